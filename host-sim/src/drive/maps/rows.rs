//! Rows of pillars across the path north: walls with a gap, or walls to fly around.

use super::parts::Pillar;
use crate::world::random::Random;

/// Dimensions of the rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rows {
    /// Number of rows.
    pub count: u32,
    /// Distance of the first row north of the origin, and from each row to the next.
    pub first_m: f64,
    /// See [`Rows::first_m`].
    pub apart_m: f64,
    /// Radius of the pillars, which touch one another.
    pub radius_m: f64,
    /// Least and greatest distance of a row's ends from its middle.
    pub half_m: [f64; 2],
    /// Largest offset of the middle, or of the gap, from the straight path.
    pub aside_m: f64,
    /// Least and greatest free width of the gap; zero: no gap.
    pub gap_m: [f64; 2],
}

/// The pillars: the same for the same seed.
#[must_use]
pub fn rows(rows: &Rows, seed: u64) -> Vec<Pillar> {
    let mut random = Random::new(seed, 7);
    let mut pillars = Vec::new();
    for row in 0..rows.count {
        let mut between = |[low, high]: [f64; 2]| low + (high - low) * random.uniform();
        let y = rows.first_m + rows.apart_m * f64::from(row);
        let (half_m, aside_m) = (between(rows.half_m), between([-rows.aside_m, rows.aside_m]));
        let gap_m = between(rows.gap_m);
        let mut fill = |west: f64, east: f64| {
            let gaps = libm::ceil((east - west) / (2.0 * rows.radius_m)).max(1.0);
            let step_m = (east - west) / gaps;
            pillars.extend((0..=gaps as u32).map(|k| [west + step_m * f64::from(k), y, rows.radius_m]));
        };
        if gap_m > 0.0 {
            let edge_m = gap_m / 2.0 + rows.radius_m;
            fill(-half_m, aside_m - edge_m);
            fill(aside_m + edge_m, half_m);
        } else {
            fill(aside_m - half_m, aside_m + half_m);
        }
    }
    pillars
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAPS: Rows = Rows {
        count: 3,
        first_m: 2.0,
        apart_m: 1.5,
        radius_m: 0.1,
        half_m: [3.0, 3.0],
        aside_m: 1.0,
        gap_m: [0.5, 0.9],
    };

    #[test]
    fn each_row_has_one_gap_as_wide_as_asked_and_none_between_its_pillars() {
        for seed in 0..20 {
            let pillars = rows(&GAPS, seed);
            for row in 0..3 {
                let y = 2.0 + 1.5 * f64::from(row);
                let xs: Vec<f64> = pillars.iter().filter(|pillar| pillar[1] == y).map(|pillar| pillar[0]).collect();
                assert_eq!((xs.first(), xs.last()), (Some(&-3.0), Some(&3.0)));
                let free: Vec<f64> = xs.windows(2).map(|pair| pair[1] - pair[0] - 0.2).collect();
                assert_eq!(free.iter().filter(|free_m| (0.5..=0.9).contains(*free_m)).count(), 1, "{free:?}");
                assert_eq!(free.iter().filter(|free_m| **free_m < 1e-9).count(), free.len() - 1, "{free:?}");
            }
            assert_eq!(rows(&GAPS, seed), pillars);
        }
    }

    #[test]
    fn without_a_gap_it_is_a_wall_with_two_ends() {
        let walls = Rows { half_m: [1.0, 2.0], gap_m: [0.0, 0.0], count: 1, ..GAPS };
        let xs: Vec<f64> = rows(&walls, 3).iter().map(|pillar| pillar[0]).collect();
        let length_m = xs[xs.len() - 1] - xs[0];
        assert!((2.0..=4.0).contains(&length_m) && xs.windows(2).all(|pair| pair[1] - pair[0] <= 0.2 + 1e-9));
    }
}
