//! Recorded frames in, bearings out: what `foxhound bearing` does.
//!
//! `looks` frames make one answer: the azimuth in the body frame of the last of them.
//!
//! - **Four looks and more** are resolved together by [`looks`](super::looks), which keeps a reflection apart from the direct path. It takes
//!   the array and the source to be level and the channels to be calibrated to one degree, and it knows no positions; the
//!   looks are meant to be a quarter of a wavelength and more apart. More than eight are resolved in equal
//!   parts, the parts averaged as below: over a longer way the beacon does not turn evenly.
//! - **Fewer**, where frames without a tone do not count, a dead channel, and the paper's estimator: the looks' bearings are carried into
//!   the world frame by the yaw of each look and averaged as unit vectors, each weighted by `1 / sigma^2`. Sigma is that of
//!   the weighted mean, widened by the square root of the reduced chi-square when the looks scatter more than their own
//!   sigmas say, as they do in reflections.

use std::f64::consts::PI;

use foxhound_core::base::adc::CHANNELS;
use foxhound_core::doa::array::Array;
use foxhound_core::doa::beam::Arrival;
use foxhound_core::doa::bearing::{self, Bearing, Estimator, Flags};
use foxhound_core::signal::phase::{self, Complex, Phasors, Tone};
use foxhound_papers::aoa::AnyBearingEstimator;
use serde::Serialize;

use super::frames::{ArrayDescription, Recording};
use super::looks::{Look, resolve};
use crate::scenario::input::InputError;
use crate::world::wrap_pi;

/// How frames become answers.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// The estimator.
    pub estimator: Estimator,
    /// Frames an answer.
    pub looks: usize,
    /// Yaw of each frame, rad; empty when the array did not turn.
    pub yaw_rad: Vec<f64>,
    /// Frames (groups of looks) are not consecutive in time: nothing is carried from one to the next.
    pub independent: bool,
}

/// One answer: a line of the output. A number that is not finite is null, as JSON has neither NaN nor infinity.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// Index of the (last) frame.
    pub frame: usize,
    /// Whether it is valid.
    pub valid: bool,
    /// Azimuth from the nose, clockwise positive.
    pub azimuth_deg: Option<f64>,
    /// Its standard deviation.
    pub sigma_deg: Option<f64>,
    /// Magnitude of the elevation.
    pub elevation_deg: Option<f64>,
    /// Its standard deviation.
    pub elevation_sigma_deg: Option<f64>,
    /// Signal-to-noise ratio per sample.
    pub snr_db: Option<f64>,
    /// Frequency of the tone.
    pub freq_hz: Option<f64>,
    /// Chi-square of the wavefront fit; `None` with a dead channel.
    pub closure_chi2: Option<f64>,
    /// Forward-backward coherence; `None` with a dead channel.
    pub coherence: Option<f64>,
    /// A hint of the range, where the wavefront is curved.
    pub range_hint_m: Option<f64>,
    /// Names of the flags.
    pub flags: Vec<&'static str>,
}

/// The answer of an array that is heard by another receiver.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ArrayLine {
    /// What every line has. Elevation, closure and range are not measured.
    #[serde(flatten)]
    pub line: Line,
    /// Which transmitter; none where they are not told apart.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub emitter: Option<i32>,
    /// The direction that antennas on a line cannot tell from this one.
    pub mirror_deg: Option<f64>,
    /// How many directions fit nearly as well; the mirror is one.
    pub ambiguities: u8,
}

impl ArrayLine {
    /// What the table has beside the line: who sent it, and where else it may come from.
    #[must_use]
    pub fn more(&self) -> String {
        let mirror = self.mirror_deg.map(|mirror_deg| format!("or {mirror_deg:.3} deg"));
        let emitter = self.emitter.map(|emitter| format!("emitter {emitter}"));
        [mirror, emitter].into_iter().flatten().collect::<Vec<_>>().join(", ")
    }

    pub(super) fn new(frame: usize, emitter: Option<i32>, arrival: &Arrival) -> Self {
        let line = Line::new(frame, &arrival.bearing);
        let mirror_deg = arrival.mirror_rad.map(|mirror_rad| f64::from(mirror_rad).to_degrees());
        Self {
            mirror_deg: mirror_deg.filter(|_| line.azimuth_deg.is_some()),
            line: Line { elevation_deg: None, elevation_sigma_deg: None, closure_chi2: None, ..line },
            emitter,
            ambiguities: arrival.ambiguities,
        }
    }
}

/// Share of the samples at the ends of the converter's range from which on they are taken for clipped, and from which on two or three
/// antennas have no bearing: clipped phases come nearer to eighths of a turn, and so few antennas do not show that they do not fit.
const CLIPPED: f64 = 0.001;
const CLIPPED_MANY: f64 = 0.01;
const CLIPPED_ANTENNAS: usize = 3;

/// Flags a bearing of which so many samples are at the ends of the converter's range.
pub(super) fn mark_clipped(bearing: &mut Bearing, clipped: usize, samples: usize, antennas: usize) {
    let share = clipped as f64 / samples.max(1) as f64;
    if share > CLIPPED {
        bearing.flags = bearing.flags.with(Flags::CLIP);
        bearing.valid &= share <= CLIPPED_MANY || antennas > CLIPPED_ANTENNAS;
    }
}

impl Line {
    fn new(frame: usize, bearing: &Bearing) -> Self {
        let has_signal = !bearing.flags.contains(Flags::NO_SIGNAL);
        // A estimator that could not solve for a direction says so with a sigma of a half turn.
        let has_direction = has_signal && f64::from(bearing.sigma_rad) < PI - 1e-3;
        let all_alive = bearing.flags.0 & (0b1111 * Flags::DEAD_1.0) == 0;
        let degrees = |angle_rad: f32| has_direction.then_some(f64::from(angle_rad).to_degrees());
        Self {
            frame,
            valid: bearing.valid,
            azimuth_deg: degrees(bearing.azimuth_rad),
            sigma_deg: degrees(bearing.sigma_rad),
            elevation_deg: degrees(bearing.elevation_rad),
            elevation_sigma_deg: degrees(bearing.elevation_sigma_rad),
            snr_db: has_signal.then_some(f64::from(bearing.quality.snr_db)),
            freq_hz: has_signal.then_some(f64::from(bearing.quality.frequency_hz)),
            closure_chi2: (has_direction && all_alive).then_some(f64::from(bearing.quality.closure_chi2)),
            coherence: bearing.quality.coherence.map(f64::from).filter(|_| has_direction),
            range_hint_m: bearing.quality.range_hint_m.map(f64::from).filter(|_| has_direction),
            flags: bearing.flags.names().collect(),
        }
    }
}

/// Most looks that are resolved together.
const TOGETHER: usize = 8;
/// Looks of which most differ by less are taken from one place: 8 deg. Recorded ones of a place scatter by 4 deg.
const STILL_RAD: f32 = 8.0 / 57.295_78;
/// What a bearing is off by where looks of one place do not fit a plane wave, rms, as recorded.
const STILL_SIGMA_RAD: f32 = 7.0 / 57.295_78;

/// Finds the bearings of a recording.
///
/// # Errors
/// A field of the array description that the core refuses, or a count of yaws that is not that of the frames.
pub fn find(recording: &Recording, description: &ArrayDescription, options: &Options) -> Result<Vec<Line>, InputError> {
    match recording.block_length {
        64 => find_in::<64>(recording, description, options),
        128 => find_in::<128>(recording, description, options),
        256 => find_in::<256>(recording, description, options),
        512 => find_in::<512>(recording, description, options),
        1024 => find_in::<1024>(recording, description, options),
        n => Err(InputError::new(format!("N = {n} samples a frame"))),
    }
}

fn find_in<const N: usize>(
    recording: &Recording,
    description: &ArrayDescription,
    options: &Options,
) -> Result<Vec<Line>, InputError> {
    let looks = options.looks.max(1);
    let extractor = description.phase.build::<N>()?;
    let config = bearing::Config { estimator: options.estimator, ..bearing::Config::default() };
    let array = description.array.build()?;
    let estimator = AnyBearingEstimator::build(&config, array)?;
    let mut state = phase::State::<N>::default();
    let resolves = (options.estimator == Estimator::CrossSpectrum).then_some(estimator.array());
    let mut group: Vec<Look> = Vec::with_capacity(looks);
    let mut lines = Vec::with_capacity(recording.frames().len() / looks);
    for (frame, snapshot) in recording.snapshots(description.phase.sample_rate_hz).enumerate() {
        if options.independent && frame % looks == 0 {
            state = phase::State::default();
        }
        let phasors = extractor.step(&mut state, &snapshot);
        let yaw_rad = wrap_pi(options.yaw_rad.get(frame).copied().unwrap_or(0.0));
        let bearing = description.deviation.apply(&estimator.estimate(&phasors));
        group.push(Look { bearing, phasors, yaw_rad });
        if group.len() == looks {
            lines.push(Line::new(frame, &answer(resolves, &group)));
            group.clear();
        }
    }
    Ok(lines)
}

/// Refuses frames that are left over where `looks` make an answer: no sample of a recording is left out.
///
/// # Errors
/// How many are left.
pub fn refuse_left(left: usize, count: usize, what: &str, looks: usize) -> Result<(), InputError> {
    if left == 0 {
        return Ok(());
    }
    if left == count {
        return Err(InputError::new(format!("{count} {what} make no group of {looks}")));
    }
    Err(InputError::new(format!("the last {left} of {count} {what} make no group of {looks}; cut them off")))
}

/// The answer of one group, resolved if there is an array for that.
fn answer(array: Option<&Array>, group: &[Look]) -> Bearing {
    let bearings = || group.iter().map(|look| (look.bearing, look.yaw_rad)).collect::<Vec<_>>();
    if is_still(group) {
        return still(&bearings());
    }
    let parts = group.chunks(group.len().div_ceil(group.len().div_ceil(TOGETHER)));
    let resolved = |part: &[Look]| Some((resolve(array?, part)?, part.last()?.yaw_rad));
    match parts.map(resolved).collect::<Option<Vec<_>>>().as_deref() {
        Some([(bearing, _)]) => *bearing,
        Some(parts) => combine(parts),
        None => combine(&bearings()),
    }
}

/// Whether the looks with a tone are all the same: the array has not turned, and what the channels hear, less what all have in
/// common, differs between the looks by less than [`STILL_RAD`] in most of them. A reflection turns with every step of the array;
/// a second path fitted to looks that are the same explains the model's errors, not a reflection.
fn is_still(group: &[Look]) -> bool {
    let heard: Vec<&Look> = group.iter().filter(|look| look.phasors.tone == Tone::Present).collect();
    let Some(first) = heard.first() else { return true };
    if heard.iter().any(|look| wrap_pi(look.yaw_rad - first.yaw_rad).abs() > f64::from(STILL_RAD)) {
        return false;
    }
    // Mean squared phase between two looks, from their correlation over the channels, less what their noise explains.
    let apart = |a: &Phasors, b: &Phasors| {
        let power = |z: &[Complex; CHANNELS]| z.iter().map(|z| z.norm_squared()).sum::<f32>();
        let product = a.z.iter().zip(&b.z).fold(Complex::default(), |sum, (a, b)| sum.plus(a.times_conj(*b)));
        let noise = |look: &Phasors| look.noise.iter().sum::<f32>() / power(&look.z);
        1.0 - product.norm_squared() / (power(&a.z) * power(&b.z)) - noise(a) - noise(b)
    };
    // The look that is nearest to most of the others stands for all.
    let typical = |look: &&Look| {
        let mut others: Vec<f32> = heard.iter().map(|other| apart(&look.phasors, &other.phasors)).collect();
        others.sort_by(f32::total_cmp);
        others[others.len() / 2]
    };
    heard.iter().map(typical).fold(f32::MAX, f32::min) < STILL_RAD * STILL_RAD
}

/// Looks of an array that stands still, of which most do not fit a plane wave, have one error in common, so that their median
/// is all that they tell, and no more of them make it better. Of others there is the mean.
fn still(group: &[(Bearing, f64)]) -> Bearing {
    let mut usable: Vec<Bearing> = group.iter().map(|(bearing, _)| *bearing).filter(|bearing| bearing.valid).collect();
    let flagged = usable.iter().filter(|bearing| bearing.flags.contains(Flags::MULTIPATH)).count();
    let mean = combine(group);
    if usable.len() < 2 || 2 * flagged < usable.len() {
        return mean;
    }
    let away = |bearing: &Bearing| wrap_pi(f64::from(bearing.azimuth_rad) - f64::from(mean.azimuth_rad));
    usable.sort_by(|a, b| away(a).total_cmp(&away(b)));
    let azimuth_rad = usable[usable.len() / 2].azimuth_rad;
    usable.sort_by(|a, b| a.sigma_rad.total_cmp(&b.sigma_rad));
    let sigma_rad = usable[usable.len() / 2].sigma_rad.max(STILL_SIGMA_RAD);
    Bearing { azimuth_rad, sigma_rad, ..mean }
}

/// Averages bearings, each with its yaw.
fn combine(group: &[(Bearing, f64)]) -> Bearing {
    let (last, yaw_last_rad) = group[group.len() - 1];
    let usable: Vec<&(Bearing, f64)> = group.iter().filter(|(bearing, _)| bearing.valid).collect();
    if group.len() == 1 || usable.is_empty() {
        return last;
    }
    let weight = |bearing: &Bearing| 1.0 / f64::from(bearing.sigma_rad).powi(2);
    let total: f64 = usable.iter().map(|(bearing, _)| weight(bearing)).sum();
    let mean = |value: &dyn Fn(&Bearing) -> f32| {
        (usable.iter().map(|(bearing, _)| weight(bearing) * f64::from(value(bearing))).sum::<f64>() / total) as f32
    };
    // Of those that have one.
    let mean_of = |value: &dyn Fn(&Bearing) -> Option<f32>| {
        let known = usable.iter().filter_map(|(bearing, _)| Some((weight(bearing), f64::from(value(bearing)?))));
        let (total, sum) = known.fold((0.0, 0.0), |(total, sum), (w, value)| (total + w, sum + w * value));
        (total > 0.0).then_some((sum / total) as f32)
    };
    let (mut north, mut east) = (0.0, 0.0);
    for (bearing, yaw_rad) in &usable {
        let direction_rad = f64::from(bearing.azimuth_rad) + yaw_rad;
        north += weight(bearing) * libm::cos(direction_rad);
        east += weight(bearing) * libm::sin(direction_rad);
    }
    let direction_rad = libm::atan2(east, north);
    let chi2: f64 = usable
        .iter()
        .map(|(bearing, yaw_rad)| {
            weight(bearing) * wrap_pi(f64::from(bearing.azimuth_rad) + yaw_rad - direction_rad).powi(2)
        })
        .sum();
    let reduced = if usable.len() > 1 { chi2 / (usable.len() - 1) as f64 } else { 1.0 };
    let flags = usable.iter().fold(Flags::default(), |flags, (bearing, _)| flags.with(bearing.flags));
    Bearing {
        time: last.time,
        valid: true,
        azimuth_rad: wrap_pi(direction_rad - yaw_last_rad) as f32,
        sigma_rad: libm::sqrt(reduced.max(1.0) / total) as f32,
        elevation_rad: mean(&|bearing| bearing.elevation_rad),
        elevation_sigma_rad: mean(&|bearing| bearing.elevation_sigma_rad),
        quality: bearing::Quality {
            snr_db: mean(&|bearing| bearing.quality.snr_db),
            frequency_hz: mean(&|bearing| bearing.quality.frequency_hz),
            closure_chi2: mean(&|bearing| bearing.quality.closure_chi2),
            wavenumber: mean(&|bearing| bearing.quality.wavenumber),
            coherence: mean_of(&|bearing| bearing.quality.coherence),
            // The vehicle moves: that of the last look.
            range_hint_m: usable.last().and_then(|(bearing, _)| bearing.quality.range_hint_m),
        },
        flags,
    }
}

/// The answers as a table for people, each with what else there is to say of it.
#[must_use]
pub fn table<'a>(lines: impl IntoIterator<Item = (&'a Line, String)>) -> String {
    let number = |value: Option<f64>, digits: usize| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"));
    let mut text = format!(
        "{:>6} {:>5} {:>12} {:>10} {:>14} {:>8} {:>10} {:>8}  {}\n",
        "frame", "valid", "azimuth_deg", "sigma_deg", "elevation_deg", "snr_db", "freq_hz", "closure", "flags"
    );
    for (line, more) in lines {
        let words: Vec<&str> =
            line.flags.iter().copied().chain([more.as_str()]).filter(|word| !word.is_empty()).collect();
        text.push_str(&format!(
            "{:>6} {:>5} {:>12} {:>10} {:>14} {:>8} {:>10} {:>8}  {}\n",
            line.frame,
            if line.valid { "yes" } else { "no" },
            number(line.azimuth_deg, 3),
            number(line.sigma_deg, 3),
            number(line.elevation_deg, 1),
            number(line.snr_db, 1),
            number(line.freq_hz, 1),
            number(line.closure_chi2, 2),
            words.join(" "),
        ));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Pose;
    use crate::world::antennas::{Antennas, Impairments, Reflection};
    use crate::world::random::Random;
    use foxhound_core::base::time::Instant;
    use foxhound_core::doa::array;

    fn look(azimuth_deg: f32, sigma_deg: f32) -> Bearing {
        Bearing {
            time: Instant(0),
            valid: true,
            azimuth_rad: azimuth_deg.to_radians(),
            sigma_rad: sigma_deg.to_radians(),
            elevation_rad: 0.0,
            elevation_sigma_rad: 0.1,
            quality: bearing::Quality::default(),
            flags: Flags::default(),
        }
    }

    #[test]
    fn looks_are_weighted_by_their_sigma_in_the_world_frame() {
        // The vehicle turned by 90 deg between the looks: 100 and 10 deg in the body frame are the same direction.
        let combined = combine(&[(look(100.0, 1.0), 0.0), (look(13.0, 1.0), PI / 2.0)]);
        assert!((combined.azimuth_rad.to_degrees() - 11.5).abs() < 1e-3);
        let combined = combine(&[(look(0.0, 1.0), 0.0), (look(5.0, 2.0), 0.0)]);
        assert!((combined.azimuth_rad.to_degrees() - 1.0).abs() < 0.01, "weights 4 to 1");
    }

    #[test]
    fn looks_that_agree_gain_by_the_root_of_their_number_and_scatter_takes_it_back() {
        let group = [(look(1.0, 2.0), 0.0); 4];
        assert!((combine(&group).sigma_rad.to_degrees() - 1.0).abs() < 1e-3);
        let scattered: Vec<_> = [-12.0, -6.0, 6.0, 12.0].map(|azimuth| (look(azimuth, 2.0), 0.0)).to_vec();
        let sigma_deg = combine(&scattered).sigma_rad.to_degrees();
        // Standard error of the mean of these four: 10.95 / 2.
        assert!((sigma_deg - 5.48).abs() < 0.05, "{sigma_deg}");
    }

    #[test]
    fn looks_across_the_back_do_not_average_to_the_nose() {
        let combined = combine(&[(look(179.0, 1.0), 0.0), (look(-179.0, 1.0), 0.0)]);
        assert!(combined.azimuth_rad.abs().to_degrees() > 179.9);
    }

    #[test]
    fn useless_looks_are_left_out_and_a_group_of_them_stays_useless() {
        let dud = Bearing { valid: false, flags: Flags::NO_SIGNAL, sigma_rad: std::f32::consts::PI, ..look(90.0, 1.0) };
        let combined = combine(&[(look(10.0, 1.0), 0.0), (dud, 0.0)]);
        assert!(combined.valid && (combined.azimuth_rad.to_degrees() - 10.0).abs() < 1e-3);
        assert!(!combine(&[(dud, 0.0), (dud, 0.0)]).valid);
    }

    #[test]
    fn a_line_without_signal_has_nulls_and_all_its_keys() {
        let dud = Bearing { valid: false, flags: Flags::NO_SIGNAL, sigma_rad: std::f32::consts::PI, ..look(90.0, 1.0) };
        let json = serde_json::to_value(Line::new(3, &dud)).unwrap();
        let expected = serde_json::json!({"frame": 3, "valid": false, "azimuth_deg": null, "sigma_deg": null,
            "elevation_deg": null, "elevation_sigma_deg": null, "snr_db": null, "freq_hz": null, "closure_chi2": null,
            "coherence": null, "range_hint_m": null, "flags": ["no_signal"]});
        assert_eq!(json, expected);
    }

    #[test]
    fn a_nan_becomes_null() {
        let mut bearing = look(1.0, 1.0);
        bearing.quality.snr_db = f32::NAN;
        bearing.quality.coherence = Some(f32::NAN);
        bearing.quality.range_hint_m = Some(f32::INFINITY);
        let json = serde_json::to_value(Line::new(0, &bearing)).unwrap();
        assert!(["snr_db", "coherence", "range_hint_m"].iter().all(|key| json[key].is_null()), "{json}");
    }

    #[test]
    fn looks_share_the_coherence_that_they_have_and_the_range_is_that_of_the_last_one() {
        let with = |sigma_deg: f32, coherence: Option<f32>, range_hint_m: Option<f32>| {
            let quality = bearing::Quality { coherence, range_hint_m, ..bearing::Quality::default() };
            (Bearing { quality, ..look(0.0, sigma_deg) }, 0.0)
        };
        let group = [with(1.0, Some(0.9), Some(5.0)), with(2.0, Some(1.0), Some(4.0)), with(1.0, None, Some(3.0))];
        let quality = combine(&group).quality;
        assert!((quality.coherence.unwrap() - 0.92).abs() < 1e-6 && quality.range_hint_m == Some(3.0), "{quality:?}");
        let quality = combine(&[with(1.0, None, Some(3.0)), with(1.0, None, None)]).quality;
        assert_eq!((quality.coherence, quality.range_hint_m), (None, None));
    }

    /// Looks a third of a wavelength apart on the way north, turning right, at a beacon in the east and its reflection in
    /// the south-west; silent where asked. With the direction of the beacon at the last look, from north.
    fn passage(count: usize, is_silent: impl Fn(usize) -> bool) -> (Vec<Look>, f64) {
        let beacon = [3.0, 40.0, 0.0];
        let reflections = vec![Reflection { image_ned_m: [-50.0, -60.0, 0.0], level_db: -6.0 }];
        let mut antennas = Antennas {
            amplitude_codes: 1000.0,
            impairments: Impairments { reflections, ..Impairments::default() },
            ..Antennas::default()
        };
        let extractor = phase::Config::default().build::<256>().unwrap();
        let estimator = bearing::Config::default().build(array()).unwrap();
        let (mut state, mut random) = (phase::State::default(), Random::new(1, 1));
        let look = |k: usize| {
            let (north, yaw_rad) = (0.115 * k as f64, 0.3 * k as f64);
            let pose = Pose { position_ned_m: [north, 0.0, 0.0], yaw_rad, ..Pose::default() };
            antennas.channel_gain = [if is_silent(k) { 0.0 } else { 1.0 }; 4];
            let frame = antennas.frame(Instant(2500 * k as u64), &pose, beacon, &mut random);
            let phasors = extractor.step(&mut state, &frame);
            Look { phasors, bearing: estimator.estimate(&phasors), yaw_rad }
        };
        let looks = (0..count).map(look).collect();
        (looks, libm::atan2(40.0, 3.0 - 0.115 * (count - 1) as f64))
    }

    fn array() -> Array {
        array::Config::default().build().unwrap()
    }

    #[test]
    fn four_looks_and_more_tell_the_beacon_from_its_reflection() {
        // The mean of parts is late by half of them, and the beacon turns 3 deg in 20 looks as it is passed.
        for (count, bound_deg) in [(4, 0.7), (8, 0.7), (12, 0.7), (20, 1.2)] {
            let (looks, truth_rad) = passage(count, |_| false);
            let yaw_rad = looks[count - 1].yaw_rad;
            let error_deg = |bearing: &Bearing, yaw_rad: f64| {
                wrap_pi(f64::from(bearing.azimuth_rad) + yaw_rad - truth_rad).to_degrees().abs()
            };
            let alone = looks.iter().map(|look| error_deg(&look.bearing, look.yaw_rad)).fold(0.0, f64::max);
            assert!(alone > 5.0, "{count} looks: the worst alone {alone}");
            let together = answer(Some(&array()), &looks);
            assert!(together.valid && together.flags.contains(Flags::MULTIPATH), "{count} looks: {together:?}");
            assert!(error_deg(&together, yaw_rad) < bound_deg, "{count} looks: {}", error_deg(&together, yaw_rad));
        }
    }

    #[test]
    fn looks_without_a_tone_are_left_out_and_fewer_than_four_are_averaged() {
        // The last look is silent: the answer is still for its yaw.
        let (looks, truth_rad) = passage(8, |k| k == 2 || k == 7);
        let together = answer(Some(&array()), &looks);
        let error_rad = wrap_pi(f64::from(together.azimuth_rad) + looks[7].yaw_rad - truth_rad);
        assert!(together.valid && error_rad.to_degrees().abs() < 1.0, "{}", error_rad.to_degrees());
        assert!(!together.flags.contains(Flags::NO_SIGNAL));

        let (looks, _) = passage(8, |k| k % 3 != 0);
        let average = |looks: &[Look]| combine(&looks.iter().map(|l| (l.bearing, l.yaw_rad)).collect::<Vec<_>>());
        assert_eq!(answer(Some(&array()), &looks), average(&looks));
        assert_eq!(answer(Some(&array()), &looks[..3]), average(&looks[..3]));
        assert_eq!(answer(None, &looks), average(&looks));
        assert!(!answer(Some(&array()), &passage(8, |_| true).0).valid);
    }
}
