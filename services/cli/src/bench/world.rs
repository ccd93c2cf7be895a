//! `bench world`: how many decisions of episodes a second, on all cores: what training and evaluation are made of. And
//! what a decision is made of: beams, pixels, motions judged, places held against their hulls.

use std::sync::Arc;
use std::time::Instant;

use episodes::{Batch, Config, Episode, Noise};
use guidance::{ActionTable, AwarenessConfig, Work};
use serde_json::{Value, json};
use world::{DepthConfig, World};

use crate::exit::Failure;
use crate::out::{self, table};
use crate::workers::progress;

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
    pixels: usize,
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

    /// A depth frame of 128x64.
    fn of_camera(name: &'static str, noise: Noise) -> Result<Self, Failure> {
        let legs = Config::go2().legs;
        Self::new(name, without_memory(Config { noise, legs, frames: 0, ..Config::default() }), None)
    }

    /// A Go2 with all that it has: memory, floor, and the observation that a network sees.
    fn of_go2(name: &'static str, table: ActionTable) -> Result<Self, Failure> {
        Self::with_table(name, Config::go2(), table, None)
    }

    fn new(name: &'static str, config: Config, prototype_per_s: Option<f64>) -> Result<Self, Failure> {
        Self::with_table(name, config, ActionTable::eight(), prototype_per_s)
    }

    fn with_table(
        name: &'static str,
        config: Config,
        table: ActionTable,
        prototype_per_s: Option<f64>,
    ) -> Result<Self, Failure> {
        let config = Config { table, ..config };
        let pixels = config.depth.as_ref().map_or(0, |depth| depth.width * depth.height);
        let mut batch = Batch::new(&Arc::new(config), EPISODES).map_err(Failure::of_input)?;
        batch.begin(1);
        Ok(Self { name, prototype_per_s, pixels, batch, per_s: Vec::new() })
    }

    /// What a decision is made of, on average: beams, pixels, faces of the world, and the shield's work.
    fn per_decision(&self) -> Value {
        let episodes = || self.batch.episodes();
        let sum = |count: &dyn Fn(&Episode) -> u64| episodes().map(count).sum::<u64>() as f64;
        let mean = |count: fn(&Episode) -> u64| sum(&count) / episodes().len() as f64;
        let decided = (EPISODES * DECISIONS * self.per_s.len()) as f64;
        let shield = |count: fn(&Work) -> u64| sum(&|episode| count(&episode.work())) / decided;
        json!({
            "beams": mean(|episode| episode.scan().1.len() as u64),
            "pixels": self.pixels,
            "faces": mean(|episode| faces(&episode.site().world)),
            "motions": shield(|work| work.motions),
            "places": shield(|work| work.places),
            "held": shield(|work| work.held),
        })
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
            "per_decision": self.per_decision(),
        })
    }
}

fn faces(world: &World) -> u64 {
    world.prisms().iter().map(|prism| prism.sides().count() as u64).sum()
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
        Row::of_camera("and a camera of 128x64", Noise::Noisy)?,
        Row::of_camera("and legs", Noise::Legged)?,
        Row::of_go2("a Go2 with memory, eight actions", ActionTable::eight())?,
        Row::of_go2("and the step back", Config::go2().table)?,
    ];
    // The machine's moods are shared by all rows.
    for _ in progress(times.into(), "rounds").wrap_iter(0..times) {
        rows.iter_mut().for_each(Row::measure);
    }
    let rows: Vec<Value> = rows.iter_mut().map(Row::json).collect();
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let report = json!({ "threads": threads, "episodes": EPISODES, "rows": rows });
    out::tell(as_json, &report, || told(&rows, threads))
}

fn told(rows: &[Value], threads: usize) -> Vec<String> {
    let number = |row: &Value, at: &str| format!("{:.0}", out::number(row, at));
    let lines = rows.iter().map(|row| {
        vec![
            out::text(row, "/what").to_owned(),
            number(row, "/decisions_per_s/p50"),
            number(row, "/decisions_per_s/min"),
            number(row, "/decisions_per_s/max"),
            row["ratio"].as_f64().map_or_else(String::new, |ratio| format!("{ratio:.2}")),
        ]
    });
    let heads = ["", "p50", "min", "max", "to the prototype's"];
    let speeds = table(&heads, &lines.collect::<Vec<_>>());
    let what = ["beams", "pixels", "faces", "motions", "places", "held"];
    let lines = rows.iter().map(|row| {
        let counts = what.iter().map(|what| number(row, &format!("/per_decision/{what}")));
        std::iter::once(out::text(row, "/what").to_owned()).chain(counts).collect()
    });
    let heads = ["", "beams", "pixels", "faces", "motions", "places x motions", "near a hull"];
    let counts = table(&heads, &lines.collect::<Vec<_>>());
    let head = format!("{EPISODES} episodes on {threads} threads, decisions a second");
    [vec![head], speeds, vec!["for each decision".to_owned()], counts].concat()
}
