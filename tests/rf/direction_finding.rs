//! Direction finding against the Cramer-Rao bound, and its own sigma. 360 azimuths, eight times each, N = 256, side
//! 0.40 wavelength, 12-bit samples, unless stated otherwise.
//!
//! The bound: `sigma = lambda / (2 pi s cos(el) sqrt(N SNR))`; 0.142 deg at 20 dB.

use foxhound_core::base::adc::CHANNELS;
use foxhound_core::doa::bearing::{Bearing, Flags};
use foxhound_core::signal::phase::{self, Tone};
use foxhound_tests::in_parallel;

use crate::waves::*;

/// From 0 to 40 dB the error is at the Cramer-Rao bound, on a frequency bin and between bins.
#[test]
fn from_0_to_40_db_the_error_is_at_the_bound_on_a_bin_and_off() {
    // The lowest and the half-way bins are allowed a little more.
    let bins = [(PRIME_BIN, 1.10), (37.37, 1.10), (4.5, 1.35), (20.5, 1.35), (60.25, 1.10), (113.8, 1.10)];
    let cases: Vec<_> = [0.0, 10.0, 20.0, 40.0].into_iter().flat_map(|snr_db| bins.map(|bin| (snr_db, bin))).collect();
    in_parallel(&cases, |(snr_db, (bins, times))| {
        let source = Source::new(*bins, *snr_db);
        for frames in [Frames::Alone, Frames::Consecutive] {
            let seed = (bins * 100.0 + snr_db) as u64;
            let what = format!("{snr_db} dB at bin {bins}");
            circle(&what, anywhere(), frames, seed, |azimuth, random| source.air(azimuth, random).codes())
                .assert_within(*times, source.bound_deg())
                .assert_honest();
        }
    });
}

/// No error is below the Cramer-Rao bound, so the signal model of these tests is right.
#[test]
fn no_estimate_is_better_than_physics() {
    let source = Source::new(37.37, 20.0);
    let heard = circle("20 dB", anywhere(), Frames::Alone, 1, |azimuth, random| source.air(azimuth, random).codes());
    assert!(heard.rms() > 0.93 * source.bound_deg(), "the model of this test is wrong: {}", heard.rms());
}

/// With two thirds of the samples clipped, a tone at a prime bin keeps an error of at most 0.1 degrees.
#[test]
fn with_two_thirds_of_the_samples_clipped_a_prime_bin_keeps_a_tenth_of_a_degree() {
    // |cos| > 1/2 two thirds of the time.
    let source = Source { amplitude: 2.0 * 2047.0, ..Source::new(PRIME_BIN, 30.0) };
    for frames in [Frames::Alone, Frames::Consecutive] {
        let heard = circle("clipped", anywhere(), frames, 3, |azimuth, random| {
            let codes = source.air(azimuth, random).codes();
            let clipped: u16 = codes.clip_count().iter().sum();
            assert!((620..740).contains(&clipped), "{clipped} of 1024");
            codes
        });
        assert!(heard.rms() <= 0.10, "{}", heard.rms());
        assert_eq!(heard.flagged(Flags::CLIP), 1.0);
        assert_eq!(heard.share(|bearing| bearing.valid), 1.0);
        heard.assert_honest();
    }
}

/// Where a clipped tone's harmonics are sampled as if they were the tone, near the sample rate over 3 to 10, its sigma says so. Errors there
/// are no noise but one number for each direction: 95 of 100 are within three sigma.
#[test]
fn a_clipped_tone_whose_harmonics_fold_onto_it_is_not_believed_too_well() {
    for (part, amplitude) in (3..=10).flat_map(|part| [1.3, 2.0, 8.0].map(|amplitude| (part, amplitude))) {
        for off_bins in [0.0, 0.2] {
            let bins = 256.0 / f64::from(part) + off_bins;
            let source = Source { amplitude: amplitude * 2047.0, ..Source::new(bins, 30.0) };
            for frames in [Frames::Alone, Frames::Consecutive] {
                let what = format!("clipped, {amplitude} of full scale at bin {bins:.2}");
                let seed = 10 + part as u64;
                let heard =
                    circle(&what, anywhere(), frames, seed, |azimuth, random| source.air(azimuth, random).codes());
                assert!(heard.inside_three_sigma() >= 0.95, "{}", heard.report(1.0));
                assert!(heard.nees() < 1.25, "{}", heard.report(1.0));
            }
        }
    }
}

/// Offsets of a third of full scale do not disturb a low tone.
#[test]
fn offsets_of_a_third_of_full_scale_do_not_disturb_a_low_tone() {
    let full_scale = 2048.0;
    for (snr_db, offsets) in [(20.0, [0.3, -0.3, 0.1, 0.0]), (10.0, [0.3; 4]), (30.0, [-0.3, 0.2, 0.3, -0.1])] {
        let source =
            Source { amplitude: 900.0 / (1.0 + 2.0 * (10f64).powf(-snr_db / 20.0)), ..Source::new(6.5, snr_db) };
        for frames in [Frames::Alone, Frames::Consecutive] {
            let what = format!("{snr_db} dB at bin 6.5, offsets {offsets:?}");
            circle(&what, anywhere(), frames, 4, |azimuth, random| {
                source.air(azimuth, random).with_offsets(offsets.map(|offset| offset * full_scale)).codes()
            })
            .assert_within(1.35, source.bound_deg())
            .assert_honest();
        }
    }
}

/// A dead channel is reported by its number, and the other three still give an honest bearing.
#[test]
fn each_dead_channel_is_named_and_the_other_three_go_on() {
    let source = Source::new(37.37, 20.0);
    for dead in 0..CHANNELS {
        // Cut off, stuck somewhere, stuck at a rail, and with an open input that still makes noise.
        for stuck in [Some(0), Some(-731), Some(-2048), None] {
            for frames in [Frames::Alone, Frames::Consecutive] {
                let what = format!("channel {} dead, {stuck:?}", dead + 1);
                let heard = circle(&what, anywhere(), frames, 5 + dead as u64, |azimuth, random| {
                    let mut air = source.air(azimuth, random);
                    for value in &mut air.rows[dead] {
                        *value = stuck.map_or_else(|| source.sigma() * random.normal(), f64::from);
                    }
                    air.codes()
                });
                heard.assert_within(1.6, source.bound_deg()).assert_honest();
                for channel in 0..CHANNELS {
                    let named = if channel == dead { 1.0 } else { 0.0 };
                    assert_eq!(heard.flagged(Flags::dead(channel)), named, "{what}");
                }
                assert_eq!(heard.flagged(Flags::CLIP), if stuck == Some(-2048) { 1.0 } else { 0.0 }, "{what}");
            }
        }
    }
}

/// An interferer of ten times the power, 6 to 20 bins away, leaves an error of at most 0.25 degrees.
#[test]
fn an_interferer_of_ten_times_the_power_eight_bins_away_is_kept_out() {
    let source = Source { amplitude: 400.0, ..Source::new(37.3, 20.0) };
    let band = |low: f64, high: f64| [low, high].map(|bin| (bin * BIN_HZ) as f32);
    let told = phase::Config { tone_hz: Some((37.0 * BIN_HZ) as f32), ..anywhere() };
    let in_band = phase::Config { tone_band_hz: band(33.0, 41.0), ..anywhere() };
    for (config, name) in [(told, "told"), (in_band, "band")] {
        for (away, seed) in [8.0, -8.0, 8.5, 6.0, 6.5, -12.3, 20.0].into_iter().zip(60..) {
            for frames in [Frames::Alone, Frames::Consecutive] {
                let what = format!("interferer {away} bins away, {name}");
                let heard = circle(&what, config, frames, seed, |azimuth, random| {
                    let other = Wave {
                        bins: source.bins + away,
                        amplitude: source.amplitude * 10f64.sqrt(),
                        ..source.wave(azimuth + 0.3 + 5.7 * random.uniform(), random)
                    };
                    source.air(azimuth, random).with_wave(other).codes()
                });
                let report = heard.report(source.bound_deg());
                assert!(heard.bearings.iter().all(|bearing| bearing.valid), "{report}");
                assert!(heard.rms() <= 0.25, "{report}");
                let sigma_deg = |bearing: &Bearing| f64::from(bearing.sigma_rad.to_degrees());
                let widest_deg = heard.bearings.iter().map(sigma_deg).fold(0.0, f64::max);
                assert!(widest_deg <= 0.6, "{widest_deg}: {report}");
                assert!(heard.inside_three_sigma() >= 0.95, "{report}");
                assert!(heard.flagged(Flags::INTERFERER) > 0.99, "{report}");
                // Nor is what leaks taken for a reflection.
                assert!(heard.flagged(Flags::MULTIPATH) <= 0.01, "{report}");
            }
        }
    }
}

/// What leaks from an interferer is included in sigma.
#[test]
fn what_leaks_from_an_interferer_is_in_sigma_where_noise_does_not_hide_it() {
    // At 40 dB it is up to five times the noise.
    let source = Source { amplitude: 400.0, ..Source::new(37.3, 40.0) };
    let in_band = phase::Config { tone_band_hz: [33.0, 41.0].map(|bin| (bin * BIN_HZ) as f32), ..anywhere() };
    for away in [6.0, 6.5, 8.0, -8.0, -8.5, 20.5] {
        let heard = circle(&format!("{away} bins"), in_band, Frames::Alone, 70, |azimuth, random| {
            let amplitude = source.amplitude * 10f64.sqrt();
            let other = Wave { bins: source.bins + away, amplitude, ..source.wave(random.turn(), random) };
            source.air(azimuth, random).with_wave(other).codes()
        });
        let report = heard.report(source.bound_deg());
        assert!(heard.inside_three_sigma() >= 0.99 && (0.4..1.8).contains(&heard.nees()), "{report}");
        assert!(heard.flagged(Flags::MULTIPATH) <= 0.01 && heard.rms() <= 0.1, "{report}");
    }
}

/// A reflection is flagged even beside an interferer.
#[test]
fn a_reflection_beside_an_interferer_is_flagged_all_the_same() {
    let source = Source { amplitude: 400.0, ..Source::new(37.3, 20.0) };
    let in_band = phase::Config { tone_band_hz: [33.0, 41.0].map(|bin| (bin * BIN_HZ) as f32), ..anywhere() };
    let heard = circle("-10 dB reflection and interferer", in_band, Frames::Alone, 71, |azimuth, random| {
        let amplitude = source.amplitude * 10f64.sqrt();
        let other = Wave { bins: source.bins + 8.0, amplitude, ..source.wave(random.turn(), random) };
        let echo = Wave { amplitude: 0.1 * amplitude, ..source.wave(random.turn(), random) };
        source.air(azimuth, random).with_wave(other).with_wave(echo).codes()
    });
    let report = heard.report(source.bound_deg());
    assert!(heard.flagged(Flags::MULTIPATH) >= 0.85, "{report}");
    let flagged = heard.share(|bearing| bearing.flags.contains(Flags::MULTIPATH));
    let wide = heard.share(|bearing| bearing.sigma_rad.to_degrees() >= 5.0);
    assert!(wide >= 0.95 * flagged, "{wide} of {flagged}: {report}");
}

/// At most one frame in 1000 of noise gives a bearing, and 95 % of those with a tone at -9 dB do.
#[test]
fn noise_is_never_a_bearing_and_a_tone_at_minus_9_db_is_heard() {
    for frames in [Frames::Alone, Frames::Consecutive] {
        for sigma in [1.0, 20.0, 400.0] {
            let silence = listen("noise", anywhere(), frames, 7, (0..4000).map(|_| 0.0), |_, random| {
                Air::silence().with_noise(sigma, random).codes()
            });
            assert!(silence.share(|bearing| bearing.valid) <= 0.001, "{}", silence.report(1.0));
            assert!(silence.flagged(Flags::NO_SIGNAL) >= 0.999, "{}", silence.report(1.0));
        }
        for bins in [PRIME_BIN, 37.5, 90.2] {
            let source = Source::new(bins, -9.0);
            let heard = listen("-9 dB", anywhere(), frames, 8, (0..4000).map(f64::from), |azimuth, random| {
                source.air(azimuth, random).codes()
            });
            let found = heard.bearings.iter().zip(&heard.phasors).filter(|(bearing, phasors)| {
                let away = f64::from(phasors.frequency_hz) / BIN_HZ - bins;
                bearing.valid && phasors.tone == Tone::Present && away.abs() < 0.5
            });
            let share = found.count() as f64 / 4000.0;
            assert!(share >= 0.95, "{share}: {}", heard.report(source.bound_deg()));
        }
    }
}

/// The noise after a tone gives no bearing either.
#[test]
fn the_noise_after_a_tone_is_no_bearing_either() {
    let source = Source::new(41.6, 20.0);
    let mut frame = 0;
    let heard =
        listen("a tone, then noise", anywhere(), Frames::Consecutive, 9, (0..4000).map(|_| 1.0), |azimuth, random| {
            frame += 1;
            if frame <= 40 {
                return source.air(azimuth, random).codes();
            }
            Air::silence().with_noise(source.sigma(), random).codes()
        });
    assert_eq!(heard.bearings[..40].iter().filter(|bearing| bearing.valid).count(), 40);
    assert!(heard.bearings[40..].iter().filter(|bearing| bearing.valid).count() <= 4, "{}", heard.report(1.0));
}

/// A source 30 or 60 degrees above is found at the bound, and so is its elevation.
#[test]
fn a_source_thirty_degrees_above_costs_the_cosine_and_its_elevation_is_told() {
    for degrees in [30.0_f64, 60.0] {
        let source = Source { elevation: degrees.to_radians(), ..Source::new(37.37, 20.0) };
        for frames in [Frames::Alone, Frames::Consecutive] {
            let what = format!("{degrees} deg above");
            let heard = circle(&what, anywhere(), frames, 10, |azimuth, random| source.air(azimuth, random).codes());
            heard.assert_within(1.10, source.bound_deg()).assert_honest();
            let elevations = |b: &Bearing| f64::from(b.elevation_rad).to_degrees() - degrees;
            let errors: Vec<f64> = heard.bearings.iter().map(elevations).collect();
            assert!(rms(&errors) <= 0.5, "{}", rms(&errors));
            let normalised = heard.bearings.iter().zip(&errors);
            let nees =
                normalised.map(|(b, e)| (e / f64::from(b.elevation_sigma_rad).to_degrees()).powi(2)).sum::<f64>();
            let nees = nees / errors.len() as f64;
            assert!((0.80..=1.25).contains(&nees), "elevation NEES {nees}");
        }
    }
}

/// A source exactly ahead is found as well as any other.
#[test]
fn exactly_ahead_is_as_good_as_anywhere() {
    let source = Source::new(37.37, 20.0);
    for frames in [Frames::Alone, Frames::Consecutive] {
        let heard = listen("ahead", anywhere(), frames, 11, (0..4000).map(|_| 0.0), |azimuth, random| {
            source.air(azimuth, random).codes()
        });
        heard.assert_within(1.10, source.bound_deg()).assert_honest();
        assert!(heard.worst() <= 0.7, "{}", heard.worst());
    }
}

/// A beacon that sends pulses for 2 % of the time is heard in its pulses only.
#[test]
fn a_beacon_that_pulses_one_fiftieth_of_the_time_is_heard_in_its_pulses_only() {
    // 20 ms every second: a frame of 2.5 ms. The pulse begins somewhere in a frame.
    let source = Source::new(45.3, 20.0);
    let mut random = Random::new(14);
    let (extractor, estimator) = (anywhere().build::<N>().unwrap(), estimator());
    let mut state = phase::State::default();
    let (mut errors, mut normalised, mut frequency_errors, mut edges) = (vec![], vec![], vec![], vec![]);
    let (mut full, mut heard_full, mut silent, mut wrong, mut wild_edges) = (0, 0, 0, 0, 0);
    let pulse = (0.020 * SAMPLE_RATE_HZ) as i64;
    let period = SAMPLE_RATE_HZ as i64;
    for frame in 0..8000_i64 {
        let azimuth = f64::from((frame % 360) as i32).to_radians();
        let since = (frame * N as i64 + 100) % period;
        // Samples of this frame that lie in a pulse.
        let start = if since < pulse { 0 } else { (period - since).min(N as i64) };
        let end = if since < pulse { (pulse - since).min(N as i64) } else { N as i64 };
        let samples = start as usize..end as usize;
        let wave = source.wave(azimuth, &mut random);
        let air = Air::silence().with_pulse(wave, samples.clone()).with_noise(source.sigma(), &mut random);
        let phasors = extractor.step(&mut state, &air.codes());
        let bearing = estimator.estimate(&phasors);
        let error = degrees_between(f64::from(bearing.azimuth_rad), azimuth);
        match samples.len() {
            0 => {
                silent += 1;
                wrong += usize::from(bearing.valid || !bearing.flags.contains(Flags::NO_SIGNAL));
            }
            N => {
                full += 1;
                heard_full += usize::from(bearing.valid);
                errors.push(error);
                normalised.push(error / f64::from(bearing.sigma_rad).to_degrees());
                frequency_errors.push(f64::from(phasors.frequency_hz) / BIN_HZ - source.bins);
            }
            _ if bearing.valid => {
                edges.push(error);
                wild_edges += usize::from(error.abs() > 5.0 * f64::from(bearing.sigma_rad).to_degrees());
            }
            _ => (),
        }
    }
    assert!(silent > 7700 && full > 120);
    assert_eq!(heard_full, full);
    assert!(wrong <= 7, "{wrong} of {silent} silent frames gave a bearing");
    assert!(rms(&errors) <= 1.15 * source.bound_deg(), "{}", rms(&errors));
    assert!(rms(&normalised).powi(2) < 1.5, "{}", rms(&normalised));
    assert!(rms(&frequency_errors) < 0.01, "{}", rms(&frequency_errors));
    // Pieces of a pulse are worse, and say so.
    assert_eq!(wild_edges, 0, "{edges:?}");
}

/// A carrier that drifts is followed, with the error at the bound.
#[test]
fn a_carrier_that_drifts_is_followed() {
    // Bins a frame: a hundredth is 1.6 kHz a second.
    for (snr_db, drift) in [(0.0, 0.001), (20.0, 0.001), (20.0, 0.01), (40.0, 0.01)] {
        let source = Source::new(30.0, snr_db);
        let mut bins = source.bins;
        let mut away = vec![];
        let what = format!("{snr_db} dB, {drift} bins a frame");
        let heard = circle(&what, anywhere(), Frames::Consecutive, 15, |azimuth, random| {
            bins += drift;
            away.push(bins);
            Source { bins, ..source }.air(azimuth, random).codes()
        });
        heard.assert_within(1.10, source.bound_deg()).assert_honest();
        let errors: Vec<f64> =
            heard.phasors.iter().zip(&away).map(|(p, bins)| f64::from(p.frequency_hz) / BIN_HZ - bins).collect();
        assert!(rms(&errors) < 0.03, "{what}: {}", rms(&errors));
    }
}
