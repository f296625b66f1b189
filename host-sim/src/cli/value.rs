//! Values of options: what is refused is named with the range that would be accepted.

use std::ops::RangeInclusive;

use clap::builder::{StringValueParser, TypedValueParser};
use foxhound_sim::scenario::input::InputError;

/// A number. Whether it is inside its range is checked where it is used, and said in the same words as of a file's; here
/// only what is no number is refused.
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
