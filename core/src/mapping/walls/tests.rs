use super::*;

fn at(north: f32, east: f32) -> Horizontal {
    Horizontal { north, east }
}

#[test]
fn remembered_circles_count_with_the_place_that_faces_the_vehicle_in_the_order_of_their_bearings() {
    let circle =
        |north: f32, east: f32, radius_m: f32| Disc { center_ned_m: at(north, east), radius_m, ..Disc::default() };
    let here = at(1.0, 1.0);
    let mover = Disc { moves: true, ..circle(3.0, 3.0, 0.2) };
    let circles = [
        circle(1.0, 3.0, 0.5),
        circle(4.0, 1.0, 1.0),
        circle(1.0, -2.0, 0.25),
        mover,
        circle(f32::NAN, 0.0, 0.1),
        circle(1.1, 0.95, 0.3),
        circle(-1.0, 1.5, 0.0),
    ];
    let points = points_of(&circles, here);
    let wanted = [at(1.0, -1.75), at(1.1, 0.95), at(3.0, 1.0), at(1.0, 2.5), at(-1.0, 1.5)];
    assert_eq!(points.len(), wanted.len());
    for (point, wanted) in points.iter().zip(wanted) {
        assert!(point.minus(wanted).norm() < 1e-6, "{point:?}");
    }
}

#[test]
fn a_configuration_that_contradicts_itself_is_refused() {
    let refused = |config: Config| config.build().unwrap_err().field;
    assert_eq!(refused(Config { gap_m: f32::NAN, ..Config::default() }), "walls.gap_m");
}

#[test]
fn the_workspace_is_small() {
    assert!(core::mem::size_of::<Workspace>() <= 12 * POINTS_MAX, "{}", core::mem::size_of::<Workspace>());
}

#[test]
fn a_long_wall_is_found_beside_many_short_rows() {
    for rows in [0, 15, 16, 30] {
        let short = (0..rows).flat_map(|row| (0..3).map(move |post| at(-10.0, 4.0 * row as f32 + 0.5 * post as f32)));
        let points: std::vec::Vec<_> = short.chain((0..30).map(|post| at(20.0 + 0.5 * post as f32, 0.0))).collect();
        let found = Config::default().build().unwrap().find(&mut Workspace::default(), &points);
        assert!(matches!(&found[..], [wall] if wall.to_m - wall.from_m > 14.0), "{rows}: {found:?}");
    }
}
