//! What goes out. Reports go to standard output: lines for people, or one JSON object with `--json`. Progress, prompts
//! and errors go to standard error. A reader that closes its pipe early is no error.

use std::io::Write;

use serde_json::Value;

use crate::exit::Failure;

/// A line of progress, or a prompt or an error, on standard error.
pub fn say(line: impl AsRef<str>) {
    // If standard error is closed, there is nowhere left to report it.
    let _ = writeln!(std::io::stderr().lock(), "{}", line.as_ref());
}

/// The one JSON object of a verb with `--json`.
///
/// # Errors
/// As [`raw`].
pub fn json(value: &Value) -> Result<(), Failure> {
    raw(&value.to_string())
}

/// A line on standard output.
///
/// # Errors
/// Where it cannot be written, as on a full disk. A reader that has gone away wanted no more, which is no error.
pub fn raw(line: &str) -> Result<(), Failure> {
    report([line])
}

/// A report for people on standard output, line by line.
///
/// # Errors
/// As [`raw`].
pub fn report(lines: impl IntoIterator<Item = impl AsRef<str>>) -> Result<(), Failure> {
    let mut out = std::io::BufWriter::new(std::io::stdout().lock());
    let all = lines.into_iter().try_for_each(|line| writeln!(out, "{}", line.as_ref()));
    written(all.and_then(|()| out.flush()))
}

/// The report of a verb: the JSON object with `--json`, else the lines for people.
///
/// # Errors
/// As [`raw`].
pub fn tell<L: AsRef<str>>(as_json: bool, value: &Value, lines: impl FnOnce() -> Vec<L>) -> Result<(), Failure> {
    if as_json { json(value) } else { report(lines()) }
}

/// The result of writing to standard output.
///
/// # Errors
/// As [`raw`].
pub fn written(result: std::io::Result<()>) -> Result<(), Failure> {
    match result {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::run(format!("failed to write to standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// A text of another program without what would steer a terminal.
pub fn plain(text: &str) -> String {
    text.replace(|c: char| c.is_control() && c != '\t', " ")
}

/// The text at a path of keys, or nothing.
pub fn text<'a>(value: &'a Value, path: &str) -> &'a str {
    value.pointer(path).and_then(Value::as_str).unwrap_or_default()
}

/// The number at a path of keys, or 0.
pub fn number(value: &Value, path: &str) -> f64 {
    value.pointer(path).and_then(Value::as_f64).unwrap_or_default()
}

/// The whole number at a path of keys, or 0.
pub fn count(value: &Value, path: &str) -> u64 {
    value.pointer(path).and_then(Value::as_u64).unwrap_or_default()
}

/// The elements of a list, or of none.
pub fn elements<'a>(value: &'a Value, path: &str) -> &'a [Value] {
    value.pointer(path).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// Rows under their headings, each column as wide as it must be; numbers are the caller's to align.
pub fn table(headings: &[&str], rows: &[Vec<String>]) -> Vec<String> {
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count());
        cells.chain([headings[column].len()]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..headings.len()).map(width).collect();
    let line = |cells: Vec<&str>| {
        let padded = cells.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}"));
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    let head = line(headings.to_vec());
    std::iter::once(head).chain(rows.iter().map(|row| line(row.iter().map(String::as_str).collect()))).collect()
}

#[cfg(test)]
mod tests {
    use super::table;

    #[test]
    fn columns_are_aligned() {
        let rows = [vec!["lidar".to_owned(), "1".to_owned()], vec!["x".to_owned(), "22".to_owned()]];
        assert_eq!(table(&["name", "n"], &rows), ["name   n", "lidar  1", "x      22"]);
    }
}
