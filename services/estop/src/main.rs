//! `guidedog-estop`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Estop, guidedog_estop::EstopDriver::open)
}
