//! config/guidedog.schema.json is written from the types of the settings.
//! `GUIDEDOG_WRITE_DOCS=1 cargo test -p guidedog-settings --test schema` writes it.

use std::path::{Path, PathBuf};

use guidedog_settings::{Settings, schema};
use serde_json::Value;

fn config(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(name)
}

#[test]
fn the_schema_is_that_of_the_settings() {
    let path = config("guidedog.schema.json");
    let text = format!("{:#}\n", schema());
    if std::env::var_os("GUIDEDOG_WRITE_DOCS").is_some() {
        std::fs::write(&path, &text).expect("it can be written");
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == text,
        "config/guidedog.schema.json is not what the settings say: GUIDEDOG_WRITE_DOCS=1 cargo test -p \
         guidedog-settings --test schema"
    );
}

/// The schema that a reference leads to.
fn resolved<'a>(whole: &'a Value, schema: &'a Value) -> &'a Value {
    match schema["$ref"].as_str() {
        Some(name) => whole.pointer(name.trim_start_matches('#')).unwrap_or_else(|| panic!("no {name}")),
        None => schema,
    }
}

/// The properties of every object in it, however it is nested; none where it is no object.
fn properties<'a>(whole: &'a Value, schema: &'a Value) -> Vec<&'a Value> {
    let schema = resolved(whole, schema);
    let parts = ["anyOf", "oneOf", "allOf"].into_iter().filter_map(|name| schema[name].as_array()).flatten();
    let own = schema.get("properties").into_iter();
    own.chain(parts.flat_map(|part| properties(whole, part))).collect()
}

/// Keys of the table that the schema does not know.
fn unknown(whole: &Value, schema: &Value, table: &toml::Table, name: &str, found: &mut Vec<String>) {
    let known = properties(whole, schema);
    for (key, value) in table {
        match (known.iter().find_map(|known| known.get(key)), value) {
            (None, _) => found.push(format!("{name}.{key}")),
            (Some(below), toml::Value::Table(table)) => unknown(whole, below, table, &format!("{name}.{key}"), found),
            (Some(_), _) => {}
        }
    }
}

#[test]
fn every_key_of_every_shipped_file_is_in_the_schema_and_no_other_is_allowed() {
    let whole = schema();
    let mut tables = vec![("defaults".to_owned(), toml::Table::try_from(Settings::default()).expect("writable"))];
    for name in ["guidedog.toml", "aliengo.toml", "go2.toml", "profiles/go2.toml", "profiles/carmen.toml"] {
        let text = std::fs::read_to_string(config(name)).expect("it is shipped");
        tables.push((name.to_owned(), text.parse().expect("it is right")));
    }
    for (name, table) in tables {
        let mut found = Vec::new();
        unknown(&whole, &whole, &table, "", &mut found);
        assert!(found.is_empty(), "{name}: {found:?}");
        assert!(table.keys().all(|section| {
            let below = resolved(&whole, &whole["properties"][section]);
            below["type"] != "object" || below["additionalProperties"] == false
        }));
    }
    assert_eq!(whole["additionalProperties"], false);
    let millis = resolved(&whole, whole.pointer("/$defs/PolicySettings/properties/dt").expect("a key")).clone();
    assert_eq!(millis["type"], "string", "{millis}");
    let rate = resolved(&whole, whole.pointer("/$defs/LidarSettings/properties/rate_hz").expect("a key")).clone();
    assert_eq!(rate["type"], "number", "{rate}");
}
