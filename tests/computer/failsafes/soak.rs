//! A day of link time, and half an hour of the whole computer, with faults all the time.

use foxhound_sim::autopilot::Start;
use foxhound_sim::drive::soak::{Config, Laps, Report, course, fly_laps, keep_link};
use foxhound_sim::drive::trial::{Clocks, Step};
use foxhound_sim::scenario::Software;

use super::stand::{BOTH, Stand, Stream};

const HOUR_US: u64 = 3_600_000_000;
/// Milliseconds of a u32 are over after 49.7 days.
const U32_MS_US: u64 = (1 << 32) * 1_000;

fn kept(software: Software, hours: f64, clocks: Clocks, seed: u64) -> Report {
    let config = Config { software, hours, step_us: 25_000, clocks, seed };
    keep_link(&config, |_| ()).unwrap()
}

fn assert_sound(report: &Report, why: &str) {
    // One at the beginning, one after each second.
    assert!(report.heartbeats.abs_diff(report.seconds) <= 1, "{why}: {report:?}");
    assert!(report.heartbeat_off_us <= 25_000, "{why}: {report:?}");
    assert_eq!((report.setpoints_off_grid, report.setpoints_wrong), (0, 0), "{why}: {report:?}");
    // The age limit, and a step.
    assert!((100_000..=275_000).contains(&report.setpoint_oldest_us), "{why}: {report:?}");
    assert_eq!((report.not_recovered, report.telemetry_off), (0, 0), "{why}: {report:?}");
    assert_eq!(u64::from(report.restarts_counted), report.restarts, "{why}: {report:?}");
}

/// A simulated day of link time with constant faults causes no drift and ends in control.
#[test]
fn a_day_of_link_time_with_faults_all_the_time_drifts_by_nothing_and_ends_in_control() {
    for software in BOTH {
        let report = kept(software, 24.0, Clocks::default(), 1);
        assert_sound(&report, &format!("{software:?}"));
        assert!(report.faults.iter().all(|count| *count > 50), "{report:?}");
        assert!(report.frames > 5_000_000 && report.damaged > 10_000, "{report:?}");
        assert!(report.clock_answers >= report.clock_requests, "{report:?}");
    }
}

/// Clocks that start far ahead change nothing.
#[test]
fn clocks_far_ahead_change_nothing() {
    for software in BOTH {
        // A quarter of a million years of microseconds, and one that has just begun.
        let clocks = Clocks { ours_us: 1 << 63, theirs_us: 0 };
        assert_sound(&kept(software, 0.5, clocks, 2), "ours far ahead");
        let clocks = Clocks { ours_us: U32_MS_US - HOUR_US / 4, theirs_us: 0 };
        assert_sound(&kept(software, 0.5, clocks, 3), "our milliseconds overflow");
    }
}

/// An overflow of the autopilot's millisecond clock in flight is not taken for a restart.
#[test]
fn milliseconds_of_the_autopilot_that_overflow_in_flight_are_no_restart() {
    for software in BOTH {
        let clocks = Clocks { ours_us: U32_MS_US - 14_000_000, theirs_us: U32_MS_US - 15_000_000 };
        let mut stand = Stand::with(software, Start::Hovering, clocks, 1);
        stand.run(2.0);
        stand.get_under_way();
        stand.expect(7.0, Stream::Moving, "both overflow");
        assert!(stand.trial.time_us() > 15_500_000);
        let slowest = stand.steps[stand.steps.len() - 350..].iter().map(Step::speed_mps).fold(1.0, f64::min);
        assert!(slowest > 0.5, "{software:?}: {slowest} m/s");
        stand.expect_beacon("both overflow");
    }
}

/// The whole computer flies back and forth for half an hour with constant faults and touches nothing.
#[test]
fn the_whole_computer_flies_to_and_fro_for_half_an_hour_and_touches_nothing() {
    std::thread::scope(|scope| {
        for software in BOTH {
            scope.spawn(move || {
                let config = Config { software, hours: 0.5, step_us: 20_000, clocks: Clocks::default(), seed: 1 };
                let laps: Laps = fly_laps(&course(), &config, |_| ()).unwrap();
                assert!(!laps.collided && laps.min_clearance_m > 0.0, "{laps:?}");
                assert!(laps.laps > 20 && laps.missed * 10 <= laps.laps, "{laps:?}");
                assert_eq!(laps.setpoints_off_grid, 0, "{laps:?}");
            });
        }
    });
}
