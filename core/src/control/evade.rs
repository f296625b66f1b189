//! The evader: it moves out of the path of moving obstacles instead of waiting or only braking. People run into a vehicle that
//! stands still.
//!
//! Each velocity of a fan is rolled out as the vehicle would fly it, with its dead time, its lag and its limit of
//! acceleration, and then straight on, against everything that moves, straight on as well. The cost of a velocity grows as
//! the hit comes nearer, as the clearance shrinks, and with the progress that it gives up. The least bad is flown, whatever it
//! costs: there is no default brake. It may be faster than the cruise where the guard is configured so, if that spares a
//! hit. While what was asked for keeps clear of all that moves, it passes as it is.
//!
//! Standing obstacles are considered for a short time ahead, so that the vehicle does not evade into a wall; keeping clear of
//! them is the guard's task. Moving obstacles may turn: this is best effort, measured in `docs/results/people.md`.
//!
//! Cost: bench rows `evade_4` and `evade_16`.

use heapless::Vec;

use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::obstacle::Neighbour;
use crate::base::units::{between, sin_cos};
use crate::control::vehicle_model::{self, VehicleModel};

/// Most moving obstacles that are evaded, the nearest ones.
pub const MOVERS_MAX: usize = 8;
/// Most standing obstacles that are considered.
const STANDING_MAX: usize = 6;
/// Directions of the fan, and shares of the speed in each.
const DIRECTIONS: usize = 16;
const SHARES: [f32; 2] = [1.0, 0.5];
/// Steps of the roll-out after the dead time. Together they last so long, and so many of the vehicle's lags.
const STEPS: usize = 5;
const TURN_S: f32 = 0.9;
const LAGS: f32 = 2.0;
/// Standing obstacles are considered for this long beyond the roll-out.
const STANDING_S: f32 = 0.5;
/// Kept from standing obstacles while evading: one may move too slowly to be known to move.
const STANDING_M: f32 = 0.2;

/// What stands and is no farther from the middle of what moves than this, and their reach, is a part of it.
const PART_M: f32 = 0.1;
/// A moving obstacle may be this much earlier or later than predicted.
const EARLY_S: f32 = 0.1;
/// A hit costs as much as one that is so much later, where it is at once.
const HIT_S: f32 = 0.3;
/// Additional cost of a velocity faster than the cruise.
const FAST_COST: f32 = 1.0;
/// A margin smaller than this counts as this.
const MARGIN_MIN_M: f32 = 0.01;
/// How far ahead moving obstacles are predicted, straight on.
const HORIZON_S: f32 = 4.0;
/// Kept from moving obstacles, beside the two radii and what they move in 0.1 s.
const MARGIN_M: f32 = 0.05;
/// By so much more for each second ahead.
const MARGIN_RATE_MPS: f32 = 0.03;
/// What is slower than this can turn round within less time than the vehicle: so much more is kept from it where it stands, less the
/// faster it is, and so much more for each second ahead.
const TURNS_MPS: f32 = 1.0;
const TURNS_M: f32 = 0.4;
const TURNS_RATE_MPS: f32 = 0.2;
/// Clearance below which a velocity costs something.
const COMFORT_M: f32 = 0.3;
/// Cost of a hit.
const HIT_COST: f32 = 200.0;
/// Cost of no clearance.
const CLEARANCE_COST: f32 = 1.5;
/// Cost of another velocity than the last.
const CHANGE_COST: f32 = 0.05;

/// The stage, for a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evader {
    /// [`HORIZON_S`], or beyond the roll-out.
    horizon_s: f32,
    v_max_mps: f32,
    /// Largest speed while evading, at least `v_max_mps`.
    fast_mps: f32,
    a_max_mps2: f32,
    tick_s: f32,
    /// The vehicle's answer, see [`VehicleModel::twice_lagged`].
    dead_steps: usize,
    lag_s: f32,
    /// A step of the roll-out.
    step_s: f32,
}

/// The last choice.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    choice_ned_mps: Option<Horizontal>,
}

impl State {
    /// What the last step chose to fly; `None` where it passed what was asked for.
    #[must_use]
    pub const fn choice_ned_mps(&self) -> Option<Horizontal> {
        self.choice_ned_mps
    }
}

/// Input of a step.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// Position, local NED.
    pub position_ned_m: Horizontal,
    /// Velocity, local NED.
    pub velocity_ned_mps: Horizontal,
    /// The last command.
    pub command_ned_mps: Horizontal,
    /// The velocity between the two lags of the vehicle's answer.
    pub halfway_ned_mps: Horizontal,
    /// The commands that have not taken effect yet.
    pub underway: &'a vehicle_model::State,
    /// Standing obstacles nearby.
    pub standing: &'a [Neighbour],
    /// The fence where it is nearest, as an obstacle.
    pub fence: Option<Neighbour>,
    /// Moving obstacles nearby: those that a sensor reports as moving, and those that are tracked.
    pub moving: [&'a [Neighbour]; 2],
}

/// An obstacle at the time when the vehicle begins to obey.
#[derive(Clone, Copy, Debug)]
struct Other {
    at_m: Horizontal,
    velocity_mps: Horizontal,
    /// The two radii, what is kept from its centre, and by how much more a second.
    reach_m: f32,
    keep_m: f32,
    rate_mps: f32,
    /// Distance of its centre.
    away_m: f32,
}

/// The worst hit and the least clearance of one roll-out.
#[derive(Clone, Copy, Debug, Default)]
struct Foreseen {
    /// How much of the margin it takes, at most all, over how soon it is.
    hit_per_s: f32,
    closeness: f32,
}

impl Foreseen {
    fn cost(&self) -> f32 {
        HIT_COST * self.hit_per_s + CLEARANCE_COST * self.closeness
    }
}

impl Evader {
    /// For a vehicle with its limits of speed, cruising and evading, and of acceleration.
    #[must_use]
    pub fn new(vehicle_model: &VehicleModel, v_max_mps: f32, fast_mps: f32, a_max_mps2: f32) -> Self {
        let (dead_steps, lag_s) = vehicle_model.twice_lagged();
        let step_s = (TURN_S + 2.0 * LAGS * lag_s) / STEPS as f32;
        // Beyond the roll-out, however slow the vehicle is.
        let least_s = step_s * STEPS as f32 + STANDING_S;
        let horizon_s = if HORIZON_S > least_s { HORIZON_S } else { least_s };
        let tick_s = vehicle_model.tick_s();
        let fast_mps = if fast_mps > v_max_mps { fast_mps } else { v_max_mps };
        Self { horizon_s, v_max_mps, fast_mps, a_max_mps2, tick_s, dead_steps, lag_s, step_s }
    }

    /// The velocity to fly in place of the one that is asked for; `None`: that is clear of all that moves, or the least bad. The guard
    /// then holds it to what has been seen, as ever.
    #[inline(never)]
    pub fn step(&self, state: &mut State, asked: Horizontal, input: &Input<'_>) -> Option<Horizontal> {
        // What is not finite the guard brakes for.
        if !asked.is_finite() || input.moving.iter().all(|part| part.is_empty()) {
            *state = State::default();
            return None;
        }
        let asked = asked.clamped(self.v_max_mps);
        let from = self.obeys_from(input);
        let (start, dead_s) = (from.position, self.dead_steps as f32 * self.tick_s);
        let mut moving: Vec<Other, MOVERS_MAX> = Vec::new();
        for other in input.moving.into_iter().flatten() {
            let at_m = other.center_ned_m.plus(other.velocity_ned_mps.times(dead_s));
            let away_m = at_m.minus(start).norm();
            let reach_s = (away_m - other.reach_m) / (self.fast_mps + other.velocity_ned_mps.norm());
            if reach_s > self.horizon_s {
                continue;
            }
            let speed_mps = other.velocity_ned_mps.norm();
            let turns = if speed_mps < TURNS_MPS { 1.0 - speed_mps / TURNS_MPS } else { 0.0 };
            let rate_mps = MARGIN_RATE_MPS + TURNS_RATE_MPS * turns;
            let wanted_m = other.reach_m + MARGIN_M + TURNS_M * turns + EARLY_S * speed_mps + rate_mps * dead_s;
            // One that is too near already must not come nearer.
            let keep_m = if wanted_m < away_m - 0.01 { wanted_m } else { away_m - 0.01 };
            let velocity_mps = other.velocity_ned_mps;
            let one = Other { at_m, velocity_mps, reach_m: other.reach_m, keep_m, rate_mps, away_m };
            keep_nearest(&mut moving, one);
        }
        if moving.is_empty() {
            state.choice_ned_mps = None;
            return None;
        }
        if self.foresee(&from, asked, &moving, [&[]; 2], f32::INFINITY) <= 0.0 {
            state.choice_ned_mps = None;
            return None;
        }
        let mut standing: Vec<Other, STANDING_MAX> = Vec::new();
        let is_far =
            |away_m: f32, other: &Neighbour| away_m - other.reach_m > (self.turn_s() + STANDING_S) * self.fast_mps;
        for other in input.standing {
            let away_m = other.center_ned_m.minus(start).norm();
            if is_far(away_m, other) {
                continue;
            }
            // Hits of a moving obstacle.
            let is_part = |mover: &Other| {
                let near_m = mover.reach_m + PART_M;
                mover.at_m.minus(mover.velocity_mps.times(dead_s)).minus(other.center_ned_m).norm_squared()
                    < near_m * near_m
            };
            if moving.iter().any(is_part) {
                continue;
            }
            let wanted_m = other.reach_m + STANDING_M;
            let keep_m = if wanted_m < away_m - 0.01 { wanted_m } else { away_m - 0.01 };
            let velocity_mps = Horizontal::default();
            let at_m = other.center_ned_m;
            keep_nearest(
                &mut standing,
                Other { at_m, velocity_mps, reach_m: other.reach_m, keep_m, rate_mps: 0.0, away_m },
            );
        }
        let fence = input.fence.and_then(|side| {
            let away_m = side.center_ned_m.minus(start).norm();
            // Behind it already, it must not go farther out.
            let keep_m = if side.reach_m < away_m - 0.01 { side.reach_m } else { away_m - 0.01 };
            let (at_m, velocity_mps) = (side.center_ned_m, Horizontal::default());
            let other = Other { at_m, velocity_mps, reach_m: side.reach_m, keep_m, rate_mps: 0.0, away_m };
            (!is_far(away_m, &side)).then_some(other)
        });
        let still = [&standing[..], fence.as_slice()];
        let speed = asked.norm();
        let towards = if speed > 1e-3 { asked.times(1.0 / speed) } else { Horizontal::default() };
        let last = state.choice_ned_mps.unwrap_or(input.command_ned_mps);
        let (mut best, mut least) = (asked, f32::INFINITY);
        let cruise_mps = 1.001 * self.v_max_mps;
        let mut consider = |velocity: Horizontal| {
            let mut progress = if speed > 1e-3 {
                self.horizon_s * (1.0 - velocity.dot(towards) / speed)
            } else {
                velocity.norm() * self.horizon_s / self.v_max_mps
            };
            if velocity.norm_squared() > cruise_mps * cruise_mps {
                // Evading fast must not pay off as a way to arrive earlier.
                progress = FAST_COST + if progress > 0.0 { progress } else { 0.0 };
            }
            let given_up = progress + CHANGE_COST * velocity.minus(last).norm();
            if given_up < least {
                let cost = given_up + self.foresee(&from, velocity, &moving, still, least - given_up);
                if cost < least {
                    (best, least) = (velocity, cost);
                }
            }
        };
        consider(asked);
        consider(last.clamped(self.fast_mps));
        consider(Horizontal::default());
        let along = if speed > 1e-3 { towards } else { Horizontal { north: 1.0, east: 0.0 } };
        let (sine, cosine) = sin_cos(core::f32::consts::TAU / DIRECTIONS as f32);
        let mut direction = along;
        for _ in 0..DIRECTIONS {
            for share in SHARES {
                consider(direction.times(self.v_max_mps * share));
            }
            if self.fast_mps > cruise_mps {
                consider(direction.times(self.fast_mps));
            }
            direction = Horizontal {
                north: cosine * direction.north - sine * direction.east,
                east: sine * direction.north + cosine * direction.east,
            };
        }
        state.choice_ned_mps = Some(best);
        (best != asked).then_some(best)
    }

    /// How long the roll-out lasts.
    fn turn_s(&self) -> f32 {
        self.step_s * STEPS as f32
    }

    /// Where the vehicle is when it begins to obey the command of this step.
    fn obeys_from(&self, input: &Input<'_>) -> Start {
        let mut start = Start {
            position: input.position_ned_m,
            velocity: input.velocity_ned_mps,
            halfway: input.halfway_ned_mps,
            command: input.command_ned_mps,
        };
        for steps in (0..self.dead_steps).rev() {
            start.fly(input.underway.ago(steps), self.lag_s, self.tick_s);
        }
        start
    }

    /// Predicts a flight at one velocity: what its hits and clearance cost, or at least so much as to be no better than the best.
    #[inline(never)]
    fn foresee(&self, from: &Start, velocity: Horizontal, moving: &[Other], still: [&[Other]; 2], least: f32) -> f32 {
        let (mut legs, mut flown) = ([Leg::default(); STEPS], *from);
        for leg in &mut legs {
            let change = velocity.minus(flown.command).clamped(self.a_max_mps2 * self.step_s);
            let (at, mean) = (flown.position, flown.command.plus(change.times(0.5)));
            flown.command = flown.command.plus(change);
            flown.fly(mean, self.lag_s, self.step_s);
            *leg = Leg { at, velocity: flown.velocity };
        }
        let rolled_s = self.turn_s();
        // What the lags and the limit of acceleration still keep back.
        let lagging = flown.velocity.plus(flown.halfway).minus(velocity.times(2.0)).times(self.lag_s);
        let missing = flown.command.minus(velocity);
        let kept_back = lagging.plus(missing.times(0.5 * missing.norm() / self.a_max_mps2));
        let last = Leg { at: flown.position.plus(kept_back), velocity };
        let mut foreseen = Foreseen::default();
        let [standing, fence] = still;
        for (others, lasts_s) in [(moving, self.horizon_s - rolled_s), (standing, STANDING_S), (fence, STANDING_S)] {
            for other in others {
                let mut begun_s = 0.0;
                for leg in &legs {
                    self.meet(other, leg, begun_s, self.step_s, &mut foreseen);
                    begun_s += self.step_s;
                }
                self.meet(other, &last, rolled_s, lasts_s, &mut foreseen);
                // It only grows with the others.
                if foreseen.cost() >= least {
                    return foreseen.cost();
                }
            }
        }
        foreseen.cost()
    }

    /// One straight leg against one other.
    fn meet(&self, other: &Other, leg: &Leg, begun_s: f32, lasts_s: f32, foreseen: &mut Foreseen) {
        if foreseen.hit_per_s * (HIT_S + begun_s) >= 1.0 {
            return;
        }
        let apart = leg.at.minus(other.at_m.plus(other.velocity_mps.times(begun_s)));
        let speed = leg.velocity.minus(other.velocity_mps);
        let (square, along) = (speed.norm_squared(), apart.dot(speed));
        let nearest_s = if square > 1e-9 { between(-along / square, 0.0, lasts_s) } else { 0.0 };
        let at_nearest = apart.plus(speed.times(nearest_s));
        let keep_m = other.keep_m + other.rate_mps * (begun_s + nearest_s);
        let far_m = keep_m + COMFORT_M;
        let squared = at_nearest.norm_squared();
        if squared >= far_m * far_m {
            return;
        }
        let clearance_m = sqrt(squared) - keep_m;
        if clearance_m < 0.0 {
            // When the circle is entered.
            let within = along * along - square * (apart.norm_squared() - keep_m * keep_m);
            let enters_s = if square > 1e-9 && within > 0.0 { (-along - sqrt(within)) / square } else { 0.0 };
            let hit_s = begun_s + if enters_s > 0.0 { enters_s } else { 0.0 };
            let margin_m = if keep_m - other.reach_m > MARGIN_MIN_M { keep_m - other.reach_m } else { MARGIN_MIN_M };
            let share = if clearance_m < -margin_m { 1.0 } else { -clearance_m / margin_m };
            let hit_per_s = share / (HIT_S + hit_s);
            if hit_per_s > foreseen.hit_per_s {
                foreseen.hit_per_s = hit_per_s;
            }
        }
        let closeness = (1.0 - clearance_m / COMFORT_M) / (1.0 + 0.7 * (begun_s + nearest_s));
        if closeness > foreseen.closeness {
            foreseen.closeness = closeness;
        }
    }
}

/// Adds one; when the list is full it replaces the farthest.
fn keep_nearest<const M: usize>(others: &mut Vec<Other, M>, one: Other) {
    let Err(one) = others.push(one) else { return };
    if let Some(last) = others.iter_mut().max_by(|a, b| a.away_m.total_cmp(&b.away_m))
        && one.away_m < last.away_m
    {
        *last = one;
    }
}

/// Where the vehicle is when it begins to obey, and the command that is changed then.
#[derive(Clone, Copy, Debug)]
struct Start {
    position: Horizontal,
    velocity: Horizontal,
    /// Between the two lags.
    halfway: Horizontal,
    command: Horizontal,
}

impl Start {
    /// One step under a command, so that each lag keeps back as much in all as in small steps.
    fn fly(&mut self, command: Horizontal, lag_s: f32, step_s: f32) {
        let share = step_s / (step_s + lag_s);
        self.halfway = self.halfway.plus(command.minus(self.halfway).times(share));
        self.velocity = self.velocity.plus(self.halfway.minus(self.velocity).times(share));
        self.position = self.position.plus(self.velocity.times(step_s));
    }
}

/// A straight piece of the roll-out.
#[derive(Clone, Copy, Debug, Default)]
struct Leg {
    at: Horizontal,
    velocity: Horizontal,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::base::units::wrap_pi;
    use crate::control::guard::Setpoint;
    use crate::control::vehicle::Vehicle;

    const TICK_S: f32 = 0.02;
    const REACH_M: f32 = 0.45;

    fn at(bearing_rad: f32, away_m: f32) -> Horizontal {
        Horizontal::from_bearing(wrap_pi(bearing_rad)).times(away_m)
    }

    /// The least distance from a walker, of a vehicle of ArduCopter's delays that is asked for a velocity.
    fn least_m(fast_mps: f32, asked: Horizontal, from: Horizontal, walk_mps: Horizontal) -> f32 {
        let vehicle_model = vehicle_model::Config::default().build(TICK_S).unwrap();
        let evader = Evader::new(&vehicle_model, 1.0, fast_mps, 2.0);
        let (mut state, mut underway) = (State::default(), vehicle_model::State::default());
        let mut vehicle = Vehicle::new(Horizontal::default(), 4, 0.45);
        let (mut command, mut halfway, mut walker) = (Horizontal::default(), Horizontal::default(), from);
        let mut least_m = f32::INFINITY;
        for _ in 0..300 {
            let moving = [Neighbour { center_ned_m: walker, reach_m: REACH_M, velocity_ned_mps: walk_mps }];
            let input = Input {
                position_ned_m: vehicle.position,
                velocity_ned_mps: vehicle.velocity,
                command_ned_mps: command,
                halfway_ned_mps: halfway,
                underway: &underway,
                standing: &[],
                fence: None,
                moving: [&moving, &[]],
            };
            let wanted = evader.step(&mut state, asked, &input).unwrap_or(asked);
            command = command.plus(wanted.minus(command).clamped(2.0 * TICK_S));
            halfway = halfway.plus(underway.ago(evader.dead_steps).minus(halfway).times(TICK_S / evader.lag_s));
            vehicle_model.command(&mut underway, command);
            let velocity_ned_mps = crate::base::ned::Ned { north: command.north, east: command.east, down: 0.0 };
            vehicle.follow(&Setpoint { velocity_ned_mps, ..Setpoint::default() });
            walker = walker.plus(walk_mps.times(TICK_S));
            least_m = f32::min(least_m, walker.minus(vehicle.position).norm());
        }
        least_m
    }

    #[test]
    fn who_walks_up_to_a_vehicle_that_hovers_or_flies_does_not_meet_it_from_wherever_he_comes() {
        for direction in 0..24 {
            let bearing_rad = direction as f32 * core::f32::consts::TAU / 24.0;
            for asked in [Horizontal::default(), Horizontal { north: 1.0, east: 0.0 }] {
                // He walks to where it would be.
                let from = at(bearing_rad, 5.0);
                let walk_mps = from.times(-1.0 / 3.0).plus(asked.times(0.8));
                let least_m = least_m(1.0, asked, from, walk_mps);
                assert!(least_m > REACH_M, "{bearing_rad} {asked:?}: {least_m}");
            }
        }
    }

    #[test]
    fn of_those_who_are_seen_late_fewer_are_met_where_it_may_evade_faster() {
        let [slow, fast] = [1.0, 2.0].map(|fast_mps| {
            let walks = (0..8).flat_map(|k| [1.2, 1.4, 1.6, 1.8, 2.0].map(|away_m| (k as f32, away_m)));
            let meets = |(k, away_m): &(f32, f32)| {
                let from = at(k * core::f32::consts::TAU / 8.0, *away_m);
                least_m(fast_mps, Horizontal::default(), from, from.times(-1.5 / away_m)) < REACH_M
            };
            walks.filter(meets).count()
        });
        assert!(slow > 0 && fast < slow, "{slow} {fast}");
    }

    #[test]
    fn what_is_clear_of_all_that_moves_passes_and_so_does_what_is_not_finite() {
        let vehicle_model = vehicle_model::Config::default().build(TICK_S).unwrap();
        let evader = Evader::new(&vehicle_model, 1.0, 2.0, 2.0);
        let (underway, north) = (vehicle_model::State::default(), Horizontal { north: 1.0, east: 0.0 });
        let away = [Neighbour { center_ned_m: at(3.0, 2.0), reach_m: REACH_M, velocity_ned_mps: at(3.0, 1.0) }];
        let input = Input {
            position_ned_m: Horizontal::default(),
            velocity_ned_mps: Horizontal::default(),
            command_ned_mps: Horizontal::default(),
            halfway_ned_mps: Horizontal::default(),
            underway: &underway,
            standing: &[],
            fence: None,
            moving: [&[], &away],
        };
        assert_eq!(evader.step(&mut State::default(), north, &input), None);
        let nowhere = Horizontal { north: f32::NAN, east: 0.0 };
        assert_eq!(evader.step(&mut State::default(), nowhere, &input), None);
    }

    #[test]
    fn in_any_crowd_the_answer_is_finite_and_within_the_speed_limit() {
        let vehicle_model = vehicle_model::Config { dead_time_s: 0.06, lag_s: 0.15 }.build(TICK_S).unwrap();
        let [slow, fast] = [0.0, 2.5].map(|fast_mps| Evader::new(&vehicle_model, 1.5, fast_mps, 2.0));
        let (underway, mut state, mut rng) = (vehicle_model::State::default(), State::default(), Rng::new(24, 0));
        let (mut evaded, mut faster, mut kept) = (0, 0, 0);
        for number in 0..2_000 {
            // The previous choice may exceed the limit; the answer must not.
            let (evader, most_mps) = if number % 2 == 0 { (&slow, 1.5) } else { (&fast, 2.5) };
            let mut draw = |most: f32| at(6.3 * rng.uniform(), most * rng.uniform());
            let one = |center_ned_m, velocity_ned_mps| Neighbour { center_ned_m, reach_m: REACH_M, velocity_ned_mps };
            let moving: std::vec::Vec<_> = (0..40).map(|_| one(draw(4.0), draw(2.0))).collect();
            let standing: std::vec::Vec<_> = (0..60).map(|_| one(draw(4.0), Horizontal::default())).collect();
            let input = Input {
                position_ned_m: draw(1.0),
                velocity_ned_mps: draw(1.5),
                command_ned_mps: draw(1.5),
                halfway_ned_mps: draw(1.5),
                underway: &underway,
                standing: &standing,
                fence: None,
                moving: [&moving[..20], &moving[20..]],
            };
            let asked = draw(3.0);
            let answer = evader.step(&mut state, asked, &input);
            if let (None, Some(choice)) = (answer, state.choice_ned_mps()) {
                // The guard is to hold what was asked for to what has been seen.
                kept += 1;
                assert_eq!(choice, asked.clamped(f32::min(most_mps, 1.5)));
            }
            if let Some(velocity) = answer {
                evaded += 1;
                faster += usize::from(velocity.norm() > 1.6);
                assert!(velocity.is_finite() && velocity.norm() <= most_mps * 1.001, "{velocity:?}");
            }
        }
        assert!(evaded > 1_000 && faster > 50 && kept > 10, "{evaded} {faster} {kept}");
    }
}
