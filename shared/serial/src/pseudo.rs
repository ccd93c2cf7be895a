//! The device's end of an emulated serial line.

use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;
use rustix::io::Errno;
use rustix::pty::OpenptFlags;
use rustix::termios::OptionalActions;

/// A pseudo-terminal: whoever opens its path finds a serial port with this at the other end. Dropping it is pulling
/// the plug.
#[derive(Debug)]
pub struct PseudoTerminal {
    fd: OwnedFd,
    link: PathBuf,
    /// Where the link leads.
    terminal: PathBuf,
}

/// Where pseudo-terminals are.
const TERMINALS: &str = "/dev/pts";

impl PseudoTerminal {
    /// Makes one, found at `link`, which is replaced where it leads to a pseudo-terminal or nowhere.
    ///
    /// # Errors
    /// Where the system has none, or the link cannot be made.
    pub fn open(link: &Path) -> std::io::Result<Self> {
        let fd = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        rustix::pty::grantpt(&fd)?;
        rustix::pty::unlockpt(&fd)?;
        let flags = rustix::fs::fcntl_getfl(&fd)?;
        rustix::fs::fcntl_setfl(&fd, flags | OFlags::NONBLOCK)?;
        let mut attributes = rustix::termios::tcgetattr(&fd)?;
        attributes.make_raw();
        rustix::termios::tcsetattr(&fd, OptionalActions::Now, &attributes)?;
        let name = rustix::pty::ptsname(&fd, Vec::new())?;
        let terminal = PathBuf::from(&*name.to_string_lossy());
        // The name of a device that is there stays its own.
        if std::fs::read_link(link).is_ok_and(|leads| leads.starts_with(TERMINALS) || !link.exists()) {
            std::fs::remove_file(link)?;
        }
        std::os::unix::fs::symlink(&terminal, link)?;
        Ok(Self { fd, link: link.to_owned(), terminal })
    }

    /// Where it is found.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.link
    }

    /// The speed at which the other end talks, bits a second.
    #[must_use]
    pub fn baud(&self) -> Option<u32> {
        rustix::termios::tcgetattr(&self.fd).ok().map(|attributes| attributes.output_speed())
    }

    /// Takes what has come; 0 where nothing has, or nobody has opened the other end.
    ///
    /// # Errors
    /// Where the terminal fails.
    pub fn read(&self, buffer: &mut [u8]) -> std::io::Result<usize> {
        match rustix::io::read(&self.fd, buffer) {
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(0),
            other => Ok(other?),
        }
    }

    /// Sends what there is room for, and says how much that was.
    ///
    /// # Errors
    /// Where the terminal fails.
    pub fn write(&self, bytes: &[u8]) -> std::io::Result<usize> {
        match rustix::io::write(&self.fd, bytes) {
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(0),
            other => Ok(other?),
        }
    }
}

impl Drop for PseudoTerminal {
    fn drop(&mut self) {
        // Only a name, which another may have taken: who has it open notices by the line.
        if std::fs::read_link(&self.link).is_ok_and(|leads| leads == self.terminal) {
            let _ = std::fs::remove_file(&self.link);
        }
    }
}
