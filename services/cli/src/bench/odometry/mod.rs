//! `bench odometry`: a log's raw odometry beside the same corrected by its scans, as the odometry service does it.

mod consistency;
mod relations;

use std::path::{Path, PathBuf};
use std::time::Instant;

use guidance::Beams;
use guidance::se2::{Se2, se2};
use matching::{Corrected, CorrectedConfig, Health};
use messages::{Odometry, Pose2, ScanHeader};
use recording::{Record, carmen};
use serde_json::{Value, json};
use settings::MatchingSettings;

use self::consistency::Consistency;
use self::relations::{Compared, Judged, Relation};
use super::Percentiles;
use crate::exit::{Failure, chain};
use crate::out::{self, table};

/// Which odometry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Which {
    /// The robot's own.
    Raw,
    /// Corrected by the scan itself: what the matcher says of its place.
    Ours,
    /// As it goes out at the scan's stamp: before the scan is matched, and with corrections fed in slowly.
    Published,
}

impl Which {
    /// All, in the order of their numbers.
    const ALL: [Self; 3] = [Self::Raw, Self::Ours, Self::Published];

    fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Ours => "ours",
            Self::Published => "published",
        }
    }
}

/// Where the robot was at a scan.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// When the scan was sent, seconds of the log's own clock.
    pub sent_s: f64,
    odom_from_robot: [Se2; 3],
}

impl Place {
    fn pose(&self, which: Which) -> &Se2 {
        &self.odom_from_robot[which as usize]
    }
}

/// Plays a log into the corrector.
struct Play {
    corrected: Corrected,
    places: Vec<Place>,
    consistency: Consistency,
    beams: Beams,
    /// The scan whose pose has not come yet.
    scan: Option<(ScanHeader, Vec<f32>, f64)>,
    count: u64,
    raw_way_m: f64,
    last_raw: Option<Pose2>,
    match_ns: Vec<u64>,
}

impl Play {
    fn of(log: &Path, config: CorrectedConfig) -> Result<Self, Failure> {
        let mut play = Self {
            corrected: Corrected::new(config),
            places: Vec::new(),
            consistency: Consistency::default(),
            beams: Beams::default(),
            scan: None,
            count: 0,
            raw_way_m: 0.0,
            last_raw: None,
            match_ns: Vec::new(),
        };
        carmen::read(log, |record, sent_s| match record {
            Record::LidarScan(scan) => play.take_scan(scan.header, scan.data, sent_s.unwrap_or_default()),
            Record::Odometry(odometry) => play.take_odometry(&odometry),
            _ => {}
        })
        .map_err(|error| Failure::input(chain(&error)))?;
        Ok(play)
    }

    fn take_scan(&mut self, header: ScanHeader, ranges_m: Vec<f32>, sent_s: f64) {
        self.corrected.take_scan(&header, &ranges_m);
        self.scan = Some((header, ranges_m, sent_s));
        self.count += 1;
    }

    fn take_odometry(&mut self, raw: &Odometry) {
        // As in the service: the pose is out before its scan is matched.
        let published = self.corrected.take_odometry(raw);
        let begun = Instant::now();
        let before = self.corrected.health().accepted + self.corrected.health().refused;
        // What was refused, and why, stands in the health.
        let _ = self.corrected.work();
        if self.corrected.health().accepted + self.corrected.health().refused > before {
            self.match_ns.push(u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX));
        }
        let pose = raw.odom_from_robot;
        let last = self.last_raw.replace(pose).unwrap_or(pose);
        self.raw_way_m += (pose.x_m - last.x_m).hypot(pose.y_m - last.y_m);
        let Some((header, ranges_m, sent_s)) =
            self.scan.take_if(|(header, ..)| header.header.stamp_ns == raw.header.stamp_ns)
        else {
            return;
        };
        let odom_from_robot = [se2(pose), *self.corrected.matched(), se2(published.odom_from_robot)];
        self.places.push(Place { sent_s, odom_from_robot });
        if self.beams.fill(&header, &ranges_m).is_ok() {
            self.consistency.take(&self.beams, odom_from_robot);
        }
    }
}

/// What became of one log.
struct Row {
    log: PathBuf,
    scans: u64,
    way_m: f64,
    health: Health,
    matching: Option<Percentiles>,
    judged: Option<Judged>,
    crispness: [Option<consistency::Crispness>; 3],
}

impl Row {
    fn of(log: &Path, relations: Option<&[Relation]>, config: CorrectedConfig) -> Result<Self, Failure> {
        let mut play = Play::of(log, config)?;
        let other = || Failure::input(format!("most of the relations are of no scans of {}", log.display()));
        let judged = relations.map(|relations| relations::judge(relations, &play.places).ok_or_else(other));
        Ok(Self {
            log: log.to_owned(),
            scans: play.count,
            way_m: play.raw_way_m,
            health: play.corrected.health().clone(),
            matching: Percentiles::of(play.match_ns),
            judged: judged.transpose()?,
            crispness: Which::ALL.map(|which| play.consistency.of(which)),
        })
    }

    fn json(&self) -> Value {
        let [raw, ours, published] = &self.crispness;
        let matching = self.matching.as_ref();
        json!({
            "log": self.log,
            "scans": self.scans,
            "way_m": self.way_m,
            "accepted": self.health.accepted,
            "refused": self.health.refused,
            "restarts": self.health.restarts,
            "last_refusal": self.health.last_refusal.as_ref().map(ToString::to_string),
            "match_us": matching.map(|us| json!({ "n": us.n, "p50": us.p50_us, "p99": us.p99_us, "max": us.max_us })),
            "relations": self.judged,
            "walls": { "raw": raw, "ours": ours, "published": published },
        })
    }

    fn told(&self) -> Vec<String> {
        let Health { accepted, refused, restarts, .. } = self.health;
        let (p50_us, p99_us) = self.matching.as_ref().map_or((0.0, 0.0), |us| (us.p50_us, us.p99_us));
        let mut told = vec![
            format!("{}: {} scans, {:.0} m", self.log.display(), self.scans, self.way_m),
            format!(
                "  {accepted} matched in {p50_us:.0} us (p50) and {p99_us:.0} us (p99), {refused} refused, {restarts} \
                 new beginnings",
            ),
        ];
        let mut rows = Vec::new();
        if let Some(judged) = &self.judged {
            rows.extend(lines("relations", &judged.all));
            let near = format!("of up to {:.0} s", relations::NEAR_S);
            rows.extend(judged.near.iter().flat_map(|compared| lines(&near, compared)));
            told.push(format!("  {} relations are of no two scans of this log", judged.unmatched));
        }
        if !rows.is_empty() {
            let heads = ["", "n", "mean", "deviation", "median", "p95", "rms", "mean square"];
            told.extend(table(&heads, &rows).iter().map(|line| format!("  {line}")));
        }
        for (which, crispness) in Which::ALL.iter().zip(&self.crispness) {
            let Some(walls) = crispness else { continue };
            told.push(format!(
                "  walls seen 5 to 20 m before, {}: off by {:.3} m (mean), {:.3} m (median), {} = {:.1} % of hits",
                which.name(),
                walls.mean_m,
                walls.median_m,
                walls.n,
                100.0 * walls.share
            ));
        }
        told
    }
}

fn lines(name: &str, compared: &Compared) -> Vec<Vec<String>> {
    let all = [(Which::Raw, &compared.raw), (Which::Ours, &compared.ours), (Which::Published, &compared.published)];
    let cells = all.into_iter().flat_map(|(which, errors)| {
        [(which.name(), "m", &errors.translation_m), (which.name(), "degrees", &errors.rotation_deg)]
    });
    let line = |(which, unit, spread): (&str, &str, &relations::Spread)| {
        let mut line = vec![format!("{name}, {which}, {unit}"), compared.n.to_string()];
        let numbers = [spread.mean, spread.deviation, spread.median, spread.p95, spread.rms, spread.mean_square];
        line.extend(numbers.map(|number| format!("{number:.4}")));
        line
    };
    cells.map(line).collect()
}

/// `guidedog bench odometry`.
///
/// # Errors
/// Where a log or the relations cannot be read or do not belong together, or the report cannot be written.
pub fn bench(logs: &[PathBuf], relations: Option<&Path>, as_json: bool) -> Result<(), Failure> {
    let relations = relations.map(relations::read).transpose()?;
    // As it is by default; there is no handler beside these robots.
    let config = MatchingSettings::default().config(Vec::new());
    let mut rows = Vec::new();
    for log in logs {
        let row = Row::of(log, relations.as_deref(), config.clone())?;
        if !as_json {
            out::report(row.told())?;
        }
        rows.push(row.json());
    }
    if as_json { out::json(&json!({ "logs": rows })) } else { Ok(()) }
}
