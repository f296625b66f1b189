//! Any measurements: sightings, walls and probabilities through the filters of the source, readings of one antenna through
//! the seeking, looks through the link state, points and circles through the walls and the search.

use std::f32::consts::{PI, TAU};

use foxhound_core::base::config::{Fence, RangeSensor};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::Disc;
use foxhound_core::base::pose::Pose;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::{Bearing, Flags, Quality};
use foxhound_core::doa::rotating;
use foxhound_core::localize::link_state::{self, Classifier, Features, Sightline};
use foxhound_core::localize::source::{Estimate, FILTERS, Sighting, Update, bank, polar};
use foxhound_core::mapping::map::CIRCLES_MAX;
use foxhound_core::mapping::walls::{self, WALLS_MAX, Wall};
use foxhound_core::planning::explore::{self, Explored};
use foxhound_papers::filters::cartesian;
use foxhound_papers::filters::reflected::{Known, literal, of_slope_intercept, slope_intercept};

use super::{Draw, Noise, Reached};

/// Longest stream.
const STEPS_MAX: u32 = 400;

/// Any measurements. Of a case, `answers` are the measurements, `usable` those after which something was known.
pub fn filters(case: &[u8]) -> Reached {
    let draw = &mut Draw { rest: case };
    match draw.below(8) {
        0 | 1 => alone(draw),
        2 => behind_walls(draw),
        3 => several(draw),
        4 => seeking(draw),
        5 => looked_at(draw),
        6 => walls(draw),
        _ => search(draw),
    }
}

fn place(draw: &mut Draw<'_>) -> Horizontal {
    let reach_m = [1.0, 20.0, 20.0, 1e4][usize::from(draw.below(4))];
    Horizontal { north: draw.any(-reach_m, reach_m), east: draw.any(-reach_m, reach_m) }
}

fn line(draw: &mut Draw<'_>) -> Wall {
    match draw.below(8) {
        0 => Wall {
            normal_ned: place(draw),
            offset_m: draw.any(-20.0, 20.0),
            from_m: draw.any(-20.0, 0.0),
            to_m: draw.any(0.0, 20.0),
        },
        1 => of_slope_intercept([draw.any(-5.0, 5.0), draw.any(-20.0, 20.0)]),
        _ => Wall::between(place(draw), place(draw)).unwrap_or_default(),
    }
}

/// Of a vehicle that goes on from where it was, as a rule, and hears one place, as a rule.
struct Stream {
    here: Horizontal,
    source: Horizontal,
    sigma_rad: f32,
    since_s: f32,
}

impl Stream {
    fn new(draw: &mut Draw<'_>) -> Self {
        let tame = |metres: f32, draw: &mut Draw<'_>| draw.between(-metres, metres);
        Self {
            here: Horizontal { north: tame(20.0, draw), east: tame(20.0, draw) },
            source: Horizontal { north: tame(20.0, draw), east: tame(20.0, draw) },
            sigma_rad: draw.field(0.05, 0.0, 3.0),
            since_s: draw.field(0.1, 0.0, 10.0),
        }
    }

    fn sighting(&mut self, draw: &mut Draw<'_>) -> Sighting {
        let kind = draw.byte();
        let step = match kind & 3 {
            0 => Horizontal::default(),
            1 => Horizontal { north: draw.between(-0.2, 0.2), east: draw.between(-0.2, 0.2) },
            2 => Horizontal { north: draw.between(-5.0, 5.0), east: draw.between(-5.0, 5.0) },
            // Right over the source.
            _ if kind & 4 == 0 => self.source.minus(self.here),
            _ => Horizontal { north: draw.between(-1e5, 1e5), east: draw.between(-1e5, 1e5) },
        };
        if kind & 3 != 3 || kind & 0x38 == 0 {
            self.here = self.here.plus(step);
        }
        let away = self.source.minus(self.here);
        let bearing_rad = away.bearing_rad() + if kind & 0x40 == 0 { self.sigma_rad } else { -self.sigma_rad };
        let mut heard = Sighting {
            place_ned_m: self.here,
            direction_ned: Horizontal::from_bearing(bearing_rad),
            sigma_rad: self.sigma_rad,
            since_s: self.since_s,
        };
        if kind & 0x80 != 0 {
            match draw.below(6) {
                0 => heard.place_ned_m = place(draw),
                1 => heard.direction_ned = Horizontal { north: draw.any(-1.1, 1.1), east: draw.any(-1.1, 1.1) },
                2 => heard.sigma_rad = draw.any(0.0, 10.0),
                3 => heard.since_s = draw.any(0.0, 1e6),
                4 => self.source = self.here.plus(place(draw)),
                _ => heard.direction_ned = Horizontal::from_bearing(draw.between(-PI, PI)),
            }
        }
        heard
    }
}

/// Symmetric, and with a Cholesky factor in double precision after scaling to ones on the diagonal.
fn check_covariance<const S: usize>(p: &[[f32; S]; S], about: &dyn Fn() -> String) {
    let mut l = [[0.0_f64; S]; S];
    for i in 0..S {
        for j in 0..=i {
            assert!(p[i][j].is_finite() && p[i][j] == p[j][i], "not symmetric: {p:?} {}", about());
            let mut sum = f64::from(p[i][j]) / (f64::from(p[i][i]) * f64::from(p[j][j])).sqrt();
            sum -= l[i].iter().zip(&l[j]).take(j).map(|(a, b)| a * b).sum::<f64>();
            if i == j {
                assert!(sum > 0.0, "not positive: {p:?} {}", about());
                l[i][i] = sum.sqrt();
            } else {
                l[i][j] = sum / l[j][j];
            }
        }
    }
}

fn check_estimate(estimate: &Estimate, about: &dyn Fn() -> String) {
    assert!(estimate.place_ned_m.is_finite() && estimate.velocity_ned_mps.is_finite(), "{estimate:?} {}", about());
    let [nn, ne, ee] = estimate.covariance_m2;
    assert!(nn >= 0.0 && ee >= 0.0 && nn.is_finite() && ne.is_finite() && ee.is_finite(), "{estimate:?} {}", about());
    assert!(estimate.bearing_ned_rad.abs() <= PI + 1e-6, "{estimate:?} {}", about());
    assert!((0.0..=2.0).contains(&estimate.bearing_sigma_rad), "{estimate:?} {}", about());
    assert!(estimate.range_m > 0.0 && estimate.range_m.is_finite(), "{estimate:?} {}", about());
    assert!(estimate.range_sigma_ratio >= 0.0 && estimate.range_sigma_ratio.is_finite(), "{estimate:?} {}", about());
}

fn check_heard(heard: &Update, about: &dyn Fn() -> String) {
    if let Update::Fused { nis, weight, likelihood } = heard {
        assert!(*nis >= 0.0 && (0.0..=1.0).contains(weight) && *likelihood >= 0.0, "{heard:?} {}", about());
        assert!(nis.is_finite() && likelihood.is_finite(), "{heard:?} {}", about());
    }
}

fn check_polar<const S: usize>(state: &polar::State<S>, about: &dyn Fn() -> String) -> bool {
    let Some(estimate) = state.estimate() else { return false };
    check_estimate(&estimate, about);
    assert!(state.mean().iter().all(|x| x.is_finite()), "{state:?} {}", about());
    assert!((state.direction_ned().norm() - 1.0).abs() < 1e-5, "{state:?} {}", about());
    let p: [[f32; S]; S] = std::array::from_fn(|i| std::array::from_fn(|j| state.covariance(i, j)));
    check_covariance(&p, about);
    true
}

fn polar_config(draw: &mut Draw<'_>) -> polar::Config {
    let usual = polar::Config::DEFAULT;
    polar::Config {
        inverse_range_per_m: draw.field(usual.inverse_range_per_m, 1e-3, 5.0),
        inverse_range_sigma_per_m: draw.field(usual.inverse_range_sigma_per_m, 1e-6, 5.0),
        range_max_m: draw.field(usual.range_max_m, 10.0, 1e5),
        outlier_rate: draw.field(usual.outlier_rate, 0.0, 0.9),
        odometry_m2_per_s: draw.field(usual.odometry_m2_per_s, 0.0, 10.0),
        speed_sigma_mps: draw.field(usual.speed_sigma_mps, 0.0, 100.0),
        acceleration_m2_per_s3: draw.field(usual.acceleration_m2_per_s3, 0.0, 100.0),
    }
}

/// Sightings through the filters of a source that is seen directly.
fn alone(draw: &mut Draw<'_>) -> Reached {
    let mut reached = Reached::default();
    let direct = cartesian::Config {
        range_m: draw.field(12.5, 0.2, 1e3),
        range_sigma_m: draw.field(10.0, 1e-3, 1e3),
        walk_m2_per_s: draw.field(1e-5, 0.0, 10.0),
        ..cartesian::Config::DEFAULT
    };
    let (Ok(filter), Ok(direct)) = (polar_config(draw).build(), direct.build()) else { return reached };
    reached.configured = true;
    let (mut resting, mut moving, mut flat) =
        (polar::Resting::new(), polar::Moving::new(), cartesian::State::default());
    let mut stream = Stream::new(draw);
    if draw.flag() {
        direct.begin(&mut flat, stream.here, place(draw), draw.any(0.0, 10.0));
    }
    while !draw.rest.is_empty() && reached.answers < STEPS_MAX {
        let heard = stream.sighting(draw);
        let about = || format!("{heard:?} {filter:?}");
        check_heard(&filter.step(&mut resting, &heard), &about);
        check_heard(&filter.step(&mut moving, &heard), &about);
        check_heard(&direct.step(&mut flat, &heard), &about);
        let known = check_polar(&resting, &about);
        check_polar(&moving, &about);
        if draw.below(16) == 0 {
            // Of which a sound wall leaves as much.
            let line = Wall::between(place(draw), place(draw)).unwrap_or_default();
            if line.offset_m.abs() < 1e5 {
                check_polar(&resting.mirrored(&line), &about);
            }
        }
        if let Some(estimate) = flat.estimate() {
            check_estimate(&estimate, &about);
            let [nn, ne, ee] = estimate.covariance_m2;
            check_covariance(&[[nn, ne], [ne, ee]], &about);
        }
        reached.answers += 1;
        reached.usable += u32::from(known);
    }
    reached
}

/// Sightings off lines that are known, and off one that is not.
fn behind_walls(draw: &mut Draw<'_>) -> Reached {
    let mut reached = Reached::default();
    let literal_config = literal::Config {
        walk_m2_per_s: draw.field(1e-5, 0.0, 10.0),
        slope_per_s: draw.field(1e-7, 0.0, 10.0),
        intercept_m2_per_s: draw.field(1e-5, 0.0, 10.0),
        ..literal::Config::DEFAULT
    };
    let (Ok(filter), Ok(printed)) = (polar_config(draw).build(), literal_config.build()) else { return reached };
    reached.configured = true;
    let mut stream = Stream::new(draw);
    let wall = line(draw);
    let (one, two) = (Known { filter, lines: [wall] }, Known { filter, lines: [line(draw), wall] });
    let (mut resting, mut moving) = (polar::Resting::new(), polar::Moving::new());
    let guess = literal::Guess {
        vehicle_ned_m: stream.here,
        vehicle_sigma_m: draw.any(0.0, 1.0),
        source_ned_m: stream.source,
        source_sigma_m: draw.any(0.0, 10.0),
        slope_intercept: if draw.flag() {
            slope_intercept(&wall)
        } else {
            [draw.any(-5.0, 5.0), draw.any(-20.0, 20.0)]
        },
        slope_intercept_sigma: [draw.any(0.0, 1.0), draw.any(0.0, 10.0)],
    };
    let mut literals = [literal::State::default(); 2];
    let _ = printed.begin_known(&mut literals[0], &guess);
    let _ = printed.begin_unknown(&mut literals[1], &guess);
    // Of which the vehicle hears the mirror image.
    if draw.flag() && wall.offset_m.abs() < 1e5 {
        stream.source = wall.mirror(stream.source);
    }
    while !draw.rest.is_empty() && reached.answers < STEPS_MAX {
        let heard = stream.sighting(draw);
        let about = || format!("{heard:?} {wall:?}");
        let _ = one.step(&mut resting, &heard).map(|heard| check_heard(&heard, &about));
        let _ = two.step(&mut moving, &heard).map(|heard| check_heard(&heard, &about));
        let mut known = check_polar(&resting, &about);
        check_polar(&moving, &about);
        for estimate in [one.estimate(&resting, stream.here), two.estimate(&moving, stream.here)].into_iter().flatten()
        {
            assert!(estimate.place_ned_m.is_finite() && estimate.velocity_ned_mps.is_finite(), "{estimate:?}");
        }
        for state in &mut literals {
            let _ = printed.step(state, &heard).map(|heard| check_heard(&heard, &about));
            if state.estimate().is_some() {
                assert!(state.mean().iter().all(|x| x.is_finite()), "{state:?} {}", about());
                check_covariance(state.covariance(), &about);
                known = true;
            }
        }
        reached.answers += 1;
        reached.usable += u32::from(known);
    }
    reached
}

/// Sightings, walls and probabilities of reflection through the bank.
fn several(draw: &mut Draw<'_>) -> Reached {
    let mut reached = Reached::default();
    let usual = bank::Config::DEFAULT;
    let config = bank::Config { polar: if draw.flag() { usual.polar } else { polar_config(draw) }, ..usual };
    let Ok(bank) = config.build() else { return reached };
    reached.configured = true;
    let mut state = bank::State::new();
    let mut stream = Stream::new(draw);
    let mut walls = [Wall::default(); 3];
    while !draw.rest.is_empty() && reached.answers < STEPS_MAX {
        if reached.answers == 0 || draw.below(16) == 0 {
            walls = [line(draw), line(draw), line(draw)];
        }
        let heard = stream.sighting(draw);
        let answer = bank.step(&mut state, &heard, draw.any(0.0, 1.0), &walls);
        assert!(state.count() <= FILTERS);
        if let Some(answer) = answer {
            check_estimate(&answer.estimate, &|| format!("{heard:?} {walls:?}"));
            assert!(answer.share > 0.0 && answer.share <= 1.0, "{answer:?}");
            reached.usable += 1;
        }
        reached.answers += 1;
    }
    reached
}

/// Readings of one antenna through the seeking.
fn seeking(draw: &mut Draw<'_>) -> Reached {
    let mut reached = Reached::default();
    let config = rotating::Config {
        memory: draw.field(0.7, 0.0, 0.99),
        sigma_min_rad: draw.field(0.035, 1e-3, 1.0),
        ..rotating::Config::default()
    };
    let Ok(seeker) = config.build() else { return reached };
    reached.configured = true;
    let mut state = rotating::State::new();
    let (mut now, mut yaw_rad) = (Instant(0), 0.0);
    let (rate_rad, mut noise) = (draw.field(0.13, -1.6, 1.6), Noise(u64::from(draw.word())));
    while !draw.rest.is_empty() && reached.answers < STEPS_MAX {
        // A rotation or so of readings that are as they should be, then one that is not.
        for _ in 0..draw.below(64) {
            now = now.plus_micros(20_000);
            yaw_rad = (yaw_rad + rate_rad) % TAU;
            let power_db = -60.0 + config.pattern.gain_db(yaw_rad) + noise.gaussian();
            reached.usable += u32::from(listen(&seeker, &mut state, now, yaw_rad, power_db).is_some());
        }
        now = draw.instant(now);
        let (yaw, power_db) = (draw.any(-4.0, 4.0), draw.any(-120.0, 0.0));
        let rotation = listen(&seeker, &mut state, now, if draw.flag() { yaw } else { yaw_rad }, power_db);
        reached.usable += u32::from(rotation.is_some());
        reached.answers += 1;
    }
    reached
}

/// One reading, and what the rotation came to.
fn listen(
    seeker: &rotating::Seeker,
    state: &mut rotating::State,
    time: Instant,
    yaw_rad: f32,
    power_db: f32,
) -> Option<rotating::Rotation> {
    let outcome = seeker.step(state, time, yaw_rad, power_db)?;
    assert!(state.bins().iter().flatten().all(f32::is_finite), "{state:?}");
    let rotating::Outcome::Rotation(rotation) = outcome else { return None };
    assert!(rotation.bearing_ned_rad.abs() <= PI + 1e-6, "{rotation:?}");
    assert!(rotation.sigma_rad > 0.0 && rotation.independent_sigma_rad().is_finite(), "{rotation:?}");
    assert!(rotation.contrast_db.is_finite(), "{rotation:?}");
    Some(rotation)
}

/// Looks through the link state.
fn looked_at(draw: &mut Draw<'_>) -> Reached {
    let mut reached = Reached { configured: true, ..Reached::default() };
    let mut state = link_state::State::new();
    let (mut now, mut stream) = (Instant(0), Stream::new(draw));
    while !draw.rest.is_empty() && reached.answers < STEPS_MAX {
        now = draw.instant(now);
        let heard = stream.sighting(draw);
        let bearing = Bearing {
            time: now,
            valid: draw.flag(),
            azimuth_rad: draw.any(-PI, PI),
            sigma_rad: heard.sigma_rad,
            elevation_rad: 0.0,
            elevation_sigma_rad: draw.any(0.0, PI),
            quality: Quality {
                snr_db: draw.any(-20.0, 60.0),
                closure_chi2: draw.any(0.0, 100.0),
                wavenumber: draw.any(0.0, 2.0),
                coherence: draw.flag().then(|| draw.any(0.0, 1.0)),
                ..Quality::default()
            },
            flags: Flags(draw.word() as u16),
        };
        let sightline = match draw.below(4) {
            0 => Sightline::Unknown,
            1 => Sightline::Clear,
            2 => Sightline::Wall { range_m: draw.any(0.0, 100.0) },
            _ => Sightline::among(&[line(draw), line(draw)], heard.place_ned_m, draw.any(-PI, PI), draw.any(0.0, 1.0)),
        };
        let bearing_ned_rad = match draw.below(8) {
            0 => None,
            1 => Some(draw.any(-PI, PI)),
            _ => Some(heard.direction_ned.bearing_rad()),
        };
        let look = Features { place_ned_m: heard.place_ned_m, bearing: &bearing, bearing_ned_rad, sightline };
        let estimate = Classifier::TRAINED.step(&mut state, &look);
        let sum: f32 = estimate.probabilities.iter().sum();
        assert!(estimate.probabilities.iter().all(|p| (0.0..=1.0).contains(p)), "{estimate:?} {look:?}");
        assert!((sum - 1.0).abs() < 1e-3, "{estimate:?} {look:?}");
        assert!((0.0..=1.0).contains(&estimate.reflected(draw.between(0.0, 10.0))), "{estimate:?}");
        assert!(state.features().is_none_or(|features| features.iter().all(|x| x.is_finite())), "{look:?} {state:?}");
        reached.answers += 1;
        reached.usable += u32::from(state.count() >= usize::from(link_state::LOOKS_MIN));
    }
    reached
}

fn points(draw: &mut Draw<'_>) -> Vec<Horizontal> {
    let mut points = Vec::new();
    while points.len() < 200 && !draw.rest.is_empty() && draw.below(8) > 0 {
        let (from, to) = (place(draw), place(draw));
        let (count, mut noise) = (draw.below(64), Noise(u64::from(draw.word())));
        let sigma_m = draw.field(0.03, 0.0, 2.0);
        points.extend((0..count).map(|k| {
            let along = from.plus(to.minus(from).times(f32::from(k) / f32::from(count)));
            along.plus(Horizontal { north: sigma_m * noise.gaussian(), east: sigma_m * noise.gaussian() })
        }));
        points.push(place(draw));
    }
    points
}

/// Points, in the order of a scan or in any other, through the walls.
fn walls(draw: &mut Draw<'_>) -> Reached {
    let mut reached = Reached::default();
    let usual = walls::Config::DEFAULT;
    // Says nothing: so that the recorded cases read the same bytes.
    let _ = draw.flag();
    let config = walls::Config {
        gap_m: draw.field(usual.gap_m, 0.05, 10.0),
        length_min_m: draw.field(usual.length_min_m, 0.1, 5.0),
    };
    let Ok(lines) = config.build() else { return reached };
    reached.configured = true;
    let mut workspace = walls::Workspace::new();
    while !draw.rest.is_empty() && reached.answers < 8 {
        let mut points = points(draw);
        if draw.flag() {
            let circles = points.iter().map(|center_ned_m| Disc {
                center_ned_m: *center_ned_m,
                radius_m: 0.1,
                ..Disc::default()
            });
            let circles: Vec<Disc> = circles.collect();
            points = walls::points_of(&circles, place(draw)).to_vec();
        }
        let found = lines.find(&mut workspace, &points);
        assert!(found.len() <= WALLS_MAX);
        for line in &found {
            let [from, to] = line.ends_ned_m();
            assert!((line.normal_ned.norm() - 1.0).abs() < 1e-3, "{line:?} {points:?}");
            assert!(from.is_finite() && to.is_finite() && line.from_m <= line.to_m, "{line:?} {points:?}");
        }
        reached.answers += 1;
        reached.usable += found.len() as u32;
    }
    reached
}

/// Poses and circles through the search.
fn search(draw: &mut Draw<'_>) -> Reached {
    let mut reached = Reached::default();
    let usual = explore::Config::default();
    let config = explore::Config {
        limit_s: draw.field(usual.limit_s, 1.0, 600.0),
        radius_m: draw.field(usual.radius_m, 1.0, 60.0),
        cell_m: draw.field(usual.cell_m, 0.2, 20.0),
        seed: draw.word(),
    };
    let Ok(explorer) = config.build(draw.field(0.2, 0.0, 2.0), &Fence::DEFAULT) else { return reached };
    reached.configured = true;
    let mut state = explore::State::new();
    let (mut now, mut here, mut began) = (Instant(0), place(draw), None);
    let mut circles = Vec::new();
    while !draw.rest.is_empty() && reached.answers < 64 {
        if draw.below(8) == 0 {
            circles = points(draw).into_iter().take(CIRCLES_MAX).map(|center_ned_m| disc(draw, center_ned_m)).collect();
        }
        match draw.below(16) {
            0 => here = place(draw),
            1 => state.blocked(),
            2 => {
                state.end();
                began = None;
            }
            _ => (),
        }
        let pose = Pose { position_ned_m: here, yaw_rad: draw.any(-PI, PI) };
        let sensor = RangeSensor { range_m: draw.any(0.1, 10.0), fov_rad: draw.any(0.1, 7.0), ..RangeSensor::DEFAULT };
        let explored = explorer.step(&mut state, now, &pose, &sensor, circles.iter());
        if began.is_none() && explored != Explored::NoPose {
            began = Some(here);
        }
        if let Explored::Target(target) = explored {
            let from = began.unwrap_or_default();
            let away = target.minus(from);
            // Far from the origin places are as coarse as their numbers are.
            let grain_m = 1e-5 * from.norm();
            assert!(away.norm() <= config.radius_m * 1.001 + grain_m, "{target:?} {from:?} {config:?}");
            here = here.plus(target.minus(here).clamped(0.5));
            reached.usable += 1;
        }
        now = draw.instant(now);
        reached.answers += 1;
    }
    reached
}

fn disc(draw: &mut Draw<'_>, center_ned_m: Horizontal) -> Disc {
    Disc {
        center_ned_m,
        radius_m: draw.field(0.15, 0.0, 2.0),
        sigma_mm: u16::from(draw.below(200)),
        moves: draw.below(16) == 0,
    }
}
