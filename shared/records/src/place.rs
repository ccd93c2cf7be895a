//! Where records lie.

use std::path::PathBuf;

/// Where the system's service keeps its records (`StateDirectory` of config/systemd/guidedog.service).
const SERVICE_ROOT: &str = "/var/lib/guidedog";

fn variable(name: &str) -> Option<PathBuf> {
    std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from)
}

/// The state folder of this process: `$GUIDEDOG_STATE`, else what systemd gives its service, else
/// `$XDG_STATE_HOME/guidedog`, else `~/.local/state/guidedog`; none for a user without a home.
#[must_use]
pub fn own_root() -> Option<PathBuf> {
    variable("GUIDEDOG_STATE")
        .or_else(|| variable("STATE_DIRECTORY"))
        .or_else(|| variable("XDG_STATE_HOME").map(|state| state.join("guidedog")))
        .or_else(|| variable("HOME").map(|home| home.join(".local/state/guidedog")))
        .and_then(|root| std::path::absolute(root).ok())
}

/// Where records are looked for: `$GUIDEDOG_STATE` alone, else this user's folder and that of the system's service.
pub(crate) fn roots() -> Vec<PathBuf> {
    let own = own_root();
    if variable("GUIDEDOG_STATE").is_some() {
        return own.into_iter().collect();
    }
    let service = PathBuf::from(SERVICE_ROOT);
    own.into_iter().filter(|own| *own != service).chain([service.clone()]).collect()
}
