//! Foxhound's planner: estimates where the source may be, finds the path around the remembered obstacles, and samples
//! trajectories over the next two metres.
//!
//! 1. The source is taken to be in the middle of the places where it may be ([`crate::localize::source::support`]).
//! 2. A wave from the start gives the length of the path to every place in the window ([`crate::planning::wavefront`]).
//!    If the source's estimate cannot be reached, the aim is the mean of the places to which there is a path.
//! 3. The temporary target is the farthest place on the path that is at most two metres away and in sight.
//! 4. The paper's ten samples lead to it, with soft gains and a sampled swirl; only those whose swept path keeps its
//!    margin may be chosen. If there are none, the straight line to the target is flown. If that is not clear either,
//!    the answer is a brake plan.
//!
//! Seen from a distance, a pillar's size is uncertain, and an open gap can seem closed. So the path leads around the
//! discs as they were measured, while samples also keep clear of their sigma, which shrinks on the way. After some
//! replans without progress, the path keeps clear of it, too.
//!
//! After some seconds without progress a detour begins: every fourth replan then uses a window three times as wide and
//! as coarse, and those between follow the path found there, until the vehicle is nearer to the source than it has ever
//! been (the leave condition of `TangentBug`, Kamon, Rivlin and Rimon 1996). After a minute or more without progress
//! the source is given up as unreachable.
//!
//! Where no obstacle is near and the range is unknown, the path is bent instead ([`super::bend`]).
//!
//! No path leads out of the fence. Where the source lies beyond it, the place inside that is nearest to it takes its place.
//!
//! If there is no path to any place where the source may be, the vehicle flies to the reachable place nearest to it,
//! and gets a brake plan there.

use heapless::Vec;

use super::bend::bend;
use super::sampling::{draw, nearest, weighted};
use super::{CHECKED_SEGMENTS, Config, GAINS_MIN, HORIZON_M, Plan, PlanRequest, Planner, SAMPLES, Verdict, Workspace};
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::obstacle::{Disc, Obstacle};
use crate::base::rng::Rng;
use crate::localize::source::support::SourcePosition;
use crate::mapping::map::CIRCLES_MAX;
use crate::planning::field::{Field, Gains};
use crate::planning::rollout::{Cost, SPACING_M, Trajectory, WAYPOINTS, cost, swept_clearance_m};
use crate::planning::wavefront::{ROUTE_MAX, Window, march};

/// Within this the source counts as reached.
const ARRIVAL_M: f32 = 0.3;
/// Beyond this distance, and while the range is uncertain, the averaged bearing is the better direction; otherwise the
/// places' mean, which does not lag behind when the vehicle passes the source.
const NEAR_M: f32 = 1.5;
const VAGUE: f32 = 0.1;
/// When the source cannot be reached, a place must be nearer to it by this to be flown to.
const WORTH_M: f32 = 0.3;
/// The distance to the target at the end of a sample must be less than this share of that at its start.
const NEARER: f32 = 0.5;
/// Bound of the cost of proximity, 1/m.
const PROXIMITY_MAX: f32 = 5.0;
/// Number of steps in which a place on the path is pushed out of margins.
const CENTRING_STEPS: usize = 4;
/// Smallest share of the places that must be reachable for the vehicle to fly there.
const REACHABLE_SHARE: f32 = 0.02;

/// Coming nearer to the source by this is progress.
const PROGRESS_M: f32 = 0.3;
/// Replans without progress, after which an obstacle is assumed to be in the way.
const PATIENCE: u16 = 8;
/// Scale of the wide window, and the number of replans from one use of it to the next.
const FAR_SCALE: f32 = 3.0;
const FAR_EVERY: u16 = 4;
/// Largest number of replans of a mission that bend the path to learn the range: about four metres. If the range is not
/// known by then, more bends do not help.
const BENDS_MAX: u8 = 6;
/// Largest distance between two neighbouring places of the path found.
const PATH_STEP_M: f32 = 1.0;
/// A vehicle that can get nowhere so far north, south, east or west, or there between, is shut in.
const SHUT_IN_M: f32 = 0.5;
/// A path with less than this left has ended.
const PATH_MIN_M: f32 = 0.6;
/// Replans without progress, the early ones left out, after which no new path is searched and only a path to the source from
/// the wide window is followed. After twice as many the vehicle stops. `CREDIT` is the number of replans that one step
/// of progress gives back.
const SPENT_MAX: u16 = 80;
const CREDIT: u16 = 20;

/// Foxhound's planner's memory and workspace.
#[derive(Clone, Debug)]
pub(super) struct Memory {
    window: Window,
    /// The path found in the wide window.
    path: Vec<Horizontal, ROUTE_MAX>,
    progress: Progress,
    /// The place that is searched, and the replans that had been spent on the source before.
    sought_ned_m: Option<Horizontal>,
    spent_on_source: u16,
}

/// Whether the vehicle comes nearer to the source. All bits are zero at first, so that it takes no flash.
#[derive(Clone, Copy, Debug)]
struct Progress {
    has_begun: bool,
    /// Where the vehicle was nearest to the source so far, and the replans since.
    closest_ned_m: Horizontal,
    since: u16,
    /// Replans so far that were not early, less those that every step of progress gives back.
    spent: u16,
    /// Number of replans without progress after which a detour begins.
    patience: u16,
    /// On a detour: replans until the next one with the wide window.
    until_far: Option<u16>,
    /// Replans that bent the path to learn the range.
    bends: u8,
    /// The place to fly to while the source cannot be reached.
    resort_ned_m: Option<Horizontal>,
}

impl Progress {
    const NONE: Self = Self {
        has_begun: false,
        closest_ned_m: Horizontal { north: 0.0, east: 0.0 },
        since: 0,
        spent: 0,
        patience: 0,
        until_far: None,
        bends: 0,
        resort_ned_m: None,
    };

    fn new(closest_ned_m: Horizontal, spent: u16) -> Self {
        Self { has_begun: true, closest_ned_m, spent, patience: PATIENCE, ..Self::NONE }
    }

    /// Updates the counters for one replan.
    fn step(&mut self, start: Horizontal, source: Horizontal, is_early: bool) {
        if !self.has_begun {
            *self = Self { bends: self.bends, ..Self::new(start, self.spent) };
        }
        self.spent = self.spent.saturating_add(u16::from(!is_early));
        self.since = self.since.saturating_add(1);
        self.until_far = match self.until_far {
            Some(left) => Some(left.checked_sub(1).unwrap_or(FAR_EVERY - 1)),
            None => (self.since >= self.patience).then_some(0),
        };
        if source.minus(start).norm() < source.minus(self.closest_ned_m).norm() - PROGRESS_M {
            *self = Self { bends: self.bends, ..Self::new(start, self.spent.saturating_sub(CREDIT)) };
        }
    }

    /// The path from the wide window turns out to be blocked.
    fn abandon(&mut self) {
        self.until_far = None;
        self.patience = self.since.saturating_add(PATIENCE);
    }
}

impl Memory {
    pub(super) const fn new() -> Self {
        Self {
            window: Window::new(),
            path: Vec::new(),
            progress: Progress::NONE,
            sought_ned_m: None,
            spent_on_source: 0,
        }
    }

    fn forget(&mut self) {
        let Self { window: _, path, progress, sought_ned_m, spent_on_source } = self;
        path.clear();
        (*progress, *sought_ned_m, *spent_on_source) = (Progress::NONE, None, 0);
    }

    /// Whether the last plan found no way out of the closest surroundings.
    #[inline(never)]
    pub(super) fn is_shut_in(&self, start: Horizontal) -> bool {
        let mut off = Horizontal { north: -SHUT_IN_M, east: -SHUT_IN_M };
        // A loop over eight places would be written out eight times.
        while off.north <= SHUT_IN_M {
            if off != Horizontal::default() && self.window.arrival_m(start.plus(off)).is_some() {
                return false;
            }
            off.east += SHUT_IN_M;
            if off.east > SHUT_IN_M {
                off = Horizontal { north: off.north + SHUT_IN_M, east: -SHUT_IN_M };
            }
        }
        true
    }

    /// Forgets the way to the last place where this is another: the next one of a search, or the source after it, for which
    /// what was spent before counts on.
    #[inline(never)]
    fn turn_to(&mut self, sought_ned_m: Option<Horizontal>) {
        if sought_ned_m == self.sought_ned_m {
            return;
        }
        if self.sought_ned_m.is_none() {
            self.spent_on_source = self.progress.spent;
        }
        let spent = if sought_ned_m.is_none() { self.spent_on_source } else { 0 };
        self.progress = Progress { spent, bends: self.progress.bends, ..Progress::NONE };
        self.path.clear();
        self.sought_ned_m = sought_ned_m;
    }
}

/// The place to fly to.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Aim {
    place_ned_m: Horizontal,
    /// Whether the source may be there, or this is only the nearest place.
    hopeful: bool,
}

/// Answers one request; `known` is the position of the source, or of a target in its place, if that is known.
pub(super) fn plan(
    planner: &Planner,
    workspace: &mut Workspace,
    (request, discs): (&PlanRequest, &[Disc]),
    known: Option<Horizontal>,
) -> Plan {
    let Planner { config, vehicle, fence, .. } = planner;
    let start = request.start_ned_m;
    let mut rng = Rng::new(request.seed, u64::from(request.id));
    let source = locate(request, known);
    let toward = fence.nearest_inside(source.map_or(request.target_ned_m, |source| source.place_ned_m), start);

    if request.begins {
        workspace.memory.forget();
    }
    workspace.memory.turn_to(request.search.as_ref().and(known));
    let Memory { window, path, progress, .. } = &mut workspace.memory;
    progress.step(start, toward, request.is_early);
    let keep_off = |obstacles: &mut Vec<Obstacle, CIRCLES_MAX>, as_measured: bool| {
        obstacles.clear();
        for disc in discs {
            // Moving obstacles have moved on by then, and avoiding them for longer means to meet them more often.
            let gust_margin_m = if disc.moves { 0.0 } else { request.gust_margin_m };
            let disc = if as_measured { disc.measured() } else { *disc };
            let _ = obstacles.push(Obstacle::of(&disc, vehicle.radius_m + gust_margin_m));
        }
    };
    // Among people the path keeps clear of the sigma as well: that is also the space to give way in.
    keep_off(&mut workspace.obstacles, progress.since < PATIENCE && !request.among_moving);
    let far = progress.until_far == Some(0);
    let near = |obstacle: &Obstacle| {
        let limit = HORIZON_M + 2.0 + obstacle.reach_m;
        obstacle.center_ned_m.minus(start).norm_squared() < limit * limit
    };
    // With no obstacle near no detour is needed, and only a bend shows how far the source is.
    if let Some(learn) = &request.learn
        && config.bends
        && known.is_none()
        && progress.until_far.is_none()
        && progress.bends < BENDS_MAX
        && !workspace.obstacles.iter().any(near)
        && let Some(bent) = bend(request, learn, &workspace.obstacles)
        && fence.has_inside(&bent, start)
    {
        progress.bends += 1;
        let target = bent[WAYPOINTS - 1];
        workspace.feasible = [false; SAMPLES];
        return Plan {
            verdict: Verdict::Follow,
            waypoints_ned_m: bent,
            cost: soft(cost(start, &bent, target, &[])),
            target_ned_m: target,
            source,
            ..Plan::brake(config, request)
        };
    }
    march(window, start, toward, if far { FAR_SCALE } else { 1.0 }, planner.passable_m, &workspace.obstacles, fence);
    let support = if known.is_some() { &[] } else { request.support.places() };
    let aim = aim(window, support, &workspace.obstacles, (progress, &*path), toward);
    // From here on only the obstacles that matter within the horizon, with their sigma.
    keep_off(&mut workspace.obstacles, false);
    workspace.obstacles.retain(near);

    let mut plan = Plan { source, ..Plan::brake(config, request) };
    let Some(aim) = aim else {
        if far {
            path.clear();
        }
        return plan;
    };
    let mut route = window.route(aim.place_ned_m);
    if far {
        path.clone_from(&route);
    }
    // Places beyond the horizon do not matter yet.
    let beyond = |place: &Horizontal| place.minus(start).norm_squared() > HORIZON_M * HORIZON_M;
    route.truncate(route.iter().position(beyond).unwrap_or(route.len()));
    for place in &mut route {
        *place = centred(*place, config.margin_m, &workspace.obstacles);
    }
    let (target, margin_m) = target(config, start, aim.place_ned_m, &route, &workspace.obstacles);
    plan.target_ned_m = target;
    let gain_m = start.minus(toward).norm() - aim.place_ned_m.minus(toward).norm();
    if !aim.hopeful && gain_m < WORTH_M {
        return plan;
    }

    sample(config, workspace, &mut rng, start, target, margin_m);
    if let Some(optimal) = weighted(workspace) {
        let chosen = nearest(workspace, &optimal);
        plan.verdict = Verdict::Follow;
        workspace.choose(chosen, &mut plan);
        return plan;
    }
    if keeps(config.tight_margin_m, start, &[target], &workspace.obstacles) {
        plan.verdict = Verdict::Follow;
        plan.waypoints_ned_m = straight(start, target);
        plan.cost = soft(cost(start, &plan.waypoints_ned_m, target, &workspace.obstacles));
    }
    plan
}

/// The position of the source: along the averaged bearing, at the mean range of the places where it may be. Near the
/// source, and when the bearing does not agree, their mean.
fn locate(request: &PlanRequest, known: Option<Horizontal>) -> Option<SourcePosition> {
    if let Some(place_ned_m) = known {
        return Some(SourcePosition { place_ned_m, sigma_m: 0.0 });
    }
    let mut source = request.support.mean()?;
    let range_m = source.place_ned_m.minus(request.position_ned_m).dot(request.direction_ned);
    if range_m > NEAR_M && source.sigma_m > VAGUE * range_m {
        source.place_ned_m = request.position_ned_m.plus(request.direction_ned.times(range_m));
    }
    Some(source)
}

/// The place to fly to in the window.
fn aim(
    window: &mut Window,
    support: &[(Horizontal, f32)],
    obstacles: &[Obstacle],
    (progress, path): (&mut Progress, &[Horizontal]),
    source: Horizontal,
) -> Option<Aim> {
    let hopeful = |place_ned_m| Some(Aim { place_ned_m, hopeful: true });
    let inside = window.contains(source);
    if progress.spent >= 2 * SPENT_MAX {
        return None;
    }
    if inside && let Some(place) = approach(window, source) {
        return hopeful(place);
    }
    if progress.spent >= SPENT_MAX && (progress.until_far.is_none() || path.is_empty()) {
        return None;
    }
    if (!inside || window.is_open(source))
        && let Some(place) = leave(window, obstacles, (progress, path), source)
    {
        return hopeful(place);
    }
    // The estimate cannot be reached: try the other places where the source may be and to which there is a path.
    let (mut sum, mut share) = (Horizontal::default(), 0.0);
    for &(place, weight) in support {
        if is_within_reach(window, place) {
            sum = sum.plus(place.times(weight));
            share += weight;
        }
    }
    if share > REACHABLE_SHARE {
        let mean = sum.times(1.0 / share);
        if let Some(place) = approach(window, mean) {
            return hopeful(place);
        }
        // The mean of the reachable places is not always reachable itself.
        let mut nearest = (f32::INFINITY, mean);
        for &(place, weight) in support {
            let distance = place.minus(mean).norm_squared();
            if weight > 0.0 && distance < nearest.0 && is_within_reach(window, place) {
                nearest = (distance, place);
            }
        }
        if let Some(place) = approach(window, nearest.1) {
            return hopeful(place);
        }
    }
    // Often several places are about as near to it: one is kept, or the vehicle would fly to and fro between them.
    let off_m = |place: Horizontal| place.minus(source).norm();
    let nearest = window.nearest_reached(source)?;
    let is_as_near =
        |place: &Horizontal| window.arrival_m(*place).is_some() && off_m(*place) < off_m(nearest) + WORTH_M;
    let place_ned_m = progress.resort_ned_m.filter(is_as_near).unwrap_or(nearest);
    progress.resort_ned_m = Some(place_ned_m);
    Some(Aim { place_ned_m, hopeful: false })
}

/// The reachable place from which a source at `place` counts as reached; if `place` is outside the window, the best
/// place to leave the window at. `None` if there is none.
fn approach(window: &Window, place: Horizontal) -> Option<Horizontal> {
    if window.arrival_m(place).is_some() {
        Some(place)
    } else if window.contains(place) {
        window.nearest_reached_within(place, ARRIVAL_M)
    } else {
        window.best_exit(place)
    }
}

/// The place to leave the window at, towards a source that cannot be reached inside it; on a detour the farthest
/// reachable place of the path from the wide window.
fn leave(
    window: &Window,
    obstacles: &[Obstacle],
    (progress, path): (&mut Progress, &[Horizontal]),
    source: Horizontal,
) -> Option<Horizontal> {
    if progress.until_far.is_some_and(|left| left > 0)
        && let Some((place, arrival_m)) = along(window, path)
    {
        if arrival_m > PATH_MIN_M {
            return Some(place);
        }
        if path.last().is_some_and(|last| last.minus(place).norm() < PATH_MIN_M) {
            // At its end: use the wide window again.
            progress.until_far = Some(1);
            return Some(place);
        }
        progress.abandon();
    }
    let exit = window.best_exit(source)?;
    // Outside the window the rest of the path is assumed to be straight; a known obstacle on it makes it longer.
    let sees = |place| keeps(0.0, place, &[source], obstacles);
    if sees(exit) {
        return Some(exit);
    }
    window.nearest_exit(source).filter(|nearest| sees(*nearest)).or(Some(exit))
}

/// The farthest place up to which a path agrees with the window's distances, and the length of the path to it.
fn along(window: &Window, path: &[Horizontal]) -> Option<(Horizontal, f32)> {
    let reached = |place: &Horizontal| window.arrival_m(*place).map(|arrival_m| (*place, arrival_m));
    // From the place with the shortest path to it.
    let (mut from, mut nearest) = (path, reached(path.first()?));
    let mut rest = path;
    while let [place, others @ ..] = rest {
        let there = reached(place);
        let stays = match (nearest, there) {
            (Some((_, least)), Some((_, arrival_m))) => arrival_m >= least,
            (Some(_), None) => true,
            (None, _) => false,
        };
        if !stays {
            (from, nearest) = (rest, there);
        }
        rest = others;
    }
    let mut farthest = nearest?;
    let mut reach_m = farthest.1;
    for place in from {
        reach_m += PATH_STEP_M;
        match reached(place) {
            Some((place, arrival_m)) if arrival_m < reach_m => (farthest, reach_m) = ((place, arrival_m), arrival_m),
            Some(_) => break,
            // The path is coarse and may cut a corner.
            None => {}
        }
    }
    Some(farthest)
}

/// Whether [`approach`] would find a place; approximate, for checking many places.
fn is_within_reach(window: &Window, place: Horizontal) -> bool {
    let around = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)];
    around.iter().any(|(north, east)| {
        let beside = place.plus(Horizontal { north: *north, east: *east }.times(0.9 * ARRIVAL_M));
        window.arrival_m(beside).is_some() || !window.contains(place)
    })
}

/// The farthest place on the path that is within the horizon and in sight, and the margin kept by the line of sight. If
/// no place is in sight with the full margin, the tight one is tried.
fn target(
    config: &Config,
    start: Horizontal,
    aim: Horizontal,
    route: &[Horizontal],
    obstacles: &[Obstacle],
) -> (Horizontal, f32) {
    let horizon_squared = HORIZON_M * HORIZON_M;
    for margin_m in [config.margin_m, config.tight_margin_m] {
        let in_sight = |place: Horizontal| {
            place.minus(start).norm_squared() <= horizon_squared && keeps(margin_m, start, &[place], obstacles)
        };
        // The path ends in the middle of a cell; the aim itself is better.
        if in_sight(aim) {
            return (aim, margin_m);
        }
        if let Some(place) = route.iter().rev().find(|place| place.minus(start).norm() > SPACING_M && in_sight(**place))
        {
            return (*place, margin_m);
        }
    }
    (route.get(1).copied().unwrap_or(aim), config.tight_margin_m)
}

/// Pushes a place on the path out of the margins of the obstacles around it. In a gap narrower than the grid resolves,
/// it ends in the middle of the gap.
fn centred(place: Horizontal, margin_m: f32, obstacles: &[Obstacle]) -> Horizontal {
    let mut centred = place;
    for _ in 0..CENTRING_STEPS {
        let mut push = Horizontal::default();
        for obstacle in obstacles {
            let away = centred.minus(obstacle.center_ned_m);
            let reach_m = obstacle.reach_m + margin_m;
            let squared = away.norm_squared();
            if squared < reach_m * reach_m && squared > 1e-6 {
                let norm = sqrt(squared);
                push = push.plus(away.times((reach_m - norm) / norm));
            }
        }
        if push == Horizontal::default() {
            break;
        }
        centred = centred.plus(push.times(0.6));
    }
    centred
}

/// Rolls out the paper's samples, and marks those as feasible that keep the margin.
fn sample(
    config: &Config,
    workspace: &mut Workspace,
    rng: &mut Rng,
    start: Horizontal,
    target: Horizontal,
    margin_m: f32,
) {
    let distance_m = target.minus(start).norm();
    workspace.scene.gather_all(start, &workspace.obstacles);
    let field = |gains| Field { gains };
    (workspace.initial, _) = workspace.scene.roll(&field(config.gains), target);
    for index in 0..SAMPLES {
        // One of the ten follows the line of sight: almost no repulsion, so almost straight.
        let gains = if index == 0 {
            Gains { k_rep: GAINS_MIN.k_rep, influence_m: GAINS_MIN.influence_m, swirl: 0.0, ..config.gains }
        } else {
            draw(config, rng)
        };
        let (trajectory, cost) = workspace.scene.roll(&field(gains), target);
        workspace.gains[index] = gains;
        workspace.costs[index] = soft(cost);
        let checked = &trajectory[..CHECKED_SEGMENTS];
        let nearer = trajectory[WAYPOINTS - 1].minus(target).norm() <= NEARER * distance_m;
        workspace.feasible[index] = nearer && workspace.scene.keeps_margin(checked, margin_m);
        workspace.samples[index] = trajectory;
    }
}

/// Eq. 41 with a bound on eq. 45: a narrow path that keeps its margin is not penalised further.
fn soft(cost: Cost) -> f32 {
    let proximity = if cost.proximity < PROXIMITY_MAX { cost.proximity } else { PROXIMITY_MAX };
    Cost { proximity, ..cost }.total()
}

/// Waypoints at the usual spacing along a straight line; the rest stay at its end.
fn straight(start: Horizontal, end: Horizontal) -> Trajectory {
    let mut position = start;
    core::array::from_fn(|_| {
        let to = end.minus(position);
        let length_m = to.norm();
        position = if length_m > SPACING_M { position.plus(to.times(SPACING_M / length_m)) } else { end };
        position
    })
}

/// Whether a path keeps a margin. If the start is already too close, a path that does not come closer keeps it.
fn keeps(margin_m: f32, start: Horizontal, trajectory: &[Horizontal], obstacles: &[Obstacle]) -> bool {
    obstacles.iter().all(|obstacle| {
        let at_start = obstacle.clearance_m(start) - 1e-3;
        let wanted = if at_start < margin_m { at_start } else { margin_m };
        swept_clearance_m(start, trajectory, core::slice::from_ref(obstacle)) >= wanted
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::config::Fence;

    #[test]
    fn a_way_seen_from_far_is_followed_past_a_corner_that_it_cuts_and_not_through_a_wall() {
        let path: Vec<Horizontal, ROUTE_MAX> =
            (1..10).map(|k| Horizontal { north: 0.3 * k as f32, east: 0.0 }).collect();
        let mut window = Window::new();
        let mut farthest = |centers: &[(f32, f32)]| {
            let obstacle = |(north, east): &(f32, f32)| Obstacle {
                center_ned_m: Horizontal { north: *north, east: *east },
                reach_m: 0.4,
            };
            let obstacles: Vec<Obstacle, 64> = centers.iter().map(obstacle).collect();
            march(&mut window, Horizontal::default(), path[8], 1.0, 0.036, &obstacles, &Fence::DEFAULT);
            along(&window, &path).map(|(place, _)| place)
        };
        // A pillar beside the path, whose reach covers the path by ten centimetres and more.
        assert_eq!(farthest(&[(0.75, 0.25)]), Some(path[8]));
        let wall: Vec<(f32, f32), 64> = (-20..=20).map(|k| (1.3, 0.3 * k as f32)).collect();
        assert_eq!(farthest(&wall), Some(path[1]));
    }
}
