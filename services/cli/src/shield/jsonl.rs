//! `guidedog shield --jsonl`: cases in, answers out, one a line, so that anyone can check the shield from outside.
//!
//! Paper mode (Kim et al. 2023, alg. 1): no memory, no escape rule; invalid readings and the handler's mask as the
//! options of the case say.

use std::io::{BufRead, Write};

use guidance::se2::{Point, Se2, pose2, se2};
use guidance::shield::suppress_in_place;
use guidance::{
    Beams, DelayedHarness, EdgeDistance, Evidence, HandlerBody, Interaction, InteractionModel, Judgement, Motion,
    Reach, RigidHarness, RotatingRod, Shield, ShieldConfig,
};
use messages::{Pose2, ScanHeader};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::exit::Failure;
use crate::out;

/// A case longer than this is none, bytes.
const LINE_MAX: u64 = 4 << 20;
/// Where a beam that hit nothing ends, metres: beyond every threshold.
const NOTHING_M: f64 = 1e9;
/// Probabilities need not sum to 1, but to a number.
const WEIGHT_MAX: f64 = 1e9;
/// Nothing is larger or farther away, metres.
const PLACE_MAX_M: f64 = 1e3;
/// More actions than this are none.
const ACTIONS_MAX: usize = 1000;
/// A run of unknown beams wider than this is unsafe where a case does not say, metres.
const UNKNOWN_GAP_M: f64 = 0.10;

/// A case.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Case {
    id: Value,
    scan: Scan,
    robot_from_lidar: [f64; 3],
    robot_from_handler: [f64; 3],
    interaction: Model,
    actions: Vec<ActionOfCase>,
    robot_radius_m: f64,
    handler_radius_m: f64,
    handler_mask_margin_m: Option<f64>,
    probabilities: Vec<f64>,
    beta: f64,
    unknown_gap_m: Option<f64>,
}

impl Case {
    fn unknown_gap_m(&self) -> f64 {
        self.unknown_gap_m.unwrap_or(UNKNOWN_GAP_M)
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Scan {
    angle_min_rad: f64,
    angle_increment_rad: f64,
    range_min_m: f64,
    range_max_m: f64,
    ranges_m: Vec<Reading>,
}

/// A reading: metres, "inf" for one that hit nothing, null for one that says nothing.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
enum Reading {
    Metres(f64),
    Word(String),
    Nothing(()),
}

#[derive(Debug, Deserialize)]
#[serde(tag = "model", rename_all = "snake_case", deny_unknown_fields)]
enum Model {
    Delayed { alpha: f64, dt_s: f64, offset: [f64; 3] },
    Rigid { offset: [f64; 3] },
    Rod { grip: [f64; 2], length_m: f64 },
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ActionOfCase {
    name: String,
    motion: [f64; 3],
    dt_s: f64,
}

/// An answer.
#[derive(Debug, Serialize)]
struct Answer {
    id: Value,
    probabilities: Vec<f64>,
    #[serde(rename = "unsafe")]
    is_unsafe: Vec<bool>,
    all_unsafe: bool,
    /// Null where no beam that is judged hit anything.
    margins_m: Vec<Option<f64>>,
    next_handler: Vec<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    thresholds_m: Option<Vec<Vec<f64>>>,
}

/// Answers every line of standard input.
///
/// # Errors
/// Where standard input cannot be read or standard output cannot be written; a malformed line is answered.
pub fn answer_lines(thresholds: bool) -> Result<(), Failure> {
    let mut input = std::io::stdin().lock();
    let mut output = std::io::BufWriter::new(std::io::stdout().lock());
    let mut judge = Judge::default();
    let mut line = Vec::new();
    loop {
        line.clear();
        let n = std::io::Read::take(&mut input, LINE_MAX).read_until(b'\n', &mut line).map_err(Failure::of_run)?;
        if n == 0 {
            return out::written(output.flush());
        }
        if n as u64 == LINE_MAX && line.last() != Some(&b'\n') {
            skip_line(&mut input).map_err(Failure::of_run)?;
            line.clear();
            line.extend(b"over the longest line");
        }
        if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        let answer = judge.answer(&line, thresholds);
        out::written(writeln!(output, "{answer}"))?;
        // An asker who waits for the answer before the next case gets it.
        out::written(output.flush())?;
    }
}

fn skip_line(input: &mut impl BufRead) -> std::io::Result<()> {
    loop {
        let buffer = input.fill_buf()?;
        let (used, done) = match buffer.iter().position(|byte| *byte == b'\n') {
            Some(end) => (end + 1, true),
            None => (buffer.len(), buffer.is_empty()),
        };
        input.consume(used);
        if done {
            return Ok(());
        }
    }
}

/// Answers cases, one after the other.
#[derive(Debug, Default)]
struct Judge {
    beams: Beams,
    judgements: Vec<Judgement>,
}

impl Judge {
    fn answer(&mut self, line: &[u8], thresholds: bool) -> String {
        let case: Result<Case, _> = serde_json::from_slice(line);
        let (id, answered) = match case {
            Ok(case) => (case.id.clone(), self.judge(case, thresholds)),
            Err(error) => {
                // A line that is JSON tells whose it is even so.
                let id = serde_json::from_slice::<Value>(line).ok().and_then(|value| value.get("id").cloned());
                (id.unwrap_or(Value::Null), Err(error.to_string()))
            }
        };
        match answered.and_then(|answer| serde_json::to_string(&answer).map_err(|error| error.to_string())) {
            Ok(text) => text,
            Err(error) => json!({ "id": id, "error": error }).to_string(),
        }
    }

    fn judge(&mut self, case: Case, thresholds: bool) -> Result<Answer, String> {
        check(&case)?;
        let range_max_m = case.scan.range_max_m;
        let hit = |metres: f64| if metres >= range_max_m { NOTHING_M } else { metres };
        let readings = case.scan.ranges_m.iter().map(|reading| metres(reading).map(hit));
        let readings: Vec<f64> = readings.collect::<Result<_, _>>()?;
        let header = header(&case);
        self.beams.fill_with(&header, readings.len(), |i| readings[i]).map_err(|error| error.to_string())?;
        let handler = se2(pose(case.robot_from_handler));
        let mut motions = Vec::with_capacity(case.actions.len());
        for action in &case.actions {
            let robot = se2(pose(action.motion));
            let after = model(&case.interaction, action.dt_s)?.step(&handler, &robot);
            motions.push(Motion::new(robot, robot * after));
        }
        let body = HandlerBody {
            center: Point::from(handler.translation.vector),
            radius_m: case.handler_radius_m,
            mask_radius_m: case.handler_mask_margin_m.map(|margin_m| case.handler_radius_m + margin_m),
            seen: None,
        };
        let mut shield = Shield::new(ShieldConfig {
            robot_radius_m: case.robot_radius_m,
            margin_m: 0.0,
            unknown_gap_m: case.unknown_gap_m(),
            escape: false,
            unseen_limit_m2: None,
            back_from_edges_m: None,
            reach: Reach::default(),
            edges: EdgeDistance::default(),
        });
        let evidence = Evidence::scan(&self.beams);
        shield.judge_motions(motions.iter().cloned(), evidence, body, &mut self.judgements);
        let is_unsafe: Vec<bool> = self.judgements.iter().map(|judgement| !judgement.safe).collect();
        let mut probabilities = case.probabilities;
        let stop = stop_of(&case.actions);
        let all_unsafe = suppress_in_place(&mut probabilities, |i| is_unsafe[i], case.beta, stop);
        let thresholds_of = |motion| shield.thresholds_m(motion, &self.beams, body);
        let thresholds_m = thresholds.then(|| motions.iter().map(thresholds_of).collect());
        let margins = self.judgements.iter().map(|judgement| judgement.margin_m);
        Ok(Answer {
            id: case.id,
            probabilities,
            is_unsafe,
            all_unsafe,
            margins_m: margins.map(|margin| (margin < NOTHING_M / 2.0).then_some(margin)).collect(),
            next_handler: motions.iter().filter_map(|motion| motion.handler.as_ref().map(numbers)).collect(),
            thresholds_m,
        })
    }
}

fn pose([x_m, y_m, yaw_rad]: [f64; 3]) -> Pose2 {
    Pose2::new(x_m, y_m, yaw_rad)
}

fn numbers(pose: &Se2) -> [f64; 3] {
    let Pose2 { x_m, y_m, yaw_rad } = pose2(pose);
    [x_m, y_m, yaw_rad]
}

fn metres(reading: &Reading) -> Result<f64, String> {
    match reading {
        Reading::Metres(metres) => Ok(*metres),
        Reading::Word(word) if word == "inf" => Ok(f64::INFINITY),
        Reading::Word(word) => Err(format!("scan.ranges_m: \"{word}\" is neither a number nor \"inf\" nor null")),
        Reading::Nothing(()) => Ok(f64::NAN),
    }
}

fn header(case: &Case) -> ScanHeader {
    let scan = &case.scan;
    ScanHeader {
        angle_min_rad: scan.angle_min_rad,
        angle_increment_rad: scan.angle_increment_rad,
        range_min_m: scan.range_min_m,
        range_max_m: NOTHING_M,
        robot_from_lidar: pose(case.robot_from_lidar),
        ..ScanHeader::default()
    }
}

/// The model, stepped with the action's own dt.
fn model(model: &Model, action_dt_s: f64) -> Result<InteractionModel, String> {
    let made = match model {
        Model::Delayed { alpha, dt_s, offset } => {
            let fitted = DelayedHarness::unbounded(pose(*offset), *alpha, *dt_s);
            fitted.and_then(|fitted| fitted.in_steps_of(action_dt_s)).map(InteractionModel::Delayed)
        }
        Model::Rigid { offset } => RigidHarness::new(pose(*offset)).map(InteractionModel::Rigid),
        Model::Rod { grip: [x_m, y_m], length_m } => RotatingRod::new(*x_m, *y_m, *length_m).map(InteractionModel::Rod),
    };
    made.map_err(|error| format!("interaction: {error}"))
}

/// What all actions being unsafe leaves: the one named stop, else the first that does not move, else the first.
fn stop_of(actions: &[ActionOfCase]) -> usize {
    let named = actions.iter().position(|action| action.name == "stop");
    named.or_else(|| actions.iter().position(|action| action.motion == [0.0; 3])).unwrap_or(0)
}

fn check(case: &Case) -> Result<(), String> {
    let actions = case.actions.len();
    if actions == 0 || actions > ACTIONS_MAX {
        return Err(format!("actions: {actions}, not 1 to {ACTIONS_MAX}"));
    }
    if case.probabilities.len() != actions {
        return Err(format!("probabilities: {}, where there are {actions} actions", case.probabilities.len()));
    }
    if !case.probabilities.iter().all(|p| (0.0..=WEIGHT_MAX).contains(p))
        || case.probabilities.iter().sum::<f64>() <= 0.0
    {
        return Err(format!("probabilities: not all in 0..{WEIGHT_MAX}, with a sum over 0"));
    }
    for (key, value, from) in [
        ("robot_radius_m", case.robot_radius_m, 0.0),
        ("handler_radius_m", case.handler_radius_m, 0.0),
        ("handler_mask_margin_m", case.handler_mask_margin_m.unwrap_or(0.0), -case.handler_radius_m),
        ("unknown_gap_m", case.unknown_gap_m(), 0.0),
    ] {
        if !(from..=PLACE_MAX_M).contains(&value) {
            return Err(format!("{key}: {value} is not in {from}..{PLACE_MAX_M}"));
        }
    }
    if !(0.0..=1.0).contains(&case.beta) {
        return Err(format!("beta: {} is not in 0..1", case.beta));
    }
    let poses = case.actions.iter().map(|action| action.motion).chain([case.robot_from_handler, case.robot_from_lidar]);
    if !poses.flatten().all(|value| value.abs() <= PLACE_MAX_M) {
        return Err(format!("a motion or a pose is not within {PLACE_MAX_M} m or radians"));
    }
    let Scan { range_min_m, range_max_m, .. } = case.scan;
    if !(range_min_m >= 0.0 && range_min_m < range_max_m && range_max_m < NOTHING_M) {
        return Err(format!("scan: range_min_m {range_min_m} and range_max_m {range_max_m} are no range"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::Judge;
    use serde_json::{Value, json};

    fn case() -> Value {
        json!({
            "id": "a", "robot_from_lidar": [0.0, 0.0, 0.0], "robot_from_handler": [-0.75, -0.35, 0.0],
            "scan": {
                "angle_min_rad": -std::f64::consts::PI, "angle_increment_rad": std::f64::consts::TAU / 360.0,
                "range_min_m": 0.1, "range_max_m": 10.0, "ranges_m": vec![5.0; 360],
            },
            "interaction": { "model": "delayed", "alpha": 0.4, "dt_s": 0.5, "offset": [-0.75, -0.35, 0.0] },
            "actions": [
                { "name": "stop", "motion": [0.0, 0.0, 0.0], "dt_s": 0.5 },
                { "name": "forward", "motion": [0.25, 0.0, 0.0], "dt_s": 0.5 },
            ],
            "robot_radius_m": 0.3, "handler_radius_m": 0.25, "handler_mask_margin_m": null,
            "probabilities": [0.2, 0.8], "beta": 0.5,
        })
    }

    fn answer(case: &Value, thresholds: bool) -> Value {
        let text = Judge::default().answer(case.to_string().as_bytes(), thresholds);
        serde_json::from_str(&text).expect("an answer is JSON")
    }

    #[test]
    fn a_thing_ahead_takes_forward_away_by_beta() {
        let mut blocked = case();
        blocked["scan"]["ranges_m"][180] = json!(0.5);
        let answer = answer(&blocked, true);
        assert_eq!(answer["unsafe"], json!([false, true]));
        let p = answer["probabilities"][1].as_f64().expect("a number");
        assert!((p - 0.4 / 0.6).abs() < 1e-12);
        assert!(answer["margins_m"][1].as_f64().is_some_and(|m| (m + 0.05).abs() < 1e-9), "{answer}");
        assert!(answer["thresholds_m"][1][180].as_f64().is_some_and(|t| (t - 0.55).abs() < 1e-9));
        let x = answer["next_handler"][1][0].as_f64().expect("a number");
        assert!((x - (0.25 - 0.75 - 0.4 * 0.25)).abs() < 1e-12, "{x}");
    }

    #[test]
    fn all_unsafe_is_stop_at_beta_zero_and_unchanged_above() {
        let mut blocked = case();
        blocked["scan"]["ranges_m"][180] = json!(0.2);
        let with = |beta: f64| {
            let mut case = blocked.clone();
            case["beta"] = json!(beta);
            answer(&case, false)
        };
        assert_eq!(
            (with(0.0)["all_unsafe"].clone(), with(0.0)["probabilities"].clone()),
            (json!(true), json!([1.0, 0.0]))
        );
        assert_eq!(with(0.5)["probabilities"], json!([0.2, 0.8]));
    }

    #[test]
    fn readings_may_be_words_or_nothing() {
        let mut odd = case();
        odd["scan"]["ranges_m"][0] = json!("inf");
        odd["scan"]["ranges_m"][1] = json!(null);
        assert_eq!(answer(&odd, false)["unsafe"], json!([false, false]));
        for i in 170..190 {
            odd["scan"]["ranges_m"][i] = json!(null);
        }
        assert_eq!(answer(&odd, false)["unsafe"], json!([false, true]), "stop needs nothing beyond the present hull");
    }

    #[test]
    fn a_lidar_that_turns_clockwise_answers_in_its_own_order() {
        let mut clockwise = case();
        clockwise["scan"]["angle_min_rad"] = json!(std::f64::consts::PI - std::f64::consts::TAU / 360.0);
        clockwise["scan"]["angle_increment_rad"] = json!(-std::f64::consts::TAU / 360.0);
        let (left, right) = (answer(&case(), true), answer(&clockwise, true));
        for i in 0..360 {
            let a = left["thresholds_m"][1][i].as_f64().expect("a number");
            let b = right["thresholds_m"][1][359 - i].as_f64().expect("a number");
            assert!((a - b).abs() < 1e-9, "{i}: {a} {b}");
        }
    }

    #[test]
    fn a_malformed_case_is_told_by_its_id() {
        let mut wrong = case();
        wrong["beta"] = json!(7);
        let told = answer(&wrong, false);
        assert_eq!(told["id"], "a");
        assert!(told["error"].as_str().is_some_and(|error| error.contains("beta")), "{told}");
        wrong = case();
        wrong["scan"]["ranges_m"][3] = json!("wall");
        assert!(answer(&wrong, false)["error"].as_str().is_some_and(|error| error.contains("wall")));
        wrong = case();
        wrong["colour"] = json!("red");
        assert!(answer(&wrong, false)["error"].as_str().is_some_and(|error| error.contains("colour")));
        let text = Judge::default().answer(b"{not json", false);
        assert!(text.contains("\"id\":null") && text.contains("error"), "{text}");
    }
}
