//! `guidedog yardstick`: short walks of both yardsticks on files that stand here, what is reported of them, and files
//! that cannot be used.

use std::fs;

use guidedog_tests::Place;
use serde_json::{Value, json};

/// One cylinder, beside the way.
const WORLD: &str = "<sdf version='1.6'><world name='default'>
<model name='pillar'><pose>-3.5 8 0 0 0 0</pose><link name='link'><collision name='c'><geometry>
<cylinder><radius>0.1</radius><length>2</length></cylinder></geometry></collision></link></model>
</world></sdf>";

/// An episode of 3 m with a pedestrian, and one whose tracks are not there.
const EPISODES: &str = "[episodes_params]\ntests=['t_a','t_b']\n
[t_a]\nmap_name=ETH\npedestrian_datasets=['eth']\ndatasets_start_t=[0]\nped_ranges=[(0, -1)]\nagents_start=[]
robot_start_goal=[[0, 0, 0], [3, 0, 0]]\nmax_time=20\n
[t_b]\nmap_name=Univ\npedestrian_datasets=['univ']\ndatasets_start_t=[0]\nped_ranges=[(0, -1)]\nagents_start=[]
robot_start_goal=[[0, 0, 0], [3, 0, 0]]\nmax_time=20\n";
const DATASETS: &str = "[dataset_params]\n
[eth]\nfile_name=eth/e.csv\nfps=10\nspawn_delay_s=0\noffset=[0, 0, 0]\nswapxy=False\nflipxn=False\nflipyn=False\n
[univ]\nfile_name=univ/u.csv\nfps=10\nspawn_delay_s=0\noffset=[0, 0, 0]\nswapxy=False\nflipxn=False\nflipyn=False\n";
/// Frames, pedestrians, y and x. SocNavBench leaves the last pedestrian out.
const TRACKS: &str = "0,50,100,0,100\n1,1,1,2,2\n2,2,2,3,3\n0,1,2,0,1\n";

/// Writes a file into a folder of the place.
fn file(place: &Place, name: &str, content: impl AsRef<[u8]>) -> String {
    let path = place.path().join(name);
    fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
    fs::write(&path, content).expect("written");
    path.to_string_lossy().into_owned()
}

/// A reference path of these cells, as NumPy writes it.
fn npy(cells: &[[i64; 2]]) -> Vec<u8> {
    let header = format!("{{'descr': '<i8', 'fortran_order': False, 'shape': ({}, 2), }}\n", cells.len());
    let length = (header.len() as u16).to_le_bytes();
    let data: Vec<u8> = cells.iter().flatten().flat_map(|number| number.to_le_bytes()).collect();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), &data].concat()
}

fn barn(place: &Place) -> String {
    file(place, "barn/path_7.npy", npy(&[[15, 0], [15, 29]]));
    file(place, "barn/world_7.world", WORLD)
}

fn socnavbench(place: &Place) -> String {
    file(place, "soc/dataset_params.ini", DATASETS);
    file(place, "soc/eth.csv", TRACKS);
    file(place, "soc/e.ini", EPISODES)
}

fn walked(place: &Place, args: &[&str]) -> Value {
    let (report, code) = place.json(&[&["yardstick"], args, &["--noise", "noisy", "--json"]].concat());
    assert_eq!(code, 0, "{report:#}");
    report
}

/// A wrong input: an error that says all of `said`, and exit code 2.
fn refused(place: &Place, args: &[&str], said: &[&str]) {
    let (report, code) = place.json(&[&["yardstick"], args, &["--json"]].concat());
    let error = report["error"].as_str().unwrap_or_default();
    assert!(code == 2 && said.iter().all(|word| error.contains(word)), "{args:?}: {code}, not {said:?}: {error}");
}

/// Means and ratios of a report have an interval and a count.
fn assert_interval(report: &Value, key: &str) {
    let of = |part: &str| report[key][part].as_f64().unwrap_or(f64::NAN);
    assert!(of("lo") <= of("mean") && of("mean") <= of("hi") && of("n") > 0.0, "{key}: {report:#}");
}

#[test]
fn a_world_of_barn_is_walked_and_scored_the_same_on_any_number_of_threads() {
    let place = Place::new();
    barn(&place);
    let folder = place.path().join("barn").to_string_lossy().into_owned();
    let outcomes = place.path().join("walks.jsonl");
    let pictures = place.path().join("pictures");
    let more =
        ["--outcomes", &outcomes.to_string_lossy(), "--pictures", &pictures.to_string_lossy()].map(str::to_owned);
    let more: Vec<&str> = more.iter().map(String::as_str).collect();
    let report = walked(&place, &[&["barn", &folder, "--repeats", "2", "--workers", "2"], &more[..]].concat());
    assert_eq!(report, walked(&place, &["barn", &folder, "--repeats", "2", "--workers", "1"]));
    let head = ["yardstick", "body", "noise", "seed"].map(|key| report[key].clone());
    assert_eq!(head, [json!("barn"), json!("robot"), json!("noisy"), json!(1)]);
    ["score", "success", "collision", "timeout", "time_s"].iter().for_each(|key| assert_interval(&report, key));
    let walks = report["walks"].as_array().expect("walks");
    assert_eq!(walks.iter().map(|walk| walk["repeat"].clone()).collect::<Vec<_>>(), [json!(0), json!(1)]);
    for walk in walks {
        let number = |key: &str| walk[key].as_f64().expect("a number");
        // 10 m at 2 m/s, and 7.5 cm aside to the cells.
        assert!((number("optimal_s") - 5.0).abs() < 0.01, "{walk:#}");
        assert_eq!((&walk["world"], &walk["success"], &walk["collision"]), (&json!(7), &json!(true), &json!(false)));
        let clipped_s = number("time_s").clamp(2.0 * number("optimal_s"), 8.0 * number("optimal_s"));
        assert!((number("score") - number("optimal_s") / clipped_s).abs() < 1e-9, "{walk:#}");
    }
    assert_ne!(walks[0]["time_s"], walks[1]["time_s"], "each repeat has other noise");
    let lines = fs::read_to_string(&outcomes).expect("outcomes");
    refused(&place, &["barn", &folder, "--outcomes", &outcomes.to_string_lossy()], &["walks.jsonl: File exists"]);
    assert_eq!(fs::read_to_string(&outcomes).expect("outcomes"), lines, "it was emptied");
    let lines: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(&lines, walks);
    for repeat in 0..2 {
        let picture = fs::read_to_string(pictures.join(format!("world-7-{repeat}.svg"))).expect("a picture");
        assert!(picture.starts_with("<svg ") && picture.contains("success"), "{picture}");
    }
}

#[test]
fn a_pair_walks_a_world_of_barn_and_people_read_a_table() {
    let place = Place::new();
    let world = barn(&place);
    let output = place.guidedog(&["yardstick", "barn", &world, "--body", "pair", "--noise", "noisy"]);
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{output:?}");
    let lines: Vec<&str> = told.lines().collect();
    assert!(lines[0].starts_with("world  ended") && lines[1].starts_with("7      success"), "{told}");
    let names = lines[2..].iter().map(|line| line.split("  ").next().unwrap_or_default());
    assert_eq!(names.collect::<Vec<_>>(), ["score", "success", "collision", "timeout", "time, s"], "{told}");
}

#[test]
fn an_episode_of_socnavbench_is_walked_and_the_others_are_listed() {
    let place = Place::new();
    let episodes = socnavbench(&place);
    let report = walked(&place, &["socnavbench", &episodes]);
    assert_eq!((&report["yardstick"], &report["body"]), (&json!("socnavbench"), &json!("robot")));
    assert_eq!(report["left_out"], json!([{ "episode": "t_b", "why": "no tracks of univ" }]));
    for key in ["success", "without_pedestrian_collision", "robot_speed", "path_length", "closest_pedestrian_distance"]
    {
        assert_interval(&report, key);
    }
    let walk = &report["walks"][0];
    assert_eq!((&walk["episode"], &walk["map"], &walk["pedestrians"]), (&json!("t_a"), &json!("ETH"), &json!(1)));
    assert_eq!((&walk["success"], &walk["termination_cause"]), (&json!(true), &json!("Success")), "{walk:#}");
    let number = |at: &str| walk.pointer(at).and_then(Value::as_f64).expect("a number");
    // 3 m to the goal, reached within 0.3 m; the pedestrian walks 2 m beside.
    assert!((2.7..3.3).contains(&number("/path_length")) && number("/total_sim_time_taken") < 6.0, "{walk:#}");
    assert!((1.9..2.1).contains(&number("/closest_pedestrian_distance/0")), "{walk:#}");
    assert_eq!((&walk["pedestrian_collisions"], &walk["hit_by_others"]), (&json!(0), &json!(0)));
    let only = walked(&place, &["socnavbench", &episodes, "--only", "t_a"]);
    assert_eq!((&only["walks"], &only["left_out"]), (&report["walks"], &json!([])));
}

#[test]
fn a_wrong_file_of_a_yardstick_is_named() {
    let place = Place::new();
    let world = barn(&place);
    refused(&place, &["barn", "/nowhere/world_1.world"], &["/nowhere/world_1.world"]);
    refused(&place, &["barn", "shared/control"], &["shared/control: no world_N.world in it"]);
    let other = file(&place, "barn/field.world", WORLD);
    refused(&place, &["barn", &other], &["field.world: a file world_N.world or world_N.world.xz is wanted"]);
    let mesh = file(&place, "barn/world_8.world", WORLD.replace("cylinder", "mesh"));
    refused(&place, &["barn", &mesh], &["world_8.world:3: <mesh>"]);
    let lost = file(&place, "barn/world_9.world", WORLD);
    refused(&place, &["barn", &lost], &["path_9.npy: No such file"]);
    file(&place, "barn/path_9.npy", &npy(&[[15, 0]])[..40]);
    refused(&place, &["barn", &lost], &["path_9.npy: no .npy file, or cut short"]);
    refused(&place, &["barn", &world, "--body", "pair", "--actions", "a.toml"], &["--actions is of --body robot"]);
    refused(&place, &["barn", &world, "--actions", "/nowhere/a.toml"], &["/nowhere/a.toml"]);

    let episodes = socnavbench(&place);
    refused(&place, &["socnavbench", "/nowhere/e.ini"], &["/nowhere/e.ini"]);
    refused(&place, &["socnavbench", &episodes, "--only", "t_z"], &["e.ini: no episode t_z"]);
    refused(&place, &["socnavbench", &episodes, "--only", "t_b"], &["e.ini: no episode can be walked", "univ"]);
    let soon = file(&place, "soc/soon.ini", EPISODES.replace("max_time=20", "max_time=soon"));
    refused(&place, &["socnavbench", &soon], &["soon.ini: [t_a] max_time"]);
    file(&place, "soc/eth.csv", TRACKS.replace("2,2,2,3,3", "2,2,two,3,3"));
    refused(&place, &["socnavbench", &episodes], &["eth.csv:3: value 3: \"two\" is no number"]);
    fs::remove_file(place.path().join("soc/dataset_params.ini")).expect("it was there");
    refused(&place, &["socnavbench", &episodes], &["dataset_params.ini: No such file"]);
}
