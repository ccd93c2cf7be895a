//! `guidedog-replay`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Replay, guidedog_replay::Replay::open)
}
