//! Frames out.

use mavlink_core::{MAVLinkV2MessageRaw, MavHeader, MessageData};

use super::Header;
use crate::dialect::MavMessage;

/// Writes one frame into `sink` and says how long it is; 0 when it does not fit. [`FRAME_MAX`](super::FRAME_MAX) bytes
/// always suffice.
pub fn encode(header: Header, message: &MavMessage, sink: &mut [u8]) -> usize {
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message(mav_header(header), message);
    copy_out(&raw, sink)
}

/// [`encode`] for a message whose type is known when compiling: the other messages' encoders are not linked.
pub fn encode_data<D: MessageData>(header: Header, data: &D, sink: &mut [u8]) -> usize {
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message_data(mav_header(header), data);
    copy_out(&raw, sink)
}

fn mav_header(header: Header) -> MavHeader {
    MavHeader { system_id: u32::from(header.system_id), component_id: header.component_id, sequence: header.sequence }
}

fn copy_out(raw: &MAVLinkV2MessageRaw, sink: &mut [u8]) -> usize {
    let bytes = raw.raw_bytes();
    let Some(room) = sink.get_mut(..bytes.len()) else {
        return 0;
    };
    room.copy_from_slice(bytes);
    bytes.len()
}
