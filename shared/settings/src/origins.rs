//! Where each value of the settings comes from.

use std::collections::BTreeMap;
use std::fmt;

use toml::de::{DeTable, DeValue};

/// Where a value comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeyOrigin {
    /// The file, or the words of the command line.
    pub layer: String,
    /// The line of the file.
    pub line: Option<usize>,
    /// Whether the operator has set it: not a file that is built in.
    pub is_operators: bool,
}

impl fmt::Display for KeyOrigin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.layer)?;
        self.line.map_or(Ok(()), |line| write!(f, ":{line}"))
    }
}

/// Where the values of the settings come from, by their keys, such as `lidar.rate_hz`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Origins(BTreeMap<String, KeyOrigin>);

impl Origins {
    /// Where the value of that key comes from; none where no layer names it: it is a default of the program.
    #[must_use]
    pub fn of(&self, key: &str) -> Option<&KeyOrigin> {
        self.0.get(key)
    }

    /// All that a file sets lies over what was there.
    pub(crate) fn lay_over(&mut self, layer: &str, text: &str, is_operators: bool) {
        // What cannot be read is told by whoever reads the values.
        let Ok(table) = DeTable::parse(text) else { return };
        for (key, at) in keys(table.get_ref()) {
            let line = text.get(..at).map(|before| 1 + before.matches('\n').count());
            self.0.insert(key, KeyOrigin { layer: layer.to_owned(), line, is_operators });
        }
    }

    /// What the command line sets with this TOML.
    pub(crate) fn set(&mut self, layer: &str, text: &str) {
        let mut set = Self::default();
        set.lay_over(layer, text, true);
        self.0.extend(set.0.into_iter().map(|(key, origin)| (key, KeyOrigin { line: None, ..origin })));
    }

    /// Of the keys that `reason` names, the first that the operator has set, else the first one of a `[section]` that
    /// it names: who is to mend it looks there.
    pub(crate) fn blamed(&self, reason: &str) -> Option<&KeyOrigin> {
        let is_part = |c: char| c.is_ascii_alphanumeric() || "._[]".contains(c);
        let words = || reason.split(|c: char| !is_part(c)).map(|word| word.trim_matches('.'));
        let operators = |key: &str| self.0.get(key).filter(|origin| origin.is_operators);
        words().find_map(operators).or_else(|| {
            let sections = words().filter_map(|word| word.strip_prefix('[')?.strip_suffix(']'));
            sections.into_iter().find_map(|section| {
                let below = format!("{section}.");
                let set = self.0.iter().find(|(key, origin)| origin.is_operators && key.starts_with(&below));
                set.map(|(_, origin)| origin)
            })
        })
    }
}

/// The keys of all values that are no tables, each with its place in the text.
fn keys(table: &DeTable<'_>) -> Vec<(String, usize)> {
    let mut all = Vec::new();
    for (key, value) in table {
        match value.get_ref() {
            DeValue::Table(below) => {
                all.extend(keys(below).into_iter().map(|(name, at)| (format!("{}.{name}", key.get_ref()), at)));
            }
            _ => all.push((key.get_ref().to_string(), key.span().start)),
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::Origins;

    #[test]
    fn the_uppermost_layer_that_names_a_key_is_its_origin() {
        let mut origins = Origins::default();
        origins.lay_over("shipped.toml", "[lidar]\nbeams = 3\nrate_hz = 5.0\n", false);
        origins.lay_over("mine.toml", "# mine\nlidar.rate_hz = 8.0\n[locomotion.unitree]\n\nprofile = \"x\"\n", true);
        let told = |key: &str| origins.of(key).map(ToString::to_string);
        assert_eq!(told("lidar.beams").as_deref(), Some("shipped.toml:2"));
        assert_eq!(told("lidar.rate_hz").as_deref(), Some("mine.toml:2"));
        assert_eq!(told("locomotion.unitree.profile").as_deref(), Some("mine.toml:5"));
        assert_eq!(told("lidar"), None);
        origins.set("--set lidar.beams=4", "lidar.beams = 4");
        assert_eq!(origins.of("lidar.beams").map(ToString::to_string).as_deref(), Some("--set lidar.beams=4"));
    }

    #[test]
    fn of_the_keys_that_a_reason_names_the_operators_is_blamed() {
        let mut origins = Origins::default();
        origins.lay_over("shipped.toml", "[lidar]\nbeams = 3\n[handler]\nalpha = 1.0\n", false);
        origins.lay_over("mine.toml", "[max_age]\nscan = \"1s\"\n[depth]\nwidth = 0\n", true);
        let blamed = |reason: &str| origins.blamed(reason).map(ToString::to_string);
        assert_eq!(blamed("lidar.beams is too much for max_age.scan.").as_deref(), Some("mine.toml:2"));
        assert_eq!(blamed("depth.width x depth.height = 0x64 is not within 1x1").as_deref(), Some("mine.toml:4"));
        assert_eq!(blamed("[depth]: no lens has that").as_deref(), Some("mine.toml:4"));
        assert_eq!(blamed("lidar.beams is too much for the depth").as_deref(), None);
        assert_eq!(blamed("[handler]: too far"), None);
    }
}
