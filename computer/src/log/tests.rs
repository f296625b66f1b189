use super::frame::LogDeframer;
use super::ring::Ring;
use super::*;
use crate::flight::{self, Receiver};
use crate::iq::Reports;
use crate::sensor::Sensor;
use foxhound_core::base::ned::Horizontal;
use foxhound_core::doa::bearing::{Bearing, Flags, Quality};
use foxhound_core::planning::planner::Planner;
use foxhound_link::companion::{self, Companion};
use rand_core::{Rng as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::boxed::Box;
use std::vec::Vec as List;

/// A flight computer of its own.
struct Parts {
    config: guidance::Config,
    guidance: guidance::Guidance<N>,
    state: guidance::State<N>,
    systems: Planner,
    companion: Companion,
    receiver: Receiver,
    sensor: Option<Sensor>,
    reports: Reports,
}

impl Parts {
    fn new() -> Box<Self> {
        let config = guidance::Config::default();
        let guidance = config.build().unwrap();
        Box::new(Self {
            config,
            state: guidance.start(),
            guidance,
            systems: config.build_planner().unwrap(),
            companion: companion::Config::default().build_with(Values::of(&config)).unwrap(),
            receiver: Receiver::new(None),
            sensor: None,
            reports: Reports::new(),
        })
    }

    fn flight(&mut self) -> Flight<'_> {
        let Self { config, guidance, state, systems, companion, receiver, sensor, reports } = self;
        Flight { config, guidance, state, systems, companion, receiver, sensor, reports }
    }
}

fn circle(number: u16) -> Circle {
    let north = f32::from(number);
    let nowhere = Horizontal::default();
    Circle { center_ned_m: Horizontal { north, east: -0.0 }, radius_m: 0.3, velocity_ned_mps: nowhere }
}

fn bearing() -> Bearing {
    Bearing {
        time: Instant(u64::MAX),
        valid: true,
        azimuth_rad: -3.1,
        sigma_rad: 0.01,
        elevation_rad: 0.2,
        elevation_sigma_rad: 0.1,
        quality: Quality { coherence: Some(1.0), range_hint_m: Some(3.0), ..Quality::default() },
        flags: Flags(u16::MAX),
    }
}

/// Reads the ring empty.
fn read<const SIZE: usize>(ring: &mut Ring<SIZE>, mut each: impl FnMut(u32, Record<'_>)) -> usize {
    let (_, mut consumer) = ring.ends();
    let mut deframer = LogDeframer::new();
    let (mut bytes, mut total) = ([0; 64], 0);
    loop {
        let count = consumer.read(&mut bytes);
        if count == 0 {
            assert_eq!(deframer.rubbish(), 0);
            return total;
        }
        total += count;
        for byte in &bytes[..count] {
            if let Some(frame) = deframer.push(*byte) {
                let record = Record::of(&frame).unwrap();
                each(frame.number, record);
            }
        }
    }
}

#[test]
fn a_flight_is_read_as_it_was_written_and_its_beginning_fits_a_small_ring() {
    let mut parts = Parts::new();
    parts.config.seed = 0xfeed_beef_dead_0001;
    let mut ring = Ring::<2048>::new();
    let mut log = Log::resume(ring.ends().0, State::default());
    log.begin("power", true, &parts.flight());
    let state = log.pause();
    let mut count = 0;
    let length = read(&mut ring, |number, record| {
        let Record::Begin(begin) = record else { panic!("{record:?}") };
        assert_eq!((number, begin.layout, begin.why, begin.needs_entry), (0, LAYOUT, "power", true));
        assert_eq!((begin.version, begin.config), (env!("CARGO_PKG_VERSION"), parts.config));
        assert_eq!(begin.values[..], Values::DEFAULT.as_array()[..]);
        count += 1;
    });
    assert!(count == 1 && length < 1500, "{length}");

    // A step with all that there can be.
    let mut snapshot = AdcFrame::<N>::zeroed();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    snapshot.codes.as_flattened_mut().iter_mut().for_each(|code| *code = (random.next_u32() % 4096) as i16 - 2048);
    snapshot.time = Instant(77);
    let mut ring = Ring::<8192>::new();
    let mut log = Log::resume(ring.ends().0, state);
    let said: List<u8> = (0..300).map(|_| random.next_u32() as u8 | 1).collect();
    log.hear(&said);
    log.hear_sensor(&said[..100]);
    let circles: List<Circle> = (0..64).map(circle).collect();
    let now = Instant(123_456_789_012);
    let step =
        flight::Step { now, front_end: FrontEnd::Frame(&snapshot), circles: Some(&circles), look: None, answer: None };
    let mut came = parts.flight().step(&step, || 0);
    let heard = Measurement { bearing: bearing(), phasors: None };
    came.heard = Some(heard);
    log.step(step.front_end, step.circles, step.look.as_ref(), &came, true);
    log.deadlines(Counts { steps: 9, late: 2, longest_us: 20_000 });
    log.deadlines(Counts { steps: 10, late: 2, longest_us: 20_000 });
    log.text("hello");
    let mut kinds = 0;
    let (mut bytes, mut lidar) = (List::new(), List::new());
    read(&mut ring, |number, record| {
        assert_eq!(number as usize, 1 + kinds);
        kinds += 1;
        match record {
            Record::Bytes(piece) => bytes.extend_from_slice(piece),
            Record::Sensor(piece) => lidar.extend_from_slice(piece),
            Record::Circles(read) => assert_eq!(read[..], circles[..]),
            Record::Codes(codes) => assert_eq!(codes.snapshot().unwrap(), snapshot),
            Record::Late(late) => assert_eq!(late, Late { late: 2, longest_us: 20_000 }),
            Record::Text(text) => assert_eq!(text, "hello"),
            Record::Step(ref step) => {
                let trace_hash = came.output.trace_hash.to_le_bytes();
                assert_eq!(*step, Step { now, heard: Some(heard), plan: None, ordered: true, trace_hash });
            }
            ref other => panic!("{other:?}"),
        }
    });
    assert_eq!((&bytes[..], &lidar[..]), (&said[..], &said[..100]));
    assert_eq!(kinds, 7, "bytes, those of a lidar, circles, codes, step, one late, text");
}

#[test]
fn what_does_not_fit_is_left_out_counted_and_its_number_is_missing() {
    let mut ring = Ring::<256>::new();
    let mut log = Log::resume(ring.ends().0, State::default());
    log.hear(&[1; 100]);
    log.text("short");
    log.text(str::from_utf8(&[b'a'; 200]).unwrap());
    log.text("short");
    assert_eq!(log.lost(), 1);
    let mut numbers = List::new();
    read(&mut ring, |number, _| numbers.push(number));
    assert_eq!(numbers, [0, 1, 3]);
}

#[test]
fn codes_wait_for_room_and_are_no_gap_when_there_is_none() {
    let mut parts = Parts::new();
    let snapshot = AdcFrame::<N>::zeroed();
    let step = flight::Step {
        now: Instant(0),
        front_end: FrontEnd::Frame(&snapshot),
        circles: None,
        look: None,
        answer: None,
    };
    let came = parts.flight().step(&step, || 0);
    let mut ring = Ring::<2048>::new();
    let mut state = State::default();
    let mut codes = List::new();
    for round in 0..120 {
        let (producer, mut consumer) = ring.ends();
        let mut log = Log::resume(producer, state);
        log.step(step.front_end, None, None, &came, false);
        state = log.pause();
        if round < 3 {
            // Nobody reads at first, and little is left.
            continue;
        }
        let (mut deframer, mut bytes) = (LogDeframer::new(), [0; 2048]);
        let count = consumer.read(&mut bytes);
        for byte in &bytes[..count] {
            if let Some(frame) = deframer.push(*byte) {
                codes.extend(matches!(Record::of(&frame), Some(Record::Codes(_))).then_some(round));
            }
        }
    }
    assert_eq!(state.lost, 0);
    assert_eq!(codes, [3, 50, 100]);
}

#[test]
fn no_key_gets_into_the_log_in_whatever_pieces_it_comes() {
    use foxhound_link::dialect::SETUP_SIGNING_DATA;
    use foxhound_link::framer::{FRAME_MAX, Header, encode_data};
    let mut frame = [0; FRAME_MAX];
    let key = SETUP_SIGNING_DATA { secret_key: [0x5a; 32], target_system: 1, ..Default::default() };
    let length = encode_data(Header { system_id: 255, component_id: 190, sequence: 3 }, &key, &mut frame);
    for piece in [1, 2, 7, 300] {
        let mut ring = Ring::<8192>::new();
        let mut log = Log::resume(ring.ends().0, State::default());
        frame[..length].chunks(piece).for_each(|bytes| log.hear(bytes));
        let _ = log.pause();
        let mut heard = List::new();
        read(&mut ring, |_, record| {
            let Record::Bytes(bytes) = record else { panic!("{record:?}") };
            heard.extend_from_slice(bytes);
        });
        assert!(heard.len() == length && heard.starts_with(&frame[..10]) && !heard.contains(&0x5a));
    }
}

#[test]
fn any_record_is_read_or_is_none() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(8);
    let mut read = [0; 12];
    for _ in 0..200_000 {
        let length = random.next_u32() as usize % 60;
        let record: List<u8> = (0..length).map(|_| (random.next_u32() >> (random.next_u32() % 8)) as u8).collect();
        let kind = random.next_u32() as u8 % 12;
        if let Some(record) = Record::of(&Frame { kind, number: 0, record: &record }) {
            read[usize::from(kind)] += 1;
            if let Record::Codes(codes) = record {
                assert_eq!(codes.snapshot(), None);
            }
        }
    }
    assert!(read[2] > 0 && read[9] > 0 && read[0] == 0);
}
