//! `guidedog-mujoco`: the simulator of `simulation.physics = "mujoco"`, started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Simulator, guidedog_mujoco::motion::open)
}
