//! What viewers are shown beside the records: a log in words, and robot, handler and hull. Pure.

use guidance::se2::{Point, exp, pose2, se2};
use guidance::{Disc, Hull, Interaction, InteractionModel};
use messages::{LocomotionState, Mode, ModeClass, Outcome, Permit, Pose2, StopKind, s_from_ns};
use recording::{Level, Record, Viewer, log_json, time_json};
use serde_json::{Value, json};
use settings::Settings;

/// Points that the hull is drawn with.
const HULL_POINTS: u32 = 72;

/// Makes what viewers are shown of the records.
#[derive(Debug)]
pub struct Show {
    robot_radius_m: f64,
    handler_radius_m: f64,
    model: Option<InteractionModel>,
    dt_s: f64,
    scan_period_ns: u64,
    mode: Option<Mode>,
    held_by: StopKind,
}

impl Show {
    /// For a run with these settings.
    pub fn new(settings: &Settings) -> Self {
        Self {
            robot_radius_m: settings.robot.radius_m.get() + settings.shield.margin_m,
            handler_radius_m: settings.handler.radius_m.get() + settings.shield.margin_m,
            model: settings.interaction().ok(),
            dt_s: settings.policy.dt.s(),
            scan_period_ns: (1e9 / settings.lidar.rate_hz.get()) as u64,
            mode: None,
            held_by: StopKind::None,
        }
    }

    /// What a record adds.
    pub fn of(&mut self, record: &Record) -> Option<(Viewer, Value)> {
        match record {
            Record::Mode(mode) => self.mode_line(mode).map(|line| (Viewer::Log, line)),
            Record::LocomotionState(state) => self.hold_line(state).map(|line| (Viewer::Log, line)),
            Record::ShieldPermit(permit) => Some((Viewer::Scene, self.scene(permit))),
            _ => None,
        }
    }

    /// A line where the class, its reason or the cue in force changed.
    fn mode_line(&mut self, mode: &Mode) -> Option<Value> {
        let cue = |mode: &Mode| mode.cue.valid.then_some(mode.cue.cue);
        let told = |mode: &Mode| (mode.class, mode.reason, mode.epoch, cue(mode).map(|cue| cue.header.seq));
        let old = self.mode.replace(*mode);
        if old.as_ref().map(told) == Some(told(mode)) {
            return None;
        }
        let (level, words) = match (mode.class, cue(mode)) {
            (ModeClass::Run, Some(cue)) => (Level::Info, format!("run: cue {}", cue.kind.name())),
            (ModeClass::Run, None) => (Level::Info, "run: no cue in force".to_owned()),
            (class, _) => (Level::Error, format!("{}: {} (epoch {})", class.name(), mode.reason, mode.epoch)),
        };
        Some(log_json(mode.header.published_ns, level, "mode", &words))
    }

    /// A line where the robot begins or ceases to be held within run.
    fn hold_line(&mut self, state: &LocomotionState) -> Option<Value> {
        let kind = state.limited_by.kind;
        if std::mem::replace(&mut self.held_by, kind) == kind || (kind != StopKind::None && !kind.holds_a_cue()) {
            return None;
        }
        let (level, words) = match kind {
            StopKind::None => (Level::Info, "goes on".to_owned()),
            _ => (Level::Warning, format!("held: {}", state.limited_by)),
        };
        Some(log_json(state.header.published_ns, level, "locomotion", &words))
    }

    /// Robot and handler as the shield sees them, and what is left of the action with one scan period more.
    fn scene(&self, permit: &Permit) -> Value {
        let granted = permit.outcome == Outcome::Granted;
        let hull_color = if granted { [0.1, 0.8, 0.2] } else { [0.9, 0.2, 0.1] };
        let timestamp = time_json(permit.header.published_ns);
        let entity = |id: &str, cylinders: Vec<Value>, lines: Vec<Value>| {
            json!({
                "timestamp": timestamp, "frame_id": "robot", "id": id, "lifetime": { "sec": 0, "nsec": 500_000_000 },
                "frame_locked": true, "metadata": [{ "key": "outcome", "value": permit.outcome.name() }],
                "arrows": [], "cubes": [], "spheres": [], "cylinders": cylinders, "lines": lines, "triangles": [],
                "texts": [], "models": [],
            })
        };
        let robot = cylinder(Pose2::default(), self.robot_radius_m, 0.5, [0.2, 0.4, 0.9]);
        let handler = cylinder(permit.robot_from_handler, self.handler_radius_m, 1.7, [0.9, 0.7, 0.1]);
        let hull: Vec<Value> = self.hull(permit).iter().map(|point| vector(point.x, point.y, 0.02)).collect();
        let hull = json!({
            "type": 1, "pose": pose_json(Pose2::default()), "thickness": 0.03, "scale_invariant": false,
            "points": hull, "color": color(hull_color, 1.0), "colors": [], "indices": [],
        });
        let entities = vec![
            entity("robot", vec![robot], Vec::new()),
            entity("handler", vec![handler], Vec::new()),
            entity("hull", Vec::new(), vec![hull]),
        ];
        json!({ "deletions": [], "entities": entities })
    }

    /// The swept hull's boundary, in the robot frame: what the shield judged, but for the handler's lag, which it knows
    /// from the whole step.
    fn hull(&self, permit: &Permit) -> Vec<Point> {
        let until_ns = permit.action_end_ns.saturating_add(self.scan_period_ns);
        let left_s = s_from_ns(until_ns.saturating_sub(permit.header.stamp_ns)).min(self.dt_s * 2.0);
        let end = exp(permit.velocity, left_s);
        let handler = se2(permit.robot_from_handler);
        let fraction = (left_s / self.dt_s).min(1.0);
        let then = self.model.as_ref().map_or(handler, |model| model.follow(&handler, &end, fraction));
        let disc = |pose: Pose2, radius_m: f64| Disc { center: Point::new(pose.x_m, pose.y_m), radius_m };
        let hull = Hull::new([
            disc(Pose2::default(), self.robot_radius_m),
            disc(pose2(&end), self.robot_radius_m),
            disc(permit.robot_from_handler, self.handler_radius_m),
            disc(pose2(&(end * then)), self.handler_radius_m),
        ]);
        (0..HULL_POINTS)
            .map(|i| {
                let angle = std::f64::consts::TAU * f64::from(i) / f64::from(HULL_POINTS);
                let direction = Point::new(angle.cos(), angle.sin()).coords;
                Point::origin() + direction * hull.threshold_m(Point::origin(), direction)
            })
            .collect()
    }
}

fn vector(x: f64, y: f64, z: f64) -> Value {
    json!({ "x": x, "y": y, "z": z })
}

fn color([r, g, b]: [f64; 3], a: f64) -> Value {
    json!({ "r": r, "g": g, "b": b, "a": a })
}

fn pose_json(pose: Pose2) -> Value {
    let half_rad = 0.5 * pose.yaw_rad;
    json!({
        "position": vector(pose.x_m, pose.y_m, 0.0),
        "orientation": { "x": 0.0, "y": 0.0, "z": half_rad.sin(), "w": half_rad.cos() },
    })
}

fn cylinder(pose: Pose2, radius_m: f64, height_m: f64, of: [f64; 3]) -> Value {
    let mut pose = pose_json(pose);
    pose["position"]["z"] = json!(0.5 * height_m);
    let size = vector(2.0 * radius_m, 2.0 * radius_m, height_m);
    json!({ "pose": pose, "size": size, "bottom_scale": 1.0, "top_scale": 1.0, "color": color(of, 0.5) })
}

#[cfg(test)]
mod tests {
    use super::Show;
    use messages::{CueInForce, Header, Mode, ModeClass, Outcome, Permit, Pose2, StopKind, StopReason, Twist2};
    use recording::{Record, Viewer};
    use settings::Settings;

    #[test]
    fn the_hull_holds_robot_and_handler_now_and_then() {
        let mut show = Show::new(&Settings::default());
        let permit = Permit {
            outcome: Outcome::Granted,
            velocity: Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.0 },
            action_end_ns: 400_000_000,
            robot_from_handler: Pose2::new(-0.75, -0.35, 0.0),
            ..Permit::default()
        };
        let hull = show.hull(&permit);
        let reach = |of: fn(&guidance::se2::Point) -> f64| hull.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
        // 0.25 m ahead and the robot's radius; 0.75 m behind and the handler's; the shield's margin about both.
        let margin_m = Settings::default().shield.margin_m;
        assert!((reach(|point| point.x) - 0.55 - margin_m).abs() < 1e-9, "{hull:?}");
        let behind_m = reach(|point| -point.x) - margin_m;
        assert!(behind_m > 0.85 && behind_m <= 1.0 + 1e-9, "{hull:?}");
        let shown = show.of(&Record::from(permit));
        assert!(shown.is_some_and(|(viewer, value)| {
            viewer == Viewer::Scene
                && value["entities"][2]["lines"][0]["points"].as_array().is_some_and(|p| p.len() == 72)
        }));
    }

    #[test]
    fn the_log_tells_changes_only() {
        let mut show = Show::new(&Settings::default());
        let header = Header { published_ns: 5, ..Header::default() };
        let fault = Mode { header, reason: StopReason::of(StopKind::Boot), epoch: 1, ..Mode::default() };
        let run = Mode { class: ModeClass::Run, cue: CueInForce { valid: true, ..CueInForce::default() }, ..fault };
        let said: Vec<String> = [fault, fault, run, run]
            .into_iter()
            .filter_map(|mode| show.of(&Record::from(mode)))
            .map(|(_, line)| line["message"].as_str().unwrap_or_default().to_owned())
            .collect();
        assert_eq!(said, ["fault: boot (epoch 1)", "run: cue stop"]);
    }
}
