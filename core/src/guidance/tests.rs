//! Flights of the fast loop and the planner together, without a simulator.

use super::*;
use crate::base::config::Fence;
use crate::base::ned::Ned;
use crate::base::obstacle::{Disc, Neighbour};
use crate::base::ownship::Agreement;
use crate::base::rng::Rng;
use crate::base::units::wrap_pi;
use crate::control::guard::GuardInput;
use crate::control::track::Demand;
use crate::control::vehicle::Vehicle;
use crate::doa::bearing::{Flags, Quality};
use crate::landing;
use crate::mapping::scan::{Frame, SECTORS_MAX, Sector};
use crate::planning::planner::{self, Workspace};
use std::vec::Vec as StdVec;

const DT: f32 = 0.02;

/// A vehicle among pillars, seen as circles within 3 m and 90 deg; bearings without noise.
struct Flight {
    config: Config,
    pillars: StdVec<Circle>,
    source: Horizontal,
    vehicle: Vehicle,
    /// Steps that the planner needs.
    planning: u32,
}

struct Report {
    reached: bool,
    closest_m: f32,
    outputs: StdVec<Output>,
    /// Which requests were early.
    early: StdVec<bool>,
    state: Option<State<64>>,
}

impl Flight {
    fn new(pillars: &[(f32, f32, f32)], source: (f32, f32)) -> Self {
        let circle = |&(north, east, radius_m): &(f32, f32, f32)| Circle {
            center_ned_m: Horizontal { north, east },
            radius_m,
            ..Circle::default()
        };
        Self {
            config: Config::default(),
            pillars: pillars.iter().map(circle).collect(),
            source: Horizontal { north: source.0, east: source.1 },
            vehicle: Vehicle::new(Horizontal::default(), 4, 0.45),
            planning: 1,
        }
    }

    fn bearing(&self, now: Instant) -> Bearing {
        let azimuth_rad = wrap_pi(self.source.minus(self.vehicle.position).bearing_rad() - self.vehicle.yaw_rad);
        let without = Bearing::without(now, Quality::default(), Flags::default());
        Bearing { valid: true, azimuth_rad, sigma_rad: 0.01, elevation_sigma_rad: 1.0, ..without }
    }

    fn visible(&self) -> StdVec<Circle> {
        let seen = |c: &&Circle| {
            let away = c.center_ned_m.minus(self.vehicle.position);
            away.norm() - c.radius_m < 3.0 && wrap_pi(away.bearing_rad() - self.vehicle.yaw_rad).abs() < 0.785
        };
        self.pillars.iter().filter(seen).copied().collect()
    }

    fn run(&mut self, seconds: f32, twist: impl Fn(u32, &mut Input<'_, 64>)) -> Report {
        let guidance = self.config.build::<64>().unwrap();
        let planner = self.config.build_planner().unwrap();
        let (mut state, mut workspace) = (guidance.start(), Workspace::default());
        let mut ready: Option<(u32, Answer)> = None;
        let mut report = Report {
            reached: false,
            closest_m: f32::INFINITY,
            outputs: StdVec::new(),
            early: StdVec::new(),
            state: None,
        };
        for step in 0..(seconds / DT) as u32 {
            let now = Instant(1_000_000 + u64::from(step) * 20_000);
            let circles = self.visible();
            let answer = ready.take_if(|(at, _)| *at <= step).map(|(_, answer)| answer);
            let mut input = Input {
                front_end: FrontEnd::Bearing(self.bearing(now)),
                ownship: Some(heard(&self.vehicle, now)),
                circles: Some(&circles),
                control: Control::Granted,
                answer: answer.as_ref(),
                ..Input::at(now)
            };
            twist(step, &mut input);
            let output = guidance.step(&mut state, &input);
            if output.plan_requested {
                report.early.push(state.request().is_early);
                ready = Some((step + self.planning, planner.answer(&mut workspace, state.request(), &known(&state))));
            }
            report.outputs.push(output);

            self.vehicle.follow(&output.setpoint);
            for pillar in &self.pillars {
                let clearance = pillar.center_ned_m.minus(self.vehicle.position).norm() - pillar.radius_m - 0.15;
                report.closest_m = report.closest_m.min(clearance);
            }
            if self.source.minus(self.vehicle.position).norm() < 0.5 {
                report.reached = true;
                break;
            }
        }
        report.state = Some(state);
        report
    }
}

const PILLARS: [(f32, f32, f32); 7] = [
    (2.0, 0.1, 0.3),
    (3.2, -0.9, 0.25),
    (3.4, 1.0, 0.25),
    (4.8, 0.2, 0.35),
    (6.2, 1.1, 0.3),
    (6.4, -0.6, 0.3),
    (8.0, 0.4, 0.25),
];

/// What the autopilot reports of a vehicle 5 m up.
fn heard(vehicle: &Vehicle, now: Instant) -> Ownship {
    let ned = |h: Horizontal| Ned { north: h.north, east: h.east, down: -5.0 };
    Ownship {
        position_time: now,
        position_ned_m: ned(vehicle.position),
        velocity_ned_mps: ned(vehicle.velocity),
        attitude_time: now,
        yaw_rad: vehicle.yaw_rad,
        ..Ownship::default()
    }
}

/// A tone at a frequency, a little later from channel to channel, and noise.
fn frame(now: Instant, bins: f32, amplitude: f32, turns_a_channel: f32, rng: &mut Rng) -> AdcFrame<256> {
    let mut frame = AdcFrame { time: now, ..AdcFrame::zeroed() };
    for (channel, row) in frame.codes.iter_mut().enumerate() {
        for (n, code) in row.iter_mut().enumerate() {
            let turns = bins * n as f32 / 256.0 + turns_a_channel * channel as f32;
            *code = (amplitude * libm::cosf(core::f32::consts::TAU * turns) + 40.0 * rng.gaussian()) as i16;
        }
    }
    frame
}

/// A scan of 72 rays ahead.
fn scan(now: Instant, sector: impl Fn(usize) -> Sector) -> Scan {
    Scan {
        time: now,
        turn_s: 0.0,
        first_azimuth_rad: -0.7,
        step_rad: 0.02,
        range_max_m: 3.0,
        rays: (0..SECTORS_MAX).map(sector).collect(),
    }
}

fn known<const N: usize>(state: &State<N>) -> std::vec::Vec<Disc> {
    state.surroundings.map.discs().collect()
}

#[test]
fn it_reaches_the_source_through_pillars_without_touching_one() {
    for seed in 0..20 {
        let mut flight = Flight::new(&PILLARS, (10.0, 0.5));
        flight.config.seed = seed;
        let report = flight.run(60.0, |_, _| {});
        let end = report.outputs.last().unwrap();
        assert!(report.reached, "seed {seed}: {:?} after {} steps", end.outcome, report.outputs.len());
        assert!(report.closest_m > 0.0, "seed {seed}: {}", report.closest_m);
    }
}

#[test]
fn a_restart_in_place_leaves_nothing_of_the_flight_before() {
    let mut flight = Flight::new(&PILLARS, (10.0, 0.5));
    let mut state = flight.run(3.0, |_, _| {}).state.unwrap();
    let guidance = flight.config.build::<64>().unwrap();
    let fresh = std::format!("{:?}", guidance.start());
    assert_ne!(std::format!("{state:?}"), fresh);
    guidance.restart(&mut state);
    assert_eq!(std::format!("{state:?}"), fresh);
}

#[test]
fn the_trace_does_not_depend_on_how_fast_the_planner_is() {
    let hash = |planning: u32| {
        let mut flight = Flight::new(&PILLARS, (10.0, 0.5));
        flight.planning = planning;
        let report = flight.run(10.0, |_, _| {});
        assert!(report.outputs.iter().all(|output| output.outcome != Outcome::PlanLate));
        report.outputs.last().unwrap().trace_hash
    };
    assert_eq!(hash(1), hash(4));
}

#[test]
fn a_planner_that_is_always_late_means_hold() {
    let mut flight = Flight::new(&[], (10.0, 0.0));
    flight.planning = 50;
    let report = flight.run(5.0, |_, _| {});
    let end = report.outputs.last().unwrap();
    assert_eq!(end.outcome, Outcome::PlanLate);
    assert!(flight.vehicle.position.norm() < 1e-3);
}

#[test]
fn a_plan_that_is_late_is_told_as_such_however_long_it_lasts_and_never_as_a_goal_that_cannot_be_reached() {
    // Ready this many steps after the request; it takes effect after 5.
    for planning in [6, 10, 11, 15, 50] {
        let mut flight = Flight::new(&PILLARS, (10.0, 0.5));
        flight.planning = planning;
        let report = flight.run(45.0, |_, _| {});
        let late = report.outputs.iter().skip(5).filter(|output| output.outcome != Outcome::PlanLate).count();
        assert_eq!(late, 0, "{planning} steps: {:?}", report.outputs.last().map(|output| output.outcome));
    }
}

#[test]
fn plans_that_come_late_from_some_time_on_are_what_a_vehicle_waits_for_that_can_go_no_further() {
    // In the open, and in a ring of pillars without a gap.
    let ring = |at: u32| {
        let (sin, cos) = (at as f32 * 0.25).sin_cos();
        (1.5 * cos, 1.5 * sin, 0.25)
    };
    let ring: StdVec<_> = (0..26).map(ring).collect();
    for pillars in [&[][..], &ring] {
        let mut flight = Flight::new(pillars, (60.0, 0.5));
        let report = flight.run(60.0, |step, input| {
            if step > 250 {
                input.answer = None;
            }
        });
        let end = report.outputs.last().unwrap();
        assert_eq!((end.outcome, report.closest_m > 0.0), (Outcome::PlanLate, true));
        assert!(report.outputs.iter().all(|output| output.outcome != Outcome::GoalUnreachable));
    }
}

#[test]
fn a_late_plan_now_and_then_does_not_keep_a_sealed_vehicle_from_giving_up() {
    let ring: StdVec<_> =
        (0..26).map(|at| ((at as f32 * 0.25).cos() * 1.5, (at as f32 * 0.25).sin() * 1.5, 0.25)).collect();
    let mut flight = Flight::new(&ring, (60.0, 0.5));
    let report = flight.run(90.0, |step, input| {
        if step % 200 < 60 {
            input.answer = None;
        }
    });
    assert_eq!(report.outputs.last().unwrap().outcome, Outcome::GoalUnreachable);
}

#[test]
fn what_keeps_coming_into_the_way_is_planned_for_at_once_but_counts_as_an_attempt_no_more_often_than_a_failure() {
    let mut flight = Flight::new(&[], (60.0, 0.0));
    let seconds = 20.0;
    let report = flight.run(seconds, |_, input| {
        // Whoever steps before it wherever it turns.
        let ahead =
            input.ownship.map(|ownship| ownship.position_ned_m.horizontal().plus(Horizontal { north: 0.5, east: 0.1 }));
        let circle = |center_ned_m| Circle { center_ned_m, radius_m: 0.1, ..Circle::default() };
        let circles: &'static [Circle] = std::boxed::Box::leak(ahead.map(circle).into_iter().collect());
        input.circles = Some(circles);
    });
    let attempts = report.early.iter().filter(|early| !**early).count();
    let most = (seconds / 0.6) as usize + 1;
    assert!(attempts <= most && attempts > most / 2, "{attempts} of {}", report.early.len());
    assert!(2 * report.early.len() > 3 * attempts, "{attempts} of {}", report.early.len());
}

#[test]
fn a_bearing_from_before_the_poses_that_are_kept_says_nothing_of_the_last_metres() {
    let config = Config { landing: Some(landing::Config::default()), ..Config::default() };
    let guidance = config.build::<64>().unwrap();
    let vehicle = Vehicle::new(Horizontal::default(), 4, 0.45);
    let believed = |late_us: Option<u64>| {
        let mut state = guidance.start();
        for step in 0..100 {
            let now = Instant(5_000_000 + step * 20_000);
            let heard_at = |late_us| Bearing {
                valid: true,
                azimuth_rad: 0.3,
                sigma_rad: 0.01,
                elevation_rad: 1.2,
                elevation_sigma_rad: 0.02,
                ..Bearing::without(Instant(now.0 - late_us), Quality::default(), Flags::default())
            };
            let front_end = late_us.map_or(FrontEnd::Nothing, |late_us| FrontEnd::Bearing(heard_at(late_us)));
            let input = Input {
                front_end,
                ownship: Some(heard(&vehicle, now)),
                height_m: Some(5.0),
                control: Control::Granted,
                ..Input::at(now)
            };
            let _ = guidance.step(&mut state, &input);
        }
        std::format!("{:?}", state.belief())
    };
    assert_ne!(believed(Some(0)), believed(None), "a fresh one says something");
    assert_eq!(believed(Some(4_000_000)), believed(None));
}

#[test]
fn a_beacon_that_was_located_before_and_is_not_heard_any_more_is_not_landed_on() {
    let config = Config { landing: Some(landing::Config::default()), ..Config::default() };
    let guidance = config.build::<64>().unwrap();
    let source = Horizontal { north: 2.0, east: 0.0 };
    // So long ago it was heard last.
    let stages = |silent_s: f32| {
        let (mut state, mut stages) = (guidance.start(), StdVec::new());
        let heard_until_s = 31.42;
        for step in 0..((heard_until_s + silent_s + 15.0) / DT) as u32 {
            let time_s = step as f32 * DT;
            let now = Instant(5_000_000 + u64::from(step) * 20_000);
            let is_heard = time_s < heard_until_s;
            // To and fro before it, and then it stands there.
            let angle = 0.2 * if is_heard { time_s } else { heard_until_s };
            let place = Horizontal { north: 0.0, east: 4.0 * libm::sinf(angle) };
            let east_mps = if is_heard { 0.8 * libm::cosf(angle) } else { 0.0 };
            let velocity_ned_mps = Ned { east: east_mps, ..Ned::default() };
            let ownship = Ownship { velocity_ned_mps, ..heard(&Vehicle::new(place, 4, 0.45), now) };
            let without = Bearing::without(now, Quality::default(), Flags::default());
            let azimuth_rad = source.minus(place).bearing_rad();
            let bearing = Bearing { valid: true, azimuth_rad, sigma_rad: 0.01, elevation_sigma_rad: 1.0, ..without };
            let input = Input {
                front_end: if is_heard { FrontEnd::Bearing(bearing) } else { FrontEnd::Nothing },
                ownship: Some(ownship),
                control: if time_s < heard_until_s + silent_s { Control::NotInControl } else { Control::Granted },
                ..Input::at(now)
            };
            stages.extend(guidance.step(&mut state, &input).landing.map(|landing| landing.stage));
        }
        stages
    };
    assert!(stages(1.0).iter().any(|stage| *stage != landing::Stage::Seeking), "just heard");
    assert!(stages(70.0).iter().all(|stage| *stage == landing::Stage::Seeking));
}

#[test]
fn the_altitude_held_is_the_first_one_heard_even_when_control_comes_before_it() {
    let mut flight = Flight::new(&[], (30.0, 0.0));
    let report = flight.run(8.0, |step, input| {
        if step < 20 {
            input.ownship = None;
        } else if step > 200 {
            // A gust has lifted the vehicle by half a metre.
            input.ownship =
                input.ownship.map(|o| Ownship { position_ned_m: Ned { down: -5.5, ..o.position_ned_m }, ..o });
        }
    });
    assert!(report.outputs[..200].iter().all(|o| o.setpoint.velocity_ned_mps.down == 0.0));
    let down_mps = report.outputs[300].setpoint.velocity_ned_mps.down;
    assert!((down_mps - 0.4).abs() < 1e-5, "0.8 a second of half a metre: {down_mps}");
}

#[test]
fn without_a_fresh_position_nothing_is_commanded_up_or_down() {
    let untold: fn(&mut Ownship) = |ownship| ownship.position_time = Instant(5_000_000);
    let frozen: fn(&mut Ownship) = |ownship| {
        ownship.position_ned_m = Ned { north: 3.0, east: 0.0, down: -4.8 };
        ownship.velocity_ned_mps = Ned { north: 1.0, east: 0.0, down: 0.0 };
    };
    for (tell, within) in [(untold, 20), (frozen, 60)] {
        let mut flight = Flight::new(&[], (30.0, 0.0));
        let report = flight.run(8.0, |step, input| {
            let Some(ownship) = &mut input.ownship else { return };
            if step > 150 {
                // It has sunk by 0.2 m, and climbs again.
                ownship.position_ned_m.down = -4.8;
            }
            if step > 200 {
                tell(ownship);
            }
        });
        let down_mps = |step: usize| report.outputs[step].setpoint.velocity_ned_mps.down;
        assert!((down_mps(200) + 0.16).abs() < 1e-5, "0.8 a second of 0.2 m: {}", down_mps(200));
        let held = report.outputs.iter().position(|output| output.outcome == Outcome::StaleOwnship).unwrap();
        assert!(held <= 200 + within, "{held}");
        // 2 m/s2 take four steps.
        assert!((held + 3..report.outputs.len()).all(|step| down_mps(step) == 0.0), "{}", down_mps(held + 3));
    }
}

/// Flies for 4 s, receives a falsified ownship from then on; returns how far it went after that, in how many steps it
/// held, and the reason.
fn told_otherwise(every: u32, tell: impl Fn(&mut Ownship, &Ownship)) -> (f32, u32, Option<Stale>) {
    use std::cell::Cell;
    let mut flight = Flight::new(&[], (60.0, 0.5));
    let (before, heard, at) = (Cell::new(None), Cell::new(None), Cell::new(0.0));
    let report = flight.run(12.0, |step, input| {
        let mut now = input.ownship.unwrap();
        if step <= 200 {
            before.set(Some(now));
            at.set(now.position_ned_m.north);
        } else {
            tell(&mut now, &before.get().unwrap());
        }
        // An autopilot that reports so with every step, or less often.
        if step % every == 0 || heard.get().is_none() {
            heard.set(Some(now));
        }
        input.ownship =
            heard.get().map(|heard| Ownship { attitude_time: now.attitude_time, yaw_rad: now.yaw_rad, ..heard });
    });
    let held = report.outputs.iter().position(|output| output.outcome == Outcome::StaleOwnship);
    let stale = report.outputs.last().unwrap().stale;
    (flight.vehicle.position.north - at.get(), held.map_or(u32::MAX, |held| held as u32 - 200), stale)
}

#[test]
fn an_autopilot_whose_velocity_contradicts_its_positions_is_not_flown_by() {
    for every in [1, 5] {
        assert_eq!(told_otherwise(every, |_, _| {}).1, u32::MAX, "it tells the truth");
        let frozen = |heard: &mut Ownship, before: &Ownship| {
            heard.position_ned_m = before.position_ned_m;
        };
        let backwards = |heard: &mut Ownship, _: &Ownship| {
            let v = &mut heard.velocity_ned_mps;
            (v.north, v.east) = (-v.north, -v.east);
        };
        let across = |heard: &mut Ownship, _: &Ownship| {
            let v = &mut heard.velocity_ned_mps;
            (v.north, v.east) = (-v.east, v.north);
        };
        for (expected, (flown_m, steps, stale)) in [
            (Stale::PositionFrozen, told_otherwise(every, frozen)),
            (Stale::VelocityContradicts, told_otherwise(every, backwards)),
            (Stale::VelocityContradicts, told_otherwise(every, across)),
        ] {
            assert!(steps <= 25 && stale == Some(expected), "every {every}: {steps} steps, {stale:?}");
            assert!(flown_m < 2.5, "every {every}, {expected:?}: {flown_m}");
        }
    }
}

#[test]
fn where_its_position_cannot_be_trusted_it_brakes_and_gives_way_to_nothing() {
    // Beside pillars that it has passed, inside of the fence's margin. Position and velocity freeze at full speed, or
    // grow old while it leans in gusts.
    let pillars = [(1.6, 0.75, 0.25), (2.2, 0.75, 0.25), (2.8, 0.75, 0.25), (2.2, -0.75, 0.25)];
    for is_frozen in [true, false] {
        let mut flight = Flight::new(&pillars, (9.0, 0.0));
        flight.config.guard.fence = Fence { radius_m: 6.0, ..Fence::DEFAULT };
        let kept = core::cell::Cell::new(None);
        let report = flight.run(12.0, |step, input| {
            let ownship = input.ownship.as_mut().unwrap();
            if step == 150 {
                kept.set(Some(*ownship));
            }
            if let Some(kept) = kept.get() {
                let time = if is_frozen { input.now } else { kept.position_time };
                *ownship = Ownship { position_time: time, attitude_time: input.now, ..kept };
            }
        });
        let commands_mps: StdVec<f32> = report
            .outputs
            .iter()
            .filter(|output| output.outcome == Outcome::StaleOwnship)
            .map(|output| output.setpoint.velocity_ned_mps.horizontal().norm())
            .collect();
        assert!(commands_mps.len() > 350, "{is_frozen}: {}", commands_mps.len());
        assert!(commands_mps[0] > 0.3, "{is_frozen}: {commands_mps:?}");
        assert!(commands_mps.windows(2).all(|two| two[1] <= two[0]), "{is_frozen}: {commands_mps:?}");
        assert_eq!(commands_mps.last(), Some(&0.0), "{is_frozen}");
    }
}

#[test]
fn what_was_seen_from_positions_that_contradict_the_velocity_is_forgotten_when_the_pilot_takes_over() {
    for is_contradictory in [false, true] {
        let mut flight = Flight::new(&[(2.6, 0.9, 0.2)], (9.0, 0.0));
        let report = flight.run(6.0, |step, input| {
            // Three metres off, in steps that the link does not see as a jump.
            if let Some(ownship) = input.ownship.as_mut().filter(|_| is_contradictory && step > 100) {
                ownship.position_ned_m.east += 0.1 * (step - 100).min(30) as f32;
            }
            if step >= 200 {
                (input.control, input.circles) = (Control::NotInControl, None);
            }
        });
        let state = report.state.unwrap();
        let has_held = report.outputs.iter().any(|output| output.stale == Some(Stale::VelocityContradicts));
        let known = [state.map().circles().next().is_some(), state.control.guard.coverage().has_seen()];
        assert_eq!((has_held, known), (is_contradictory, [!is_contradictory; 2]));
    }
}

#[test]
fn losing_the_mode_stops_at_once_and_a_fresh_entry_goes_on() {
    let mut flight = Flight::new(&[], (30.0, 0.0));
    let report = flight.run(12.0, |step, input| {
        if (200..300).contains(&step) {
            input.control = Control::NotInControl;
        }
    });
    assert!(report.outputs[199].setpoint.velocity_ned_mps.north > 0.5);
    assert!(report.outputs[200..300].iter().all(|o| o.setpoint == Setpoint::default()));
    assert!(report.outputs[200..300].iter().all(|o| o.outcome == Outcome::NotInControl));
    assert!(report.outputs[500].setpoint.velocity_ned_mps.north > 0.5, "{:?}", report.outputs[500]);
}

#[test]
fn a_lost_bearing_brakes_within_the_acceleration_limit_and_holds() {
    let mut flight = Flight::new(&[], (30.0, 0.0));
    let report = flight.run(10.0, |step, input| {
        if step >= 200 {
            input.front_end = FrontEnd::Nothing;
        }
    });
    let speeds: StdVec<f32> = report.outputs.iter().map(|o| o.setpoint.velocity_ned_mps.horizontal().norm()).collect();
    assert!(speeds.windows(2).all(|w| (w[1] - w[0]).abs() < 2.0 * DT * 1.01));
    assert_eq!(report.outputs[499].outcome, Outcome::NoSignal);
    assert_eq!(speeds[499], 0.0);
}

#[test]
fn what_the_guard_does_while_the_vehicle_holds_is_told() {
    // A pillar nearer than the margin, and no signal.
    let mut flight = Flight::new(&[(0.33, 0.0, 0.2)], (10.0, 0.0));
    let report = flight.run(2.0, |_, input| input.front_end = FrontEnd::Nothing);
    let counts = report.outputs.last().unwrap().guard_counts;
    let told = |action| report.outputs.iter().filter(|output| output.guard == action).count();
    assert!(counts.limited > 0, "{counts:?}");
    assert_eq!(told(guard::Action::Limited), counts.limited as usize, "{counts:?}");
}

#[test]
fn in_a_crowd_the_fast_loop_heeds_the_nearest_obstacles_and_otherwise_all_that_are_near() {
    let guidance = Config::default().build::<64>().unwrap();
    let mut rng = Rng::new(6, 0);
    for crowd in [0, 10, 64, 65, 100, 192] {
        let mut state = guidance.start();
        let circles: StdVec<Circle> = (0..crowd)
            .map(|k| Circle {
                center_ned_m: Horizontal::from_bearing(k as f32).times(0.3 + 5.0 * rng.uniform()),
                radius_m: 0.05 + rng.uniform(),
                ..Circle::default()
            })
            .collect();
        for part in circles.chunks(64) {
            state.surroundings.map.observe_circles(Instant(1), Horizontal::default(), part).unwrap();
        }
        near::gather(
            &guidance.guard,
            near::NEAR_M,
            &state.surroundings.map,
            Horizontal::default(),
            &mut state.surroundings.near,
        );
        let clearance = |o: &Neighbour| o.center_ned_m.norm() - o.reach_m;
        let mut all: StdVec<f32> = state
            .surroundings
            .map
            .circles()
            .map(|c| clearance(&guidance.guard.obstacle(&c)))
            .filter(|c| *c < near::NEAR_M)
            .collect();
        all.sort_by(f32::total_cmp);
        let farthest = state.surroundings.near.iter().map(clearance).fold(f32::NEG_INFINITY, f32::max);
        assert_eq!(state.surroundings.near.len(), all.len().min(OBSTACLES_MAX), "{crowd}");
        // Within a ring's width.
        assert!(
            all.get(state.surroundings.near.len())
                .is_none_or(|next| farthest < next + near::NEAR_M / f32::from(near::FAR)),
            "{crowd}"
        );
    }
}

/// Somebody walks up to a vehicle that hovers beside the fence, from wherever the fence leaves room to. It gives way along the fence, as
/// it would along a wall.
#[test]
fn beside_the_fence_it_gives_way_along_it() {
    let fence = Fence { center_ned_m: Horizontal { north: 29.45, east: 0.0 }, radius_m: 30.0, ..Fence::DEFAULT };
    let (mut runs, mut hits) = (0, 0);
    for (direction, offset) in (0..24).flat_map(|direction| (-3..=3).map(move |offset| (direction, offset))) {
        let heading = Horizontal::from_bearing((15.0 * direction as f32 + 7.0).to_radians());
        let across = Horizontal { north: heading.east, east: -heading.north };
        let from = heading.times(-3.6).plus(across.times(0.1 * offset as f32));
        if from.north < 0.5 {
            continue;
        }
        let mut config = Config::default();
        config.guard.fence = fence;
        let guidance = config.build::<64>().unwrap();
        let mut state = guidance.start();
        let mut vehicle = Vehicle::new(Horizontal::default(), 4, 0.45);
        let mut closest_m = f32::INFINITY;
        for step in 0..300_u64 {
            let now = Instant(1_000_000 + step * 20_000);
            let ownship = Ownship { yaw_rad: 0.0, ..heard(&vehicle, now) };
            let velocity_ned_mps = heading.times(1.2);
            let center_ned_m = from.plus(velocity_ned_mps.times(step as f32 * DT));
            let walker = [Circle { center_ned_m, radius_m: 0.3, velocity_ned_mps }];
            let input =
                Input { ownship: Some(ownship), circles: Some(&walker), control: Control::Granted, ..Input::at(now) };
            vehicle.follow(&guidance.step(&mut state, &input).setpoint);
            closest_m = closest_m.min(vehicle.position.minus(center_ned_m).norm() - 0.45);
            assert!(fence.inside(vehicle.position).unwrap().1 > 0.0);
        }
        runs += 1;
        hits += u32::from(closest_m < 0.0);
    }
    assert!(runs == 77 && hits == 0, "{hits} of {runs}");
}

/// A column of posts comes into the list only once it is near. However fast the vehicle may be, and however slowly it brakes, that is
/// early enough.
#[test]
fn what_is_near_is_as_far_as_the_vehicle_needs_to_stop() {
    for (v_max_mps, evade_max_mps, a_max_mps2) in
        [(1.0, 0.0, 2.0), (1.0, 0.0, 0.1), (2.0, 4.0, 2.0), (5.0, 0.0, 2.0), (1.0, 8.0, 1.0), (20.0, 0.0, 20.0)]
    {
        let mut config = Config::default();
        (config.guard.v_max_mps, config.guard.evade_max_mps, config.guard.a_max_mps2) =
            (v_max_mps, evade_max_mps, a_max_mps2);
        config.sensor.range_m = 100.0;
        let guidance = config.build::<64>().unwrap();
        let (mut state, post_m) = (guidance.start(), 150.0);
        let post = Circle { center_ned_m: Horizontal { north: post_m, east: 0.0 }, radius_m: 0.5, ..Circle::default() };
        let mut vehicle = Vehicle::new(Horizontal::default(), 4, 0.45);
        let mut fastest_mps = 0.0_f32;
        for _ in 0..10_000 {
            let (around, guard_state) = (&mut state.surroundings, &mut state.control.guard);
            around.map.observe_circles(Instant(1), vehicle.position, &[post]).unwrap();
            near::gather(&guidance.guard, guidance.stop_m, &around.map, vehicle.position, &mut around.near);
            let commands = vehicle.pending.iter().map(|setpoint| setpoint.velocity_ned_mps.horizontal());
            let pending = commands.fold(Horizontal::default(), Horizontal::plus).times(DT);
            let facts = GuardInput {
                position_ned_m: vehicle.position,
                rest_ned_m: vehicle.position.plus(vehicle.velocity.times(0.45)).plus(pending),
                delay_s: 0.53,
                is_evading: evade_max_mps > 0.0,
                ..GuardInput::default()
            };
            let demand = Demand { velocity_ned_mps: Horizontal { north: 30.0, east: 0.0 }, ..Demand::default() };
            vehicle.follow(&guidance.guard.step(guard_state, &demand, &facts, &around.near, DT).setpoint);
            fastest_mps = fastest_mps.max(vehicle.velocity.north);
        }
        let clearance_m = post_m - 0.5 - config.vehicle.radius_m - vehicle.position.north;
        assert!(clearance_m > 0.0 && clearance_m < 0.2, "{v_max_mps} {evade_max_mps} {a_max_mps2}: {clearance_m}");
        assert!(fastest_mps > 0.99 * v_max_mps.max(evade_max_mps), "{fastest_mps}");
    }
}

#[test]
fn a_vehicle_that_hears_nothing_but_single_points_stops_before_what_they_show() {
    let wall_m = 4.0;
    let mut flight = Flight::new(&[], (30.0, 0.0));
    let guidance = flight.config.build::<64>().unwrap();
    let (planner, mut workspace) = (flight.config.build_planner().unwrap(), Workspace::default());
    let mut state = guidance.start();
    let mut answer = None;
    let mut fastest = 0.0_f32;
    for step in 0..1500_u64 {
        let now = Instant(1_000_000 + step * 20_000);
        // Eight beams, every fifth step, of which those ahead see the wall across the path.
        let mut points = Points { time: now, frame: Frame::Body, ..Points::default() };
        for beam in 0..8 {
            let azimuth = beam as f32 * core::f32::consts::FRAC_PI_4;
            let range_m = (wall_m - flight.vehicle.position.north) / libm::cosf(azimuth + flight.vehicle.yaw_rad);
            if range_m > 0.0 && range_m < 3.0 {
                points.points_m.push(Horizontal::from_bearing(azimuth).times(range_m)).unwrap();
            }
        }
        let input = Input {
            front_end: FrontEnd::Bearing(flight.bearing(now)),
            ownship: Some(heard(&flight.vehicle, now)),
            points: (step % 5 == 0).then_some(&points),
            control: Control::Granted,
            answer: answer.as_ref(),
            ..Input::at(now)
        };
        let output = guidance.step(&mut state, &input);
        answer = output.plan_requested.then(|| planner.answer(&mut workspace, state.request(), &known(&state)));
        flight.vehicle.follow(&output.setpoint);
        fastest = fastest.max(flight.vehicle.velocity.north);
        assert!(flight.vehicle.position.north < wall_m - 0.15, "it hits the wall after {step} steps: {output:?}");
    }
    assert!(fastest > 0.3 && flight.vehicle.position.north > 1.0, "{fastest} {:?}", flight.vehicle.position);
}

#[test]
fn the_navigation_half_keeps_within_48_kilobytes() {
    // Everything but the antennas: the planner's memory, and guidance's state without the phases and without the
    // powers of a turning antenna. The landing's state and its last output have bounds of their own
    // (`landing::tests`). The cross-check of the autopilot's data is not part of navigation.
    let landing = size_of::<landing::State>() + size_of::<Option<landing::Output>>();
    let others = size_of::<phase::State<256>>() + size_of::<turning::State>() + size_of::<Agreement>() + landing;
    let carried = size_of::<State<256>>() - others;
    let bytes = size_of::<Workspace>() + size_of::<planner::Planner>() + carried;
    assert!(bytes <= 48 * 1024, "{bytes}");
}

#[test]
fn a_step_with_what_was_heard_instead_of_the_codes_comes_to_the_same_bits() {
    let guidance = Config::default().build::<256>().unwrap();
    let (planner, mut workspace) = (Config::default().build_planner().unwrap(), Workspace::default());
    let (mut whole, mut parted, mut again) = (guidance.start(), guidance.start(), guidance.start());
    let mut rng = Rng::new(31, 0);
    let mut answer = None;
    let mut heard_count = 0;
    for step in 0..500_u64 {
        let now = Instant(1_000_000 + step * 20_000);
        // The beacon is silent for a while, and then transmits on another frequency.
        let bins = if step < 300 { 20.3 } else { 33.8 };
        let amplitude = if (200..260).contains(&step) { 0.0 } else { 900.0 };
        let snapshot = frame(now, bins, amplitude, 0.2, &mut rng);
        // Eight obstacles, and nothing between them.
        let far_m: [f32; 8] = core::array::from_fn(|k| 1.8 + 0.2 * (k % 4) as f32 + 0.01 * rng.gaussian());
        let look = scan(now, |index| match far_m.get(index / 9) {
            Some(far_m) if index % 9 < 5 => Sector::Hit(*far_m),
            _ => Sector::Clear,
        });
        let ownship = Ownship {
            position_time: now,
            position_ned_m: Ned { north: 0.003 * step as f32, east: 0.0, down: -5.0 },
            attitude_time: now,
            ..Ownship::default()
        };
        let input = Input {
            front_end: FrontEnd::Frame(&snapshot),
            ownship: Some(ownship),
            scan: step.is_multiple_of(5).then_some(&look),
            control: Control::Granted,
            answer: answer.as_ref(),
            ..Input::at(now)
        };
        let output = guidance.step(&mut whole, &input);
        // As the flight computer does it: measure, then step.
        let heard = guidance.listen(&mut parted, input.front_end).unwrap();
        let input = Input { front_end: FrontEnd::Measured(&heard), ..input };
        assert_eq!(guidance.step(&mut parted, &input), output, "{step}");
        // As a log is replayed: without the samples.
        assert_eq!(guidance.step(&mut again, &input), output, "{step}");
        heard_count += u32::from(heard.bearing.valid);
        answer = output.plan_requested.then(|| planner.answer(&mut workspace, whole.request(), &known(&whole)));
    }
    assert!(heard_count > 350 && whole.map().circles().count() > 10, "{heard_count}");
}

#[test]
fn however_much_is_delivered_with_it_a_tone_is_heard_in_its_first_frame() {
    let guidance = Config::default().build::<256>().unwrap();
    for (count, wander_m, scans) in
        [(0, 0.0, false), (1, 0.3, false), (12, 0.0, false), (12, 0.3, true), (40, 0.0, true)]
    {
        let mut state = guidance.start();
        let mut rng = Rng::new(32, 0);
        let missed = (0..100_u64).find(|step| {
            let now = Instant(1_000_000 + step * 20_000);
            let snapshot = frame(now, 20.3, 900.0, 0.0, &mut rng);
            let circles: StdVec<Circle> = (0..count)
                .map(|index| {
                    let far_m = 1.5 + 0.08 * index as f32;
                    let away = Horizontal::from_bearing(1.2 * index as f32).times(far_m);
                    let center_ned_m = away.plus(Horizontal { north: wander_m * rng.gaussian(), east: 0.0 });
                    Circle { center_ned_m, radius_m: 0.1, ..Circle::default() }
                })
                .collect();
            let look = scan(now, |index| if index % 9 < 5 { Sector::Hit(1.8) } else { Sector::Clear });
            let input = Input {
                front_end: FrontEnd::Frame(&snapshot),
                ownship: Some(Ownship { position_time: now, attitude_time: now, ..Ownship::default() }),
                scan: scans.then_some(&look),
                circles: Some(&circles),
                control: Control::Granted,
                ..Input::at(now)
            };
            guidance.step(&mut state, &input).bearing.is_none_or(|bearing| bearing.quality.snr_db < 10.0)
        });
        assert_eq!(missed, None, "{count} {wander_m} {scans}");
    }
}
