//! Floors that are not level, in depth frames without noise, with an attitude that is half a degree off.

use super::tests::{camera_160, held};
use super::{DepthView, FloorCell, FloorStep, StepMax};
use crate::se2::Point;
use messages::DepthHeader;
use nalgebra::{Point3, Rotation3, Vector3};

const RAMP: f64 = 1.0 / 12.0;
/// Bias of the attitude, degrees: roll and pitch.
const BIASES: [[f64; 2]; 5] = [[0.0, 0.0], [0.5, 0.5], [-0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]];
/// A ray is followed in steps of this, metres, and to this depth.
const STEP_M: f64 = 0.01;
const REACH_M: f64 = 10.0;

/// What the camera sees of the ground. `ground_m` is its height at a place over the ground under the robot, metres.
pub(crate) fn seen(header: &DepthHeader, ground_m: &impl Fn(f64, f64) -> f64) -> Vec<u16> {
    let (mount, tilt) = (header.robot_from_camera, held(2.0, 3.0));
    let eye = tilt.place(Point3::new(mount.x_m, mount.y_m, mount.z_m));
    let mounted = Rotation3::from_euler_angles(0.0, mount.pitch_rad, mount.yaw_rad);
    let depth_m = |i: usize| {
        let (v, u) = (i / header.width as usize, i % header.width as usize);
        let ray = tilt.direction(mounted * Vector3::new(1.0, super::left_of(header, u), super::up_of(header, v)));
        let under = |depth_m: f64| {
            let at = eye + ray * depth_m;
            at.z < ground_m(at.x, at.y)
        };
        let mut far_m = (1..(REACH_M / STEP_M) as usize).map(|i| i as f64 * STEP_M).find(|depth_m| under(*depth_m))?;
        let mut near_m = far_m - STEP_M;
        for _ in 0..6 {
            let middle_m = f64::midpoint(near_m, far_m);
            if under(middle_m) { far_m = middle_m } else { near_m = middle_m }
        }
        Some(far_m)
    };
    let mm = |i: usize| depth_m(i).map_or(0, |metres| (metres * 1000.0).round() as u16);
    (0..(header.width * header.height) as usize).map(mm).collect()
}

/// The obstacles within 4 m of such ground, with each bias; none where a frame is refused.
fn obstacles(ground_m: impl Fn(f64, f64) -> f64) -> Vec<Option<Vec<Point>>> {
    let (header, mut view) = (camera_160(), DepthView::default());
    let pixels = seen(&header, &ground_m);
    let looks = |[roll_deg, pitch_deg]: [f64; 2]| {
        let told = held(2.0 + roll_deg, 3.0 + pitch_deg);
        view.fill_tilted(&header, &pixels, Some(&told)).ok()?;
        Some(view.points().iter().copied().filter(|point| point.x < 4.0).collect())
    };
    BIASES.into_iter().map(looks).collect()
}

/// The edges within 3 m of such ground, with each bias.
pub(super) fn edges(header: &DepthHeader, ground_m: impl Fn(f64, f64) -> f64) -> Vec<Vec<Point>> {
    let (pixels, mut view) = (seen(header, &ground_m), DepthView::default());
    let looks = |[roll_deg, pitch_deg]: [f64; 2]| {
        view.fill_tilted(header, &pixels, Some(&held(2.0 + roll_deg, 3.0 + pitch_deg))).expect("usable");
        view.edges().to_vec()
    };
    BIASES.into_iter().map(looks).collect()
}

/// Fails where there are any.
fn none(wrong: &[String]) {
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// What is wrong where such ground is not all floor.
fn not_floor(what: &str, ground_m: impl Fn(f64, f64) -> f64) -> Vec<String> {
    not_found(what, ground_m, 0, |_| false)
}

/// Failures: at least `least` columns must see the thing, whose points are `on` it, and no column anything else.
fn not_found(what: &str, ground_m: impl Fn(f64, f64) -> f64, least: usize, on: impl Fn(&Point) -> bool) -> Vec<String> {
    let edges = edges(&camera_160(), &ground_m).into_iter().zip(BIASES);
    let dropped = edges.filter_map(|(edges, bias)| {
        let first = edges.first()?;
        Some(format!("{what}, bias {bias:?}: {} edges, the first at {first:?}", edges.len()))
    });
    let dropped: Vec<_> = dropped.collect();
    let looks = obstacles(ground_m).into_iter().zip(BIASES);
    let wrong = looks.filter_map(|(found, bias)| {
        let Some(found) = found else { return Some(format!("{what}, bias {bias:?}: refused")) };
        let (there, elsewhere): (Vec<Point>, Vec<Point>) = found.into_iter().partition(&on);
        let is_right = there.len() >= least && elsewhere.is_empty();
        let first = elsewhere.first();
        (!is_right).then(|| format!("{what}, bias {bias:?}: {}, and {} at {first:?}", there.len(), elsewhere.len()))
    });
    wrong.chain(dropped).collect()
}

/// A ramp of that slope from its foot or crest on.
fn ramp(from_m: f64, slope: f64) -> impl Fn(f64, f64) -> f64 {
    move |x, _| (x - from_m).max(0.0) * slope
}

#[test]
fn a_ramp_is_floor_wherever_it_begins() {
    let begins = [-1.0, 0.0, 0.3, 0.6, 0.9, 1.2, 1.5, 2.0, 2.5, 3.0];
    let wrong = begins.into_iter().flat_map(|from_m: f64| {
        let under_m = (-from_m).max(0.0) * RAMP;
        let mut wrong = not_floor(&format!("up from {from_m}"), |x, y| ramp(from_m, RAMP)(x, y) - under_m);
        wrong.extend(not_floor(&format!("down from {from_m}"), |x, y| ramp(from_m, -RAMP)(x, y) + under_m));
        wrong
    });
    none(&wrong.collect::<Vec<_>>());
}

#[test]
fn a_ramp_may_end_anywhere() {
    let ends = [0.2, 0.5, 0.8, 1.2, 1.8, 2.4].into_iter().flat_map(|to_m| [(to_m, RAMP), (to_m, -RAMP)]);
    // The robot stands on it.
    let wrong = ends.flat_map(|(to_m, slope)| not_floor(&format!("{slope} up to {to_m}"), |x, _| x.min(to_m) * slope));
    none(&wrong.collect::<Vec<_>>());
}

#[test]
fn a_ramp_beside_the_way_and_a_ramp_across_are_floor() {
    none(&not_floor("a slope to the left", |_, y| y.clamp(-1.0, 1.0) * RAMP));
    none(&not_floor("an oblique foot", |x, y| ((x - 1.5 + 0.5 * y).max(0.0) * RAMP * 0.9).min(0.25)));
}

#[test]
fn a_kerb_is_no_ramp() {
    let wrong = [1.0, 1.2, 1.4, 1.6, 1.8, 2.0].into_iter().flat_map(|at_m| {
        let kerb = move |x: f64, _: f64| if x > at_m { 0.10 } else { 0.0 };
        not_found(&format!("a kerb at {at_m}"), kerb, 60, |point| point.x > at_m - 0.15)
    });
    none(&wrong.collect::<Vec<_>>());
    for at_m in [0.4, 0.6, 0.8] {
        // Of it, its top alone is in view. Half a degree of nose can make the trimmed plane of it, as before there were
        // ramps: the memory holds it.
        let found = obstacles(move |x, _| if x > at_m { 0.10 } else { 0.0 });
        let count = found.into_iter().next().flatten().map_or(0, |points| points.len());
        assert!(count >= 60, "a kerb at {at_m}: {count}");
    }
}

#[test]
fn a_box_on_a_ramp_is_an_obstacle() {
    let places = [(-1.0, 1.2), (0.5, 1.6), (1.2, 1.8), (1.2, 2.4)];
    let boxes = places.into_iter().flat_map(|(from_m, box_m)| [(RAMP, from_m, box_m), (-RAMP, from_m, box_m)]);
    let wrong = boxes.flat_map(|(slope, from_m, box_m): (f64, f64, f64)| {
        let on = move |x: f64, y: f64| (box_m..box_m + 0.3).contains(&x) && y.abs() < 0.15;
        let under_m = (-from_m).max(0.0) * slope;
        let ground = move |x: f64, y: f64| ramp(from_m, slope)(x, y) - under_m + if on(x, y) { 0.15 } else { 0.0 };
        let near = move |point: &Point| (box_m - 0.1..box_m + 0.4).contains(&point.x) && point.y.abs() < 0.25;
        not_found(&format!("a box at {box_m} on {slope} from {from_m}"), ground, 5, near)
    });
    none(&wrong.collect::<Vec<_>>());
}

#[test]
fn a_cell_tells_floor_from_what_lies_behind_a_step() {
    let (header, mut view) = (camera_160(), DepthView::default());
    let at = |view: &DepthView, x: f64| view.floor_at(Point::new(x, 0.1));
    let tilt = held(2.0, 3.0);
    let pixels = seen(&header, &|x, _| if x > 1.7 { -0.3 } else { 0.0 });
    view.fill_tilted(&header, &pixels, Some(&tilt)).expect("some of it is floor");
    assert!(matches!(at(&view, 1.3), FloorCell::Floor(m) if m.abs() < 0.02), "{:?}", at(&view, 1.3));
    assert_eq!(at(&view, 2.2), FloorCell::Unseen, "the edge hides it");
    assert!(matches!(at(&view, 3.6), FloorCell::Apart(m) if (m + 0.3).abs() < 0.03), "{:?}", at(&view, 3.6));
    let pixels = seen(&header, &ramp(1.2, RAMP));
    view.fill_tilted(&header, &pixels, Some(&tilt)).expect("usable");
    assert!(matches!(at(&view, 2.4), FloorCell::Floor(m) if (m - 0.1).abs() < 0.03), "{:?}", at(&view, 2.4));
    view.fill(&header, &pixels).expect("usable");
    assert_eq!(at(&view, 2.4), FloorCell::Unseen, "the attitude is not known");
}

#[test]
fn floor_that_was_seen_before_goes_on_from_the_feet_at_the_end_of_a_ramp_down_and_a_deep_drop_does_not() {
    let header = camera_160();
    let mut view = DepthView::default();
    let mut edges = |ground_m: &dyn Fn(f64, f64) -> f64, was_floor: bool| {
        let told = held(2.0, 3.5);
        let pixels = seen(&header, &ground_m);
        view.fill_remembering(&header, &pixels, Some(&told), |_| was_floor).expect("usable");
        view.edges().len()
    };
    // The robot stands on a ramp, 1.15 m before its foot.
    let foot = |x: f64, _: f64| -0.1 * x.clamp(0.0, 1.15);
    assert_eq!((edges(&foot, false) > 50, edges(&foot, true)), (true, 0));
    let kerb = |rise_m: f64| move |x: f64, _: f64| if x > 0.4 { rise_m } else { 0.0 };
    // A step that was taken. Behind one that was not, no floor was seen.
    assert_eq!((edges(&kerb(-0.1), false) > 50, edges(&kerb(-0.1), true)), (true, 0));
    assert!(edges(&kerb(-0.15), true) > 50, "higher than a step that may be taken");
}

#[test]
fn a_low_step_that_is_known_is_no_edge_while_the_robot_comes_near_to_it() {
    let header = camera_160();
    let mut view = DepthView::with_steps(StepMax { down_m: 0.12, up_m: 0.06 });
    let mut edges = |at_m: f64, is_known: bool| {
        let pixels = seen(&header, &|x, _| if x > at_m { -0.1 } else { 0.0 });
        let known = (-12..=12)
            .filter(|_| is_known)
            .map(|i| FloorStep { place: Point::new(at_m, 0.1 * f64::from(i)), rise_m: -0.1 });
        view.expect_steps(known);
        view.fill_remembering(&header, &pixels, Some(&held(2.0, 3.5)), |_| false).expect("usable");
        view.edges().len()
    };
    let near_m = || (70..=130).step_by(3).map(|cm| f64::from(cm) / 100.0);
    let known: Vec<_> = near_m().map(|at_m| edges(at_m, true)).collect();
    let unknown: Vec<_> = near_m().map(|at_m| edges(at_m, false)).collect();
    assert!(known.iter().all(|edges| *edges == 0), "{known:?}, unknown {unknown:?}");
    assert!(unknown.iter().any(|edges| *edges > 0), "{unknown:?}");
}
