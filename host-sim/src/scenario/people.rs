//! People who walk about: their route, speed and behaviour.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::input::{InputError, check};

/// People must be at least this far from the vehicle's start.
const START_FREE_M: f64 = 1.5;

/// A person, or several side by side, who walk along `route` and `heading_deg`, or along a recorded `track`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Person {
    /// Start, and the points to walk to, one after the other, x and y. Straight on after the last.
    #[schemars(inner(inner(range(min = -10000.0, max = 10000.0))))]
    pub route: Vec<[f64; 2]>,
    /// Walking direction with a route of one point, from north, clockwise.
    #[schemars(range(min = -360.0, max = 360.0))]
    pub heading_deg: Option<f64>,
    /// Instead of a route, a recorded track: time, x, y. Straight on in between; absent before and after it.
    #[schemars(inner(inner(range(min = -10000.0, max = 10000.0))))]
    pub track: Vec<[f64; 3]>,
    /// Walking speed. The default is the median of people in a hurry.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub speed: f64,
    /// Radius.
    #[schemars(range(min = 0.05, max = 5.0))]
    pub r: f64,
    /// Amplitude of the sway to either side of the route.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub sway_m: f64,
    /// Period of the sway.
    #[schemars(range(min = 0.2, max = 60.0))]
    pub sway_s: f64,
    /// Mean time from one stop to the next; zero: never stops.
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub stop_every_s: f64,
    /// Mean duration of a stop.
    #[schemars(range(min = 0.1, max = 600.0))]
    pub stop_s: f64,
    /// Mean time from one turn to the next; zero: never turns.
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub turn_every_s: f64,
    /// Largest turn to either side.
    #[schemars(range(min = 0.0, max = 180.0))]
    pub turn_deg: f64,
    /// Number of people who walk together, side by side.
    #[schemars(range(min = 1, max = 10))]
    pub group: u32,
    /// Distance from one of them to the next.
    #[schemars(range(min = 0.3, max = 5.0))]
    pub group_gap: f64,
    /// Gives way to the vehicle; others ignore it.
    pub steps_aside: bool,
}

impl Default for Person {
    fn default() -> Self {
        Self {
            route: Vec::new(),
            heading_deg: None,
            track: Vec::new(),
            speed: 1.67,
            r: 0.3,
            sway_m: 0.0,
            sway_s: 4.0,
            stop_every_s: 0.0,
            stop_s: 2.0,
            turn_every_s: 0.0,
            turn_deg: 60.0,
            group: 1,
            group_gap: 0.7,
            steps_aside: false,
        }
    }
}

impl Person {
    /// Checks what their ranges do not say, and that nobody starts too close to the vehicle.
    pub(super) fn check(&self, name: &str, start: [f64; 2]) -> Result<(), InputError> {
        for (key, every_s) in [("stop_every_s", self.stop_every_s), ("turn_every_s", self.turn_every_s)] {
            if every_s != 0.0 {
                check(&format!("{name}.{key}"), every_s, 0.5, 3600.0)?;
            }
        }
        self.check_way(name)?;
        let gap_m = |[x, y]: [f64; 2]| libm::hypot(x - start[0], y - start[1]);
        if let Some(gap_m) = self.starts().into_iter().map(gap_m).find(|gap_m| *gap_m < START_FREE_M) {
            let text =
                format!("{name}: starts {gap_m:.2} m from the vehicle's start; at least {START_FREE_M} m is required");
            return Err(InputError::new(text));
        }
        Ok(())
    }

    /// Whether exactly one kind of path is given.
    fn check_way(&self, name: &str) -> Result<(), InputError> {
        let wrong = match (self.route.len(), self.track.len()) {
            (0, 0) => "needs a route or a track",
            (0, 1) => "a track needs at least two points",
            (0, _) if self.track.windows(2).any(|pair| pair[1][0] <= pair[0][0]) => {
                "the times of a track must increase"
            }
            (0, _) if self.heading_deg.is_some() || self.turn_every_s != 0.0 || self.stop_every_s != 0.0 => {
                "a person with a track can only follow it"
            }
            (0, _) if self.sway_m != 0.0 || self.group != 1 => "a person with a track can only follow it",
            (0, _) => return Ok(()),
            (_, 1..) => "has both a route and a track",
            (1, 0) if self.heading_deg.is_none() => "needs a heading_deg, or a second point in its route",
            (2.., 0) if self.heading_deg.is_some() => "heading_deg needs a route of one point",
            (2.., 0) if self.turn_every_s != 0.0 => "turn_every_s needs a route of one point",
            (2.., 0) if self.route.windows(2).any(|pair| pair[0] == pair[1]) => {
                "two successive points of its route are the same"
            }
            _ => return Ok(()),
        };
        Err(InputError::new(format!("{name}: {wrong}")))
    }

    /// Initial direction, x and y, as a unit vector.
    pub(crate) fn first_heading(&self) -> [f64; 2] {
        match (&self.route[..], self.heading_deg) {
            ([from, to, ..], _) => {
                let (x, y) = (to[0] - from[0], to[1] - from[1]);
                let norm = libm::hypot(x, y);
                [x / norm, y / norm]
            }
            (_, heading_deg) => {
                let (sine, cosine) = libm::sincos(heading_deg.unwrap_or_default().to_radians());
                [sine, cosine]
            }
        }
    }

    /// Offsets of the people of a group from the middle one, constant over the route.
    pub(crate) fn abreast(&self) -> impl Iterator<Item = [f64; 2]> + use<> {
        let ([x, y], middle, gap_m) = (self.first_heading(), 0.5 * f64::from(self.group - 1), self.group_gap);
        (0..self.group).map(move |k| {
            let aside_m = gap_m * (f64::from(k) - middle);
            [y * aside_m, -x * aside_m]
        })
    }

    /// Positions at time zero of those who are present then.
    fn starts(&self) -> Vec<[f64; 2]> {
        if let Some([x, y]) = self.route.first() {
            return self.abreast().map(|[aside_x, aside_y]| [x + aside_x, y + aside_y]).collect();
        }
        let spans = self.track.windows(2).find(|pair| pair[0][0] <= 0.0 && 0.0 <= pair[1][0]);
        let at = |pair: &[[f64; 3]]| {
            let share = -pair[0][0] / (pair[1][0] - pair[0][0]);
            [1, 2].map(|axis| pair[0][axis] + share * (pair[1][axis] - pair[0][axis]))
        };
        spans.map(at).into_iter().collect()
    }
}
