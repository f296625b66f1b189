//! A setpoint ends ArduPilot's take-off: there is none during it, whatever else goes wrong meanwhile.

use foxhound_link::companion::Config;
use foxhound_link::failsafe::Cause;

use crate::bench::*;
use crate::failsafes::{Flight, battery};

const TAKES_OFF: u8 = 3;

#[test]
fn a_heartbeat_that_stays_out_in_a_take_off_ends_nothing() {
    let mut flight = Flight::of(ARDUPILOT);
    flight.bench.say(&extended(TAKES_OFF));
    assert_eq!(flight.cause(), Cause::OnGround);
    flight.bench.take_sent();
    flight.bench.heartbeat = None;
    assert!(flight.setpoints(4.5).is_empty());
}

#[test]
fn nor_does_a_restart_with_a_damaged_record() {
    let mut bench = Bench::new(Config::default());
    bench.companion.require_entry();
    bench.companion.note_store(true);
    bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
    bench.run(1.0);
    assert_eq!(bench.companion.cause(bench.now()), Cause::StoreDamaged);
    assert!(bench.setpoints().is_empty());
    bench.companion.note_store(false);
    bench.heartbeat = None;
    bench.run(4.5);
    assert!(bench.setpoints().is_empty(), "silent before it said what it does");
}

#[test]
fn after_a_lost_link_it_may_have_landed_and_be_taking_off() {
    let mut flight = Flight::of(ARDUPILOT);
    let beat = flight.bench.heartbeat.take();
    flight.run(8.0);
    flight.bench.take_sent();
    flight.bench.heartbeat = beat;
    assert!(flight.setpoints(1.1).is_empty());
    assert_eq!(flight.cause(), Cause::EntryNeeded);
    flight.bench.say(&extended(2));
    assert!(!flight.setpoints(1.0).is_empty());
}

#[test]
fn with_a_low_battery_a_search_goes_on_after_a_short_silence() {
    let mut flight = Flight::of(ARDUPILOT);
    flight.run(2.0);
    flight.bench.say(&battery(0, 2, 25));
    let beat = flight.bench.heartbeat.take();
    flight.run(2.7);
    assert_eq!(flight.cause(), Cause::LinkQuiet);
    flight.bench.heartbeat = beat;
    flight.run(0.1);
    flight.assert_flies();
}
