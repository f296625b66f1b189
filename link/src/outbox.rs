//! Frames that wait to be sent, by priority: setpoint, heartbeat, errands (answers and requests), telemetry,
//! parameters.
//!
//! The message waits, not its frame; the frame is made when the line is free, so that sequence numbers and signatures
//! rise in the order of sending and a setpoint is the newest one.

use foxhound_core::base::time::Instant;
use heapless::Deque;

use crate::MessageData;
use crate::dialect::{
    COMMAND_LONG_DATA, DEBUG_VECT_DATA, HEARTBEAT_DATA, LANDING_TARGET_DATA, OBSTACLE_DISTANCE_DATA, PARAM_VALUE_DATA,
    SET_POSITION_TARGET_LOCAL_NED_DATA, STATUSTEXT_DATA,
};
use crate::framer::{FRAME_MAX, Header, Packed, fill};

/// Answers and requests; the longest is a command.
type Errand = Packed<[u8; COMMAND_LONG_DATA::ENCODED_LEN]>;
/// Telemetry that queues, the longest of it a text; of all other telemetry only the newest of each kind waits.
type Note = Packed<[u8; STATUSTEXT_DATA::ENCODED_LEN]>;

/// Counts of what was not sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Dropped {
    pub(crate) errands: u32,
    pub(crate) notes: u32,
}

#[derive(Clone, Debug)]
pub(crate) struct Outbox {
    setpoint: Option<(Instant, Packed<[u8; SET_POSITION_TARGET_LOCAL_NED_DATA::ENCODED_LEN]>)>,
    heartbeat: Option<Packed<[u8; HEARTBEAT_DATA::ENCODED_LEN]>>,
    errands: Deque<Errand, 8>,
    landing: Option<Packed<[u8; LANDING_TARGET_DATA::ENCODED_LEN]>>,
    notes: Deque<Note, 8>,
    direction: Option<Packed<[u8; DEBUG_VECT_DATA::ENCODED_LEN]>>,
    surroundings: Option<Packed<[u8; OBSTACLE_DISTANCE_DATA::ENCODED_LEN]>>,
    parameter: Option<Packed<[u8; PARAM_VALUE_DATA::ENCODED_LEN]>>,
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
            landing: None,
            notes: Deque::new(),
            direction: None,
            surroundings: None,
            parameter: None,
            dropped: Dropped { errands: 0, notes: 0 },
            sequence: 0,
            frame: [0; FRAME_MAX],
            sent: 0,
            end: 0,
        }
    }

    /// The newest setpoint replaces one that has not been sent yet.
    pub(crate) fn post_setpoint(&mut self, now: Instant, setpoint: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
        self.setpoint = Some((self.waiting_since().unwrap_or(now), Packed::new(setpoint)));
    }

    /// Withdraws a setpoint that waits.
    pub(crate) fn withdraw_setpoint(&mut self) {
        self.setpoint = None;
    }

    /// Since when a setpoint waits.
    pub(crate) fn waiting_since(&self) -> Option<Instant> {
        self.setpoint.as_ref().map(|(since, _)| *since)
    }

    pub(crate) fn post_heartbeat(&mut self, heartbeat: &HEARTBEAT_DATA) {
        self.heartbeat = Some(Packed::new(heartbeat));
    }

    /// If the queue is full, the new errand is dropped: its sender asks again.
    pub(crate) fn post_errand(&mut self, errand: &impl MessageData) {
        self.push_errand(Packed::new(errand));
    }

    #[inline(never)]
    fn push_errand(&mut self, errand: Errand) {
        if self.errands.push_back(errand).is_err() {
            self.dropped.errands = self.dropped.errands.saturating_add(1);
        }
    }

    /// If the queue is full, the oldest value is dropped, and the oldest text only where there are no values.
    pub(crate) fn post_note(&mut self, note: &impl MessageData) {
        self.push_note(Packed::new(note));
    }

    #[inline(never)]
    fn push_note(&mut self, note: Note) {
        if self.notes.is_full() {
            for _ in 0..self.notes.len() {
                let Some(text) = self.notes.pop_front_if(|note| note.is(STATUSTEXT_DATA::ID)) else { break };
                self.notes.push_back(text).ok();
            }
            self.notes.pop_front();
            self.dropped.notes = self.dropped.notes.saturating_add(1);
        }
        // There is room now.
        self.notes.push_back(note).ok();
    }

    pub(crate) fn post_landing(&mut self, landing: Option<&LANDING_TARGET_DATA>) {
        self.landing = landing.map(Packed::new);
    }

    pub(crate) fn post_direction(&mut self, direction: &DEBUG_VECT_DATA) {
        self.direction = Some(Packed::new(direction));
    }

    pub(crate) fn post_surroundings(&mut self, surroundings: &OBSTACLE_DISTANCE_DATA) {
        self.surroundings = Some(Packed::new(surroundings));
    }

    /// Whether a parameter may be posted: one waits at a time.
    pub(crate) const fn has_room_for_a_parameter(&self) -> bool {
        self.parameter.is_none()
    }

    pub(crate) fn post_parameter(&mut self, parameter: &PARAM_VALUE_DATA) {
        self.parameter = Some(Packed::new(parameter));
    }

    pub(crate) const fn dropped(&self) -> Dropped {
        self.dropped
    }

    /// Fills `sink` and returns how many bytes. A frame that does not fit is continued by the next call. `seal` gets
    /// the length of a finished frame, may sign it, and returns its new length; 0 keeps it back.
    #[inline(never)]
    pub(crate) fn transmit(
        &mut self,
        (system_id, component_id): (u8, u8),
        sink: &mut [u8],
        mut seal: impl FnMut(&mut [u8; FRAME_MAX], usize) -> usize,
    ) -> usize {
        let mut filled = 0;
        while filled < sink.len() {
            if self.sent == self.end {
                self.sent = 0;
                self.end = self.next_frame(Header { system_id, component_id, sequence: self.sequence });
                if self.end == 0 {
                    break;
                }
                self.end = seal(&mut self.frame, self.end).min(FRAME_MAX);
                self.sequence = self.sequence.wrapping_add(1);
                if self.end == 0 {
                    // It cannot be signed: not to be sent.
                    continue;
                }
            }
            let waiting = self.frame.get(self.sent..self.end).unwrap_or_default();
            let length = fill(sink.get_mut(filled..).unwrap_or_default(), waiting);
            self.sent += length;
            filled += length;
        }
        filled
    }

    #[inline(never)]
    fn next_frame(&mut self, header: Header) -> usize {
        let frame = &mut self.frame;
        let mut write = |packed: &Packed| packed.write(header, frame);
        if let Some((_, setpoint)) = self.setpoint.take() {
            write(&setpoint)
        } else if let Some(heartbeat) = self.heartbeat.take() {
            write(&heartbeat)
        } else if let Some(errand) = self.errands.pop_front() {
            write(&errand)
        } else if let Some(landing) = self.landing.take() {
            write(&landing)
        } else if let Some(note) = self.notes.pop_front() {
            write(&note)
        } else if let Some(direction) = self.direction.take() {
            write(&direction)
        } else if let Some(surroundings) = self.surroundings.take() {
            write(&surroundings)
        } else if let Some(parameter) = self.parameter.take() {
            write(&parameter)
        } else {
            0
        }
    }
}
