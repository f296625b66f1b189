//! A local frame that stays continuous when the autopilot's jumps.
//!
//! An autopilot corrects its estimate in steps: the position moves by metres between two messages, or the heading turns
//! by tens of degrees, while the vehicle does neither. What guidance remembers (obstacles, the source, its plan) would
//! be metres off. So guidance works in a frame of its own, called ours, in which the vehicle's track is continuous.
//! This file keeps the rotation and the shift between the two frames:
//!
//! ```text
//!  ours = turn back (autopilot's) + shift         velocities for the autopilot = turn (ours)
//! ```
//!
//! A position is a jump when it is farther from where the last one led than `max(0.15 m, 3 v dt + 0.1 m)`, with `v` the
//! faster of the two speeds, and than five times the noise: noise that is hidden when it goes one way and not when it comes back would
//! move our frame. A position that is told again, bit for bit, is an estimate that comes less often than its messages: the way is summed up
//! until it changes. Noise comes back: what one position is off by is made up for by the next. Steps that go on in one direction are
//! none. Or it is one when a message says so (`ODOMETRY.reset_counter`, a new
//! `GPS_GLOBAL_ORIGIN`). A heading is a jump when it is more than 10 degrees from where the yaw rate led. Until the first jump
//! both frames are the same, to the bit.

use foxhound_core::base::math::sqrt;
use foxhound_core::base::ned::Ned;
use foxhound_core::base::units::{sin_cos, wrap_pi};

const STEP_MIN_M: f32 = 0.15;
const STEP_PER_WAY: f32 = 3.0;
const STEP_MARGIN_M: f32 = 0.1;
/// The least where no velocities are reported.
const BLIND_STEP_MIN_M: f32 = 1.0;
/// Of the mean square of what positions are off by and come back from: its weight, and how many roots of it are a jump.
const NOISE_WEIGHT: f32 = 1.0 / 16.0;
const NOISES: f32 = 5.0;
/// After a longer gap a change of position is not taken for a jump.
pub(crate) const PLACE_GAP_MAX_S: f32 = 2.0;
/// A position that stands for longer is frozen.
const STANDS_MAX_S: f32 = 0.5;
const TURN_MIN_RAD: f32 = 10.0 * core::f32::consts::PI / 180.0;
/// After a longer gap a change of heading is not taken for a jump.
const HEADING_GAP_MAX_S: f32 = 0.5;

/// The rotation and shift between the autopilot's local frame and ours.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Continuity {
    turn_rad: f32,
    sin: f32,
    cos: f32,
    shift_m: Ned,
    /// Mean square of how far a position was off from where the last one led, as far as the next came back; a jump counts as the limit.
    noise_m2: f32,
    off_m: Ned,
    /// Since the position last changed: the time, and how far the velocity has led.
    stood_s: f32,
    led_m: Ned,
    /// Whether there was a jump at all.
    differs: bool,
    /// A message said that the next position, or the next heading, begins anew.
    place_is_new: bool,
    heading_is_new: bool,
}

/// From one position to the next.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Displacement {
    pub(crate) from_m: Ned,
    pub(crate) to_m: Ned,
    pub(crate) from_mps: Ned,
    pub(crate) to_mps: Ned,
    pub(crate) dt_s: f32,
}

/// From one heading to the next.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Turn {
    pub(crate) from_rad: f32,
    pub(crate) to_rad: f32,
    pub(crate) dt_s: f32,
    /// The yaw rate in between.
    pub(crate) rate_radps: f32,
    /// How much faster it may have been.
    pub(crate) unknown_radps: f32,
}

impl Continuity {
    /// The same frame.
    pub(crate) const fn new() -> Self {
        Self {
            turn_rad: 0.0,
            sin: 0.0,
            cos: 1.0,
            shift_m: Ned { north: 0.0, east: 0.0, down: 0.0 },
            noise_m2: 0.0,
            off_m: Ned { north: 0.0, east: 0.0, down: 0.0 },
            stood_s: 0.0,
            led_m: Ned { north: 0.0, east: 0.0, down: 0.0 },
            differs: false,
            place_is_new: false,
            heading_is_new: false,
        }
    }

    /// The autopilot has reported that its estimate jumps: the next position, and the heading, are taken to be where
    /// the last ones were.
    #[inline(never)]
    pub(crate) fn expect_new(&mut self, heading: bool) {
        self.place_is_new = true;
        self.heading_is_new |= heading;
    }

    /// Follows the autopilot from one position to the next; returns how far it jumped, if it did.
    #[inline(never)]
    pub(crate) fn follow_place(&mut self, moved: &Displacement) -> Option<f32> {
        let Displacement { from_m, to_m, from_mps, to_mps, dt_s } = *moved;
        let is_new = core::mem::take(&mut self.place_is_new);
        let is_gap = dt_s > PLACE_GAP_MAX_S;
        if is_gap {
            (self.stood_s, self.led_m) = (0.0, Ned::default());
        }
        if is_gap && !is_new {
            return None;
        }
        // Over a gap before a new beginning the motion is unknown, so it is not extrapolated.
        let dt_s = if is_gap { 0.0 } else { dt_s };
        let (stood_s, led_m) = (core::mem::take(&mut self.stood_s), core::mem::take(&mut self.led_m));
        let led_m = Ned {
            north: led_m.north + 0.5 * (from_mps.north + to_mps.north) * dt_s,
            east: led_m.east + 0.5 * (from_mps.east + to_mps.east) * dt_s,
            down: led_m.down + 0.5 * (from_mps.down + to_mps.down) * dt_s,
        };
        let dt_s = stood_s + dt_s;
        if to_m == from_m && !is_new {
            if dt_s <= STANDS_MAX_S {
                (self.stood_s, self.led_m) = (dt_s, led_m);
            }
            return None;
        }
        let step_m = Ned {
            north: to_m.north - from_m.north - led_m.north,
            east: to_m.east - from_m.east - led_m.east,
            down: to_m.down - from_m.down - led_m.down,
        };
        let (before_mps, after_mps) = (norm(from_mps), norm(to_mps));
        let fastest_mps = if before_mps > after_mps { before_mps } else { after_mps };
        let limit_m = STEP_PER_WAY * fastest_mps * dt_s + STEP_MARGIN_M;
        // A vehicle in the air is never exactly still: an autopilot that sends zero reports no velocities.
        let least_m = if fastest_mps > 0.0 { STEP_MIN_M } else { BLIND_STEP_MIN_M };
        let noise_m = NOISES * sqrt(self.noise_m2);
        let least_m = if least_m > noise_m { least_m } else { noise_m };
        let limit_m = if limit_m > least_m { limit_m } else { least_m };
        let jumped_m = norm(step_m);
        let share = if jumped_m > limit_m { limit_m / jumped_m } else { 1.0 };
        let off_m = Ned { north: share * step_m.north, east: share * step_m.east, down: share * step_m.down };
        let Ned { north, east, down } = core::mem::replace(&mut self.off_m, off_m);
        // Of white noise twice the product of neighbours is minus the mean square.
        let came_back_m2 = -2.0 * (north * off_m.north + east * off_m.east + down * off_m.down);
        let noise_m2 = self.noise_m2 + NOISE_WEIGHT * (came_back_m2 - self.noise_m2);
        self.noise_m2 = if noise_m2 > 0.0 { noise_m2 } else { 0.0 };
        if jumped_m <= limit_m && !is_new {
            return None;
        }
        let step_m = self.velocity_to_ours(step_m);
        self.shift_m.north -= step_m.north;
        self.shift_m.east -= step_m.east;
        self.shift_m.down -= step_m.down;
        self.differs = true;
        Some(jumped_m)
    }

    /// Follows the autopilot from one heading to the next, at a position; returns by how much it turned, if it did.
    pub(crate) fn follow_heading(&mut self, turn: Turn, at_m: Ned) -> Option<f32> {
        let is_new = core::mem::take(&mut self.heading_is_new);
        let is_gap = turn.dt_s > HEADING_GAP_MAX_S;
        if is_gap && !is_new {
            return None;
        }
        let dt_s = if is_gap { 0.0 } else { turn.dt_s };
        let turned_rad = wrap_pi(turn.to_rad - turn.from_rad - turn.rate_radps * dt_s);
        if libm::fabsf(turned_rad) <= TURN_MIN_RAD + turn.unknown_radps * dt_s && !is_new {
            return None;
        }
        let here_m = self.place_to_ours(at_m);
        self.turn_rad = wrap_pi(self.turn_rad + turned_rad);
        let (sin, cos) = sin_cos(self.turn_rad);
        self.sin = sin;
        self.cos = cos;
        self.differs = true;
        // The vehicle stays where it is in our frame.
        let there_m = self.place_to_ours(at_m);
        self.shift_m.north += here_m.north - there_m.north;
        self.shift_m.east += here_m.east - there_m.east;
        Some(turned_rad)
    }

    /// A position in the autopilot's frame, in ours.
    #[inline(never)]
    pub(crate) fn place_to_ours(&self, place_m: Ned) -> Ned {
        if !self.differs {
            return place_m;
        }
        let turned_m = self.velocity_to_ours(place_m);
        Ned {
            north: turned_m.north + self.shift_m.north,
            east: turned_m.east + self.shift_m.east,
            down: turned_m.down + self.shift_m.down,
        }
    }

    /// A position in our frame, in the autopilot's.
    pub(crate) fn place_to_theirs(&self, place_m: Ned) -> Ned {
        if !self.differs {
            return place_m;
        }
        self.velocity_to_theirs(Ned {
            north: place_m.north - self.shift_m.north,
            east: place_m.east - self.shift_m.east,
            down: place_m.down - self.shift_m.down,
        })
    }

    /// A velocity in the autopilot's frame, in ours.
    pub(crate) fn velocity_to_ours(&self, velocity: Ned) -> Ned {
        self.turned(velocity, -self.sin)
    }

    /// A velocity in our frame, in the autopilot's.
    pub(crate) fn velocity_to_theirs(&self, velocity: Ned) -> Ned {
        self.turned(velocity, self.sin)
    }

    /// A heading in the autopilot's frame, in ours.
    #[inline(never)]
    pub(crate) fn heading_to_ours(&self, heading_rad: f32) -> f32 {
        if self.differs { wrap_pi(heading_rad - self.turn_rad) } else { heading_rad }
    }

    /// A heading in our frame, in the autopilot's.
    pub(crate) fn heading_to_theirs(&self, heading_rad: f32) -> f32 {
        if self.differs { wrap_pi(heading_rad + self.turn_rad) } else { heading_rad }
    }

    #[inline(never)]
    fn turned(&self, v: Ned, sin: f32) -> Ned {
        if !self.differs {
            return v;
        }
        Ned { north: self.cos * v.north - sin * v.east, east: sin * v.north + self.cos * v.east, down: v.down }
    }
}

#[inline(never)]
fn norm(v: Ned) -> f32 {
    sqrt(v.north * v.north + v.east * v.east + v.down * v.down)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ned(north: f32, east: f32, down: f32) -> Ned {
        Ned { north, east, down }
    }

    fn moved(from_m: Ned, velocity_mps: Ned, to_m: Ned, dt_s: f32) -> Displacement {
        Displacement { from_m, to_m, from_mps: velocity_mps, to_mps: velocity_mps, dt_s }
    }

    #[test]
    fn a_vehicle_that_gets_going_in_a_gap_has_not_jumped() {
        for (dt_s, a_mps2) in [(0.25, 5.0), (0.75, 4.0), (1.0, 3.0), (1.5, 3.0)] {
            let mut frame = Continuity::new();
            let still = ned(0.0, 0.0, 0.0);
            let (to_m, to_mps) = (ned(0.5 * a_mps2 * dt_s * dt_s, 0.0, 0.0), ned(a_mps2 * dt_s, 0.0, 0.0));
            assert_eq!(frame.follow_place(&Displacement { from_m: still, to_m, from_mps: still, to_mps, dt_s }), None);
        }
    }

    #[test]
    fn positions_that_come_less_often_than_their_messages_do_not_jump_and_one_that_does_is_found() {
        for (each, speed_mps) in [(5, 1.0_f32), (10, 1.0), (20, 1.5), (24, 3.0)] {
            let mut frame = Continuity::new();
            let velocity = ned(speed_mps, 0.0, 0.0);
            let place = |tick: u32| ned(0.02 * speed_mps * (tick / each * each) as f32, 0.0, 0.0);
            for tick in 0..40 * each {
                assert_eq!(frame.follow_place(&moved(place(tick), velocity, place(tick + 1), 0.02)), None, "{each}");
            }
            let last = place(40 * each);
            let jumped = ned(last.north + 0.02 * speed_mps * each as f32 + 3.0 * speed_mps + 1.0, 0.0, 0.0);
            assert!(frame.follow_place(&moved(last, velocity, jumped, 0.02)).is_some(), "{each}");
        }
    }

    fn turn(from_rad: f32, rate_radps: f32, to_rad: f32, dt_s: f32) -> Turn {
        Turn { from_rad, to_rad, dt_s, rate_radps, unknown_radps: 0.0 }
    }

    #[test]
    fn a_turn_at_a_rate_that_nobody_told_is_no_jump_unless_no_vehicle_turns_so_fast() {
        let mut frame = Continuity::new();
        let here = ned(0.0, 0.0, 0.0);
        let told = |to_rad| Turn { unknown_radps: 4.0, ..turn(0.0, 0.0, to_rad, 0.1) };
        assert_eq!(frame.follow_heading(told(0.5), here), None);
        assert!(frame.follow_heading(told(0.6), here).is_some());
    }

    fn distance(a: Ned, b: Ned) -> f32 {
        norm(ned(a.north - b.north, a.east - b.east, a.down - b.down))
    }

    #[test]
    fn without_a_jump_both_frames_are_the_same_to_the_bit() {
        let mut frame = Continuity::new();
        let velocity = ned(3.0, -1.0, 0.5);
        let mut place = ned(0.1, -0.3, -5.7);
        for _ in 0..1000 {
            let next = ned(place.north + 0.061, place.east - 0.019, place.down + 0.011);
            assert_eq!(frame.follow_place(&moved(place, velocity, next, 0.02)), None);
            assert_eq!(frame.follow_heading(turn(3.1, 1.5, -3.13, 0.02), next), None);
            place = next;
            assert_eq!(frame.place_to_ours(place), place);
            assert_eq!(frame.velocity_to_theirs(velocity), velocity);
            assert_eq!(frame.heading_to_ours(-3.13), -3.13);
        }
    }

    #[test]
    fn a_jump_of_five_metres_leaves_the_track_continuous() {
        let mut frame = Continuity::new();
        let (before, velocity) = (ned(10.0, 4.0, -5.0), ned(1.0, 0.0, 0.0));
        let after = ned(10.02 + 3.0, 4.0 - 4.0, -5.0);
        let jumped_m = frame.follow_place(&moved(before, velocity, after, 0.02)).unwrap();
        assert!((jumped_m - 5.0).abs() < 1e-3);
        assert!(distance(frame.place_to_ours(after), ned(10.02, 4.0, -5.0)) < 1e-4);
        assert!(distance(frame.place_to_theirs(frame.place_to_ours(after)), after) < 1e-4);
        assert_eq!(frame.velocity_to_theirs(velocity), velocity);
    }

    #[test]
    fn noise_moves_the_frame_by_less_than_itself_and_a_jump_in_it_is_hidden() {
        for sigma_m in [0.02_f32, 0.03, 0.05] {
            let mut rng = foxhound_core::base::rng::Rng::new(7, 0);
            let mut frame = Continuity::new();
            let (velocity, mut last) = (ned(0.5, 0.0, 0.0), ned(0.0, 0.0, 0.0));
            let mut told = |frame: &mut Continuity, at: u32, jump_m: f32| {
                let [north, east, down] = [0; 3].map(|_| sigma_m * rng.gaussian());
                let next = ned(0.01 * at as f32 + north + jump_m, east, down);
                frame.follow_place(&moved(last, velocity, next, 0.02));
                last = next;
                distance(frame.place_to_ours(next), ned(0.01 * at as f32, 0.0, 0.0))
            };
            let apart_m = (0..10_000).map(|at| told(&mut frame, at, 0.0)).fold(0.0, f32::max);
            assert!(apart_m < 6.0 * sigma_m, "{sigma_m} m: {apart_m}");
            let apart_m = (10_000..10_100).map(|at| told(&mut frame, at, 4.0)).fold(0.0, f32::max);
            assert!(apart_m < 15.0 * sigma_m, "{sigma_m} m: {apart_m} after a jump");
        }
    }

    #[test]
    fn a_turn_of_the_heading_keeps_place_and_body_directions() {
        let mut frame = Continuity::new();
        let here = ned(20.0, -7.0, -3.0);
        let turned = frame.follow_heading(turn(1.0, 0.0, 1.5, 0.02), here).unwrap();
        assert!((turned - 0.5).abs() < 1e-6);
        assert!(distance(frame.place_to_ours(here), here) < 1e-4);
        assert!((frame.heading_to_ours(1.5) - 1.0).abs() < 1e-6);
        // Ahead of the nose stays ahead of the nose.
        let (sin, cos) = sin_cos(1.0);
        let ahead = frame.velocity_to_theirs(ned(cos, sin, 0.0));
        let (sin, cos) = sin_cos(1.5);
        assert!(distance(ahead, ned(cos, sin, 0.0)) < 1e-6);
        // And another jump of the place on top of it.
        frame.follow_place(&moved(here, ned(0.0, 0.0, 0.0), ned(24.0, -10.0, -3.0), 0.02)).unwrap();
        assert!(distance(frame.place_to_ours(ned(24.0, -10.0, -3.0)), here) < 1e-4);
        assert!(distance(frame.place_to_theirs(here), ned(24.0, -10.0, -3.0)) < 1e-4);
    }

    #[test]
    fn what_is_announced_is_a_jump_however_small_and_a_gap_is_none() {
        let mut frame = Continuity::new();
        let still = ned(0.0, 0.0, 0.0);
        assert_eq!(frame.follow_place(&moved(still, still, ned(0.9, 0.0, 0.0), 0.02)), None);
        frame.expect_new(false);
        assert!(frame.follow_place(&moved(still, still, ned(0.2, 0.0, 0.0), 0.02)).is_some());
        assert!((frame.place_to_ours(ned(0.2, 0.0, 0.0)).north).abs() < 1e-6);
        assert_eq!(frame.follow_place(&moved(still, still, ned(50.0, 0.0, 0.0), 3.0)), None);
        assert_eq!(frame.follow_heading(turn(0.0, 0.0, 3.0, 1.0), still), None);
        frame.expect_new(true);
        assert!(frame.follow_place(&moved(still, still, ned(50.0, 0.0, 0.0), 30.0)).is_some());
        assert!(frame.follow_heading(turn(0.0, 0.0, 3.0, 30.0), still).is_some());
    }
}
