//! The payload of a frame, to be read as one message type.

use mavlink_core::{MavlinkVersion, Message as _, MessageData};

use super::{Frame, PAYLOAD_MAX};
use crate::dialect::MavMessage;

/// The payload of a frame, with the trailing zeros restored that its sender cut off.
///
/// [`Frame::message`] can return any message, and so links the decoders of all of them; this links only those that are
/// used.
#[derive(Clone, Copy, Debug)]
pub struct Content {
    message_id: u32,
    payload: [u8; PAYLOAD_MAX],
}

impl Content {
    /// The payload of a frame, if it is a message of our dialect.
    #[must_use]
    #[inline(never)]
    pub fn of(frame: &Frame<'_>) -> Option<Self> {
        if !is_ours(frame.message_id) {
            return None;
        }
        let mut payload = [0; PAYLOAD_MAX];
        super::fill(&mut payload, frame.payload);
        Some(Self { message_id: frame.message_id, payload })
    }

    /// Which message it is.
    #[must_use]
    pub const fn message_id(&self) -> u32 {
        self.message_id
    }

    /// The message, as type `D`; check with [`Self::message_id`] that it is one.
    #[must_use]
    pub fn read<D: MessageData + Default>(&self) -> D {
        // No payload is too short, and our dialect has no undefined values that fail to parse.
        D::deser(MavlinkVersion::V2, &self.payload).unwrap_or_default()
    }
}

impl From<&MavMessage> for Content {
    fn from(message: &MavMessage) -> Self {
        let mut payload = [0; PAYLOAD_MAX];
        message.ser(MavlinkVersion::V2, &mut payload);
        Self { message_id: message.message_id(), payload }
    }
}

/// Whether a message is one of our dialect.
#[inline(never)]
pub(super) fn is_ours(message_id: u32) -> bool {
    MavMessage::all_ids().binary_search(&message_id).is_ok()
}
