//! `guidedog-bridge`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Bridge, guidedog_bridge::Bridge::open)
}
