//! Why a request is not done.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::framing::Abuse;

/// Why a request is not done. On the wire it is its words (`error`), and for those that a client acts on a code
/// (`refused`).
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// The client has no right to it: see [`crate::Right`].
    #[error("you may read how the run is, and not do that; its own user and root may")]
    NotPermitted,
    /// The client had to make room for another one. Nothing was asked, or nothing was done: ask again.
    #[error("idle for too long: another client came")]
    CrowdedOut,
    /// The client had to make room for another one. What it asked may be done.
    #[error("idle for too long: another client came")]
    AnswerLost,
    /// It is no request: what is wrong with it.
    #[error("bad request: {0}")]
    BadRequest(String),
    /// The client does not keep to the framing, and is let go.
    #[error(transparent)]
    Abuse(Abuse),
    /// A stop came with it, and nothing undoes a stop that came with it.
    #[error("overtaken by a stop")]
    Overtaken,
    /// It waited for a supervisor that slept, and was meant for another moment.
    #[error("the supervisor slept; say it again")]
    Slept,
    /// There is no lock to end.
    #[error("the run is not locked")]
    NotLocked,
    /// The cue would not be taken: why.
    #[error("cue refused: {0}")]
    Cue(String),
    /// The policy is not swapped: why.
    #[error("refused: {0}")]
    Swap(String),
    /// The fault would do nothing, or may not be: why.
    #[error("fault refused: {0}")]
    Fault(String),
    /// A recording is under way.
    #[error("the run is being recorded already")]
    RecordedAlready,
    /// There is no recording to end.
    #[error("the run is not being recorded")]
    NotRecorded,
    /// The supervisor works in a folder of its own: a path that is not absolute leads elsewhere.
    #[error("the recording's path is not absolute")]
    RelativePath,
    /// The run directory does not take the order to record: why.
    #[error("{0}")]
    NoOrder(String),
    /// Read from the wire: any of those without a code, or one that this program does not know, in its words.
    #[error("{0}")]
    Told(String),
}

/// Those that a client acts on, by their codes.
const CODES: [(Refusal, &str); 3] = [
    (Refusal::NotPermitted, "not_permitted"),
    (Refusal::CrowdedOut, "crowded_out"),
    (Refusal::AnswerLost, "answer_lost"),
];

#[derive(Serialize, Deserialize)]
struct OnTheWire {
    error: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    refused: Option<String>,
}

impl Serialize for Refusal {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let code = CODES.iter().find(|(refusal, _)| refusal == self).map(|(_, code)| (*code).to_owned());
        OnTheWire { error: self.to_string(), refused: code }.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Refusal {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let OnTheWire { error, refused } = OnTheWire::deserialize(deserializer)?;
        let known = CODES.into_iter().find(|(_, code)| refused.as_deref() == Some(code));
        Ok(known.map_or(Self::Told(error), |(refusal, _)| refusal))
    }
}

#[cfg(test)]
mod tests {
    use super::Refusal;
    use crate::framing::{Abuse, line};

    /// As every supervisor has told them.
    #[test]
    fn refusals_are_told_to_the_byte_as_ever_and_read_by_their_codes() {
        let why = || "why".to_owned();
        for (refusal, told) in [
            (
                Refusal::NotPermitted,
                concat!(
                    r#"{"error":"you may read how the run is, and not do that; its own user and root may","#,
                    r#""refused":"not_permitted"}"#
                ),
            ),
            (Refusal::CrowdedOut, r#"{"error":"idle for too long: another client came","refused":"crowded_out"}"#),
            (Refusal::AnswerLost, r#"{"error":"idle for too long: another client came","refused":"answer_lost"}"#),
            (Refusal::BadRequest(why()), r#"{"error":"bad request: why"}"#),
            (Refusal::Abuse(Abuse::TooLong), r#"{"error":"a request of over 4096 bytes"}"#),
            (Refusal::Abuse(Abuse::TooMany), r#"{"error":"over 4 requests at once"}"#),
            (Refusal::Overtaken, r#"{"error":"overtaken by a stop"}"#),
            (Refusal::Slept, r#"{"error":"the supervisor slept; say it again"}"#),
            (Refusal::NotLocked, r#"{"error":"the run is not locked"}"#),
            (Refusal::Cue(why()), r#"{"error":"cue refused: why"}"#),
            (Refusal::Swap(why()), r#"{"error":"refused: why"}"#),
            (Refusal::Fault(why()), r#"{"error":"fault refused: why"}"#),
            (Refusal::RecordedAlready, r#"{"error":"the run is being recorded already"}"#),
            (Refusal::NotRecorded, r#"{"error":"the run is not being recorded"}"#),
            (Refusal::RelativePath, r#"{"error":"the recording's path is not absolute"}"#),
            (Refusal::NoOrder(why()), r#"{"error":"why"}"#),
        ] {
            assert_eq!(line(&refusal).expect("JSON").trim_end(), told);
            let read: Refusal = serde_json::from_str(told).expect("a refusal");
            let has_code = told.contains("refused\":");
            assert_eq!(read, if has_code { refusal } else { Refusal::Told(refusal.to_string()) });
        }
    }

    #[test]
    fn a_code_of_a_later_supervisor_is_told_in_its_words() {
        let read: Refusal =
            serde_json::from_str(r#"{"error":"not today","refused":"holiday","until":"Monday"}"#).expect("a refusal");
        assert_eq!(read, Refusal::Told("not today".to_owned()));
    }
}
