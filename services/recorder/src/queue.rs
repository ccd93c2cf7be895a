//! The way of records to their file: a bounded queue, and a thread that writes.

use std::collections::BTreeMap;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use messages::TopicId;
use recording::{About, Record, WriteError, Writer};
use transport::monotonic_ns;

use crate::show::Show;

/// A killed recorder has lost no more than was recorded since the last flush: of wall time and of run time. Half of
/// what is promised, as the disk takes its time too.
const FLUSH_NS: u64 = 250_000_000;

/// What the thread has to say in the end: the file, where it could be written.
type Written = Result<Box<Writer>, WriteError>;

/// A file being written by a thread of its own, so that no disk ever holds up the loop that takes the messages.
#[derive(Debug)]
pub struct Queue {
    sender: Option<SyncSender<Record>>,
    thread: Option<JoinHandle<Written>>,
    /// Whether records wait for room rather than being left out: in stepped time.
    waits: bool,
    /// Records that were left out, by topic.
    left_out: BTreeMap<TopicId, u64>,
    told: bool,
    /// Fault injection: whether the disk is to be taken for full.
    disk_is_full: Arc<AtomicBool>,
}

impl Queue {
    /// A queue of `room` records to `writer`; `show` adds what viewers are shown.
    pub fn new(writer: Writer, room: usize, waits: bool, show: Option<Show>) -> Self {
        let (sender, receiver) = sync_channel(room);
        let disk_is_full = Arc::new(AtomicBool::new(false));
        let full = Arc::clone(&disk_is_full);
        let thread = std::thread::spawn(move || write_all(writer, &receiver, show, &full));
        let left_out = BTreeMap::new();
        Self { sender: Some(sender), thread: Some(thread), waits, left_out, told: false, disk_is_full }
    }

    /// Fault injection: from now on the disk has no room.
    pub fn fill_disk(&self) {
        self.disk_is_full.store(true, Ordering::Relaxed);
    }

    /// Takes a record, where there is room and the file still goes on.
    pub fn keep(&mut self, record: Record) {
        let topic = record.topic();
        let taken = match &self.sender {
            Some(sender) if self.waits => sender.send(record).is_ok(),
            Some(sender) => sender.try_send(record).is_ok(),
            None => false,
        };
        if !taken {
            *self.left_out.entry(topic).or_default() += 1;
        }
    }

    /// Records that were left out, by topic.
    pub fn left_out(&self) -> &BTreeMap<TopicId, u64> {
        &self.left_out
    }

    /// Why the file came to its end before its time, where it did; once.
    pub fn failure(&mut self) -> Option<String> {
        if self.told || !self.thread.as_ref().is_some_and(JoinHandle::is_finished) {
            return None;
        }
        self.told = true;
        self.sender = None;
        self.thread.take().map(|thread| match thread.join() {
            Ok(Err(error)) => chain(&error),
            _ => "its thread ended".to_owned(),
        })
    }

    /// Writes what is waiting, and ends the file.
    ///
    /// # Errors
    /// Where the file could not be written.
    pub fn finish(mut self, about: impl FnOnce(&BTreeMap<TopicId, u64>) -> About) -> Result<(), String> {
        self.sender = None;
        let Some(thread) = self.thread.take() else { return Ok(()) };
        let writer = thread.join().map_err(|_| "its thread panicked".to_owned())?;
        let finished = writer.and_then(|writer| writer.finish(about(&self.left_out)));
        finished.map(drop).map_err(|error| chain(&error))
    }
}

/// Writes until nobody sends any more, and flushes on time.
fn write_all(mut writer: Writer, records: &Receiver<Record>, mut show: Option<Show>, full: &AtomicBool) -> Written {
    let mut flushed_wall_ns = monotonic_ns();
    let mut flushed_run_ns = 0;
    loop {
        let left_ns = (flushed_wall_ns + FLUSH_NS).saturating_sub(monotonic_ns());
        let mut run_ns = flushed_run_ns;
        match records.recv_timeout(Duration::from_nanos(left_ns)) {
            Ok(record) => {
                run_ns = record.time_ns();
                match writer.write(&record) {
                    // One that cannot be recorded is not in the file, whose seqs tell.
                    Ok(()) | Err(WriteError::Record { .. }) => {}
                    Err(error) => return Err(error),
                }
                if let Some((viewer, value)) = show.as_mut().and_then(|show| show.of(&record)) {
                    writer.show(viewer, run_ns, value.to_string().as_bytes())?;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(Box::new(writer)),
        }
        if full.load(Ordering::Relaxed) {
            let (path, source) = (writer.path().to_owned(), io::ErrorKind::StorageFull.into());
            return Err(WriteError::Io { action: "write", path, source });
        }
        let now_ns = monotonic_ns();
        if now_ns >= flushed_wall_ns + FLUSH_NS || run_ns >= flushed_run_ns + FLUSH_NS {
            writer.flush()?;
            (flushed_wall_ns, flushed_run_ns) = (now_ns, run_ns);
        }
    }
}

/// An error with its causes, as one line.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        text = format!("{text}: {error}");
        source = error.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::Queue;
    use messages::{Header, Odometry, TopicId};
    use recording::{About, Part, Record, RunAbout, Writer, recover};
    use std::fs::File;
    use std::io::{self, Seek, SeekFrom, Write};

    /// A disk with so much room: what is over it is written as far as it goes, and then refused.
    struct Disk {
        file: File,
        room: u64,
    }

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let n = bytes.len().min(self.room as usize);
            if n == 0 && !bytes.is_empty() {
                return Err(io::ErrorKind::StorageFull.into());
            }
            self.room -= n as u64;
            self.file.write(&bytes[..n])
        }

        fn flush(&mut self) -> io::Result<()> {
            self.file.flush()
        }
    }

    impl Seek for Disk {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.file.seek(to)
        }
    }

    fn odometry(seq: u64) -> Record {
        let header = Header { stamp_ns: seq * 20_000_000, seq, incarnation: 1, ..Header::default() };
        Record::from(Odometry { header, ..Odometry::default() })
    }

    fn about() -> About {
        let run = RunAbout { name: "test".to_owned(), incarnation: 1, ..RunAbout::default() };
        About { source: "a run".to_owned(), run: Some(run), ..About::default() }
    }

    #[test]
    fn a_full_disk_ends_the_recording_and_what_was_written_is_recovered() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, whole) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
        let disk = Disk { file: File::create(&path).expect("created"), room: 40_000 };
        let writer = Writer::live_into(&path, Box::new(disk), Part::Small, &about(), "").expect("there is room yet");
        let mut queue = Queue::new(writer, 16, true, None);
        let mut failure = None;
        for seq in 1..=20_000 {
            queue.keep(odometry(seq));
            failure = failure.or_else(|| queue.failure());
        }
        while failure.is_none() {
            failure = queue.failure();
            std::thread::yield_now();
        }
        assert!(failure.as_ref().is_some_and(|why| why.contains("a.mcap")), "{failure:?}");
        assert!(queue.left_out()[&TopicId::Odometry] > 0, "what came after is counted");
        assert_eq!(queue.failure(), None, "it is told once");
        assert_eq!(queue.finish(|_| about()), Ok(()));
        assert_eq!(path.metadata().expect("it is there").len(), 40_000, "nothing was written after the failure");
        let recovered = recover(&path, &whole).expect("it can be recovered");
        assert!(recovered.info.records["odometry"] > 100 && recovered.cut_at_byte <= 40_000, "{recovered:?}");
        let records: Vec<Record> =
            recording::Reader::open(&whole).expect("whole").collect::<Result<_, _>>().expect("every record");
        let seqs: Vec<u64> = records.iter().map(|record| record.header().seq).collect();
        assert_eq!(seqs, (1..=seqs.len() as u64).collect::<Vec<_>>());
    }
}
