//! Pictures of the simulated camera, each alone: shown twice to a new detector, and the second look counts.

use foxhound_core::base::time::Instant;
use foxhound_core::landing::observation::{Bad, PadObservation, Seen};
use foxhound_pad::{Camera, Config, Detector, Format, HEIGHT_MAX, Header, State, WEIGHTS, WIDTH_MAX};
use foxhound_sim::study::pad::{EXAMINATION, Tally, examine};
use foxhound_sim::world::camera::random::Recipe;
use foxhound_sim::world::camera::watch::alone;
use foxhound_sim::world::camera::{Ground, Lighting, PAD_RED, Pose, Scene, Size, Target, render};

const FRAMES: u64 = EXAMINATION.end;

/// The first so many pictures of a recipe, none of which the weights were trained on.
fn run(recipe: &Recipe, count: u64, inside: [f32; 2]) -> Tally {
    examine(&WEIGHTS, recipe, 0..count, inside).unwrap()
}

/// The pad is found in any light, and its centre is correct.
#[test]
fn the_pad_is_found_in_any_light_and_its_centre_is_right() {
    let tally = run(&Recipe::PAD, FRAMES, [1.0, 1.0]);
    println!(
        "pad: {tally:?}, {:.2} %, rms {:.4}, straightened {:.4}",
        100.0 * tally.rate(),
        tally.rms(tally.square),
        tally.rms(tally.straight)
    );
    assert!(tally.due > 3000, "{tally:?}");
    assert!(tally.rate() >= RATE, "{tally:?}");
    assert!(tally.rms(tally.square) <= 0.02 && tally.rms(tally.straight) <= 0.005, "{tally:?}");
}

/// Of pads of 12 pixels and more. 99.2 % are reached.
const RATE: f64 = 0.99;

/// A pad that the edge of the picture cuts is found in most cases.
#[test]
fn a_pad_that_the_border_cuts_is_mostly_found() {
    let near = Recipe { is_whole: false, height_m: [0.4, 1.2], ..Recipe::PAD };
    let tally = run(&near, FRAMES / 4, [0.5, 0.9999]);
    println!(
        "cut: {tally:?}, {:.2} %, rms {:.4}, straightened {:.4}",
        100.0 * tally.rate(),
        tally.rms(tally.square),
        tally.rms(tally.straight)
    );
    assert!(tally.rate() >= 0.88 && tally.rms(tally.straight) <= 0.03, "{tally:?}");
}

/// Pictures without a pad hardly ever give a detection.
#[test]
fn where_there_is_no_pad_hardly_any_is_seen() {
    let tally = run(&Recipe::CLUTTER, FRAMES, [0.0, 1.0]);
    println!("clutter: {tally:?}, {:.2} %", 100.0 * tally.rate());
    assert_eq!(tally.due, FRAMES as u32);
    assert!(tally.rate() <= FALSE_RATE, "{tally:?}");
}

/// Pads seen where there are none. 0.10 % are reached.
const FALSE_RATE: f64 = 0.001;

/// With a grey camera only some pads are found.
#[test]
fn a_grey_camera_finds_only_some() {
    let size = Size { format: Format::Grey, ..Size::USUAL };
    let with = run(&Recipe { size, ..Recipe::PAD }, FRAMES / 4, [1.0, 1.0]);
    let without = run(&Recipe { size, ..Recipe::CLUTTER }, FRAMES / 4, [0.0, 1.0]);
    println!("grey: {with:?} {:.2} %, clutter {without:?} {:.2} %", 100.0 * with.rate(), 100.0 * without.rate());
    assert!(with.rate() >= 0.1 && with.rms(with.square) <= 0.02, "{with:?}");
    assert!(without.rate() <= 0.06, "{without:?}");
}

/// A pad from straight above, north and east of the vehicle.
fn plain(north_m: f32, east_m: f32, pose: Pose, size: Size) -> (foxhound_sim::world::camera::Frame, Scene) {
    let target = Target { north_m, east_m, radius_m: 0.25, ring_m: 0.05, colour: PAD_RED };
    let scene = Scene { ground: Ground::Concrete, things: Vec::new(), target: Some(target), covers: Vec::new() };
    (render(&scene, &Camera::default(), &pose, &Lighting::default(), size, 1), scene)
}

fn pad_of(
    detector: &Detector,
    frame: &foxhound_sim::world::camera::Frame,
    height_m: Option<f32>,
) -> foxhound_core::landing::observation::Pad {
    match alone(detector, frame, height_m, 1).seen {
        Seen::Pad(pad) => pad,
        other => panic!("{other:?}"),
    }
}

/// Up in the picture is forward and right is right, and the lean of the vehicle is not removed.
#[test]
fn ahead_is_forward_and_starboard_is_right_and_a_lean_is_not_taken_out() {
    let detector = Config::default().build().unwrap();
    for size in [
        Size::USUAL,
        Size { width_px: 320, height_px: 240, ..Size::USUAL },
        Size { width_px: 100, height_px: 80, ..Size::USUAL },
    ] {
        let level = Pose { height_m: 2.0, ..Pose::default() };
        for (north_m, east_m, pose, forward, right) in [
            (0.4, 0.0, level, 0.2, 0.0),
            (0.0, 0.4, level, 0.0, 0.2),
            (-0.4, -0.6, level, -0.2, -0.3),
            // Looking east, what is north is on the left.
            (0.4, 0.0, Pose { yaw_rad: std::f32::consts::FRAC_PI_2, ..level }, 0.0, -0.2),
            // With the nose up, what is below is behind... of the camera's axis: ahead of it lies the nearer ground.
            (0.0, 0.0, Pose { pitch_rad: 0.15, ..level }, -0.151, 0.0),
            (0.0, 0.0, Pose { roll_rad: 0.15, ..level }, 0.0, 0.151),
        ] {
            let (frame, _) = plain(north_m, east_m, pose, size);
            let [truth_forward, truth_right, _] = pose.see(north_m, east_m);
            assert!(
                (truth_forward - forward).abs() < 0.005 && (truth_right - right).abs() < 0.005,
                "{pose:?}: {truth_forward} {truth_right}"
            );
            for height_m in [Some(2.0), None] {
                let pad = pad_of(&detector, &frame, height_m);
                assert!((pad.forward - forward).abs() < 0.01 && (pad.right - right).abs() < 0.01, "{pose:?}: {pad:?}");
                assert!((pad.radius - 0.125).abs() < 0.012 && pad.confidence > 0.5 && !pad.is_cut, "{pad:?}");
            }
        }
    }
}

/// A disc of another size is taken for the pad only if the height is unknown.
#[test]
fn a_disc_of_another_size_is_the_pad_only_where_the_height_is_unknown() {
    let detector = Config::default().build().unwrap();
    let (frame, _) = plain(0.1, 0.1, Pose { height_m: 2.0, ..Pose::default() }, Size::USUAL);
    assert!(matches!(alone(&detector, &frame, None, 1).seen, Seen::Pad(_)));
    for height_m in [0.8, 4.5] {
        assert!(matches!(alone(&detector, &frame, Some(height_m), 1).seen, Seen::Nothing(_)), "{height_m} m");
    }
}

/// Lines of a good frame, so many of them.
fn feed(detector: &Detector, state: &mut State, rows: impl IntoIterator<Item = u16>, bytes: usize) -> Result<(), Bad> {
    let line: Vec<u8> = (0..bytes).map(|at| (at * 37) as u8).collect();
    rows.into_iter().try_for_each(|row| detector.line(state, row, &line))
}

/// Every kind of bad frame has a name, and the next good frame is used.
#[test]
fn each_bad_frame_has_its_name_and_the_next_good_one_is_seen() {
    let detector = Config::default().build().unwrap();
    let (good, _) = plain(0.0, 0.0, Pose { height_m: 2.0, ..Pose::default() }, Size::USUAL);
    let header = good.header(Instant(7));
    let begin = |state: &mut State| detector.begin(state, &header, Some(2.0)).unwrap();
    type Spoil<'a> = Box<dyn Fn(&mut State) + 'a>;
    let of_size = |width_px, height_px| -> Spoil<'_> {
        let detector = &detector;
        Box::new(move |state| {
            let header = Header { width_px, height_px, ..header };
            assert_eq!(detector.begin(state, &header, None), Err(Bad::Size));
            assert_eq!(feed(detector, state, [0], 320), Err(Bad::Size));
        })
    };
    let of_lines = |rows: Vec<u16>, bytes: usize, bad: Bad| -> Spoil<'_> {
        let (detector, begin) = (&detector, &begin);
        Box::new(move |state| {
            begin(state);
            assert_eq!(feed(detector, state, rows.clone(), bytes), Err(bad));
        })
    };
    let all = || 0..120;
    let cases: Vec<(Bad, Spoil<'_>)> = vec![
        (Bad::Size, of_size(0, 0)),
        (Bad::Size, of_size(WIDTH_MAX + 1, 120)),
        (Bad::Size, of_size(160, HEIGHT_MAX + 1)),
        (Bad::Size, of_size(160, 8)),
        (Bad::Size, of_size(u16::MAX, u16::MAX)),
        (Bad::Line, of_lines(vec![0], 0, Bad::Line)),
        (Bad::Line, of_lines(vec![0], 319, Bad::Line)),
        (Bad::Line, of_lines(vec![0], 322, Bad::Line)),
        (Bad::Order, of_lines(vec![1], 320, Bad::Order)),
        (Bad::Order, of_lines(vec![0, 0], 320, Bad::Order)),
        (Bad::Order, of_lines(vec![0, 2], 320, Bad::Order)),
        (Bad::Order, of_lines(vec![0, 1, 0], 320, Bad::Order)),
        (Bad::Order, of_lines(all().chain([120]).collect(), 320, Bad::Order)),
        (Bad::Order, of_lines(vec![u16::MAX], 320, Bad::Order)),
        (Bad::Cut, Box::new(|state| begin(state))),
        (
            Bad::Cut,
            Box::new(|state| {
                begin(state);
                feed(&detector, state, 0..119, 320).unwrap();
            }),
        ),
        (
            Bad::Flat,
            Box::new(|state| {
                begin(state);
                all().for_each(|row| detector.line(state, row, &[0x55; 320]).unwrap());
            }),
        ),
        (Bad::NotBegun, Box::new(|_| ())),
        (Bad::NotBegun, Box::new(|state| assert_eq!(feed(&detector, state, [0], 320), Err(Bad::NotBegun)))),
    ];
    let mut state = State::new();
    for (bad, spoil) in cases {
        spoil(&mut state);
        assert_eq!(detector.end(&mut state).seen, Seen::Bad(bad));
        assert_eq!(detector.end(&mut state).seen, Seen::Bad(Bad::NotBegun));
        detector.begin(&mut state, &header, Some(2.0)).unwrap();
        good.lines().for_each(|(row, bytes)| detector.line(&mut state, row, bytes).unwrap());
        let PadObservation { time, seen } = detector.end(&mut state);
        assert!(time == Instant(7) && matches!(seen, Seen::Pad(_)), "after {bad:?}: {seen:?}");
    }
}
