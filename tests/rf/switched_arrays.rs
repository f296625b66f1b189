//! An array behind a switch on recorded packets: how often offsets are looked for anew, and what four of the eight antennas know.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::{BTreeMap, HashMap};
use std::f64::consts::PI;

use foxhound_core::base::time::Instant;
use foxhound_core::doa::beam::{self, Arrival, Beam};
use foxhound_core::doa::switched::{Config, Emitter, Estimator, Group};
use foxhound_core::signal::phase::Complex;
use foxhound_core::signal::switched::{self as slots, SLOTS_MAX};
use foxhound_tests::recording::{Place, places};

use crate::waves::{degrees_between, quantile};

/// The recorded places, or a note that there are none.
fn recorded() -> Option<BTreeMap<String, Place>> {
    let places = places();
    if places.is_none() {
        eprintln!("SKIPPED: there is no ../shared/data/radio: recorded packets are not heard");
    }
    places
}

const ALL: [usize; 8] = [0, 1, 2, 3, 4, 5, 6, 7];

/// Some antennas of the recorded ring, from 0 on.
fn ring(antennas: &[usize]) -> Beam {
    let radius_m = 0.0456 / 2.0 / (PI / 8.0).sin();
    let mut antennas_m = [[0.0; 2]; 8];
    for (place, antenna) in antennas_m.iter_mut().zip(antennas) {
        let (sine, cosine) = (*antenna as f64 * PI / 4.0).sin_cos();
        *place = [(radius_m * cosine) as f32, (radius_m * sine) as f32];
    }
    beam::Config { wavelength_m: 0.12287, antennas_m, count: antennas.len() }.build().unwrap()
}

/// Of these antennas; the slots of the others are not used.
fn estimator(antennas: &[usize]) -> Estimator {
    let mut pattern = [0; SLOTS_MAX];
    for (name, antenna) in (1..).zip(antennas) {
        pattern[*antenna] = name;
    }
    let count = antennas.len();
    let (sample_rate_hz, tone_hz, slot_s, pattern_slots) = (2e6, 250e3, 4e-6, 8);
    let schedule = slots::Config { antennas: count, sample_rate_hz, tone_hz, slot_s, pattern, pattern_slots };
    Config::default().build(ring(antennas), schedule.build(37, 3).unwrap()).unwrap()
}

/// Each group of packets at a place, its arrival and its true direction; returns of how many packets the offset was followed, and of how
/// many of them all offsets were tried.
fn hear(estimator: &Estimator, place: &Place, looks: usize, mut take: impl FnMut(&Group, &Arrival, f64)) -> (u32, u32) {
    let mut states: HashMap<i32, (Emitter, Group, usize)> = HashMap::new();
    let packets = place.values.chunks_exact(37 * 3).zip(&place.beacons).zip(&place.truth);
    for ((samples, beacon), truth) in packets {
        let samples: Vec<_> = samples.iter().map(|[re, im]| Complex { re: *re as f32, im: *im as f32 }).collect();
        let (emitter, group, count) = states.entry(*beacon).or_default();
        estimator.take(emitter, group, &samples);
        *count += 1;
        if *count == looks {
            take(group, &estimator.bearing(group, Instant(0)), *truth);
            (*group, *count) = (Group::default(), 0);
        }
    }
    let sum = |of: fn(&Emitter) -> u32| states.values().map(|(emitter, _, _)| of(emitter)).sum();
    (sum(Emitter::packets), sum(Emitter::searches))
}

/// What is heard at a place: each arrival and its true direction.
fn heard(estimator: &Estimator, place: &Place, looks: usize) -> Vec<(Arrival, f64)> {
    let mut arrivals = Vec::new();
    hear(estimator, place, looks, |_, arrival, truth| arrivals.push((*arrival, truth)));
    arrivals
}

/// Azimuths less the truth of the valid arrivals, and their sigma.
fn off(arrivals: &[(Arrival, f64)]) -> impl Iterator<Item = (f64, f64)> {
    let valid = arrivals.iter().filter(|(arrival, _)| arrival.bearing.valid);
    valid.map(|(Arrival { bearing, .. }, truth)| (f64::from(bearing.azimuth_rad) - truth, f64::from(bearing.sigma_rad)))
}

/// Mean direction of what the valid arrivals are off by.
fn mean_of(arrivals: &[(Arrival, f64)]) -> f64 {
    let (sine, cosine) = off(arrivals).fold((0.0, 0.0), |(s, c), (off, _)| (s + off.sin(), c + off.cos()));
    f64::atan2(sine, cosine)
}

/// The same of four antennas that the ring of eight tells its offset, and to within 25 degrees where to look.
fn told(antennas: &[usize; 4], place: &Place, looks: usize) -> Vec<f64> {
    let beam = ring(&ALL);
    let mut offs = Vec::new();
    hear(&estimator(&ALL), place, looks, |group, Arrival { bearing, .. }, truth| {
        let covariance = group.covariance();
        let power = |azimuth_rad: f32| {
            let mut wave = beam.toward(azimuth_rad);
            for (antenna, z) in wave.iter_mut().enumerate() {
                *z = if antennas.contains(&antenna) { *z } else { Complex::default() };
            }
            covariance.power(&wave)
        };
        let near = (-100..=100).map(|quarter| bearing.azimuth_rad + (0.25 * quarter as f32).to_radians());
        let best = near.max_by(|a, b| power(*a).total_cmp(&power(*b))).unwrap();
        if bearing.valid {
            offs.push(f64::from(best) - truth);
        }
    });
    offs
}

/// Nearly all recorded packets of a ring of eight are read with the offset that their transmitter had before: less than one in eight has
/// all offsets tried.
#[test]
fn offsets_of_recorded_packets_are_followed_and_rarely_looked_for() {
    let Some(places) = recorded() else { return };
    let estimator = estimator(&ALL);
    let (mut packets, mut searches) = (0, 0);
    for place in places.values() {
        let (followed, searched) = hear(&estimator, place, 1, |_, _, _| ());
        (packets, searches) = (packets + followed, searches + searched);
    }
    println!("offsets: {packets} packets, all tried for {searches}");
    assert!(packets > 5000 && 8 * searches < packets, "{searches} of {packets}");
}

/// Four of eight recorded antennas, 0.69 wavelength apart, answer seldom and honestly: what they cannot tell apart is counted and not
/// valid, and valid bearings are within their sigma. The headings of the places are those that the ring of eight finds.
#[test]
fn four_of_a_recorded_ring_answer_where_they_are_sure() {
    let Some(places) = recorded() else { return };
    let eight = estimator(&ALL);
    let headings: Vec<f64> = places.values().map(|place| mean_of(&heard(&eight, place, 1))).collect();
    println!(
        "| antennas | packets | median | 90 % | less own mean | answered | within 3 sigma | counted as ambiguous |"
    );
    for (name, antennas) in [("1, 3, 5, 7", [0, 2, 4, 6]), ("2, 4, 6, 8", [1, 3, 5, 7])] {
        let four = estimator(&antennas);
        // Median, 90 %.
        for (looks, [median, most]) in [(1, [5.0, 10.0]), (8, [4.6, 9.5])] {
            let (mut errors, mut own, mut inside, mut lines, mut counted) = (Vec::new(), Vec::new(), 0, 0, 0);
            for (place, heading) in places.values().zip(&headings) {
                let arrivals = heard(&four, place, looks);
                lines += arrivals.len();
                counted += arrivals.iter().filter(|(arrival, _)| arrival.ambiguities > 0).count();
                assert!(arrivals.iter().all(|(arrival, _)| !arrival.bearing.valid || arrival.ambiguities == 0));
                let mean = mean_of(&arrivals);
                for (off, sigma) in off(&arrivals) {
                    own.push(degrees_between(off, mean).abs());
                    let error = degrees_between(off, *heading).abs();
                    inside += usize::from(error < 3.0 * sigma.to_degrees());
                    errors.push(error);
                }
            }
            let share = |count: usize, all: usize| 100.0 * count as f64 / all as f64;
            let (half, ninety) = (quantile(&errors, 0.5), quantile(&errors, 0.9));
            println!(
                "| {name} | {looks} | {half:.2} | {ninety:.2} | {:.2}, {:.2} | {:.1} % | {:.1} % | {:.1} % |",
                quantile(&own, 0.5),
                quantile(&own, 0.9),
                share(errors.len(), lines),
                share(inside, errors.len()),
                share(counted, lines)
            );
            assert!(share(inside, errors.len()) >= 95.0, "{name}, {looks} packets: {inside} of {}", errors.len());
            let told = places.values().zip(&headings).flat_map(|(place, heading)| {
                let offs = told(&antennas, place, looks);
                offs.into_iter().map(|off| degrees_between(off, *heading).abs()).collect::<Vec<_>>()
            });
            let told: Vec<f64> = told.collect();
            println!(
                "| {name}, told by all eight | {looks} | {:.2} | {:.2} | | | | |",
                quantile(&told, 0.5),
                quantile(&told, 0.9)
            );
            // Of the other four too few are answered to ask for more.
            assert!(
                ninety <= most && (antennas[0] == 1 || half <= median),
                "{name}, {looks} packets: {half}, {ninety}"
            );
        }
    }
}
