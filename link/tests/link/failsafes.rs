//! The rows of the table in `foxhound_link::failsafe`, one by one, against both autopilots.

use foxhound_core::guidance::mission::{Control, Outcome};
use foxhound_link::companion::Config;
use foxhound_link::dialect::*;
use foxhound_link::failsafe::Cause;

use crate::bench::*;

/// In the mode, armed, in the air, with position and attitude at 50 Hz; a setpoint is published at every step.
pub(crate) struct Flight {
    pub(crate) bench: Bench,
    /// As the autopilot says them.
    pub(crate) position: [f32; 3],
    pub(crate) yaw: f32,
    pub(crate) position_is_silent: bool,
}

impl Flight {
    pub(crate) fn of(autopilot: u8) -> Self {
        Self::with(autopilot, Config::default())
    }

    /// Before the first step.
    fn new(autopilot: u8, config: Config) -> Self {
        let mut bench = Bench::new(config);
        bench.answers = true;
        bench.heartbeat = Some(heartbeat(autopilot, if autopilot == PX4 { OFFBOARD } else { GUIDED }, ARMED));
        bench.output = Some(output([1.0, -0.5, -0.25], 0.125));
        Self { bench, position: [10.0, 20.0, -5.0], yaw: 0.5, position_is_silent: false }
    }

    pub(crate) fn with(autopilot: u8, config: Config) -> Self {
        let mut flight = Self::new(autopilot, config);
        flight.bench.step(10_000);
        flight.bench.say(&extended(2));
        flight.run(1.0);
        assert_eq!(flight.cause(), Cause::None);
        flight
    }

    pub(crate) fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 50.0).round() as u32 {
            let time_boot_ms = (self.bench.now_us / 1000) as u32;
            if !self.position_is_silent {
                let [x, y, z] = self.position;
                let data = LOCAL_POSITION_NED_DATA { time_boot_ms, x, y, z, ..LOCAL_POSITION_NED_DATA::DEFAULT };
                self.bench.say(&MavMessage::LOCAL_POSITION_NED(data));
            }
            self.bench.say(&attitude(time_boot_ms, self.yaw));
            self.bench.step(20_000);
        }
    }

    /// The pilot leaves the mode, in this way, and enters it again.
    pub(crate) fn enter_afresh(&mut self, leave: fn(&mut HEARTBEAT_DATA)) {
        let in_mode = self.bench.heartbeat.clone().unwrap();
        let mut left = in_mode.clone();
        leave(&mut left);
        self.bench.heartbeat = Some(left);
        self.run(1.1);
        self.bench.heartbeat = Some(in_mode);
        self.run(1.1);
    }

    pub(crate) fn cause(&self) -> Cause {
        self.bench.companion.cause(self.bench.now())
    }

    /// The setpoints of the next while.
    pub(crate) fn setpoints(&mut self, seconds: f64) -> Vec<[f32; 4]> {
        self.bench.take_sent();
        self.run(seconds);
        self.bench.setpoints().iter().map(|(_, setpoint)| velocity(setpoint)).collect()
    }

    pub(crate) fn assert_zero(&mut self, cause: Cause) {
        assert_eq!(self.cause(), cause);
        let setpoints = self.setpoints(1.0);
        assert_eq!(setpoints, [ZERO; 20], "{cause:?}");
        assert_eq!(self.bench.companion.control(self.bench.now()), Control::NotInControl);
    }

    pub(crate) fn assert_silent(&mut self, cause: Cause) {
        assert_eq!(self.cause(), cause);
        assert_eq!(self.setpoints(1.0).len(), 0, "{cause:?}");
    }

    pub(crate) fn assert_flies(&mut self) {
        assert_eq!(self.cause(), Cause::None);
        self.run(0.1);
        assert_eq!(self.setpoints(1.0), [[1.0, -0.5, -0.25, 0.125]; 20]);
    }

    /// The state in the heartbeats of the next 1.1 s; `None` if there is none.
    pub(crate) fn status(&mut self) -> Option<u8> {
        self.bench.take_sent();
        self.run(1.1);
        self.bench.take_sent().into_iter().rev().find_map(|sent| match sent.message {
            MavMessage::HEARTBEAT(heartbeat) => Some(heartbeat.system_status),
            _ => None,
        })
    }

    pub(crate) fn texts(&mut self, seconds: f64) -> Vec<String> {
        self.bench.take_sent();
        self.run(seconds);
        texts(&mut self.bench).into_iter().map(|(_, text)| text).collect()
    }
}

pub(crate) const BOTH: [u8; 2] = [ARDUPILOT, PX4];

fn command(command: u16, param1: f32) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        target_system: 1,
        target_component: 191,
        command,
        param1,
        ..COMMAND_LONG_DATA::DEFAULT
    })
}

#[test]
fn none_guidance_flies_and_the_heartbeat_says_active() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        flight.assert_flies();
        assert_eq!(flight.status(), Some(4));
        assert_eq!(flight.bench.companion.control(flight.bench.now()), Control::Granted);
    }
}

#[test]
fn unfit_setpoints_that_stay_insane_end_the_stream_and_the_heartbeats_until_a_fresh_entry() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        flight.bench.output = Some(output([f32::NAN, 0.0, 0.0], 0.0));
        assert!(flight.setpoints(0.5).iter().all(|velocity| *velocity == ZERO), "zero at first");
        flight.run(0.1);
        flight.assert_silent(Cause::Unfit);
        assert_eq!(flight.status(), None);
        flight.bench.output = Some(output([1.0, -0.5, -0.25], 0.125));
        flight.run(0.1);
        flight.assert_zero(Cause::EntryNeeded);
        flight.enter_afresh(|heartbeat| heartbeat.base_mode = DISARMED);
        flight.assert_flies();
    }
}

#[test]
fn unfit_a_guidance_that_is_silent_ends_the_heartbeats_and_so_does_the_application() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        flight.bench.output = None;
        flight.run(2.1);
        flight.assert_silent(Cause::Unfit);
        assert_eq!(flight.status(), None);

        let mut flight = Flight::of(autopilot);
        flight.bench.companion.fail();
        flight.assert_silent(Cause::Unfit);
        assert_eq!(flight.status(), None);
        flight.run(10.0);
        flight.assert_silent(Cause::Unfit);
    }
}

#[test]
fn no_autopilot_there_is_nobody_to_command() {
    let mut bench = Bench::new(Config::default());
    bench.output = Some(output([1.0; 3], 0.0));
    bench.run(3.0);
    assert_eq!(bench.companion.cause(bench.now()), Cause::NoAutopilot);
    assert_eq!(bench.companion.control(bench.now()), Control::LinkLost);
    assert_eq!(bench.setpoints().len(), 0);
}

#[test]
fn link_quiet_then_lost_zero_then_silence_then_a_fresh_entry() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        let in_mode = flight.bench.heartbeat.take();
        flight.run(2.6);
        assert_eq!(flight.cause(), Cause::LinkQuiet);
        assert_eq!(flight.setpoints(1.0), [ZERO; 20]);
        flight.run(1.6);
        flight.assert_silent(Cause::LinkLost);
        assert_eq!(flight.bench.companion.control(flight.bench.now()), Control::LinkLost);
        assert_eq!(flight.status(), Some(3), "our own heartbeats go on");
        flight.bench.heartbeat = in_mode;
        flight.run(0.1);
        flight.bench.say(&extended(2));
        flight.assert_zero(Cause::EntryNeeded);
    }
}

#[test]
fn not_in_mode_motion_stops_with_the_first_heartbeat_and_only_px4_is_prestreamed() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        flight.bench.say(&MavMessage::HEARTBEAT(heartbeat(autopilot, 5, ARMED)));
        flight.bench.heartbeat = Some(heartbeat(autopilot, 5, ARMED));
        assert_eq!(flight.cause(), Cause::NotInMode);
        let setpoints = flight.setpoints(1.0);
        assert_eq!(setpoints, if autopilot == PX4 { vec![ZERO; 20] } else { vec![] });
        assert_eq!(flight.status(), Some(3));
        assert!(flight.texts(2.0).is_empty(), "told once");
    }
}

#[test]
fn on_ground_and_in_a_take_off_nothing_disturbs_ardupilot_and_px4_gets_zeros() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        for state in [1, 3] {
            flight.bench.say(&extended(state));
            assert_eq!(flight.cause(), Cause::OnGround);
            let setpoints = flight.setpoints(1.0);
            assert_eq!(setpoints, if autopilot == PX4 { vec![ZERO; 20] } else { vec![] }, "state {state}");
        }
        for state in [2, 4, 0, 77] {
            flight.bench.say(&extended(state));
            flight.assert_flies();
        }
    }
}

const RC_RECEIVER: u32 = 1 << 16;
const GEOFENCE: u32 = 1 << 20;

/// The parts of the autopilot that there are, and those that are well.
fn parts(present: u32, healthy: u32) -> MavMessage {
    MavMessage::SYS_STATUS(SYS_STATUS_DATA {
        onboard_control_sensors_present: present,
        onboard_control_sensors_health: healthy,
        battery_remaining: -1,
        ..SYS_STATUS_DATA::DEFAULT
    })
}

#[test]
fn switched_off_the_pilots_switch_stops_and_starts_and_its_silence_stops() {
    let channels = |chan7_raw, chancount| {
        MavMessage::RC_CHANNELS(RC_CHANNELS_DATA { chan7_raw, chancount, ..RC_CHANNELS_DATA::DEFAULT })
    };
    for autopilot in BOTH {
        let mut flight = Flight::new(autopilot, Config { switch_channel: 7, ..Config::default() });
        flight.run(1.0);
        flight.assert_zero(Cause::SwitchedOff);
        flight.bench.say(&channels(1900, 8));
        flight.assert_flies();
        flight.bench.say(&channels(1100, 8));
        flight.assert_zero(Cause::SwitchedOff);
        flight.bench.say(&channels(1900, 8));
        assert_eq!(flight.cause(), Cause::None);
        flight.run(2.1);
        flight.assert_zero(Cause::SwitchedOff);
        for (pulse, count) in [(0, 8), (u16::MAX, 8), (700, 8), (1900, 6)] {
            flight.bench.say(&channels(pulse, count));
            assert_eq!(flight.cause(), Cause::SwitchedOff, "no signal is not on: {pulse} of {count}");
        }
        // ArduPilot repeats the last pulses when the transmitter is gone, and says only here that it is.
        // PX4 says then that there is no receiver. One that never had any may still report channels.
        flight.bench.say(&channels(1900, 8));
        flight.bench.say(&parts(0, 0));
        assert_eq!(flight.cause(), Cause::None);
        let (well, none) = ((RC_RECEIVER, RC_RECEIVER), (0, 0));
        for ((present, healthy), cause) in [
            (well, Cause::None),
            ((RC_RECEIVER, 0), Cause::SwitchedOff),
            (well, Cause::None),
            (none, Cause::SwitchedOff),
        ] {
            flight.bench.say(&parts(present, healthy));
            flight.bench.say(&channels(1900, 8));
            assert_eq!(flight.cause(), cause);
        }
    }
}

#[test]
fn paused_by_a_command_until_told_to_go_on_or_the_mode_is_entered_afresh() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        flight.bench.say_as((255, 190), &command(193, 0.0));
        flight.assert_zero(Cause::Paused);
        assert_eq!(flight.status(), Some(3));
        flight.bench.say_as((255, 190), &command(193, 1.0));
        flight.assert_flies();
        flight.bench.say_as((255, 190), &command(193, 0.0));
        flight.enter_afresh(|heartbeat| heartbeat.custom_mode = 5);
        flight.assert_flies();
        flight.bench.take_sent();
        for value in [f32::NAN, 2.0, -1.0] {
            flight.bench.say_as((255, 190), &command(193, value));
            assert_eq!(flight.cause(), Cause::None, "{value}");
        }
    }
}

pub(crate) fn battery(id: u8, charge_state: u8, battery_remaining: i8) -> MavMessage {
    MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
        id,
        charge_state,
        battery_remaining,
        ..BATTERY_STATUS_DATA::DEFAULT
    })
}

#[test]
fn battery_critical_holds_and_says_so() {
    for autopilot in BOTH {
        for state in [3, 4, 5, 6] {
            let mut flight = Flight::of(autopilot);
            flight.bench.say(&battery(1, state, 50));
            flight.bench.say(&battery(0, 1, 90));
            assert_eq!(flight.texts(1.5), ["Foxhound: battery critical, holds"]);
            flight.assert_zero(Cause::BatteryCritical);
            assert_eq!(flight.status(), Some(5));
            flight.bench.say(&battery(1, 1, 50));
            flight.assert_flies();
        }
        let mut flight = Flight::with(autopilot, Config { battery_min_percent: 20.0, ..Config::default() });
        for unknown in [-1, 101, -128] {
            flight.bench.say(&battery(0, 0, unknown));
            flight.assert_flies();
        }
        flight.bench.say(&battery(0, 0, 20));
        flight.assert_flies();
        flight
            .bench
            .say(&MavMessage::SYS_STATUS(SYS_STATUS_DATA { battery_remaining: 19, ..SYS_STATUS_DATA::DEFAULT }));
        flight.assert_zero(Cause::BatteryCritical);
    }
}

#[test]
fn battery_low_lets_a_search_go_on_and_does_not_begin_one() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        flight.bench.say(&battery(0, 2, 25));
        flight.assert_flies();
        flight.enter_afresh(|heartbeat| heartbeat.custom_mode = 5);
        flight.assert_zero(Cause::BatteryLow);
        flight.bench.say(&battery(0, 1, 90));
        flight.assert_flies();
    }
}

#[test]
fn fence_breached_holds_while_the_autopilot_says_so() {
    let fence =
        |breach_status| MavMessage::FENCE_STATUS(FENCE_STATUS_DATA { breach_status, ..FENCE_STATUS_DATA::DEFAULT });
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        flight.bench.say(&fence(1));
        flight.assert_zero(Cause::FenceBreached);
        flight.bench.say(&fence(0));
        flight.assert_flies();
        // ArduPilot says no more of a fence that is switched off, but counts it as well.
        flight.bench.say(&fence(1));
        flight.bench.say(&parts(GEOFENCE, 0));
        flight.assert_zero(Cause::FenceBreached);
        flight.bench.say(&parts(GEOFENCE, GEOFENCE));
        flight.assert_flies();
    }
}

#[test]
fn link_noisy_a_fifth_of_damaged_frames_holds_and_a_twentieth_is_told() {
    let damage = |flight: &mut Flight, every: u32| {
        for step in 0..250 {
            flight.run(0.02);
            if step % every == 0 {
                // A whole frame with a flipped bit.
                let mut frame = [0; foxhound_link::framer::FRAME_MAX];
                let header = foxhound_link::framer::Header { system_id: 1, component_id: 1, sequence: 0 };
                let length = foxhound_link::framer::encode(header, &extended(2), &mut frame);
                frame[11] ^= 1;
                flight.bench.companion.receive(flight.bench.now(), &frame[..length]);
            }
        }
    };
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        flight.bench.take_sent();
        damage(&mut flight, 6);
        assert_eq!(flight.cause(), Cause::None, "8 %");
        let told: Vec<String> = texts(&mut flight.bench).into_iter().map(|(_, text)| text).collect();
        assert_eq!(told, ["Foxhound: frames arrive damaged"]);
        damage(&mut flight, 1);
        assert_eq!(flight.cause(), Cause::LinkNoisy);
        assert_eq!(flight.setpoints(0.2), [ZERO; 4]);
        flight.run(4.1);
        flight.assert_flies();
    }
}

#[test]
fn ownship_lost_guidance_gets_none_and_after_two_seconds_setpoints_end() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        flight.position_is_silent = true;
        flight.run(2.4);
        assert_eq!(flight.cause(), Cause::None, "guidance itself holds for a stale position");
        flight.run(0.2);
        flight.assert_silent(Cause::OwnshipLost);
        assert_eq!(flight.status(), Some(5));
        flight.position_is_silent = false;
        flight.run(0.1);
        flight.assert_flies();
    }
}

#[test]
fn ownship_lost_an_estimator_that_does_not_know_counts_like_silence() {
    let good = 1 | 2 | 8;
    for autopilot in BOTH {
        let say = |flight: &mut Flight, flags| {
            let report = if autopilot == PX4 {
                MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA { flags, ..ESTIMATOR_STATUS_DATA::DEFAULT })
            } else {
                MavMessage::EKF_STATUS_REPORT(EKF_STATUS_REPORT_DATA { flags, ..EKF_STATUS_REPORT_DATA::DEFAULT })
            };
            flight.bench.say(&report);
        };
        // PX4 tells a constant position of every vehicle at rest on the ground as well: there the other flags decide.
        let constant = if autopilot == PX4 { 1 | 128 } else { good | 128 };
        for bad in [0, 2 | 8, 1 | 8, 1 | 2, constant] {
            let mut flight = Flight::of(autopilot);
            say(&mut flight, good);
            flight.assert_flies();
            say(&mut flight, bad);
            assert_eq!(flight.bench.companion.ownship(), None, "{bad}");
            flight.run(2.1);
            flight.assert_silent(Cause::OwnshipLost);
            say(&mut flight, 1 | 2 | 16);
            flight.run(0.1);
            flight.assert_flies();
        }
    }
    let mut flight = Flight::of(PX4);
    let flags = good | 128;
    flight.bench.say(&MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA { flags, ..ESTIMATOR_STATUS_DATA::DEFAULT }));
    flight.run(2.1);
    flight.assert_flies();
}

#[test]
fn after_seconds_without_a_position_guidance_remembers_nothing() {
    for autopilot in BOTH {
        for (silent_s, is_lost) in [(1.5, false), (2.5, true)] {
            let mut flight = Flight::of(autopilot);
            flight.run(1.0);
            flight.position_is_silent = true;
            flight.run(silent_s);
            assert!(!flight.bench.companion.take_world_lost());
            flight.position_is_silent = false;
            flight.run(0.1);
            assert_eq!(flight.bench.companion.take_world_lost(), is_lost);
            assert!(!flight.bench.companion.take_world_lost());
        }
    }
}

#[test]
fn a_restart_of_the_autopilot_needs_a_fresh_entry_and_ends_what_guidance_knew() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        // A turn of the heading before, of which nothing is left.
        flight.yaw += 1.0;
        flight.run(1.0);
        assert!(!flight.bench.companion.take_world_lost());
        // It comes back in the mode and armed, at its new origin; the clock starts over.
        let data = LOCAL_POSITION_NED_DATA { time_boot_ms: 900, ..LOCAL_POSITION_NED_DATA::DEFAULT };
        flight.bench.say(&MavMessage::LOCAL_POSITION_NED(data));
        assert_eq!(flight.bench.companion.counters().reboots, 1);
        assert!(flight.bench.companion.take_world_lost() && !flight.bench.companion.take_world_lost());
        assert_eq!(flight.bench.companion.control(flight.bench.now()), Control::NotInControl);
        for step in 0..60 {
            let time_boot_ms = 1000 + step * 20;
            let data = LOCAL_POSITION_NED_DATA { time_boot_ms, ..LOCAL_POSITION_NED_DATA::DEFAULT };
            flight.bench.say(&MavMessage::LOCAL_POSITION_NED(data));
            flight.bench.say(&attitude(time_boot_ms, 0.25));
            flight.bench.step(20_000);
        }
        assert_eq!(flight.cause(), Cause::EntryNeeded);
        let after = flight.bench.companion.ownship().unwrap();
        assert_eq!((after.position_ned_m.north, after.position_ned_m.east, after.yaw_rad), (0.0, 0.0, 0.25));
    }
}

#[test]
fn a_silence_that_nobody_polled_through_needs_a_fresh_entry_too() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        flight.bench.now_us += 20_000_000;
        let data = flight.bench.heartbeat.clone().unwrap();
        flight.bench.say(&MavMessage::HEARTBEAT(data));
        flight.run(0.1);
        assert_eq!(flight.cause(), Cause::EntryNeeded);
    }
}

#[test]
fn a_pause_outside_the_mode_is_refused_since_it_would_be_forgotten() {
    let mut bench = Bench::flying();
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 5, ARMED));
    bench.step(10_000);
    bench.take_sent();
    bench.say_as((255, 190), &command(193, 0.0));
    bench.drain();
    let result = bench.take_sent().into_iter().find_map(|sent| match sent.message {
        MavMessage::COMMAND_ACK(ack) => Some(ack.result),
        _ => None,
    });
    assert_eq!(result, Some(1));
}

#[test]
fn what_is_bad_does_not_get_good_by_silence() {
    let mut flight = Flight::of(ARDUPILOT);
    flight.bench.say(&MavMessage::FENCE_STATUS(FENCE_STATUS_DATA { breach_status: 1, ..FENCE_STATUS_DATA::DEFAULT }));
    flight.run(30.0);
    flight.assert_zero(Cause::FenceBreached);
    let mut flight = Flight::of(ARDUPILOT);
    flight.bench.say(&MavMessage::EKF_STATUS_REPORT(EKF_STATUS_REPORT_DATA::DEFAULT));
    flight.run(30.0);
    flight.assert_silent(Cause::OwnshipLost);
}

#[test]
fn warnings_do_not_hide_what_we_do() {
    let mut flight = Flight::of(ARDUPILOT);
    flight.run(2.0);
    flight.bench.take_sent();
    let origin = |latitude| {
        MavMessage::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA { latitude, ..GPS_GLOBAL_ORIGIN_DATA::DEFAULT })
    };
    flight.bench.say(&battery(0, 3, 5));
    for flap in 0..6 {
        flight.bench.say(&origin(100 * flap));
        flight.run(0.6);
    }
    let told: Vec<String> = texts(&mut flight.bench).into_iter().map(|(_, text)| text).collect();
    assert!(told.contains(&"Foxhound: battery critical, holds".to_owned()), "{told:?}");
    assert!(told.contains(&"Foxhound: position or heading jumped".to_owned()), "{told:?}");
}

#[test]
fn an_outcome_that_lasts_is_told_again() {
    let lasting = [
        (Outcome::NoSignal, 30.0, "Foxhound: no signal for 30 s, take over"),
        (Outcome::StaleObstacles, 15.0, "Foxhound: no obstacle data for 15 s, take over"),
    ];
    for (outcome, after_s, text) in lasting {
        let mut flight = Flight::of(ARDUPILOT);
        flight.bench.output.as_mut().unwrap().outcome = outcome;
        flight.run(2.0);
        assert_eq!(flight.texts(after_s - 3.0), [""; 0]);
        assert_eq!(flight.texts(60.0), [text]);
    }
}

#[test]
fn an_autopilot_that_beats_and_never_answers_is_told_of() {
    let mut bench = Bench::new(Config::default());
    bench.heartbeat = Some(heartbeat(PX4, 0, DISARMED));
    bench.run(10.0);
    let told = texts(&mut bench).into_iter().map(|(_, text)| text).collect::<Vec<_>>();
    assert!(told.contains(&"Foxhound: autopilot does not answer; signing?".to_owned()), "{told:?}");
}

#[test]
fn after_a_restart_of_our_own_the_mode_must_be_entered_afresh() {
    for autopilot in BOTH {
        let mut flight = Flight::new(autopilot, Config::default());
        flight.bench.companion.require_entry();
        flight.run(1.0);
        flight.bench.say(&extended(2));
        flight.assert_zero(Cause::EntryNeeded);
        flight.enter_afresh(|heartbeat| heartbeat.base_mode = DISARMED);
        flight.assert_flies();
    }
}

#[test]
fn a_restart_in_a_take_off_sends_ardupilot_nothing_until_it_says_that_it_flies() {
    let mut bench = Bench::new(Config::default());
    bench.companion.require_entry();
    bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
    bench.run(1.0);
    assert!(bench.setpoints().is_empty());
    bench.say(&extended(3));
    bench.run(1.0);
    assert!(bench.setpoints().is_empty());
    bench.say(&extended(2));
    bench.run(1.0);
    assert_eq!(bench.companion.cause(bench.now()), Cause::EntryNeeded);
    assert!(!bench.setpoints().is_empty());
}

/// PX4 leaves OFFBOARD because nobody sends, and enters it again when somebody does: that is no word of its pilot.
#[test]
fn after_a_crash_of_our_own_px4_does_not_hand_control_back_by_itself() {
    let crashed = || {
        let mut flight = Flight::new(PX4, Config::default());
        flight.bench.companion.note_crash();
        flight.run(1.0);
        flight.assert_zero(Cause::EntryNeeded);
        flight
    };
    let leave = |heartbeat: &mut HEARTBEAT_DATA| heartbeat.custom_mode = 4 << 16;
    let mut flight = crashed();
    let in_mode = flight.bench.heartbeat.clone().unwrap();
    let left = flight.bench.heartbeat.as_mut().unwrap();
    (left.custom_mode, left.system_status) = (4 << 16 | 3 << 24, MavState::MAV_STATE_CRITICAL as u8);
    flight.run(1.1);
    assert!(flight.setpoints(2.0).is_empty(), "what PX4 waits for is not sent");
    flight.bench.heartbeat = Some(in_mode);
    flight.run(1.1);
    flight.assert_zero(Cause::EntryNeeded);
    flight.enter_afresh(|heartbeat| heartbeat.base_mode = DISARMED);
    flight.assert_flies();

    let mut flight = crashed();
    flight.bench.say(&command(193, 1.0));
    flight.enter_afresh(leave);
    flight.assert_flies();

    // What is heard first is a script.
    let mut flight = Flight::new(PX4, Config::default());
    flight.bench.companion.note_crash();
    flight.bench.say_as((255, 0), &MavMessage::HEARTBEAT(HEARTBEAT_DATA::DEFAULT));
    leave(flight.bench.heartbeat.as_mut().unwrap());
    flight.run(1.1);
    assert!(flight.setpoints(2.0).is_empty(), "a script's heartbeat says nothing of PX4");
}

/// The mode that PX4's failsafe has chosen is no word of its pilot, and neither is its end.
#[test]
fn a_failsafe_of_px4_lifts_nothing() {
    for cause in [Cause::Paused, Cause::EntryNeeded] {
        for (state, is_lifted) in [(MavState::MAV_STATE_CRITICAL, false), (MavState::MAV_STATE_ACTIVE, true)] {
            let mut flight = Flight::of(PX4);
            if cause == Cause::Paused {
                flight.bench.say(&command(193, 0.0));
            } else {
                flight.bench.companion.require_entry();
            }
            flight.assert_zero(cause);
            let in_mode = flight.bench.heartbeat.clone().unwrap();
            let left = flight.bench.heartbeat.as_mut().unwrap();
            (left.custom_mode, left.system_status) = (4 << 16 | 3 << 24, state as u8);
            flight.run(1.1);
            flight.assert_zero(Cause::NotInMode);
            flight.bench.heartbeat = Some(in_mode);
            flight.run(1.1);
            if is_lifted { flight.assert_flies() } else { flight.assert_zero(cause) }
        }
    }
}

/// ArduCopter flies out of an aircraft's way in a mode of its own and may return to GUIDED, which is no word of its pilot either.
#[test]
fn giving_way_to_an_aircraft_lifts_nothing() {
    for (mode, is_lifted) in [(19, false), (5, true)] {
        let mut flight = Flight::of(ARDUPILOT);
        flight.bench.say(&command(193, 0.0));
        flight.assert_zero(Cause::Paused);
        let in_mode = flight.bench.heartbeat.clone().unwrap();
        flight.bench.heartbeat.as_mut().unwrap().custom_mode = mode;
        flight.run(1.1);
        assert_eq!(flight.cause(), Cause::NotInMode);
        flight.bench.heartbeat = Some(in_mode);
        flight.run(1.1);
        if is_lifted { flight.assert_flies() } else { flight.assert_zero(Cause::Paused) }
    }
}

/// Nor is a gap of the position, in which guidance begins anew: what it had ended is not begun again, nor what it was doing.
#[test]
fn what_had_ended_needs_a_fresh_entry_after_a_failsafe_of_px4_and_after_a_gap() {
    for has_ended in [false, true] {
        let ended = |flight: &mut Flight| {
            if has_ended {
                flight.bench.output.as_mut().unwrap().outcome = Outcome::HandedOver;
                flight.run(1.0);
            }
        };
        let entry = if has_ended { Cause::EntryNeeded } else { Cause::None };

        let mut flight = Flight::of(PX4);
        ended(&mut flight);
        let in_mode = flight.bench.heartbeat.clone().unwrap();
        let left = flight.bench.heartbeat.as_mut().unwrap();
        (left.custom_mode, left.system_status) = (4 << 16 | 3 << 24, MavState::MAV_STATE_CRITICAL as u8);
        flight.bench.output.as_mut().unwrap().outcome = Outcome::NotInControl;
        flight.run(1.1);
        flight.bench.heartbeat = Some(in_mode);
        flight.run(1.1);
        assert_eq!(flight.cause(), entry);

        for autopilot in BOTH {
            for silent_s in [2.1, 4.0] {
                let mut flight = Flight::of(autopilot);
                ended(&mut flight);
                flight.position_is_silent = true;
                flight.run(silent_s);
                flight.position_is_silent = false;
                flight.run(0.1);
                assert!(flight.bench.companion.take_world_lost());
                assert_eq!(flight.cause(), entry, "{silent_s}");
            }
        }
    }
}

/// The link is lost while PX4's failsafe flies.
#[test]
fn a_link_that_was_lost_in_a_failsafe_of_px4_needs_a_fresh_entry() {
    let mut flight = Flight::of(PX4);
    let in_mode = flight.bench.heartbeat.clone().unwrap();
    let mut left = in_mode.clone();
    (left.custom_mode, left.system_status) = (4 << 16 | 3 << 24, MavState::MAV_STATE_CRITICAL as u8);
    flight.bench.heartbeat = Some(left.clone());
    flight.run(1.1);
    flight.bench.heartbeat = None;
    flight.run(6.0);
    for heartbeat in [left, in_mode] {
        flight.bench.heartbeat = Some(heartbeat);
        flight.run(1.1);
    }
    flight.assert_zero(Cause::EntryNeeded);
}

/// The pilot has switched it off; a station changes what the switch is.
#[test]
fn parameters_that_are_changed_in_the_mode_need_a_fresh_entry() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        flight.bench.say(&command(193, 0.0));
        flight.assert_zero(Cause::Paused);
        let values = *flight.bench.companion.parameters();
        flight.bench.companion.set_parameters(values).unwrap();
        flight.bench.say(&command(193, 1.0));
        flight.assert_zero(Cause::EntryNeeded);
        flight.enter_afresh(|heartbeat| heartbeat.custom_mode = 5);
        flight.assert_flies();
    }
}

/// A pause that is asked for in PX4's failsafe holds when it comes back to OFFBOARD.
#[test]
fn a_pause_is_taken_in_a_failsafe_of_px4() {
    let mut flight = Flight::of(PX4);
    let in_mode = flight.bench.heartbeat.clone().unwrap();
    let left = flight.bench.heartbeat.as_mut().unwrap();
    (left.custom_mode, left.system_status) = (4 << 16 | 3 << 24, MavState::MAV_STATE_CRITICAL as u8);
    flight.run(1.1);
    flight.bench.say(&command(193, 0.0));
    flight.bench.heartbeat = Some(in_mode);
    flight.run(1.1);
    flight.assert_zero(Cause::Paused);
}

/// PX4 leaves OFFBOARD for its own failsafe when setpoints end, and zeros would take it back.
#[test]
fn without_a_position_px4_gets_no_zeros_outside_of_offboard_either() {
    let mut flight = Flight::of(PX4);
    flight.position_is_silent = true;
    flight.run(3.0);
    flight.assert_silent(Cause::OwnshipLost);
    let in_mode = flight.bench.heartbeat.clone().unwrap();
    flight.bench.heartbeat.as_mut().unwrap().custom_mode = 4 << 16;
    flight.run(1.1);
    flight.assert_silent(Cause::NotInMode);
    flight.position_is_silent = false;
    flight.run(1.0);
    assert!(!flight.setpoints(1.0).is_empty(), "with a position OFFBOARD can be entered");
    flight.bench.heartbeat = Some(in_mode);
    flight.run(1.1);
    flight.assert_flies();
}

#[test]
fn after_a_crash_of_our_own_one_word_to_continue_ends_a_pause() {
    let mut flight = Flight::of(ARDUPILOT);
    flight.bench.companion.note_crash();
    flight.enter_afresh(|heartbeat| heartbeat.custom_mode = 5);
    for (param1, cause) in [(0.0, Cause::Paused), (1.0, Cause::None)] {
        flight.bench.say(&command(193, param1));
        assert_eq!(flight.cause(), cause);
    }
}

#[test]
fn what_cannot_hover_is_not_commanded() {
    for autopilot in BOTH {
        // A wing, a rover and a tiltrotor.
        for mavtype in [1, 10, 21] {
            let mut flight = Flight::new(autopilot, Config::default());
            flight.bench.heartbeat.as_mut().unwrap().mavtype = mavtype;
            flight.run(1.0);
            assert_eq!(flight.cause(), Cause::NotInMode);
            assert!(flight.setpoints(2.0).is_empty());
        }
    }
}

#[test]
fn a_battery_that_gets_low_on_the_way_is_told_of_once() {
    let mut flight = Flight::of(ARDUPILOT);
    flight.run(2.0);
    flight.bench.say(&battery(0, 2, 25));
    assert_eq!(flight.texts(5.0), ["Foxhound: battery low"]);
}

#[test]
fn a_hole_in_the_autopilots_own_failsafe_is_told_of() {
    let mut bench = Bench::new(Config::default());
    bench.answers = true;
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 0, DISARMED));
    bench.run(1.0);
    let asked = bench.take_sent().into_iter().find_map(|sent| match sent.message {
        MavMessage::PARAM_REQUEST_READ(request) => Some(request.param_id.to_str().unwrap().to_owned()),
        _ => None,
    });
    assert_eq!(asked.as_deref(), Some("GUID_TIMEOUT"));
    bench.say(&MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
        param_id: "GUID_TIMEOUT".into(),
        param_value: 3.0,
        param_type: 9,
        ..PARAM_VALUE_DATA::DEFAULT
    }));
    bench.run(3.0);
    let told: Vec<String> = texts(&mut bench).into_iter().map(|(_, text)| text).collect();
    assert!(told.contains(&"Foxhound: GUID_TIMEOUT is long, set 1".to_owned()), "{told:?}");
}

#[test]
fn store_damaged_nothing_moves_until_what_was_stored_is_whole_again() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        flight.bench.companion.note_store(true);
        flight.assert_zero(Cause::StoreDamaged);
        flight.bench.companion.note_store(false);
        flight.assert_flies();
    }
}
