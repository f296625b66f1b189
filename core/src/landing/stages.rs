//! The actions of each stage, and its end: the table in the module's documentation.

use super::arrival::Verdict;
use super::centring::{
    CLIMB_M, CLIMB_MPS, CLIMB_S, COMMIT_M, COMMIT_MAX_M, COMMIT_MPS, COMMIT_S, DESCENT_MIN_MPS, FRESH_S, LOST_S,
    SPEED_MAX_MPS, speed_mps,
};
use super::search::{self, End, Search};
use super::{Here, Input, Lander, Reason, Stage, State, Wish};
use crate::base::ned::Horizontal;
use crate::base::time::Instant;
use crate::base::units::between;
use crate::localize::source::Estimate;

/// Above the beacon means this near, this slow, for this long.
const ABOVE_M: f32 = 0.4;
const ABOVE_MPS: f32 = 0.25;
const ABOVE_S: f32 = 1.5;
/// A detection this young shows that the pad is there.
const FOUND_S: f32 = 0.4;
/// A pad belongs to the beacon when it is this near to it.
const PAD_FROM_BEACON_M: f32 = 4.0;
/// Without a good frame for this long the camera counts as missing.
const CAMERA_S: f32 = 2.0;
/// Away from the beacon for this long means that it is not there.
const FAR_S: f32 = 3.0;
/// Blocked for this long counts as blocked.
const BLOCKED_S: f32 = 5.0;
/// Smallest pitch of a search for a beacon.
const BEACON_PITCH_M: f32 = 0.75;
/// At the commit the vehicle must still be in the middle after this time.
const AHEAD_S: f32 = 0.5;
/// Share of the cone's radius inside which the descent begins.
const INSIDE: f32 = 0.7;
/// A vehicle commanded to sink that sinks slower than this, for this long, stands.
const STANDS_MPS: f32 = 0.06;
const STANDS_S: f32 = 0.8;
/// A vehicle that stands higher than this is not on the ground, given the accuracy of the height.
const LOW_M: f32 = 0.3;
/// The last part is aborted this far off the middle.
const PUSHED_GATES: f32 = 2.0;
/// The height of the drop, which depends on the accuracy of the height: with a range finder, and without. And the
/// share of the middle in which it must be.
const DROP_M: f32 = 0.15;
const DROP_UNSURE_M: f32 = 0.2;
const DROP_GATES: f32 = 0.7;
/// Prediction time for the drop: about its duration, most of which is the vehicle's own delay.
const DROP_S: f32 = 0.8;
const DROP_BAND_M: f32 = 0.04;
/// How much above the height of the commit it waits.
const WAIT_ABOVE_M: f32 = 0.1;
/// A pad is seen until it is this many times as wide as the picture's shorter side.
pub(super) const FILLED: f32 = 1.5;
/// Half the picture's shorter side, in widths; up to this height the pad is kept in it.
pub(super) const SHORT_SIDE_HALF: f32 = 0.375;
const IN_SIGHT_MAX_M: f32 = 2.0;
/// Rate at which a height is corrected.
const HEIGHT_RATE_PER_S: f32 = 2.0;
/// Assumed height if it is unknown.
const HEIGHT_ASSUMED_M: f32 = 2.0;

/// Whether a pad is so near to the beacon that it is the beacon's.
fn belongs(pad_ned_m: Horizontal, beacon_ned_m: Horizontal) -> bool {
    beacon_ned_m.minus(pad_ned_m).norm_squared() < PAD_FROM_BEACON_M * PAD_FROM_BEACON_M
}

impl Lander {
    /// Whether the pad is in sight.
    fn is_found(&self, state: &State, now: Instant) -> bool {
        state.track.is_sure() && state.track.unseen_s(now) < FOUND_S
    }

    /// The demand of this step; `None` to follow the planner.
    pub(super) fn act(&self, state: &mut State, input: &Input<'_>, here: &Here, verdict: Verdict) -> Option<Wish> {
        match state.stage {
            Stage::Seeking => self.seek(state, input, here, verdict),
            Stage::Approaching => Some(self.approach(state, input, here, verdict)),
            Stage::SearchingBeacon => Some(self.search_beacon(state, input, here, verdict)),
            Stage::SearchingPad => Some(self.search_pad(state, input, here)),
            Stage::Centring | Stage::Descending => Some(self.center(state, input, here)),
            Stage::Recovering => Some(self.recover(state, here)),
            Stage::Committed => Some(self.commit(state, input, here)),
            // The autopilot takes the vehicle for landed only while it is told to sink.
            Stage::Landed if !input.is_landed => Some(Wish { down_mps: COMMIT_MPS, ..Wish::default() }),
            Stage::Landed | Stage::HandedOver => Some(Wish::default()),
        }
    }

    fn seek(&self, state: &mut State, input: &Input<'_>, here: &Here, verdict: Verdict) -> Option<Wish> {
        let now = here.now;
        let begin = |state: &mut State, stage: Stage| {
            state.enter(stage, None, now);
            if state.began.is_none() {
                state.began = Some(now);
                state.top_down_m = here.down_m - self.climb_m;
            }
        };
        match verdict {
            Verdict::Known(_) if !state.arrival.is_long_near() => {}
            Verdict::Arrived(fix) | Verdict::Known(fix) => {
                state.goal_ned_m = fix.place_ned_m.horizontal();
                state.integral_mps = Horizontal::default();
                begin(state, Stage::Approaching);
            }
            Verdict::Ambiguous(fix) => {
                let pitch_m = if fix.sigma_m > BEACON_PITCH_M { fix.sigma_m } else { BEACON_PITCH_M };
                self.search.begin(&mut state.search, fix.place_ned_m.horizontal(), pitch_m, now);
                begin(state, Stage::SearchingBeacon);
            }
            Verdict::Far | Verdict::Near(_) => {}
        }
        if self.is_found(state, now) && self.is_of_beacon(state, input, verdict) {
            begin(state, Stage::Centring);
        }
        (state.stage != Stage::Seeking).then_some(Wish::default())
    }

    /// Whether the pad in sight belongs to the beacon.
    fn is_of_beacon(&self, state: &State, input: &Input<'_>, verdict: Verdict) -> bool {
        let pad = state.track.place_ned_m().horizontal();
        let by_fix = match verdict {
            Verdict::Far => None,
            Verdict::Near(fix) | Verdict::Known(fix) | Verdict::Ambiguous(fix) | Verdict::Arrived(fix) => {
                Some(fix.place_ned_m.horizontal())
            }
        };
        let known = |estimate: &&Estimate| estimate.covariance_m2[0] + estimate.covariance_m2[2] < 4.0;
        let beacon = by_fix.or(input.estimate.filter(known).map(|estimate| estimate.place_ned_m));
        beacon.is_some_and(|beacon| belongs(pad, beacon))
    }

    fn approach(&self, state: &mut State, input: &Input<'_>, here: &Here, verdict: Verdict) -> Wish {
        let now = here.now;
        let is_there = match verdict {
            Verdict::Arrived(fix) | Verdict::Known(fix) => {
                // Only what stays unknown from now on is ambiguous.
                state.arrival.have_patience();
                state.goal_ned_m = fix.place_ned_m.horizontal();
                matches!(verdict, Verdict::Arrived(_))
            }
            Verdict::Far | Verdict::Ambiguous(_) => {
                state.arrival.have_patience();
                if state.retries >= self.config.retries_max {
                    state.enter(Stage::HandedOver, Some(Reason::Ambiguous), now);
                } else {
                    state.retries += 1;
                    state.enter(Stage::Seeking, Some(Reason::Ambiguous), now);
                }
                return Wish::default();
            }
            Verdict::Near(_) => false,
        };
        if self.is_found(state, now) && self.is_of_beacon(state, input, verdict) {
            state.enter(Stage::Centring, None, now);
            return Wish::default();
        }
        let error_m = state.goal_ned_m.minus(here.place_ned_m);
        let is_above = is_there
            && error_m.norm_squared() < ABOVE_M * ABOVE_M
            && here.velocity_ned_mps.norm_squared() < ABOVE_MPS * ABOVE_MPS;
        state.settled_s = if is_above { state.settled_s + here.tick_s } else { 0.0 };
        let is_late = now.seconds_since(state.entered) > self.config.approach_s;
        if state.settled_s > ABOVE_S || (is_late && is_there) {
            self.arrive(state, here);
        } else if is_late {
            state.enter(Stage::HandedOver, Some(Reason::TimeLimit), now);
        } else if state.blocked_s > BLOCKED_S {
            state.enter(Stage::HandedOver, Some(Reason::Blocked), now);
        }
        if state.stage != Stage::Approaching {
            return Wish::default();
        }
        self.hover(state, state.goal_ned_m, here, HEIGHT_ASSUMED_M, SPEED_MAX_MPS)
    }

    /// The vehicle is above the beacon.
    fn arrive(&self, state: &mut State, here: &Here) {
        let now = here.now;
        if !self.config.has_camera {
            state.enter(Stage::HandedOver, Some(Reason::Arrived), now);
        } else if self.has_frames(state, now) {
            self.begin_pad_search(state, state.goal_ned_m, here);
        } else {
            state.enter(Stage::HandedOver, Some(Reason::NoCamera), now);
        }
    }

    fn has_frames(&self, state: &State, now: Instant) -> bool {
        state.framed.is_some_and(|framed| now.seconds_since(framed) < CAMERA_S)
    }

    fn begin_pad_search(&self, state: &mut State, center: Horizontal, here: &Here) {
        let height_m = state.height_m(here.down_m).or(here.height_m).unwrap_or(HEIGHT_ASSUMED_M);
        let pitch_m = Search::camera_pitch_m(height_m, self.config.focal_widths);
        self.search.begin(&mut state.search, center, pitch_m, here.now);
        state.integral_mps = Horizontal::default();
        state.enter(Stage::SearchingPad, None, here.now);
    }

    fn search_beacon(&self, state: &mut State, input: &Input<'_>, here: &Here, verdict: Verdict) -> Wish {
        if self.is_found(state, here.now) && self.is_of_beacon(state, input, verdict) {
            state.enter(Stage::Centring, None, here.now);
            return Wish::default();
        }
        if let Verdict::Arrived(fix) | Verdict::Known(fix) = verdict {
            state.goal_ned_m = fix.place_ned_m.horizontal();
            state.arrival.have_patience();
            state.enter(Stage::Approaching, None, here.now);
            return Wish::default();
        }
        // The beacon that it searched for is not near.
        state.settled_s = if verdict == Verdict::Far { state.settled_s + here.tick_s } else { 0.0 };
        if state.settled_s > FAR_S && state.retries < self.config.retries_max {
            state.retries += 1;
            state.enter(Stage::Seeking, Some(Reason::Ambiguous), here.now);
            return Wish::default();
        }
        self.search_on(state, input, here, Reason::SearchLimit)
    }

    fn search_pad(&self, state: &mut State, input: &Input<'_>, here: &Here) -> Wish {
        let is_of_beacon = state.has_found || belongs(state.track.place_ned_m().horizontal(), state.goal_ned_m);
        if self.is_found(state, here.now) && is_of_beacon {
            state.enter(Stage::Centring, None, here.now);
            return Wish::default();
        }
        if !self.has_frames(state, here.now) {
            state.enter(Stage::HandedOver, Some(Reason::NoCamera), here.now);
            return Wish::default();
        }
        let reason = match (state.has_found, state.lacks_height) {
            (true, _) => Reason::PadLost,
            (false, true) => Reason::NoHeight,
            (false, false) => Reason::NoPad,
        };
        self.search_on(state, input, here, reason)
    }

    /// Continues the search; at its end hands over with that reason.
    fn search_on(&self, state: &mut State, input: &Input<'_>, here: &Here, reason: Reason) -> Wish {
        let progress = self.search.step(&mut state.search, here.place_ned_m, input.is_blocked, here.now, here.tick_s);
        let reason = match progress {
            search::Progress::Towards(corner) => {
                return self.hover(state, corner, here, HEIGHT_ASSUMED_M, search::SPEED_MPS);
            }
            search::Progress::Over(End::Searched) => reason,
            search::Progress::Over(End::TimeUp) => Reason::TimeLimit,
            search::Progress::Over(End::Blocked) => Reason::Blocked,
        };
        state.enter(Stage::HandedOver, Some(reason), here.now);
        Wish::default()
    }

    /// Towards a place, at the present height.
    fn hover(&self, state: &mut State, place: Horizontal, here: &Here, height_m: f32, speed_mps: f32) -> Wish {
        let error_m = place.minus(here.place_ned_m);
        let velocity_ned_mps =
            self.pilot.steer(&mut state.integral_mps, error_m, here.velocity_ned_mps, height_m, speed_mps, here.tick_s);
        Wish { velocity_ned_mps, down_mps: 0.0 }
    }

    /// Below this height it descends without seeing the pad: a large one, or one before a narrow camera, fills the picture early.
    fn commit_m(&self) -> f32 {
        let c = &self.config;
        let filled_m = c.pad_radius_m * c.focal_widths / (SHORT_SIDE_HALF * FILLED);
        between(filled_m, COMMIT_M, COMMIT_MAX_M)
    }

    fn center(&self, state: &mut State, input: &Input<'_>, here: &Here) -> Wish {
        let (c, now) = (&self.config.centring, here.now);
        state.has_found = true;
        let height_m = state.track.height_m(here.down_m);
        let unseen_s = state.track.unseen_s(now);
        let pad = state.track.place_ned_m().horizontal();
        let error_m = pad.minus(here.place_ned_m).norm();
        if input.is_landed && height_m < COMMIT_M + LOW_M {
            state.enter(Stage::Landed, Some(Reason::Landed), now);
            return Wish::default();
        }
        if state.blocked_s > BLOCKED_S {
            state.enter(Stage::HandedOver, Some(Reason::Blocked), now);
            return Wish::default();
        }
        // It returns from the last part without sight: it has this long to see the pad again.
        let is_lost = unseen_s > LOST_S && now.seconds_since(state.entered) > LOST_S;
        if is_lost || now.seconds_since(state.attempted) > self.config.attempt_s {
            let reason = if is_lost { Reason::PadLost } else { Reason::TimeLimit };
            return self.lose(state, here, reason);
        }
        let is_fresh = unseen_s < FRESH_S;
        let gate_m = self.pilot.gate_m(height_m);
        if state.stage == Stage::Centring && is_fresh && error_m < INSIDE * gate_m {
            state.enter(Stage::Descending, None, now);
        } else if state.stage == Stage::Descending && !(is_fresh && error_m < gate_m) {
            state.enter(Stage::Centring, None, now);
        }
        let is_slow = here.velocity_ned_mps.norm_squared() < c.commit_speed_mps * c.commit_speed_mps;
        let is_inside = error_m < c.commit_gate_m && pad.minus(here.after(AHEAD_S)).norm() < c.commit_gate_m;
        let commit_m = self.commit_m();
        if height_m < commit_m + WAIT_ABOVE_M && is_inside && is_slow && is_fresh {
            state.enter(Stage::Committed, None, now);
        }
        let wait_m = commit_m + 0.5 * WAIT_ABOVE_M;
        // If pushed away it climbs, so that the pad stays in the picture.
        let half_tangent = SHORT_SIDE_HALF / self.config.focal_widths;
        let in_sight_m = between((error_m - 0.5 * self.config.pad_radius_m) / half_tangent, 0.0, IN_SIGHT_MAX_M);
        let wait_m = if in_sight_m > wait_m && here.down_m > state.top_down_m { in_sight_m } else { wait_m };
        let to_wait_mps = HEIGHT_RATE_PER_S * (height_m - wait_m);
        let down_mps = if state.stage == Stage::Descending {
            let descent_mps = self.pilot.descent_mps(height_m, error_m);
            if to_wait_mps < descent_mps { to_wait_mps } else { descent_mps }
        } else if to_wait_mps < 0.0 {
            to_wait_mps
        } else {
            0.0
        };
        Wish { down_mps, ..self.hover(state, pad, here, height_m, speed_mps(height_m)) }
    }

    fn lose(&self, state: &mut State, here: &Here, reason: Reason) -> Wish {
        // A pad that a climb brings back into sight was not lost.
        if reason == Reason::PadLost || self.may_retry(state, reason, here.now) {
            state.lost_down_m = here.down_m;
            state.enter(Stage::Recovering, Some(reason), here.now);
        }
        Wish::default()
    }

    /// Counts a loss; after too many it hands over.
    fn may_retry(&self, state: &mut State, reason: Reason, now: Instant) -> bool {
        if state.retries >= self.config.retries_max {
            state.enter(Stage::HandedOver, Some(reason), now);
            return false;
        }
        state.retries += 1;
        state.attempted = now;
        true
    }

    fn recover(&self, state: &mut State, here: &Here) -> Wish {
        let pad = state.track.place_ned_m().horizontal();
        let risen_m = state.lost_down_m - here.down_m;
        let is_up = risen_m >= CLIMB_M || here.down_m <= state.top_down_m;
        let since_s = here.now.seconds_since(state.entered);
        // Seen again from a little higher: the cause of the loss must not recur at once.
        if self.is_found(state, here.now) && (is_up || risen_m > 0.3 * CLIMB_M) {
            state.enter(Stage::Centring, None, here.now);
        } else if (is_up || since_s > CLIMB_S)
            && self.may_retry(state, state.reason.unwrap_or(Reason::PadLost), here.now)
        {
            self.begin_pad_search(state, pad, here);
        }
        if state.stage != Stage::Recovering {
            return Wish::default();
        }
        let height_m = state.track.height_m(here.down_m);
        let down_mps = if is_up { 0.0 } else { -CLIMB_MPS };
        Wish { down_mps, ..self.hover(state, pad, here, height_m, speed_mps(height_m)) }
    }

    fn commit(&self, state: &mut State, input: &Input<'_>, here: &Here) -> Wish {
        let (c, now) = (&self.config.centring, here.now);
        let height_m = state.track.height_m(here.down_m);
        let pad = state.track.place_ned_m().horizontal();
        let error_m = pad.minus(here.place_ned_m).norm();
        let is_told = state.down_mps > 0.5 * COMMIT_MPS;
        let stands = is_told && !input.is_blocked && libm::fabsf(here.down_mps) < STANDS_MPS;
        state.stands_s = if stands { state.stands_s + here.tick_s } else { 0.0 };
        if input.is_landed || (state.stands_s > STANDS_S && height_m < LOW_M) {
            state.enter(Stage::Landed, Some(Reason::Landed), now);
            return Wish::default();
        }
        let is_late = now.seconds_since(state.entered) > COMMIT_S;
        if state.is_dropping && is_late {
            return self.lose(state, here, Reason::TimeLimit);
        } else if !state.is_dropping && (is_late || error_m > PUSHED_GATES * c.commit_gate_m) {
            state.enter(Stage::Centring, None, now);
        }
        // The drop waits: it cannot be aborted.
        let soon_m = pad.minus(here.after(DROP_S)).norm();
        let drop_m = if here.height_m.is_some() { DROP_M } else { DROP_UNSURE_M };
        let is_at_edge = height_m < drop_m + DROP_BAND_M;
        let is_slow = here.velocity_ned_mps.norm_squared() < c.commit_speed_mps * c.commit_speed_mps;
        let is_moment = is_at_edge && is_slow && soon_m < DROP_GATES * c.commit_gate_m && error_m < c.commit_gate_m;
        if is_moment && state.stage == Stage::Committed && !state.is_dropping {
            (state.is_dropping, state.entered) = (true, now);
        }
        let wait_mps = between(HEIGHT_RATE_PER_S * (height_m - drop_m), -CLIMB_MPS, DESCENT_MIN_MPS);
        let down_mps = if state.is_dropping { COMMIT_MPS } else { wait_mps };
        Wish { down_mps, ..self.hover(state, pad, here, height_m, speed_mps(height_m)) }
    }
}
