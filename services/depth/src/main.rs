//! `guidedog-depth`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Depth, guidedog_depth::DepthDriver::open)
}
