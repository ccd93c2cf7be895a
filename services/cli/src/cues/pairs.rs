//! Two models that heard the same: where they differ, with intervals of 95 %.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::Outcome;
use super::figures::Counts;
use crate::statistics::difference;

/// What two models made of the same recordings, in the same order: by word that is a cue and of all other words, how
/// often each alone was right, and the difference of the shares; the same of starts from standing; and all that the
/// other model alone came to.
pub fn report(these: &[Outcome], others: &[Outcome]) -> Value {
    let mut pairs: BTreeMap<&str, Vec<(bool, bool)>> = BTreeMap::new();
    let mut starts = Vec::new();
    for (this, other) in these.iter().zip(others) {
        let name = match (this.what.word(), this.what.cue()) {
            (Some(word), Some(_)) => word,
            (Some(_), None) => "other words",
            (None, _) => continue,
        };
        starts.extend(this.from_standing.zip(other.from_standing));
        pairs.entry(name).or_default().push((this.is_right(), other.is_right()));
    }
    let right: serde_json::Map<String, Value> =
        pairs.iter().map(|(name, pairs)| ((*name).to_owned(), difference(pairs))).collect();
    json!({ "right": right, "from_standing": difference(&starts), "other": Counts::of(others).report() })
}
