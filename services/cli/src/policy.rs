//! `guidedog policy`: another policy for a live run.

use std::path::{Path, PathBuf};
use std::time::Duration;

use control::{Policies, PolicyLife, Request, SwapRecord, SwapState};
use serde_json::json;
use settings::PolicyModel;

use crate::args::{PolicyArgs, PolicyRunArgs, PolicyVerb, SwapArgs};
use crate::exit::{EXIT_OK, EXIT_SWAP_FAILED, Failure};
use crate::find;
use crate::operate;
use crate::out::{self, say, table};

/// The supervisor decides; this is how often it is asked whether it has.
const ASK_EVERY: Duration = Duration::from_millis(50);

/// `guidedog policy`: the exit code.
///
/// # Errors
/// Where a file is missing, there is no such run, or the supervisor refuses.
pub fn policy(args: &PolicyArgs, as_json: bool) -> Result<u8, Failure> {
    match &args.what {
        PolicyVerb::Swap(args) => swap(args, as_json),
        PolicyVerb::Rollback(args) => follow(args, &Request::PolicyRollback {}, as_json),
        PolicyVerb::Show(run) => operate::show(run, as_json, show_lines).map(|()| EXIT_OK),
    }
}

fn swap(args: &SwapArgs, as_json: bool) -> Result<u8, Failure> {
    let exe = args.exe.as_deref().map(whole_path).transpose()?;
    let mut model = args.model.clone();
    if let Some(path) = model.as_mut().and_then(PolicyModel::file_mut) {
        *path = whole_path(path)?.into();
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
    let begun = find::tell(run, request)?;
    let number = begun.swap.ok_or_else(|| Failure::run("the supervisor does not say which swap has begun"))?;
    let mut told = None;
    let swap = loop {
        let policies: Policies = find::read(run)?;
        let swap = policies.swap(number).cloned();
        let swap = swap.ok_or_else(|| Failure::run(format!("the supervisor has forgotten swap {number}")))?;
        if swap.state == SwapState::Unknown {
            let what = "is in a state that this program does not know; see `guidedog policy show --json`";
            return Err(Failure::run(format!("swap {number} {what}")));
        }
        if swap.state.is_over() || (swap.state == SwapState::Probation && !args.settle) {
            break swap;
        }
        if !as_json && told != Some(swap.state) {
            say(format!("swap {number}: {}", swap.state));
            told = Some(swap.state);
        }
        std::thread::sleep(ASK_EVERY);
    };
    out::tell(as_json, &json!(swap), || {
        let why = swap.why.as_ref().map_or_else(String::new, |why| format!(": {why}"));
        vec![format!("swap {number}: {}{why}", swap.state)]
    })?;
    Ok(if swap.state == SwapState::Failed { EXIT_SWAP_FAILED } else { EXIT_OK })
}

fn show_lines(policies: &Policies) -> Vec<String> {
    let mut lines = vec![format!("active     {}", policy_line(&policies.active))];
    if let Some(previous) = &policies.previous {
        lines.push(format!("previous   {}", policy_line(previous)));
    }
    if !policies.swaps.is_empty() {
        let rows: Vec<Vec<String>> = policies.swaps.iter().map(swap_row).collect();
        lines.push(String::new());
        lines.extend(table(&["swap", "state", "life", "of", "why"], &rows));
    }
    lines
}

fn policy_line(policy: &PolicyLife) -> String {
    let (engine, model) = (policy.says("engine").unwrap_or("another executable"), policy.says("model"));
    let digest = policy.says("sha256").map_or_else(String::new, |digest| format!(", sha256 {digest}"));
    let strange = policy.says("not_trained_with");
    let strange = strange.map_or_else(String::new, |strange| format!("; not trained with {strange}"));
    format!("life {}: {engine}, {}{digest}{strange}", policy.incarnation, model.unwrap_or("as built"))
}

fn swap_row(swap: &SwapRecord) -> Vec<String> {
    let of = [&swap.spec.exe, &swap.spec.model].into_iter().flatten().map(|path| path.display().to_string());
    let of: Vec<String> = of.collect();
    vec![
        swap.number.to_string(),
        swap.state.to_string(),
        swap.candidate.to_string(),
        if of.is_empty() { "as configured".to_owned() } else { of.join(" ") },
        swap.why.clone().unwrap_or_default(),
    ]
}

#[cfg(test)]
mod tests {
    use super::show_lines;
    use control::{Policies, PolicyLife, PolicySpec, SwapRecord, SwapState};
    use serde_json::json;

    #[test]
    fn the_policy_in_force_and_why_a_swap_failed_are_told() {
        let why = Some("decision 7: its output is no probability".to_owned());
        let spec = PolicySpec { exe: Some("/x/nan".into()), model: None };
        let policies = Policies {
            active: PolicyLife { incarnation: 1, runs: Some(json!({ "engine": "geometric" })) },
            swaps: vec![SwapRecord { number: 1, state: SwapState::Failed, candidate: 2, previous: 1, spec, why }],
            ..Policies::default()
        };
        let lines = show_lines(&policies).join("\n");
        assert!(lines.contains("active     life 1: geometric, as built"), "{lines}");
        assert!(lines.contains("failed  2     /x/nan  decision 7: its output is no probability"), "{lines}");
    }
}
