//! The social force model held against recorded tracks. docs/people.md has the figures, and how they were got.

#![allow(clippy::unwrap_used, reason = "helpers of tests are tests too")]

use std::fs::File;
use std::io::Read;

use guidedog_world::people::social::SocialForce;
use guidedog_world::recorded::{Again, Pairs, Recording};
use guidedog_world::tracks;
use lzma_rust2::XzReader;
use test_data::data;

/// Name, frames a second, and the pedestrians in it.
const RECORDINGS: [(&str, f64, usize); 3] = [("hotel", 15.0, 389), ("eth", 15.0, 360), ("zara01", 25.0, 148)];

#[test]
fn the_model_is_nearer_to_recorded_pedestrians_than_a_straight_line() {
    for (name, frames_hz, count) in RECORDINGS {
        let Some(path) = data(&format!("pedestrians/{name}.csv.xz")) else { return };
        let mut text = String::new();
        XzReader::new(File::open(&path).unwrap(), true).read_to_string(&mut text).unwrap();
        let tracks = tracks::read(name, &text).unwrap();
        assert_eq!(tracks.len(), count, "{name}");
        let recording = Recording::new(tracks, frames_hz);
        let [was, line, model] = [Again::Recorded, Again::Straight, Again::Social(&SocialForce::default())]
            .map(|again| recording.walk(again));
        assert!(model.displacement_m <= line.displacement_m, "{name}: {} m", model.displacement_m);
        let Pairs { least_m, error_m, nearer, touching, .. } = model.strangers;
        // Measured: 0.77 to 0.83 of the line's error, and 0 to 0.33 of what the line lacks in the mean.
        assert!(error_m < 0.88 * line.strangers.error_m, "{name}: {error_m} m");
        let lacks_m = |least_m: f64| (least_m - was.strangers.least_m).abs();
        assert!(lacks_m(least_m) < 0.5 * lacks_m(line.strangers.least_m), "{name}: {least_m} m");
        // Measured: 0.57 to 0.85 of the line's pairs that come nearer; of those who nearly touch too many, 0.2 to 0.5.
        assert!(nearer < 0.9 * line.strangers.nearer, "{name}: {nearer}");
        let too_many = |touching: f64| touching - was.strangers.touching;
        assert!(too_many(touching) < 0.6 * too_many(line.strangers.touching), "{name}: {touching}");
        assert!((model.speed_mps / was.speed_mps - 1.0).abs() < 0.05, "{name}: {} m/s", model.speed_mps);
    }
}
