//! The guard: every command passes it, whoever made it, and it trusts nobody.
//!
//! In this order: numbers that are not finite become a brake; speed is limited; motion outside the field of view is slowed
//! to a crawl until the nose has come round; motion towards each known circle is limited to what can still be stopped
//! (a half-space a circle, a few sweeps); the change from the last command is limited to the acceleration limit; and
//! last, an exact check: the segments from the vehicle to its rest point and on to where this command would lead must not
//! touch a circle, or the command is cut down, in the end to a brake. Within limits a brake is always granted.
//!
//! The half-spaces are those of a control barrier function `h = distance - reach - margin` with the bound
//! `-dh/dt <= min(rate h, sqrt(1.4 a h))`. Cost: about 80 instructions a circle that is near, 10 for one that is not.

use crate::error::{ConfigError, check};
use crate::field::Obstacle;
use crate::frame::{Horizontal, Ned};
use crate::map::Circle;
use crate::track::Demand;
use crate::units::wrap_pi;

/// Sweeps over the half-spaces.
const SWEEPS: usize = 6;
/// Speed that is left outside the field of view.
const BLIND_SHARE: f32 = 0.05;
/// How far ahead the straight line from the vehicle to where the command leads must be clear.
const CORNER_S: f32 = 0.2;

/// What the guard needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Largest horizontal speed.
    pub v_max_mps: f32,
    /// Largest vertical speed.
    pub v_down_max_mps: f32,
    /// Largest change of the horizontal command.
    pub a_max_mps2: f32,
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
}

impl Default for Config {
    fn default() -> Self {
        Self {
            v_max_mps: 1.0,
            v_down_max_mps: 0.5,
            a_max_mps2: 2.0,
            yaw_rate_max_radps: 1.5,
            vehicle_radius_m: 0.15,
            margin_m: 0.03,
            approach_rate_per_s: 2.0,
            fov_rad: core::f32::consts::FRAC_PI_2,
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
        check("guard.yaw_rate_max_radps", self.yaw_rate_max_radps, 0.1, 6.3)?;
        check("guard.vehicle_radius_m", self.vehicle_radius_m, 0.0, 5.0)?;
        check("guard.margin_m", self.margin_m, 0.0, 5.0)?;
        check("guard.approach_rate_per_s", self.approach_rate_per_s, 0.1, 20.0)?;
        check("guard.fov_rad", self.fov_rad, 0.1, core::f32::consts::TAU)?;
        Ok(Guard { config: *self })
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
    /// Nothing.
    #[default]
    Passed,
    /// Slowed or bent away from an obstacle, or slowed outside the field of view.
    Limited,
    /// Replaced by a brake.
    Braked,
}

/// Where the vehicle is and where it would come to rest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Situation {
    /// Position, local NED.
    pub position_ned_m: Horizontal,
    /// Rest point, local NED.
    pub rest_ned_m: Horizontal,
    /// Yaw.
    pub yaw_rad: f32,
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guard {
    config: Config,
}

/// The last command, from which the next may differ by the acceleration limit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    command_ned_mps: Horizontal,
}

impl State {
    /// The last horizontal command.
    #[must_use]
    pub fn command_ned_mps(&self) -> Horizontal {
        self.command_ned_mps
    }
}

impl Guard {
    /// The obstacle that a known circle is to this vehicle.
    #[must_use]
    pub fn obstacle(&self, circle: &Circle) -> Obstacle {
        Obstacle::of(circle, self.config.vehicle_radius_m)
    }

    /// Passes, limits or replaces one demand. The setpoint is finite and inside the limits whatever comes in.
    pub fn step(
        &self,
        state: &mut State,
        demand: &Demand,
        situation: &Situation,
        obstacles: &[Obstacle],
        dt_s: f32,
    ) -> (Setpoint, Action) {
        let c = &self.config;
        let sane = demand.velocity_ned_mps.is_finite()
            && situation.position_ned_m.is_finite()
            && situation.rest_ned_m.is_finite()
            && situation.yaw_rad.is_finite();
        let yaw_rate_radps = finite(demand.yaw_rate_radps).clamp(-c.yaw_rate_max_radps, c.yaw_rate_max_radps);
        let down = finite(demand.down_mps).clamp(-c.v_down_max_mps, c.v_down_max_mps);
        let most = c.a_max_mps2 * dt_s;

        let mut action = Action::Braked;
        let mut velocity = limited(state.command_ned_mps, Horizontal::default(), most);
        if sane {
            let wanted = demand.velocity_ned_mps.clamped(c.v_max_mps);
            let seen = wanted.times(self.view_share(wanted, situation.yaw_rad));
            let safe = self.half_spaces(seen, situation.rest_ned_m, obstacles).clamped(c.v_max_mps);
            for share in [1.0, 0.5, 0.25] {
                let tried = limited(state.command_ned_mps, safe.times(share), most);
                if self.is_clear(tried, situation, obstacles) {
                    velocity = tried;
                    action = if share == 1.0 && safe == wanted { Action::Passed } else { Action::Limited };
                    break;
                }
            }
        }
        state.command_ned_mps = velocity;
        let velocity_ned_mps = Ned { north: velocity.north, east: velocity.east, down };
        (Setpoint { velocity_ned_mps, yaw_rate_radps }, action)
    }

    /// Share of the speed that is granted in a direction that the sensor may not cover.
    fn view_share(&self, velocity: Horizontal, yaw_rad: f32) -> f32 {
        let half_rad = 0.5 * self.config.fov_rad;
        if half_rad >= 3.1 || velocity.norm_squared() < 1e-6 {
            return 1.0;
        }
        let off_rad = libm::fabsf(wrap_pi(velocity.bearing_rad() - yaw_rad));
        // Full speed in the inner three fifths, a crawl from the edge on.
        ((half_rad - off_rad) / (0.4 * half_rad)).clamp(BLIND_SHARE, 1.0)
    }

    /// Takes out of a velocity what runs into circles faster than can be stopped.
    fn half_spaces(&self, velocity: Horizontal, rest: Horizontal, obstacles: &[Obstacle]) -> Horizontal {
        let c = &self.config;
        let mut velocity = velocity;
        for _ in 0..SWEEPS {
            let mut changed = false;
            for obstacle in obstacles {
                let drift = obstacle.velocity_ned_mps;
                let away = rest.minus(obstacle.center_ned_m);
                let near = obstacle.reach_m + c.margin_m + 2.0 * c.v_max_mps;
                let squared = away.norm_squared();
                if squared > near * near {
                    continue;
                }
                let norm = libm::sqrtf(squared);
                let out = if norm > 1e-6 { away.times(1.0 / norm) } else { Horizontal { north: 1.0, east: 0.0 } };
                let h = norm - obstacle.reach_m - c.margin_m - 0.2 * drift.norm();
                // Inside the margin nothing may go further in, and what is deep inside is gently moved out.
                let least = if h > 0.0 {
                    let by_rate = c.approach_rate_per_s * h;
                    let by_brake = libm::sqrtf(1.4 * c.a_max_mps2 * h);
                    -if by_rate < by_brake { by_rate } else { by_brake }
                } else {
                    (-h).clamp(0.0, 0.3)
                };
                let lacking = least - out.dot(velocity.minus(drift));
                if lacking > 1e-4 {
                    velocity = velocity.plus(out.times(lacking));
                    changed = true;
                }
            }
            if !changed {
                break;
            }
        }
        velocity
    }

    /// Whether a command keeps the vehicle out of every circle: on the way to its rest point, from there until the command
    /// is braked away, and on the straight line to where it leads next. What touches a circle already may move if it does
    /// not go deeper.
    fn is_clear(&self, velocity: Horizontal, situation: &Situation, obstacles: &[Obstacle]) -> bool {
        let (position, rest) = (situation.position_ned_m, situation.rest_ned_m);
        let brake_s = 0.5 * velocity.norm() / self.config.a_max_mps2;
        let ahead_s = if brake_s > CORNER_S { brake_s } else { CORNER_S };
        let ahead = rest.plus(velocity.times(ahead_s));
        let reach_sum = ahead.minus(position).norm() + rest.minus(position).norm();
        obstacles.iter().all(|obstacle| {
            let clearance = obstacle.clearance_m(position);
            if clearance > reach_sum + 0.1 + obstacle.velocity_ned_mps.norm() * 0.5 {
                return true;
            }
            let center = obstacle.center_ned_m;
            let least = |distance: f32, other: f32| if distance < other { distance } else { other };
            let on_way = least(
                Horizontal::distance_to_segment(center, rest, ahead),
                Horizontal::distance_to_segment(center, position, ahead),
            ) - obstacle.reach_m;
            let at_rest = Horizontal::distance_to_segment(center, position, rest) - obstacle.reach_m;
            // What is on its way cannot be called back: it is no reason to refuse a command that leads out of it.
            let allowed = least(0.5 * self.config.margin_m, at_rest - 1e-3);
            on_way >= allowed
        })
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
mod tests {
    use super::*;
    use crate::rng::Rng;
    use std::vec::Vec;

    const DT: f32 = 0.02;

    fn wall(north: f32, reach_m: f32) -> Obstacle {
        Obstacle { center_ned_m: Horizontal { north, east: 0.0 }, reach_m, ..Obstacle::default() }
    }

    fn demand(north: f32, east: f32) -> Demand {
        Demand { velocity_ned_mps: Horizontal { north, east }, ..Demand::default() }
    }

    /// Flies a demand with an ideal vehicle (rest point = position) and returns the smallest clearance and the end.
    fn fly(demand: Demand, obstacles: &[Obstacle], yaw_rad: f32) -> (f32, Horizontal) {
        let (guard, mut state) = (Config::default().build().unwrap(), State::default());
        let mut at = Horizontal::default();
        let mut closest = f32::INFINITY;
        for _ in 0..1000 {
            let situation = Situation { position_ned_m: at, rest_ned_m: at, yaw_rad };
            let (setpoint, _) = guard.step(&mut state, &demand, &situation, obstacles, DT);
            at = at.plus(setpoint.velocity_ned_mps.horizontal().times(DT));
            closest = obstacles.iter().map(|o| o.clearance_m(at)).fold(closest, f32::min);
        }
        (closest, at)
    }

    #[test]
    fn full_speed_at_a_wall_ends_before_it() {
        let (closest, at) = fly(demand(5.0, 0.0), &[wall(4.0, 1.0)], 0.0);
        assert!(closest > 0.0 && closest < 0.2, "{closest} {at:?}");
    }

    #[test]
    fn a_glancing_demand_slides_along() {
        let (closest, at) = fly(demand(0.5, 0.3), &[wall(2.0, 0.6)], 0.4);
        assert!(closest > 0.0 && at.north > 3.0, "{closest} {at:?}");
    }

    #[test]
    fn outside_the_field_of_view_it_crawls() {
        let (_, ahead) = fly(demand(1.0, 0.0), &[], 0.0);
        let (_, behind) = fly(demand(1.0, 0.0), &[], 3.0);
        assert!(behind.north < 0.06 * ahead.north && behind.north > 0.0, "{ahead:?} {behind:?}");
    }

    #[test]
    fn from_inside_a_circle_it_may_leave_but_not_go_deeper() {
        let obstacle = wall(-0.3, 0.4);
        let (_, out) = fly(demand(1.0, 0.0), &[obstacle], 0.0);
        assert!(out.north > 5.0, "{out:?}");
        let (closest, _) = fly(demand(-1.0, 0.0), &[obstacle], 3.1);
        assert!(closest > -0.101, "{closest}");
    }

    #[test]
    fn whatever_comes_in_a_finite_setpoint_inside_the_limits_comes_out() {
        let config = Config::default();
        let (guard, mut state) = (config.build().unwrap(), State::default());
        let mut rng = Rng::new(11, 0);
        let wild = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30, 0.0, 1e-30];
        let mut last = Horizontal::default();
        for _ in 0..20_000 {
            let mut number = || {
                let pick = (rng.uniform() * 20.0) as usize;
                wild.get(pick).copied().unwrap_or(4.0 * rng.gaussian())
            };
            let mut vector = || Horizontal { north: number(), east: number() };
            let demand = Demand { velocity_ned_mps: vector(), down_mps: vector().north, yaw_rate_radps: vector().east };
            let situation = Situation { position_ned_m: vector(), rest_ned_m: vector(), yaw_rad: vector().north };
            let obstacles: Vec<_> =
                (0..4).map(|_| Obstacle { center_ned_m: vector(), reach_m: 0.3, velocity_ned_mps: vector() }).collect();
            let (setpoint, _) = guard.step(&mut state, &demand, &situation, &obstacles, DT);
            let velocity = setpoint.velocity_ned_mps;
            assert!(velocity.is_finite() && setpoint.yaw_rate_radps.is_finite());
            assert!(velocity.horizontal().norm() <= config.v_max_mps * 1.0001);
            assert!(velocity.down.abs() <= config.v_down_max_mps);
            assert!(setpoint.yaw_rate_radps.abs() <= config.yaw_rate_max_radps);
            assert!(velocity.horizontal().minus(last).norm() <= config.a_max_mps2 * DT * 1.001 + 1e-6);
            last = velocity.horizontal();
        }
    }

    #[test]
    fn bad_limits_are_refused_by_name() {
        let refused = |change: &dyn Fn(&mut Config)| {
            let mut config = Config::default();
            change(&mut config);
            config.build().unwrap_err().field
        };
        assert_eq!(refused(&|c| c.v_max_mps = 0.0), "guard.v_max_mps");
        assert_eq!(refused(&|c| c.a_max_mps2 = f32::NAN), "guard.a_max_mps2");
        assert_eq!(refused(&|c| c.fov_rad = 10.0), "guard.fov_rad");
    }
}
