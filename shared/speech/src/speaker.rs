//! What is to be said now: what happens goes in, with its time, and sentences come out, the most urgent first.
//!
//! One sentence is heard at a time. What is more urgent cuts it short, and so does another stop or lock; another reason
//! within a stop lets it say the half of it that tells which part is lost. What else is of the same urgency waits, and
//! of most kinds only the newest does, so that nothing is told that is over.

use std::collections::VecDeque;

use guidance::cue::CueTrack;
use guidance::se2::se2;
use messages::{
    CueAnswer, CueHeard, CueKind, CueRefusal, CueSource, Formation, LocomotionState, Mode, ModeClass, NS_PER_S,
    Odometry, Outcome, Permit, StopKind, StopReason, Urgency,
};
use settings::{Settings, Verbosity};

use crate::sentence::{News, Sentence, Topic};

/// After so long a wait, the handler is asked for another way.
const LONG_NS: u64 = 30 * NS_PER_S;
/// Within a stop the same reason is no news for so long.
const STOP_AGAIN_NS: u64 = 5 * NS_PER_S;
/// A robot that holds, goes and holds again tells it once in so long; so it does where the reason changes meanwhile.
const HOLD_AGAIN_NS: u64 = 4 * NS_PER_S;
/// Another reason within a stop leaves a sentence so much time: it is told within a second all the same.
const LEFT_TO_SAY_NS: u64 = NS_PER_S * 4 / 5;
/// The same refusal: who says a cue twice a second is not answered each time.
const REFUSAL_AGAIN_NS: u64 = 2 * NS_PER_S;
/// A battery that is low is told again after so long.
const BATTERY_AGAIN_NS: u64 = 300 * NS_PER_S;
/// States in a row that tell of a low battery, half a second of them, are no garbled one.
const LOW_STATES: u32 = 25;
/// Ready for a cue means so for a moment.
const READY_AFTER_NS: u64 = NS_PER_S / 5;
/// Who was not ready for so long tells it anew.
const UNREADY_NS: u64 = NS_PER_S;
/// What waits for longer is no longer worth saying.
const NEWS_WAITS_NS: u64 = 5 * NS_PER_S;
/// A tone that is later than this is of no use: the cue grows old.
const TONE_WAITS_NS: u64 = NS_PER_S / 5;
/// A stop that could not be heard is told again after so long: a sound card may just have come back.
const UNHEARD_AGAIN_NS: u64 = NS_PER_S;
/// Stops within a stop that may wait to be told.
const STOPS_WAITING: usize = 3;
/// Sentences of which it is remembered when they were told.
const REMEMBERED: usize = 32;

/// How much is said, and when.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SpeakerConfig {
    /// How much.
    pub verbosity: Verbosity,
    /// A hold is told once it has lasted for so long, nanoseconds.
    pub hold_after_ns: u64,
    /// And again every so often, nanoseconds.
    pub remind_ns: u64,
    /// At this charge the battery is low, percent.
    pub charge_warn_percent: u32,
    /// Something watches the floor.
    pub watches_floor: bool,
    /// Actions that lead to the left: bit *i* is action *i* of the table.
    pub left_actions: u32,
    /// Actions that lead to the right likewise.
    pub right_actions: u32,
}

impl SpeakerConfig {
    /// Of a run with these settings.
    #[must_use]
    pub fn of(settings: &Settings) -> Self {
        let (speak, table) = (&settings.speak, settings.policy.actions.table());
        let to_side = |side: f64| {
            let leads = |motion: messages::Pose2| motion.y_m * side > 0.0 || motion.yaw_rad * side > 0.0;
            let actions = table.actions().iter().enumerate().filter(|(_, action)| leads(action.motion));
            actions.fold(0, |mask, (i, _)| mask | 1 << i)
        };
        Self {
            verbosity: speak.verbosity,
            hold_after_ns: speak.hold_after.ns(),
            remind_ns: speak.remind.ns(),
            charge_warn_percent: u32::from(settings.locomotion.charge_warn_percent),
            watches_floor: settings.watches_floor(),
            left_actions: to_side(1.0),
            right_actions: to_side(-1.0),
        }
    }
}

/// A sentence that is to be said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Utterance {
    /// What.
    pub sentence: Sentence,
    /// How urgent it is.
    pub urgency: Urgency,
    /// Run time of what it tells of, nanoseconds.
    pub about_ns: u64,
    /// The stop that it tells of, if any.
    pub reason: StopReason,
}

#[derive(Debug, Clone, Copy)]
struct Waiting {
    utterance: Utterance,
    until_ns: u64,
    /// It cuts short what is as urgent and has been said for so long, nanoseconds.
    breaks_in_after_ns: u64,
}

/// What is being said.
#[derive(Debug, Clone, Copy)]
struct Speaking {
    urgency: Urgency,
    since_ns: u64,
    /// It is over what it tells of: anything may cut it short.
    is_over: bool,
}

/// A stop within run.
#[derive(Debug, Clone, Copy)]
struct Hold {
    sentence: Sentence,
    /// Run time of its first state, nanoseconds; and of the first with that sentence.
    since_ns: u64,
    sentence_since_ns: u64,
    /// When it was told last, and what.
    told: Option<(u64, Sentence)>,
}

impl Hold {
    /// Whether its sentence was told since it began to be true.
    fn is_told(&self) -> bool {
        self.told.is_some_and(|(at_ns, what)| what == self.sentence && at_ns >= self.sentence_since_ns)
    }
}

/// Decides what is said. Every time is run time, nanoseconds.
#[derive(Debug)]
pub struct Speaker {
    config: SpeakerConfig,
    mode: Option<Mode>,
    /// The way since the cue in force, by its incarnation and seq.
    track: ((u32, u64), CueTrack),
    unsafe_mask: u32,
    waiting: Vec<Waiting>,
    speaking: Option<Speaking>,
    /// What could not be heard, and when it is told again, if it was not yet.
    again: Option<(Utterance, Option<u64>)>,
    told: VecDeque<(Sentence, u64)>,
    hold: Option<Hold>,
    /// Since when a cue would be accepted, or would not; and whether that was told.
    ready: (bool, u64),
    ready_told: bool,
    low_states: u32,
    /// What was told of the floor: once in a run.
    floor_told: bool,
}

impl Speaker {
    /// One that knows nothing yet, and is silent.
    #[must_use]
    pub fn new(config: SpeakerConfig) -> Self {
        Self {
            config,
            mode: None,
            track: ((0, 0), CueTrack::default()),
            unsafe_mask: 0,
            waiting: Vec::new(),
            speaking: None,
            again: None,
            told: VecDeque::new(),
            hold: None,
            ready: (false, 0),
            ready_told: false,
            low_states: 0,
            floor_told: false,
        }
    }

    /// A mode has come.
    pub fn mode(&mut self, mode: &Mode, now_ns: u64) {
        let old = self.mode.replace(*mode);
        let was = old.map(|old| (old.class, old.epoch));
        if mode.class != ModeClass::Run {
            if was != Some((mode.class, mode.epoch)) {
                self.stop_begins(mode, old.as_ref(), now_ns);
            }
        } else if was.is_some_and(|(class, _)| class != ModeClass::Run) {
            self.stop_is_over();
        } else if let Some(before) = old.map(|old| old.active_policy)
            && before != 0
            && before != mode.active_policy
        {
            self.news(News::PolicyChanged, now_ns);
        }
        let ready = mode.class == ModeClass::Fault && mode.ready_for_cue;
        if ready != self.ready.0 {
            self.ready = (ready, now_ns);
        }
        if !ready {
            self.drop_waiting(|topic| topic == Topic::News(News::Ready));
        }
    }

    fn stop_begins(&mut self, mode: &Mode, old: Option<&Mode>, now_ns: u64) {
        self.hold = None;
        self.ready_told = false;
        let sentence = Sentence::stop(&mode.reason);
        let is_another = old.is_none_or(|old| old.class != mode.class);
        let is_lock = mode.class == ModeClass::Lock;
        let same_reason = old.is_some_and(|old| old.reason.kind == mode.reason.kind);
        // A fault within a lock raises the epoch and changes nothing for who waits.
        if !is_another && (is_lock && same_reason || self.was_told(&sentence, STOP_AGAIN_NS, now_ns)) {
            return;
        }
        let is_news = matches!(mode.reason.kind, StopKind::Boot | StopKind::Resumed);
        let breaks_in = (is_another || is_lock) && !is_news;
        self.waiting.retain(|waiting| match waiting.utterance.urgency {
            Urgency::Warning => true,
            Urgency::Stop => !breaks_in,
            _ => false,
        });
        let urgency = if is_news { Urgency::News } else { Urgency::Stop };
        let until_ns = if is_news { now_ns + NEWS_WAITS_NS } else { u64::MAX };
        let utterance = Utterance { sentence, urgency, about_ns: mode.header.stamp_ns, reason: mode.reason };
        let breaks_in_after_ns = if breaks_in { 0 } else { LEFT_TO_SAY_NS };
        self.add(Waiting { utterance, until_ns, breaks_in_after_ns }, now_ns);
    }

    /// The robot may walk again: nobody needs to hear why it could not.
    fn stop_is_over(&mut self) {
        self.drop_urgency(Urgency::Stop);
        self.drop_waiting(|topic| topic == Topic::News(News::Ready));
    }

    /// The supervisor answered a cue. That of a done turn is nobody's who wants an answer.
    pub fn answer(&mut self, answer: &CueAnswer, now_ns: u64) {
        let about_ns = answer.header.stamp_ns;
        let until_ns = now_ns + NEWS_WAITS_NS;
        if answer.source == CueSource::TurnDone {
            return;
        }
        let (sentence, urgency) = if answer.refusal == CueRefusal::None {
            (Sentence::cue(answer.kind), Urgency::News)
        } else {
            let sentence = Sentence::refusal(answer.refusal, &answer.reason);
            if self.was_told(&sentence, REFUSAL_AGAIN_NS, now_ns) {
                return;
            }
            (sentence, Urgency::Refusal)
        };
        // Of answers only the newest is of interest.
        self.drop_waiting(|topic| matches!(topic, Topic::Cue(_) | Topic::Refusal(_)));
        let utterance = Utterance { sentence, urgency, about_ns, reason: StopReason::default() };
        self.add(Waiting { utterance, until_ns, breaks_in_after_ns: u64::MAX }, now_ns);
    }

    /// A cue was heard that would start the robot: nothing of less urgency delays its tone, and it comes at once or not
    /// at all.
    pub fn heard(&mut self, heard: &CueHeard, now_ns: u64) {
        let (sentence, urgency, reason) = (Sentence::tone(), Urgency::Tone, StopReason::default());
        let utterance = Utterance { sentence, urgency, about_ns: heard.header.stamp_ns, reason };
        self.add(Waiting { utterance, until_ns: now_ns + TONE_WAITS_NS, breaks_in_after_ns: u64::MAX }, now_ns);
    }

    /// The shield's verdict has come.
    pub fn permit(&mut self, permit: &Permit, now_ns: u64) {
        self.unsafe_mask = permit.unsafe_mask;
        if permit.outcome == Outcome::Granted && permit.assumes_floor {
            self.tell_of_floor(News::FloorAssumed, now_ns);
        }
    }

    fn tell_of_floor(&mut self, news: News, now_ns: u64) {
        if !self.floor_told && !self.waits(Topic::News(news)) {
            self.news(news, now_ns);
        }
    }

    /// Odometry has come.
    pub fn odometry(&mut self, odometry: &Odometry) {
        let Some(cue) = self.mode.filter(|mode| mode.cue.valid).map(|mode| mode.cue.cue) else { return };
        let id = (cue.header.incarnation, cue.header.seq);
        if self.track.0 != id {
            self.track = (id, CueTrack::default());
        }
        if cue.odometry_incarnation == odometry.header.incarnation {
            self.track.1.observe(&(se2(cue.odom_from_start).inverse() * se2(odometry.odom_from_robot)));
        }
    }

    /// What locomotion does.
    pub fn state(&mut self, state: &LocomotionState, now_ns: u64) {
        self.judge_battery(state, now_ns);
        let Some(mode) = self.mode else { return };
        if !self.config.watches_floor && (self.ready_told || mode.class == ModeClass::Run) {
            self.tell_of_floor(News::FloorNotWatched, now_ns);
        }
        let asked = mode.class == ModeClass::Run && mode.cue.valid && state.epoch == mode.epoch;
        let (stands, kind) = (state.applied.is_zero(), state.limited_by.kind);
        if !(asked && stands && kind.holds_a_cue() && kind != StopKind::StopCue) {
            // "Going on" would lead a handler ahead who has to step back.
            let step_back = Topic::Stop(StopKind::StepBack);
            let told = self.hold.take().and_then(|hold| hold.told).is_some_and(|(_, what)| what.topic != step_back);
            self.drop_urgency(Urgency::Hold);
            if told && asked && !stands {
                self.news(News::GoingOn, now_ns);
            }
            return;
        }
        let stamp_ns = state.header.stamp_ns;
        let is_long = self.hold.is_some_and(|hold| now_ns.saturating_sub(hold.since_ns) >= LONG_NS);
        let is_blocked = matches!(kind, StopKind::AllUnsafe | StopKind::RemainderUnsafe);
        let sentence = match is_long && is_blocked {
            true => Sentence::news(News::StillBlocked),
            false => self.hold_sentence(&mode, state),
        };
        let first = Hold { sentence, since_ns: stamp_ns, sentence_since_ns: stamp_ns, told: None };
        let hold = self.hold.get_or_insert(first);
        if hold.sentence != sentence {
            (hold.sentence, hold.sentence_since_ns) = (sentence, stamp_ns);
        }
        let hold = *hold;
        let lasted = |since_ns: u64| now_ns.saturating_sub(since_ns) >= self.config.hold_after_ns;
        // Shield and supervisor wait only so long: what the handler is to do is told at once, and each time.
        let is_asked = matches!(kind, StopKind::StepBack | StopKind::Narrow | StopKind::Wide);
        let (due, about_ns) = match hold.told {
            _ if is_asked && !hold.is_told() => (lasted(hold.sentence_since_ns), hold.sentence_since_ns),
            None => (lasted(hold.since_ns) && !self.was_told(&sentence, HOLD_AGAIN_NS, now_ns), hold.since_ns),
            Some((at_ns, _)) if now_ns >= at_ns + self.config.remind_ns => (true, now_ns),
            Some((at_ns, what)) => {
                let changed = what != sentence && lasted(hold.sentence_since_ns) && now_ns >= at_ns + HOLD_AGAIN_NS;
                (changed, hold.sentence_since_ns)
            }
        };
        if due {
            self.hold = Some(Hold { told: Some((now_ns, sentence)), ..hold });
            self.drop_waiting_urgency(Urgency::Hold);
            let utterance = Utterance { sentence, urgency: Urgency::Hold, about_ns, reason: state.limited_by };
            let breaks_in_after_ns = if is_asked { 0 } else { u64::MAX };
            self.add(Waiting { utterance, until_ns: u64::MAX, breaks_in_after_ns }, now_ns);
        }
    }

    /// A policy that stands where it was to turn has found nothing to turn into, or must not. A handler who is missed
    /// behind the robot is told to come there.
    fn hold_sentence(&self, mode: &Mode, state: &LocomotionState) -> Sentence {
        let cue = &mode.cue.cue;
        let (actions, blocked, missed) = match cue.kind {
            CueKind::Left => (self.config.left_actions, News::LeftBlocked, News::NoLeftTurn),
            CueKind::Right => (self.config.right_actions, News::RightBlocked, News::NoRightTurn),
            CueKind::Stop | CueKind::Forward => (0, News::GoingOn, News::GoingOn),
        };
        let is_its_track = self.track.0 == (cue.header.incarnation, cue.header.seq);
        match state.limited_by.kind {
            StopKind::PolicyStop | StopKind::AllUnsafe if is_its_track && self.track.1.turn_missed(cue.kind) => {
                Sentence::news(missed)
            }
            // A handler beside the robot holds the handle: it has to tell them where it looks.
            StopKind::HandlerNotSeen if mode.formation == Formation::Behind => Sentence::news(News::NotBehind),
            StopKind::PolicyStop if actions != 0 && self.unsafe_mask & actions == actions => Sentence::news(blocked),
            _ => Sentence::stop(&state.limited_by),
        }
    }

    fn judge_battery(&mut self, state: &LocomotionState, now_ns: u64) {
        let low = (1..=self.config.charge_warn_percent).contains(&state.charge_percent);
        self.low_states = if low { self.low_states.saturating_add(1) } else { 0 };
        let sentence = Sentence::news(News::BatteryLow);
        if self.low_states >= LOW_STATES && !self.was_told(&sentence, BATTERY_AGAIN_NS, now_ns) {
            let reason = StopReason::default();
            let utterance = Utterance { sentence, urgency: Urgency::Warning, about_ns: state.header.stamp_ns, reason };
            self.add(Waiting { utterance, until_ns: now_ns + BATTERY_AGAIN_NS, breaks_in_after_ns: u64::MAX }, now_ns);
        }
    }

    /// What is to be said now, in place of whatever is being said. It counts as being said until
    /// [`Speaker::finished`].
    pub fn next(&mut self, now_ns: u64) -> Option<Utterance> {
        self.tell_ready(now_ns);
        self.tell_again(now_ns);
        self.waiting.retain(|waiting| now_ns <= waiting.until_ns);
        let best = self.waiting.iter().map(|waiting| waiting.utterance.urgency).max()?;
        let i = self.waiting.iter().position(|waiting| waiting.utterance.urgency == best)?;
        let after_ns = self.waiting[i].breaks_in_after_ns;
        let may = self.speaking.is_none_or(|speaking| {
            let has_said = now_ns.saturating_sub(speaking.since_ns) >= after_ns;
            speaking.is_over || best > speaking.urgency || (best == speaking.urgency && has_said)
        });
        if !may {
            return None;
        }
        self.speaking = Some(Speaking { urgency: best, since_ns: now_ns, is_over: false });
        let utterance = self.waiting.remove(i).utterance;
        let topic = utterance.sentence.topic;
        self.ready_told |= topic == Topic::News(News::Ready);
        self.floor_told |= matches!(topic, Topic::News(News::FloorAssumed | News::FloorNotWatched));
        Some(utterance)
    }

    /// What was being said has come to its end.
    pub fn finished(&mut self) {
        self.speaking = None;
    }

    /// What was being said could not be heard. Why the robot stands is told once more, and so is that it is ready:
    /// nothing else would tell it.
    pub fn unheard(&mut self, utterance: &Utterance, now_ns: u64) {
        self.finished();
        let was_again = self.again.take().is_some_and(|(again, _)| again.about_ns == utterance.about_ns);
        let matters = utterance.urgency == Urgency::Stop || utterance.sentence.topic == Topic::News(News::Ready);
        if matters && !was_again {
            self.again = Some((*utterance, Some(now_ns + UNHEARD_AGAIN_NS)));
        }
    }

    /// Tells again what could not be heard, while it is so.
    fn tell_again(&mut self, now_ns: u64) {
        let Some((utterance, Some(at_ns))) = self.again else { return };
        if now_ns < at_ns {
            return;
        }
        self.again = Some((utterance, None));
        let lasts = match utterance.urgency {
            Urgency::Stop => self.mode.is_some_and(|m| m.class != ModeClass::Run && m.reason == utterance.reason),
            _ => self.ready.0,
        };
        if lasts {
            self.add(Waiting { utterance, until_ns: u64::MAX, breaks_in_after_ns: u64::MAX }, now_ns);
        }
    }

    fn tell_ready(&mut self, now_ns: u64) {
        let (ready, since_ns) = self.ready;
        let for_ns = now_ns.saturating_sub(since_ns);
        if !ready && for_ns >= UNREADY_NS {
            self.ready_told = false;
        }
        // It counts as told once it is its turn: until then it is dropped where the robot is no longer ready.
        if ready && !self.ready_told && for_ns >= READY_AFTER_NS && !self.waits(Topic::News(News::Ready)) {
            self.news_until(News::Ready, now_ns, u64::MAX);
        }
    }

    fn news(&mut self, news: News, now_ns: u64) {
        self.news_until(news, now_ns, now_ns + NEWS_WAITS_NS);
    }

    fn news_until(&mut self, news: News, now_ns: u64, until_ns: u64) {
        let reason = StopReason::default();
        let utterance = Utterance { sentence: Sentence::news(news), urgency: Urgency::News, about_ns: now_ns, reason };
        self.add(Waiting { utterance, until_ns, breaks_in_after_ns: u64::MAX }, now_ns);
    }

    fn add(&mut self, waiting: Waiting, now_ns: u64) {
        let sentence = waiting.utterance.sentence;
        if sentence.verbosity() > self.config.verbosity {
            return;
        }
        self.told.retain(|(told, _)| *told != sentence);
        self.told.push_back((sentence, now_ns));
        if self.told.len() > REMEMBERED {
            self.told.pop_front();
        }
        self.waiting.retain(|other| other.utterance.sentence != sentence);
        let stops = self.waiting.iter().filter(|other| other.utterance.urgency == Urgency::Stop).count();
        if waiting.utterance.urgency != Urgency::Stop || stops < STOPS_WAITING {
            self.waiting.push(waiting);
        }
    }

    fn was_told(&self, sentence: &Sentence, within_ns: u64, now_ns: u64) -> bool {
        self.told.iter().any(|(told, at_ns)| told == sentence && now_ns.saturating_sub(*at_ns) < within_ns)
    }

    fn waits(&self, topic: Topic) -> bool {
        self.waiting.iter().any(|waiting| waiting.utterance.sentence.topic == topic)
    }

    fn drop_waiting(&mut self, is_over: impl Fn(Topic) -> bool) {
        self.waiting.retain(|waiting| !is_over(waiting.utterance.sentence.topic));
    }

    fn drop_waiting_urgency(&mut self, urgency: Urgency) {
        self.waiting.retain(|waiting| waiting.utterance.urgency != urgency);
    }

    /// What is of that urgency is over: it is not begun any more, and gives way where it is being said.
    fn drop_urgency(&mut self, urgency: Urgency) {
        self.drop_waiting_urgency(urgency);
        if let Some(speaking) = self.speaking.as_mut().filter(|speaking| speaking.urgency == urgency) {
            speaking.is_over = true;
        }
    }
}

#[cfg(test)]
mod tests;
