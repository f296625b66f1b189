//! Everything that can go wrong with the firmware, once each, in QEMU; `cargo xtask qemu faults` does it a thousand times.

use std::path::PathBuf;

use foxhound_sim::campaign::{self, KINDS, Kind};
use foxhound_tests::qemu_image;

#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn after_every_fault_the_vehicle_flies_on_or_stands_and_says_why_and_every_restart_is_told() {
    let elf = PathBuf::from(qemu_image());
    let report = campaign::fly(&elf, 1, KINDS.len() as u32, 0).unwrap();
    assert_eq!(report.rows.len(), KINDS.len(), "{report:?}");
    for (kind, row) in &report.rows {
        assert_eq!(row.recovered + row.safe.values().sum::<u32>(), 1, "{kind:?}: {row:?}");
        assert_eq!((row.collisions, row.collisions_away), (0, 0), "{kind:?}: {row:?}");
        assert_eq!((row.outside_limits, row.uninvited), (0, 0), "{kind:?}: {row:?}");
        let restarts = [
            Kind::PowerCut,
            Kind::SpoiledFlash,
            Kind::Panic,
            Kind::UndefinedInstruction,
            Kind::StackOverflow,
            Kind::Hang,
        ];
        let expected = u32::from(restarts.contains(kind));
        assert_eq!((row.restarts, row.restarts_told), (expected, expected), "{kind:?}: {row:?}");
    }
}
