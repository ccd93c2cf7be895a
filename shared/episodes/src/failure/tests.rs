//! Each class, by a case made by hand: a corridor of 40 m along x, 2 m wide, with an opening to the left at 10 m and
//! another one at 20 m. The robot is 0.5 m ahead of the handler.

use guidance::TravelLine;
use guidance::se2::{Point, Se2};
use messages::CueKind;
use world::{Course, DropKind, HandlerProfile, Opening, Side, Team, World};

use super::classify::Case;
use super::watch::Seen;
use super::{Asked, Class, Failure, Thing};
use crate::score::{Held, Report, Score};
use crate::task::{Goal, Task};

fn line(places: &[[f64; 2]]) -> TravelLine {
    let places: Vec<Point> = places.iter().map(|[x, y]| Point::new(*x, *y)).collect();
    TravelLine::new(&places).expect("a line")
}

fn opening(way_m: f64) -> Opening {
    let line = line(&[[way_m, 0.0], [way_m, 8.0]]);
    Opening { way_m, width_m: 1.6, side: Side::Left, line, edge_m: None, behind: None }
}

/// One case: what is asked, and where handler and robot are at each decision.
struct Made {
    task: Task,
    course: Course,
    report: Report,
    stopped: bool,
    seen: Vec<Seen>,
}

fn seen(x_m: f64, y_m: f64) -> Seen {
    Seen {
        robot: Point::new(x_m + 0.5, y_m),
        handler: Point::new(x_m, y_m),
        moved: true,
        held: Held::default(),
        touched: [None; 2],
        arrived: false,
        person_m: f64::INFINITY,
        room_m: 1.0,
        edge_m: f64::INFINITY,
        walked_m: 0.0,
    }
}

fn way(from: [f64; 2], to: [f64; 2], count: usize) -> Vec<Seen> {
    let at = |i: usize, axis: usize| from[axis] + (to[axis] - from[axis]) * i as f64 / (count - 1) as f64;
    (0..count).map(|i| seen(at(i, 0), at(i, 1))).collect()
}

impl Made {
    fn new(cue: CueKind, goal: Goal, seen: Vec<Seen>) -> Self {
        let course = Course::new(line(&[[0.0, 0.0], [40.0, 0.0]]), 2.0, vec![opening(10.0), opening(20.0)]);
        let start = Se2::translation(2.5, 0.0);
        let task = Task { cue, world_from_robot: start, line: course.line.clone(), goal, width_m: 2.0 };
        let world = World::new(2.5, Vec::new());
        let profile = HandlerProfile::exact(guidance::DelayedHarness::default());
        let team = Team::new(&world, world::Bodies::default(), profile, &start);
        let report = Score::begin(&task, DropKind::None, &team, &world).report();
        Self { task, course, report, stopped: true, seen }
    }

    fn forward(seen: Vec<Seen>) -> Self {
        Self::new(CueKind::Forward, Goal::Along(12.0), seen)
    }

    fn left(seen: Vec<Seen>) -> Self {
        Self::new(CueKind::Left, Goal::Into(vec![opening(10.0)]), seen)
    }

    fn stand(seen: Vec<Seen>) -> Self {
        Self::new(CueKind::Right, Goal::Stand(Vec::new()), seen)
    }

    fn with(mut self, change: impl FnOnce(&mut Self)) -> Self {
        change(&mut self);
        self
    }

    fn failure(&self) -> Option<Failure> {
        let Self { task, course, report, stopped, seen } = self;
        Case { task, course, start: Point::new(2.0, 0.0), report, stopped: *stopped, seen }.failure()
    }

    fn is(&self, asked: Asked, class: Class) -> Failure {
        let found = self.failure().expect("a failure");
        assert_eq!((found.asked, found.class), (asked, class), "{found:?}");
        found
    }
}

/// A robot that stands for 30 decisions at 5 m, held by that, in a way of 40 decisions.
fn stuck(held: Held, change: impl Fn(&mut Seen)) -> Made {
    let mut seen = way([2.0, 0.0], [5.0, 0.0], 10);
    let mut stands = Seen { moved: false, held, ..*seen.last().expect("a way") };
    change(&mut stands);
    seen.extend([stands; 30]);
    Made::forward(seen)
}

const LIDAR: Held = Held { policy: 0, lidar: 1, camera: 0, memory: 0, contact: 0, floor: 0 };

#[test]
fn an_episode_in_which_all_goes_well_is_no_failure() {
    assert_eq!(Made::forward(way([2.0, 0.0], [12.0, 0.0], 50)).with(|made| made.report.success = true).failure(), None);
}

#[test]
fn a_fall_counts_before_anything_else() {
    let fall = || Made::forward(way([2.0, 0.0], [5.0, 0.0], 20));
    fall().with(|made| made.report.floor.robot_fell = true).is(Asked::Forward, Class::RobotFell);
    let handler = fall().with(|made| {
        made.report.floor.handler_fell = true;
        made.seen[3].touched[0] = Some(Thing::Wall);
    });
    assert_eq!(handler.is(Asked::Forward, Class::HandlerFell).decision, 20);
}

#[test]
fn the_first_touch_counts_with_what_was_touched() {
    let touch = |first: [Option<Thing>; 2]| {
        Made::forward(way([2.0, 0.0], [12.0, 0.0], 50)).with(|made| {
            (made.seen[6].touched, made.report.success) = (first, true);
            made.seen[9].touched = [Some(Thing::Person); 2];
        })
    };
    let robot = touch([Some(Thing::Glass), None]).is(Asked::Forward, Class::RobotTouched);
    assert_eq!(
        (robot.thing, robot.decision, robot.words().as_str()),
        (Some(Thing::Glass), 7, "the robot touched glass")
    );
    let handler = touch([None, Some(Thing::Low)]).is(Asked::Forward, Class::HandlerTouched);
    assert_eq!((handler.thing, handler.decision), (Some(Thing::Low), 7));
}

#[test]
fn where_the_handler_went_instead_is_told() {
    let along = way([2.0, 0.0], [20.0, 0.0], 40);
    let into = |x_m: f64| [way([2.0, 0.0], [x_m, 0.0], 20), way([x_m, 0.0], [x_m, 4.0], 20)].concat();
    let wrong = Made::left([along, way([20.0, 0.0], [20.0, 4.0], 20)].concat());
    // They passed theirs on the way, and the opening that they are in tells more.
    wrong.is(Asked::Turn, Class::WrongOpening);
    Made::forward(into(10.0)).is(Asked::Forward, Class::WrongOpening);
    Made::stand(into(20.0)).is(Asked::Stand, Class::WrongOpening);
    let passed = Made::left(way([2.0, 0.0], [18.0, 0.0], 60)).is(Asked::Turn, Class::PassedOpening);
    // Its far edge is at 10.8 m.
    assert_eq!(passed.decision, 38);
    let outside = || [way([2.0, 0.0], [5.0, 0.0], 20), way([5.0, 0.0], [5.0, -3.0], 20)].concat();
    Made::left(outside()).is(Asked::Turn, Class::LeftCorridor);
    Made::stand(outside()).is(Asked::Stand, Class::LeftCorridor);
    Made::forward(way([2.0, 0.0], [0.2, 0.0], 9)).is(Asked::Forward, Class::TurnedBack);
    Made::stand(way([2.0, 0.0], [18.0, 0.0], 60)).is(Asked::Stand, Class::WalkedOn);
    // They are 2.5 m inside, and face another way: all that the line of an opening lets them miss.
    let askew = [way([2.0, 0.0], [10.0, 0.0], 30), way([10.0, 0.0], [10.0, 3.5], 15)].concat();
    Made::left(askew).is(Asked::Turn, Class::InsideAskew);
    Made::forward(way([2.0, 0.0], [9.0, 0.0], 50)).is(Asked::Forward, Class::OutOfTime);
}

#[test]
fn before_an_edge_the_robot_stands_too_far_off_or_walks_still() {
    let far = Made::new(CueKind::Forward, Goal::BeforeEdge, stuck(LIDAR, |_| {}).seen);
    far.is(Asked::Edge, Class::StoodFarFromEdge);
    let walks = Made::new(CueKind::Forward, Goal::BeforeEdge, way([2.0, 0.0], [8.0, 0.0], 50));
    walks.is(Asked::Edge, Class::OutOfTime);
}

#[test]
fn what_held_a_robot_that_is_stuck_is_told() {
    let asked = Asked::Forward;
    let turning = stuck(Held::default(), |seen| seen.moved = true).is(asked, Class::StuckTurning);
    assert!((10..40).contains(&turning.decision), "{turning:?}");
    let policy = Held { policy: 1, ..Held::default() };
    stuck(policy, |_| {}).is(asked, Class::StoodByPolicy);
    let floor = Held { floor: 1, ..Held::default() };
    stuck(floor, |seen| seen.edge_m = 0.6).is(asked, Class::StuckAtEdge);
    stuck(floor, |_| {}).is(asked, Class::StuckAtNothing);
    stuck(LIDAR, |seen| seen.person_m = 1.2).is(asked, Class::StuckAtPerson);
    stuck(LIDAR, |seen| seen.room_m = 0.3).is(asked, Class::StuckAtObstacle);
    stuck(LIDAR, |_| {}).is(asked, Class::StuckAtNothing);
    stuck(Held::default(), |_| {}).is(asked, Class::StoodByRule);
    // The opening's sides are at 9.2 and 10.8 m, in the wall at 1 m.
    let jamb = |seen: &mut Seen| (seen.handler, seen.robot) = (Point::new(8.8, 0.4), Point::new(9.3, 0.4));
    stuck(LIDAR, jamb).is(asked, Class::StuckAtJamb);
}

#[test]
fn who_arrives_all_the_same_was_stuck_only_after_twenty_seconds() {
    let late = |stands: usize| {
        let mut made = stuck(LIDAR, |seen| seen.room_m = 0.3);
        made.seen.truncate(10);
        let last = *made.seen.last().expect("a way");
        made.seen.extend(vec![Seen { moved: false, held: LIDAR, room_m: 0.3, ..last }; stands]);
        made.seen.extend(way([5.5, 0.0], [12.0, 0.0], 20));
        made.report.success = true;
        made.failure().map(|failure| failure.class)
    };
    assert_eq!(late(30), None);
    assert_eq!(late(45), Some(Class::StuckAtObstacle));
}

#[test]
fn what_comes_after_the_episode_counts_last_and_people_are_told_separately() {
    let arrived = || Made::forward(way([2.0, 0.0], [12.0, 0.0], 50)).with(|made| made.report.success = true);
    let moves = arrived().with(|made| (made.stopped, made.report.hit_by_others) = (false, 1));
    moves.is(Asked::Forward, Class::DidNotStop);
    let hit = arrived().with(|made| made.report.hit_by_others = 1).is(Asked::Forward, Class::HitByPerson);
    assert!(!hit.class.is_ours());
    assert!(Class::ALL.iter().all(|class| class.is_ours() != (*class == Class::HitByPerson)));
}

#[test]
fn docs_define_every_class() {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/evaluation/page.md");
    let page = std::fs::read_to_string(page).expect("the page");
    for class in Class::ALL {
        assert!(page.contains(&format!("| {} |", class.words())), "docs/evaluation/page.md lacks {:?}", class.words());
    }
}
