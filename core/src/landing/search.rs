//! A search on a square spiral around the best estimate, limited in radius and time.
//!
//! Legs run north, east, south, west and so on; their lengths are one pitch, one, two, two, three, three. With a
//! camera the pitch is less than its view at this height, so that nothing is missed; for a beacon the pitch gives the
//! bearings other angles. A leg that the guard blocks, or on which the vehicle comes no nearer, is left out. At the
//! end the vehicle flies back to the start, if it can, since that is the best estimate.

use crate::base::error::{ConfigError, check};
use crate::base::ned::Horizontal;
use crate::base::time::Instant;

/// A corner is passed within this distance.
const PASSED_M: f32 = 0.35;
/// Largest number of corners.
const CORNERS_MAX: u8 = 60;
/// Smallest and largest pitch.
const PITCH_MIN_M: f32 = 0.3;
const PITCH_MAX_M: f32 = 3.0;
/// The pitch as a share of the camera's view.
const OVERLAP: f32 = 0.6;
/// A leg is left out if the vehicle comes no nearer to its corner by this much in this time.
const NEARER_M: f32 = 0.2;
const NEARER_S: f32 = 4.0;
/// Speed of the search.
pub(super) const SPEED_MPS: f32 = 0.5;
/// A leg is left out when it has been blocked for this long.
const BLOCKED_S: f32 = 1.0;

/// Configuration of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Largest distance from the best estimate.
    pub radius_m: f32,
    /// Time limit.
    pub time_s: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { radius_m: 3.0, time_s: 90.0 }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Search, ConfigError> {
        check("landing.search.radius_m", self.radius_m, 0.5, 20.0)?;
        check("landing.search.time_s", self.time_s, 1.0, 600.0)?;
        Ok(Search { config: *self })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    config: Config,
}

/// State of a search.
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    center_ned_m: Horizontal,
    corner_ned_m: Horizontal,
    pitch_m: f32,
    began: Instant,
    /// The least distance to the corner, and when it was reached.
    nearest_m: f32,
    neared: Instant,
    blocked_s: f32,
    corners: u8,
    skipped: u8,
    /// Flying back, after this end.
    end: Option<End>,
}

/// How a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Everything was searched.
    Searched,
    /// The time limit was reached.
    TimeUp,
    /// Most legs were blocked.
    Blocked,
}

/// The next action of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// Fly there.
    Towards(Horizontal),
    /// It is over.
    Over(End),
}

impl State {
    /// The position has jumped.
    pub fn shift(&mut self, by: Horizontal) {
        self.center_ned_m = self.center_ned_m.plus(by);
        self.corner_ned_m = self.corner_ned_m.plus(by);
    }

    /// The vehicle holds: neither the search's time nor that of a leg runs on.
    pub(super) fn wait(&mut self, micros: u64) {
        self.began = self.began.plus_micros(micros);
        self.neared = self.neared.plus_micros(micros);
    }

    fn turn_back(&mut self, end: End, now: Instant) {
        self.end = Some(end);
        self.set_out(self.center_ned_m, now);
    }

    fn set_out(&mut self, corner_ned_m: Horizontal, now: Instant) {
        self.corner_ned_m = corner_ned_m;
        (self.neared, self.nearest_m, self.blocked_s) = (now, f32::INFINITY, 0.0);
    }
}

impl Search {
    /// The pitch for a camera at a height: `focal_widths` is its focal length over the width of its image.
    #[must_use]
    pub fn camera_pitch_m(height_m: f32, focal_widths: f32) -> f32 {
        OVERLAP * height_m / focal_widths
    }

    /// Begins a search around a place.
    pub fn begin(&self, state: &mut State, center_ned_m: Horizontal, pitch_m: f32, now: Instant) {
        let pitch_m = crate::base::units::between(pitch_m, PITCH_MIN_M, PITCH_MAX_M);
        let pitch_m = if pitch_m.is_finite() { pitch_m } else { PITCH_MIN_M };
        *state = State { center_ned_m, corner_ned_m: center_ned_m, pitch_m, began: now, ..State::default() };
        state.set_out(center_ned_m, now);
    }

    /// The next action from here.
    pub fn step(&self, state: &mut State, here: Horizontal, is_blocked: bool, now: Instant, tick_s: f32) -> Progress {
        let c = &self.config;
        if state.end.is_none() && now.seconds_since(state.began) > c.time_s {
            state.turn_back(End::TimeUp, now);
        }
        state.blocked_s = if is_blocked { state.blocked_s + tick_s } else { 0.0 };
        let away_m = here.minus(state.corner_ned_m).norm();
        if away_m < state.nearest_m - NEARER_M {
            (state.nearest_m, state.neared) = (away_m, now);
        }
        let is_late = now.seconds_since(state.neared) > NEARER_S;
        let is_passed = away_m < PASSED_M;
        let is_skipped = !is_passed && (is_late || state.blocked_s > BLOCKED_S);
        if let Some(end) = state.end {
            return if is_passed || is_skipped { Progress::Over(end) } else { Progress::Towards(state.corner_ned_m) };
        }
        if is_passed || is_skipped {
            state.skipped = state.skipped.saturating_add(u8::from(is_skipped));
            let (pitch_m, last) = (state.pitch_m, state.corner_ned_m);
            let length_m = pitch_m * f32::from(state.corners / 2 + 1);
            let corner = match state.corners % 4 {
                0 => Horizontal { north: last.north + length_m, ..last },
                1 => Horizontal { east: last.east + length_m, ..last },
                2 => Horizontal { north: last.north - length_m, ..last },
                _ => Horizontal { east: last.east - length_m, ..last },
            };
            state.corners += 1;
            state.set_out(corner, now);
        }
        let off = state.corner_ned_m.minus(state.center_ned_m);
        let is_outside = libm::fabsf(off.north) > c.radius_m + 0.01 || libm::fabsf(off.east) > c.radius_m + 0.01;
        if is_outside || state.corners > CORNERS_MAX {
            let is_blocked = 2 * u16::from(state.skipped) > u16::from(state.corners);
            state.turn_back(if is_blocked { End::Blocked } else { End::Searched }, now);
        }
        Progress::Towards(state.corner_ned_m)
    }
}
