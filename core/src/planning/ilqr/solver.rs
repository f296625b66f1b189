//! The iteration: a quadratic model in a backward pass, a rollout in a forward pass (differential dynamic programming
//! with an interior point, after A. Pavlov, I. Shames, C. Manzie, "Interior point differential dynamic programming",
//! 2021).
//!
//! A control changes the position only, and the measurement depends on the position after it. So all functions of the
//! state before and the control are functions of the position after and of the covariance before. The model is built in
//! these two and split at the end: the derivatives by the position before and by the control are equal.
//!
//! An inequality with slack (room) `y > 0` has a barrier `-mu ln y` and a dual `l`; its curvature in the model is
//! `l / y`, as in the paper's perturbed complementarity `l y = mu`. Below a small slack the logarithm is continued as a
//! parabola, so that the initial path may go through obstacles: it is pushed out, and does not enter again.
//!
//! Unlike the paper's solver, the model includes the second derivatives of the covariance update (they are cheap): the
//! trace is linear in the covariance, so that without them the model does not show how far to bend the path.

use crate::base::obstacle::Obstacle;

use super::clearance::{NEAREST, Near, deviation};
use super::sensor::{Sensor, Slopes, at, dot};
use super::{Bound, Planner, Step};

/// The problem and the parameters of a solve.
pub(super) struct Search<'a, const L: usize> {
    pub(super) planner: &'a Planner,
    pub(super) sensor: Sensor<L>,
    pub(super) start: [f32; 2],
    pub(super) goal: [f32; 2],
    pub(super) obstacles: &'a [Obstacle],
    /// Diagonal of `T`.
    pub(super) weight: [f32; L],
    /// Weight of the barrier.
    pub(super) mu: f32,
    /// Slack below which the barrier is a parabola.
    pub(super) delta_m: f32,
    pub(super) inverse_delta: f32,
    /// Regularisation: added to the curvature by the control.
    pub(super) rho: f32,
}

/// The control law of a step: its response to a change of the state before it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Law<const M: usize> {
    pub(super) feedforward: [f32; 2],
    pub(super) by_place: [[f32; 2]; 2],
    pub(super) by_covariance: [[f32; M]; 2],
}

impl<const M: usize> Law<M> {
    pub(super) const ZERO: Self = Self { feedforward: [0.0; 2], by_place: [[0.0; 2]; 2], by_covariance: [[0.0; M]; 2] };
}

/// Result of the backward pass.
pub(super) struct Model {
    /// Cost and barriers of the present path.
    pub(super) merit: f32,
    /// First-order decrease of a whole step.
    pub(super) decrease: f32,
    /// Smallest slack to an obstacle.
    pub(super) room_m: f32,
    /// Largest dual of an obstacle.
    pub(super) dual: f32,
}

/// The sum of the logarithms of many slacks: they are multiplied, and the logarithm of the product is taken only when
/// it becomes very large or small. They come in small groups whose product fits in an `f32`.
struct Product {
    product: f32,
    sum: f32,
}

impl Product {
    const fn new() -> Self {
        Self { product: 1.0, sum: 0.0 }
    }

    #[inline]
    fn times(&mut self, room: f32) {
        self.product *= room;
        if !(self.product > 1e-15 && self.product < 1e15) {
            self.sum += libm::logf(self.product);
            self.product = 1.0;
        }
    }

    fn logarithm(&self) -> f32 {
        self.sum + libm::logf(self.product)
    }
}

/// The cost-to-go, as a quadratic function around the path: `p` the position, `c` the covariance.
struct Value<const M: usize> {
    p: [f32; 2],
    c: [f32; M],
    pp: [f32; 3],
    pc: [[f32; M]; 2],
    cc: [[f32; M]; M],
}

impl<const M: usize> Value<M> {
    const NOTHING: Self = Self { p: [0.0; 2], c: [0.0; M], pp: [0.0; 3], pc: [[0.0; M]; 2], cc: [[0.0; M]; M] };

    /// The same value as a function of the covariance before the update; the position is still that after the control.
    #[inline]
    fn before<const L: usize>(&self, slopes: &Slopes<'_, L>) -> Self {
        let by_place: [[f32; M]; 2] = slopes.by_place();
        let c = slopes.pull(&self.c);
        let curvature = slopes.curvature(&self.c);

        // cc C, by columns, and pc + (cc C)'.
        let bent = by_place.map(|column| self.cc.map(|row| dot(&row, &column)));
        let p = [0, 1].map(|j| self.p[j] + dot(&self.c, &by_place[j]));
        let pp = [(0, 0, 0), (0, 1, 1), (1, 1, 2)].map(|(j, k, entry)| {
            let mixed = dot(&self.pc[j], &by_place[k]) + dot(&self.pc[k], &by_place[j]);
            self.pp[entry] + mixed + dot(&by_place[j], &bent[k]) + curvature.place[entry]
        });
        let mut pc = curvature.mixed;
        for j in 0..2 {
            let mut weight = bent[j];
            add(&mut weight, &self.pc[j]);
            add(&mut pc[j], &slopes.pull(&weight));
        }
        let rows = self.cc.map(|row| slopes.pull(&row));
        let mut cc = [[0.0; M]; M];
        for j in 0..M {
            let column = slopes.pull(&rows.map(|row| row[j]));
            for i in 0..j {
                cc[i][j] = column[i];
                cc[j][i] = column[i];
            }
            cc[j][j] = column[j];
        }
        Self { p, c, pp, pc, cc }
    }

    /// Substitutes the control by its law.
    #[inline]
    fn close(&mut self, law: &Law<M>, slope: [f32; 2]) {
        let k = &law.by_place;
        let left = &law.by_covariance;
        let pp = self.pp;
        for j in 0..2 {
            self.p[j] += k[0][j] * slope[0] + k[1][j] * slope[1];
        }
        self.pp[0] += pp[0] * k[0][0] + pp[1] * k[1][0];
        self.pp[1] += pp[0] * k[0][1] + pp[1] * k[1][1];
        self.pp[2] += pp[1] * k[0][1] + pp[2] * k[1][1];
        for i in 0..M {
            self.c[i] += left[0][i] * slope[0] + left[1][i] * slope[1];
            let mixed = [self.pc[0][i], self.pc[1][i]];
            for j in 0..i {
                self.cc[j][i] += mixed[0] * left[0][j] + mixed[1] * left[1][j];
                self.cc[i][j] = self.cc[j][i];
            }
            self.cc[i][i] += mixed[0] * left[0][i] + mixed[1] * left[1][i];
        }
        for i in 0..M {
            self.pc[0][i] += pp[0] * left[0][i] + pp[1] * left[1][i];
            self.pc[1][i] += pp[1] * left[0][i] + pp[2] * left[1][i];
        }
    }
}

#[inline]
fn add<const M: usize>(to: &mut [f32; M], what: &[f32; M]) {
    for (to, what) in to.iter_mut().zip(what) {
        *to += what;
    }
}

impl<const L: usize> Search<'_, L> {
    /// The number whose logarithm is the barrier of a slack; where the barrier is a parabola, its value is added.
    #[inline]
    fn barrier(&self, room: f32, barriers: &mut Barriers) -> f32 {
        if room > self.delta_m {
            room
        } else {
            let past = room * self.inverse_delta - 2.0;
            barriers.parabolas += 0.5 * past * past - 0.5;
            self.delta_m
        }
    }

    /// Continues the logarithm to a smaller slack.
    pub(super) fn steepen(&mut self, delta_m: f32) {
        (self.delta_m, self.inverse_delta) = (delta_m, 1.0 / delta_m);
    }

    fn merit(&self, cost: f32, barriers: &Barriers) -> f32 {
        cost + self.mu * (barriers.parabolas - barriers.rooms.logarithm())
    }

    #[inline]
    fn trace<const M: usize>(&self, covariance: &[f32; M]) -> f32 {
        let mut sum = 0.0;
        for a in 0..L {
            sum += self.weight[a] * covariance[at(a, a)];
        }
        sum
    }

    /// Builds the model around the path, and the control laws from it. `None` if it has no minimum.
    pub(super) fn backward<const M: usize>(
        &self,
        path: &[Step<M>],
        first: &[f32; M],
        near: &[Near],
        duals: &[[f32; NEAREST]],
        bounds: &[[f32; 2]],
        laws: &mut [Law<M>],
    ) -> Option<Model> {
        let config = &self.planner.config;
        let mut value = Value::<M>::NOTHING;
        let (mut cost, mut barriers) = (0.0, Barriers::new());
        let mut model = Model { merit: 0.0, decrease: 0.0, room_m: 1e9, dual: 0.0 };
        if let Some(last) = path.last() {
            let q = config.q_terminal;
            let away = [last.place_ned_m.north - self.goal[0], last.place_ned_m.east - self.goal[1]];
            cost += q * (away[0] * away[0] + away[1] * away[1]);
            value.p = away.map(|away| 2.0 * q * away);
            value.pp = [2.0 * q, 0.0, 2.0 * q];
        }
        for index in (0..path.len()).rev() {
            let step = path.get(index)?;
            let (near, duals, bound) = (near.get(index)?, duals.get(index)?, bounds.get(index)?);
            let place = [step.place_ned_m.north, step.place_ned_m.east];
            let before = match index.checked_sub(1) {
                Some(before) => &path.get(before)?.covariance_m2,
                None => first,
            };
            cost += self.trace(&step.covariance_m2);
            for a in 0..L {
                value.c[at(a, a)] += self.weight[a];
            }
            self.add_obstacles(&mut value, &mut barriers, &mut model, step, near, duals);

            value = value.before(&self.sensor.slopes(before, place));
            let (law, terms) = self.control(&value, step.control_m, *bound, &mut barriers)?;
            cost += terms.cost;
            model.decrease -= law.feedforward[0] * terms.slope[0] + law.feedforward[1] * terms.slope[1];
            value.close(&law, terms.slope);
            *laws.get_mut(index)? = law;
        }
        model.merit = self.merit(cost, &barriers);
        model.merit.is_finite().then_some(model)
    }

    /// Adds the obstacles around a step to the value at it.
    #[inline]
    fn add_obstacles<const M: usize>(
        &self,
        value: &mut Value<M>,
        barriers: &mut Barriers,
        model: &mut Model,
        step: &Step<M>,
        near: &Near,
        duals: &[f32; NEAREST],
    ) {
        let place = [step.place_ned_m.north, step.place_ned_m.east];
        let (width, by) = self.width(&step.covariance_m2);
        let (mut pushes, mut stiffnesses, mut crossed, mut product) = (0.0, 0.0, [0.0; 2], 1.0);
        for (number, dual) in duals.iter().enumerate() {
            let Some((room, away)) = near.room(number, self.obstacles, place) else { break };
            let room = room - width;
            product *= self.barrier(room, barriers);
            if room < model.room_m {
                model.room_m = room;
            }
            let (push, stiffness) = if room > self.delta_m {
                let inverse = 1.0 / room;
                (self.mu * inverse, dual * inverse)
            } else {
                let stiffness = self.mu * self.inverse_delta * self.inverse_delta;
                (stiffness * (2.0 * self.delta_m - room), stiffness)
            };
            if *dual > model.dual {
                model.dual = *dual;
            }
            pushes += push;
            stiffnesses += stiffness;
            let stiff = away.map(|away| stiffness * away);
            for j in 0..2 {
                value.p[j] -= push * away[j];
                crossed[j] += stiff[j];
            }
            value.pp[0] += stiff[0] * away[0];
            value.pp[1] += stiff[0] * away[1];
            value.pp[2] += stiff[1] * away[1];
        }
        barriers.rooms.times(product);
        if self.planner.config.n_std > 0.0 {
            for i in 0..3 {
                value.c[i] += pushes * by[i];
                for j in 0..2 {
                    value.pc[j][i] -= crossed[j] * by[i];
                }
                let stiff = stiffnesses * by[i];
                for k in 0..3 {
                    value.cc[i][k] += stiff * by[k];
                }
            }
        }
    }

    /// How far the covariance widens the obstacles, and the derivative.
    #[inline]
    pub(super) fn width<const M: usize>(&self, covariance: &[f32; M]) -> (f32, [f32; 3]) {
        let config = &self.planner.config;
        if config.n_std > 0.0 {
            let (width, by) = deviation([covariance[0], covariance[1], covariance[2]]);
            (config.n_std * width, by.map(|by| config.n_std * by))
        } else {
            (0.0, [0.0; 3])
        }
    }

    /// The control's own terms, and the resulting law.
    #[inline]
    fn control<const M: usize>(
        &self,
        value: &Value<M>,
        control: [f32; 2],
        duals: [f32; 2],
        barriers: &mut Barriers,
    ) -> Option<(Law<M>, Terms)> {
        let config = &self.planner.config;
        let r = config.r_control;
        let mut slope = [2.0 * r * control[0] + value.p[0], 2.0 * r * control[1] + value.p[1]];
        let stiff = 2.0 * r + self.rho;
        let mut curve = [value.pp[0] + stiff, value.pp[1], value.pp[2] + stiff];
        let by_room = -2.0 * self.planner.inverse_u_max2;
        let rooms = self.planner.rooms(control);
        match config.bound {
            Bound::Axes => {
                for j in 0..2 {
                    let push = self.mu / rooms[j];
                    let slip = by_room * control[j];
                    barriers.rooms.times(rooms[j]);
                    slope[j] -= push * slip;
                    curve[2 * j] += duals[j] / rooms[j] * slip * slip - push * by_room;
                }
            }
            Bound::Norm => {
                let push = self.mu / rooms[0];
                let slip = control.map(|control| by_room * control);
                barriers.rooms.times(rooms[0]);
                slope[0] -= push * slip[0];
                slope[1] -= push * slip[1];
                let stiffness = duals[0] / rooms[0];
                curve[0] += stiffness * slip[0] * slip[0] - push * by_room;
                curve[1] += stiffness * slip[0] * slip[1];
                curve[2] += stiffness * slip[1] * slip[1] - push * by_room;
            }
        }
        let determinant = curve[0] * curve[2] - curve[1] * curve[1];
        // Positive definite, by more than rounding errors.
        if !(curve[0] > 0.0 && curve[2] > 0.0 && determinant > 1e-6 * curve[0] * curve[2]) {
            return None;
        }
        let scale = -1.0 / determinant;
        let inverse = [curve[2] * scale, -curve[1] * scale, curve[0] * scale];
        let solve = |x: f32, y: f32| [inverse[0] * x + inverse[1] * y, inverse[1] * x + inverse[2] * y];
        let mut law = Law::ZERO;
        law.feedforward = solve(slope[0], slope[1]);
        let (left, right) = (solve(value.pp[0], value.pp[1]), solve(value.pp[1], value.pp[2]));
        law.by_place = [[left[0], right[0]], [left[1], right[1]]];
        for m in 0..M {
            let [first, second] = solve(value.pc[0][m], value.pc[1][m]);
            law.by_covariance[0][m] = first;
            law.by_covariance[1][m] = second;
        }
        let cost = r * (control[0] * control[0] + control[1] * control[1]);
        Some((law, Terms { slope, cost }))
    }

    /// Rolls the laws out into `trial`, with a share of their feedforward; returns its merit, or `None` if a step moved
    /// too far or the merit is not finite.
    pub(super) fn forward<const M: usize>(
        &self,
        path: &[Step<M>],
        trial: &mut [Step<M>],
        first: &[f32; M],
        near: &[Near],
        laws: &[Law<M>],
        share: f32,
    ) -> Option<f32> {
        let config = &self.planner.config;
        let (mut place, mut covariance) = (self.start, *first);
        let (mut off, mut off_covariance) = ([0.0; 2], [0.0; M]);
        let (mut cost, mut barriers) = (0.0, Barriers::new());
        for (((step, trial), near), law) in path.iter().zip(trial.iter_mut()).zip(near).zip(laws) {
            let mut control = step.control_m;
            for j in 0..2 {
                let mut answer = share * law.feedforward[j] + law.by_place[j][0] * off[0] + law.by_place[j][1] * off[1];
                for m in 0..M {
                    answer += law.by_covariance[j][m] * off_covariance[m];
                }
                control[j] += answer;
            }
            let control = self.planner.bounded(control, step.control_m);
            place = [place[0] + control[0], place[1] + control[1]];
            if !near.holds(place, 1.0) {
                return None;
            }
            covariance = self.sensor.update(&covariance, place);
            off = [place[0] - step.place_ned_m.north, place[1] - step.place_ned_m.east];
            for m in 0..M {
                off_covariance[m] = covariance[m] - step.covariance_m2[m];
            }
            let (width, _) = self.width(&covariance);
            let mut product = 1.0;
            for number in 0..NEAREST {
                let Some((room, _)) = near.room(number, self.obstacles, place) else { break };
                trial.rooms_m[number] = room - width;
                product *= self.barrier(room - width, &mut barriers);
            }
            let rooms = self.planner.rooms(control);
            barriers.rooms.times(product * rooms[0] * rooms[1]);
            cost += config.r_control * (control[0] * control[0] + control[1] * control[1]) + self.trace(&covariance);
            trial.place_ned_m.north = place[0];
            trial.place_ned_m.east = place[1];
            trial.control_m = control;
            trial.covariance_m2 = covariance;
        }
        let away = [place[0] - self.goal[0], place[1] - self.goal[1]];
        cost += config.q_terminal * (away[0] * away[0] + away[1] * away[1]);
        let merit = self.merit(cost, &barriers);
        merit.is_finite().then_some(merit)
    }

    /// The cost (eq. 10 and 13) of a path.
    pub(super) fn cost<const M: usize>(&self, path: &[Step<M>]) -> f32 {
        let config = &self.planner.config;
        let mut cost = 0.0;
        for step in path {
            let [north, east] = step.control_m;
            cost += config.r_control * (north * north + east * east) + self.trace(&step.covariance_m2);
        }
        if let Some(last) = path.last() {
            let away = [last.place_ned_m.north - self.goal[0], last.place_ned_m.east - self.goal[1]];
            cost += config.q_terminal * (away[0] * away[0] + away[1] * away[1]);
        }
        cost
    }

    /// Updates the duals after an accepted step: Newton's step of `l y = mu`, limited to a factor around the barrier's
    /// value.
    pub(super) fn move_duals<const M: usize>(
        &self,
        from: &[Step<M>],
        to: &[Step<M>],
        duals: &mut [[f32; NEAREST]],
        bounds: &mut [[f32; 2]],
    ) {
        for (((from, to), duals), bounds) in from.iter().zip(to).zip(duals).zip(bounds) {
            for ((dual, old), new) in duals.iter_mut().zip(from.rooms_m).zip(to.rooms_m) {
                let least = |room: f32| if room > self.delta_m { room } else { self.delta_m };
                *dual = self.dual(*dual, least(old), least(new));
            }
            let (old, new) = (self.planner.rooms(from.control_m), self.planner.rooms(to.control_m));
            for ((dual, old), new) in bounds.iter_mut().zip(old).zip(new) {
                *dual = self.dual(*dual, old, new);
            }
        }
    }

    #[inline]
    fn dual(&self, dual: f32, old: f32, new: f32) -> f32 {
        const APART: f32 = 8.0;
        let central = self.mu / new;
        let moved = (self.mu - dual * (new - old)) / old;
        crate::base::units::between(moved, central * (1.0 / APART), central * APART)
    }
}

/// Sum of the barriers.
struct Barriers {
    rooms: Product,
    parabolas: f32,
}

impl Barriers {
    const fn new() -> Self {
        Self { rooms: Product::new(), parabolas: 0.0 }
    }
}

/// The control's contribution.
struct Terms {
    /// Derivative of the cost-to-go by the control.
    slope: [f32; 2],
    cost: f32,
}
