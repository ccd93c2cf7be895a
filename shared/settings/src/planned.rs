//! What is planned to happen in a run: what an operator would ask for, at a given run time.

use messages::CueKind;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::units::Millis;
use crate::{ConfigPath, PolicyModel, Settings};

/// One thing that is planned. In stepped time it happens in the very step of that time, the same in every run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Planned {
    /// Run time.
    pub at: Millis,
    /// What.
    pub ask: Ask,
}

/// What can be planned: what can be asked over the control socket, and changes the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "verb", rename_all = "snake_case", deny_unknown_fields)]
pub enum Ask {
    /// A cue for the handler.
    Cue {
        /// Which.
        #[schemars(with = "String")]
        cue: CueKind,
    },
    /// The operator's stop.
    Stop {},
    /// Out of a lock.
    Resume {},
    /// Another policy is to be swapped in.
    PolicySwap {
        /// Another executable in place of `guidedog-policy`.
        exe: Option<ConfigPath>,
        /// The model to load.
        model: Option<PolicyModel>,
    },
    /// Back to the policy before.
    PolicyRollback {},
    /// A fault is injected, or mended.
    Inject {
        /// A stream, a service, or the host, by name.
        target: String,
        /// Which fault, by name; "none" mends the target.
        fault: String,
        /// How long it lasts; without it, until it is mended.
        #[serde(rename = "for", skip_serializing_if = "Option::is_none")]
        lasts: Option<Millis>,
        /// Seed of what is random about it.
        #[serde(skip_serializing_if = "Option::is_none")]
        seed: Option<u64>,
    },
}

impl Settings {
    /// Whether faults are planned, in a run that may allow none.
    #[must_use]
    pub fn plans_faults(&self) -> bool {
        self.planned.iter().any(|planned| matches!(planned.ask, Ask::Inject { .. }))
    }
}

/// What is planned and cannot be; the reason begins with the key.
pub(crate) fn check(settings: &Settings) -> Result<(), String> {
    for (i, Planned { ask, .. }) in settings.planned.iter().enumerate() {
        let wrong = |why: String| format!("planned[{i}]: {why}");
        match ask {
            Ask::PolicySwap { exe: None, model: None } => {
                return Err(wrong("neither an executable nor a model is named".to_owned()));
            }
            Ask::Cue { .. } | Ask::Resume {} if settings.commands_robot() => {
                return Err(wrong(
                    "nothing but the handler or the operator starts a real robot, and locomotion.link \
                                  commands one"
                        .to_owned(),
                ));
            }
            Ask::Inject { target, fault, .. } => {
                messages::fault::parse(target, fault).map_err(wrong)?;
            }
            _ => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::{Ask, Settings};

    #[test]
    fn a_plan_is_written_as_it_was_read() {
        let text = r#"
            [[planned]]
            at = "1.5s"
            ask = { verb = "inject", target = "lidar/scan", fault = "off", for = "2s" }
            [[planned]]
            at = "2s"
            ask = { verb = "stop" }
        "#;
        let settings: Settings = toml::from_str(text).expect("a plan");
        assert_eq!(super::check(&settings), Ok(()));
        assert_eq!((settings.planned.len(), &settings.planned[1].ask), (2, &Ask::Stop {}));
        let written = toml::to_string(&settings).expect("settings can be written");
        assert_eq!(toml::from_str::<Settings>(&written).expect("and read"), settings);
    }

    #[test]
    fn what_cannot_be_planned_is_told_with_its_number() {
        for (ask, why) in [
            ("verb = \"inject\", target = \"lidar\", fault = \"off\"", "planned[0]: lidar can be kill"),
            ("verb = \"policy_swap\"", "planned[0]: neither"),
        ] {
            let text = format!("[[planned]]\nat = \"1s\"\nask = {{ {ask} }}\n");
            let settings: Settings = toml::from_str(&text).expect("each key by itself is right");
            assert!(super::check(&settings).is_err_and(|told| told.contains(why)), "{ask}");
        }
        assert!(toml::from_str::<Settings>("[[planned]]\nat = \"1s\"\nask = { verb = \"quit\" }\n").is_err());
    }

    #[test]
    fn what_a_verb_does_not_know_is_refused() {
        for verb in ["stop", "resume", "policy_rollback"] {
            let text = format!("[[planned]]\nat = \"1s\"\nask = {{ verb = \"{verb}\", after = \"10s\" }}\n");
            let refused = toml::from_str::<Settings>(&text).expect_err("it has no such key").to_string();
            assert!(refused.contains("after"), "{verb}: {refused}");
        }
    }
}
