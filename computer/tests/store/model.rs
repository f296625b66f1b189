//! What should be kept, and what is done to it.

use foxhound_computer::flight::ParameterStore as _;
use foxhound_computer::store::{Kept, Store};
use foxhound_core::doa::array::{Entry, Table};
use foxhound_core::doa::calibration::deviation::Deviation;
use foxhound_core::doa::calibration::record::Calibration;
use foxhound_core::guidance::param::{Id, Values};
use foxhound_link::signing::Key;

use crate::flash::{Flash, Random};

/// Something that is done with the store.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Deed {
    Begin,
    Parameters(Values),
    Calibration(Calibration),
    Key(Option<[u8; 32]>),
    Timestamp(u64),
    Reset,
}

/// What the store holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Model {
    pub(crate) starts: u32,
    pub(crate) parameters: Kept<Values>,
    pub(crate) calibration: Kept<Calibration>,
    pub(crate) key: Kept<[u8; 32]>,
    pub(crate) timestamp: u64,
}

impl Model {
    pub(crate) const EMPTY: Self =
        Self { starts: 0, parameters: Kept::Nothing, calibration: Kept::Nothing, key: Kept::Nothing, timestamp: 0 };

    /// What a start finds.
    pub(crate) fn found(store: &mut Store<&mut Flash>) -> Self {
        let starts = store.begin();
        let parameters = match store.parameters() {
            Kept::Found(restored) => {
                assert_eq!(restored.dropped, 0, "what is read is what was written");
                Kept::Found(restored.values)
            }
            Kept::Nothing => Kept::Nothing,
            Kept::Lost => Kept::Lost,
        };
        let (key, timestamp) = match store.key() {
            Kept::Found((key, timestamp)) => (Kept::Found(*key.secret()), timestamp),
            Kept::Nothing => (Kept::Nothing, 0),
            Kept::Lost => (Kept::Lost, 0),
        };
        Self { starts, parameters, calibration: store.calibration(), key, timestamp }
    }

    /// What should be there afterwards.
    #[must_use]
    pub(crate) fn after(mut self, deed: &Deed) -> Self {
        match *deed {
            Deed::Begin => self.starts += 1,
            Deed::Parameters(values) => self.parameters = Kept::Found(values),
            Deed::Calibration(calibration) => self.calibration = Kept::Found(calibration),
            Deed::Key(key) => {
                // A timestamp belongs to its key.
                if key.map_or(Kept::Nothing, Kept::Found) != self.key {
                    self.timestamp = 0;
                }
                self.key = key.map_or(Kept::Nothing, Kept::Found);
            }
            Deed::Timestamp(timestamp) if self.key != Kept::Nothing => self.timestamp = timestamp,
            Deed::Timestamp(_) => {}
            Deed::Reset => self = Self { starts: self.starts, ..Self::EMPTY },
        }
        self
    }

    /// Whether every part is that of one or of the other.
    pub(crate) fn is_of(&self, old: &Self, new: &Self) -> bool {
        let starts = (old.starts..=new.starts + 1).contains(&self.starts);
        let has_key_of = |model: &Self| (self.key, self.timestamp) == (model.key, model.timestamp);
        // While a key is forgotten its timestamp may go first; a key without one is told the time by its peers.
        let is_half_gone = self.key == old.key && new.key == Kept::Nothing && self.timestamp == 0;
        starts
            && [old.parameters, new.parameters].contains(&self.parameters)
            && [old.calibration, new.calibration].contains(&self.calibration)
            && (has_key_of(old) || has_key_of(new) || is_half_gone)
    }
}

impl Deed {
    /// Any, as they come: parameters oftenest.
    pub(crate) fn any(random: &mut Random) -> Self {
        match random.below(16) {
            0 => Self::Reset,
            1 | 2 => Self::Calibration(calibration(random)),
            3 => Self::Key(None),
            4 | 5 => Self::Key(Some(core::array::from_fn(|_| random.next() as u8 | 1))),
            6..10 => Self::Timestamp(1 + random.below(1 << 47)),
            10 | 11 => Self::Begin,
            _ => Self::Parameters(parameters(random)),
        }
    }

    /// Does it; false where the store says that it could not.
    pub(crate) fn is_done(&self, store: &mut Store<&mut Flash>, model: &Model) -> bool {
        match self {
            Self::Begin => store.begin() > 0,
            Self::Parameters(values) => store.save(values),
            Self::Calibration(calibration) => store.keep_calibration(calibration),
            Self::Key(key) => store.keep_key(key.and_then(Key::new).as_ref()),
            Self::Timestamp(timestamp) => match model.key {
                Kept::Found(key) => store.keep_timestamp(&Key::new(key).unwrap(), *timestamp),
                _ => true,
            },
            Self::Reset => store.reset(),
        }
    }
}

/// Values all over their ranges.
pub(crate) fn parameters(random: &mut Random) -> Values {
    let mut values = Values::DEFAULT;
    for id in Id::all() {
        let (min, max) = id.range();
        let value = min + (max - min) * (random.below(1001) as f32 / 1000.0);
        // A switch takes whole numbers only, and keeps its default where it does not.
        let _ = values.set(id, value);
    }
    assert_ne!(values, Values::DEFAULT);
    values
}

pub(crate) fn calibration(random: &mut Random) -> Calibration {
    let mut number = || random.below(1000) as f32 * 1e-3;
    let entry = Entry {
        frequency_hz: 20_000.0 + number(),
        gain: [(); 4].map(|()| 0.5 + number()),
        phase_rad: [(); 4].map(|()| number()),
        residual_rad: number(),
        temperature_c: Some(number()),
    };
    let deviation = Deviation { constant_rad: number(), ..Deviation::default() };
    Calibration { table: Table::new(0.345, &[entry]).unwrap(), deviation }
}
