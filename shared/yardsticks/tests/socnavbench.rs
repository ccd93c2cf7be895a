//! SocNavBench's own files.

use std::collections::BTreeMap;

use guidance::se2::Point;
use guidedog_yardsticks::socnavbench::{datasets, episodes, tracks, tracks_file};

#[test]
fn its_episodes_are_among_the_people_who_were_recorded() {
    let Some(folder) = test_data::data("pedestrians") else { return };
    let episodes = episodes(&folder.join("episode_params_val.ini")).expect("episodes");
    let datasets = datasets(&folder.join("dataset_params.ini")).expect("datasets");
    assert_eq!((episodes.len(), datasets.len()), (33, 9));
    let there = datasets.iter().filter_map(|(name, dataset)| Some((name.clone(), tracks_file(&folder, dataset)?)));
    let tracks: BTreeMap<_, _> = there.map(|(name, file)| (name, tracks(&file).expect("tracks"))).collect();
    // eth, hotel under five names, zara01.
    assert_eq!(tracks.len(), 7);
    let mut walked = 0;
    for episode in &episodes {
        match episode.passage(&datasets, &tracks) {
            Ok(passage) => {
                walked += 1;
                let seen = |time_s: u32| passage.crowd.at(f64::from(time_s)).count();
                assert!((0..=episode.time_max_s as u32).any(|time_s| seen(time_s) >= 2), "{}", episode.name);
                // The tracks lie where the robot walks.
                let [start, goal] = episode.robot;
                let middle = Point::new((start[0] + goal[0]) / 2.0, (start[1] + goal[1]) / 2.0);
                let places = passage.crowd.people.iter().flat_map(|person| &person.places);
                let nearest_m = places.map(|(_, at)| (at - middle).norm()).fold(f64::INFINITY, f64::min);
                assert!(nearest_m < 5.0, "{}: {nearest_m}", episode.name);
            }
            Err(why) => assert!(why.ends_with("zara02") || why.ends_with("univ"), "{}: {why}", episode.name),
        }
    }
    assert_eq!(walked, 20);
}
