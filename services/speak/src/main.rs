//! `guidedog-speak`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Speak, guidedog_speak::Speak::open)
}
