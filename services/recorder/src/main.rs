//! `guidedog-recorder`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Recorder, guidedog_recorder::Recorder::open)
}
