//! Values of options: an error names the accepted range.

use std::ops::RangeInclusive;
use std::path::Path;

use clap::builder::{StringValueParser, TypedValueParser};
use foxhound_sim::scenario::input::InputError;

/// A number. Its range is checked where it is used, with the same error text as for a value in a file; here only
/// what is not a number is refused.
pub(super) fn number(range: RangeInclusive<f64>) -> impl TypedValueParser<Value = f64> {
    StringValueParser::new().try_map(move |text| {
        let refused = || InputError::new(format!("expected a number in {}..={}", range.start(), range.end()));
        text.parse().map_err(|_| refused())
    })
}

/// A whole number in a range.
pub(super) fn whole<T>(range: RangeInclusive<u64>) -> impl TypedValueParser<Value = T>
where
    T: TryFrom<u64> + Clone + Send + Sync + 'static,
{
    StringValueParser::new().try_map(move |text| {
        let refused = || InputError::new(format!("expected a whole number in {}..={}", range.start(), range.end()));
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.and_then(|number| T::try_from(number).ok()).ok_or_else(refused)
    })
}

/// Checks that no two of these files are one, or a result would replace what was read, or another result.
pub(super) fn check_apart(files: &[(&str, Option<&Path>)]) -> Result<(), InputError> {
    let is_file = |path: &Path| !path.metadata().is_ok_and(|there| !there.is_file());
    let place = |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path)).ok();
    let mut named: Vec<(&str, _)> = Vec::new();
    for (option, path) in files.iter().filter_map(|(option, path)| path.map(|path| (*option, path))) {
        let here = place(path).filter(|_| is_file(path));
        if let Some((other, _)) = named.iter().find(|(_, there)| here.is_some() && *there == here) {
            return Err(InputError::new(format!("{option} {}: is also the file of {other}", path.display())));
        }
        named.push((option, here));
    }
    Ok(())
}
