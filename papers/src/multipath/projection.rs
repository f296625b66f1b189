//! Projection onto two paths (Ziskind and Wax 1988), tried for pairs of directions of the grid.

use super::bartlett::{GRID_STEP_RAD, HALF, Scan};
use super::matrix::halves;
use super::model::Solver;

/// Added to what is left of one steering vector beside another, so that two that are the same explain no more than one.
const REST_BIAS: f32 = 1e-3;

impl Solver<'_> {
    /// The two directions of the grid that explain most together, one of them on every second line of it.
    pub(super) fn projection(&self, scan: &Scan) -> [f32; 2] {
        let (mut pair, mut most) = ([0, HALF], 0.0);
        let count = self.some_headings(self.stride).count();
        for i in (0..HALF).step_by(2) {
            for j in (0..HALF).filter(|j| j % 2 == 1 || *j <= i) {
                // Of these two; of both their opposites; of one and the other's opposite.
                let mut explained = [0.0; 4];
                for (a, b) in scan.at(i).iter().zip(scan.at(j)).take(count) {
                    let cosine = halves(&a.d, &b.d);
                    let ([even, cross], [crossed, odd]) = (halves(&a.d, &b.seen[0]), halves(&a.d, &b.seen[1]));
                    let cosines = [cosine[0] + cosine[1], cosine[0] - cosine[1]];
                    let [alike, mixed] = cosines.map(|c| 1.0 / (1.0 + REST_BIAS - c * c));
                    let [c, d] = cosines.map(|c| 2.0 * c);
                    let ([p, q], [r, s]) = (a.power, b.power);
                    let (sum, difference) = (even + odd, even - odd);
                    let (add, less) = (cross + crossed, cross - crossed);
                    explained[0] += (p + r - c * (sum + add)) * alike;
                    explained[1] += (q + s - c * (sum - add)) * alike;
                    explained[2] += (p + s - d * (difference + less)) * mixed;
                    explained[3] += (q + r - d * (difference - less)) * mixed;
                }
                let pairs = [[i, j], [i + HALF, j + HALF], [i, j + HALF], [i + HALF, j]];
                for (explained, directions) in explained.into_iter().zip(pairs) {
                    if explained > most {
                        (most, pair) = (explained, directions);
                    }
                }
            }
        }
        pair.map(|i| i as f32 * GRID_STEP_RAD)
    }
}

#[cfg(test)]
mod tests {
    use super::super::bartlett::GRID;
    use super::super::model::Paths;
    use super::super::scenes::with_solver;
    use super::*;

    #[test]
    fn no_pair_of_the_grid_with_an_even_member_explains_more() {
        for turn_deg in [0.0, 3.0, 4.0] {
            with_solver(turn_deg, 1.0, |solver| {
                assert!(solver.headings.len() <= super::super::model::HEADINGS);
                let explained = |pair: [f32; 2]| solver.normal(Paths::Two(pair, 1.0), 1).explained;
                let mut scan = Scan::EMPTY;
                solver.scan(&mut scan);
                let found = explained(solver.projection(&scan));
                for i in (0..GRID).step_by(2) {
                    for j in (0..GRID).filter(|j| *j != i) {
                        let other = explained([i, j].map(|k| k as f32 * GRID_STEP_RAD));
                        assert!(found > 0.99 * other, "{i} {j}: {other}, found {found}");
                    }
                }
            });
        }
    }
}
