//! After every restart, of the autopilot or of ourselves, nothing moves before the mode is entered afresh.

use foxhound_core::base::ownship::Stale;
use foxhound_core::guidance::mission::{Control, Outcome};
use foxhound_core::landing::{self, Stage};
use foxhound_link::companion::Config;
use foxhound_link::dialect::*;
use foxhound_link::failsafe::Cause;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

use crate::bench::*;

/// More than messages may overtake each other by, milliseconds.
const RESTART_MS: u32 = 1_500;

#[test]
fn two_restarts_of_the_autopilot_within_one_heartbeat_still_need_a_fresh_entry() {
    for (autopilot, mode) in [(ARDUPILOT, GUIDED), (PX4, OFFBOARD)] {
        let mut bench = Bench::new(Config::default());
        let in_mode = MavMessage::HEARTBEAT(heartbeat(autopilot, mode, ARMED));
        bench.say(&in_mode);
        bench.step(10_000);
        for time_boot_ms in [60_000, 20_000, 1_000] {
            bench.say(&position(time_boot_ms));
            bench.step(10_000);
        }
        assert_eq!(bench.companion.counters().reboots, 2);
        bench.say(&in_mode);
        assert_eq!(bench.companion.cause(bench.now()), Cause::EntryNeeded);
        bench.say(&MavMessage::HEARTBEAT(heartbeat(autopilot, mode, DISARMED)));
        bench.say(&in_mode);
        assert_eq!(bench.companion.cause(bench.now()), Cause::None, "entered afresh");
    }
}

/// The autopilot's mode, as its pilot and its restarts make it, and whether the companion may move the vehicle.
#[derive(Clone, Copy, Debug, Default)]
struct Model {
    in_mode: bool,
    /// A heartbeat out of the mode was heard since the last restart, or there was none.
    may_enter: bool,
    /// A heartbeat in the mode was heard after that.
    has_entered: bool,
}

impl Model {
    fn beat(&mut self) {
        self.may_enter |= !self.in_mode;
        self.has_entered = self.may_enter && self.in_mode;
    }

    fn restart(&mut self) {
        (self.may_enter, self.has_entered) = (false, false);
    }
}

#[test]
fn whatever_order_heartbeats_and_restarts_come_in_nothing_moves_without_a_fresh_entry() {
    let (mut granted, mut refused, mut restarts) = (0, 0, 0);
    for seed in 0..200 {
        let mut random = Xoshiro128PlusPlus::seed_from_u64(seed);
        let (autopilot, mode) = if seed % 2 == 0 { (ARDUPILOT, GUIDED) } else { (PX4, OFFBOARD) };
        let mut bench = Bench::new(Config::default());
        let mut model = Model { may_enter: true, ..Model::default() };
        let mut boot_ms = 100_000;
        bench.say(&MavMessage::HEARTBEAT(heartbeat(autopilot, mode, DISARMED)));
        bench.say(&position(boot_ms));
        let mut history = Vec::new();
        for _ in 0..400 {
            let deed = random.next_u32() % 16;
            history.push(deed);
            match deed {
                // The pilot.
                0 | 1 => model.in_mode = !model.in_mode,
                // The autopilot restarts, in a mode of its own choice. No restart is seen so soon after another one.
                2..=4 if boot_ms > 2 * RESTART_MS => {
                    boot_ms = RESTART_MS + random.next_u32() % (boot_ms - 2 * RESTART_MS);
                    bench.say(&position(boot_ms));
                    if deed == 4 {
                        model.in_mode = random.next_u32().is_multiple_of(2);
                    }
                    model.restart();
                    restarts += 1;
                }
                5 => {
                    bench.companion.require_entry();
                    model.restart();
                    restarts += 1;
                }
                6..=9 => {
                    boot_ms += random.next_u32() % 5_000;
                    bench.say(&position(boot_ms));
                }
                _ => {
                    let base_mode = if model.in_mode { ARMED } else { DISARMED };
                    bench.say(&MavMessage::HEARTBEAT(heartbeat(autopilot, mode, base_mode)));
                    model.beat();
                }
            }
            bench.step(u64::from(random.next_u32() % 100_000));
            let control = bench.companion.control(bench.now());
            if model.has_entered {
                granted += u32::from(control == Control::Granted);
            } else {
                refused += 1;
                assert_ne!(control, Control::Granted, "seed {seed}: {history:?}");
            }
        }
        // It is never refused for ever.
        for base_mode in [DISARMED, ARMED] {
            bench.say(&MavMessage::HEARTBEAT(heartbeat(autopilot, mode, base_mode)));
            bench.step(10_000);
        }
        assert_eq!(bench.companion.control(bench.now()), Control::Granted, "seed {seed}");
    }
    assert!(granted > 5_000 && refused > 20_000 && restarts > 5_000, "{granted} {refused} {restarts}");
}

#[test]
fn a_descent_that_was_interrupted_is_no_search_at_that_height() {
    for stage in [Stage::Approaching, Stage::SearchingPad, Stage::Centring, Stage::Descending, Stage::Committed] {
        let mut bench = Bench::flying();
        let last = output([0.0; 3], 0.0);
        let landing = Some(landing::Output { stage, demand: Some(Default::default()), ..landing::Output::default() });
        bench.output = Some(foxhound_core::guidance::Output { landing, ..last });
        bench.run(1.0);
        bench.say(&MavMessage::HEARTBEAT(heartbeat(ARDUPILOT, GUIDED, ARMED)));
        // The autopilot is silent for a while.
        bench.heartbeat = None;
        bench.output = Some(foxhound_core::guidance::Output { outcome: Outcome::NotInControl, ..last });
        bench.run(3.0);
        bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
        bench.run(1.5);
        let is_low = stage != Stage::Approaching;
        let cause = if is_low { Cause::EntryNeeded } else { Cause::None };
        assert_eq!(bench.companion.cause(bench.now()), cause, "{stage:?}");
    }
}

#[test]
fn after_a_landing_only_disarming_or_a_fresh_entry_lets_it_search_again() {
    for disarms in [true, false] {
        let mut bench = Bench::flying();
        bench.run(1.0);
        let last = output([0.0; 3], 0.0);
        let landed = foxhound_core::guidance::Output { outcome: Outcome::Landed, ..last };
        bench.output = Some(landed);
        bench.run(1.0);
        bench.say(&extended(1));
        bench.run(1.5);
        assert_eq!(bench.companion.cause(bench.now()), Cause::OnGround);
        if disarms {
            bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, DISARMED));
            bench.run(1.5);
            bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
            bench.run(1.5);
        }
        bench.output = Some(foxhound_core::guidance::Output { outcome: Outcome::NotInControl, ..last });
        bench.say(&extended(3));
        bench.run(1.5);
        bench.say(&extended(2));
        bench.run(0.1);
        let cause = if disarms { Cause::None } else { Cause::EntryNeeded };
        assert_eq!(bench.companion.cause(bench.now()), cause, "{disarms}");
    }
}

#[test]
fn what_guidance_has_ended_is_not_begun_again_by_a_hold_of_ours() {
    let pause = |param1| {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_DO_PAUSE_CONTINUE as u16,
            param1,
            target_system: AUTOPILOT.0,
            target_component: 191,
            ..COMMAND_LONG_DATA::DEFAULT
        })
    };
    let ends = [
        (Outcome::GoalUnreachable, None, true),
        (Outcome::HandedOver, None, true),
        (Outcome::Landed, None, true),
        (Outcome::StaleOwnship, Some(Stale::VelocityContradicts), true),
        (Outcome::StaleOwnship, Some(Stale::PositionOld), false),
        (Outcome::Nominal, None, false),
        (Outcome::NoSignal, None, false),
    ];
    for (outcome, stale, is_final) in ends {
        let mut bench = Bench::flying();
        bench.run(1.0);
        let last = output([0.0; 3], 0.0);
        bench.output = Some(foxhound_core::guidance::Output { outcome, stale, ..last });
        bench.run(1.0);
        assert_eq!(bench.companion.cause(bench.now()), Cause::None, "{outcome:?}");
        // The vehicle is held for another reason, and guidance is out of control.
        bench.say(&pause(0.0));
        bench.output = Some(foxhound_core::guidance::Output { outcome: Outcome::NotInControl, ..last });
        bench.run(0.1);
        bench.say(&pause(1.0));
        bench.run(1.0);
        let cause = if is_final { Cause::EntryNeeded } else { Cause::None };
        assert_eq!(bench.companion.cause(bench.now()), cause, "{outcome:?}");
        bench.heartbeat = Some(heartbeat(ARDUPILOT, 5, ARMED));
        bench.run(1.5);
        bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
        bench.run(1.5);
        assert_eq!(bench.companion.cause(bench.now()), Cause::None, "{outcome:?}");
    }
}
