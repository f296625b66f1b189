//! A path around obstacles: `cargo run --package foxhound-core --example plan`.

use foxhound_core::ConfigError;
use foxhound_core::base::config::{Fence, RangeSensor, Vehicle};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::Disc;
use foxhound_core::planning::planner::{Config, PlanRequest, Verdict, Workspace};

fn main() -> Result<(), ConfigError> {
    let guard_margin_m = 0.03;
    let planner =
        Config::default().build(&Vehicle::default(), &RangeSensor::default(), &Fence::default(), guard_margin_m)?;
    // 33 KB, reused from plan to plan. Firmware has it in a static.
    let mut workspace = Box::new(Workspace::new());
    let source_ned_m = Horizontal { north: 6.0, east: 0.0 };
    let request = PlanRequest {
        seed: 1,
        direction_ned: Horizontal { north: 1.0, east: 0.0 },
        target_ned_m: source_ned_m,
        known_source_ned_m: Some(source_ned_m),
        ..PlanRequest::default()
    };
    let known = [(1.0, 0.1, 0.3), (2.2, -0.5, 0.25)].map(|(north, east, radius_m)| Disc {
        center_ned_m: Horizontal { north, east },
        radius_m,
        ..Disc::default()
    });
    let plan = planner.plan(&mut workspace, &request, &known);
    println!("{:?}, cost {:.3}, gains {:?}", plan.verdict, plan.cost, plan.gains);
    for place in plan.waypoints_ned_m {
        println!("  {:6.3} m north {:6.3} m east", place.north, place.east);
        for pillar in &known {
            assert!(place.minus(pillar.center_ned_m).norm() > pillar.radius_m + 0.15);
        }
    }
    assert_eq!(plan.verdict, Verdict::Follow);
    Ok(())
}
