//! A cheap camera that looks down: the picture of the ground, with or without a pad, from a pose.
//!
//! A pinhole at the body's position, along its down axis; perspective of the flat ground, four samples per pixel.
//! Objects lie on the ground, later ones over earlier ones. The light has a colour, a gradient and hard shadows; the
//! lens a vignette, flare, focus and motion blur; the sensor shot and read noise, dead pixels, gamma and 5, 6, 5 bits
//! or 8 of grey. Reflectances are linear, as measured ones are. The same seed gives the same picture.

mod frame;
mod ground;
pub mod grounds;
mod light;
pub mod picture;
pub mod random;
mod sensor;
pub mod watch;

use std::f32::consts::TAU;

use light::each;

pub use foxhound_pad::Camera;
pub use frame::{Frame, Size};
pub use ground::Ground;
pub use light::{Colour, Lighting, Shadow, direction, lamp};

/// The red of a pad: a matt paint.
pub const PAD_RED: Colour = [0.52, 0.06, 0.05];
/// The white of a ring.
pub const WHITE: Colour = [0.80, 0.80, 0.78];

/// Outline of an object, in units of half of its width.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// All round.
    Disc,
    /// This many times as long as wide.
    Rectangle(f32),
    /// Three equal sides.
    Triangle,
    /// With a hole of this share of its radius.
    Ring(f32),
    /// A sector of a disc, this share of the full turn.
    Sector(f32),
    /// A pointed leaf, this many times as long as wide.
    Leaf(f32),
    /// No edge at all: a Gaussian.
    Glow,
}

/// A flat object on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thing {
    /// Its outline.
    pub shape: Shape,
    /// North position of its centre.
    pub north_m: f32,
    /// East position of its centre.
    pub east_m: f32,
    /// Half of its width.
    pub radius_m: f32,
    /// Its rotation, clockwise.
    pub turn_rad: f32,
    /// Its colour.
    pub colour: Colour,
}

impl Thing {
    /// Its coverage of a point, 0 to 1.
    fn cover(&self, north_m: f32, east_m: f32) -> f32 {
        let (dn, de) = (north_m - self.north_m, east_m - self.east_m);
        let square = dn * dn + de * de;
        let reach_m = self.radius_m * self.reach();
        if square > reach_m * reach_m {
            return 0.0;
        }
        let (sine, cosine) = libm::sincosf(self.turn_rad);
        let along = (dn * cosine + de * sine) / self.radius_m;
        let across = (de * cosine - dn * sine) / self.radius_m;
        let radius = square.sqrt() / self.radius_m;
        let is_in = match self.shape {
            Shape::Disc => radius < 1.0,
            Shape::Rectangle(long) => across.abs() < 1.0 && along.abs() < long,
            Shape::Triangle => along > -0.5 && (along - 1.0) < -across.abs() * 3.0_f32.sqrt(),
            Shape::Ring(hole) => radius < 1.0 && radius > hole,
            Shape::Sector(part) => radius < 1.0 && libm::atan2f(across, along).rem_euclid(TAU) < part * TAU,
            Shape::Leaf(long) => {
                let bent = (along / long).abs();
                across.abs() < 1.0 - bent * bent
            }
            Shape::Glow => return libm::expf(-3.0 * radius * radius),
        };
        f32::from(u8::from(is_in))
    }

    /// Whether it covers anything within a distance of a point; true more often than it does.
    fn may_cover(&self, north_m: f32, east_m: f32, within_m: f32) -> bool {
        let reach_m = 1.001 * (self.radius_m * self.reach() + within_m);
        (north_m - self.north_m).abs() <= reach_m && (east_m - self.east_m).abs() <= reach_m
    }

    fn reach(&self) -> f32 {
        match self.shape {
            Shape::Rectangle(long) => (1.0 + long * long).sqrt(),
            Shape::Leaf(long) => long.max(1.0),
            Shape::Glow => 1.6,
            _ => 1.0,
        }
    }
}

/// The pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// North position of its centre.
    pub north_m: f32,
    /// East position of its centre.
    pub east_m: f32,
    /// Radius of the red disc.
    pub radius_m: f32,
    /// Width of the white ring around it, 0 for none.
    pub ring_m: f32,
    /// Its paint.
    pub colour: Colour,
}

/// The scene under the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The ground itself.
    pub ground: Ground,
    /// Objects below the pad, if there is one, or beside it.
    pub things: Vec<Thing>,
    /// The pad.
    pub target: Option<Target>,
    /// Objects on the pad.
    pub covers: Vec<Thing>,
}

/// Pose of the camera: north, east, above the ground, and the body's attitude.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// North.
    pub north_m: f32,
    /// East.
    pub east_m: f32,
    /// Above the ground.
    pub height_m: f32,
    /// Right side down positive.
    pub roll_rad: f32,
    /// Nose up positive.
    pub pitch_rad: f32,
    /// Clockwise from north.
    pub yaw_rad: f32,
}

impl Pose {
    /// The body's forward, right and down axes in north, east, down.
    fn axes(&self) -> [[f32; 3]; 3] {
        let ((sr, cr), (sp, cp), (sy, cy)) =
            (libm::sincosf(self.roll_rad), libm::sincosf(self.pitch_rad), libm::sincosf(self.yaw_rad));
        [
            [cp * cy, cp * sy, -sp],
            [sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp],
            [cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp],
        ]
    }

    /// A ray of the body, with forward and right per unit of down, in north, east, down.
    fn ray(axes: &[[f32; 3]; 3], forward: f32, right: f32) -> [f32; 3] {
        each(|k| axes[0][k] * forward + axes[1][k] * right + axes[2][k])
    }

    /// A point on the ground as the body's tangents forward and right, and its depth along down.
    #[must_use]
    pub fn see(&self, north_m: f32, east_m: f32) -> [f32; 3] {
        let away = [north_m - self.north_m, east_m - self.east_m, self.height_m];
        let [forward, right, down] = self.axes().map(|axis| axis.iter().zip(away).map(|(a, b)| a * b).sum::<f32>());
        [forward / down, right / down, down]
    }

    /// The vertical, as tangents of the body.
    #[must_use]
    pub fn up(&self) -> [f32; 2] {
        let axes = self.axes();
        [-axes[0][2] / -axes[2][2], -axes[1][2] / -axes[2][2]].map(|tangent| -tangent)
    }
}

/// Positions of the samples in a pixel: no two in a row or a column.
const SAMPLES: [[f32; 2]; 4] = [[0.125, 0.625], [0.375, 0.125], [0.625, 0.875], [0.875, 0.375]];

/// The picture of a scene.
#[must_use]
pub fn render(scene: &Scene, camera: &Camera, pose: &Pose, lighting: &Lighting, size: Size, seed: u64) -> Frame {
    let (width, height) = (usize::from(size.width_px), usize::from(size.height_px));
    let focal_px = camera.focal_widths * f32::from(size.width_px);
    let axes = pose.axes();
    let mut image = vec![[0.0_f32; 3]; width * height];
    let place = |x: f32, y: f32| {
        let [north, east, down] =
            Pose::ray(&axes, (0.5 * height as f32 - y) / focal_px, (x - 0.5 * width as f32) / focal_px);
        // Above the horizon: distant haze.
        let far = pose.height_m / down.max(0.02);
        (pose.north_m + north * far, pose.east_m + east * far, far)
    };
    let objects = objects(scene);
    let mut near = Vec::new();
    for (row, line) in image.chunks_mut(width).enumerate() {
        for (column, pixel) in line.iter_mut().enumerate() {
            let (x, y) = (column as f32, row as f32);
            let (north_m, east_m, far_m) = place(x + 0.5, y + 0.5);
            let samples = SAMPLES.map(|[dx, dy]| place(x + dx, y + dy));
            let off_m = |(n, e, _): &(f32, f32, f32)| (n - north_m).abs() + (e - east_m).abs();
            let spread_m = samples.iter().map(off_m).fold(0.0, f32::max);
            near.clear();
            near.extend(objects.iter().filter(|thing| thing.may_cover(north_m, east_m, spread_m)));
            let ground = scene.ground.colour(north_m, east_m, far_m / focal_px, seed);
            let mut sum = [0.0; 3];
            for (north_m, east_m, _) in samples {
                let lit = lit(&lighting.shadows, north_m, east_m);
                let colour = surface(&near, ground, north_m, east_m);
                sum = each(|k| sum[k] + 0.25 * lit * colour[k]);
            }
            *pixel = sum;
        }
    }
    sensor::expose(&mut image, lighting, size, seed)
}

/// The share of light on a point.
fn lit(shadows: &[Shadow], north_m: f32, east_m: f32) -> f32 {
    let mut lit = 1.0_f32;
    for shadow in shadows {
        let into_m = (north_m - shadow.north_m) * shadow.into[0] + (east_m - shadow.east_m) * shadow.into[1];
        if into_m > 0.0 && into_m < shadow.width_m {
            lit = lit.min(shadow.left);
        }
    }
    lit
}

/// All that lies on the ground, the lowest first.
fn objects(scene: &Scene) -> Vec<Thing> {
    let mut objects = scene.things.clone();
    if let Some(target) = &scene.target {
        let disc = |radius_m: f32, colour: Colour| Thing {
            shape: Shape::Disc,
            north_m: target.north_m,
            east_m: target.east_m,
            radius_m,
            turn_rad: 0.0,
            colour,
        };
        if target.ring_m > 0.0 {
            objects.push(disc(target.radius_m + target.ring_m, WHITE));
        }
        objects.push(disc(target.radius_m, target.colour));
    }
    objects.extend_from_slice(&scene.covers);
    objects
}

/// The colour of a point: the ground, or the objects on it.
fn surface(objects: &[&Thing], ground: Colour, north_m: f32, east_m: f32) -> Colour {
    let mut colour = ground;
    for thing in objects {
        let cover = thing.cover(north_m, east_m);
        if cover > 0.0 {
            colour = each(|k| colour[k] + cover * (thing.colour[k] - colour[k]));
        }
    }
    colour
}

/// The true position of the pad in the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Truth {
    /// The pad's centre.
    pub forward: f32,
    /// The pad's centre.
    pub right: f32,
    /// From its left end to its right end.
    pub width_px: f32,
    /// The share of the disc inside the picture.
    pub inside: f32,
    /// The share of the disc that objects cover.
    pub hidden: f32,
}

/// The true position of the pad of a scene.
#[must_use]
pub fn truth(scene: &Scene, camera: &Camera, pose: &Pose, size: Size) -> Option<Truth> {
    let target = scene.target?;
    let focal_px = camera.focal_widths * f32::from(size.width_px);
    let [forward, right, _] = pose.see(target.north_m, target.east_m);
    let half = [0.5 * f32::from(size.width_px) / focal_px, 0.5 * f32::from(size.height_px) / focal_px];
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    let (mut inside, mut hidden) = (0, 0);
    const SPOTS: usize = 400;
    for spot in 0..SPOTS {
        // Evenly over the disc (sunflower seeds), and round its edge.
        let turn = spot as f32 * 2.399_963;
        let at = |part: f32| {
            (
                target.north_m + part * target.radius_m * libm::cosf(turn),
                target.east_m + part * target.radius_m * libm::sinf(turn),
            )
        };
        let (north_m, east_m) = at(1.0);
        let [_, edge, _] = pose.see(north_m, east_m);
        (low, high) = (low.min(edge), high.max(edge));
        let (north_m, east_m) = at(((spot as f32 + 0.5) / SPOTS as f32).sqrt());
        let [forward, right, down] = pose.see(north_m, east_m);
        inside += usize::from(down > 0.0 && right.abs() < half[0] && forward.abs() < half[1]);
        hidden += usize::from(scene.covers.iter().any(|thing| thing.cover(north_m, east_m) > 0.5));
    }
    let part = |count: usize| count as f32 / SPOTS as f32;
    Some(Truth { forward, right, width_px: (high - low) * focal_px, inside: part(inside), hidden: part(hidden) })
}
