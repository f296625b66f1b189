//! In place of the module of this name in an image without the feature `pad`: every byte at the maintenance port is typed text.

use foxhound_core::ConfigError;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance;
use foxhound_core::landing::observation::PadObservation;

/// There is no pad detector.
#[derive(Clone, Copy, Debug)]
pub struct Detector;

/// Every configuration that [`crate::features::check`] accepts is without a camera.
///
/// # Errors
/// None.
pub const fn detector(_: &guidance::Config) -> Result<Detector, ConfigError> {
    Ok(Detector)
}

/// The result of a byte.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Came {
    /// Typed text.
    Text(u8),
    /// Does not happen.
    Sighted(Sighted),
}

/// There is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sighted {}

impl Sighted {
    /// There is no observation.
    #[must_use]
    pub const fn look(&self, _: Instant) -> PadObservation {
        match *self {}
    }
}

/// Reads no frames.
#[derive(Clone, Copy, Debug)]
pub struct Camera;

impl Camera {
    /// Before the first byte.
    #[must_use]
    pub const fn new(_: Detector) -> Self {
        Self
    }

    /// Changes nothing.
    pub const fn set_detector(&mut self, _: Detector) {}

    /// Takes a byte.
    pub const fn push(&mut self, byte: u8, _: Option<f32>) -> Option<Came> {
        Some(Came::Text(byte))
    }
}
