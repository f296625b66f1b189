//! Exploration, the same for all agents: towards a frontier of the known ground, the near ones likelier, until it is one no
//! longer.

use super::known::{Cell, Index, Known};
use crate::random::Random;
use crate::world::Horizontal;

/// Where it is headed.
#[derive(Clone, Debug)]
pub struct Explorer {
    random: Random,
    target: Option<Index>,
}

impl Explorer {
    /// With a seed of its own.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { random: Random::new(seed, 5), target: None }
    }

    /// Drops the target.
    pub fn forget(&mut self) {
        self.target = None;
    }

    /// Where to go next; `None` when nothing is left to explore.
    pub fn target(&mut self, known: &Known, place: Horizontal) -> Option<Horizontal> {
        if let Some(target) = self.target {
            let center = known.center(target);
            if is_frontier(known, target) && !known.is_blocked(center) && center.minus(place).norm() > 0.5 {
                return Some(center);
            }
        }
        let costs = known.distances(place);
        let weigh = |index: Index| {
            let cost = known.cost_of(&costs, index);
            // Frontiers of many cells count as much as they are wide.
            let cells = f64::from(cost) * 1e-3;
            if cost == u32::MAX { 0.0 } else { 1.0 / ((cells + 8.0) * (cells + 8.0)) }
        };
        let weighed: Vec<(Index, f64)> = known.frontier().into_iter().map(|index| (index, weigh(index))).collect();
        let total: f64 = weighed.iter().map(|(_, weight)| weight).sum();
        let mut left = total * self.random.uniform();
        self.target = None;
        for (index, weight) in weighed {
            left -= weight;
            if weight > 0.0 {
                self.target = Some(index);
                if left <= 0.0 {
                    break;
                }
            }
        }
        self.target.map(|target| known.center(target))
    }
}

fn is_frontier(known: &Known, [column, row]: Index) -> bool {
    known.cell([column, row]) == Cell::Free
        && [[column.wrapping_sub(1), row], [column + 1, row], [column, row.wrapping_sub(1)], [column, row + 1]]
            .into_iter()
            .any(|index| known.get(index) == Some(Cell::Unknown))
}
