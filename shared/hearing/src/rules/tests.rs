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
        "talk": { "reach": "6s", "voiced": "1s", "depth_db": 20, "stop": { "threshold": 0.9, "steps": 8 } },
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
    assert_eq!(refusal("/stop/threshold", json!(0.9)), "", "as in talk");
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
        ("/isolation/reach", json!("4ms"), "no word would be seen"),
        ("/refractory", json!("1h"), "said again would not count"),
        ("/voice/periodicity", json!(0.95), "no word would be a cue"),
        ("/voice/voiced", json!("200ms"), "no word would be a cue"),
        ("/voice/above_floor_db", json!(20), "no word would be a cue"),
        ("/talk/reach", json!("6410ms"), "over 6400 ms: what is older is not remembered"),
        ("/talk/reach", json!("1790ms"), "no talk would count"),
        ("/talk/voiced", json!("3100ms"), "not in 0.5 to 3 s"),
        ("/talk/voiced", json!("400ms"), "not in 0.5 to 3 s"),
        ("/talk/depth_db", json!(5), "not in 6 to 40"),
        ("/talk/depth_db", json!(41), "not in 6 to 40"),
        ("/talk/stop/threshold", json!(0.96), "no stop would count in talk"),
        ("/talk/stop/steps", json!(13), "no stop would count in talk"),
        ("/talk/stop/threshold", json!(0.5), "laxer than stop"),
        ("/talk/stop/steps", json!(1), "laxer than stop"),
        ("/stop/threshold", json!(0.95), "laxer than stop"),
    ] {
        let refusal = refusal(path, value);
        assert!(refusal.contains(says), "{path}: {refusal}");
    }
    for (path, value) in [("/talk/reach", json!("6400ms")), ("/talk/reach", json!("1800ms"))] {
        assert_eq!(refusal(path, value), "");
    }
}

#[test]
fn a_manifest_without_talk_or_with_more_in_it_is_none() {
    let (mut without, mut more) = (rules(), rules());
    without.as_object_mut().expect("rules").remove("talk");
    more["talk"]["directions"] = json!(true);
    for (manifest, says) in [(without, "talk"), (more, "directions")] {
        let error = serde_json::from_value::<Rules>(manifest).expect_err("refused").to_string();
        assert!(error.contains(says), "{error}");
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
fn in_talk_a_stop_that_is_not_sure_for_long_does_not_count_where_only_a_stop_does_either() {
    let stops = |talked: usize, p: f32, steps: usize| {
        let mut listener = listener();
        let _ = hear(&mut listener, 80, &NOTHING, -60.0);
        let _ = hear(&mut listener, talked, &NOTHING, -10.0);
        let _ = hear(&mut listener, 40, &NOTHING, -60.0);
        let sounds = [Sound { level_db: -10.0, periodicity: 0.9 }; FRAMES_A_STEP];
        let said = [0.0, 0.0, 0.0, p, 0.0, 1.0 - p];
        (0..steps).filter_map(|_| listener.take_only_stop(&said, &sounds)).map(|heard| heard.score).collect::<Vec<_>>()
    };
    assert_eq!(stops(0, 0.7, 2), [0.7], "without talk");
    assert_eq!(stops(49, 0.7, 2), [0.7], "a word or two are no talk");
    assert!(stops(50, 0.7, 20).is_empty(), "not sure enough");
    assert!(stops(50, 0.95, 7).is_empty(), "not for as long");
    assert_eq!(stops(50, 0.95, 8), [0.95]);
}

#[test]
fn in_talk_no_attention_word_is_heard() {
    let said = |talked: usize, pause: usize| {
        let mut listener = CueRules::new(serde_json::from_value(rules()).expect("rules"), true);
        let _ = hear(&mut listener, 80, &NOTHING, -60.0);
        let _ = hear(&mut listener, talked, &NOTHING, -10.0);
        let _ = hear(&mut listener, pause, &NOTHING, -60.0);
        let _ = hear(&mut listener, 8, &[0.0, 0.0, 0.0, 0.0, 1.0, 0.0], -10.0);
        // The direction itself comes when the talk is over, but not two seconds after the attention word.
        let _ = hear(&mut listener, 80, &NOTHING, -60.0);
        let _ = hear(&mut listener, 8, &LEFT, -10.0);
        hear(&mut listener, 24, &NOTHING, -60.0)
    };
    assert_eq!(said(25, 180), [CueKind::Left]);
    assert_eq!(said(50, 180), []);
}

const DOUBTED: Probabilities = [0.0, 0.0, 0.0, 0.7, 0.0, 0.3];

/// A listener in talk.
fn in_talk() -> CueRules {
    let mut listener = listener();
    for (steps, level_db) in [(80, -60.0), (60, -10.0), (40, -60.0)] {
        assert_eq!(hear(&mut listener, steps, &NOTHING, level_db), []);
    }
    listener
}

#[test]
fn in_talk_a_stop_in_doubt_counts_when_it_is_said_again_and_at_once_where_the_robot_stands() {
    let again = |pause: usize| {
        let mut listener = in_talk();
        assert_eq!(hear(&mut listener, 6, &DOUBTED, -10.0), [], "it is in doubt");
        let _ = hear(&mut listener, pause, &NOTHING, -60.0);
        hear(&mut listener, 6, &DOUBTED, -10.0)
    };
    assert_eq!(again(4), [], "one word flickers");
    assert_eq!(again(40), [CueKind::Stop]);
    assert_eq!(again(130), [], "much later");
    let mut listener = in_talk();
    listener.stands(true);
    assert_eq!(hear(&mut listener, 6, &DOUBTED, -10.0), [CueKind::Stop]);
}

#[test]
fn talk_holds_no_stop_back_while_the_robot_speaks_and_ages_meanwhile() {
    let mut listener = in_talk();
    assert!(aside(&mut listener).is_some());
    let mut listener = in_talk();
    (0..300).for_each(|_| listener.pass());
    assert_eq!(hear(&mut listener, 6, &DOUBTED, -10.0), [CueKind::Stop], "what was talk is six seconds old");
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
