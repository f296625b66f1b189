//! The parameter protocol: a ground station lists, reads and sets the parameters of [`foxhound_core::guidance::param`].
//!
//! After <https://mavlink.io/en/services/parameter.html>. Messages go in by [`Params::hear`], answers come out of
//! [`Params::next`], one every 50 ms at most: they can wait, setpoints cannot. What is queued is not an answer but a
//! mark on the parameter to be sent. So an answer has the value of the moment in which it is sent, many requests for
//! one parameter get one answer, and a list needs no more memory than a single read. A list and single answers take
//! turns.
//!
//! # Setting
//!
//! A value that is out of its own range is refused at once. Any other is a proposal: only the code that builds the
//! configuration of guidance can say whether it fits the other parameters, so the application fetches it
//! ([`Params::proposal`]), tries it, and answers ([`Params::settle`]); no value takes effect before. Every set is
//! answered by the value then in use, the old one if it was refused; a refusal also sends a text. While the vehicle
//! seeks, nothing is set.
//!
//! The answer to a set carries the true number of the parameter, as every other `PARAM_VALUE` does, and as in PX4.
//! `ArduPilot` sends 65535 there. Ground stations match the answer to a set by name, so both work; but `QGroundControl`
//! discards 65535 while it waits for its list to begin, and `MAVProxy` once took it for a parameter of its own (its
//! pull request 110).
//!
//! All parameters are `REAL32`. Another type is refused: integers are packed into the float in one of two ways, and the
//! message does not say which.

use foxhound_core::base::error::ConfigError;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::param::{COUNT, Id, Refusal, Values};
use heapless::Deque;

use crate::dialect::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, MavCmd, MavParamType, MavResult, PARAM_REQUEST_LIST_DATA,
    PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA, STATUSTEXT_DATA,
};
use crate::framer::{Content, Header};
use crate::{CharArray, MessageData as _};

mod text;

use text::{Trouble, Worded};

/// From answer to answer.
const PERIOD_US: u64 = 50_000;
/// How many sets may wait for the application; a station repeats what is not answered.
const SETS: usize = 4;
/// Bytes of a set of parameters.
const MARKS: usize = size_of::<u128>();
/// The last one.
const LAST: u8 = (COUNT - 1) as u8;

/// What a station wants done with the stored parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Storage {
    /// Store the values in use.
    Save,
    /// Go back to the stored ones.
    Load,
    /// Go back to the defaults, and store these.
    Reset,
}

/// Something to be sent.
#[derive(Clone, Debug, PartialEq)]
pub enum Reply {
    /// A parameter.
    Value(PARAM_VALUE_DATA),
    /// What was refused and why.
    Text(STATUSTEXT_DATA),
    /// The result of a command about the storage.
    Ack(COMMAND_ACK_DATA),
}

#[derive(Clone, Copy, Debug)]
struct Errand {
    storage: Storage,
    /// The station to be answered; `None` where all components were addressed, since the station takes one answer only.
    station: Option<(u8, u8)>,
    is_taken: bool,
}

/// A set of parameters that are taken one after the other, in a ring, so that none is always last.
#[derive(Clone, Copy, Debug)]
struct Marks {
    /// One bit for each, the lowest first; bytes, since a `u128` would be padded.
    marked: [u8; MARKS],
    /// The one that was taken last.
    last: u8,
}

impl Marks {
    const NONE: Self = Self { marked: [0; MARKS], last: LAST };
    /// Starts with the first one.
    const ALL: Self = Self { marked: (u128::MAX >> (128 - COUNT)).to_le_bytes(), last: LAST };

    #[inline(never)]
    fn add(&mut self, id: Id) {
        self.marked = (u128::from_le_bytes(self.marked) | 1 << id.index()).to_le_bytes();
    }

    #[inline(never)]
    fn remove(&mut self, id: Id) {
        self.marked = (u128::from_le_bytes(self.marked) & !(1 << id.index())).to_le_bytes();
    }

    #[inline(never)]
    fn take(&mut self) -> Option<Id> {
        let marked = u128::from_le_bytes(self.marked);
        let behind = marked & !(u128::MAX >> (127 - self.last));
        let from = if behind == 0 { marked } else { behind };
        let id = Id::at(from.trailing_zeros() as usize)?;
        self.last = id.index() as u8;
        self.remove(id);
        Some(id)
    }
}

/// The parameters, and which are to be sent.
///
/// ```
/// use foxhound_core::base::time::Instant;
/// use foxhound_core::guidance::param::Values;
/// use foxhound_link::params::{Params, Reply};
///
/// // What the application runs with from now on is sent to the stations, one after the other.
/// let mut params = Params::new(Values::default());
/// params.replace(Values::default());
/// assert!(matches!(params.next(Instant(0)), Some(Reply::Value(value)) if value.param_index == 0));
/// ```
#[derive(Clone, Debug)]
pub struct Params {
    values: Values,
    /// Parameters to be sent because a station requested or set them.
    asked: Marks,
    /// Parameters of a list that are still to be sent.
    listed: Marks,
    /// Whether it is the list's turn.
    is_lists_turn: bool,
    sets: Deque<(Id, f32), SETS>,
    errand: Option<Errand>,
    ack: Option<(MavResult, (u8, u8))>,
    trouble: Option<Worded>,
    due: Instant,
}

impl Params {
    /// The parameters with which the application runs.
    #[must_use]
    pub const fn new(values: Values) -> Self {
        Self {
            values,
            asked: Marks::NONE,
            listed: Marks::NONE,
            is_lists_turn: false,
            sets: Deque::new(),
            errand: None,
            ack: None,
            trouble: None,
            due: Instant(0),
        }
    }

    /// The values in use.
    #[must_use]
    pub const fn values(&self) -> &Values {
        &self.values
    }

    /// Whether a message may be about parameters.
    pub(crate) const fn may_hear(message_id: u32) -> bool {
        matches!(
            message_id,
            PARAM_REQUEST_LIST_DATA::ID
                | PARAM_REQUEST_READ_DATA::ID
                | PARAM_SET_DATA::ID
                | COMMAND_LONG_DATA::ID
                | COMMAND_INT_DATA::ID
        )
    }

    /// Takes in a message; `us` is our system and component. False if it is not about parameters, or for another
    /// component.
    #[inline(never)]
    pub fn hear(&mut self, us: (u8, u8), from: Header, content: &Content, is_seeking: bool) -> bool {
        let for_us = |system, component| system == us.0 && (component == us.1 || component == 0);
        let alone = |target: (u8, u8)| (target.1 == us.1).then_some((from.system_id, from.component_id));
        match content.message_id() {
            PARAM_REQUEST_LIST_DATA::ID => {
                let list: PARAM_REQUEST_LIST_DATA = content.read();
                let is_ours = for_us(list.target_system, list.target_component);
                if is_ours {
                    self.list();
                }
                is_ours
            }
            PARAM_REQUEST_READ_DATA::ID => {
                let read: PARAM_REQUEST_READ_DATA = content.read();
                let is_ours = for_us(read.target_system, read.target_component);
                let id = match usize::try_from(read.param_index) {
                    Ok(index) => Id::at(index),
                    Err(_) => Id::named(&read.param_id[..]),
                };
                if let Some(id) = id.filter(|_| is_ours) {
                    self.asked.add(id);
                }
                is_ours
            }
            PARAM_SET_DATA::ID => {
                let set: PARAM_SET_DATA = content.read();
                let is_ours = for_us(set.target_system, set.target_component);
                if is_ours {
                    self.set(&set, set.target_component == us.1, is_seeking);
                }
                is_ours
            }
            COMMAND_LONG_DATA::ID => {
                let command: COMMAND_LONG_DATA = content.read();
                let target = (command.target_system, command.target_component);
                for_us(target.0, target.1) && self.command(command.command, command.param1, alone(target), is_seeking)
            }
            COMMAND_INT_DATA::ID => {
                let command: COMMAND_INT_DATA = content.read();
                let target = (command.target_system, command.target_component);
                for_us(target.0, target.1) && self.command(command.command, command.param1, alone(target), is_seeking)
            }
            _ => false,
        }
    }

    /// The clock may have been set back.
    pub(crate) fn follow_clock(&mut self, now: Instant) {
        self.due = self.due.min(now);
    }

    /// What is to be sent next, if it is due. Call it when nothing else waits to be sent, and what it returned before
    /// has been sent.
    #[inline(never)]
    pub fn next(&mut self, now: Instant) -> Option<Reply> {
        if now < self.due {
            return None;
        }
        let reply = self.next_reply()?;
        self.due = now.plus_micros(PERIOD_US);
        Some(reply)
    }

    /// The values as a station wants them, the oldest request first; `None` where nothing is proposed. What was not
    /// settled before the vehicle began to seek is refused.
    #[must_use]
    pub fn proposal(&mut self, is_seeking: bool) -> Option<Values> {
        while is_seeking && let Some((id, _)) = self.sets.pop_front() {
            self.object(Trouble::Seeking(id));
            self.asked.add(id);
        }
        let (id, value) = self.sets.front()?;
        let mut values = self.values;
        // Was checked when it was received.
        values.set(*id, *value).ok()?;
        Some(values)
    }

    /// Which parameter the [proposal](Self::proposal) changes.
    #[must_use]
    pub fn proposed(&self) -> Option<Id> {
        self.sets.front().map(|(id, _)| *id)
    }

    /// The application's answer to the [proposal](Self::proposal): it runs with it from now on, or it does not.
    pub fn settle(&mut self, verdict: Result<(), ConfigError>) {
        let Some((id, value)) = self.sets.pop_front() else { return };
        match verdict {
            // Was checked when it was received.
            Ok(()) => {
                self.values.set(id, value).ok();
            }
            Err(error) => self.object(Trouble::Config(id, value, error)),
        }
        self.asked.add(id);
    }

    /// What the application is to do with its storage, once it has settled what was set before; returned once, then waits for
    /// [`stored`](Self::stored).
    pub fn take_storage(&mut self) -> Option<Storage> {
        let is_settled = self.sets.is_empty();
        let errand = self.errand.as_mut().filter(|errand| is_settled && !errand.is_taken)?;
        errand.is_taken = true;
        Some(errand.storage)
    }

    /// The application has done it, or could not. Values that were loaded or reset must have been
    /// [replaced](Self::replace) before.
    pub fn stored(&mut self, is_done: bool) {
        let Some(errand) = self.errand.take() else { return };
        self.answer(
            if is_done { MavResult::MAV_RESULT_ACCEPTED } else { MavResult::MAV_RESULT_FAILED },
            errand.station,
        );
    }

    /// The application runs with other values from now on. All of them are sent to the stations.
    pub fn replace(&mut self, values: Values) {
        self.values = values;
        self.sets.clear();
        self.list();
    }

    /// From the first parameter.
    fn list(&mut self) {
        self.listed = Marks::ALL;
    }

    #[inline(never)]
    fn set(&mut self, set: &PARAM_SET_DATA, is_for_us_alone: bool, is_seeking: bool) {
        let Some(id) = Id::named(&set.param_id[..]) else {
            // Addressed to all components, it is another's parameter.
            if is_for_us_alone {
                self.object(Trouble::Unknown(set.param_id.into()));
            }
            return;
        };
        let value = set.param_value;
        let trouble = if set.param_type != MavParamType::MAV_PARAM_TYPE_REAL32 as u8 {
            Some(Trouble::Type(id))
        } else if let Err(refusal) = id.check(value) {
            Some(Trouble::Refused(id, value, refusal == Refusal::NotWhole))
        } else if is_seeking && value != self.values.get(id) {
            Some(Trouble::Seeking(id))
        } else {
            None
        };
        // Nothing changes, or only because an earlier set still waits.
        let is_settled = value == self.values.get(id) && self.sets.iter().all(|(other, _)| *other != id);
        match trouble {
            Some(trouble) => self.object(trouble),
            None if is_settled => {}
            // Answered when it is settled. If the queue is full, it is as if it had not been received.
            None => {
                self.sets.push_back((id, value)).ok();
                return;
            }
        }
        self.asked.add(id);
    }

    /// Takes in a command of a station, `None` where all components were addressed; false if it is not about parameters.
    #[inline(never)]
    fn command(&mut self, command: u16, param1: f32, station: Option<(u8, u8)>, is_seeking: bool) -> bool {
        let is_ours = command == MavCmd::MAV_CMD_PREFLIGHT_STORAGE as u16;
        if is_ours {
            self.keep(param1, station, is_seeking);
        }
        is_ours
    }

    fn keep(&mut self, param1: f32, station: Option<(u8, u8)>, is_seeking: bool) {
        let storage = if param1 == 0.0 {
            Storage::Load
        } else if param1 == 1.0 {
            Storage::Save
        } else if param1 == 2.0 {
            // Some stations send it to all components to reset the autopilot: that must not erase keys.
            if station.is_none() {
                return;
            }
            Storage::Reset
        } else {
            return self.answer(MavResult::MAV_RESULT_DENIED, station);
        };
        match self.errand {
            // A station that repeats its request.
            Some(errand) if errand.station == station && errand.storage == storage => {}
            // Writing the flash stops the processor for a while, so it is not done in flight either.
            _ if is_seeking => self.answer(MavResult::MAV_RESULT_TEMPORARILY_REJECTED, station),
            Some(_) => self.answer(MavResult::MAV_RESULT_TEMPORARILY_REJECTED, station),
            None => self.errand = Some(Errand { storage, station, is_taken: false }),
        }
    }

    #[inline(never)]
    fn answer(&mut self, result: MavResult, station: Option<(u8, u8)>) {
        if let Some(station) = station {
            self.ack = Some((result, station));
        }
    }

    /// A text that is being sent is finished first. A station that floods us with invalid requests gets an answer to
    /// some of them.
    #[inline(never)]
    fn object(&mut self, trouble: Trouble) {
        if self.trouble.is_none() {
            self.trouble = Some(Worded::new(trouble));
        }
    }

    #[inline(never)]
    fn next_reply(&mut self) -> Option<Reply> {
        if let Some((result, (target_system, target_component))) = self.ack.take() {
            return Some(Reply::Ack(COMMAND_ACK_DATA {
                command: MavCmd::MAV_CMD_PREFLIGHT_STORAGE as u16,
                result: result as u8,
                target_system,
                target_component,
                ..COMMAND_ACK_DATA::DEFAULT
            }));
        }
        if let Some(worded) = &mut self.trouble {
            let (text, is_last) = worded.next_piece();
            if is_last {
                self.trouble = None;
            }
            return Some(Reply::Text(text));
        }
        let list_first = self.is_lists_turn || self.asked.marked == Marks::NONE.marked;
        let from_list = if list_first { self.listed.take() } else { None };
        let id = from_list.or_else(|| self.asked.take())?;
        self.is_lists_turn = from_list.is_none();
        // The answer reaches all stations.
        self.asked.remove(id);
        self.listed.remove(id);
        Some(Reply::Value(PARAM_VALUE_DATA {
            param_id: CharArray::new(*id.padded_name()),
            param_value: self.values.get(id),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32 as u8,
            param_count: COUNT as u16,
            param_index: id.index() as u16,
        }))
    }
}
