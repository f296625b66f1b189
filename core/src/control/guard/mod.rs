//! The guard: the last safety filter. Every command passes through it, whichever stage it comes from, and it trusts
//! none of them.
//!
//! Its steps, in order:
//!
//! 1. Numbers that are not finite become a brake; speeds, horizontal and vertical, and the yaw rate are limited. Demands
//!    of the evader may be faster than others ([`Config::evade_max_mps`]).
//! 2. Motion towards each known circle and the geofence is limited so that the vehicle can still stop:
//!    half-spaces of a control barrier function `h = distance - reach - margin - 0.2 |v_obstacle|`, with the bound
//!    `-dh/dt <= min(rate h, sqrt(1.4 a h))` on the speed relative to the circle. The command is replaced by the
//!    nearest one that all of them allow. If an obstacle is too close the vehicle moves away from it, also from a
//!    standstill. If the half-spaces contradict one another, the distance to standing obstacles need only not shrink;
//!    if they still do, the vehicle brakes. In gusts ([`crate::control::wind`]) the margin to standing obstacles
//!    grows by the gust margin; if there is no space for that, all margins shrink equally, which leads to the middle.
//! 3. The change from the last command is limited: by the acceleration limit always, by the jerk limit when the speed
//!    grows. Braking and evading are never limited by jerk, so that they are not late. The jerk limit bounds how fast
//!    an acceleration builds up or reverses; it may end at once. Where the half-spaces ask for a slower command, that
//!    change comes first: the vehicle slows before it turns.
//! 4. An exact check: the segments from the vehicle to its rest point and on to where this command would lead must
//!    not touch a circle or leave the fence less its margin; otherwise the command is reduced, if necessary to a brake.
//! 5. The vehicle's hull, at the place where the command leads, must not touch a place that the sensor has not seen
//!    ([`crate::mapping::coverage`]). Otherwise the command is reduced or held, and the output says where to turn the
//!    sensor first. Behind an obstacle of the latest scan, where turning does not help, the vehicle goes slowly. Two
//!    threats outweigh an unseen obstacle: an obstacle that approaches the vehicle, and gusts that push it towards
//!    one. Where the demand leads into the unseen, the vehicle then makes way while the nose turns, and does no more.
//!    Demands of the evader do not wait for the nose.
//!
//! Within the limits a brake is always allowed. Everything is counted; the count of steps shows that the guard is
//! running. Cost: at most 11 000 instructions among 64 obstacles (bench row `guard_64`).

use crate::base::config::Vehicle;
use crate::base::math::sqrt;
use crate::base::ned::{Horizontal, Ned};
use crate::base::obstacle::{Circle, Neighbour};
use crate::base::pose::Pose;
use crate::base::units::between;
use crate::control::track::Demand;
use crate::mapping::coverage::{Coverage, Surveyor};
use crate::mapping::scan::Scan;

mod ahead;
mod bounds;
mod config;
mod half_space;

use ahead::PathCover;
pub use bounds::CLOSE_MAX;
use bounds::Near;
pub use config::Config;
use half_space::{HalfSpaces, evened_out, nearest_allowed};

/// The fast loop uses this many of the nearest obstacles; the planner gets all.
pub const OBSTACLES_MAX: usize = 64;

/// Largest speed towards places hidden behind an obstacle.
const HIDDEN_MPS: f32 = 0.4;
/// Radius of the disc that stands for the fence: large against what the evader foresees, and small enough for its
/// squares.
const FENCE_DISC_M: f32 = 100.0;
/// Share of the remaining distance to an altitude limit that may be used up per second.
const ALTITUDE_RATE_PER_S: f32 = 0.5;

/// The one command that leaves the core.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Setpoint {
    /// Velocity in the local NED frame.
    pub velocity_ned_mps: Ned,
    /// Yaw rate, clockwise positive.
    pub yaw_rate_radps: f32,
}

/// What the guard did with a command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Action {
    /// Passed with nothing but the limits of acceleration and jerk.
    #[default]
    Passed,
    /// Slowed, or deflected from an obstacle or the fence.
    Limited,
    /// Held until the nose has turned to a place that the sensor has not seen.
    Looking,
    /// Replaced by a brake.
    Braked,
}

/// The guard's answer to a demand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GuardOutput {
    /// The command.
    pub setpoint: Setpoint,
    /// What the guard did with the demand.
    pub action: Action,
    /// Where to turn the sensor before going on, from north, clockwise.
    pub look_ned_rad: Option<f32>,
}

/// The vehicle's state and the conditions of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GuardInput {
    /// Position, local NED.
    pub position_ned_m: Horizontal,
    /// Rest point, local NED.
    pub rest_ned_m: Horizontal,
    /// Yaw.
    pub yaw_rad: f32,
    /// Yaw where the nose would come to rest ([`crate::control::track::rest_yaw_rad`]).
    pub rest_yaw_rad: f32,
    /// Time that the vehicle takes to reach its rest point; moving obstacles have moved on by then.
    pub delay_s: f32,
    /// The gust margin: the additional distance from standing obstacles.
    pub gust_margin_m: f32,
    /// Whether such gusts have been measured, and are not only expected.
    pub has_gusts: bool,
    /// The demand is the evader's.
    pub is_evading: bool,
    /// It gives way to somebody in view: it does not wait until the nose has turned.
    pub may_be_unseen: bool,
    /// The position is not to be trusted: it brakes, since it cannot know what it would keep clear of.
    pub is_lost: bool,
    /// Vertical position, local NED, if known.
    pub down_m: Option<f32>,
    /// The held altitude, local NED, if any.
    pub held_down_m: Option<f32>,
}

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Counts {
    /// Commands that passed.
    pub passed: u32,
    /// Commands that were slowed or deflected.
    pub limited: u32,
    /// Commands held until the nose has turned.
    pub looking: u32,
    /// Commands replaced by a brake.
    pub braked: u32,
    /// Of those, the brakes because the half-spaces contradict one another.
    pub not_converged: u32,
}

/// The configured stage.
///
/// ```
/// # use foxhound_core::ConfigError;
/// use foxhound_core::base::config::{RangeSensor, Vehicle};
/// use foxhound_core::base::ned::Horizontal;
/// use foxhound_core::control::guard::{Config, GuardInput, State};
/// use foxhound_core::control::track::Demand;
///
/// let config = Config::default();
/// let guard = config.build(&Vehicle::default(), &RangeSensor::default())?;
/// let mut state = State::default();
/// let velocity_ned_mps = Horizontal { north: 50.0, east: 0.0 };
/// let demand = Demand { velocity_ned_mps, ..Demand::default() };
/// for _ in 0..100 {
///     let setpoint = guard.step(&mut state, &demand, &GuardInput::default(), &[], 0.02).setpoint;
///     assert!(setpoint.velocity_ned_mps.north <= config.v_max_mps);
/// }
/// # Ok::<(), ConfigError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guard {
    config: Config,
    vehicle: Vehicle,
    fov_rad: f32,
    surveyor: Surveyor,
}

/// The last command, from which the next may differ only within the limits; the coverage; and the counts.
#[derive(Clone, Debug, Default)]
pub struct State {
    command_ned_mps: Horizontal,
    down_mps: f32,
    /// Change of the command in the last step.
    change_ned_mps: Horizontal,
    coverage: Coverage,
    counts: Counts,
}

impl State {
    /// The last horizontal command.
    #[must_use]
    pub fn command_ned_mps(&self) -> Horizontal {
        self.command_ned_mps
    }

    /// The coverage: which places the sensor has seen.
    #[cfg(test)]
    pub(crate) fn coverage(&self) -> &Coverage {
        &self.coverage
    }

    /// Counts since the start.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// The vehicle's altitude, in control: at another one nothing has been seen.
    pub fn level(&mut self, down_m: f32) {
        self.coverage.level(Some(down_m));
    }

    /// A step out of control: the next command starts from rest; the coverage is kept at the same altitude.
    pub fn release(&mut self, down_m: Option<f32>) {
        self.command_ned_mps = Horizontal::default();
        self.change_ned_mps = Horizontal::default();
        self.down_mps = 0.0;
        self.coverage.leave();
        self.coverage.level(down_m);
    }

    /// Nothing has been seen.
    pub(crate) fn forget(&mut self) {
        self.coverage.forget();
    }
}

impl Guard {
    /// A known circle as an obstacle for this vehicle.
    #[must_use]
    pub fn obstacle(&self, circle: &Circle) -> Neighbour {
        Neighbour::of(circle, self.vehicle.radius_m)
    }

    /// The fence, its margin included, as an obstacle for a vehicle at this place, for a stage that knows circles only: a large disc, which
    /// touches it where it is nearest.
    pub(crate) fn fence_beside(&self, place_ned_m: Horizontal) -> Option<Neighbour> {
        let (inwards, depth_m) = self.config.fence.inside(place_ned_m)?;
        Some(Neighbour {
            center_ned_m: place_ned_m.minus(inwards.times(depth_m - self.config.fence.margin_m + FENCE_DISC_M)),
            reach_m: FENCE_DISC_M,
            ..Neighbour::default()
        })
    }

    /// Adds a scan to the coverage; `loses_rays` if its sensor does.
    pub fn note_scan(&self, state: &mut State, scan: &Scan, pose: &Pose, loses_rays: bool) {
        self.surveyor.note_scan(&mut state.coverage, scan, pose, loses_rays);
    }

    /// Adds circles delivered by a sensor to the coverage; `obstacles` are all that are known near the vehicle.
    pub fn note_circles(&self, state: &mut State, obstacles: &[Neighbour], pose: &Pose) {
        self.surveyor.note_circles(&mut state.coverage, obstacles, self.vehicle.radius_m, pose);
    }

    /// Passes, limits or replaces one demand. The setpoint is finite and inside the limits for any input. The obstacles are the
    /// nearest, [`OBSTACLES_MAX`] at most.
    pub fn step(
        &self,
        state: &mut State,
        demand: &Demand,
        input: &GuardInput,
        obstacles: &[Neighbour],
        dt_s: f32,
    ) -> GuardOutput {
        let c = &self.config;
        let sane = !input.is_lost
            && demand.velocity_ned_mps.is_finite()
            && input.position_ned_m.is_finite()
            && input.rest_ned_m.is_finite()
            && input.yaw_rad.is_finite()
            && input.delay_s.is_finite();
        let yaw_rate_radps = between(finite(demand.yaw_rate_radps), -c.yaw_rate_max_radps, c.yaw_rate_max_radps);
        let down = self.vertical(state.down_mps, finite(demand.down_mps), input, dt_s);

        let last = state.command_ned_mps;
        let braked = (limited(last, Horizontal::default(), c.a_max_mps2 * dt_s), Action::Braked, None);
        let (velocity, action, look_ned_rad) =
            if sane { self.horizontal(state, demand, input, obstacles, dt_s).unwrap_or(braked) } else { braked };

        let counts = &mut state.counts;
        let count = match action {
            Action::Passed => &mut counts.passed,
            Action::Limited => &mut counts.limited,
            Action::Looking => &mut counts.looking,
            Action::Braked => &mut counts.braked,
        };
        *count = count.saturating_add(1);
        state.change_ned_mps = velocity.minus(last);
        (state.command_ned_mps, state.down_mps) = (velocity, down);
        let velocity_ned_mps = Ned { north: velocity.north, east: velocity.east, down };
        GuardOutput { setpoint: Setpoint { velocity_ned_mps, yaw_rate_radps }, action, look_ned_rad }
    }

    /// The horizontal command; `None` is a brake.
    fn horizontal(
        &self,
        state: &mut State,
        demand: &Demand,
        input: &GuardInput,
        obstacles: &[Neighbour],
        dt_s: f32,
    ) -> Option<(Horizontal, Action, Option<f32>)> {
        let c = &self.config;
        self.surveyor.stand(&mut state.coverage, input.position_ned_m, self.vehicle.radius_m);
        // Filled in place: returning them would copy them.
        let (mut near, mut half_spaces) = (Near::new(), HalfSpaces::new());
        let v_max_mps = self.gather_near(state.command_ned_mps, input, obstacles, &mut near)?;
        let near = &near;
        let bounding = if input.gust_margin_m > 0.0 { obstacles } else { near };
        let is_threatened = self.bound(input, bounding, v_max_mps, &mut half_spaces);
        let is_urgent = is_threatened || input.is_evading;

        let wanted = demand.velocity_ned_mps.clamped(v_max_mps);
        let granted = if input.may_be_unseen { wanted } else { wanted.times(self.view_share(wanted, input.yaw_rad)) };
        let mut agreed = nearest_allowed(granted, &half_spaces);
        if agreed.is_none() && input.gust_margin_m > 0.0 {
            agreed = evened_out(granted, &mut half_spaces);
        }
        let agreed = agreed.or_else(|| {
            for half_space in &mut half_spaces {
                if half_space.least_mps > half_space.oncoming_mps {
                    half_space.least_mps = half_space.oncoming_mps;
                }
            }
            nearest_allowed(granted, &half_spaces)
        });
        let Some(safe) = agreed else {
            state.counts.not_converged = state.counts.not_converged.saturating_add(1);
            return None;
        };
        let safe = safe.clamped(v_max_mps);
        let kept = nearest_allowed(state.command_ned_mps, &half_spaces).unwrap_or(safe);

        // Without any scan so far there is no such sensor; whether one is required is decided by the mission.
        let has_sensor = state.coverage.has_scanned() && !input.may_be_unseen;
        let mut unseen = None;
        for (trial, share) in [1.0, 0.5, 0.25].into_iter().enumerate() {
            let tried = self.approach(state, kept, safe.times(share), is_urgent, dt_s);
            let is_clear = self.is_clear(tried, input, near) && self.stays_inside(tried, input);
            if !is_clear {
                continue;
            }
            let covered =
                if has_sensor { self.path_coverage(&state.coverage, tried, input, near) } else { PathCover::Seen };
            if let PathCover::Unseen(direction) = covered {
                unseen = unseen.or(Some(direction.bearing_rad()));
            }
            let is_slow = tried.norm_squared() <= HIDDEN_MPS * HIDDEN_MPS;
            if !(covered == PathCover::Seen || covered == PathCover::Hidden && is_slow) {
                if is_threatened {
                    // A part of it would not make way.
                    break;
                }
                continue;
            }
            if has_sensor
                && unseen.is_none()
                && tried != safe
                && let PathCover::Unseen(direction) = self.path_coverage(&state.coverage, safe, input, near)
            {
                // The nose turns to where the full command leads before the vehicle is fast enough to need it.
                unseen = Some(direction.bearing_rad());
            }
            let action = if trial == 0 && safe == wanted { Action::Passed } else { Action::Limited };
            return Some((tried, action, unseen));
        }
        let action = if unseen.is_some() { Action::Looking } else { Action::Limited };
        // Making way does not wait until the nose has turned; more space for gusts that are only expected does.
        if is_threatened || input.gust_margin_m > 0.0 {
            let still = Horizontal::default();
            let retreat = nearest_allowed(still, &half_spaces).or_else(|| evened_out(still, &mut half_spaces));
            let retreat = retreat.unwrap_or_default().clamped(v_max_mps);
            let tried = self.approach(state, kept, retreat, is_urgent, dt_s);
            let covered = if has_sensor && !is_threatened && !input.has_gusts {
                self.path_coverage(&state.coverage, tried, input, near)
            } else {
                PathCover::Seen
            };
            if let PathCover::Unseen(direction) = covered {
                unseen = Some(direction.bearing_rad());
            } else if self.is_clear(tried, input, near) && self.stays_inside(tried, input) {
                return Some((tried, action, unseen));
            }
        }
        let brake = limited(state.command_ned_mps, Horizontal::default(), c.a_max_mps2 * dt_s);
        unseen.map(|bearing_rad| (brake, Action::Looking, Some(bearing_rad)))
    }

    /// The next command, from the last towards `to`, inside the limits of acceleration and jerk. If the nearest one that is allowed,
    /// `kept`, is slower than the last, the change to it comes first, and what is left goes towards `to`.
    fn approach(&self, state: &State, kept: Horizontal, to: Horizontal, is_urgent: bool, dt_s: f32) -> Horizontal {
        let c = &self.config;
        let (from, a_max) = (state.command_ned_mps, c.a_max_mps2 * dt_s);
        let change = to.minus(from);
        let most = if is_urgent || to.norm_squared() <= from.norm_squared() {
            a_max
        } else {
            let built_up = if change.dot(state.change_ned_mps) > 0.0 { state.change_ned_mps.norm() } else { 0.0 };
            let by_jerk = built_up + c.jerk_max_mps3 * dt_s * dt_s;
            if by_jerk < a_max { by_jerk } else { a_max }
        };
        let kept = if kept.norm_squared() < from.norm_squared() { kept } else { from };
        let needed = kept.minus(from);
        let left = most - needed.norm();
        if left > 0.0 { kept.plus(to.minus(kept).clamped(left)) } else { from.plus(needed.clamped(a_max)) }
    }

    /// Share of the speed that is allowed in a direction that the sensor does not cover at the moment.
    fn view_share(&self, velocity: Horizontal, yaw_rad: f32) -> f32 {
        let half_rad = 0.5 * self.fov_rad;
        if half_rad >= 3.1 || velocity.norm_squared() < 1e-6 {
            return 1.0;
        }
        let off_rad = libm::fabsf(crate::base::units::wrap_pi(velocity.bearing_rad() - yaw_rad));
        // Full speed in the inner three fifths.
        between((half_rad - off_rad) / (0.4 * half_rad), self.config.out_of_view_share, 1.0)
    }

    /// The vertical command: towards the demand, inside the altitude band.
    fn vertical(&self, last_mps: f32, wanted_mps: f32, input: &GuardInput, dt_s: f32) -> f32 {
        let c = &self.config;
        let mut wanted_mps = between(wanted_mps, -c.v_down_max_mps, c.v_down_max_mps);
        let [down_m, held_m] =
            [input.down_m, input.held_down_m].map(|down_m| down_m.filter(|down_m| down_m.is_finite()));
        if let (Some(down_m), Some(held_m)) = (down_m, held_m) {
            let towards_mps = |limit_m: f32| {
                let way_m = limit_m - down_m;
                let stops_mps = sqrt(1.4 * c.a_max_mps2 * libm::fabsf(way_m));
                let most_mps = if stops_mps < c.v_down_max_mps { stops_mps } else { c.v_down_max_mps };
                between(ALTITUDE_RATE_PER_S * way_m, -most_mps, most_mps)
            };
            wanted_mps =
                between(wanted_mps, towards_mps(held_m - c.altitude_band_m), towards_mps(held_m + c.altitude_band_m));
        }
        let most = c.a_max_mps2 * dt_s;
        last_mps + between(wanted_mps - last_mps, -most, most)
    }
}

/// `value`, or 0 if it is not finite.
fn finite(value: f32) -> f32 {
    if value.is_finite() { value } else { 0.0 }
}

/// `to`, or the point on the way from `from` that is `most` away.
fn limited(from: Horizontal, to: Horizontal, most: f32) -> Horizontal {
    from.plus(to.minus(from).clamped(most))
}

#[cfg(test)]
mod tests;
