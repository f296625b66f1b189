//! What others see in the way.

use foxhound_core::base::time::Instant;
use foxhound_core::mapping::scan::{Frame, Sector};
use foxhound_link::companion::{Config, ObstacleFrame};
use foxhound_link::dialect::*;

use crate::bench::*;

fn obstacles(frame: u8) -> MavMessage {
    let mut data = OBSTACLE_DISTANCE_DATA {
        increment: 5,
        min_distance: 20,
        max_distance: 1000,
        frame,
        ..OBSTACLE_DISTANCE_DATA::DEFAULT
    };
    data.distances = [1001; 72];
    data.distances[0] = 250;
    data.distances[1] = 0;
    data.distances[2] = u16::MAX;
    MavMessage::OBSTACLE_DISTANCE(data)
}

fn first_azimuth(autopilot: u8, frame: u8, config: Config) -> Option<f32> {
    let mut bench = Bench::new(config);
    bench.say(&MavMessage::HEARTBEAT(heartbeat(autopilot, 0, DISARMED)));
    bench.say(&attitude(1, 0.5));
    bench.say_as((1, 158), &obstacles(frame));
    bench.take_scan().map(|scan| scan.first_azimuth_rad)
}

#[test]
fn obstacle_angles_count_from_the_nose_on_ardupilot_and_as_the_frame_says_on_px4() {
    let auto = Config::default();
    for frame in [0, 1, 8, 12] {
        assert_eq!(first_azimuth(ARDUPILOT, frame, auto), Some(0.0), "ArduPilot ignores the frame");
    }
    assert_eq!(first_azimuth(PX4, 12, auto), Some(0.0));
    assert_eq!(first_azimuth(PX4, 0, auto), Some(-0.5), "north is to the left");
    assert_eq!(first_azimuth(PX4, 1, auto), Some(-0.5));
    assert_eq!(first_azimuth(PX4, 8, auto), None);
    let with = |obstacle_frame| Config { obstacle_frame, ..Config::default() };
    assert_eq!(first_azimuth(ARDUPILOT, 0, with(ObstacleFrame::Field)), Some(-0.5));
    assert_eq!(first_azimuth(PX4, 0, with(ObstacleFrame::Body)), Some(0.0));
}

#[test]
fn north_aligned_obstacles_without_a_fresh_yaw_are_rejected() {
    let mut bench = Bench::new(Config::default());
    bench.say(&MavMessage::HEARTBEAT(heartbeat(PX4, 0, DISARMED)));
    bench.say(&obstacles(0));
    assert_eq!(bench.take_scan(), None);
    bench.say(&attitude(1, 0.5));
    bench.step(600_000);
    bench.say(&obstacles(0));
    assert_eq!(bench.take_scan(), None);
    assert_eq!(bench.companion.counters().rejected, 2);
}

#[test]
fn zero_is_no_reading_on_ardupilot_and_touching_elsewhere() {
    for (autopilot, expected) in [(ARDUPILOT, Sector::Unknown), (PX4, Sector::Hit(0.2))] {
        let mut bench = Bench::new(Config::default());
        bench.say(&MavMessage::HEARTBEAT(heartbeat(autopilot, 0, DISARMED)));
        bench.say(&obstacles(12));
        let scan = bench.take_scan().unwrap();
        assert_eq!(
            scan.rays.iter().take(4).collect::<Vec<_>>(),
            [Sector::Hit(2.5), expected, Sector::Unknown, Sector::Clear]
        );
        assert_eq!((scan.time, scan.range_max_m), (bench.now(), 10.0));
        assert_eq!(bench.take_scan(), None, "taken once");
    }
}

#[test]
fn obstacles_come_from_any_component_of_our_system_but_no_other_system() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.say_as((2, 1), &obstacles(12));
    assert_eq!(bench.take_scan(), None);
    bench.say_as((1, 196), &obstacles(12));
    assert!(bench.take_scan().is_some());
}

#[test]
fn a_scan_that_nobody_takes_is_dropped_when_it_is_old() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.say(&obstacles(12));
    bench.run(0.6);
    assert_eq!(bench.take_scan(), None);
}

fn beam(orientation: u8, current_distance: u16) -> MavMessage {
    MavMessage::DISTANCE_SENSOR(DISTANCE_SENSOR_DATA {
        orientation,
        current_distance,
        min_distance: 20,
        max_distance: 800,
        horizontal_fov: 0.05,
        ..DISTANCE_SENSOR_DATA::DEFAULT
    })
}

fn point(x: f32, y: f32) -> MavMessage {
    MavMessage::OBSTACLE_DISTANCE_3D(OBSTACLE_DISTANCE_3D_DATA {
        frame: 12,
        x,
        y,
        min_distance: 0.2,
        max_distance: 8.0,
        ..OBSTACLE_DISTANCE_3D_DATA::DEFAULT
    })
}

#[test]
fn beams_and_points_of_our_system_are_gathered_until_they_are_taken() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    let heard_at = bench.now();
    bench.say(&beam(0, 300));
    bench.step(10_000);
    bench.say_as((1, 196), &beam(2, 150));
    bench.say_as((1, 196), &point(1.0, -0.5));
    bench.say_as((2, 1), &beam(0, 100));
    let points = bench.take_points().unwrap();
    let found: Vec<(f32, f32)> = points.points_m.iter().map(|point| (point.north, point.east)).collect();
    assert_eq!(found.len(), 3, "{found:?}");
    for (found, expected) in found.iter().zip([(3.0, 0.0), (0.0, 1.5), (1.0, -0.5)]) {
        assert!((found.0 - expected.0).abs() < 1e-5 && (found.1 - expected.1).abs() < 1e-5, "{found:?}");
    }
    assert_eq!((points.frame, points.time), (Frame::Body, heard_at), "as old as the oldest of them");
    assert_eq!(bench.take_points(), None, "taken once");
}

#[test]
fn a_beam_of_unknown_width_fills_45_degrees_and_eight_of_them_are_a_scan() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    let wide = |orientation| match beam(orientation, 400) {
        MavMessage::DISTANCE_SENSOR(narrow) => DISTANCE_SENSOR_DATA { horizontal_fov: 0.0, ..narrow },
        _ => unreachable!(),
    };
    bench.say_as((1, 196), &MavMessage::DISTANCE_SENSOR(wide(2)));
    let points = bench.take_points().unwrap().points_m;
    let azimuths_deg: Vec<f32> = points.iter().map(|point| point.east.atan2(point.north).to_degrees()).collect();
    assert!(azimuths_deg.iter().all(|azimuth_deg| (azimuth_deg - 90.0).abs() < 20.5), "{azimuths_deg:?}");
    assert_eq!(azimuths_deg.len(), 9);
    assert!(points.iter().all(|point| (point.norm() - 4.0).abs() < 1e-3));
    (0..8).for_each(|orientation| bench.say_as((1, 196), &MavMessage::DISTANCE_SENSOR(wide(orientation))));
    bench.companion.drop_obstacles();
    (0..8).for_each(|orientation| bench.say_as((1, 196), &MavMessage::DISTANCE_SENSOR(wide(orientation))));
    let (scan, points) = bench.take_obstacles();
    assert_eq!(points, None);
    let scan = scan.unwrap();
    assert_eq!(scan.turn(), Some(72));
    assert!(scan.rays.iter().all(|ray| ray == Sector::Hit(4.0)));
    // Up is no obstacle, and who looks there has not seen any.
    let sources = bench.companion.obstacle_sources(bench.now()).count();
    bench.say_as((1, 9), &MavMessage::DISTANCE_SENSOR(DISTANCE_SENSOR_DATA { orientation: 24, ..wide(0) }));
    assert_eq!(bench.companion.obstacle_sources(bench.now()).count(), sources);
}

/// A direction that was told once and is missing in a turn is unknown, whoever else has a beam.
#[test]
fn a_beam_of_another_component_does_not_make_a_missing_direction_of_ardupilot_clear() {
    let mut bench = Bench::new(Config::default());
    bench.say(&MavMessage::HEARTBEAT(heartbeat(ARDUPILOT, GUIDED, ARMED)));
    bench.step(10_000);
    let wide = |orientation, id| match beam(orientation, 300) {
        MavMessage::DISTANCE_SENSOR(narrow) => {
            MavMessage::DISTANCE_SENSOR(DISTANCE_SENSOR_DATA { id, horizontal_fov: 0.0, ..narrow })
        }
        _ => unreachable!(),
    };
    (0..8).for_each(|orientation| bench.say(&wide(orientation, 10 + orientation)));
    assert!(bench.take_scan().unwrap().rays.iter().all(|ray| ray == Sector::Hit(3.0)));
    bench.companion.drop_obstacles();
    bench.say_as((1, 158), &wide(0, 0));
    // The other one falls silent, and the next turn begins.
    bench.step(1_100_000);
    bench.companion.drop_obstacles();
    for orientation in [0, 1, 2, 3, 4, 6, 7, 0] {
        bench.step(10_000);
        bench.say(&wide(orientation, 10 + orientation));
    }
    let scan = bench.take_scan().unwrap();
    let count = |sector| scan.rays.iter().filter(|ray| *ray == sector).count();
    assert_eq!((count(Sector::Hit(3.0)), count(Sector::Clear)), (63, 0));
}

#[test]
fn a_beam_that_sees_nothing_is_a_word_and_one_that_does_not_look_ahead_or_does_not_read_is_none() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    for silent in [beam(25, 300), beam(24, 300), beam(0, 5), beam(0, 0)] {
        bench.say(&silent);
        assert_eq!(bench.take_points(), None, "{silent:?}");
    }
    bench.say(&beam(0, 801));
    assert_eq!(bench.take_points().map(|points| points.points_m.len()), Some(0));
    bench.say(&point(f32::NAN, 0.0));
    assert_eq!((bench.take_points(), bench.companion.counters().rejected), (None, 1));
}

#[test]
fn points_are_bounded_and_dropped_when_they_are_old() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    for k in 0..100 {
        bench.say(&point(1.0 + 0.01 * k as f32, 0.0));
    }
    assert_eq!(bench.take_points().unwrap().points_m.len(), 72);
    bench.say(&beam(0, 300));
    bench.run(0.6);
    assert_eq!(bench.take_points(), None);
}

#[test]
fn two_sensors_take_turns_and_each_has_an_age_of_its_own() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    let taken: Vec<f32> = (0..6)
        .map(|_| {
            bench.now_us += 20_000;
            for (component, increment) in [(154, 5), (158, 10)] {
                let MavMessage::OBSTACLE_DISTANCE(mut data) = obstacles(12) else { panic!() };
                data.increment = increment;
                bench.say_as((1, component), &MavMessage::OBSTACLE_DISTANCE(data));
            }
            bench.take_scan().unwrap().step_rad.to_degrees().round()
        })
        .collect();
    assert_eq!(taken, [10.0, 5.0, 10.0, 5.0, 10.0, 5.0]);
    bench.now_us += 1_000_000;
    bench.say_as((1, 158), &obstacles(12));
    let now = Instant(bench.now_us + 500_000);
    let ages: Vec<(u8, u16, f32)> = bench
        .companion
        .obstacle_sources(now)
        .map(|(source, age)| (source.component_id, source.message_id, age))
        .collect();
    assert_eq!(ages, [(154, 330, 1.5), (158, 330, 0.5)]);
}

#[test]
fn who_tells_the_autopilot_of_obstacles_does_not_hear_them_back() {
    for surroundings in [false, true] {
        let mut bench = Bench::new(Config { surroundings, ..Config::default() });
        bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
        bench.step(10_000);
        bench.say(&beam(0, 200));
        assert_eq!(bench.take_points().is_some(), !surroundings, "the autopilot's");
        bench.say_as((1, 158), &beam(0, 200));
        assert!(bench.take_points().is_some(), "another's");
        // The ground is no obstacle that we could have reported.
        bench.say(&attitude(1, 0.0));
        bench.say(&beam(25, 200));
        assert!(bench.companion.height_m(bench.now()).is_some());
    }
}

#[test]
fn what_the_autopilot_tells_again_of_another_components_sensor_is_not_heard() {
    for autopilot in [ARDUPILOT, PX4] {
        let mut bench = Bench::new(Config::default());
        bench.heartbeat = Some(heartbeat(autopilot, 0, DISARMED));
        bench.step(10_000);
        // A ring of eight beams, each of which the autopilot repeats: to ArduPilot, what no beam has seen is free.
        let told = |id: u8, orientation: u8| {
            let MavMessage::DISTANCE_SENSOR(beam) = beam(orientation, 200) else { panic!() };
            MavMessage::DISTANCE_SENSOR(DISTANCE_SENSOR_DATA { id, horizontal_fov: 0.0, ..beam })
        };
        for _ in 0..3 {
            for orientation in 0..8 {
                bench.say_as((1, 158), &told(0, orientation));
                bench.say(&told(10 + orientation, orientation));
            }
            bench.step(100_000);
        }
        let scan = bench.take_scan().unwrap();
        assert!(scan.rays.iter().all(|ray| matches!(ray, Sector::Hit(_))), "{scan:?}");
        assert!(bench.companion.obstacle_sources(bench.now()).all(|(source, _)| source.component_id == 158));
        // The sensor has failed. What the autopilot sees itself counts from now on.
        bench.step(1_100_000);
        while bench.take_points().is_some() {}
        bench.say(&told(0, 0));
        assert!(bench.take_points().is_some());
    }
}
