//! What a task asks for, in words.

use guidance::cue::TURN_REACH_M;
use guidance::se2::Point;
use messages::CueKind;
use world::{Course, Opening, Side};

use crate::task::{END_M, Goal, INSIDE_M, Task};

/// What a task asks for, and when it has been done.
#[must_use]
pub fn explain(task: &Task, course: &Course) -> String {
    let way_m = course.line.foot(Point::from(task.world_from_robot.translation.vector)).way_m;
    let off_deg = course.line.heading_error_rad(way_m, task.world_from_robot.rotation.angle()).to_degrees();
    let left_m = course.line.length_m() - way_m;
    let (cue, done) = match (&task.goal, task.cue) {
        (_, CueKind::Stop) => ("Stop.".to_owned(), "the robot stands".to_owned()),
        (Goal::Along(to_m), _) if to_m + END_M > course.line.length_m() - 0.01 => (
            format!("Forward: the corridor ends {left_m:.1} m ahead of the robot."),
            format!("the handler is within {END_M} m of its end"),
        ),
        (Goal::Along(to_m), _) => (
            format!("Forward: the corridor goes on for {left_m:.1} m."),
            format!("the handler has come {:.1} m on from where the robot is", to_m - way_m),
        ),
        (Goal::BeforeEdge, cue) => {
            (format!("{}: the floor of the way ends.", name(cue)), "the robot stands before the edge".to_owned())
        }
        (Goal::Into(openings), cue) => {
            let all: Vec<String> = openings.iter().map(|opening| told(opening, way_m)).collect();
            (
                format!("{}: the opening {}.", name(cue), all.join(", or the one ")),
                format!("the handler is {INSIDE_M} m inside"),
            )
        }
        (Goal::Stand(beside), cue) => {
            let side = if cue == CueKind::Left { "left" } else { "right" };
            let also = beside.first().map_or(String::new(), |opening| {
                format!(", or is {INSIDE_M} m inside the opening {}", told(opening, way_m))
            });
            (
                format!("{}: no opening to the {side} within {:.1} m.", name(cue), left_m.min(TURN_REACH_M)),
                format!("the handler stands in the corridor{also}"),
            )
        }
    };
    format!("{cue} The handler faces {off_deg:+.0} degrees off the way. Done when {done}.")
}

fn name(cue: CueKind) -> &'static str {
    match cue {
        CueKind::Forward => "Forward",
        CueKind::Left => "Left",
        CueKind::Right => "Right",
        CueKind::Stop => "Stop",
    }
}

fn told(opening: &Opening, way_m: f64) -> String {
    let (ahead_m, width_m) = (opening.way_m - way_m, opening.width_m);
    let side = if opening.side == Side::Left { "left" } else { "right" };
    let place = if ahead_m < 0.0 { "behind the robot" } else { "ahead" };
    format!("to the {side} {:.1} m {place}, {width_m:.1} m wide", ahead_m.abs())
}
