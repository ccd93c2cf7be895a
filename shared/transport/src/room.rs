//! Room in shared memory. Its files are sparse: where it is full, the first touch of a page is a SIGBUS. So nobody
//! starts where there is no room, and who is ready has every page that it will ever write to.

use rustix::io::Errno;

use crate::TransportError;

/// Where iceoryx2 keeps its segments.
pub const SHM: &str = "/dev/shm";
/// What must be free for a service to start: all that one without frames writes to, and the ends that its peers make
/// for it (together some 0.3 MiB). Pools of frames are taken whole by [`take_all`].
const TO_START_BYTES: u64 = 1 << 20;

/// Bytes of shared memory: all, and those left.
///
/// # Errors
/// Where there is none, or this process may not write to it.
pub fn shared_memory_bytes() -> Result<(u64, u64), TransportError> {
    rustix::fs::access(SHM, rustix::fs::Access::WRITE_OK).map_err(TransportError::system("writing to /dev/shm"))?;
    let stat = rustix::fs::statvfs(SHM).map_err(TransportError::system("statvfs /dev/shm"))?;
    Ok((stat.f_blocks.saturating_mul(stat.f_frsize), stat.f_bavail.saturating_mul(stat.f_frsize)))
}

/// Refuses to start where a peer, or this process, would be killed for want of a page.
pub(crate) fn check() -> Result<(), TransportError> {
    let (_, left) = shared_memory_bytes()?;
    if left < TO_START_BYTES { Err(full(format!("{} KiB are left", left >> 10))) } else { Ok(()) }
}

/// Touches all that this process may write to in the run's shared memory: no first touch while it works, neither slow
/// nor, where it is full by then, deadly.
pub(crate) fn take_all(prefix: &str) -> Result<(), TransportError> {
    let maps = std::fs::read_to_string("/proc/self/maps")
        .map_err(|error| TransportError::Service(format!("/proc/self/maps: {error}")))?;
    for (from, to) in maps.lines().filter(|line| line.contains(prefix)).filter_map(writable) {
        // SAFETY: populating changes no byte of the mapping.
        let taken = unsafe {
            let start = std::ptr::with_exposed_provenance_mut(from);
            rustix::mm::madvise(start, to - from, rustix::mm::Advice::LinuxPopulateWrite)
        };
        match taken {
            // A kernel before 5.14 does not know how: the first messages pay instead.
            Ok(()) | Err(Errno::INVAL) => {}
            Err(errno) => return Err(full(format!("{} KiB cannot be had ({errno})", (to - from) >> 10))),
        }
    }
    Ok(())
}

/// The range of a shared mapping that may be written to, of a line of `/proc/self/maps`.
fn writable(line: &str) -> Option<(usize, usize)> {
    let (range, rest) = line.split_once(' ')?;
    let (from, to) = range.split_once('-')?;
    let range = (usize::from_str_radix(from, 16).ok()?, usize::from_str_radix(to, 16).ok()?);
    rest.starts_with("rw-s").then_some(range)
}

fn full(what: String) -> TransportError {
    TransportError::Service(format!("{SHM} is full: {what}; `guidedog doctor` tells what a run takes"))
}

#[cfg(test)]
mod tests {
    use super::writable;

    #[test]
    fn only_what_is_shared_and_writable_is_taken() {
        let line = |rights: &str| format!("7f00-8f00 {rights} 00000000 00:1b 33   /dev/shm/gd_1.data");
        assert_eq!(writable(&line("rw-s")), Some((0x7f00, 0x8f00)));
        for rights in ["r--s", "rw-p", "---s"] {
            assert_eq!(writable(&line(rights)), None, "{rights}");
        }
        assert_eq!(writable(""), None);
    }
}
