use super::*;
use foxhound_core::doa::bearing::{Flags, Quality};

const N: usize = 256;

fn circle(k: usize) -> Circle {
    let k = k as f32;
    Circle {
        center_ned_m: Horizontal { north: k * 0.1, east: -k },
        radius_m: 0.3 + k,
        velocity_ned_mps: Horizontal { north: -0.0, east: f32::MIN_POSITIVE },
    }
}

fn step<'a>(front_end: FrontEnd<'a, N>, circles: Option<&'a [Circle]>) -> Step<'a, N> {
    Step {
        sequence: 7,
        now: Instant(u64::MAX - 3),
        rx_expected: 90_000,
        camera_expected: 38_400,
        sensor_expected: 17_625,
        front_end,
        circles,
        fault: Some(Fault::PowerCut { after_us: 123_456 }),
    }
}

#[test]
fn a_full_step_comes_back_with_every_bit() {
    let mut snapshot = AdcFrame::<N>::zeroed();
    snapshot.time = Instant(123_456_789_012);
    for (k, code) in snapshot.codes.as_flattened_mut().iter_mut().enumerate() {
        *code = (k as i16).wrapping_mul(31) - 2048;
    }
    let circles: [Circle; DELIVERY_MAX] = core::array::from_fn(circle);
    let sent = step(FrontEnd::Frame(&snapshot), Some(&circles));
    let mut block = [0xa5; BLOCK_BYTES];
    sent.encode(&mut block).unwrap();

    let mut arrivals = Arrivals::<N>::new();
    arrivals.decode(&block).unwrap();
    let got = arrivals.step();
    assert_eq!((got.sequence, got.now), (sent.sequence, sent.now));
    let expected = |step: &Step<'_, N>| (step.rx_expected, step.camera_expected, step.sensor_expected);
    assert_eq!(expected(&got), expected(&sent));
    let FrontEnd::Frame(came) = got.front_end else { panic!("no snapshot") };
    assert_eq!(came, &snapshot);
    let bits = |circle: &Circle| {
        [circle.center_ned_m.north, circle.radius_m, circle.velocity_ned_mps.north, circle.velocity_ned_mps.east]
            .map(f32::to_bits)
    };
    assert!(got.circles.unwrap().iter().map(bits).eq(circles.iter().map(bits)));
}

#[test]
fn no_circles_and_an_empty_list_of_circles_stay_apart() {
    let mut block = [0; BLOCK_BYTES];
    let mut arrivals = Arrivals::<N>::new();
    step(FrontEnd::Nothing, None).encode(&mut block).unwrap();
    arrivals.decode(&block).unwrap();
    assert_eq!(arrivals.step().circles, None);
    step(FrontEnd::Nothing, Some(&[])).encode(&mut block).unwrap();
    arrivals.decode(&block).unwrap();
    assert_eq!(arrivals.step().circles, Some([].as_slice()));
}

#[test]
fn a_bearing_comes_back() {
    let bearing = Bearing {
        time: Instant(5),
        valid: true,
        azimuth_rad: -3.1,
        sigma_rad: 0.01,
        elevation_rad: 0.2,
        elevation_sigma_rad: 0.1,
        quality: Quality::default(),
        flags: Flags::CLIP,
    };
    let mut block = [0; BLOCK_BYTES];
    step(FrontEnd::Bearing(bearing), None).encode(&mut block).unwrap();
    let mut arrivals = Arrivals::<N>::new();
    arrivals.decode(&block).unwrap();
    let FrontEnd::Bearing(came) = arrivals.step().front_end else { panic!("no bearing") };
    assert_eq!(came, bearing);
}

#[test]
fn too_many_circles_an_empty_block_and_an_impossible_length_are_refused() {
    let circles = [circle(1); DELIVERY_MAX + 1];
    let mut block = [0; BLOCK_BYTES];
    assert_eq!(step(FrontEnd::Nothing, Some(&circles)).encode(&mut block), Err(Error::Length));
    assert_eq!(read_record::<Report>(&block), Err(Error::Magic));
    block[..4].copy_from_slice(&MAGIC.to_le_bytes());
    block[4..8].fill(0xff);
    assert_eq!(read_record::<Report>(&block), Err(Error::Length));
    block[4..8].copy_from_slice(&1_u32.to_le_bytes());
    assert_eq!(read_record::<Report>(&block), Err(Error::Content));
}

#[test]
fn a_setup_fits_its_block_and_comes_back() {
    let setup = Setup {
        guidance: guidance::Config { seed: 0xfeed_beef_dead_0001, ..guidance::Config::default() },
        needs_entry: true,
    };
    let mut block = [0; BLOCK_BYTES];
    write_record(&mut block, &setup).unwrap();
    let back: Setup = read_record(&block).unwrap();
    assert_eq!((back.guidance.seed, back.needs_entry), (setup.guidance.seed, true));
}

#[test]
fn a_refusal_is_text_and_a_long_one_is_cut_at_a_character() {
    let mut block = [0; BLOCK_BYTES];
    encode_refusal(&mut block, format_args!("{} = {}", "planner.margin_m", -1));
    assert_eq!(decode_refusal(&block), Ok("planner.margin_m = -1"));
    let long = ["\u{20ac}"; 2000].concat();
    encode_refusal(&mut block, format_args!("{long}"));
    let cut = decode_refusal(&block).unwrap();
    assert_eq!(cut.len(), (BLOCK_BYTES - HEAD_BYTES) / 3 * 3);
    assert!(cut.chars().all(|letter| letter == '\u{20ac}'));
}

#[test]
fn at_shift_eight_six_and_four_tenths_ticks_are_one_instruction() {
    for count in [0_u32, 1, 2, 3, 7, 1_000, 45_311, 1_700_000] {
        assert_eq!(instructions((u64::from(count) * 64 / 10) as u32), count);
        assert_eq!(instructions((u64::from(count) * 64).div_ceil(10) as u32), count);
    }
}
