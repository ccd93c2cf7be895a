//! `guidedog fit`: interaction models fitted to recorded walks.

use std::fs::File;
use std::io::{BufReader, BufWriter};

use fitting::fit::{FitError, Rmse, predict};
use fitting::picture::{Trace, svg};
use fitting::table::{TableRow, by_subject, per_subject, simulated, table};
use fitting::{Fit, ModelKind, Recording, data, walker};
use guidance::se2::Se2;
use guidance::{DelayedHarness, InteractionModel, RigidHarness};
use messages::Pose2;
use serde_json::{Value, json};

use crate::args::{FitArgs, FitModel};
use crate::exit::Failure;
use crate::out;

/// Decision periods, from and to, seconds.
const DT_S: (f64, f64) = (0.01, 5.0);

/// `guidedog fit`.
///
/// # Errors
/// Where the data cannot be read, a model cannot be fitted, or a file cannot be written.
pub fn fit(args: &FitArgs, as_json: bool) -> Result<(), Failure> {
    let recordings = recordings(args)?;
    let dt_s = args.dt.s();
    if !(DT_S.0..=DT_S.1).contains(&dt_s) {
        return Err(Failure::input(format!("--dt is {dt_s} s, not in {}..{} s", DT_S.0, DT_S.1)));
    }
    if let Some(path) = &args.svg {
        let text = picture(&recordings, dt_s)?;
        std::fs::write(path, text).map_err(|error| Failure::input(format!("{}: {error}", path.display())))?;
    }
    let mut report = json!({
        "dt_s": dt_s,
        "subjects": by_subject(&recordings).keys().collect::<Vec<_>>(),
        "simulated_subjects": simulated(&recordings),
        "recordings": recordings.len(),
    });
    match args.model {
        None => {
            let table = table(&recordings, dt_s).map_err(Failure::of_input)?;
            report["rows"] = table.rows.iter().map(row_json).collect();
            report["unfittable"] = table.unfittable.iter().map(unfittable_json).collect();
        }
        Some(model) => {
            let kind = kind(model);
            let (fits, unfittable) = if args.pooled {
                let all: Vec<&Recording> = recordings.iter().collect();
                let fit = fitting::fit::fit(kind, "all handlers", &all, dt_s).map_err(Failure::of_input)?;
                (vec![("all".to_owned(), fit)], Vec::new())
            } else {
                per_subject(kind, &recordings, dt_s)
            };
            if let (true, Some(error)) = (fits.is_empty(), unfittable.first()) {
                return Err(Failure::of_input(error));
            }
            report["unfittable"] = unfittable.iter().map(unfittable_json).collect();
            report["fits"] = fits.iter().map(|(subject, fit)| fit_json(subject, fit)).collect();
        }
    }
    out::tell(as_json, &report, || lines(&report))
}

fn kind(model: FitModel) -> ModelKind {
    match model {
        FitModel::Rigid => ModelKind::Rigid,
        FitModel::Rod => ModelKind::Rod,
        FitModel::Delayed => ModelKind::Delayed,
    }
}

fn recordings(args: &FitArgs) -> Result<Vec<Recording>, Failure> {
    if let Some(path) = &args.data {
        let name = path.display().to_string();
        let failed = |error: std::io::Error| Failure::input(format!("{name}: {error}"));
        // Before it is opened: opening a pipe would wait for its writer.
        if !path.metadata().map_err(failed)?.is_file() {
            return Err(Failure::input(format!("{name} is not a file")));
        }
        let file = File::open(path).map_err(failed)?;
        return data::read(&name, BufReader::new(file)).map_err(Failure::of_input);
    }
    let recordings = walker::synthesize(args.seed);
    if let Some(path) = &args.output {
        let failed = |error: &dyn std::fmt::Display| Failure::input(format!("{}: {error}", path.display()));
        let file = File::create_new(path).map_err(|error| failed(&error))?;
        data::write(&recordings, BufWriter::new(file)).map_err(|error| failed(&error))?;
    }
    Ok(recordings)
}

fn rmse_json(rmse: Option<Rmse>) -> Value {
    rmse.map_or(Value::Null, |rmse| json!({ "position_mm": rmse.position_mm, "heading_deg": rmse.heading_deg }))
}

fn row_json(row: &TableRow) -> Value {
    json!({ "name": row.name, "validation": rmse_json(row.validated), "paper_position_mm": row.paper_mm })
}

fn unfittable_json(error: &FitError) -> Value {
    json!({ "subject": error.whom(), "why": error.to_string() })
}

fn fit_json(subject: &str, fit: &Fit) -> Value {
    let parameters: Vec<Value> = fit
        .kind
        .parameters()
        .iter()
        .zip(fit.parameters.iter().zip(&fit.half_width))
        .map(|(name, (value, half))| json!({ "name": name, "value": value, "ci95": [value - half, value + half] }))
        .collect();
    json!({
        "subject": subject,
        "model": fit.kind.name(),
        "parameters": parameters,
        "fit": rmse_json(fit.fitted.rmse()),
        "validation": rmse_json(fit.validated.rmse()),
        "recordings": { "fit": fit.recordings.0, "validation": fit.recordings.1 },
        "refused_by_runtime": fit.refused.as_ref().map(ToString::to_string),
    })
}

/// The first subject's last walk, with the rigid and the delayed harness fitted to the subject.
fn picture(recordings: &[Recording], dt_s: f64) -> Result<String, Failure> {
    let subjects = by_subject(recordings);
    let (subject, walks) = subjects.iter().next().ok_or_else(|| Failure::input("no walk to draw"))?;
    let walk = walks.last().ok_or_else(|| Failure::input("no walk to draw"))?;
    let steps = walk.steps(dt_s);
    let fitted = |kind| fitting::fit::fit(kind, subject, walks, dt_s).map_err(Failure::of_input);
    let (rigid, delayed) = (fitted(ModelKind::Rigid)?.parameters, fitted(ModelKind::Delayed)?.parameters);
    let offset = |p: &[f64]| Pose2::new(p[0], p[1], p[2]);
    let rigid = RigidHarness::new(offset(&rigid)).map_err(Failure::of_run)?;
    let delayed = DelayedHarness::unbounded(offset(&delayed), delayed[3], dt_s).map_err(Failure::of_run)?;
    let rigid = predict(&InteractionModel::Rigid(rigid), &steps);
    let delayed = predict(&InteractionModel::Delayed(delayed), &steps);
    let (robot, handler): (Vec<Se2>, Vec<Se2>) = steps.into_iter().unzip();
    let title = format!("{subject}, trajectory {}, walk {}", walk.trajectory, walk.repetition);
    let trace = |name, color, poses| Trace { name, color, poses };
    Ok(svg(
        &title,
        &[
            trace("robot", "#222222", &robot),
            trace("handler, as recorded", "#e69f00", &handler),
            trace("rigid harness", "#999999", &rigid),
            trace("delayed harness", "#009e73", &delayed),
        ],
    ))
}

fn lines(report: &Value) -> Vec<String> {
    let simulated = out::elements(report, "/simulated_subjects").len();
    let subjects = out::elements(report, "/subjects").len();
    let walks = out::count(report, "/recordings");
    let mut lines = vec![format!("{subjects} handlers, {simulated} of them simulated; {walks} walks")];
    let rmse = |value: &Value, part: &str, key: &str| format!("{:>8.1}", out::number(value, &format!("/{part}/{key}")));
    for left_out in out::elements(report, "/unfittable") {
        lines.push(format!("left out: {}", out::text(left_out, "/why")));
    }
    let rows: Vec<Vec<String>> = out::elements(report, "/rows")
        .iter()
        .map(|row| {
            vec![
                out::text(row, "/name").to_owned(),
                rmse(row, "validation", "position_mm"),
                rmse(row, "validation", "heading_deg"),
                format!("{:>8.1}", out::number(row, "/paper_position_mm")),
            ]
        })
        .collect();
    if !rows.is_empty() {
        lines.extend(out::table(&["model", "RMSE, mm", "deg", "paper, mm"], &rows));
    }
    let fits: Vec<Vec<String>> = out::elements(report, "/fits")
        .iter()
        .map(|fit| {
            let parameters: Vec<String> = out::elements(fit, "/parameters")
                .iter()
                .map(|p| {
                    let half = (out::number(p, "/ci95/1") - out::number(p, "/ci95/0")) / 2.0;
                    format!("{} {:.3} +- {half:.3}", out::text(p, "/name"), out::number(p, "/value"))
                })
                .collect();
            vec![
                out::text(fit, "/subject").to_owned(),
                rmse(fit, "fit", "position_mm"),
                rmse(fit, "validation", "position_mm"),
                rmse(fit, "validation", "heading_deg"),
                parameters.join(", "),
            ]
        })
        .collect();
    if !fits.is_empty() {
        lines.extend(out::table(&["subject", "fit, mm", "validation, mm", "deg", "parameters, 95 %"], &fits));
    }
    lines
}
