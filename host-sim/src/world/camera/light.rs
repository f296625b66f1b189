//! The light on the ground, and the effects of lens and sensor.

/// Linear red, green and blue.
pub type Colour = [f32; 3];

/// A colour by its channels. `array::map` would be a call for each of them in every pixel.
pub(super) fn each(channel: impl Fn(usize) -> f32) -> Colour {
    [channel(0), channel(1), channel(2)]
}

/// A shadow's straight edge across the picture: dark on one side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadow {
    /// A point on its edge.
    pub north_m: f32,
    /// A point on its edge.
    pub east_m: f32,
    /// The direction into the dark, north and east: [`direction`].
    pub into: [f32; 2],
    /// Its width; the ground behind it is lit again.
    pub width_m: f32,
    /// The remaining share of the light.
    pub left: f32,
}

/// The light of a value on the curve of sRGB.
pub(super) fn linear(value: f32) -> f32 {
    if value <= 0.040_45 { value / 12.92 } else { libm::powf((value + 0.055) / 1.055, 2.4) }
}

/// The unit vector of a direction clockwise from north: north and east.
#[must_use]
pub fn direction(turn_rad: f32) -> [f32; 2] {
    let (east, north) = libm::sincosf(turn_rad);
    [north, east]
}

/// The light and the effects of lens and sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    /// 1: white is just not clipped.
    pub exposure: f32,
    /// Gains of red, green and blue: the lamp's colour, minus the camera's white balance.
    pub gains: Colour,
    /// How much darker the corners are.
    pub vignette: f32,
    /// How much the light changes from one side of the picture to the other, and in which direction.
    pub gradient: [f32; 2],
    /// Shadows of trees, masts, the vehicle.
    pub shadows: Vec<Shadow>,
    /// The part of the mean light that is all over the picture.
    pub flare: f32,
    /// Focus: standard deviation.
    pub blur_px: f32,
    /// Motion during the exposure: columns, lines.
    pub motion_px: [f32; 2],
    /// Read noise, over white.
    pub read_noise: f32,
    /// Electrons of white.
    pub full_well: f32,
    /// Stuck pixels per million.
    pub dead_ppm: f32,
}

impl Default for Lighting {
    fn default() -> Self {
        Self {
            exposure: 1.0,
            gains: [1.0; 3],
            vignette: 0.0,
            gradient: [0.0; 2],
            shadows: Vec::new(),
            flare: 0.0,
            blur_px: 0.0,
            motion_px: [0.0; 2],
            read_noise: 0.003,
            full_well: 8000.0,
            dead_ppm: 0.0,
        }
    }
}

/// A lamp's red, green and blue relative to daylight of 6500 K, linear, green 1: Planck's law at 600, 540 and 450 nm.
#[must_use]
pub fn lamp(kelvin: f32) -> Colour {
    let planck = |nanometres: f32, kelvin: f32| 1.0 / (libm::expf(14_387_770.0 / (nanometres * kelvin)) - 1.0);
    let beside = |nanometres: f32| planck(nanometres, kelvin) / planck(nanometres, 6500.0);
    let green = beside(540.0);
    [beside(600.0) / green, 1.0, beside(450.0) / green]
}
