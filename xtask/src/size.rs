//! What takes the flash of the NUCLEO-G474RE's image: `cargo xtask size`.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use object::{Object as _, ObjectSymbol as _};

use crate::Failure;
use crate::board;
use crate::build::{Image, Parts};
use crate::thumb::readable;

/// Where the RAM begins.
const RAM: u64 = 0x2000_0000;
/// Smaller crates are put together.
const LISTED_MIN: u64 = 1000;
/// How many functions are listed.
const LISTED: usize = 24;

/// Prints a row for each layer of the core and each other crate in the board's image, bytes of code and of named constants; and
/// the longest functions.
pub(crate) fn run(parts: Parts) -> Result<(), Failure> {
    let image = Image::with(parts, board::NUCLEO)?;
    let unreadable = |why: String| Failure(format!("{}: {why}", image.elf.display()));
    let bytes = std::fs::read(&image.elf).map_err(|error| unreadable(error.to_string()))?;
    let file = object::File::parse(bytes.as_slice()).map_err(|error| unreadable(error.to_string()))?;
    let (mut rows, mut functions) = (BTreeMap::<String, [u64; 2]>::new(), BTreeMap::<String, u64>::new());
    for symbol in file.symbols().filter(|symbol| symbol.address() < RAM && symbol.size() > 0) {
        let column = match symbol.kind() {
            object::SymbolKind::Text => 0,
            object::SymbolKind::Data => 1,
            _ => continue,
        };
        let name = readable(symbol.name().unwrap_or_default());
        rows.entry(layer(&name)).or_default()[column] += symbol.size();
        if column == 0 {
            *functions.entry(name).or_default() += symbol.size();
        }
    }
    let mut rows: Vec<_> = rows.into_iter().collect();
    rows.sort_by_key(|(_, [code, constants])| Reverse(code + constants));
    println!("| where | code | named constants |\n|---|---|---|");
    let (mut rest, mut named) = ([0; 2], 0);
    for (layer, [code, constants]) in rows {
        named += code + constants;
        if code + constants < LISTED_MIN {
            rest = [rest[0] + code, rest[1] + constants];
        } else {
            println!("| {layer} | {code} | {constants} |");
        }
    }
    println!("| what takes less than {LISTED_MIN} each | {} | {} |", rest[0], rest[1]);
    let flash = image.size()?.flash_bytes;
    println!("| texts, tables without a name, gaps | | {} |", flash.saturating_sub(named));
    println!("| all | | {flash} |\n\n| longest functions, with what was put into them | code |\n|---|---|");
    let mut functions: Vec<_> = functions.into_iter().collect();
    functions.sort_by_key(|(_, bytes)| Reverse(*bytes));
    for (name, bytes) in functions.into_iter().take(LISTED) {
        println!("| `{name}` | {bytes} |");
    }
    Ok(())
}

/// The crate of a function, with its layer for the core.
fn layer(name: &str) -> String {
    let path = name.trim_start_matches(['<', '&', '*', '[', '(']).trim_start_matches("mut ").trim_start_matches("dyn ");
    let mut parts = path.split(['<', '>', ' ', ',']).next().unwrap_or_default().split("::");
    match (parts.next().unwrap_or_default(), parts.next()) {
        ("foxhound_core", Some(layer)) => format!("core: {layer}"),
        ("core" | "alloc" | "std", _) => "Rust's own library".to_owned(),
        (_, None) => "without a crate".to_owned(),
        (other, Some(_)) => other.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_function_belongs_to_its_crate_and_in_the_core_to_its_layer() {
        let names = [
            ("foxhound_core::planning::planner::Planner::plan", "core: planning"),
            ("<foxhound_core::control::guard::Guard as core::fmt::Debug>::fmt", "core: control"),
            ("foxhound_computer::flight::Flight<S>::serve", "foxhound_computer"),
            ("core::panicking::panic", "Rust's own library"),
            ("memcpy", "without a crate"),
        ];
        for (name, expected) in names {
            assert_eq!(layer(name), expected);
        }
    }
}
