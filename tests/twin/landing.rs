//! The last metres, with the image in QEMU: a camera's frames on its maintenance port.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::Path;

use foxhound_computer::twin::Setup;
use foxhound_core::doa::bearing::Estimator;
use foxhound_core::landing::Stage;
use foxhound_core::planning::planner;
use foxhound_sim::drive::computer::HostComputer;
use foxhound_sim::drive::flight::{self, Mission};
use foxhound_sim::drive::qemu::QemuComputer;
use foxhound_sim::scenario::Scenario;
use foxhound_tests::qemu_image;

fn mission(landing: &str) -> Mission {
    let scenario = Scenario::parse(&format!(
        r#"{{"start":[7.8,7.8],"sensor":{{"model":"scan"}},"bearing":{{"snr_db":20}},"vehicle":{{"model":"arducopter"}},
        "landing":{landing},"goal_tolerance":1.5,"max_time_s":60}}"#
    ))
    .unwrap();
    Mission { scenario, seed: 4, planner: planner::Config::default(), estimator: Estimator::CrossSpectrum }
}

/// The same landing in this process and in the image; how it ended, and whether the hashes are the same.
fn both(mission: &Mission, is_on_line: bool) {
    let mut host = HostComputer::new(&mission.guidance()).unwrap();
    let here = flight::fly(mission, &mut host, None, |_| ()).unwrap().report;
    assert_eq!(here.landing.unwrap().stage, Stage::Landed, "{here:?}");
    let mut twin =
        QemuComputer::start(Path::new(&qemu_image()), &Setup { guidance: mission.guidance(), needs_entry: false })
            .unwrap();
    if is_on_line {
        twin.put_camera_on_line();
    }
    let there = flight::fly(mission, &mut twin, None, |_| ()).unwrap().report;
    assert_eq!((here.trace_hash, here.landing), (there.trace_hash, there.landing));
}

/// The image in QEMU lands exactly as the desktop does, bit for bit.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn the_image_lands_as_the_host_does_bit_for_bit() {
    both(&mission(r#"{"pad":[0.2,0.1]}"#), false);
}

/// Camera frames that arrive over the serial line are used as well.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn frames_that_come_by_the_serial_line_are_seen_as_well() {
    both(&mission(r#"{"height":1.5,"camera":{"width":64,"height":48,"rate_hz":5}}"#), true);
}
