//! When a plan is requested, what the request contains, and when the answer takes effect.

use super::mission::Progress;
use super::{Guidance, State, near};
use crate::base::ned::Horizontal;
use crate::base::pose::Pose;
use crate::base::time::Instant;
use crate::control::guard::GuardInput;
use crate::localize::source::bank;
use crate::mapping::tracks::Track;
use crate::planning::planner::{Learn, Plan, Search};
use crate::planning::rollout::WAYPOINTS;

impl<const N: usize> Guidance<N> {
    /// Takes the planner's answer and lets it take effect at its step; true if one did.
    pub(super) fn take_over(&self, state: &mut State<N>, answer: Option<&Plan>) -> bool {
        if let Some(plan) = answer
            && state.due.is_some()
            && plan.id == state.request.id
        {
            state.pending = Some(plan.clone());
        }
        if state.due != Some(state.tick) {
            return false;
        }
        state.due = None;
        let answer = state.pending.take();
        state.is_plan_late = answer.is_none();
        let Some(plan) = answer else {
            state.plans_late = state.plans_late.saturating_add(1);
            return false;
        };
        state.trace.word(plan.id);
        for waypoint in &plan.waypoints_ned_m {
            state.trace.float(waypoint.north);
            state.trace.float(waypoint.east);
        }
        state.active = Some(plan);
        state.activated = state.tick;
        state.track.restart();
        true
    }

    /// Whether an obstacle known by now blocks the active plan's next waypoints.
    fn is_invalid(&self, state: &State<N>, situation: &GuardInput) -> bool {
        let State { active: Some(plan), near, track, .. } = state else { return false };
        let from = track.passed.min(WAYPOINTS);
        let next = plan.waypoints_ned_m.get(from..(from + 6).min(WAYPOINTS)).unwrap_or_default();
        near::stands_in_the_way(near, situation.rest_ned_m, next, self.plan_margin_m)
    }

    /// Requests a plan if one is needed; true if it did.
    pub(super) fn ask(&self, state: &mut State<N>, now: Instant, situation: &GuardInput, progress: Progress) -> bool {
        let since = state.tick.wrapping_sub(state.activated);
        let wanted = match progress {
            Progress::RanOut | Progress::Late => true,
            Progress::NoPath => since >= self.retry_ticks,
            Progress::GuardBraked | Progress::NotFinite => since >= self.handover_ticks,
            Progress::Following => {
                state.track.passed >= self.replan_at_waypoint
                    || since >= self.replan_ticks
                    || self.is_invalid(state, situation)
            }
        };
        if !wanted || state.due.is_some() {
            return false;
        }
        // The rest point follows commands at once, so this is where it will be when the plan takes effect.
        let ahead_s = self.tick_s * self.handover_ticks as f32;
        let start_ned_m = situation.rest_ned_m.plus(state.guard.command_ned_mps().times(ahead_s));
        let heard = state.goal.source_bearing_ned_rad().or(state.is_searching.then_some(situation.yaw_rad));
        let Some(bearing_rad) = heard else { return false };
        // Along the measured bearing line, which begins at the vehicle and not at the start of the plan; for a
        // reflected bearing, along the line to its origin.
        let direction =
            state.around_the_corner(situation.position_ned_m).unwrap_or(Horizontal::from_bearing(bearing_rad));
        let along_m = start_ned_m.minus(situation.position_ned_m).dot(direction);
        let distance_m = self.target_distance_m + if along_m > 0.0 { along_m } else { 0.0 };
        state.request.id = state.request.id.wrapping_add(1);
        state.request.seed = self.seed;
        state.request.start_ned_m = start_ned_m;
        state.request.gust_margin_m = self.wind.margin_m(&state.wind);
        state.request.among_moving = state.tracks.all().iter().any(Track::moves);
        state.request.target_ned_m = situation.position_ned_m.plus(direction.times(distance_m));
        state.request.fresh = state.request.id == 1 || core::mem::take(&mut state.misled);
        state.request.wants_lines = state.reflected >= self.reflected_min;
        state.request.begins = state.active.is_none();
        state.request.position_ned_m = situation.position_ned_m;
        state.request.direction_ned = direction;
        let vague = |belief: &bank::Answer| belief.estimate.range_sigma_ratio > self.range_sigma_max;
        state.request.learn = state.belief.filter(vague).map(|belief| Learn {
            source_ned_m: belief.estimate.place_ned_m,
            covariance_m2: belief.estimate.covariance_m2,
            sigma_rad: if belief.estimate.bearing_sigma_rad > 0.01 { belief.estimate.bearing_sigma_rad } else { 0.01 },
        });
        state.request.known_source_ned_m = self.known_source_ned_m;
        let pose = Pose { position_ned_m: situation.position_ned_m, yaw_rad: situation.yaw_rad };
        state.request.search = state.is_searching.then_some(Search { now, pose });
        state.request.sightings = state.goal.take_sightings();
        state.due = Some(state.tick.wrapping_add(self.handover_ticks));
        true
    }
}
