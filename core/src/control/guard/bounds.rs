//! Which obstacles can matter in a step, and which velocities they and the fence allow.

use heapless::Vec;

use super::half_space::{HalfSpace, HalfSpaces};
use super::{Guard, GuardInput};
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::obstacle::Neighbour;
use crate::base::units::between;

/// The number of obstacles considered in one step. Among more the vehicle is slowed, so that fewer can matter.
pub const CLOSE_MAX: usize = 18;
/// How often its speed is halved for that at least, and until it is no faster than this; if there are still too many it
/// brakes.
const HALVED_MIN: u8 = 3;
const SLOWEST_MPS: f32 = 0.0625;
/// Enough for any speed that is allowed.
const HALVED_MAX: u8 = 8;
/// Largest speed of moving away from a standing obstacle that is too close.
const OUT_MPS: f32 = 0.3;
/// The factor on that speed in gusts.
const GUSTY_OUT: f32 = 2.0;
/// An obstacle that approaches the vehicle slower than this is no threat.
const STILL_MPS: f32 = 0.02;
/// Half-planes beyond this many times the speed limit cannot matter.
const SLACK: f32 = 1.5;

/// The obstacles that can matter in a step.
pub(super) type Near = Vec<Neighbour, CLOSE_MAX>;

impl Guard {
    /// The obstacles that the vehicle could reach in the time that it takes to stop, and the speed up to which the
    /// list is complete; `None` if there are too many at any speed.
    pub(super) fn gather_near(
        &self,
        command_ned_mps: Horizontal,
        input: &GuardInput,
        obstacles: &[Neighbour],
        near: &mut Near,
    ) -> Option<f32> {
        let c = &self.config;
        let (rest, delay_s) = (input.rest_ned_m, input.delay_s);
        let underway_m = rest.minus(input.position_ned_m).norm();
        let mut v_max_mps = c.v_max_mps;
        if input.is_evading && c.evade_max_mps > v_max_mps {
            v_max_mps = c.evade_max_mps;
        }
        for halved in 0..=HALVED_MAX {
            if halved > HALVED_MIN && 2.0 * v_max_mps <= SLOWEST_MPS {
                break;
            }
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

    /// The distance from an obstacle at which the fastest command begins to be limited, for a vehicle that follows with this
    /// delay.
    #[must_use]
    pub(crate) fn stop_m(&self, delay_s: f32) -> f32 {
        let c = &self.config;
        let fastest_mps = if c.evade_max_mps > c.v_max_mps { c.evade_max_mps } else { c.v_max_mps };
        self.range_m(fastest_mps) + c.margin_m + fastest_mps * delay_s
    }

    /// The distance from which a speed of approach is allowed: the inverse of the bound in the module's documentation.
    fn range_m(&self, speed_mps: f32) -> f32 {
        let c = &self.config;
        let (by_rate, by_brake) = (speed_mps / c.approach_rate_per_s, speed_mps * speed_mps / (1.4 * c.a_max_mps2));
        if by_rate > by_brake { by_rate } else { by_brake }
    }

    /// Largest speed of approach at a clearance; negative, a speed of retreat, inside the margin. The retreat is
    /// twice as fast in gusts, since they push as fast.
    fn approach_mps(&self, h: f32, gust_m: f32) -> f32 {
        if !(h > 0.0) {
            let out_mps = between(-h, 0.0, OUT_MPS + gust_m);
            return if gust_m > 0.0 { -GUSTY_OUT * out_mps } else { -out_mps };
        }
        let by_rate = self.config.approach_rate_per_s * h;
        let by_brake = sqrt(1.4 * self.config.a_max_mps2 * h);
        if by_rate < by_brake { by_rate } else { by_brake }
    }

    /// The velocities allowed by circles and fence, and whether an obstacle approaches the vehicle so that it cannot
    /// just stay.
    pub(super) fn bound(
        &self,
        input: &GuardInput,
        near: &[Neighbour],
        v_max_mps: f32,
        half_spaces: &mut HalfSpaces,
    ) -> bool {
        let c = &self.config;
        let (rest, delay_s) = (input.rest_ned_m, input.delay_s);
        let mut is_threatened = false;
        let beyond = -SLACK * v_max_mps;
        for obstacle in near {
            let mut drift = obstacle.velocity_ned_mps;
            // Gusts also falsify the measured velocity of obstacles: one that seems to move away is assumed to stand.
            if input.gust_margin_m > 0.0 && rest.minus(obstacle.center_ned_m).dot(drift) < 0.0 {
                drift = Horizontal::default();
            }
            let away = rest.minus(obstacle.center_ned_m.plus(drift.times(delay_s)));
            let norm = away.norm();
            let outwards = if norm > 1e-6 { away.times(1.0 / norm) } else { Horizontal { north: 1.0, east: 0.0 } };
            // Moving obstacles are evaded as in calm air, so that the vehicle does not hit the next one.
            let gust_m = if drift == Horizontal::default() { input.gust_margin_m } else { 0.0 };
            let h = norm - obstacle.reach_m - c.margin_m - gust_m - 0.2 * drift.norm();
            let oncoming = outwards.dot(drift);
            let least_mps = oncoming - self.approach_mps(h, gust_m);
            is_threatened |= least_mps > 0.0 && oncoming > STILL_MPS;
            if least_mps > beyond {
                // Cannot fail: no more obstacles are told.
                let _ = half_spaces.push(HalfSpace { outwards, least_mps, oncoming_mps: oncoming });
            }
        }
        if let Some((inwards, depth_m)) = c.fence.inside(rest) {
            let gust_m = input.gust_margin_m;
            let least_mps = -self.approach_mps(depth_m - c.fence.margin_m - gust_m, gust_m);
            if least_mps > beyond {
                // Cannot fail: the capacity is the largest number that is gathered.
                let _ = half_spaces.push(HalfSpace { outwards: inwards, least_mps, oncoming_mps: 0.0 });
            }
        }
        is_threatened
    }
}
