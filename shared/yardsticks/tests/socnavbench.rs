//! SocNavBench's own files.

use std::collections::BTreeMap;

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
                let (low, high) = (start[0].min(goal[0]) - 12.0, start[0].max(goal[0]) + 12.0);
                let places = passage.crowd.people.iter().flat_map(|person| &person.places);
                assert!(places.clone().count() > 100, "{}", episode.name);
                assert!(places.clone().all(|(_, at)| (low..high).contains(&at.x)), "{}", episode.name);
            }
            Err(why) => assert!(why.ends_with("zara02") || why.ends_with("univ"), "{}: {why}", episode.name),
        }
    }
    assert_eq!(walked, 20);
}
