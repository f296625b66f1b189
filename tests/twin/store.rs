//! The store of the firmware image in QEMU: what it keeps when the power is cut inside it. `cargo xtask test` builds the image
//! and runs these.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::Path;

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use foxhound_computer::store::{Kept, PAGES, Store};
use foxhound_computer::twin::{self, Fault, Setup};
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::param::{self, Id, Values};
use foxhound_core::guidance::{self, FrontEnd};
use foxhound_link::dialect::{HEARTBEAT_DATA, MavMessage};
use foxhound_link::framer::{Framer, Header};
use foxhound_sim::drive::qemu::{QemuComputer, QemuError};
use foxhound_tests::{qemu_image, station};

const BYTES: usize = PAGES as usize * 2048;
const AUTOPILOT: Header = Header { system_id: 1, component_id: 1, sequence: 0 };

/// A copy of the twin's flash.
struct Flash(Vec<u8>);

impl Flash {
    fn of(computer: &QemuComputer) -> Self {
        let mut bytes = vec![0; BYTES];
        computer.read_memory(&mut bytes, twin::STORE_AT).unwrap();
        Self(bytes.into_iter().map(|byte| !byte).collect())
    }
}

impl ErrorType for Flash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 8;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        bytes.copy_from_slice(&self.0[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        BYTES
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = 2048;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.0[from as usize..to as usize].fill(0xff);
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.0[offset as usize..][..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }
}

struct Twin {
    computer: QemuComputer,
    now: Instant,
    framer: Framer,
    heard: Vec<MavMessage>,
}

impl Twin {
    fn start() -> Self {
        let computer = QemuComputer::start(Path::new(&qemu_image()), &setup()).unwrap();
        Self { computer, now: Instant(1_000_000), framer: Framer::new(), heard: Vec::new() }
    }

    fn step(&mut self, rx: &[u8]) -> Result<(), QemuError> {
        self.now = self.now.plus_micros(20_000);
        let report = self.computer.step(self.now, FrontEnd::Nothing, None, rx)?;
        self.heard.extend(station::messages(&mut self.framer, &report.tx).into_iter().map(|(_, message)| message));
        Ok(())
    }

    /// Says something, and listens for two seconds beside an autopilot that stands there.
    fn tell(&mut self, message: &[u8]) {
        self.step(message).unwrap();
        for step in 0..100 {
            let beat = HEARTBEAT_DATA { mavtype: 2, autopilot: 3, mavlink_version: 3, ..Default::default() };
            self.step(&if step % 25 == 0 { station::frame(AUTOPILOT, &beat) } else { Vec::new() }).unwrap();
        }
    }

    fn set(&mut self, id: Id, param_value: f32) {
        self.tell(&station::set(id, param_value));
    }

    /// What the twin would find now.
    fn kept(&self) -> (u32, Kept<Values>) {
        let mut store = Store::new(Flash::of(&self.computer));
        let start = store.begin();
        match store.parameters() {
            Kept::Found(restored) => (start - 1, Kept::Found(restored.values)),
            Kept::Nothing => (start - 1, Kept::Nothing),
            Kept::Lost => (start - 1, Kept::Lost),
        }
    }

    fn has_said(&self, words: &str) -> bool {
        self.heard.iter().any(|message| match message {
            MavMessage::STATUSTEXT(text) => text.text.starts_with(words.as_bytes()),
            _ => false,
        })
    }
}

fn setup() -> Setup {
    Setup { guidance: guidance::Config::default(), needs_entry: false }
}

/// When the power is cut while the image saves parameters, the old or the new ones remain.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn a_power_cut_while_the_image_stores_leaves_the_old_or_the_new_parameters() {
    let mut twin = Twin::start();
    assert_eq!(twin.kept(), (1, Kept::Nothing), "a new file is a blank flash");
    twin.set(param::FH_RADIUS, 0.3);
    twin.tell(&station::save());
    let (_, Kept::Found(mut old)) = twin.kept() else { panic!("{:?}", twin.kept()) };
    assert_eq!(old.get(param::FH_RADIUS), 0.3);
    let (mut starts, mut olds, mut news) = (1, 0, 0);
    for cut in 0..24_u32 {
        let radius_m = 0.31 + 0.01 * cut as f32;
        twin.set(param::FH_RADIUS, radius_m);
        let mut new = Values::DEFAULT;
        new.set(param::FH_RADIUS, radius_m).unwrap();
        // Storing takes some ten milliseconds of the twin's time.
        twin.computer.inject(Fault::PowerCut { after_us: 1 + cut * cut * 250 });
        let mut result = twin.step(&station::save());
        for _ in 0..100 {
            if result.is_err() {
                break;
            }
            result = twin.step(&[]);
        }
        assert!(matches!(result, Err(QemuError::Restarted)), "cut {cut}: {result:?}");
        twin.heard.clear();
        twin.computer.recover(&setup()).unwrap();
        starts += 1;
        let (start, Kept::Found(kept)) = twin.kept() else { panic!("cut {cut}: {:?}", twin.kept()) };
        assert_eq!(start, starts, "cut {cut}");
        assert!(kept == old || kept == new, "cut {cut}: {kept:?}");
        if kept == old {
            olds += 1;
        } else {
            news += 1;
        }
        old = kept;
        // The setup of the simulator overrules what is kept.
        twin.tell(&station::read(param::FH_RADIUS));
        let values: Vec<f32> = twin
            .heard
            .iter()
            .filter_map(
                |message| if let MavMessage::PARAM_VALUE(value) = message { Some(value.param_value) } else { None },
            )
            .collect();
        assert_eq!(values, [param::FH_RADIUS.default()], "cut {cut}");
        assert!(twin.has_said(&format!("Foxhound: restart {starts}: ")), "cut {cut}: {:?}", twin.heard);
    }
    assert!(olds > 2 && news > 2, "{olds} old, {news} new: cut too early or too late");
}

/// The image starts with any contents of its flash.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn the_image_starts_with_anything_in_its_flash() {
    for fill in [0x00_u8, 0xff, 0x5a] {
        let mut twin = Twin::start();
        twin.set(param::FH_RADIUS, 0.3);
        twin.tell(&station::save());
        let junk: Vec<u8> = (0..BYTES).map(|at| fill ^ (at as u8).wrapping_mul(fill)).collect();
        twin.computer.write_memory(&junk, twin::STORE_AT).unwrap();
        twin.computer.inject(Fault::PowerCut { after_us: 10 });
        while twin.step(&[]).is_ok() {}
        twin.computer.recover(&setup()).unwrap();
        let lost = Flash(junk.iter().map(|byte| !byte).collect());
        let mut store = Store::new(lost);
        store.begin();
        let wanted = if fill == 0 { Kept::Nothing } else { Kept::Lost };
        assert_eq!(store.parameters() == Kept::Lost, wanted == Kept::Lost);
        assert_eq!(twin.kept().1, wanted, "the image sees it alike");
        twin.set(param::FH_RADIUS, 0.4);
        twin.tell(&station::save());
        assert!(matches!(twin.kept().1, Kept::Found(values) if values.get(param::FH_RADIUS) == 0.4));
    }
}
