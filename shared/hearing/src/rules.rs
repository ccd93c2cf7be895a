//! From probabilities to cues: the rules, which are data, and who follows them. Pure.
//!
//! *stop* counts in a few steps, whatever goes on. A direction has to be the surest word in steps in a row, in a
//! voice that stands out from what is always there, and to stand alone: it is given only once the sound that it is in
//! has ended, and that was no longer than a word. *forward*, and *go*, which means the
//! same, have to be surer after a stop. `scripts/train/cues/rules.py`
//! is the same, step by step.

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
/// Who has to say "stop" again says so within this.
const REFRACTORY_MAX_S: f64 = 2.0;
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
        let seen_frames = MEMORY - FRAMES_A_STEP;
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
        self.isolation.check()
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

/// Follows the rules, step by step.
#[derive(Debug, Clone)]
pub struct CueRules {
    rules: Rules,
    levels: Levels,
    step: u64,
    /// Steps in a row in which a word was probable enough, and the least it was.
    streaks: [(u32, f32); WORDS],
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
        self.forget();
    }

    /// Takes a step in which nothing but *stop* is listened for: the robot itself speaks.
    pub fn take_stop(&mut self, probabilities: &Probabilities) -> Option<Heard> {
        let (p, (streak, score)) = (probabilities[STOP], self.stop_aside);
        let is_stop = f64::from(p) >= self.rules.stop.threshold.get();
        self.stop_aside = if is_stop { (streak + 1, score.min(p)) } else { (0, 1.0) };
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
        self.sure_of_stop().and_then(|score| self.stop(step, score))
    }

    /// Takes a step, with what each of its frames sounds like.
    pub fn take(&mut self, probabilities: &Probabilities, sounds: &[Sound; FRAMES_A_STEP]) -> Option<Heard> {
        let step = self.begin(probabilities, sounds);
        let refractory = count(self.rules.refractory, STEP_NS) as u64;
        if let Some(score) = self.sure_of_stop() {
            return self.stop(step, score);
        }
        let is_voice = self.is_voice();
        if self.streaks[GO].0 >= self.rules.direction.steps && is_voice {
            self.went = Some(step);
        }
        for word in DIRECTIONS {
            let (streak, score) = self.streaks[word];
            let is_sure =
                self.may_be(word, step) && streak >= self.rules.direction.steps && step >= self.silent_until.1;
            if is_sure && is_voice && self.waiting.is_none_or(|waiting| waiting.word != word) {
                self.waiting = Some(Candidate { word, step, score, loud_db: self.levels.loud_db() });
            }
        }
        let Candidate { word, step: since, score, .. } = self.isolated(step)?;
        let after_stop = std::mem::take(&mut self.is_stopped);
        (self.waiting, self.went) = (None, None);
        self.silent_until.1 = step + refractory;
        let kind = cue_of(LABELS[word])?;
        Some(Heard { kind, score, steps_ago: step - since, after_stop })
    }

    /// Counts a step: its number.
    fn begin(&mut self, probabilities: &Probabilities, sounds: &[Sound; FRAMES_A_STEP]) -> u64 {
        sounds.iter().for_each(|sound| self.levels.take(*sound));
        self.count(probabilities);
        self.step += 1;
        self.step - 1
    }

    /// The score of *stop*, if it was probable enough for as many steps as it takes.
    fn sure_of_stop(&self) -> Option<f32> {
        let (streak, score) = self.streaks[STOP];
        (streak >= self.rules.stop.steps).then_some(score)
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
mod tests {
    use serde_json::{Value, json};

    use super::{CueRules, FRAMES_A_STEP, Heard, Probabilities, Rules, Sound};
    use messages::CueKind;

    fn rules() -> Value {
        json!({
            "stop": { "threshold": 0.6, "steps": 2 },
            "direction": {
                "threshold": { "forward": 0.8, "left": 0.6, "right": 0.6, "go": 0.8 }, "steps": 5, "isolated": true,
            },
            "start": { "forward": 0.9, "go": 0.95 },
            "refractory": "1s",
            "isolation": {
                "quiet": "180ms", "segment_max": "1s", "wait_max": "600ms", "reach": "800ms",
                "margin_db": 8, "depth_db": 30, "floor_rise_db": 0.02, "floor_fall": 0.2,
            },
            "voice": { "periodicity": 0.7, "voiced": "30ms", "above_floor_db": 5 },
        })
    }

    /// What comes of the rules where one of them is another: the text of its refusal, if it is refused.
    fn refusal(path: &str, value: Value) -> String {
        let mut rules = rules();
        *rules.pointer_mut(path).expect("a rule") = value;
        let rules: Rules = serde_json::from_value(rules).expect("rules");
        rules.check().err().unwrap_or_default()
    }

    #[test]
    fn rules_by_which_everything_or_nothing_would_be_a_cue_are_refused() {
        assert_eq!(refusal("/stop/threshold", json!(0.95)), "");
        for (path, value, says) in [
            ("/stop/threshold", json!(0.0), "a threshold of 0"),
            ("/stop/threshold", json!(0.96), "none would count"),
            ("/stop/steps", json!(13), "none would count"),
            ("/direction/steps", json!(0), "everything would be a cue"),
            ("/direction/steps", json!(21), "no word is as long"),
            ("/start/go", json!(0.0), "a threshold of 0"),
            ("/isolation/wait_max", json!("800ms"), "too old to be accepted"),
            ("/isolation/wait_max", json!("180ms"), "no direction would be given"),
            ("/isolation/segment_max", json!("1200ms"), "over 2540 ms together"),
            ("/refractory", json!("1h"), "said again would not count"),
            ("/voice/periodicity", json!(0.95), "no word would be a cue"),
            ("/voice/voiced", json!("200ms"), "no word would be a cue"),
            ("/voice/above_floor_db", json!(20), "no word would be a cue"),
        ] {
            let refusal = refusal(path, value);
            assert!(refusal.contains(says), "{path}: {refusal}");
        }
    }
    const NOTHING: Probabilities = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    const STOP: Probabilities = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
    const LEFT: Probabilities = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0];

    fn listener() -> CueRules {
        CueRules::new(serde_json::from_value(rules()).expect("rules"), false)
    }

    /// Steps that sound so.
    fn hear(listener: &mut CueRules, steps: usize, probabilities: &Probabilities, level_db: f64) -> Vec<CueKind> {
        let sounds = [Sound { level_db, periodicity: if level_db > -40.0 { 0.9 } else { 0.0 } }; FRAMES_A_STEP];
        (0..steps).filter_map(|_| listener.take(probabilities, &sounds)).map(|heard| heard.kind).collect()
    }

    /// As much of *stop* as counts, while the robot speaks.
    fn aside(listener: &mut CueRules) -> Option<Heard> {
        let _ = listener.take_stop(&NOTHING);
        listener.take_stop(&STOP).or(listener.take_stop(&STOP))
    }

    #[test]
    fn a_stop_is_not_told_twice_but_counts_anew_once_the_robot_walks_or_a_second_has_passed() {
        let mut listener = listener();
        assert_eq!(hear(&mut listener, 20, &STOP, -10.0), [CueKind::Stop], "once");
        listener.stands(true);
        assert!(aside(&mut listener).is_none(), "the robot stands");
        listener.stands(false);
        assert!(aside(&mut listener).is_some(), "somebody has started it again");
        assert!(aside(&mut listener).is_none());
        // While the robot speaks time passes, too.
        (0..50).for_each(|_| listener.pass());
        assert!(aside(&mut listener).is_some());
    }

    #[test]
    fn go_means_forward_and_has_to_be_surer_after_a_stop() {
        let said = |p: f32, is_stopped: bool| {
            let mut listener = listener();
            listener.stands(is_stopped);
            let _ = hear(&mut listener, 80, &NOTHING, -60.0);
            let _ = hear(&mut listener, 8, &[0.0, 0.0, 0.0, 0.0, p, 1.0 - p], -10.0);
            hear(&mut listener, 24, &NOTHING, -60.0)
        };
        assert_eq!(said(0.9, false), [CueKind::Forward]);
        assert_eq!(said(0.9, true), []);
        assert_eq!(said(0.96, true), [CueKind::Forward]);
    }

    #[test]
    fn with_an_attention_word_a_direction_counts_only_after_it_and_stop_always() {
        let said = |go: bool, pause: usize| {
            let mut listener = CueRules::new(serde_json::from_value(rules()).expect("rules"), true);
            let _ = hear(&mut listener, 80, &NOTHING, -60.0);
            let mut heard = Vec::new();
            if go {
                heard.extend(hear(&mut listener, 8, &[0.0, 0.0, 0.0, 0.0, 1.0, 0.0], -10.0));
                heard.extend(hear(&mut listener, pause, &NOTHING, -60.0));
            }
            heard.extend(hear(&mut listener, 8, &LEFT, -10.0));
            heard.extend(hear(&mut listener, 24, &NOTHING, -60.0));
            heard.extend(hear(&mut listener, 4, &STOP, -10.0));
            heard
        };
        assert_eq!(said(false, 0), [CueKind::Stop]);
        assert_eq!(said(true, 0), [CueKind::Left, CueKind::Stop], "in one breath");
        assert_eq!(said(true, 50), [CueKind::Left, CueKind::Stop], "a second later");
        assert_eq!(said(true, 120), [CueKind::Stop], "too late");
        // What comes between ends it: a stop, another's cue, a direction.
        let go = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let after = |between: &dyn Fn(&mut CueRules)| {
            let mut listener = CueRules::new(serde_json::from_value(rules()).expect("rules"), true);
            let _ = hear(&mut listener, 80, &NOTHING, -60.0);
            let _ = hear(&mut listener, 8, &go, -10.0);
            between(&mut listener);
            let _ = hear(&mut listener, 8, &LEFT, -10.0);
            hear(&mut listener, 24, &NOTHING, -60.0)
        };
        assert_eq!(after(&|_| {}), [CueKind::Left]);
        assert_eq!(after(&|listener| assert_eq!(hear(listener, 3, &STOP, -10.0), [CueKind::Stop])), []);
        assert_eq!(after(&CueRules::forget), []);
    }

    #[test]
    fn where_only_a_stop_counts_a_direction_is_none_and_what_is_always_there_is_learnt() {
        let mut listener = listener();
        let sounds = |level_db| [Sound { level_db, periodicity: 0.9 }; FRAMES_A_STEP];
        for _ in 0..80 {
            assert!(listener.take_only_stop(&NOTHING, &sounds(-40.0)).is_none());
        }
        for _ in 0..20 {
            assert!(listener.take_only_stop(&LEFT, &sounds(-10.0)).is_none());
        }
        assert_eq!(hear(&mut listener, 4, &NOTHING, -60.0), [], "it is over");
        assert!(listener.levels().above_floor_db() > 20.0, "the floor is known");
        let heard: Vec<_> = (0..3).filter_map(|_| listener.take_only_stop(&STOP, &sounds(-10.0))).collect();
        assert_eq!(heard.len(), 1, "a stop counts");
    }

    #[test]
    fn a_direction_that_waits_is_forgotten_when_the_robot_speaks_or_another_cue_is_given() {
        let given = |meanwhile: &dyn Fn(&mut CueRules)| {
            let mut listener = listener();
            let _ = hear(&mut listener, 80, &NOTHING, -60.0);
            assert_eq!(hear(&mut listener, 16, &LEFT, -10.0), [], "its sound has not ended");
            meanwhile(&mut listener);
            hear(&mut listener, 24, &NOTHING, -60.0)
        };
        assert_eq!(given(&|_| {}), [CueKind::Left]);
        assert_eq!(given(&CueRules::forget), []);
        assert_eq!(given(&CueRules::pass), []);
    }
}
