//! The start, with what was kept; and what is kept as the link goes on.
//!
//! | what was kept | what the vehicle does |
//! |---|---|
//! | parameters, all of them known and in range | flies with them |
//! | parameters, some unknown or out of range by now | flies with the others and the defaults of those, and says so |
//! | parameters that do not fit each other, or cannot be read | says so, and holds with the outcome `Uncalibrated`: with the defaults, without a calibration, and with `FH_CAL_REQ` on, until somebody has looked at the parameters and switched it off or stored them and restarted |
//! | a calibration that cannot be read | says so; flies without, unless `FH_CAL_REQ` is on: then `Uncalibrated` |
//! | a key that cannot be read | says so; neither signs nor asks for signatures |
//!
//! Nothing of this is said, or done, where nothing was ever kept.

use embedded_storage::nor_flash::NorFlash;
use foxhound_core::guidance;
use foxhound_core::mission::Control;
use foxhound_core::param::{self, Values};
use foxhound_core::time::Instant;
use foxhound_link::companion::Companion;
use foxhound_link::signing::Signing;
use heapless::String;

use super::{Kept, Store};
use crate::flight::Flight;

/// Which of our links signs.
const LINK_ID: u8 = 0;

/// What the pilot is to hear.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum News {
    ParametersLost,
    ParametersRefused,
    ParametersDropped,
    CalibrationLost,
    KeyLost,
    KeyNotKept,
}

impl News {
    const ALL: [Self; 6] = [
        Self::ParametersLost,
        Self::ParametersRefused,
        Self::ParametersDropped,
        Self::CalibrationLost,
        Self::KeyLost,
        Self::KeyNotKept,
    ];

    /// At most 50 bytes, those of a `STATUSTEXT`.
    const fn words(self) -> &'static str {
        match self {
            Self::ParametersLost => "Foxhound: parameters lost: defaults, does not seek",
            Self::ParametersRefused => "Foxhound: parameters do not fit: does not seek",
            Self::ParametersDropped => "Foxhound: some stored parameters are defaults",
            Self::CalibrationLost => "Foxhound: stored calibration lost",
            Self::KeyLost => "Foxhound: stored key lost: signs nothing",
            Self::KeyNotKept => "Foxhound: the key cannot be stored",
        }
    }
}

/// News that were not told yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Untold(u8);

impl Untold {
    pub(super) const NOTHING: Self = Self(0);

    fn add(&mut self, news: News) {
        self.0 |= 1 << news as u8;
    }

    fn take(&mut self) -> Option<News> {
        let news = News::ALL.into_iter().find(|news| self.0 & 1 << *news as u8 != 0)?;
        self.0 &= !(1 << news as u8);
        Some(news)
    }
}

impl<F: NorFlash> Store<F> {
    /// Puts the calibration that was kept into the configuration that the flight is to begin with.
    #[inline(never)]
    pub fn calibrate(&mut self, config: &mut guidance::Config) {
        match self.calibration() {
            Kept::Found(calibration) => config.array.calibration = Some(calibration.table),
            Kept::Lost => self.untold.add(News::CalibrationLost),
            Kept::Nothing => {}
        }
    }

    /// Goes on with the parameters and the key that were kept. To be called once, before the first step.
    #[inline(never)]
    pub fn resume(&mut self, now: Instant, flight: &mut Flight<'_>) {
        match self.parameters() {
            Kept::Found(restored) if flight.run_with(restored.values).is_ok() => {
                if restored.dropped > 0 {
                    self.untold.add(News::ParametersDropped);
                }
            }
            Kept::Found(_) => {
                self.untold.add(News::ParametersRefused);
                fall_back(flight);
            }
            Kept::Lost => {
                self.untold.add(News::ParametersLost);
                fall_back(flight);
            }
            Kept::Nothing => {}
        }
        match self.key() {
            Kept::Found((key, timestamp)) => {
                let mut signing = Signing::new(key, LINK_ID);
                signing.restore(now, timestamp);
                flight.companion.sign_with(Some(signing));
            }
            Kept::Lost => self.untold.add(News::KeyLost),
            Kept::Nothing => {}
        }
    }

    /// Keeps what has changed of the signing, and tells what is to be told. To be called in every step, after the parameters
    /// were served and before anything is sent; does nothing to the flash while the vehicle is in control.
    #[inline(never)]
    pub fn keep_up(&mut self, now: Instant, companion: &mut Companion) {
        if companion.control(now) != Control::Granted {
            self.keep_signing(now, companion);
        }
        if !companion.has_notice()
            && let Some(news) = self.untold.take()
        {
            companion.notify(String::try_from(news.words()).unwrap_or_default());
        }
    }

    /// A simulator sets everything up: what waits to be told holds no more.
    pub const fn overrule(&mut self) {
        self.untold = Untold::NOTHING;
    }

    #[inline(never)]
    fn keep_signing(&mut self, now: Instant, companion: &mut Companion) {
        let is_other = companion.take_key_change();
        let mut is_kept = true;
        if is_other {
            is_kept = self.keep_key(companion.signing().map(|signing| signing.key()));
        }
        if let Some(signing) = companion.signing()
            && let Some(timestamp) = signing.timestamp_to_store(now)
        {
            // Where a key was forgotten it still signs until the next start, and nothing of it is kept.
            is_kept &= !self.has_key() || self.keep_timestamp(signing.key(), timestamp);
        }
        if !is_kept {
            self.untold.add(News::KeyNotKept);
        }
    }
}

/// Flies nowhere until somebody has looked: nobody knows whether a calibration was asked for, so it is.
#[inline(never)]
fn fall_back(flight: &mut Flight<'_>) {
    flight.config.array.calibration = None;
    let mut values = Values::DEFAULT;
    let is_set = values.set(param::FH_CAL_REQ, 1.0).is_ok();
    if !is_set || flight.run_with(values).is_err() {
        flight.companion.fail();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_news_fit_a_message_and_are_told_once() {
        let mut untold = Untold::NOTHING;
        for news in News::ALL {
            assert!(news.words().len() <= foxhound_link::companion::NOTICE_BYTES, "{}", news.words());
            untold.add(news);
        }
        for news in News::ALL {
            assert_eq!(untold.take(), Some(news));
        }
        assert_eq!(untold.take(), None);
    }
}
