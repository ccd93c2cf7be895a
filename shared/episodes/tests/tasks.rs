//! Tasks on real floor plans against what two readers said of them.

use std::collections::HashMap;

use guidance::se2::{Point, se2};
use guidedog_episodes::{Config, Goal, Task};
use messages::{CueKind, Pose2};
use world::{FloorPlan, GeneratorConfig, Side, generate};

/// A task of the table.
struct Row<'a> {
    map: &'a str,
    cue: CueKind,
    world_from_robot: Pose2,
    asks: &'a str,
    /// The opening, or where the handler has to come to.
    at: Option<Point>,
    /// What the two readers said.
    judged: [&'a str; 2],
}

/// Answers are the same that name places so near to each other, metres.
const SAME_M: f64 = 1.5;

fn rows(table: &str) -> Vec<Row<'_>> {
    let lines = table.lines().filter(|line| !line.starts_with('#')).skip(1);
    let row = |line| {
        let [map, cue, x, y, yaw, asks, at_x, at_y, a, b] = *Vec::from_iter(str::split(line, '\t')) else {
            panic!("ten columns: {line}")
        };
        let number = |text: &str| text.parse::<f64>().ok();
        let world_from_robot = [x, y, yaw].map(|text| number(text).expect("a number"));
        let at = number(at_x).zip(number(at_y)).map(|(x, y)| Point::new(x, y));
        Row {
            map,
            cue: CueKind::from_name(cue).expect("a cue"),
            world_from_robot: Pose2::new(world_from_robot[0], world_from_robot[1], world_from_robot[2]),
            asks,
            at,
            judged: [a, b],
        }
    };
    lines.map(row).collect()
}

/// What a task asks for and where, as the table tells it.
fn told(task: &Task) -> (&'static str, Option<Point>) {
    let place = |pose: guidance::Se2| Point::from(pose.translation.vector);
    match &task.goal {
        Goal::Along(to_m) => ("along", Some(place(task.line.at(*to_m)))),
        Goal::Into(openings) => ("into", openings.first().map(|opening| place(opening.line.at(0.0)))),
        Goal::Stand(openings) => ("stand", openings.first().map(|opening| place(opening.line.at(0.0)))),
        Goal::BeforeEdge => ("before_edge", None),
    }
}

#[test]
fn tasks_on_floor_plans_are_what_readers_would_mean() {
    let Some(maps) = test_data::data("maps") else { return };
    let robot_from_handler = se2(Config::default().robot_from_handler);
    let mut plans: HashMap<&str, FloorPlan> = HashMap::new();
    let (mut set, mut right, mut lost) = (0, 0, Vec::new());
    for (number, row) in rows(include_str!("tasks.tsv")).iter().enumerate() {
        let file = maps.join(row.map.strip_prefix("maps/").unwrap_or(row.map));
        let plan = plans.entry(row.map).or_insert_with(|| FloorPlan::load(&file).expect("a map"));
        let pose = se2(row.world_from_robot);
        let course = plan.course_at(&pose);
        let task = course.and_then(|course| Task::at(&course, row.cue, pose, &robot_from_handler));
        let answer = task.as_ref().map(told);
        let is_same = answer.is_some_and(|(asks, at)| {
            let near = at.zip(row.at).is_none_or(|(a, b)| (a - b).norm() < SAME_M);
            asks == row.asks && (near || asks == "stand")
        });
        set += usize::from(task.is_some());
        // A judgement holds for the answer that was judged; where none is set any more, nothing is asked.
        let is_right = row.judged.iter().all(|judged| *judged == "right");
        right += usize::from(is_same && is_right);
        if task.is_some() && !(is_same && is_right) {
            lost.push(format!("{number}: {} {:?} {:?} for {} {:?}", row.map, row.cue, answer, row.asks, row.judged));
        }
    }
    assert!(set >= 175, "at {set} places of the table a task is set: the others were clear as well");
    assert!(right as f64 >= 0.97 * set as f64, "{right} of {set}:\n{}", lost.join("\n"));
}

/// Who is sent across a hall arrives in the corridor behind it. In the hall, and for a turn towards it, no task is set.
#[test]
fn forward_leads_across_a_hall_and_nothing_else_is_asked_for_there() {
    let robot_from_handler = se2(Config::default().robot_from_handler);
    let (mut across, mut halls) = (0, 0);
    for seed in 0..400 {
        let course = generate(&GeneratorConfig::of_buildings(), seed).course;
        let Some([from_m, to_m]) = course.mapped.and_then(|mapped| mapped.hall_m) else { continue };
        halls += 1;
        for at in 8..(4.0 * course.line.length_m()) as usize - 8 {
            let way_m = 0.25 * at as f64;
            let task = |cue| Task::at(&course, cue, course.line.at(way_m), &robot_from_handler);
            let turns = [CueKind::Left, CueKind::Right].map(task);
            if (from_m..to_m).contains(&way_m) {
                assert!(
                    task(CueKind::Forward).is_none() && turns.iter().all(Option::is_none),
                    "seed {seed}, {way_m} m"
                );
                continue;
            }
            let Some(Task { goal: Goal::Along(forward_m), .. }) = task(CueKind::Forward) else {
                panic!("seed {seed}, {way_m} m: no task")
            };
            let is_before = way_m < from_m;
            assert!(!(from_m..to_m + 0.9).contains(&forward_m), "seed {seed}, {way_m} m: to {forward_m} m");
            across += usize::from(is_before && forward_m > to_m);
            for turn in turns.into_iter().flatten().filter(|_| is_before) {
                match turn.goal {
                    Goal::Into(openings) => assert!(openings.iter().all(|opening| opening.way_m < from_m)),
                    _ => assert!(turn.line.length_m() < from_m, "seed {seed}, {way_m} m"),
                }
            }
        }
    }
    println!("{halls} of 400 corridors have a hall; forward leads across it from {across} places");
    assert!((15..40).contains(&halls) && across > 200);
}

/// *Left* can mean the opening that robot or handler are beside. It does not mean one that both have passed.
#[test]
fn an_opening_may_be_meant_until_the_handler_has_passed_it() {
    let robot_from_handler = se2(Config::default().robot_from_handler);
    let (mut beside, mut passed) = (0, 0);
    for seed in 0..100 {
        let course = generate(&GeneratorConfig::default(), seed).course;
        for opening in &course.openings {
            let cue = if opening.side == Side::Left { CueKind::Left } else { CueKind::Right };
            for past_m in [-0.3, 0.1, 0.3, 1.5] {
                let way_m = opening.far_edge_m() + past_m;
                if way_m > course.line.length_m() {
                    continue;
                }
                let robot = course.line.at(way_m);
                let handler = robot * robot_from_handler;
                let handler_m = course.line.foot(Point::from(handler.translation.vector)).way_m;
                let Some(task) = Task::at(&course, cue, robot, &robot_from_handler) else { continue };
                let (Goal::Into(allowed) | Goal::Stand(allowed)) = &task.goal else { panic!("{:?}", task.goal) };
                let may_be_meant = allowed.contains(opening);
                assert_eq!(may_be_meant, handler_m < opening.far_edge_m(), "seed {seed}, {past_m} m past {opening:?}");
                if may_be_meant { beside += 1 } else { passed += 1 }
            }
        }
    }
    assert!(beside > 50 && passed > 50, "{beside} {passed}");
}
