//! `guidedog-brake`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Brake, guidedog_brake::Brake::open)
}
