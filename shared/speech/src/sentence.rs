//! Everything that can be said.

use messages::stops::STOPS;
use messages::{CueKind, CueRefusal, ServiceId, StopKind, StopReason};
use settings::Verbosity;

/// What is neither a stop nor an answer to a cue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum News {
    /// A cue would be accepted now.
    Ready,
    /// A left cue is in force, and the robot has found nothing to turn into.
    NoLeftTurn,
    /// A right cue likewise.
    NoRightTurn,
    /// A left cue is in force, and whatever leads to the left is unsafe.
    LeftBlocked,
    /// A right cue likewise.
    RightBlocked,
    /// The robot's battery is low.
    BatteryLow,
    /// Another policy decides.
    PolicyChanged,
    /// The way has been blocked for long: the handler may choose another one.
    StillBlocked,
    /// The handler was asked to come behind the robot, which does not see them there.
    NotBehind,
    /// The robot no longer waits.
    GoingOn,
    /// The robot walks over floor that it has not seen.
    FloorAssumed,
    /// Nothing watches the floor in this run.
    FloorNotWatched,
}

impl News {
    /// Every one.
    pub const ALL: [Self; 12] = [
        Self::Ready,
        Self::NoLeftTurn,
        Self::NoRightTurn,
        Self::LeftBlocked,
        Self::RightBlocked,
        Self::BatteryLow,
        Self::PolicyChanged,
        Self::StillBlocked,
        Self::NotBehind,
        Self::GoingOn,
        Self::FloorAssumed,
        Self::FloorNotWatched,
    ];

    /// The name, as in language files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ready => "ready",
            Self::NoLeftTurn => "no_left_turn",
            Self::NoRightTurn => "no_right_turn",
            Self::LeftBlocked => "left_blocked",
            Self::RightBlocked => "right_blocked",
            Self::BatteryLow => "battery_low",
            Self::PolicyChanged => "policy_changed",
            Self::StillBlocked => "still_blocked",
            Self::NotBehind => "not_behind",
            Self::GoingOn => "going_on",
            Self::FloorAssumed => "floor_assumed",
            Self::FloorNotWatched => "floor_not_watched",
        }
    }
}

/// What is said, apart from the part that it is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Topic {
    /// A stop, or a hold.
    Stop(StopKind),
    /// A refused cue.
    Refusal(CueRefusal),
    /// An accepted cue.
    Cue(CueKind),
    /// Anything else.
    News(News),
    /// No words: the tone before motion.
    Tone,
}

/// One sentence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sentence {
    /// What is said.
    pub topic: Topic,
    /// The part that it is about; [`ServiceId::None`] where it is about none.
    pub part: ServiceId,
}

impl Sentence {
    /// Every topic that has words, those first that may not wait for a voice.
    pub fn topics() -> impl Iterator<Item = Topic> {
        let stops = STOPS.iter().map(|info| Topic::Stop(info.kind));
        let refusals = CueRefusal::ALL.into_iter().map(Topic::Refusal);
        let cues = [CueKind::Stop, CueKind::Forward, CueKind::Left, CueKind::Right].into_iter().map(Topic::Cue);
        stops.chain(refusals).chain(News::ALL.into_iter().map(Topic::News)).chain(cues)
    }

    /// Of a stop, by its reason.
    #[must_use]
    pub fn stop(reason: &StopReason) -> Self {
        Self { topic: Topic::Stop(reason.kind), part: part_of(reason) }
    }

    /// Of a refused cue, by the reason.
    #[must_use]
    pub fn refusal(refusal: CueRefusal, reason: &StopReason) -> Self {
        Self { topic: Topic::Refusal(refusal), part: part_of(reason) }
    }

    /// Of an accepted cue.
    #[must_use]
    pub fn cue(kind: CueKind) -> Self {
        Self { topic: Topic::Cue(kind), part: ServiceId::None }
    }

    /// Of news.
    #[must_use]
    pub fn news(news: News) -> Self {
        Self { topic: Topic::News(news), part: ServiceId::None }
    }

    /// The tone before motion.
    #[must_use]
    pub fn tone() -> Self {
        Self { topic: Topic::Tone, part: ServiceId::None }
    }

    /// From which verbosity on it is said.
    #[must_use]
    pub fn verbosity(&self) -> Verbosity {
        match self.topic {
            Topic::Stop(StopKind::Boot) | Topic::News(News::PolicyChanged | News::GoingOn) => Verbosity::All,
            Topic::Stop(StopKind::Resumed) | Topic::Cue(_) => Verbosity::Normal,
            Topic::Stop(_) | Topic::Refusal(_) | Topic::News(_) | Topic::Tone => Verbosity::Stops,
        }
    }
}

impl Topic {
    /// Table and key in a language file; of the tone, which stands in none, what is published as its text.
    #[must_use]
    pub fn key(self) -> (&'static str, &'static str) {
        match self {
            Self::Stop(kind) => ("stops", kind.name()),
            Self::Refusal(refusal) => ("refusals", refusal.name()),
            Self::Cue(kind) => ("cues", kind.name()),
            Self::News(news) => ("news", news.name()),
            Self::Tone => ("", "(tone)"),
        }
    }
}

/// The service that a reason is about: where it names only a stream, who gives it.
fn part_of(reason: &StopReason) -> ServiceId {
    let publisher = || reason.topic.spec().and_then(|spec| spec.publishers.first().copied()).unwrap_or_default();
    if reason.service == ServiceId::None { publisher() } else { reason.service }
}
