//! `guidedog shield`: the shield by itself, asked about cases or about recorded scans.

mod jsonl;
mod recorded;

use crate::args::ShieldArgs;
use crate::exit::Failure;

/// `guidedog shield`.
///
/// # Errors
/// Where a recording or the configuration is wrong, or the answer cannot be written.
pub fn shield(args: &ShieldArgs, as_json: bool) -> Result<(), Failure> {
    match &args.recording {
        Some(recording) => recorded::tell(recording, args.config.as_deref(), as_json),
        None => jsonl::answer_lines(args.thresholds),
    }
}
