//! `guidedog-odometry`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Odometry, guidedog_odometry::OdometryDriver::open)
}
