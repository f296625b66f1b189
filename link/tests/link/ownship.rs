//! What the autopilot says of the vehicle.

use foxhound_core::base::time::Instant;
use foxhound_link::dialect::*;

use crate::bench::*;

#[test]
fn ownship_needs_position_and_attitude_of_the_latched_autopilot() {
    let mut bench = Bench::flying();
    bench.say(&position(1));
    bench.say(&attitude(1, 0.0));
    assert_eq!(bench.companion.ownship(), None, "nobody is latched yet");
    bench.step(10_000);
    bench.say_as((2, 1), &position(1));
    bench.say_as((1, 2), &attitude(1, 0.0));
    bench.say(&position(5));
    assert_eq!(bench.companion.ownship(), None);
    bench.step(20_000);
    bench.say(&attitude(7, 0.75));
    let ownship = bench.companion.ownship().unwrap();
    assert_eq!((ownship.position_time, ownship.attitude_time), (Instant(10_010_000), Instant(10_030_000)));
    let (at, speed) = (ownship.position_ned_m, ownship.velocity_ned_mps);
    assert_eq!([at.north, at.east, at.down], [1.0, 2.0, -3.0]);
    assert_eq!([speed.north, speed.east, speed.down], [0.1, 0.2, 0.3]);
    assert_eq!(ownship.yaw_rad, 0.75);
}

#[test]
fn numbers_that_are_not_finite_or_absurd_are_rejected_and_counted() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.say(&position(1));
    bench.say(&attitude(1, 0.5));
    let before = bench.companion.ownship();
    let MavMessage::LOCAL_POSITION_NED(good_position) = position(1) else { panic!() };
    let MavMessage::ATTITUDE(good_attitude) = attitude(1, 0.0) else { panic!() };
    let quaternion = ATTITUDE_QUATERNION_DATA { q1: 1.0, ..ATTITUDE_QUATERNION_DATA::DEFAULT };
    let bad = [
        MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA { x: f32::NAN, ..good_position.clone() }),
        MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA { vz: f32::INFINITY, ..good_position.clone() }),
        MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA { y: 1e30, ..good_position }),
        MavMessage::ATTITUDE(ATTITUDE_DATA { yaw: f32::NAN, ..good_attitude.clone() }),
        MavMessage::ATTITUDE(ATTITUDE_DATA { yawspeed: f32::NAN, ..good_attitude.clone() }),
        MavMessage::ATTITUDE(ATTITUDE_DATA { roll: 1e9, ..good_attitude }),
        MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA { q1: 0.0, ..quaternion.clone() }),
        MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA { q2: 0.5, ..quaternion.clone() }),
        MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA { q3: f32::NAN, ..quaternion }),
    ];
    for (index, message) in bad.iter().enumerate() {
        bench.say(message);
        assert_eq!(bench.companion.counters().rejected, index as u32 + 1, "{message:?}");
    }
    assert_eq!(bench.companion.ownship(), before);
}

#[test]
fn quaternions_and_angles_mean_the_same_attitude() {
    for (roll, pitch, yaw) in [(0.0, 0.0, 3.1), (0.3, -0.2, -2.0), (-1.2, 0.9, 0.4), (0.0, 1.4, 1.0)] {
        // Each for a vehicle of its own: from one to the next would be a jump.
        let mut bench = Bench::flying();
        bench.step(10_000);
        bench.say(&position(1));
        // Yaw, then pitch, then roll, in f64.
        let half = |angle: f64| ((angle / 2.0).sin(), (angle / 2.0).cos());
        let ((sr, cr), (sp, cp), (sy, cy)) = (half(roll), half(pitch), half(yaw));
        let data = ATTITUDE_QUATERNION_DATA {
            q1: (cr * cp * cy + sr * sp * sy) as f32,
            q2: (sr * cp * cy - cr * sp * sy) as f32,
            q3: (cr * sp * cy + sr * cp * sy) as f32,
            q4: (cr * cp * sy - sr * sp * cy) as f32,
            ..ATTITUDE_QUATERNION_DATA::DEFAULT
        };
        bench.say(&MavMessage::ATTITUDE_QUATERNION(data));
        let ownship = bench.companion.ownship().unwrap();
        assert!((f64::from(ownship.roll_rad) - roll).abs() < 1e-5);
        assert!((f64::from(ownship.pitch_rad) - pitch).abs() < 1e-5);
        assert!((f64::from(ownship.yaw_rad) - yaw).abs() < 1e-5);
    }
}

#[test]
fn the_yaw_rate_is_that_of_the_yaw_angle() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.say(&position(1));
    // Banked 60 degrees right in a level turn of 0.4 rad/s: the body sees pitch rate 0.4 sin, yaw rate 0.4 cos.
    let (sine, cosine) = 60.0_f32.to_radians().sin_cos();
    let (pitchspeed, yawspeed) = (0.4 * sine, 0.4 * cosine);
    let roll = 60.0_f32.to_radians();
    bench.say(&MavMessage::ATTITUDE(ATTITUDE_DATA { roll, pitchspeed, yawspeed, ..ATTITUDE_DATA::DEFAULT }));
    assert!((bench.companion.ownship().unwrap().yaw_rate_radps - 0.4).abs() < 1e-5);
}
