//! A control cycle: what is known in it, and how far it goes.

use super::known::Known;
use super::radio::Link;
use crate::world::Horizontal;

/// Control cycles of a period.
pub(super) const PERIOD: u32 = 10;
/// Longest step of a control cycle.
pub(super) const STEP_M: f64 = 0.5;

/// Input of an agent at a control cycle.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<'a> {
    /// Which cycle it is.
    pub(super) cycle: u32,
    /// The map so far.
    pub(super) known: &'a Known,
    /// Points of the scan, in the order of their bearings.
    pub(super) scan: &'a [Horizontal],
    /// Where the robot is.
    pub(super) place: Horizontal,
    /// The state of the link.
    pub(super) link: Link,
    /// The angle of arrival, from north, clockwise.
    pub(super) bearing_rad: f64,
}
