//! What an image may have been built without: the features of this crate.

use foxhound_core::base::error::{ConfigError, Why};
use foxhound_core::doa::radio::Sends;
use foxhound_core::guidance;

/// Refuses a configuration that needs what this image does not have.
///
/// # Errors
/// The field that asks for it.
pub fn check(config: &guidance::Config) -> Result<(), ConfigError> {
    let needs_iq = config.radio.is_some_and(|radio| radio.sends == Sends::IqReports);
    let needs_pad = config.landing.is_some_and(|landing| landing.has_camera);
    let refuse = |field, text| Err(ConfigError { field, value: 1.0, why: Why::Inconsistent(text) });
    if needs_iq && !cfg!(feature = "iq") {
        return refuse("radio.sends", "this image does not read IQ reports");
    }
    if needs_pad && !cfg!(feature = "pad") {
        return refuse("landing.has_camera", "this image has no pad detector");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::guidance::param::{self, Values};
    use foxhound_core::landing;

    #[test]
    fn a_configuration_that_needs_an_absent_part_is_refused_by_field() {
        let mut values = Values::DEFAULT;
        values.set(param::FH_BRG_SRC, 2.0).unwrap();
        let mut iq = guidance::Config::default();
        values.apply(&mut iq);
        let with_camera = landing::Config { has_camera: true, ..landing::Config::default() };
        let pad = guidance::Config { landing: Some(with_camera), ..guidance::Config::default() };
        for (config, has, field) in
            [(iq, cfg!(feature = "iq"), "radio.sends"), (pad, cfg!(feature = "pad"), "landing.has_camera")]
        {
            assert_eq!(check(&config).err().map(|error| error.field), (!has).then_some(field));
        }
        assert!(check(&guidance::Config::default()).is_ok());
    }
}
