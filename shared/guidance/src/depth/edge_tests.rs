//! Floors that drop, in depth frames without noise, with an attitude that is half a degree off.

use super::ramp_tests::{edges, seen};
use super::tests::{camera_160, held};
use super::{DepthView, FloorCell};
use crate::se2::Point;
use messages::DepthHeader;

/// A camera of few pixels.
fn camera_128() -> DepthHeader {
    DepthHeader { width: 128, height: 64, fx_px: 64.0, fy_px: 45.0, cx_px: 63.5, cy_px: 31.5, ..camera_160() }
}

/// What is wrong where the columns within 0.4 m of the way do not show an edge at `edge_m` ahead. It may be told nearer
/// than it is by two rows of pixels, and farther by 2 cm.
fn no_edge(what: &str, header: &DepthHeader, edge_m: f64, ground_m: impl Fn(f64, f64) -> f64) -> Vec<String> {
    let ahead_m = edge_m - header.robot_from_camera.x_m;
    let nearer_m = 0.02 + 2.0 * super::apart_at_1_m(header, header.robot_from_camera.z_m) * ahead_m * ahead_m;
    let wrong = edges(header, ground_m).into_iter().filter_map(|edges| {
        let before: Vec<_> = edges.iter().filter(|edge| edge.y.abs() < 0.4).collect();
        let columns = 0.8 / ahead_m * header.fx_px;
        let is_near = |edge: &&&Point| (edge_m - nearer_m..edge_m + 0.02).contains(&edge.x);
        let off = before.iter().find(|edge| !is_near(edge));
        let count = before.len();
        (off.is_some() || (count as f64) < 0.95 * columns - 2.0)
            .then(|| format!("{what} at {edge_m}: {count} of {columns:.0} columns, one tells {off:?}"))
    });
    wrong.collect()
}

#[test]
fn a_drop_has_an_edge_where_the_floor_ends() {
    let mut wrong = Vec::new();
    for (header, drops_m) in [(camera_160(), [0.12, 0.3, 2.0]), (camera_128(), [0.15, 0.5, 1.0])] {
        for drop_m in drops_m {
            for edge_m in [1.2, 1.35, 1.5] {
                let cliff = move |x: f64, _: f64| if x > edge_m { -drop_m } else { 0.0 };
                wrong.extend(no_edge(&format!("a drop of {drop_m}"), &header, edge_m, cliff));
            }
        }
        let stairs = |x: f64, _: f64| if x > 1.4 { -0.17 * (1.0 + ((x - 1.4) / 0.28).floor()).min(8.0) } else { 0.0 };
        wrong.extend(no_edge("stairs down", &header, 1.4, stairs));
        let hole = |x: f64, _: f64| if (1.4..2.4).contains(&x) { -1.0 } else { 0.0 };
        wrong.extend(no_edge("a hole", &header, 1.4, hole));
        let ramp = |x: f64, _: f64| if x > 1.4 { -0.4 } else { -x / 12.0 };
        wrong.extend(no_edge("the end of a ramp", &header, 1.4, ramp));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn an_edge_beside_the_way_is_told_along_it() {
    for edges in edges(&camera_160(), |_, y| if y < -0.5 { -0.5 } else { 0.0 }) {
        // Where the image ends before the floor does, a column shows only that floor is missing farther on.
        assert!(edges.iter().all(|edge| edge.y < -0.35), "{edges:?}");
        let edges: Vec<_> = edges.into_iter().filter(|edge| edge.y > -0.51).collect();
        assert!(edges.iter().any(|edge| edge.x < 1.2) && edges.iter().any(|edge| edge.x > 1.8), "{edges:?}");
    }
}

#[test]
fn where_all_that_is_in_view_lies_below_the_edge_is_no_farther_than_the_first_ray() {
    for edges in edges(&camera_160(), |x, _| if x > 0.5 { -0.5 } else { 0.0 }) {
        let nearest_m = edges.iter().map(|edge| edge.x).fold(f64::INFINITY, f64::min);
        assert!(edges.len() > 100 && nearest_m < 1.1, "{nearest_m}: {edges:?}");
    }
}

#[test]
fn a_kerb_beside_a_ramp_to_the_same_road_is_an_edge() {
    // A dropped kerb between y = -0.5 and 0.5 leads to a road 0.15 m below; beside it is the kerb.
    let road = |x: f64, y: f64| match x - 1.0 {
        beyond if beyond <= 0.0 => 0.0,
        beyond if y.abs() < 0.5 => -(beyond / 12.0).min(0.15),
        _ => -0.15,
    };
    for edges in edges(&camera_160(), road) {
        let kerb = edges.iter().filter(|edge| edge.y.abs() > 0.55 && (0.85..1.05).contains(&edge.x)).count();
        assert!(kerb > 20, "{kerb}: {edges:?}");
    }
}

#[test]
fn the_crest_of_a_ramp_that_ends_in_a_drop_is_an_edge() {
    let crest = |x: f64, _: f64| if x > 1.2 { 0.0 } else { (x / 9.0).max(0.0) };
    for edges in edges(&camera_160(), crest) {
        let at = edges.iter().filter(|edge| edge.y.abs() < 0.4 && (1.05..1.22).contains(&edge.x)).count();
        assert!(at > 40, "{at}: {edges:?}");
    }
}

#[test]
fn pixels_that_say_nothing_are_no_floor() {
    // A hole, half a metre wide, that swallows all light.
    let header = camera_160();
    let mut pixels = seen(&header, &|_, _| 0.0);
    let deep = seen(&header, &|x, _| if (2.0..2.5).contains(&x) { -3.0 } else { 0.0 });
    for (pixel, deep) in pixels.iter_mut().zip(&deep) {
        *pixel = if pixel == deep { *pixel } else { 0 };
    }
    let mut view = DepthView::default();
    view.fill_tilted(&header, &pixels, Some(&held(2.0, 3.0))).expect("usable");
    assert!(view.sees_floor(Point::new(1.8, 0.1)));
    assert!((20..26).all(|x| !view.sees_floor(Point::new(0.1 * f64::from(x), 0.1))));
}

#[test]
fn the_floor_is_seen_and_edges_lie_where_they_are_below_a_camera_that_looks_down() {
    let mut header = camera_160();
    header.robot_from_camera.pitch_rad = 0.45;
    let mut view = DepthView::default();
    let flat = seen(&header, &|_, _| 0.0);
    view.fill_tilted(&header, &flat, Some(&held(2.0, 3.0))).expect("usable");
    let places = || (8..20).flat_map(|x| (-4..=4).map(move |y| (0.1 * f64::from(x), 0.1 * f64::from(y))));
    let unseen: Vec<_> = places().filter(|(x, y)| !view.sees_floor(Point::new(*x, *y))).collect();
    assert!(view.edges().is_empty() && unseen.is_empty(), "{unseen:?}");
    let beside = seen(&header, &|_, y| if y < -0.5 { -0.5 } else { 0.0 });
    view.fill_tilted(&header, &beside, Some(&held(2.0, 3.0))).expect("usable");
    let found = view.edges().iter().filter(|edge| (-0.52..-0.4).contains(&edge.y)).count();
    assert!(found > 20 && view.edges().iter().all(|edge| edge.y < -0.4), "{found}: {:?}", view.edges());
}

#[test]
fn floor_is_seen_up_to_the_edge_and_not_beyond() {
    let (header, mut view) = (camera_160(), DepthView::default());
    let pixels = seen(&header, &|x, _| if x > 1.6 { -0.3 } else { 0.0 });
    view.fill_tilted(&header, &pixels, Some(&held(2.0, 3.0))).expect("usable");
    let sees = |x_m: f64| view.sees_floor(Point::new(x_m, 0.1));
    assert!(!sees(0.3), "below the image");
    assert!(sees(1.2) && sees(1.45));
    assert!(!sees(1.59) && !sees(1.7) && !sees(2.5));
    let first = *view.edges().first().expect("an edge");
    view.move_to(&crate::se2::se2(messages::Pose2::new(-0.5, 0.0, 0.0)));
    assert!((view.edges()[0].x - first.x + 0.5).abs() < 1e-12);
    assert!(view.sees_floor(Point::new(0.9, 0.1)) && !view.sees_floor(Point::new(1.2, 0.1)));
    view.clear();
    assert!(view.edges().is_empty() && !view.sees_floor(Point::new(0.9, 0.1)));
}

#[test]
fn the_cells_of_a_lower_level_are_not_floor() {
    for drop_m in [0.12, 0.3, 1.0] {
        let (header, mut view) = (camera_160(), DepthView::default());
        let pixels = seen(&header, &move |x, _| if x > 1.5 { -drop_m } else { 0.0 });
        view.fill_tilted(&header, &pixels, Some(&held(2.0, 3.0))).expect("usable");
        let lower = (16..40).map(|i| view.floor_at(Point::new(0.1 * f64::from(i), 0.1)));
        assert!(lower.into_iter().all(|cell| !matches!(cell, FloorCell::Floor(m) if m < -0.08)), "{drop_m}");
    }
}

#[test]
fn a_hole_too_narrow_for_its_bottom_to_show_has_an_edge() {
    let cases = [(camera_160(), 0.3, 1.3), (camera_160(), 0.2, 1.1), (camera_128(), 0.3, 1.3)];
    for (header, width_m, up_to_m) in cases {
        for deep_m in [0.12, 0.15, 0.5] {
            for edge_m in [1.1, 1.2, 1.3].into_iter().filter(|edge_m| *edge_m <= up_to_m) {
                let hole = move |x: f64, _: f64| if (edge_m..edge_m + width_m).contains(&x) { -deep_m } else { 0.0 };
                let what = format!("{} pixels: a hole of {width_m} m, {deep_m} m deep", header.width);
                let wrong = no_edge(&what, &header, edge_m, hole);
                assert!(wrong.is_empty(), "{}", wrong.join("\n"));
            }
        }
    }
}

#[test]
fn a_shallow_gutter_and_a_ramp_have_no_edge() {
    for header in [camera_160(), camera_128()] {
        let gutter = |x: f64, _: f64| -0.03 * (1.0 - ((x - 1.3) / 0.15).abs()).max(0.0);
        let ramp = |x: f64, _: f64| -((x - 1.2) / 12.0).clamp(0.0, 0.06);
        for edges in edges(&header, gutter).into_iter().chain(edges(&header, ramp)) {
            assert!(edges.is_empty(), "{edges:?}");
        }
    }
}
