//! `guidedog-supervisor`: what `guidedog up` becomes.

fn main() -> std::process::ExitCode {
    guidedog_supervisor::main()
}
