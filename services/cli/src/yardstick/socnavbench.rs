//! `guidedog yardstick socnavbench`.

use crate::args::yardstick::SocnavbenchArgs;
use crate::exit::Failure;

/// See [`super::yardstick`].
pub fn socnavbench(_args: &SocnavbenchArgs, _as_json: bool) -> Result<(), Failure> {
    Err(Failure::input("not yet"))
}
