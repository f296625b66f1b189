//! # Foxhound papers
//!
//! The algorithms of the published papers that Foxhound is based on, as printed and repaired, if the vehicle does not
//! fly with them. The simulator, the benchmark and the twin of the firmware in QEMU compare them with those that fly,
//! which are in [`foxhound_core`]; the image for the vehicle links none of them. Like the core this crate has no
//! heap, no clock and no IO.
//!
//! | paper | module | as printed | repaired | command |
//! |---|---|---|---|---|
//! | main paper | [`aoa`] | Algorithm 1 with its half-plane rule; the pair, the crossings of two, three and more antennas | the half-plane by magnitudes, and by cross-correlation | `foxhound reproduce aoa-circle`, `aoa-crb`; `--estimator` |
//! | main paper | [`apf`] | Algorithm 2; eq. 47 as a distance; the plain field; descent by the gradient | eq. 47 as a signed offset; steps of a fixed length, whole or in quarters | `foxhound reproduce apf-density`; `--planner` |
//! | variants paper | [`apf`] | Khatib's, Rizqi's and Sun's fields and the virtual force | signs, directions and powers where forces and potentials contradict each other | `foxhound reproduce apf-variants` |
//! | mmWave paper | [`filters`] | the Cartesian filter, and both filters behind a wall | the polar filter behind walls that are known | `foxhound reproduce localize` |
//!
//! Other parts of the papers fly, or are shared with parts that fly, and are in the core: the potential field and the
//! sampling of the main paper (`planning`), the belief planner of the mmWave paper (`planning::ilqr`), the turning
//! antenna (`doa::rotating`).
//!
//! To fly with them, use [`AllSystems`] instead of the core's own systems; the configuration may then name any of
//! them.
//!
//! ## Sources
//!
//! - *Main paper*: S. M. Mulla, A. Kanakapudi, L. Narasimhan, A. Tiwari, "RF-source Seeking with Obstacle Avoidance using
//!   Real-time Modified Artificial Potential Fields in Unknown Environments", [arXiv 2506.06811](https://arxiv.org/abs/2506.06811).
//! - *Variants paper*: a comparison of potential fields on a quadrotor in four scenes with local minima.
//! - *mmWave paper*: K. Pfeiffer, Y. Jia, M. Yin, A. K. Veldanda, Y. Hu, A. Trivedi, J. Zhang, S. Garg, E. Erkip, S. Rangan,
//!   L. Righetti, "Path Planning Under Uncertainty to Localize mmWave Sources", [arXiv
//!   2303.03739](https://arxiv.org/abs/2303.03739).
//! - *Rotating vehicle's paper*: S. Venkateswaran, J. T. Isaacs, K. Fregene, R. Ratmansky, B. M. Sadler, J. P. Hespanha, U. Madhow,
//!   "RF Source-Seeking by a Micro Aerial Vehicle using Rotation-Based Angle of Arrival Estimates", American Control Conference, 2013.
//!
//! Numbers of equations are those of the named paper.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod aoa;
pub mod apf;
pub mod filters;
mod systems;

pub use systems::AllSystems;
