//! The start, with what was kept; and what is kept as the link goes on.
//!
//! | what was kept | what the vehicle does |
//! |---|---|
//! | parameters, all of them known and in range | flies with them |
//! | parameters, some unknown or out of range by now | flies with the others and the defaults of those, and says so |
//! | parameters that do not fit each other | says so, and holds with the outcome `Uncalibrated`: with the defaults, without a calibration, and with `FH_CAL_REQ` on, until somebody has looked at the parameters and switched it off or stored them and restarted |
//! | parameters whose newest record is damaged | the same; and does not move before parameters were stored, or everything was reset |
//! | a calibration whose newest record is damaged | says so, and does not move before a calibration was stored, or everything was reset |
//! | a key, or its timestamp, whose newest record is damaged | says so, and does not move before a key was set or taken away, or everything was reset; without the key it neither signs nor asks for signatures |
//! | a flash that refuses to be read | as with parameters that do not fit; and as without a calibration and a key |
//!
//! What does not move has the cause [`foxhound_link::failsafe::Cause::StoreDamaged`]. An older record is never taken in place of a
//! damaged one.
//!
//! Nothing of this is said, or done, where nothing was ever kept.

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
            Self::ParametersDropped => "Foxhound: some stored parameters are defaults",
            Self::CalibrationLost => "Foxhound: stored calibration lost",
            Self::KeyLost => "Foxhound: stored key lost: signs nothing",
            Self::TimestampLost => "Foxhound: stored time of the key lost",
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
            Kept::Lost => self.miss(Name::Calibration, News::CalibrationLost),
            Kept::Nothing => {}
        }
    }

    /// Goes on with the parameters and the key that were kept. To be called once, before the first step.
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

    /// What was kept under a name is damaged, unless the flash has nothing to read at all.
    #[inline(never)]
    fn miss(&mut self, name: Name, news: News) {
        self.untold.add(news);
        if !matches!(self.get(RECORDS, name as u8), Err(Trouble::Refused)) {
            self.damaged |= name.bit();
        }
    }

    /// Keeps what has changed of the signing, and tells what is to be told. To be called in every step, after the parameters
    /// were served and before anything is sent; does nothing to the flash while the vehicle is in control.
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

    /// A simulator sets everything up: what waits to be told holds no more, nor does what was damaged.
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
        // The time of a key goes on from what is kept; where that is damaged, only a key that is set anew has one.
        if self.damaged & Name::Timestamp.bit() != 0 && !is_other {
            return;
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
