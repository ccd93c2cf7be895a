//! Files of public yardsticks: a world of Gazebo and its reference path, as BARN has them; episodes, datasets and
//! tracks, as SocNavBench has them.
#![no_main]

use std::collections::BTreeMap;

use guidedog_fuzz::{BORDER, file};
use libfuzzer_sys::fuzz_target;
use world::{Tracks, tracks};
use yardsticks::barn::Task;
use yardsticks::socnavbench::{datasets, episodes};

/// The first byte says which yardstick's files follow.
const BARN: u8 = b'b';

fuzz_target!(|input: &[u8]| {
    match input.split_first() {
        Some((&BARN, files)) => barn(files),
        Some((_, files)) => socnavbench(files),
        None => {}
    }
});

/// A world; behind a border its path, which may hold any bytes.
fn barn(files: &[u8]) {
    let border = files.iter().position(|byte| *byte == BORDER).unwrap_or(files.len());
    let world = file("world_1.world", &files[..border]);
    let _ = file("path_1.npy", files.get(border + 1..).unwrap_or_default());
    let Ok(task) = Task::load(&world) else { return };
    assert!(task.optimal_s.is_finite() && task.optimal_s > 0.0, "{}", task.optimal_s);
    for prism in task.world.prisms() {
        let is_finite = prism.outline.iter().all(|corner| corner.coords.norm().is_finite());
        assert!(is_finite && prism.z0_m.is_finite() && prism.z1_m.is_finite(), "{prism:?}");
    }
    let passage = task.passage();
    let room_m = passage.world.clearance(passage.goal, [0.0, 1.0], 1.0);
    assert!(room_m.is_finite(), "{room_m}");
}

/// Episodes, datasets and tracks, with a border between them.
fn socnavbench(files: &[u8]) {
    let mut files = files.splitn(3, |byte| *byte == BORDER);
    let mut next = |name: &str| file(name, files.next().unwrap_or_default());
    let (episodes, datasets) = (episodes(&next("e.ini")), datasets(&next("d.ini")));
    let text = std::fs::read_to_string(next("t.csv")).unwrap_or_default();
    let found = Tracks::parse("t.csv", &text);
    if let Ok(whole) = tracks::read("t.csv", &text) {
        for track in whole {
            let last = track.first_frame + track.places.len() as u32 - 1;
            assert!(track.at(last).is_some() && track.at(last + 1).is_none());
        }
    }
    let (Ok(episodes), Ok(datasets), Ok(found)) = (episodes, datasets, found) else { return };
    let tracks: BTreeMap<String, Tracks> = datasets.keys().map(|name| (name.clone(), found.clone())).collect();
    for episode in episodes {
        let Ok(passage) = episode.passage(&datasets, &tracks) else { continue };
        for time_s in [0.0, 0.1, 1.0, episode.time_max_s] {
            for (person, at) in passage.crowd.at(time_s) {
                assert!(at.coords.norm().is_finite(), "{:?} at {time_s} s", passage.crowd.people[person]);
            }
        }
    }
}
