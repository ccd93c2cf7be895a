//! An episode from above, as SVG.

use std::fmt::Write;

use episodes::{Goal, Task};
use guidance::Se2;
use guidance::se2::Point;
use world::{Bodies, Cell, GridMap, SeenBy, Site, World};

use super::outcome::Outcome;

/// Pixels of a metre.
const SCALE: f64 = 24.0;
/// About the height of the lidar's plane, metres.
const OVER_M: f64 = 0.35;
/// What is shown about the walk, metres.
const AROUND_M: f64 = 4.0;
/// Of a task so much of the way is shown, metres, and dots of that distance where it has been done.
const SHOWN_M: f64 = 18.0;
const DOT_M: f64 = 0.2;

/// A drawing in the world's metres.
struct Drawing {
    min: Point,
    max: Point,
    out: String,
}

impl Drawing {
    fn new(min: Point, max: Point) -> Self {
        let size = (max - min) * SCALE;
        let (width, height) = (size.x.ceil(), size.y.ceil());
        let frame = format!("width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\"");
        let paper = "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>";
        let out = format!("<svg xmlns=\"http://www.w3.org/2000/svg\" {frame}>{paper}");
        Self { min, max, out }
    }

    fn pixels(&self, p: &Point) -> (f64, f64) {
        ((p.x - self.min.x) * SCALE, (self.max.y - p.y) * SCALE)
    }

    fn shows(&self, p: &Point) -> bool {
        p.x > self.min.x && p.x < self.max.x && p.y > self.min.y && p.y < self.max.y
    }

    fn lines<'a>(&mut self, tag: &str, points: impl Iterator<Item = &'a Point>, style: &str) {
        let at = |p: &Point| {
            let (x, y) = self.pixels(p);
            format!("{x:.1},{y:.1}")
        };
        let points: Vec<String> = points.map(at).collect();
        let _ = write!(self.out, "<{tag} points=\"{}\" {style}/>", points.join(" "));
    }

    fn disc(&mut self, p: &Point, radius_m: f64, style: &str) {
        let (x, y) = self.pixels(p);
        let _ = write!(self.out, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{:.1}\" {style}/>", radius_m * SCALE);
    }

    /// The whole, with a line of text.
    fn text(mut self, text: &str) -> String {
        for (i, sentence) in text.split_inclusive(". ").enumerate() {
            let style = format!("x=\"8\" y=\"{}\" font-family=\"sans-serif\" font-size=\"14\"", 18 * (i + 1));
            let _ = write!(self.out, "<text {style}>{}</text>", sentence.trim());
        }
        self.out.push_str("</svg>");
        self.out
    }

    /// What stands and walks there, and where the floor lies lower or is dark.
    fn world(&mut self, world: &World) {
        let polygon = |fill: &str| format!("fill=\"{fill}\" stroke=\"#b60\"");
        for dark in world.dark_floor() {
            self.lines("polygon", dark.outline.iter(), &polygon("#ddd"));
        }
        for hole in world.holes() {
            self.lines("polygon", hole.outline.iter(), &polygon("#fdb"));
        }
        for prism in world.prisms() {
            if prism.solid && !prism.outline.iter().any(|p| self.shows(p)) {
                continue;
            }
            let stroke = match prism.seen_by {
                SeenBy::Camera => "#3ac",
                _ if prism.z0_m > OVER_M => "#e80",
                _ if prism.z1_m < OVER_M => "#2a2",
                _ => "#333",
            };
            let (tag, fill) = if prism.solid { ("polygon", "#bbb") } else { ("polyline", "none") };
            let style = format!("fill=\"{fill}\" stroke=\"{stroke}\" stroke-width=\"2\"");
            self.lines(tag, prism.outline.iter(), &style);
        }
        for (door, _) in world.doors() {
            let open = door.leaf(door.swing_rad[1]);
            self.lines("polygon", open.outline.iter(), "fill=\"none\" stroke=\"#333\" stroke-dasharray=\"4\"");
        }
        for person in world.people() {
            let style = "fill=\"none\" stroke=\"#c3c\" stroke-width=\"2\" stroke-dasharray=\"4\"";
            self.lines("polyline", person.path.iter(), style);
        }
        if let Some(map) = world.map() {
            self.map(map);
        }
    }

    /// What is not free of a floor plan, and what is off it: each run of cells of a row is one rectangle.
    fn map(&mut self, map: &GridMap) {
        let corners = [self.min, Point::new(self.max.x, self.min.y), self.max, Point::new(self.min.x, self.max.y)];
        let cells = corners.map(|corner| map.cell_of(corner));
        let of = |at: fn(&(i64, i64)) -> i64| {
            let all = || cells.iter().map(at);
            all().min().unwrap_or(0)..=all().max().unwrap_or(0)
        };
        let columns: Vec<i64> = of(|cell| cell.0).collect();
        for row in of(|cell| cell.1) {
            let is_free = |column: &i64| map.cell(*column, row) == Cell::Free;
            for run in columns.chunk_by(|a, b| is_free(a) == is_free(b)).filter(|run| !is_free(&run[0])) {
                let (from, to) = (run[0] as f64, (run[run.len() - 1] + 1) as f64);
                let outline = [(from, 0.0), (to, 0.0), (to, 1.0), (from, 1.0)]
                    .map(|(column, up)| map.place_of(column, row as f64 + up));
                self.lines("polygon", outline.iter(), "fill=\"#555\"");
            }
        }
    }
}

/// The picture of a task: red is the robot as the cue is given, blue the handler; green is where the handler has
/// arrived, grey the way that is meant, and each circle a place where the course can be left.
#[must_use]
pub fn task(task: &Task, site: &Site, handler: &Se2, words: &str, bodies: &Bodies) -> String {
    let robot = place(&task.world_from_robot);
    let foot_m = site.course.line.foot(robot).way_m;
    let (mut min, mut max) = (robot, robot);
    let near = site.course.line.part((foot_m - 3.0).max(0.0), foot_m + SHOWN_M);
    let shown = near.iter().flat_map(|line| line.corners()).chain(task.line.corners());
    for place in shown.filter(|place| (*place - robot).norm() < SHOWN_M) {
        (min, max) = (min.inf(place), max.sup(place));
    }
    let around = nalgebra::Vector2::repeat(AROUND_M);
    // Room for the words.
    max.x = max.x.max(min.x + SHOWN_M);
    let mut drawing = Drawing::new(min - around, max + around);
    drawing.world(&site.world);
    let line = |color: &str, width: u32| format!("fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\"");
    let (columns, rows) = ((max - min).x + 2.0 * AROUND_M, (max - min).y + 2.0 * AROUND_M);
    let places = (0..(rows / DOT_M) as usize)
        .flat_map(|row| (0..(columns / DOT_M) as usize).map(move |column| (column as f64 * DOT_M, row as f64 * DOT_M)));
    for (x_m, y_m) in places {
        let at = min - around + nalgebra::Vector2::new(x_m, y_m);
        let way_m = task.line.foot(at).way_m;
        let is_place = task.goal != Goal::BeforeEdge && !matches!(task.goal, Goal::Along(_));
        let facing = Se2::new(at.coords, task.line.at(way_m).rotation.angle());
        if is_place && task.is_done(&facing, way_m) {
            drawing.disc(&at, 0.03, "fill=\"#2a2\"");
        }
    }
    drawing.lines("polyline", task.line.corners().iter(), &format!("{} stroke-dasharray=\"6\"", line("#777", 2)));
    if let Goal::Along(to_m) = task.goal {
        drawing.disc(&place(&task.line.at(to_m)), 0.3, &line("#2a2", 3));
    }
    for opening in &site.course.openings {
        drawing.disc(&place(&site.course.line.at(opening.way_m)), 0.12, &line("#888", 1));
        drawing.lines("polyline", opening.line.corners().iter(), &line("#bbb", 1));
    }
    for (pose, radius_m, color) in
        [(&task.world_from_robot, bodies.robot_radius_m, "#d33"), (handler, bodies.handler_radius_m, "#36c")]
    {
        drawing.disc(&place(pose), radius_m, &line(color, 2));
        let nose = pose * Point::new(radius_m + 0.4, 0.0);
        drawing.lines("polyline", [place(pose), nose].iter(), &line(color, 2));
    }
    drawing.text(words)
}

/// The picture of a walk to a goal, in words: red is the robot, blue the handler, green the goal.
#[must_use]
pub fn walked(world: &World, robot: &[Point], handler: &[Point], goal: Point, bodies: &Bodies, words: &str) -> String {
    let (mut min, mut max) = (goal, goal);
    for place in robot.iter().chain(handler) {
        (min, max) = (min.inf(place), max.sup(place));
    }
    let around = nalgebra::Vector2::repeat(AROUND_M);
    let mut drawing = Drawing::new(min - around, max + around);
    drawing.world(world);
    let line = |color: &str, width: u32| format!("fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\"");
    for (places, radius_m, color) in
        [(robot, bodies.robot_radius_m, "#d33"), (handler, bodies.handler_radius_m, "#36c")]
    {
        drawing.lines("polyline", places.iter(), &line(color, 2));
        for place in places.iter().step_by(40).chain(places.last()) {
            drawing.disc(place, radius_m, &line(color, 1));
        }
    }
    drawing.disc(&goal, 0.15, "fill=\"#2a2\"");
    drawing.text(words)
}

fn place(pose: &Se2) -> Point {
    Point::from(pose.translation.vector)
}

/// The picture of an episode that was traced; nothing where it was not. Red is the robot, blue the handler; green is
/// lower than the lidar's plane, orange above it, cyan glass; floor that lies lower is light orange, dark floor grey.
#[must_use]
pub fn svg(outcome: &Outcome, bodies: &Bodies) -> String {
    let Some(trace) = &outcome.trace else { return String::new() };
    let (mut min, mut max) = (Point::new(f64::MAX, f64::MAX), Point::new(f64::MIN, f64::MIN));
    for place in trace.places.iter().flat_map(|(robot, handler)| [robot, handler]).chain(&trace.line) {
        (min, max) = (min.inf(place), max.sup(place));
    }
    let around = nalgebra::Vector2::repeat(AROUND_M);
    let mut drawing = Drawing::new(min - around, max + around);
    drawing.world(&trace.site.world);
    let line = |color: &str, width: u32| format!("fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\"");
    drawing.lines("polyline", trace.line.iter(), &format!("{} stroke-dasharray=\"6\"", line("#aaa", 1)));
    drawing.lines("polyline", trace.places.iter().map(|p| &p.0), &line("#d33", 2));
    drawing.lines("polyline", trace.places.iter().map(|p| &p.1), &line("#36c", 2));
    for (robot, handler) in trace.places.iter().step_by(10).chain(trace.places.last()) {
        drawing.disc(robot, bodies.robot_radius_m, &line("#d33", 1));
        drawing.disc(handler, bodies.handler_radius_m, &line("#36c", 1));
    }
    for place in &trace.collisions {
        drawing.disc(place, 0.1, "fill=\"#d33\"");
    }
    let report = &outcome.report;
    let followed = match (report.floor.robot_fell, report.floor.handler_fell) {
        (true, _) => "the robot fell",
        (_, true) => "the handler fell",
        _ if report.success => "followed",
        _ => "not followed",
    };
    let text = format!("{:?}, {followed}, {} collisions, {:.1} m", report.cue, report.collisions, report.distance_m);
    drawing.text(&text)
}
