//! Configuration errors: which field, which value, which range. They are not returned at run time.

use core::fmt;

/// A refused configuration value.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ConfigError {
    /// The field's path as the user wrote it, such as `planner.margin_m`.
    pub field: &'static str,
    /// The refused value.
    pub value: f32,
    /// Why it was refused.
    pub why: Why,
}

/// Why a configuration value was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Why {
    /// Not a finite number.
    NotFinite,
    /// Outside the closed range `[min, max]`.
    OutOfRange {
        /// Smallest accepted value.
        min: f32,
        /// Largest accepted value.
        max: f32,
    },
    /// Contradicts another field or physics; the text says which.
    Inconsistent(&'static str),
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.why {
            Why::NotFinite => write!(f, "{} = {} is not a finite number", self.field, self.value),
            Why::OutOfRange { min, max } => {
                write!(f, "{} = {} is outside {min}..={max}", self.field, self.value)
            }
            Why::Inconsistent(text) => write!(f, "{} = {}: {text}", self.field, self.value),
        }
    }
}

impl core::error::Error for ConfigError {}

/// Accepts `value` when it is finite and inside `[min, max]`.
///
/// # Errors
/// [`Why::NotFinite`] or [`Why::OutOfRange`], naming `field`.
#[inline(never)]
pub fn check(field: &'static str, value: f32, min: f32, max: f32) -> Result<f32, ConfigError> {
    if !value.is_finite() {
        return Err(ConfigError { field, value, why: Why::NotFinite });
    }
    if value < min || value > max {
        return Err(ConfigError { field, value, why: Why::OutOfRange { min, max } });
    }
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn the_message_names_field_value_and_range() {
        let error = check("guard.v_max_mps", 99.0, 0.1, 10.0).unwrap_err();
        assert_eq!(error.to_string(), "guard.v_max_mps = 99 is outside 0.1..=10");
        let error = check("guard.v_max_mps", f32::NAN, 0.1, 10.0).unwrap_err();
        assert_eq!(error.why, Why::NotFinite);
    }
}
