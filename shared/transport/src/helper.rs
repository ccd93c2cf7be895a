//! Programs of others that a process starts and never waits for: a voice, a player.

use std::io::ErrorKind;
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};

use nix::libc;
use rustix::fs::{MemfdFlags, OFlags};
use rustix::io::Errno;
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, waitid};

/// So much of a program's own words is looked at, bytes, and so much of their last line is told.
const WORDS_BYTES: usize = 4096;
const LINE_CHARS: usize = 200;

/// A program of others. It inherits nothing of the run but what it is given, leads a group of its own, and dies with
/// the thread that started it.
#[derive(Debug)]
pub struct Helper {
    program: String,
    child: Child,
}

impl Helper {
    /// Starts the program that the first word names, with the others as its arguments, `input` on its standard input
    /// and, where `gives`, its standard output to be read without waiting.
    ///
    /// # Errors
    /// Where it cannot be started; the reason names it.
    pub fn start(words: &[String], input: &[u8], gives: bool) -> Result<Self, String> {
        let (program, arguments) = words.split_first().ok_or("no command is named")?;
        let fail = |what: &str, why: &dyn std::fmt::Display| format!("{program}: {what}: {why}");
        let input = in_memory(input).map_err(|errno| fail("its input", &errno))?;
        let mut command = Command::new(program);
        command.args(arguments).stdin(input).stderr(Stdio::piped()).process_group(0);
        command.stdout(if gives { Stdio::piped() } else { Stdio::null() });
        let parent = rustix::process::getpid();
        let alone = move || {
            // iceoryx2 opens its files and sockets without close-on-exec.
            // SAFETY: only flags of descriptors are changed, in the child.
            if unsafe { libc::close_range(3, libc::c_uint::MAX, libc::CLOSE_RANGE_CLOEXEC as libc::c_int) } != 0 {
                return Err(std::io::Error::last_os_error());
            }
            rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
            if rustix::process::getppid() != Some(parent) {
                return Err(Errno::SRCH.into());
            }
            Ok(())
        };
        // SAFETY: the closure makes system calls only: it neither allocates nor takes a lock.
        unsafe { command.pre_exec(alone) };
        let child = command.spawn().map_err(|error| match error.kind() {
            ErrorKind::NotFound => format!("{program} is not there"),
            _ => fail("failed to start", &error),
        })?;
        let helper = Self { program: program.clone(), child };
        for pipe in [helper.child.stdout.as_ref().map(fd_of), helper.child.stderr.as_ref().map(fd_of)] {
            let Some(pipe) = pipe else { continue };
            rustix::fs::fcntl_setfl(pipe, OFlags::NONBLOCK).map_err(|errno| fail("its output", &errno))?;
        }
        Ok(helper)
    }

    /// What it gives, where it does: its descriptor.
    #[must_use]
    pub fn stdout(&self) -> Option<&ChildStdout> {
        self.child.stdout.as_ref()
    }

    /// Takes what it has given until now, `bytes` becoming no longer than `most` and one piece: whether that was all.
    /// Never waits.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn read(&self, bytes: &mut Vec<u8>, most: usize) -> rustix::io::Result<bool> {
        let Some(stdout) = self.stdout() else { return Ok(true) };
        let mut piece = [0; 1 << 16];
        while bytes.len() <= most {
            match rustix::io::read(stdout, &mut piece) {
                Ok(0) => return Ok(true),
                Ok(n) => bytes.extend_from_slice(&piece[..n]),
                Err(Errno::AGAIN | Errno::INTR) => return Ok(false),
                Err(errno) => return Err(errno),
            }
        }
        Ok(false)
    }

    /// Lets other work come first: what it does is in no hurry.
    pub fn do_not_hurry(&self) {
        // Where that is not allowed, it is as fast as others.
        let _ = rustix::process::setpriority_process(self.pid(), 10);
    }

    /// How it ended, if it has; whatever it has started then ends, too. Never waits.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        // Until it is waited for its number is its own, and that of its group.
        let look = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        if let Some(group) = self.pid()
            && matches!(waitid(WaitId::Pid(group), look), Ok(Some(_)))
        {
            let _ = rustix::process::kill_process_group(group, Signal::KILL);
        }
        self.child.try_wait().ok().flatten()
    }

    /// Ends it, and whatever it has started.
    pub fn kill(&mut self) {
        // Once it was waited for, its number may be another's.
        if let Some(group) = self.pid().filter(|_| self.ended().is_none()) {
            // It may be ending by itself.
            let _ = rustix::process::kill_process_group(group, Signal::KILL);
        }
    }

    /// That it failed, in a line: its name, how it ended if it has, and what it said itself.
    pub fn failure(&mut self) -> String {
        let status = self.ended().map_or_else(|| "no end".to_owned(), |status| status.to_string());
        let mut words = [0; WORDS_BYTES];
        let stderr = self.child.stderr.as_ref();
        let n = stderr.and_then(|stderr| rustix::io::read(stderr, &mut words).ok()).unwrap_or(0);
        let words = String::from_utf8_lossy(&words[..n]);
        // Who gives up says why at the end.
        let last = words.lines().map(str::trim).rfind(|line| !line.is_empty()).unwrap_or_default();
        let last: String = last.chars().take(LINE_CHARS).collect();
        let (program, last) = (&self.program, last.replace(char::is_control, " "));
        if last.is_empty() { format!("{program}: {status}") } else { format!("{program}: {status}: {last}") }
    }

    fn pid(&self) -> Option<Pid> {
        i32::try_from(self.child.id()).ok().and_then(Pid::from_raw)
    }
}

impl Drop for Helper {
    /// Whoever drops one that lives no longer wants it.
    fn drop(&mut self) {
        self.kill();
    }
}

fn fd_of(pipe: &impl std::os::fd::AsFd) -> std::os::fd::BorrowedFd<'_> {
    pipe.as_fd()
}

/// A file in memory that holds these bytes, at its beginning: whoever reads it needs nobody who writes.
fn in_memory(bytes: &[u8]) -> rustix::io::Result<OwnedFd> {
    let file = rustix::fs::memfd_create(c"guidedog", MemfdFlags::CLOEXEC)?;
    let mut left = bytes;
    while !left.is_empty() {
        let n = rustix::io::write(&file, left)?;
        left = &left[n..];
    }
    rustix::fs::seek(&file, rustix::fs::SeekFrom::Start(0))?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::Helper;
    use std::time::{Duration, Instant};

    fn words(words: &[&str]) -> Vec<String> {
        words.iter().map(|word| (*word).to_owned()).collect()
    }

    fn end_of(helper: &mut Helper) -> std::process::ExitStatus {
        let since = Instant::now();
        loop {
            if let Some(status) = helper.ended() {
                return status;
            }
            assert!(since.elapsed() < Duration::from_secs(60), "it ends");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    #[test]
    fn it_is_given_its_input_and_inherits_nothing_else() {
        let _leak = std::fs::File::open("/dev/null").expect("there is one");
        let mut helper = Helper::start(&words(&["sh", "-c", "cat; ls /proc/self/fd"]), b"all\n", true).expect("starts");
        assert!(end_of(&mut helper).success());
        let mut bytes = [0; 100];
        let n = rustix::io::read(helper.stdout().expect("it gives"), &mut bytes).expect("readable");
        // 3 is the folder that `ls` reads.
        assert_eq!(String::from_utf8_lossy(&bytes[..n]), "all\n0\n1\n2\n3\n");
    }

    #[test]
    fn what_fails_is_told_with_its_own_words_and_who_is_not_there_by_name() {
        let mut helper =
            Helper::start(&words(&["sh", "-c", "(echo what; echo no card) >&2; exit 3"]), b"", false).expect("starts");
        end_of(&mut helper);
        assert_eq!(helper.failure(), "sh: exit status: 3: no card");
        let error = Helper::start(&words(&["no-such-program"]), b"", false).expect_err("there is none");
        assert_eq!(error, "no-such-program is not there");
        assert!(Helper::start(&[], b"", false).is_err());
    }

    #[test]
    fn it_ends_with_all_that_it_started() {
        ends_with_all("sleep 600 & echo $!; wait", true);
        ends_with_all("sleep 600 & echo $!", false);
    }

    fn ends_with_all(command: &str, is_killed: bool) {
        let mut helper = Helper::start(&words(&["sh", "-c", command]), b"", true).expect("starts");
        let since = Instant::now();
        let mut bytes = [0; 20];
        let n = loop {
            match rustix::io::read(helper.stdout().expect("it gives"), &mut bytes) {
                Ok(n) if n > 0 => break n,
                _ => assert!(since.elapsed() < Duration::from_secs(60), "it begins"),
            }
        };
        let sleeper = String::from_utf8_lossy(&bytes[..n]).trim().to_owned();
        if is_killed {
            helper.kill();
        }
        end_of(&mut helper);
        let stat = || std::fs::read_to_string(format!("/proc/{sleeper}/stat")).unwrap_or_default();
        while !stat().is_empty() && !stat().contains(") Z ") {
            assert!(since.elapsed() < Duration::from_secs(60), "it ends");
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}
