//! When a plan is requested, what the request contains, and when the answer takes effect.

use super::mission::Progress;
use super::{Guidance, HANDOVER_TICKS, State, near};
use crate::base::ned::Horizontal;
use crate::base::pose::Pose;
use crate::base::time::Instant;
use crate::control::guard::GuardInput;
use crate::mapping::tracks::Track;
use crate::planning::planner::{Answer, Learn, Search};
use crate::planning::rollout::WAYPOINTS;

/// Distance of the temporary target along the bearing, until a place of the source is known (main paper, section IV).
const TARGET_DISTANCE_M: f32 = 2.0;

impl<const N: usize> Guidance<N> {
    /// Takes the planner's answer and lets it take effect at its step.
    pub(super) fn take_over(&self, state: &mut State<N>, answer: Option<&Answer>) {
        if let Some(answer) = answer
            && state.plans.due.is_some()
            && answer.plan.id == state.plans.request.id
        {
            state.plans.pending = Some(answer.clone());
        }
        if state.plans.due != Some(state.tick) {
            return;
        }
        state.plans.due = None;
        let answer = state.plans.pending.take();
        state.plans.is_late = answer.is_none();
        let Some(Answer { plan, walls }) = answer else { return };
        state.trace.word(plan.id);
        for waypoint in &plan.waypoints_ned_m {
            state.trace.float(waypoint.north);
            state.trace.float(waypoint.east);
        }
        state.plans.active = Some(plan);
        state.plans.walls = walls;
        state.plans.activated = state.tick;
        state.control.track.restart();
    }

    /// Whether an obstacle known by now blocks the active plan's next waypoints.
    fn is_invalid(&self, state: &State<N>, situation: &GuardInput) -> bool {
        let Some(plan) = &state.plans.active else { return false };
        let from = state.control.track.passed.min(WAYPOINTS);
        let next = plan.waypoints_ned_m.get(from..(from + 6).min(WAYPOINTS)).unwrap_or_default();
        near::stands_in_the_way(&state.surroundings.near, situation.rest_ned_m, next, self.plan_margin_m)
    }

    /// Requests a plan if one is needed; true if it did.
    pub(super) fn ask(&self, state: &mut State<N>, now: Instant, situation: &GuardInput, progress: Progress) -> bool {
        let since = state.tick.wrapping_sub(state.plans.activated);
        state.plans.since_attempt = state.plans.since_attempt.saturating_add(1);
        let wanted = match progress {
            Progress::RanOut | Progress::Late => true,
            Progress::NoPath => since >= self.retry_ticks,
            Progress::GuardBraked | Progress::NotFinite => since >= HANDOVER_TICKS,
            Progress::Following => {
                state.control.track.passed >= self.replan_at_waypoint
                    || since >= self.replan_ticks
                    || self.is_invalid(state, situation)
            }
        };
        if !wanted || state.plans.due.is_some() {
            return false;
        }
        // The rest point follows commands at once, so this is where it will be when the plan takes effect.
        let ahead_s = self.tick_s * HANDOVER_TICKS as f32;
        let start_ned_m = situation.rest_ned_m.plus(state.control.guard.command_ned_mps().times(ahead_s));
        let heard = state.belief.bearing_ned_rad().or(state.plans.is_searching.then_some(situation.yaw_rad));
        let Some(bearing_rad) = heard else { return false };
        // Along the measured bearing line, which begins at the vehicle and not at the start of the plan; for a
        // reflected bearing, along the line to its origin.
        let direction =
            state.belief.around_the_corner(situation.position_ned_m).unwrap_or(Horizontal::from_bearing(bearing_rad));
        let along_m = start_ned_m.minus(situation.position_ned_m).dot(direction);
        let distance_m = TARGET_DISTANCE_M + if along_m > 0.0 { along_m } else { 0.0 };
        let request = &mut state.plans.request;
        request.id = request.id.wrapping_add(1);
        request.seed = self.seed;
        request.start_ned_m = start_ned_m;
        request.gust_margin_m = self.wind.margin_m(&state.vehicle.wind);
        request.among_moving = state.surroundings.tracks.all().iter().any(Track::moves);
        request.target_ned_m = situation.position_ned_m.plus(direction.times(distance_m));
        request.wants_walls = state.belief.is_reflected();
        request.begins = state.plans.active.is_none();
        request.is_early = !request.begins && u32::from(state.plans.since_attempt) < self.retry_ticks + HANDOVER_TICKS;
        if !request.is_early {
            state.plans.since_attempt = 0;
        }
        request.position_ned_m = situation.position_ned_m;
        request.direction_ned = direction;
        request.learn = state.belief.vague().map(|estimate| Learn {
            source_ned_m: estimate.place_ned_m,
            covariance_m2: estimate.covariance_m2,
            sigma_rad: if estimate.bearing_sigma_rad > 0.01 { estimate.bearing_sigma_rad } else { 0.01 },
        });
        request.known_source_ned_m = self.known_source_ned_m;
        let pose = Pose { position_ned_m: situation.position_ned_m, yaw_rad: situation.yaw_rad };
        request.search = state.plans.is_searching.then_some(Search { now, pose });
        state.belief.support(&mut request.support);
        state.plans.due = Some(state.tick.wrapping_add(HANDOVER_TICKS));
        true
    }
}
