//! What a ground station sends to a companion, and what is heard of one.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use foxhound_core::guidance::param::Id;
use foxhound_link::dialect::{COMMAND_LONG_DATA, MavMessage, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, STATUSTEXT_DATA};
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode_data};
use foxhound_link::{CharArray, MessageData};

/// Who a ground station is, and of whom it asks something.
pub const STATION: Header = Header { system_id: 255, component_id: 190, sequence: 0 };
const COMPANION: (u8, u8) = (1, 191);

/// A frame with a message.
#[must_use]
pub fn frame<D: MessageData>(sender: Header, message: &D) -> Vec<u8> {
    let mut frame = vec![0; FRAME_MAX];
    let length = encode_data(sender, message, &mut frame);
    frame.truncate(length);
    frame
}

/// Sets a parameter.
#[must_use]
pub fn set(id: Id, param_value: f32) -> Vec<u8> {
    let (target_system, target_component) = COMPANION;
    let param_id = CharArray::new(*id.padded_name());
    frame(STATION, &PARAM_SET_DATA { target_system, target_component, param_id, param_type: 9, param_value })
}

/// Asks for a parameter.
#[must_use]
pub fn read(id: Id) -> Vec<u8> {
    let (target_system, target_component) = COMPANION;
    let param_id = CharArray::new(*id.padded_name());
    frame(STATION, &PARAM_REQUEST_READ_DATA { target_system, target_component, param_id, param_index: -1 })
}

/// Commands something.
#[must_use]
pub fn command(command: u16, param1: f32, param2: f32) -> Vec<u8> {
    let (target_system, target_component) = COMPANION;
    let more = COMMAND_LONG_DATA::DEFAULT;
    frame(STATION, &COMMAND_LONG_DATA { target_system, target_component, command, param1, param2, ..more })
}

/// Stores the parameters that hold.
#[must_use]
pub fn save() -> Vec<u8> {
    command(245, 1.0, 0.0)
}

/// The messages that these bytes complete, each with its sender.
#[must_use]
pub fn messages(framer: &mut Framer, bytes: &[u8]) -> Vec<(Header, MavMessage)> {
    let mut messages = Vec::new();
    framer.each(bytes, |frame| messages.extend(frame.message().map(|message| (frame.header, message))));
    messages
}

/// A text for the pilot.
#[must_use]
pub fn words(text: &STATUSTEXT_DATA) -> String {
    text.text.to_str().unwrap().to_owned()
}
