//! A flight that goes on after arrival: the pad, the camera that looks down, the range finder.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The flight ends when the vehicle has landed, or hovers and hands over; without this it ends within the goal
/// tolerance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Landing {
    /// Height of the flight over the ground. The beacon lies on the ground.
    #[schemars(range(min = 1.0, max = 12.0))]
    pub height: f64,
    /// Centre of the pad relative to the beacon: east, north.
    #[schemars(inner(range(min = -10.0, max = 10.0)))]
    pub pad: [f64; 2],
    /// Its radius.
    #[schemars(range(min = 0.05, max = 2.0))]
    pub pad_radius: f64,
    /// There is no pad, although the vehicle expects one.
    pub pad_missing: bool,
    /// The camera; null where there is none.
    pub camera: Option<Camera>,
    /// The autopilot has a range finder that looks down.
    pub range_finder: bool,
    /// The autopilot is asked to land where the vehicle has arrived.
    pub request_land: bool,
}

/// A camera that looks down.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Camera {
    /// Pixels from left to right.
    #[schemars(range(min = 16, max = 320))]
    pub width: u16,
    /// Lines.
    #[schemars(range(min = 16, max = 240))]
    pub height: u16,
    /// Its horizontal field of view.
    #[schemars(range(min = 20.0, max = 120.0))]
    pub fov_deg: f64,
    /// Frames a second.
    #[schemars(range(min = 1.0, max = 50.0))]
    pub rate_hz: f64,
    /// From the exposure to the last byte of the frame.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub latency_s: f64,
    /// It sees no colours.
    pub grey: bool,
    /// Red objects that are not the pad lie about.
    pub distractors: bool,
    /// Time span in which its frames are cut off in the middle.
    #[schemars(inner(range(min = 0.0, max = 1e6)))]
    pub cut: Option<[f64; 2]>,
    /// Time span in which its frames are all of one colour.
    #[schemars(inner(range(min = 0.0, max = 1e6)))]
    pub blind: Option<[f64; 2]>,
}

impl Default for Landing {
    fn default() -> Self {
        Self {
            height: 3.0,
            pad: [0.0, 0.0],
            pad_radius: 0.25,
            pad_missing: false,
            camera: Some(Camera::default()),
            range_finder: true,
            request_land: false,
        }
    }
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            width: 160,
            height: 120,
            fov_deg: 60.0,
            rate_hz: 10.0,
            latency_s: 0.08,
            grey: false,
            distractors: false,
            cut: None,
            blind: None,
        }
    }
}

impl Camera {
    /// Focal length over the image's width.
    #[must_use]
    pub fn focal_widths(self) -> f64 {
        0.5 / libm::tan(0.5 * self.fov_deg.to_radians())
    }
}
