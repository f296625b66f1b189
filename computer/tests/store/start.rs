//! The flight begins with what was kept, and keeps what the link is told.

use foxhound_computer::SAMPLES_PER_CHANNEL as N;
use foxhound_computer::flight::{Flight, ParameterStore as _, Receiver, Step};
use foxhound_computer::iq::Reports;
use foxhound_computer::log::ring::Ring;
use foxhound_computer::log::{self, Log};
use foxhound_computer::sensor::Sensor;
use foxhound_computer::store::{Kept, Store};
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::mission::Control;
use foxhound_core::guidance::param::{self, Values};
use foxhound_core::guidance::{self, FrontEnd, Guidance};
use foxhound_core::planning::planner::Planner;
use foxhound_link::companion::{self, Companion};
use foxhound_link::dialect::{
    ATTITUDE_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavMessage, SETUP_SIGNING_DATA,
};
use foxhound_link::failsafe::Cause;
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode_data};
use foxhound_link::signing::Key;
use foxhound_link::{CharArray, MessageData};

use crate::flash::{Flash, PAGE_BYTES, Random};
use crate::model::{calibration, parameters};

const AUTOPILOT: Header = Header { system_id: 1, component_id: 1, sequence: 0 };
const ARMED_AND_GUIDED: u8 = 128 | 1;
const CRITICAL: u8 = 5;

/// A computer that was just switched on, as the firmware has it.
struct Computer<'a> {
    store: Store<&'a mut Flash>,
    start: u32,
    config: guidance::Config,
    guidance: Guidance<N>,
    state: guidance::State<N>,
    systems: Planner,
    companion: Companion,
    receiver: Receiver,
    sensor: Option<Sensor>,
    reports: Reports,
    now: Instant,
    framer: Framer,
    words: Vec<String>,
    acks: Vec<u8>,
    has_written_in_control: bool,
    /// The state in the last heartbeat, and whether any setpoint moved the vehicle.
    status: Option<u8>,
    has_moved: bool,
}

impl<'a> Computer<'a> {
    fn on(flash: &'a mut Flash, provisioning: bool) -> Self {
        flash.restart();
        let mut store = Store::new(flash);
        let start = store.begin();
        let mut config = guidance::Config::default();
        store.calibrate(&mut config);
        let guidance = config.build().unwrap();
        let link = companion::Config { provisioning, ..companion::Config::default() };
        let mut computer = Self {
            start,
            config,
            state: guidance.start(),
            guidance,
            systems: config.build_planner().unwrap(),
            companion: link.build_with(Values::of(&config)).unwrap(),
            receiver: Receiver::new(None),
            sensor: None,
            reports: Reports::new(),
            store,
            now: Instant(1_000_000),
            framer: Framer::new(),
            words: Vec::new(),
            acks: Vec::new(),
            has_written_in_control: false,
            status: None,
            has_moved: false,
        };
        let (mut flight, store) = computer.parts();
        store.resume(Instant(0), &mut flight);
        computer
    }

    fn parts(&mut self) -> (Flight<'_>, &mut Store<&'a mut Flash>) {
        let Self { config, guidance, state, systems, companion, receiver, sensor, reports, store, .. } = self;
        (Flight { config, guidance, state, systems, companion, receiver, sensor, reports }, store)
    }

    /// A step of the firmware.
    fn step(&mut self, heard: &[u8]) {
        let now = self.now.plus_micros(20_000);
        self.now = now;
        let (mut flight, store) = self.parts();
        store.take_written();
        flight.hear(now, heard);
        let mut ring = Ring::<4096>::new();
        let mut log = Log::resume(ring.ends().0, log::State::default());
        flight.serve(&mut log.parameter_store(store));
        store.keep_up(now, flight.companion);
        let has_control = flight.companion.control(now) == Control::Granted;
        let step = Step { now, front_end: FrontEnd::Nothing, circles: None, look: None, answer: None };
        flight.step(&step, || 0);
        let has_written = store.take_written();
        self.has_written_in_control |= has_control && has_written;
        let mut said = [0; 4096];
        let count = self.companion.transmit(&mut said);
        self.framer.each(&said[..count], |frame| match frame.message() {
            Some(MavMessage::STATUSTEXT(text)) => self.words.push(words(&text.text)),
            Some(MavMessage::COMMAND_ACK(ack)) => self.acks.push(ack.result),
            Some(MavMessage::HEARTBEAT(heartbeat)) => self.status = Some(heartbeat.system_status),
            Some(MavMessage::SET_POSITION_TARGET_LOCAL_NED(target)) => {
                self.has_moved |= [target.vx, target.vy, target.vz, target.yaw_rate] != [0.0; 4];
            }
            _ => {}
        });
    }

    fn tell<D: MessageData>(&mut self, message: &D) {
        self.step(&frame(message));
    }

    /// An autopilot that flies, or only stands there.
    fn live(&mut self, seconds: f32, armed: bool) {
        for step in 0..(seconds * 50.0) as u32 {
            let mut heard = Vec::new();
            if step % 25 == 0 {
                let (base_mode, custom_mode) = if armed { (ARMED_AND_GUIDED, 4) } else { (1, 0) };
                let beat = HEARTBEAT_DATA {
                    mavtype: 2,
                    autopilot: 3,
                    base_mode,
                    custom_mode,
                    system_status: if armed { 4 } else { 3 },
                    mavlink_version: 3,
                };
                heard.extend(frame(&beat));
            }
            let time_boot_ms = (self.now.0 / 1000) as u32 + 20;
            heard.extend(frame(&LOCAL_POSITION_NED_DATA { time_boot_ms, z: -5.0, ..Default::default() }));
            heard.extend(frame(&ATTITUDE_DATA { time_boot_ms, ..Default::default() }));
            self.step(&heard);
        }
    }

    /// From now on; an autopilot of these tests cannot sign.
    fn believe_unsigned(&mut self) {
        let mut values = *self.companion.parameters();
        values.set(param::FH_SIGN, 0.0).unwrap();
        self.companion.set_parameters(values).unwrap();
    }

    fn said(&self, part: &str) -> bool {
        self.words.iter().any(|words| words.contains(part))
    }
}

fn words(text: &CharArray<50>) -> String {
    text.iter().take_while(|byte| **byte != 0).map(|byte| char::from(*byte)).collect()
}

fn frame<D: MessageData>(message: &D) -> Vec<u8> {
    let mut frame = [0; FRAME_MAX];
    let length = encode_data(AUTOPILOT, message, &mut frame);
    frame[..length].to_vec()
}

fn storage(param1: f32) -> COMMAND_LONG_DATA {
    COMMAND_LONG_DATA { target_system: 1, target_component: 191, command: 245, param1, ..Default::default() }
}

/// Values that build.
fn fast() -> Values {
    let mut values = Values::DEFAULT;
    values.set(param::FH_SPD_MAX, 1.7).unwrap();
    values.set(param::FH_SILENT, 7.0).unwrap();
    values
}

#[test]
fn an_empty_store_changes_nothing_and_says_nothing() {
    let mut flash = Flash::new(1);
    let mut computer = Computer::on(&mut flash, false);
    assert_eq!((computer.start, computer.config.array.calibration), (1, None));
    assert_eq!(computer.companion.parameters(), &Values::DEFAULT);
    computer.live(10.0, false);
    assert!(!computer.said("lost") && !computer.said("stored"), "{:?}", computer.words);
    assert_eq!(Computer::on(&mut flash, false).start, 2);
}

#[test]
fn what_a_station_stores_holds_after_the_next_start_for_guidance_and_link() {
    let mut flash = Flash::new(2);
    let mut computer = Computer::on(&mut flash, false);
    let (mut flight, _) = computer.parts();
    flight.run_with(fast()).unwrap();
    computer.tell(&storage(1.0));
    computer.live(1.0, false);
    assert_eq!(computer.acks, [0]);
    let kept = calibration(&mut Random(3));
    assert!(computer.store.keep_calibration(&kept));

    let mut again = Computer::on(&mut flash, false);
    assert_eq!(again.companion.parameters(), &fast());
    assert_eq!(again.config.guard.v_max_mps, 1.7);
    assert_eq!(again.config.array.calibration, Some(kept.table));
    again.tell(&storage(2.0));
    again.live(1.0, false);
    assert_eq!((again.acks.as_slice(), again.companion.parameters()), (&[0][..], &Values::DEFAULT));
    let after = Computer::on(&mut flash, false);
    assert_eq!((after.start, after.config.array.calibration), (3, None), "a reset leaves the count only");
    assert_eq!(after.companion.parameters(), &Values::DEFAULT);
}

#[test]
fn lost_parameters_are_told_and_the_vehicle_holds_uncalibrated_until_somebody_looks() {
    let mut flash = Flash::new(4);
    let mut computer = Computer::on(&mut flash, false);
    assert!(computer.store.save(&fast()) && computer.store.keep_calibration(&calibration(&mut Random(5))));
    drop(computer);
    let first = 3 * PAGE_BYTES / 8 + 1;
    flash.words[first + 7] ^= 1;
    let mut again = Computer::on(&mut flash, false);
    again.live(10.0, true);
    assert!(again.said("parameters lost") && again.said("stored record damaged"), "{:?}", again.words);
    assert_eq!(again.companion.cause(again.now), Cause::StoreDamaged);
    assert!(again.config.array.require_calibration && again.config.array.calibration.is_none());
    assert_eq!(again.companion.parameters().get(param::FH_CAL_REQ), 1.0);
    assert_eq!(again.companion.parameters().get(param::FH_SPD_MAX), Values::DEFAULT.get(param::FH_SPD_MAX));
    // Stored again, everything is as it was.
    assert!(again.store.save(&fast()));
    let mended = Computer::on(&mut flash, false);
    assert!(mended.config.array.calibration.is_some() && !mended.config.array.require_calibration);
}

#[test]
fn parameters_that_do_not_fit_each_other_any_more_are_defaults_and_told() {
    let mut flash = Flash::new(6);
    let mut values = Values::DEFAULT;
    // Each in its range; but the margin for tight places must not be the larger one.
    values.set(param::FH_MARGIN_TGT, 3.0).unwrap();
    assert!(Computer::on(&mut flash, false).store.save(&values));
    let mut again = Computer::on(&mut flash, false);
    again.live(10.0, false);
    assert!(again.said("do not fit"), "{:?}", again.words);
    assert_eq!(again.companion.parameters().get(param::FH_MARGIN_TGT), param::FH_MARGIN_TGT.default());
    assert!(again.config.array.require_calibration);
}

/// What is kept: parameters, a calibration, a key and its time, each twice.
fn fill(flash: &mut Flash) {
    let mut computer = Computer::on(flash, true);
    for round in 0..2 {
        let key = Key::new([3 + round; 32]).unwrap();
        let store = &mut computer.store;
        assert!(store.keep_calibration(&calibration(&mut Random(8 + u64::from(round)))) && store.save(&fast()));
        assert!(store.keep_key(Some(&key)) && store.keep_timestamp(&key, 1_000_000 + u64::from(round)));
    }
}

/// The words that a deed writes into the pages of the records.
fn written_by(flash: &Flash, deed: impl FnOnce(&mut Store<&mut Flash>) -> bool) -> (Flash, Vec<usize>) {
    let mut written = flash.clone();
    let mut store = Store::new(&mut written);
    assert!(store.begin() > 0 && deed(&mut store));
    let changed = (3 * PAGE_BYTES / 8..flash.words.len()).filter(|at| written.words[*at] != flash.words[*at]);
    let changed = changed.collect();
    (written, changed)
}

#[test]
fn a_damaged_record_of_any_name_is_told_and_keeps_the_vehicle_where_it_is_until_it_is_kept_anew() {
    type Deed = fn(&mut Store<&mut Flash>) -> bool;
    let deeds: [(&str, Deed); 4] = [
        ("parameters lost", |store| store.save(&fast())),
        ("calibration lost", |store| store.keep_calibration(&calibration(&mut Random(8)))),
        ("stored key lost", |store| store.keep_key(Key::new([5; 32]).as_ref())),
        ("time of the key lost", |store| store.keep_timestamp(&Key::new([4; 32]).unwrap(), 2_000_000)),
    ];
    for (part, deed) in deeds {
        let mut flash = Flash::new(7);
        fill(&mut flash);
        let (mut written, changed) = written_by(&flash, deed);
        written.words[changed[changed.len() / 2]] ^= 1 << 40;
        // Again and again.
        for _ in 0..2 {
            let mut again = Computer::on(&mut written, true);
            again.believe_unsigned();
            again.live(10.0, false);
            assert!(again.said(part), "{part}: {:?}", again.words);
            assert_eq!(again.companion.cause(again.now), Cause::NotInMode, "{part}");
            assert_eq!(again.status, Some(CRITICAL), "{part}");
            again.live(10.0, true);
            assert_eq!(again.companion.cause(again.now), Cause::StoreDamaged, "{part}");
            assert_eq!(again.companion.control(again.now), Control::NotInControl, "{part}");
            assert!(again.said("stored record damaged, does not move"), "{part}: {:?}", again.words);
            assert_eq!((again.status, again.has_moved), (Some(CRITICAL), false), "{part}");
        }
        let mut again = Computer::on(&mut written, true);
        assert!(again.store.is_damaged());
        if part == "time of the key lost" {
            assert!(again.store.keep_key(Key::new([6; 32]).as_ref()) && again.store.is_damaged());
            assert!(again.store.keep_timestamp(&Key::new([6; 32]).unwrap(), 7));
        } else {
            assert!(deed(&mut again.store));
        }
        assert!(!again.store.is_damaged());
        again.believe_unsigned();
        again.live(1.0, false);
        again.live(3.0, true);
        assert_ne!(again.companion.cause(again.now), Cause::StoreDamaged, "{part}");
        let mut mended = Computer::on(&mut written, true);
        mended.believe_unsigned();
        mended.live(10.0, false);
        assert!(!mended.said(part) && !mended.store.is_damaged(), "{part}: {:?}", mended.words);
    }
}

#[test]
fn a_flash_that_refuses_is_told_as_a_loss_but_holds_no_record_that_is_damaged() {
    let mut flash = Flash::new(9);
    let mut computer = Computer::on(&mut flash, false);
    assert!(computer.store.save(&fast()));
    flash.is_broken = true;
    let mut again = Computer::on(&mut flash, false);
    again.live(10.0, false);
    assert!(again.said("parameters lost") && !again.store.is_damaged(), "{:?}", again.words);
    assert!(again.config.array.require_calibration);
}

#[test]
fn several_news_are_told_one_after_the_other_and_wait_for_an_autopilot() {
    let mut flash = Flash::new(9);
    let mut computer = Computer::on(&mut flash, false);
    assert!(computer.store.save(&fast()) && computer.store.keep_calibration(&calibration(&mut Random(8))));
    assert!(computer.store.keep_key(Key::new([3; 32]).as_ref()));
    drop(computer);
    flash.words[3 * PAGE_BYTES / 8..].fill(0x0123_4567_89ab_cdef);
    let mut again = Computer::on(&mut flash, false);
    (0..500).for_each(|_| again.step(&[]));
    assert!(!again.said("lost"), "nobody is there: {:?}", again.words);
    again.live(20.0, false);
    for part in ["parameters lost", "calibration lost", "key lost"] {
        assert!(again.said(part), "{part}: {:?}", again.words);
    }
}

#[test]
fn a_key_that_comes_over_the_link_signs_after_the_next_start_and_behind_all_that_was_signed() {
    let mut flash = Flash::new(10);
    let mut computer = Computer::on(&mut flash, true);
    computer.live(2.0, false);
    let initial_timestamp = 1_000_000_000;
    let secret_key = [9; 32];
    computer.tell(&SETUP_SIGNING_DATA { initial_timestamp, target_system: 1, target_component: 191, secret_key });
    // It is in the flash before anything that is signed has left.
    assert!(matches!(computer.store.key(), Kept::Found((_, timestamp)) if timestamp > initial_timestamp));
    // A minute and a half later.
    (0..90 * 50).for_each(|_| computer.step(&[]));
    let used = initial_timestamp + 90 * 100_000;
    let mut again = Computer::on(&mut flash, true);
    assert_eq!(again.companion.signing().unwrap().key(), &Key::new(secret_key).unwrap());
    assert!(matches!(again.store.key(), Kept::Found((_, timestamp)) if timestamp > used));
    // Zeros take it away.
    again.companion.sign_with(None);
    again.live(2.0, false);
    again.tell(&SETUP_SIGNING_DATA {
        initial_timestamp: 0,
        target_system: 1,
        target_component: 191,
        secret_key: [0; 32],
    });
    assert_eq!(again.store.key(), Kept::Nothing);
    assert!(Computer::on(&mut flash, true).companion.signing().is_none());
}

#[test]
fn while_the_vehicle_is_in_control_nothing_is_written() {
    let mut flash = Flash::new(11);
    let mut computer = Computer::on(&mut flash, true);
    assert!(computer.store.keep_key(Key::new([5; 32]).as_ref()) && computer.store.save(&parameters(&mut Random(1))));
    let mut computer = Computer::on(&mut flash, true);
    // An autopilot that cannot sign is believed where that is allowed.
    let mut values = Values::DEFAULT;
    values.set(param::FH_SIGN, 0.0).unwrap();
    let (mut flight, _) = computer.parts();
    flight.run_with(values).unwrap();
    computer.live(3.0, true);
    assert_eq!(computer.companion.control(computer.now), Control::Granted, "{:?}", computer.words);
    let before = computer.store.key();
    computer.tell(&storage(1.0));
    computer.live(130.0, true);
    assert!(!computer.has_written_in_control);
    assert_eq!(computer.store.key(), before, "two minutes in control");
    assert!(!computer.acks.is_empty() && computer.acks.iter().all(|ack| *ack != 0), "{:?}", computer.acks);
    computer.live(0.1, false);
    let Kept::Found((_, timestamp)) = computer.store.key() else { panic!("the key is there") };
    let Kept::Found((_, old)) = before else { panic!("it was") };
    assert!(timestamp > old + 100 * 100_000, "at once when it is over");
}
