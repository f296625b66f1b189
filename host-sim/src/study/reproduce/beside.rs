//! How lines of published numbers beside ours are written.

use crate::drive::suite::Tally;
use crate::study::reproduce::{Beside, Judgement, Study, Verdict};

pub(super) fn line<S: Study>(what: String, [published, theirs, ours]: [String; 3]) -> Beside {
    Beside { experiment: S::NAME.to_owned(), what, published, theirs, ours }
}

pub(super) fn judged<S: Study>(figure: &str, verdict: Verdict, why: String) -> Judgement {
    Judgement { experiment: S::NAME.to_owned(), figure: figure.to_owned(), verdict, why }
}

/// A number, or a dash if there is none.
pub(super) fn shown(number: f64, decimals: usize) -> String {
    if number.is_finite() { format!("{number:.decimals$}") } else { "no number".to_owned() }
}

/// The same with its sign.
pub(super) fn signed(number: f64, decimals: usize) -> String {
    if number.is_finite() { format!("{number:+.decimals$}") } else { "no number".to_owned() }
}

pub(super) fn empty() -> String {
    String::new()
}

pub(super) fn percent(share: Option<f64>) -> String {
    share.map_or_else(empty, |share| format!("{:.1} %", 100.0 * share))
}

/// `61.0 % of 100`.
pub(super) fn rate(tally: &Tally) -> String {
    tally.success_rate.map_or_else(empty, |rate| format!("{:.1} % of {}", 100.0 * rate, tally.runs))
}
