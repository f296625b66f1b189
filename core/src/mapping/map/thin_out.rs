//! When the store fills up, circles that others cover are forgotten: the known occupied area stays the same, and there
//! is space for more circles.
//!
//! A surface that is seen from several sides leaves more circles than it needs: patches from before its pillar was
//! recognised, and between pillars. A few circles are checked, in turn, before each scan is processed, so that hits of
//! the scan that are no longer covered are added again.

use core::f32::consts::FRAC_1_SQRT_2;

use super::index::{Index, Places};
use super::{AVERAGED, CIRCLES_MAX, DOOMED, Known, Map, Origin};
use crate::base::ned::Horizontal;

/// Number of circles from which on circles are checked.
const FULL: usize = CIRCLES_MAX * 3 / 4;
/// Number of circles checked per scan.
const ASKED: usize = 12;
/// Largest distance by which the rim of a covered circle may stick out of the others, where it is checked.
const STICK_OUT_M: f32 = 0.02;
/// Largest distance by which the middle of a patch's chord may stick out of the others: no obstacle fits in there.
const BETWEEN_M: f32 = 0.08;
/// Larger pillars are not checked: the checked places on their rim would be too far apart.
const RADIUS_MAX_M: f32 = 0.3;
/// Patches with a longer chord are not checked: between its ends, only the middle is tested.
const CHORD_MAX_M: f32 = 0.45;
const COS_30: f32 = 0.8660254;
const TAN_30: f32 = 0.57735026;
/// Directions in which the rim is checked: every 15 degrees.
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

impl Map {
    /// Forgets those of the next few circles that others cover, if the store fills up.
    pub(super) fn thin_out(&mut self, index: &mut Index) {
        if self.known.len() < FULL {
            return;
        }
        for _ in 0..ASKED {
            let next = usize::from(self.asked) + 1;
            let at = if next < self.known.len() { next } else { 0 };
            self.asked = at as u8;
            if is_covered(&self.known, index, at)
                && let Some(known) = self.known.get_mut(at)
            {
                known.clear_scans = DOOMED;
                index.doom(at);
            }
        }
    }
}

/// Whether other circles cover one, by their measured radii without sigma. Only standing circles count that no scan has
/// seen through and that may replace it.
///
/// The whole rim of a round circle has to be covered. Of a patch only the front is known: the two ends of its chord
/// must be covered. Between them there is at most a gap too narrow for a hit, and the bulge in front of the chord
/// belongs to the circle only, not to the surface.
fn is_covered(all: &[Known], index: &Index, at: usize) -> bool {
    let is_asked = |known: &&Known| known.origin != Origin::Given && stands(known);
    let Some(known) = all.get(at).filter(is_asked) else { return false };
    let circle = known.circle();
    let center = circle.center_ned_m;
    let near = index.near(center, circle.radius_m + BETWEEN_M);
    let is_in_others = |place: Horizontal, slack_m: f32| is_in_others(all, near, at, known, place, slack_m);
    if known.is_round() {
        return circle.radius_m <= RADIUS_MAX_M
            && RIM.iter().all(|(north, east)| {
                let side = Horizontal { north: *north, east: *east };
                is_in_others(center.plus(side.times(circle.radius_m)), STICK_OUT_M)
            });
    }
    // Its radius is the length of its chord, if it has one: the ends lie 30 degrees to either side of its front.
    let middle = known.slope_or_front.times(COS_30 * known.radius_m);
    let end = Horizontal { north: -middle.east, east: middle.north }.times(TAN_30);
    let middle = center.plus(middle);
    circle.radius_m <= CHORD_MAX_M
        && is_in_others(middle.plus(end), STICK_OUT_M)
        && is_in_others(middle.minus(end), STICK_OUT_M)
        && is_in_others(middle, BETWEEN_M)
}

/// Whether a place is in one of the circles that may replace a known one, or sticks out of it by at most `slack_m`.
#[inline(never)]
fn is_in_others(all: &[Known], near: Places, at: usize, known: &Known, place: Horizontal, slack_m: f32) -> bool {
    near.into_iter().any(|other| {
        let Some(one) = all.get(other).filter(|_| other != at) else { return false };
        let reach_m = one.radius_m + slack_m;
        place.minus(one.center_ned_m).norm_squared() <= reach_m * reach_m && covers(one) && may_stand_for(one, known)
    })
}

/// Whether a circle may replace another: a patch does not cover a pillar, nor a patch that was seen from its other
/// side.
fn may_stand_for(one: &Known, other: &Known) -> bool {
    one.is_round() || !other.is_round() && one.slope_or_front.dot(other.slope_or_front) > 0.0
}

fn covers(known: &Known) -> bool {
    stands(known) && matches!(known.clear_scans, 0 | AVERAGED)
}

fn stands(known: &Known) -> bool {
    known.velocity_ned_mps() == Horizontal::default() && known.clear_scans != DOOMED
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::obstacle::Circle;
    use crate::base::rng::Rng;
    use crate::base::time::Instant;
    use crate::mapping::map::Motion;
    use crate::mapping::map::tests::known;
    use crate::mapping::scan::{Kind, Segmentation};
    use std::vec::Vec;

    /// Pillars with four patches each: together more than [`FULL`] circles.
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

    /// The given number of scans that see nothing.
    fn look(map: &mut Map, looks: u64) {
        for at in 0..looks {
            map.observe_points(
                Instant(100_000 * at),
                &Segmentation { time: Instant(100_000 * at), ..Segmentation::default() },
            );
        }
    }

    #[test]
    fn what_is_forgotten_was_covered_and_all_pillars_stay() {
        let mut rng = Rng::new(5, 0);
        for _ in 0..20 {
            let mut map = row(&mut rng);
            let before: Vec<Known> = map.known.iter().copied().collect();
            look(&mut map, 40);
            let after: Vec<Circle> = map.circles().collect();
            assert!(after.len() <= FULL + ASKED && after.len() < before.len(), "{}", after.len());
            let pillars = map.known.iter().filter(|known| known.is_round()).count();
            assert_eq!(pillars, PILLARS);
            for lost in before.iter().filter(|known| !after.contains(&known.circle())) {
                let front_rad = lost.slope_or_front.bearing_rad();
                for turn_deg in [-30.0_f32, 30.0] {
                    let end = Horizontal::from_bearing(front_rad + turn_deg.to_radians()).times(lost.radius_m);
                    let end = lost.center_ned_m.plus(end);
                    let outside = |c: &Circle| end.minus(c.center_ned_m).norm() - c.radius_m;
                    let nearest = after.iter().map(outside).fold(f32::INFINITY, f32::min);
                    // Twice, where the covering circle was covered by another one in turn.
                    assert!(nearest < 2.0 * STICK_OUT_M, "{lost:?}: {nearest}");
                }
            }
        }
    }

    #[test]
    fn chords_between_pillars_go_and_what_was_seen_from_the_other_side_stays() {
        let front = Horizontal { north: 0.0, east: -1.0 };
        for (seen_from, is_other_round) in
            [(front, true), (front, false), (front.times(-1.0), true), (front.times(-1.0), false)]
        {
            let mut map = Map::default();
            let kind = if is_other_round { Kind::Pillar } else { Kind::Patch };
            // Enough circles that the store checks them, and that all of them get their turn.
            for at in 0..FULL {
                let center = Horizontal { north: 0.33 * at as f32, east: 2.0 };
                map.known.push(known(center, 0.2, Origin::Seen(kind))).unwrap();
            }
            // From the front of one to the front of the next.
            let chord_m = 0.33;
            let middle = Horizontal { north: 0.33 * 10.5, east: 2.0 }.plus(seen_from.times(0.2 - COS_30 * chord_m));
            let link = Known { slope_or_front: seen_from, ..known(middle, chord_m, Origin::Seen(Kind::Patch)) };
            map.known.push(link).unwrap();
            look(&mut map, 40);
            let has_gone = !map.circles().any(|circle| circle == link.circle());
            assert_eq!(has_gone, is_other_round || seen_from == front, "{seen_from:?} {kind:?}");
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
                known.slope_or_front = Horizontal { north: 0.001, east: 0.0 };
                known.motion = Motion::of(known.slope_or_front);
            }
        }
        let before = map.known.len();
        look(&mut map, 10);
        assert_eq!(map.known.len(), before);
    }

    #[test]
    fn neither_a_circles_doubt_nor_one_that_is_seen_through_covers_another() {
        for (sigma_m, clear_scans) in [(0.3, 0), (0.005, 1)] {
            let mut map = Map::default();
            for at in 0..FULL / 2 {
                let center = Horizontal { north: 2.0 * at as f32, east: 2.0 };
                let pillar = known(center, 0.1 + sigma_m, Origin::Seen(Kind::Pillar));
                map.known.push(Known { radius_m: 0.1, sigma_m, clear_scans, ..pillar }).unwrap();
                let east = if clear_scans == 0 { 2.2 } else { 2.0 };
                let patch = known(Horizontal { east, ..center }, 0.06, Origin::Seen(Kind::Patch));
                map.known.push(patch).unwrap();
            }
            look(&mut map, 40);
            assert_eq!(map.known.len(), FULL, "{sigma_m}");
        }
    }
}
