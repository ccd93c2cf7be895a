//! Cleans up what dead processes left in a run's shared memory, in a thread of its own: it takes milliseconds a node,
//! and no stop may wait for that.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use iceoryx2::node::NodeView;
use iceoryx2::prelude::{CallbackProgression, Config, Node, NodeState, ipc};

use crate::{Domain, TransportError};

/// One dead node is cleaned for at most this long at a time.
const NODE_LIMIT: Duration = Duration::from_millis(50);
/// What could not be cleaned is tried again after this long.
const RETRY: Duration = Duration::from_millis(200);
/// A node that could not be cleaned so often died in the middle of its start: iceoryx2 skips its half-made files, so
/// they are removed by hand.
const ROUNDS: u32 = 3;

/// The supervisor's janitor.
#[derive(Debug)]
pub struct Janitor {
    requests: Option<Sender<()>>,
    asked: u64,
    done: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl Janitor {
    /// A janitor for the run of `domain`, with nothing to do yet.
    ///
    /// # Errors
    /// Where no thread can be had.
    pub fn start(domain: &Domain) -> Result<Self, TransportError> {
        let (requests, inbox) = channel();
        let done = Arc::new(AtomicU64::new(0));
        let (config, told) = (domain.config()?, Arc::clone(&done));
        let nodes = domain.dir.iceoryx2_root().join("nodes");
        let thread = std::thread::Builder::new()
            .name("janitor".to_owned())
            .spawn(move || work(&inbox, &told, &config, &nodes))
            .map_err(TransportError::service)?;
        Ok(Self { requests: Some(requests), asked: 0, done, thread: Some(thread) })
    }

    /// A process has died: its slots are to be freed. Returns at once.
    pub fn clean(&mut self) {
        if let Some(requests) = &self.requests {
            self.asked += 1;
            // A janitor that is gone leaves everything to the end of the run.
            let _ = requests.send(());
        }
    }

    /// Whether everything that was asked for has been done, as far as it could be.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.done.load(Ordering::Acquire) >= self.asked
    }
}

impl Drop for Janitor {
    fn drop(&mut self) {
        // The end of the inbox is the end of the thread.
        self.requests = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn work(inbox: &Receiver<()>, done: &AtomicU64, config: &Config, nodes: &Path) {
    let mut failures: BTreeMap<PathBuf, u32> = BTreeMap::new();
    loop {
        let asked = if failures.is_empty() {
            inbox.recv().map_err(|_| RecvTimeoutError::Disconnected)
        } else {
            inbox.recv_timeout(RETRY)
        };
        if asked == Err(RecvTimeoutError::Disconnected) {
            return;
        }
        failures = clean(config, nodes, &failures);
        for (node, rounds) in &mut failures {
            if *rounds >= ROUNDS {
                remove_half_made(node);
                *rounds = 0;
            }
        }
        if asked.is_ok() {
            done.fetch_add(1, Ordering::Release);
        }
    }
}

/// Cleans all dead nodes: the directories of those that could not be, and how often by now.
fn clean(config: &Config, nodes: &Path, before: &BTreeMap<PathBuf, u32>) -> BTreeMap<PathBuf, u32> {
    let mut failures = BTreeMap::new();
    let listed = Node::<ipc::Service>::list(config, |state| {
        if let NodeState::Dead(node) = state {
            let dir = nodes.join(node.id().value().to_string());
            if node.blocking_remove_stale_resources(NODE_LIMIT).is_err() {
                let rounds = before.get(&dir).copied().unwrap_or(0) + 1;
                failures.insert(dir, rounds);
            }
        }
        CallbackProgression::Continue
    });
    // Where the nodes cannot be listed now, what failed before is tried again.
    if listed.is_ok() { failures } else { before.clone() }
}

fn remove_half_made(node: &Path) {
    let Ok(entries) = std::fs::read_dir(node) else { return };
    for entry in entries.flatten() {
        // What is left is removed with the run.
        let _ = std::fs::remove_file(entry.path());
    }
}
