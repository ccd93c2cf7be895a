//! Holes, stairs and dark floor as the depth camera sees them, against a ray that is followed in small steps.

use guidance::Tilt;
use guidance::se2::Point;
use guidedog_world::{DarkFloor, DepthConfig, DepthSensor, Hole, Prism, Scene, Stairs, World, floor};
use messages::{Attitude, Pose2, Pose3};
use nalgebra::{Point3, Rotation3, Vector3};

const WIDTH: usize = 64;
const HEIGHT: usize = 48;
/// A ray goes on by so much, metres; what it finds is no more exact.
const STEP_M: f64 = 0.004;

fn rectangle(at: (f64, f64), yaw_rad: f64, size: [f64; 2]) -> Vec<Point> {
    floor::rectangle(Pose2::new(at.0, at.1, yaw_rad), size[0], size[1])
}

fn camera(pitch_rad: f64) -> DepthConfig {
    DepthConfig {
        width: WIDTH,
        height: HEIGHT,
        robot_from_camera: Pose3 { x_m: 0.25, y_m: 0.0, z_m: 0.45, yaw_rad: 0.0, pitch_rad },
        noise_per_m: 0.0,
        ..DepthConfig::default()
    }
}

fn frame(config: &DepthConfig, world: &World, tilt: Option<Tilt>, number: u64) -> Vec<u16> {
    let mut sensor = DepthSensor::new(config.clone(), 1, 1).expect("a camera");
    let mut pixels = vec![0; sensor.pixels()];
    let scene = Scene::without_people(world, Pose2::default(), tilt);
    sensor.render(&scene, number, &mut pixels);
    pixels
}

/// Whether a place is below the floor that is there, or in a thing.
fn is_solid(world: &World, at: Point3<f64>) -> bool {
    let over = at.xy();
    let in_hole = |hole: &Hole| hole.distance_m(over) == 0.0;
    let floor_m = world.holes().iter().find(|hole| in_hole(hole)).map_or(0.0, |hole| -hole.depth_m);
    at.z < floor_m || world.prisms().iter().any(|p| p.contains(over) && (p.z0_m..=p.z1_m).contains(&at.z))
}

/// The depth that a pixel should have, millimetres.
fn expected_mm(config: &DepthConfig, world: &World, tilt: Option<&Tilt>, pixel: usize) -> f64 {
    let (eye, way) = ray(config, tilt, pixel);
    let step = STEP_M / way.norm();
    let mut depth_m = 0.0;
    while depth_m < config.range_max_m && !is_solid(world, eye + way * depth_m) {
        depth_m += step;
    }
    if depth_m < config.range_max_m { 1000.0 * depth_m } else { 0.0 }
}

/// Where a pixel looks from, and the way that a metre of depth leads.
fn ray(config: &DepthConfig, tilt: Option<&Tilt>, pixel: usize) -> (Point3<f64>, Vector3<f64>) {
    let half_rad: f64 = 0.5 * config.hfov_rad;
    let focal_px = 0.5 * WIDTH as f64 / half_rad.tan();
    let (row, column) = ((pixel / WIDTH) as f64, (pixel % WIDTH) as f64);
    let left = -(column - 0.5 * (WIDTH as f64 - 1.0)) / focal_px;
    let up = -(row - 0.5 * (HEIGHT as f64 - 1.0)) / focal_px;
    let mount = config.robot_from_camera;
    let way = Rotation3::from_euler_angles(0.0, mount.pitch_rad, 0.0) * Vector3::new(1.0, left, up);
    let eye = Point3::new(mount.x_m, mount.y_m, mount.z_m);
    tilt.map_or((eye, way), |tilt| (tilt.place(eye), tilt.direction(way)))
}

/// Holds the way to the ground against the rays, in a world in which nothing else is.
fn hold_ground(config: &DepthConfig, world: &World, tilt: Option<&Tilt>, expected_mm: &[f64]) {
    let is_off = |pixel: &usize| {
        let (eye, way) = ray(config, tilt, *pixel);
        let found_m = world.ground_along(&eye.coords, &way).filter(|depth_m| *depth_m < config.range_max_m);
        (found_m.unwrap_or(0.0) - expected_mm[*pixel] / 1000.0).abs() > STEP_M
    };
    // In a step a flat ray may pass the rim of a hole.
    let off = (0..WIDTH * HEIGHT).filter(is_off).count();
    assert!(off * 200 < WIDTH * HEIGHT, "{off} pixels are off");
}

/// Holds a frame against the rays: pixels on an edge may show either side of it.
fn hold(world: &World, pitch_rad: f64, tilt: Option<Tilt>) {
    let config = camera(pitch_rad);
    let seen = frame(&config, world, tilt, 0);
    let expected: Vec<f64> =
        (0..WIDTH * HEIGHT).map(|pixel| expected_mm(&config, world, tilt.as_ref(), pixel)).collect();
    if world.prisms().is_empty() {
        hold_ground(&config, world, tilt.as_ref(), &expected);
    }
    let is_off = |pixel: &usize| {
        // A flat ray passes much floor in a step.
        (f64::from(seen[*pixel]) - expected[*pixel]).abs() > 8.0 + 0.01 * expected[*pixel]
    };
    let floor = (0..WIDTH * HEIGHT).filter(|pixel| (1..5000).contains(&seen[*pixel]));
    let (off, all) = (floor.clone().filter(is_off).count(), floor.count());
    assert!(all > 500 && off * 50 < all, "{off} of {all} pixels are off");
}

#[test]
fn what_lies_in_a_hole_is_seen_through_its_opening() {
    let hole = |at, yaw_rad, size, depth_m| Hole { outline: rectangle(at, yaw_rad, size), depth_m };
    let world = World::new(100.0, Vec::new())
        .with_holes(vec![hole((1.2, 0.3), 0.4, [1.0, 1.5], 0.4), hole((2.6, -0.6), 0.0, [2.0, 2.0], 3.0)]);
    hold(&world, 0.35, None);
    hold(&world, 0.2, Tilt::of(&Attitude::at_height(1, 0.12, 0.05, 0.31)));
}

#[test]
fn stairs_are_seen_tread_by_tread() {
    let foot = Pose2::new(1.0, 0.0, 0.1);
    let stairs = Stairs { foot, steps: 6, tread_m: 0.3, width_m: 3.0, rise_m: -0.17, landing_m: 2.0, open: false };
    let down = World::new(100.0, Vec::new()).with_holes(stairs.holes().collect());
    hold(&down, 0.4, None);
    let up = Stairs { rise_m: 0.17, ..stairs };
    hold(&World::new(100.0, up.bodies().collect()), 0.4, None);
    hold(&World::new(100.0, Stairs { open: true, ..up }.bodies().collect()), 0.4, None);
}

#[test]
fn a_share_of_dark_floor_says_nothing_and_what_stands_on_it_does() {
    let dark = DarkFloor { outline: rectangle((0.4, 0.0), 0.0, [4.0, 8.0]), silent: 0.3 };
    let thing = Prism::cuboid(Point::new(2.0, 0.0), [0.4, 0.6], 0.0, [0.0, 0.3]);
    let bare = World::new(100.0, vec![thing]);
    let world = bare.clone().with_dark_floor(vec![dark]);
    let config = camera(0.4);
    let (clear, one, other) =
        (frame(&config, &bare, None, 0), frame(&config, &world, None, 0), frame(&config, &world, None, 1));
    let floor_mm = |pixel: usize| expected_mm(&config, &World::new(100.0, Vec::new()), None, pixel);
    let is_floor = |pixel: &usize| (f64::from(clear[*pixel]) - floor_mm(*pixel)).abs() < 12.0;
    let (floor, rest): (Vec<_>, Vec<_>) =
        (0..WIDTH * HEIGHT).filter(|pixel| (1..4000).contains(&clear[*pixel])).partition(is_floor);
    let silent = |of: &[u16]| floor.iter().filter(|pixel| of[**pixel] == 0).count() as f64 / floor.len() as f64;
    assert!(floor.len() > 1000 && rest.len() > 50, "{} and {}", floor.len(), rest.len());
    assert!((silent(&one) - 0.3).abs() < 0.04 && (silent(&other) - 0.3).abs() < 0.04, "{}", silent(&one));
    assert!(one != other, "other pixels in each frame");
    assert!(rest.iter().all(|pixel| one[*pixel] == clear[*pixel]));
}
