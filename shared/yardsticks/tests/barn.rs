//! BARN's own files, and walks through them.

use std::fs;
use std::path::Path;

use guidance::ActionTable;
use guidance::Draw;
use guidedog_yardsticks::barn::{Task, worlds};
use guidedog_yardsticks::{Body, Config, End, Noise, Walk};
use policies::{SoloConfig, SoloEngine};
use settings::{Profile, Settings};

fn settings() -> Settings {
    settings::load(Profile::Go2, None).expect("built in")
}

/// A robot alone on legs, as `guidedog yardstick` has it.
fn alone() -> Walk {
    let settings = settings();
    let mut base = episodes::Config::of(&settings).expect("a handler");
    base.noise = Noise::Legged;
    let config = Config { base, interaction: settings.interaction().expect("a handler"), draw: Draw::ArgMax };
    let config = config.alone(ActionTable::solo(), 0.2);
    let base = &config.base;
    let radius_m = base.shield.robot_radius_m + base.shield.margin_m;
    let solo = SoloConfig { dt_s: base.dt_s, radius_m, reach: base.shield.reach };
    let engine = SoloEngine::new(solo, base.table.clone());
    Walk::new(config, Body::Robot(Box::new(engine)))
}

#[test]
fn the_robot_alone_walks_through_worlds_of_barn_and_the_same_seed_walks_the_same() {
    let Some(folder) = test_data::data("barn") else { return };
    let mut walk = alone();
    for number in [5, 100] {
        let task = Task::load(&folder.join(format!("world_{number}.world.xz"))).expect("a task");
        assert!(task.world.prisms().len() > 150 && (5.0..7.0).contains(&task.optimal_s), "{}", task.optimal_s);
        let walked = [1, 1, 2].map(|seed| walk.walk(&task.passage(), seed).expect("walks"));
        for trace in &walked {
            let score = task.score(trace);
            assert!(trace.end == End::Goal && score.score > 0.3, "world {number}: {score:?}");
        }
        assert_eq!(walked[0].robot, walked[1].robot);
        assert_ne!(walked[0].robot, walked[2].robot);
    }
}

#[test]
fn all_worlds_of_a_folder_are_found_in_the_order_of_their_numbers() {
    let Some(folder) = test_data::data("barn") else { return };
    let found = worlds(&[folder]).expect("worlds");
    assert_eq!(found.len(), 60);
    let name = |path: &Path| path.file_name().and_then(|name| name.to_str()).map(str::to_owned);
    assert_eq!(name(&found[1]).as_deref(), Some("world_5.world.xz"));
    assert!(worlds(&[tempfile::tempdir().expect("a folder").path().to_owned()]).is_err());
}

#[test]
fn files_that_are_cut_short_or_missing_are_named() {
    let Some(folder) = test_data::data("barn") else { return };
    let copy = tempfile::tempdir().expect("a folder");
    let (world, path) = (copy.path().join("world_5.world.xz"), copy.path().join("path_5.npy"));
    let error = |what: &str| {
        let error = Task::load(&world).expect_err(what).to_string();
        assert!(error.contains(what), "{error}\nnot {what}");
    };
    error("world_5.world.xz");
    let bytes = fs::read(folder.join("world_5.world.xz")).expect("there");
    fs::write(&world, &bytes[..bytes.len() / 2]).expect("written");
    error("failed to read");
    fs::write(&world, &bytes).expect("written");
    error("path_5.npy");
    let reference = fs::read(folder.join("path_5.npy")).expect("there");
    fs::write(&path, &reference[..reference.len() - 8]).expect("written");
    error("path_5.npy: ");
    fs::write(&path, &reference).expect("written");
    Task::load(&world).expect("whole again");
}
