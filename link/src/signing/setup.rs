//! Keys that are set over the link.

use foxhound_core::base::time::Instant;

use super::{Key, Signing, TIMESTAMP_MAX};
use crate::dialect::SETUP_SIGNING_DATA;

/// The result of a `SETUP_SIGNING`.
#[derive(Clone, Debug)]
pub enum Setup {
    /// It is for somebody else.
    NotOurs,
    /// Keys are not accepted now, or its timestamp is invalid.
    Refused,
    /// No signing from now on: forget the key.
    Off,
    /// Sign with this from now on: store the key, and the timestamp when it is due, which is at once.
    On(Signing),
}

/// Checks a key that came over the link. It is accepted, signed or not, only while `provisioning`: somebody is at the
/// vehicle, which is disarmed, has said so by other means than the link, and the link is a local one. `us` are our
/// system and component.
///
/// The key that is already in use keeps its streams and timestamps, so that sending it again gives no attacker an
/// advantage.
#[must_use]
#[inline(never)]
pub fn set_up(
    now: Instant,
    message: &SETUP_SIGNING_DATA,
    us: (u8, u8),
    provisioning: bool,
    link_id: u8,
    current: Option<&Signing>,
) -> Setup {
    if message.target_system != us.0 || ![0, us.1].contains(&message.target_component) {
        return Setup::NotOurs;
    }
    if !provisioning || message.initial_timestamp > TIMESTAMP_MAX {
        return Setup::Refused;
    }
    let Some(key) = Key::new(message.secret_key) else { return Setup::Off };
    let mut signing = match current {
        Some(current) if current.key == key => Signing { link_id, ..current.clone() },
        // The clock stays what it was.
        _ => Signing { start: current.map_or(0, |current| current.start), ..Signing::new(key, link_id) },
    };
    signing.restore(now, message.initial_timestamp);
    signing.stored = 0;
    Setup::On(signing)
}
