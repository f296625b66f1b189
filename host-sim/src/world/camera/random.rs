//! Random scenes: any ground, light and clutter, with a pad or without.

use std::f32::consts::{PI, TAU};

use super::{
    Camera, Colour, Frame, Ground, Lighting, PAD_RED, Pose, Scene, Shadow, Shape, Size, Target, Thing, Truth,
    direction, lamp, render, truth,
};
use crate::world::random::Random;

/// Conditions of a random picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recipe {
    /// Whether there is a pad.
    pub has_pad: bool,
    /// Range of heights, uniform in their logarithm.
    pub height_m: [f32; 2],
    /// Largest lean.
    pub lean_rad: f32,
    /// Radius of the pad.
    pub pad_radius_m: f32,
    /// Largest share of the pad that objects cover.
    pub hidden: f32,
    /// Whether the whole pad is in the picture; otherwise about its centre is.
    pub is_whole: bool,
    /// Format of the camera.
    pub size: Size,
}

impl Recipe {
    /// The pad from 0.5 to 10 m, leaning by up to 20 degrees.
    pub const PAD: Self = Self {
        has_pad: true,
        height_m: [0.5, 10.0],
        lean_rad: 20.0 * PI / 180.0,
        pad_radius_m: 0.25,
        hidden: 0.3,
        is_whole: true,
        size: Size::USUAL,
    };
    /// The same without one.
    pub const CLUTTER: Self = Self { has_pad: false, ..Self::PAD };
}

/// A picture, and its truth.
#[derive(Clone, Debug)]
pub struct Shot {
    /// The scene.
    pub scene: Scene,
    /// Pose of the camera.
    pub pose: Pose,
    /// The lighting.
    pub lighting: Lighting,
    /// The picture.
    pub frame: Frame,
    /// Position of the pad.
    pub truth: Option<Truth>,
}

/// Random numbers of a picture.
pub(super) struct Draw(pub(super) Random);

impl Draw {
    pub(super) fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.0.uniform() as f32
    }

    pub(super) fn one_of(&mut self, count: usize) -> usize {
        (self.0.uniform() * count as f64) as usize
    }

    pub(super) fn chance(&mut self, part: f64) -> bool {
        self.0.uniform() < part
    }

    /// Uniform in the logarithm.
    pub(super) fn scale(&mut self, low: f32, high: f32) -> f32 {
        libm::expf(self.between(libm::logf(low), libm::logf(high)))
    }

    pub(super) fn turn(&mut self) -> f32 {
        self.between(0.0, TAU)
    }

    pub(super) fn vary(&mut self, colour: Colour, by: f32) -> Colour {
        let all = self.between(1.0 - by, 1.0 + by);
        colour.map(|value| (value * all * self.between(1.0 - 0.4 * by, 1.0 + 0.4 * by)).min(0.95))
    }
}

/// Draws a picture.
#[must_use]
pub fn shot(recipe: &Recipe, camera: &Camera, seed: u64) -> Shot {
    let mut draw = Draw(Random::new(seed, 40));
    let height_m = draw.scale(recipe.height_m[0], recipe.height_m[1]);
    let (lean_rad, lean_to) = (recipe.lean_rad * (draw.0.uniform() as f32).sqrt(), draw.turn());
    let pose = Pose {
        height_m,
        roll_rad: lean_rad * libm::cosf(lean_to),
        pitch_rad: lean_rad * libm::sinf(lean_to),
        yaw_rad: draw.turn(),
        ..Pose::default()
    };
    let mut scene = Scene { ground: ground(&mut draw), things: Vec::new(), target: None, covers: Vec::new() };
    let mut found = None;
    if recipe.has_pad {
        let half = 0.5 / camera.focal_widths;
        let ratio = f32::from(recipe.size.height_px) / f32::from(recipe.size.width_px);
        let paint = draw.vary(PAD_RED, 0.25);
        let ring_m = if draw.chance(0.4) { draw.between(0.03, 0.08) } else { 0.0 };
        for attempt in 0..60 {
            // Near the middle where it is large.
            let reach = 1.0 - attempt as f32 / 60.0;
            let forward = reach * draw.between(-half * ratio, half * ratio);
            let right = reach * draw.between(-half, half);
            let axes = pose.axes();
            let [north, east, down] = Pose::ray(&axes, forward, right);
            let far = height_m / down.max(0.1);
            let (north_m, east_m) = (north * far, east * far);
            let target = Target { north_m, east_m, radius_m: recipe.pad_radius_m, ring_m, colour: paint };
            scene.target = Some(target);
            found = truth(&scene, camera, &pose, recipe.size);
            if found.is_some_and(|truth| !recipe.is_whole || truth.inside >= 1.0) {
                break;
            }
        }
        if recipe.hidden > 0.0 && draw.chance(0.4) {
            cover(&mut draw, &mut scene, recipe.hidden);
        }
    }
    clutter(&mut draw, &mut scene, height_m, camera, if recipe.has_pad { 0.6 } else { 1.0 });
    let lighting = lighting(&mut draw, &scene, height_m);
    let frame = render(&scene, camera, &pose, &lighting, recipe.size, seed);
    let truth = found.and_then(|_| truth(&scene, camera, &pose, recipe.size));
    Shot { scene, pose, lighting, frame, truth }
}

fn ground(draw: &mut Draw) -> Ground {
    match draw.one_of(7) {
        0 => Ground::Grass,
        1 => Ground::Gravel,
        2 => Ground::Concrete,
        3 => Ground::Tiles { side_m: draw.between(0.15, 0.8), colour: draw.vary([0.40, 0.38, 0.35], 0.3) },
        4 => Ground::Soil { colour: draw.vary([0.28, 0.19, 0.12], 0.3) },
        5 => Ground::Soil { colour: draw.vary([0.27, 0.14, 0.085], 0.2) },
        _ => Ground::Mixed,
    }
}

/// A leaf, some leaves, or a cable on the pad.
fn cover(draw: &mut Draw, scene: &mut Scene, most: f32) {
    let Some(target) = scene.target else { return };
    let kind = draw.one_of(3);
    let pieces = if kind == 1 { 1 + draw.one_of(4) } else { 1 };
    for _ in 0..pieces {
        let (turn, away) = (draw.turn(), draw.between(0.0, 1.1) * target.radius_m);
        let (shape, radius_m) = match kind {
            0 => (Shape::Leaf(draw.between(1.2, 2.2)), draw.between(0.2, 0.55) * target.radius_m),
            1 => (Shape::Leaf(draw.between(1.2, 3.0)), draw.between(0.08, 0.2) * target.radius_m),
            _ => (Shape::Rectangle(200.0), draw.between(0.004, 0.02)),
        };
        let colours = [[0.07, 0.12, 0.03], [0.25, 0.18, 0.06], [0.03, 0.03, 0.03], [0.6, 0.6, 0.58]];
        let paint = colours[draw.one_of(4)];
        let colour = draw.vary(paint, 0.3);
        let thing = Thing {
            shape,
            north_m: target.north_m + away * libm::cosf(turn),
            east_m: target.east_m + away * libm::sinf(turn),
            radius_m,
            turn_rad: draw.turn(),
            colour,
        };
        scene.covers.push(thing);
        let level = Pose { height_m: 1.0, ..Pose::default() };
        let hidden = truth(scene, &Camera::default(), &level, Size::USUAL).map_or(0.0, |truth| truth.hidden);
        if hidden > most {
            scene.covers.pop();
        }
    }
}

/// Objects that are red, round, or both, but not a pad.
fn clutter(draw: &mut Draw, scene: &mut Scene, height_m: f32, camera: &Camera, share: f64) {
    let reach_m = 0.6 * height_m / camera.focal_widths;
    let count = if draw.chance(share) { 1 + draw.one_of(3) } else { 0 };
    for _ in 0..count {
        let (north_m, east_m) = (draw.between(-reach_m, reach_m), draw.between(-reach_m, reach_m));
        let red = draw.vary(PAD_RED, 0.3);
        let pad_m = draw.between(0.15, 0.4);
        let (shape, radius_m, colour) = match draw.one_of(14) {
            0 => (Shape::Rectangle(2.4), 0.87, red),
            1 => {
                (Shape::Rectangle(draw.between(1.0, 1.5)), draw.between(0.8, 3.0), draw.vary([0.33, 0.13, 0.085], 0.25))
            }
            2 => (Shape::Glow, draw.between(1.0, 8.0), draw.vary([0.55, 0.18, 0.08], 0.2)),
            3 => (Shape::Leaf(draw.between(0.8, 2.0)), draw.between(0.3, 2.0), draw.vary([0.26, 0.14, 0.085], 0.2)),
            4 => (Shape::Sector(0.5), pad_m, red),
            5 => (Shape::Sector(0.25), pad_m, red),
            6 => (Shape::Ring(draw.between(0.55, 0.85)), pad_m, red),
            7 => (Shape::Triangle, 1.3 * pad_m, red),
            8 => (Shape::Rectangle(1.0), 0.9 * pad_m, red),
            9 => (Shape::Disc, pad_m, draw.vary([0.60, 0.24, 0.03], 0.15)),
            10 => (Shape::Disc, pad_m, draw.vary([0.65, 0.52, 0.05], 0.2)),
            11 => (Shape::Disc, pad_m, draw.vary([0.45, 0.06, 0.35], 0.2)),
            12 => (Shape::Disc, pad_m, draw.vary([0.04, 0.10, 0.40], 0.2)),
            _ => {
                for _ in 0..12 {
                    let (dn, de) = (draw.between(-0.5, 0.5), draw.between(-0.5, 0.5));
                    let colour = if draw.chance(0.7) { red } else { [0.7, 0.55, 0.05] };
                    let radius_m = draw.between(0.015, 0.05);
                    let turn_rad = draw.turn();
                    let thing = Thing {
                        shape: Shape::Leaf(1.2),
                        north_m: north_m + dn,
                        east_m: east_m + de,
                        radius_m,
                        turn_rad,
                        colour,
                    };
                    push(scene, thing);
                }
                continue;
            }
        };
        let thing = Thing { shape, north_m, east_m, radius_m, turn_rad: draw.turn(), colour };
        push(scene, thing);
        if radius_m == 0.87 {
            // Its windows.
            let (sine, cosine) = libm::sincosf(thing.turn_rad);
            for along_m in [0.6, -1.2] {
                let window = Thing {
                    shape: Shape::Rectangle(0.35),
                    north_m: north_m + along_m * cosine,
                    east_m: east_m + along_m * sine,
                    radius_m: 0.7,
                    colour: [0.03, 0.035, 0.04],
                    ..thing
                };
                push(scene, window);
            }
        }
    }
}

/// Adds an object where it does not touch the pad; a glow or soil may be under it.
fn push(scene: &mut Scene, thing: Thing) {
    let is_under = matches!(thing.shape, Shape::Glow) || thing.colour[0] < 0.3;
    let is_clear = scene.target.is_none_or(|target| {
        let apart_m = libm::hypotf(thing.north_m - target.north_m, thing.east_m - target.east_m);
        apart_m > 1.15 * thing.radius_m * thing.reach() + target.radius_m + 0.1
    });
    if is_under || is_clear {
        scene.things.push(thing);
    }
}

fn lighting(draw: &mut Draw, scene: &Scene, height_m: f32) -> Lighting {
    let exposure = draw.scale(0.25, 2.5);
    // The camera balances a part of the lamp's colour.
    let left = draw.between(0.3, 1.0);
    let gains = lamp(1.0 / draw.between(1.0 / 9000.0, 1.0 / 2700.0)).map(|gain| libm::powf(gain, left));
    let brightness = 1.0 / (0.2126 * gains[0] + 0.7152 * gains[1] + 0.0722 * gains[2]);
    let mut lighting = Lighting {
        exposure,
        gains: gains.map(|gain| gain * brightness),
        vignette: draw.between(0.0, 0.5),
        gradient: [draw.between(-0.6, 0.6), draw.between(-0.6, 0.6)],
        flare: draw.between(0.0, 0.05),
        blur_px: draw.between(0.0, 1.0),
        read_noise: draw.scale(0.002, 0.012),
        full_well: draw.scale(1500.0, 8000.0),
        dead_ppm: if draw.chance(0.3) { draw.between(0.0, 1000.0) } else { 0.0 },
        ..Lighting::default()
    };
    if draw.chance(0.4) {
        lighting.motion_px = [draw.between(-2.5, 2.5), draw.between(-2.5, 2.5)];
    }
    if draw.chance(0.4) {
        for _ in 0..=draw.one_of(2) {
            // Some of them across the pad.
            let away_m = 0.3 * height_m;
            let (north_m, east_m) = match scene.target {
                Some(target) if draw.chance(0.6) => (
                    target.north_m + target.radius_m * draw.between(-0.8, 0.8),
                    target.east_m + target.radius_m * draw.between(-0.8, 0.8),
                ),
                _ => (draw.between(-away_m, away_m), draw.between(-away_m, away_m)),
            };
            lighting.shadows.push(Shadow {
                north_m,
                east_m,
                into: direction(draw.turn()),
                width_m: draw.scale(0.1, 20.0),
                left: draw.between(0.2, 0.6),
            });
        }
    }
    lighting
}
