//! The published messages, by which the framer recognises a frame.

use super::table;

/// Layout of a published message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Known {
    /// `CRC_EXTRA`, the byte that fixes the layout.
    pub extra: u8,
    /// Bytes of payload without extensions: what MAVLink 1 sends. MAVLink 2 cuts off trailing zeros.
    pub shortest: u8,
}

/// The published message with this id.
#[must_use]
#[inline(never)]
pub fn known(message_id: u32) -> Option<Known> {
    let id = u16::try_from(message_id).ok()?;
    let at = table::IDS.binary_search(&id).ok()?;
    Some(Known { extra: table::EXTRAS[at], shortest: table::SHORTEST[at] })
}

/// The ids of all published messages, ascending.
pub fn known_ids() -> impl Iterator<Item = u32> {
    table::IDS.iter().copied().map(u32::from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialect::MavMessage;
    use mavlink_core::{MavlinkVersion, Message};

    #[test]
    fn the_messages_of_our_dialect_are_in_the_table_with_their_layout() {
        for &id in MavMessage::all_ids() {
            let known = known(id).unwrap();
            assert_eq!(known.extra, MavMessage::extra_crc(id), "{id}");
            // No zeros at the end, so nothing is cut off.
            let full = MavMessage::parse(MavlinkVersion::V2, id, &[0xFF; 255]).unwrap();
            let length = full.ser(MavlinkVersion::V2, &mut [0; 255]);
            assert!(usize::from(known.shortest) <= length, "{id}: {length}");
        }
    }

    #[test]
    fn ids_ascend_and_no_message_is_empty() {
        assert!(table::IDS.is_sorted_by(|a, b| a < b));
        for id in known_ids() {
            assert!(known(id).unwrap().shortest > 0, "{id}");
        }
        for stranger in [3, 433, 0xFFFF, 0x1_0000, 0xFF_FFFF] {
            assert_eq!(known(stranger), None, "{stranger}");
        }
    }
}
