//! The arguments of `guidedog evaluate` as they were given, without those that say what to do with the outcomes: what
//! an episode depends on.

use clap::Parser;

use crate::args::evaluate::EvaluateArgs;
use crate::exit::{Failure, one_line};

/// They change no episode.
const BESIDE: [&str; 10] = [
    "--json",
    "--failures",
    "--replay",
    "--outcomes",
    "--resume",
    "--shard",
    "--merge",
    "--pictures",
    "--workers",
    "--paired",
];

/// The arguments alone, for those that a file has.
#[derive(Debug, Parser)]
#[command(name = "evaluate", no_binary_name = true)]
struct Words {
    #[command(flatten)]
    args: EvaluateArgs,
}

/// What this process was called with.
pub fn given() -> Vec<String> {
    let all = std::env::args_os().map(|word| word.to_string_lossy().into_owned());
    kept(&all.skip_while(|word| word != "evaluate").skip(1).collect::<Vec<_>>())
}

fn kept(words: &[String]) -> Vec<String> {
    options(words).into_iter().filter(|option| !BESIDE.contains(&name(option))).flatten().cloned().collect()
}

/// `words`, with the options of `others` in place of its own.
pub fn replaced(words: &[String], others: &[String]) -> Vec<String> {
    let new = options(others);
    let is_replaced = |option: &&[String]| new.iter().any(|other| name(other) == name(option));
    let left = options(words).into_iter().filter(|option| !is_replaced(option));
    left.chain(new.iter().copied()).flatten().cloned().collect()
}

/// Each option with its values: the command has no other arguments.
fn options(words: &[String]) -> Vec<&[String]> {
    words.chunk_by(|_, next| !next.starts_with("--")).collect()
}

fn name(option: &[String]) -> &str {
    option.first().and_then(|word| word.split('=').next()).unwrap_or_default()
}

/// These words, understood.
///
/// # Errors
/// Where the command has no such arguments.
pub fn parsed(words: &[String]) -> Result<EvaluateArgs, Failure> {
    let parsed = Words::try_parse_from(kept(words));
    parsed.map(|words| words.args).map_err(|error| Failure::input(one_line(&error.to_string())))
}

/// A command line for a shell.
pub fn command(words: &[String]) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c);
    let quoted = |word: &String| {
        if !word.is_empty() && word.chars().all(is_plain) {
            word.clone()
        } else {
            format!("'{}'", word.replace('\'', r"'\''"))
        }
    };
    let words: Vec<String> = words.iter().map(quoted).collect();
    ["guidedog", "evaluate"].into_iter().chain(words.iter().map(String::as_str)).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::{command, kept, replaced};

    fn words(text: &str) -> Vec<String> {
        text.split(' ').map(str::to_owned).collect()
    }

    #[test]
    fn what_changes_no_episode_is_left_out_and_options_are_replaced_whole() {
        let given = words("--policy guide --worlds a.yaml b.yaml --failures out --json --seed=3 --paired --workers 2");
        let episodes = kept(&given);
        assert_eq!(episodes, words("--policy guide --worlds a.yaml b.yaml --seed=3"));
        let other = replaced(&episodes, &words("--worlds c.yaml --seed 4"));
        assert_eq!(other, words("--policy guide --worlds c.yaml --seed 4"));
        assert_eq!(replaced(&episodes, &[]), episodes);
        assert_eq!(
            command(&["--config".to_owned(), "my robot's.toml".to_owned()]),
            r"guidedog evaluate --config 'my robot'\''s.toml'"
        );
    }
}
