//! Textures of the ground, made of noise.

use super::light::{Colour, each};

/// Material of the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ground {
    /// Blades of two greens, with dry patches.
    Grass,
    /// Stones.
    Gravel,
    /// Smooth and grey, with stains.
    Concrete,
    /// Square stones with joints.
    Tiles {
        /// Side of one.
        side_m: f32,
        /// Their colour.
        colour: Colour,
    },
    /// Earth, from sand to red-brown.
    Soil {
        /// Its colour.
        colour: Colour,
    },
    /// Grass grown over earth and stones.
    Mixed,
    /// One colour.
    Plain(Colour),
}

impl Ground {
    /// The colour of a point, averaged over a pixel of that width.
    pub(super) fn colour(&self, north_m: f32, east_m: f32, pixel_m: f32, seed: u64) -> Colour {
        let noise = |size_m: f32, kind: u32| {
            // Structures smaller than the pixel are averaged out.
            let seen = 1.0 / (1.0 + (pixel_m / size_m) * (pixel_m / size_m));
            seen * smooth(north_m / size_m, east_m / size_m, seed as u32 ^ kind.wrapping_mul(0x9e37_79b9))
        };
        match *self {
            Self::Plain(colour) => colour,
            Self::Grass => {
                let blade = mix([0.09, 0.14, 0.04], [0.05, 0.09, 0.025], noise(0.03, 1) + 0.7 * noise(0.2, 2));
                mix(blade, [0.22, 0.19, 0.09], 0.8 * noise(1.1, 3) - 0.35)
            }
            Self::Gravel => mix(
                [0.24, 0.22, 0.20],
                [0.45, 0.42, 0.38],
                noise(0.025, 1) + 0.8 * noise(0.07, 2) + 0.3 * noise(0.6, 3),
            ),
            Self::Concrete => {
                let plain = mix([0.36, 0.35, 0.33], [0.46, 0.45, 0.43], 0.8 * noise(0.4, 1) + 0.4 * noise(0.02, 2));
                mix(plain, [0.14, 0.13, 0.12], noise(1.7, 3) - 0.55)
            }
            Self::Tiles { side_m, colour } => {
                let (n, e) = (north_m / side_m, east_m / side_m);
                let joint = 0.02 / side_m + 0.5 * pixel_m / side_m;
                let edge = |x: f32| (x - x.round()).abs() < joint;
                let own = 0.5 * lattice(n.floor() as i32, e.floor() as i32, seed as u32);
                let shade = 0.9 + 0.25 * own + 0.1 * noise(0.05, 1);
                let tile = each(|k| colour[k] * shade);
                let seen = (0.02 / pixel_m).min(1.0);
                if edge(n) || edge(e) { mix(tile, [0.16, 0.15, 0.14], 0.8 * seen) } else { tile }
            }
            Self::Soil { colour } => {
                let dark = each(|k| 0.6 * colour[k]);
                mix(colour, dark, 0.6 + 0.7 * noise(0.3, 1) + 0.6 * noise(0.05, 2))
            }
            Self::Mixed => {
                let earth = mix([0.24, 0.16, 0.10], [0.15, 0.10, 0.07], 0.5 + noise(0.08, 4));
                let stone = mix([0.30, 0.28, 0.26], [0.45, 0.43, 0.40], noise(0.04, 5));
                let bare = mix(earth, stone, 1.5 * noise(0.7, 6));
                mix(bare, [0.07, 0.12, 0.035], 0.5 + 2.0 * noise(0.9, 7) + noise(0.1, 8))
            }
        }
    }
}

fn mix(from: Colour, to: Colour, part: f32) -> Colour {
    let part = part.clamp(0.0, 1.0);
    each(|k| from[k] + part * (to[k] - from[k]))
}

/// A random number of a lattice point, -1 to 1.
fn lattice(x: i32, y: i32, seed: u32) -> f32 {
    let mut z = (x as u32).wrapping_mul(0x85eb_ca6b) ^ (y as u32).wrapping_mul(0xc2b2_ae35) ^ seed;
    z = (z ^ (z >> 16)).wrapping_mul(0x7feb_352d);
    z = (z ^ (z >> 15)).wrapping_mul(0x846c_a68b);
    (z ^ (z >> 16)) as f32 / 2_147_483_648.0 - 1.0
}

/// Noise interpolated between lattice points.
fn smooth(x: f32, y: f32, seed: u32) -> f32 {
    let (x0, y0) = (x.floor(), y.floor());
    let ease = |t: f32| t * t * (3.0 - 2.0 * t);
    let (u, v) = (ease(x - x0), ease(y - y0));
    let (x0, y0) = (x0 as i32, y0 as i32);
    let at = |dx: i32, dy: i32| lattice(x0.wrapping_add(dx), y0.wrapping_add(dy), seed);
    let (low, high) = (at(0, 0) + u * (at(1, 0) - at(0, 0)), at(0, 1) + u * (at(1, 1) - at(0, 1)));
    low + v * (high - low)
}
