//! Where a program of a setting's command is.

use std::path::{Path, PathBuf};

/// The file of a program: the path itself where it has a slash, or else the first of that name in PATH. `None` where
/// there is no such file.
#[must_use]
pub fn find_program(program: &str) -> Option<PathBuf> {
    if program.contains('/') {
        return Some(PathBuf::from(program)).filter(|path| Path::is_file(path));
    }
    let folders = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&folders).map(|folder| folder.join(program)).find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::find_program;

    #[test]
    fn a_program_is_found_by_its_path_or_in_path() {
        assert!(find_program("sh").is_some_and(|path| path.is_absolute()));
        assert_eq!(find_program("/bin/sh"), Some("/bin/sh".into()));
        assert_eq!(find_program("/bin"), None, "a folder is no program");
        assert_eq!((find_program("no-such-program"), find_program("./no-such-program")), (None, None));
    }
}
