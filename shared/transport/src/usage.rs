//! What this process uses: told in every beat, read five times a second.

use crate::monotonic_ns;

const PERIOD_NS: u64 = 200_000_000;

/// Memory and descriptors of this process.
#[derive(Debug, Default)]
pub(crate) struct Usage {
    pub resident_bytes: u64,
    pub private_bytes: u64,
    pub open_files: u32,
    read_ns: Option<u64>,
}

impl Usage {
    /// Reads them anew, where the last reading is old.
    pub fn refresh(&mut self) {
        let now = monotonic_ns();
        if self.read_ns.is_some_and(|read| now < read + PERIOD_NS) {
            return;
        }
        self.read_ns = Some(now);
        // What cannot be read now (no descriptor may be left for it) stays as it was.
        let statm = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
        if let Some((resident, private)) = parse_statm(&statm, rustix::param::page_size() as u64) {
            (self.resident_bytes, self.private_bytes) = (resident, private);
        }
        if let Some(count) = open_files() {
            self.open_files = count;
        }
    }
}

/// How many files are open. The kernel tells it as the size of the folder since Linux 6.2; before, they are counted,
/// which takes a tenth of a millisecond and more.
fn open_files() -> Option<u32> {
    const FOLDER: &str = "/proc/self/fd";
    let told = std::fs::metadata(FOLDER).ok()?.len();
    if told > 0 {
        return u32::try_from(told).ok();
    }
    std::fs::read_dir(FOLDER).ok().map(|entries| entries.count() as u32)
}

/// Bytes resident, and those of them that are neither a file's nor shared.
fn parse_statm(statm: &str, page_bytes: u64) -> Option<(u64, u64)> {
    let mut pages = statm.split_ascii_whitespace().skip(1).map_while(|text| text.parse::<u64>().ok());
    let (resident, shared) = (pages.next()?, pages.next()?);
    Some((resident * page_bytes, resident.saturating_sub(shared) * page_bytes))
}

#[cfg(test)]
mod tests {
    use super::{Usage, parse_statm};

    #[test]
    fn what_is_shared_is_not_its_own() {
        assert_eq!(parse_statm("900 300 100 20 0 80 0\n", 4096), Some((300 * 4096, 200 * 4096)));
        assert_eq!(parse_statm("900", 4096), None);
    }

    #[test]
    fn memory_that_is_taken_is_told() {
        let mut usage = Usage::default();
        usage.refresh();
        let before = usage.private_bytes;
        assert!(before > 0 && usage.open_files > 2 && usage.resident_bytes >= before);
        let taken = vec![1u8; 32 << 20];
        usage.read_ns = None;
        usage.refresh();
        assert!(usage.private_bytes >= before + (30 << 20), "{} after {before}", usage.private_bytes);
        drop(taken);
    }
}
