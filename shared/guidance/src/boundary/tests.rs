use super::{Boundary, Directions, Readings};
use crate::hull::{Disc, Hull};
use crate::se2::Point;
use nalgebra::Vector2;
use proptest::prelude::*;

fn any_disc() -> impl Strategy<Value = Disc> {
    (-1.5..1.5f64, -1.5..1.5f64, 0.05..0.5f64).prop_map(|(x, y, radius_m)| Disc { center: Point::new(x, y), radius_m })
}

/// Discs on a grid, whose tangents often are one and the same, or begin where the walk begins.
fn grid_disc() -> impl Strategy<Value = Disc> {
    (-4..=4i8, -4..=4i8, 1..=3u8).prop_map(|(x, y, r)| Disc {
        center: Point::new(f64::from(x) * 0.25, f64::from(y) * 0.25),
        radius_m: f64::from(r) * 0.25,
    })
}

/// Four discs as they are in practice too: some equal, some in one line, some within others.
fn any_discs() -> impl Strategy<Value = [Disc; 4]> {
    let grid = || [grid_disc(), grid_disc(), grid_disc(), grid_disc()];
    let nearly_grid = (grid(), any::<u64>()).prop_map(|(discs, bits)| nearly(discs, bits));
    prop_oneof![1 => grid(), 1 => nearly_grid, 2 => drawn_discs()]
}

/// As rounding leaves what would be a tie: off by some 1e-16 to 1e-10.
fn nearly(mut discs: [Disc; 4], bits: u64) -> [Disc; 4] {
    for (i, disc) in discs.iter_mut().enumerate() {
        let off = |n: usize| {
            let byte = bits >> (8 * ((2 * i + n) % 8)) & 0xff;
            (byte as f64 / 127.5 - 1.0) * [0.0, 1e-16, 1e-13, 1e-10][(byte % 4) as usize]
        };
        disc.center += Vector2::new(off(0), off(1));
    }
    discs
}

fn drawn_discs() -> impl Strategy<Value = [Disc; 4]> {
    ([any_disc(), any_disc(), any_disc(), any_disc()], 0..6u8).prop_map(|([a, b, c, d], kind)| match kind {
        0 => [a, b, a, b],
        1 => [a, a, a, a],
        2 => {
            let step = Vector2::new(0.25, 0.0);
            [a, b, Disc { center: a.center + step, ..a }, Disc { center: b.center + step, ..b }]
        }
        3 => [a, Disc { radius_m: a.radius_m, ..b }, Disc { center: nalgebra::center(&a.center, &b.center), ..a }, a],
        4 => [Disc { radius_m: 2.0, ..a }, b, c, d],
        _ => [a, b, c, d],
    })
}

fn fan(count: usize, first_rad: f64) -> (Vec<f64>, Vec<f64>, f64) {
    let increment = std::f64::consts::TAU / count as f64;
    let angle = |i: usize| first_rad + i as f64 * increment;
    ((0..count).map(|i| angle(i).cos()).collect(), (0..count).map(|i| angle(i).sin()).collect(), increment)
}

proptest! {
    #![proptest_config(crate::testing::cases())]
    #[test]
    fn piece_by_piece_is_as_all_at_once(
        discs in any_discs(), which in 0..4usize, first in -7.0..7.0f64, guess in 0..97usize,
    ) {
        let (hull, boundary) = (Hull::new(discs), Boundary::of(&discs));
        let origin = discs[which].center;
        let (x, y, increment_rad) = fan(97, first);
        let beams = Directions { x: &x, y: &y, first_rad: first, increment_rad };
        let seen = boundary.seen_from(origin).expect("a disc's middle is within");
        let mut thresholds = Vec::new();
        let parts = seen.over(beams);
        parts.thresholds_m(&mut thresholds);
        for i in 0..97 {
            let truth = hull.threshold_m(origin, Vector2::new(x[i], y[i]));
            prop_assert!((thresholds[i] - truth).abs() < 1e-6, "beam {i}: {} {}", thresholds[i], truth);
        }
        let readings: Vec<f64> = (0..97).map(|i| 0.5 + 0.02 * f64::from((i * 37 % 97) as u32)).collect();
        let mut sorted = Readings::default();
        sorted.fill(readings.iter().copied());
        let margins: Vec<f64> = readings.iter().zip(&thresholds).map(|(r, t)| r - t).collect();
        let truth = margins.iter().copied().fold(f64::INFINITY, f64::min);
        for guess in [None, sorted.nearest(), Some(guess)] {
            let (least, beam) = parts.least_margin_m(&sorted, guess);
            prop_assert!((least - truth).abs() < 1e-12);
            prop_assert!(beam.is_some_and(|beam| (margins[beam] - least).abs() < 1e-12));
        }
        let (mut below, mut expected) = (Vec::new(), Vec::new());
        parts.each_below(&sorted, |beam, threshold| below.push((beam, threshold.to_bits())));
        expected.extend((0..97).filter(|i| margins[*i] < 0.0));
        below.sort_unstable();
        prop_assert_eq!(below.iter().map(|(beam, _)| *beam).collect::<Vec<_>>(), expected);
        for (beam, threshold) in below {
            prop_assert!((f64::from_bits(threshold) - thresholds[beam]).abs() < 1e-12);
        }
        // Each of some is told once, wherever the pieces end.
        let which: Vec<usize> = (0..97).filter(|i| i % 3 != guess % 3).collect();
        let mut some = Vec::new();
        parts.some_thresholds_m(&which, |beam, threshold| some.push((beam, threshold)));
        prop_assert_eq!(some.iter().map(|(beam, _)| *beam).collect::<Vec<_>>(), which);
        prop_assert!(some.iter().all(|(beam, threshold)| *threshold == thresholds[*beam]));
    }

    #[test]
    fn within_is_where_the_distance_is_negative(discs in any_discs(), x in -2.5..2.5f64, y in -2.5..2.5f64) {
        let (hull, point) = (Hull::new(discs), Point::new(x, y));
        let distance = hull.signed_distance_m(point);
        if distance.abs() > 1e-7 {
            prop_assert_eq!(Boundary::of(&discs).seen_from(point).is_some(), distance < 0.0, "{}", distance);
        }
    }

    #[test]
    fn areas_add_up_to_what_many_thin_triangles_have(
        discs in any_discs(), from in -4.0..4.0f64, turn in 0.0..6.2f64,
    ) {
        let (hull, boundary) = (Hull::new(discs), Boundary::of(&discs));
        let seen = boundary.seen_from(discs[0].center).expect("a disc's middle is within");
        let steps = 4000;
        let thin: f64 = (0..steps)
            .map(|i| {
                let angle = from + turn * (f64::from(i) + 0.5) / f64::from(steps);
                hull.threshold_m(discs[0].center, Vector2::new(angle.cos(), angle.sin())).powi(2) / 2.0
            })
            .sum::<f64>() * turn / f64::from(steps);
        let area = seen.area_between_m2(from, from + turn);
        prop_assert!((area - thin).abs() < 2e-4 * (1.0 + thin), "{area} {thin}");
    }
}

#[test]
fn a_disc_alone_is_a_circle() {
    let disc = Disc { center: Point::new(0.2, -0.1), radius_m: 0.5 };
    let boundary = Boundary::of(&[disc; 4]);
    let seen = boundary.seen_from(disc.center).expect("its middle is within");
    assert!((seen.area_between_m2(0.3, 0.3 + std::f64::consts::TAU) - std::f64::consts::PI * 0.25).abs() < 1e-9);
    assert!(boundary.seen_from(Point::new(0.8, -0.1)).is_none());
}

#[test]
fn the_nearest_reading_is_found_in_the_last_block_too() {
    let mut readings = Readings::default();
    for (count, nearest) in [(5, 3), (32, 31), (70, 66), (96, 40)] {
        readings.fill((0..count).map(|i| if i == nearest { 0.5 } else { 1.0 + i as f64 }));
        assert_eq!(readings.nearest(), Some(nearest));
    }
    readings.fill(std::iter::empty());
    assert_eq!(readings.nearest(), None);
}

/// Robot and handler take a step to the side: two discs of each reach equally far, ahead and behind.
#[test]
fn a_step_to_the_side_has_a_straight_edge_ahead() {
    let disc = |x, y, radius_m| Disc { center: Point::new(x, y), radius_m };
    for side in [0.15, -0.15] {
        let discs =
            [disc(0.0, 0.0, 0.3), disc(-0.75, -0.35, 0.25), disc(0.0, side, 0.3), disc(-0.75, side - 0.35, 0.25)];
        let (hull, boundary) = (Hull::new(discs), Boundary::of(&discs));
        let seen = boundary.seen_from(Point::origin()).expect("a disc's middle is within");
        let (x, y, increment_rad) = fan(360, 0.0);
        let mut thresholds = Vec::new();
        seen.over(Directions { x: &x, y: &y, first_rad: 0.0, increment_rad }).thresholds_m(&mut thresholds);
        for i in 0..360 {
            let truth = hull.threshold_m(Point::origin(), Vector2::new(x[i], y[i]));
            assert!((thresholds[i] - truth).abs() < 1e-9, "{i} degrees: {} {truth}", thresholds[i]);
        }
    }
}
