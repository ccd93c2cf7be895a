//! The models side by side, beside the paper's figures (Kim et al. 2023, table 1).

use std::collections::BTreeMap;

use crate::data::Recording;
use crate::fit::{Fit, FitError, ModelKind, Rmse, Squares, fit, unfitted};
use crate::walker::SIMULATED;

/// A row of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct TableRow {
    /// The paper's name.
    pub name: &'static str,
    /// Errors on the walks that nothing was fitted to, all handlers together.
    pub validated: Option<Rmse>,
    /// What the paper has, millimetres: three blind and six blindfolded handlers, motion capture.
    pub paper_mm: f64,
}

/// The recordings of each handler.
#[must_use]
pub fn by_subject(recordings: &[Recording]) -> BTreeMap<&str, Vec<&Recording>> {
    let mut map: BTreeMap<&str, Vec<&Recording>> = BTreeMap::new();
    for recording in recordings {
        map.entry(&recording.subject).or_default().push(recording);
    }
    map
}

/// The handlers that are simulated, by their names.
#[must_use]
pub fn simulated(recordings: &[Recording]) -> Vec<&str> {
    by_subject(recordings).into_keys().filter(|name| name.starts_with(SIMULATED)).collect()
}

/// One model for each handler.
///
/// # Errors
/// Where one of them cannot be fitted.
pub fn per_subject(kind: ModelKind, recordings: &[Recording], dt_s: f64) -> Result<Vec<(String, Fit)>, FitError> {
    let subjects = by_subject(recordings);
    subjects.iter().map(|(name, walks)| Ok(((*name).to_owned(), fit(kind, name, walks, dt_s)?))).collect()
}

/// The whole table.
///
/// # Errors
/// Where a model cannot be fitted.
pub fn table(recordings: &[Recording], dt_s: f64) -> Result<Vec<TableRow>, FitError> {
    let together = |squares: Vec<Squares>| squares.into_iter().fold(Squares::default(), Squares::and).rmse();
    let start = by_subject(recordings).values().filter_map(|walks| unfitted(walks, dt_s)).collect();
    let of =
        |kind| Ok(together(per_subject(kind, recordings, dt_s)?.into_iter().map(|(_, fit)| fit.validated).collect()));
    let all: Vec<&Recording> = recordings.iter().collect();
    let pooled = fit(ModelKind::Delayed, "all handlers", &all, dt_s)?;
    let row = |name, validated, paper_mm| TableRow { name, validated, paper_mm };
    Ok(vec![
        row("Fixed-unopt-ind", together(start), 136.2),
        row("Fixed-opt-ind", of(ModelKind::Rigid)?, 102.8),
        row("RR-opt-ind", of(ModelKind::Rod)?, 431.4),
        row("DH-opt-ind", of(ModelKind::Delayed)?, 86.3),
        row("DH-opt-all", pooled.validated.rmse(), 123.1),
    ])
}

#[cfg(test)]
mod tests {
    use super::table;
    use crate::walker::synthesize;

    #[test]
    fn fitting_each_handler_and_remembering_are_what_helps_as_in_the_paper() {
        let rows = table(&synthesize(1), 0.5).expect("fitted");
        let mm: Vec<f64> = rows.iter().map(|row| row.validated.expect("steps").position_mm).collect();
        let [unfitted, rigid, rod, delayed, pooled] = mm[..] else { panic!("five rows") };
        assert!(delayed < rigid && rigid < unfitted && delayed < pooled && delayed < rod, "{mm:?}");
    }
}
