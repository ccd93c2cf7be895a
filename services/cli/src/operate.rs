//! `status`, `why`, `cue`, `stop`, `resume`: what an operator asks of a live run.

use std::collections::BTreeMap;

use control::{
    CueStatus, LocomotionStatus, MicrophoneStatus, ModeStatus, Note, Query, Request, ServiceStatus, Status, Stop, Why,
};
use messages::stops::{STOPS, StopInfo};
use messages::{CueKind, MicrophoneState, ModeClass, SpeechPhase, StopKind};
use serde_json::{Value, json};
use settings::AttitudeSource;
use transport::LiveRun;

use crate::args::{InjectArgs, RunArg, StopArgs};
use crate::exit::Failure;
use crate::find::{self, ask, read};
use crate::history;
use crate::out::{self, table};

const STOPPED: &str = "stopped and locked; `guidedog resume` ends the lock";

/// `guidedog status`
///
/// # Errors
/// As [`ask`].
pub fn status(run: &RunArg, as_json: bool) -> Result<(), Failure> {
    show(run, as_json, status_lines).or_else(|failure| history::or_ended(failure, run, as_json))
}

/// `guidedog why`
///
/// # Errors
/// As [`ask`].
pub fn why(run: &RunArg, as_json: bool) -> Result<(), Failure> {
    show(run, as_json, why_lines).or_else(|failure| history::or_ended(failure, run, as_json))
}

/// Shows something of a run. As JSON it is what the supervisor says, members that this program does not know included.
///
/// # Errors
/// As [`ask`].
pub fn show<T: Query>(run: &RunArg, as_json: bool, lines: impl FnOnce(&T) -> Vec<String>) -> Result<(), Failure> {
    let run = run.run.as_deref();
    if as_json {
        return out::json(&ask(run, &T::REQUEST)?);
    }
    out::report(lines(&read(run)?))
}

/// `guidedog why --reasons`
///
/// # Errors
/// Where nothing can be written.
pub fn reasons(as_json: bool) -> Result<(), Failure> {
    if as_json {
        let row = |stop: &StopInfo| {
            let (name, class) = (stop.name, stop.class.name());
            json!({ "reason": name, "class": class, "meaning": stop.meaning, "advice": stop.advice })
        };
        return out::json(&json!({ "reasons": STOPS.iter().map(row).collect::<Vec<Value>>() }));
    }
    let row = |stop: &StopInfo| [stop.name, stop.class.name(), stop.meaning, stop.advice].map(str::to_owned).to_vec();
    let rows: Vec<Vec<String>> = STOPS.iter().map(row).collect();
    out::report(table(&["reason", "class", "what happened", "what to do"], &rows))
}

/// `guidedog cue`
///
/// # Errors
/// As [`ask`].
pub fn cue(cue: CueKind, run: &RunArg, as_json: bool) -> Result<(), Failure> {
    tell(run, &Request::Cue { cue }, &format!("cue {} given", cue.name()), as_json)
}

/// `guidedog stop`: every live run, unless one is named.
///
/// # Errors
/// Where there is no run, or one of them did not stop; the others are stopped even so. With `--all`, also where there
/// may be runs in a directory that this user may not read.
pub fn stop(args: &StopArgs, as_json: bool) -> Result<(), Failure> {
    let find::Runs { live: runs, closed } = find::all(args.run.as_deref())?;
    let answers = stop_each(&runs);
    if let (false, [answer]) = (args.all, &answers[..]) {
        return out::tell(as_json, answer.as_ref().map_err(Clone::clone)?, || vec![STOPPED]);
    }
    let mut stopped = Vec::new();
    let mut failed = Vec::new();
    for (LiveRun { name, .. }, answer) in runs.into_iter().zip(answers) {
        match answer {
            Ok(_) => stopped.push(name),
            Err(failure) => failed.push((name, failure)),
        }
    }
    if args.all {
        failed.extend(closed.into_iter().map(|(dir, failure)| (dir.display().to_string(), failure)));
    }
    let messages: BTreeMap<&str, &str> =
        failed.iter().map(|(name, failure)| (name.as_str(), failure.message.as_str())).collect();
    let mut report = json!({ "stopped": stopped, "failed": messages });
    if let Some((_, failure)) = failed.first() {
        report["error"] = json!(failure.message);
    }
    out::tell(as_json, &report, || {
        let stopped = stopped.iter().map(|name| format!("{name}: {STOPPED}"));
        stopped.chain(messages.iter().map(|(name, why)| format!("{name}: NOT STOPPED: {why}"))).collect()
    })?;
    failed.into_iter().next().map_or(Ok(()), |(_, failure)| Err(Failure { told: as_json, ..failure }))
}

/// Stops all runs at once: one that does not answer delays no other.
fn stop_each(runs: &[LiveRun]) -> Vec<Result<Value, Failure>> {
    std::thread::scope(|scope| {
        let stop = |run| scope.spawn(move || find::ask_run(run, &Request::Stop, |client| client.ask(&Request::Stop)));
        let asked: Vec<_> = runs.iter().map(stop).collect();
        let gone = |_| Err(Failure::run("the thread that asked for the stop panicked"));
        asked.into_iter().map(|asked| asked.join().unwrap_or_else(gone)).collect()
    })
}

/// `guidedog resume`
///
/// # Errors
/// As [`ask`].
pub fn resume(run: &RunArg, as_json: bool) -> Result<(), Failure> {
    tell(run, &Request::Resume {}, "lock ended; the robot waits for a cue", as_json)
}

/// `guidedog inject`
///
/// # Errors
/// As [`ask`], and where target or fault is none.
pub fn inject(args: &InjectArgs, as_json: bool) -> Result<(), Failure> {
    let (target, _) = messages::fault::parse(&args.target, &args.fault).map_err(Failure::input)?;
    let for_ms = args.lasts.map(|lasts| lasts.ns() / 1_000_000);
    let (name, fault, seed) = (args.target.clone(), args.fault.clone(), Some(args.seed));
    let request = Request::Inject { target: name, fault, for_ms, seed };
    tell(&args.run, &request, &format!("{target}: {}", args.fault), as_json)
}

fn tell(run: &RunArg, request: &Request, done: &str, as_json: bool) -> Result<(), Failure> {
    let answer = ask(run.run.as_deref(), request)?;
    out::tell(as_json, &answer, || vec![done])
}

/// The mode in a few words.
pub fn mode_line(mode: &ModeStatus) -> String {
    let reason = mode.reason.as_ref().map_or_else(String::new, |reason| format!(": {reason}"));
    let ready = match (mode.class, mode.ready_for_cue) {
        (ModeClass::Fault, true) => ", ready for a cue",
        (ModeClass::Fault, false) => ", not ready for a cue",
        (ModeClass::Run | ModeClass::Lock, _) => "",
    };
    format!("{}{reason} (epoch {}){ready}", mode.class.name(), mode.epoch)
}

/// The cue in force in a few words.
pub fn cue_line(mode: &ModeStatus) -> String {
    let told = |cue: &CueStatus| format!("{}, since {:.1} s", cue.kind.name(), cue.since_s);
    mode.cue.as_ref().map_or_else(|| "none".to_owned(), told)
}

/// What the robot does in a few words.
pub fn robot_line(status: &Status) -> String {
    let velocity = velocity(status.locomotion.as_ref());
    let Some(world) = &status.world else { return velocity };
    let [x_m, y_m, yaw_rad] = world.robot;
    let (heading_deg, walked_m) = (yaw_rad.to_degrees(), world.distance_m);
    format!("at ({x_m:.2}, {y_m:.2}) heading {heading_deg:.0} deg, {walked_m:.1} m walked, {velocity}")
}

fn velocity(locomotion: Option<&LocomotionStatus>) -> String {
    let Some(LocomotionStatus { velocity: [vx, vy, wz], limited_by, .. }) = locomotion else {
        return "no word from locomotion".to_owned();
    };
    let limited = if limited_by == StopKind::None.name() { String::new() } else { format!(", held by {limited_by}") };
    format!("{:.2} m/s, {wz:+.2} rad/s{limited}", vx.hypot(*vy))
}

/// What the robot said last.
fn said_line(status: &Status) -> String {
    let Some(said) = status.said.as_ref().filter(|said| !said.text.is_empty()) else { return "nothing".to_owned() };
    let (ago_s, unheard) =
        (status.now_s - said.at_s, if said.phase == SpeechPhase::Unheard { ", unheard" } else { "" });
    format!("\"{}\", {ago_s:.1} s ago{unheard}", said.text)
}

/// The ages of the streams in a few words.
pub fn ages_line(status: &Status) -> String {
    let ages: Vec<String> = status.stream_age_ms.iter().map(|(topic, age_ms)| format!("{topic} {age_ms:.0}")).collect();
    if ages.is_empty() { "none yet".to_owned() } else { format!("{} ms", ages.join(", ")) }
}

/// How the handler's voice is heard.
fn hears_line(microphone: Option<&MicrophoneStatus>) -> String {
    let Some(microphone) = microphone else { return "no voice".to_owned() };
    let what = match microphone.state {
        MicrophoneState::None => return "no voice".to_owned(),
        MicrophoneState::Lost => return "nothing: its source is lost".to_owned(),
        MicrophoneState::WarmingUp => return "not yet: warming up".to_owned(),
        MicrophoneState::Muted => return "not now: the robot speaks".to_owned(),
        MicrophoneState::Hearing => "",
        MicrophoneState::Dead => "dead: ",
        MicrophoneState::Clipping => "clipping: ",
    };
    let (level, standing_out, clipped) = (microphone.level_dbfs, microphone.above_floor_db, 100.0 * microphone.clipped);
    format!("{what}{level:.0} dBFS, {standing_out:.0} dB above what is always there, {clipped:.1} % cut off")
}

fn status_lines(status: &Status) -> Vec<String> {
    let mut lines = vec![
        format!("run      {} (supervisor {}), {:.1} s", status.run, status.supervisor_pid, status.now_s),
        format!("mode     {}", mode_line(&status.mode)),
        format!("cue      {}", cue_line(&status.mode)),
        format!("robot    {}", robot_line(status)),
        format!("said     {}", said_line(status)),
        format!("hears    {}", hears_line(status.microphone.as_ref())),
        format!("streams  {}", ages_line(status)),
    ];
    if status.attitude.as_deref() == Some(AttitudeSource::Depth.name()) {
        lines.push("attitude from depth images alone: a ramp or a low step counts as a tilt of the body".to_owned());
    }
    if status.floor.is_some() {
        lines.push("floor    not watched: the robot would walk over an edge".to_owned());
    }
    lines.extend(status.no_start_by_voice.iter().map(|why| format!("voice    {why}")));
    lines.push(String::new());
    let rows: Vec<Vec<String>> = status.services.iter().map(service_row).collect();
    lines.extend(table(&["service", "state", "pid", "life", "restarts", "critical"], &rows));
    lines.extend(notes(&status.notes, 5));
    lines
}

fn service_row(service: &ServiceStatus) -> Vec<String> {
    vec![
        service.name.clone(),
        service.state.name().to_owned(),
        if service.pid == 0 { "-".to_owned() } else { service.pid.to_string() },
        service.incarnation.to_string(),
        service.restarts.to_string(),
        (if service.critical { "yes" } else { "no" }).to_owned(),
    ]
}

fn why_lines(why: &Why) -> Vec<String> {
    let mut lines = vec![
        format!("run        {}", why.run),
        format!("mode       {}", mode_line(&why.mode)),
        format!("stands     {}", stands(why)),
        format!("for a cue  {}", why.not_ready_because.as_deref().unwrap_or("ready")),
        String::new(),
    ];
    lines.extend(stops(&why.stops));
    lines.extend(notes(&why.notes, 10));
    lines
}

/// Why the robot stands, as locomotion says.
fn stands(why: &Why) -> &str {
    match why.stands_because.as_deref() {
        Some(reason) if reason == StopKind::None.name() => "it does not",
        Some(reason) => reason,
        None => "locomotion has said nothing yet",
    }
}

/// A table of stops.
pub fn stops(stops: &[Stop]) -> Vec<String> {
    if stops.is_empty() {
        return vec!["no stops".to_owned()];
    }
    let rows: Vec<Vec<String>> = stops.iter().map(stop_row).collect();
    table(&["at", "lasted", "class", "why"], &rows)
}

fn stop_row(stop: &Stop) -> Vec<String> {
    let lasts = if stop.ended { "" } else { " and on" };
    vec![format!("{:.2} s", stop.at_s), format!("{:.2} s{lasts}", stop.lasted_s), stop.class.clone(), stop.why.clone()]
}

/// The last notes of the supervisor.
pub fn notes(notes: &[Note], most: usize) -> Vec<String> {
    let last = &notes[notes.len().saturating_sub(most)..];
    let lines = last.iter().map(|note| format!("{:8.2} s  {}", note.at_s, note.text));
    let head = (!last.is_empty()).then(|| [String::new(), "notes".to_owned()]).into_iter().flatten();
    head.chain(lines).collect()
}

#[cfg(test)]
mod tests {
    use super::{status_lines, why_lines};
    use control::{ModeStatus, SaidStatus, ServicePhase, ServiceStatus, Status, Stop, Why};
    use messages::{ModeClass, SpeechPhase, Urgency};

    #[test]
    fn a_status_is_told_whole_and_without_what_it_lacks() {
        let (text, phase, urgency) = ("Ready.".to_owned(), SpeechPhase::Unheard, Urgency::News);
        let (name, state) = ("lidar".to_owned(), ServicePhase::Ready);
        let status = Status {
            run: "walk".to_owned(),
            supervisor_pid: 7,
            now_s: 1.5,
            mode: ModeStatus {
                reason: Some("boot".to_owned()),
                epoch: 1,
                ready_for_cue: true,
                ..ModeStatus::default()
            },
            services: vec![ServiceStatus {
                name,
                pid: 9,
                state,
                incarnation: 2,
                restarts: 1,
                critical: true,
                ..ServiceStatus::default()
            }],
            said: Some(SaidStatus { text, at_s: 1.0, phase, urgency }),
            stream_age_ms: [("lidar/scan".to_owned(), 20.4)].into(),
            ..Status::default()
        };
        let lines = status_lines(&status).join("\n");
        for what in [
            "run      walk (supervisor 7), 1.5 s",
            "fault: boot (epoch 1), ready for a cue",
            "lidar/scan 20 ms",
            "said     \"Ready.\", 0.5 s ago, unheard",
        ] {
            assert!(lines.contains(what), "{what} is not in\n{lines}");
        }
        assert!(lines.contains("lidar    ready  9    2     1         yes"), "{lines}");
    }

    #[test]
    fn why_lists_the_stops() {
        let (class, why) = ("hold".to_owned(), "no_permit".to_owned());
        let why = Why {
            mode: ModeStatus { class: ModeClass::Run, epoch: 2, ..ModeStatus::default() },
            stands_because: Some("no_permit".to_owned()),
            stops: vec![Stop { class, why, at_s: 3.0, lasted_s: 0.5, ..Stop::default() }],
            ..Why::default()
        };
        let lines = why_lines(&why).join("\n");
        assert!(lines.contains("3.00 s  0.50 s and on  hold   no_permit"), "{lines}");
        assert!(lines.contains("stands     no_permit"), "{lines}");
    }
}
