//! Two emitters in one band, at settings that no constant was chosen with.

use crate::modulations::{Arriving, Sent, frame, lines};
use crate::other_radios::{Files, has, number, ring};
use crate::waves::{Random, degrees_between};

/// Frames of each setting and pair of modulations.
const COUNT: usize = 200;

/// What became of the frames of one setting.
#[derive(Default)]
struct Heard {
    flagged: usize,
    /// Valid, without a flag, and off from the stronger emitter, or the nearer of two equal ones, by more than three sigma.
    wrong: usize,
    /// The largest of those errors.
    worst_deg: f64,
}

/// Two emitters in one band, the second as strong as the first, 6 and 12 dB below, 20, 60 and 120 degrees away, in two pairs of
/// modulations: four and more channels flag 95 % of each at 15 dB, a wrong bearing without a flag is rare, and one emitter alone is not flagged. Prints the table of
/// `docs/results/radios.md`, which has three channels and weak emitters as well.
#[test]
fn two_emitters_in_one_band_are_flagged() {
    let files = Files::new();
    let mut random = Random::new(6101);
    println!("| channels | first | alone | equal | 6 dB below | 12 dB below | wrong without a flag |");
    for first_db in [15.0, 5.0] {
        for antennas in [3, 4, 5, 8] {
            let antennas_m = ring(antennas, 0.08 * antennas as f64);
            let mut hear = |below_db: f64, apart_deg: f64| {
                let mut heard = Heard::default();
                for [sent, other] in [[Sent::FmVoice, Sent::LoRa], [Sent::NoiseLike, Sent::Ofdm]] {
                    let azimuths: Vec<f64> = (0..COUNT).map(|k| 0.3 + 1.7 * k as f64).collect();
                    let apart_rad = apart_deg.to_radians();
                    let values: Vec<_> = azimuths
                        .iter()
                        .flat_map(|azimuth| {
                            let first = Arriving { sent, azimuth: *azimuth, snr_db: first_db, shift_hz: 0.0 };
                            let (azimuth, snr_db) = (azimuth + apart_rad, first_db - below_db);
                            frame(
                                &antennas_m,
                                &[first, Arriving { sent: other, azimuth, snr_db, ..first }],
                                &mut random,
                            )
                        })
                        .collect();
                    let lines = lines(&files, &antennas_m, sent.band_hz(), &values, 1).0;
                    for (line, azimuth) in lines.iter().zip(&azimuths) {
                        if has(line, "interferer") || has(line, "multipath") {
                            heard.flagged += 1;
                        } else if line["valid"] == true {
                            let off =
                                |azimuth: f64| degrees_between(number(line, "azimuth_deg").to_radians(), azimuth).abs();
                            let second = if below_db == 0.0 { off(azimuth + apart_rad) } else { f64::MAX };
                            let off_deg = off(*azimuth).min(second);
                            if off_deg > 3.0 * number(line, "sigma_deg") {
                                heard.wrong += 1;
                                heard.worst_deg = heard.worst_deg.max(off_deg);
                            }
                        }
                    }
                }
                heard
            };
            let alone = hear(f64::INFINITY, 20.0);
            let all = [0.0, 6.0, 12.0].map(|below_db| [20.0, 60.0, 120.0].map(|apart_deg| hear(below_db, apart_deg)));
            let share = |count: usize| 100.0 * count as f64 / (2 * COUNT) as f64;
            let flagged =
                all.each_ref().map(|row| row.each_ref().map(|heard| format!("{:.0}", share(heard.flagged))).join(", "));
            let wrong = share(all.iter().flatten().map(|heard| heard.wrong).sum()) / 9.0;
            let worst_deg = all.iter().flatten().map(|heard| heard.worst_deg).fold(0.0, f64::max);
            println!(
                "| {antennas} | {first_db} dB | {:.1} % | {} % | {wrong:.1} %, at most {worst_deg:.0} degrees |",
                share(alone.flagged),
                flagged.join(" % | ")
            );
            assert!(share(alone.flagged) <= 1.0, "{antennas} channels: {} of one emitter", alone.flagged);
            if antennas > 3 && first_db > 10.0 {
                assert!(all.iter().flatten().all(|heard| share(heard.flagged) >= 95.0), "{antennas}: {flagged:?}");
                assert!(wrong <= 0.5, "{antennas} channels: {wrong} % wrong without a flag");
            }
        }
    }
}
