//! Everything that can go wrong with the firmware, once each, in QEMU; `cargo xtask qemu faults` does it a thousand times.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::PathBuf;

use foxhound_computer::deadline::BUDGET_US;
use foxhound_computer::twin::{Fault, Setup};
use foxhound_core::guidance::mission::Behaviour;
use foxhound_link::dialect::MavMessage;
use foxhound_sim::autopilot::Start;
use foxhound_sim::drive::campaign::{self, KINDS, Kind};
use foxhound_sim::drive::qemu::QemuComputer;
use foxhound_sim::drive::soak::manual_mode;
use foxhound_sim::drive::trial::{Clocks, Step, Trial};
use foxhound_sim::scenario::{Scenario, Software};
use foxhound_tests::qemu_image;

/// A microsecond of the part that the twin stands for, in microseconds of the twin's clock: 725 ticks of 25 MHz.
const TWIN_US: u32 = 29;
/// What the watchdog waits for, on the twin's clock.
const WATCHDOG_US: u32 = 4_000_000;

/// After every fault the vehicle continues, or stands and says why, and every restart is reported.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn after_every_fault_the_vehicle_flies_on_or_stands_and_says_why_and_every_restart_is_told() {
    let elf = PathBuf::from(qemu_image());
    let report = campaign::fly(&elf, 1, KINDS.len() as u32).unwrap();
    assert_eq!(report.complaints, [], "{report}");
    assert_eq!(report.rows.len(), KINDS.len(), "{report}");
    for (kind, row) in &report.rows {
        assert_eq!(row.recovered + row.safe.values().sum::<u32>(), 1, "{kind:?}: {row:?}");
        let ends = kind.restarts().map_or(row.restarts, u32::from);
        assert_eq!((row.restarts, row.restarts_told), (ends, ends), "{kind:?}: {row:?}");
        assert_eq!(row.late_steps > 0, *kind == Kind::StolenProcessor, "{kind:?}: {row:?}");
    }
}

/// A mission with faults ends the same way when it is flown again.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn a_mission_that_is_flown_again_ends_the_same_way_fault_by_fault() {
    let elf = PathBuf::from(qemu_image());
    let kinds = [Kind::LineFlood, Kind::ModeFlapping, Kind::StarvedPlanner, Kind::PositionJump];
    let [one, other] = [0, 1].map(|_| campaign::fly_with(&elf, 5, &kinds).unwrap());
    assert_eq!((one.rows, one.seconds, one.complaints), (other.rows, other.seconds, other.complaints));
}

/// A vehicle on its way through the open, with the firmware aboard.
struct Seeker {
    trial: Trial<QemuComputer>,
    setup: Setup,
    said: Vec<MavMessage>,
}

impl Seeker {
    fn under_way() -> Self {
        let mut seeker = Self::start();
        let last = seeker.fly(6.0);
        assert!(last.speed_mps() > 0.5, "{last:?}");
        seeker
    }

    fn start() -> Self {
        let scenario = Scenario { obstacles: Vec::new(), goal: [0.0, 60.0], ..Scenario::default() };
        let setup = Setup { guidance: Trial::guidance(&scenario, 3), needs_entry: false };
        let computer = QemuComputer::start_quick(&PathBuf::from(qemu_image()), &setup).unwrap();
        let mut trial = Trial::with(computer, &scenario, Software::ArduCopter, Start::Hovering, Clocks::default(), 3);
        trial.rig.autopilot.set_parameter("GUID_TIMEOUT", 1.0);
        trial.give_control();
        Self { trial, setup, said: Vec::new() }
    }

    /// Steps from which an interrupt takes so much, microseconds of the part's time.
    fn step(&mut self, stolen_us: u32) -> Step {
        if stolen_us > 0 {
            self.trial.computer.inject(Fault::Steal { for_us: stolen_us * TWIN_US });
        }
        let step = self.trial.step();
        self.said.extend(step.sent.iter().map(|(_, message)| message.clone()));
        step
    }

    fn fly(&mut self, seconds: f64) -> Step {
        for _ in 1..(seconds * 50.0) as u32 {
            self.step(0);
        }
        self.step(0)
    }

    /// The late steps that the pilot was told of last.
    fn told(&self) -> Option<f32> {
        self.said.iter().rev().find_map(|message| match message {
            MavMessage::NAMED_VALUE_FLOAT(value) if value.name.to_str() == Ok("FH_LATE") => Some(value.value),
            _ => None,
        })
    }
}

/// A late step is counted and reported, and changes nothing else.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn a_late_step_is_counted_and_told_and_changes_nothing_else() {
    let (mut calm, mut stormy) = (Seeker::start(), Seeker::start());
    // In turn: one that waits for 5 s flies on by itself.
    for _ in 0..250 {
        assert_eq!(calm.step(0).output, stormy.step(0).output);
    }
    // Not late yet: the storm ends in time. In sum far longer than the watchdog waits.
    for _ in 0..50 {
        assert_eq!(calm.step(0).output, stormy.step(BUDGET_US / 2).output);
    }
    assert_eq!(stormy.trial.computer.late_steps(), 0);
    // Fewer than would take so much of the planner's time that its plan is late.
    for step in 0..60 {
        let stolen_us = if step % 2 == 0 { BUDGET_US * 3 / 2 } else { 0 };
        let (one, other) = (calm.step(0), stormy.step(stolen_us));
        assert_eq!((one.output, one.motion), (other.output, other.motion), "step {step}");
        assert!(one.setpoints().eq(other.setpoints()), "step {step}");
        assert_eq!(stormy.trial.computer.late_steps(), step / 2 + 1);
    }
    let (one, other) = (calm.fly(2.0), stormy.fly(2.0));
    assert_eq!((one.output, one.motion), (other.output, other.motion));
    assert!(other.speed_mps() > 0.5);
    assert_eq!((calm.told(), stormy.told()), (Some(0.0), Some(30.0)));
}

/// When only late steps run, the watchdog restarts the image, and the vehicle stands until the mode is entered again.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn late_steps_alone_do_not_feed_the_watchdog_and_after_it_the_vehicle_stands_until_the_mode_is_entered_afresh() {
    let mut seeker = Seeker::under_way();
    let stolen_us = BUDGET_US * 3 / 2;
    let enough = WATCHDOG_US / (stolen_us * TWIN_US);
    let late = (0..20).take_while(|_| seeker.step(stolen_us).output.is_some()).count() as u32;
    // The step in which it bites is not finished; what a step takes besides makes them fewer.
    assert!((enough - 1..=enough).contains(&late), "{late} of {enough}");
    seeker.trial.computer.recover(&seeker.setup).unwrap();
    seeker.said.clear();
    let stands = seeker.fly(3.0);
    assert!(stands.obeyed && stands.speed_mps() < 0.05, "{stands:?}");
    let moves = |message: &MavMessage| match message {
        MavMessage::SET_POSITION_TARGET_LOCAL_NED(target) => target.vx.hypot(target.vy) > 0.0,
        _ => false,
    };
    assert!(!seeker.said.iter().any(moves));
    let words = seeker.said.iter().find_map(|message| match message {
        MavMessage::STATUSTEXT(text) => text.text.to_str().ok().filter(|text| text.starts_with("Foxhound: restart")),
        _ => None,
    });
    assert!(words.is_some_and(|words| words.starts_with("Foxhound: restart 2: watchdog at 0x")), "{words:?}");
    let now_us = seeker.trial.autopilot_us();
    seeker.trial.rig.autopilot.select_mode(now_us, manual_mode(Software::ArduCopter));
    seeker.fly(1.1);
    seeker.trial.give_control();
    let flies = seeker.fly(5.0);
    assert!(flies.output.is_some_and(|output| output.outcome.behaviour() == Behaviour::Follow));
    assert!(flies.speed_mps() > 0.5);
}
