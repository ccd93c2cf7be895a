//! Model and policy of a legged robot in MuJoCo: which files they are, and whether they are the ones that they should
//! be.

use std::path::Path;

use serde_json::{Value, json};
use settings::{ConfigPath, Mujoco, PhysicsKind, Settings};
use sha2::{Digest, Sha256};

use crate::exit::Failure;
use crate::launch::beside;
use crate::prepare::find_config_file;

/// What `scripts/mujoco` brings, as sha256sum writes it.
const KNOWN: &str = include_str!("../../../config/legs.sha256");

/// Names model and policy where the configuration does not, and notes their digests, which recordings hold.
///
/// # Errors
/// Where one of them, or the program that simulates it, is missing, or a file has another digest than was configured.
pub fn find(mujoco: &mut Mujoco) -> Result<(), Failure> {
    let program = beside(PhysicsKind::Mujoco.program())?;
    if !program.is_file() {
        let build = "bring MuJoCo with scripts/mujoco, and build it with `cargo build` in services/mujoco";
        return Err(Failure::input(format!("{} is missing: {build}", program.display())));
    }
    find_file("model", "go2.xml", &mut mujoco.model, &mut mujoco.model_sha256)?;
    find_file("policy", "policy.onnx", &mut mujoco.policy, &mut mujoco.policy_sha256)
}

fn find_file(key: &str, name: &str, file: &mut Option<ConfigPath>, sha256: &mut Option<String>) -> Result<(), Failure> {
    let path = match &*file {
        Some(path) => path.clone().into(),
        None => find_config_file(&Path::new("legs/go2").join(name))?,
    };
    let wrong = |what: String| Failure::input(format!("simulation.mujoco.{key}: {} {what}", path.display()));
    if !path.is_file() {
        let bring = if file.is_none() { ": bring it with scripts/mujoco" } else { "" };
        return Err(wrong(format!("is missing{bring}")));
    }
    let bytes = std::fs::read(&path).map_err(|error| wrong(format!("cannot be read: {error}")))?;
    let found = digest(&bytes);
    if let Some(wanted) = sha256.as_ref().filter(|wanted| !wanted.eq_ignore_ascii_case(&found)) {
        return Err(wrong(format!("has the digest {found}, not {wanted}")));
    }
    (*file, *sha256) = (Some(path.into()), Some(found));
    Ok(())
}

fn digest(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Whether this is the digest of that file of the Go2 that `scripts/mujoco` brings.
fn is_known(name: &str, sha256: &str) -> bool {
    let mut known = KNOWN.lines().filter_map(|line| line.split_once("  "));
    known.any(|(digest, file)| file.ends_with(name) && digest == sha256)
}

/// What a report says of model and policy: their files, their digests, and whether they are the known ones. A model
/// with a description beside it is another robot's. Null where no legs walk.
#[must_use]
pub fn about(settings: &Settings) -> Value {
    let mujoco = &settings.simulation.mujoco;
    let file = |name: &str, file: &Option<ConfigPath>, sha256: &Option<String>| {
        let is_described = || file.as_ref().is_some_and(|file| file.as_ref().with_extension("toml").exists());
        let is_known = sha256.as_ref().is_some_and(|sha256| is_known(name, sha256)) && !is_described();
        let note = (!is_known).then(|| format!("this is not the {name} that scripts/mujoco brings"));
        json!({ "path": file, "sha256": sha256, "known": is_known, "note": note })
    };
    match settings.simulation.physics {
        PhysicsKind::Flat => Value::Null,
        PhysicsKind::Mujoco => json!({
            "model": file("go2.xml", &mujoco.model, &mujoco.model_sha256),
            "policy": file("policy.onnx", &mujoco.policy, &mujoco.policy_sha256),
        }),
    }
}

/// The same as lines of a summary.
#[must_use]
pub fn lines(about: &Value) -> Vec<String> {
    let parts = about.as_object().into_iter().flatten();
    let line = |(part, file): (&String, &Value)| {
        let sha256 = file["sha256"].as_str().unwrap_or_default();
        let note = file["note"].as_str().map_or_else(String::new, |note| format!(": {note}"));
        format!("  {part}: sha256 {sha256}{note}")
    };
    parts.map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::{KNOWN, about, digest, find_file, is_known, lines};
    use settings::{ConfigPath, PhysicsKind, Settings};

    #[test]
    fn the_known_files_are_the_ones_that_the_script_brings() {
        assert_eq!(KNOWN.lines().count(), 3);
        for (name, sha256) in [
            ("go2.xml", "50adb09a4365293e2acdaf2010ae35a82b0f09fea18ae51806fef91e310ed04a"),
            ("policy.onnx", "d6c8be8e5019ffaa44a1501f854d60f9dfc742b0b85eb6400b6357f5f1e92b57"),
        ] {
            assert!(is_known(name, sha256) && !is_known(name, &digest(b"other")), "{name}");
        }
    }

    #[test]
    fn another_file_is_told_and_a_file_of_another_digest_than_configured_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("policy.onnx");
        std::fs::write(&path, "walks").expect("written");
        let mut file = Some(ConfigPath::from(path));
        let mut settings = Settings::default();
        assert!(about(&settings).is_null());
        settings.simulation.physics = PhysicsKind::Mujoco;
        let mujoco = &mut settings.simulation.mujoco;
        find_file("policy", "policy.onnx", &mut file, &mut mujoco.policy_sha256).expect("it is there");
        assert_eq!(mujoco.policy_sha256, Some(digest(b"walks")));
        let told = about(&settings);
        assert_eq!((&told["policy"]["known"], &told["policy"]["sha256"]), (&false.into(), &digest(b"walks").into()));
        let told = lines(&told);
        assert!(told.iter().any(|line| line.contains("policy") && line.contains("this is not the")), "{told:?}");
        let refused = find_file("policy", "policy.onnx", &mut file, &mut Some(digest(b"swims"))).expect_err("refused");
        assert!(refused.message.contains("has the digest"), "{}", refused.message);
    }
}
