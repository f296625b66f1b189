//! When the store fills up, circles that others cover are forgotten: what is known to be occupied stays the same, and there
//! is room for more of it.
//!
//! A surface that is seen from several sides leaves more circles than it needs: patches from before its pillar was
//! recognised, and between pillars. A few circles are asked before each look is taken in, in turn: what of the look is then not
//! covered any more is added again.

use core::f32::consts::FRAC_1_SQRT_2;

use super::index::Index;
use super::{AVERAGED, CIRCLES_MAX, DOOMED, Keeper, Known, Map, Origin};
use crate::base::ned::Horizontal;

/// From so many circles on.
const FULL: usize = CIRCLES_MAX * 3 / 4;
/// Circles that are asked in a look.
const ASKED: usize = 12;
/// The rim of a covered circle sticks out of the others by this much at most, where it is looked at.
const STICK_OUT_M: f32 = 0.02;
/// Larger ones are not asked: their rim is looked at too far apart.
const RADIUS_MAX_M: f32 = 0.3;
/// Where its rim is looked at: every 15 degrees.
const RIM: [(f32, f32); 24] = [
    (1.0, 0.0),
    (0.9659258, 0.258819),
    (0.8660254, 0.5),
    (FRAC_1_SQRT_2, FRAC_1_SQRT_2),
    (0.5, 0.8660254),
    (0.258819, 0.9659258),
    (0.0, 1.0),
    (-0.258819, 0.9659258),
    (-0.5, 0.8660254),
    (-FRAC_1_SQRT_2, FRAC_1_SQRT_2),
    (-0.8660254, 0.5),
    (-0.9659258, 0.258819),
    (-1.0, 0.0),
    (-0.9659258, -0.258819),
    (-0.8660254, -0.5),
    (-FRAC_1_SQRT_2, -FRAC_1_SQRT_2),
    (-0.5, -0.8660254),
    (-0.258819, -0.9659258),
    (0.0, -1.0),
    (0.258819, -0.9659258),
    (0.5, -0.8660254),
    (FRAC_1_SQRT_2, -FRAC_1_SQRT_2),
    (0.8660254, -0.5),
    (0.9659258, -0.258819),
];

impl Keeper {
    /// Forgets those of the next few circles that others cover, if the store is filling up.
    pub(super) fn thin_out(&self, map: &mut Map, index: &mut Index) {
        if map.known.len() < FULL {
            return;
        }
        for _ in 0..ASKED {
            map.asked = if map.asked + 1 < map.known.len() { map.asked + 1 } else { 0 };
            if is_covered(&map.known, index, map.asked)
                && let Some(known) = map.known.get_mut(map.asked)
            {
                known.clear_looks = DOOMED;
                index.doom(map.asked);
            }
        }
    }
}

/// Whether other circles cover one, as far as they were measured and not their doubt: those that stand, through which nothing has
/// been seen, and which are pillars where it is one.
fn is_covered(all: &[Known], index: &Index, at: usize) -> bool {
    let is_asked = |known: &&Known| known.origin != Origin::Given && stands(known);
    let Some(known) = all.get(at).filter(is_asked) else { return false };
    let circle = known.circle();
    if circle.radius_m > RADIUS_MAX_M {
        return false;
    }
    let near = index.near(circle.center_ned_m, circle.radius_m + STICK_OUT_M);
    RIM.iter().all(|(north, east)| {
        let rim = circle.center_ned_m.plus(Horizontal { north: *north, east: *east }.times(circle.radius_m));
        near.filter(|other| *other != at).any(|other| {
            let Some(other) = all.get(other).filter(|other| covers(other) && (other.is_round() || !known.is_round()))
            else {
                return false;
            };
            let reach_m = other.radius_m + STICK_OUT_M;
            rim.minus(other.center_ned_m).norm_squared() <= reach_m * reach_m
        })
    })
}

fn covers(known: &Known) -> bool {
    stands(known) && matches!(known.clear_looks, 0 | AVERAGED)
}

fn stands(known: &Known) -> bool {
    known.velocity_ned_mps() == Horizontal::default() && known.clear_looks != DOOMED
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::obstacle::Circle;
    use crate::base::rng::Rng;
    use crate::base::time::Instant;
    use crate::mapping::map::{Config, Motion};
    use crate::mapping::scan::{Kind, Look};
    use std::vec::Vec;

    fn known(center_ned_m: Horizontal, radius_m: f32, origin: Origin) -> Known {
        Known {
            center_ned_m,
            radius_m,
            sigma_m: 0.005,
            slope_ned_mps: Horizontal::default(),
            motion: Motion::default(),
            seen_ms: 0,
            origin,
            clear_looks: 0,
        }
    }

    /// Each with four patches, more than fill the store up.
    const PILLARS: usize = FULL / 4;

    /// A row of pillars, each with patches that lie in it and beside it.
    fn row(rng: &mut Rng) -> Map {
        let mut map = Map::default();
        for pillar in 0..PILLARS {
            let center = Horizontal { north: 0.33 * pillar as f32, east: 2.0 };
            map.known.push(known(center, 0.2, Origin::Seen(Kind::Pillar))).unwrap();
            for _ in 0..4 {
                let away = Horizontal { north: 0.1 * rng.gaussian(), east: 0.1 * rng.gaussian() };
                let radius_m = 0.05 + 0.1 * rng.uniform();
                map.known.push(known(center.plus(away), radius_m, Origin::Seen(Kind::Patch))).unwrap();
            }
        }
        map
    }

    /// As many looks that see nothing.
    fn look(map: &mut Map, looks: u64) {
        let keeper = Config::default().build().unwrap();
        for at in 0..looks {
            keeper.observe_points(map, Instant(100_000 * at), &Look { time: Instant(100_000 * at), ..Look::default() });
        }
    }

    #[test]
    fn what_is_forgotten_was_covered_and_all_pillars_stay() {
        let mut rng = Rng::new(5, 0);
        for _ in 0..20 {
            let mut map = row(&mut rng);
            let before: Vec<Circle> = map.circles().collect();
            look(&mut map, 40);
            let after: Vec<Circle> = map.circles().collect();
            assert!(after.len() <= FULL + ASKED && after.len() < before.len(), "{}", after.len());
            let pillars = map.known.iter().filter(|known| known.is_round()).count();
            assert_eq!(pillars, PILLARS);
            for lost in before.iter().filter(|circle| !after.contains(circle)) {
                for _ in 0..50 {
                    let bearing_rad = core::f32::consts::TAU * rng.uniform();
                    let point = lost.center_ned_m.plus(Horizontal::from_bearing(bearing_rad).times(lost.radius_m));
                    let outside = |c: &Circle| point.minus(c.center_ned_m).norm() - c.radius_m;
                    let nearest = after.iter().map(outside).fold(f32::INFINITY, f32::min);
                    // Twice where what covered it was covered in its turn.
                    assert!(nearest < 2.0 * STICK_OUT_M, "{lost:?}: {nearest}");
                }
            }
        }
    }

    #[test]
    fn nothing_is_forgotten_while_there_is_room_nor_what_was_delivered_or_moves() {
        let mut map = row(&mut Rng::new(6, 0));
        map.known.truncate(FULL - 1);
        look(&mut map, 40);
        assert_eq!(map.known.len(), FULL - 1);

        let mut map = row(&mut Rng::new(6, 0));
        for (at, known) in map.known.iter_mut().enumerate() {
            if at % 2 == 0 {
                known.origin = Origin::Given;
            } else {
                known.slope_ned_mps = Horizontal { north: 0.001, east: 0.0 };
                known.motion = Motion::of(known.slope_ned_mps);
            }
        }
        let before = map.known.len();
        look(&mut map, 10);
        assert_eq!(map.known.len(), before);
    }

    #[test]
    fn neither_a_circles_doubt_nor_one_that_is_seen_through_covers_another() {
        for (sigma_m, clear_looks) in [(0.3, 0), (0.005, 1)] {
            let mut map = Map::default();
            for at in 0..FULL / 2 {
                let center = Horizontal { north: 2.0 * at as f32, east: 2.0 };
                let pillar = known(center, 0.1 + sigma_m, Origin::Seen(Kind::Pillar));
                map.known.push(Known { radius_m: 0.1, sigma_m, clear_looks, ..pillar }).unwrap();
                let east = if clear_looks == 0 { 2.2 } else { 2.0 };
                let patch = known(Horizontal { east, ..center }, 0.06, Origin::Seen(Kind::Patch));
                map.known.push(patch).unwrap();
            }
            look(&mut map, 40);
            assert_eq!(map.known.len(), FULL, "{sigma_m}");
        }
    }
}
