//! The report of a flight: one self-contained HTML file that works offline.
//!
//! A [`Recorder`] watches the flight and makes records, a line of JSON each. A file's are collected in [`Kept`],
//! which thins those of a long flight, and stand in the page kind by kind, as gzip, as Base64; the page's script takes them one by one
//! with its function `add`. Those of a live flight arrive as they are made ([`Live`]).
//!
//! | file | content |
//! |---|---|
//! | `record.rs`, `keep.rs` | the records; which of them a file holds |
//! | `signal.rs`, `picture.rs` | records of what was heard and seen |
//! | `page/page.html`, `page.css` | layout and style: light, dark, narrow |
//! | `page/unpack.js`, `data.js` | the records of a file; `add(record)`, and the state at a time |
//! | `page/draw.js`, `map.js`, `field.js`, `charts.js`, `section.js`, `heard.js` | the pictures, on plain canvases |
//! | `page/space.js`, `vendor/` | the view in space, by WebGL, and its library |
//! | `page/tables.js`, `main.js` | text and numbers; playback, keys, tabs, themes |
//! | `page/live.js` | fetches the records of a live flight; only in the live page |
//!
//! The page of the built-in mission is below 300 kB, that of an hour below 5 MB (`tests/cli/report.rs`).

use std::io::{self, Write as _};
use std::path::Path;

use base64::prelude::{BASE64_STANDARD, Engine as _};
use flate2::Compression;
use flate2::write::GzEncoder;

use crate::scenario::input::InputError;
use crate::scenario::output;

mod beside;
mod keep;
mod live;
mod picture;
pub(crate) mod record;
mod recorder;
mod signal;

pub use beside::Beside;
pub use keep::Kept;
pub use live::Live;
use record::Record;
pub use recorder::Recorder;

const HTML: &str = include_str!("page/page.html");
const STYLE: &str = include_str!("page/page.css");
/// In the order of their dependencies.
const SCRIPTS: [&str; 11] = [
    include_str!("page/unpack.js"),
    include_str!("page/data.js"),
    include_str!("page/draw.js"),
    include_str!("page/map.js"),
    include_str!("page/field.js"),
    include_str!("page/charts.js"),
    include_str!("page/section.js"),
    include_str!("page/heard.js"),
    include_str!("page/space.js"),
    include_str!("page/tables.js"),
    include_str!("page/main.js"),
];

/// The library that draws in space.
const LIBRARY: &str = include_str!("page/vendor/ogl.min.js");
/// Only in the live page.
const LIVE_SCRIPT: &str = include_str!("page/live.js");
const LIVE_POLICY: &str = "; connect-src 'self'";

/// The hosts that a page may contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Contact {
    /// None: the page is self-contained.
    None,
    /// Its own server.
    Live,
}

/// The page with these records in it.
///
/// # Errors
/// None that is known: the bytes are written to memory.
pub fn page(records: &[Record]) -> io::Result<String> {
    // Those of a kind stand together, which makes the file smaller.
    let mut sorted: Vec<&Record> = records.iter().collect();
    sorted.sort_by_key(|record| record.rank());
    let mut lines = Vec::new();
    for record in sorted {
        serde_json::to_writer(&mut lines, record)?;
        lines.push(b'\n');
    }
    let mut gzip = GzEncoder::new(Vec::new(), Compression::best());
    gzip.write_all(&lines)?;
    Ok(page_of(&BASE64_STANDARD.encode(gzip.finish()?), Contact::None))
}

fn page_of(records: &str, contact: Contact) -> String {
    // One pass over the template: inserted text is not scanned again.
    let mut page = String::with_capacity(HTML.len() + STYLE.len() + records.len() + (1 << 16));
    let mut rest = HTML;
    while let Some((before, behind)) = rest.split_once("<!--") {
        let (name, after) = behind.split_once("-->").unwrap_or((behind, ""));
        page.push_str(before);
        match name {
            "style" => page.push_str(STYLE),
            "records" => page.push_str(records),
            "library" => page.push_str(LIBRARY),
            "scripts" => {
                page.push_str(&SCRIPTS.concat());
                page.push_str(if contact == Contact::Live { LIVE_SCRIPT } else { "" });
            }
            "contact" => page.push_str(if contact == Contact::Live { LIVE_POLICY } else { "" }),
            _ => {}
        }
        rest = after;
    }
    page.push_str(rest);
    page
}

/// Writes the page to a file.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, kept: &Kept) -> Result<(), InputError> {
    let page = page(kept.records()).map_err(|error| InputError::new(format!("{}: {error}", path.display())))?;
    output::write(path, page.as_bytes())
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;
    use crate::drive::flight::Mission;
    use crate::scenario::Scenario;
    use foxhound_core::guidance::param::Values;

    #[test]
    fn what_a_scenario_is_called_cannot_end_the_script_that_it_stands_in() {
        let name = "</script><script>alert(1)</script><!--style-->";
        let scenario = Scenario { name: name.to_owned(), ..Scenario::built_in() };
        let mission = Mission {
            scenario,
            seed: 1,
            planner: foxhound_core::planning::planner::Config::default(),
            estimator: foxhound_core::doa::bearing::Estimator::default(),
        };
        let mut recorder =
            Recorder::new(&mission, &mission.guidance(), &Values::of(&mission.guidance()), name.to_owned());
        let page = page(&recorder.take()).unwrap();
        assert_eq!(page.matches("</script>").count(), HTML.matches("</script>").count());
        assert_eq!((page.matches("alert(1)").count(), page.matches(STYLE).count()), (0, 1));
    }

    #[test]
    fn the_page_asks_nobody_for_anything() {
        let page = page(&[]).unwrap();
        for address in ["http:", "https:", "//cdn", "src=", "@import", "url("] {
            let allowed = match address {
                "http:" => page.matches("http://www.w3.org/2000/svg").count(),
                // A field of the library's blending is called so.
                "src=" => LIBRARY.matches("blendFunc.src=").count(),
                _ => 0,
            };
            assert_eq!(page.matches(address).count(), allowed, "{address}");
        }
        assert!(!page.contains("connect-src") && !page.contains("fetch("));
    }

    #[test]
    fn the_library_is_the_one_whose_licence_is_beside_it() {
        let licence = include_str!("page/vendor/LICENSE-ogl");
        assert!(licence.contains("released into the public domain") && LIBRARY.starts_with("/* OGL 1.0.11 "));
        let mut packed = flate2::read::GzEncoder::new(LIBRARY.as_bytes(), flate2::Compression::best());
        let mut bytes = Vec::new();
        packed.read_to_end(&mut bytes).unwrap();
        assert!(bytes.len() < 20_000, "{} bytes", bytes.len());
    }
}
