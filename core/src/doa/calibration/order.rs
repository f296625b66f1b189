//! Channel order: which antenna is on which channel.
//!
//! A plane wave from changing, known directions changes the phases in a way that only one assignment of antennas to
//! channels explains. For each of the 24, the frames' phasors are compared with the directions, and the residual over
//! the noise decides. With uncalibrated channels, their gains are estimated from the same frames
//! ([`Check::over_a_spin`]): constant gains cannot imitate another order while the direction changes. With calibrated
//! channels one known bearing may suffice ([`Check::of_calibrated`]), unless antennas are symmetric about it.
//!
//! The direction is needed: closure and wavenumber alone, over a spin of unknown direction, distinguish 3 classes of
//! orders, but not a square array from its rotations and mirror images, of which each class has eight.

use core::fmt;

use super::{LOOK_FREEDOM, Mean, Source, Taken, mean_noise, usable};
use crate::base::adc::CHANNELS;
use crate::doa::array::Array;
use crate::signal::phase::{Complex, Phasors};

/// Number of orders.
const ORDERS: usize = 24;
/// The best order's residual must be smaller than the next by this factor.
const CLEARLY: f32 = 4.0;
/// Phase errors larger than this, in rad squared, fit no array: 30 deg.
const POOR: f32 = 0.27;

/// The order of the channels by the measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Order {
    /// The configured order fits.
    AsConfigured,
    /// Two channels, 0..4, are swapped.
    Swapped(usize, usize),
    /// Antenna `m` is on channel `order[m]`.
    Permuted([usize; CHANNELS]),
    /// The configured order does not fit, and no other is clearly better.
    Undecided,
}

impl fmt::Display for Order {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::AsConfigured => f.write_str("the channels are in order"),
            Self::Swapped(a, b) => write!(f, "channels {} and {} look swapped", a + 1, b + 1),
            Self::Permuted([a, b, c, d]) => {
                write!(f, "antennas 1 to 4 look to be on channels {}, {}, {}, {}", a + 1, b + 1, c + 1, d + 1)
            }
            Self::Undecided => f.write_str("the phases do not fit the array in any order of the channels"),
        }
    }
}

/// The `k`th order, 0..24; the first is the identity.
fn order(k: usize) -> [usize; CHANNELS] {
    let mut order = [0, 1, 2, 3];
    let mut rest = k;
    for (m, choices) in [6, 2, 1].into_iter().enumerate() {
        // The picked one is moved before the remaining ones.
        for picked in (m..m + rest / choices).rev() {
            if let Some([before, after]) = order.get_mut(picked..picked + 2) {
                core::mem::swap(before, after);
            }
        }
        rest %= choices;
    }
    order
}

/// Compares all orders, frame by frame.
#[derive(Clone, Copy, Debug)]
pub struct Check {
    fits: [Mean; ORDERS],
    learns: bool,
}

impl Check {
    /// For channels of unknown gains; needs frames from all around, and is undecided or content before.
    #[must_use]
    pub fn over_a_spin() -> Self {
        Self { fits: [Mean::default(); ORDERS], learns: true }
    }

    /// For channels whose gains are in the array's table.
    #[must_use]
    pub fn of_calibrated() -> Self {
        Self { fits: [Mean::EQUAL; ORDERS], learns: false }
    }

    /// Takes a frame; a refused one changes nothing.
    pub fn step(&mut self, array: &Array, source: Source, phasors: &Phasors) -> Taken {
        let taken = usable(phasors);
        if taken != Taken::Yes {
            return taken;
        }
        let noise = mean_noise(phasors);
        let z = if self.learns { phasors.z } else { array.at(phasors.frequency_hz).correct(&phasors.z) };
        let expected = source.phasors(array);
        for (k, fit) in self.fits.iter_mut().enumerate() {
            let order = order(k);
            let y: [Complex; CHANNELS] = core::array::from_fn(|m| z[order[m] % CHANNELS].times_conj(expected[m]));
            if self.learns {
                fit.learn(&y, noise);
            } else {
                fit.compare(&y, noise);
            }
        }
        Taken::Yes
    }

    /// The verdict so far.
    #[must_use]
    pub fn order(&self) -> Order {
        // A residual below the noise counts as the noise.
        let left = |fit: &Mean| {
            let freedom = LOOK_FREEDOM * (fit.looks - u32::from(self.learns && fit.looks > 0)) as f32;
            (fit.scatter / freedom.max(1.0)).max(1.0)
        };
        let as_is = left(&self.fits[0]);
        if self.fits[0].looks == 0 {
            return Order::AsConfigured;
        }
        let (mut best, mut least, mut next) = (0, as_is, f32::INFINITY);
        for (k, fit) in self.fits.iter().enumerate().skip(1) {
            let left = left(fit);
            if left < least {
                (best, least, next) = (k, left, least);
            } else if left < next {
                next = left;
            }
        }
        if as_is < CLEARLY * least {
            let signal = self.fits[0].weight / self.fits[0].looks as f32;
            return if as_is > POOR * signal { Order::Undecided } else { Order::AsConfigured };
        }
        if next < CLEARLY * least {
            return Order::Undecided;
        }
        let order = order(best);
        let mut moved = (0..CHANNELS).filter(|m| order.get(*m) != Some(m));
        match (moved.next(), moved.next(), moved.next()) {
            (Some(a), Some(b), None) => Order::Swapped(a, b),
            _ => Order::Permuted(order),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::doa::calibration::tests::{Receiver, square};
    use std::string::ToString;
    use std::vec::Vec;

    fn array() -> Array {
        square().build().unwrap()
    }

    /// The frames of a spin, or one, with the channels in some order.
    fn verdict(mut check: Check, receiver: &Receiver, on: [usize; 4], azimuths: &[f64], seed: u64) -> Order {
        let mut rng = Rng::new(seed, 1);
        for azimuth in azimuths {
            let mut phasors = receiver.phasors(Some(*azimuth), &mut rng);
            let truth = phasors.z;
            for m in 0..4 {
                phasors.z[on[m]] = truth[m];
            }
            assert_eq!(check.step(&array(), Source::ahead_at(*azimuth as f32), &phasors), Taken::Yes);
        }
        check.order()
    }

    fn spin() -> Vec<f64> {
        (0..24).map(|k| f64::from(k) * 15_f64.to_radians()).collect()
    }

    #[test]
    fn the_orders_are_all_there_are_and_the_first_is_none() {
        let mut all: Vec<_> = (0..ORDERS).map(order).collect();
        assert_eq!(all[0], [0, 1, 2, 3]);
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), 24);
        for order in all {
            let mut sorted = order;
            sorted.sort_unstable();
            assert_eq!(sorted, [0, 1, 2, 3]);
        }
    }

    #[test]
    fn a_spin_finds_every_order_though_the_channels_are_tens_of_degrees_apart() {
        let receiver = Receiver { gain: [1.0, 0.7, 1.0, 0.85], phase_rad: [0.0, 0.8, -0.5, 1.2], snr_db: 10.0 };
        for k in 0..ORDERS {
            let on = order(k);
            let found = verdict(Check::over_a_spin(), &receiver, on, &spin(), k as u64);
            let moved: Vec<_> = (0..4).filter(|m| on[*m] != *m).collect();
            match moved[..] {
                [] => assert_eq!(found, Order::AsConfigured),
                [a, b] => assert_eq!(found, Order::Swapped(a, b)),
                _ => assert_eq!(found, Order::Permuted(on)),
            }
        }
    }

    #[test]
    fn one_known_bearing_finds_a_swap_of_calibrated_channels() {
        let receiver = Receiver { phase_rad: [0.0, 0.03, -0.02, 0.01], ..Receiver::IDEAL };
        for (a, b) in [(0, 1), (1, 2), (2, 3), (0, 3), (0, 2), (1, 3)] {
            let mut on = [0, 1, 2, 3];
            on.swap(a, b);
            assert_eq!(verdict(Check::of_calibrated(), &receiver, on, &[0.5], 3), Order::Swapped(a, b));
        }
        assert_eq!(verdict(Check::of_calibrated(), &receiver, [0, 1, 2, 3], &[0.5], 3), Order::AsConfigured);
        // Straight ahead the two front antennas receive the same: their swap cannot be detected, and is not reported.
        assert_eq!(verdict(Check::of_calibrated(), &receiver, [1, 0, 2, 3], &[0.0], 3), Order::AsConfigured);
    }

    #[test]
    fn too_little_to_go_by_is_no_verdict_against_the_order() {
        assert_eq!(Check::over_a_spin().order(), Order::AsConfigured);
        assert_eq!(verdict(Check::over_a_spin(), &Receiver::IDEAL, [0, 2, 1, 3], &[0.5], 1), Order::AsConfigured);
        let receiver = Receiver { phase_rad: [0.0, 2.0, -1.9, 0.4], ..Receiver::IDEAL };
        let found = verdict(Check::of_calibrated(), &receiver, [0, 1, 2, 3], &spin(), 5);
        assert_eq!(found, Order::Undecided, "constant phases of 100 deg are no order");
    }

    #[test]
    fn orders_are_reported_by_the_channels_numbers() {
        assert_eq!(Order::Swapped(1, 2).to_string(), "channels 2 and 3 look swapped");
        assert_eq!(Order::Permuted([1, 2, 0, 3]).to_string(), "antennas 1 to 4 look to be on channels 2, 3, 1, 4");
    }
}
