//! What runs beside the link: guidance, which is built anew with other parameters.

use std::f32::consts::PI;
use std::sync::OnceLock;

use foxhound_core::base::error::{ConfigError, Why};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::ownship::Ownship;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::{Bearing, Flags, Quality};
use foxhound_core::guidance::mission::{Control, Outcome};
use foxhound_core::guidance::param::{Id, Values};
use foxhound_core::guidance::{self, FrontEnd, Guidance, Input, Output};
use foxhound_core::localize::source::support::SourcePosition;

use super::Draw;

/// To build guidance takes as long as all the rest of a case.
const TRIES: u8 = 2;
const TRIED: ConfigError = ConfigError { field: "tried enough", value: 0.0, why: Why::NotFinite };

pub(super) struct Application {
    config: guidance::Config,
    tries: u8,
}

impl Application {
    pub(super) fn new() -> Self {
        Self { config: guidance::Config::default(), tries: 0 }
    }

    /// As the firmware does it. What builds must also fly: a first step is finite and stands still.
    pub(super) fn adopt(&mut self, id: Id, values: &Values) -> Result<(), ConfigError> {
        if self.tries == TRIES {
            return Err(TRIED);
        }
        self.tries += 1;
        let mut config = self.config;
        values.apply_one(id, &mut config);
        let guidance = config.build::<64>()?;
        config.build_planner()?;
        let again = Values::of(&config).get(id);
        let says_so = (again - values.get(id)).abs() <= 1e-5 * values.get(id).abs();
        assert!(says_so || again == id.default(), "{}: {} came to {again}", id.name(), values.get(id));
        let output = first_step(&guidance, Control::Granted);
        assert!(output.setpoint.velocity_ned_mps.is_finite() && output.setpoint.yaw_rate_radps.is_finite());
        self.config = config;
        Ok(())
    }
}

fn first_step(guidance: &Guidance<64>, control: Control) -> Output {
    let input = Input {
        now: Instant(0),
        front_end: FrontEnd::Nothing,
        ownship: (control == Control::Granted).then(Ownship::default),
        scan: None,
        points: None,
        circles: None,
        look: None,
        height_m: None,
        is_landed: false,
        control,
        answer: None,
    };
    guidance.step(&mut guidance.start(), &input)
}

/// An output of guidance with any numbers.
pub(super) fn output(draw: &mut Draw<'_>) -> Output {
    static SILENT: OnceLock<Output> = OnceLock::new();
    let mut output = *SILENT.get_or_init(|| match guidance::Config::default().build() {
        Ok(guidance) => first_step(&guidance, Control::LinkLost),
        Err(error) => unreachable!("the default configuration: {error}"),
    });
    let velocity = &mut output.setpoint.velocity_ned_mps;
    (velocity.north, velocity.east, velocity.down) = (draw.any(-3.0, 3.0), draw.any(-3.0, 3.0), draw.any(-3.0, 3.0));
    output.setpoint.yaw_rate_radps = draw.any(-1.0, 1.0);
    output.source_bearing_ned_rad = draw.flag().then(|| draw.any(-PI, PI));
    output.outcome =
        [Outcome::Nominal, Outcome::Nominal, Outcome::NoSignal, Outcome::Fault][usize::from(draw.below(4))];
    if draw.below(4) == 0 {
        output.bearing = Some(Bearing {
            time: Instant(0),
            valid: draw.flag(),
            azimuth_rad: draw.any(-PI, PI),
            sigma_rad: 0.1,
            elevation_rad: draw.any(-1.5, 1.5),
            elevation_sigma_rad: 0.1,
            quality: Quality::default(),
            flags: Flags(0),
        });
        let place_ned_m = Horizontal { north: draw.any(-20.0, 20.0), east: draw.any(-20.0, 20.0) };
        output.source = Some(SourcePosition { place_ned_m, sigma_m: draw.any(0.0, 2.0) });
    }
    output
}
