//! Asking the autopilot for the messages that we need, and checking that they come.
//!
//! Each wish is a `MAV_CMD_SET_MESSAGE_INTERVAL`, repeated every 0.5 s until it is acknowledged, five times at most.
//! The acknowledgement names the command only, not the message, so the answers of a round are matched to its requests
//! in order. If one is lost the match slips and a wish may count as granted that is not: what counts in the end is the
//! rate that is measured. A ground station, a router or a reboot may also change it later. A message that comes at
//! less than 60 % of the wish over 3 s is asked for again.

use foxhound_core::time::Instant;
use heapless::Deque;

use crate::dialect::{COMMAND_LONG_DATA, MavCmd};

const ROUND_US: u64 = 500_000;
const WINDOW_US: u64 = 3_000_000;
const TRIES: u8 = 5;
const ENOUGH: f32 = 0.6;

/// How many messages are asked for.
pub(crate) const WISHES: usize = 4;

/// One message that we want.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Wish {
    pub(crate) message_id: u32,
    /// Wanted rate; 0 leaves the message to the autopilot.
    pub(crate) rate_hz: f32,
    /// Whether the message must come. An obstacle sensor may not exist.
    pub(crate) must_come: bool,
}

#[derive(Clone, Copy, Debug)]
struct Progress {
    wish: Wish,
    tries: u8,
    granted: bool,
    /// Since when the messages are counted.
    since: Instant,
    heard: u32,
}

impl Progress {
    fn pending(&self) -> bool {
        self.wish.rate_hz > 0.0 && !self.granted && self.tries < TRIES
    }

    fn ask_again(&mut self) {
        self.tries = 0;
        self.granted = false;
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Requests {
    progress: [Progress; WISHES],
    next_round: Instant,
    /// The requests of this round, in the order in which they were sent.
    asked: Deque<usize, WISHES>,
}

impl Requests {
    pub(crate) fn new(wishes: [Wish; WISHES]) -> Self {
        let progress =
            wishes.map(|wish| Progress { wish, tries: 0, granted: false, since: Instant::default(), heard: 0 });
        Self { progress, next_round: Instant::default(), asked: Deque::new() }
    }

    /// Everything is asked for anew, from now on.
    pub(crate) fn restart(&mut self, now: Instant) {
        self.asked.clear();
        self.next_round = now;
        self.progress.iter_mut().for_each(Progress::ask_again);
    }

    /// A message came.
    pub(crate) fn heard(&mut self, message_id: u32) {
        for progress in self.progress.iter_mut().filter(|progress| progress.wish.message_id == message_id) {
            progress.heard = progress.heard.saturating_add(1);
        }
    }

    /// An acknowledgement of a `MAV_CMD_SET_MESSAGE_INTERVAL` of ours came.
    pub(crate) fn acknowledged(&mut self, now: Instant) {
        if let Some(progress) = self.asked.pop_front().and_then(|index| self.progress.get_mut(index)) {
            progress.granted = true;
            progress.since = now;
            progress.heard = 0;
        }
    }

    /// Requests that are due now go to `send`.
    pub(crate) fn poll(&mut self, now: Instant, target: (u8, u8), mut send: impl FnMut(COMMAND_LONG_DATA)) {
        self.check_rates(now);
        if now < self.next_round || !self.progress.iter().any(Progress::pending) {
            return;
        }
        self.next_round = now.plus_micros(ROUND_US);
        self.asked.clear();
        for (index, progress) in self.progress.iter_mut().enumerate() {
            if !progress.pending() {
                continue;
            }
            send(COMMAND_LONG_DATA {
                target_system: target.0,
                target_component: target.1,
                command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16,
                confirmation: progress.tries,
                // Message ids up to 2^24 are exact in f32.
                param1: progress.wish.message_id as f32,
                param2: libm::roundf(1e6 / progress.wish.rate_hz),
                ..COMMAND_LONG_DATA::DEFAULT
            });
            progress.tries += 1;
            progress.since = now;
            progress.heard = 0;
            // Holds as many as there are wishes.
            self.asked.push_back(index).ok();
        }
    }

    fn check_rates(&mut self, now: Instant) {
        for progress in &mut self.progress {
            if progress.pending() || now.micros_since(progress.since) < WINDOW_US {
                continue;
            }
            let wanted = ENOUGH * progress.wish.rate_hz * now.seconds_since(progress.since);
            if progress.wish.must_come && (progress.heard as f32) < wanted {
                progress.ask_again();
            }
            progress.since = now;
            progress.heard = 0;
        }
    }
}
