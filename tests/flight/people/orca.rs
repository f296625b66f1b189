//! Optimal reciprocal collision avoidance after van den Berg, Guy, Lin and Manocha (2011), for one who takes all the
//! responsibility: nobody else gives way.

/// A vector of the plane.
pub(super) type V = [f64; 2];

pub(super) fn plus([ax, ay]: V, [bx, by]: V, share: f64) -> V {
    [ax + share * bx, ay + share * by]
}

pub(super) fn minus(a: V, b: V) -> V {
    plus(a, b, -1.0)
}

pub(super) fn dot([ax, ay]: V, [bx, by]: V) -> f64 {
    ax * bx + ay * by
}

pub(super) fn norm(a: V) -> f64 {
    dot(a, a).sqrt()
}

fn det([ax, ay]: V, [bx, by]: V) -> f64 {
    ax * by - ay * bx
}

fn scaled(a: V, by: f64) -> V {
    [a[0] * by, a[1] * by]
}

/// A half-plane of velocities: what is to the left of a directed line.
#[derive(Clone, Copy, Debug)]
struct Line {
    point: V,
    direction: V,
}

/// How far ahead it looks; no farther than a step at who is touched already.
const HORIZON_S: f64 = 4.0;
const STEP_S: f64 = 0.02;

/// The velocity next to the one that is preferred, no faster than `v_max_mps`, with which nobody is nearer than `reach_m` within
/// the horizon; where there is none, that which enters the least.
pub(super) fn velocity(own: V, preferred: V, others: &[(V, V)], reach_m: f64, v_max_mps: f64) -> V {
    let lines: Vec<Line> = others.iter().map(|(apart, moves)| line(own, *apart, *moves, reach_m)).collect();
    match nearest(&lines, v_max_mps, preferred, false) {
        Ok(found) => found,
        Err((failed, found)) => least_bad(&lines, failed, v_max_mps, found),
    }
}

/// What somebody at `apart` of us, who moves so, leaves of the velocities.
fn line(own: V, apart: V, moves: V, reach_m: f64) -> Line {
    let closing = minus(own, moves);
    let square = dot(apart, apart);
    let cut_off = |horizon_s: f64| {
        let w = minus(closing, scaled(apart, 1.0 / horizon_s));
        let unit = scaled(w, 1.0 / norm(w).max(1e-12));
        ([unit[1], -unit[0]], scaled(unit, reach_m / horizon_s - norm(w)))
    };
    let (direction, change) = if square > reach_m * reach_m {
        let w = minus(closing, scaled(apart, 1.0 / HORIZON_S));
        let along = dot(w, apart);
        if along < 0.0 && along * along > reach_m * reach_m * dot(w, w) {
            cut_off(HORIZON_S)
        } else {
            let leg = (square - reach_m * reach_m).sqrt();
            let [x, y] = apart;
            let direction = if det(apart, w) > 0.0 {
                [x * leg - y * reach_m, x * reach_m + y * leg]
            } else {
                [-(x * leg + y * reach_m), x * reach_m - y * leg]
            };
            let direction = scaled(direction, 1.0 / square);
            (direction, minus(scaled(direction, dot(closing, direction)), closing))
        }
    } else {
        cut_off(STEP_S)
    };
    Line { point: plus(own, change, 1.0), direction }
}

/// The best velocity on the line `number`, within the circle and the lines before; none where they leave nothing of it.
fn on_line(lines: &[Line], number: usize, v_max_mps: f64, wanted: V, is_direction: bool) -> Option<V> {
    let Line { point, direction } = lines[number];
    let middle = dot(point, direction);
    let within = middle * middle + v_max_mps * v_max_mps - dot(point, point);
    if within < 0.0 {
        return None;
    }
    let (mut left, mut right) = (-middle - within.sqrt(), -middle + within.sqrt());
    for other in &lines[..number] {
        let (denominator, numerator) =
            (det(direction, other.direction), det(other.direction, minus(point, other.point)));
        if denominator.abs() < 1e-9 {
            if numerator < 0.0 {
                return None;
            }
            continue;
        }
        let at = numerator / denominator;
        if denominator >= 0.0 {
            right = right.min(at);
        } else {
            left = left.max(at);
        }
        if left > right {
            return None;
        }
    }
    let best = if is_direction {
        if dot(wanted, direction) > 0.0 { right } else { left }
    } else {
        dot(direction, minus(wanted, point)).clamp(left, right)
    };
    Some(plus(point, direction, best))
}

/// The best velocity within all lines; where there is none, the first line that cannot be held, and the best before it.
fn nearest(lines: &[Line], v_max_mps: f64, wanted: V, is_direction: bool) -> Result<V, (usize, V)> {
    let speed = norm(wanted);
    let mut found =
        if is_direction || speed > v_max_mps { scaled(wanted, v_max_mps / speed.max(1e-12)) } else { wanted };
    for (number, line) in lines.iter().enumerate() {
        if det(line.direction, minus(line.point, found)) > 0.0 {
            found = on_line(lines, number, v_max_mps, wanted, is_direction).ok_or((number, found))?;
        }
    }
    Ok(found)
}

/// The velocity that enters the half-planes least.
fn least_bad(lines: &[Line], failed: usize, v_max_mps: f64, mut found: V) -> V {
    let mut distance = 0.0;
    for (number, line) in lines.iter().enumerate().skip(failed) {
        if det(line.direction, minus(line.point, found)) <= distance {
            continue;
        }
        let bisectors = lines[..number].iter().filter_map(|other| {
            let crossing = det(line.direction, other.direction);
            let point = if crossing.abs() < 1e-9 {
                if dot(line.direction, other.direction) > 0.0 {
                    return None;
                }
                scaled(plus(line.point, other.point, 1.0), 0.5)
            } else {
                let at = det(other.direction, minus(line.point, other.point)) / crossing;
                plus(line.point, line.direction, at)
            };
            let direction = minus(other.direction, line.direction);
            Some(Line { point, direction: scaled(direction, 1.0 / norm(direction).max(1e-12)) })
        });
        let bisectors: Vec<Line> = bisectors.collect();
        let inward = [-line.direction[1], line.direction[0]];
        found = nearest(&bisectors, v_max_mps, inward, true).unwrap_or(found);
        distance = det(line.direction, minus(line.point, found));
    }
    found
}

/// The velocity is clear of everybody for the horizon, or there is none, and it is the one next to what is preferred: compared
/// with a raster of all velocities.
#[test]
fn the_velocity_is_the_best_of_a_raster_or_there_is_none() {
    let mut random = foxhound_sim::world::random::Random::new(24, 77);
    let mut draw = |most: f64| [most * (2.0 * random.uniform() - 1.0), most * (2.0 * random.uniform() - 1.0)];
    let (mut clear, mut none) = (0, 0);
    for number in 0..400 {
        let (count, far_m) = if number % 2 == 0 { (4, 4.0) } else { (12, 2.0) };
        let (own, preferred) = (draw(0.7), draw(0.7));
        let others: Vec<(V, V)> =
            (0..count).map(|_| (draw(far_m), draw(1.5))).filter(|(apart, _)| norm(*apart) > 0.5).collect();
        let found = velocity(own, preferred, &others, 0.45, 1.0);
        assert!(norm(found) < 1.0 + 1e-9);
        let lines: Vec<Line> = others.iter().map(|(apart, moves)| line(own, *apart, *moves, 0.45)).collect();
        let enters = |v: V| lines.iter().map(|line| det(line.direction, minus(line.point, v))).fold(0.0, f64::max);
        let raster = (-50..=50).flat_map(|x| (-50..=50).map(move |y| [0.02 * f64::from(x), 0.02 * f64::from(y)]));
        let within: Vec<V> = raster.filter(|v| norm(*v) <= 1.0).collect();
        if enters(found) < 1e-6 {
            clear += 1;
            let off = |v: &V| norm(minus(*v, preferred));
            let best = within.iter().filter(|v| enters(**v) <= 0.0).map(off).fold(f64::INFINITY, f64::min);
            assert!(off(&found) < best + 1e-6, "{found:?}: {best}");
            let meets = |(apart, moves): &(V, V)| {
                let closing = minus(*moves, found);
                let square = dot(closing, closing).max(1e-12);
                let nearest_s = (-dot(*apart, closing) / square).clamp(0.0, HORIZON_S);
                norm(plus(*apart, closing, nearest_s)) < 0.45 - 1e-6
            };
            assert!(!others.iter().any(meets), "{found:?}");
        } else {
            none += 1;
            let best = within.iter().map(|v| enters(*v)).fold(f64::INFINITY, f64::min);
            assert!(enters(found) < best + 1e-6, "{found:?}: {} {best}", enters(found));
        }
    }
    assert!(clear > 200 && none > 20, "{clear} {none}");
}
