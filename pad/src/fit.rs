//! Fits a disc to an outline; robust, since a third of the disc may be hidden.
//!
//! The ends of the lines, down the left and up the right, form a ring of points. Circles are fitted to runs of half
//! of it (Kasa's sums, an eighth of the ring each): an object that hides a part of the disc spoils some of them, not
//! all. The circle through the most points starts Gauss-Newton steps for centre, radius and the second harmonic of
//! the radius, by which a tilted disc is an ellipse; outliers get little weight (weights after Geman). Third and
//! fourth harmonic of the residual are those of triangles and squares.
//!
//! Floating point, since a frame has only a few dozen points of a few regions.

use foxhound_core::base::math::sqrt;

use super::regions::{Outline, ROWS};

/// Most points of a ring.
const POINTS_MAX: usize = 2 * ROWS;
const EIGHTHS: usize = 8;
/// Sectors for the coverage of the ring's points.
pub(super) const SECTORS: u32 = 16;
const STEPS: usize = 4;
/// Standard deviation of the second harmonic, relative to the radius: a disc is nearly round.
const ROUND_SIGMA: f32 = 0.10;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Point {
    pub(super) x: f32,
    pub(super) y: f32,
}

/// A nearly round ellipse, in pixels: radius `r (1 + p cos 2a + q sin 2a)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Disc {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) radius: f32,
    pub(super) p: f32,
    pub(super) q: f32,
}

impl Disc {
    /// Distance of a point from the centre, its direction, and its distance outside the disc.
    fn residual(&self, point: Point) -> (f32, f32, f32, f32, f32) {
        let (dx, dy) = (point.x - self.x, point.y - self.y);
        let distance = sqrt(dx * dx + dy * dy).max(1e-3);
        let (cosine, sine) = (dx / distance, dy / distance);
        let (cosine2, sine2) = (cosine * cosine - sine * sine, 2.0 * cosine * sine);
        let outside = distance - self.radius * (1.0 + self.p * cosine2 + self.q * sine2);
        (outside, cosine, sine, cosine2, sine2)
    }

    pub(super) fn area(&self) -> f32 {
        core::f32::consts::PI * self.radius * self.radius * (1.0 + 0.5 * (self.p * self.p + self.q * self.q))
    }

    /// The share of its area inside the picture.
    pub(super) fn share_inside(&self, width: f32, height: f32) -> f32 {
        let reach = self.radius * (1.0 + libm::fabsf(self.p) + libm::fabsf(self.q));
        let is_inside = self.x > reach && self.y > reach && self.x + reach < width && self.y + reach < height;
        if is_inside {
            return 1.0;
        }
        // A few strips of the circle.
        const STRIPS: usize = 32;
        let (mut inside, mut all) = (0.0, 0.0);
        for strip in 0..STRIPS {
            let v = (2.0 * strip as f32 + 1.0) / STRIPS as f32 - 1.0;
            let half = self.radius * sqrt(1.0 - v * v);
            all += 2.0 * half;
            let y = self.y + v * self.radius;
            if y >= 0.0 && y <= height {
                inside += ((self.x + half).min(width) - (self.x - half).max(0.0)).max(0.0);
            }
        }
        inside / all
    }
}

/// The result of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    pub(super) disc: Disc,
    /// Sectors of the ring with points on the disc's edge, of those inside the picture.
    pub(super) seen: u32,
    pub(super) sectors: u32,
    /// Shares of the points on the edge, and outside of it.
    pub(super) on_edge: f32,
    pub(super) outside: f32,
    /// The third and the fourth harmonic of the residual, in pixels.
    pub(super) corners: [f32; 2],
    /// Residual of the points on the edge, rms, in pixels.
    pub(super) rough: f32,
    /// Whether the picture's border cuts the region.
    pub(super) is_cut: bool,
}

/// The expected radius in pixels, and its standard deviation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prior {
    pub(super) radius: f32,
    pub(super) sigma: f32,
}

/// Sums over some points for a circle through them.
#[derive(Clone, Copy, Default)]
struct Sums {
    n: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    zx: f32,
    zy: f32,
    z: f32,
}

impl Sums {
    fn of(points: &[Point]) -> Self {
        let mut sums = Self::default();
        for point in points {
            let (xx, yy) = (point.x * point.x, point.y * point.y);
            let z = xx + yy;
            sums.n += 1.0;
            sums.x += point.x;
            sums.y += point.y;
            sums.xx += xx;
            sums.xy += point.x * point.y;
            sums.yy += yy;
            sums.zx += z * point.x;
            sums.zy += z * point.y;
            sums.z += z;
        }
        sums
    }

    fn plus(&self, other: &Self) -> Self {
        Self {
            n: self.n + other.n,
            x: self.x + other.x,
            y: self.y + other.y,
            xx: self.xx + other.xx,
            xy: self.xy + other.xy,
            yy: self.yy + other.yy,
            zx: self.zx + other.zx,
            zy: self.zy + other.zy,
            z: self.z + other.z,
        }
    }

    /// The circle with the least algebraic distance.
    fn circle(&self) -> Option<Disc> {
        if self.n < 5.0 {
            return None;
        }
        let (mx, my) = (self.x / self.n, self.y / self.n);
        let (xx, xy, yy) = (self.xx - mx * self.x, self.xy - mx * self.y, self.yy - my * self.y);
        let (zx, zy) = (self.zx - mx * self.z, self.zy - my * self.z);
        let determinant = xx * yy - xy * xy;
        if !(determinant > 1e-4 * (xx + yy) * (xx + yy)) {
            return None;
        }
        let x = 0.5 * (zx * yy - zy * xy) / determinant;
        let y = 0.5 * (zy * xx - zx * xy) / determinant;
        let square = self.z / self.n - 2.0 * (x * mx + y * my) + x * x + y * y;
        (square > 0.25).then(|| Disc { x, y, radius: sqrt(square), p: 0.0, q: 0.0 })
    }
}

/// The ring of an outline: down the left, up the right, without the picture's border.
struct Ring {
    points: [Point; POINTS_MAX],
    length: usize,
    is_cut: bool,
}

impl Ring {
    fn of(outline: &Outline, narrow: u8, width_px: u16) -> Self {
        let mut ring = Self { points: [Point::default(); POINTS_MAX], length: 0, is_cut: false };
        let scale = (1_u16 << narrow) as f32;
        // Of two merged columns, the middle.
        let middle = 0.5 * (scale - 1.0);
        let last = width_px >> narrow;
        for (row, [from, _]) in outline.lines() {
            if from == 0 {
                ring.is_cut = true;
            } else {
                ring.push(f32::from(from) * scale + middle, row);
            }
        }
        for (row, [_, to]) in outline.lines().rev() {
            if u16::from(to) >= last.min(255) {
                ring.is_cut = true;
            } else {
                ring.push(f32::from(to) * scale + middle, row);
            }
        }
        ring
    }

    fn push(&mut self, x: f32, row: u16) {
        if let Some(slot) = self.points.get_mut(self.length) {
            *slot = Point { x, y: f32::from(row) + 0.5 };
            self.length += 1;
        }
    }
}

/// Fits a disc to an outline in a picture of that size. `None`: there are too few points, or they are not on a
/// circle.
pub(super) fn fit(outline: &Outline, narrow: u8, size_px: [u16; 2], prior: Option<Prior>) -> Option<Fit> {
    let mut ring = Ring::of(outline, narrow, size_px[0]);
    let points = ring.points.get_mut(..ring.length)?;
    if points.len() < 6 {
        return None;
    }
    // Relative to their middle the sums stay small.
    let (mut low, mut high) = (*points.first()?, *points.first()?);
    for point in points.iter() {
        low = Point { x: low.x.min(point.x), y: low.y.min(point.y) };
        high = Point { x: high.x.max(point.x), y: high.y.max(point.y) };
    }
    let origin = Point { x: 0.5 * (low.x + high.x), y: 0.5 * (low.y + high.y) };
    for point in points.iter_mut() {
        (point.x, point.y) = (point.x - origin.x, point.y - origin.y);
    }
    let extent = (high.x - low.x).max(high.y - low.y);
    let mut disc = begin(points, extent, prior)?;
    // From loose to tight.
    let tight = (0.05 * disc.radius).max(0.7);
    let mut scale = (0.15 * disc.radius).max(1.0);
    for _ in 0..STEPS {
        disc = improve(&disc, points, scale, prior, ring.is_cut)?;
        scale = (0.6 * scale).max(tight);
    }
    if !(disc.radius > 1.0 && disc.radius < 4.0 * extent) {
        return None;
    }
    let mut fit = judge(&disc, points, origin, size_px);
    (fit.disc.x, fit.disc.y, fit.is_cut) = (disc.x + origin.x, disc.y + origin.y, ring.is_cut);
    Some(fit)
}

/// How near a point must be to count as on the edge.
fn tolerance(radius: f32) -> f32 {
    (0.07 * radius).max(0.9)
}

/// The circle through half of the ring that passes the most points.
#[inline(never)]
fn begin(points: &[Point], extent: f32, prior: Option<Prior>) -> Option<Disc> {
    let mut eighths = [Sums::default(); EIGHTHS];
    for (at, sums) in eighths.iter_mut().enumerate() {
        let (from, to) = (at * points.len() / EIGHTHS, (at + 1) * points.len() / EIGHTHS);
        *sums = Sums::of(points.get(from..to)?);
    }
    let mut best: Option<(f32, Disc)> = None;
    let mut consider = |sums: &Sums| {
        let Some(disc) = sums.circle().filter(|disc| disc.radius < 3.0 * extent) else { return };
        let near = tolerance(disc.radius);
        let mut score = 0.0;
        // Every second one is enough.
        for point in points.iter().step_by(2) {
            let (outside, ..) = disc.residual(*point);
            if libm::fabsf(outside) < near {
                score += 1.0;
            } else if outside > 0.0 {
                score -= 1.0;
            }
        }
        if let Some(prior) = prior {
            let off = libm::fabsf(disc.radius - prior.radius) / prior.sigma;
            score -= 0.05 * points.len() as f32 * off.min(3.0);
        }
        if best.is_none_or(|(most, _)| score > most) {
            best = Some((score, disc));
        }
    };
    let all = eighths.iter().fold(Sums::default(), |sum, part| sum.plus(part));
    consider(&all);
    for first in 0..EIGHTHS {
        let half = eighths.iter().cycle().skip(first).take(EIGHTHS / 2 + 1);
        consider(&half.fold(Sums::default(), |sum, part| sum.plus(part)));
    }
    best.map(|(_, disc)| disc)
}

/// One step of Gauss and Newton.
#[inline(never)]
fn improve(disc: &Disc, points: &[Point], scale: f32, prior: Option<Prior>, is_cut: bool) -> Option<Disc> {
    // The upper triangle of the normal equations and their right side, line by line.
    let mut sums = [0.0_f32; 20];
    let inverse = 1.0 / (scale * scale);
    for point in points {
        let (outside, cosine, sine, cosine2, sine2) = disc.residual(*point);
        let weight = 1.0 / (1.0 + outside * outside * inverse);
        let weight = weight * weight;
        let radial = 1.0 + disc.p * cosine2 + disc.q * sine2;
        let (long, slant) = (disc.radius * cosine2, disc.radius * sine2);
        let (a, b, c, d, e) = (weight * cosine, weight * sine, weight * radial, weight * long, weight * slant);
        let products = [
            [a * cosine, a * sine, a * radial, a * long, a * slant],
            [a * outside, b * sine, b * radial, b * long, b * slant],
            [b * outside, c * radial, c * long, c * slant, c * outside],
            [d * long, d * slant, d * outside, e * slant, e * outside],
        ];
        for (sum, product) in sums.iter_mut().zip(products.as_flattened()) {
            *sum += product;
        }
    }
    let [aa, ab, ac, ad, ae, a, bb, bc, bd, be, b, cc, cd, ce, c, dd, de, d, ee, e] = sums;
    let mut matrix = [
        [aa, ab, ac, ad, ae, a],
        [ab, bb, bc, bd, be, b],
        [ac, bc, cc, cd, ce, c],
        [ad, bd, cd, dd, de, d],
        [ae, be, ce, de, ee, e],
    ];
    // It is nearly round, and of about the expected size if that is known and the border hides a part. A point's own
    // error is about half a pixel.
    let round = 0.25 / (ROUND_SIGMA * ROUND_SIGMA);
    for (at, value) in [(3, disc.p), (4, disc.q)] {
        let line = matrix.get_mut(at)?;
        *line.get_mut(at)? += round;
        *line.get_mut(5)? -= round * value;
    }
    if let Some(prior) = prior.filter(|_| is_cut) {
        let stiff = 0.25 / (prior.sigma * prior.sigma);
        *matrix.get_mut(2)?.get_mut(2)? += stiff;
        *matrix.get_mut(2)?.get_mut(5)? += stiff * (prior.radius - disc.radius);
    }
    let step = solve(&mut matrix)?;
    let [x, y, radius, p, q] = step;
    let most = 0.5 * disc.radius;
    let held = |step: f32, most: f32| foxhound_core::base::units::between(step, -most, most);
    let next = Disc {
        x: disc.x + held(x, most),
        y: disc.y + held(y, most),
        radius: disc.radius + held(radius, most),
        p: foxhound_core::base::units::between(disc.p + p, -0.3, 0.3),
        q: foxhound_core::base::units::between(disc.q + q, -0.3, 0.3),
    };
    (next.x.is_finite() && next.y.is_finite() && next.radius > 0.5 && next.p.is_finite() && next.q.is_finite())
        .then_some(next)
}

/// Gauss's elimination of a symmetric positive system.
#[inline(never)]
fn solve(matrix: &mut [[f32; 6]; 5]) -> Option<[f32; 5]> {
    for at in 0..5 {
        let pivot = *matrix.get(at)?;
        let head = *pivot.get(at)?;
        if !(head > 1e-6) {
            return None;
        }
        for line in matrix.iter_mut().skip(at + 1) {
            let factor = *line.get(at)? / head;
            for (entry, value) in line.iter_mut().zip(&pivot).skip(at) {
                *entry -= factor * value;
            }
        }
    }
    let mut out = [0.0; 5];
    for at in (0..5).rev() {
        let line = matrix.get(at)?;
        let mut value = line[5];
        for (entry, known) in line.iter().zip(&out).skip(at + 1) {
            value -= entry * known;
        }
        *out.get_mut(at)? = value / line.get(at)?;
    }
    Some(out)
}

/// Compares the ring with the disc.
#[inline(never)]
fn judge(disc: &Disc, points: &[Point], origin: Point, size_px: [u16; 2]) -> Fit {
    let near = tolerance(disc.radius);
    let (mut on_edge, mut outside, mut square, mut seen) = (0.0, 0.0, 0.0, 0_u32);
    let (mut three, mut four, mut count) = ([0.0_f32; 2], [0.0_f32; 2], 0.0_f32);
    for point in points {
        let (off, cosine, sine, cosine2, sine2) = disc.residual(*point);
        if libm::fabsf(off) < near {
            on_edge += 1.0;
            square += off * off;
            seen |= 1 << sector(cosine, sine);
        } else if off > 0.0 {
            outside += 1.0;
        }
        // Points inside are of hidden parts, and are ignored.
        let left = if off < -near { 0.0 } else { off.min(4.0 * near) };
        let (cosine3, sine3) = (cosine2 * cosine - sine2 * sine, sine2 * cosine + cosine2 * sine);
        let (cosine4, sine4) = (cosine2 * cosine2 - sine2 * sine2, 2.0 * cosine2 * sine2);
        three = [three[0] + left * cosine3, three[1] + left * sine3];
        four = [four[0] + left * cosine4, four[1] + left * sine4];
        count += 1.0;
    }
    let length = |pair: [f32; 2]| 2.0 * sqrt(pair[0] * pair[0] + pair[1] * pair[1]) / count;
    let mut sectors = 0;
    for at in 0..SECTORS {
        let (sine, cosine) =
            foxhound_core::base::units::sin_cos((at as f32 + 0.5) * core::f32::consts::TAU / SECTORS as f32);
        let (x, y) = (disc.x + origin.x + disc.radius * cosine, disc.y + origin.y + disc.radius * sine);
        let is_inside = x > 0.5 && y > 0.5 && x < f32::from(size_px[0]) - 0.5 && y < f32::from(size_px[1]) - 0.5;
        sectors += u32::from(is_inside);
    }
    Fit {
        disc: *disc,
        seen: seen.count_ones(),
        sectors,
        on_edge: on_edge / count,
        outside: outside / count,
        corners: [length(three), length(four)],
        rough: sqrt(square / on_edge.max(1.0)),
        is_cut: false,
    }
}

/// Which of the sixteen sectors a direction is in, in any order.
fn sector(cosine: f32, sine: f32) -> u32 {
    let (a, b) = (libm::fabsf(cosine), libm::fabsf(sine));
    let (large, small, is_steep) = if a > b { (a, b, 0) } else { (b, a, 1) };
    // The tangent of an eighth of a right angle.
    let is_outer = u32::from(small > 0.414_213_57 * large);
    u32::from(cosine < 0.0) << 3 | u32::from(sine < 0.0) << 2 | is_steep << 1 | is_outer
}
