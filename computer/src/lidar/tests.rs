use std::vec::Vec;

use foxhound_core::base::rng::Rng;

use super::*;

/// The example of LDROBOT's development manual of the LD19.
const EXAMPLE: [u8; FRAME_BYTES] = [
    0x54, 0x2C, 0x68, 0x08, 0xAB, 0x7E, 0xE0, 0x00, 0xE4, 0xDC, 0x00, 0xE2, 0xD9, 0x00, 0xE5, 0xD5, 0x00, 0xE3, 0xD3,
    0x00, 0xE4, 0xD0, 0x00, 0xE9, 0xCD, 0x00, 0xE4, 0xCA, 0x00, 0xE2, 0xC7, 0x00, 0xE9, 0xC5, 0x00, 0xE5, 0xC2, 0x00,
    0xE5, 0xC0, 0x00, 0xE5, 0xBE, 0x82, 0x3A, 0x1A, 0x50,
];

/// The remainder of the message by the polynomial, bit by bit as one divides on paper.
fn remainder(bytes: &[u8]) -> u8 {
    let mut bits: Vec<bool> = bytes.iter().flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1 != 0)).collect();
    bits.extend([false; 8]);
    let divisor = [true, false, true, false, false, true, true, false, true];
    for at in 0..bits.len() - 8 {
        if bits[at] {
            bits[at..].iter_mut().zip(divisor).for_each(|(bit, of)| *bit ^= of);
        }
    }
    bits[bits.len() - 8..].iter().fold(0, |byte, bit| byte << 1 | u8::from(*bit))
}

fn frame(first_cdeg: u32, step_cdeg: u32, point: impl Fn(u32) -> (u16, u8)) -> [u8; FRAME_BYTES] {
    let mut bytes = [0; FRAME_BYTES];
    let word = |cdeg: u32| ((cdeg % 36_000) as u16).to_le_bytes();
    bytes[..4].copy_from_slice(&[0x54, 0x2C, 0x10, 0x0E]);
    bytes[4..6].copy_from_slice(&word(first_cdeg));
    for k in 0..12 {
        let (distance_mm, confidence) = point(first_cdeg + step_cdeg * k);
        bytes[6 + 3 * k as usize..8 + 3 * k as usize].copy_from_slice(&distance_mm.to_le_bytes());
        bytes[8 + 3 * k as usize] = confidence;
    }
    bytes[42..44].copy_from_slice(&word(first_cdeg + step_cdeg * 11));
    bytes[46] = remainder(&bytes[..46]);
    bytes
}

/// So many points from an angle on, of a lidar that turns once in 0.1 s: frames and when they have come.
fn turns(
    from_cdeg: u32,
    points: u32,
    step_cdeg: u32,
    point: impl Fn(u32) -> (u16, u8),
) -> Vec<(Instant, [u8; FRAME_BYTES])> {
    (0..points / 12)
        .map(|number| {
            let first_cdeg = from_cdeg + 12 * step_cdeg * number;
            let time = Instant(u64::from(first_cdeg + 12 * step_cdeg) * 100_000 / 36_000);
            (time, frame(first_cdeg, step_cdeg, &point))
        })
        .collect()
}

fn lidar() -> Lidar {
    Config::default().build().unwrap()
}

#[test]
fn the_manuals_frame_is_right_and_says_what_the_manual_says() {
    assert_eq!((crc8(&EXAMPLE[..46]), remainder(&EXAMPLE[..46])), (0x50, 0x50));
    let mut lidar = Config { range_min_m: 0.0, ..Config::default() }.build().unwrap();
    lidar.push(Instant(0), &EXAMPLE);
    assert_eq!(lidar.counters(), Counters { frames: 1, ..Counters::default() });
    // 324.27 deg, 0.224 m; 334.70 deg, 0.192 m; two points in 325 deg, 220 and 217 mm.
    // Ray 0 is astern.
    assert_eq!(lidar.rays.get(144), Sector::Hit(0.224));
    assert_eq!(lidar.rays.get(154), Sector::Hit(0.192));
    assert_eq!(lidar.rays.get(145), Sector::Hit(0.220));
    assert_eq!(lidar.rays.get(143), Sector::Unknown);
}

#[test]
fn a_turn_is_a_scan_of_one_degree_with_the_nearest_point_in_each() {
    for from_cdeg in [0, 9_000, 35_990] {
        let mut lidar = lidar();
        let mut scans = Vec::new();
        for (time, bytes) in turns(from_cdeg, 1800, 80, |cdeg| ((1000 + cdeg % 36_000 / 10) as u16, 200)) {
            lidar.push(time, &bytes);
            scans.extend(lidar.scan().cloned());
            lidar.take();
        }
        assert!((2..=3).contains(&scans.len()), "{from_cdeg}: {} turns of 4", scans.len());
        for scan in scans {
            assert_eq!(scan.turn(), Some(360));
            for (degree, sector) in scan.rays.iter().enumerate() {
                let Sector::Hit(range_m) = sector else { panic!("{degree}: {sector:?}") };
                // Ray 0 is astern.
                let nearest_m = 1.0 + ((degree + 180) % 360) as f32 * 0.01;
                assert!((nearest_m - 0.001..nearest_m + 0.009).contains(&range_m), "{degree}: {range_m}");
            }
        }
    }
}

#[test]
fn the_time_of_a_scan_is_the_middle_of_its_turn_however_long_its_bytes_waited() {
    for step_us in [1, 20_000, 33_000] {
        let mut lidar = lidar();
        let mut waiting = Vec::new();
        // The first whole turn begins astern.
        let mut middle_us = 0;
        for (time, bytes) in turns(0, 2400, 80, |_| (2000, 200)) {
            waiting.extend(bytes);
            let step = Instant(time.0.div_ceil(step_us) * step_us);
            // The next frame comes after this step.
            if time.0 + 2_667 > step.0 {
                let waited = std::mem::take(&mut waiting);
                let (first, rest) = waited.split_at(waited.len() * 2 / 3);
                lidar.push(step, first);
                lidar.push(step, rest);
            }
            if let Some(scan) = lidar.scan() {
                middle_us += 100_000;
                assert!(scan.time.0.abs_diff(middle_us) < 4_000, "{step_us}: {} for {middle_us}", scan.time.0);
                assert!((scan.turn_s - 0.1).abs() < 1e-6);
            }
            lidar.take();
        }
        assert!(lidar.counters().turns >= 3);
    }
}

#[test]
fn azimuth_runs_clockwise_from_the_nose_however_it_is_mounted() {
    // Something at 90 deg of the lidar's own.
    let seen_deg = |config: Config| {
        let mut lidar = config.build().unwrap();
        for (time, bytes) in
            turns(0, 1400, 80, |cdeg| (if (8_950..9_050).contains(&(cdeg % 36_000)) { 1500 } else { 0 }, 99))
        {
            lidar.push(time, &bytes);
        }
        let scan = lidar.scan().unwrap();
        let hits: Vec<_> = (0..360).filter(|ray| matches!(scan.rays.get(*ray), Sector::Hit(_))).collect();
        let clear = (0..360).filter(|ray| scan.rays.get(*ray) == Sector::Clear).count();
        assert_eq!(clear + hits.len(), 360);
        let middle = hits.iter().sum::<usize>() as f32 / hits.len() as f32;
        wrap_pi(scan.first_azimuth_rad + scan.step_rad * middle).to_degrees()
    };
    assert!((seen_deg(Config::default()) - 90.0).abs() < 0.6);
    let yaw_rad = 1.0;
    let turned = Config { mount: Mount { yaw_rad, is_upside_down: false }, ..Config::default() };
    assert!((seen_deg(turned) - 147.3).abs() < 0.6);
    assert!(
        (seen_deg(Config { mount: Mount { yaw_rad, is_upside_down: true }, ..Config::default() }) + 32.7).abs() < 0.6
    );
}

#[test]
fn what_is_no_reading_is_unknown_and_what_is_silent_free_if_that_is_wanted() {
    let see = |config: Config, distance_mm, confidence| config.build().unwrap().seen(distance_mm, confidence);
    let usual = Config::default();
    assert_eq!(see(usual, 0, 0), Sector::Clear);
    assert_eq!(see(Config { trusts_silence: false, ..usual }, 0, 0), Sector::Unknown);
    assert_eq!(see(usual, 99, 200), Sector::Unknown, "the vehicle");
    assert_eq!(see(usual, 2000, 14), Sector::Unknown);
    assert_eq!(see(usual, 2000, 15), Sector::Hit(2.0));
    assert_eq!(see(usual, 8001, 200), Sector::Clear, "farther than we look");
    let nowhere = Mount { yaw_rad: f32::NAN, ..Mount::default() };
    for bad in [Config { mount: nowhere, ..usual }, Config { range_max_m: 0.05, ..usual }] {
        assert!(bad.build().is_err());
    }
}

/// Two points a degree: nothing reflected, and a point that is not sure, in either order.
#[test]
fn a_point_that_is_not_sure_is_not_overruled_by_one_without_a_reflection() {
    for unsure_cdeg in [0, 50] {
        let mut lidar = lidar();
        let is_weak = |cdeg: u32| (4_000..9_000).contains(&(cdeg % 36_000)) && cdeg % 100 == unsure_cdeg;
        for (time, bytes) in turns(0, 1800, 50, |cdeg| if is_weak(cdeg) { (1500, 14) } else { (0, 0) }) {
            lidar.push(time, &bytes);
            if let Some(scan) = lidar.scan() {
                let unknown = scan.rays.iter().filter(|sector| *sector == Sector::Unknown).count();
                assert_eq!(unknown, 50, "{unsure_cdeg}");
                lidar.take();
            }
        }
        assert!(lidar.counters().turns >= 1);
    }
}

#[test]
fn a_frame_that_is_lost_leaves_unknown_rays_and_no_old_ones() {
    let mut lidar = lidar();
    for (number, (time, bytes)) in
        turns(0, 1800, 80, |cdeg| ((1000 + cdeg / 36_000) as u16, 200)).into_iter().enumerate()
    {
        if number % 10 != 3 {
            lidar.push(time, &bytes);
        }
        if let Some(scan) = lidar.scan() {
            let unknown = scan.rays.iter().filter(|sector| *sector == Sector::Unknown).count();
            assert!((27..=50).contains(&unknown), "{unknown} rays of 3 or 4 frames");
            let newest = scan.rays.iter().filter_map(|sector| if let Sector::Hit(m) = sector { Some(m) } else { None });
            assert!(
                newest.fold(9.0, f32::min) > 0.999 + 0.001 * (lidar.counters().turns as f32 - 1.0),
                "none of before"
            );
            lidar.take();
        }
    }
    assert!(lidar.counters().turns >= 2);
}

#[test]
fn after_a_silence_or_a_stop_of_the_motor_no_scan_has_readings_from_before() {
    // Before, everything is 2 m away, and 3 m after; it goes on at any angle, even where it ended.
    let has_old = |scan: &Scan| scan.rays.iter().any(|sector| sector == Sector::Hit(2.0));
    for pause_us in [75_000, 150_000, 400_000, 3_000_000] {
        for on_cdeg in [0, 4_000, 16_000, 26_000, 35_000] {
            for stands in [false, true] {
                let mut lidar = lidar();
                let (mut end, mut end_cdeg) = (Instant(0), 0);
                for (time, bytes) in turns(0, 780, 80, |_| (2000, 200)) {
                    lidar.push(time, &bytes);
                    lidar.take();
                    (end, end_cdeg) = (time, end_cdeg + 960);
                }
                // A motor that stands still sends one angle over and over.
                for at_us in (0..if stands { pause_us } else { 0 }).step_by(2_667) {
                    lidar.push(end.plus_micros(at_us), &frame(end_cdeg, 0, |_| (2000, 200)));
                    lidar.take();
                }
                let from_cdeg = if stands { end_cdeg } else { on_cdeg };
                let mut scans = 0;
                for (time, bytes) in turns(from_cdeg, 2250, 80, |_| (3000, 200)) {
                    let since_us = time.0 - u64::from(from_cdeg) * 100_000 / 36_000;
                    lidar.push(end.plus_micros(pause_us + since_us), &bytes);
                    if let Some(scan) = lidar.scan() {
                        // Of a motor that stood only as long as a slow turn takes, the first one is a slow turn.
                        let is_slow = stands && pause_us < 160_000 && scans == 0;
                        assert!(is_slow || !has_old(scan), "{pause_us} {on_cdeg} {stands} {scans}");
                        scans += 1;
                    }
                    lidar.take();
                }
                assert!(scans >= 3, "{pause_us} {on_cdeg} {stands}: {scans} of 5 turns");
            }
        }
    }
}

#[test]
fn every_whole_frame_is_found_in_whatever_lies_between_and_nothing_else() {
    let mut rng = Rng::new(5, 5);
    for _ in 0..200 {
        let mut lidar = lidar();
        let (mut stream, mut whole) = (Vec::new(), 0);
        for (_, mut bytes) in turns(0, 480, 80, |cdeg| ((cdeg % 9000) as u16, 84)) {
            match (rng.uniform() * 4.0) as u32 {
                // Noise, which may begin like a frame but holds none.
                0 => stream.extend((0..(rng.uniform() * 60.0) as usize).map(|k| if k % 7 == 0 { 0x54 } else { 0x2C })),
                1 => {
                    let at = (rng.uniform() * 46.9) as usize;
                    bytes[at] ^= 1 << ((rng.uniform() * 7.9) as u32);
                    stream.extend(bytes);
                    continue;
                }
                _ => {}
            }
            stream.extend(bytes);
            whole += 1;
        }
        for piece in stream.chunks(1 + (rng.uniform() * 60.0) as usize) {
            lidar.push(Instant(0), piece);
        }
        assert_eq!(lidar.counters().frames, whole);
    }
}

#[test]
fn any_bytes_leave_it_sane() {
    let mut rng = Rng::new(6, 6);
    let (mut lidar, mut turns) = (lidar(), 0);
    for step in 0..20_000_u64 {
        // Right or nearly, of any angles.
        let any = |rng: &mut Rng| (rng.uniform() * 65_536.0) as u32;
        let (first, step_cdeg) = (any(&mut rng), any(&mut rng) % 300);
        let (distance, confidence) = (any(&mut rng) as u16, any(&mut rng) as u8);
        let mut bytes = frame(first, step_cdeg, |_| (distance, confidence));
        if rng.uniform() < 0.3 {
            bytes[4..6].copy_from_slice(&(any(&mut rng) as u16).to_le_bytes());
            bytes[46] = remainder(&bytes[..46]);
        }
        lidar.push(Instant(step * 2_700), &bytes[..(rng.uniform() * 60.0) as usize % 48]);
        lidar.push(Instant(step * 2_700), &bytes);
        if let Some(scan) = lidar.scan() {
            turns += 1;
            assert!(scan.is_plausible() && scan.rays.len() == 360);
            assert!(scan.rays.iter().all(|sector| !matches!(sector, Sector::Hit(m) if !(0.1..=8.0).contains(&m))));
        }
        lidar.take();
    }
    assert!(turns > 1_000, "{turns}");
}
