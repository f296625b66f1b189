//! Which unsigned frames are accepted once there is a key.

/// HEARTBEAT, `RADIO_STATUS`, `ADSB_VEHICLE`, COLLISION: what PX4 takes unsigned, from senders that cannot sign.
const OPEN: [u32; 4] = [0, 109, 246, 247];
/// `PARAM_REQUEST_READ`, `PARAM_REQUEST_LIST`, `COMMAND_ACK`, `AUTOPILOT_VERSION`, STATUSTEXT: none of them can move
/// the vehicle.
const IDLE: [u32; 5] = [20, 21, 77, 148, 253];
const HEARTBEAT: u32 = 0;
const RADIO_STATUS: u32 = 109;
const SETUP_SIGNING: u32 = 256;

/// Which unsigned frames are accepted once there is a key. (Without a key all frames are, signed or not.)
///
/// | | HEARTBEAT, `RADIO_STATUS` | `ADSB_VEHICLE`, COLLISION | harmless messages | all others |
/// |---|---|---|---|---|
/// | `Always` | yes | yes | yes | yes |
/// | `UntilFirstSigned` | yes | yes | until a signed frame was received | no |
/// | `HeartbeatAndRadioStatusOnly` | yes | no | no | no |
///
/// Harmless messages: requests for parameters, acknowledgements, texts, the autopilot's version. So except by `Always`
/// no unsigned position, attitude, obstacle, command or parameter is accepted, from the start. An unsigned heartbeat
/// says that somebody is there; it must not give control by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Unsigned {
    /// All of them: for a peer that requires signatures and cannot sign itself.
    Always,
    /// Those that cannot move the vehicle, until the first signed frame.
    #[default]
    UntilFirstSigned,
    /// Heartbeats and radio status only.
    HeartbeatAndRadioStatusOnly,
}

impl Unsigned {
    /// Whether an unsigned frame of this message is accepted; `signed_heard` once there was a frame with a valid
    /// signature.
    #[must_use]
    pub fn takes(self, message_id: u32, signed_heard: bool) -> bool {
        match self {
            Self::Always => true,
            Self::UntilFirstSigned => OPEN.contains(&message_id) || (!signed_heard && IDLE.contains(&message_id)),
            Self::HeartbeatAndRadioStatusOnly => matches!(message_id, HEARTBEAT | RADIO_STATUS),
        }
    }
}

/// Whether a message carries a key: it is never forwarded, logged, recorded or printed.
#[must_use]
pub const fn is_secret(message_id: u32) -> bool {
    message_id == SETUP_SIGNING
}
