//! `guidedog-policy`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Policy, guidedog_policy::PolicyService::open)
}
