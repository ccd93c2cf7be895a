//! Exit codes, and the error that carries one. `guidedog --help` lists them.

use std::error::Error;

/// All is well; a walk reached its goal, a replay came to its end.
pub const EXIT_OK: u8 = 0;
/// A walk ended without reaching its goal, a replay before its end, a bench found what must not be, or an enrolment
/// would have done more harm than good.
pub const EXIT_NOT_REACHED: u8 = 1;
/// Arguments, the configuration or an input file cannot be used; nothing was started.
pub const EXIT_BAD_INPUT: u8 = 2;
/// The run failed: a service could not start, the supervisor died, or the machine lacks something.
pub const EXIT_RUN_FAILED: u8 = 3;
/// There is no such run, or several are alive and none is named.
pub const EXIT_NO_RUN: u8 = 4;
/// The supervisor refused: a cue that cannot be taken now, a resume where nothing is locked.
pub const EXIT_REFUSED: u8 = 5;
/// A policy swap failed, and the policy before goes on.
pub const EXIT_SWAP_FAILED: u8 = 6;
/// A replay decides differently from its recording, where it was asked for (`--against`) or may not (`bench replay`).
pub const EXIT_DIFFERENT: u8 = 7;
/// The caller may not do that to this run: its own user and root may, and the group may read.
pub const EXIT_NOT_PERMITTED: u8 = 8;

/// The codes as `guidedog --help` tells them.
pub const EXIT_CODES_HELP: &str = "\
Exit codes:
  0  all is well; a walk reached its goal, a replay came to its end
  1  a walk ended without reaching its goal, a replay before its end, a bench found what must not be, or an enrolment
     would have done more harm than good
  2  arguments, configuration or an input file cannot be used; nothing was started
  3  the run failed (a service could not start, the supervisor died), or the machine lacks something (doctor)
  4  no such run is alive, or several are and none is named with --run
  5  the supervisor refused (a cue that cannot be taken now, a resume where nothing is locked)
  6  a policy swap failed; the policy before goes on
  7  a replay decides differently from its recording (replay --against, bench replay),
     or evaluate --replay walks an episode otherwise than the same program did
  8  the caller may not do that to this run, or may not read its folder: its own user and root may, and the group may
     read";

/// The environment as `guidedog --help` tells it.
pub const ENVIRONMENT_HELP: &str = "\
Environment:
  GUIDEDOG_RUNS    the folder of live runs, else /tmp/guidedog-<uid>; runs are also looked for in /run/guidedog
  GUIDEDOG_STATE   the folder of run records, else $XDG_STATE_HOME/guidedog, else ~/.local/state/guidedog; records are
                   also looked for in /var/lib/guidedog
  GUIDEDOG_CONFIG  a folder of configuration, looked into before ./config and config beside the program";

/// Why the command could not do what it was asked, with its exit code.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    /// One of the exit codes above.
    pub code: u8,
    /// One line that names file, line, key or topic.
    pub message: String,
    /// Whether the JSON object on stdout has told it.
    pub told: bool,
}

impl Failure {
    /// Arguments, configuration or an input file are at fault.
    pub fn input(message: impl Into<String>) -> Self {
        Self { code: EXIT_BAD_INPUT, message: message.into(), told: false }
    }

    /// The run is at fault.
    pub fn run(message: impl Into<String>) -> Self {
        Self { code: EXIT_RUN_FAILED, message: message.into(), told: false }
    }

    /// All went well, and came to nothing.
    pub fn not_reached(message: impl Into<String>) -> Self {
        Self { code: EXIT_NOT_REACHED, message: message.into(), told: false }
    }

    /// There is no such run.
    pub fn no_run(message: impl Into<String>) -> Self {
        Self { code: EXIT_NO_RUN, message: message.into(), told: false }
    }

    /// The supervisor refused.
    pub fn refused(message: impl Into<String>) -> Self {
        Self { code: EXIT_REFUSED, message: message.into(), told: false }
    }

    /// The caller has no right to it.
    pub fn not_permitted(message: impl Into<String>) -> Self {
        Self { code: EXIT_NOT_PERMITTED, message: message.into(), told: false }
    }

    /// For `map_err`: an input is at fault, and the error says which.
    pub fn of_input(error: impl Error) -> Self {
        Self::input(chain(&error))
    }

    /// For `map_err`: the run is at fault, and the error says why.
    pub fn of_run(error: impl Error) -> Self {
        Self::run(chain(&error))
    }
}

/// An error and its causes as one line. A cause that its error has told already is not told again.
pub fn chain(error: &dyn Error) -> String {
    let mut text = one_line(&error.to_string());
    let mut cause = error.source();
    while let Some(error) = cause {
        let more = one_line(&error.to_string());
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        cause = error.source();
    }
    text
}

/// A message of many lines as one: the quoted source lines of a TOML error are left out, its place is kept.
pub fn one_line(text: &str) -> String {
    let quoted = |line: &&str| line.split('|').next().is_some_and(|l| l.trim().chars().all(|c| c.is_ascii_digit()));
    let lines: Vec<&str> =
        text.lines().map(str::trim).filter(|line| !(line.is_empty() || line.contains('|') && quoted(line))).collect();
    lines.join(": ")
}

#[cfg(test)]
mod tests {
    use super::{EXIT_CODES_HELP, Failure, chain, one_line};

    #[test]
    fn the_help_lists_every_code() {
        let codes: Vec<u8> =
            EXIT_CODES_HELP.lines().skip(1).filter_map(|line| line.split_whitespace().next()?.parse().ok()).collect();
        assert_eq!(codes, [0, 1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(Failure::input("").code, 2);
        assert_eq!(Failure::run("").code, 3);
        assert_eq!(Failure::no_run("").code, 4);
        assert_eq!(Failure::refused("").code, 5);
        assert_eq!(Failure::not_permitted("").code, 8);
    }

    #[test]
    fn a_toml_error_becomes_one_line_that_names_its_line() {
        let text =
            "x.toml: TOML parse error at line 2, column 1\n  |\n2 | beems = 3\n  | ^^^^^\nunknown field `beems`\n";
        assert_eq!(one_line(text), "x.toml: TOML parse error at line 2, column 1: unknown field `beems`");
    }

    #[test]
    fn causes_are_followed() {
        let error = recording::ReadError::Io {
            path: "a.mcap".into(),
            byte: 7,
            source: std::io::Error::other("the disk is gone"),
        };
        assert_eq!(chain(&error), "failed to read a.mcap at byte 7: the disk is gone");
    }
}
