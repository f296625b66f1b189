//! Tests of the planner.

use super::*;
use crate::base::rng::Rng;
use crate::planning::rollout::swept_clearance_m;

type Discs = std::vec::Vec<Disc>;

/// The guard's default.
const GUARD_MARGIN_M: f32 = 0.03;

fn discs(circles: &[(f32, f32, f32)]) -> Discs {
    circles
        .iter()
        .map(|(north, east, radius_m)| Disc {
            center_ned_m: Horizontal { north: *north, east: *east },
            radius_m: *radius_m,
            ..Disc::default()
        })
        .collect()
}

fn request() -> PlanRequest {
    PlanRequest { id: 1, seed: 9, target_ned_m: Horizontal { north: 2.0, east: 0.0 }, ..PlanRequest::default() }
}

fn plan(request: &PlanRequest, known: &[Disc]) -> (Plan, Workspace) {
    let mut workspace = Workspace::default();
    let plan = Config::default()
        .build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT, &Fence::DEFAULT, GUARD_MARGIN_M)
        .unwrap()
        .plan(&mut workspace, request, known);
    (plan, workspace)
}

fn obstacles(known: &[Disc]) -> std::vec::Vec<Obstacle> {
    known.iter().map(|disc| Obstacle::of(disc, 0.15)).collect()
}

#[test]
fn it_flies_straight_through_the_open() {
    let (plan, _) = plan(&request(), &[]);
    assert_eq!(plan.verdict, Verdict::Follow);
    assert!(plan.waypoints_ned_m[14].minus(Horizontal { north: 2.0, east: 0.0 }).norm() < 1e-4);
}

#[test]
fn ours_never_returns_a_path_that_loses_its_margin() {
    let planner =
        Config::default().build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT, &Fence::DEFAULT, GUARD_MARGIN_M).unwrap();
    let mut workspace = Workspace::default();
    let (mut followed, mut braked) = (0, 0);
    for seed in 0..400_u64 {
        let mut rng = Rng::new(seed, 77);
        let mut place = || (0.3 + 2.0 * rng.uniform(), -1.0 + 2.0 * rng.uniform(), 0.1 + 0.25 * rng.uniform());
        let known = discs(&[place(), place(), place(), place()]);
        let plan = planner.plan(&mut workspace, &PlanRequest { seed, begins: true, ..request() }, &known);
        let obstacles = obstacles(&known);
        let at_start = obstacles.iter().map(|o| o.clearance_m(Horizontal::default())).fold(f32::INFINITY, f32::min);
        match plan.verdict {
            Verdict::Follow => {
                let clearance = swept_clearance_m(plan.start_ned_m, &plan.waypoints_ned_m[..6], &obstacles);
                let least = Config::default().tight_margin_m - 1e-4;
                assert!(clearance >= least.min(at_start - 0.0011), "seed {seed}: {clearance} from {at_start}");
                followed += 1;
            }
            Verdict::Brake => {
                assert!(plan.waypoints_ned_m.iter().all(|p| *p == plan.start_ned_m));
                braked += 1;
            }
        }
    }
    assert!(followed > 300, "{followed} followed, {braked} braked");
}

#[test]
fn gusts_make_the_way_wider_and_a_narrow_gap_none() {
    let least_m = |gust_margin_m: f32, gap_m: f32| {
        let east_m = 0.3 + 0.5 * gap_m;
        let known = discs(&[(1.0, east_m, 0.3), (1.0, -east_m, 0.3)]);
        let (plan, _) = plan(&PlanRequest { gust_margin_m, ..request() }, &known);
        swept_clearance_m(plan.start_ned_m, &plan.waypoints_ned_m, &obstacles(&known))
    };
    // Between them there is 0.15 m on either side; with gusts the path leads around them, or stays away.
    assert!(least_m(0.0, 0.6) < 0.16);
    assert!(least_m(0.3, 0.6) >= 0.3);
    // Where there is space for both.
    assert!((0.3..0.46).contains(&least_m(0.3, 1.2)), "{}", least_m(0.3, 1.2));
}

#[test]
fn a_gap_that_may_be_closed_is_flown_to_and_left_when_that_brings_it_no_nearer() {
    // A wall with a gap of 0.5 m straight ahead, 3 m away, of which each side may be 0.15 m nearer.
    let wall = (0..40).flat_map(|k| [1.0_f32, -1.0].map(|side| (3.0, side * (0.45 + 0.3 * k as f32), 0.2 + 0.15)));
    let known: Discs = discs(&wall.collect::<std::vec::Vec<_>>());
    let known: Discs = known.into_iter().map(|disc| Disc { sigma_mm: 150, ..disc }).collect();
    let planner =
        Config::default().build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT, &Fence::DEFAULT, GUARD_MARGIN_M).unwrap();
    let mut workspace = Workspace::default();
    let known_source_ned_m = Some(Horizontal { north: 6.0, east: 0.0 });
    let mut east_m = |begins, id| {
        let request = PlanRequest { id, begins, known_source_ned_m, ..request() };
        planner.plan(&mut workspace, &request, &known).target_ned_m.east
    };
    assert!(east_m(true, 0).abs() < 0.1, "towards the gap");
    let later: std::vec::Vec<f32> = (1..40).map(|id| east_m(false, id)).collect();
    assert!(later.iter().any(|east| east.abs() > 1.0), "round the wall: {later:?}");
}

#[test]
fn an_obstacle_exactly_on_the_line_is_passed_on_one_side() {
    let (plan, _) = plan(&request(), &discs(&[(1.0, 0.0, 0.3)]));
    assert_eq!(plan.verdict, Verdict::Follow);
    // To the place beside the pillar from where the target is in sight.
    let end = plan.waypoints_ned_m[14];
    assert!(end.north > 0.6 && end.east.abs() > 0.4 && end.minus(plan.target_ned_m).norm() < 0.2, "{end:?}");
}

/// A wall 20 m long across the path to a known source, and the vehicle in front of its middle.
fn wide_wall() -> (PlanRequest, Discs) {
    let wall: std::vec::Vec<_> = (0..61).map(|k| (1.5, (k as f32 - 30.0) * 0.33, 0.2)).collect();
    let known_source_ned_m = Some(Horizontal { north: 6.0, east: 0.0 });
    (PlanRequest { known_source_ned_m, begins: true, ..request() }, discs(&wall))
}

#[test]
fn a_wall_wider_than_the_window_is_gone_round() {
    let planner =
        Config::default().build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT, &Fence::DEFAULT, GUARD_MARGIN_M).unwrap();
    let (mut workspace, (mut request, known)) = (Workspace::default(), wide_wall());
    let source = request.known_source_ned_m.unwrap();
    for _ in 0..80 {
        let plan = planner.plan(&mut workspace, &request, &known);
        request.begins = false;
        request.id += 1;
        request.start_ned_m = plan.waypoints_ned_m[5];
        if request.start_ned_m.minus(source).norm() < 0.5 {
            return;
        }
    }
    panic!("after 80 replans at {:?}", request.start_ned_m);
}

#[test]
fn who_never_comes_nearer_is_told_that_there_is_no_way_until_it_is_handed_over_again() {
    let planner =
        Config::default().build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT, &Fence::DEFAULT, GUARD_MARGIN_M).unwrap();
    let (mut workspace, (mut request, known)) = (Workspace::default(), wide_wall());
    request.start_ned_m.north = 1.0;
    let mut verdict = |begins| {
        request.begins = begins;
        request.id += 1;
        planner.plan(&mut workspace, &request, &known).verdict
    };
    assert_eq!(verdict(true), Verdict::Follow);
    let follows = (0..200).take_while(|_| verdict(false) == Verdict::Follow).count();
    // The wide window has a path all the time: it is followed for twice as long as one that is searched for.
    assert!((100..=160).contains(&follows), "{follows}");
    assert_eq!(verdict(false), Verdict::Brake);
    assert_eq!(verdict(true), Verdict::Follow);
}

#[test]
fn a_sealed_start_yields_a_brake_plan() {
    let ring: std::vec::Vec<_> = (0..12)
        .map(|k| {
            let angle = core::f32::consts::TAU * k as f32 / 12.0;
            let p = Horizontal::from_bearing(angle).times(0.55);
            (p.north, p.east, 0.2)
        })
        .collect();
    assert_eq!(plan(&request(), &discs(&ring)).0.verdict, Verdict::Brake);
}

#[test]
fn same_seed_same_plan_and_another_seed_another() {
    let (request, known) = (request(), discs(&[(1.0, 0.1, 0.3)]));
    let other = PlanRequest { seed: 10, ..request.clone() };
    assert_eq!(plan(&request, &known).0, plan(&request, &known).0);
    assert_ne!(plan(&request, &known).1.gains, plan(&other, &known).1.gains);
}

#[test]
fn bad_gains_are_refused_by_name() {
    let refused = |change: &dyn Fn(&mut Config)| {
        let mut config = Config::default();
        change(&mut config);
        config.build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT, &Fence::DEFAULT, GUARD_MARGIN_M).unwrap_err().field
    };
    assert_eq!(refused(&|c| c.gains.k_rep = f32::NAN), "planner.gains.k_rep");
    assert_eq!(refused(&|c| c.gains.influence_m = -1.0), "planner.gains.influence_m");
    assert_eq!(refused(&|c| c.gains_sigma.swirl = -1.0), "planner.gains_sigma");
    assert_eq!(refused(&|c| c.kind = Kind::Paper), "planner.kind");
    assert_eq!(refused(&|c| c.law = Law::of(baseline::Kind::Khatib)), "planner.law.kind");
}

/// Follows the plans from a start to a known source; where it was at each replan.
fn followed(fence: &Fence, start: Horizontal, source: Horizontal, known: &[Disc]) -> std::vec::Vec<Horizontal> {
    let planner = Config::default().build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT, fence, GUARD_MARGIN_M).unwrap();
    follow(&planner, start, source, known)
}

fn follow(planner: &Planner, start: Horizontal, source: Horizontal, known: &[Disc]) -> std::vec::Vec<Horizontal> {
    let (mut workspace, mut here) = (Workspace::default(), start);
    let mut places = std::vec![here];
    for id in 0..60 {
        let known_source_ned_m = Some(source);
        let (start_ned_m, position_ned_m) = (here, here);
        let request = PlanRequest { id, start_ned_m, position_ned_m, known_source_ned_m, ..request() };
        let plan = planner.plan(&mut workspace, &request, known);
        here = plan.waypoints_ned_m[3];
        places.push(here);
    }
    places
}

#[test]
fn no_path_leads_out_of_the_fence() {
    let at = |north, east| Horizontal { north, east };
    let fence = Fence { radius_m: 4.0, ..Fence::DEFAULT };
    // A wall whose nearer end lies outside.
    let wall = discs(&std::array::from_fn::<_, 29, _>(|k| (1.5, -2.0 + 0.2 * k as f32, 0.1)));
    let (start, source) = (at(0.5, 1.0), at(2.7, 1.0));
    let free = followed(&Fence::DEFAULT, start, source, &wall);
    assert!(free.iter().any(|place| place.norm() > 3.9), "{free:?}");
    // Also from where it is not allowed to be.
    for start in [start, at(0.0, 4.8)] {
        let fenced = followed(&fence, start, source, &wall);
        let farthest_m = fenced.iter().map(|place| place.norm()).fold(0.0, f32::max);
        assert!(farthest_m < start.norm().max(3.5) + 0.1, "{fenced:?}");
        assert!(fenced[60].minus(source).norm() < 0.4, "{fenced:?}");
    }
    // As near to what lies outside as it may.
    let beyond = followed(&fence, at(0.0, 1.0), at(9.0, 0.0), &[]);
    assert!(beyond[60].minus(at(3.5, 0.0)).norm() < 0.3, "{beyond:?}");
}

/// In the middle of the gap nothing is nearer than 0.15 m: passable, but with margins of 0.2 m or more.
#[test]
fn a_gap_in_which_the_margins_cannot_be_kept_is_flown_around() {
    let pillars = discs(&[(2.0, -0.5, 0.2), (2.0, 0.5, 0.2)]);
    let source = Horizontal { north: 5.0, east: 0.0 };
    let wide = Config { margin_m: 0.5, tight_margin_m: 0.3, ..Config::default() };
    for (config, guard_margin_m, through) in
        [(Config::default(), 0.03, true), (Config::default(), 0.2, false), (wide, 0.03, false), (wide, 0.2, false)]
    {
        let planner = config.build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT, &Fence::DEFAULT, guard_margin_m).unwrap();
        let places = follow(&planner, Horizontal::default(), source, &pillars);
        assert!(places[60].minus(source).norm() < 0.4, "{guard_margin_m}: {places:?}");
        let between = |place: &Horizontal| (place.north - 2.0).abs() < 0.2 && place.east.abs() < 0.3;
        assert_eq!(places.iter().any(between), through, "{guard_margin_m}: {places:?}");
    }
}

#[test]
fn what_was_spent_on_a_search_or_before_the_beginning_does_not_count() {
    let explore = Some(explore::Config { limit_s: 600.0, ..explore::Config::default() });
    let planner = Config { explore, ..Config::default() }
        .build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT, &Fence::DEFAULT, GUARD_MARGIN_M)
        .unwrap();
    let mut workspace = Workspace::default();
    // A vehicle that is held up: it stays where it is.
    let mut plans = |count: u32, begins: bool, searches: bool| {
        (0..count).fold(Verdict::Brake, |_, id| {
            let search = Search { now: Instant(1_000_000 + 700_000 * u64::from(id)), pose: Pose::default() };
            let begins = begins && id == 0;
            let request = PlanRequest { id, begins, search: searches.then_some(search), ..request() };
            planner.plan(&mut workspace, &request, &[]).verdict
        })
    };
    plans(200, true, true);
    assert_eq!(plans(1, false, false), Verdict::Follow, "after a search");
    assert_eq!(plans(200, false, false), Verdict::Brake);
    plans(1, true, true);
    assert_eq!(plans(1, false, false), Verdict::Follow, "it has begun anew with a search");
    // What was asked for in between because something came into the way.
    for id in 0..400 {
        let request = PlanRequest { id, is_early: id % 6 != 0, ..request() };
        assert_eq!(planner.plan(&mut workspace, &request, &[]).verdict, Verdict::Follow, "{id}");
    }
}

#[test]
fn whoever_shuts_the_vehicle_in_for_a_while_does_not_end_its_search() {
    let explore = Some(explore::Config::default());
    let planner = Config { explore, ..Config::default() }
        .build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT, &Fence::DEFAULT, GUARD_MARGIN_M)
        .unwrap();
    let ring = |count: u8, away_m: f32, radius_m: f32, moves: bool| -> Discs {
        let place = |k: u8| Horizontal::from_bearing(f32::from(k) * core::f32::consts::TAU / f32::from(count));
        let disc = |k| Disc { center_ned_m: place(k).times(away_m), radius_m, moves, ..Disc::default() };
        (0..count).map(disc).collect()
    };
    // Pillars with gaps of 0.8 m in gusts, and people who stand around it.
    let (pillars, people) = (ring(8, 1.44, 0.15, false), ring(12, 0.62, 0.25, true));
    for (radius_m, moves, gust_margin_m) in [(0.15, false, 1.0), (0.25, true, 0.0)] {
        let (ring, mut workspace) = (if moves { &people } else { &pillars }, Workspace::default());
        let plans = (1..80_u32).map(|id| {
            let search = Some(Search { now: Instant(1_000_000 + 600_000 * u64::from(id)), pose: Pose::default() });
            let is_shut_in = (3..40).contains(&id);
            let gust_margin_m = if is_shut_in { gust_margin_m } else { 0.0 };
            let request = PlanRequest { id, begins: id == 1, gust_margin_m, search, ..PlanRequest::default() };
            planner.plan(&mut workspace, &request, if is_shut_in || !moves { ring } else { &[] })
        });
        let plans: std::vec::Vec<Plan> = plans.collect();
        assert!(plans.iter().all(|plan| plan.search == Some(Searched::On)), "{radius_m}");
        assert_eq!(plans[5].verdict, Verdict::Brake, "{radius_m}");
        assert_eq!(plans[60].verdict, Verdict::Follow, "{radius_m}");
    }
}

#[test]
fn no_bent_path_leads_out_of_the_fence_either() {
    let fence = Fence { radius_m: 5.0, ..Fence::DEFAULT };
    let planner = Config::default().build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT, &fence, GUARD_MARGIN_M).unwrap();
    let start = Horizontal { north: 4.4, east: 0.0 };
    let learn =
        Learn { source_ned_m: Horizontal { north: 14.0, east: 0.0 }, covariance_m2: [10.0, 0.0, 1.0], sigma_rad: 0.05 };
    let request = PlanRequest {
        begins: true,
        start_ned_m: start,
        position_ned_m: start,
        target_ned_m: Horizontal { north: 6.4, east: 0.0 },
        learn: Some(learn),
        ..request()
    };
    let plan = planner.plan(&mut Workspace::default(), &request, &[]);
    assert!(plan.verdict == Verdict::Follow && plan.waypoints_ned_m.iter().all(|place| place.norm() < 4.6), "{plan:?}");
}
