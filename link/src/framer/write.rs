//! Encodes frames.

use mavlink_core::utils::remove_trailing_zeroes;
use mavlink_core::{MavlinkVersion, Message as _, MessageData, calculate_crc};

use super::{CHECKSUM, HEADER, Header, PAYLOAD_MAX, STX};
use crate::dialect::MavMessage;

/// A message that waits to be sent: its frame without the header, which is made at the moment of sending.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Packed<Payload: ?Sized = [u8]> {
    message_id: u16,
    extra: u8,
    payload: Payload,
}

impl<const LENGTH: usize> Packed<[u8; LENGTH]> {
    pub(crate) fn new<D: MessageData>(data: &D) -> Self {
        const { assert!(D::ENCODED_LEN <= LENGTH && D::ID <= u16::MAX as u32) };
        let mut payload = [0; LENGTH];
        data.ser(MavlinkVersion::V2, &mut payload);
        Self { message_id: D::ID as u16, extra: D::EXTRA_CRC, payload }
    }
}

impl<Payload: ?Sized> Packed<Payload> {
    /// Whether it is that message.
    pub(crate) fn is(&self, message_id: u32) -> bool {
        u32::from(self.message_id) == message_id
    }
}

impl Packed {
    /// Writes its frame into `sink` and returns its length; 0 when it does not fit.
    #[inline(never)]
    pub(crate) fn write(&self, header: Header, sink: &mut [u8]) -> usize {
        write(header, u32::from(self.message_id), self.extra, &self.payload, sink)
    }
}

/// Writes one frame into `sink` and returns its length; 0 when it does not fit. [`FRAME_MAX`](super::FRAME_MAX) bytes
/// always suffice.
pub fn encode(header: Header, message: &MavMessage, sink: &mut [u8]) -> usize {
    let mut payload = [0; PAYLOAD_MAX];
    message.ser(MavlinkVersion::V2, &mut payload);
    let message_id = message.message_id();
    write(header, message_id, MavMessage::extra_crc(message_id), &payload, sink)
}

/// [`encode`] for a message whose type is known when compiling: the other messages' encoders are not linked.
pub fn encode_data<D: MessageData>(header: Header, data: &D, sink: &mut [u8]) -> usize {
    let packed: &Packed = &Packed::<[u8; PAYLOAD_MAX]>::new(data);
    packed.write(header, sink)
}

/// Zeros at the end of the payload are cut off.
fn write(header: Header, message_id: u32, extra: u8, payload: &[u8], sink: &mut [u8]) -> usize {
    let payload = &payload[..remove_trailing_zeroes(payload)];
    let body = HEADER + payload.len();
    let Some(frame) = sink.get_mut(..body + CHECKSUM) else { return 0 };
    let Header { system_id, component_id, sequence } = header;
    let [id_0, id_1, id_2, _] = message_id.to_le_bytes();
    let start = [STX, payload.len() as u8, 0, 0, sequence, system_id, component_id, id_0, id_1, id_2];
    frame[..HEADER].copy_from_slice(&start);
    frame[HEADER..body].copy_from_slice(payload);
    let checksum = calculate_crc(&frame[1..body], extra);
    frame[body..].copy_from_slice(&checksum.to_le_bytes());
    body + CHECKSUM
}
