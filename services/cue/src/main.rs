//! `guidedog-cue`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Cue, guidedog_cue::CueService::open)
}
