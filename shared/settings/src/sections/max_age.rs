//! How old an input may be for motion. The topic table says which key is whose; no other place pairs the two.

use messages::TopicId;
use messages::topic::{AgeLimit, TOPICS};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Settings;
use crate::units::Millis;

/// Declares `[max_age]`: its keys, which are those of the topic table.
macro_rules! max_age {
    ($($(#[doc = $doc:literal])+ $key:ident,)+) => {
        /// How old an input may be for motion.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct MaxAge {
            $($(#[doc = $doc])+ $key: Millis,)+
        }

        impl Default for MaxAge {
            fn default() -> Self {
                Self { $($key: default_of(stringify!($key)),)+ }
            }
        }

        impl MaxAge {
            fn of(&self, key: &str) -> Option<Millis> {
                match key {
                    $(stringify!($key) => Some(self.$key),)+
                    _ => None,
                }
            }
        }
    };
}

max_age! {
    /// Of scans.
    scan,
    /// Of the second lidar's scans, where there is one.
    second_scan,
    /// Of depth frames, where they are needed.
    depth,
    /// Of odometry.
    odometry,
    /// Of a cue, to be accepted.
    cue,
    /// Of the mode.
    mode,
    /// Of the emergency stop's word, where there is one.
    estop,
}

fn default_of(key: &str) -> Millis {
    let default_ms = TOPICS.iter().find_map(|spec| match spec.max_age {
        AgeLimit::Configured { key: its, default_ms, .. } if its == key => Some(default_ms),
        _ => None,
    });
    Millis::of_ms(default_ms.unwrap_or_default())
}

impl Settings {
    /// How old the newest message of a topic may be for motion, nanoseconds. It is 0 where the topic table sets no such
    /// limit: who asks then takes every message for too old, and the robot stands.
    #[must_use]
    pub fn max_age_ns(&self, topic: TopicId) -> u64 {
        match topic.spec().map(|spec| spec.max_age) {
            Some(AgeLimit::Configured { key, .. }) => self.max_age.of(key).map_or(0, Millis::ns),
            Some(AgeLimit::Decision) => self.policy.dt.ns() * 3 / 2,
            Some(AgeLimit::Unlimited | AgeLimit::Expiry | AgeLimit::Beat) | None => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{AgeLimit, Settings, TOPICS};
    use std::collections::BTreeSet;

    #[test]
    fn the_keys_are_those_of_the_topic_table_and_each_is_its_topics() {
        let mut keys = BTreeSet::new();
        for spec in TOPICS {
            let AgeLimit::Configured { key, default_ms, .. } = spec.max_age else { continue };
            assert!(keys.insert(key.to_owned()), "{key} is the key of two topics");
            assert_eq!(Settings::default().max_age_ns(spec.id), default_ms * 1_000_000, "{key}");
            let changed: Settings = toml::from_str(&format!("[max_age]\n{key} = \"7ms\"\n")).expect("a key");
            assert_eq!(changed.max_age_ns(spec.id), 7_000_000, "{key}");
        }
        let written = toml::Table::try_from(Settings::default().max_age).expect("settings can be written");
        assert_eq!(written.into_iter().map(|(key, _)| key).collect::<BTreeSet<_>>(), keys);
    }
}
