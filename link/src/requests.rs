//! Requests to the autopilot for the messages that we need, and the check that they arrive.
//!
//! Each wish is a `MAV_CMD_SET_MESSAGE_INTERVAL`. Four at a time are requested; the next four follow when all are
//! acknowledged, or after 0.5 s, and a wish that was not acknowledged is repeated, five times at most. The
//! acknowledgement names the command only, not the message, so the answers of a round are matched to its requests in
//! order. If one is lost the match slips and a wish may wrongly count as granted; so the measured rate decides in the
//! end. A ground station, a router or a restart may also change it later.
//!
//! A message that arrives at less than 60 % of the wanted rate over 3 s is requested again. One that guidance cannot do
//! without is requested without end; for the others, which an autopilot may not have, the wait doubles after each
//! failure, up to 48 s. One that has not arrived by then is given up, and one that the autopilot refuses is given up
//! after one more try, since the answers may have slipped.

use foxhound_core::base::time::Instant;
use heapless::{Deque, Vec};

use crate::dialect::{COMMAND_LONG_DATA, MavCmd};

const ROUND_US: u64 = 500_000;
const WINDOW_US: u64 = 3_000_000;
/// The window is doubled at most this many times.
const PATIENCE_MAX: u8 = 4;
const TRIES: u8 = 5;
const ENOUGH: f32 = 0.6;
/// This many requests without an answer, about 5 s, mean that the autopilot ignores us.
const UNANSWERED_MAX: u8 = 40;
/// Requests under way at a time.
const ROUND: usize = 4;

/// How many messages may be asked for.
pub(crate) const WISHES: usize = 13;

/// One message that we want.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Wish {
    pub(crate) message_id: u16,
    /// Wanted rate; 0 leaves the message to the autopilot.
    pub(crate) rate_hz: f32,
    /// Whether guidance cannot do without it.
    pub(crate) is_vital: bool,
}

#[derive(Clone, Copy, Debug)]
struct Progress {
    wish: Wish,
    tries: u8,
    granted: bool,
    /// Windows without enough messages, in a row.
    patience: u8,
    /// It arrived at least once.
    was_heard: bool,
    /// It is not requested any more.
    given_up: bool,
    heard: u16,
    /// Since when the messages are counted.
    since: Instant,
}

impl Progress {
    const fn new(now: Instant, wish: Wish) -> Self {
        let (granted, was_heard, given_up) = (false, false, false);
        Self { wish, tries: 0, granted, patience: 0, was_heard, given_up, heard: 0, since: now }
    }

    #[inline(never)]
    fn pending(&self) -> bool {
        self.wish.rate_hz > 0.0 && !self.granted && !self.given_up && self.tries < TRIES
    }

    fn window_us(&self) -> u64 {
        WINDOW_US << self.patience
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Requests {
    progress: Vec<Progress, WISHES>,
    next_round: Instant,
    /// The requests of this round, in the order in which they were sent.
    asked: Deque<u8, ROUND>,
    /// Requests since the last acknowledgement.
    unanswered: u8,
}

impl Requests {
    /// No wishes.
    pub(crate) const fn new() -> Self {
        Self { progress: Vec::new(), next_round: Instant(0), asked: Deque::new(), unanswered: 0 }
    }

    /// Replaces the wishes; at most [`WISHES`].
    pub(crate) fn wish_for(&mut self, now: Instant, wishes: impl Iterator<Item = Wish>) {
        self.progress.clear();
        for wish in wishes {
            // There is room for as many as are ever wished for.
            self.progress.push(Progress::new(now, wish)).ok();
        }
        self.restart(now);
    }

    /// Requests everything again, from now on.
    #[inline(never)]
    pub(crate) fn restart(&mut self, now: Instant) {
        self.asked.clear();
        self.unanswered = 0;
        self.next_round = now;
        for progress in &mut self.progress {
            *progress = Progress::new(now, progress.wish);
        }
    }

    /// A message came.
    #[inline(never)]
    pub(crate) fn heard(&mut self, message_id: u32) {
        // Nothing is wished for twice.
        let mut all = self.progress.iter_mut();
        if let Some(progress) = all.find(|progress| u32::from(progress.wish.message_id) == message_id) {
            progress.was_heard = true;
            progress.heard = progress.heard.saturating_add(1);
        }
    }

    /// An acknowledgement of a `MAV_CMD_SET_MESSAGE_INTERVAL` of ours came.
    #[inline(never)]
    pub(crate) fn acknowledged(&mut self, now: Instant, is_refused: bool) {
        self.unanswered = 0;
        let asked = self.asked.pop_front();
        if let Some(progress) = asked.and_then(|index| self.progress.get_mut(usize::from(index))) {
            progress.granted = true;
            if is_refused && !progress.wish.is_vital {
                progress.patience = progress.patience.max(PATIENCE_MAX - 1);
            }
            progress.since = now;
            progress.heard = 0;
        }
        if self.asked.is_empty() {
            self.next_round = now;
        }
    }

    /// Whether an autopilot that sends heartbeats does not answer: it may want our messages signed.
    pub(crate) const fn is_ignored(&self) -> bool {
        self.unanswered >= UNANSWERED_MAX
    }

    /// Passes the requests that are due now to `send`.
    #[inline(never)]
    pub(crate) fn poll(&mut self, now: Instant, target: (u8, u8), mut send: impl FnMut(COMMAND_LONG_DATA)) {
        self.check_rates(now);
        if now < self.next_round || !self.progress.iter().any(Progress::pending) {
            return;
        }
        self.next_round = now.plus_micros(ROUND_US);
        self.asked.clear();
        let pending = self.progress.iter_mut().enumerate().filter(|(_, progress)| progress.pending());
        // The wish with the fewest tries comes first.
        let fewest = pending.map(|(_, progress)| progress.tries).min().unwrap_or_default();
        for (index, progress) in self.progress.iter_mut().enumerate() {
            if !progress.pending() || progress.tries > fewest || self.asked.is_full() {
                continue;
            }
            send(COMMAND_LONG_DATA {
                target_system: target.0,
                target_component: target.1,
                command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16,
                confirmation: progress.tries,
                param1: f32::from(progress.wish.message_id),
                param2: libm::roundf(1e6 / progress.wish.rate_hz),
                ..COMMAND_LONG_DATA::DEFAULT
            });
            progress.tries += 1;
            progress.since = now;
            progress.heard = 0;
            self.unanswered = self.unanswered.saturating_add(1);
            // The queue is not full, and there are fewer than 256.
            self.asked.push_back(index as u8).ok();
        }
    }

    #[inline(never)]
    fn check_rates(&mut self, now: Instant) {
        for progress in &mut self.progress {
            if progress.pending() || progress.given_up || now.micros_since(progress.since) < progress.window_us() {
                continue;
            }
            let wanted = ENOUGH * progress.wish.rate_hz * now.seconds_since(progress.since);
            if f32::from(progress.heard) < wanted {
                progress.tries = 0;
                progress.granted = false;
                progress.given_up = progress.patience >= PATIENCE_MAX && !progress.was_heard;
                let more = if progress.wish.is_vital { 0 } else { 1 };
                progress.patience = (progress.patience + more).min(PATIENCE_MAX);
            } else {
                progress.patience = 0;
            }
            progress.since = now;
            progress.heard = 0;
        }
    }
}
