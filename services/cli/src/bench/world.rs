//! `bench world`: how many decisions of episodes a second, on all cores: what training and evaluation are made of.

use std::sync::Arc;
use std::time::Instant;

use episodes::{Batch, Config, Noise};
use guidance::{ActionTable, AwarenessConfig};
use serde_json::{Value, json};
use world::DepthConfig;

use crate::exit::Failure;
use crate::out::{self, say, table};

/// Episodes side by side, and decisions of each in one measurement: all parts of an episode, and beginning the next.
const EPISODES: usize = 64;
const DECISIONS: usize = 200;
/// What a prototype of the same task reached on two such cores, decisions a second: sensors alone, with the shield, and
/// with noise as well.
const PROTOTYPE: [f64; 3] = [293_000.0, 117_000.0, 38_000.0];

/// One row: what is simulated at each decision.
struct Row {
    name: &'static str,
    /// None where the prototype did no such thing.
    prototype_per_s: Option<f64>,
    batch: Batch,
    per_s: Vec<f64>,
}

/// One scan and one frame decide alone.
fn without_memory(config: Config) -> Config {
    let awareness = AwarenessConfig { memory: None, ..config.awareness };
    Config { awareness, ..config }
}

impl Row {
    /// As the prototype had it: a lidar of 360 beams, a depth frame of 64x32, one scan and one frame judged alone.
    fn of_prototype(name: &'static str, noise: Noise, judges: bool, prototype_per_s: f64) -> Result<Self, Failure> {
        let config = without_memory(Config { noise, judges, frames: 0, ..Config::default() });
        let depth = config.depth.clone().map(|depth| DepthConfig { width: 64, height: 32, ..depth });
        Self::new(name, Config { depth, ..config }, Some(prototype_per_s))
    }

    /// As training and evaluation have it, but for the memory: a depth frame of 128x64.
    fn of_episodes(name: &'static str, noise: Noise) -> Result<Self, Failure> {
        let legs = Config::go2().legs;
        Self::new(name, without_memory(Config { noise, legs, frames: 0, ..Config::default() }), None)
    }

    fn new(name: &'static str, config: Config, prototype_per_s: Option<f64>) -> Result<Self, Failure> {
        let config = Config { table: ActionTable::eight(), ..config };
        let mut batch = Batch::new(&Arc::new(config), EPISODES).map_err(Failure::of_input)?;
        batch.begin(1);
        Ok(Self { name, prototype_per_s, batch, per_s: Vec::new() })
    }

    /// Walks on, mostly ahead, as a policy would.
    fn measure(&mut self) {
        let begun = Instant::now();
        for decision in 0..DECISIONS {
            let action = |place: usize| [1, 1, 1, 2, 1, 1, 3, 1, 6, 7][(decision + 3 * place) % 10];
            let actions: Vec<usize> = (0..EPISODES).map(action).collect();
            self.batch.step(&actions);
        }
        self.per_s.push((EPISODES * DECISIONS) as f64 / begun.elapsed().as_secs_f64());
    }

    fn json(&mut self) -> Value {
        self.per_s.sort_by(f64::total_cmp);
        let median = self.per_s[self.per_s.len() / 2];
        let (min, max) = (self.per_s.first(), self.per_s.last());
        json!({
            "what": self.name,
            "decisions_per_s": { "p50": median, "min": min, "max": max, "n": self.per_s.len() },
            "prototype_per_s": self.prototype_per_s,
            "ratio": self.prototype_per_s.map(|prototype_per_s| median / prototype_per_s),
        })
    }
}

/// `guidedog bench world`.
///
/// # Errors
/// Where the report cannot be written.
pub fn bench(times: u32, as_json: bool) -> Result<(), Failure> {
    let mut rows = [
        Row::of_prototype("lidar, depth, motion", Noise::Ideal, false, PROTOTYPE[0])?,
        Row::of_prototype("and the shield, eight actions", Noise::Ideal, true, PROTOTYPE[1])?,
        Row::of_prototype("and noise", Noise::Noisy, true, PROTOTYPE[2])?,
        Row::of_episodes("and a camera of 128x64", Noise::Noisy)?,
        Row::of_episodes("and legs", Noise::Legged)?,
    ];
    // The machine's moods are shared by all rows.
    for _ in 0..times {
        rows.iter_mut().for_each(Row::measure);
    }
    let rows: Vec<Value> = rows.iter_mut().map(Row::json).collect();
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    if as_json {
        return out::json(&json!({ "threads": threads, "episodes": EPISODES, "rows": rows }));
    }
    let lines = rows.iter().map(|row| {
        let number = |at: &str| format!("{:.0}", out::number(row, at));
        vec![
            out::text(row, "/what").to_owned(),
            number("/decisions_per_s/p50"),
            number("/decisions_per_s/min"),
            number("/decisions_per_s/max"),
            row["ratio"].as_f64().map_or_else(String::new, |ratio| format!("{ratio:.2}")),
        ]
    });
    say(format!("{EPISODES} episodes on {threads} threads, decisions a second"));
    let heads = ["", "p50", "min", "max", "to the prototype's"];
    table(&heads, &lines.collect::<Vec<_>>()).iter().for_each(say);
    Ok(())
}
