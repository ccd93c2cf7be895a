//! `guidedog shield --recording`: how often the shield would have been in the way of a robot that came to no harm.
//!
//! Two questions. *Moves*: every motion that the recorded robot really made over a decision period is judged by the
//! scan from which it began, with the robot's own disc and no handler. It collided with nothing, so each move that is
//! flagged is a false alarm. *Team*: with a handler at the default offset, in how many scans is every action unsafe,
//! and in how many every one that moves?

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

use guidance::se2::{Point, Se2};
use guidance::{
    ActionTable, Beams, EdgeDistance, Evidence, HandlerBody, Interaction, Judgement, Memory, Motion, PoseTrack, Reach,
    Shield, ShieldConfig,
};
use messages::{Odometry, ScanHeader};
use recording::{Reader, Record};
use serde::Serialize;
use serde_json::json;
use settings::{Profile, Settings};

use crate::exit::Failure;
use crate::out::{self, table};
use crate::prepare;

/// A motion that is less than either is none, metres and radians.
const MOVED: (f64, f64) = (0.01, 0.02);
/// Robots for which the moves are judged besides the configured one, metres.
const RADII_M: [f64; 5] = [0.15, 0.20, 0.25, 0.30, 0.35];

/// What makes it the paper's algorithm, or ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
struct Rules {
    escape: bool,
    memory: bool,
}

const RULES: [Rules; 4] = [
    Rules { escape: false, memory: false },
    Rules { escape: false, memory: true },
    Rules { escape: true, memory: false },
    Rules { escape: true, memory: true },
];

/// Moves judged with one radius.
#[derive(Debug, Default, Serialize)]
struct Moves {
    robot_radius_m: f64,
    judged: u64,
    flagged: u64,
    share_flagged: f64,
    /// Of these, flagged before the robot moves at all: a disc of that size does not fit where it stands.
    flagged_standing: u64,
    /// By cause.
    by_cause: BTreeMap<String, u64>,
    /// How deep the deepest point of a flagged move lies in the hull, in the middle of all, metres.
    median_depth_m: f64,
    #[serde(skip)]
    depths_m: Vec<f64>,
}

/// Scans judged with a handler.
#[derive(Debug, Serialize)]
struct Team {
    rules: Rules,
    scans: u64,
    all_unsafe: u64,
    share_all_unsafe: f64,
    no_motion: u64,
    share_no_motion: f64,
}

/// Tells of a recording.
///
/// # Errors
/// Where the recording or the configuration is wrong.
pub fn tell(recording: &Path, config: Option<&Path>, as_json: bool) -> Result<(), Failure> {
    let settings = prepare::load(Profile::Carmen, config)?;
    let mut study = Study::new(&settings)?;
    for record in Reader::open(recording).map_err(Failure::of_input)? {
        match record.map_err(Failure::of_input)? {
            Record::LidarScan(scan) => study.take_scan(scan.header, scan.data),
            Record::Odometry(odometry) => study.take_odometry(&odometry),
            // The question is about the lidar.
            _ => {}
        }
    }
    study.finish();
    if as_json {
        return out::json(&json!({
            "recording": recording.display().to_string(),
            "scans": study.scans,
            "unusable": study.unusable,
            "horizon_s": study.horizon_ns as f64 / 1e9,
            "moves": study.moves,
            "standing": study.standing,
            "without_pose": study.without_pose,
            "team": study.team,
        }));
    }
    out::report(study.lines())
}

struct Study {
    table: ActionTable,
    robot_radius_m: f64,
    margin_m: f64,
    unknown_gap_m: f64,
    handler: Se2,
    handler_radius_m: f64,
    after: Vec<Motion>,
    horizon_ns: u64,
    track: PoseTrack,
    newest_pose_ns: u64,
    has_poses: bool,
    waiting: VecDeque<(ScanHeader, Vec<f32>)>,
    incarnation: Option<u32>,
    memory: Memory,
    beams: Beams,
    judgements: Vec<Judgement>,
    scans: u64,
    unusable: u64,
    standing: u64,
    without_pose: u64,
    moves: Vec<Moves>,
    team: Vec<Team>,
}

impl Study {
    fn new(settings: &Settings) -> Result<Self, Failure> {
        let model = settings.interaction().map_err(Failure::of_input)?;
        let table = settings.policy.actions.table();
        let handler = model.robot_from_default();
        let motion = |end: Se2| Motion::new(end, end * model.step(&handler, &end));
        let radius_m = settings.robot.radius_m.get();
        let mut radii_m: Vec<f64> = RADII_M.to_vec();
        if !radii_m.contains(&radius_m) {
            radii_m.push(radius_m);
            radii_m.sort_by(f64::total_cmp);
        }
        Ok(Self {
            robot_radius_m: radius_m,
            margin_m: settings.shield.margin_m,
            unknown_gap_m: settings.shield.unknown_gap_m.get(),
            handler,
            handler_radius_m: settings.handler.radius_m.get(),
            after: table.actions().iter().map(|action| motion(action.start_from_end())).collect(),
            table,
            horizon_ns: settings.policy.dt.ns(),
            track: PoseTrack::default(),
            newest_pose_ns: 0,
            has_poses: false,
            waiting: VecDeque::new(),
            incarnation: None,
            memory: Memory::new(settings.shield.memory.config(None)),
            beams: Beams::default(),
            judgements: Vec::new(),
            scans: 0,
            unusable: 0,
            standing: 0,
            without_pose: 0,
            moves: radii_m.into_iter().map(|robot_radius_m| Moves { robot_radius_m, ..Moves::default() }).collect(),
            team: RULES.into_iter().map(Team::new).collect(),
        })
    }

    fn take_odometry(&mut self, odometry: &Odometry) {
        self.track.push(odometry);
        self.newest_pose_ns = odometry.header.stamp_ns;
        self.has_poses = true;
        while let Some((header, ranges_m)) = self.waiting.front()
            && header.header.stamp_ns + self.horizon_ns <= self.newest_pose_ns
        {
            let (header, ranges_m) = (*header, ranges_m.clone());
            self.waiting.pop_front();
            self.judge(&header, &ranges_m);
        }
    }

    /// A scan waits until it is known where the robot went from there.
    fn take_scan(&mut self, header: ScanHeader, ranges_m: Vec<f32>) {
        self.waiting.push_back((header, ranges_m));
    }

    fn finish(&mut self) {
        while let Some((header, ranges_m)) = self.waiting.pop_front() {
            self.judge(&header, &ranges_m);
        }
        for moves in &mut self.moves {
            moves.share_flagged = share(moves.flagged, moves.judged);
            moves.depths_m.sort_by(f64::total_cmp);
            moves.median_depth_m = moves.depths_m.get(moves.depths_m.len() / 2).copied().unwrap_or(0.0);
        }
        for team in &mut self.team {
            team.share_all_unsafe = share(team.all_unsafe, team.scans);
            team.share_no_motion = share(team.no_motion, team.scans);
        }
    }

    fn judge(&mut self, header: &ScanHeader, ranges_m: &[f32]) {
        self.scans += 1;
        if self.beams.fill(header, ranges_m).is_err() {
            self.unusable += 1;
            return;
        }
        let stamp_ns = header.header.stamp_ns;
        // Without odometry the robot stands, until the lidar is another one.
        let there = if self.has_poses { self.track.at(stamp_ns) } else { Some(Se2::identity()) };
        if self.incarnation.replace(header.header.incarnation).is_some_and(|old| old != header.header.incarnation) {
            self.memory.clear();
        }
        let Some(there) = there else {
            self.without_pose += 1;
            return;
        };
        let handler = self.body();
        self.memory.update(stamp_ns, &there, &self.beams, None, &handler);
        self.judge_team(handler);
        let end_ns = stamp_ns + self.horizon_ns;
        let end = self.track.at(end_ns).filter(|_| self.has_poses && end_ns <= self.newest_pose_ns);
        match end.map(|end| there.inverse() * end) {
            Some(moved) if moved.translation.vector.norm() >= MOVED.0 || moved.rotation.angle().abs() >= MOVED.1 => {
                self.judge_move(&moved);
            }
            Some(_) => self.standing += 1,
            None => self.without_pose += 1,
        }
    }

    fn body(&self) -> HandlerBody {
        HandlerBody {
            center: Point::from(self.handler.translation.vector),
            radius_m: self.handler_radius_m,
            mask_radius_m: Some(self.handler_radius_m + 3.0 * self.beams.sigma_m()),
            seen: None,
        }
    }

    fn shield(&self, robot_radius_m: f64, rules: Rules) -> Shield {
        Shield::new(ShieldConfig {
            robot_radius_m,
            margin_m: self.margin_m,
            unknown_gap_m: self.unknown_gap_m,
            escape: rules.escape,
            unseen_limit_m2: None,
            back_from_edges_m: None,
            reach: Reach::default(),
            edges: EdgeDistance::default(),
        })
    }

    fn judge_team(&mut self, handler: HandlerBody) {
        for (i, rules) in RULES.into_iter().enumerate() {
            let mut shield = self.shield(self.robot_radius_m, rules);
            let evidence =
                Evidence { memory: Some(&self.memory).filter(|_| rules.memory), ..Evidence::scan(&self.beams) };
            shield.judge_motions(self.after.iter().cloned(), evidence, handler, &mut self.judgements);
            let free = |i: usize| self.judgements[i].safe;
            let moving = (0..self.table.len()).filter(|i| *i != ActionTable::STOP).any(free);
            let team = &mut self.team[i];
            team.scans += 1;
            team.no_motion += u64::from(!moving);
            team.all_unsafe += u64::from(!moving && !free(ActionTable::STOP));
        }
    }

    /// The paper's algorithm, for a robot alone: its hull is that of its own disc, here and there.
    fn judge_move(&mut self, moved: &Se2) {
        for i in 0..self.moves.len() {
            let radius_m = self.moves[i].robot_radius_m;
            let mut shield = self.shield(radius_m, RULES[0]);
            let alone = HandlerBody { center: Point::origin(), radius_m, mask_radius_m: None, seen: None };
            let motions = [*moved, Se2::identity()].map(|end| Motion::new(end, end));
            let evidence = Evidence::scan(&self.beams);
            shield.judge_motions(motions.into_iter(), evidence, alone, &mut self.judgements);
            let (judgement, moves) = (self.judgements[0], &mut self.moves[i]);
            moves.judged += 1;
            if !judgement.safe {
                moves.flagged += 1;
                moves.flagged_standing += u64::from(!self.judgements[1].safe);
                let cause = format!("{:?}", judgement.cause).to_lowercase();
                *moves.by_cause.entry(cause).or_default() += 1;
                moves.depths_m.push((-judgement.margin_m).max(0.0));
            }
        }
    }

    fn lines(&self) -> Vec<String> {
        let percent = |share: f64| format!("{:>8.2} %", 100.0 * share);
        let mut lines = vec![format!(
            "{} scans ({} unusable); moves over {} s: {} judged, {} times it stood, {} times nobody knows where it was",
            self.scans,
            self.unusable,
            self.horizon_ns as f64 / 1e9,
            self.moves.first().map_or(0, |moves| moves.judged),
            self.standing,
            self.without_pose
        )];
        let rows: Vec<Vec<String>> = self
            .moves
            .iter()
            .map(|moves| {
                let causes: Vec<String> = moves.by_cause.iter().map(|(cause, n)| format!("{cause} {n}")).collect();
                let depth = format!("{:>7.0} mm", 1000.0 * moves.median_depth_m);
                let standing = percent(share(moves.flagged_standing, moves.judged));
                let radius = format!("{:.2} m", moves.robot_radius_m);
                vec![radius, percent(moves.share_flagged), standing, depth, causes.join(", ")]
            })
            .collect();
        if self.moves.first().is_some_and(|moves| moves.judged > 0) {
            lines.push(
                "the robot's own moves, which hit nothing: how many are flagged, how many of all where it".to_owned(),
            );
            lines.push("only stands, and how deep".to_owned());
            lines.extend(table(&["radius", "   flagged", "  standing", "    median", "by cause"], &rows));
        }
        let rows: Vec<Vec<String>> = self
            .team
            .iter()
            .map(|team| {
                let on = |on: bool| if on { "on" } else { "off" }.to_owned();
                let (escape, memory) = (on(team.rules.escape), on(team.rules.memory));
                vec![escape, memory, percent(team.share_all_unsafe), percent(team.share_no_motion)]
            })
            .collect();
        lines.push(
            "with a handler at the default offset: in how many scans nothing is safe, and nothing that moves"
                .to_owned(),
        );
        lines.extend(table(&["escape", "memory", "all unsafe", " no motion"], &rows));
        lines
    }
}

impl Team {
    fn new(rules: Rules) -> Self {
        Self { rules, scans: 0, all_unsafe: 0, share_all_unsafe: 0.0, no_motion: 0, share_no_motion: 0.0 }
    }
}

fn share(part: u64, of: u64) -> f64 {
    if of == 0 { 0.0 } else { part as f64 / of as f64 }
}
