//! The fault matrix as it is checked in: what must come of every fault of every target, within what limit, and why.

use messages::fault::{Device, Fault, Target, streams};
use messages::{ServiceId, TopicId};
use serde::Deserialize;

use crate::exit::Failure;

/// The matrix.
const MATRIX: &str = include_str!("../../../../../config/faults.toml");

/// What must come of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Expect {
    /// Zero comes to the link within the limit, and the robot stands.
    Stop,
    /// The robot may go slower or hold; nothing is run into, and it walks again within the limit after the fault.
    Degrade,
    /// The walk goes on as if nothing were.
    None,
}

impl Expect {
    /// The word, as in the matrix.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Degrade => "degrade",
            Self::None => "none",
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    rule: Vec<Rule>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Rule {
    targets: Vec<String>,
    faults: Vec<String>,
    expect: Expect,
    limit_ms: Option<f64>,
    #[serde(default)]
    stays: bool,
    why: String,
}

/// One cell of the matrix.
#[derive(Debug, Clone)]
pub struct Cell {
    /// What the fault is done to.
    pub target: Target,
    /// Which fault.
    pub fault: Fault,
    /// What must come of it.
    pub expect: Expect,
    /// For a stop: from the fault to zero at the link; else from its end to the robot walking, milliseconds.
    pub limit_ms: f64,
    /// After its end the robot stands on, until it sees that what it was told is not so.
    pub stays: bool,
    /// Why that, and why that limit.
    pub why: String,
}

/// Without a limit of its own, a robot that was not stopped walks again within this, milliseconds: a cue, a decision
/// and the longest pause of a restart lie in it.
const WALKS_AGAIN_MS: f64 = 5000.0;

/// The services of a simulated walk that are restarted, that of a second lidar among them: the end of the supervisor or
/// of the world ends the run.
pub const RESTARTED: [ServiceId; 9] = [
    ServiceId::Locomotion,
    ServiceId::Brake,
    ServiceId::Odometry,
    ServiceId::Lidar,
    ServiceId::SecondLidar,
    ServiceId::Depth,
    ServiceId::Cue,
    ServiceId::Policy,
    ServiceId::Shield,
];

/// The services that speak to a robot on DDS.
pub const ON_DDS: [ServiceId; 2] = [ServiceId::Bridge, ServiceId::Backstop];

/// The services of a simulated walk that is recorded.
fn services() -> impl Iterator<Item = ServiceId> {
    RESTARTED.into_iter().chain(ON_DDS).chain([ServiceId::Supervisor, ServiceId::Simulator, ServiceId::Recorder])
}

/// Everything that a fault can be done to in a simulated walk, with that fault. A supervisor starts only once, and
/// motion depends on no beat of it or of the world.
fn all() -> impl Iterator<Item = (Target, Fault)> {
    let streams = streams().map(|topic| Target::Stream(topic, ServiceId::None));
    let told = RESTARTED.into_iter().chain(ON_DDS);
    let health = told.map(|of| Target::Stream(TopicId::Health, of));
    let services = services().map(Target::Service);
    let cells = |target: Target| target.faults().iter().map(move |fault| (target, *fault));
    let lines = Device::ALL.into_iter().map(Target::Line);
    let cells = services.chain(streams).chain(health).chain(lines).chain([Target::Host]).flat_map(cells);
    cells.filter(|cell| *cell != (Target::Service(ServiceId::Supervisor), Fault::ExitOnStart))
}

impl Rule {
    fn is_of(&self, target: Target, fault: Fault) -> bool {
        let target = target.to_string();
        self.targets.iter().any(|pattern| matches(pattern, &target))
            && self.faults.iter().any(|pattern| matches(pattern, fault.name()))
    }
}

/// Whether a name is one that a pattern means, in which `*` stands for anything.
fn matches(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((head, rest)) => name.strip_prefix(head).is_some_and(|tail| {
            tail.char_indices().map(|(i, _)| i).chain([tail.len()]).any(|i| matches(rest, &tail[i..]))
        }),
    }
}

/// The cells of the matrix, each of which exactly one rule must name.
///
/// # Errors
/// Where the matrix cannot be read or has a hole.
fn matrix(text: &str) -> Result<Vec<Cell>, Failure> {
    let wrong = |why: String| Failure::input(format!("config/faults.toml: {why}"));
    let file: File = toml::from_str(text).map_err(|error| wrong(error.to_string()))?;
    let cell = |(target, fault): (Target, Fault)| {
        let rules: Vec<&Rule> = file.rule.iter().filter(|rule| rule.is_of(target, fault)).collect();
        let [rule] = rules[..] else {
            return Err(wrong(format!("{} rules for {target}:{}", rules.len(), fault.name())));
        };
        let limit_ms = match (rule.expect, rule.limit_ms) {
            (_, Some(limit_ms)) => limit_ms,
            (Expect::Stop, None) => return Err(wrong(format!("{target}:{} has no limit_ms", fault.name()))),
            (_, None) => WALKS_AGAIN_MS,
        };
        if rule.stays && rule.expect != Expect::Stop {
            return Err(wrong(format!("{target}:{} stays, and expects no stop", fault.name())));
        }
        Ok(Cell { target, fault, expect: rule.expect, limit_ms, stays: rule.stays, why: rule.why.clone() })
    };
    all().map(cell).collect()
}

/// The cells that a list of patterns means, such as `*:kill,lidar/scan:*`; a pattern without a colon is of targets.
/// Those of the host are meant only where one says so: they need a machine that is set up for them.
///
/// # Errors
/// Where the matrix cannot be read or nothing is meant.
pub fn cells(patterns: Option<&str>) -> Result<Vec<Cell>, Failure> {
    let mut cells = matrix(MATRIX)?;
    let Some(patterns) = patterns else {
        cells.retain(|cell| cell.target != Target::Host);
        return Ok(cells);
    };
    let is_meant = |cell: &Cell| {
        patterns.split(',').map(str::trim).any(|pattern| {
            let (target, fault) = pattern.split_once(':').unwrap_or((pattern, "*"));
            let host = cell.target != Target::Host || target == "host";
            host && matches(target, &cell.target.to_string()) && matches(&fault.replace('-', "_"), cell.fault.name())
        })
    };
    cells.retain(is_meant);
    if cells.is_empty() {
        return Err(Failure::input(format!("no cell of the matrix is {patterns}")));
    }
    Ok(cells)
}

#[cfg(test)]
mod tests {
    use super::{MATRIX, cells, matches, matrix};

    #[test]
    fn every_cell_of_the_matrix_has_exactly_one_rule_and_a_reason() {
        let all = matrix(MATRIX).expect("the shipped matrix is whole");
        assert!(all.len() > 190, "{}", all.len());
        for cell in all {
            assert!(cell.why.len() > 10 && cell.limit_ms > 0.0, "{cell:?}");
        }
        let stays = MATRIX.replacen("expect = \"none\"", "expect = \"none\"\nstays = true", 1);
        assert!(matrix(&stays).expect_err("it may not stand").message.contains("expects no stop"));
        assert!(matrix("rule = []").expect_err("it has holes").message.contains("0 rules for locomotion:kill"));
    }

    #[test]
    fn patterns_mean_cells() {
        assert!(matches("health/*", "health/lidar") && matches("*", "") && matches("a*c", "abbc"));
        assert!(!matches("health/*", "lidar/scan") && !matches("a*c", "abbd"));
        assert_eq!(cells(Some("*:kill")).expect("there are some").len(), 14);
        assert_eq!(cells(Some("lidar/scan:off, policy:exit-on-start")).expect("there are some").len(), 2);
        assert!(cells(Some("lidar/scan:kill")).is_err());
        assert!(cells(None).expect("the matrix is whole").iter().all(|cell| cell.target.to_string() != "host"));
    }
}
