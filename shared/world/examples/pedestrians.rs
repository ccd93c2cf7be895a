//! Holds the social force model against recorded tracks, and prints the table of docs/people.md:
//!
//! ```text
//! cargo run --release -p guidedog-world --example pedestrians -- FOLDER [fit]
//! ```
//!
//! `FOLDER` has `hotel.csv.xz`, `eth.csv.xz` and `zara01.csv.xz`. With `fit`, the parameters are fitted to hotel.

use std::error::Error;
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use guidedog_world::people::social::SocialForce;
use guidedog_world::recorded::{Again, Figures, Pairs, Recording};
use guidedog_world::tracks;
use lzma_rust2::XzReader;

/// Recordings, and their frames a second.
const RECORDINGS: [(&str, f64); 3] = [("hotel", 15.0), ("eth", 15.0), ("zara01", 25.0)];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(arguments.first().ok_or("usage: pedestrians FOLDER [fit]")?);
    let recordings: Vec<_> = RECORDINGS.iter().map(|(name, hz)| read(folder, name, *hz)).collect::<Result<_, _>>()?;
    let mut out = std::io::stdout().lock();
    let mut laws = vec![("published", SocialForce::PUBLISHED), ("default", SocialForce::default())];
    if arguments.get(1).is_some_and(|word| word == "fit") {
        let fitted = fit(&recordings[0]);
        writeln!(out, "{fitted:#?}")?;
        laws.push(("fitted now", fitted));
    }
    writeln!(out, "{HEAD}")?;
    for ((name, _), recording) in RECORDINGS.iter().zip(&recordings) {
        writeln!(out, "{}", row(name, "recorded", &recording.walk(Again::Recorded)))?;
        writeln!(out, "{}", row(name, "straight line", &recording.walk(Again::Straight)))?;
        for (law_name, law) in &laws {
            writeln!(out, "{}", row(name, law_name, &recording.walk(Again::Social(law))))?;
        }
        let alone = SocialForce { gaze_per_s: 0.0, attraction_mps2: 0.0, apart_mps2: 0.0, ..SocialForce::default() };
        writeln!(out, "{}", row(name, "default, no groups", &recording.walk(Again::Social(&alone))))?;
    }
    Ok(())
}

const HEAD: &str = "\
| place | walks again | n | displacement m | speed m/s | strangers n | least m | error m | nearer | under 0.5 m | \
companions n | least m | error m | nearer | under 0.5 m |
|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|";

fn row(place: &str, how: &str, figures: &Figures) -> String {
    let pairs = |pairs: &Pairs| {
        let Pairs { count, least_m, error_m, nearer, touching } = pairs;
        format!("{count} | {least_m:.2} | {error_m:.3} | {nearer:.3} | {touching:.3}")
    };
    let Figures { pedestrians, displacement_m, speed_mps, strangers, companions } = figures;
    let (strangers, companions) = (pairs(strangers), pairs(companions));
    format!("| {place} | {how} | {pedestrians} | {displacement_m:.3} | {speed_mps:.2} | {strangers} | {companions} |")
}

fn read(folder: &Path, name: &str, frames_hz: f64) -> Result<Recording, Box<dyn Error>> {
    let path = folder.join(format!("{name}.csv.xz"));
    let file = File::open(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut text = String::new();
    XzReader::new(file, true).read_to_string(&mut text)?;
    Ok(Recording::new(tracks::read(&path.display().to_string(), &text)?, frames_hz))
}

/// The parameters that matter between people, by coordinate descent from the published ones: what is nearest to the
/// recording in displacement, in least distances and in the share of strangers who nearly touch, each as a share of the
/// straight line's. What holds a group together keeps an eighth of its strength: on straight ways it costs displacement
/// alone.
fn fit(recording: &Recording) -> SocialForce {
    let parameters: [fn(&mut SocialForce) -> &mut f64; 6] = [
        |law| &mut law.strength_mps2,
        |law| &mut law.reach_m,
        |law| &mut law.gaze_per_s,
        |law| &mut law.attraction_mps2,
        |law| &mut law.apart_mps2,
        |law| &mut law.apart_m,
    ];
    let bound = |law: &SocialForce| {
        let least = SocialForce::PUBLISHED;
        law.gaze_per_s >= least.gaze_per_s / 8.0 && law.attraction_mps2 >= least.attraction_mps2 / 8.0
    };
    let (recorded, straight) = (recording.walk(Again::Recorded), recording.walk(Again::Straight));
    let touching = |figures: &Figures| (figures.strangers.touching - recorded.strangers.touching).abs();
    let cost = |law: &SocialForce| {
        let figures = recording.walk(Again::Social(law));
        figures.displacement_m / straight.displacement_m
            + figures.strangers.error_m / straight.strangers.error_m
            + figures.companions.error_m / straight.companions.error_m
            + touching(&figures) / touching(&straight)
    };
    let mut law = SocialForce::PUBLISHED;
    let mut best = cost(&law);
    for step in [2.0, 1.4, 1.2, 1.1] {
        let mut improves = true;
        while improves {
            improves = false;
            for (parameter, factor) in
                parameters.iter().flat_map(|parameter| [(parameter, step), (parameter, 1.0 / step)])
            {
                let mut tried = law;
                *parameter(&mut tried) *= factor;
                let new = if bound(&tried) { cost(&tried) } else { f64::INFINITY };
                if new < best - 1e-4 {
                    (law, best, improves) = (tried, new, true);
                }
            }
        }
    }
    law
}
