//! `guidedog-locomotion`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Locomotion, guidedog_locomotion::Locomotion::open)
}
