//! What is flashed, flown in every setting: waveforms and scans together, behind each autopilot's delays, with either hull.
//!
//! Every two values of sensor, bearings, vehicle and hull meet at least once, on held-out seeds ([`foxhound_sim::seeds`]). The
//! whole product, and dense corridors: `cargo xtask campaign`.

use foxhound_sim::matrix::{fly, forests, pairwise};
use foxhound_sim::seeds;

#[test]
fn forests_of_the_papers_densities_are_flown_without_a_collision_in_every_setting() {
    for setting in pairwise() {
        let row = fly(&forests(&setting, seeds::test(20), 4).unwrap()).unwrap();
        assert!(row.collided.is_empty(), "{}: {row:?}", setting.name());
        assert!(f64::from(row.reached) >= 0.985 * f64::from(row.flights), "{}: {row:?}", setting.name());
        assert!(row.length_ratio.unwrap() <= 1.06, "{}: {row:?}", setting.name());
    }
}
