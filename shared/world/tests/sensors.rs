//! Sensors against what can be said of a scene without them.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests are tests too")]

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use guidance::Tilt;
use guidance::se2::Point;
use guidedog_world::{
    Cell, DepthConfig, DepthSensor, GridMap, LidarConfig, LidarSensor, OdometryConfig, OdometrySensor, Prism, Scene,
    SeenBy, World,
};
use messages::{Attitude, Pose2, Pose3, Twist2, Walker};
use nalgebra::{Point3, Rotation3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const FULL: [f64; 2] = [0.0, 2.6];

fn scene(world: &World, x: f64, y: f64, yaw: f64) -> Scene<'_> {
    Scene::without_people(world, Pose2::new(x, y, yaw), None)
}

/// A wall across the way, `distance` ahead of the origin.
fn wall_ahead(distance: f64) -> World {
    World::new(2.6, vec![Prism::wall(vec![Point::new(distance, -30.0), Point::new(distance, 30.0)], FULL)])
}

fn random_world(random: &mut ChaCha8Rng) -> World {
    let mut at = || Point::new(random.random_range(-8.0..8.0), random.random_range(-8.0..8.0));
    let places: Vec<_> = (0..60).map(|_| at()).collect();
    let prisms = places.chunks_exact(3).enumerate().map(|(i, p)| match i % 3 {
        0 => Prism::wall(p.to_vec(), [0.0, 0.2 + 0.1 * i as f64]),
        1 => Prism::cuboid(p[0], [0.1 + p[1].x.abs() / 8.0, 0.1 + p[1].y.abs() / 8.0], p[2].x, [0.05 * i as f64, 1.5]),
        _ => Prism::pillar(p[0], 0.1 + p[1].x.abs() / 20.0, FULL),
    });
    World::new(2.6, prisms.collect())
}

/// Ray against every face, without an index.
fn brute_force(world: &World, origin: Point, direction: Vector2<f64>, z: f64) -> f64 {
    let seen = world.prisms().iter().filter(|prism| (prism.z0_m..=prism.z1_m).contains(&z));
    let hits = seen.flat_map(|prism| prism.sides()).filter_map(|(a, b)| {
        let (along, to_a) = (b - a, a - origin);
        let cross = direction.perp(&along);
        let (t, u) = (to_a.perp(&along) / cross, to_a.perp(&direction) / cross);
        (t >= 0.0 && (0.0..=1.0).contains(&u)).then_some(t)
    });
    hits.fold(f64::INFINITY, f64::min)
}

#[test]
fn the_index_finds_what_brute_force_finds() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    for _ in 0..20 {
        let world = random_world(&mut random);
        for _ in 0..500 {
            let origin = Point::new(random.random_range(-12.0..12.0), random.random_range(-12.0..12.0));
            let angle: f64 = random.random_range(-PI..PI);
            let (direction, z) = (Vector2::new(angle.cos(), angle.sin()), random.random_range(0.0..2.6));
            let found = world.cast(origin, direction, z, 100.0).unwrap_or(f64::INFINITY);
            let expected = brute_force(&world, origin, direction, z);
            assert!(found == expected || (found - expected).abs() < 1e-9, "{found} {expected}");
        }
        let at = Point::new(random.random_range(-8.0..8.0), random.random_range(-8.0..8.0));
        let nearest = world.clearance(at, FULL, 3.0);
        let around = (0..3600).filter_map(|i| {
            let angle = f64::from(i) * PI / 1800.0;
            world
                .prisms()
                .iter()
                .all(|prism| !prism.contains(at))
                .then(|| brute_force_any(&world, at, Vector2::new(angle.cos(), angle.sin())))
        });
        let by_rays = around.fold(3.0, f64::min);
        assert!(nearest <= by_rays + 1e-9 && (nearest == 0.0 || by_rays - nearest < 0.02), "{nearest} {by_rays}");
    }
}

fn brute_force_any(world: &World, origin: Point, direction: Vector2<f64>) -> f64 {
    let faces = world.prisms().iter().map(|prism| Prism { z0_m: 0.0, z1_m: 2.6, ..prism.clone() }).collect();
    brute_force(&World::new(2.6, faces), origin, direction, 1.0)
}

fn random_map(random: &mut ChaCha8Rng, world_from_map: Pose2) -> GridMap {
    let kinds = [Cell::Free, Cell::Free, Cell::Free, Cell::Free, Cell::Free, Cell::Free, Cell::Occupied, Cell::Unknown];
    let cells = (0..40 * 30).map(|_| kinds[random.random_range(0..kinds.len())]).collect();
    GridMap::new(40, 0.25, world_from_map, cells)
}

#[test]
fn a_map_is_cast_as_the_borders_of_its_cells() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for yaw in [0.0, 0.7, -2.0] {
        let pose = Pose2::new(-3.0, 2.0, yaw);
        let map = random_map(&mut random, pose);
        let mut borders = Vec::new();
        for (column, row) in (0..40).flat_map(|column| (0..30).map(move |row| (column, row))) {
            if map.cell(column, row) != Cell::Free {
                let middle = map.middle(column as usize, row as usize);
                borders.push(Prism::cuboid(middle, [0.25, 0.25], yaw, FULL));
            }
        }
        let middle = guidance::se2::se2(pose) * Point::new(5.0, 3.75);
        borders.push(Prism::cuboid(middle, [10.0, 7.5], yaw, FULL));
        let same = World::new(2.6, borders);
        let world = World::new(2.6, vec![]).with_map(map);
        let map = world.map().unwrap();
        for _ in 0..2000 {
            let origin = map.middle(random.random_range(0..40), random.random_range(0..30));
            if map.at(origin) != Cell::Free {
                assert_eq!(world.cast(origin, Vector2::x(), 1.0, 5.0), Some(0.0));
                continue;
            }
            let angle: f64 = random.random_range(-PI..PI);
            let direction = Vector2::new(angle.cos(), angle.sin());
            let found = world.cast(origin, direction, 1.0, 50.0).unwrap();
            let expected = same.cast(origin, direction, 1.0, 50.0).unwrap();
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
            let (a, b) = (world.clearance(origin, FULL, 1.0), same.clearance(origin, FULL, 1.0));
            assert!(b == 0.0 || (a - b).abs() < 1e-9, "{a} {b}");
        }
    }
}

#[test]
fn a_lidar_measures_walls_people_and_the_handler() {
    let config =
        LidarConfig { sigma_m: 0.0, drop_out: 0.0, beams: 4, angle_increment_rad: FRAC_PI_2, ..Default::default() };
    let mut sensor = LidarSensor::new(config, 1, 1).unwrap();
    let mut world = wall_ahead(5.0);
    world = world.with_prisms([Prism::cuboid(Point::new(-3.0, 0.0), [0.4, 0.4], 0.0, [0.0, 0.25])]);
    let mut ranges = [0.0f32; 4];
    sensor.scan(&scene(&world, 1.0, 0.0, 0.0), 0, &mut ranges);
    // Behind, right, ahead, left: the box behind is lower than the lidar.
    assert_eq!(ranges, [f32::INFINITY, f32::INFINITY, 3.9, f32::INFINITY]);
    let walkers = [Walker { x_m: 3.0, y_m: 0.0, radius_m: 0.25 }];
    let handler = Some(Pose2::new(0.0, 0.0, 0.0));
    let seen = Scene { walkers: &walkers, world_from_handler: handler, ..scene(&world, 1.0, 0.0, 0.0) };
    sensor.scan(&seen, 0, &mut ranges);
    assert!((ranges[2] - 1.65).abs() < 1e-6 && (ranges[0] - 0.9).abs() < 1e-6, "{ranges:?}");
    let near = scene(&world, 4.85, 0.0, 0.0);
    sensor.scan(&near, 0, &mut ranges);
    assert!(ranges[2].is_nan(), "nearer than the least range is unknown");
}

#[test]
fn glass_is_not_seen_and_blocks() {
    let mut glass = Prism::wall(vec![Point::new(2.0, -1.0), Point::new(2.0, 1.0)], FULL);
    glass.seen_by = SeenBy::Nobody;
    let world = wall_ahead(5.0).with_prisms([glass]);
    assert_eq!(world.cast(Point::origin(), Vector2::x(), 0.4, 12.0), Some(5.0));
    assert!(world.free_share(Point::origin(), Point::new(4.0, 0.0), 0.3, [0.02, 0.6]).is_some());
}

#[test]
fn noise_depends_on_seed_incarnation_and_frame_alone() {
    let world = wall_ahead(5.0);
    let scan = |seed, incarnation, frame| {
        let mut sensor = LidarSensor::new(LidarConfig::default(), seed, incarnation).unwrap();
        let mut ranges = vec![0.0f32; 360];
        sensor.scan(&scene(&world, 0.0, 0.0, 0.1), frame, &mut ranges);
        ranges.iter().map(|range| range.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(scan(1, 2, 3), scan(1, 2, 3));
    for other in [scan(2, 2, 3), scan(1, 3, 3), scan(1, 2, 4)] {
        assert_ne!(scan(1, 2, 3), other);
    }
    let depth = |seed, frames: &[u64]| {
        let config = DepthConfig { width: 64, height: 48, ..Default::default() };
        let mut sensor = DepthSensor::new(config, seed, 1).unwrap();
        let mut pixels = vec![0; 64 * 48];
        for &frame in frames {
            sensor.render(&scene(&world, 0.0, 0.0, 0.1), frame, &mut pixels);
        }
        pixels
    };
    assert_eq!(depth(1, &[1, 2, 9]), depth(1, &[9]));
    assert_ne!(depth(1, &[9]), depth(2, &[9]));
    assert_ne!(depth(1, &[9]), depth(1, &[8]));
}

#[test]
fn lidar_noise_is_as_configured() {
    let world = wall_ahead(5.0);
    let config = LidarConfig { beams: 4000, angle_min_rad: 0.0, angle_increment_rad: 0.0, ..Default::default() };
    let mut ranges = vec![0.0f32; 4000];
    LidarSensor::new(config, 5, 1).unwrap().scan(&scene(&world, 0.0, 0.0, 0.0), 0, &mut ranges);
    let good: Vec<_> = ranges.iter().filter(|range| range.is_finite()).map(|&range| f64::from(range)).collect();
    let mean = good.iter().sum::<f64>() / good.len() as f64;
    let sigma = (good.iter().map(|range| (range - mean).powi(2)).sum::<f64>() / good.len() as f64).sqrt();
    assert!((mean - 4.9).abs() < 0.003 && (sigma - 0.025).abs() < 0.002, "{mean} {sigma}");
    let lost = 1.0 - good.len() as f64 / 4000.0;
    assert!((0.001..0.012).contains(&lost), "{lost}");
}

/// A mount's place and a direction on the body, in the level robot frame.
fn held(scene: &Scene<'_>, mount: Point3<f64>, way: Vector3<f64>) -> (Point3<f64>, Vector3<f64>) {
    scene.tilt.map_or((mount, way), |tilt| (tilt.place(mount), tilt.direction(way)))
}

fn tilt(roll_rad: f64, pitch_rad: f64, height_m: f64) -> Option<Tilt> {
    Tilt::of(&Attitude { stamp_ns: 1, roll_rad, pitch_rad, height_m, standing_m: 0.3 })
}

/// Depth along the optical axis of one pixel, by casting its ray at every face; 0 for none.
fn pixel_by_ray(sensor: &DepthSensor, scene: &Scene<'_>, column: usize, row: usize) -> f64 {
    let (header, config) = (sensor.depth_header(), sensor.config());
    let mount = config.robot_from_camera;
    let side = (header.cx_px - column as f64) / header.fx_px;
    let up = (header.cy_px - row as f64) / header.fy_px;
    let mounted = Rotation3::from_euler_angles(0.0, mount.pitch_rad, mount.yaw_rad) * Vector3::new(1.0, side, up);
    let (place, level) = held(scene, Point3::new(mount.x_m, mount.y_m, mount.z_m), mounted);
    let robot = guidance::se2::se2(scene.world_from_robot);
    let (eye, flat) = (robot * place.xy(), robot.rotation * level.xy());
    let mut depth = f64::INFINITY;
    let mut meet = |t: f64| depth = if t > 0.0 { depth.min(t) } else { depth };
    meet(-place.z / level.z);
    meet((scene.world.ceiling_m() - place.z) / level.z);
    for prism in scene.world.prisms() {
        for (a, b) in prism.sides() {
            let (along, to_a) = (b - a, a - eye);
            let cross = flat.perp(&along);
            let (t, u) = (to_a.perp(&along) / cross, to_a.perp(&flat) / cross);
            if (0.0..=1.0).contains(&u) && (prism.z0_m..=prism.z1_m).contains(&(place.z + t * level.z)) {
                meet(t);
            }
        }
        for z in [prism.z0_m, prism.z1_m] {
            let t = (z - place.z) / level.z;
            if prism.contains(eye + flat * t) {
                meet(t);
            }
        }
    }
    if (config.range_min_m..=config.range_max_m).contains(&depth) { depth } else { 0.0 }
}

fn camera(pitch_rad: f64) -> DepthConfig {
    let robot_from_camera = Pose3 { x_m: 0.25, y_m: 0.05, z_m: 0.55, yaw_rad: 0.2, pitch_rad };
    DepthConfig { width: 160, height: 120, robot_from_camera, noise_per_m: 0.0, ..Default::default() }
}

#[test]
fn depth_is_that_of_every_pixels_ray() {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let (nose_down, rolled) = (tilt(0.0, 0.1, 0.27), tilt(0.2, -0.1, 0.33));
    for (pitch, tilt) in [(0.0, None), (0.35, None), (-0.2, None), (0.0, nose_down), (0.3, rolled)] {
        let mut sensor = DepthSensor::new(camera(pitch), 1, 1).unwrap();
        let (mut wrong, mut all) = (0, 0);
        for _ in 0..4 {
            let world = random_world(&mut random);
            let level = scene(&world, random.random_range(-6.0..6.0), 0.0, random.random_range(-PI..PI));
            let scene = Scene { tilt, ..level };
            let mut pixels = vec![1u16; sensor.pixels()];
            sensor.render(&scene, 0, &mut pixels);
            let robot = guidance::se2::se2(scene.world_from_robot) * Point::new(0.25, 0.05);
            if world.prisms().iter().any(|prism| prism.contains(robot)) {
                continue;
            }
            for (i, &pixel) in pixels.iter().enumerate() {
                let expected = pixel_by_ray(&sensor, &scene, i % 160, i / 160) * 1000.0;
                all += 1;
                wrong += usize::from((f64::from(pixel) - expected).abs() > 1.0);
            }
        }
        // Rays that graze an edge may go either way.
        assert!(all > 50_000 && wrong * 2000 < all, "pitch {pitch}: {wrong} of {all}");
    }
}

/// A beam's range, by casting its ray at every face and at the floor.
fn beam_by_ray(config: &LidarConfig, scene: &Scene<'_>, beam: usize) -> f64 {
    let mount = config.robot_from_lidar;
    let angle_rad = mount.yaw_rad + config.angle_min_rad + beam as f64 * config.angle_increment_rad;
    let ahead = Vector3::new(angle_rad.cos(), angle_rad.sin(), 0.0);
    let (place, way) = held(scene, Point3::new(mount.x_m, mount.y_m, config.height_m), ahead);
    let robot = guidance::se2::se2(scene.world_from_robot);
    let (eye, flat) = (robot * place.xy(), robot.rotation * way.xy());
    let mut range_m = if way.z < 0.0 { -place.z / way.z } else { f64::INFINITY };
    for prism in scene.world.prisms() {
        for (a, b) in prism.sides() {
            let (along, to_a) = (b - a, a - eye);
            let cross = flat.perp(&along);
            let (t, u) = (to_a.perp(&along) / cross, to_a.perp(&flat) / cross);
            let meets = (0.0..=1.0).contains(&u) && (prism.z0_m..=prism.z1_m).contains(&(place.z + t * way.z));
            range_m = if meets && t > 0.0 { range_m.min(t) } else { range_m };
        }
    }
    range_m
}

#[test]
fn a_lidar_on_a_tilted_body_meets_what_its_rays_meet() {
    let mut random = ChaCha8Rng::seed_from_u64(12);
    let config = LidarConfig { sigma_m: 0.0, drop_out: 0.0, ..Default::default() };
    let mut sensor = LidarSensor::new(config.clone(), 1, 1).unwrap();
    let mut ranges = vec![0.0f32; config.beams];
    let (mut wrong, mut all, mut floor) = (0, 0, 0);
    let bare = World::new(2.6, Vec::new());
    for _ in 0..40 {
        let world = random_world(&mut random);
        let (roll_rad, pitch_rad) = (random.random_range(-0.1..0.1), random.random_range(-0.1..0.1));
        let level = scene(&world, random.random_range(-6.0..6.0), 0.0, random.random_range(-PI..PI));
        let scene = Scene { tilt: tilt(roll_rad, pitch_rad, random.random_range(0.25..0.35)), ..level };
        let inside = |prism: &Prism| prism.contains(Point::new(scene.world_from_robot.x_m, 0.0));
        if world.prisms().iter().any(inside) {
            continue;
        }
        sensor.scan(&scene, 0, &mut ranges);
        for (beam, range) in ranges.iter().enumerate().filter(|(_, range)| !range.is_nan()) {
            let expected = beam_by_ray(&config, &scene, beam);
            let alike = if expected < 11.9 { (f64::from(*range) - expected).abs() < 0.03 } else { *range > 11.8 };
            all += 1;
            wrong += usize::from(!alike);
            let bare = Scene { world: &bare, ..scene };
            floor += usize::from(expected < 11.9 && expected == beam_by_ray(&config, &bare, beam));
        }
    }
    // The bearing of a beam is off by up to 0.3 degrees at such tilts: at an edge it may go either way.
    assert!(all > 9_000 && floor > 300 && wrong * 50 < all, "{wrong} of {all}, {floor}");
}

#[test]
fn an_attitude_is_read_with_its_errors_and_one_that_is_not_known_stays_so() {
    let config = OdometryConfig { attitude_bias_rad: 0.01, attitude_sigma_rad: 0.003, ..Default::default() };
    let truth = Attitude { stamp_ns: 1, roll_rad: 0.1, pitch_rad: -0.1, height_m: 0.3, standing_m: 0.3 };
    let errors = |seed: u64| {
        let sensor = OdometrySensor::new(config.clone(), seed, 1).unwrap();
        assert_eq!(sensor.attitude(1, &Attitude::default()), Attitude::default());
        let rolls = (0..2000).map(|tick| sensor.attitude(tick, &truth).roll_rad - 0.1);
        let (sum, squares) = rolls.fold((0.0, 0.0), |(sum, squares), off| (sum + off, squares + off * off));
        (sum / 2000.0, (squares / 2000.0 - (sum / 2000.0).powi(2)).sqrt())
    };
    let biases: Vec<f64> = (0..50).map(|seed| errors(seed).0).collect();
    assert!(biases.iter().all(|bias| bias.abs() < 0.0105) && biases.iter().any(|bias| *bias > 0.005), "{biases:?}");
    assert!((errors(1).1 - 0.003).abs() < 0.0003);
}

#[test]
fn a_wall_at_a_known_distance_has_that_depth() {
    let world = wall_ahead(4.0);
    let mount = Pose3 { x_m: 0.5, z_m: 0.5, ..Default::default() };
    let config =
        DepthConfig { width: 161, height: 121, robot_from_camera: mount, noise_per_m: 0.0, ..Default::default() };
    let mut pixels = vec![0u16; 161 * 121];
    DepthSensor::new(config.clone(), 1, 1).unwrap().render(&scene(&world, 1.5, 0.0, 0.0), 0, &mut pixels);
    assert!(pixels[60 * 161..61 * 161].iter().all(|&depth| depth == 2000), "flat along the row, along the axis");
    let pitched = DepthConfig { robot_from_camera: Pose3 { pitch_rad: 0.2, ..mount }, ..config };
    DepthSensor::new(pitched, 1, 1).unwrap().render(&scene(&world, 1.5, 0.0, 0.0), 0, &mut pixels);
    let middle = f64::from(pixels[60 * 161 + 80]);
    assert!((middle - 2000.0 / 0.2f64.cos()).abs() < 1.0, "{middle}");
}

#[test]
fn a_map_is_rendered_as_its_cells() {
    let cells = (0..100 * 100).map(|i| if i % 100 == 70 { Cell::Occupied } else { Cell::Free }).collect();
    let map = GridMap::new(100, 0.05, Pose2::new(0.0, -2.5, 0.0), cells);
    let world = World::new(2.6, vec![]).with_map(map);
    let config = DepthConfig { noise_per_m: 0.0, hfov_rad: 1.0, ..Default::default() };
    let mut pixels = vec![0u16; 640 * 480];
    DepthSensor::new(config, 1, 1).unwrap().render(&scene(&world, 1.0, 0.0, 0.0), 0, &mut pixels);
    let row = &pixels[200 * 640..201 * 640];
    assert!(row.iter().all(|&depth| depth == 2250), "{:?}", &row[..20]);
}

#[test]
fn a_map_looks_as_the_boxes_of_its_cells() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let pose = Pose2::new(-3.0, 2.0, 0.4);
    let cells = (0..40 * 40).map(|_| if random.random_range(0..30) == 0 { Cell::Occupied } else { Cell::Free });
    let map = GridMap::new(40, 0.25, pose, cells.collect());
    let places = (0..40).flat_map(|column| (0..40).map(move |row| (column, row)));
    let occupied = places.filter(|&(column, row)| map.cell(column, row) == Cell::Occupied);
    let boxes = occupied.map(|(c, r)| Prism::cuboid(map.middle(c as usize, r as usize), [0.25; 2], 0.4, [0.0, 2.6]));
    let same = World::new(2.6, boxes.collect());
    let world = World::new(2.6, vec![]).with_map(map);
    for pitch in [0.0, 0.3] {
        // Near enough that the edge of the map is out of range.
        let config = DepthConfig { range_max_m: 3.0, ..camera(pitch) };
        let at = guidance::se2::se2(pose) * Point::new(5.1, 5.1);
        let mut frames = [&world, &same].map(|world| {
            let mut pixels = vec![0u16; 160 * 120];
            DepthSensor::new(config.clone(), 1, 1).unwrap().render(&scene(world, at.x, at.y, 1.0), 0, &mut pixels);
            pixels
        });
        let [a, b] = &mut frames;
        let wrong = a.iter().zip(b).filter(|(a, b)| a.abs_diff(**b) > 1).count();
        assert!(a.iter().any(|&mm| mm > 0) && wrong <= 20, "pitch {pitch}: {wrong}");
    }
}

#[test]
fn depth_noise_grows_with_the_square() {
    let world = wall_ahead(5.25);
    let config = DepthConfig { width: 320, height: 240, noise_per_m: 0.002, ..Default::default() };
    let mut pixels = vec![0u16; 320 * 240];
    DepthSensor::new(config, 1, 1).unwrap().render(&scene(&world, 0.0, 0.0, 0.0), 7, &mut pixels);
    let wall: Vec<_> = pixels[115 * 320..120 * 320].iter().map(|&mm| f64::from(mm) - 5000.0).collect();
    let sigma = (wall.iter().map(|off| off * off).sum::<f64>() / wall.len() as f64).sqrt();
    assert!((sigma - 50.0).abs() < 5.0, "{sigma}");
}

#[test]
fn odometry_drifts_as_it_says_and_begins_anew() {
    let twist = Twist2 { vx_mps: 0.5, ..Twist2::ZERO };
    let walk = |incarnation| {
        let mut sensor = OdometrySensor::new(OdometryConfig::default(), 9, incarnation).unwrap();
        let at = |tick: u64| Pose2::new(3.0 + 0.005 * tick as f64, 1.0, 0.0);
        assert_eq!(sensor.update(0, at(0), twist).odom_from_robot, Pose2::default());
        (1..=4000).map(|tick| sensor.update(tick, at(tick), twist)).last().unwrap()
    };
    assert_eq!(walk(1), walk(1));
    assert_ne!(walk(1), walk(2));
    let mut squares = [0.0; 3];
    for incarnation in 0..200 {
        let end = walk(incarnation);
        let errors = [end.odom_from_robot.x_m - 20.0, end.odom_from_robot.y_m, end.odom_from_robot.yaw_rad];
        for (square, (error, sigma)) in squares.iter_mut().zip(errors.iter().zip(end.sigma)) {
            *square += (error / sigma).powi(2) / 200.0;
        }
    }
    assert!(squares.iter().all(|&square| (0.05..1.5).contains(&square)) && squares[2] > 0.7, "{squares:?}");
}

#[test]
fn absurd_configurations_are_refused() {
    let lidar = LidarSensor::new(LidarConfig { sigma_m: f64::NAN, ..Default::default() }, 0, 0).unwrap_err();
    assert_eq!(lidar.key, "sigma_m");
    assert!(DepthSensor::new(DepthConfig { width: 4000, ..Default::default() }, 0, 0).is_err());
    assert!(OdometrySensor::new(OdometryConfig { scale_sigma: -1.0, ..Default::default() }, 0, 0).is_err());
}

#[test]
fn a_scan_is_what_each_beam_alone_would_meet() {
    let mut random = ChaCha8Rng::seed_from_u64(9);
    for round in 0..60 {
        let world = random_world(&mut random);
        let turn = [1.0, -1.0][round % 2];
        let (beams, increment) = [(360, TAU / 360.0), (181, PI / 180.0), (37, 0.17)][round % 3];
        let config = LidarConfig {
            beams,
            angle_min_rad: random.random_range(-PI..PI),
            angle_increment_rad: turn * increment,
            range_min_m: 0.0,
            sigma_m: 0.0,
            drop_out: 0.0,
            robot_from_lidar: Pose2::new(0.2, -0.1, 0.4),
            ..Default::default()
        };
        let mut sensor = LidarSensor::new(config.clone(), 1, 1).unwrap();
        let robot = Pose2::new(random.random_range(-4.0..4.0), random.random_range(-4.0..4.0), 1.0);
        let world_from_lidar = guidance::se2::se2(robot) * guidance::se2::se2(config.robot_from_lidar);
        let origin = Point::from(world_from_lidar.translation.vector);
        if world.clearance(origin, FULL, 1.0) == 0.0 {
            continue;
        }
        let mut ranges = vec![0.0f32; beams];
        sensor.scan(&scene(&world, robot.x_m, robot.y_m, robot.yaw_rad), 0, &mut ranges);
        for (beam, range) in ranges.iter().enumerate() {
            let angle = config.angle_min_rad + config.angle_increment_rad * beam as f64;
            let direction = world_from_lidar.rotation * Vector2::new(angle.cos(), angle.sin());
            let alone = world.cast(origin, direction, config.height_m, config.range_max_m);
            let expected = alone.map_or(f32::INFINITY, |range_m| range_m as f32);
            assert!(*range == expected || (range - expected).abs() < 1e-4, "beam {beam}: {range} and {expected}");
        }
    }
}
