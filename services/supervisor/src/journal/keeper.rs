//! The record of a run from its start to its end.

use std::io::Write;

use control::Report;
use records::{About, EventFile, Keep, Record};
use settings::RunRecordSettings;
use transport::{RunDir, TransportError};

use super::output::{LogTo, Output};

/// What is kept of the run, and the threads that write its journal.
pub struct Keeper {
    record: Option<Record>,
    output: Output,
    /// Why there is no record, where there was to be one.
    pub without: Option<String>,
}

impl Keeper {
    /// Begins the journal, and the record of the run where it can be written: a robot whose disk is full walks without.
    pub fn begin(log: LogTo, name: &str, settings: &str, keep: RunRecordSettings, dir: &RunDir) -> Self {
        let begun = if keep.keep_runs == 0 { Ok(None) } else { begin(name, settings, keep, dir).map(Some) };
        let (kept, why) = match begun {
            Ok(kept) => (kept, None),
            Err(why) => (None, Some(why)),
        };
        let (record, events) = kept.unzip();
        let without = why.map(|why| format!("this run leaves no record: {why}"));
        Self { record, output: Output::begin(log, events), without }
    }

    /// Writes how the run ended, after its last event.
    pub fn end(self, name: &str, outcome: &Result<Report, TransportError>) {
        let failed = |error: &TransportError| Report {
            run: name.to_owned(),
            failure: Some(error.to_string()),
            ..Report::default()
        };
        let failure = outcome.as_ref().err().map(failed);
        let Some(report) = outcome.as_ref().ok().or(failure.as_ref()) else { return };
        super::ended(report);
        self.output.tell_dropped(report.duration_s);
        drop(self.output);
        if let Some(Err(why)) = self.record.map(|record| record.end(report)) {
            // The reader may be gone; there is nobody else to tell.
            let _ = writeln!(std::io::stderr(), "guidedog-supervisor: the end of the run is not recorded: {why}");
        }
    }
}

/// The record and the file of its events; the services' logs go there from now on.
fn begin(name: &str, settings: &str, keep: RunRecordSettings, dir: &RunDir) -> Result<(Record, EventFile), String> {
    let root = records::own_root().ok_or("this user has no home; GUIDEDOG_STATE names a folder for records")?;
    let keep = Keep { runs: keep.keep_runs as usize, bytes: u64::from(keep.keep_mib) << 20 };
    let about = About::now(name, env!("CARGO_PKG_VERSION"));
    let record = Record::begin(&root, &about, settings, keep).map_err(|error| error.to_string())?;
    let events = record.events().map_err(|error| error.to_string());
    let linked = events.and_then(|events| {
        dir.keep_logs_in(&record.logs()).map_err(|error| error.to_string())?;
        Ok(events)
    });
    match linked {
        Ok(events) => Ok((record, events)),
        Err(why) => {
            record.discard();
            Err(why)
        }
    }
}
