//! What is believed of frames that are not signed, where there is a key.

/// HEARTBEAT, `RADIO_STATUS`, `ADSB_VEHICLE`, COLLISION: what PX4 takes unsigned, from senders that cannot sign.
const OPEN: [u32; 4] = [0, 109, 246, 247];
/// `PARAM_REQUEST_READ`, `PARAM_REQUEST_LIST`, `COMMAND_ACK`, `AUTOPILOT_VERSION`, STATUSTEXT: nothing moves for these.
const IDLE: [u32; 5] = [20, 21, 77, 148, 253];
const HEARTBEAT: u32 = 0;
const RADIO_STATUS: u32 = 109;
const SETUP_SIGNING: u32 = 256;

/// Which unsigned frames are taken where there is a key. (Where there is none, all are, signed ones included.)
///
/// | | HEARTBEAT, `RADIO_STATUS` | `ADSB_VEHICLE`, COLLISION | what moves nothing | all others |
/// |---|---|---|---|---|
/// | `Always` | yes | yes | yes | yes |
/// | `UntilFirstSigned` | yes | yes | until a signed frame was heard | no |
/// | `HeartbeatAndRadioStatusOnly` | yes | no | no | no |
///
/// What moves nothing: requests for parameters, acknowledgements, texts, the autopilot's version. So except by `Always`
/// no unsigned position, attitude, obstacle, command or parameter counts, from the start. An unsigned heartbeat says
/// that somebody is there; by itself it must not give control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Unsigned {
    /// All of them: to sign for a peer that demands it and cannot sign itself.
    Always,
    /// What cannot move us, until somebody signs.
    #[default]
    UntilFirstSigned,
    /// Signs of life only.
    HeartbeatAndRadioStatusOnly,
}

impl Unsigned {
    /// Whether an unsigned frame of this message is taken; `signed_heard` once there was a frame with a right signature.
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
