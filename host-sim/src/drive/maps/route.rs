//! The shortest path of a disc-shaped vehicle among known pillars, exactly.
//!
//! A shortest path consists of straight pieces that touch the inflated pillars and of arcs on them: it is found with
//! Dijkstra's algorithm on the tangent graph, whose nodes are the points of contact of all common tangents. There is
//! no grid, so the length is exact except for rounding (1e-9 m). The path stays inside the bounds; because they are
//! convex it never bends at them.

use std::f64::consts::{PI, TAU};

use petgraph::algo::dijkstra;
use petgraph::graph::{NodeIndex, UnGraph};

use super::parts::Pillar;

/// A tangent may enter a pillar by this much: rounding.
const ROUNDING_M: f64 = 1e-9;

/// Inflated pillars and the tangents among them.
#[derive(Clone, Debug)]
pub struct Forest {
    bounds: [f64; 4],
    discs: Vec<Pillar>,
    /// Per disc: the middles of the arcs that are inside other discs or out of bounds.
    closed_rad: Vec<Vec<f64>>,
    tangents: Vec<Tangent>,
}

/// A straight piece that touches two discs: the contacts, as disc and angle, and its length.
#[derive(Clone, Copy, Debug)]
struct Tangent {
    contacts: [(usize, f64); 2],
    length_m: f64,
}

impl Forest {
    /// The forest for a vehicle whose centre must keep `inflation_m` from every pillar.
    #[must_use]
    pub fn new(bounds: [f64; 4], pillars: &[Pillar], inflation_m: f64) -> Self {
        let inflated: Vec<Pillar> = pillars.iter().map(|[x, y, r]| [*x, *y, r + inflation_m]).collect();
        // A disc inside another is never touched; of equal ones the first is kept.
        let is_inside = |k: usize, j: usize| {
            let gap = inflated[j][2] - inflated[k][2] - distance(inflated[k], inflated[j]);
            gap > 0.0 || (gap == 0.0 && j < k)
        };
        let is_outermost = |k: &usize| !(0..inflated.len()).any(|j| j != *k && is_inside(*k, j));
        let discs: Vec<Pillar> = (0..inflated.len()).filter(is_outermost).map(|k| inflated[k]).collect();
        let closed_rad = (0..discs.len()).map(|k| closed_rad(bounds, &discs, k)).collect();
        let mut forest = Self { bounds, discs, closed_rad, tangents: Vec::new() };
        for i in 0..forest.discs.len() {
            for j in i + 1..forest.discs.len() {
                let free = common_tangents(forest.discs[i], forest.discs[j])
                    .filter(|[a, b]| forest.is_free(point(forest.discs[i], *a), point(forest.discs[j], *b), [i, j]))
                    .map(|[a, b]| Tangent {
                        contacts: [(i, a), (j, b)],
                        length_m: distance(point(forest.discs[i], a), point(forest.discs[j], b)),
                    });
                let free: Vec<Tangent> = free.collect();
                forest.tangents.extend(free);
            }
        }
        forest
    }

    /// Whether a place is inside the bounds and outside all inflated pillars.
    #[must_use]
    pub fn is_clear(&self, [x, y]: [f64; 2]) -> bool {
        self.is_within([x, y, 0.0]) && self.discs.iter().all(|disc| distance(*disc, [x, y, 0.0]) >= disc[2])
    }

    fn is_within(&self, [x, y, _]: Pillar) -> bool {
        let [west, south, east, north] = self.bounds;
        x >= west - ROUNDING_M && x <= east + ROUNDING_M && y >= south - ROUNDING_M && y <= north + ROUNDING_M
    }

    /// Whether a straight piece stays inside the bounds and outside all discs except those that it touches.
    fn is_free(&self, from: Pillar, to: Pillar, touched: [usize; 2]) -> bool {
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let length2 = (dx * dx + dy * dy).max(f64::MIN_POSITIVE);
        self.is_within(from)
            && self.is_within(to)
            && self.discs.iter().enumerate().filter(|(k, _)| !touched.contains(k)).all(|(_, [x, y, r])| {
                let t = (((x - from[0]) * dx + (y - from[1]) * dy) / length2).clamp(0.0, 1.0);
                let (gap_x, gap_y) = (from[0] + t * dx - x, from[1] + t * dy - y);
                let radius = r - ROUNDING_M;
                gap_x * gap_x + gap_y * gap_y >= radius * radius
            })
    }

    /// Length of the shortest path; `None` when there is no path.
    #[must_use]
    pub fn shortest_m(&self, start: [f64; 2], goal: [f64; 2]) -> Option<f64> {
        if !self.is_clear(start) || !self.is_clear(goal) {
            return None;
        }
        const NONE: usize = usize::MAX;
        let [start, goal] = [start, goal].map(|[x, y]| [x, y, 0.0]);
        if self.is_free(start, goal, [NONE, NONE]) {
            return Some(distance(start, goal));
        }

        let mut graph: UnGraph<(), f64> = UnGraph::default();
        let ends = [graph.add_node(()), graph.add_node(())];
        let mut contacts: Vec<Vec<(f64, NodeIndex)>> = vec![Vec::new(); self.discs.len()];
        let mut touch = |graph: &mut UnGraph<(), f64>, (disc, angle_rad): (usize, f64)| {
            let node = graph.add_node(());
            contacts[disc].push((libm::remainder(angle_rad, TAU), node));
            node
        };
        for tangent in &self.tangents {
            let [a, b] = tangent.contacts.map(|contact| touch(&mut graph, contact));
            graph.add_edge(a, b, tangent.length_m);
        }
        for (end, node) in [start, goal].into_iter().zip(ends) {
            for (k, disc) in self.discs.iter().enumerate() {
                for [_, angle_rad] in common_tangents(end, *disc) {
                    let at = point(*disc, angle_rad);
                    if self.is_free(end, at, [NONE, k]) {
                        let contact = touch(&mut graph, (k, angle_rad));
                        graph.add_edge(node, contact, distance(end, at));
                    }
                }
            }
        }
        for (k, around) in contacts.iter_mut().enumerate() {
            around.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (index, (from_rad, from)) in around.iter().enumerate() {
                let (to_rad, to) = around[(index + 1) % around.len()];
                let arc_rad = libm::fmod(to_rad - from_rad + TAU, TAU);
                // Both contacts are open, so a closed arc is either completely between them or not at all.
                let is_between = |closed: &f64| libm::fmod(closed - from_rad + 2.0 * TAU, TAU) < arc_rad;
                if *from != to && !self.closed_rad[k].iter().any(is_between) {
                    graph.add_edge(*from, to, self.discs[k][2] * arc_rad);
                }
            }
        }
        dijkstra(&graph, ends[0], Some(ends[1]), |edge| *edge.weight()).get(&ends[1]).copied()
    }
}

fn distance([x, y, _]: Pillar, [other_x, other_y, _]: Pillar) -> f64 {
    libm::hypot(other_x - x, other_y - y)
}

/// The point of a disc at an angle, from the x axis, counter-clockwise.
fn point([x, y, r]: Pillar, angle_rad: f64) -> Pillar {
    [x + r * libm::cos(angle_rad), y + r * libm::sin(angle_rad), 0.0]
}

/// The common tangents of two discs, as the angles of their contacts.
fn common_tangents(a: Pillar, b: Pillar) -> impl Iterator<Item = [f64; 2]> {
    let apart = distance(a, b);
    let toward = libm::atan2(b[1] - a[1], b[0] - a[0]);
    let is_disjoint = apart > a[2] + b[2];
    let outer = (apart > (a[2] - b[2]).abs()).then(|| libm::acos((a[2] - b[2]) / apart));
    // Those that cross between the discs; the same as the outer ones when one is a point.
    let inner = (is_disjoint && a[2] > 0.0 && b[2] > 0.0).then(|| libm::acos((a[2] + b[2]) / apart));
    let both_sides = |half: f64| [half, -half];
    let outer = outer.into_iter().flat_map(both_sides).map(move |side| [toward + side, toward + side]);
    let inner = inner.into_iter().flat_map(both_sides).map(move |side| [toward + side, toward + side + PI]);
    outer.chain(inner)
}

/// Middles of the arcs of a disc that are inside other discs or beyond the bounds.
fn closed_rad([west, south, east, north]: [f64; 4], discs: &[Pillar], k: usize) -> Vec<f64> {
    let [x, y, r] = discs[k];
    let beyond = [(x - west, PI), (east - x, 0.0), (y - south, -PI / 2.0), (north - y, PI / 2.0)];
    let beyond = beyond.into_iter().filter(|(inside_m, _)| *inside_m < r).map(|(_, middle)| middle);
    let others = discs.iter().enumerate().filter(|(j, other)| {
        let apart = distance(discs[k], **other);
        *j != k && apart < r + other[2]
    });
    beyond.chain(others.map(|(_, other)| libm::atan2(other[1] - y, other[0] - x))).collect()
}

#[cfg(test)]
mod tests {
    use std::cmp::Reverse;
    use std::collections::BinaryHeap;

    use super::*;
    use crate::world::random::Random;

    const BOUNDS: [f64; 4] = [0.0, 0.0, 10.0, 10.0];

    #[test]
    fn a_free_line_is_straight() {
        let forest = Forest::new(BOUNDS, &[[5.0, 5.0, 0.8]], 0.2);
        assert_eq!(forest.shortest_m([1.0, 1.0], [1.0, 9.0]), Some(8.0));
    }

    #[test]
    fn round_one_disc_it_is_two_tangents_and_an_arc() {
        // Collinear, 4 m either side of a disc of 1 m: 2 sqrt(15) + 2 asin(1/4).
        let forest = Forest::new(BOUNDS, &[[5.0, 5.0, 0.8]], 0.2);
        let expected = 2.0 * 15.0_f64.sqrt() + 2.0 * 0.25_f64.asin();
        assert!((forest.shortest_m([1.0, 5.0], [9.0, 5.0]).unwrap() - expected).abs() < 1e-9);
    }

    #[test]
    fn between_two_overlapping_discs_there_is_no_way() {
        // Round the outer one of them: below, because the line is nearer to its lower rim.
        let forest = Forest::new(BOUNDS, &[[5.0, 5.0, 1.0], [5.0, 6.5, 1.0]], 0.0);
        let single = Forest::new(BOUNDS, &[[5.0, 5.0, 1.0]], 0.0);
        let (start, goal) = ([1.0, 5.2], [9.0, 5.2]);
        let around = forest.shortest_m(start, goal).unwrap();
        assert!(around > single.shortest_m(start, goal).unwrap() + 0.05);
        let mirrored = single.shortest_m([1.0, 4.8], [9.0, 4.8]).unwrap();
        assert!(around > mirrored, "it had to cross to the other side of the disc's middle");
    }

    #[test]
    fn an_s_between_two_discs_uses_the_inner_tangent() {
        // Discs of 1 m at (3.5, 5.5) and (6.5, 4.5), start and goal on the axis: the two halves are alike.
        let forest = Forest::new(BOUNDS, &[[3.5, 5.5, 1.0], [6.5, 4.5, 1.0]], 0.0);
        let whole = forest.shortest_m([0.5, 5.0], [9.5, 5.0]).unwrap();
        let half = forest.shortest_m([0.5, 5.0], [5.0, 5.0]).unwrap();
        assert!((whole - 2.0 * half).abs() < 1e-9, "{whole} {half}");
        assert!(whole > 9.0 && whole < 9.6);
    }

    #[test]
    fn a_wall_without_a_gap_from_edge_to_edge_cannot_be_passed_and_one_with_a_gap_can() {
        let wall = |gap: f64| -> Vec<Pillar> {
            (0..21).map(|k| f64::from(k) * 0.5).filter(|y| *y != 5.0 || gap == 0.0).map(|y| [5.0, y, 0.3]).collect()
        };
        assert_eq!(Forest::new(BOUNDS, &wall(0.0), 0.15).shortest_m([2.0, 5.0], [8.0, 5.0]), None);
        assert_eq!(Forest::new(BOUNDS, &wall(1.0), 0.21).shortest_m([2.0, 5.0], [8.0, 5.0]), None);
        assert_eq!(Forest::new(BOUNDS, &wall(1.0), 0.19).shortest_m([2.0, 5.0], [8.0, 5.0]), Some(6.0));
    }

    #[test]
    fn a_start_or_goal_inside_an_inflated_pillar_or_out_of_bounds_has_no_way() {
        let forest = Forest::new(BOUNDS, &[[5.0, 5.0, 0.8]], 0.2);
        assert_eq!(forest.shortest_m([5.0, 5.9], [9.0, 5.0]), None);
        assert_eq!(forest.shortest_m([1.0, 5.0], [10.5, 5.0]), None);
    }

    #[test]
    fn duplicate_and_nested_pillars_change_nothing() {
        let plain = Forest::new(BOUNDS, &[[4.0, 5.1, 0.8], [6.0, 4.8, 0.5]], 0.1);
        let doubled = [[4.0, 5.1, 0.8], [6.0, 4.8, 0.5], [4.0, 5.1, 0.8], [4.1, 5.1, 0.3], [6.0, 4.8, 0.5]];
        let doubled = Forest::new(BOUNDS, &doubled, 0.1);
        let (start, goal) = ([1.0, 5.0], [9.0, 5.0]);
        assert_eq!(plain.shortest_m(start, goal), doubled.shortest_m(start, goal));
    }

    /// Dijkstra on a grid with the 32 nearest directions: at most 0.7 % longer than the shortest path, plus some
    /// cells.
    fn grid_m(pillars: &[Pillar], inflation_m: f64, start: [f64; 2], goal: [f64; 2]) -> Option<f64> {
        const STEP_M: f64 = 0.02;
        const SIDE: i32 = 501;
        let is_free = |x: i32, y: i32| {
            let (x, y) = (f64::from(x) * STEP_M, f64::from(y) * STEP_M);
            pillars.iter().all(|[px, py, r]| (x - px).hypot(y - py) >= r + inflation_m)
        };
        let free: Vec<bool> = (0..SIDE * SIDE).map(|k| is_free(k % SIDE, k / SIDE)).collect();
        let node = |at: [f64; 2]| ((at[0] / STEP_M).round() as i32, (at[1] / STEP_M).round() as i32);
        let steps: Vec<(i32, i32)> = [(1, 0), (1, 1), (1, 2), (2, 1), (1, 3), (3, 1), (2, 3), (3, 2)]
            .into_iter()
            .flat_map(|(a, b)| [(a, b), (-b, a), (-a, -b), (b, -a)])
            .collect();
        let mut best = vec![i64::MAX; free.len()];
        let mut queue = BinaryHeap::from([(Reverse(0_i64), node(start))]);
        while let Some((Reverse(so_far), (x, y))) = queue.pop() {
            if (x, y) == node(goal) {
                return Some(so_far as f64 * 1e-6);
            }
            if so_far > best[(y * SIDE + x) as usize] {
                continue;
            }
            for (dx, dy) in &steps {
                let (x, y) = (x + dx, y + dy);
                if x < 0 || y < 0 || x >= SIDE || y >= SIDE || !free[(y * SIDE + x) as usize] {
                    continue;
                }
                let length = so_far + (f64::from(*dx).hypot(f64::from(*dy)) * STEP_M * 1e6) as i64;
                if length < best[(y * SIDE + x) as usize] {
                    best[(y * SIDE + x) as usize] = length;
                    queue.push((Reverse(length), (x, y)));
                }
            }
        }
        None
    }

    #[test]
    fn in_random_forests_it_is_as_long_as_a_fine_grid_says() {
        let mut random = Random::new(9, 0);
        let mut compared = 0;
        for _ in 0..12 {
            let mut draw = |from: f64, to: f64| from + (to - from) * random.uniform();
            let pillars: Vec<Pillar> = (0..100).map(|_| [draw(0.0, 10.0), draw(0.0, 10.0), draw(0.1, 0.33)]).collect();
            let forest = Forest::new(BOUNDS, &pillars, 0.15);
            let (start, goal) = ([draw(0.0, 2.0), draw(0.0, 10.0)], [draw(8.0, 10.0), draw(0.0, 10.0)]);
            let Some(exact) = forest.shortest_m(start, goal) else { continue };
            let straight = (start[0] - goal[0]).hypot(start[1] - goal[1]);
            assert!(exact >= straight - 1e-9);
            // Slightly thinner pillars, or the grid could miss a narrow gap.
            let Some(grid) = grid_m(&pillars, 0.14, start, goal) else { panic!("only the exact one finds a way") };
            assert!(grid < exact * 1.008 + 0.04, "the grid finds {grid} where the shortest is {exact}");
            let Some(grid) = grid_m(&pillars, 0.15, start, goal) else { continue };
            assert!(grid > exact - 0.04, "the grid finds {grid}, shorter than the shortest {exact}");
            compared += 1;
        }
        assert!(compared >= 6, "{compared}");
    }
}
