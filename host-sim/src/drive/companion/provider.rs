//! Who provides the obstacles of a flight beside an autopilot.
//!
//! The beacon is always simulated; obstacles need not be. Whom the flying computer hears it decides itself, and nothing here takes any
//! of it away. Only with a file, or where nobody has said anything and nobody tells of obstacles, does the driver deliver looks of a
//! simulated sensor.

use foxhound_core::base::time::Instant;

use crate::scenario::Obstacle;

/// An autopilot that has told of no obstacle for so long since its position is known has nothing to tell.
const DECIDED_AFTER_S: f32 = 1.5;

/// What the user says of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Provider {
    /// Nothing: the autopilot where it tells of obstacles, else a simulated sensor that sees an empty world.
    #[default]
    Unsaid,
    /// A simulated sensor sees these.
    File(Vec<Obstacle>),
    /// The autopilot alone.
    Autopilot,
    /// Nobody: the vehicle moves only where its parameters let it fly blind.
    Nobody,
}

impl Provider {
    /// The obstacles of the simulated world.
    #[must_use]
    pub fn simulated(&self) -> &[Obstacle] {
        match self {
            Self::File(obstacles) => obstacles,
            Self::Unsaid | Self::Autopilot | Self::Nobody => &[],
        }
    }
}

/// Who provides them as it turns out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Eyes {
    /// It is not decided yet; until then nobody.
    Undecided,
    /// A simulated sensor, of the obstacles of a file.
    File,
    /// The autopilot.
    Autopilot,
    /// A simulated sensor, of an empty world.
    SimulatedEmpty,
    /// Nobody.
    Nobody,
}

impl Eyes {
    /// Its name in the report.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Undecided => "undecided",
            Self::File => "file",
            Self::Autopilot => "autopilot",
            Self::SimulatedEmpty => "simulated_empty",
            Self::Nobody => "none",
        }
    }

    /// What the pilot is told, in 50 bytes.
    #[must_use]
    pub const fn text(self) -> Option<&'static str> {
        match self {
            Self::Undecided => None,
            Self::File => Some("Foxhound: obstacles are simulated, from a file"),
            Self::Autopilot => Some("Foxhound: obstacles are the autopilot's alone"),
            Self::SimulatedEmpty => Some("Foxhound: no sensor heard, simulates empty world"),
            Self::Nobody => Some("Foxhound: NO obstacle sensor (--obstacles none)"),
        }
    }

    /// Whether a simulated sensor delivers looks; only then is it known where the obstacles are.
    #[must_use]
    pub const fn is_simulated(self) -> bool {
        matches!(self, Self::File | Self::SimulatedEmpty)
    }
}

/// Finds out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chooser {
    eyes: Eyes,
    is_said: bool,
    since: Option<Instant>,
}

impl Chooser {
    pub(super) const fn new(provider: &Provider) -> Self {
        let eyes = match provider {
            Provider::Unsaid => Eyes::Undecided,
            Provider::File(_) => Eyes::File,
            Provider::Autopilot => Eyes::Autopilot,
            Provider::Nobody => Eyes::Nobody,
        };
        Self { eyes, is_said: !matches!(provider, Provider::Unsaid), since: None }
    }

    pub(super) const fn eyes(self) -> Eyes {
        self.eyes
    }

    /// A step in which the position is known. Who has once told of obstacles has eyes, and is waited for where he falls silent.
    pub(super) fn step(&mut self, now: Instant, is_told: bool) {
        let since = *self.since.get_or_insert(now);
        if self.is_said {
            return;
        }
        if is_told {
            self.eyes = Eyes::Autopilot;
        } else if self.eyes == Eyes::Undecided && now.seconds_since(since) > DECIDED_AFTER_S {
            self.eyes = Eyes::SimulatedEmpty;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_autopilot_that_tells_has_eyes_for_good_and_one_that_does_not_is_waited_for() {
        let at = |s: u64| Instant(s * 1_000_000);
        let mut chooser = Chooser::new(&Provider::Unsaid);
        chooser.step(at(1), false);
        assert_eq!(chooser.eyes(), Eyes::Undecided);
        chooser.step(at(5), false);
        assert_eq!(chooser.eyes(), Eyes::SimulatedEmpty);
        chooser.step(at(9), true);
        chooser.step(at(99), false);
        assert_eq!(chooser.eyes(), Eyes::Autopilot, "late is not too late, and silence no empty world");
    }

    #[test]
    fn what_is_said_stays() {
        for (provider, eyes) in [
            (Provider::File(Vec::new()), Eyes::File),
            (Provider::Autopilot, Eyes::Autopilot),
            (Provider::Nobody, Eyes::Nobody),
        ] {
            let mut chooser = Chooser::new(&provider);
            chooser.step(Instant(0), true);
            chooser.step(Instant(9_000_000), false);
            assert_eq!(chooser.eyes(), eyes);
        }
    }

    #[test]
    fn texts_fit_a_message() {
        for eyes in [Eyes::File, Eyes::Autopilot, Eyes::SimulatedEmpty, Eyes::Nobody] {
            assert!(eyes.text().is_some_and(|text| text.len() <= 50), "{eyes:?}");
        }
    }
}
