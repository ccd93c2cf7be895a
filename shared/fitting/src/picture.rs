//! A walk as a picture (SVG), as in the paper's figure of the models: the robot, the handler as seen, and where two
//! models have the handler.

use std::fmt::Write;

use guidance::se2::Se2;

/// Pixels for a metre, and around everything.
const SCALE_PX: f64 = 180.0;
const EDGE_PX: f64 = 40.0;

/// A line of the picture.
#[derive(Debug, Clone, Copy)]
pub struct Trace<'a> {
    /// What it is.
    pub name: &'a str,
    /// A colour of SVG.
    pub color: &'a str,
    /// Its poses, one for each step.
    pub poses: &'a [Se2],
}

/// The picture. The first trace is the robot: thin lines tie each of its poses to those of the others at the same step.
#[must_use]
pub fn svg(title: &str, traces: &[Trace<'_>]) -> String {
    let all = || traces.iter().flat_map(|trace| trace.poses);
    let bound = |of: fn(&Se2) -> f64, pick: fn(f64, f64) -> f64, start| all().map(of).fold(start, pick);
    let (left, right) =
        (bound(|p| p.translation.x, f64::min, f64::MAX), bound(|p| p.translation.x, f64::max, f64::MIN));
    let (low, high) = (bound(|p| p.translation.y, f64::min, f64::MAX), bound(|p| p.translation.y, f64::max, f64::MIN));
    let x = |pose: &Se2| EDGE_PX + (pose.translation.x - left) * SCALE_PX;
    let y = |pose: &Se2| EDGE_PX * 2.0 + (high - pose.translation.y) * SCALE_PX;
    let width = (right - left) * SCALE_PX + 2.0 * EDGE_PX;
    let height = (high - low) * SCALE_PX + EDGE_PX * (3.0 + traces.len() as f64 * 0.5);
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{height:.0}\" \
         font-family=\"sans-serif\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         <text x=\"{EDGE_PX}\" y=\"24\" font-size=\"15\">{}</text>",
        escaped(title)
    );
    if let Some((robot, others)) = traces.split_first() {
        for trace in others {
            for (a, b) in robot.poses.iter().zip(trace.poses) {
                let _ = writeln!(
                    out,
                    "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"{}\" \
                     stroke-width=\"0.6\" opacity=\"0.5\"/>",
                    x(a),
                    y(a),
                    x(b),
                    y(b),
                    trace.color
                );
            }
        }
    }
    for (i, trace) in traces.iter().enumerate() {
        let points: Vec<String> = trace.poses.iter().map(|pose| format!("{:.1},{:.1}", x(pose), y(pose))).collect();
        let _ = writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2\"/>",
            points.join(" "),
            trace.color
        );
        for pose in trace.poses {
            let _ =
                writeln!(out, "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"{}\"/>", x(pose), y(pose), trace.color);
        }
        let line = height - EDGE_PX * 0.5 * (traces.len() - i) as f64;
        let _ = writeln!(
            out,
            "<text x=\"{EDGE_PX}\" y=\"{line:.0}\" font-size=\"13\" fill=\"{}\">{}</text>",
            trace.color,
            escaped(trace.name)
        );
    }
    out.push_str("</svg>\n");
    out
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::{Trace, svg};
    use guidance::Se2;

    #[test]
    fn names_cannot_break_the_picture() {
        let poses = [Se2::identity(), Se2::translation(1.0, 0.5)];
        let robot = Trace { name: "a<b & c", color: "black", poses: &poses };
        let text = svg("<title>", &[robot, Trace { name: "x", ..robot }]);
        assert!(text.starts_with("<svg") && text.ends_with("</svg>\n"));
        assert!(text.contains("a&lt;b &amp; c") && !text.contains("<title>"));
    }
}
