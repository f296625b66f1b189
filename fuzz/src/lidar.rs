//! The lidar's line.

use foxhound_computer::lidar::{Config, FRAME_BYTES, crc8};
use foxhound_core::base::time::Instant;
use foxhound_core::mapping::lidar::Mount;
use foxhound_core::mapping::scan::{RAYS_MAX, Sector};

use super::{Draw, Reached};

/// Any bytes, and frames whole and broken, of any angles: every whole frame that is sane is found, and a scan has sane rays.
pub fn lidar(case: &[u8]) -> Reached {
    let draw = &mut Draw { rest: case };
    let config = Config {
        mount: Mount { yaw_rad: draw.field(0.0, -4.0, 4.0), is_upside_down: draw.flag() },
        range_min_m: draw.field(0.1, 0.0, 1.2),
        range_max_m: draw.field(8.0, 0.5, 13.0),
        confidence_min: draw.byte(),
        trusts_silence: draw.flag(),
    };
    let Ok(mut lidar) = config.build() else { return Reached::default() };
    let mut reached = Reached { configured: true, ..Reached::default() };
    let (mut now, mut first_cdeg) = (Instant(0), draw.word() % 36_000);
    // As long as nothing broken came since, the next whole frame is found at once.
    let mut is_clean = true;
    while !draw.rest.is_empty() {
        now = if draw.below(16) == 0 { draw.instant(now) } else { now.plus_micros(2_667) };
        let step_cdeg = if draw.below(8) == 0 { draw.word() % 400 } else { 80 };
        let mut bytes = [0; FRAME_BYTES];
        bytes[..2].copy_from_slice(&[0x54, 0x2C]);
        // 80 hundredths of a degree from point to point are ten turns a second.
        bytes[2..4].copy_from_slice(&((45 * step_cdeg) as u16).to_le_bytes());
        bytes[4..6].copy_from_slice(&((first_cdeg % 36_000) as u16).to_le_bytes());
        let (word, mix) = (draw.word(), draw.word());
        for (index, byte) in bytes[6..42].iter_mut().enumerate() {
            *byte = (word.rotate_left(index as u32) ^ mix.rotate_right(3 * index as u32)) as u8;
        }
        bytes[42..44].copy_from_slice(&(((first_cdeg + 11 * step_cdeg) % 36_000) as u16).to_le_bytes());
        bytes[46] = crc8(&bytes[..46]);
        let is_sane = 11 * step_cdeg % 36_000 <= 2_000;
        first_cdeg = if draw.below(16) == 0 { draw.word() % 36_000 } else { (first_cdeg + 12 * step_cdeg) % 36_000 };
        let before = lidar.counters().frames;
        match draw.below(8) {
            0 => {
                bytes[usize::from(draw.byte()) % FRAME_BYTES] ^= draw.byte();
                lidar.push(now, &bytes);
                is_clean = false;
            }
            1 => {
                lidar.push(now, &bytes[usize::from(draw.byte()) % FRAME_BYTES..]);
                is_clean = false;
            }
            2 => {
                let noise = [(); 5].map(|()| draw.byte());
                lidar.push(now, &noise);
                is_clean = false;
            }
            _ => {
                bytes.chunks(1 + usize::from(draw.byte())).for_each(|piece| lidar.push(now, piece));
                let found = lidar.counters().frames - before;
                assert!(!is_clean || found == u32::from(is_sane), "{found} of a whole frame");
                // What was broken may hold back one frame's length of bytes, no more than that.
                is_clean = is_sane && found > 0;
                reached.answers += found;
            }
        }
        if let Some(scan) = lidar.scan() {
            reached.usable += 1;
            assert!(scan.is_plausible() && scan.rays.len() == RAYS_MAX && scan.turn() == Some(RAYS_MAX), "{scan:?}");
            for sector in scan.rays.iter() {
                if let Sector::Hit(range_m) = sector {
                    let (least_m, most_m) = (config.range_min_m - 1e-3, config.range_max_m + 1e-3);
                    assert!(range_m > 0.0 && (least_m..=most_m).contains(&range_m), "{range_m}");
                }
            }
            lidar.take();
        }
    }
    reached
}
