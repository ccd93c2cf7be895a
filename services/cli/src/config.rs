//! `config`: the effective configuration with the origin of each value, and its schema.

use std::collections::BTreeMap;

use serde_json::json;
use settings::{Effective, Operator, Origins, PhysicsKind, Profile, SimulatedNoise, load_with_origins};

use crate::args::{ConfigArgs, ConfigCommand, ConfigVerb};
use crate::exit::Failure;
use crate::out;

/// Where a value comes from that no file names.
const BUILT_IN: &str = "default";
/// Origins stand behind this column, where a line leaves it free.
const COLUMN: usize = 48;

/// `guidedog config`
///
/// # Errors
/// Where the configuration cannot be used.
pub fn config(args: &ConfigCommand, as_json: bool) -> Result<(), Failure> {
    match &args.verb {
        ConfigVerb::Show { config, profile } => show(config, profile.map(Profile::from), as_json),
        ConfigVerb::Schema => out::raw(&format!("{:#}", settings::schema())),
    }
}

fn show(config: &ConfigArgs, profile: Option<Profile>, as_json: bool) -> Result<(), Failure> {
    let Effective { settings, origins } = effective(&config.operator(), profile).map_err(Failure::of_input)?;
    let table = toml::Table::try_from(&settings).map_err(Failure::of_input)?;
    let mut lines = Vec::new();
    let mut told = BTreeMap::new();
    section("", &table, &origins, &mut lines, &mut told);
    out::tell(as_json, &json!({ "settings": settings, "origins": told }), || lines)
}

/// The settings as `walk` and `up` take them: a robot on legs has defaults of its own.
fn effective(operator: &Operator, profile: Option<Profile>) -> Result<Effective, settings::SettingsError> {
    let given = load_with_origins(profile.unwrap_or(Profile::Walk), operator.clone())?;
    let simulation = &given.settings.simulation;
    let legs = match (profile, simulation.physics, simulation.noise) {
        (None, PhysicsKind::Mujoco, _) => Profile::Mujoco,
        (None, PhysicsKind::Flat, SimulatedNoise::Legged) => Profile::Go2,
        _ => return Ok(given),
    };
    load_with_origins(legs, operator.clone())
}

/// The values of a section, then the sections in it.
fn section(
    name: &str,
    table: &toml::Table,
    origins: &Origins,
    lines: &mut Vec<String>,
    told: &mut BTreeMap<String, String>,
) {
    let key_of = |key: &str| if name.is_empty() { key.to_owned() } else { format!("{name}.{key}") };
    let is_table = |value: &toml::Value| matches!(value, toml::Value::Table(_));
    let mut values = table.iter().filter(|(_, value)| !is_table(value)).peekable();
    if values.peek().is_some() && !name.is_empty() {
        lines.extend([String::new(), format!("[{name}]")]);
    }
    for (key, value) in values {
        let whole = key_of(key);
        let origin = origins.of(&whole).map_or_else(|| BUILT_IN.to_owned(), ToString::to_string);
        lines.push(format!("{:COLUMN$} # {origin}", format!("{key} = {value}")));
        told.insert(whole, origin);
    }
    for (key, value) in table {
        if let toml::Value::Table(below) = value {
            section(&key_of(key), below, origins, lines, told);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::effective;
    use settings::{Operator, Settings};

    #[test]
    fn what_is_shown_is_a_configuration_that_says_the_same() {
        let operator = Operator { file: None, set: vec!["simulation.noise=legged".to_owned()] };
        let shown = effective(&operator, None).expect("it is right");
        let table = toml::Table::try_from(&shown.settings).expect("it can be written");
        let (mut lines, mut told) = (Vec::new(), std::collections::BTreeMap::new());
        super::section("", &table, &shown.origins, &mut lines, &mut told);
        let read: Settings = toml::from_str(&lines.join("\n")).expect("it can be read");
        assert_eq!(read, shown.settings);
        assert_eq!(told["simulation.noise"], "--set simulation.noise=legged");
        assert!(told.values().any(|origin| origin.starts_with("config/profiles/go2.toml:")));
    }
}
