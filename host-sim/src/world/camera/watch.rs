//! Runs frames through the detector.

use foxhound_core::base::time::Instant;
use foxhound_core::landing::observation::{Bad, PadObservation, Seen};
use foxhound_pad::{Candidate, Detector, State, WEIGHTS, score};

use super::frame::Frame;

/// The detector's result for a frame, after those before it.
#[must_use]
pub fn watch(detector: &Detector, state: &mut State, frame: &Frame, height_m: Option<f32>) -> PadObservation {
    watch_by(detector, state, frame, height_m, |candidate| score(&WEIGHTS, &candidate.measures))
}

/// The same with another score.
fn watch_by(
    detector: &Detector,
    state: &mut State,
    frame: &Frame,
    height_m: Option<f32>,
    score: impl FnMut(&Candidate) -> f32,
) -> PadObservation {
    let header = frame.header(Instant(0));
    let mut fed: Result<(), Bad> = detector.begin(state, &header, height_m);
    for (row, bytes) in frame.lines() {
        fed = fed.and_then(|()| detector.line(state, row, bytes));
    }
    let look = detector.end_with(state, score);
    debug_assert!(fed.is_ok() || matches!(look.seen, Seen::Bad(_)), "{fed:?} {look:?}");
    look
}

/// The result for a frame by itself: it is processed `times` times, and the last result counts.
#[must_use]
pub fn alone(detector: &Detector, frame: &Frame, height_m: Option<f32>, times: u32) -> PadObservation {
    alone_by(detector, frame, height_m, times, |_, candidate| score(&WEIGHTS, &candidate.measures))
}

/// The same with another score, which gets the index of the observation, from 0.
#[must_use]
pub fn alone_by(
    detector: &Detector,
    frame: &Frame,
    height_m: Option<f32>,
    times: u32,
    mut score: impl FnMut(u32, &Candidate) -> f32,
) -> PadObservation {
    let mut state = State::new();
    for look in 1..times {
        let _ = watch_by(detector, &mut state, frame, height_m, |candidate| score(look - 1, candidate));
    }
    watch_by(detector, &mut state, frame, height_m, |candidate| score(times - 1, candidate))
}
