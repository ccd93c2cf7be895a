//! Run time from a log's clocks.

use super::report::{Anomaly, Clock, Counts};
use super::survey::Entry;

const US_PER_S: f64 = 1e6;

/// Clocks that leap by more are not believed when there is a reason not to.
const LEAP_US: i64 = 10_000_000;

/// The other clock's word for what is no leap.
const NO_LEAP_US: i64 = 1_000_000;

/// Between two messages of a kind where nothing tells.
const INTERVAL_US: i64 = 100_000;

/// The clock to use: when a message was sent, unless more than one time in twenty is odd, and fewer of the logger's.
pub fn choose(entries: &[Entry]) -> Clock {
    let odd = |clock: Clock| {
        let mut last_us = [None; 2];
        let is_odd = |entry: &Entry| {
            let now_us = time_us(entry, clock);
            let before_us = last_us[usize::from(entry.laser)].replace(now_us);
            before_us.is_some_and(|before_us: i64| now_us <= before_us || now_us - before_us > LEAP_US)
        };
        entries.iter().map(is_odd).filter(|&odd| odd).count()
    };
    let ipc = odd(Clock::Ipc);
    if ipc * 20 > entries.len() && odd(Clock::Logger) < ipc { Clock::Logger } else { Clock::Ipc }
}

/// Run time of each entry, nanoseconds: from 0, in whole microseconds, strictly increasing among the scans and among
/// the others.
pub fn stamps_ns(entries: &[Entry], clock: Clock, counts: &mut Counts) -> Vec<u64> {
    let other = if clock == Clock::Ipc { Clock::Logger } else { Clock::Ipc };
    let next = next_of_kind(entries);
    let mut base = Base { shift_us: 0, last: [None; 2] };
    let mut latest_us = i64::MIN;
    let mut stamps_us = Vec::with_capacity(entries.len());
    for (entry, next) in entries.iter().zip(next) {
        let (now_us, other_us) = (time_us(entry, clock), time_us(entry, other));
        let next_us = next.map(|i| time_us(&entries[i], clock));
        let (stamp_us, anomaly) = base.place(usize::from(entry.laser), now_us, other_us, next_us);
        if let Some(anomaly) = anomaly {
            counts.add(anomaly, 1);
        } else if stamp_us < latest_us {
            counts.add(Anomaly::OutOfOrder, 1);
        }
        latest_us = latest_us.max(stamp_us);
        stamps_us.push(stamp_us);
    }
    let first_us = stamps_us.iter().copied().min().unwrap_or(0);
    stamps_us.into_iter().map(|us| us.abs_diff(first_us) * 1000).collect()
}

fn time_us(entry: &Entry, clock: Clock) -> i64 {
    let seconds = if clock == Clock::Ipc { entry.ipc_s } else { entry.logger_s };
    (seconds * US_PER_S).round() as i64
}

/// For each entry the next of its kind.
fn next_of_kind(entries: &[Entry]) -> Vec<Option<usize>> {
    let mut seen = [None; 2];
    let mut next: Vec<_> =
        entries.iter().enumerate().rev().map(|(i, entry)| seen[usize::from(entry.laser)].replace(i)).collect();
    next.reverse();
    next
}

/// What was placed last of a kind.
#[derive(Clone, Copy)]
struct Placed {
    raw_us: i64,
    other_us: i64,
    stamp_us: i64,
    interval_us: i64,
    shift_us: i64,
}

/// Both kinds have one clock, so a step of it shifts both.
struct Base {
    shift_us: i64,
    last: [Option<Placed>; 2],
}

impl Base {
    /// The stamp of a message of the kind that says `now_us`, and what is odd about it.
    fn place(&mut self, kind: usize, now_us: i64, other_us: i64, next_us: Option<i64>) -> (i64, Option<Anomaly>) {
        let Some(last) = self.last[kind] else {
            let stamp_us = now_us + self.shift_us;
            let shift_us = self.shift_us;
            self.last[kind] = Some(Placed { raw_us: now_us, other_us, stamp_us, interval_us: INTERVAL_US, shift_us });
            return (stamp_us, None);
        };
        let shifted_us = now_us + self.shift_us;
        let other_interval_us = other_us - last.other_us;
        // The other kind has met this very step, and what is left of it is how far the two are apart.
        let known = self.shift_us != last.shift_us && last.stamp_us - shifted_us < NO_LEAP_US;
        let leap = shifted_us - last.stamp_us > LEAP_US;
        let anomaly = if now_us == last.raw_us {
            Some(Anomaly::RepeatedStamp)
        } else if now_us < last.raw_us && shifted_us <= last.stamp_us && !known {
            Some(Anomaly::ClockBackwards)
        } else if leap && (next_us.is_some_and(|next| next < now_us) || (1..=NO_LEAP_US).contains(&other_interval_us)) {
            Some(Anomaly::ClockForwards)
        } else {
            None
        };
        let step = match anomaly {
            // The next is where it should be: this one alone was wrong. A last one alone is no step either.
            Some(Anomaly::ClockBackwards) => next_us.is_some_and(|next| next <= last.raw_us),
            Some(Anomaly::ClockForwards) => next_us.is_some_and(|next| next >= now_us),
            _ => false,
        };
        let alone = anomaly.is_some() && !step;
        if step {
            let told = (1..=LEAP_US).contains(&other_interval_us);
            let interval_us = if told { other_interval_us } else { last.interval_us };
            self.shift_us += last.stamp_us + interval_us - shifted_us;
        }
        let wanted_us = if alone { last.stamp_us + 1 } else { now_us + self.shift_us };
        let stamp_us = wanted_us.max(last.stamp_us + 1);
        self.last[kind] = Some(Placed {
            raw_us: if alone { last.raw_us } else { now_us },
            other_us,
            stamp_us,
            interval_us: if anomaly.is_some() { last.interval_us } else { stamp_us - last.stamp_us },
            shift_us: self.shift_us,
        });
        (stamp_us, anomaly)
    }
}
