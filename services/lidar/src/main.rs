//! `guidedog-lidar`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Lidar, guidedog_lidar::LidarDriver::open)
}
