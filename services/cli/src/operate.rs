//! `status`, `why`, `cue`, `stop`, `resume`: what an operator asks of a live run.

use control::Request;
use messages::CueKind;
use messages::stops::{STOPS, StopInfo};
use serde_json::{Value, json};

use crate::args::{InjectArgs, RunArg};
use crate::exit::Failure;
use crate::find::ask;
use crate::out::{self, count, elements, entries, number, say, table, text};

/// `guidedog status`
///
/// # Errors
/// As [`ask`].
pub fn status(run: &RunArg, as_json: bool) -> Result<(), Failure> {
    let status = ask(run.run.as_deref(), &Request::Status)?;
    if as_json {
        out::json(&status)?;
    } else {
        status_lines(&status).iter().for_each(say);
    }
    Ok(())
}

/// `guidedog why`
///
/// # Errors
/// As [`ask`].
pub fn why(run: &RunArg, as_json: bool) -> Result<(), Failure> {
    let why = ask(run.run.as_deref(), &Request::Why)?;
    if as_json {
        out::json(&why)?;
    } else {
        why_lines(&why).iter().for_each(say);
    }
    Ok(())
}

/// `guidedog why --reasons`
///
/// # Errors
/// Where nothing can be written.
pub fn reasons(as_json: bool) -> Result<(), Failure> {
    if as_json {
        let row = |stop: &StopInfo| {
            let (name, class) = (stop.kind.name(), stop.class);
            json!({ "reason": name, "class": class, "meaning": stop.meaning, "advice": stop.advice })
        };
        return out::json(&json!({ "reasons": STOPS.iter().map(row).collect::<Vec<Value>>() }));
    }
    let row = |stop: &StopInfo| [stop.kind.name(), stop.class, stop.meaning, stop.advice].map(str::to_owned).to_vec();
    let rows: Vec<Vec<String>> = STOPS.iter().map(row).collect();
    table(&["reason", "class", "what happened", "what to do"], &rows).iter().for_each(say);
    Ok(())
}

/// `guidedog cue`
///
/// # Errors
/// As [`ask`].
pub fn cue(cue: CueKind, run: &RunArg, as_json: bool) -> Result<(), Failure> {
    tell(run, &Request::Cue { cue }, &format!("cue {} given", cue.name()), as_json)
}

/// `guidedog stop`
///
/// # Errors
/// As [`ask`].
pub fn stop(run: &RunArg, as_json: bool) -> Result<(), Failure> {
    tell(run, &Request::Stop, "stopped and locked; `guidedog resume` ends the lock", as_json)
}

/// `guidedog resume`
///
/// # Errors
/// As [`ask`].
pub fn resume(run: &RunArg, as_json: bool) -> Result<(), Failure> {
    tell(run, &Request::Resume, "lock ended; the robot waits for a cue", as_json)
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
    if as_json {
        out::json(&answer)?;
    } else {
        say(done);
    }
    Ok(())
}

/// The mode in a few words.
pub fn mode_line(status: &Value) -> String {
    let reason = text(status, "/mode/reason");
    let reason = if reason.is_empty() { String::new() } else { format!(": {reason}") };
    let ready = match (text(status, "/mode/class"), status.pointer("/mode/ready_for_cue").and_then(Value::as_bool)) {
        ("fault", Some(true)) => ", ready for a cue",
        ("fault", _) => ", not ready for a cue",
        _ => "",
    };
    format!("{}{reason} (epoch {}){ready}", text(status, "/mode/class"), count(status, "/mode/epoch"))
}

/// The cue in force in a few words.
pub fn cue_line(status: &Value) -> String {
    match text(status, "/mode/cue/kind") {
        "" => "none".to_owned(),
        kind => format!("{kind}, since {:.1} s", number(status, "/mode/cue/since_s")),
    }
}

/// What the robot does in a few words.
pub fn robot_line(status: &Value) -> String {
    if !status["world"].is_object() {
        return velocity(status);
    }
    format!(
        "at ({:.2}, {:.2}) heading {:.0} deg, {:.1} m walked, {}",
        number(status, "/world/robot/0"),
        number(status, "/world/robot/1"),
        number(status, "/world/robot/2").to_degrees(),
        number(status, "/world/distance_m"),
        velocity(status),
    )
}

fn velocity(status: &Value) -> String {
    if !status["locomotion"].is_object() {
        return "no word from locomotion".to_owned();
    }
    let limited = match text(status, "/locomotion/limited_by") {
        "" | "none" => String::new(),
        kind => format!(", held by {kind}"),
    };
    let (vx, vy) = (number(status, "/locomotion/velocity/0"), number(status, "/locomotion/velocity/1"));
    format!("{:.2} m/s, {:+.2} rad/s{limited}", vx.hypot(vy), number(status, "/locomotion/velocity/2"))
}

/// What the robot said last.
fn said_line(status: &Value) -> String {
    let ago_s = number(status, "/now_s") - number(status, "/said/at_s");
    let unheard = if text(status, "/said/phase") == "unheard" { ", unheard" } else { "" };
    match text(status, "/said/text") {
        "" => "nothing".to_owned(),
        said => format!("\"{said}\", {ago_s:.1} s ago{unheard}"),
    }
}

/// The ages of the streams in a few words.
pub fn ages_line(status: &Value) -> String {
    let ages =
        entries(status, "/stream_age_ms").map(|(topic, age)| format!("{topic} {:.0}", age.as_f64().unwrap_or(0.0)));
    let ages: Vec<String> = ages.collect();
    if ages.is_empty() { "none yet".to_owned() } else { format!("{} ms", ages.join(", ")) }
}

/// How the handler's voice is heard.
fn hears_line(status: &Value) -> String {
    let (level, clipped) = (number(status, "/microphone/level_dbfs"), 100.0 * number(status, "/microphone/clipped"));
    match text(status, "/microphone/state") {
        "" => "no voice".to_owned(),
        "lost" => "nothing: its source is lost".to_owned(),
        "warming_up" => "not yet: warming up".to_owned(),
        "muted" => "not now: the robot speaks".to_owned(),
        state => {
            let standing_out = number(status, "/microphone/above_floor_db");
            let what = if state == "hearing" { String::new() } else { format!("{state}: ") };
            format!("{what}{level:.0} dBFS, {standing_out:.0} dB above what is always there, {clipped:.1} % cut off")
        }
    }
}

fn status_lines(status: &Value) -> Vec<String> {
    let mut lines = vec![
        format!(
            "run      {} (supervisor {}), {:.1} s",
            text(status, "/run"),
            count(status, "/supervisor_pid"),
            number(status, "/now_s")
        ),
        format!("mode     {}", mode_line(status)),
        format!("cue      {}", cue_line(status)),
        format!("robot    {}", robot_line(status)),
        format!("said     {}", said_line(status)),
        format!("hears    {}", hears_line(status)),
        format!("streams  {}", ages_line(status)),
        String::new(),
    ];
    let rows: Vec<Vec<String>> = elements(status, "/services").iter().map(service_row).collect();
    lines.extend(table(&["service", "state", "pid", "life", "restarts", "critical"], &rows));
    lines.extend(notes(status, 5));
    lines
}

fn service_row(service: &Value) -> Vec<String> {
    let critical = service["critical"].as_bool().unwrap_or(false);
    vec![
        text(service, "/name").to_owned(),
        text(service, "/state").to_owned(),
        service["pid"].as_u64().filter(|pid| *pid > 0).map_or("-".to_owned(), |pid| pid.to_string()),
        count(service, "/incarnation").to_string(),
        count(service, "/restarts").to_string(),
        (if critical { "yes" } else { "no" }).to_owned(),
    ]
}

fn why_lines(why: &Value) -> Vec<String> {
    let or = |path: &str, otherwise: &str| match text(why, path) {
        "" | "none" => otherwise.to_owned(),
        said => said.to_owned(),
    };
    let mut lines = vec![
        format!("run        {}", text(why, "/run")),
        format!("mode       {}", mode_line(why)),
        format!("stands     {}", stands(why)),
        format!("for a cue  {}", or("/not_ready_because", "ready")),
        String::new(),
    ];
    let stops = elements(why, "/stops");
    if stops.is_empty() {
        lines.push("no stops".to_owned());
    } else {
        let rows: Vec<Vec<String>> = stops.iter().map(stop_row).collect();
        lines.extend(table(&["at", "lasted", "class", "why"], &rows));
    }
    lines.extend(notes(why, 10));
    lines
}

/// Why the robot stands, as locomotion says.
fn stands(why: &Value) -> String {
    match why["stands_because"].as_str() {
        Some("none") => "it does not".to_owned(),
        Some(reason) => reason.to_owned(),
        None => "locomotion has said nothing yet".to_owned(),
    }
}

fn stop_row(stop: &Value) -> Vec<String> {
    let lasts = if stop["ended"].as_bool() == Some(false) { " and on" } else { "" };
    vec![
        format!("{:.2} s", number(stop, "/at_s")),
        format!("{:.2} s{lasts}", number(stop, "/lasted_s")),
        text(stop, "/class").to_owned(),
        text(stop, "/why").to_owned(),
    ]
}

/// The last notes of the supervisor.
fn notes(value: &Value, most: usize) -> Vec<String> {
    let notes = elements(value, "/notes");
    let last = &notes[notes.len().saturating_sub(most)..];
    let lines = last.iter().map(|note| format!("{:8.2} s  {}", number(note, "/at_s"), text(note, "/text")));
    let head = (!last.is_empty()).then(|| [String::new(), "notes".to_owned()]).into_iter().flatten();
    head.chain(lines).collect()
}

#[cfg(test)]
mod tests {
    use super::{status_lines, why_lines};
    use serde_json::json;

    #[test]
    fn a_status_is_told_whole_and_without_what_it_lacks() {
        let status = json!({
            "run": "walk", "supervisor_pid": 7, "now_s": 1.5,
            "mode": { "class": "fault", "reason": "boot", "epoch": 1, "ready_for_cue": true, "cue": null },
            "services": [{ "name": "lidar", "pid": 9, "state": "ready", "incarnation": 2, "restarts": 1,
                           "critical": true }],
            "said": { "text": "Ready.", "at_s": 1.0, "phase": "unheard" },
            "stream_age_ms": { "lidar/scan": 20.4 }, "world": null, "locomotion": null, "notes": [],
        });
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
        let why = json!({
            "run": "walk", "mode": { "class": "run", "reason": null, "epoch": 2 }, "stands_because": "no_permit",
            "stops": [{ "class": "hold", "why": "no_permit", "at_s": 3.0, "lasted_s": 0.5, "ended": false }],
        });
        let lines = why_lines(&why).join("\n");
        assert!(lines.contains("3.00 s  0.50 s and on  hold   no_permit"), "{lines}");
        assert!(lines.contains("stands     no_permit"), "{lines}");
    }
}
