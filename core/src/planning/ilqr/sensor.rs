//! The Kalman filter's covariance as a function of the vehicle's path, and its derivatives (paper, eq. 16-19).
//!
//! With `d` the vehicle's position relative to the apparent position of the source, a bearing `b` of deviation `sigma`
//! has `db = h'dx / d'd`, where the row `h = B d` is linear in `d` (a quarter turn, mirrored for states behind a
//! reflection). So
//!
//! ```text
//! P+ = P- - z z'/s,   z = P- h,   s = h'z + sigma^2 (d'd + near^2)^2,   P- = P + W
//! ```
//!
//! without a root and with one division. The paper's redundant `[cos, sin]` with noise `sigma^2 I` (eq. 3) yields the
//! same covariance: its Jacobian is the outer product of the tangent and `h/|d|^2`, so that the radial component
//! carries no information (a test compares the two). `near` limits the information of a bearing close to the source,
//! where it has none; the paper has `near = 0`.
//!
//! Eq. 18 and 19 are Kronecker products of size `l^2 x l^2`; for the triangle of the symmetric matrix they become
//!
//! ```text
//! dP+/dP: X -> A X A',                A = I - z h'/s
//! dP+/dd_j = -(e_j z' + z e_j'),      e_j = (P- B_j - z s_j / 2s) / s,   s_j = 2 B_j'z + 4 sigma^2 (d'd + near^2) d_j
//! ```
//!
//! and the second derivatives of `tr(G P+)`, which the paper leaves out and the solver can use, follow in the same way.

use crate::base::ned::Horizontal;
use crate::mapping::walls::Wall;

/// A symmetric matrix of `L x L` as its upper triangle, column by column: element `(a, b)`, `a <= b`, at
/// `b (b + 1) / 2 + a`.
pub(super) const fn at(a: usize, b: usize) -> usize {
    if a <= b { b * (b + 1) / 2 + a } else { a * (a + 1) / 2 + b }
}

/// The measurement model of a state of `L` elements, whose covariance triangle has `M`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sensor<const L: usize> {
    /// `B`.
    rows: [[f32; 2]; L],
    /// The apparent position of the source.
    image_ned_m: [f32; 2],
    variance_rad2: f32,
    near_m2: f32,
    /// Diagonal of `W`.
    noise_m2: [f32; L],
}

impl<const L: usize> Sensor<L> {
    /// The model of a source that is received directly, or by reflection at a line. Two states are the vehicle's
    /// position relative to the source (eq. 2) or the source's alone, four are the vehicle's and the source's (eq. 8).
    pub(super) fn new(
        source_ned_m: Horizontal,
        seen_through: Option<&Wall>,
        variance_rad2: f32,
        near_m: f32,
        noise_m2: [f32; 2],
    ) -> Self {
        // d = p - mirror(source); the derivative of a bearing is a quarter turn of d, that of the mirror its linear
        // part.
        let (image, mirror) = match seen_through {
            Some(line) => {
                let n = line.normal_ned;
                let cross = -2.0 * n.north * n.east;
                let mirror = [[1.0 - 2.0 * n.north * n.north, cross], [cross, 1.0 - 2.0 * n.east * n.east]];
                (line.mirror(source_ned_m), mirror)
            }
            None => (source_ned_m, [[1.0, 0.0], [0.0, 1.0]]),
        };
        // mirror' * [[0, -1], [1, 0]].
        let mirrored = mirror.map(|[north, east]| [east, -north]);
        let rows = core::array::from_fn(|a| match a {
            0 if L == 4 => [0.0, -1.0],
            1 if L == 4 => [1.0, 0.0],
            _ => {
                let row = mirrored[a & 1];
                if L == 4 { [-row[0], -row[1]] } else { row }
            }
        });
        let noise_m2 = core::array::from_fn(|a| noise_m2[usize::from(a >= 2)]);
        Self { rows, image_ned_m: [image.north, image.east], variance_rad2, near_m2: near_m * near_m, noise_m2 }
    }

    fn spread(&self, d: [f32; 2]) -> f32 {
        d[0] * d[0] + d[1] * d[1] + self.near_m2
    }

    /// Predicts and updates the covariance `p` at a place.
    #[inline]
    pub(super) fn update<const M: usize>(&self, p: &[f32; M], place: [f32; 2]) -> [f32; M] {
        let Gain { full, z, s, .. } = self.gain(p, place);
        let scale = 1.0 / s;
        let mut out = [0.0; M];
        for b in 0..L {
            let zb = z[b] * scale;
            for a in 0..=b {
                out[at(a, b)] = full[a][b] - z[a] * zb;
            }
        }
        out
    }

    #[inline]
    fn gain<const M: usize>(&self, p: &[f32; M], place: [f32; 2]) -> Gain<L> {
        let d = [place[0] - self.image_ned_m[0], place[1] - self.image_ned_m[1]];
        let mut full = [[0.0; L]; L];
        for b in 0..L {
            for a in 0..=b {
                full[a][b] = p[at(a, b)];
                full[b][a] = p[at(a, b)];
            }
            full[b][b] += self.noise_m2[b];
        }
        let h = self.rows.map(|row| row[0] * d[0] + row[1] * d[1]);
        let z = full.map(|row| dot(&row, &h));
        let spread = self.spread(d);
        // A vehicle exactly at the source measures nothing: there the sum is zero.
        let s = dot(&h, &z) + self.variance_rad2 * spread * spread + f32::MIN_POSITIVE;
        Gain { d, full, h, z, s }
    }

    /// The update's derivatives at a place.
    #[inline]
    pub(super) fn slopes<const M: usize>(&self, p: &[f32; M], place: [f32; 2]) -> Slopes<'_, L> {
        let gain = self.gain(p, place);
        let scale = 1.0 / gain.s;
        let spread = 4.0 * self.variance_rad2 * self.spread(gain.d);
        let mut turned = [[0.0; L]; 2];
        let mut ds = [0.0; 2];
        for j in 0..2 {
            let column = self.rows.map(|row| row[j]);
            turned[j] = gain.full.map(|row| dot(&row, &column));
            ds[j] = 2.0 * dot(&column, &gain.z) + spread * gain.d[j];
        }
        let share = gain.z.map(|z| z * scale);
        let (half, twice) = (share.map(|share| 0.5 * share), gain.h.map(|h| 2.0 * h));
        Slopes { sensor: self, gain, scale, share, half, twice, turned, ds }
    }
}

#[inline]
pub(super) fn dot<const L: usize>(a: &[f32; L], b: &[f32; L]) -> f32 {
    let mut sum = a[0] * b[0];
    for k in 1..L {
        sum += a[k] * b[k];
    }
    sum
}

/// Parts of an update.
struct Gain<const L: usize> {
    d: [f32; 2],
    /// `P-`.
    full: [[f32; L]; L],
    h: [f32; L],
    z: [f32; L],
    s: f32,
}

/// The derivatives of an update.
pub(super) struct Slopes<'a, const L: usize> {
    sensor: &'a Sensor<L>,
    gain: Gain<L>,
    /// `1 / s`.
    scale: f32,
    /// `z / s`, half of it, and `2 h`.
    share: [f32; L],
    half: [f32; L],
    twice: [f32; L],
    /// `P- B`, by columns.
    turned: [[f32; L]; 2],
    /// `ds/dd`.
    ds: [f32; 2],
}

impl<const L: usize> Slopes<'_, L> {
    /// `dP+/dP` (eq. 19), transposed, times a derivative by the triangle of `P+`: gives the derivative by the triangle
    /// of `P`. Of the matrix `G` that `slope` stands for, `A'GA = G - h w' - w h'` with `w = G z/s - h (z'Gz) / 2s^2`,
    /// so that no `M x M` matrix is built.
    #[inline]
    pub(super) fn pull<const M: usize>(&self, slope: &[f32; M]) -> [f32; M] {
        let mut w = [0.0; L];
        for b in 0..L {
            for a in 0..b {
                w[a] += slope[at(a, b)] * self.half[b];
                w[b] += slope[at(a, b)] * self.half[a];
            }
            w[b] += slope[at(b, b)] * self.share[b];
        }
        let along = dot(&w, &self.half);
        for a in 0..L {
            w[a] -= self.gain.h[a] * along;
        }
        let mut out = *slope;
        for b in 0..L {
            for a in 0..b {
                out[at(a, b)] -= self.twice[a] * w[b] + w[a] * self.twice[b];
            }
            out[at(b, b)] -= self.twice[b] * w[b];
        }
        out
    }

    /// `dP+/dp` (eq. 18, with `dH/dx` included) on triangles.
    #[inline]
    pub(super) fn by_place<const M: usize>(&self) -> [[f32; M]; 2] {
        let z = &self.gain.z;
        let mut out = [[0.0; M]; 2];
        for j in 0..2 {
            let half = 0.5 * self.ds[j] * self.scale;
            let mut e = [0.0; L];
            for a in 0..L {
                e[a] = -(self.turned[j][a] - z[a] * half) * self.scale;
            }
            for b in 0..L {
                for a in 0..=b {
                    out[j][at(a, b)] = e[a] * z[b] + z[a] * e[b];
                }
            }
        }
        out
    }

    /// Second derivatives of `tr(G P+)`, where `slope` is the derivative by the triangle of `P+`: place by place
    /// `[nn, ne, ee]`, and place by covariance. The second derivative by the covariance is left out: it is never
    /// positive, costs most, and does not reduce the number of iterations.
    #[inline]
    pub(super) fn curvature<const M: usize>(&self, slope: &[f32; M]) -> Curvature<M> {
        let Gain { d, h, z, .. } = &self.gain;
        let scale = self.scale;
        let weight: [[f32; L]; L] = square(slope);

        let gz = weight.map(|row| dot(&row, z));
        let alpha = dot(z, &gz);
        // A'x = x - h (z'x)/s.
        let pull = |x: &[f32; L]| {
            let back = dot(z, x) * scale;
            let mut out = [0.0; L];
            for a in 0..L {
                out[a] = x[a] - h[a] * back;
            }
            out
        };
        let weighted = self.turned.map(|turned| weight.map(|row| dot(&row, &turned)));
        let da = self.turned.map(|turned| 2.0 * dot(&turned, &gz));
        let columns = [0, 1].map(|j| self.sensor.rows.map(|row| row[j]));
        let isotropic = 4.0 * self.sensor.variance_rad2 * self.sensor.spread(*d);
        let place = [(0, 0), (0, 1), (1, 1)].map(|(j, k)| {
            let dda = 2.0 * dot(&self.turned[j], &weighted[k]);
            let along = 8.0 * self.sensor.variance_rad2 * d[j] * d[k];
            let dds = 2.0 * dot(&columns[j], &self.turned[k]) + along + if j == k { isotropic } else { 0.0 };
            let cross = da[j] * self.ds[k] + self.ds[j] * da[k] + alpha * dds;
            -scale * (dda - scale * (cross - 2.0 * scale * alpha * self.ds[j] * self.ds[k]))
        });

        let v = pull(&gz);
        let mut mixed = [[0.0; M]; 2];
        for j in 0..2 {
            let mut x = weighted[j];
            let back = scale * self.ds[j];
            for a in 0..L {
                x[a] -= gz[a] * back;
            }
            let w = pull(&x);
            let column = &columns[j];
            for b in 0..L {
                for a in 0..b {
                    let entry = h[a] * w[b] + w[a] * h[b] + column[a] * v[b] + v[a] * column[b];
                    mixed[j][at(a, b)] = -2.0 * scale * entry;
                }
                mixed[j][at(b, b)] = -2.0 * scale * (h[b] * w[b] + column[b] * v[b]);
            }
        }
        Curvature { place, mixed }
    }
}

/// The symmetric matrix `G` for which `tr(G X)` is the sum of `slope` times the triangle of `X`.
#[inline]
fn square<const L: usize, const M: usize>(slope: &[f32; M]) -> [[f32; L]; L] {
    let mut out = [[0.0; L]; L];
    for b in 0..L {
        for a in 0..b {
            out[a][b] = 0.5 * slope[at(a, b)];
            out[b][a] = out[a][b];
        }
        out[b][b] = slope[at(b, b)];
    }
    out
}

/// Second derivatives of `tr(G P+)`.
pub(super) struct Curvature<const M: usize> {
    /// By the position, twice.
    pub(super) place: [f32; 3],
    /// By the position and by the triangle of `P`.
    pub(super) mixed: [[f32; M]; 2],
}
