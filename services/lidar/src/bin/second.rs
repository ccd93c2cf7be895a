//! `guidedog-second_lidar`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::SecondLidar, guidedog_lidar::LidarDriver::open_second)
}
