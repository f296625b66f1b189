//! The parameters that an operator tunes, each with its name, unit, range, default, the field of the configuration that
//! holds it, and a sentence of description.
//!
//! There is one [`TABLE`]. The ground station's list, the checks of values, the manual's page and the command
//! `foxhound params` all come from it. Every value is a 32-bit float, so that the packing of integers is never
//! ambiguous; a [`Kind::Whole`] accepts whole numbers only.
//!
//! The rows are constants. The firmware contains only a compact form, computed at compile time: name, range, default,
//! kind and field, 44 bytes each. Units and descriptions are not linked.
//!
//! Parameters of guidance go into its configuration ([`Values::apply`]); the link reads its own by their [`Id`]. Here
//! each value is checked by itself; only `guidance::Config::build` can tell whether all of them fit together.

mod id;
mod parts;
mod table;

use crate::guidance::Config;

pub use id::*;
pub use table::TABLE;

/// Longest name, as MAVLink has it.
pub const NAME_MAX: usize = 16;
/// Number of parameters.
pub const COUNT: usize = TABLE.len();

/// The kind of values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Kind {
    /// Any in its range.
    Real,
    /// Whole numbers: counts, choices, and switches (0 or 1).
    Whole,
}

/// Where a value is.
#[derive(Clone, Copy, Debug)]
pub enum Field {
    /// A field of the configuration of guidance.
    Value(fn(&mut Config) -> &mut f32),
    /// The same, 0 or 1.
    Switch(fn(&mut Config) -> &mut bool),
    /// What is not a field by itself: how it is read, if the configuration has it, and written.
    Parts(fn(&Config) -> Option<f32>, fn(&Values, &mut Config)),
    /// The link reads it by its [`Id`].
    Link,
}

/// One row of the table.
#[derive(Clone, Copy, Debug)]
pub struct Param {
    /// Name, in upper case.
    pub name: &'static str,
    /// Unit as ground stations print it; empty where there is none.
    pub unit: &'static str,
    /// Default value.
    pub default: f32,
    /// Smallest value.
    pub min: f32,
    /// Largest value.
    pub max: f32,
    /// Kind of values.
    pub kind: Kind,
    /// Where the value is.
    pub field: Field,
    /// Description.
    pub doc: &'static str,
}

/// The compact form of a row in the firmware.
#[derive(Clone, Copy, Debug)]
struct Wire {
    name: [u8; NAME_MAX],
    default: f32,
    min: f32,
    max: f32,
    kind: Kind,
    field: Field,
}

static WIRE: [Wire; COUNT] = wire();

const fn wire() -> [Wire; COUNT] {
    let mut wire =
        [Wire { name: [0; NAME_MAX], default: 0.0, min: 0.0, max: 0.0, kind: Kind::Real, field: Field::Link }; COUNT];
    let mut row = 0;
    while row < COUNT {
        let Param { name, default, min, max, kind, field, .. } = TABLE[row];
        let name = name.as_bytes();
        let mut at = 0;
        // A longer name does not compile.
        while at < name.len() {
            wire[row].name[at] = name[at];
            at += 1;
        }
        (wire[row].default, wire[row].min, wire[row].max) = (default, min, max);
        (wire[row].kind, wire[row].field) = (kind, field);
        row += 1;
    }
    wire
}

const DEFAULTS: [f32; COUNT] = {
    let mut defaults = [0.0; COUNT];
    let mut row = 0;
    while row < COUNT {
        defaults[row] = TABLE[row].default;
        row += 1;
    }
    defaults
};

/// Distinguishes tables with other names, or with the same names in another order: stored values belong to one table.
/// FNV-1a over the names.
pub const LAYOUT: u32 = {
    let mut hash = 0x811C_9DC5_u32;
    let mut row = 0;
    while row < COUNT {
        let name = TABLE[row].name.as_bytes();
        let mut at = 0;
        while at <= name.len() {
            let byte = if at < name.len() { name[at] } else { 0 };
            hash = (hash ^ byte as u32).wrapping_mul(0x0100_0193);
            at += 1;
        }
        row += 1;
    }
    hash
};

/// A parameter of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Id(u8);

impl Id {
    /// For constants: a name that is not in the table does not compile.
    const fn of(name: &str) -> Self {
        let name = name.as_bytes();
        let mut row = 0;
        while !same(TABLE[row].name.as_bytes(), name) {
            row += 1;
        }
        Self(row as u8)
    }

    /// The parameter with that number.
    #[must_use]
    pub fn at(index: usize) -> Option<Self> {
        (index < COUNT).then_some(Self(index as u8))
    }

    /// The parameter with that name, which ends at its first zero or with the slice.
    #[must_use]
    pub fn named(name: &[u8]) -> Option<Self> {
        let name = name.split(|byte| *byte == 0).next().unwrap_or_default();
        WIRE.iter()
            .position(|row| {
                row.name.get(..name.len()) == Some(name) && row.name.get(name.len()).is_none_or(|byte| *byte == 0)
            })
            .and_then(Self::at)
    }

    /// All parameters, in order.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..COUNT).filter_map(Self::at)
    }

    /// Its number.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize
    }

    /// Its name, padded with zeros.
    #[must_use]
    pub fn padded_name(self) -> &'static [u8; NAME_MAX] {
        &self.wire().name
    }

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        let name = self.padded_name();
        let length = name.iter().position(|byte| *byte == 0).unwrap_or(NAME_MAX);
        name.get(..length).and_then(|name| core::str::from_utf8(name).ok()).unwrap_or_default()
    }

    /// Its default value.
    #[must_use]
    pub fn default(self) -> f32 {
        self.wire().default
    }

    /// Its smallest and its largest value.
    #[must_use]
    pub fn range(self) -> (f32, f32) {
        (self.wire().min, self.wire().max)
    }

    /// Whether it is a switch, a choice or a count.
    #[must_use]
    pub fn is_whole(self) -> bool {
        self.wire().kind == Kind::Whole
    }

    /// Whether it may have this value, regardless of all others.
    ///
    /// # Errors
    /// Why it may not.
    pub fn check(self, value: f32) -> Result<(), Refusal> {
        let Wire { min, max, kind, .. } = *self.wire();
        if !value.is_finite() {
            return Err(Refusal::NotFinite);
        }
        if value < min || value > max {
            return Err(Refusal::OutOfRange { min, max });
        }
        if kind == Kind::Whole && libm::roundf(value) != value {
            return Err(Refusal::NotWhole);
        }
        Ok(())
    }

    fn wire(self) -> &'static Wire {
        // Every constructor checks the range, so the first row is never returned for another.
        WIRE.get(self.index()).unwrap_or(&WIRE[0])
    }
}

const fn same(a: &[u8], b: &[u8]) -> bool {
    let mut at = 0;
    while at < a.len() && at < b.len() && a[at] == b[at] {
        at += 1;
    }
    at == a.len() && at == b.len()
}

/// Why a value was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// Not a finite number.
    NotFinite,
    /// Outside the closed range.
    OutOfRange {
        /// Smallest value.
        min: f32,
        /// Largest value.
        max: f32,
    },
    /// Not a whole number, and it must be one.
    NotWhole,
}

impl core::fmt::Display for Refusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NotFinite => f.write_str("is not a finite number"),
            Self::OutOfRange { min, max } => write!(f, "is outside {min}..={max}"),
            Self::NotWhole => f.write_str("is not a whole number"),
        }
    }
}

impl core::error::Error for Refusal {}

/// A value for each parameter, each in its range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Values([f32; COUNT]);

impl Default for Values {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Values {
    /// The default of every parameter.
    pub const DEFAULT: Self = Self(DEFAULTS);

    /// Restores stored values, of this table's [`LAYOUT`]. A value that is refused by now gets its default; returns
    /// how many.
    #[must_use]
    pub fn restore(stored: &[f32; COUNT]) -> (Self, usize) {
        let (mut values, mut refused) = (Self::DEFAULT, 0);
        for (id, value) in Id::all().zip(stored) {
            refused += usize::from(values.set(id, *value).is_err());
        }
        (values, refused)
    }

    /// The values to store.
    #[must_use]
    pub const fn as_array(&self) -> &[f32; COUNT] {
        &self.0
    }

    /// A value.
    #[must_use]
    pub fn get(&self, id: Id) -> f32 {
        self.0.get(id.index()).copied().unwrap_or_default()
    }

    /// Whether a switch is on.
    #[must_use]
    pub fn is_on(&self, id: Id) -> bool {
        self.get(id) != 0.0
    }

    /// A choice or a count.
    #[must_use]
    pub fn whole(&self, id: Id) -> u32 {
        self.get(id) as u32
    }

    /// Sets a value.
    ///
    /// # Errors
    /// Why it is refused; then the old value is kept.
    pub fn set(&mut self, id: Id, value: f32) -> Result<(), Refusal> {
        id.check(value)?;
        // There is only one zero: -0 would be another value on the link.
        if let Some(slot) = self.0.get_mut(id.index()) {
            *slot = value + 0.0;
        }
        Ok(())
    }

    /// The parameters that correspond to a configuration of guidance. A value that the table cannot express gets its
    /// default, and so do the parameters of the link.
    #[must_use]
    pub fn of(config: &Config) -> Self {
        let (mut values, mut fields) = (Self::DEFAULT, *config);
        for id in Id::all() {
            let value = match id.wire().field {
                Field::Value(field) => Some(*field(&mut fields)),
                Field::Switch(field) => Some(f32::from(*field(&mut fields))),
                Field::Parts(read, _) => read(config),
                Field::Link => None,
            };
            if let Some(value) = value {
                // If refused, it stays the default.
                let _ = values.set(id, value);
            }
        }
        values
    }

    /// Writes every parameter of guidance into its configuration. The antennas become the square of `FH_ARR_SIDE`;
    /// fields without a parameter are unchanged.
    pub fn apply(&self, config: &mut Config) {
        for id in Id::all() {
            self.apply_one(id, config);
        }
    }

    /// Writes one parameter into the configuration; parameters of the link have no field there.
    pub fn apply_one(&self, id: Id, config: &mut Config) {
        match id.wire().field {
            Field::Value(field) => *field(config) = self.get(id),
            Field::Switch(field) => *field(config) = self.is_on(id),
            Field::Parts(_, write) => write(self, config),
            Field::Link => {}
        }
    }
}

#[cfg(test)]
mod tests;
