//! The light over the ground, and what lens and sensor take from it.

/// Linear red, green and blue.
pub type Colour = [f32; 3];

/// A shadow's straight edge across the picture: dark on one side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadow {
    /// A place on its edge.
    pub north_m: f32,
    /// A place on its edge.
    pub east_m: f32,
    /// The direction into the dark.
    pub turn_rad: f32,
    /// How wide it is; what is behind is lit again.
    pub width_m: f32,
    /// How much of the light is left.
    pub left: f32,
}

/// The light and what lens and sensor make of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    /// 1: white is just not clipped.
    pub exposure: f32,
    /// Gains of red, green and blue: the lamp's colour, as far as the camera does not balance it.
    pub gains: Colour,
    /// How much darker the corners are.
    pub vignette: f32,
    /// How much the light changes from one side of the picture to the other, and in which direction.
    pub gradient: [f32; 2],
    /// Of trees, masts, the vehicle.
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
    /// Pixels that are stuck, a million.
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

/// A lamp's red, green and blue beside those of daylight of 6500 K, linear, green 1: Planck's law at 600, 540 and 450 nm.
#[must_use]
pub fn lamp(kelvin: f32) -> Colour {
    let planck = |nanometres: f32, kelvin: f32| 1.0 / ((14_387_770.0 / (nanometres * kelvin)).exp() - 1.0);
    let beside = |nanometres: f32| planck(nanometres, kelvin) / planck(nanometres, 6500.0);
    let green = beside(540.0);
    [beside(600.0) / green, 1.0, beside(450.0) / green]
}
