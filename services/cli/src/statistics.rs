//! Means and rates with intervals of 95 %, as reports tell them.

use serde_json::{Value, json};

use crate::out::number;

/// Of the normal distribution, for 95 %.
const Z: f64 = 1.959_964;

/// A mean with its interval: of numbers, by the normal distribution.
pub fn mean(values: impl Iterator<Item = f64>) -> Value {
    let values: Vec<f64> = values.collect();
    let n = values.len() as f64;
    if values.is_empty() {
        return Value::Null;
    }
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    let half = Z * (variance / n).sqrt();
    json!({ "mean": mean, "lo": mean - half, "hi": mean + half, "n": values.len() })
}

/// A ratio with its interval (Wilson 1927).
pub fn ratio(hits: impl Iterator<Item = bool>) -> Value {
    let hits: Vec<bool> = hits.collect();
    let n = hits.len() as f64;
    if hits.is_empty() {
        return Value::Null;
    }
    let p = hits.iter().filter(|hit| **hit).count() as f64 / n;
    let (z2, center) = (Z * Z, p + Z * Z / (2.0 * n));
    let half = Z * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt();
    let scale = 1.0 + z2 / n;
    let (lo, hi) = ((center - half) / scale, (center + half) / scale);
    json!({ "mean": p, "lo": lo.clamp(0.0, p), "hi": hi.clamp(p, 1.0), "n": hits.len() })
}

/// A mean or a ratio with its interval, as a line for people: the name to a width, then the mean to a width.
pub fn line(name: &str, of: &Value, [name_width, mean_width]: [usize; 2], digits: usize) -> String {
    let value = |key| number(of, key);
    let (mean, lo, hi, n) = (value("/mean"), value("/lo"), value("/hi"), value("/n"));
    format!("{name:<name_width$}{mean:>mean_width$.digits$}  [{lo:.digits$}, {hi:.digits$}]  n = {n}")
}

/// How much more often the first of each pair is true, with its interval (Agresti and Min 2005).
pub fn difference(pairs: &[(bool, bool)]) -> Value {
    if pairs.is_empty() {
        return Value::Null;
    }
    let count = |wanted: (bool, bool)| pairs.iter().filter(|pair| **pair == wanted).count();
    let (first, second) = (count((true, false)), count((false, true)));
    // Half a pair more of each kind.
    let (n, more, less) = (pairs.len() as f64 + 2.0, first as f64 + 0.5, second as f64 + 0.5);
    let center = (more - less) / n;
    let half = Z * (more + less - (more - less).powi(2) / n).sqrt() / n;
    json!({
        "mean": (first as f64 - second as f64) / pairs.len() as f64, "lo": center - half, "hi": center + half,
        "n": pairs.len(), "this_alone": first, "other_alone": second,
    })
}

/// Events an hour, with their interval: of rare events, by Byar's approximation of Poisson's.
pub fn an_hour(count: usize, hours: f64) -> Value {
    rate(count, hours, "hours")
}

/// Events a kilometre, likewise.
pub fn a_km(count: usize, km: f64) -> Value {
    rate(count, km, "km")
}

fn rate(count: usize, all: f64, unit: &str) -> Value {
    if all <= 0.0 {
        return Value::Null;
    }
    let bound = |count: f64, side: f64| {
        if count <= 0.0 { 0.0 } else { count * (1.0 - 1.0 / (9.0 * count) + side * Z / (3.0 * count.sqrt())).powi(3) }
    };
    let (lo, hi) = (bound(count as f64, -1.0), bound(count as f64 + 1.0, 1.0));
    json!({ "mean": count as f64 / all, "lo": lo / all, "hi": hi / all, "count": count, unit: all })
}

#[cfg(test)]
mod tests {
    use super::{an_hour, difference, line, mean, ratio};
    use serde_json::Value;

    fn near(report: &Value, key: &str, expected: f64) {
        let found = report[key].as_f64().expect("a number");
        assert!((found - expected).abs() < 0.02 * expected.max(0.05), "{key} of {report}, not {expected}");
    }

    #[test]
    fn a_line_has_columns() {
        let half = ratio([true, false].into_iter());
        assert_eq!(line("success", &half, [9, 7], 2), "success     0.50  [0.09, 0.91]  n = 2");
    }

    #[test]
    fn intervals_are_those_of_the_books() {
        // Wilson's interval of 9 in 10.
        let nine = ratio((0..10).map(|i| i > 0));
        near(&nine, "lo", 0.5958);
        near(&nine, "hi", 0.9821);
        let four = mean([1.0, 2.0, 3.0, 4.0].into_iter());
        near(&four, "hi", 2.5 + 1.96 * 0.6455);
        assert!(mean(std::iter::empty()).is_null() && ratio(std::iter::empty()).is_null());
        // 15 pairs of 100 in which the first alone is true, 5 in which the second is.
        let pairs: Vec<(bool, bool)> = (0..100).map(|i| (i < 15, (15..20).contains(&i))).collect();
        let more = difference(&pairs);
        near(&more, "mean", 0.10);
        near(&more, "lo", 0.0118);
        near(&more, "hi", 0.1843);
        assert!(difference(&[]).is_null());
        // Poisson's exact intervals: of 0 events 0 to 3.69, of 5 events 1.62 to 11.67.
        near(&an_hour(0, 1.0), "hi", 3.69);
        near(&an_hour(5, 1.0), "lo", 1.62);
        near(&an_hour(5, 1.0), "hi", 11.67);
        near(&an_hour(5, 0.5), "mean", 10.0);
        assert!(an_hour(0, 0.0).is_null());
    }
}
