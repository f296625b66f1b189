//! Any lines: frames of any size, whole, broken or out of order, with discs and noise, through the pad detector.

use foxhound_core::base::time::Instant;
use foxhound_core::landing::observation::Seen;
use foxhound_pad::{Camera, Config, Format, Header, State};

use super::{Draw, Noise, Reached};

/// Any frames. Of a case, `answers` are the frames, `usable` those in which a pad was seen.
pub fn pad(case: &[u8]) -> Reached {
    let draw = &mut Draw { rest: case };
    let config = Config {
        camera: Camera { focal_widths: draw.field(0.866, 0.1, 6.0) },
        pad_radius_m: draw.field(0.25, 0.0, 6.0),
        height_tolerance: draw.field(0.2, 0.0, 1.0),
    };
    let Ok(detector) = config.build() else { return Reached::default() };
    let mut reached = Reached { configured: true, ..Reached::default() };
    let mut state = State::new();
    for _ in 0..=draw.below(4) {
        let format = if draw.below(3) == 0 { Format::Grey } else { Format::Rgb565 };
        let side = |draw: &mut Draw<'_>, usual: u16| match draw.below(8) {
            0 => draw.word() as u16,
            1 => u16::from(draw.byte()) + 16,
            _ => usual,
        };
        let (width_px, height_px) = (side(draw, 96), side(draw, 72));
        let height_m = match draw.below(4) {
            0 => None,
            1 => Some(draw.any(0.0, 20.0)),
            _ => Some(draw.between(0.4, 4.0)),
        };
        let header = Header { time: draw.instant(Instant(0)), width_px, height_px, format };
        let begun = detector.begin(&mut state, &header, height_m);
        let bytes_px = if format == Format::Grey { 1 } else { 2 };
        let mut line = vec![0; usize::from(width_px) * bytes_px];
        let disc = [draw.unit() * 96.0, draw.unit() * 72.0, draw.unit() * 60.0];
        let (red, ground) = (draw.word() as u16, draw.word() as u16);
        // Half of all colours are those of a pad on stone.
        let [pad, stone] = [(red, 0xa0c3), (ground, 0x7bef)]
            .map(|(colour, usual)| if colour.is_multiple_of(2) { usual } else { colour });
        let mut noise = Noise(u64::from(draw.word()));
        let (speck, mischief) = (draw.byte() as u64 & 63, draw.below(4));
        for row in 0..height_px.min(400) {
            for (column, pixel) in line.chunks_mut(bytes_px).enumerate() {
                let (dx, dy) = (column as f32 - disc[0], f32::from(row) - disc[1]);
                let is_in = dx * dx + dy * dy < disc[2] * disc[2];
                let random = noise.next();
                let value = match (random >> 8 & 255) < speck {
                    true => random as u16,
                    false if is_in => pad,
                    false => stone,
                };
                pixel.copy_from_slice(&value.to_le_bytes()[..bytes_px]);
            }
            let (number, length) = match mischief {
                0 if noise.next().is_multiple_of(200) => (noise.next() as u16, line.len()),
                1 if noise.next().is_multiple_of(200) => (row, noise.next() as usize % (line.len() + 1)),
                2 if noise.next().is_multiple_of(300) => continue,
                _ => (row, line.len()),
            };
            let taken = detector.line(&mut state, number, &line[..length]);
            assert!(begun.is_ok() || taken.is_err(), "a line of a frame that has not begun");
        }
        let look = detector.end(&mut state);
        assert_eq!(look.time, header.time);
        assert!(begun.is_ok() || matches!(look.seen, Seen::Bad(_)), "{look:?}");
        reached.answers += 1;
        if let Seen::Pad(pad) = look.seen {
            reached.usable += 1;
            assert!(pad.forward.is_finite() && pad.right.is_finite(), "{pad:?}");
            assert!(pad.radius.is_finite() && pad.radius > 0.0, "{pad:?}");
            assert!((0.0..=1.0).contains(&pad.confidence), "{pad:?}");
        }
    }
    reached
}
