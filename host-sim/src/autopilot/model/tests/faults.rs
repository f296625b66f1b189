//! Faults on order.

use super::super::{Battery, Start};
use super::*;
use crate::scenario::Software;

fn both() -> [Autopilot; 2] {
    [Software::ArduCopter, Software::Px4].map(|software| Autopilot::new(software, Start::InControl))
}

/// Says a message on request and gives it.
fn said(autopilot: &mut Autopilot, id: u32) -> MavMessage {
    autopilot.transmit();
    let motion = autopilot.flight.truth;
    autopilot.receive(0, &motion, &bytes(&command(512, [id as f32, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])));
    heard(autopilot).remove(0).1
}

#[test]
fn after_a_reboot_its_clock_begins_anew_and_streams_mode_and_arming_are_forgotten() {
    for mut autopilot in both() {
        autopilot.receive(0, &eastward(PLACE), &bytes(&command(511, [245.0, 2e4, 0.0, 0.0, 0.0, 0.0, 0.0])));
        autopilot.telemetry(60_000_000, &eastward(PLACE), false);
        autopilot.transmit();
        autopilot.reboot(60_000_000, 3_000_000);
        for tick in 3000..3150 {
            autopilot.telemetry(tick * TICK_US, &eastward(PLACE), false);
            autopilot.receive(
                tick * TICK_US,
                &eastward(PLACE),
                &bytes(&command(511, [32.0, 2e4, 0.0, 0.0, 0.0, 0.0, 0.0])),
            );
        }
        assert!(heard(&mut autopilot).is_empty(), "silent and deaf while it boots");
        autopilot.telemetry(63_000_000, &eastward(PLACE), false);
        let said = heard(&mut autopilot);
        assert_eq!(said[0].0.sequence, 0);
        let Some((_, MavMessage::HEARTBEAT(heartbeat))) = said.first() else { panic!("{said:?}") };
        assert_eq!(heartbeat.base_mode & 128, 0);
        assert_ne!(autopilot.custom_mode, autopilot.companion_mode());
        autopilot.receive(63_000_000, &eastward(PLACE), &bytes(&command(512, [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])));
        let said = heard(&mut autopilot);
        let Some((_, MavMessage::SYSTEM_TIME(time))) = said.first() else { panic!("{said:?}") };
        assert_eq!(time.time_boot_ms, 3000);
    }
}

#[test]
fn a_step_of_the_filter_moves_what_it_says_and_not_the_vehicle() {
    for mut autopilot in both() {
        let is_px4 = autopilot.software() == Software::Px4;
        let before = obey(&mut autopilot, &target(0x05C7, 1));
        autopilot.transmit();
        autopilot.jump(0, [3.0, -4.0, 0.0], !is_px4);
        assert_eq!(autopilot.command(0), before);
        assert_eq!(heard_ids(&mut autopilot), if is_px4 { vec![] } else { vec![49] });
        let MavMessage::LOCAL_POSITION_NED(place) = said(&mut autopilot, 32) else { panic!() };
        assert_eq!([place.x, place.y, place.z], [4.0, -2.0, -5.0]);
        if is_px4 {
            let MavMessage::ODOMETRY(odometry) = said(&mut autopilot, 331) else { panic!() };
            assert_eq!((odometry.reset_counter, odometry.x), (1, 4.0));
        }
        autopilot.jump_yaw(0.3);
        let MavMessage::ATTITUDE(attitude) = said(&mut autopilot, 30) else { panic!() };
        assert!((attitude.yaw - 0.3 - std::f32::consts::FRAC_PI_2).abs() < 1e-6);
        let MavMessage::ATTITUDE_QUATERNION(q) = said(&mut autopilot, 31) else { panic!() };
        assert!((2.0 * q.q4.atan2(q.q1) - attitude.yaw).abs() < 1e-6);
    }
}

#[test]
fn odometry_has_its_velocities_in_the_body() {
    let mut autopilot = Autopilot::new(Software::Px4, Start::InControl);
    let mut motion = eastward(PLACE);
    motion.velocity_ned_mps = [0.0, 2.0, 0.5];
    autopilot.receive(0, &motion, &[]);
    let MavMessage::ODOMETRY(odometry) = said(&mut autopilot, 331) else { panic!() };
    assert!((odometry.vx - 2.0).abs() < 1e-6 && odometry.vy.abs() < 1e-6 && (odometry.vz - 0.5).abs() < 1e-6);
    assert_eq!((odometry.frame_id, odometry.child_frame_id), (1, 12));
}

#[test]
fn silence_and_deafness_last_as_long_as_they_are_set() {
    for mut autopilot in both() {
        autopilot.faults.is_silent = true;
        for tick in 0..250 {
            autopilot.telemetry(tick * TICK_US, &eastward(PLACE), false);
        }
        assert!(heard(&mut autopilot).is_empty());
        (autopilot.faults.is_silent, autopilot.faults.heartbeat_is_silent) = (false, true);
        for tick in 250..300 {
            autopilot.telemetry(tick * TICK_US, &eastward(PLACE), false);
        }
        let ids = heard_ids(&mut autopilot);
        assert!(!ids.contains(&0) && ids.contains(&111), "{ids:?}");
        autopilot.faults.heartbeat_is_silent = false;
        for tick in 300..350 {
            autopilot.telemetry(tick * TICK_US, &eastward(PLACE), false);
        }
        assert_eq!(heard_ids(&mut autopilot).iter().filter(|id| **id == 0).count(), 1, "no beats to catch up with");
        autopilot.faults.is_deaf = true;
        autopilot.receive(7_000_000, &eastward(PLACE), &bytes(&command(31_000, [0.0; 7])));
        assert!(results(&mut autopilot).is_empty());
    }
}

#[test]
fn health_is_told_as_it_is_ordered() {
    for mut autopilot in both() {
        let is_px4 = autopilot.software() == Software::Px4;
        let flags = |autopilot: &mut Autopilot| match said(autopilot, if is_px4 { 230 } else { 193 }) {
            MavMessage::EKF_STATUS_REPORT(report) => report.flags,
            MavMessage::ESTIMATOR_STATUS(status) => status.flags,
            other => panic!("{other:?}"),
        };
        assert_eq!(flags(&mut autopilot) & 0x9A, 0x1A);
        autopilot.faults.filter_is_bad = true;
        assert_eq!(flags(&mut autopilot) & 0x9A, 0x80);
        autopilot.faults.battery = Battery { remaining_percent: 7, charge_state: 3 };
        let MavMessage::BATTERY_STATUS(battery) = said(&mut autopilot, 147) else { panic!() };
        let MavMessage::SYS_STATUS(status) = said(&mut autopilot, 1) else { panic!() };
        assert_eq!((battery.charge_state, battery.battery_remaining, status.battery_remaining), (3, 7, 7));
        autopilot.faults.rc_us[6] = 1900;
        let MavMessage::RC_CHANNELS(channels) = said(&mut autopilot, 65) else { panic!() };
        assert_eq!((channels.chan7_raw, channels.chan8_raw, channels.chancount), (1900, 1500, 18));
        autopilot.faults.rc_is_lost = true;
        let MavMessage::RC_CHANNELS(channels) = said(&mut autopilot, 65) else { panic!() };
        assert_eq!((channels.chan7_raw, channels.chancount), (u16::MAX, 0));
        if !is_px4 {
            autopilot.faults.fence_is_breached = true;
            let MavMessage::FENCE_STATUS(fence) = said(&mut autopilot, 162) else { panic!() };
            assert_eq!(fence.breach_status, 1);
        }
    }
}

#[test]
fn the_landed_state_follows_the_vehicle_and_can_be_ordered() {
    let state = |autopilot: &mut Autopilot| match said(autopilot, 245) {
        MavMessage::EXTENDED_SYS_STATE(state) => state.landed_state,
        other => panic!("{other:?}"),
    };
    let mut flown = Flown::new(Autopilot::new(Software::ArduCopter, Start::Parked), Start::Parked);
    flown.idle(0.1);
    assert_eq!(state(&mut flown.autopilot), 1);
    flown.autopilot.select_mode(flown.now_us(), flown.autopilot.companion_mode());
    assert!(flown.autopilot.arm(flown.now_us()) && flown.autopilot.take_off(flown.now_us(), 3.0));
    flown.idle(1.0);
    assert_eq!(state(&mut flown.autopilot), 3, "taking off");
    flown.idle(6.0);
    assert_eq!(state(&mut flown.autopilot), 2, "in the air");
    flown.autopilot.set_landed(true);
    flown.idle(1.0);
    assert_eq!(state(&mut flown.autopilot), 1, "on order");
    flown.autopilot.set_landed(false);
    flown.autopilot.select_mode(flown.now_us(), 9);
    flown.idle(1.0);
    assert_eq!(state(&mut flown.autopilot), 4, "landing");
    flown.idle(8.0);
    assert_eq!(state(&mut flown.autopilot), 1);
}

#[test]
fn with_a_key_only_signed_frames_count_and_heartbeats() {
    let unsigned = bytes(&target(0x05C7, 1));
    // Signed in form: the flag, and thirteen bytes behind the checksum that the check is asked about.
    let mut signed = bytes(&target(0x05C7, 1));
    signed.truncate(signed.len() - 2);
    signed[2] = 1;
    let mut crc = 0xFFFF_u16;
    // MAVLink's CRC-16/MCRF4XX, with the CRC_EXTRA of message 84.
    for byte in signed[1..].iter().chain(&[143]) {
        let mut tmp = byte ^ (crc & 0xFF) as u8;
        tmp ^= tmp << 4;
        crc = (crc >> 8) ^ (u16::from(tmp) << 8) ^ (u16::from(tmp) << 3) ^ (u16::from(tmp) >> 4);
    }
    signed.extend(crc.to_le_bytes());
    signed.extend([7; 13]);
    let check: fn(&[u8]) -> bool = |frame| frame.ends_with(&[7; 13]);
    let fails: fn(&[u8]) -> bool = |_| false;
    let cases = [
        (false, None, true, true),
        (true, None, false, true),
        (true, Some(check), false, true),
        (true, Some(fails), false, false),
    ];
    for (required, check, takes_unsigned, takes_signed) in cases {
        for (frame, is_taken) in [(&unsigned, takes_unsigned), (&signed, takes_signed)] {
            let mut autopilot = Autopilot::default();
            autopilot.faults.signing_required = required;
            autopilot.faults.signature_check = check;
            autopilot.receive(0, &eastward(PLACE), frame);
            assert_eq!(!autopilot.command(0).is_brake, is_taken, "{required} {takes_signed}");
        }
    }
}

#[test]
fn another_autopilot_beats_beside_it() {
    let mut autopilot = Autopilot::default();
    autopilot.faults.other_system = Some(7);
    for tick in 0..100 {
        autopilot.telemetry(tick * TICK_US, &eastward(PLACE), false);
    }
    let beats: Vec<(u8, u8)> = heard(&mut autopilot)
        .into_iter()
        .filter_map(|(header, message)| {
            matches!(message, MavMessage::HEARTBEAT(_)).then_some((header.system_id, header.sequence))
        })
        .collect();
    assert_eq!(beats, [(1, 0), (7, 0), (1, 1), (7, 1)], "{beats:?}");
}
