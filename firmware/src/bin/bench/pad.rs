//! The pad detector's row: a whole frame with a pad on rough ground.

use core::hint::black_box;

use crate::halt;
use foxhound_core::base::rng::Rng;
use foxhound_core::base::time::Instant;
use foxhound_core::landing::observation::Seen;
use foxhound_pad::{Config, Format, Header, State};
use static_cell::ConstStaticCell;

use crate::row;

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

static STATE: ConstStaticCell<State> = ConstStaticCell::new(State::new());

/// The worst of some frames, with the pad near and far; each is shown twice, so that its light is known.
#[inline(never)]
pub fn rows(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let Ok(detector) = Config::default().build() else { halt(format_args!("the pad detector does not build")) };
    let state = STATE.take();
    let mut worst = 0;
    for (format, name, ceiling) in [(Format::Rgb565, "pad_160x120", 400_000), (Format::Grey, "pad_160x120_grey", 0)] {
        for (seed, radius_px, height_m) in [(1, 12, Some(2.9)), (2, 50, Some(0.69)), (3, 30, None), (4, 0, None)] {
            for _ in 0..2 {
                let (total, seen) = frame(measure, &detector, state, format, seed, radius_px, height_m);
                worst = worst.max(total);
                if format == Format::Rgb565 && radius_px > 0 && !matches!(seen, Seen::Pad(_)) {
                    halt(format_args!("the pad is not seen: {seen:?}"));
                }
            }
        }
        row(name, worst, ceiling);
        worst = 0;
    }
}

/// The instructions of a frame, without those that make it.
fn frame(
    measure: &impl Fn(&mut dyn FnMut()) -> u32,
    detector: &foxhound_pad::Detector,
    state: &mut State,
    format: Format,
    seed: u64,
    radius_px: i32,
    height_m: Option<f32>,
) -> (u32, Seen) {
    let header = Header { time: Instant(0), width_px: WIDTH as u16, height_px: HEIGHT as u16, format };
    let mut rng = Rng::new(seed, 9);
    let mut line = [0_u8; 2 * WIDTH];
    let mut total = measure(&mut || {
        let _ = black_box(detector.begin(state, black_box(&header), height_m));
    });
    for y in 0..HEIGHT {
        let bytes = match format {
            Format::Rgb565 => {
                for (x, pixel) in line.as_chunks_mut::<2>().0.iter_mut().enumerate() {
                    *pixel = colour(x, y, radius_px, &mut rng).to_le_bytes();
                }
                &line[..]
            }
            Format::Grey => {
                for (x, pixel) in line.iter_mut().take(WIDTH).enumerate() {
                    *pixel = (colour(x, y, radius_px, &mut rng) >> 3) as u8;
                }
                &line[..WIDTH]
            }
        };
        total += measure(&mut || {
            let _ = black_box(detector.line(state, y as u16, black_box(bytes)));
        });
    }
    let mut seen = None;
    let end = measure(&mut || seen = Some(detector.end(state).seen));
    total += end;
    (total, seen.unwrap_or(Seen::Bad(foxhound_core::landing::observation::Bad::NotBegun)))
}

/// Red in the disc, rough and grey around it, here and there a red grain.
fn colour(x: usize, y: usize, radius_px: i32, rng: &mut Rng) -> u16 {
    let (dx, dy) = (x as i32 - 84, y as i32 - 57);
    let noise = (rng.uniform() * 6.0) as u16;
    if dx * dx + dy * dy < radius_px * radius_px || rng.uniform() < 0.001 {
        (18 + noise) << 11 | (8 + noise) << 5 | (4 + noise / 2)
    } else {
        (9 + noise) << 11 | (19 + 2 * noise) << 5 | (9 + noise)
    }
}
