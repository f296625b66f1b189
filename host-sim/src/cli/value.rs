//! Values of options: an error names the accepted range.

use std::ops::RangeInclusive;

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
