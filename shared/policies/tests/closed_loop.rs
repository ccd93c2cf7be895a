//! The geometric engine in a closed loop: exact lidar, delayed handler, shield, in small worlds of segments and discs.
//!
//! `GEO_TRACE=1 cargo test -- --nocapture NAME` prints every decision.

#![allow(clippy::print_stdout)]

mod support;

use guidance::se2::{Point, pose2, se2, wrap_angle};
use guidance::{ActionTable, DelayedHarness, Se2};
use guidedog_policies::geometric::{GeometricConfig, GeometricEngine, Observation, Plan};
use messages::{CueKind, MAX_ACTIONS, Pose2, ScanHeader};
use nalgebra::Vector2;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::time::{Duration, Instant};
use support::{HANDLER_M, ROBOT_M, follow, rigid};

const RANGE_MAX_M: f64 = 16.0;

/// Walls, pillars, and people who walk at a constant velocity.
#[derive(Default, Clone)]
struct World {
    walls: Vec<[Point; 2]>,
    pillars: Vec<(Point, f64)>,
    walkers: Vec<(Point, Vector2<f64>, f64)>,
}

impl World {
    fn line(mut self, points: &[(f64, f64)]) -> Self {
        for pair in points.windows(2) {
            self.walls.push([Point::new(pair[0].0, pair[0].1), Point::new(pair[1].0, pair[1].1)]);
        }
        self
    }

    fn boxed(self, x: f64, y: f64, half_x: f64, half_y: f64) -> Self {
        let (west, east, south, north) = (x - half_x, x + half_x, y - half_y, y + half_y);
        self.line(&[(west, south), (east, south), (east, north), (west, north), (west, south)])
    }

    fn pillar(mut self, x: f64, y: f64, radius_m: f64) -> Self {
        self.pillars.push((Point::new(x, y), radius_m));
        self
    }

    fn discs(&self, time_s: f64) -> impl Iterator<Item = (Point, f64)> {
        let walking =
            self.walkers.iter().map(move |(place, velocity, radius_m)| (place + velocity * time_s, *radius_m));
        self.pillars.iter().copied().chain(walking)
    }

    /// From a place to the nearest thing, metres.
    fn distance_m(&self, place: Point, time_s: f64) -> f64 {
        let mut nearest = f64::INFINITY;
        for [a, b] in &self.walls {
            let run = b - a;
            let share = ((place - a).dot(&run) / run.norm_squared()).clamp(0.0, 1.0);
            nearest = nearest.min((place - (a + run * share)).norm());
        }
        self.discs(time_s).map(|(centre, radius_m)| (place - centre).norm() - radius_m).fold(nearest, f64::min)
    }

    fn range_m(&self, from: Point, bearing: f64, handler: Point, time_s: f64) -> f64 {
        let ray = Vector2::new(bearing.cos(), bearing.sin());
        let mut nearest = f64::INFINITY;
        for [a, b] in &self.walls {
            let (run, to) = (b - a, a - from);
            let cross = ray.perp(&run);
            if cross.abs() > 1e-12 {
                let (along, share) = (to.perp(&run) / cross, to.perp(&ray) / cross);
                if along >= 0.0 && (0.0..=1.0).contains(&share) {
                    nearest = nearest.min(along);
                }
            }
        }
        for (centre, radius_m) in self.discs(time_s).chain([(handler, HANDLER_M)]) {
            let to = centre - from;
            let along = to.dot(&ray);
            let within = radius_m * radius_m - (to.norm_squared() - along * along);
            if along > 0.0 && within >= 0.0 {
                nearest = nearest.min((along - within.sqrt()).max(0.0));
            }
        }
        nearest
    }
}

/// One walk: where it begins, the cues with the place and direction that trigger them, and where it ends.
struct Walk {
    name: &'static str,
    world: World,
    start: Pose2,
    /// Cue, and the place at which it is given: once the robot is level with the first that is left
    /// (all lie along x).
    cues: Vec<(CueKind, Option<Point>)>,
    /// The robot gets within 0.8 m of it; `None`: it must end standing, with that plan.
    end: Result<Point, (Point, Plan)>,
    limit_s: f64,
    beams: usize,
    field_rad: f64,
    sigma_m: f64,
}

#[derive(Debug, Default)]
struct Report {
    reached: bool,
    time_s: f64,
    distance_m: f64,
    robot_collisions: u32,
    handler_collisions: u32,
    all_unsafe: u32,
    changed_by_shield: u32,
    decisions: u32,
    least_room_m: f64,
    slowest: Duration,
    last_plan: Plan,
    end: Pose2,
}

struct Noise(u64);

impl Noise {
    /// Roughly normal: the sum of twelve.
    fn next(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

impl Walk {
    fn new(name: &'static str, world: World, start: (f64, f64, f64), limit_s: f64) -> Self {
        Self {
            name,
            world,
            start: Pose2::new(start.0, start.1, start.2),
            cues: vec![(CueKind::Forward, None)],
            end: Err((Point::origin(), Plan::End)),
            limit_s,
            beams: 360,
            field_rad: TAU,
            sigma_m: 0.0,
        }
    }

    fn cue(mut self, cue: CueKind, at: (f64, f64)) -> Self {
        self.cues.push((cue, Some(Point::new(at.0, at.1))));
        self
    }

    fn to(mut self, x: f64, y: f64) -> Self {
        self.end = Ok(Point::new(x, y));
        self
    }

    fn stands(mut self, x: f64, y: f64, plan: Plan) -> Self {
        self.end = Err((Point::new(x, y), plan));
        self
    }

    fn scan(&self, robot: &Se2, handler: Point, time_s: f64, noise: &mut Noise) -> (ScanHeader, Vec<f32>) {
        let increment =
            if self.field_rad >= TAU { TAU / self.beams as f64 } else { self.field_rad / (self.beams - 1) as f64 };
        let header = ScanHeader {
            angle_min_rad: -self.field_rad / 2.0,
            angle_increment_rad: increment,
            range_min_m: 0.05,
            range_max_m: RANGE_MAX_M,
            sigma_m: self.sigma_m,
            ..ScanHeader::default()
        };
        let from = Point::from(robot.translation.vector);
        let ranges = (0..self.beams).map(|i| {
            let bearing = robot.rotation.angle() + header.angle_min_rad + increment * i as f64;
            let range_m = self.world.range_m(from, bearing, handler, time_s);
            if range_m >= RANGE_MAX_M { f32::INFINITY } else { (range_m + self.sigma_m * noise.next()) as f32 }
        });
        (header, ranges.collect())
    }

    fn run(&self) -> Report {
        let table = ActionTable::eight();
        let mut engine = GeometricEngine::new(GeometricConfig::default(), table.clone());
        let mut report = Report { least_room_m: f64::INFINITY, ..Report::default() };
        let mut noise = Noise(7);
        let mut robot = se2(self.start);
        let mut handler = rigid();
        let (mut cues, mut cue, mut cue_start) = (self.cues.as_slice(), CueKind::Stop, robot);
        let mut stood = 0;
        let mut colliding = [false; 2];
        while report.time_s < self.limit_s {
            let place = Point::from(robot.translation.vector);
            let mut new = false;
            if let [(kind, at), rest @ ..] = cues
                && at.is_none_or(|at| (place - at).norm() < 1.5 && (place.x - at.x).abs() < 0.3)
            {
                (cue, cue_start, cues, new) = (*kind, robot, rest, true);
            }
            let axis = match cue {
                CueKind::Left => FRAC_PI_2,
                CueKind::Right => -FRAC_PI_2,
                _ => 0.0,
            };
            if axis != 0.0 && wrap_angle((cue_start.inverse() * robot).rotation.angle()) * axis.signum() > PI / 4.0 {
                let yaw = cue_start.rotation.angle() + axis;
                (cue, cue_start, new) = (CueKind::Forward, Se2::new(robot.translation.vector, yaw), true);
            }
            let handler_at = Point::from((robot * handler).translation.vector);
            let (header, ranges) = self.scan(&robot, handler_at, report.time_s, &mut noise);
            let begun = Instant::now();
            let shares = engine.decide(&Observation {
                scan: &header,
                ranges: &ranges,
                obstacles: &[],
                shield: None,
                handler: None,
                odom_from_robot: pose2(&robot),
                odometry_incarnation: 1,
                start_from_robot: pose2(&(cue_start.inverse() * robot)),
                cue,
                cue_is_new: new,
                formation: messages::Formation::Beside,
            });
            report.slowest = report.slowest.max(begun.elapsed());
            let sum: f32 = shares.iter().sum();
            assert!((sum - 1.0).abs() < 1e-5 && shares[table.len()..].iter().all(|share| *share == 0.0));
            let action = self.shielded(&header, &ranges, &handler, &table, &shares, &mut report);
            trace(self.name, &report, &robot, cue, engine.plan(), &table, action, &shares);
            let motion = table.actions()[action].start_from_end();
            self.advance(&mut robot, &mut handler, &motion, &mut colliding, &mut report);
            report.last_plan = engine.plan();
            stood = if action == 0 { stood + 1 } else { 0 };
            let place = Point::from(robot.translation.vector);
            match self.end {
                Ok(end) if (place - end).norm() < 0.8 => report.reached = true,
                Err((end, plan)) if stood >= 6 && report.last_plan == plan => {
                    report.reached = (place - end).norm() < 1.0 && cues.is_empty();
                }
                _ => {}
            }
            if report.reached || stood >= 40 {
                break;
            }
        }
        report.end = pose2(&robot);
        report
    }

    /// The action of the greatest probability that the shield lets pass; stop where it lets none.
    fn shielded(
        &self,
        header: &ScanHeader,
        ranges: &[f32],
        handler: &Se2,
        table: &ActionTable,
        shares: &[f32; MAX_ACTIONS],
        report: &mut Report,
    ) -> usize {
        report.decisions += 1;
        let ranked = |a: &usize, b: &usize| shares[*a].total_cmp(&shares[*b]).then(b.cmp(a));
        let best = (0..table.len()).max_by(ranked).unwrap_or(0);
        if best == ActionTable::STOP {
            return best;
        }
        let hits = support::hits(header, ranges, handler);
        let allowed_actions = support::allowed(&hits, handler, table);
        let allowed = allowed_actions.into_iter().max_by(ranked);
        if allowed.is_none() {
            report.all_unsafe += 1;
        } else if allowed != Some(best) {
            report.changed_by_shield += 1;
        }
        allowed.unwrap_or(ActionTable::STOP)
    }

    fn advance(
        &self,
        robot: &mut Se2,
        handler: &mut Se2,
        motion: &Se2,
        colliding: &mut [bool; 2],
        report: &mut Report,
    ) {
        const PARTS: i32 = 10;
        let velocity = guidance::se2::log(motion, 0.5);
        let (from, before) = (*robot, *robot * *handler);
        let after = from * motion * follow(motion, handler);
        for part in 1..=PARTS {
            let share = f64::from(part) / f64::from(PARTS);
            let now = from * guidance::se2::exp(velocity, 0.5 * share);
            let handler_at = before.translation.vector.lerp(&after.translation.vector, share);
            report.distance_m += (now.translation.vector - robot.translation.vector).norm();
            report.time_s += 0.5 / f64::from(PARTS);
            *robot = now;
            let robot_room = self.world.distance_m(Point::from(now.translation.vector), report.time_s) - ROBOT_M;
            let handler_room = self.world.distance_m(Point::from(handler_at), report.time_s) - HANDLER_M;
            report.least_room_m = report.least_room_m.min(robot_room).min(handler_room);
            report.robot_collisions += u32::from(robot_room < 0.0 && !colliding[0]);
            report.handler_collisions += u32::from(handler_room < 0.0 && !colliding[1]);
            *colliding = [robot_room < 0.0, handler_room < 0.0];
        }
        *handler = follow(motion, handler);
    }

    #[track_caller]
    fn check(&self) -> Report {
        let report = self.run();
        println!(
            "{:<22} {} {:?} t {:5.1} s, {:5.1} m, collisions {}/{}, all unsafe {}, changed {}, room {:.2} m, \
             slowest {:?}",
            self.name,
            if report.reached { "reached" } else { "NOT REACHED" },
            report.last_plan,
            report.time_s,
            report.distance_m,
            report.robot_collisions,
            report.handler_collisions,
            report.all_unsafe,
            report.changed_by_shield,
            report.least_room_m,
            report.slowest,
        );
        assert!(report.reached, "{}: not reached, ended at {:?} ({:?})", self.name, report.end, report.last_plan);
        assert_eq!((report.robot_collisions, report.handler_collisions), (0, 0), "{}", self.name);
        report
    }
}

#[allow(clippy::too_many_arguments)]
fn trace(
    name: &str,
    report: &Report,
    robot: &Se2,
    cue: CueKind,
    plan: Plan,
    table: &ActionTable,
    action: usize,
    shares: &[f32; MAX_ACTIONS],
) {
    if std::env::var_os("GEO_TRACE").is_none() {
        return;
    }
    let best = (0..table.len()).max_by(|a, b| shares[*a].total_cmp(&shares[*b])).unwrap_or(0);
    println!(
        "{name} {:6.1} ({:6.2} {:6.2} {:6.1}) {:<8} {plan:?} {} {}",
        report.time_s,
        robot.translation.x,
        robot.translation.y,
        robot.rotation.angle().to_degrees(),
        cue.name(),
        table.actions()[action].name,
        if best == action { String::new() } else { format!("instead of {}", table.actions()[best].name) },
    );
}

fn corridor(length_m: f64, width_m: f64) -> World {
    let half = width_m / 2.0;
    World::default().line(&[(-3.0, -half), (-3.0, half), (length_m, half), (length_m, -half), (-3.0, -half)])
}

/// Two corridors of 2 m that cross at (10, 0); `arms`: west, east, north, south.
fn junction(arms: [bool; 4]) -> World {
    let [west, east, north, south] = arms;
    let mut points = vec![(9.0, 1.0)];
    let arm = |points: &mut Vec<(f64, f64)>, open: bool, way: [(f64, f64); 2]| {
        if open {
            points.extend(way);
        }
    };
    arm(&mut points, north, [(9.0, 12.0), (11.0, 12.0)]);
    points.push((11.0, 1.0));
    arm(&mut points, east, [(22.0, 1.0), (22.0, -1.0)]);
    points.push((11.0, -1.0));
    arm(&mut points, south, [(11.0, -12.0), (9.0, -12.0)]);
    points.push((9.0, -1.0));
    arm(&mut points, west, [(-3.0, -1.0), (-3.0, 1.0)]);
    points.push((9.0, 1.0));
    World::default().line(&points)
}

fn arc(radius_m: f64, from_deg: f64, to_deg: f64) -> Vec<(f64, f64)> {
    let count = 40;
    (0..=count)
        .map(|i| {
            let angle = (from_deg + (to_deg - from_deg) * f64::from(i) / f64::from(count)).to_radians();
            (radius_m * angle.cos(), radius_m * angle.sin())
        })
        .collect()
}

/// A ring corridor of 2 m round the origin, from the south counter-clockwise by that angle.
fn curve(radius_m: f64, by_deg: f64) -> World {
    let (inner, outer) = (arc(radius_m - 1.0, -100.0, by_deg - 90.0), arc(radius_m + 1.0, -100.0, by_deg - 90.0));
    World::default().line(&inner).line(&outer)
}

#[test]
fn corridor_with_an_orientation_error() {
    for error_deg in [0.0_f64, 30.0, -30.0] {
        Walk::new("corridor", corridor(30.0, 2.0), (0.0, 0.0, error_deg.to_radians()), 90.0).to(25.0, 0.0).check();
    }
}

#[test]
fn corridor_with_boxes_and_pillars() {
    let world = corridor(30.0, 2.4).boxed(5.0, 0.9, 0.4, 0.3).boxed(10.0, -0.8, 0.3, 0.4).boxed(15.0, 0.8, 0.5, 0.4);
    let world = world.pillar(20.0, -0.9, 0.15);
    Walk::new("boxes", world.clone(), (0.0, 0.0, 0.0), 120.0).to(26.0, 0.0).check();
    let mut noisy = Walk::new("boxes, noisy", world, (0.0, 0.0, 0.0), 120.0).to(26.0, 0.0);
    noisy.sigma_m = 0.025;
    noisy.check();
}

#[test]
fn cluttered_hall() {
    let world = corridor(30.0, 5.0).boxed(4.0, 0.2, 0.4, 0.4).boxed(8.0, 1.3, 0.5, 0.5).boxed(8.0, -1.4, 0.4, 0.5);
    let world =
        world.pillar(11.5, 0.0, 0.3).boxed(15.0, -0.6, 0.6, 0.3).pillar(17.0, 1.2, 0.25).boxed(20.0, 0.0, 0.3, 0.8);
    Walk::new("cluttered", world, (0.0, 0.0, 0.0), 140.0).to(26.0, 0.0).check();
}

#[test]
fn people_walk_by() {
    let mut world = corridor(30.0, 3.0);
    world.walkers.push((Point::new(25.0, 0.9), Vector2::new(-0.8, 0.0), 0.25));
    world.walkers.push((Point::new(40.0, -0.9), Vector2::new(-0.8, 0.0), 0.25));
    Walk::new("people", world, (0.0, 0.0, 0.0), 120.0).to(25.0, 0.0).check();
}

#[test]
fn curves_and_bends_need_one_cue() {
    Walk::new("curve", curve(6.0, 160.0), (0.0, -6.0, 0.0), 120.0).to(5.6, 2.0).check();
    Walk::new("tight curve", curve(3.5, 160.0), (0.0, -3.5, 0.0), 120.0).to(3.3, 1.2).check();
    let left = World::default().line(&[(-3.0, 1.0), (9.0, 1.0), (9.0, 12.0)]).line(&[
        (-3.0, -1.0),
        (11.0, -1.0),
        (11.0, 12.0),
    ]);
    Walk::new("bend left", left, (0.0, 0.0, 0.0), 90.0).to(10.0, 9.0).check();
    let right = World::default().line(&[(-3.0, 1.0), (11.0, 1.0), (11.0, -12.0)]).line(&[
        (-3.0, -1.0),
        (9.0, -1.0),
        (9.0, -12.0),
    ]);
    Walk::new("bend right", right.clone(), (0.0, 0.0, 0.0), 90.0).to(10.0, -9.0).check();
    let mut noisy = Walk::new("bend right, noisy", right, (0.0, 0.0, 0.2), 90.0).to(10.0, -9.0);
    noisy.sigma_m = 0.025;
    noisy.check();
    let kink =
        World::default().line(&[(-3.0, 1.0), (9.0, 1.0), (17.0, 9.0)]).line(&[(-3.0, -1.0), (9.8, -1.0), (18.4, 7.6)]);
    Walk::new("kink", kink, (0.0, 0.0, 0.0), 90.0).to(16.0, 6.6).check();
}

#[test]
fn forward_goes_straight_on_at_a_crossing_and_stands_at_an_end() {
    Walk::new("crossing", junction([true; 4]), (0.0, 0.0, 0.0), 90.0).to(18.0, 0.0).check();
    Walk::new("side openings", junction([true, true, true, false]), (0.0, 0.0, 0.0), 90.0).to(18.0, 0.0).check();
    let tee = junction([true, false, true, true]);
    Walk::new("tee", tee, (0.0, 0.0, 0.1), 90.0).stands(10.0, 0.0, Plan::Junction).check();
    Walk::new("dead end", corridor(10.0, 2.0), (0.0, 0.0, 0.0), 90.0).stands(9.0, 0.0, Plan::End).check();
    Walk::new("no opening", corridor(10.0, 2.0), (0.0, 0.0, 0.0), 90.0)
        .cue(CueKind::Left, (4.0, 0.0))
        .stands(9.0, 0.0, Plan::End)
        .check();
}

#[test]
fn forward_stays_in_the_corridor_beside_an_open_space() {
    // The left wall has a gap of 4 m. The hall behind it runs on beside the corridor, and is wider.
    let world = World::default()
        .line(&[(-3.0, -0.72), (40.0, -0.72)])
        .line(&[(-3.0, 0.72), (10.0, 0.72), (10.0, 9.0), (40.0, 9.0)])
        .line(&[(14.0, 0.72), (40.0, 0.72)]);
    Walk::new("beside a hall", world, (0.0, 0.0, 0.0), 90.0).to(25.0, 0.0).check();
}

/// A corridor of 2 m that bends to the left by that angle at (9, 0) and ends there after `on_m`; and its end.
fn bent_dead_end(bend_deg: f64, on_m: f64) -> (World, Point) {
    let bend_rad = bend_deg.to_radians();
    let (along, across) = (Vector2::new(bend_rad.cos(), bend_rad.sin()), Vector2::new(-bend_rad.sin(), bend_rad.cos()));
    let end = Point::new(9.0, 0.0) + along * on_m;
    let [left, right] = [end + across, end - across];
    let cut_m = (bend_rad / 2.0).tan();
    let world = World::default().line(&[
        (-3.0, 1.0),
        (9.0 - cut_m, 1.0),
        (left.x, left.y),
        (right.x, right.y),
        (9.0 + cut_m, -1.0),
        (-3.0, -1.0),
        (-3.0, 1.0),
    ]);
    (world, end - along)
}

#[test]
fn behind_a_bend_the_way_back_is_no_opening() {
    for bend_deg in [50.0, -50.0] {
        for cue in [CueKind::Left, CueKind::Right] {
            let (world, end) = bent_dead_end(bend_deg, 5.0);
            let is_its_turn = (cue == CueKind::Left) == (bend_deg > 0.0);
            // The cue comes after the bend where the bend itself would be its turn.
            let at = if is_its_turn { end - (end - Point::new(9.0, 0.0)) * 0.4 } else { Point::new(7.0, 0.0) };
            let walk = Walk::new("dead end behind a bend", world, (0.0, 0.0, 0.0), 120.0).cue(cue, (at.x, at.y));
            walk.stands(end.x, end.y, Plan::End).check();
        }
    }
}

#[test]
fn a_turn_is_looked_for_behind_a_bend_to_the_other_side() {
    let right = World::default().line(&[(-3.0, 1.0), (9.0, 1.0), (9.0, 14.0), (11.0, 14.0), (11.0, 9.0), (20.0, 9.0)]);
    let right = right.line(&[(-3.0, -1.0), (11.0, -1.0), (11.0, 7.0), (20.0, 7.0)]);
    let walk = Walk::new("right behind a bend to the left", right, (0.0, 0.0, 0.0), 110.0);
    walk.cue(CueKind::Right, (6.0, 0.0)).to(16.0, 8.0).check();
}

#[test]
fn a_person_in_the_opening_that_is_asked_for_does_not_send_the_team_the_other_way() {
    let mut world = junction([true, false, true, true]);
    world.walkers.push((Point::new(10.0, -1.3), Vector2::zeros(), 0.25));
    let walk =
        Walk::new("somebody stands in the right arm", world, (0.0, 0.0, 0.0), 60.0).cue(CueKind::Right, (7.0, 0.0));
    walk.stands(10.2, 0.9, Plan::End).check();
}

#[test]
fn a_person_across_the_corridor_is_not_its_end() {
    // Beside an opening, a person crosses the corridor and fills it for a moment.
    let mut world = junction([true, true, true, false]);
    world.walkers.push((Point::new(10.8, 30.0), Vector2::new(0.0, -1.6), 0.35));
    world.walkers.push((Point::new(10.8, 30.8), Vector2::new(0.0, -1.6), 0.35));
    Walk::new("a person crosses", world, (0.0, 0.0, 0.0), 110.0).to(18.0, 0.0).check();
}

#[test]
fn turns_into_openings_with_timing_errors() {
    let (left, right) = (CueKind::Left, CueKind::Right);
    let turn = |name, arms, cue, at: f64, end: (f64, f64)| {
        Walk::new(name, junction(arms), (0.0, 0.0, 0.0), 110.0).cue(cue, (at, 0.0)).to(end.0, end.1).check();
    };
    for at in [5.0, 7.0, 8.5, 9.5] {
        turn("left at tee", [true, false, true, true], left, at, (10.0, 8.0));
        turn("right at tee", [true, false, true, true], right, at, (10.0, -8.0));
    }
    for at in [5.0, 8.5, 9.8, 11.0] {
        turn("left at crossing", [true; 4], left, at, (10.0, 8.0));
        turn("right at crossing", [true; 4], right, at, (10.0, -8.0));
    }
    turn("left, only left", [true, true, true, false], left, 6.0, (10.0, 8.0));
    turn("right, only right", [true, true, false, true], right, 6.0, (10.0, -8.0));
}

#[test]
fn a_half_circle_lidar_is_enough() {
    let mut walk = Walk::new("180 degrees", junction([true; 4]), (0.0, 0.0, 0.0), 110.0)
        .cue(CueKind::Right, (8.0, 0.0))
        .to(10.0, -8.0);
    (walk.beams, walk.field_rad) = (181, PI);
    walk.check();
}

#[test]
fn two_walks_are_the_same_to_the_bit() {
    let walk = Walk::new("again", junction([true; 4]), (0.0, 0.2, 0.3), 40.0).to(18.0, 0.0);
    let (first, second) = (walk.run(), walk.run());
    assert_eq!(first.end, second.end);
    assert_eq!(first.decisions, second.decisions);
}

#[test]
fn another_handler_walks_where_their_model_says() {
    let mut engine = GeometricEngine::new(GeometricConfig::default(), ActionTable::eight());
    let offset = Pose2::new(-0.9, -0.3, 0.1);
    let model = DelayedHarness::new(offset, 0.5, 0.5).expect("a handler").into();
    engine.take_handler(&model);
    let there = engine.robot_from_handler();
    let off = [there.x_m - offset.x_m, there.y_m - offset.y_m, there.yaw_rad - offset.yaw_rad];
    assert!(off.iter().all(|off| off.abs() < 1e-9), "{there:?}");
}

#[test]
fn odd_input_stands() {
    let table = ActionTable::eight();
    let header = ScanHeader {
        angle_min_rad: -PI,
        angle_increment_rad: TAU / 360.0,
        range_min_m: 0.1,
        range_max_m: 10.0,
        ..ScanHeader::default()
    };
    let cases: [(ScanHeader, Vec<f32>, Pose2); 7] = [
        (header, vec![f32::NAN; 360], Pose2::default()),
        (header, Vec::new(), Pose2::default()),
        (header, vec![-1.0; 360], Pose2::default()),
        (ScanHeader::default(), vec![1.0; 360], Pose2::default()),
        (header, vec![1.0; 360], Pose2::new(f64::NAN, 0.0, 0.0)),
        (header, vec![1.0; 360], Pose2::new(1e300, -1e9, 0.0)),
        (ScanHeader { angle_increment_rad: f64::NAN, ..header }, vec![1.0; 360], Pose2::default()),
    ];
    let mut engine = GeometricEngine::new(GeometricConfig::default(), table);
    for (header, ranges, pose) in &cases {
        let shares = engine.decide(&Observation {
            scan: header,
            ranges,
            obstacles: &[Point::new(f64::NAN, 0.0)],
            shield: None,
            handler: None,
            odom_from_robot: *pose,
            odometry_incarnation: 1,
            start_from_robot: Pose2::default(),
            cue: CueKind::Forward,
            cue_is_new: true,
            formation: messages::Formation::Beside,
        });
        assert_eq!(shares[0], 1.0);
        assert_eq!(engine.plan(), Plan::Blind);
    }
    for ranges in [vec![f32::INFINITY; 360], vec![0.2; 360], vec![10.0; 360]] {
        let shares = engine.decide(&Observation {
            scan: &header,
            ranges: &ranges,
            obstacles: &[Point::new(0.5, 0.0), Point::new(1e12, -1e300)],
            shield: None,
            handler: None,
            odom_from_robot: Pose2::new(1e5, -1e5, 3.0),
            odometry_incarnation: 2,
            start_from_robot: Pose2::default(),
            cue: CueKind::Left,
            cue_is_new: false,
            formation: messages::Formation::Beside,
        });
        assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5);
    }
}

/// A frame's noise across the way is not what the way is chosen by; the shield looks at it. What is seen again is.
#[test]
fn what_one_frame_saw_does_not_stop_the_team_and_what_two_saw_does() {
    let header =
        ScanHeader { angle_min_rad: -PI, angle_increment_rad: TAU / 360.0, range_max_m: 10.0, ..ScanHeader::default() };
    let corridor =
        |i: u32| (1.2 / (header.angle_min_rad + header.angle_increment_rad * f64::from(i)).sin().abs()) as f32;
    let ranges: Vec<f32> = (0..360).map(corridor).collect();
    let bar: Vec<Point> = (-12..=12).map(|i| Point::new(0.8, 0.1 * f64::from(i))).collect();
    let mut engine = GeometricEngine::new(GeometricConfig::default(), ActionTable::eight());
    let mut goes_ahead = |obstacles: &[Point]| {
        let shares = engine.decide(&Observation {
            scan: &header,
            ranges: &ranges,
            obstacles,
            shield: None,
            handler: Some(Point::new(-0.75, -0.35)),
            odom_from_robot: Pose2::default(),
            odometry_incarnation: 1,
            start_from_robot: Pose2::default(),
            cue: CueKind::Forward,
            cue_is_new: false,
            formation: messages::Formation::Beside,
        });
        shares[1] > 0.5
    };
    assert!(goes_ahead(&[]));
    assert!(goes_ahead(&bar), "a glimpse");
    assert!(goes_ahead(&[]));
    assert!(goes_ahead(&[]) && goes_ahead(&[]) && goes_ahead(&bar), "the glimpse is forgotten");
    assert!(!goes_ahead(&bar), "seen again");
    assert!(!goes_ahead(&[]), "below what the camera sees from here");
}
