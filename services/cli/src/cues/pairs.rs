//! Two models that heard the same: where they differ, with intervals of 95 %.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::Outcome;
use crate::statistics::difference;

/// What two models made of the same recordings, in the same order: by word that is a cue and of all other words, how
/// often each alone was right, and the difference of the shares; and the alarms of each in streams.
pub fn report(these: &[Outcome], others: &[Outcome]) -> Value {
    let mut pairs: BTreeMap<&str, Vec<(bool, bool)>> = BTreeMap::new();
    let mut alarms = (0, 0);
    for (this, other) in these.iter().zip(others) {
        let name = match (this.what.word(), this.what.cue()) {
            (Some(word), Some(_)) => word,
            (Some(_), None) => "other words",
            (None, _) => {
                alarms = (alarms.0 + this.heard.len(), alarms.1 + other.heard.len());
                continue;
            }
        };
        pairs.entry(name).or_default().push((this.is_right(), other.is_right()));
    }
    let right: serde_json::Map<String, Value> =
        pairs.iter().map(|(name, pairs)| ((*name).to_owned(), difference(pairs))).collect();
    json!({ "right": right, "alarms": { "this": alarms.0, "other": alarms.1 } })
}
