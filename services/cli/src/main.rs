//! `guidedog`: the operator's command.

fn main() -> std::process::ExitCode {
    guidedog_cli::main()
}
