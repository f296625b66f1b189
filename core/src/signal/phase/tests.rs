use super::scene::{Scene, arg, assert_finite, bins_of, extractor, open_config, reference_fit, rms, vec, wrapped};
use super::*;
use crate::base::rng::Rng;
use crate::base::units::sin_cos;
use std::f64::consts::TAU;
use std::vec::Vec;

#[test]
fn the_phasor_is_the_least_squares_fit_at_the_reported_frequency() {
    fn check<const N: usize>() {
        let mut rng = Rng::new(11, N as u64);
        for bins in [4.3, 7.77, N as f64 / 8.0 + 0.4, N as f64 / 2.0 - 5.3] {
            let scene = Scene::new(bins, 1100.0, 0.0).with_random_phases(&mut rng);
            let frame = scene.frame::<N>(&mut rng);
            let phasors = extractor::<N>().step(&mut State::default(), &frame);
            for (z, row) in phasors.z.iter().zip(&frame.codes) {
                let (re, im) = reference_fit(row, bins_of::<N>(&phasors));
                let off = (re - f64::from(z.re)).hypot(im - f64::from(z.im));
                // The reference is within 1/2048 bin of the reported frequency, and has a mean for each half.
                assert!(off < 0.5, "N {N} bins {bins}: {off} codes of 1100");
            }
        }
    }
    check::<64>();
    check::<128>();
    check::<256>();
    check::<512>();
    check::<1024>();
}

#[test]
fn a_clean_tone_is_as_good_as_its_twelve_bits() {
    // Degrees, as in the project's budget: 0.005 at an amplitude of 1 500, 0.065 at 60.
    for (amplitude, bound) in [(1500.0, 0.005), (60.0, 0.065)] {
        let mut rng = Rng::new(5, 0);
        let mut errors = Vec::new();
        for k in 0..60 {
            let scene = Scene::new(20.0 + f64::from(k % 3) * 9.0, amplitude, 0.0).with_random_phases(&mut rng);
            let phasors = extractor::<256>().step(&mut State::default(), &scene.frame(&mut rng));
            errors.extend(scene.errors(&phasors));
        }
        assert!(rms(&errors).to_degrees() < bound, "{}", rms(&errors).to_degrees());
    }
}

#[test]
fn blind_single_frames_reach_the_cramer_rao_bound_and_predict_their_errors() {
    for &backend in Backend::ALL {
        let extractor = Config { backend, ..open_config() }.build::<256>().unwrap();
        for bins in [4.5, 20.5, 37.0, 60.25] {
            for snr_db in [0.0, 10.0, 20.0, 40.0] {
                let scene = Scene::at_snr(bins, snr_db);
                let mut rng = Rng::new(3, 1);
                let (mut fresh, mut tracked, mut normalised, mut frequency) = (vec(), vec(), vec(), vec());
                let mut state = State::default();
                let mut snr = 0.0;
                for _ in 0..400 {
                    let scene = scene.with_random_phases(&mut rng);
                    let frame = scene.frame::<256>(&mut rng);
                    let phasors = extractor.step(&mut State::default(), &frame);
                    assert_eq!(phasors.tone, Tone::Present, "{bins} {snr_db}");
                    assert!(!phasors.interferer && !phasors.clipped);
                    frequency.push(bins_of::<256>(&phasors) - bins);
                    snr += f64::from(phasors.snr_db) / 400.0;
                    let errors = scene.errors(&phasors);
                    fresh.extend(errors);
                    let variance =
                        phasors.z.iter().zip(phasors.noise).map(|(z, v)| f64::from(v / (2.0 * z.norm_squared())));
                    let variance: Vec<_> = variance.collect();
                    normalised.extend(errors.iter().zip(1..).map(|(e, m)| e / (variance[0] + variance[m]).sqrt()));
                    let phasors = extractor.step(&mut state, &frame);
                    assert_eq!(phasors.tone, Tone::Present, "{bins} {snr_db}");
                    tracked.extend(scene.errors(&phasors));
                }
                let what = std::format!("{backend:?} {bins} bins {snr_db} dB");
                let bound = scene.bound::<256>();
                let allowed = if bins < 5.0 { 1.35 } else { 1.10 };
                assert!(rms(&fresh) < allowed * bound, "{what}: {}", rms(&fresh) / bound);
                assert!(rms(&tracked) < allowed * bound, "{what}: {} tracked", rms(&tracked) / bound);
                let honesty = rms(&normalised).powi(2);
                assert!((0.85..1.2).contains(&honesty), "{what}: {honesty}");
                assert!((snr - snr_db).abs() < 0.5, "{what}: {snr}");
                // 0.024 bins at 0 dB, where the bound is 0.022 (four channels) over sqrt(3/4).
                let frequency_bound = 0.027 / 10_f64.powf(snr_db / 20.0);
                assert!(rms(&frequency) < frequency_bound, "{what}: {}", rms(&frequency));
            }
        }
    }
}

#[test]
fn noise_alone_raises_no_alarm_and_a_tone_at_minus_9_db_is_found() {
    let extractor = extractor::<256>();
    let mut rng = Rng::new(21, 0);
    let mut state = State::default();
    for k in 0..4000 {
        if k % 2 == 0 {
            state.reset();
        }
        let phasors = extractor.step(&mut state, &Scene::silence(100.0).frame(&mut rng));
        assert_eq!(phasors.tone, Tone::Absent, "frame {k}: {phasors:?}");
        assert_finite(&phasors);
    }
    let mut missed = 0;
    for _ in 0..2000 {
        let bins = 5.0 + 118.0 * f64::from(rng.uniform());
        let scene = Scene::at_snr(bins, -9.0).with_random_phases(&mut rng);
        let phasors = extractor.step(&mut State::default(), &scene.frame(&mut rng));
        let found = phasors.tone == Tone::Present && (bins_of::<256>(&phasors) - bins).abs() < 0.5;
        missed += usize::from(!found);
    }
    assert!(missed < 20, "{missed} of 2000 missed");
}

/// Mean squared error of the phase differences over what the noise of the phasors predicts, once the noise has been heard for a while.
fn honesty(extractor: &Extractor<256>, scene: Scene, rng: &mut Rng) -> f64 {
    let (mut normalised, mut state) = (vec(), State::default());
    for k in 0..600 {
        let scene = scene.with_random_phases(rng);
        let phasors = extractor.step(&mut state, &scene.frame(rng));
        assert_eq!(phasors.tone, Tone::Present);
        if k < 200 {
            continue;
        }
        let variance = |m: usize| f64::from(phasors.noise[m] / (2.0 * phasors.z[m].norm_squared()));
        normalised.extend(scene.errors(&phasors).iter().zip(1..).map(|(e, m)| e / (variance(m) + variance(0)).sqrt()));
    }
    rms(&normalised).powi(2)
}

/// Frames of noise alone, of a thousand, in which a receiver that has just been switched on hears a tone.
fn alarms<const N: usize>(colour: fn(f64) -> f64) -> usize {
    let mut rng = Rng::new(23, 0);
    let scene = Scene { colour: Some(colour), ..Scene::silence(100.0) };
    let extractor = Config::default().build::<N>().unwrap();
    (0..1000).filter(|_| extractor.step(&mut State::default(), &scene.frame(&mut rng)).tone == Tone::Present).count()
}

/// Noise behind a filter, and the converter's own at a tenth of it or less.
#[test]
fn noise_behind_a_filter_is_no_tone_and_is_as_loud_as_it_is_beside_the_tone() {
    let butterworth = |hz: f64| 0.1 + 1.0 / (1.0 + (hz / 30e3).powi(8));
    let steep = |hz: f64| 0.01 + if (10e3..20e3).contains(&hz) { 1.0 } else { 0.0 };
    let low = |hz: f64| 0.03 + if hz < 4.8e3 { 1.0 } else { 0.0 };
    let resonance = |hz: f64| 0.1 + 1.0 / (1.0 + (3.0 * (hz / 16.4e3 - 16.4e3 / hz.max(1.0))).powi(2));
    // The filter, how many of 1000 frames of noise may be taken for a tone, and the honesty of a tone in it. The lowest bins have
    // no noise below them, and a resonance is too narrow to be told from its sides.
    let filters = [
        (butterworth as fn(f64) -> f64, 3, 0.6..1.3),
        (steep, 3, 0.6..1.3),
        (low, 60, 0.6..1.3),
        (resonance, 10, 0.4..2.0),
    ];
    for (kind, (colour, allowed, range)) in filters.into_iter().enumerate() {
        let heard = alarms::<256>(colour);
        assert!(heard <= allowed, "filter {kind}: {heard} of 1000 frames of noise");
        let heard = alarms::<1024>(colour);
        assert!(heard <= 3, "filter {kind}: {heard} of 1000 longer frames of noise");
        let extractor = Config::default().build::<256>().unwrap();
        let mut rng = Rng::new(23, 1);
        for (bins, amplitude) in
            [(41.0, 300.0), (38.4, 1200.0), (30.3, 300.0), (80.3, 300.0), (7.4, 1200.0), (25.5, 600.0)]
        {
            let scene = Scene { colour: Some(colour), bins, amplitude: [amplitude; CHANNELS], ..Scene::silence(100.0) };
            let honesty = honesty(&extractor, scene, &mut rng);
            assert!(range.contains(&honesty), "filter {kind}, {amplitude} at {bins}: {honesty}");
        }
    }
}

/// A tone whose frequency is known is heard beside a line that is 30 dB stronger.
#[test]
fn beside_a_much_stronger_line_a_known_tone_is_heard() {
    let extractor = Config { tone_hz: Some(37.4 * 400.0), ..open_config() }.build::<256>().unwrap();
    let mut rng = Rng::new(25, 0);
    let scene = Scene { other: [45.4, 950.0, 0.0], ..Scene::new(37.4, 30.0, 21.0) };
    let heard = |rng: &mut Rng| {
        let scene = scene.with_random_phases(rng);
        extractor.step(&mut State::default(), &scene.frame(rng)).tone == Tone::Present
    };
    assert_eq!((0..100).filter(|_| heard(&mut rng)).count(), 100);
}

/// A line that is too weak for the window is in the noise of the fit, as if it were noise.
#[test]
fn a_weak_line_beside_the_tone_is_in_its_noise() {
    let mut rng = Rng::new(24, 0);
    let extractor = extractor::<256>();
    for away in [4.5, 6.5, 10.5, 30.5] {
        for below_db in [11.0, 15.0, 20.0, 30.0] {
            let scene = Scene::new(37.4, 1000.0, 22.0);
            let other = [37.4 + away, scene.amplitude[0] * 10_f64.powf(-below_db / 20.0), 0.0];
            let honesty = honesty(&extractor, Scene { other, ..scene }, &mut rng);
            assert!((0.35..1.4).contains(&honesty), "{away} bins away, {below_db} dB below: {honesty}");
        }
    }
}

#[test]
fn the_noise_is_that_of_each_channel() {
    fn check<const N: usize>() {
        let extractor = extractor::<N>();
        let mut rng = Rng::new(8, 8);
        for sigma in [1.0, 30.0, 300.0] {
            let mut mean = [0.0; CHANNELS];
            for _ in 0..200 {
                let mut frame = Scene::silence(sigma).frame::<N>(&mut rng);
                frame.codes[2] = [-7; N];
                let phasors = extractor.step(&mut State::default(), &frame);
                for (mean, noise) in mean.iter_mut().zip(phasors.noise) {
                    *mean += f64::from(noise) / 200.0;
                }
            }
            let expected = 4.0 * (sigma * sigma + 1.0 / 12.0) / N as f64;
            for channel in [0, 1, 3] {
                let ratio = mean[channel] / expected;
                assert!((0.93..1.08).contains(&ratio), "N {N} sigma {sigma}: {ratio}");
            }
            // The transform's rounding beside a loud neighbour.
            let stuck = mean[2] / (4.0 / 12.0 / N as f64);
            assert!((0.999..1.001 + 1e-3 * sigma * sigma).contains(&stuck), "N {N} sigma {sigma}: {stuck}");
        }
    }
    check::<64>();
    check::<256>();
    check::<1024>();
}

#[test]
fn an_offset_of_a_third_of_full_scale_changes_nothing() {
    for bins in [4.5, 20.5, 37.0] {
        let mut rng = Rng::new(3, 1);
        let (mut errors, mut scene) = (vec(), Scene::at_snr(bins, 20.0));
        scene.amplitude = [1000.0; CHANNELS];
        scene.sigma = 70.0;
        scene.dc = [614.0, -614.0, 0.0, 300.0];
        for _ in 0..300 {
            let scene = scene.with_random_phases(&mut rng);
            let phasors = extractor::<256>().step(&mut State::default(), &scene.frame(&mut rng));
            assert_eq!(phasors.tone, Tone::Present);
            errors.extend(scene.errors(&phasors));
        }
        let allowed = if bins < 5.0 { 1.35 } else { 1.10 };
        assert!(rms(&errors) < allowed * scene.bound::<256>(), "{bins}: {}", rms(&errors) / scene.bound::<256>());
    }
}

#[test]
fn a_dead_channel_leaves_the_others_alone() {
    let mut rng = Rng::new(4, 1);
    let scene = Scene::at_snr(33.3, 10.0);
    for dead in 0..CHANNELS {
        for value in [0, 1234, -2048] {
            let mut frame = scene.frame::<256>(&mut rng);
            frame.codes[dead] = [value; 256];
            let phasors = extractor::<256>().step(&mut State::default(), &frame);
            assert_eq!(phasors.tone, Tone::Present);
            assert!((bins_of::<256>(&phasors) - 33.3).abs() < 0.05);
            assert!(phasors.z[dead].norm_squared() < 1e-3, "{:?}", phasors.z[dead]);
            assert_eq!(phasors.clipped, value == -2048);
            for alive in (0..CHANNELS).filter(|m| *m != dead) {
                assert!(wrapped(arg(phasors.z[alive]) - scene.phases[alive]).abs() < 0.2);
                assert!((f64::from(phasors.z[alive].norm_squared()).sqrt() / scene.amplitude[0] - 1.0).abs() < 0.15);
            }
        }
    }
}

#[test]
fn a_drifting_tone_is_followed_and_a_jump_is_found_in_the_same_frame() {
    let extractor = extractor::<256>();
    for (snr_db, drift) in [(0.0, 0.002), (20.0, 0.002), (20.0, 0.05), (40.0, 0.3)] {
        let mut rng = Rng::new(6, 1);
        let mut state = State::default();
        let (mut errors, mut frequency, mut bins) = (vec(), vec(), 30.0);
        let mut bound = 0.0;
        for _ in 0..200 {
            bins += drift;
            let scene = Scene::at_snr(bins, snr_db).with_random_phases(&mut rng);
            let phasors = extractor.step(&mut state, &scene.frame(&mut rng));
            assert_eq!(phasors.tone, Tone::Present);
            errors.extend(scene.errors(&phasors));
            frequency.push(bins_of::<256>(&phasors) - bins);
            bound = scene.bound::<256>();
        }
        assert!(rms(&errors) < 1.12 * bound, "{snr_db} dB {drift}: {}", rms(&errors) / bound);
        assert!(rms(&frequency) < 0.03, "{snr_db} dB {drift}: {}", rms(&frequency));
    }
    // Hops anywhere in the band, also onto the sidelobes of the old frequency.
    let mut rng = Rng::new(6, 2);
    let mut state = State::default();
    for _ in 0..500 {
        let bins = 5.0 + 118.0 * f64::from(rng.uniform());
        let scene = Scene::at_snr(bins, 30.0).with_random_phases(&mut rng);
        let phasors = extractor.step(&mut state, &scene.frame(&mut rng));
        assert_eq!(phasors.tone, Tone::Present);
        assert!((bins_of::<256>(&phasors) - bins).abs() < 0.01, "{bins}: {}", bins_of::<256>(&phasors));
        assert!(scene.errors(&phasors).iter().all(|error| error.abs() < 6.0 * scene.bound::<256>()));
    }
}

#[test]
fn a_tone_that_comes_back_is_found_again() {
    let extractor = extractor::<256>();
    let mut rng = Rng::new(9, 1);
    let mut state = State::default();
    let scene = Scene::new(41.7, 300.0, 100.0);
    assert_eq!(extractor.step(&mut state, &scene.frame(&mut rng)).tone, Tone::Present);
    for _ in 0..20 {
        let phasors = extractor.step(&mut state, &Scene::silence(100.0).frame(&mut rng));
        assert_eq!(phasors.tone, Tone::Absent);
        assert!((bins_of::<256>(&phasors) - 41.7).abs() < 0.1, "the tracked frequency is kept");
        assert_eq!(phasors.z, [Complex::default(); CHANNELS]);
    }
    let phasors = extractor.step(&mut state, &scene.frame(&mut rng));
    assert_eq!(phasors.tone, Tone::Present);
    assert!((bins_of::<256>(&phasors) - 41.7).abs() < 0.05);
}

#[test]
fn a_known_tone_is_found_within_one_bin_and_nothing_else_is() {
    let mut rng = Rng::new(12, 1);
    for offset in [-0.9, -0.4, 0.0, 0.6, 0.95] {
        let config = Config { tone_hz: Some(50.0 * 400.0), ..open_config() };
        let extractor = config.build::<256>().unwrap();
        let mut scene = Scene::at_snr(50.0 + offset, 10.0);
        scene.amplitude = [500.0; CHANNELS];
        scene.sigma = 100.0;
        // A line four times as strong elsewhere.
        scene.other = [90.5, 1000.0, 0.0];
        let phasors = extractor.step(&mut State::default(), &scene.frame(&mut rng));
        assert_eq!(phasors.tone, Tone::Present);
        assert!(phasors.interferer);
        assert!((bins_of::<256>(&phasors) - 50.0 - offset).abs() < 0.1, "{offset}: {}", bins_of::<256>(&phasors));
        scene.amplitude = [0.0; CHANNELS];
        let phasors = extractor.step(&mut State::default(), &scene.frame(&mut rng));
        assert_eq!(phasors.tone, Tone::Absent, "{offset}");
    }
}

#[test]
fn another_line_is_flagged_and_kept_out_by_the_window() {
    let config = Config { tone_band_hz: [30.0 * 400.0, 45.0 * 400.0], ..open_config() };
    let extractor = config.build::<256>().unwrap();
    // Line relative to the tone in dB, its bin, the flag.
    for (line_db, bin, flagged) in [(-20.0, 50.5, false), (0.0, 41.0, true), (10.0, 50.5, true), (10.0, 25.7, true)] {
        let mut rng = Rng::new(14, 1);
        let mut scene = Scene::new(37.4, 300.0, 21.2);
        scene.other = [bin, 300.0 * 10_f64.powf(line_db / 20.0), 0.0];
        let band = if bin > 30.0 && bin < 45.0 { [36.0 * 400.0, 38.9 * 400.0] } else { config.tone_band_hz };
        let extractor = if band == config.tone_band_hz {
            extractor.clone()
        } else {
            Config { tone_band_hz: band, ..config }.build().unwrap()
        };
        let (mut state, mut errors, mut normalised) = (State::default(), vec(), vec());
        for _ in 0..300 {
            let scene = scene.with_random_phases(&mut rng);
            let phasors = extractor.step(&mut state, &scene.frame(&mut rng));
            assert_eq!(phasors.tone, Tone::Present, "{line_db} dB at {bin}");
            assert_eq!(phasors.interferer, flagged, "{line_db} dB at {bin}");
            let new = scene.errors(&phasors);
            errors.extend(new);
            let variance = |m: usize| f64::from(phasors.noise[m] / (2.0 * phasors.z[m].norm_squared()));
            normalised.extend(new.iter().zip(1..).map(|(e, m)| e / (variance(m) + variance(0)).sqrt()));
        }
        if flagged {
            let ratio = rms(&errors) / scene.bound::<256>();
            assert!(ratio < 1.6, "{line_db} dB at {bin}: {ratio}");
            let honesty = rms(&normalised).powi(2);
            assert!((0.7..1.6).contains(&honesty), "{line_db} dB at {bin}: {honesty}");
        }
    }
}

#[test]
fn what_another_line_leaks_into_a_phasor_is_in_its_noise() {
    let extractor = Config { tone_band_hz: [35.0 * 400.0, 40.0 * 400.0], ..open_config() }.build::<256>().unwrap();
    // A tone without noise, so that everything but the rounding is leakage.
    for away in [6.0, 6.25, 6.5, -6.5, 8.0, -8.0, 8.5, -8.5, 10.5, 20.0, -20.0, -20.5] {
        let mut rng = Rng::new(22, 1);
        let (mut errors, mut predicted, mut state) = (vec(), 0.0, State::default());
        for _ in 0..300 {
            let mut scene = Scene::new(37.3, 300.0, 0.0).with_random_phases(&mut rng);
            scene.other = [37.3 + away, 300.0 * 10_f64.sqrt(), scene.other[2]];
            let phasors = extractor.step(&mut state, &scene.frame(&mut rng));
            assert!(phasors.interferer && phasors.tone == Tone::Present, "{away}");
            for (m, phase) in scene.phases.iter().enumerate() {
                errors.push(wrapped(arg(phasors.z[m]) - phase));
                predicted += f64::from(phasors.noise[m] / (2.0 * phasors.z[m].norm_squared())) / 1200.0;
            }
        }
        let honesty = rms(&errors).powi(2) / predicted;
        assert!((0.4..2.0).contains(&honesty), "{away} bins: {honesty}, {} deg", rms(&errors).to_degrees());
        assert!(rms(&errors).to_degrees() < 0.25, "{away} bins: {} deg", rms(&errors).to_degrees());
    }
}

#[test]
fn a_channel_sampled_later_is_turned_back() {
    let mut rng = Rng::new(15, 1);
    let skew_s = [0.0, 2e-6, -3e-6, 7e-6];
    let mut scene = Scene::at_snr(52.3, 30.0);
    let truth = scene.phases;
    let frequency_hz = 52.3 * 400.0;
    // Channel m samples cos(w t + phase) at t + skew.
    for (phase, skew) in scene.phases.iter_mut().zip(skew_s) {
        *phase += TAU * frequency_hz * f64::from(skew);
    }
    let extractor = Config { skew_s, ..open_config() }.build::<256>().unwrap();
    let phasors = extractor.step(&mut State::default(), &scene.frame(&mut rng));
    scene.phases = truth;
    assert!(scene.errors(&phasors).iter().all(|error| error.abs() < 6.0 * scene.bound::<256>()));
}

#[test]
fn more_than_one_sample_in_a_hundred_at_a_rail_is_clipping() {
    let mut rng = Rng::new(16, 1);
    let frame = Scene::new(20.0, 1500.0, 10.0).frame::<256>(&mut rng);
    let clipped = |rails: usize| {
        let mut frame = frame.clone();
        for (code, rail) in frame.codes[1].iter_mut().zip([2047, -2048].iter().cycle()).take(rails) {
            *code = *rail;
        }
        extractor::<256>().step(&mut State::default(), &frame).clipped
    };
    assert!(!clipped(0) && !clipped(2) && clipped(3));
}

#[test]
fn whatever_comes_in_finite_numbers_come_out() {
    fn check<const N: usize>(backend: Backend) {
        let extractor = Config { backend, ..open_config() }.build::<N>().unwrap();
        let mut rng = Rng::new(17, N as u64);
        let mut state = State::default();
        let silent = extractor.step(&mut state, &AdcFrame::zeroed());
        assert_eq!(silent.tone, Tone::Absent);
        assert_finite(&silent);
        for k in 0..120_usize {
            let mut frame = Scene::new(2.0 + k as f64 / 5.0, 1500.0, 30.0).frame::<N>(&mut rng);
            for (m, row) in frame.codes.iter_mut().enumerate() {
                for (n, code) in row.iter_mut().enumerate() {
                    let random = (rng.uniform() * 65_536.0) as i32 as i16;
                    match (k + m) % 8 {
                        0 => *code = random,
                        1 => *code = random >> 4,
                        2 => *code = if n % (k + 2) < k / 2 { 2047 } else { -2048 },
                        3 => *code = if n % 2 == 0 { i16::MIN } else { i16::MAX },
                        4 => *code = 0,
                        5 => *code = i16::from(n == k),
                        _ => (),
                    }
                }
            }
            assert_finite(&extractor.step(&mut state, &frame));
            assert_finite(&extractor.step(&mut State::default(), &frame));
        }
    }
    for &backend in Backend::ALL {
        check::<64>(backend);
        check::<128>(backend);
        check::<256>(backend);
        check::<512>(backend);
        check::<1024>(backend);
    }
}

#[test]
fn the_state_is_small() {
    assert!(size_of::<State<256>>() < 4096, "{}", size_of::<State<256>>());
    assert!(size_of::<State<1024>>() < 16 * 1024, "{}", size_of::<State<1024>>());
}

#[test]
fn configurations_are_checked_and_named() {
    let refused = |config: Config| config.build::<256>().unwrap_err().field;
    let good = Config::default();
    assert!(good.build::<64>().is_ok() && good.build::<1024>().is_ok());
    assert_eq!(refused(Config { sample_rate_hz: f32::NAN, ..good }), "phase.sample_rate_hz");
    assert_eq!(refused(Config { sample_rate_hz: 0.0, ..good }), "phase.sample_rate_hz");
    assert_eq!(refused(Config { tone_band_hz: [-1.0, 1e4], ..good }), "phase.tone_band_hz");
    assert_eq!(refused(Config { tone_band_hz: [1e4, 1e3], ..good }), "phase.tone_band_hz");
    assert_eq!(refused(Config { tone_band_hz: [0.0, 800.0], ..good }), "phase.tone_band_hz");
    assert_eq!(refused(Config { tone_band_hz: [1e3, 6e4], ..good }), "phase.tone_band_hz");
    assert_eq!(refused(Config { tone_hz: Some(500.0), ..good }), "phase.tone_hz");
    assert_eq!(refused(Config { tone_hz: Some(f32::INFINITY), ..good }), "phase.tone_hz");
    assert_eq!(refused(Config { skew_s: [0.0, 0.0, 1.0, 0.0], ..good }), "phase.skew_s");
}

#[test]
fn a_line_outside_the_band_and_the_slope_that_leads_to_it_are_no_tone() {
    let mut random = Rng::new(77, 0);
    for (bins, is_heard) in [(20.0, true), (23.6, true), (24.6, false), (26.0, false), (15.4, false)] {
        let rate_hz = Config::default().sample_rate_hz;
        let band_hz = [16.0 * rate_hz / 256.0, 24.0 * rate_hz / 256.0];
        let extractor = Config { tone_band_hz: band_hz, ..Config::default() }.build::<256>().unwrap();
        // Another line far away forces an acquisition in every frame.
        for other in [0.0, 300.0] {
            let mut frame = AdcFrame::<256>::zeroed();
            for row in &mut frame.codes {
                for (n, code) in row.iter_mut().enumerate() {
                    let wave = |bins: f32| sin_cos(core::f32::consts::TAU * bins * n as f32 / 256.0).0;
                    *code = (900.0 * wave(bins) + other * wave(70.3) + 5.0 * random.gaussian()) as i16;
                }
            }
            let heard = extractor.step(&mut State::default(), &frame);
            assert_eq!(heard.tone == Tone::Present, is_heard, "{bins} {other}");
        }
    }
}
