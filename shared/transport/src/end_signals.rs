//! The signals that ask a program to end.

use crate::TransportError;

/// Calls `handle` at SIGINT, SIGTERM and SIGHUP; at SIGHUP not where this program was started to ignore it (`nohup`).
///
/// # Errors
/// Where handlers cannot be set, as when there are some already.
pub fn on_end_signals(handle: impl FnMut() + Send + 'static) -> Result<(), TransportError> {
    let ignores_hup = ignores_hup();
    ctrlc::set_handler(handle).map_err(TransportError::service)?;
    if ignores_hup {
        // SAFETY: no handler of this program is replaced by one that could break it: the signal is ignored.
        unsafe { nix::sys::signal::signal(nix::sys::signal::Signal::SIGHUP, nix::sys::signal::SigHandler::SigIgn) }
            .map_err(TransportError::service)?;
    }
    Ok(())
}

/// Whether SIGHUP, signal 1, is the first bit of those that this process ignores.
fn ignores_hup() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask & 1 != 0)
}
