//! What is received of the transmitter: the strongest path's angle of arrival and how often it was reflected.

use serde::Serialize;

use crate::world::Horizontal;
use crate::world::random::Random;
use crate::world::rays::{self, Wall};

/// Weaker than this, over the free wave at one metre, nothing is received: two reflections reach 25 m, one 63 m.
pub(super) const FLOOR_DB: f64 = -44.0;
/// Reflections that are traced. Three would lose 24 dB and be received within a path of 10 m only.
pub(super) const ORDER_MAX: usize = 2;

/// The state of the link, of the strongest path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Link {
    /// Direct.
    LineOfSight,
    /// Reflected once.
    FirstOrder,
    /// Reflected more often.
    HigherOrder,
    /// Too weak.
    None,
}

impl Link {
    /// All.
    pub(super) const ALL: [Self; 4] = [Self::LineOfSight, Self::FirstOrder, Self::HigherOrder, Self::None];

    /// The state as a classifier with this rate of errors tells it: any other one instead.
    pub(super) fn told(self, error_rate: f64, random: &mut Random) -> Self {
        let [error, which] = [random.uniform(), random.uniform()];
        if error >= error_rate {
            return self;
        }
        let others: Vec<Self> = Self::ALL.into_iter().filter(|other| *other != self).collect();
        others[libm::floor(which * others.len() as f64) as usize]
    }
}

/// The measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reception {
    /// By what path.
    pub(super) link: Link,
    /// From where, from north, clockwise; of no meaning when nothing is received.
    pub(super) bearing_rad: f64,
}

/// What a receiver measures.
pub(super) fn hear(walls: &[Wall], source: Horizontal, listener: Horizontal) -> Reception {
    let strongest = |order_max| {
        let found = rays::paths(walls, source, listener, order_max, -FLOOR_DB).into_iter().next();
        found.filter(|path| path.gain_db() >= FLOOR_DB)
    };
    // Nothing is shorter than the direct path, or loses less.
    match strongest(0).or_else(|| strongest(ORDER_MAX)) {
        None => Reception { link: Link::None, bearing_rad: 0.0 },
        Some(path) => {
            let link = match path.order {
                0 => Link::LineOfSight,
                1 => Link::FirstOrder,
                _ => Link::HigherOrder,
            };
            Reception { link, bearing_rad: path.bearing_rad(listener) }
        }
    }
}
