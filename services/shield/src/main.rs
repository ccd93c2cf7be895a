//! `guidedog-shield`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Shield, guidedog_shield::ShieldService::open)
}
