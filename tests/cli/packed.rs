//! Reads the records of a report: lines of JSON as gzip, as Base64.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::Read as _;

use base64::prelude::{BASE64_STANDARD, Engine as _};
use flate2::read::GzDecoder;
use serde_json::Value;

/// All records of a page.
pub(crate) fn records(page: &str) -> Vec<Value> {
    let (_, behind) = page.split_once("id=\"records\">").unwrap();
    let (packed, _) = behind.split_once("</script>").unwrap();
    let mut lines = String::new();
    GzDecoder::new(BASE64_STANDARD.decode(packed).unwrap().as_slice()).read_to_string(&mut lines).unwrap();
    lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}
