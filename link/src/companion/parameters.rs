//! The parameters: who changes them, and when they are stored.

use foxhound_core::base::error::ConfigError;
use foxhound_core::guidance::mission::Control;
use foxhound_core::guidance::param::{Id, Values};

use super::{Companion, Config};
use crate::params::Storage;

impl Companion {
    /// Whether the link can run with other parameters.
    ///
    /// # Errors
    /// The field of the link's configuration that does not fit the others.
    #[inline(never)]
    pub fn check_parameters(&self, values: &Values) -> Result<(), ConfigError> {
        self.config.with(values).check_together()
    }

    /// The application runs with other parameters from now on; the link takes its own from them.
    ///
    /// # Errors
    /// The field of the link's configuration that does not fit the others; then everything stays as it was.
    #[inline(never)]
    pub fn set_parameters(&mut self, values: Values) -> Result<(), ConfigError> {
        let config = self.config.with(&values);
        config.check_together()?;
        self.change_limits();
        self.params.replace(values);
        self.reconfigure(config);
        Ok(())
    }

    /// The parameters in use.
    #[must_use]
    pub const fn parameters(&self) -> &Values {
        self.params.values()
    }

    /// A parameter that a station wants changed, and the full set with that change, for the application to try. Answer
    /// it by [`settle`](Self::settle) before anything else.
    #[inline(never)]
    pub fn proposal(&mut self) -> Option<(Id, Values)> {
        let is_seeking = self.control(self.now) == Control::Granted;
        loop {
            let values = self.params.proposal(is_seeking)?;
            match self.config.with(&values).check_together() {
                Ok(()) => return self.params.proposed().map(|id| (id, values)),
                Err(error) => self.params.settle(Err(error)),
            }
        }
    }

    /// The application's answer to the proposal: it runs with it from now on, or it cannot.
    #[inline(never)]
    pub fn settle(&mut self, verdict: Result<(), ConfigError>) {
        if verdict.is_ok() {
            self.change_limits();
        }
        self.params.settle(verdict);
        let config = self.config.with(self.params.values());
        self.reconfigure(config);
    }

    /// What the application is to do with its stored parameters; answer it by [`stored`](Self::stored).
    #[inline(never)]
    pub fn take_storage(&mut self) -> Option<Storage> {
        let storage = self.params.take_storage()?;
        if self.control(self.now) == Control::Granted {
            // It was requested before. Writing the flash stops the processor.
            self.params.stored(false);
            return None;
        }
        Some(storage)
    }

    /// The application has done it, or could not. Values that were loaded or reset must have been
    /// [set](Self::set_parameters) before.
    #[inline(never)]
    pub fn stored(&mut self, is_done: bool) {
        self.params.stored(is_done);
    }

    /// What holds the vehicle in the mode may be lifted by other parameters: only a fresh entry shows that the pilot wants that.
    fn change_limits(&mut self) {
        self.entry_needed |= self.may_obey();
    }

    fn reconfigure(&mut self, config: Config) {
        if self.config.accept_v1 != config.accept_v1 {
            self.framer.accept_v1(config.accept_v1);
        }
        let channel_changed = self.config.switch_channel != config.switch_channel;
        self.config = config;
        if let Some(autopilot) = self.autopilot.filter(|_| channel_changed) {
            self.wish(autopilot.software);
        }
    }
}
