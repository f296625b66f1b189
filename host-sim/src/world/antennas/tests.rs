use super::*;

/// Phase and amplitude of the tone by correlation in `f64`, independent of the core.
fn phasor(row: &[i16], cycles: f64) -> (f64, f64) {
    let n = row.len() as f64;
    let (mut re, mut im) = (0.0, 0.0);
    for (k, code) in row.iter().enumerate() {
        let angle = TAU * cycles * (k as f64 - (n - 1.0) / 2.0) / n;
        re += f64::from(*code) * angle.cos();
        im -= f64::from(*code) * angle.sin();
    }
    (im.atan2(re), 2.0 / n * re.hypot(im))
}

fn clean() -> Antennas {
    Antennas { snr_db: None, ..Antennas::default() }
}

fn phases(antennas: &Antennas, pose: &Pose, source: [f64; 3]) -> [f64; 4] {
    let frame = antennas.frame::<256>(Instant(0), pose, source, &mut Random::new(1, 1));
    frame.codes.each_ref().map(|row| phasor(row, 37.0).0)
}

fn ahead(phase: f64, of: f64) -> f64 {
    crate::world::wrap_pi(phase - of)
}

#[test]
fn a_directional_antenna_hears_by_the_angle_off_its_boresight_whatever_the_attitude() {
    let boresights_rad = [0.0, 30.0, 90.0, 180.0].map(f64::to_radians);
    let pattern = Some(Pattern { exponent: 2.0, front_to_back_db: 15.0, boresights_rad });
    let all_round = clean();
    let directional = Antennas { pattern, ..clean() };
    for (yaw_deg, azimuth_deg) in [(0.0_f64, 0.0_f64), (50.0, 50.0), (200.0, -70.0), (-45.0, 135.0)] {
        // Far away, so that all antennas have the same direction to it.
        let azimuth_rad = azimuth_deg.to_radians();
        let source = [5000.0 * azimuth_rad.cos(), 5000.0 * azimuth_rad.sin(), 0.0];
        let pose = Pose { yaw_rad: yaw_deg.to_radians(), ..Pose::default() };
        let amplitudes = |antennas: &Antennas| {
            let frame = antennas.frame::<256>(Instant(0), &pose, source, &mut Random::new(1, 1));
            frame.codes.each_ref().map(|row| phasor(row, 37.0).1)
        };
        let (flat, lobed) = (amplitudes(&all_round), amplitudes(&directional));
        for channel in 0..CHANNELS {
            let off_rad = azimuth_rad - pose.yaw_rad - boresights_rad[channel];
            let expected_db = 10.0 * ((0.5 + 0.5 * off_rad.cos()).powi(2) + 10.0_f64.powf(-1.5)).log10();
            let heard_db = 20.0 * (lobed[channel] / flat[channel]).log10();
            assert!((heard_db - expected_db).abs() < 0.05, "{yaw_deg} {azimuth_deg} {channel}: {heard_db}");
        }
    }
    // Straight up is at a right angle to all boresights, unless the vehicle tilts.
    let up = |pose: Pose| {
        let frame = directional.frame::<256>(Instant(0), &pose, [0.0, 0.0, -5000.0], &mut Random::new(1, 1));
        20.0 * (phasor(&frame.codes[0], 37.0).1 / 1500.0).log10()
    };
    let level_db = 10.0 * (0.25 + 10.0_f64.powf(-1.5)).log10();
    assert!((up(Pose { yaw_rad: 1.0, ..Pose::default() }) - level_db).abs() < 0.05);
    assert!(up(Pose { pitch_rad: 0.5, ..Pose::default() }) > level_db + 2.0, "the nose is up");
}

#[test]
fn the_antenna_nearer_the_source_leads_in_phase_whatever_the_yaw() {
    // The source is dead ahead of the nose: the front pair leads the back pair by k s, left and right agree.
    for yaw_deg in [0.0_f64, 90.0, 200.0, -45.0] {
        let yaw_rad = yaw_deg.to_radians();
        let pose = Pose { yaw_rad, ..Pose::default() };
        let source = [500.0 * yaw_rad.cos(), 500.0 * yaw_rad.sin(), 0.0];
        let [front_right, front_left, back_left, back_right] = phases(&clean(), &pose, source);
        let expected = TAU * 0.40;
        assert!((ahead(front_right, back_right) - expected).abs() < 1e-3, "yaw {yaw_deg}");
        assert!((ahead(front_left, back_left) - expected).abs() < 1e-3, "yaw {yaw_deg}");
        assert!(ahead(front_right, front_left).abs() < 1e-3, "yaw {yaw_deg}");
    }
    // To the right of the nose, the right pair leads.
    let [front_right, front_left, ..] = phases(&clean(), &Pose::default(), [0.0, 500.0, 0.0]);
    assert!((ahead(front_right, front_left) - TAU * 0.40).abs() < 1e-3);
}

#[test]
fn rolling_the_right_side_down_brings_the_right_antennas_nearer_a_source_below() {
    let pose = Pose { roll_rad: 0.3, position_ned_m: [0.0, 0.0, -500.0], ..Pose::default() };
    let [front_right, front_left, ..] = phases(&clean(), &pose, [0.0, 0.0, 0.0]);
    assert!((ahead(front_right, front_left) - TAU * 0.40 * 0.3_f64.sin()).abs() < 1e-3);
}

#[test]
fn pitching_the_nose_up_moves_the_front_antennas_up() {
    let pose = Pose { pitch_rad: 0.2, ..Pose::default() };
    assert!(pose.to_ned([1.0, 0.0, 0.0])[2] < -0.19);
    let turned = Pose { yaw_rad: 1.1, pitch_rad: 0.2, roll_rad: -0.4, ..Pose::default() };
    let norm: f64 = turned.to_ned([1.0, 2.0, 3.0]).iter().map(|x| x * x).sum();
    assert!((norm - 14.0).abs() < 1e-12, "a rotation keeps lengths");
}

#[test]
fn the_noise_has_the_asked_signal_to_noise_ratio() {
    for snr_db in [0.0, 10.0, 20.0] {
        let antennas = Antennas { snr_db: Some(snr_db), ..Antennas::default() };
        let mut random = Random::new(5, 1);
        let (mut signal, mut noise) = (0.0, 0.0);
        for _ in 0..200 {
            let frame = antennas.frame::<256>(Instant(0), &Pose::default(), [7.0, 3.0, 1.0], &mut random);
            for row in &frame.codes {
                let (phase, amplitude) = phasor(row, 37.0);
                signal += 256.0 * amplitude * amplitude / 2.0;
                for (k, code) in row.iter().enumerate() {
                    let tone = amplitude * (TAU * 37.0 * (k as f64 - 127.5) / 256.0 + phase).cos();
                    noise += (f64::from(*code) - tone).powi(2);
                }
            }
        }
        let measured_db = 10.0 * (signal / noise).log10();
        assert!((measured_db - snr_db).abs() < 0.1, "{snr_db} dB asked, {measured_db} dB in the codes");
    }
}

#[test]
fn amplitude_gain_mismatch_and_fall_off_arrive_in_the_codes() {
    let antennas = Antennas {
        channel_gain: [1.0, 0.5, 1.0, 1.0],
        channel_phase_rad: [0.0, 0.25, 0.0, 0.0],
        offset_codes: [0.0, 0.0, 40.0, 0.0],
        fall_off_from_m: Some(5.0),
        ..clean()
    };
    let source = [10.0, 0.0, 0.0];
    let frame = antennas.frame::<256>(Instant(0), &Pose::default(), source, &mut Random::new(1, 1));
    let amplitude = |channel: usize| phasor(&frame.codes[channel], 37.0).1;
    assert!((amplitude(0) - 750.0).abs() < 8.0, "{}", amplitude(0));
    assert!((amplitude(1) / amplitude(0) - 0.5).abs() < 1e-3);
    let mean = frame.codes[2].iter().map(|code| f64::from(*code)).sum::<f64>() / 256.0;
    assert!((mean - 40.0).abs() < 0.5);
    let [a1, a2, ..] = frame.codes.each_ref().map(|row| phasor(row, 37.0).0);
    assert!((ahead(a2, a1) - 0.25).abs() < 1e-3);
}

#[test]
fn codes_are_rounded_to_nearest_and_clipped_at_the_rails() {
    assert_eq!([0.4, 0.6, -0.6, 1e9, -1e9].map(quantise), [0, 1, -1, 2047, -2048]);
    let mut random = Random::new(1, 1);
    let halves = (-5000..5000).map(|k| f64::from(k) * 0.5);
    for value in halves.chain((0..1000).map(|_| 5000.0 * (random.uniform() - 0.5))) {
        assert_eq!(f64::from(quantise(value)), value.round_ties_even().clamp(-2048.0, 2047.0), "{value}");
    }
    let loud = Antennas { amplitude_codes: 4000.0, gain_control: false, ..clean() };
    let frame = loud.frame::<256>(Instant(0), &Pose::default(), [9.0, 0.0, 0.0], &mut Random::new(1, 1));
    assert!(frame.clip_count().iter().all(|clipped| *clipped > 100));
    let controlled = Antennas { gain_control: true, ..loud };
    let frame = controlled.frame::<256>(Instant(0), &Pose::default(), [9.0, 0.0, 0.0], &mut Random::new(1, 1));
    assert!(frame.clip_count().iter().all(|clipped| *clipped < 5));
}

/// Frames of a source 500 m ahead of a vehicle that looks north.
fn heard(impairments: Impairments, time: Instant) -> AdcFrame<256> {
    let antennas = Antennas { impairments, amplitude_codes: 800.0, ..clean() };
    antennas.frame(time, &Pose::default(), [500.0, 0.0, 0.0], &mut Random::new(2, 1))
}

#[test]
fn a_channel_sampled_later_is_further_in_phase() {
    let plain = heard(Impairments::default(), Instant(0)).codes.each_ref().map(|row| phasor(row, 37.0).0);
    let skew_s = [0.0, 3e-6, 0.0, -5e-6];
    let skewed = heard(Impairments { skew_s, ..Impairments::default() }, Instant(0));
    for (channel, row) in skewed.codes.iter().enumerate() {
        let expected = TAU * 14_800.0 * skew_s[channel];
        assert!((ahead(phasor(row, 37.0).0, plain[channel]) - expected).abs() < 2e-3, "channel {channel}");
    }
}

#[test]
fn dead_and_stuck_channels_say_nothing_and_the_others_are_as_before() {
    let plain = heard(Impairments::default(), Instant(0));
    let faults = [Fault::None, Fault::Dead, Fault::Stuck(-77), Fault::None];
    let broken = heard(Impairments { faults, ..Impairments::default() }, Instant(0));
    assert_eq!(broken.codes, [plain.codes[0], [0; 256], [-77; 256], plain.codes[3]]);
}

#[test]
fn an_interferer_comes_from_its_own_direction_at_its_own_level() {
    // From the right at bin 45, 6 dB down: the right pair leads, the front pair does not.
    let interferer = Interferer { tone_hz: 18_000.0, azimuth_ned_rad: TAU / 4.0, elevation_rad: 0.5, level_db: -6.0 };
    let frame = heard(Impairments { interferers: vec![interferer], ..Impairments::default() }, Instant(0));
    let [front_right, front_left, back_left, _] = frame.codes.each_ref().map(|row| phasor(row, 45.0));
    assert!((front_right.1 / 800.0 - 0.501).abs() < 2e-3, "{}", front_right.1 / 800.0);
    assert!((ahead(front_right.0, front_left.0) - TAU * 0.40 * 0.5_f64.cos()).abs() < 5e-3);
    assert!(ahead(front_left.0, back_left.0).abs() < 5e-3);
}

#[test]
fn a_reflection_adds_the_image_with_the_phase_of_its_distance() {
    // The image stands half a wavelength, then a whole one, behind the source: it weakens, then strengthens.
    for (wavelengths, expected) in [(0.5, 0.5), (1.0, 1.5)] {
        let image_ned_m = [500.0 + wavelengths * 0.345, 0.0, 0.0];
        let reflections = vec![Reflection { image_ned_m, level_db: -6.0206 }];
        let frame = heard(Impairments { reflections, ..Impairments::default() }, Instant(0));
        for row in &frame.codes {
            assert!((phasor(row, 37.0).1 / 800.0 - expected).abs() < 2e-3, "{}", phasor(row, 37.0).1 / 800.0);
        }
    }
}

#[test]
fn pulses_sound_for_their_length_once_a_period() {
    // 20 ms every second, the first at 0.3 s: a frame of 2.5 ms at 310 ms is full, one at 320 ms half, others empty.
    let pulses = Some(Pulses { period_s: 1.0, length_s: 0.020, start_s: 0.3 });
    let sounding = |time_us: u64| {
        let frame = heard(Impairments { pulses, ..Impairments::default() }, Instant(time_us));
        frame.codes[0].iter().filter(|code| **code != 0).count()
    };
    assert!(sounding(310_000) > 250 && sounding(7_310_000) > 250);
    assert!((120..=130).contains(&sounding(320_000)), "{}", sounding(320_000));
    assert_eq!((sounding(298_000), sounding(322_000), sounding(900_000)), (0, 0, 0));
}

#[test]
fn the_frequency_drifts_with_time_and_within_the_frame() {
    // One bin is 400 Hz: at 10 s and 40 Hz/s the tone stands on bin 38.
    let drifting = Impairments { drift_hz_per_s: 40.0, ..Impairments::default() };
    let frame = heard(drifting, Instant(10_000_000));
    assert!((phasor(&frame.codes[0], 38.0).1 / 800.0 - 1.0).abs() < 2e-3);
    // A chirp of one bin in the frame, sample by sample; the same seed starts both frames with the same phase.
    let steady = heard(Impairments::default(), Instant(0));
    let chirped = heard(Impairments { drift_hz_per_s: 160_000.0, ..Impairments::default() }, Instant(0));
    let (phase, amplitude) = phasor(&steady.codes[0], 37.0);
    for (n, code) in chirped.codes[0].iter().enumerate() {
        let t = (n as f64 - 127.5) / 102_400.0;
        let expected = amplitude * (phase + TAU * (14_800.0 * t + 80_000.0 * t * t)).cos();
        assert!((f64::from(*code) - expected).abs() < 1.0, "sample {n}: {code} {expected}");
    }
}

#[test]
fn coloured_noise_keeps_its_power_and_is_correlated() {
    for noise_correlation in [-0.5, 0.0, 0.8] {
        let impairments = Impairments { noise_correlation, ..Impairments::default() };
        let antennas = Antennas { snr_db: Some(0.0), channel_gain: [0.0; 4], impairments, ..Antennas::default() };
        let (mut power, mut product, mut random) = (0.0, 0.0, Random::new(7, 1));
        for _ in 0..100 {
            let frame = antennas.frame::<256>(Instant(0), &Pose::default(), [9.0, 0.0, 0.0], &mut random);
            for pair in frame.codes.iter().flat_map(|row| row.windows(2)) {
                power += f64::from(pair[0]) * f64::from(pair[0]);
                product += f64::from(pair[0]) * f64::from(pair[1]);
            }
        }
        assert!((product / power - noise_correlation).abs() < 0.02, "{} {noise_correlation}", product / power);
        let gain = 2047.0 / (1500.0 + 4.0 * 1500.0 / 2.0_f64.sqrt());
        let expected = 102_000.0 * (gain * 1500.0).powi(2) / 2.0;
        assert!((power / expected - 1.0).abs() < 0.05, "{}", power / expected);
    }
}
