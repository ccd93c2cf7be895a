use super::{DepthError, DepthView};
use crate::scan::Beams;
use crate::se2::{Point, Se2};
use crate::tilt::Tilt;
use messages::{Attitude, DepthHeader, Pose3};
use nalgebra::{Point3, Rotation3, Vector3};

fn header() -> DepthHeader {
    DepthHeader {
        width: 64,
        height: 48,
        fx_px: 32.0,
        fy_px: 32.0,
        cx_px: 31.5,
        cy_px: 23.5,
        robot_from_camera: Pose3 { x_m: 0.25, z_m: 0.45, ..Pose3::default() },
        ..DepthHeader::default()
    }
}

#[test]
fn a_wall_ahead_is_a_row_of_points() {
    let mut view = DepthView::default();
    view.fill(&header(), &vec![2000; 64 * 48]).expect("usable");
    assert_eq!(view.points().len(), 64);
    assert!(view.points().iter().all(|p| (p.x - 2.25).abs() < 1e-9));
    assert!(view.sees_free(Point::new(1.5, 0.2)) && !view.sees_free(Point::new(2.4, 0.2)));
    assert!(!view.sees_free(Point::new(-1.0, 0.0)), "behind the camera nothing is seen");
}

#[test]
fn the_lidar_tells_of_what_stands_right_before_the_camera() {
    let beams = |wall_m: f64| {
        let header = crate::scan::tests::header();
        let angle = |i: usize| header.angle_min_rad + i as f64 * header.angle_increment_rad;
        let mut beams = Beams::default();
        let to_wall = |i: usize| if angle(i).cos() > 0.1 { wall_m / angle(i).cos() } else { f64::INFINITY };
        beams.fill_with(&header, 360, to_wall).expect("usable");
        beams
    };
    let before = |wall_m: f64| DepthView::stands_before_something(&header(), 0.3, &beams(wall_m));
    assert!(before(0.45) && before(0.55));
    assert!(!before(0.65) && !before(5.0), "that far the camera sees: something covers it");
}

#[test]
fn the_floor_is_no_obstacle() {
    let mut pixels = vec![0u16; 64 * 48];
    for v in 25..48 {
        // Where the ray of row v meets the floor.
        let depth = 0.45 * 32.0 / (v as f64 - 23.5);
        if depth < 10.0 {
            pixels[v * 64..(v + 1) * 64].fill((depth * 1000.0) as u16);
        }
    }
    let mut view = DepthView::default();
    view.fill(&header(), &pixels).expect("usable");
    assert!(view.points().is_empty());
}

/// The floor as far as a ray reaches it within 10 m, and nothing above.
fn floor() -> Vec<u16> {
    let mut pixels = vec![0u16; 64 * 48];
    for v in 0..48 {
        let depth = 0.45 * 32.0 / (v as f64 - 23.5);
        let seen = v > 23 && depth < 10.0;
        // The upper half sees a wall 9 m away.
        pixels[v * 64..(v + 1) * 64].fill(if seen { (depth * 1000.0) as u16 } else { 9000 });
    }
    pixels
}

#[test]
fn near_the_camera_the_floor_is_below_the_image() {
    let mut pixels = floor();
    pixels[..24 * 64].fill(9000);
    let mut view = DepthView::default();
    view.fill(&header(), &pixels).expect("usable");
    let (near, far) = (Point::new(0.6, 0.0), Point::new(1.6, 0.0));
    assert!(view.sees_free(near) && !view.sees_free_up_to(near, -0.4));
    assert!(view.sees_free_up_to(far, -0.4));
}

#[test]
fn a_thin_bar_across_the_way_is_seen() {
    for row in 0..48 {
        let mut pixels = floor();
        let height = 0.45 - (f64::from(row) - 23.5) / 32.0 * 1.0;
        pixels[row as usize * 64..(row as usize + 1) * 64].fill(1000);
        let mut view = DepthView::default();
        view.fill(&header(), &pixels).expect("usable");
        let seen = view.points().iter().filter(|p| (p.x - 1.25).abs() < 1e-6).count();
        // The last pixel of a row has no neighbour.
        assert_eq!(seen >= 63, (0.08..=1.90).contains(&height), "row {row}, {height} m high: {seen}");
    }
}

#[test]
fn one_pixel_alone_is_no_obstacle_but_is_not_free_either() {
    let mut pixels = floor();
    pixels[20 * 64 + 32] = 1000;
    let mut view = DepthView::default();
    view.fill(&header(), &pixels).expect("usable");
    assert!(view.points().iter().all(|p| p.x > 5.0));
    let ahead = |x: f64| Point::new(0.25 + x, -0.01 * x);
    assert!(view.sees_free(ahead(0.9)) && !view.sees_free(ahead(1.1)));
}

#[test]
fn what_no_pixel_says_anything_about_is_not_free() {
    let mut view = DepthView::default();
    let mut pixels = floor();
    view.fill(&header(), &pixels).expect("usable");
    let ahead = Point::new(3.0, 0.0);
    assert!(view.sees_free(ahead));
    // A black thing on the floor returns nothing: rows 10 to 40 of the middle.
    for v in 10..40 {
        pixels[v * 64 + 24..v * 64 + 40].fill(0);
    }
    view.fill(&header(), &pixels).expect("usable");
    assert!(!view.sees_free(ahead));
    let covered = view.fill(&header(), &vec![0; 64 * 48]);
    assert!(matches!(covered, Err(DepthError::Blind { known: 0, .. })));
    assert!(!view.sees_free(Point::new(0.5, 0.0)) && view.points().is_empty());
}

#[test]
fn a_robot_that_moved_on_is_nearer_to_what_it_saw() {
    let mut view = DepthView::default();
    view.fill(&header(), &vec![2000; 64 * 48]).expect("usable");
    view.move_to(&Se2::translation(-0.5, 0.0));
    assert!(view.points().iter().all(|p| (p.x - 1.75).abs() < 1e-9));
    assert!(view.sees_free(Point::new(1.5, 0.1)) && !view.sees_free(Point::new(1.9, 0.1)));
}

pub(crate) fn held(roll_deg: f64, pitch_deg: f64) -> Tilt {
    let [roll_rad, pitch_rad] = [roll_deg, pitch_deg].map(f64::to_radians);
    Tilt::of(&Attitude { stamp_ns: 1, roll_rad, pitch_rad, height_m: 0.28, standing_m: 0.30 }).expect("known")
}

/// What the camera of `header` sees of a floor, of a wall at x = 5 and of a block between two places, when the body
/// is held so.
fn seen(header: &DepthHeader, tilt: &Tilt, block: Option<[[f64; 3]; 2]>) -> Vec<u16> {
    let mount = header.robot_from_camera;
    let eye = tilt.place(Point3::new(mount.x_m, mount.y_m, mount.z_m));
    let mounted = Rotation3::from_euler_angles(0.0, mount.pitch_rad, mount.yaw_rad);
    let depth_at = |i: usize| {
        let (v, u) = (i / header.width as usize, i % header.width as usize);
        let ray = tilt.direction(mounted * Vector3::new(1.0, super::left_of(header, u), super::up_of(header, v)));
        let floor_m = if ray.z < 0.0 { -eye.z / ray.z } else { f64::INFINITY };
        let wall_m = if ray.x > 0.0 { (5.0 - eye.x) / ray.x } else { f64::INFINITY };
        let block_m = block.map_or(f64::INFINITY, |[low, high]| {
            let sides = [0, 1, 2].map(|axis| {
                let ends = [low[axis], high[axis]].map(|end| (end - eye[axis]) / ray[axis]);
                [ends[0].min(ends[1]), ends[0].max(ends[1])]
            });
            let enters = sides.iter().map(|side| side[0]).fold(0.0, f64::max);
            let leaves = sides.iter().map(|side| side[1]).fold(f64::INFINITY, f64::min);
            if enters < leaves { enters } else { f64::INFINITY }
        });
        floor_m.min(wall_m).min(block_m)
    };
    let mm = |i: usize| Some(depth_at(i)).filter(|m| *m < 10.0).map_or(0, |m| (m * 1000.0).round() as u16);
    (0..(header.width * header.height) as usize).map(mm).collect()
}

pub(crate) fn camera_160() -> DepthHeader {
    DepthHeader { width: 160, height: 120, fx_px: 80.0, fy_px: 80.0, cx_px: 79.5, cy_px: 59.5, ..header() }
}

#[test]
fn a_bare_floor_is_none_however_the_body_is_held_and_a_low_block_stands_where_it_stands() {
    let (header, mut view) = (camera_160(), DepthView::default());
    let block = [[1.2, -0.1, 0.0], [1.4, 0.1, 0.12]];
    for (roll_deg, pitch_deg) in [(0.0, 0.0), (6.0, 0.0), (-6.0, 8.0), (12.0, -5.0), (-12.0, 12.0)] {
        let tilt = held(roll_deg, pitch_deg);
        view.fill_tilted(&header, &seen(&header, &tilt, None), Some(&tilt)).expect("usable");
        let near = view.points().iter().filter(|p| p.x < 4.8).count();
        assert_eq!(near, 0, "{roll_deg} {pitch_deg}: {:?}", view.points());
        assert!(view.sees_free_up_to(Point::new(2.0, 0.2), 0.0) && view.sees_free(Point::new(4.5, 0.0)));
        view.fill_tilted(&header, &seen(&header, &tilt, Some(block)), Some(&tilt)).expect("usable");
        let on_block = |p: &&Point| (1.15..1.45).contains(&p.x) && p.y.abs() < 0.13;
        let found = view.points().iter().filter(on_block).count();
        assert!(found >= 8, "{roll_deg} {pitch_deg}: {found}");
        assert!(!view.sees_free(Point::new(1.5, 0.0)) && view.sees_free(Point::new(1.5, 0.5)));
    }
}

#[test]
fn an_attitude_that_is_half_a_degree_off_makes_no_obstacle_of_the_floor() {
    let (header, mut view) = (camera_160(), DepthView::default());
    for (roll_off_deg, pitch_off_deg) in [(0.5, 0.5), (-0.9, 0.9), (0.9, -0.9)] {
        let (truth, told) = (held(4.0, 3.0), held(4.0 + roll_off_deg, 3.0 + pitch_off_deg));
        view.fill_tilted(&header, &seen(&header, &truth, None), Some(&told)).expect("usable");
        assert!(view.points().iter().all(|p| p.x > 3.0), "{:?}", view.points());
    }
}

#[test]
fn what_some_rows_of_a_rolled_image_do_not_reach_is_not_seen_free() {
    let (header, tilt, mut view) = (camera_160(), held(12.0, 0.0), DepthView::default());
    view.fill_tilted(&header, &seen(&header, &tilt, None), Some(&tilt)).expect("usable");
    let at = |bearing: f64| Point::new(0.25 + 2.0, 2.0 * bearing);
    assert!(view.sees_free(at(0.0)) && !view.sees_free(at(0.97)) && !view.sees_free(at(-0.97)));
}

#[test]
fn a_frame_of_the_wrong_size_is_refused() {
    let mut view = DepthView::default();
    assert!(matches!(view.fill(&header(), &[1; 100]), Err(DepthError::Size { pixels: 100, .. })));
    assert!(view.points().is_empty());
}
