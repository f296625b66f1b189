//! The state of the fast loop, and how it starts over.

use heapless::Vec;

use super::{Guidance, OBSTACLES_MAX, Refused, mission, turning};
use crate::base::ned::Horizontal;
use crate::base::obstacle::Neighbour;
use crate::base::ownship::{Agreement, Ownship};
use crate::base::trace::Trace;
use crate::control::{evade, guard, track, vehicle_model, wind};
use crate::doa::bearing::Flags;
use crate::landing;
use crate::localize::source::bank::{self, Path};
use crate::localize::source::gather::Gathering;
use crate::localize::{goal, link_state};
use crate::mapping::coverage::Coverage;
use crate::mapping::map::Map;
use crate::mapping::tracks::Tracks;
use crate::planning::planner::{Plan, PlanRequest};
use crate::signal::phase;

/// The state of the fast loop, kept from step to step.
#[derive(Clone, Debug)]
pub struct State<const N: usize> {
    pub(super) tick: u32,
    pub(super) phase: phase::State<N>,
    pub(super) map: Map,
    pub(super) tracks: Tracks,
    pub(super) refused: Refused,
    pub(super) gathering: Gathering,
    pub(super) link: link_state::State,
    /// Probability that the link is reflected, as of the last bearing.
    pub(super) reflected: f32,
    pub(super) source: bank::State,
    /// The planner's information about the source was about its mirror image.
    pub(super) misled: bool,
    /// The bank's last answer.
    pub(super) belief: Option<bank::Answer>,
    /// There is no signal, and the vehicle searches for one.
    pub(super) is_searching: bool,
    pub(super) goal: goal::State,
    pub(super) vehicle_model: vehicle_model::State,
    pub(super) wind: wind::State,
    pub(super) track: track::State,
    pub(super) evade: evade::State,
    pub(super) guard: guard::State,
    /// Where the guard needs to look before it goes on.
    pub(super) look_ned_rad: Option<f32>,
    pub(super) mission: mission::State,
    pub(super) turning: turning::State,
    pub(super) landing: landing::State,
    /// The landing's last output, and whether the guard braked then.
    pub(super) advice: Option<landing::Output>,
    pub(super) is_blocked: bool,
    pub(super) height_m: Option<f32>,
    /// Obstacles near the vehicle in this step.
    pub(super) near: Vec<Neighbour, OBSTACLES_MAX>,
    pub(super) ownship: Option<Ownship>,
    pub(super) agreement: Agreement,
    pub(super) last_flags: Flags,
    pub(super) hold_down_m: Option<f32>,
    pub(super) request: PlanRequest,
    /// The step at which the request's answer takes effect; `None` without a request.
    pub(super) due: Option<u32>,
    pub(super) pending: Option<Plan>,
    pub(super) active: Option<Plan>,
    /// When the active plan took effect.
    pub(super) activated: u32,
    pub(super) plans_late: u32,
    /// The last requested plan did not arrive in time.
    pub(super) is_plan_late: bool,
    pub(super) trace: Trace,
}

impl<const N: usize> Default for State<N> {
    /// The state before the first step, for any configuration.
    fn default() -> Self {
        Self {
            tick: 0,
            phase: phase::State::default(),
            map: Map::default(),
            tracks: Tracks::default(),
            refused: Refused::default(),
            gathering: Gathering::default(),
            link: link_state::State::new(),
            reflected: 0.0,
            source: bank::State::new(),
            misled: false,
            belief: None,
            is_searching: false,
            goal: goal::State::default(),
            vehicle_model: vehicle_model::State::default(),
            wind: wind::State::default(),
            track: track::State::default(),
            evade: evade::State::default(),
            guard: guard::State::default(),
            look_ned_rad: None,
            mission: mission::State::default(),
            turning: turning::State::default(),
            landing: landing::State::default(),
            advice: None,
            is_blocked: false,
            height_m: None,
            near: Vec::new(),
            ownship: None,
            agreement: Agreement::default(),
            last_flags: Flags::default(),
            hold_down_m: None,
            request: PlanRequest::default(),
            due: None,
            pending: None,
            active: None,
            activated: 0,
            plans_late: 0,
            is_plan_late: false,
            trace: Trace::default(),
        }
    }
}

impl<const N: usize> State<N> {
    /// The plan request in progress. It was made with the obstacles that [`Self::map`] had at its step.
    #[must_use]
    pub fn request(&self) -> &PlanRequest {
        &self.request
    }

    /// The known obstacles.
    #[must_use]
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// The tracked bodies.
    #[must_use]
    pub fn tracks(&self) -> &Tracks {
        &self.tracks
    }

    /// The velocity with which the last step gives way to moving obstacles; `None` if it does not.
    #[must_use]
    pub const fn evasion_ned_mps(&self) -> Option<Horizontal> {
        self.evade.choice_ned_mps()
    }

    /// Deliveries of obstacle sensors that were refused.
    #[must_use]
    pub const fn refused(&self) -> &Refused {
        &self.refused
    }

    /// Obstacles near the vehicle, as passed to the guard in the last step.
    #[must_use]
    pub fn near(&self) -> &[Neighbour] {
        &self.near
    }

    /// The coverage of the obstacle sensors.
    #[must_use]
    pub fn coverage(&self) -> &Coverage {
        self.guard.coverage()
    }

    /// Height of the vehicle over the ground, if known.
    #[must_use]
    pub const fn height_m(&self) -> Option<f32> {
        self.height_m
    }

    /// The plan that is being followed.
    #[must_use]
    pub fn plan(&self) -> Option<&Plan> {
        self.active.as_ref()
    }
}

impl<const N: usize> State<N> {
    /// The direction of the origin of a reflected signal, from a place.
    pub(super) fn around_the_corner(&self, from_ned_m: Horizontal) -> Option<Horizontal> {
        let belief = self.belief.filter(|belief| belief.path != Path::Direct)?;
        let towards = belief.estimate.place_ned_m.minus(from_ned_m);
        let norm = towards.norm();
        (norm > 1e-3).then(|| towards.times(1.0 / norm))
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
            map,
            tracks,
            refused,
            gathering,
            link,
            reflected,
            source,
            misled,
            belief,
            is_searching,
            goal,
            vehicle_model,
            wind,
            track,
            evade,
            guard,
            look_ned_rad,
            mission,
            turning,
            landing,
            advice,
            is_blocked,
            height_m,
            near,
            ownship,
            agreement,
            last_flags,
            hold_down_m,
            request,
            due,
            pending,
            active,
            activated,
            plans_late,
            is_plan_late,
            trace,
        } = state;
        (*tick, *activated, *plans_late, *is_plan_late) = (0, 0, 0, false);
        phase.clear();
        map.clear();
        tracks.clear();
        *refused = Refused::default();
        *gathering = Gathering::default();
        *link = link_state::State::new();
        *reflected = 0.0;
        *source = bank::State::new();
        (*misled, *is_searching) = (false, false);
        *belief = None;
        *goal = goal::State::default();
        *vehicle_model = vehicle_model::State::default();
        *wind = wind::State::default();
        *track = track::State::default();
        *evade = evade::State::default();
        *guard = guard::State::default();
        (*look_ned_rad, *hold_down_m) = (None, None);
        *mission = mission::State::default();
        *turning = turning::State::default();
        *landing = landing::State::default();
        (*advice, *is_blocked, *height_m) = (None, false, None);
        near.clear();
        *ownship = None;
        *agreement = Agreement::default();
        *last_flags = Flags::default();
        *request = PlanRequest::default();
        *due = None;
        *pending = None;
        *active = None;
        *trace = Trace::default();
    }
}
