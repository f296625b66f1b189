//! Frames that wait for the wire, by priority: setpoint, heartbeat, errands (answers and requests), notes (telemetry).
//!
//! What waits is the message; its frame is made when the wire is free, so that sequence numbers rise in the order of
//! sending and a setpoint is the newest one.

use heapless::Deque;

use crate::dialect::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, NAMED_VALUE_FLOAT_DATA, SET_POSITION_TARGET_LOCAL_NED_DATA,
    STATUSTEXT_DATA, TIMESYNC_DATA,
};
use crate::framer::{FRAME_MAX, Header, encode_data};

/// Answers and requests.
#[derive(Clone, Debug)]
pub(crate) enum Errand {
    Command(COMMAND_LONG_DATA),
    Ack(COMMAND_ACK_DATA),
    Timesync(TIMESYNC_DATA),
}

/// Telemetry.
#[derive(Clone, Debug)]
pub(crate) enum Note {
    Value(NAMED_VALUE_FLOAT_DATA),
    Text(STATUSTEXT_DATA),
}

/// What did not reach the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Dropped {
    pub(crate) setpoints: u32,
    pub(crate) errands: u32,
    pub(crate) notes: u32,
}

#[derive(Clone, Debug)]
pub(crate) struct Outbox {
    setpoint: Option<SET_POSITION_TARGET_LOCAL_NED_DATA>,
    heartbeat: Option<HEARTBEAT_DATA>,
    errands: Deque<Errand, 8>,
    notes: Deque<Note, 8>,
    dropped: Dropped,
    sequence: u8,
    frame: [u8; FRAME_MAX],
    sent: usize,
    end: usize,
}

impl Outbox {
    pub(crate) const fn new() -> Self {
        Self {
            setpoint: None,
            heartbeat: None,
            errands: Deque::new(),
            notes: Deque::new(),
            dropped: Dropped { setpoints: 0, errands: 0, notes: 0 },
            sequence: 0,
            frame: [0; FRAME_MAX],
            sent: 0,
            end: 0,
        }
    }

    /// The newest setpoint takes the place of one that has not left yet.
    pub(crate) fn post_setpoint(&mut self, setpoint: SET_POSITION_TARGET_LOCAL_NED_DATA) {
        if self.setpoint.replace(setpoint).is_some() {
            self.dropped.setpoints = self.dropped.setpoints.saturating_add(1);
        }
    }

    /// A setpoint that waits is taken back.
    pub(crate) fn withdraw_setpoint(&mut self) {
        self.setpoint = None;
    }

    pub(crate) fn post_heartbeat(&mut self, heartbeat: HEARTBEAT_DATA) {
        self.heartbeat = Some(heartbeat);
    }

    /// With no room left the new errand is dropped: the one who wants it asks again.
    pub(crate) fn post_errand(&mut self, errand: Errand) {
        if self.errands.push_back(errand).is_err() {
            self.dropped.errands = self.dropped.errands.saturating_add(1);
        }
    }

    /// With no room left the oldest note is dropped.
    pub(crate) fn post_note(&mut self, note: Note) {
        if self.notes.is_full() {
            self.notes.pop_front();
            self.dropped.notes = self.dropped.notes.saturating_add(1);
        }
        // There is room now.
        self.notes.push_back(note).ok();
    }

    pub(crate) const fn dropped(&self) -> Dropped {
        self.dropped
    }

    /// Fills `sink` and says how far. A frame that does not fit is continued by the next call.
    pub(crate) fn transmit(&mut self, system_id: u8, component_id: u8, sink: &mut [u8]) -> usize {
        let mut filled = 0;
        while filled < sink.len() {
            if self.sent == self.end {
                self.sent = 0;
                self.end = self.next_frame(Header { system_id, component_id, sequence: self.sequence });
                if self.end == 0 {
                    break;
                }
                self.sequence = self.sequence.wrapping_add(1);
            }
            let length = (self.end - self.sent).min(sink.len() - filled);
            sink[filled..filled + length].copy_from_slice(&self.frame[self.sent..self.sent + length]);
            self.sent += length;
            filled += length;
        }
        filled
    }

    fn next_frame(&mut self, header: Header) -> usize {
        let frame = &mut self.frame;
        if let Some(setpoint) = self.setpoint.take() {
            return encode_data(header, &setpoint, frame);
        }
        if let Some(heartbeat) = self.heartbeat.take() {
            return encode_data(header, &heartbeat, frame);
        }
        match self.errands.pop_front() {
            Some(Errand::Command(command)) => return encode_data(header, &command, frame),
            Some(Errand::Ack(ack)) => return encode_data(header, &ack, frame),
            Some(Errand::Timesync(timesync)) => return encode_data(header, &timesync, frame),
            None => {}
        }
        match self.notes.pop_front() {
            Some(Note::Value(value)) => encode_data(header, &value, frame),
            Some(Note::Text(text)) => encode_data(header, &text, frame),
            None => 0,
        }
    }
}
