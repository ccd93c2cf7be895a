//! Episodes as training and evaluation have them.

use std::sync::Arc;

use guidance::ActionTable;
use guidance::observation::LENGTH;
use guidedog_episodes::{Batch, Config, Episode, Goal, Handlers, NoTask, Noise, Places, part_seed};
use messages::{CueKind, Pose2};
use world::{Bodies, Cell, FloorPlan, GeneratorConfig, GridMap, LidarConfig};

fn config(noise: Noise) -> Config {
    Config { noise, ..Config::default() }
}

/// The reports of episodes that the teacher leads.
fn taught(config: Config, count: u64) -> Vec<guidedog_episodes::Report> {
    let mut episode = Episode::new(Arc::new(config)).expect("sensors");
    let walk = |seed: u64| {
        episode.begin(part_seed(5, seed));
        while !episode.step(episode.teacher().action()).ended {}
        episode.report()
    };
    (0..count).map(walk).collect()
}

#[test]
fn the_same_seed_is_the_same_episode_to_the_bit() {
    same_to_the_bit(&Arc::new(config(Noise::Noisy)));
    same_to_the_bit(&Arc::new(Config::go2()));
}

fn same_to_the_bit(config: &Arc<Config>) {
    let walk = |seed: u64| {
        let mut episode = Episode::new(Arc::clone(config)).expect("sensors");
        // Whatever was before.
        episode.begin(seed + 77);
        episode.begin(seed);
        let mut seen = Vec::new();
        for decision in 0..20 {
            seen.extend(episode.observation().iter().map(|number| number.to_bits()));
            seen.push(episode.unsafe_mask());
            let step = episode.step(decision % 8);
            seen.push((step.reward as f32).to_bits());
        }
        seen
    };
    assert_eq!(walk(3), walk(3));
    assert_ne!(walk(3), walk(4));
}

#[test]
fn who_knows_the_way_gets_there_and_touches_nothing() {
    let reports = taught(config(Noise::Noisy), 60);
    let share = |what: fn(&guidedog_episodes::Report) -> bool| {
        reports.iter().filter(|report| what(report)).count() as f64 / reports.len() as f64
    };
    assert!(share(|report| report.success) > 0.85, "{reports:#?}");
    assert!(share(|report| report.collisions == 0) > 0.95, "{reports:#?}");
    assert!(reports.iter().any(|report| report.to_stand && report.success), "some are to stand, and do");
}

/// Legs lag, overrun and tilt: an empty corridor stays walkable all the same.
#[test]
fn on_legs_an_empty_corridor_is_walked_and_the_body_tilts() {
    let empty = GeneratorConfig { clutter_per_m: 0.0, people: 0.0, bends: 0.0, ..GeneratorConfig::default() };
    let cues = vec![(CueKind::Forward, 1.0)];
    let config = Config { places: Places::Generated(empty), cues, ..Config::go2() };
    let mut episode = Episode::new(Arc::new(config)).expect("sensors");
    let (mut forbidden, mut all, mut pitch_max_rad) = (0, 0, 0.0_f64);
    for seed in 0..12 {
        episode.begin(part_seed(9, seed));
        for _ in 0..20 {
            let attitude = episode.team().attitude();
            assert!(attitude.is_known() && attitude.is_usable(), "{attitude:?}");
            pitch_max_rad = pitch_max_rad.max(attitude.pitch_rad.abs());
            forbidden += usize::from(episode.unsafe_mask() & 2 != 0);
            all += 1;
            episode.step(episode.teacher().action());
        }
        assert!(episode.report().collisions == 0, "{seed}: {:?}", episode.report());
    }
    assert!(pitch_max_rad > 0.03, "{pitch_max_rad}");
    assert!(forbidden * 20 < all, "forward is forbidden in {forbidden} of {all}");
}

#[test]
fn what_is_followed_is_rewarded_once() {
    let paid = taught(Config { followed_reward: 5.0, ..config(Noise::Ideal) }, 30);
    for (paid, unpaid) in paid.iter().zip(taught(config(Noise::Ideal), 30)) {
        let followed = f64::from(u8::from(paid.success)) + f64::from(u8::from(paid.corrected == Some(true)));
        assert!((paid.reward - unpaid.reward - 5.0 * followed).abs() < 1e-9, "{paid:#?} {unpaid:#?}");
    }
    assert!(paid.iter().any(|report| report.to_stand && report.success), "some stand");
    assert!(paid.iter().any(|report| report.corrected == Some(true)), "some have erred");
}

#[test]
fn what_is_forbidden_and_taken_costs() {
    let walk = |forbidden_penalty: f64| {
        let config = Config { forbidden_penalty, ..config(Noise::Ideal) };
        let mut episode = Episode::new(Arc::new(config)).expect("sensors");
        episode.begin(2);
        while !episode.step(1).ended {}
        episode.report()
    };
    let (free, paid) = (walk(0.0), walk(0.5));
    assert!(free.unsafe_taken > 0, "who always walks on comes to a wall");
    assert!((free.reward - paid.reward - 0.5 * f64::from(free.unsafe_taken)).abs() < 1e-9, "{free:#?} {paid:#?}");
}

#[test]
fn who_sees_nothing_stands_and_may_do_nothing() {
    let lidar = LidarConfig { drop_out: 1.0, ..LidarConfig::default() };
    let config = Config { lidar, ..config(Noise::Noisy) };
    let table_len = config.table.len();
    let mut episode = Episode::new(Arc::new(config)).expect("sensors");
    episode.begin(1);
    for _ in 0..20 {
        assert_eq!(episode.unsafe_mask(), (1 << table_len) - 1);
        episode.step(1);
    }
    assert_eq!((episode.report().distance_m, episode.report().collisions), (0.0, 0));
}

#[test]
fn who_is_too_stout_has_no_place() {
    let bodies = Bodies { handler_radius_m: 2.0, ..Bodies::default() };
    assert!(matches!(Config { bodies, ..Config::default() }.check_tasks(), Err(NoTask(_))));
    assert_eq!(Config::default().check_tasks(), Ok(()));
}

#[test]
fn a_stop_is_stood_whatever_is_decided() {
    let mut episode = Episode::new(Arc::new(Config { cues: vec![(CueKind::Forward, 1.0)], ..config(Noise::Ideal) }))
        .expect("sensors");
    episode.begin(1);
    episode.give(CueKind::Stop);
    let before = *episode.team().world_from_robot();
    episode.step(1);
    assert_eq!(episode.team().world_from_robot(), &before);
}

#[test]
fn what_is_asked_for_is_where_it_is_asked() {
    let mut episode = Episode::new(Arc::new(config(Noise::Ideal))).expect("sensors");
    let mut seen = [0; 3];
    for seed in 0..120 {
        episode.begin(seed);
        let (cue, course) = (episode.task().cue, &episode.site().course);
        match &episode.task().goal {
            Goal::Along(to_m) => {
                seen[0] += 1;
                assert_eq!(cue, CueKind::Forward);
                assert!(*to_m <= course.line.length_m());
            }
            Goal::Into(openings) => {
                seen[1] += 1;
                assert!(!openings.is_empty() && openings.iter().all(|opening| course.openings.contains(opening)));
            }
            Goal::Stand(_) => seen[2] += 1,
            Goal::BeforeEdge => panic!("these worlds have no edges"),
        }
        assert_eq!(episode.observation().len(), LENGTH);
        assert!(episode.observation().iter().all(|number| number.is_finite() && number.abs() <= 4.0));
    }
    assert!(seen.iter().all(|count| *count > 5), "{seen:?}");
}

#[test]
fn a_batch_is_the_same_on_any_number_of_cores() {
    let walk = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let mut batch = Batch::new(&Arc::new(config(Noise::Noisy)), 12).expect("sensors");
            batch.begin(1);
            let mut rewards = Vec::new();
            for decision in 0..30 {
                let actions: Vec<usize> =
                    (0..12).map(|place| (place + decision) % ActionTable::eight().len()).collect();
                batch.step(&actions);
                rewards.extend(batch.rewards());
            }
            (rewards, batch.finished().count())
        })
    };
    assert_eq!(walk(1), walk(3));
}

#[test]
fn handlers_are_told_about_as_they_are() {
    let nominal = Config { handlers: Handlers::Nominal, ..config(Noise::Ideal) };
    let mut episode = Episode::new(Arc::new(nominal)).expect("sensors");
    episode.begin(1);
    let default = episode.team().robot_from_handler().translation.vector;
    assert!((default.x + 0.75).abs() < 1e-9 && (default.y + 0.35).abs() < 1e-9);
    let mut episode = Episode::new(Arc::new(config(Noise::Ideal))).expect("sensors");
    let mut different = 0;
    for seed in 0..20 {
        episode.begin(seed);
        let (told, truth) =
            (episode.handler_estimate().translation.vector, episode.team().robot_from_handler().translation.vector);
        assert!((told - truth).norm() < 0.1, "{told} {truth}");
        different += u32::from((truth - default).norm() > 0.02);
    }
    assert!(different > 10);
}

#[test]
fn forward_alone_may_have_been_asked_for_long_before() {
    let config = Arc::new(Config { walked_before: 1.0, ..config(Noise::Ideal) });
    let mut episode = Episode::new(config).expect("a configuration");
    let mut told = [0, 0];
    for seed in 0..40 {
        episode.begin(seed);
        let (cue, start_from_robot, _) = episode.cue();
        let is_off = start_from_robot.translation.vector.norm() > 1e-6;
        assert_eq!(is_off, cue == CueKind::Forward, "seed {seed}");
        told[usize::from(is_off)] += 1;
    }
    assert!(told.iter().all(|count| *count > 3), "{told:?}");
}

/// A corridor 20 m long and 2 m wide on a floor plan; with `branch` a way of 1.6 m leads off it to one side.
fn on_plan(branch: bool, cue: CueKind) -> Config {
    let (width, height, resolution_m) = (440, 200, 0.05);
    let free = |x: f64, y: f64| {
        (1.0..21.0).contains(&x) && (1.0..3.0).contains(&y)
            || branch && (11.2..12.8).contains(&x) && (1.0..9.0).contains(&y)
    };
    let middle = |i: usize| (i as f64 + 0.5) * resolution_m;
    let cell = |i: usize| if free(middle(i % width), middle(i / width)) { Cell::Free } else { Cell::Occupied };
    let map = GridMap::new(width, resolution_m, Pose2::default(), (0..width * height).map(cell).collect());
    let bare = GeneratorConfig { clutter_per_m: 0.0, people: 0.0, ..GeneratorConfig::default() };
    let places = Places::Plans(Arc::new(vec![FloorPlan::new(map)]), bare);
    Config { places, cues: vec![(cue, 1.0)], ..config(Noise::Ideal) }
}

#[test]
fn on_a_floor_plan_the_ways_off_a_corridor_are_asked_for() {
    let mut episode = Episode::new(Arc::new(on_plan(true, CueKind::Left))).expect("sensors");
    let mut seen = [0, 0];
    for seed in 0..30 {
        episode.begin(seed);
        let task = episode.task();
        match &task.goal {
            Goal::Into(openings) => {
                seen[0] += 1;
                assert!(openings.iter().all(|opening| opening.line.length_m() > 5.0), "{openings:?}");
                let end = task.line.at(task.line.length_m()).translation.vector;
                assert!((end.x - 12.0).abs() < 0.3 && end.y > 7.0, "into the way that leads off: {end}");
            }
            _ => seen[1] += 1,
        }
    }
    assert!(seen.iter().all(|count| *count > 3), "{seen:?}");
}

#[test]
fn a_cue_that_has_no_place_on_a_floor_plan_is_told() {
    assert_eq!(on_plan(true, CueKind::Left).check_tasks(), Ok(()));
    let near_openings = |branch| Config { timing_max_m: Some(5.0), ..on_plan(branch, CueKind::Right) };
    assert_eq!(near_openings(true).check_tasks(), Ok(()));
    assert_eq!(near_openings(false).check_tasks(), Err(NoTask(CueKind::Right)));
}

#[test]
fn who_errs_and_never_comes_so_far_has_not_put_it_right() {
    let cues = vec![(CueKind::Forward, 1.0)];
    let mut episode = Episode::new(Arc::new(Config { cues, ..config(Noise::Ideal) })).expect("sensors");
    let mut told = [0, 0];
    for seed in 0..40 {
        episode.begin(seed);
        for _ in 0..12 {
            episode.step(ActionTable::STOP);
        }
        match episode.report().corrected {
            Some(corrected) => {
                assert!(!corrected, "seed {seed}");
                told[0] += 1;
            }
            None => told[1] += 1,
        }
    }
    assert!(told.iter().all(|count| *count > 3), "{told:?}");
}

#[test]
fn what_holds_a_robot_that_stands_is_counted() {
    let bare = GeneratorConfig { clutter_per_m: 0.0, people: 0.0, ..GeneratorConfig::default() };
    let cues = vec![(CueKind::Forward, 1.0)];
    let config = Config { cues, places: Places::Generated(bare), ..config(Noise::Ideal) };
    let mut episode = Episode::new(Arc::new(config)).expect("sensors");
    let (stop, forward) = (ActionTable::STOP, 1);
    // The policy wants to stand all the time. Then another one wants to go on, into the wall at the end.
    episode.begin(3);
    (0..10).for_each(|_| {
        episode.wants(stop, stop);
        episode.step(stop);
    });
    let held = episode.report().held;
    assert_eq!((held.policy, held.lidar, held.floor), (10, 0, 0), "{held:?}");
    episode.begin(3);
    for _ in 0..100 {
        let is_forbidden = episode.unsafe_mask() >> forward & 1 == 1;
        let taken = if is_forbidden { stop } else { forward };
        episode.wants(forward, taken);
        episode.step(taken);
    }
    let held = episode.report().held;
    assert!(held.policy == 0 && held.lidar > 10, "{held:?}");
}
