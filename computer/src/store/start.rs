//! The start, with the stored values; and what is stored during operation.
//!
//! | stored | what the vehicle does |
//! |---|---|
//! | parameters, all of them known and in range | flies with them |
//! | parameters, some unknown or out of range by now | flies with the others, for a value out of range with the nearest in it, for a choice with the default, and reports it until they are stored again |
//! | parameters that do not fit each other | reports it, and holds with the outcome `Uncalibrated`: with the defaults, without a calibration, and with `FH_CAL_REQ` on, until the pilot has switched it off, or has stored the parameters and restarted |
//! | parameters whose newest record is damaged | the same; and does not move until parameters are stored, or everything is reset |
//! | a calibration whose newest record is damaged | reports it, and does not move until a calibration is stored, or everything is reset |
//! | a key, or its timestamp, whose newest record is damaged | reports it, and does not move until a key is set or removed, or everything is reset; without the key it neither signs nor requires signatures |
//! | a flash that cannot be read | as with parameters that do not fit; and as without a calibration and a key |
//!
//! "Does not move" is the cause [`foxhound_link::failsafe::Cause::StoreDamaged`]. An older record is never used
//! instead of a damaged one.
//!
//! None of this applies if nothing was ever stored.

use embedded_storage::nor_flash::NorFlash;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance;
use foxhound_core::guidance::mission::Control;
use foxhound_core::guidance::param::{self, Values};
use foxhound_core::guidance::systems::Systems;
use foxhound_link::companion::Companion;
use foxhound_link::signing::Signing;
use heapless::String;

use super::{Kept, Name, RECORDS, Store, Trouble};
use crate::flight::Flight;

/// The id of our signing link.
const LINK_ID: u8 = 0;

/// Messages to the pilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum News {
    ParametersLost,
    ParametersRefused,
    ParametersDropped,
    CalibrationLost,
    KeyLost,
    TimestampLost,
    KeyNotKept,
}

impl News {
    const ALL: [Self; 7] = [
        Self::ParametersLost,
        Self::ParametersRefused,
        Self::ParametersDropped,
        Self::CalibrationLost,
        Self::KeyLost,
        Self::TimestampLost,
        Self::KeyNotKept,
    ];

    /// At most 50 bytes, those of a `STATUSTEXT`.
    const fn words(self) -> &'static str {
        match self {
            Self::ParametersLost => "Foxhound: parameters lost: defaults, does not seek",
            Self::ParametersRefused => "Foxhound: parameters do not fit: does not seek",
            Self::ParametersDropped => "Foxhound: stored parameters changed, check them",
            Self::CalibrationLost => "Foxhound: stored calibration lost",
            Self::KeyLost => "Foxhound: stored key lost: signs nothing",
            Self::TimestampLost => "Foxhound: stored time of the key lost",
            Self::KeyNotKept => "Foxhound: the key cannot be stored",
        }
    }
}

/// Messages that have not been sent yet.
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
    /// Writes the stored calibration into the configuration of the next flight.
    #[inline(never)]
    pub fn calibrate(&mut self, config: &mut guidance::Config) {
        match self.calibration() {
            Kept::Found(calibration) => config.array.calibration = Some(calibration.table),
            Kept::Lost => self.miss(Name::Calibration, News::CalibrationLost),
            Kept::Nothing => {}
        }
    }

    /// Continues with the stored parameters and key. Call it once, before the first step.
    #[inline(never)]
    pub fn resume<S: Systems>(&mut self, now: Instant, flight: &mut Flight<'_, S>) {
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
                self.miss(Name::Parameters, News::ParametersLost);
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
            Kept::Lost => self.miss(Name::Key, News::KeyLost),
            Kept::Nothing => {}
        }
        if self.read(Name::Timestamp, |_| Some(())) == Kept::Lost {
            self.miss(Name::Timestamp, News::TimestampLost);
        }
        flight.companion.note_store(self.is_damaged());
    }

    /// A stored record is damaged, unless the flash cannot be read at all.
    #[inline(never)]
    fn miss(&mut self, name: Name, news: News) {
        self.untold.add(news);
        if !matches!(self.get(RECORDS, name as u8), Err(Trouble::Refused)) {
            self.damaged |= name.bit();
        }
    }

    /// Stores changes of the signing, and sends messages to the pilot. Call it in every step, after the parameters
    /// were served and before anything is sent; it does not write the flash while the vehicle is in control.
    #[inline(never)]
    pub fn keep_up(&mut self, now: Instant, companion: &mut Companion) {
        if companion.control(now) != Control::Granted {
            self.keep_signing(now, companion);
        }
        companion.note_store(self.is_damaged());
        if !companion.has_notice()
            && let Some(news) = self.untold.take()
        {
            companion.notify(String::try_from(news.words()).unwrap_or_default());
        }
    }

    /// A simulator sets everything up: pending messages and damage are dropped.
    pub const fn overrule(&mut self) {
        self.untold = Untold::NOTHING;
        self.damaged = 0;
    }

    #[inline(never)]
    fn keep_signing(&mut self, now: Instant, companion: &mut Companion) {
        let is_other = companion.take_key_change();
        let mut is_kept = true;
        if is_other {
            is_kept = self.keep_key(companion.signing().map(|signing| signing.key()));
        }
        // The time of a key continues from the stored one; if that is damaged, only a key that is set anew has one.
        if self.damaged & Name::Timestamp.bit() != 0 && !is_other {
            return;
        }
        if let Some(signing) = companion.signing()
            && let Some(timestamp) = signing.timestamp_to_store(now)
        {
            // After a key was removed it still signs until the next start, and nothing of it is stored.
            is_kept &= !self.has_key() || self.keep_timestamp(signing.key(), timestamp);
        }
        if !is_kept {
            self.untold.add(News::KeyNotKept);
        }
    }
}

/// Does not fly until the pilot has acted: whether a calibration was required is unknown, so it is.
#[inline(never)]
fn fall_back<S: Systems>(flight: &mut Flight<'_, S>) {
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
