//! Whether the sensors that a configuration names give as much as it says: they are run, each by its own driver, and
//! nobody gives a cue, so that the robot stands.

use std::path::Path;
use std::time::{Duration, Instant};

use control::{Client, Status};
use messages::TopicId;
use settings::{Millis, Settings, Source};

use super::Check;
use crate::exit::Failure;
use crate::find::{free_name, socket};
use crate::launch::{Launch, Running};
use crate::prepare;

/// A device that has not given anything by then is not there.
const BEGUN_WITHIN: Duration = Duration::from_secs(15);
/// A sensor that gives less than this share of what is configured is too slow.
const SHARE_MIN: f64 = 0.8;
/// In less a sensor of a few hertz says little of its rate.
const SPAN_MIN: Duration = Duration::from_secs(2);

/// A sensor's topic, and how often something is to come on it, hertz.
struct Sensor {
    name: &'static str,
    topic: TopicId,
    rate_hz: f64,
}

/// A check for each sensor of the configuration.
///
/// # Errors
/// Where the configuration is wrong, or the run fails.
pub(super) fn checks(config: Option<&Path>, span: Millis) -> Result<Vec<Check>, Failure> {
    let mut settings = prepare::standing(config)?;
    settings.run_record.keep_runs = 0;
    let sensors = sensors(&settings);
    let launch = Launch { settings: &settings, name: free_name("doctor"), speed: None };
    let mut running = launch.spawn()?;
    let span = Duration::from_secs_f64(span.s()).max(SPAN_MIN);
    let looked = look(&mut running, &sensors, span);
    let counts = running.finish(looked)?;
    Ok(sensors.iter().map(|sensor| check(sensor, &counts)).collect())
}

fn sensors(settings: &Settings) -> Vec<Sensor> {
    let there = |source: Source| source != Source::Absent;
    let sensor = |name, topic, rate_hz| Sensor { name, topic, rate_hz };
    let (lidar, depth, odometry) = (&settings.lidar, &settings.depth, &settings.odometry);
    let second = lidar.second.as_ref().filter(|second| there(second.source));
    [
        second.map(|second| sensor("second lidar rate", TopicId::SecondScan, second.rate_hz.get())),
        there(lidar.source).then(|| sensor("lidar rate", TopicId::LidarScan, lidar.rate_hz.get())),
        there(depth.source).then(|| sensor("depth rate", TopicId::DepthFrame, depth.rate_hz.get())),
        there(odometry.source).then(|| sensor("odometry rate", TopicId::Odometry, odometry.rate_hz.get())),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// What had been published before and after, by topic, the time between, and what the run had to say.
struct Counts {
    before: Status,
    after: Status,
    seconds: f64,
}

impl Counts {
    fn rate_hz(&self, topic: TopicId) -> f64 {
        self.after.published(topic).saturating_sub(self.before.published(topic)) as f64 / self.seconds
    }

    /// The last that was noted, such as why a device cannot be opened.
    fn last_note(&self, about: &str) -> Option<String> {
        self.after.notes.iter().rev().map(|note| &note.text).find(|note| note.contains(about)).cloned()
    }
}

/// Waits until every sensor has given something, or does not any more; then counts.
fn look(running: &mut Running, sensors: &[Sensor], span: Duration) -> Result<Counts, Failure> {
    let until = Instant::now() + BEGUN_WITHIN;
    let mut before = Status::default();
    while Instant::now() < until {
        running.sleep(Duration::from_millis(200))?;
        let Ok(mut client) = Client::connect(&socket(running.name())) else { continue };
        let Ok(status) = client.read() else { continue };
        before = status;
        if sensors.iter().all(|sensor| before.published(sensor.topic) > 0) {
            break;
        }
    }
    running.sleep(span)?;
    let mut client = Client::connect(&socket(running.name())).map_err(Failure::of_run)?;
    let after: Status = client.read().map_err(Failure::of_run)?;
    let seconds = (after.now_s - before.now_s).max(f64::EPSILON);
    Ok(Counts { before, after, seconds })
}

fn check(sensor: &Sensor, counts: &Counts) -> Check {
    let rate_hz = counts.rate_hz(sensor.topic);
    let ok = rate_hz >= SHARE_MIN * sensor.rate_hz;
    let mut found = format!("{rate_hz:.1} a second, {:.1} are configured", sensor.rate_hz);
    let service = sensor.name.split_whitespace().next().unwrap_or_default();
    if let Some(note) = counts.last_note(service).filter(|_| !ok) {
        found += &format!(" ({note})");
    }
    let fix = format!("see to its cable and its own settings, or put what it gives into [{service}] rate_hz");
    Check { name: sensor.name, ok, found, fix }
}
