//! `guidedog cue enrol`: a handler says each cue five times, and five other words twice, and the recogniser is fitted
//! to that voice, unless more is lost by that than won.

mod folder;
mod recording;

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use enrolment::{Change, Changes, Clip, Enrolled, HeadFile, Rehearsal};
use hearing::{Head, ModelFiles, Recogniser, digest};
use messages::CueKind;
use serde_json::{Value, json};

use super::{decode, model_files};
use crate::args::cues::EnrolArgs;
use crate::exit::Failure;
use crate::out::{self, say};
use crate::prepare;
use folder::{Folder, Origin};

/// Words that are cues, in the order in which they are asked for.
const CUES: [&str; 5] = ["forward", "left", "right", "stop", "go"];
/// Other words that are asked for: what is most easily taken for a cue.
const OTHERS: [&str; 5] = ["start", "lift", "write", "follow", "no"];
/// Clips of each cue that are asked for; fewer than the least are too few to train with, more than the most no better.
const TAKES: usize = 5;
/// Clips of each other word that are asked for.
const TAKES_OF_OTHERS: usize = 2;
const TAKES_LEAST: usize = 3;
const TAKES_MOST: usize = 20;
/// Other work comes first.
const NICE: i32 = 10;
/// Of what is drawn.
const SEED: u64 = 1;

/// `guidedog cue enrol`.
///
/// # Errors
/// Where the recogniser's files, the clips or the microphone cannot be used; what was in force stays so.
pub fn enrol(args: &EnrolArgs, as_json: bool) -> Result<(), Failure> {
    let mut folder = Folder::new(prepare::absolute(&args.output)?)?;
    if args.undo {
        return undo(&folder, as_json);
    }
    let model = ModelFiles { manifest: base(args)?, ..model_files(args.config.as_deref())? };
    // What does not fit is told before anybody has to speak.
    let head = Head::read(&model.manifest).map_err(Failure::of_input)?;
    HeadFile::parse(&head).map_err(Failure::of_input)?;
    Recogniser::with(&head, &model).map_err(Failure::of_input)?;
    let rehearsal_path = model.manifest.with_file_name("rehearsal.bin");
    let rehearsal = Rehearsal::read(&rehearsal_path, &head).map_err(Failure::of_input)?;
    folder.begin(if args.from.is_some() { Origin::Copied } else { Origin::Spoken })?;
    let summary = collect(args, &folder).and_then(|clips| train(&folder, &model, &head, &rehearsal, &clips));
    let (summary, changed) = summary
        .inspect_err(|_| folder.give_up(args.from.is_none()))
        .map_err(|failure| Failure { message: failure.message + &folder.kept(), ..failure })?;
    out::tell(as_json, &summary, || vec![changed, told(&folder)])
}

fn undo(folder: &Folder, as_json: bool) -> Result<(), Failure> {
    folder.undo()?;
    let head = Head::read(&folder.manifest()).map_err(Failure::of_input)?;
    out::tell(as_json, &json!({ "head": folder.manifest(), "sha256": head.manifest.sha256 }), || {
        vec![format!("{} is as it was before; --undo again takes that back", folder.path().display())]
    })
}

/// The clips, from wherever they come.
fn collect(args: &EnrolArgs, folder: &Folder) -> Result<Vec<Clip>, Failure> {
    if let Some(from) = &args.from {
        folder.copy_clips(from)?;
    } else {
        recording::record(&prepare::load(settings::Profile::Walk, args.config.as_deref())?, folder, args.quiet)?;
    }
    read_clips(&folder.new_clips())
}

/// Fits the head and puts it in force, where it is one to be put in force.
///
/// Returns the report, and what changed in lines for people.
fn train(
    folder: &Folder,
    model: &ModelFiles,
    before: &Head,
    rehearsal: &Rehearsal,
    clips: &[Clip],
) -> Result<(Value, String), Failure> {
    say(format!("training with {} clips", clips.len()));
    // On the robot's own computer a run may be alive. Where that is not allowed, it is as fast as others.
    let _ = rustix::process::setpriority_process(None, NICE);
    let begun = Instant::now();
    let enrolled = enrolment::enrol(model, rehearsal, clips, SEED).map_err(Failure::of_run)?;
    plausible(&enrolled, clips)?;
    if !enrolled.is_worth_it() {
        let changed = told_of(&enrolled);
        return Err(Failure::not_reached(format!("{changed}\nMore is lost than won: nothing was changed")));
    }
    folder.put(&enrolled.head.bytes, &manifest(&model.manifest, &enrolled, clips)?)?;
    Recogniser::load(&ModelFiles { manifest: folder.new_manifest(), ..model.clone() }).map_err(Failure::of_run)?;
    folder.keep_before(before, &model.manifest)?;
    folder.put_in_force()?;
    let summary = json!({
        "head": folder.manifest(), "sha256": enrolled.head.manifest.sha256, "clips": clips.len(),
        "own": changes(&enrolled.own),
        "other_voices": changes(&enrolled.rehearsed),
        "seconds": begun.elapsed().as_secs_f64(),
    });
    Ok((summary, told_of(&enrolled)))
}

fn changes(changes: &Changes) -> Value {
    let of = |change: Change| json!({ "before": change.before, "after": change.after, "of": change.of });
    json!({ "cues_heard": of(changes.cues), "stop_heard": of(changes.stop), "others_taken": of(changes.others) })
}

/// What got better and what worse, in lines.
fn told_of(enrolled: &Enrolled) -> String {
    let (own, rehearsed) = (enrolled.own, enrolled.rehearsed);
    [
        ("your cues that are heard right (each clip four times)", own.cues, true),
        ("your \"stop\" among them", own.stop, true),
        ("your other words that are taken for cues", own.others, false),
        ("other voices' cues that are heard right", rehearsed.cues, true),
        ("their \"stop\" among them", rehearsed.stop, true),
        ("other voices' other words that are taken for cues", rehearsed.others, false),
    ]
    .into_iter()
    .filter(|(_, change, _)| change.of > 0)
    .map(|(name, change, more_is_better)| {
        let verdict = match (change.after.cmp(&change.before), more_is_better) {
            (Ordering::Equal, _) => "as before",
            (Ordering::Greater, true) | (Ordering::Less, false) => "better",
            _ => "worse",
        };
        let Change { before, after, of } = change;
        format!("  {name:<57}{before:>5} of {of} before, {after:>5} now: {verdict}")
    })
    .collect::<Vec<String>>()
    .join("\n")
}

/// Clips that a head does not learn are none of these words; and whoever lets "stop" be learnt as another word, or
/// another word as "stop", has mixed up the folders.
fn plausible(enrolled: &Enrolled, clips: &[Clip]) -> Result<(), Failure> {
    let Change { after, of, .. } = enrolled.own.cues;
    if after * 2 < of {
        return Err(Failure::input(format!(
            "of {of} cues {after} alone are heard right after training: these are not the words; nothing was changed"
        )));
    }
    for cue in CUES {
        let of_cue = clips.iter().zip(&enrolled.heard_before).filter(|(clip, _)| clip.word == cue);
        let said: Vec<Option<CueKind>> = of_cue.map(|(_, heard)| *heard).collect();
        let meant = hearing::cue_of(cue);
        let is_confused = |other: &CueKind| {
            let times = said.iter().filter(|heard| **heard == Some(*other)).count();
            let of_stop = meant == Some(CueKind::Stop) || *other == CueKind::Stop;
            meant != Some(*other) && of_stop && times * 2 > said.len()
        };
        if let Some(other) = CUES.iter().filter_map(|other| hearing::cue_of(other)).find(is_confused) {
            return Err(Failure::input(format!(
                "most clips of \"{cue}\" were heard as \"{}\" before: are they mixed up? Nothing was changed",
                other.name()
            )));
        }
    }
    Ok(())
}

/// The shipped head, or the one that is named: what is enrolled already is not enrolled upon.
fn base(args: &EnrolArgs) -> Result<PathBuf, Failure> {
    args.base.as_deref().map_or_else(super::shipped_manifest, prepare::absolute)
}

fn told(folder: &Folder) -> String {
    format!(
        "The recogniser hears this voice, from the next run on, where the configuration says:\n\n\
         [cue.voice]\nmodel = \"{}\"\n",
        folder.manifest().display()
    )
}

/// All clips in a folder of folders, each named by its word.
fn read_clips(folder: &Path) -> Result<Vec<Clip>, Failure> {
    let mut clips = Vec::new();
    for word in folder::words_of(folder)? {
        for (take, path) in folder::clips_of(folder, &word)?.iter().enumerate() {
            clips.push(Clip { word: word.clone(), take, samples: decode::read(path)? });
        }
    }
    for cue in CUES.iter().filter(|cue| !clips.iter().any(|clip| clip.word == **cue)) {
        say(format!("{cue}: no clips, so it is heard as before"));
    }
    if clips.iter().all(|clip| clip.cue().is_some()) {
        say("no other words: it cannot be told whether more of them are taken for cues");
    }
    Ok(clips)
}

/// The manifest of the enrolled head: as that of the head before, with its own digest and how it was made.
fn manifest(base: &Path, enrolled: &Enrolled, clips: &[Clip]) -> Result<String, Failure> {
    let bytes = hearing::read(base).map_err(Failure::of_input)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut manifest: toml::Table = toml::from_str(&text).map_err(Failure::of_input)?;
    let mut counts: BTreeMap<&str, i64> = BTreeMap::new();
    clips.iter().for_each(|clip| *counts.entry(&clip.word).or_default() += 1);
    let counts: toml::Table = counts.into_iter().map(|(word, count)| (word.to_owned(), count.into())).collect();
    let made = [
        ("base_sha256".to_owned(), manifest["sha256"].clone()),
        ("clips".to_owned(), counts.into()),
        ("heard_right_before".to_owned(), (enrolled.own.cues.before as i64).into()),
        ("heard_right_held_out".to_owned(), (enrolled.own.cues.after as i64).into()),
        ("heard_right_of".to_owned(), (enrolled.own.cues.of as i64).into()),
    ];
    manifest.insert("sha256".to_owned(), digest(&enrolled.head.bytes).into());
    manifest.remove("rehearsal_sha256");
    manifest.insert(
        "trained".to_owned(),
        toml::Table::from_iter([("enrolled".to_owned(), toml::Table::from_iter(made).into())]).into(),
    );
    let text = toml::to_string(&manifest).map_err(Failure::of_run)?;
    Ok(format!("# Written by `guidedog cue enrol`: a head fitted to one handler's voice.\n{text}"))
}
