//! From the active plan to the command: the demand, the evader and the guard; and the reset out of control.

use heapless::Vec;

use super::step::is_landing;
use super::{Guidance, State, near};
use crate::base::ned::Horizontal;
use crate::control::evade;
use crate::control::guard::{self, GuardInput, Setpoint};
use crate::control::track::{self, Demand};
use crate::planning::planner::Verdict;

/// Obstacles reported as moving faster than this are left to the evader while it gives way.
const WALKS_MPS: f32 = 0.5;
/// The guard lets the vehicle come this much nearer to obstacles reported as moving than to standing ones.
const BODY_M: f32 = 0.1;

impl<const N: usize> Guidance<N> {
    /// The demand of the active plan; `None` when there is nothing to follow.
    pub(super) fn demand(&self, state: &mut State<N>, situation: &GuardInput) -> Option<Demand> {
        let plan = state.plans.active.as_ref()?;
        let trajectory = &plan.waypoints_ned_m;
        let mut demand =
            state.control.track.step(trajectory, situation.rest_ned_m, situation.rest_yaw_rad, self.tick_s);
        if let Some(look_ned_rad) = state.control.look_ned_rad {
            demand.yaw_rate_radps = track::turn_to(look_ned_rad, situation.rest_yaw_rad);
        }
        if plan.verdict == Verdict::Brake {
            demand.velocity_ned_mps = Horizontal::default();
            // No safe path in sight: look towards the source.
            if let Some(bearing_rad) = state.belief.bearing_ned_rad() {
                demand.yaw_rate_radps = track::turn_to(bearing_rad, situation.rest_yaw_rad);
            }
        }
        Some(demand)
    }

    /// The demand, with the altitude held, through the evader and the guard.
    pub(super) fn command(
        &self,
        state: &mut State<N>,
        demand: &Demand,
        situation: &GuardInput,
        evades: bool,
    ) -> (Setpoint, guard::Action) {
        // The altitude of the first position received in control; before it there is none to hold.
        let mut demand = *demand;
        let mut situation = *situation;
        if is_landing(state) {
            // The altitude to hold next is the one where the landing ends.
            state.control.hold_down_m = None;
            situation.held_down_m = None;
        } else if let Some(down_m) = situation.down_m {
            demand.down_mps = track::hold_altitude(*state.control.hold_down_m.get_or_insert(down_m), down_m);
        }
        if evades {
            let ownship = state.vehicle.ownship.unwrap_or_default();
            let (standing, told) = near::told_apart(&state.surroundings.near);
            let mut followed = Vec::new();
            let is_in_view = near::followed(&self.guard, &state.surroundings.tracks, &mut followed);
            let evasion = self.evade.step(
                &mut state.control.evade,
                demand.velocity_ned_mps,
                &evade::Input {
                    position_ned_m: situation.position_ned_m,
                    velocity_ned_mps: ownship.velocity_ned_mps.horizontal(),
                    command_ned_mps: state.control.guard.command_ned_mps(),
                    halfway_ned_mps: state.vehicle.wind.halfway_mps(),
                    underway: &state.vehicle.model,
                    standing,
                    fence: self.guard.fence_beside(situation.position_ned_m),
                    moving: [told, &followed],
                },
            );
            if let Some(velocity_ned_mps) = evasion {
                demand.velocity_ned_mps = velocity_ned_mps;
                situation.is_evading = true;
                situation.may_be_unseen = is_in_view || !told.is_empty();
            }
            // With scans, the guard has the hits of a tracked body, and the moving circles of the map. With reported
            // circles, it keeps clear of a body's present place as if it stood there; walking bodies are left to the
            // evader, since they will have left that place when the vehicle arrives.
            if !state.surroundings.tracks.has_scanned() {
                if situation.is_evading {
                    state.surroundings.near.retain(|one| one.velocity_ned_mps.norm_squared() < WALKS_MPS * WALKS_MPS);
                }
                for body in
                    state.surroundings.near.iter_mut().filter(|one| one.velocity_ned_mps != Horizontal::default())
                {
                    body.velocity_ned_mps = Horizontal::default();
                    body.reach_m -= BODY_M;
                }
            }
        } else {
            state.control.evade = evade::State::default();
        }
        let ruling =
            self.guard.step(&mut state.control.guard, &demand, &situation, &state.surroundings.near, self.tick_s);
        state.control.look_ned_rad = ruling.look_ned_rad;
        (ruling.setpoint, ruling.action)
    }

    /// Out of control: everything that belongs to a mission starts over; knowledge of the surroundings is kept, unless the positions
    /// contradict the velocities.
    pub(super) fn let_go(&self, state: &mut State<N>) {
        state.control.guard.release(state.vehicle.ownship.map(|ownship| ownship.position_ned_m.down));
        state.vehicle.wind.release();
        state.belief.trust_reflections();
        state.plans.is_searching = false;
        state.control.look_ned_rad = None;
        state.control.track = track::State::default();
        state.control.evade = evade::State::default();
        state.control.hold_down_m = None;
        state.plans.end_active();
        state.plans.is_late = false;
        if state.vehicle.agreement.found().is_some() {
            // From where it saw what it knows is not known.
            state.surroundings.forget();
            state.control.guard.forget();
            state.belief.forget();
        }
        state.vehicle.agreement.release();
    }
}
