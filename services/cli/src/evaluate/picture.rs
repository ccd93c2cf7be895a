//! An episode from above, as SVG.

use std::fmt::Write;

use guidance::se2::Point;
use world::{Bodies, Cell, GridMap, SeenBy, World};

use super::outcome::Outcome;

/// Pixels of a metre.
const SCALE: f64 = 24.0;
/// About the height of the lidar's plane, metres.
const OVER_M: f64 = 0.35;
/// What is shown about the walk, metres.
const AROUND_M: f64 = 4.0;

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
        for person in world.people() {
            let style = "fill=\"none\" stroke=\"#c3c\" stroke-width=\"2\" stroke-dasharray=\"4\"";
            self.lines("polyline", person.path.iter(), style);
        }
        if let Some(map) = world.map() {
            self.map(map);
        }
    }

    fn map(&mut self, map: &GridMap) {
        let cell = map.resolution_m() * SCALE;
        let (columns, rows) = map.size();
        for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
            let middle = map.middle(column, row);
            if self.shows(&middle) && map.cell(column as i64, row as i64) != Cell::Free {
                let (x, y) = self.pixels(&middle);
                let (x, y) = (x - cell / 2.0, y - cell / 2.0);
                let place = format!("x=\"{x:.1}\" y=\"{y:.1}\" width=\"{cell:.1}\" height=\"{cell:.1}\"");
                let _ = write!(self.out, "<rect {place} fill=\"#555\"/>");
            }
        }
    }
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
    let style = "x=\"8\" y=\"18\" font-family=\"sans-serif\" font-size=\"14\"";
    let _ = write!(drawing.out, "<text {style}>{text}</text></svg>");
    drawing.out
}
