//! The vehicle in tests of the guard and of guidance: it follows setpoints after a dead time and with a lag, as
//! [`vehicle_model`](super::vehicle_model) predicts.

use std::collections::VecDeque;

use crate::base::ned::Horizontal;
use crate::base::units::wrap_pi;
use crate::control::guard::Setpoint;

/// A step of guidance.
const DT_S: f32 = 0.02;

pub(crate) struct Vehicle {
    pub(crate) position: Horizontal,
    pub(crate) velocity: Horizontal,
    pub(crate) yaw_rad: f32,
    pub(crate) lag_s: f32,
    /// Setpoints received but not followed yet: the dead time.
    pub(crate) pending: VecDeque<Setpoint>,
}

impl Vehicle {
    /// One that stands still and heads north, with a dead time of `steps` steps.
    pub(crate) fn new(position: Horizontal, steps: usize, lag_s: f32) -> Self {
        let pending = std::vec![Setpoint::default(); steps].into();
        Self { position, velocity: Horizontal::default(), yaw_rad: 0.0, lag_s, pending }
    }

    /// One step.
    pub(crate) fn follow(&mut self, setpoint: &Setpoint) {
        self.pending.push_back(*setpoint);
        let acting = self.pending.pop_front().unwrap();
        let change = acting.velocity_ned_mps.horizontal().minus(self.velocity);
        self.velocity = self.velocity.plus(change.times(DT_S / self.lag_s.max(DT_S)));
        self.position = self.position.plus(self.velocity.times(DT_S));
        self.yaw_rad = wrap_pi(self.yaw_rad + acting.yaw_rate_radps * DT_S);
    }
}
