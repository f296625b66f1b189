//! The guard: every command passes it, whoever made it, and it trusts nobody.
//!
//! In this order:
//!
//! 1. Numbers that are not finite become a brake; speeds, horizontal and vertical, and the yaw rate are limited.
//! 2. Motion towards each known circle and each side of the geofence is limited to what can still be stopped: half-spaces of
//!    a control barrier function `h = distance - reach - margin - 0.2 |v_obstacle|`, with the bound
//!    `-dh/dt <= min(rate h, sqrt(1.4 a h))` on the speed relative to the circle. The command becomes the nearest one that
//!    all of them allow. What is too close is moved away from, also from a standstill. If they do not agree, what stands
//!    still need only not come nearer; if they still do not, it brakes.
//!    Where gusts push the vehicle about ([`crate::control::gust`]) the margin to what stands still grows by as much; where
//!    there is no room for that, all give way by the same, which leads to the middle.
//! 3. The change from the last command is limited: by the acceleration limit always, by the jerk limit when the speed
//!    grows. Slowing down is never limited by jerk, nor is getting out of the way: a brake must not be late. The jerk limit bounds how
//!    fast an acceleration builds up or turns round; it may end at once.
//! 4. An exact check: the segments from the vehicle to its rest point and on to where this command would lead must not
//!    touch a circle or leave the fence, or the command is cut down, in the end to a brake.
//! 5. The vehicle's hull at the place where the command leads must not touch a place that has not been looked at ([`sight`]).
//!    Otherwise it is cut down or held, and the ruling says where to look first. Behind something that the latest look has
//!    seen, where looking does not help, it goes slowly. Two threats are worse than what might be there: an obstacle that comes at
//!    the vehicle, and gusts that push it towards one. From that it keeps away while the nose turns, and does no more. Nor does what the
//!    evader asks for wait until the nose has turned.
//!
//! Within limits a brake is always granted. Everything is counted, and the count of steps tells that the guard is alive.
//! Cost: at most 11 000 instructions among 64 obstacles (bench row `guard_64`).

use heapless::Vec;

use crate::base::error::{ConfigError, Why, check};
use crate::base::math::sqrt;
use crate::base::ned::{Horizontal, Ned};
use crate::base::obstacle::{Circle, Neighbour};
use crate::base::pose::Pose;
use crate::base::units::{between, sin_cos};
use crate::control::track::Demand;
use crate::mapping::scan::Scan;
use crate::mapping::sight::{self, Cover, Sight, Surveyor};

mod fence;
pub use fence::{CORNERS_MAX, Fence};

/// A half-space counts as kept when it is missed by no more than this.
const AGREED_MPS: f32 = 1e-4;
/// So many half-spaces may decide.
const DECISIVE_MAX: usize = 12;
/// So many obstacles are looked at closely in one step. Among more the vehicle is slower, so that fewer can matter.
pub const CLOSE_MAX: usize = 18;
/// So many bound the velocity in gusts, where those as far away as the gust margin do, whatever the speed. Of more than that
/// the least demanding are left out.
const GUSTY_MAX: usize = 64;
/// How often its speed is halved for that; where there are still more it brakes.
const HALVED_MAX: u8 = 3;
/// How far ahead the straight line from the vehicle to where the command leads must be clear.
const CORNER_S: f32 = 0.2;
/// Fastest that what is too close is moved away from, where it stands still.
const OUT_MPS: f32 = 0.3;
/// So many times as fast in gusts.
const GUSTY_OUT: f32 = 2.0;
/// Fastest towards what is hidden behind something.
const HIDDEN_MPS: f32 = 0.4;
/// What comes at the vehicle slower than this is no threat.
const STILL_MPS: f32 = 0.02;
/// Slower than this nothing need be looked at.
const CREEP_MPS: f32 = 0.001;
/// Share of the altitude that is left to a limit that may be used up a second.
const ALTITUDE_RATE_PER_S: f32 = 0.5;
/// Half a way shorter than this is not looked at by itself: what is asked of a place holds for 7 cm around it.
const SHORT_M: f32 = 0.06;
/// Halvings of the shortfall where gusts want more room than there is.
const EVENED_MAX: u8 = 4;
/// Half-planes beyond this many times the speed limit cannot matter.
const SLACK: f32 = 1.5;

/// Cosine and sine of the directions, off that of travel, in which the hull's front comes nearer to something: up to 75
/// degrees. At 90 it would pass it.
const FRONT: [(f32, f32); 9] = [
    (1.0, 0.0),
    (0.946_930, 0.321_439),
    (0.946_930, -0.321_439),
    (0.793_353, 0.608_761),
    (0.793_353, -0.608_761),
    (0.555_570, 0.831_470),
    (0.555_570, -0.831_470),
    (0.258_819, 0.965_926),
    (0.258_819, -0.965_926),
];

/// What the guard needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Largest horizontal speed.
    pub v_max_mps: f32,
    /// Largest vertical speed.
    pub v_down_max_mps: f32,
    /// Largest change of the horizontal, and of the vertical, command.
    pub a_max_mps2: f32,
    /// Largest change of that change while the speed grows.
    pub jerk_max_mps3: f32,
    /// Largest yaw rate.
    pub yaw_rate_max_radps: f32,
    /// Radius of the vehicle.
    pub vehicle_radius_m: f32,
    /// Clearance that the half-spaces keep.
    pub margin_m: f32,
    /// Share of the remaining clearance that may be used up a second.
    pub approach_rate_per_s: f32,
    /// Full angle of the obstacle sensor's view, centred on the nose; 2 pi when it looks all round.
    pub fov_rad: f32,
    /// Share of the speed that is granted out of the view, into what has been seen.
    pub out_of_view_share: f32,
    /// Where has been looked.
    pub sight: sight::Config,
    /// Largest deviation from the altitude that is held, either way.
    pub altitude_band_m: f32,
    /// Highest place, local NED.
    pub down_min_m: f32,
    /// Lowest place, local NED.
    pub down_max_m: f32,
    /// Where the vehicle may be.
    pub fence: Fence,
    /// Distance that is kept from the fence, on its inside.
    pub fence_margin_m: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            v_max_mps: 1.0,
            v_down_max_mps: 0.5,
            a_max_mps2: 2.0,
            jerk_max_mps3: 20.0,
            yaw_rate_max_radps: 2.5,
            vehicle_radius_m: 0.15,
            margin_m: 0.03,
            approach_rate_per_s: 2.0,
            fov_rad: core::f32::consts::FRAC_PI_2,
            out_of_view_share: 0.5,
            sight: sight::Config::default(),
            altitude_band_m: 2.0,
            down_min_m: -1e4,
            down_max_m: 1e4,
            fence: Fence::Off,
            fence_margin_m: 0.5,
        }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Guard, ConfigError> {
        check("guard.v_max_mps", self.v_max_mps, 0.05, 20.0)?;
        check("guard.v_down_max_mps", self.v_down_max_mps, 0.0, 5.0)?;
        check("guard.a_max_mps2", self.a_max_mps2, 0.1, 20.0)?;
        check("guard.jerk_max_mps3", self.jerk_max_mps3, 1.0, 1000.0)?;
        check("guard.yaw_rate_max_radps", self.yaw_rate_max_radps, 0.1, 6.3)?;
        check("guard.vehicle_radius_m", self.vehicle_radius_m, 0.0, 5.0)?;
        check("guard.margin_m", self.margin_m, 0.0, 5.0)?;
        check("guard.approach_rate_per_s", self.approach_rate_per_s, 0.1, 20.0)?;
        check("guard.out_of_view_share", self.out_of_view_share, 0.0, 1.0)?;
        check("guard.altitude_band_m", self.altitude_band_m, 0.1, 1e3)?;
        check("guard.down_min_m", self.down_min_m, -1e4, 1e4)?;
        check("guard.down_max_m", self.down_max_m, -1e4, 1e4)?;
        if !(self.down_min_m + 0.1 < self.down_max_m) {
            let why = Why::Inconsistent("the highest place must be above the lowest");
            return Err(ConfigError { field: "guard.down_min_m", value: self.down_min_m, why });
        }
        check("guard.fence_margin_m", self.fence_margin_m, 0.0, 100.0)?;
        self.fence.build()?;
        Ok(Guard { config: *self, looker: self.sight.build(self.fov_rad)? })
    }
}

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

/// What the guard did to a command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Action {
    /// Nothing but what the limits of acceleration and jerk ask for.
    #[default]
    Passed,
    /// Slowed, or bent away from an obstacle or the fence.
    Limited,
    /// Held until the nose has turned to what has not been looked at.
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
    /// What it did.
    pub action: Action,
    /// Where to look before going on, from north, clockwise.
    pub look_ned_rad: Option<f32>,
}

/// Where the vehicle is and where it would come to rest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GuardInput {
    /// Position, local NED.
    pub position_ned_m: Horizontal,
    /// Rest point, local NED.
    pub rest_ned_m: Horizontal,
    /// Yaw.
    pub yaw_rad: f32,
    /// How long the vehicle takes to come to its rest point: what moves has moved on by then.
    pub delay_s: f32,
    /// How far gusts push the vehicle about: so much more is kept from what stands still.
    pub gust_margin_m: f32,
    /// The demand is the evader's: getting out of somebody's way does not wait until the nose has turned.
    pub is_evading: bool,
    /// Vertical position, local NED, if known.
    pub down_m: Option<f32>,
    /// The altitude that is held, local NED, if any.
    pub held_down_m: Option<f32>,
}

/// What the guard has done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Counts {
    /// Steps: grows as long as the guard is alive, in control or not. Wraps.
    pub beats: u32,
    /// Commands that passed.
    pub passed: u32,
    /// Commands that were slowed or bent.
    pub limited: u32,
    /// Commands held until the nose has come round.
    pub looking: u32,
    /// Commands that became a brake.
    pub braked: u32,
    /// Those of them that did so because the half-spaces did not agree.
    pub not_converged: u32,
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guard {
    config: Config,
    looker: Surveyor,
}

/// The last command, from which the next may differ by the limits, what has been seen, and the counts.
#[derive(Clone, Debug, Default)]
pub struct State {
    command_ned_mps: Horizontal,
    down_mps: f32,
    /// Change of the command in the last step.
    change_ned_mps: Horizontal,
    sight: Sight,
    counts: Counts,
}

impl State {
    /// The last horizontal command.
    #[must_use]
    pub fn command_ned_mps(&self) -> Horizontal {
        self.command_ned_mps
    }

    /// Where has been looked.
    #[must_use]
    pub fn sight(&self) -> &Sight {
        &self.sight
    }

    /// What the guard has done so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// A step out of control: the next command starts from rest; what has been seen stays, and the guard is alive.
    pub fn release(&mut self) {
        self.command_ned_mps = Horizontal::default();
        self.change_ned_mps = Horizontal::default();
        self.down_mps = 0.0;
        self.sight.leave();
        self.counts.beats = self.counts.beats.wrapping_add(1);
    }
}

/// A half-plane of velocities: `outwards . v >= least`.
#[derive(Clone, Copy, Debug)]
struct HalfSpace {
    outwards: Horizontal,
    least_mps: f32,
    /// The least that keeps the distance.
    oncoming_mps: f32,
}

/// What lies where a command leads.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Way {
    Seen,
    Hidden,
    /// Towards the place to look at first.
    Unseen(Horizontal),
}

/// The obstacles that can matter in a step.
type Near = Vec<Neighbour, CLOSE_MAX>;
/// Half-spaces of all obstacles and of the fence.
type HalfSpaces = Vec<HalfSpace, { GUSTY_MAX + CORNERS_MAX }>;

impl Guard {
    /// The obstacle that a known circle is to this vehicle.
    #[must_use]
    pub fn obstacle(&self, circle: &Circle) -> Neighbour {
        Neighbour::of(circle, self.config.vehicle_radius_m)
    }

    /// Takes in what a scan has looked at.
    pub fn look_scan(&self, state: &mut State, scan: &Scan, pose: &Pose) {
        self.looker.note_scan(&mut state.sight, scan, pose);
    }

    /// Takes in that a sensor has delivered circles; `obstacles` are all that are known near the vehicle.
    pub fn look_circles(&self, state: &mut State, obstacles: &[Neighbour], pose: &Pose) {
        self.looker.note_circles(&mut state.sight, obstacles, self.config.vehicle_radius_m, pose);
    }

    /// Passes, limits or replaces one demand. The setpoint is finite and inside the limits whatever comes in.
    pub fn step(
        &self,
        state: &mut State,
        demand: &Demand,
        situation: &GuardInput,
        obstacles: &[Neighbour],
        dt_s: f32,
    ) -> GuardOutput {
        let c = &self.config;
        let sane = demand.velocity_ned_mps.is_finite()
            && situation.position_ned_m.is_finite()
            && situation.rest_ned_m.is_finite()
            && situation.yaw_rad.is_finite()
            && situation.delay_s.is_finite();
        let yaw_rate_radps = between(finite(demand.yaw_rate_radps), -c.yaw_rate_max_radps, c.yaw_rate_max_radps);
        let down = self.vertical(state.down_mps, finite(demand.down_mps), situation, dt_s);

        let last = state.command_ned_mps;
        let braked = (limited(last, Horizontal::default(), c.a_max_mps2 * dt_s), Action::Braked, None);
        let (velocity, action, look_ned_rad) =
            if sane { self.horizontal(state, demand, situation, obstacles, dt_s).unwrap_or(braked) } else { braked };

        let counts = &mut state.counts;
        counts.beats = counts.beats.wrapping_add(1);
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
        situation: &GuardInput,
        obstacles: &[Neighbour],
        dt_s: f32,
    ) -> Option<(Horizontal, Action, Option<f32>)> {
        let c = &self.config;
        self.looker.stand(&mut state.sight, situation.position_ned_m, c.vehicle_radius_m);
        // Filled where they lie: to return them would copy them.
        let (mut near, mut half_spaces) = (Near::new(), HalfSpaces::new());
        let v_max_mps = self.gather_near(state.command_ned_mps, situation, obstacles, &mut near)?;
        let near = &near;
        let bounding = if situation.gust_margin_m > 0.0 { obstacles } else { near };
        let is_threatened = self.bound(situation, bounding, v_max_mps, &mut half_spaces) || situation.is_evading;

        let wanted = demand.velocity_ned_mps.clamped(v_max_mps);
        let granted = if is_threatened { wanted } else { wanted.times(self.view_share(wanted, situation.yaw_rad)) };
        let mut agreed = nearest_allowed(granted, &half_spaces);
        if agreed.is_none() && situation.gust_margin_m > 0.0 {
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

        // Where nothing has ever looked there is no such sensor: whether there must be one is for the mission to say.
        let looks = state.sight.has_looked() && !is_threatened;
        let mut unseen = None;
        for (trial, share) in [1.0, 0.5, 0.25].into_iter().enumerate() {
            let tried = self.approach(state, safe.times(share), is_threatened, dt_s);
            let is_clear = self.is_clear(tried, situation, near) && self.stays_inside(tried, situation);
            if !is_clear {
                continue;
            }
            let way = if looks { self.way(&state.sight, tried, situation, near) } else { Way::Seen };
            match way {
                Way::Unseen(direction) => {
                    unseen = unseen.or(Some(direction.bearing_rad()));
                    continue;
                }
                Way::Hidden if tried.norm_squared() > HIDDEN_MPS * HIDDEN_MPS => continue,
                Way::Hidden | Way::Seen => {}
            }
            if looks
                && unseen.is_none()
                && tried != safe
                && let Way::Unseen(direction) = self.way(&state.sight, safe, situation, near)
            {
                // The nose turns to where the full command leads before the vehicle is fast enough to need it.
                unseen = Some(direction.bearing_rad());
            }
            let action = if trial == 0 && safe == wanted { Action::Passed } else { Action::Limited };
            return Some((tried, action, unseen));
        }
        let action = if unseen.is_some() { Action::Looking } else { Action::Limited };
        // Gusts do not wait until the nose has turned.
        if situation.gust_margin_m > 0.0 {
            let still = Horizontal::default();
            let retreat = nearest_allowed(still, &half_spaces).or_else(|| evened_out(still, &mut half_spaces));
            let tried = self.approach(state, retreat.unwrap_or_default().clamped(v_max_mps), is_threatened, dt_s);
            if self.is_clear(tried, situation, near) && self.stays_inside(tried, situation) {
                return Some((tried, action, unseen));
            }
        }
        let brake = limited(state.command_ned_mps, Horizontal::default(), c.a_max_mps2 * dt_s);
        unseen.map(|bearing_rad| (brake, action, Some(bearing_rad)))
    }

    /// The next command on the way from the last to `to`, inside the limits of acceleration and jerk.
    fn approach(&self, state: &State, to: Horizontal, is_urgent: bool, dt_s: f32) -> Horizontal {
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
        from.plus(change.clamped(most))
    }

    /// Share of the speed that is granted in a direction that the sensor does not cover at the moment.
    fn view_share(&self, velocity: Horizontal, yaw_rad: f32) -> f32 {
        let half_rad = 0.5 * self.config.fov_rad;
        if half_rad >= 3.1 || velocity.norm_squared() < 1e-6 {
            return 1.0;
        }
        let off_rad = libm::fabsf(crate::base::units::wrap_pi(velocity.bearing_rad() - yaw_rad));
        // Full speed in the inner three fifths.
        between((half_rad - off_rad) / (0.4 * half_rad), self.config.out_of_view_share, 1.0)
    }

    /// The vertical command: towards the demand, inside the band and the limits of altitude.
    fn vertical(&self, last_mps: f32, wanted_mps: f32, situation: &GuardInput, dt_s: f32) -> f32 {
        let c = &self.config;
        let mut wanted_mps = between(wanted_mps, -c.v_down_max_mps, c.v_down_max_mps);
        if let Some(down_m) = situation.down_m.filter(|down_m| down_m.is_finite()) {
            let (mut top_m, mut bottom_m) = (c.down_min_m, c.down_max_m);
            if let Some(held_m) = situation.held_down_m.filter(|held_m| held_m.is_finite()) {
                // The configured limits have the last word if the altitude held is not inside them.
                top_m = between(held_m - c.altitude_band_m, c.down_min_m, c.down_max_m - 0.1);
                bottom_m = between(held_m + c.altitude_band_m, top_m + 0.1, c.down_max_m);
            }
            let up = between(ALTITUDE_RATE_PER_S * (top_m - down_m), -c.v_down_max_mps, c.v_down_max_mps);
            let down = between(ALTITUDE_RATE_PER_S * (bottom_m - down_m), -c.v_down_max_mps, c.v_down_max_mps);
            wanted_mps = between(wanted_mps, up, down);
        }
        let most = c.a_max_mps2 * dt_s;
        last_mps + between(wanted_mps - last_mps, -most, most)
    }

    /// The obstacles that can matter, those that the vehicle could come to in the time that it takes to stop, and the speed up to
    /// which these are all; `None` where there are too many for any speed.
    fn gather_near(
        &self,
        command_ned_mps: Horizontal,
        situation: &GuardInput,
        obstacles: &[Neighbour],
        near: &mut Near,
    ) -> Option<f32> {
        let c = &self.config;
        let (rest, delay_s) = (situation.rest_ned_m, situation.delay_s);
        let underway_m = rest.minus(situation.position_ned_m).norm();
        let mut v_max_mps = c.v_max_mps;
        for _ in 0..=HALVED_MAX {
            // It is no slower than this before the next step.
            let command_mps = command_ned_mps.norm();
            let fastest_mps = if v_max_mps > command_mps { v_max_mps } else { command_mps };
            let range_m = self.range_m(SLACK * fastest_mps) + c.margin_m;
            let range_m = if range_m > underway_m { range_m } else { underway_m };
            let is_near = |obstacle: &&Neighbour| {
                let drift_m =
                    libm::fabsf(obstacle.velocity_ned_mps.north) + libm::fabsf(obstacle.velocity_ned_mps.east);
                let limit_m = obstacle.reach_m + range_m + drift_m * (1.0 + delay_s);
                rest.minus(obstacle.center_ned_m).norm_squared() < limit_m * limit_m
            };
            near.clear();
            if obstacles.iter().filter(is_near).all(|obstacle| near.push(*obstacle).is_ok()) {
                return Some(v_max_mps);
            }
            v_max_mps *= 0.5;
        }
        None
    }

    /// The distance from which a speed of approach is allowed: the inverse of the bound of the module's text.
    fn range_m(&self, speed_mps: f32) -> f32 {
        let c = &self.config;
        let (by_rate, by_brake) = (speed_mps / c.approach_rate_per_s, speed_mps * speed_mps / (1.4 * c.a_max_mps2));
        if by_rate > by_brake { by_rate } else { by_brake }
    }

    /// Fastest approach at a clearance; negative, a speed of retreat, inside the margin: in gusts twice as fast, since they push as
    /// fast as that.
    fn approach_mps(&self, h: f32, gust_m: f32) -> f32 {
        if !(h > 0.0) {
            let out_mps = between(-h, 0.0, OUT_MPS + gust_m);
            return if gust_m > 0.0 { -GUSTY_OUT * out_mps } else { -out_mps };
        }
        let by_rate = self.config.approach_rate_per_s * h;
        let by_brake = sqrt(1.4 * self.config.a_max_mps2 * h);
        if by_rate < by_brake { by_rate } else { by_brake }
    }

    /// What circles and fence say of the velocity, and whether something comes at the vehicle so that it cannot just stay.
    fn bound(&self, situation: &GuardInput, near: &[Neighbour], v_max_mps: f32, half_spaces: &mut HalfSpaces) -> bool {
        let c = &self.config;
        let (rest, delay_s) = (situation.rest_ned_m, situation.delay_s);
        let mut is_threatened = false;
        let beyond = -SLACK * v_max_mps;
        for obstacle in near {
            let mut drift = obstacle.velocity_ned_mps;
            // What pushes the vehicle about misleads its eyes, too: in gusts, what seems to go away is held to stand.
            if situation.gust_margin_m > 0.0 && rest.minus(obstacle.center_ned_m).dot(drift) < 0.0 {
                drift = Horizontal::default();
            }
            let away = rest.minus(obstacle.center_ned_m.plus(drift.times(delay_s)));
            let norm = away.norm();
            let outwards = if norm > 1e-6 { away.times(1.0 / norm) } else { Horizontal { north: 1.0, east: 0.0 } };
            // From what moves it goes out of the way as in calm air: into the arms of the next one else.
            let gust_m = if drift == Horizontal::default() { situation.gust_margin_m } else { 0.0 };
            let h = norm - obstacle.reach_m - c.margin_m - gust_m - 0.2 * drift.norm();
            let oncoming = outwards.dot(drift);
            let least_mps = oncoming - self.approach_mps(h, gust_m);
            is_threatened |= least_mps > 0.0 && oncoming > STILL_MPS;
            if least_mps > beyond {
                add(half_spaces, HalfSpace { outwards, least_mps, oncoming_mps: oncoming });
            }
        }
        for (inwards, depth_m) in c.fence.sides(rest) {
            let gust_m = situation.gust_margin_m;
            let least_mps = -self.approach_mps(depth_m - c.fence_margin_m - gust_m, gust_m);
            if least_mps > beyond {
                // Cannot fail: there is room for all of them.
                let _ = half_spaces.push(HalfSpace { outwards: inwards, least_mps, oncoming_mps: 0.0 });
            }
        }
        is_threatened
    }

    /// Where a command leads until it is braked away, at least a little ahead.
    fn ahead(&self, velocity: Horizontal, rest: Horizontal) -> (Horizontal, f32) {
        let brake_s = 0.5 * velocity.norm() / self.config.a_max_mps2;
        let ahead_s = if brake_s > CORNER_S { brake_s } else { CORNER_S };
        (rest.plus(velocity.times(ahead_s)), ahead_s)
    }

    /// Whether a command keeps the vehicle out of every circle: on the way to its rest point, from there until the command
    /// is braked away, and on the straight line to where it leads next. What touches a circle already may move if it does
    /// not go deeper.
    fn is_clear(&self, velocity: Horizontal, situation: &GuardInput, near: &[Neighbour]) -> bool {
        let (position, rest) = (situation.position_ned_m, situation.rest_ned_m);
        let (ahead, ahead_s) = self.ahead(velocity, rest);
        let (underway_m, ahead_m) = (position.minus(rest).norm(), ahead.minus(rest).norm());
        let spread_m = self.config.margin_m + if underway_m > ahead_m { underway_m } else { ahead_m };
        near.iter().all(|obstacle| {
            let center = obstacle.center_ned_m;
            let far_m = obstacle.reach_m + spread_m;
            let is_still = obstacle.velocity_ned_mps == Horizontal::default();
            if is_still && center.minus(rest).norm_squared() > far_m * far_m {
                return true;
            }
            let least = |distance: f32, other: f32| if distance < other { distance } else { other };
            let on_way = least(
                Horizontal::distance_to_segment(center, rest, ahead),
                Horizontal::distance_to_segment(center, position, ahead),
            ) - obstacle.reach_m;
            if on_way >= 0.5 * self.config.margin_m && is_still {
                return true;
            }
            // What is on its way cannot be called back: it is no reason to refuse a command that leads out of it.
            let at_rest = Horizontal::distance_to_segment(center, position, rest) - obstacle.reach_m;
            let later = center.plus(obstacle.velocity_ned_mps.times(situation.delay_s + ahead_s));
            let later_ahead = ahead.minus(later).norm() - obstacle.reach_m;
            let later_at_rest = rest.minus(later).norm() - obstacle.reach_m;
            on_way >= least(0.5 * self.config.margin_m, at_rest - 1e-3)
                && later_ahead >= least(0.5 * self.config.margin_m, later_at_rest - 1e-3)
        })
    }

    /// Whether a command leads to a place inside the fence, or at least not farther out.
    fn stays_inside(&self, velocity: Horizontal, situation: &GuardInput) -> bool {
        let (ahead, _) = self.ahead(velocity, situation.rest_ned_m);
        let now = self.config.fence.sides(situation.rest_ned_m);
        self.config.fence.sides(ahead).zip(now).all(|((_, then_m), (_, now_m))| then_m >= 0.0 || then_m >= now_m - 1e-4)
    }

    /// What has been seen of the places where an obstacle would touch the hull on its way.
    fn way(&self, sight: &Sight, velocity: Horizontal, situation: &GuardInput, near: &[Neighbour]) -> Way {
        let speed = velocity.norm();
        if speed < CREEP_MPS {
            return Way::Seen;
        }
        let (radius_m, smallest_m) = (self.config.vehicle_radius_m, self.looker.smallest_obstacle_m());
        let reach_m = radius_m + smallest_m;
        let along = velocity.times(1.0 / speed);
        let right = Horizontal { north: -along.east, east: along.north };
        let (ahead, _) = self.ahead(velocity, situation.rest_ned_m);
        let middle = ahead.plus(situation.rest_ned_m).times(0.5);
        // A short way has no middle that its end does not cover.
        let is_short = ahead.minus(middle).norm_squared() < SHORT_M * SHORT_M;
        let (nose_east, nose_north) = sin_cos(situation.yaw_rad);
        let nose = Horizontal { north: nose_north, east: nose_east };

        let mut way = Way::Seen;
        let mut nearest_the_nose = f32::NEG_INFINITY;
        for station in [middle, ahead].into_iter().skip(usize::from(is_short)) {
            for (cosine, sine) in FRONT {
                let place = station.plus(along.times(reach_m * cosine)).plus(right.times(reach_m * sine));
                if self.looker.is_at_home(sight, place, radius_m) {
                    continue;
                }
                let cover = self.looker.cover(sight, place);
                // What could stand there unseen is inside of what is known, but for the margin that is kept from it.
                let is_known = |obstacle: &Neighbour| {
                    let limit_m = obstacle.reach_m - reach_m + self.config.margin_m;
                    limit_m > 0.0 && obstacle.center_ned_m.minus(place).norm_squared() < limit_m * limit_m
                };
                if cover == Cover::Seen || near.iter().any(is_known) {
                    continue;
                }
                // What was hidden from elsewhere can be looked at by now, unless something known stands before it.
                let is_before = |obstacle: &Neighbour| {
                    let place_m =
                        Horizontal::distance_to_segment(obstacle.center_ned_m, situation.position_ned_m, place);
                    place_m < obstacle.reach_m - radius_m
                };
                if cover == Cover::Hidden || cover == Cover::WasHidden && near.iter().any(is_before) {
                    if way == Way::Seen {
                        way = Way::Hidden;
                    }
                    continue;
                }
                let direction = place.minus(situation.position_ned_m);
                let off_nose = nose.dot(direction) / direction.norm();
                if off_nose > nearest_the_nose {
                    nearest_the_nose = off_nose;
                    way = Way::Unseen(direction);
                }
            }
        }
        way
    }
}

/// Adds an obstacle's half-space, or puts it in the place of the least demanding one.
fn add(half_spaces: &mut HalfSpaces, half_space: HalfSpace) {
    if half_spaces.len() < GUSTY_MAX {
        // Cannot fail.
        let _ = half_spaces.push(half_space);
        return;
    }
    let demands = |one: &&mut HalfSpace, other: &&mut HalfSpace| one.least_mps.total_cmp(&other.least_mps);
    if let Some(least) = half_spaces.iter_mut().min_by(demands).filter(|least| least.least_mps < half_space.least_mps) {
        *least = half_space;
    }
}

/// Where gusts want more room than there is: the same shortfall from all that stands, so that the vehicle keeps to the middle.
fn evened_out(wanted: Horizontal, half_spaces: &mut HalfSpaces) -> Option<Horizontal> {
    // By the largest of them, nothing is asked for any more.
    let most_mps = half_spaces
        .iter()
        .fold(0.0, |most, half_space| if half_space.least_mps > most { half_space.least_mps } else { most });
    let (mut least_mps, mut most_mps, mut lowered_mps) = (0.0, most_mps, 0.0);
    let mut lower = |half_spaces: &mut HalfSpaces, by_mps: f32| {
        for half_space in half_spaces {
            if half_space.oncoming_mps == 0.0 {
                half_space.least_mps -= by_mps - lowered_mps;
            }
        }
        lowered_mps = by_mps;
    };
    let mut best = None;
    for _ in 0..EVENED_MAX {
        let by_mps = 0.5 * (least_mps + most_mps);
        lower(half_spaces, by_mps);
        match nearest_allowed(wanted, half_spaces) {
            Some(velocity) => (best, most_mps) = (Some(velocity), by_mps),
            None => least_mps = by_mps,
        }
    }
    lower(half_spaces, 0.0);
    best
}

/// The velocity nearest to the wanted one that all half-spaces allow; `None` if there is none.
///
/// The half-space that the answer so far breaks most is added: the new answer lies on its edge, within what those added
/// before leave of that line (the incremental linear programme of de Berg et al., Computational Geometry, section 4.3, with a
/// distance for its objective). Exact; two or three of them mostly decide, and where more than [`DECISIVE_MAX`] have to, there
/// is none in time.
fn nearest_allowed(wanted: Horizontal, half_spaces: &[HalfSpace]) -> Option<Horizontal> {
    let mut velocity = wanted;
    let mut decisive: Vec<HalfSpace, DECISIVE_MAX> = Vec::new();
    loop {
        let (mut most_broken, mut most_mps) = (None, AGREED_MPS);
        for half_space in half_spaces {
            let lacking_mps = half_space.least_mps - half_space.outwards.dot(velocity);
            if lacking_mps > most_mps {
                (most_broken, most_mps) = (Some(half_space), lacking_mps);
            }
        }
        let Some(edge) = most_broken else { return Some(velocity) };
        let foot = edge.outwards.times(edge.least_mps);
        let along = Horizontal { north: -edge.outwards.east, east: edge.outwards.north };
        let (mut from, mut to) = (f32::NEG_INFINITY, f32::INFINITY);
        for earlier in &decisive {
            let (slope, lacking) = (earlier.outwards.dot(along), earlier.least_mps - earlier.outwards.dot(foot));
            if libm::fabsf(slope) < 1e-5 {
                if lacking > AGREED_MPS {
                    return None;
                }
                continue;
            }
            let bound = lacking / slope;
            if slope > 0.0 && bound > from {
                from = bound;
            } else if slope < 0.0 && bound < to {
                to = bound;
            }
        }
        if from > to + AGREED_MPS {
            return None;
        }
        let at = wanted.dot(along);
        let at = if at < from { from } else { at };
        velocity = foot.plus(along.times(if at > to { to } else { at }));
        decisive.push(*edge).ok()?;
    }
}

/// `value`, or 0 if it is not finite.
fn finite(value: f32) -> f32 {
    if value.is_finite() { value } else { 0.0 }
}

/// `to`, or as far towards it from `from` as `most` allows.
fn limited(from: Horizontal, to: Horizontal, most: f32) -> Horizontal {
    from.plus(to.minus(from).clamped(most))
}

#[cfg(test)]
mod tests;
