//! `guidedog-emulator`: started by the supervisor.

fn main() -> std::process::ExitCode {
    transport::service_main(messages::ServiceId::Emulator, guidedog_emulator::Emulator::open)
}
