//! People of the social force model: round the team, in groups, with stops, and never into a wall.

#![allow(clippy::unwrap_used, reason = "helpers of tests are tests too")]

use std::path::Path;
use std::sync::Arc;

use guidance::se2::Point;
use guidedog_world::{Crowd, GeneratorConfig, Moves, PERSON_HEIGHT_M, Physics, PhysicsConfig, World, generate};
use messages::{Pose2, Twist2, WorldTruth};

const FORWARD: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.0 };
/// A corridor, 30 m long and 3 m wide, in which the team walks from its left end on.
const CORRIDOR: &str = "[[wall]]\npoints = [[-5, -1.5], [25, -1.5], [25, 1.5], [-5, 1.5], [-5, -1.5]]\n";

fn corridor(people: &[&str]) -> Physics {
    let people = people.iter().map(|person| format!("[[person]]\nmoves = \"social\"\n{person}\n")).collect::<String>();
    let world = World::from_toml("w.toml", &(CORRIDOR.to_owned() + &people), Path::new("")).unwrap();
    Physics::new(Arc::new(world), PhysicsConfig::default(), Pose2::default()).unwrap()
}

/// The truth after each tick.
fn walk(physics: &mut Physics, command: Twist2, seconds: f64) -> Vec<WorldTruth> {
    let tick = |_| {
        physics.step(command);
        physics.truth()
    };
    (0..(seconds * 100.0) as usize).map(tick).collect()
}

fn touches(truth: &WorldTruth) -> [u32; 3] {
    [truth.robot_collisions, truth.handler_collisions, truth.hit_by_others]
}

#[test]
fn they_walk_round_a_team_that_comes_on_and_past_one_that_is_slow() {
    for person in [
        "path = [[20, 0], [-4, 0]]\nspeed_mps = 1.2",
        "path = [[20, -0.3], [-4, -0.3]]\nspeed_mps = 0.8",
        // One who overtakes, from behind the handler.
        "path = [[-4.5, -0.3], [24, -0.3]]\nspeed_mps = 1.5",
    ] {
        for command in [FORWARD, Twist2::ZERO] {
            let mut physics = corridor(&[person]);
            let comes_on = physics.truth().walkers[0].x_m > 0.0;
            let truths = walk(&mut physics, command, 32.0);
            let last = truths.last().unwrap();
            assert_eq!(touches(last), [0, 0, 0], "{person}");
            let is_past = truths.iter().any(|truth| {
                let past_m = truth.walkers[0].x_m - truth.world_from_robot.x_m;
                if comes_on { past_m < -1.5 } else { past_m > 1.0 }
            });
            assert!(is_past, "{person} {command:?}: {:?}", last.walkers[0]);
        }
    }
}

#[test]
fn one_who_takes_no_notice_walks_into_a_team_that_stands() {
    let mut physics = corridor(&["path = [[8, 0], [-4, 0]]\nspeed_mps = 1.0\nyields = false"]);
    let last = *walk(&mut physics, Twist2::ZERO, 10.0).last().unwrap();
    assert_eq!(touches(&last), [0, 0, 1], "one touch is one event, and not ours");
}

#[test]
fn one_who_stops_in_the_way_stands_there_for_that_time() {
    let mut physics = corridor(&["path = [[20, 0], [3, 0]]\nspeed_mps = 1.0\npauses = [[4, 6]]"]);
    let truths = walk(&mut physics, Twist2::ZERO, 20.0);
    let stands = |pair: &[WorldTruth]| pair[0].walkers[0] == pair[1].walkers[0];
    let standing: Vec<_> = truths.windows(2).filter(|pair| stands(pair)).map(|pair| pair[0].walkers[0]).collect();
    assert!((standing.len() as f64 * 0.01 - 6.0).abs() < 0.1, "{}", standing.len());
    assert!(standing.iter().all(|walker| (walker.x_m - 16.0).abs() < 0.05), "{:?}", standing[0]);
}

#[test]
fn a_group_stays_together_and_strangers_do_not() {
    let people = |group: &str| {
        let member = |y: f64, speed: f64| {
            format!("path = [[20, {y}], [-4, {y}]]\nspeed_mps = {speed}\nwalk = \"once\"\n{group}")
        };
        [member(0.7, 1.0), member(1.1, 1.2)]
    };
    let apart_m = |group: &str| {
        let people = people(group);
        let mut physics = corridor(&[&people[0], &people[1]]);
        let truths = walk(&mut physics, Twist2::ZERO, 17.0);
        assert_eq!(touches(truths.last().unwrap()), [0, 0, 0]);
        let [one, two] = [truths.last().unwrap().walkers[0], truths.last().unwrap().walkers[1]];
        (one.x_m - two.x_m).hypot(one.y_m - two.y_m)
    };
    let (group_m, strangers_m) = (apart_m("group = 1"), apart_m(""));
    assert!(group_m < 1.6 && strangers_m > 2.0, "{group_m} {strangers_m}");
}

#[test]
fn nobody_walks_into_a_wall_and_the_same_seed_is_the_same_walk() {
    let config = GeneratorConfig { people: 1.0, crowd: Crowd::Social, ..GeneratorConfig::default() };
    let mut walked = 0;
    for seed in 0..40 {
        let site = generate(&config, seed);
        let world = Arc::new(site.world);
        let start = site.course.line.at(1.5);
        let start = Pose2::new(start.translation.x, start.translation.y, start.rotation.angle());
        let Ok(mut physics) = Physics::new(world.clone(), PhysicsConfig::default(), start) else { continue };
        let mut again = physics.clone();
        for _ in 0..2000 {
            physics.step(Twist2::ZERO);
            let truth = physics.truth();
            for walker in &truth.walkers[..truth.walker_count as usize] {
                let (at, needed_m) = (Point::new(walker.x_m, walker.y_m), walker.radius_m - 1e-6);
                let room_m = world.clearance(at, [0.1, PERSON_HEIGHT_M], needed_m);
                assert!(room_m >= needed_m, "seed {seed}: {walker:?} has {room_m} m");
            }
            walked += truth.walker_count;
        }
        (0..2000).for_each(|_| again.step(Twist2::ZERO));
        assert_eq!(physics.truth(), again.truth(), "seed {seed}");
    }
    assert!(walked > 20 * 2000, "there were people: {walked}");
}

#[test]
fn generated_people_are_of_every_kind() {
    let config = GeneratorConfig { people: 1.0, crowd: Crowd::Social, ..GeneratorConfig::default() };
    let people: Vec<_> = (0..300).flat_map(|seed| generate(&config, seed).world.people().to_vec()).collect();
    let manner = |moves: &Moves| match moves {
        Moves::Social(manner) => manner.clone(),
        Moves::Path => panic!("all are of the model"),
    };
    let count = people.len() as f64;
    let share = |is: &dyn Fn(&guidedog_world::Person) -> bool| people.iter().filter(|p| is(p)).count() as f64 / count;
    let (groups, stops) =
        (share(&|p| manner(&p.moves).group.is_some()), share(&|p| !manner(&p.moves).pauses.is_empty()));
    let fast = share(&|p| p.speed_mps > 1.4);
    assert!(people.len() > 150 && groups > 0.15 && stops > 0.08 && fast > 0.05, "{count} {groups} {stops} {fast}");
    let pauses = people.iter().flat_map(|p| manner(&p.moves).pauses);
    assert!(pauses.map(|pause| pause.for_s).all(|for_s| (10.0..=60.0).contains(&for_s)));
}

/// So that the walk of `tests/tests/walks.rs` is one among people.
#[test]
fn the_walk_among_people_meets_every_one_of_them() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/worlds/people.toml");
    let world = Arc::new(World::load(&file).unwrap());
    let mut physics = Physics::new(world, PhysicsConfig::default(), Pose2::default()).unwrap();
    let truths = walk(&mut physics, FORWARD, 66.0);
    assert_eq!(touches(truths.last().unwrap()), [0, 0, 0]);
    for person in 0..4 {
        let to_robot_m = |truth: &WorldTruth| {
            let (walker, robot) = (&truth.walkers[person], &truth.world_from_robot);
            (walker.x_m - robot.x_m).hypot(walker.y_m - robot.y_m)
        };
        let nearest = truths.iter().min_by(|a, b| to_robot_m(a).total_cmp(&to_robot_m(b))).unwrap();
        assert!(to_robot_m(nearest) < 1.8, "{person}: {} m", to_robot_m(nearest));
    }
    // The last of them stands while the robot comes by.
    let stood = truths.windows(2).filter(|pair| pair[0].walkers[3] == pair[1].walkers[3]);
    assert!(stood.filter(|pair| (pair[0].walkers[3].x_m - pair[0].world_from_robot.x_m).abs() < 2.0).count() > 300);
}

#[test]
fn what_a_person_cannot_do_is_refused_with_its_key() {
    for (person, told) in [
        ("path = [[0, 0], [4, 0]]\ngroup = 1", "w.toml:1: group: it needs moves = \"social\""),
        ("path = [[0, 0], [4, 0]]\npauses = [[1, 5]]", "w.toml:1: pauses: it needs moves = \"social\""),
        ("moves = \"social\"\npath = [[0, 0], [4, 0]]\npauses = [[5, 5]]", "w.toml:1: pauses: 5 is not in [0, 4]"),
        (
            "moves = \"social\"\npath = [[0, 0], [4, 0]]\npauses = [[2, 5], [1, 5]]",
            "w.toml:1: pauses: 1 is not in [2, 4]",
        ),
        ("moves = \"social\"\npath = [[0, 0], [4, 0]]\npauses = [[2, -5]]", "w.toml:1: pauses: -5 is not in [0, 3600]"),
    ] {
        let error = World::from_toml("w.toml", &format!("[[person]]\n{person}\n"), Path::new("")).unwrap_err();
        assert_eq!(error.to_string(), told);
    }
    assert!(World::from_toml("w.toml", "[[person]]\npath = [[0, 0]]\nmoves = \"orca\"\n", Path::new("")).is_err());
}
