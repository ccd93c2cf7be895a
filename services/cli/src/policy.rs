//! `guidedog policy`: another policy for a live run.

use std::path::{Path, PathBuf};
use std::time::Duration;

use control::Request;
use serde_json::Value;
use settings::PolicyModel;

use crate::args::{PolicyArgs, PolicyRunArgs, PolicyVerb, RunArg, SwapArgs};
use crate::exit::{EXIT_OK, EXIT_SWAP_FAILED, Failure};
use crate::find::ask;
use crate::out::{self, count, elements, say, table, text};

/// The supervisor decides; this is how often it is asked whether it has.
const ASK_EVERY: Duration = Duration::from_millis(50);

/// `guidedog policy`: the exit code.
///
/// # Errors
/// Where a file is missing, there is no such run, or the supervisor refuses.
pub fn policy(args: &PolicyArgs, as_json: bool) -> Result<u8, Failure> {
    match &args.what {
        PolicyVerb::Swap(args) => swap(args, as_json),
        PolicyVerb::Rollback(args) => follow(args, &Request::PolicyRollback, as_json),
        PolicyVerb::Show(run) => show(run, as_json),
    }
}

fn swap(args: &SwapArgs, as_json: bool) -> Result<u8, Failure> {
    let exe = args.exe.as_deref().map(whole_path).transpose()?;
    let mut model = args.model.clone();
    if let Some(path) = model.as_mut().and_then(PolicyModel::file_mut) {
        *path = whole_path(path)?;
    }
    follow(&args.run, &Request::PolicySwap { exe, model: model.map(PathBuf::from) }, as_json)
}

/// A path that can go over the control socket.
pub fn named(path: PathBuf) -> Result<PathBuf, Failure> {
    if path.to_str().is_some() {
        Ok(path)
    } else {
        Err(Failure::input(format!("{}: the path is not UTF-8", path.display())))
    }
}

/// The supervisor works in a folder of its own.
fn whole_path(path: &Path) -> Result<PathBuf, Failure> {
    let found = path.canonicalize().map_err(|error| Failure::input(format!("{}: {error}", path.display())))?;
    if !found.is_file() {
        return Err(Failure::input(format!("{} is not a file", path.display())));
    }
    // Not the link's target: a link may be what names the program.
    named(std::path::absolute(path).map_err(|error| Failure::input(format!("{}: {error}", path.display())))?)
}

/// Asks for a swap, and waits until it is decided.
fn follow(args: &PolicyRunArgs, request: &Request, as_json: bool) -> Result<u8, Failure> {
    let run = args.run.run.as_deref();
    let number = count(&ask(run, request)?, "/swap");
    let mut told = String::new();
    let swap = loop {
        let shown = ask(run, &Request::PolicyShow)?;
        let swap = elements(&shown, "/swaps").iter().rev().find(|swap| count(swap, "/number") == number).cloned();
        let swap = swap.ok_or_else(|| Failure::run(format!("the supervisor has forgotten swap {number}")))?;
        let state = text(&swap, "/state");
        if !as_json && state != told {
            say(format!("swap {number}: {state}"));
            state.clone_into(&mut told);
        }
        if matches!(state, "done" | "rolled_back" | "failed") || (state == "probation" && !args.settle) {
            break swap;
        }
        std::thread::sleep(ASK_EVERY);
    };
    let why = text(&swap, "/why");
    if as_json {
        out::json(&swap)?;
    } else if !why.is_empty() {
        say(why);
    }
    Ok(if text(&swap, "/state") == "failed" { EXIT_SWAP_FAILED } else { EXIT_OK })
}

fn show(run: &RunArg, as_json: bool) -> Result<u8, Failure> {
    let shown = ask(run.run.as_deref(), &Request::PolicyShow)?;
    if as_json {
        out::json(&shown)?;
    } else {
        show_lines(&shown).iter().for_each(say);
    }
    Ok(EXIT_OK)
}

fn show_lines(shown: &Value) -> Vec<String> {
    let mut lines = vec![format!("active     {}", policy_line(&shown["active"]))];
    if shown["previous"].is_object() {
        lines.push(format!("previous   {}", policy_line(&shown["previous"])));
    }
    let swaps = elements(shown, "/swaps");
    if !swaps.is_empty() {
        lines.push(String::new());
        lines.extend(table(&["swap", "state", "life", "of", "why"], &swaps.iter().map(swap_row).collect::<Vec<_>>()));
    }
    lines
}

fn policy_line(policy: &Value) -> String {
    let or = |path: &str, otherwise: &str| match text(policy, path) {
        "" => otherwise.to_owned(),
        said => said.to_owned(),
    };
    let digest = text(policy, "/runs/sha256");
    let digest = if digest.is_empty() { String::new() } else { format!(", sha256 {digest}") };
    let (engine, model) = (or("/runs/engine", "another executable"), or("/runs/model", "as built"));
    let strange = match text(policy, "/runs/not_trained_with") {
        "" => String::new(),
        strange => format!("; not trained with {strange}"),
    };
    format!("life {}: {engine}, {model}{digest}{strange}", count(policy, "/incarnation"))
}

fn swap_row(swap: &Value) -> Vec<String> {
    let of = ["/spec/exe", "/spec/model"].map(|path| text(swap, path)).join(" ");
    vec![
        count(swap, "/number").to_string(),
        text(swap, "/state").to_owned(),
        count(swap, "/candidate").to_string(),
        if of.trim().is_empty() { "as configured".to_owned() } else { of.trim().to_owned() },
        text(swap, "/why").to_owned(),
    ]
}

#[cfg(test)]
mod tests {
    use super::show_lines;
    use serde_json::json;

    #[test]
    fn the_policy_in_force_and_why_a_swap_failed_are_told() {
        let shown = json!({
            "active": { "incarnation": 1, "runs": { "engine": "geometric" } }, "previous": null,
            "swaps": [{ "number": 1, "state": "failed", "candidate": 2, "spec": { "exe": "/x/nan", "model": null },
                        "why": "decision 7: its output is no probability" }],
        });
        let lines = show_lines(&shown).join("\n");
        assert!(lines.contains("active     life 1: geometric, as built"), "{lines}");
        assert!(lines.contains("failed  2     /x/nan  decision 7: its output is no probability"), "{lines}");
    }
}
