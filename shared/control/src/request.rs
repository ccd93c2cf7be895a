//! What an operator asks, and the right that it needs.

use std::path::PathBuf;

use messages::CueKind;
use serde::{Deserialize, Serialize};

use crate::Refusal;

/// What an operator asks.
///
/// A request with a member that its verb does not have is refused: what the operator meant by it must not be left out
/// in silence. The braces of the verbs without members see to that, for `serde` lets a unit variant have any. A stop is
/// a unit variant: it must be obeyed whatever else a client of another version says with it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "verb", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Mode, services, the walk so far.
    Status {},
    /// The last stops, with evidence.
    Why {},
    /// A cue for the handler.
    Cue {
        /// Which.
        cue: CueKind,
    },
    /// The robot is to stand, and stay.
    Stop,
    /// Out of a lock.
    Resume {},
    /// The run is to be recorded from now on.
    Record {
        /// The recording, absolute.
        path: PathBuf,
    },
    /// The recording is to end.
    RecordStop {},
    /// Another policy is to be swapped in.
    PolicySwap {
        /// Another executable in place of `guidedog-policy`, its path absolute.
        exe: Option<PathBuf>,
        /// The model to load: the name of one that is built in, or a file's path, absolute.
        model: Option<PathBuf>,
    },
    /// Back to the policy before.
    PolicyRollback {},
    /// The policy in force, and the last swaps.
    PolicyShow {},
    /// A fault is injected, or mended, in a run that allows it.
    Inject {
        /// A stream, a service, or the host, by name.
        target: String,
        /// Which fault, by name; "none" mends the target.
        fault: String,
        /// How long it lasts, milliseconds of run time; without it, until it is mended.
        #[serde(default)]
        for_ms: Option<u64>,
        /// Seed of what is random about it.
        #[serde(default)]
        seed: Option<u64>,
    },
    /// The run is to end.
    Quit {},
}

/// What a client may do, and what a request needs. In this order: who may change may read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Right {
    /// Ask how things are.
    Read,
    /// Have the robot walk or stand, and end the run.
    Change,
    /// Have a program run as the run's own user.
    Own,
}

impl Request {
    /// The request that a line is.
    ///
    /// # Errors
    /// [`Refusal::BadRequest`], which says what is wrong with it.
    pub fn parse(line: &[u8]) -> Result<Self, Refusal> {
        serde_json::from_slice(line).map_err(|error| Refusal::BadRequest(error.to_string()))
    }

    /// Its verb, as on the wire.
    #[must_use]
    pub fn verb(&self) -> String {
        let written = serde_json::to_value(self).unwrap_or_default();
        written["verb"].as_str().unwrap_or_default().to_owned()
    }

    /// The right that it needs.
    #[must_use]
    pub const fn needs(&self) -> Right {
        match self {
            Self::Status {} | Self::Why {} | Self::PolicyShow {} => Right::Read,
            Self::Cue { .. } | Self::Stop | Self::Resume {} | Self::Quit {} => Right::Change,
            // They start programs, or write files, with the rights of the run.
            Self::PolicySwap { .. }
            | Self::PolicyRollback {}
            | Self::Record { .. }
            | Self::RecordStop {}
            | Self::Inject { .. } => Right::Own,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Request, Right};
    use crate::Refusal;
    use messages::CueKind;

    #[test]
    fn a_request_is_exactly_what_it_may_be() {
        assert_eq!(Request::parse(br#"{"verb":"cue","cue":"left"}"#), Ok(Request::Cue { cue: CueKind::Left }));
        for bad in [
            r#"{"verb":"fly"}"#,
            r#"{"verb":"cue","cue":"up"}"#,
            "",
            "[]",
            r#"{"verb":"cue"}"#,
            r#"{"verb":"cue","cue":"left","soon":true}"#,
        ] {
            assert!(matches!(Request::parse(bad.as_bytes()), Err(Refusal::BadRequest(_))), "{bad}");
        }
    }

    #[test]
    fn a_request_is_read_as_it_was_written_and_as_clients_have_always_written_it() {
        let swap = |model: Option<&str>| Request::PolicySwap { exe: None, model: model.map(Into::into) };
        let inject = |for_ms, seed| Request::Inject { target: "host".into(), fault: "full_disk".into(), for_ms, seed };
        for (line, request) in [
            (r#"{"verb":"status"}"#, Request::Status {}),
            (r#"{"verb":"why"}"#, Request::Why {}),
            (r#"{"cue":"forward","verb":"cue"}"#, Request::Cue { cue: CueKind::Forward }),
            (r#"{"verb":"stop"}"#, Request::Stop),
            (r#"{"verb":"resume"}"#, Request::Resume {}),
            (r#"{"path":"/tmp/a.mcap","verb":"record"}"#, Request::Record { path: "/tmp/a.mcap".into() }),
            (r#"{"verb":"record_stop"}"#, Request::RecordStop {}),
            (r#"{"exe":null,"model":"geometric","verb":"policy_swap"}"#, swap(Some("geometric"))),
            (r#"{"verb":"policy_swap"}"#, swap(None)),
            (r#"{"verb":"policy_rollback"}"#, Request::PolicyRollback {}),
            (r#"{"verb":"policy_show"}"#, Request::PolicyShow {}),
            (r#"{"fault":"full_disk","target":"host","verb":"inject"}"#, inject(None, None)),
            (
                r#"{"fault":"full_disk","for_ms":1500,"seed":3,"target":"host","verb":"inject"}"#,
                inject(Some(1500), Some(3)),
            ),
            (r#"{"verb":"quit"}"#, Request::Quit {}),
        ] {
            assert_eq!(Request::parse(line.as_bytes()), Ok(request.clone()), "{line}");
            let written = serde_json::to_vec(&request).expect("JSON");
            assert_eq!(Request::parse(&written), Ok(request.clone()));
            // In both places: before the verb is known, and after.
            for more in [line.replacen('{', "{\"after\":\"10s\",", 1), line.replace('}', ",\"after\":\"10s\"}")] {
                let read = Request::parse(more.as_bytes());
                match request {
                    Request::Stop => assert_eq!(read, Ok(Request::Stop), "{more}: a stop is obeyed all the same"),
                    _ => assert!(matches!(read, Err(Refusal::BadRequest(_))), "{more}: {read:?}"),
                }
            }
        }
    }

    #[test]
    fn reading_is_not_changing_and_changing_runs_no_program() {
        assert!(Right::Read < Right::Change && Right::Change < Right::Own);
        for (verb, needs) in [
            ("status", Right::Read),
            ("why", Right::Read),
            ("policy_show", Right::Read),
            ("stop", Right::Change),
            ("resume", Right::Change),
            ("quit", Right::Change),
            ("record_stop", Right::Own),
            ("policy_rollback", Right::Own),
        ] {
            let request = Request::parse(format!("{{\"verb\":\"{verb}\"}}").as_bytes()).expect("a request");
            assert_eq!(request.needs(), needs, "{verb}");
        }
    }
}
