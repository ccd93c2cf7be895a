//! The worlds and scenarios that are shipped.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests are tests too")]

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use guidance::se2::Point;
use guidedog_world::{CueTrigger, Physics, PhysicsConfig, Scenario, World};
use messages::CueKind;

fn config() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config")
}

fn toml_files(folder: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(config().join(folder)).unwrap();
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// Way from start to goal over cells of 10 cm whose disc of `radius_m` is free, metres.
fn way_m(world: &World, from: Point, to: Point, radius_m: f64) -> Option<f64> {
    const CELL_M: f64 = 0.1;
    let mut seen = std::collections::HashMap::from([((0, 0), 0)]);
    let mut queue = VecDeque::from([(0, 0)]);
    while let Some((x, y)) = queue.pop_front() {
        let at = from + nalgebra::Vector2::new(f64::from(x), f64::from(y)) * CELL_M;
        let steps = seen[&(x, y)];
        if (at - to).norm() < CELL_M {
            return Some(f64::from(steps) * CELL_M);
        }
        for next in [(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)] {
            let at = from + nalgebra::Vector2::new(f64::from(next.0), f64::from(next.1)) * CELL_M;
            if !seen.contains_key(&next) && world.clearance(at, [0.02, 1.8], radius_m) >= radius_m {
                seen.insert(next, steps + 1);
                queue.push_back(next);
            }
        }
    }
    None
}

#[test]
fn every_world_parses() {
    let worlds = toml_files("worlds");
    assert!(worlds.len() >= 6);
    for file in worlds {
        let world = World::load(&file).unwrap();
        assert!(!world.prisms().is_empty() && world.ceiling_m() == 2.6, "{}", file.display());
    }
}

#[test]
fn every_scenario_starts_free_and_its_goal_can_be_reached() {
    let scenarios = toml_files("scenarios");
    let names: Vec<_> = scenarios.iter().filter_map(|file| file.file_stem()?.to_str()).collect();
    for name in ["corridor", "curve", "l-turn", "left-at-tee", "crossing", "cluttered", "people", "opening-doors"] {
        assert!(names.contains(&name), "{name}");
    }
    for file in &scenarios {
        let scenario = Scenario::load(file).unwrap();
        let world = Arc::new(scenario.load_world().unwrap());
        Physics::new(world.clone(), PhysicsConfig::default(), scenario.start).unwrap();
        let start = Point::new(scenario.start.x_m, scenario.start.y_m);
        let Some(goal) = scenario.route.goal else {
            // Single motions, and what no sensor sees.
            let has_none =
                ["steps.toml", "glass.toml", "platform-gap.toml"].into_iter().any(|name| file.ends_with(name));
            assert!(has_none, "{}: no goal", file.display());
            continue;
        };
        let way = way_m(&world, start, goal.at, 0.35).unwrap_or_else(|| panic!("{}: no way", file.display()));
        let is_in_single_file = file.ends_with("narrow-door.toml");
        assert!(is_in_single_file || way - goal.within_m > 30.0, "{}: {way} m", file.display());
        let is_for_two = way_m(&world, start, goal.at, 0.7).is_some();
        assert_eq!(is_for_two, !is_in_single_file, "{}: a way for two", file.display());
        let first = scenario.route.cues.first().unwrap();
        assert_eq!((first.kind, first.trigger), (CueKind::Forward, CueTrigger::Time(1.0)));
        for person in world.people() {
            for pair in person.path.windows(2) {
                let free = world.free_share(pair[0], pair[1], person.radius_m, [0.02, 1.75]);
                assert_eq!(free, None, "{}: somebody walks through something", file.display());
            }
        }
    }
}
