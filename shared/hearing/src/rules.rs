//! From probabilities to cues: the rules, which are data, and who follows them. Pure.
//!
//! *stop* counts in a few steps. A direction has to be the surest word in steps in a row, in a
//! voice that stands out from what is always there, and to stand alone: it is given only once the sound that it is in
//! has ended, and that was no longer than a word. *forward*, and *go*, which means the same, have to be surer after a
//! stop. In talk, the handler's own or that of others, no direction is taken, and *stop* has to be surer for longer, or
//! to be said again: running speech has words in it that sound like cues. `scripts/train/cues/rules.py` is the same,
//! step by step.

use messages::CueKind;
use serde::Deserialize;
use settings::{Millis, Positive, Share};

use crate::levels::{Around, Isolation, Levels, MEMORY, Sound};
use crate::recogniser::{FRAMES_A_STEP, STEP_NS};
use crate::{LABELS, Probabilities};

/// From one frame to the next, nanoseconds.
const FRAME_NS: u64 = STEP_NS / FRAMES_A_STEP as u64;
/// A cue is accepted within a second; its sound's end is waited for, and a tone (0.2 s, and what a player takes).
const WAIT_MAX_S: f64 = 0.7;
/// Beyond these no word would ever be a cue: one is seen whole for some 0.4 s.
const STOP_THRESHOLD_MAX: f64 = 0.95;
const STOP_STEPS_MAX: u32 = 12;
const DIRECTION_STEPS_MAX: u32 = 20;
const PERIODICITY_MAX: f64 = 0.9;
const VOICED_MAX_S: f64 = 0.1;
const ABOVE_FLOOR_MAX_DB: f64 = 15.0;
/// A direction follows its attention word within this.
const ATTENTION_NS: u64 = 2 * messages::NS_PER_S;
/// A stop in doubt counts when it is said again within the second time, but not within the first: one word flickers.
const FLICKER_NS: u64 = messages::NS_PER_S * 4 / 10;
const AGAIN_NS: u64 = messages::NS_PER_S * 3 / 2;
/// Who has to say "stop" again says so within this.
const REFRACTORY_MAX_S: f64 = 2.0;
/// Frames that isolation may look back on, and the least that its reach has.
const ISOLATION_MEMORY: usize = 256;
const REACH_LEAST: usize = 10;
/// What is talk: how much of a voice, and how far below the word, decibels.
const TALK_VOICED_S: std::ops::RangeInclusive<f64> = 0.5..=3.0;
const TALK_DEPTH_DB: std::ops::RangeInclusive<f64> = 6.0..=40.0;
/// Places in [`LABELS`].
const FORWARD: usize = 0;
const STOP: usize = 3;
const GO: usize = 4;
/// Words that are cues.
const WORDS: usize = LABELS.len() - 1;
/// Those that are directions.
const DIRECTIONS: [usize; 4] = [FORWARD, 1, 2, GO];

/// The cue that a word is, if it is one: *go* means *forward*.
#[must_use]
pub fn cue_of(word: &str) -> Option<CueKind> {
    match word {
        "go" => Some(CueKind::Forward),
        word => LABELS[..WORDS].iter().find(|label| **label == word).and_then(|label| CueKind::from_name(label)),
    }
}

/// Thresholds and times: they stand beside the head that they were chosen for.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// When a stop counts.
    pub stop: Stop,
    /// When a direction does.
    pub direction: Direction,
    /// How sure a word has to be that is to start the robot after a stop.
    pub start: Starts,
    /// After a cue no further one for so long; *stop* and the directions apart.
    pub refractory: Millis,
    /// When a direction stands alone.
    pub isolation: IsolationRules,
    /// When a direction is in a voice.
    pub voice: VoiceRules,
    /// When it is talk, and what counts then.
    pub talk: TalkRules,
}

/// How probable a word has to be, in how many steps in a row.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stop {
    /// The least probability.
    pub threshold: Share,
    /// Steps in a row.
    pub steps: u32,
}

/// The same of the directions.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Direction {
    /// The least probability of each.
    pub threshold: Thresholds,
    /// Steps in a row.
    pub steps: u32,
    /// Whether it has to stand alone.
    pub isolated: bool,
}

/// The least probability of each direction.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thresholds {
    /// Of *forward*.
    pub forward: Share,
    /// Of *left*.
    pub left: Share,
    /// Of *right*.
    pub right: Share,
    /// Of *go*.
    pub go: Share,
}

/// The least probability of what starts the robot.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Starts {
    /// Of *forward*.
    pub forward: Share,
    /// Of *go*.
    pub go: Share,
}

/// When a direction stands alone; see [`Isolation`].
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IsolationRules {
    /// So much quiet ends a sound.
    pub quiet: Millis,
    /// A sound that is longer is running speech.
    pub segment_max: Millis,
    /// A direction waits at most so long for the end of its sound.
    pub wait_max: Millis,
    /// What was loud longer ago than this is no part of it.
    pub reach: Millis,
    /// See [`Isolation::margin_db`].
    pub margin_db: Positive,
    /// See [`Isolation::depth_db`].
    pub depth_db: Positive,
    /// See [`Isolation::floor_rise_db`].
    pub floor_rise_db: Positive,
    /// See [`Isolation::floor_fall`].
    pub floor_fall: Share,
}

/// When a direction is in a voice: by the frames within [`IsolationRules::reach`].
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VoiceRules {
    /// A frame is voiced that is as periodic as this; see [`crate::Periodicity`].
    pub periodicity: Share,
    /// So much has to be voiced.
    pub voiced: Millis,
    /// So far the loudest has to stand out from what is always there, decibels.
    pub above_floor_db: Positive,
}

/// When it is talk: by the frames within `reach`, without the newest, within [`IsolationRules::reach`], which hold
/// the word itself. Then no direction is taken.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TalkRules {
    /// What was said longer ago than this is over.
    pub reach: Millis,
    /// As much as this has to be voiced; see [`VoiceRules::periodicity`].
    pub voiced: Millis,
    /// A voice that is lower than the loudest of late by more than this is not beside the word, decibels.
    pub depth_db: Positive,
    /// When *stop* counts all the same: besides what it takes without talk.
    pub stop: Stop,
}

/// So many of these, to the nearest.
fn count(time: Millis, each_ns: u64) -> usize {
    ((time.ns() + each_ns / 2) / each_ns) as usize
}

impl IsolationRules {
    fn check(&self) -> Result<(), String> {
        if self.wait_max.s() > WAIT_MAX_S {
            return Err(format!("isolation.wait_max is over {WAIT_MAX_S} s: a cue would be too old to be accepted"));
        }
        if self.quiet.ns() >= self.wait_max.ns() {
            return Err("isolation.quiet is not under wait_max: no direction would be given".to_owned());
        }
        // A wait ends with a step.
        if count(self.reach, FRAME_NS) < REACH_LEAST {
            return Err("isolation.reach is under 100 ms: no word would be seen".to_owned());
        }
        let seen_frames = ISOLATION_MEMORY - FRAMES_A_STEP;
        if [self.segment_max, self.wait_max, self.reach].map(|time| count(time, FRAME_NS)).iter().sum::<usize>()
            > seen_frames
        {
            let seen_ms = seen_frames as u64 * FRAME_NS / 1_000_000;
            return Err(format!("isolation's segment_max, wait_max and reach are over {seen_ms} ms together"));
        }
        Ok(())
    }

    fn in_frames(&self) -> Isolation {
        Isolation {
            quiet: count(self.quiet, FRAME_NS),
            segment_max: count(self.segment_max, FRAME_NS),
            reach: count(self.reach, FRAME_NS),
            margin_db: self.margin_db.get(),
            depth_db: self.depth_db.get(),
            floor_fall: self.floor_fall.get(),
            floor_rise_db: self.floor_rise_db.get(),
        }
    }
}

impl TalkRules {
    fn check(&self, late: Millis, stop: &Stop) -> Result<(), String> {
        let [reach, late, voiced] = [self.reach, late, self.voiced].map(|time| count(time, FRAME_NS));
        if reach > MEMORY {
            let remembered_ms = MEMORY as u64 * FRAME_NS / 1_000_000;
            return Err(format!("talk.reach is over {remembered_ms} ms: what is older is not remembered"));
        }
        if !TALK_VOICED_S.contains(&self.voiced.s()) {
            let [least, most] = [TALK_VOICED_S.start(), TALK_VOICED_S.end()];
            return Err(format!(
                "talk.voiced is not in {least} to {most} s: a word would be talk, or talk would be none"
            ));
        }
        if !TALK_DEPTH_DB.contains(&self.depth_db.get()) {
            let [least, most] = [TALK_DEPTH_DB.start(), TALK_DEPTH_DB.end()];
            return Err(format!("talk.depth_db is not in {least} to {most}: no talk would count, or any whisper"));
        }
        if late + voiced > reach {
            return Err("talk.voiced does not fit into talk.reach less isolation.reach: no talk would count".to_owned());
        }
        let Stop { threshold, steps } = self.stop;
        if threshold.get() > STOP_THRESHOLD_MAX || steps > STOP_STEPS_MAX {
            let limits = format!("threshold over {STOP_THRESHOLD_MAX} or steps over {STOP_STEPS_MAX}");
            return Err(format!("talk.stop has a {limits}: no stop would count in talk"));
        }
        if threshold.get() < stop.threshold.get() || steps < stop.steps {
            return Err("talk.stop is laxer than stop: talk makes a stop less certain, not more".to_owned());
        }
        Ok(())
    }
}

impl Rules {
    /// The least probability of a word that is a cue, by its place in [`LABELS`], while the robot walks.
    #[must_use]
    pub fn least(&self, word: usize) -> f64 {
        let Thresholds { forward, left, right, go } = self.direction.threshold;
        [forward, left, right, self.stop.threshold, go].get(word).map_or(1.0, |least| least.get())
    }

    /// Whether they can be followed.
    ///
    /// # Errors
    /// Names the rule that cannot.
    pub(crate) fn check(&self) -> Result<(), String> {
        let Thresholds { forward, left, right, go } = self.direction.threshold;
        let start = self.start;
        if [self.stop.threshold, forward, left, right, go, start.forward, start.go].iter().any(|p| p.get() <= 0.0) {
            return Err("a threshold of 0: everything would be a cue".to_owned());
        }
        if self.stop.steps == 0 || self.direction.steps == 0 {
            return Err("steps = 0: everything would be a cue".to_owned());
        }
        // As good as never, and nobody would be told.
        if self.stop.threshold.get() > STOP_THRESHOLD_MAX || self.stop.steps > STOP_STEPS_MAX {
            let limits = format!("threshold over {STOP_THRESHOLD_MAX} or steps over {STOP_STEPS_MAX}");
            return Err(format!("stop has a {limits}: none would count"));
        }
        if self.direction.steps > DIRECTION_STEPS_MAX {
            return Err(format!("direction.steps is over {DIRECTION_STEPS_MAX}: no word is as long"));
        }
        let VoiceRules { periodicity, voiced, above_floor_db } = self.voice;
        if periodicity.get() > PERIODICITY_MAX || voiced.s() > VOICED_MAX_S || above_floor_db.get() > ABOVE_FLOOR_MAX_DB
        {
            let limits = format!("{PERIODICITY_MAX}, {VOICED_MAX_S} s, {ABOVE_FLOOR_MAX_DB} dB");
            return Err(format!(
                "voice is over periodicity, voiced, above_floor_db of {limits}: no word would be a cue"
            ));
        }
        if self.refractory.s() > REFRACTORY_MAX_S {
            return Err(format!("refractory is over {REFRACTORY_MAX_S} s: a cue that is said again would not count"));
        }
        self.isolation.check()?;
        self.talk.check(self.isolation.reach, &self.stop)
    }
}

/// A cue that was heard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Heard {
    /// Which.
    pub kind: CueKind,
    /// The least of the probabilities that made it.
    pub score: f32,
    /// Steps ago that it was sure, waiting for the end of its sound since.
    pub steps_ago: u64,
    /// The robot stood by a stop.
    pub after_stop: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Candidate {
    word: usize,
    step: u64,
    score: f32,
    loud_db: f64,
}

/// A streak of steps, and the least probability in it, after a step of this probability.
fn longer((streak, least): (u32, f32), p: f32, threshold: Share) -> (u32, f32) {
    if f64::from(p) >= threshold.get() { (streak + 1, least.min(p)) } else { (0, 1.0) }
}

/// Follows the rules, step by step.
#[derive(Debug, Clone)]
pub struct CueRules {
    rules: Rules,
    levels: Levels,
    step: u64,
    /// Steps in a row in which a word was probable enough, and the least it was.
    streaks: [(u32, f32); WORDS],
    /// The same of *stop* in talk.
    stop_in_talk: (u32, f32),
    /// The step in which a stop in doubt began.
    doubted: Option<u64>,
    /// Of *stop*, in what sounds while the robot itself speaks.
    stop_aside: (u32, f32),
    waiting: Option<Candidate>,
    /// The last cue was a stop.
    is_stopped: bool,
    /// The robot was last known to stand.
    stood: bool,
    /// A direction counts only after *go*, and *go* alone is no cue.
    wants_go: bool,
    /// The step at which *go* was last sure.
    went: Option<u64>,
    /// No further stop, and no further direction, before this step.
    silent_until: (u64, u64),
}

impl CueRules {
    /// Nothing was heard yet. Where directions want *go*, they count only within two seconds after it ("go left"), and
    /// it is no cue by itself.
    #[must_use]
    pub fn new(rules: Rules, wants_go: bool) -> Self {
        Self {
            wants_go,
            went: None,
            levels: Levels::new(rules.isolation.in_frames()),
            rules,
            step: 0,
            streaks: [(0, 1.0); WORDS],
            stop_in_talk: (0, 1.0),
            doubted: None,
            stop_aside: (0, 1.0),
            waiting: None,
            is_stopped: false,
            stood: false,
            silent_until: (0, 0),
        }
    }

    /// The sound's levels.
    #[must_use]
    pub fn levels(&self) -> &Levels {
        &self.levels
    }

    /// Whether the robot stands by somebody's stop: *forward* has to be as sure as after one that was heard. Once it
    /// walks again, however soon, the next stop counts.
    pub fn stands(&mut self, is_stopped: bool) {
        if std::mem::replace(&mut self.stood, is_stopped) && !is_stopped {
            self.silent_until.0 = 0;
        }
        self.is_stopped = is_stopped;
    }

    /// What was heard and not given yet is over.
    pub fn forget(&mut self) {
        (self.waiting, self.went) = (None, None);
        DIRECTIONS.iter().for_each(|word| self.streaks[*word] = (0, 1.0));
    }

    /// A step passes in which no direction is listened for.
    pub fn pass(&mut self) {
        self.step += 1;
        self.levels.pass(FRAMES_A_STEP);
        self.forget();
    }

    /// Takes a step in which nothing but *stop* is listened for: the robot itself speaks.
    pub fn take_stop(&mut self, probabilities: &Probabilities) -> Option<Heard> {
        self.stop_aside = longer(self.stop_aside, probabilities[STOP], self.rules.stop.threshold);
        let (streak, score) = self.stop_aside;
        if streak >= self.rules.stop.steps { self.stop(self.step, score) } else { None }
    }

    /// A stop counts, if none did of late.
    fn stop(&mut self, step: u64, score: f32) -> Option<Heard> {
        (self.waiting, self.went, self.is_stopped) = (None, None, true);
        let is_new = step >= self.silent_until.0;
        if is_new {
            self.silent_until.0 = step + count(self.rules.refractory, STEP_NS) as u64;
        }
        is_new.then_some(Heard { kind: CueKind::Stop, score, steps_ago: 0, after_stop: true })
    }

    /// Takes a step as [`CueRules::take`] does, and ignores directions.
    pub fn take_only_stop(&mut self, probabilities: &Probabilities, sounds: &[Sound; FRAMES_A_STEP]) -> Option<Heard> {
        let step = self.begin(probabilities, sounds);
        self.forget();
        self.sure_of_stop(step).and_then(|score| self.stop(step, score))
    }

    /// Takes a step, with what each of its frames sounds like.
    pub fn take(&mut self, probabilities: &Probabilities, sounds: &[Sound; FRAMES_A_STEP]) -> Option<Heard> {
        let step = self.begin(probabilities, sounds);
        let refractory = count(self.rules.refractory, STEP_NS) as u64;
        if let Some(score) = self.sure_of_stop(step) {
            return self.stop(step, score);
        }
        // The sound is looked at only where a word makes it matter.
        if DIRECTIONS.iter().any(|word| self.is_sure(*word)) && self.is_voice() && !self.is_talk() {
            self.listen_for_directions(step);
        }
        let Candidate { word, step: since, score, .. } = self.isolated(step)?;
        let after_stop = std::mem::take(&mut self.is_stopped);
        (self.waiting, self.went) = (None, None);
        self.silent_until.1 = step + refractory;
        let kind = cue_of(LABELS[word])?;
        Some(Heard { kind, score, steps_ago: step - since, after_stop })
    }

    /// Takes what is sure, in a voice that may give directions.
    fn listen_for_directions(&mut self, step: u64) {
        if self.is_sure(GO) {
            self.went = Some(step);
        }
        for word in DIRECTIONS {
            let may_count = self.is_sure(word) && self.may_be(word, step) && step >= self.silent_until.1;
            if may_count && self.waiting.is_none_or(|waiting| waiting.word != word) {
                let score = self.streaks[word].1;
                self.waiting = Some(Candidate { word, step, score, loud_db: self.levels.loud_db() });
            }
        }
    }

    /// Whether a direction was probable enough for as many steps as it takes.
    fn is_sure(&self, word: usize) -> bool {
        self.streaks[word].0 >= self.rules.direction.steps
    }

    /// Counts a step: its number.
    fn begin(&mut self, probabilities: &Probabilities, sounds: &[Sound; FRAMES_A_STEP]) -> u64 {
        sounds.iter().for_each(|sound| self.levels.take(*sound));
        self.count(probabilities);
        self.step += 1;
        self.step - 1
    }

    /// The score of *stop*, if it was probable enough for as many steps as it takes. In talk it may be in doubt: it
    /// ends what waits, and counts when it is said again. A false stop costs nothing while the robot stands by one.
    fn sure_of_stop(&mut self, step: u64) -> Option<f32> {
        let (streak, score) = self.streaks[STOP];
        if streak < self.rules.stop.steps {
            return None;
        }
        if self.stood || !self.is_talk() {
            return Some(score);
        }
        let (in_talk, surely) = self.stop_in_talk;
        if in_talk >= self.rules.talk.stop.steps {
            return Some(surely);
        }
        (self.waiting, self.went) = (None, None);
        (streak == self.rules.stop.steps && self.is_again(step)).then_some(score)
    }

    /// A doubt begins: whether it is the second of late.
    fn is_again(&mut self, step: u64) -> bool {
        let before = self.doubted.map(|doubted| step - doubted);
        if before.is_some_and(|before| before < FLICKER_NS / STEP_NS) {
            return false;
        }
        self.doubted = Some(step);
        before.is_some_and(|before| before <= AGAIN_NS / STEP_NS)
    }

    /// Whether a direction may be given now, as far as its attention word goes.
    fn may_be(&self, word: usize, step: u64) -> bool {
        let is_announced = self.went.is_some_and(|went| step - went <= ATTENTION_NS / STEP_NS);
        !self.wants_go || (word != GO && is_announced)
    }

    fn count(&mut self, probabilities: &Probabilities) {
        // The first of equals.
        let best = (0..LABELS.len()).rev().max_by(|a, b| probabilities[*a].total_cmp(&probabilities[*b]));
        for (word, p) in probabilities.iter().copied().enumerate().take(WORDS) {
            let (streak, least) = self.streaks[word];
            let counts = f64::from(p) >= self.threshold(word) && (word == STOP || best == Some(word));
            let least = if streak > 0 { least.min(p) } else { p };
            self.streaks[word] = if counts { (streak + 1, least) } else { (0, 1.0) };
        }
        self.stop_in_talk = longer(self.stop_in_talk, probabilities[STOP], self.rules.talk.stop.threshold);
    }

    /// Whether it is talk: of late, and about as loud as what is heard now.
    fn is_talk(&self) -> bool {
        let TalkRules { reach, voiced, depth_db, .. } = self.rules.talk;
        let periodicity = self.rules.voice.periodicity.get();
        self.levels.talked(count(reach, FRAME_NS), periodicity, depth_db.get()) >= count(voiced, FRAME_NS)
    }

    /// Whether a voice was heard of late, and not what is always there alone.
    fn is_voice(&self) -> bool {
        let VoiceRules { periodicity, voiced, above_floor_db } = self.rules.voice;
        self.levels.voiced(periodicity.get()) >= count(voiced, FRAME_NS)
            && self.levels.above_floor_db() > above_floor_db.get()
    }

    fn threshold(&self, word: usize) -> f64 {
        let start = match word {
            FORWARD if self.is_stopped => self.rules.start.forward.get(),
            GO if self.is_stopped && !self.wants_go => self.rules.start.go.get(),
            _ => 0.0,
        };
        self.rules.least(word).max(start)
    }

    /// The direction that waits, where it may be given now; one that never may is dropped.
    fn isolated(&mut self, step: u64) -> Option<Candidate> {
        let waiting = self.waiting?;
        if !self.rules.direction.isolated {
            return Some(waiting);
        }
        let waited = (step - waiting.step) as usize;
        match self.levels.around(waiting.loud_db, waited * FRAMES_A_STEP) {
            Around::Quiet => return Some(waiting),
            Around::Running => self.waiting = None,
            Around::Open if waited >= count(self.rules.isolation.wait_max, STEP_NS) => self.waiting = None,
            Around::Open => {}
        }
        None
    }
}

#[cfg(test)]
mod tests;
