//! Numbered work on several threads. Results do not depend on how many there are.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::exit::Failure;

/// Work that is shared out among threads.
pub struct Work {
    /// Threads at most; all cores without it.
    pub threads: Option<u32>,
    /// How many pieces there are, numbered from 0.
    pub count: usize,
    /// What the pieces are called, for people: "episodes".
    pub pieces: &'static str,
}

impl Work {
    /// Does every piece with `piece`, by its number, and returns the results in the order of their numbers. Each thread
    /// has a worker of its own, which `worker` makes.
    ///
    /// # Errors
    /// Where a worker cannot be made, or a piece fails: then no thread begins another piece.
    pub fn run<W: Send, T: Send>(
        &self,
        worker: impl Fn() -> Result<W, Failure>,
        piece: impl Fn(&mut W, usize) -> Result<T, Failure> + Sync,
    ) -> Result<Vec<T>, Failure> {
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        let threads = self.threads.map_or_else(cores, |threads| threads as usize).min(self.count.max(1));
        let workers = (0..threads).map(|_| worker()).collect::<Result<Vec<_>, _>>()?;
        let (next, bar) = (AtomicUsize::new(0), progress(self.count as u64, self.pieces));
        let work = |mut worker: W| -> Result<Vec<(usize, T)>, Failure> {
            let mut done = Vec::new();
            loop {
                let number = next.fetch_add(1, Ordering::Relaxed);
                if number >= self.count {
                    return Ok(done);
                }
                let result = piece(&mut worker, number).inspect_err(|_| next.store(self.count, Ordering::Relaxed))?;
                done.push((number, result));
                bar.inc(1);
            }
        };
        let done = std::thread::scope(|scope| {
            let handles: Vec<_> = workers.into_iter().map(|worker| scope.spawn(|| work(worker))).collect();
            let panicked = || Failure::run(format!("one of the {} panicked", self.pieces));
            let joined = handles.into_iter().map(|handle| handle.join().unwrap_or_else(|_| Err(panicked())));
            joined.collect::<Result<Vec<_>, _>>()
        })?;
        bar.finish_and_clear();
        let mut done: Vec<(usize, T)> = done.into_iter().flatten().collect();
        done.sort_by_key(|(number, _)| *number);
        Ok(done.into_iter().map(|(_, result)| result).collect())
    }
}

/// A progress bar; it shows where standard error is a terminal.
pub fn progress(count: u64, pieces: &str) -> ProgressBar {
    let bar = ProgressBar::new(count);
    let style = ProgressStyle::with_template(&format!("{{bar:40}} {{pos}}/{{len}} {pieces}, {{eta}} left"));
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

#[cfg(test)]
mod tests {
    use super::Work;
    use crate::exit::Failure;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn work(threads: u32, count: usize) -> Work {
        Work { threads: Some(threads), count, pieces: "pieces" }
    }

    #[test]
    fn results_have_the_order_of_their_numbers_on_any_number_of_threads() {
        let made = AtomicUsize::new(0);
        let worker = || {
            made.fetch_add(1, Ordering::Relaxed);
            Ok(0)
        };
        for (threads, count, workers) in [(1, 40, 1), (3, 40, 3), (9, 2, 2), (4, 0, 1)] {
            made.store(0, Ordering::Relaxed);
            let squares = work(threads, count).run(worker, |_, number| Ok(number * number)).expect("squares");
            assert_eq!(squares, (0..count).map(|number| number * number).collect::<Vec<_>>());
            assert_eq!(made.load(Ordering::Relaxed), workers, "{threads} threads, {count} pieces");
        }
    }

    #[test]
    fn a_piece_that_fails_ends_the_work() {
        let begun = AtomicUsize::new(0);
        let fails = |_: &mut (), number: usize| {
            begun.fetch_add(1, Ordering::Relaxed);
            if number == 3 { Err(Failure::run("the fourth")) } else { Ok(()) }
        };
        assert_eq!(work(1, 100).run(|| Ok(()), fails).expect_err("it fails").message, "the fourth");
        assert_eq!(begun.load(Ordering::Relaxed), 4);
        let no_worker = || Err::<(), _>(Failure::run("no worker"));
        assert_eq!(work(2, 1).run(no_worker, |(), _| Ok(())).expect_err("none").message, "no worker");
    }

    #[test]
    fn a_panic_is_an_error() {
        let panics = |_: &mut (), number: usize| if number == 1 { panic!("on purpose") } else { Ok(()) };
        assert_eq!(work(2, 3).run(|| Ok(()), panics).expect_err("it panics").message, "one of the pieces panicked");
    }
}
