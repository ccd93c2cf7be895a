//! Learnt policies, with networks made here: what they are fed with, what they remember, what is refused.

mod onnx;

use std::path::{Path, PathBuf};

use guidance::observation::{LENGTH, OBSERVATION};
use guidance::se2::{Point, Se2};
use guidance::{ActionTable, Beams, Evidence, HandlerBody};
use guidedog_policies::{Expected, GeometricConfig, Model, ModelError, Pilot, Situation};
use messages::{CueKind, Formation, ScanHeader};
use onnx::{Network, bias, counting};
use settings::{PlannerUse, PolicyModel};
use sha2::{Digest, Sha256};

/// A folder of models.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    fn model(&self, name: &str, bytes: &[u8], more: &str) -> PathBuf {
        let path = self.0.path().join(format!("{name}.onnx"));
        std::fs::write(&path, bytes).expect("written");
        let digest: String = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        let manifest = format!(
            "sha256 = \"{digest}\"\nobservation = \"{OBSERVATION}\"\nactions = \"eight\"\ndt = \"500ms\"\n{more}"
        );
        std::fs::write(path.with_extension("toml"), manifest).expect("written");
        path
    }
}

/// The library of ONNX Runtime that runs these networks, where one is named (`scripts/test` does both): else tract.
fn library() -> Option<PathBuf> {
    std::env::var_os("GUIDEDOG_ONNX_RUNTIME").map(PathBuf::from)
}

fn pilot(path: &Path) -> Result<Pilot, ModelError> {
    let table = ActionTable::eight();
    let model = Model::load(path, &Expected { table: table.clone(), dt_ns: 500_000_000 })?;
    let library = library();
    Ok(Pilot::new(guidedog_policies::engine(
        Some(&model),
        GeometricConfig::default(),
        PlannerUse::Off,
        &table,
        library.as_deref(),
    )?))
}

/// Decides in an empty hall.
fn decide(pilot: &mut Pilot, cue: CueKind, cue_is_new: bool, start_from_robot: Se2) -> Vec<f32> {
    decide_in(Formation::Beside, pilot, cue, cue_is_new, start_from_robot)
}

fn decide_in(
    formation: Formation,
    pilot: &mut Pilot,
    cue: CueKind,
    cue_is_new: bool,
    start_from_robot: Se2,
) -> Vec<f32> {
    let header = ScanHeader {
        angle_min_rad: -3.0,
        angle_increment_rad: 0.02,
        range_min_m: 0.1,
        range_max_m: 12.0,
        ..ScanHeader::default()
    };
    let ranges = [5.0; 300];
    let mut beams = Beams::default();
    beams.fill(&header, &ranges).expect("usable");
    let handler =
        HandlerBody { center: Point::new(-0.75, -0.35), radius_m: 0.25, mask_radius_m: Some(0.3), seen: None };
    let situation = Situation {
        scan: &header,
        ranges: &ranges,
        evidence: Evidence::scan(&beams),
        handler,
        odom_from_robot: Se2::identity(),
        odometry_incarnation: 1,
        start_from_robot,
        cue,
        cue_is_new,
        formation,
    };
    pilot.decide(&situation).expect("decides")[..8].to_vec()
}

#[test]
fn a_networks_logits_become_probabilities() {
    let folder = Folder::new();
    let logits = [0.0, 3.0, 1.0, 1.0, -2.0, -2.0, 0.5, 0.5];
    let mut pilot = pilot(&folder.model("plain", &bias(LENGTH, &logits), "")).expect("loads");
    let shares = decide(&mut pilot, CueKind::Forward, true, Se2::identity());
    let sum: f64 = logits.iter().map(|logit| f64::from(*logit).exp()).sum();
    for (share, logit) in shares.iter().zip(logits) {
        assert!((f64::from(*share) - f64::from(logit).exp() / sum).abs() < 1e-6, "{shares:?}");
    }
}

#[test]
fn no_network_goes_on_against_a_stop_or_after_a_turn_that_was_nowhere() {
    let folder = Folder::new();
    let mut pilot =
        pilot(&folder.model("eager", &bias(LENGTH, &[0.0, 9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), "")).expect("loads");
    assert_eq!(decide(&mut pilot, CueKind::Stop, true, Se2::identity())[0], 1.0);
    let far = Se2::translation(15.5, 0.0);
    assert_eq!(decide(&mut pilot, CueKind::Left, false, far)[0], 1.0);
    assert!(decide(&mut pilot, CueKind::Forward, false, far)[1] > 0.9);
}

#[test]
fn a_network_stands_with_the_handler_behind_and_asks_them_to_come_beside() {
    let folder = Folder::new();
    let eager = bias(LENGTH, &[0.0, 9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let mut pilot = pilot(&folder.model("eager", &eager, "")).expect("loads");
    for (formation, stop) in [(Formation::Beside, 0.0), (Formation::Behind, 1.0)] {
        let decided = decide_in(formation, &mut pilot, CueKind::Forward, false, Se2::identity());
        assert_eq!((decided[0].round(), pilot.formation()), (stop, Formation::Beside));
    }
}

#[test]
fn what_a_recurrent_network_remembers_goes_on_until_the_next_cue() {
    let folder = Folder::new();
    // Its memory counts decisions, and the logit of forward is that count.
    let mut pilot = pilot(&folder.model("counts", &counting(LENGTH), "memory = 1")).expect("loads");
    let mut forward = |cue_is_new| decide(&mut pilot, CueKind::Forward, cue_is_new, Se2::identity())[1];
    let counts = [forward(true), forward(false), forward(false), forward(true)];
    assert!(counts[0] < counts[1] && counts[1] < counts[2], "{counts:?}");
    assert_eq!(counts[0], counts[3], "a new cue begins anew");
}

#[test]
fn what_cannot_decide_is_refused_when_it_is_loaded() {
    let folder = Folder::new();
    let good = bias(LENGTH, &[0.0; 8]);
    let nan = bias(LENGTH, &[f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let few = bias(LENGTH, &[0.0; 7]);
    let other_input = bias(LENGTH + 1, &[0.0; 8]);
    let misnamed = Network { output: "actions", ..Network::bias(LENGTH, &[0.0; 8]) }.bytes();
    let cases: [(&str, &[u8], &str, &str); 8] = [
        ("nan", &nan, "", "output logits is not finite"),
        ("few", &few, "", "\"logits\" has 7 numbers, not 8"),
        ("other-input", &other_input, "", "could not be run"),
        ("misnamed", &misnamed, "", "no output \"logits\""),
        ("torn", &good[..good.len() / 2], "", "torn.onnx"),
        ("not-recurrent", &good, "memory = 4", "could not be run"),
        ("too-sure", &good, "temperature = 1e-60", "probabilities, is not finite"),
        ("many-frames", &good, "frames = 17", "frames = 17 is not in 1..16"),
    ];
    for (name, bytes, more, what) in cases {
        let error = pilot(&folder.model(name, bytes, more)).err().map(|error| error.to_string()).expect(name);
        assert!(error.contains(what), "{name}: {error}");
    }
    let path = folder.model("other-observation", &good, "");
    let text = std::fs::read_to_string(path.with_extension("toml")).expect("readable");
    std::fs::write(path.with_extension("toml"), text.replace(OBSERVATION, "pixels/1")).expect("written");
    let error = pilot(&path).err().map(|error| error.to_string()).expect("refused");
    assert!(error.contains("was made for the observation pixels/1"), "{error}");
}

#[test]
fn weights_in_a_file_of_their_own_which_nobody_has_verified_are_not_loaded() {
    // ONNX Runtime would look for it where the process was started.
    let weights = tempfile::Builder::new().prefix("weights").tempfile_in(".").expect("a file");
    std::fs::write(weights.path(), vec![0; 4 * 8 * LENGTH]).expect("written");
    let name = weights.path().file_name().and_then(|name| name.to_str()).expect("a name");
    let bytes = Network { apart: Some(name), ..Network::bias(LENGTH, &[0.0; 8]) }.bytes();
    let error = pilot(&Folder::new().model("apart", &bytes, "")).err().expect("refused").to_string();
    assert!(error.contains("apart.onnx"), "{error}");
}

#[test]
fn the_shipped_policy_fits_this_build_and_walks_where_it_is_free() {
    let table = ActionTable::eight();
    let expected = Expected { table: table.clone(), dt_ns: 500_000_000 };
    let model = Model::named(&PolicyModel::Guide, &expected).expect("fits").expect("a model");
    assert!(model.manifest.trained.is_some());
    let library = library();
    let engine = guidedog_policies::engine(
        Some(&model),
        GeometricConfig::default(),
        PlannerUse::Off,
        &table,
        library.as_deref(),
    );
    let mut pilot = Pilot::new(engine.expect("loads"));
    let decided = decide(&mut pilot, CueKind::Forward, true, Se2::identity());
    assert!((decided.iter().sum::<f32>() - 1.0).abs() < 1e-3 && decided[ActionTable::STOP] < 0.5, "{decided:?}");
    assert_eq!(decide(&mut pilot, CueKind::Stop, true, Se2::identity())[ActionTable::STOP], 1.0);
}

#[test]
fn a_library_that_is_not_there_is_named() {
    // In a process of its own the library would be tried; here another one runs already.
    let folder = Folder::new();
    let path = folder.model("plain", &bias(LENGTH, &[0.0; 8]), "");
    pilot(&path).expect("loads");
    let table = ActionTable::eight();
    let model = Model::load(&path, &Expected { table: table.clone(), dt_ns: 500_000_000 }).expect("fits");
    let nowhere = Some(Path::new("/nowhere/libonnxruntime.so"));
    let error = guidedog_policies::engine(Some(&model), GeometricConfig::default(), PlannerUse::Off, &table, nowhere);
    let error = error.err().map(|error| error.to_string()).expect("refused");
    let running = library().map_or_else(|| "tract".to_owned(), |path| path.display().to_string());
    assert!(error.contains(&format!("runs its models by {running} already")), "{error}");
}
