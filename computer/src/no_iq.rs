//! In place of the module of this name in an image without the feature `iq`: [`crate::features::check`] refuses what would need it.

use foxhound_core::ConfigError;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::radio::Mount;

use crate::came::Came;

/// Reads nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reports;

impl Reports {
    /// Reads nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self
    }

    /// Does nothing.
    ///
    /// # Errors
    /// None.
    pub const fn begin(&mut self, _: &Mount) -> Result<(), ConfigError> {
        Ok(())
    }

    /// None.
    pub const fn known(&self) -> core::iter::Empty<[u8; 15]> {
        core::iter::empty()
    }

    /// Reads nothing.
    pub(crate) const fn push(&mut self, _: &Mount, _: Instant, _: u8) -> Option<Came> {
        None
    }

    /// Does nothing.
    pub const fn end_step(&mut self) {}
}
