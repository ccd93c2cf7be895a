//! An episode from above, as SVG.

use std::fmt::Write;

use guidance::se2::Point;
use world::{Cell, SeenBy};

use super::course::Course;

/// Pixels of a metre.
const SCALE: f64 = 24.0;
/// What is shown about the walk, metres.
const AROUND_M: f64 = 4.0;

/// The picture of an episode that was traced; nothing where it was not.
#[must_use]
pub fn svg(course: &Course) -> String {
    let Some(trace) = &course.trace else { return String::new() };
    let (mut min, mut max) = (Point::new(f64::MAX, f64::MAX), Point::new(f64::MIN, f64::MIN));
    for place in trace.places.iter().flat_map(|(robot, handler)| [robot, handler]).chain(&trace.line) {
        (min, max) = (min.inf(place), max.sup(place));
    }
    let around = nalgebra::Vector2::repeat(AROUND_M);
    (min, max) = (min - around, max + around);
    let size = (max - min) * SCALE;
    let at = |p: &Point| format!("{:.1},{:.1}", (p.x - min.x) * SCALE, (max.y - p.y) * SCALE);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0}\" height=\"{1:.0}\" viewBox=\"0 0 {0:.0} {1:.0}\">\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>",
        size.x, size.y
    );
    let mut path = |points: &mut dyn Iterator<Item = &Point>, style: &str, tag: &str| {
        let points: Vec<String> = points.map(at).collect();
        let _ = write!(out, "<{tag} points=\"{}\" {style}/>", points.join(" "));
    };
    for prism in trace.site.world.prisms() {
        let inside = prism.outline.iter().any(|p| p.x > min.x && p.x < max.x && p.y > min.y && p.y < max.y);
        if !inside && prism.outline.len() > 2 && prism.solid {
            continue;
        }
        let fill = if prism.solid { "#bbb" } else { "none" };
        let stroke = match prism.seen_by {
            SeenBy::Camera => "#3ac",
            _ if prism.z0_m > 0.35 => "#e80",
            _ if prism.z1_m < 0.35 => "#2a2",
            _ => "#333",
        };
        let tag = if prism.solid { "polygon" } else { "polyline" };
        path(&mut prism.outline.iter(), &format!("fill=\"{fill}\" stroke=\"{stroke}\" stroke-width=\"2\""), tag);
    }
    for person in trace.site.world.people() {
        path(
            &mut person.path.iter(),
            "fill=\"none\" stroke=\"#c3c\" stroke-width=\"2\" stroke-dasharray=\"4\"",
            "polyline",
        );
    }
    path(&mut trace.line.iter(), "fill=\"none\" stroke=\"#aaa\" stroke-width=\"1\" stroke-dasharray=\"6\"", "polyline");
    let (robots, handlers) = (trace.places.iter().map(|p| &p.0), trace.places.iter().map(|p| &p.1));
    path(&mut robots.into_iter(), "fill=\"none\" stroke=\"#d33\" stroke-width=\"2\"", "polyline");
    path(&mut handlers.into_iter(), "fill=\"none\" stroke=\"#36c\" stroke-width=\"2\"", "polyline");
    let mut disc = |p: &Point, radius_m: f64, style: &str| {
        let (x, y) = ((p.x - min.x) * SCALE, (max.y - p.y) * SCALE);
        let _ = write!(out, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{:.1}\" {style}/>", radius_m * SCALE);
    };
    for (robot, handler) in trace.places.iter().step_by(10).chain(trace.places.last()) {
        disc(robot, 0.30, "fill=\"none\" stroke=\"#d33\"");
        disc(handler, 0.25, "fill=\"none\" stroke=\"#36c\"");
    }
    for place in &trace.collisions {
        disc(place, 0.1, "fill=\"#d33\"");
    }
    if let Some(map) = trace.site.world.map() {
        let cell = map.resolution_m() * SCALE;
        let (columns, rows) = map.size();
        for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
            let p = map.middle(column, row);
            let shown = p.x > min.x && p.x < max.x && p.y > min.y && p.y < max.y;
            if shown && map.cell(column as i64, row as i64) != Cell::Free {
                let (x, y) = ((p.x - min.x) * SCALE, (max.y - p.y) * SCALE);
                let _ = write!(
                    out,
                    "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{cell:.1}\" height=\"{cell:.1}\" fill=\"#555\"/>"
                );
            }
        }
    }
    let report = &course.report;
    let _ = write!(
        out,
        "<text x=\"8\" y=\"18\" font-family=\"sans-serif\" font-size=\"14\">{:?}, {}, {} collisions, {:.1} m</text></svg>",
        report.cue,
        if report.success { "followed" } else { "not followed" },
        report.collisions,
        report.distance_m
    );
    out
}
