//! The rows of the table in `foxhound_link::failsafe` that an autopilot, a pilot or a line can cause.

use foxhound_link::dialect::MavMessage;
use foxhound_sim::autopilot::{Battery, Start, Wire};
use foxhound_sim::drive::trial::{Step, parameter};
use foxhound_sim::scenario::Software;

use super::stand::{BOTH, BRAKES_M, BRAKES_S, Stand, Stream, manual};

const STANDBY: u8 = 3;
const ACTIVE: u8 = 4;
const CRITICAL: u8 = 5;
const LOW: u8 = 2;
const CHARGE_CRITICAL: u8 = 3;
const PAUSE_CONTINUE: u16 = 193;

/// What is streamed outside of the mode.
fn waiting(software: Software) -> Stream {
    match software {
        Software::ArduCopter => Stream::Silent,
        Software::Px4 => Stream::Zero,
    }
}

/// The stream ends: ArduCopter stays in GUIDED, PX4 leaves OFFBOARD after a second of silence (`COM_OF_LOSS_T`), and no zeros take it
/// back.
fn expect_silence_and_its_end(stand: &mut Stand, why: &str) {
    // It may have ended already.
    let from = stand.steps.len() - 100;
    stand.run(4.5);
    assert!(stand.statuses(from).contains(&CRITICAL), "{why}");
    let times_s = stand.steps[from..].iter().filter(|step| step.setpoints().count() > 0).map(Step::time_s);
    let ends_s = stand.steps[stand.steps.len() - 1].time_s();
    let times_s: Vec<f64> = times_s.chain([ends_s]).collect();
    let longest_s =
        times_s.windows(2).map(|pair| pair[1] - pair[0]).fold(times_s[0] - stand.steps[from].time_s(), f64::max);
    assert!(longest_s > 4.0, "{why}: silent for {longest_s} s only");
    let obeyed = stand.steps[stand.steps.len() - 1].obeyed;
    assert_eq!(obeyed, stand.software == Software::ArduCopter, "{why}");
}

/// With nothing wrong, it flies to the beacon and reports that it is active.
#[test]
fn none_it_flies_to_the_beacon_and_says_that_it_is_active() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        assert_eq!((stand.stream_now(), stand.status()), (Stream::Moving, Some(ACTIVE)));
        stand.expect_beacon("nothing");
    }
}

/// It commands nothing before it has heard an autopilot.
#[test]
fn no_autopilot_nothing_is_commanded_before_one_is_heard() {
    for software in BOTH {
        let mut stand = Stand::new(software, Start::Hovering);
        stand.trial.rig.autopilot.faults.is_silent = true;
        stand.expect(5.0, Stream::Silent, "nobody");
        assert_eq!(stand.status(), Some(STANDBY));
        stand.trial.rig.autopilot.faults.is_silent = false;
        stand.run(2.0);
        stand.get_under_way();
    }
}

/// Without heartbeats for 2.5 s it stops, and it continues when they return.
#[test]
fn link_quiet_without_heartbeats_for_two_and_a_half_seconds_it_stops_and_goes_on_when_they_are_back() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        stand.trial.rig.autopilot.faults.heartbeat_is_silent = true;
        // The last one was up to a second ago.
        stand.expect_stand(2.5 + BRAKES_S, 2.5 + BRAKES_M, 4.0, "2.5 s without heartbeats");
        assert_eq!((stand.stream_now(), stand.status()), (Stream::Zero, Some(STANDBY)));
        stand.trial.rig.autopilot.faults.heartbeat_is_silent = false;
        stand.expect_beacon("heartbeats are back");
    }
}

/// Without heartbeats for 5 s it falls silent, and then waits until the mode is entered again.
#[test]
fn link_lost_after_five_seconds_it_is_silent_and_waits_for_a_fresh_entry() {
    for software in BOTH {
        for all in [false, true] {
            let mut stand = Stand::under_way(software);
            let faults = &mut stand.trial.rig.autopilot.faults;
            (faults.heartbeat_is_silent, faults.is_silent) = (true, all);
            // Without any telemetry it stops after 0.3 s, by itself.
            let quiet_s = if all { 0.4 } else { 2.5 };
            stand.expect_stand(quiet_s + BRAKES_S, quiet_s + BRAKES_M, 5.1, "5 s without heartbeats");
            stand.expect(4.0, Stream::Silent, "5 s without heartbeats");
            assert_eq!(stand.status(), Some(STANDBY));
            let faults = &mut stand.trial.rig.autopilot.faults;
            (faults.heartbeat_is_silent, faults.is_silent) = (false, false);
            // ArduCopter is in GUIDED still; PX4 comes back to OFFBOARD by itself, which is no fresh entry.
            stand.run(2.2);
            stand.expect(3.0, Stream::Zero, "a fresh entry is needed");
            stand.expect_stand(0.0, 0.05, 3.0, "a fresh entry is needed");
            stand.enter_afresh();
            stand.expect_beacon("entered afresh");
        }
    }
}

/// Without position telemetry it first stops, then falls silent, and continues when telemetry returns.
#[test]
fn ownship_lost_without_telemetry_it_stops_then_is_silent_and_goes_on() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        stand.trial.ownship_is_silent = true;
        stand.expect_stand(0.4 + BRAKES_S, 0.4 + BRAKES_M, 2.6, "no telemetry");
        expect_silence_and_its_end(&mut stand, "no telemetry for 2 s");
        stand.trial.ownship_is_silent = false;
        stand.expect_beacon("telemetry is back");
    }
}

/// Telemetry that is 1.5 s late stops it for as long as that lasts.
#[test]
fn telemetry_that_is_late_by_a_second_and_a_half_stops_it_for_as_long() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        stand.trial.ownship_is_silent = true;
        // Stale after 0.3 s, and braked at 2 m/s^2.
        stand.run(1.4);
        assert_eq!(stand.stream_now(), Stream::Zero);
        stand.trial.ownship_is_silent = false;
        stand.expect_beacon("telemetry was late");
        assert!(stand.steps.iter().skip(200).all(|step| step.obeyed));
    }
}

/// Estimator flags that say that nothing is known stop it, even if position numbers keep coming.
#[test]
fn estimator_flags_that_say_nothing_is_known_stop_it_though_the_numbers_go_on() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        stand.trial.rig.autopilot.faults.filter_is_bad = true;
        // Said twice a second by ArduPilot, once by PX4.
        stand.expect_stand(1.1 + BRAKES_S, 1.1 + BRAKES_M, 2.9, "bad estimator");
        expect_silence_and_its_end(&mut stand, "bad estimator");
        stand.trial.rig.autopilot.faults.filter_is_bad = false;
        stand.expect_beacon("good estimator");
    }
}

/// When the pilot leaves the mode it gives up control, and it continues when the pilot returns.
#[test]
fn not_in_mode_the_pilot_takes_the_vehicle_and_gives_it_back() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        let now_us = stand.trial.autopilot_us();
        assert!(stand.trial.rig.autopilot.select_mode(now_us, manual(software)));
        stand.expect_stand(BRAKES_S, BRAKES_M, 2.0, "mode taken away");
        stand.expect(3.0, waiting(software), "mode taken away");
        assert_eq!(stand.status(), Some(STANDBY));
        assert!(stand.trial.give_control());
        stand.expect_beacon("mode given back");
    }
}

/// When the pilot disarms it gives up control, and it continues when the pilot arms again.
#[test]
fn not_in_mode_the_pilot_disarms_and_arms_again() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        stand.trial.rig.autopilot.armed = false;
        stand.expect_stand(BRAKES_S, BRAKES_M, 2.0, "disarmed");
        stand.expect(3.0, waiting(software), "disarmed");
        let now_us = stand.trial.autopilot_us();
        assert!(stand.trial.rig.autopilot.arm(now_us));
        stand.expect_beacon("armed again");
    }
}

/// On the ground it waits for the pilot's take-off, then flies, and waits again after a landing.
#[test]
fn on_ground_it_waits_for_the_take_off_that_its_pilot_asks_for_and_then_flies_and_for_the_landing() {
    for software in BOTH {
        let mut stand = Stand::new(software, Start::Parked);
        stand.run(2.0);
        let now_us = stand.trial.autopilot_us();
        if software == Software::ArduCopter {
            assert!(stand.trial.give_control());
        }
        assert!(stand.trial.rig.autopilot.arm(now_us));
        stand.run(1.0);
        stand.expect(2.0, waiting(software), "on the ground");
        let now_us = stand.trial.autopilot_us();
        assert!(stand.trial.rig.autopilot.take_off(now_us, 2.5));
        let height_m = |stand: &Stand| -stand.trial.motion().pose.position_ned_m[2];
        while height_m(&stand) < 2.3 {
            stand.expect(0.1, waiting(software), "taking off");
        }
        if software == Software::Px4 {
            stand.run(2.0);
            assert!(stand.trial.give_control());
        }
        stand.fly_past(7.5);
        assert!(height_m(&stand) > 2.2, "{}", height_m(&stand));

        let mut landing = Stand::under_way(software);
        landing.trial.rig.autopilot.set_landed(true);
        // It says so twice a second. ArduCopter's last setpoint holds for GUID_TIMEOUT, 3 s.
        landing.run(1.0);
        landing.expect(2.0, waiting(software), "landed");
        landing.expect_stand(1.5, 1.5, 3.0, "landed");
        stand.expect_beacon("took off");
    }
}

/// A critical battery makes it hold; a low one only prevents a start.
#[test]
fn battery_critical_it_holds_while_low_only_keeps_it_from_beginning() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        stand.trial.rig.autopilot.faults.battery = Battery { remaining_percent: 20, charge_state: LOW };
        stand.run(3.0);
        assert_eq!(stand.stream_now(), Stream::Moving, "what is under way goes on");
        stand.trial.rig.autopilot.faults.battery = Battery { remaining_percent: 5, charge_state: CHARGE_CRITICAL };
        // Said once a second, by PX4 when it is asked to.
        stand.expect_stand(1.1 + BRAKES_S, 1.1 + BRAKES_M, 4.0, "battery critical");
        stand.expect(10.0, Stream::Zero, "battery critical");
        assert_eq!(stand.status(), Some(CRITICAL));

        let mut stand = Stand::new(software, Start::Hovering);
        stand.trial.rig.autopilot.faults.battery = Battery { remaining_percent: 20, charge_state: LOW };
        stand.run(3.0);
        assert!(stand.trial.give_control());
        stand.run(1.1);
        stand.expect(5.0, Stream::Zero, "battery low before the start");
        assert_eq!(stand.status(), Some(CRITICAL));
        stand.trial.rig.autopilot.faults.battery = Battery::default();
        stand.expect_beacon("another battery");
    }
}

/// A breached fence stops it on ArduPilot, which reports the breach.
#[test]
fn fence_breached_it_stops_on_ardupilot_which_says_so() {
    let mut stand = Stand::under_way(Software::ArduCopter);
    stand.trial.rig.autopilot.faults.fence_is_breached = true;
    stand.expect_stand(1.1 + BRAKES_S, 1.1 + BRAKES_M, 4.0, "fence breached");
    assert_eq!((stand.stream_now(), stand.status()), (Stream::Zero, Some(CRITICAL)));
    stand.trial.rig.autopilot.faults.fence_is_breached = false;
    stand.expect_beacon("inside the fence again");
}

/// A radio channel, selected by a parameter, switches it off and on.
#[test]
fn switched_off_a_channel_that_a_ground_station_names_by_parameter_stops_and_starts_it() {
    for software in BOTH {
        let mut stand = Stand::new(software, Start::Hovering);
        stand.run(2.0);
        stand.trial.set_parameter("FH_RC_CH", 7.0);
        let from = stand.steps.len();
        stand.run(2.0);
        let answers: Vec<f32> = stand.steps[from..].iter().filter_map(|step| parameter(step, "FH_RC_CH")).collect();
        assert_eq!(answers, [7.0], "the ground station is told");
        assert!(stand.trial.give_control());
        // In the middle is off.
        stand.run(1.1);
        stand.expect(2.0, Stream::Zero, "switch in the middle");
        stand.expect_stand(0.0, 0.05, 1.0, "switch in the middle");
        stand.trial.rig.autopilot.faults.rc_us[6] = 1900;
        stand.fly_past(7.5);
        stand.trial.rig.autopilot.faults.rc_us[6] = 1100;
        stand.expect_stand(0.2 + BRAKES_S, 0.2 + BRAKES_M, 4.0, "switched off");
        assert_eq!((stand.stream_now(), stand.status()), (Stream::Zero, Some(STANDBY)));
        stand.trial.rig.autopilot.faults.rc_us[6] = 1900;
        stand.fly_past(12.5);
        stand.trial.rig.autopilot.faults.rc_is_lost = true;
        stand.expect_stand(2.0 + BRAKES_S, 2.0 + BRAKES_M, 5.0, "no switch heard");
        assert_eq!(stand.stream_now(), Stream::Zero);
        stand.trial.rig.autopilot.faults.rc_is_lost = false;
        stand.expect_beacon("switched on");
    }
}

/// A ground station can pause it and let it continue.
#[test]
fn paused_a_ground_station_stops_it_and_lets_it_go_on() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        stand.trial.command(PAUSE_CONTINUE, 0.0);
        stand.expect_stand(BRAKES_S, BRAKES_M, 3.0, "paused");
        stand.expect(10.0, Stream::Zero, "paused");
        assert_eq!(stand.status(), Some(STANDBY));
        stand.trial.command(PAUSE_CONTINUE, 1.0);
        stand.expect_beacon("told to go on");
    }
}

/// A pause outlasts the link, and PX4's coming back to OFFBOARD by itself.
#[test]
fn paused_it_stays_paused_when_the_link_was_lost_meanwhile() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        stand.trial.command(PAUSE_CONTINUE, 0.0);
        stand.run(2.0);
        stand.trial.rig.autopilot.faults.heartbeat_is_silent = true;
        stand.run(8.0);
        assert_eq!(stand.stream_now(), Stream::Silent);
        stand.trial.rig.autopilot.faults.heartbeat_is_silent = false;
        stand.run(4.0);
        stand.expect_stand(0.0, 0.05, 10.0, "paused");
        assert!(stand.steps[stand.steps.len() - 1].obeyed);
        stand.trial.command(PAUSE_CONTINUE, 1.0);
        stand.expect_stand(0.0, 0.05, 3.0, "a fresh entry is needed");
        stand.enter_afresh();
        stand.expect_beacon("entered afresh");
    }
}

/// When more than a fifth of the frames is damaged it stops, until the link is good again.
#[test]
fn link_noisy_when_more_than_a_fifth_of_the_frames_is_damaged_it_stops_until_they_are_not() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        stand.trial.wire = Some(Wire::new(1, 0.0, 0.015));
        // Counted over 2 s, of which the first may be half good.
        stand.expect_stand(4.0 + BRAKES_S, 4.0 + BRAKES_M, 8.0, "noise");
        assert_eq!(stand.stream_now(), Stream::Zero);
        stand.trial.wire = None;
        stand.run(4.0);
        if stand.stream_now() == Stream::Zero {
            // Where the noise took so many heartbeats.
            stand.enter_afresh();
        }
        stand.expect_beacon("no noise");
    }
}

/// After a restart of the autopilot in flight it commands nothing until the mode is entered again.
#[test]
fn entry_needed_an_autopilot_that_restarts_in_flight_is_not_commanded_until_its_mode_is_entered_again() {
    for software in BOTH {
        for moves_frame in [false, true] {
            let mut stand = Stand::under_way(software);
            if moves_frame {
                let now_us = stand.trial.autopilot_us();
                stand.trial.rig.autopilot.jump(now_us, [3.0, -4.0, 0.5], false);
                stand.run(3.0);
            }
            let now_us = stand.trial.autopilot_us();
            stand.trial.rig.autopilot.reboot(now_us, 1_500_000);
            stand.expect_stand(0.4 + BRAKES_S, 0.4 + BRAKES_M, 5.0, "restart");
            assert_eq!(stand.stream_now(), waiting(software));
            let now_us = stand.trial.autopilot_us();
            assert!(stand.trial.give_control() && stand.trial.rig.autopilot.arm(now_us));
            stand.expect_beacon("restarted, and entered again");
        }
    }
}

/// An autopilot that starts up already in the mode receives zero setpoints only.
#[test]
fn entry_needed_an_autopilot_that_wakes_up_in_the_mode_is_sent_zeros() {
    let mut stand = Stand::under_way(Software::ArduCopter);
    let now_us = stand.trial.autopilot_us();
    stand.trial.rig.autopilot.reboot(now_us, 1_000_000);
    let mode = stand.trial.rig.autopilot.companion_mode();
    (stand.trial.rig.autopilot.custom_mode, stand.trial.rig.autopilot.armed) = (mode, true);
    stand.expect_stand(0.4 + BRAKES_S, 0.4 + BRAKES_M, 5.0, "restart in the mode");
    stand.expect(10.0, Stream::Zero, "restart in the mode");
    stand.enter_afresh();
    stand.expect_beacon("entered afresh");
}

/// A second autopilot on the same link changes nothing.
#[test]
fn a_second_autopilot_on_the_link_changes_nothing() {
    for software in BOTH {
        let mut alone = Stand::under_way(software);
        alone.expect_beacon("alone");
        let mut stand = Stand::under_way(software);
        stand.trial.rig.autopilot.faults.other_system = Some(2);
        stand.expect_beacon("a second autopilot");
        assert_eq!(stand.trial.motion(), alone.trial.motion(), "to the bit");
    }
}

/// Without fresh obstacle data it stops, until data arrives again.
#[test]
fn stale_obstacles_stop_it_until_something_is_seen_again() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        stand.trial.obstacles_are_silent = true;
        stand.expect_stand(0.7 + BRAKES_S, 0.7 + BRAKES_M, 4.0, "obstacles stale");
        assert_eq!((stand.stream_now(), stand.status()), (Stream::Zero, Some(CRITICAL)));
        stand.trial.obstacles_are_silent = false;
        stand.expect_beacon("obstacles seen");
    }
}

/// The texts about ownship that the pilot got since a step.
fn told(stand: &Stand, from: usize) -> Vec<String> {
    let messages = stand.steps[from..].iter().flat_map(|step| &step.sent);
    let texts = messages.filter_map(|(_, message)| match message {
        MavMessage::STATUSTEXT(text) => Some(text.text.to_str().unwrap().to_owned()),
        _ => None,
    });
    texts.filter(|text| text.contains("position") || text.contains("velocity")).collect()
}

/// A frozen position, or a velocity that contradicts it, makes it hold, and is reported once.
#[test]
fn stale_ownship_a_position_that_stands_still_and_a_velocity_that_contradicts_it_hold_and_are_told_once() {
    for software in BOTH {
        for is_frozen in [true, false] {
            let mut stand = Stand::under_way(software);
            let from = stand.steps.len();
            if is_frozen {
                let position_ned_m = stand.trial.motion().pose.position_ned_m.map(|metres| metres as f32);
                stand.trial.rig.autopilot.faults.position_ned_m = Some(position_ned_m);
            } else {
                stand.trial.rig.autopilot.faults.velocity_is_backwards = true;
            }
            stand.expect_stand(0.5 + BRAKES_S, 0.5 + BRAKES_M, 20.0, "contradiction");
            assert_eq!((stand.stream_now(), stand.status()), (Stream::Zero, Some(CRITICAL)));
            let why = if is_frozen { "position stands still" } else { "velocity contradicts position" };
            assert_eq!(told(&stand, from), [format!("Foxhound: {why}, holds")]);
            // A contradiction is kept until the mode is entered again, by which time it may have ended.
            let faults = &mut stand.trial.rig.autopilot.faults;
            (faults.position_ned_m, faults.velocity_is_backwards) = (None, false);
            stand.run(2.0);
            assert_eq!(stand.stream_now(), Stream::Zero);
            stand.enter_afresh();
            stand.expect_beacon("mended");
        }
    }
}
