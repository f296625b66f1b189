//! Filters behind reflections: the source is not where its signal comes from.
//!
//! - [`fold`]: lines of reflection as mirrors, of any order (eq. 9 of the mmWave paper). A sighting off lines that are known
//!   becomes a sighting of the source itself.
//! - [`Known`]: known lines: [`polar`](foxhound_core::localize::source::polar) behind the mirrors.
//! - [`law`]: the law of reflection as the paper has it (eq. 4-7), and [`literal`] its two filters, the baselines.

use foxhound_core::base::math::sqrt;
use foxhound_core::base::ned::Horizontal;
use foxhound_core::mapping::walls::Wall;

use super::kalman;
use super::{Estimate, Sighting, Update};

pub mod fold;
pub mod known;
pub mod law;
pub mod literal;

pub use known::Known;

/// The paper's slope and intercept of a wall, `m` and `c` of eq. 5, in its frame (x east, y north); infinite for a vertical
/// wall.
#[must_use]
pub fn slope_intercept(wall: &Wall) -> [f32; 2] {
    // n_e x + n_n y = offset.
    let north = wall.normal_ned.north;
    [-wall.normal_ned.east / north, wall.offset_m / north]
}

/// The unbounded wall of a slope and an intercept in the paper's frame (x east, y north).
#[must_use]
pub fn of_slope_intercept([m, c]: [f32; 2]) -> Wall {
    let scale = 1.0 / sqrt(1.0 + m * m);
    let normal_ned = Horizontal { north: scale, east: -m * scale };
    Wall { normal_ned, offset_m: c * scale, from_m: -1e5, to_m: 1e5 }
}

/// Degenerate geometry of a reflection. The filter is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Degenerate {
    /// The line runs along the paper's y axis: its slope is infinite. The literal filters cannot have it.
    Vertical,
    /// The vehicle is on the line, and the point of reflection where it is.
    OnLine,
    /// The ray runs along a line, or away from it: there is no reflection.
    NoReflection,
    /// Not a line: its normal is not a unit vector, or its offset is not finite.
    NoLine,
    /// The filter has not begun.
    NotBegun,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_slope_and_intercept_are_those_of_its_frame() {
        // y = 0.5 x + 3, x east and y north.
        let at = |x: f32| Horizontal { north: 0.5 * x + 3.0, east: x };
        let line = Wall::between(at(-4.0), at(7.0)).unwrap();
        let [m, c] = slope_intercept(&line);
        assert!((m - 0.5).abs() < 1e-5 && (c - 3.0).abs() < 1e-5, "{m} {c}");
        assert!(of_slope_intercept([m, c]).distance_m(at(5.0)).abs() < 1e-4);
    }
}
