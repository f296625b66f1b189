//! Frames through the detector.

use foxhound_core::base::time::Instant;
use foxhound_core::landing::observation::{Bad, PadObservation, Seen};
use foxhound_pad::{Detector, State};

use super::frame::Frame;

/// What the detector sees in a frame, after those that the state has seen.
#[must_use]
pub fn watch(detector: &Detector, state: &mut State, frame: &Frame, height_m: Option<f32>) -> PadObservation {
    let header = frame.header(Instant(0));
    let mut fed: Result<(), Bad> = detector.begin(state, &header, height_m);
    for (row, bytes) in frame.lines() {
        fed = fed.and_then(|()| detector.line(state, row, bytes));
    }
    let look = detector.end(state);
    debug_assert!(fed.is_ok() || matches!(look.seen, Seen::Bad(_)), "{fed:?} {look:?}");
    look
}

/// What it sees in a frame alone: shown so many times, the last of them counts.
#[must_use]
pub fn alone(detector: &Detector, frame: &Frame, height_m: Option<f32>, times: u32) -> PadObservation {
    let mut state = State::new();
    let mut look = watch(detector, &mut state, frame, height_m);
    for _ in 1..times {
        look = watch(detector, &mut state, frame, height_m);
    }
    look
}
