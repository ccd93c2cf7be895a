//! `guidedog fit-robot`: how a robot answers a command, identified from recordings of single motions.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use fitting::response::{Drive, Excursion, Figure, Identified, Sway, identify};
use recording::{Reader, Record};
use serde_json::json;
use settings::{Origin, Settings};

use crate::args::FitRobotArgs;
use crate::exit::Failure;
use crate::out;

/// What is known of the robot in a recording.
#[derive(Debug, PartialEq)]
struct Robot {
    name: String,
    origin: Origin,
}

/// `guidedog fit-robot`.
///
/// # Errors
/// Where a recording cannot be read or tells too little, the robot did not obey, or the file is there already.
pub fn fit_robot(args: &FitRobotArgs, as_json: bool) -> Result<(), Failure> {
    let mut drives = Vec::new();
    let mut robot: Option<Robot> = None;
    for path in &args.recordings {
        let (drive, of) = read(path)?;
        if let Some(other) = robot.as_ref().filter(|other| **other != of) {
            let told = |robot: &Robot| format!("{} ({})", robot.name, robot.origin.name());
            let what = format!("{} is of the robot {}, and those before of {}", drive.name, told(&of), told(other));
            return Err(Failure::input(what));
        }
        robot = Some(of);
        drives.push(drive);
    }
    let Some(robot) = robot else { return Err(Failure::input("no recording is named")) };
    let found = identify(&drives).map_err(Failure::of_input)?;
    let names: Vec<&str> = drives.iter().map(|drive| drive.name.as_str()).collect();
    let section = section(&found, &robot, &names)?;
    if let Some(path) = &args.output {
        write(path, &section)?;
    }
    if as_json {
        let mut report = serde_json::to_value(&found).map_err(Failure::of_run)?;
        report["recordings"] = json!(names);
        report["robot"] = json!(robot.name);
        report["origin"] = json!(robot.origin);
        report["output"] = json!(args.output);
        return out::json(&report);
    }
    let moved: usize = found.motions.values().sum();
    out::raw(&format!("{} ({}), {moved} motions", robot.name, robot.origin.name()))?;
    for line in out::table(&["", "value", "95 %", "largest", "n"], &rows(&found)) {
        out::raw(&line)?;
    }
    out::raw(&format!("\n{}", section.trim_end()))
}

/// What a recording tells of commands and poses, and which robot is in it.
fn read(path: &Path) -> Result<(Drive, Robot), Failure> {
    let name = path.display().to_string();
    let mut reader = Reader::open(path).map_err(Failure::of_input)?;
    let info = reader.info().clone();
    let text = reader.settings().map_err(Failure::of_input)?;
    let text = text.ok_or_else(|| Failure::input(format!("{name} is an import: it has no commands to a robot")))?;
    let settings = settings::load_over(&format!("the settings recorded in {name}"), &text, None);
    let settings = settings.map_err(Failure::of_input)?;
    if settings.replays() {
        let what = format!("{name} was recorded in a replay: its robot did not hear the commands");
        return Err(Failure::input(what));
    }
    let mut drive = Drive { name, ..Drive::default() };
    let mut in_world = false;
    for record in reader {
        match record.map_err(Failure::of_input)? {
            Record::Odometry(odometry) => drive.odometry.push(*odometry),
            Record::LocomotionState(state) => drive.commands.push((state.header.stamp_ns, state.applied)),
            Record::WorldTruth(_) => in_world = true,
            _ => {}
        }
    }
    drive.odometry.sort_by_key(|odometry| odometry.header.stamp_ns);
    drive.commands.sort_by_key(|(at_ns, _)| *at_ns);
    drive.odometry.dedup_by_key(|odometry| odometry.header.stamp_ns);
    drive.commands.dedup_by_key(|(at_ns, _)| *at_ns);
    Ok((drive, Robot { name: info.about.robot, origin: origin(&settings, in_world) }))
}

/// Where a response comes from that is identified in a run of these settings. Whatever hints at a simulation makes it
/// one.
fn origin(settings: &Settings, in_world: bool) -> Origin {
    let real = settings.commands_robot() && !settings.has_world() && !in_world && !settings.robot_is_here();
    if real { Origin::Measured } else { Origin::Simulated }
}

/// `[robot.response]`, as the configuration takes it.
fn section(found: &Identified, robot: &Robot, names: &[&str]) -> Result<String, Failure> {
    let profile = &found.profile;
    let moved: usize = found.motions.values().sum();
    // A name is the caller's, and may have more lines than one.
    let names = crate::exit::one_line(&names.join(", "));
    let text = format!(
        "# How the robot answers a command: guidedog fit-robot of {names}\n\
         # ({moved} motions of the robot {}), rounded up.\n\
         [robot.response]\norigin = \"{}\"\nlag = \"{}ms\"\nway_off_m = {}\nturn_off_rad = {}\n\
         overrun_m = [{:?}, {:?}]\noverrun_rad = {:?}\n",
        robot.name,
        robot.origin.name(),
        profile.lag_ms,
        profile.way_off_m,
        profile.turn_off_rad,
        profile.overrun_m[0],
        profile.overrun_m[1],
        profile.overrun_rad,
    );
    let settings: Settings = toml::from_str(&text).map_err(Failure::of_run)?;
    settings::check(&settings).map_err(Failure::run)?;
    Ok(text)
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    let failed = |error: std::io::Error| Failure::input(format!("{}: {error}", path.display()));
    File::create_new(path).and_then(|mut file| file.write_all(text.as_bytes())).map_err(failed)
}

/// The figures as lines of a table.
fn rows(found: &Identified) -> Vec<Vec<String>> {
    let mut rows = Vec::new();
    for (name, axis) in &found.axes {
        rows.push(row(&format!("{name}: delay, ms"), &axis.delay_s, 1e3, false));
        rows.push(row(&format!("{name}: time constant, ms"), &axis.time_constant_s, 1e3, false));
        rows.push(row(&format!("{name}: both, ms"), &axis.answer_s, 1e3, false));
        rows.push(row(&format!("{name}: speed, % of the commanded"), &axis.gain, 1e2, false));
    }
    let overruns = found.overrun.iter().map(|(kind, overrun)| (format!("overrun, {kind}"), &overrun.until_standing));
    let farthest = found.overrun.iter().map(|(kind, overrun)| (format!("in 1.5 s, {kind}"), &overrun.farthest));
    for (name, excursion) in overruns.chain(farthest) {
        rows.extend(excursions(&name, excursion));
    }
    let gaits = found.gait.iter().map(|(kind, sway)| (format!("sway, {kind}"), sway));
    for (name, sway) in gaits.chain(found.standing.iter().map(|sway| ("sway, standing".to_owned(), sway))) {
        rows.extend(sways(&name, sway));
    }
    rows.push(row("error of way, cm", &found.way_off_m, 1e2, true));
    rows.push(row("error of heading, deg", &found.turn_off_rad, 1f64.to_degrees(), true));
    rows
}

fn excursions(name: &str, excursion: &Excursion) -> [Vec<String>; 3] {
    [
        row(&format!("{name}: along, cm"), &excursion.along_m, 1e2, true),
        row(&format!("{name}: across, cm"), &excursion.across_m, 1e2, true),
        row(&format!("{name}: heading, deg"), &excursion.turn_rad, 1f64.to_degrees(), true),
    ]
}

fn sways(name: &str, sway: &Sway) -> Vec<Vec<String>> {
    let degrees = 1f64.to_degrees();
    let all = [
        ("along, cm", Some(&sway.along_m), 1e2),
        ("across, cm", Some(&sway.across_m), 1e2),
        ("heading, deg", Some(&sway.turn_rad), degrees),
        ("roll, deg", sway.roll_rad.as_ref(), degrees),
        ("pitch, deg", sway.pitch_rad.as_ref(), degrees),
    ];
    let told = all.into_iter().filter_map(|(what, figure, scale)| Some((what, figure?, scale)));
    told.map(|(what, figure, scale)| row(&format!("{name}: {what}"), figure, scale, true)).collect()
}

/// A figure times `scale`; a fitted one has no largest value.
fn row(name: &str, figure: &Figure, scale: f64, largest: bool) -> Vec<String> {
    let number = |value: f64| format!("{:.1}", value * scale);
    vec![
        name.to_owned(),
        number(figure.value),
        format!("{} to {}", number(figure.lo), number(figure.hi)),
        if largest { number(figure.max) } else { String::new() },
        figure.n.to_string(),
    ]
}

#[cfg(test)]
mod tests {
    use super::{Origin, origin};
    use settings::Settings;

    #[test]
    fn a_simulated_run_is_never_measured() {
        let real = "[lidar]\nsource = \"device\"\n[depth]\nsource = \"device\"\n[odometry]\nsource = \"device\"\n";
        let of = |text: &str, in_world: bool| {
            let settings: Settings = toml::from_str(text).expect("right");
            origin(&settings, in_world)
        };
        let link = |link: &str, more: &str| format!("{real}[locomotion]\nlink = \"{link}\"\n{more}");
        for name in ["unitree", "go2", "ros2"] {
            assert_eq!(of(&link(name, ""), false), Origin::Measured);
            assert_eq!(of(&link(name, ""), true), Origin::Simulated, "there is a world in the recording");
            assert_eq!(of(&link(name, "[simulation.emulated]\non = true\n"), false), Origin::Simulated);
            let here = "unitree = { robot = \"127.0.0.1:8082\" }\ndds = { networks = [\"127.0.0.1\"] }\n";
            assert_eq!(of(&link(name, here), false), Origin::Simulated, "an emulated robot, started by hand");
        }
        assert_eq!(of(real, false), Origin::Simulated);
        assert_eq!(of("", false), Origin::Simulated);
        assert_eq!(of(&link("null", ""), false), Origin::Simulated);
    }
}
