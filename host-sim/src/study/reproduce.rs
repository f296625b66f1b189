//! Experiments of the papers and of the theory, our number beside theirs: what `foxhound reproduce` does.
//!
//! - [`circle`], `aoa-circle`: the main paper's angle-of-arrival experiment (fig. 8), a source on a circle of 5 m without
//!   noise. The paper reports a mean error of 1.48 deg and neither heights nor frequencies.
//! - [`crb`], `aoa-crb`: the rms error of whole frames, frequency unknown, over the Cramer-Rao bound of the square array,
//!   `sigma = lambda / (2 pi s cos(el) sqrt(N SNR))`.
//! - [`density`], `apf-density`: the main paper's planners on maps of growing obstacle density (Table I, fig. 9 and 10).
//! - [`localize`]: the mmWave paper's filters in line of sight and behind walls (fig. 2 and 3).
//! - [`variants`], `apf-variants`: the variants paper's four potential fields in its four scenes (Table I).
//! - [`mmwave`], `mmwave`: agents that search for a transmitter indoors (mmWave paper, Table 3, fig. 5 and 6).
//! - [`multipath`], `multipath`: the closed loop among walls that reflect, with and without filters.
//! - [`stretch`], `stretch`: excess travel of a vehicle that follows its turning antenna, outliers among its measurements (fig. 3
//!   and 4 of the rotating vehicle's paper), and a source that moves.
//!
//! Each experiment is a [`Study`]: a serialisable report with a table as text and pictures. [`Experiment`]
//! runs any of them by its name; [`gallery`] keeps all of them in a folder with a page.

pub mod circle;
pub mod crb;
pub mod density;
pub mod gallery;
pub mod localize;
pub mod mmwave;
pub mod multipath;
pub mod stretch;
pub mod variants;

mod beside;
mod chart;
mod experiment;
mod kinematic;
mod potential;
mod settings;

/// The citation of each paper. No address is a link: the page needs no network.
pub const PAPERS: [(&str, &str); 4] = [
    (
        "main paper",
        "S. M. Mulla, A. Kanakapudi, L. Narasimhan, A. Tiwari, \"RF-source Seeking with Obstacle Avoidance using Real-time Modified \
         Artificial Potential Fields in Unknown Environments\", Indian Institute of Technology Madras, 2025, arXiv:2506.06811.",
    ),
    (
        "variants paper",
        "A comparison of the traditional and three modified artificial potential fields for a quadrotor in four scenes: one obstacle, \
         two obstacles, a goal near an obstacle (GNRON), a dynamic obstacle. The copy that was worked from has neither title nor \
         authors; it begins \"Artificial potential field (APF) is the effective real-time guide\".",
    ),
    (
        "mmWave paper",
        "K. Pfeiffer, Y. Jia, M. Yin, A. K. Veldanda, Y. Hu, A. Trivedi, J. Zhang, S. Garg, E. Erkip, S. Rangan, L. Righetti, \"Path \
         Planning Under Uncertainty to Localize mmWave Sources\", 2023, arXiv:2303.03739.",
    ),
    (
        "rotating vehicle's paper",
        "S. Venkateswaran, J. T. Isaacs, K. Fregene, R. Ratmansky, B. M. Sadler, J. P. Hespanha, U. Madhow, \"RF Source-Seeking by a \
         Micro Aerial Vehicle using Rotation-Based Angle of Arrival Estimates\", American Control Conference, 2013.",
    ),
];

pub use experiment::{Beside, Experiment, Judgement, Outcome, Study, Verdict, Watch};
pub use kinematic::{Rules, Sight};
pub use settings::Settings;

use foxhound_core::ConfigError;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::doa::array;
use foxhound_core::doa::bearing::{self, Bearing, Estimator};
use foxhound_core::signal::phase::{self, Extractor, Phasors};
use foxhound_papers::aoa::AnyBearingEstimator;

use crate::world::wrap_pi;

/// An estimator under its name in the reports.
#[derive(Clone, Copy, Debug)]
struct Contender {
    name: &'static str,
    label: &'static str,
    estimator: Estimator,
}

/// Ours, and what becomes of the main paper's Algorithm 1 when its half-plane rule is mended.
const CONTENDERS: [Contender; 4] = [
    Contender { name: "paper", label: "paper, as printed", estimator: Estimator::PaperSquare },
    Contender { name: "paper_repaired", label: "paper, |theta| rule", estimator: Estimator::PaperRepaired },
    Contender { name: "paper_correlated", label: "paper, cross-correlation", estimator: Estimator::PaperCorrelated },
    Contender { name: "cross", label: "Foxhound", estimator: Estimator::CrossSpectrum },
];

/// The default array's estimator for each contender.
fn estimators() -> Result<[AnyBearingEstimator; CONTENDERS.len()], ConfigError> {
    let array = array::Config::default().build()?;
    let build = |contender: Contender| {
        let config = bearing::Config { estimator: contender.estimator, ..bearing::Config::default() };
        AnyBearingEstimator::build(&config, array)
    };
    let [a, b, c, d] = CONTENDERS.map(build);
    Ok([a?, b?, c?, d?])
}

/// The phasors of one frame that stands alone.
fn phasors<const N: usize>(extractor: &Extractor<N>, snapshot: &AdcFrame<N>) -> Phasors {
    extractor.step(&mut phase::State::default(), snapshot)
}

/// The error of a bearing, rad; `None` when it says that there is no direction.
fn error_rad(bearing: &Bearing, azimuth_rad: f64) -> Option<f64> {
    (bearing.sigma_rad < std::f32::consts::PI).then(|| wrap_pi(f64::from(bearing.azimuth_rad) - azimuth_rad))
}
