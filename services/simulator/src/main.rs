//! `guidedog-simulator`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Simulator, guidedog_simulator::Simulator::open)
}
