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

/// One model for each handler, and why it is fitted to some of them not.
#[must_use]
pub fn per_subject(kind: ModelKind, recordings: &[Recording], dt_s: f64) -> (Vec<(String, Fit)>, Vec<FitError>) {
    let (mut fits, mut unfittable) = (Vec::new(), Vec::new());
    for (name, walks) in by_subject(recordings) {
        match fit(kind, name, &walks, dt_s) {
            Ok(fit) => fits.push((name.to_owned(), fit)),
            Err(error) => unfittable.push(error),
        }
    }
    (fits, unfittable)
}

/// All models, over the same handlers.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// A row for each model.
    pub rows: Vec<TableRow>,
    /// Who is left out of every row, because a model cannot be fitted to them: which one, and why.
    pub unfittable: Vec<FitError>,
}

/// The whole table.
///
/// # Errors
/// Where nobody is left whom all models can be fitted to.
pub fn table(recordings: &[Recording], dt_s: f64) -> Result<Table, FitError> {
    let kinds = [ModelKind::Rigid, ModelKind::Rod, ModelKind::Delayed];
    let fits = kinds.map(|kind| per_subject(kind, recordings, dt_s));
    let unfittable: Vec<FitError> = fits.iter().flat_map(|(_, unfittable)| unfittable.clone()).collect();
    let is_left = |name: &str| unfittable.iter().all(|error| error.whom() != name);
    let left: Vec<&Recording> = recordings.iter().filter(|recording| is_left(&recording.subject)).collect();
    if let (true, Some(error)) = (left.is_empty(), unfittable.first()) {
        return Err(error.clone());
    }
    let together = |squares: Vec<Squares>| squares.into_iter().fold(Squares::default(), Squares::and).rmse();
    let subjects = by_subject(recordings);
    let of_left = subjects.iter().filter(|(name, _)| is_left(name));
    let start = together(of_left.filter_map(|(_, walks)| unfitted(walks, dt_s)).collect());
    let [rigid, rod, delayed] = fits.map(|(fits, _)| {
        let of_left = fits.into_iter().filter(|(name, _)| is_left(name));
        together(of_left.map(|(_, fit)| fit.validated).collect())
    });
    let pooled = fit(ModelKind::Delayed, "all handlers", &left, dt_s)?.validated.rmse();
    let row = |name, validated, paper_mm| TableRow { name, validated, paper_mm };
    let rows = vec![
        row("Fixed-unopt-ind", start, 136.2),
        row("Fixed-opt-ind", rigid, 102.8),
        row("RR-opt-ind", rod, 431.4),
        row("DH-opt-ind", delayed, 86.3),
        row("DH-opt-all", pooled, 123.1),
    ];
    Ok(Table { rows, unfittable })
}

#[cfg(test)]
mod tests {
    use super::{Table, table};
    use crate::walker::synthesize;

    #[test]
    fn who_cannot_be_fitted_is_listed_and_left_out() {
        let mut recordings = synthesize(1);
        let whole = table(&recordings, 0.5).expect("fitted");
        // One walk is too little to fit anything to; and one who never moves fixes no model but the rigid one.
        let mut extra = recordings[0].clone();
        extra.subject = "only-once".to_owned();
        recordings.push(extra);
        let somebody: Vec<_> = recordings[..15].to_vec();
        for mut still in somebody {
            let first = still.samples[0];
            for sample in &mut still.samples {
                sample.world_from_robot = first.world_from_robot;
                sample.world_from_handler = first.world_from_handler;
            }
            still.subject = "statue".to_owned();
            recordings.push(still);
        }
        let table = table(&recordings, 0.5).expect("the others are fitted");
        assert_eq!(table.rows, whole.rows, "the others count as before");
        let told: Vec<String> = table.unfittable.iter().map(ToString::to_string).collect();
        assert!(told.iter().any(|why| why.contains("recordings of only-once, too few")), "{told:?}");
        assert!(told.iter().any(|why| why.starts_with("delayed for statue: ")), "{told:?}");
    }

    #[test]
    fn fitting_each_handler_and_remembering_are_what_helps_as_in_the_paper() {
        let Table { rows, unfittable } = table(&synthesize(1), 0.5).expect("fitted");
        assert!(unfittable.is_empty(), "{unfittable:?}");
        let mm: Vec<f64> = rows.iter().map(|row| row.validated.expect("steps").position_mm).collect();
        let [unfitted, rigid, rod, delayed, pooled] = mm[..] else { panic!("five rows") };
        assert!(delayed < rigid && rigid < unfitted && delayed < pooled && delayed < rod, "{mm:?}");
    }
}
