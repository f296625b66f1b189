//! A stream of snapshots: every one gives its phasors, and the spectrum is worked off beside them, a piece at a time.
//!
//! [`Extractor::step`] looks at the whole spectrum of a snapshot whenever it has to, which is what a recording wants. Here
//! a snapshot is fitted at the frequency that is tracked, at a cost that does not jump, and [`Extractor::work_off`] does what
//! there is time for: the transform of two channels, the floor of one of them, the choice of the line, each of whatever
//! snapshot comes then, since neither floor nor frequency change from one to the next. A tone that appears is found some
//! snapshots later for it. When the power that the fit leaves over changes, the floor is scaled by as much at once, and
//! measured anew.

use super::acquire::{Candidate, remember_left_over};
use super::fit::{Fit, Level, fit, left_over, left_over_changed, level, tune};
use super::{Extractor, Phasors, QUANTISATION, State};
use crate::adc::{CHANNELS, Snapshot};
use crate::spectrum::Pair;
use crate::spectrum::tone::Window;
use crate::work::Work;

/// Rounds of refinement in one snapshot; the next ones do the rest.
const ROUNDS: u8 = 1;

/// Snapshots from one look at the spectrum to the next. A floor that changes is scaled at once.
const RENEWED_EVERY: u8 = 32;

/// Most instructions of a snapshot that is followed; with a new reference, one that is moved, or a new tone.
const FOLLOWED: u32 = 7_600;
const SILENT: u32 = 5_200;
const SETTLED: u32 = 13_400;
/// Of the pieces of work.
const TRANSFORM: u32 = 14_300;
const FLOOR: u32 = 6_000;
const CHOICE: u32 = 14_300;

/// The piece that is next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Piece {
    #[default]
    First,
    FloorOf(u8),
    Second,
    Choice,
}

/// How far the spectrum is worked off.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Progress {
    next: Piece,
    /// The line to move to with the next snapshot.
    candidate: Option<Candidate>,
    /// The floor is new: what the next fit leaves over goes with it.
    is_fresh: bool,
    /// The last snapshot held the tone.
    is_followed: bool,
}

impl Progress {
    /// The floors are new enough, or a line waits for its snapshot.
    const fn is_idle(&self, floor_due_in: u8) -> bool {
        self.candidate.is_some() || (matches!(self.next, Piece::First) && floor_due_in > 0)
    }
}

impl<const N: usize> Extractor<N> {
    /// Extracts the phasors of one snapshot of a stream, with what is known of the spectrum so far.
    pub fn listen(&self, state: &mut State<N>, snapshot: &Snapshot<N>, work: &mut Work) -> Phasors {
        let codes = &snapshot.codes;
        let levels = codes.each_ref().map(level);
        let before = (state.tracked, state.reference.step());
        let candidate = state.progress.candidate.take();
        let found = match candidate {
            Some(candidate) if state.interferer => self.settle_beside(state, codes, &candidate),
            Some(candidate) => self.settle(state, codes, &candidate, ROUNDS),
            None => self.hold(state, codes),
        };
        let is_moved = candidate.is_some() || state.reference.step() != before.1;
        work.spend(match (is_moved, &found) {
            (true, _) => SETTLED,
            (false, Some(_)) => FOLLOWED,
            (false, None) => SILENT,
        });
        match &found {
            Some(fit) if state.progress.is_fresh => remember_left_over(state, &levels, fit),
            Some(fit) if left_over_changed::<N>(state, &levels, fit) => scale_floor(state, &levels, fit),
            Some(_) => {}
            None => {
                state.tracked = before.0;
                state.interferer &= candidate.is_none();
                state.floor_due_in = 0;
            }
        }
        state.progress.is_fresh &= found.is_none();
        state.progress.is_followed = found.is_some();
        state.floor_due_in = state.floor_due_in.saturating_sub(1);
        let is_silent = found.is_none();
        let mut phasors = self.report(state, snapshot, &levels, found);
        if is_silent {
            // The floor is that of some snapshot before. In white noise the snapshot's own energy says the same, and says it
            // anew each time: whoever averages over silence relies on that.
            for ((noise, variance), level) in phasors.noise.iter_mut().zip(state.variance).zip(levels) {
                let white = (level.energy / (N as f32 - 2.0)).max(QUANTISATION);
                if white < 2.0 * variance {
                    *noise *= white / variance;
                }
            }
        }
        phasors
    }

    /// Fits at the frequency that is tracked.
    fn hold(&self, state: &mut State<N>, codes: &[[i16; N]; CHANNELS]) -> Option<Fit> {
        let tracked = state.tracked?;
        if state.interferer {
            return Some(fit(state, codes)).filter(|fit| fit.statistic >= Self::HOLD);
        }
        if state.reference.window() == Window::Hann {
            // Another line was looked at, and is gone or was none.
            tune(state, tracked.step, Window::Flat);
        }
        // Where it was lost, another line may be near: that is for the spectrum to say, which needs the time.
        self.follow(state, codes, if state.progress.is_followed { ROUNDS } else { 0 })
    }

    /// What the next piece of the spectrum costs; 0 where none is due.
    pub fn wants(&self, state: &State<N>) -> u16 {
        if state.progress.is_idle(state.floor_due_in) { 0 } else { state.progress.next.price() as u16 }
    }

    /// Works off the spectrum as far as there is time, with the snapshot that was listened to last.
    pub fn work_off(&self, state: &mut State<N>, snapshot: &Snapshot<N>, work: &mut Work) {
        while !state.progress.is_idle(state.floor_due_in) && work.take(state.progress.next.price()) {
            if self.work_off_piece(state, snapshot) {
                return;
            }
        }
    }

    /// True when that was the last one.
    #[inline(never)]
    fn work_off_piece(&self, state: &mut State<N>, snapshot: &Snapshot<N>) -> bool {
        let mut scratch = [0.0; N];
        let (backend, codes) = (self.config.backend, &snapshot.codes);
        state.progress.next = match state.progress.next {
            Piece::First => {
                state.spectrum.measure_pair(backend, Pair::First, codes, &mut scratch);
                Piece::FloorOf(0)
            }
            Piece::Second => {
                state.spectrum.measure_pair(backend, Pair::Second, codes, &mut scratch);
                Piece::FloorOf(2)
            }
            Piece::FloorOf(channel) => {
                self.measure_floor(state, usize::from(channel), &mut scratch);
                match channel {
                    0 | 2 => Piece::FloorOf(channel + 1),
                    1 => Piece::Second,
                    _ => Piece::Choice,
                }
            }
            Piece::Choice => {
                let candidate = self.choose(state, &mut scratch);
                let is_alone = !state.interferer && state.reference.window() == Window::Flat;
                let goes_on = is_alone && state.progress.is_followed && candidate.is_held && candidate.is_near;
                // What is not worth a closer look would only cost a snapshot its look at the tone that was there.
                state.progress.candidate = Some(candidate).filter(|candidate| !goes_on && candidate.is_worth_it);
                state.progress.is_fresh = true;
                state.floor_due_in = RENEWED_EVERY;
                Piece::First
            }
        };
        state.progress.next == Piece::First
    }
}

impl Piece {
    const fn price(self) -> u32 {
        match self {
            Self::First | Self::Second => TRANSFORM,
            Self::FloorOf(_) => FLOOR,
            Self::Choice => CHOICE,
        }
    }
}

/// The floor of a frame in which the fit leaves more over, or less, and a sooner look at the spectrum.
fn scale_floor<const N: usize>(state: &mut State<N>, levels: &[Level; CHANNELS], fit: &Fit) {
    let now = left_over(&state.solver, levels, fit);
    for ((variance, then), now) in state.variance.iter_mut().zip(state.left_over).zip(now) {
        *variance = (*variance * (now.max(1.0) / then.max(1.0))).max(QUANTISATION);
    }
    state.left_over = now;
    state.floor_due_in = 0;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phase::scene::{Scene, bins_of, extractor, rms, vec};
    use crate::phase::{Complex, Tone};
    use crate::rng::Rng;
    use std::vec::Vec;

    /// One snapshot as in a flight: in every second one there is room for a single piece of the spectrum.
    fn frame(state: &mut State<256>, scene: &Scene, number: u32, rng: &mut Rng) -> Phasors {
        let snapshot = scene.frame::<256>(rng);
        let extractor = extractor::<256>();
        let phasors = extractor.listen(state, &snapshot, &mut Work::unlimited());
        extractor.work_off(state, &snapshot, &mut Work::new(if number.is_multiple_of(2) { 0 } else { TRANSFORM }));
        phasors
    }

    /// Squared errors in units of what the phasors predict, and how many snapshots held no tone.
    fn normalised(state: &mut State<256>, scene: &Scene, count: u32, rng: &mut Rng) -> (f64, u32) {
        let (mut sum, mut held, mut missed) = (0.0, 0, 0);
        for number in 0..count {
            let scene = scene.with_random_phases(rng);
            let phasors = frame(state, &scene, number, rng);
            if phasors.tone == Tone::Absent {
                missed += 1;
                continue;
            }
            let variance = |m: usize| f64::from(phasors.noise[m] / (2.0 * phasors.z[m].norm_squared()));
            for (error, m) in scene.errors(&phasors).iter().zip(1..) {
                sum += error * error / (variance(0) + variance(m));
                held += 1;
            }
        }
        (sum / f64::from(held), missed)
    }

    #[test]
    fn a_tone_is_found_within_half_a_second_and_then_every_snapshot_is_at_the_bound() {
        for snr_db in [0.0, 10.0, 20.0, 40.0] {
            for bins in [20.5, 37.0, 60.25] {
                let (mut rng, mut state) = (Rng::new(21, 1), State::default());
                let scene = Scene::at_snr(bins, snr_db);
                let first =
                    (0..25).position(|number| frame(&mut state, &scene, number, &mut rng).tone == Tone::Present);
                assert!(first.is_some(), "{bins} {snr_db}");
                let mut errors = vec();
                for number in 0..400 {
                    let scene = scene.with_random_phases(&mut rng);
                    let phasors = frame(&mut state, &scene, number, &mut rng);
                    assert_eq!(phasors.tone, Tone::Present, "{bins} {snr_db}: {number}");
                    errors.extend(scene.errors(&phasors));
                }
                let ratio = rms(&errors) / scene.bound::<256>();
                assert!(ratio < 1.12, "{bins} {snr_db}: {ratio}");
            }
        }
    }

    #[test]
    fn the_noise_that_is_told_is_that_of_the_snapshot_also_when_it_has_just_doubled() {
        let (mut rng, mut state) = (Rng::new(22, 1), State::default());
        let quiet = Scene::new(41.7, 900.0, 60.0);
        normalised(&mut state, &quiet, 40, &mut rng);
        for sigma in [60.0, 240.0, 60.0] {
            let (ratio, missed) = normalised(&mut state, &Scene { sigma, ..quiet }, 120, &mut rng);
            assert!(missed == 0 && (0.75..1.35).contains(&ratio), "{sigma}: {ratio}, {missed} missed");
        }
    }

    #[test]
    fn a_tone_that_hops_is_lost_for_a_while_and_one_that_comes_back_is_there_by_the_second_snapshot() {
        let (mut rng, mut state) = (Rng::new(23, 1), State::default());
        for bins in [30.2, 71.9, 12.4] {
            let scene = Scene::at_snr(bins, 20.0);
            let (_, missed) = normalised(&mut state, &scene, 60, &mut rng);
            assert!((1..30).contains(&missed), "{bins}: {missed}");
            for number in 0..50 {
                let phasors = frame(&mut state, &Scene::silence(scene.sigma), number, &mut rng);
                assert_eq!((phasors.tone, phasors.z), (Tone::Absent, [Complex::default(); CHANNELS]));
            }
            // The first one may have to do with another line.
            frame(&mut state, &scene, 0, &mut rng);
            let phasors = frame(&mut state, &scene, 0, &mut rng);
            assert_eq!(phasors.tone, Tone::Present);
            assert!((bins_of::<256>(&phasors) - bins).abs() < 0.05);
        }
    }

    #[test]
    fn silence_raises_no_alarm_and_its_noise_is_another_one_each_time() {
        let (mut rng, mut state) = (Rng::new(24, 1), State::default());
        let scene = Scene::silence(80.0);
        let told: Vec<f64> = (0..3000)
            .map(|number| {
                let phasors = frame(&mut state, &scene, number, &mut rng);
                assert_eq!(phasors.tone, Tone::Absent, "{number}");
                f64::from(phasors.noise[0])
            })
            .skip(50)
            .collect();
        let mean = told.iter().sum::<f64>() / told.len() as f64;
        assert!((mean / (80.0 * 80.0 * 4.0 / 256.0) - 1.0).abs() < 0.03, "{mean}");
        // Of neighbours nothing in common: floors kept for thirty snapshots would have nearly all.
        let deviations: Vec<f64> = told.iter().map(|noise| noise - mean).collect();
        let variance = deviations.iter().map(|d| d * d).sum::<f64>();
        let common = deviations.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / variance;
        assert!(common.abs() < 0.1, "{common}");
    }
}
