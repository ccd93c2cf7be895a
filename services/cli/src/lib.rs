//! `guidedog`: the operator's command. It starts runs, talks to their supervisors over the control socket, and holds no
//! state of its own.
//!
//! Reports go to standard output; with `--json` it holds one JSON object and nothing else. Progress, prompts and errors
//! go to standard error. Mistakes in configuration, worlds, routes and recordings are found before anything is started.

mod args;
mod bench;
mod bundle;
mod config;
mod cues;
mod doctor;
mod emulate;
mod evaluate;
mod exit;
mod find;
mod fit;
mod fit_robot;
mod floor;
mod history;
mod import;
mod launch;
mod legs;
mod live;
mod logs;
mod map_view;
mod operate;
mod out;
mod policy;
mod prepare;
mod prepare_replay;
mod record;
mod recording_files;
mod replays;
mod runs;
mod shield;
mod statistics;
mod summary;
mod workers;
mod yardstick;

use std::io::Write;
use std::process::ExitCode;

use clap::Parser;
use serde_json::json;

use args::{Bench, Cli, Verb};
use exit::{EXIT_OK, Failure, one_line};

/// The whole of `guidedog`.
#[must_use]
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    let as_json = cli.json;
    match perform(cli) {
        Ok(code) => ExitCode::from(code),
        Err(failure) => {
            if as_json && !failure.told {
                // Where nothing can be written there either, stderr and the exit code say it.
                let _ = out::json(&json!({ "error": failure.message }));
            }
            out::say(format!("guidedog: {}", failure.message));
            ExitCode::from(failure.code)
        }
    }
}

/// What clap has to say: help and version on stdout, errors on stderr.
fn usage(error: &clap::Error) -> ExitCode {
    if error.use_stderr() && std::env::args_os().any(|arg| arg == "--json") {
        let text = error.to_string();
        let first = text.split("\n\n").next().unwrap_or_default();
        // Where nothing can be written there, stderr and the exit code say it.
        let _ = out::json(&json!({ "error": one_line(first).trim_start_matches("error: ") }));
    }
    let printed = error.print().and_then(|()| std::io::stdout().flush());
    if let Err(failure) = out::written(printed) {
        out::say(format!("guidedog: {}", failure.message));
        return ExitCode::from(failure.code);
    }
    ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(exit::EXIT_BAD_INPUT))
}

fn perform(cli: Cli) -> Result<u8, Failure> {
    let json = cli.json;
    let done = |outcome: Result<(), Failure>| outcome.map(|()| EXIT_OK);
    match cli.verb {
        Verb::Up(args) => Err(runs::up(&args, json)),
        Verb::Walk(args) => runs::walk(&args, json),
        Verb::Replay(args) => replays::replay(&args, json),
        Verb::Record(args) => done(record::record(&args, json)),
        Verb::Recording(args) => done(recording_files::recording(&args, json)),
        Verb::Config(args) => done(config::config(&args, json)),
        Verb::Runs => done(history::runs(json)),
        Verb::Logs(args) => done(logs::logs(&args, json)),
        Verb::Bundle(args) => done(bundle::bundle(&args, json)),
        Verb::Status(run) => done(operate::status(&run, json)),
        Verb::Why(args) if args.reasons => done(operate::reasons(json)),
        Verb::Why(args) => done(operate::why(&args.run, json)),
        Verb::Cue(args) => done(cues::cue(&args.verb, json)),
        Verb::Stop(run) => done(operate::stop(&run, json)),
        Verb::Resume(run) => done(operate::resume(&run, json)),
        Verb::Policy(args) => policy::policy(&args, json),
        Verb::Inject(args) => done(operate::inject(&args, json)),
        Verb::Doctor(args) => doctor::doctor(&args, json),
        Verb::Import(args) => done(import::import(&args, json)),
        Verb::Bench(args) => match args.what {
            Bench::Transport { seconds } => done(bench::transport::bench(seconds, json)),
            Bench::Shield { times } => done(bench::shield::bench(times, json)),
            Bench::Decoders { times } => done(bench::decoders::bench(times, json)),
            Bench::Depth { times } => done(bench::depth::bench(times, json)),
            Bench::Link { seconds } => done(bench::link::bench(seconds, json)),
            Bench::World { times } => done(bench::world::bench(times, json)),
            Bench::Odometry { logs, relations } => done(bench::odometry::bench(&logs, relations.as_deref(), json)),
            Bench::Replay { recording, repeat, config } => {
                bench::replay::bench(&recording, repeat, config.as_deref(), json)
            }
            Bench::Faults(args) => bench::faults::bench(&args, json),
            Bench::Soak(args) => bench::soak::bench(&args, json),
            Bench::Swaps { count } => bench::swaps::bench(count, json),
            Bench::Idle { seconds } => done(bench::idle::bench(seconds, json)),
        },
        Verb::Fit(args) => done(fit::fit(&args, json)),
        Verb::FitRobot(args) => done(fit_robot::fit_robot(&args, json)),
        Verb::Evaluate(args) => done(evaluate::evaluate(&args, json)),
        Verb::Yardstick(args) => done(yardstick::yardstick(&args, json)),
        Verb::EvaluateCues(args) => done(cues::evaluate(&args, json)),
        Verb::Emulate(args) => done(emulate::emulate(&args)),
        Verb::Shield(args) => done(shield::shield(&args, json)),
        Verb::Floor(args) => done(floor::floor(&args, json)),
        Verb::BenchReceiver(args) => done(bench::receiver::receive(&args)),
    }
}
