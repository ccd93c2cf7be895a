//! `guidedog-backstop`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Backstop, guidedog_bridge::Backstop::open)
}
