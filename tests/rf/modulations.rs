//! Bearings of modulated signals, from the covariance over the occupied band.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::f64::consts::TAU;
use std::time::Instant;

use foxhound_sim::tools::iq::{self, Frames};
use foxhound_sim::tools::radio_array::RadioArray;
use serde_json::Value;

use crate::other_radios::{Files, bound_deg, complex64, errors, has, line, number, ring};
use crate::waves::{Random, degrees_between, rms};

/// Samples of a frame, at 1 MHz.
pub(crate) const N: usize = 256;
pub(crate) const RATE_HZ: f64 = 1e6;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Sent {
    Tone,
    /// A low-pass noise, like a voice, in the frequency.
    FmVoice,
    /// A chirp over the band, once in two thirds of a frame, beginning anywhere.
    LoRa,
    /// 16 carriers for half of the frame.
    Ofdm,
    NoiseLike,
}

const MODULATED: [Sent; 4] = [Sent::FmVoice, Sent::LoRa, Sent::Ofdm, Sent::NoiseLike];

impl Sent {
    /// Its occupied band.
    pub(crate) fn band_hz(self) -> [f64; 2] {
        match self {
            Self::Tone => [-16e3, 16e3],
            Self::FmVoice => [-90e3, 90e3],
            Self::LoRa => [-125e3, 125e3],
            Self::Ofdm => [-140e3, 140e3],
            Self::NoiseLike => [-100e3, 100e3],
        }
    }

    /// Bins of a frame in its band.
    fn bins(self) -> f64 {
        let [low_hz, high_hz] = self.band_hz();
        let bin_hz = RATE_HZ / N as f64;
        (high_hz / bin_hz).floor() - (low_hz / bin_hz).ceil() + 1.0
    }

    /// A frame of this signal, of any power.
    fn frame(self, random: &mut Random) -> Vec<[f64; 2]> {
        let at = |phase: f64| [phase.cos(), phase.sin()];
        let start = TAU * random.uniform();
        match self {
            Self::Tone => {
                let hz = 4e3 * (2.0 * random.uniform() - 1.0);
                (0..N).map(|k| at(start + TAU * hz * k as f64 / RATE_HZ)).collect()
            }
            Self::FmVoice => {
                let (mut phase, mut voice) = (start, random.normal());
                (0..N)
                    .map(|_| {
                        voice += 0.06 * (random.normal() * 3.0 - voice);
                        phase += TAU * 60e3 * voice.clamp(-1.0, 1.0) / RATE_HZ;
                        at(phase)
                    })
                    .collect()
            }
            Self::LoRa => {
                let (sweep, from) = (N as f64 / 1.5, random.uniform());
                let mut phase = start;
                (0..N)
                    .map(|k| {
                        let part = (from + k as f64 / sweep).fract();
                        phase += TAU * 240e3 * (part - 0.5) / RATE_HZ;
                        at(phase)
                    })
                    .collect()
            }
            Self::Ofdm => {
                let first = (random.uniform() * N as f64 / 2.0) as usize;
                let symbols: Vec<(f64, f64)> = (0..16)
                    .map(|c| (15.625e3 * (f64::from(c) - 7.5), TAU * 0.25 * (random.uniform() * 4.0).floor()))
                    .collect();
                (0..N)
                    .map(|k| {
                        if !(first..first + N / 2).contains(&k) {
                            return [0.0; 2];
                        }
                        let parts = symbols.iter().map(|(hz, phase)| at(phase + TAU * hz * k as f64 / RATE_HZ));
                        parts.fold([0.0; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]])
                    })
                    .collect()
            }
            Self::NoiseLike => {
                // A sum of tones at the bins of the band, each of random amplitude.
                let tones: Vec<(f64, [f64; 2])> =
                    (-25..=25).map(|bin| (f64::from(bin) / N as f64, [random.normal(), random.normal()])).collect();
                (0..N)
                    .map(|k| {
                        tones.iter().fold([0.0; 2], |sum, (turns, [a, b])| {
                            let (s, c) = (TAU * turns * k as f64).sin_cos();
                            [sum[0] + a * c - b * s, sum[1] + a * s + b * c]
                        })
                    })
                    .collect()
            }
        }
    }
}

/// An emitter: its direction, its power in the band (dB over the noise there), and its frequency shift in hertz.
#[derive(Clone, Copy)]
pub(crate) struct Arriving {
    pub(crate) sent: Sent,
    pub(crate) azimuth: f64,
    pub(crate) snr_db: f64,
    pub(crate) shift_hz: f64,
}

/// A frame of all antennas, noise of power 1.
pub(crate) fn frame(antennas_m: &[[f64; 2]], arriving: &[Arriving], random: &mut Random) -> Vec<[f64; 2]> {
    let waves: Vec<Vec<[f64; 2]>> = arriving
        .iter()
        .map(|wave| {
            let frame = wave.sent.frame(random);
            let energy: f64 = frame.iter().map(|[a, b]| a * a + b * b).sum();
            let scale = (10.0_f64.powf(wave.snr_db / 10.0) * wave.sent.bins() / energy).sqrt();
            let turned = |(k, [a, b]): (usize, &[f64; 2])| {
                let (s, c) = (TAU * wave.shift_hz * k as f64 / RATE_HZ).sin_cos();
                [scale * (a * c - b * s), scale * (a * s + b * c)]
            };
            frame.iter().enumerate().map(turned).collect()
        })
        .collect();
    let mut values = Vec::with_capacity(antennas_m.len() * N);
    for [x, y] in antennas_m {
        let turn = |wave: &Arriving| (TAU * (x * wave.azimuth.cos() + y * wave.azimuth.sin())).sin_cos();
        let turns: Vec<(f64, f64)> = arriving.iter().map(turn).collect();
        for k in 0..N {
            let mut sum = [random.normal() * 0.5_f64.sqrt(), random.normal() * 0.5_f64.sqrt()];
            for ((s, c), samples) in turns.iter().zip(&waves) {
                let [a, b] = samples[k];
                sum = [sum[0] + a * c - b * s, sum[1] + a * s + b * c];
            }
            values.push(sum);
        }
    }
    values
}

fn description(antennas_m: &[[f64; 2]], band_hz: [f64; 2]) -> String {
    format!("wavelength_m = 1.0\nantennas_m = {antennas_m:?}\nsample_rate_hz = 1e6\ntone_band_hz = {band_hz:?}\n")
}

/// The lines of frames, made by the library, and the microseconds that a frame takes.
pub(crate) fn lines(
    files: &Files,
    antennas_m: &[[f64; 2]],
    band_hz: [f64; 2],
    values: &[[f64; 2]],
    looks: usize,
) -> (Vec<Value>, f64) {
    let (antennas, path) = (antennas_m.len(), files.path("f.npy"));
    let count = values.len() / (antennas * N);
    complex64(&path, &[count, antennas, N], values);
    let array = RadioArray::parse(&description(antennas_m, band_hz)).unwrap();
    let frames = Frames::read(&path, &array).unwrap();
    let begin = Instant::now();
    let lines = iq::find(&frames, &array, looks).unwrap();
    let taken_us = begin.elapsed().as_secs_f64() * 1e6 / count as f64;
    (lines.iter().map(|line| serde_json::to_value(line).unwrap()).collect(), taken_us)
}

/// FM voice, chirps, OFDM bursts and noise-like sources heard by 2 to 8 channels in their occupied band: errors within 1.15 of the
/// Cramer-Rao bound of a Gaussian source of that band, with their own sigma, at 0 dB (four frames a bearing), 10 and 30 dB.
#[test]
fn any_modulation_is_at_the_bound_of_a_gaussian_source() {
    const COUNT: i32 = 600;
    let files = Files::new();
    let mut random = Random::new(2301);
    let mut worst = 0.0_f64;
    for sent in MODULATED {
        for antennas in 2..=8 {
            let antennas_m = if antennas == 2 { line(2, 0.45) } else { ring(antennas, 0.08 * antennas as f64) };
            for snr_db in [0.0, 10.0, 30.0] {
                // Two channels at 0 dB need more samples than one frame has in its band to tell a source from noise.
                let looks = if snr_db == 0.0 { 4 } else { 1 };
                // Two antennas look across their line, where they see.
                let azimuths: Vec<f64> = (0..COUNT)
                    .map(|k| if antennas == 2 { f64::from(k) / f64::from(COUNT) - 0.5 } else { f64::from(k) })
                    .collect();
                let values: Vec<_> = azimuths
                    .iter()
                    .flat_map(|azimuth| {
                        let wave = Arriving { sent, azimuth: *azimuth, snr_db, shift_hz: 0.0 };
                        (0..looks).flat_map(|_| frame(&antennas_m, &[wave], &mut random)).collect::<Vec<_>>()
                    })
                    .collect();
                let (mut lines, _) = lines(&files, &antennas_m, sent.band_hz(), &values, looks);
                for (group, line) in lines.iter_mut().enumerate() {
                    line["frame"] = group.into();
                }
                let what = format!("{sent:?}, {antennas} channels, {snr_db} dB");
                let off = errors(&lines, &azimuths);
                assert!(off.len() + 10 >= COUNT as usize, "{what}: {} of {COUNT} valid", off.len());
                let used: Vec<&Value> = lines.iter().filter(|line| line["valid"] == true).collect();
                let azimuth = |line: &Value| azimuths[line["frame"].as_u64().unwrap() as usize];
                let over: Vec<f64> = off
                    .iter()
                    .zip(&used)
                    .map(|(off, line)| off / bound_deg(&antennas_m, azimuth(line), snr_db, looks as f64 * sent.bins()))
                    .collect();
                let own: Vec<f64> = off.iter().zip(&used).map(|(off, line)| off / number(line, "sigma_deg")).collect();
                let (over, nees) = (rms(&over), rms(&own).powi(2));
                println!("{what}: {over:.3} of the bound, NEES {nees:.2}");
                assert!(over <= 1.15, "{what}: {over} of the bound");
                assert!((0.8..1.25).contains(&nees), "{what}: NEES {nees}");
                worst = worst.max(over);
            }
        }
    }
    println!("worst: {worst:.3}");
}

/// A second emitter of another modulation in the band is flagged; a far stronger one outside of the band given makes no bearing, alone, and
/// bends none beside a source in it. (The jumps of chirps and bursts reach into every band: they are not in this.)
#[test]
fn a_second_emitter_is_flagged_and_one_outside_of_the_band_is_not_heard() {
    let files = Files::new();
    let mut random = Random::new(2302);
    let antennas_m = ring(5, 0.4);
    let flagged = |line: &&Value| has(line, "interferer") || has(line, "multipath");
    let azimuths: Vec<f64> = (0..200).map(f64::from).collect();
    for sent in MODULATED {
        let band_hz = sent.band_hz();
        let mut heard = |second: Option<Arriving>, first_db: f64| {
            let values: Vec<_> = azimuths
                .iter()
                .flat_map(|azimuth| {
                    let first = Arriving { sent, azimuth: *azimuth, snr_db: first_db, shift_hz: 0.0 };
                    let second = second.map(|second| Arriving { azimuth: azimuth + 2.0, ..second });
                    let all: Vec<Arriving> = [Some(first), second].into_iter().flatten().collect();
                    frame(&antennas_m, &all, &mut random)
                })
                .collect();
            lines(&files, &antennas_m, band_hz, &values, 1).0
        };
        for other in MODULATED {
            let what = format!("{sent:?} beside {other:?}");
            let alone = heard(None, 15.0);
            assert!(alone.iter().filter(flagged).count() <= 6, "{what}: flagged alone");
            let inside = Arriving { sent: other, azimuth: 0.0, snr_db: 9.0, shift_hz: 0.0 };
            let both = heard(Some(inside), 15.0);
            assert!(both.iter().filter(flagged).count() >= 190, "{what}: {}", both.iter().filter(flagged).count());
        }
        for (other, snr_db) in [(Sent::Tone, 40.0), (Sent::FmVoice, 25.0), (Sent::NoiseLike, 25.0)] {
            let what = format!("{sent:?}, {other:?} outside");
            let outside = Arriving { sent: other, azimuth: 0.0, snr_db, shift_hz: 360e3 };
            let only = heard(Some(outside), -60.0);
            let valid = only.iter().filter(|line| line["valid"] == true).count();
            assert!(valid <= 2, "{what}: {valid} bearings of 200 from outside of the band");
            let beside = heard(Some(outside), 15.0);
            let off = errors(&beside, &azimuths);
            assert!(off.len() >= 190 && rms(&off) < 2.0, "{what}: {} valid, {} deg", off.len(), rms(&off));
        }
    }
}

/// A kind of reception, and 200 frames of it.
pub(crate) struct Reception {
    pub(crate) name: &'static str,
    pub(crate) antennas_m: Vec<[f64; 2]>,
    pub(crate) sent: Sent,
    pub(crate) snr_db: f64,
    pub(crate) azimuths: Vec<f64>,
    pub(crate) values: Vec<[f64; 2]>,
}

impl Reception {
    /// Errors of directions found in these frames. Of a line along the right side, the nearer of the answer and its mirror, as for our own.
    pub(crate) fn errors(&self, found: &[f64]) -> Vec<f64> {
        let off = |found: f64, azimuth: f64| degrees_between(found, azimuth).abs();
        let error = |(found, azimuth): (&f64, &f64)| match self.name.starts_with("line") {
            true => off(*found, *azimuth).min(off(TAU / 2.0 - found, *azimuth)),
            false => off(*found, *azimuth),
        };
        found.iter().zip(&self.azimuths).map(error).collect()
    }
}

/// Six kinds of reception.
pub(crate) fn six_kinds(seed: u64) -> Vec<Reception> {
    let mut random = Random::new(seed);
    [
        ("ring of 4", ring(4, 0.32), Sent::Tone, 10.0, None),
        ("ring of 5", ring(5, 0.4), Sent::FmVoice, 10.0, None),
        ("ring of 8", ring(8, 0.64), Sent::LoRa, 5.0, None),
        ("ring of 6", ring(6, 0.48), Sent::Ofdm, 20.0, None),
        ("line of 4", line(4, 0.45), Sent::NoiseLike, 10.0, None),
        ("ring of 5, a tone outside of the band", ring(5, 0.4), Sent::FmVoice, 10.0, Some(45.0)),
    ]
    .map(|(name, antennas_m, sent, snr_db, outside_db)| {
        // A line array is steered across its axis.
        let azimuths: Vec<f64> = (0..200)
            .map(|k| if name.starts_with("line") { 0.005 * f64::from(k) - 0.5 } else { f64::from(k) })
            .collect();
        let values = azimuths
            .iter()
            .flat_map(|azimuth| {
                let mut all = vec![Arriving { sent, azimuth: *azimuth, snr_db, shift_hz: 0.0 }];
                let tone = |snr_db| Arriving { sent: Sent::Tone, azimuth: azimuth + 2.0, snr_db, shift_hz: 360e3 };
                all.extend(outside_db.map(tone));
                frame(&antennas_m, &all, &mut random)
            })
            .collect();
        Reception { name, antennas_m, sent, snr_db, azimuths, values }
    })
    .into()
}
