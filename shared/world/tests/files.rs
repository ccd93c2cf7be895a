//! World, route and map files, good and bad.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests are tests too")]

use std::path::Path;

use guidance::HandlerErrors;
use guidance::se2::Point;
use guidedog_world::{
    Cell, CuePoint, CueSequence, CueTrigger, Disturbance, DisturbanceKind, GridMap, Route, Scenario, World,
};
use messages::{CueKind, Pose2};

fn world_error(text: &str) -> String {
    World::from_toml("w.toml", text, Path::new("")).unwrap_err().to_string()
}

#[test]
fn errors_of_a_world_name_file_line_and_key() {
    let cases = [
        ("[[wall]]\npoints = [[0, 0], [1, 0]]\nhight = 2\n", "w.toml:3: unknown field `hight`"),
        ("\n[[box]]\nat = [0, 0]\nz = [0, 1]\n", "w.toml:2: missing field `size`"),
        ("\n[[box]]\nat = [0, 0]\nsize = [0, 1]\nz = [0, 1]\n", "w.toml:2: size: 0 is not in"),
        ("\n\n[[pillar]]\nat = [nan, 0]\nradius_m = 1\n", "w.toml:3: at: NaN is not in"),
        ("[[wall]]\npoints = [[0, 0]]\n", "w.toml:1: points: 1 points are too few"),
        ("[[wall]]\npoints = [[0, 0], [1e9, 0]]\n", "w.toml:1: points: 1000000000 is not in"),
        ("[[curtain]]\npoints = [[0, 0], [1, 0]]\nz = [2, 1]\n", "w.toml:1: z: lower edge 2 is not under"),
        ("[[person]]\npath = [[0, 0]]\nwalk = \"hop\"\n", "w.toml:3: unknown variant `hop`"),
        ("[[hole]]\nat = [0, 0]\nsize = [3, 2]\n", "w.toml:1: missing field `depth_m`"),
        ("[[hole]]\nat = [0, 0]\nsize = [3, 2]\ndepth_m = 0\n", "w.toml:1: depth_m: 0 is not in"),
        (
            "[[hole]]\nat = [0, 0]\nsize = [3, 2]\ndepth_m = 1\n\
             [[stairs]]\nat = [2, 0]\nsteps = 3\nwidth_m = 1\nrise_m = -0.2\n",
            "w.toml:5: hole: it overlaps another hole",
        ),
        ("[[stairs]]\nat = [0, 0]\nsteps = 3\nwidth_m = 1\nrise_m = 0\n", "w.toml:1: rise_m: 0 is no step"),
        ("[[stairs]]\nat = [0, 0]\nsteps = 0\nwidth_m = 1\nrise_m = 0.2\n", "w.toml:1: steps: 0 is not in 1..100"),
        (
            "[[stairs]]\nat = [0, 0]\nsteps = 3\nwidth_m = 1\nrise_m = -0.2\nopen = true\n",
            "w.toml:1: open: only stairs that lead up",
        ),
        ("[[dark_floor]]\nat = [0, 0]\nsize = [3, 2]\nsilent = 2\n", "w.toml:1: silent: 2 is not in"),
        ("[[ramp]]\nat = [0, 0]\nsize = [3, 2]\n", "w.toml:1: missing field `rise_m`"),
        ("[[ramp]]\nat = [0, 0]\nsize = [3, 0]\nrise_m = 0.2\n", "w.toml:1: size: 0 is not in"),
        ("[[ramp]]\nat = [0, 0]\nsize = [3, 2]\nrise_m = 2\n", "w.toml:1: rise_m: 2 is not in"),
        ("[[ramp]]\nat = [0, 0]\nsize = [3, 2]\nrise_m = 1\nfrom_m = 4.5\n", "w.toml:1: from_m: 4.5 is not in"),
        ("[[wall]\n", "w.toml:1: "),
        ("ceiling_m = -1\n", "w.toml:1: ceiling_m: -1 is not in"),
    ];
    for (text, expected) in cases {
        let error = world_error(text);
        assert!(error.starts_with(expected), "{error}");
    }
    let many = "[[person]]\npath = [[0, 0]]\n".repeat(17);
    assert!(world_error(&many).starts_with("w.toml:33: person: there are over 16"));
    assert!(World::load(Path::new("/nowhere/w.toml")).unwrap_err().to_string().contains("/nowhere/w.toml"));
}

#[test]
fn errors_of_a_route_name_file_line_and_key() {
    let cases = [
        ("[[cue]]\nkind = \"forwards\"\nat_s = 1\n", "r.toml:2: unknown variant `forwards`"),
        ("\n[[cue]]\nkind = \"left\"\n", "r.toml:2: cue: needs either"),
        ("\n[[cue]]\nkind = \"left\"\nat_s = 1\nat = [0, 0]\n", "r.toml:2: cue: needs either"),
        ("\n[[cue]]\nkind = \"left\"\nat_s = -1\n", "r.toml:4: at_s: -1 is not in"),
        ("time_limit_s = inf\n", "r.toml:1: time_limit_s: inf is not in"),
        ("goal = { at = [0, 0], within = 1 }\n", "r.toml:1: unknown field `within`"),
        ("world = \"x\"\n", "r.toml:1: unknown field `world`"),
    ];
    for (text, expected) in cases {
        let error = Route::from_toml("r.toml", text).unwrap_err().to_string();
        assert!(error.starts_with(expected), "{error}");
    }
    let error = Scenario::from_toml("s.toml", "world = \"x.toml\"\n", Path::new("")).unwrap_err().to_string();
    assert!(error.starts_with("s.toml:1: missing field"), "{error}");
}

#[test]
fn cues_come_in_order() {
    let text = "[[cue]]\nkind = \"forward\"\nat_s = 1.0\n[[cue]]\nkind = \"left\"\nat = [5, 0]\nwithin_m = 0.5\n";
    let route = Route::from_toml("r.toml", text).unwrap();
    let place = CueTrigger::Place(Point::new(5.0, 0.0), 0.5);
    assert_eq!(route.cues[1], CuePoint { kind: CueKind::Left, trigger: place, late_m: 0.0 });
    let mut cues = CueSequence::new(&route);
    let there = Pose2::new(4.8, 0.3, 0.0);
    assert_eq!(cues.due(0.5, there), None, "the second waits for the first");
    assert_eq!(cues.due(1.0, there), Some(CueKind::Forward));
    assert_eq!(cues.due(1.0, Pose2::default()), None);
    assert_eq!(cues.due(9.0, there), Some(CueKind::Left));
    assert!(cues.is_done() && cues.due(10.0, there).is_none());
}

/// A map of 3 x 2 pixels: black, white, grey above; white, white, black below.
const PIXELS: [u8; 6] = [0, 254, 205, 254, 254, 0];

fn pgm() -> Vec<u8> {
    let mut image = b"P5\n# a comment\n3 2\n255\n".to_vec();
    image.extend(PIXELS);
    image
}

const YAML: &str = "image: m.pgm\nresolution: 0.5\norigin: [1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\n\
                    free_thresh: 0.196\n";

fn map(yaml: &str, image: &[u8]) -> Result<GridMap, String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("m.pgm"), image).unwrap();
    let file = folder.path().join("m.yaml");
    std::fs::write(&file, yaml).unwrap();
    GridMap::load(&file).map_err(|error| error.to_string().replace(folder.path().to_str().unwrap(), ""))
}

#[test]
fn a_map_tells_the_image_that_it_names() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("floor-3.yaml");
    std::fs::write(&file, YAML).unwrap();
    assert_eq!(GridMap::image(&file).unwrap(), folder.path().join("m.pgm"));
    std::fs::write(&file, "resolution: 0.5\n").unwrap();
    assert!(GridMap::image(&file).unwrap_err().to_string().contains("floor-3.yaml"));
}

#[test]
fn a_map_stands_on_its_origin() {
    let map_a = map(YAML, &pgm()).unwrap();
    assert_eq!(map_a.size(), (3, 2));
    assert_eq!(map_a.at(Point::new(1.25, 2.75)), Cell::Occupied, "the upper left pixel");
    assert_eq!(map_a.at(Point::new(2.25, 2.75)), Cell::Unknown, "grey is unknown");
    assert_eq!(map_a.at(Point::new(1.25, 2.25)), Cell::Free);
    assert_eq!(map_a.at(Point::new(0.9, 2.25)), Cell::Unknown, "off the map");
    let turned = map(&YAML.replace("2.0, 0.0", "2.0, 1.5707963267948966"), &pgm()).unwrap();
    // x of the map now points along y of the world.
    assert_eq!(turned.at(Point::new(0.25, 2.25)), Cell::Occupied);
    assert_eq!(turned.at(Point::new(0.75, 3.25)), Cell::Occupied);
    assert_eq!(turned.at(Point::new(0.25, 3.25)), Cell::Unknown);
}

#[test]
fn images_of_other_kinds_say_the_same() {
    let expected: Vec<_> = cells(&map(YAML, &pgm()).unwrap());
    let plain = b"P2 3 2 255\n0 254 205\n254 254 0\n";
    assert_eq!(cells(&map(YAML, plain).unwrap()), expected, "plain PGM");
    let inverse: Vec<u8> = b"P5 3 2 255\n".iter().copied().chain(PIXELS.map(|pixel| 255 - pixel)).collect();
    assert_eq!(cells(&map(&YAML.replace("negate: 0", "negate: true"), &inverse).unwrap()), expected, "negated");
    let percent = b"P2 3 2 255\n100 0 255\n0 0 100\n";
    assert_eq!(cells(&map(&format!("{YAML}mode: raw\n"), percent).unwrap()), expected, "raw");
    let small = b"P2 3 2 100\n0 100 80\n100 100 0\n";
    assert_eq!(cells(&map(YAML, small).unwrap()), expected, "white is 100");
    let small: Vec<u8> = b"P5 3 2 100\n".iter().copied().chain([0, 100, 80, 100, 100, 0]).collect();
    assert_eq!(cells(&map(YAML, &small).unwrap()), expected, "white is 100, raw");
    let deep: Vec<u8> = PIXELS.iter().flat_map(|&pixel| [pixel, pixel]).collect();
    let deep: Vec<u8> = b"P5 3 2 65535\n".iter().copied().chain(deep).collect();
    assert_eq!(cells(&map(YAML, &deep).unwrap()), expected, "16 bits");
    let mut png = std::io::Cursor::new(Vec::new());
    let image = image::GrayImage::from_raw(3, 2, PIXELS.to_vec()).unwrap();
    image.write_to(&mut png, image::ImageFormat::Png).unwrap();
    assert_eq!(cells(&map(YAML, png.get_ref()).unwrap()), expected, "PNG");
    let clear = image::GrayAlphaImage::from_fn(3, 2, |_, _| image::LumaA([254, 0]));
    png = std::io::Cursor::new(Vec::new());
    clear.write_to(&mut png, image::ImageFormat::Png).unwrap();
    assert_eq!(map(YAML, png.get_ref()).unwrap().count(Cell::Unknown), 6, "what is transparent is unknown");
}

fn cells(map: &GridMap) -> Vec<Cell> {
    (0..6).map(|i| map.cell(i % 3, i / 3)).collect()
}

#[test]
fn errors_of_a_map_name_file_and_line_or_key() {
    let cases = [
        (YAML.replace("resolution: 0.5", "resolution: 0"), "/m.yaml:2: resolution: 0 is not in"),
        (YAML.replace("resolution: 0.5", "resolution: .nan"), "/m.yaml:2: resolution: NaN is not in"),
        (YAML.replace("[1.0, 2.0, 0.0]", "[1.0, .inf, 0.0]"), "/m.yaml:3: origin: "),
        (YAML.replace("free_thresh: 0.196", "free_thresh: 0.9"), "/m.yaml:6: free_thresh: 0.9 is over"),
        (YAML.replace("negate: 0", "negate: 7"), "/m.yaml:4: negate: 7 is neither"),
        (YAML.replace("m.pgm", "n.pgm"), "failed to read /n.pgm"),
    ];
    for (yaml, expected) in cases {
        let error = map(&yaml, &pgm()).unwrap_err();
        assert!(error.starts_with(expected), "{error}");
    }
    for (yaml, part) in [
        (YAML.replace("resolution: 0.5\n", ""), "resolution"),
        (YAML.replace("[1.0, 2.0, 0.0]", "[1.0, 2.0]"), "/m.yaml:3: "),
        (YAML.replace("resolution: 0.5", "resolution: wide"), "/m.yaml:2: "),
        ("{".to_owned(), "/m.yaml:"),
        ("- a\n- b\n".to_owned(), "/m.yaml:1: "),
    ] {
        let error = map(&yaml, &pgm()).unwrap_err();
        assert!(error.starts_with("/m.yaml:") && error.contains(part), "{error}");
        println!("{error}");
    }
    let whole = pgm();
    let bad_images: [&[u8]; 6] =
        [b"", b"P5", b"hello", b"P5\n-3 2\n255\n", &whole[..whole.len() - 1], b"P5\n60000 60000\n255\n"];
    for image in bad_images {
        let error = map(YAML, image).unwrap_err();
        assert!(error.starts_with("/m.pgm: "), "{error}");
        println!("{error}");
    }
}

#[test]
fn real_maps_load_and_other_yaml_beside_them_is_refused() {
    let Some(maps) = test_data::data("maps") else { return };
    let folders = std::fs::read_dir(maps).unwrap().map(|entry| entry.unwrap().path());
    let files: Vec<_> =
        folders.flat_map(|folder| std::fs::read_dir(folder).unwrap()).map(|e| e.unwrap().path()).collect();
    let mut loaded = 0;
    for file in files.iter().filter(|file| file.extension().is_some_and(|extension| extension == "yaml")) {
        if !["pgm", "png"].iter().any(|extension| file.with_extension(extension).exists()) {
            let error = GridMap::load(file).unwrap_err().to_string();
            assert!(error.starts_with(&format!("{}:", file.display())), "{error}");
            continue;
        }
        let world = World::load(file).unwrap();
        let map = world.map().unwrap();
        let (free, occupied) = (map.count(Cell::Free), map.count(Cell::Occupied));
        assert!(free > 10_000 && occupied > 1000, "{}: {free} {occupied}", file.display());
        loaded += 1;
    }
    assert!(loaded >= 10, "{loaded}");
}

#[test]
fn a_handlers_errors_turn_the_start_and_shift_the_cues_of_places_along_the_way() {
    let text = "world = \"w.toml\"\nstart = { at = [0, 0], yaw_deg = 0 }\ngoal = { at = [4, 9] }\ntime_limit_s = 60\n\
        [[cue]]\nkind = \"forward\"\nat_s = 1.0\n[[cue]]\nkind = \"left\"\nat = [4, 0]\n\
        [[cue]]\nkind = \"stop\"\nat = [4, 8]\n";
    let scenario = Scenario::from_toml("s.toml", text, std::path::Path::new("")).unwrap();
    let errors = HandlerErrors { orientation_rad: 0.2, timing_m: 0.5 };
    let erring = scenario.clone().with_errors(&errors);
    assert!((erring.start.yaw_rad - 0.2).abs() < 1e-12 && erring.start.x_m == 0.0);
    // Where each cue comes on a way to (4, 0) and from there to (4, 10).
    let places = |scenario: &Scenario| {
        let mut cues = CueSequence::new(&scenario.route);
        let way = (0..=140).map(|i| f64::from(i) / 10.0);
        let poses = way.map(|way_m| Pose2::new(way_m.min(4.0), (way_m - 4.0).max(0.0), 0.0));
        let given = poses.filter_map(|at| cues.due(9.0, at).map(|kind| (kind, at.x_m + at.y_m)));
        given.collect::<Vec<_>>()
    };
    let (right, late) = (places(&scenario), places(&erring));
    let early = places(&scenario.clone().with_errors(&HandlerErrors { orientation_rad: 0.0, timing_m: -0.7 }));
    for (i, after_m) in [0.0, 3.0, 11.0].into_iter().enumerate() {
        let shift_m = if i == 0 { 0.0 } else { 1.0 };
        for (given, wanted_m) in
            [(&right, after_m), (&late, after_m + 0.5 * shift_m), (&early, after_m - 0.7 * shift_m)]
        {
            assert!((given[i].1 - wanted_m).abs() < 0.11, "{i}: {given:?}");
        }
    }
    assert_eq!(scenario.clone().with_errors(&HandlerErrors::default()), scenario);
}

#[test]
fn a_scenario_tells_what_the_handler_does_and_refuses_what_makes_no_sense() {
    let of = |disturbance: &str| {
        let start = "world = \"x.toml\"\nstart = { at = [0, 0] }\ntime_limit_s = 9\n";
        Scenario::from_toml(
            "s.toml",
            &format!("{start}[[handler]]\nat_s = 2.0\nfor_s = 1.5\n{disturbance}"),
            Path::new(""),
        )
    };
    let disturbances = of("does = \"pull\"\npull_n = [5, -20]\n").unwrap().disturbances;
    assert_eq!(disturbances, [Disturbance { kind: DisturbanceKind::Pull([5.0, -20.0]), at_s: 2.0, for_s: 1.5 }]);
    assert!(
        disturbances[0].is_at(2.0)
            && disturbances[0].is_at(3.4)
            && !disturbances[0].is_at(3.5)
            && !disturbances[0].is_at(1.9)
    );
    assert_eq!(of("does = \"let_go\"\n").unwrap().disturbances[0].kind, DisturbanceKind::LetGo);
    let pulls = "pull_n belongs to does = \"pull\", which needs it";
    for (disturbance, told) in [
        ("does = \"snag\"\npull_n = [1, 1]\n", pulls),
        ("does = \"pull\"\n", pulls),
        ("does = \"pull\"\npull_n = [0, 9000]\n", "handler.pull_n"),
        ("does = \"jump\"\n", "unknown variant `jump`"),
    ] {
        let error = of(disturbance).unwrap_err().to_string();
        assert!(error.starts_with("s.toml:") && error.contains(told), "{error}");
    }
}
