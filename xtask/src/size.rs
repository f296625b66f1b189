//! What the link takes of the flash: `cargo xtask size`.
//!
//! Two images are compared: one that drives everything of the link, with numbers that the compiler does not know, and
//! one that does nothing. Both are built as the product is, and both start, halt and panic the same way.

use std::collections::BTreeMap;

use object::{Object as _, ObjectSection as _, ObjectSymbol as _};
use serde_json::json;

use crate::Failure;
use crate::board;
use crate::build::{Image, Parts};
use crate::thumb::readable;

/// What the link may take, signing and parameters included.
const TEXT_MAX: u64 = 16 * 1024;
/// Where the RAM begins.
const RAM: u64 = 0x2000_0000;
/// Smaller crates are put together.
const LISTED_MIN: u64 = 1000;
/// How many functions are listed.
const LISTED: usize = 24;

/// Builds both images, prints what lies between them, and fails when that is too much or needs a heap.
pub(crate) fn run(json: bool) -> Result<(), Failure> {
    let base = Program::read(&Image::build(board::NUCLEO, "size_base")?)?;
    let link = Program::read(&Image::build(board::NUCLEO, "size_link")?)?;
    let (text, rodata) = (link.text.saturating_sub(base.text), link.rodata.saturating_sub(base.rodata));
    if json {
        let largest: Vec<_> =
            link.added(&base).into_iter().map(|(name, bytes)| json!({"name": name, "bytes": bytes})).collect();
        let row = |program: &Program| json!({"text_bytes": program.text, "rodata_bytes": program.rodata});
        let report = json!({
            "base": row(&base),
            "with_link": row(&link),
            "link": {"text_bytes": text, "rodata_bytes": rodata, "text_bytes_max": TEXT_MAX},
            "allocator": link.allocator,
            "functions": largest,
        });
        println!("{report}");
    } else {
        println!("{:<16} {:>8} {:>8}", "", ".text", ".rodata");
        println!("{:<16} {:>8} {:>8}", "without link", base.text, base.rodata);
        println!("{:<16} {:>8} {:>8}", "with link", link.text, link.rodata);
        println!("{:<16} {text:>8} {rodata:>8}   .text of {TEXT_MAX} allowed", "link");
        println!();
        for (name, bytes) in link.added(&base).into_iter().take(LISTED) {
            println!("{bytes:>8}  {name}");
        }
    }
    if let Some(symbol) = link.allocator {
        return Err(Failure(format!("the link needs a heap: {symbol}")));
    }
    if text > TEXT_MAX {
        return Err(Failure(format!("the link takes {text} bytes of .text, {} too many", text - TEXT_MAX)));
    }
    Ok(())
}

/// Prints a row for each layer of the core and each other crate in the board's image, bytes of code and of named constants; and
/// the longest functions.
pub(crate) fn layers(parts: Parts) -> Result<(), Failure> {
    let image = Image::with(parts, board::NUCLEO)?;
    let unreadable = |why: String| Failure(format!("{}: {why}", image.elf.display()));
    let bytes = std::fs::read(&image.elf).map_err(|error| unreadable(error.to_string()))?;
    let file = object::File::parse(bytes.as_slice()).map_err(|error| unreadable(error.to_string()))?;
    let mut rows: BTreeMap<String, [u64; 2]> = BTreeMap::new();
    for symbol in file.symbols().filter(|symbol| symbol.address() < RAM && symbol.size() > 0) {
        let column = match symbol.kind() {
            object::SymbolKind::Text => 0,
            object::SymbolKind::Data => 1,
            _ => continue,
        };
        rows.entry(layer(&readable(symbol.name().unwrap_or_default()))).or_default()[column] += symbol.size();
    }
    let mut rows: Vec<_> = rows.into_iter().collect();
    rows.sort_by_key(|(_, [code, constants])| std::cmp::Reverse(code + constants));
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
    for (name, bytes) in Program::read(&image)?.added(&Program::default()).into_iter().take(LISTED) {
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

/// What there is in an image.
#[derive(Default)]
struct Program {
    text: u64,
    rodata: u64,
    /// Bytes by function.
    functions: BTreeMap<String, u64>,
    /// A symbol of an allocator.
    allocator: Option<String>,
}

impl Program {
    fn read(image: &Image) -> Result<Self, Failure> {
        let unreadable = |why: String| Failure(format!("{}: {why}", image.elf.display()));
        let bytes = std::fs::read(&image.elf).map_err(|error| unreadable(error.to_string()))?;
        let file = object::File::parse(bytes.as_slice()).map_err(|error| unreadable(error.to_string()))?;
        let section = |name| file.section_by_name(name).map(|section| section.size());
        let text = section(".text").ok_or_else(|| unreadable("no .text".to_owned()))?;
        let mut functions = BTreeMap::new();
        let mut allocator = None;
        for symbol in file.symbols() {
            let name = symbol.name().unwrap_or_default();
            if is_allocator(name) {
                allocator = Some(name.to_owned());
            }
            if symbol.kind() == object::SymbolKind::Text && symbol.size() > 0 {
                *functions.entry(readable(name)).or_insert(0) += symbol.size();
            }
        }
        if functions.len() < 20 {
            return Err(unreadable("it has no symbols, so nothing can be said of it".to_owned()));
        }
        Ok(Self { text, rodata: section(".rodata").unwrap_or(0), functions, allocator })
    }

    /// The functions that are new or longer than in another program, longest first.
    fn added(&self, other: &Self) -> Vec<(&str, u64)> {
        let mut added: Vec<(&str, u64)> = self
            .functions
            .iter()
            .map(|(name, bytes)| (name.as_str(), bytes.saturating_sub(other.functions.get(name).copied().unwrap_or(0))))
            .filter(|(_, bytes)| *bytes > 0)
            .collect();
        added.sort_by_key(|(_, bytes)| std::cmp::Reverse(*bytes));
        added
    }
}

fn is_allocator(name: &str) -> bool {
    ["__rust_alloc", "__rg_alloc", "__rdl_alloc", "__rust_realloc"].iter().any(|part| name.contains(part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_new_or_longer_is_listed_longest_first() {
        let program = |functions: &[(&str, u64)]| Program {
            text: 0,
            rodata: 0,
            functions: functions.iter().map(|(name, bytes)| ((*name).to_owned(), *bytes)).collect(),
            allocator: None,
        };
        let (base, link) = (program(&[("a", 5), ("b", 9)]), program(&[("a", 7), ("b", 9), ("c", 30)]));
        assert_eq!(link.added(&base), [("c", 30), ("a", 2)]);
    }

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

    #[test]
    fn an_allocator_is_known_by_any_of_its_names() {
        assert!(is_allocator("__rust_alloc") && is_allocator("_R7__rustc12___rust_alloc_zeroed"));
        assert!(!is_allocator("memcpy"));
    }
}
