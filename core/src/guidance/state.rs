//! The state of the fast loop, and how it starts over.

use heapless::Vec;

use super::{Guidance, OBSTACLES_MAX, mission, turning};
use crate::base::history::Poses;
use crate::base::ned::Horizontal;
use crate::base::obstacle::Neighbour;
use crate::base::ownship::{Agreement, Ownship};
use crate::base::trace::Trace;
use crate::control::{evade, guard, track, vehicle_model, wind};
use crate::doa::bearing::Flags;
use crate::landing;
use crate::localize::belief;
use crate::mapping::map::Map;
use crate::mapping::scan::LostRays;
use crate::mapping::tracks::Tracks;
use crate::mapping::walls::{WALLS_MAX, Wall};
use crate::planning::planner::{Answer, Plan, PlanRequest};
use crate::signal::phase;

/// The state of the fast loop, kept from step to step, by stage.
#[derive(Clone, Debug, Default)]
pub struct State<const N: usize> {
    pub(super) tick: u32,
    pub(super) phase: phase::State<N>,
    pub(super) last_flags: Flags,
    pub(super) turning: turning::State,
    pub(super) belief: belief::State,
    pub(super) vehicle: VehicleState,
    pub(super) surroundings: Surroundings,
    pub(super) plans: Plans,
    pub(super) arrival: Arrival,
    pub(super) control: Controllers,
    pub(super) mission: mission::State,
    pub(super) trace: Trace,
}

/// The vehicle as last received, and what is estimated of it.
#[derive(Clone, Debug, Default)]
pub(super) struct VehicleState {
    pub(super) ownship: Option<Ownship>,
    /// Those of the last moments, and how far the newest position has jumped, if it has.
    pub(super) poses: Poses,
    pub(super) jump_m: Option<Horizontal>,
    pub(super) agreement: Agreement,
    pub(super) height_m: Option<f32>,
    pub(super) model: vehicle_model::State,
    pub(super) wind: wind::State,
}

/// The obstacles.
#[derive(Clone, Debug, Default)]
pub(super) struct Surroundings {
    pub(super) map: Map,
    pub(super) tracks: Tracks,
    pub(super) lost_rays: LostRays,
    /// Those near the vehicle in this step.
    pub(super) near: Vec<Neighbour, OBSTACLES_MAX>,
}

/// The plan that is followed, and the next one.
#[derive(Clone, Debug, Default)]
pub(super) struct Plans {
    pub(super) request: PlanRequest,
    /// The step at which the request's answer takes effect; `None` without a request.
    pub(super) due: Option<u32>,
    pub(super) pending: Option<Answer>,
    pub(super) active: Option<Plan>,
    /// The walls that came with it.
    pub(super) walls: Vec<Wall, WALLS_MAX>,
    /// When the active plan took effect.
    pub(super) activated: u32,
    /// Steps since the last request that was not early.
    pub(super) since_attempt: u16,
    /// Whether the last plan came too late.
    pub(super) is_late: bool,
    /// There is no signal, and the vehicle searches for one.
    pub(super) is_searching: bool,
}

/// The landing, and its last output.
#[derive(Clone, Debug, Default)]
pub(super) struct Arrival {
    pub(super) landing: landing::State,
    pub(super) advice: Option<landing::Output>,
    /// Whether the guard braked in the last step.
    pub(super) is_blocked: bool,
}

/// From the plan to the setpoint.
#[derive(Clone, Debug, Default)]
pub(super) struct Controllers {
    pub(super) track: track::State,
    pub(super) evade: evade::State,
    pub(super) guard: guard::State,
    /// Where the guard needs to look before it goes on.
    pub(super) look_ned_rad: Option<f32>,
    pub(super) hold_down_m: Option<f32>,
}

impl Plans {
    /// The active plan is not followed any more, nor the one that has been requested, and the walls that came with it are forgotten.
    pub(super) fn end_active(&mut self) {
        (self.due, self.pending, self.active) = (None, None, None);
        self.walls.clear();
    }
}

impl Surroundings {
    /// Nothing has been seen yet.
    #[inline(never)]
    pub(super) fn forget(&mut self) {
        let Self { map, tracks, lost_rays, near } = self;
        map.clear();
        tracks.clear();
        *lost_rays = LostRays::default();
        near.clear();
    }
}

impl<const N: usize> State<N> {
    /// The plan request in progress. It was made with the obstacles that [`Self::map`] had at its step.
    #[must_use]
    pub fn request(&self) -> &PlanRequest {
        &self.plans.request
    }

    /// The known obstacles.
    #[must_use]
    pub fn map(&self) -> &Map {
        &self.surroundings.map
    }

    /// The belief about the source.
    #[must_use]
    pub const fn belief(&self) -> &belief::State {
        &self.belief
    }

    /// The tracked bodies.
    #[must_use]
    pub fn tracks(&self) -> &Tracks {
        &self.surroundings.tracks
    }

    /// The velocity with which the last step gives way to moving obstacles; `None` if it does not.
    #[must_use]
    pub const fn evasion_ned_mps(&self) -> Option<Horizontal> {
        self.control.evade.choice_ned_mps()
    }

    /// Height of the vehicle over the ground, if known.
    #[must_use]
    pub const fn height_m(&self) -> Option<f32> {
        self.vehicle.height_m
    }
}

impl<const N: usize> Guidance<N> {
    /// The state before the first step.
    #[must_use]
    pub fn start(&self) -> State<N> {
        State::default()
    }

    /// Back to the state before the first step, in place: a second state on the stack would not fit a
    /// microcontroller.
    pub fn restart(&self, state: &mut State<N>) {
        let State {
            tick,
            phase,
            last_flags,
            turning,
            belief,
            vehicle,
            surroundings,
            plans,
            arrival,
            control,
            mission,
            trace,
        } = state;
        *tick = 0;
        phase.clear();
        *last_flags = Flags::default();
        *turning = turning::State::default();
        belief.forget();
        *vehicle = VehicleState::default();
        surroundings.forget();
        *plans = Plans::default();
        *arrival = Arrival::default();
        *control = Controllers::default();
        *mission = mission::State::default();
        *trace = Trace::default();
    }
}
