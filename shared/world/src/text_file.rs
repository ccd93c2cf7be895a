//! Text files with bounded size, and TOML errors that name file and line.

use std::io::Read;
use std::ops::Range;
use std::path::Path;

use serde::de::DeserializeOwned;

use crate::WorldError;

/// No world, route or map description is longer; what is, is some other file.
const MAX_BYTES: u64 = 4 << 20;

/// Reads a text file.
pub(crate) fn read(path: &Path) -> Result<String, WorldError> {
    let file = path.display().to_string();
    let failed = |source| WorldError::Read { file: file.clone(), source };
    let mut text = String::new();
    let opened = open(path).map_err(failed)?;
    opened.take(MAX_BYTES + 1).read_to_string(&mut text).map_err(failed)?;
    if text.len() as u64 > MAX_BYTES {
        return Err(WorldError::Parse { file, line: 1, what: format!("file is longer than {MAX_BYTES} bytes") });
    }
    Ok(text)
}

/// Opens a regular file, and nothing else: opening a pipe would wait for its writer.
pub(crate) fn open(path: &Path) -> std::io::Result<std::fs::File> {
    if !path.metadata()?.is_file() {
        return Err(std::io::Error::other("it is not a file"));
    }
    std::fs::File::open(path)
}

/// A TOML text with its name, for errors.
pub(crate) struct TomlText<'a> {
    pub(crate) file: &'a str,
    pub(crate) text: &'a str,
}

impl TomlText<'_> {
    /// Parses the whole text.
    pub(crate) fn parse<T: DeserializeOwned>(&self) -> Result<T, WorldError> {
        toml::from_str(self.text).map_err(|error| WorldError::Parse {
            file: self.file.to_owned(),
            line: self.line(&error.span().unwrap_or(0..0)),
            what: error.message().replace('\n', ", "),
        })
    }

    /// The error for a value in `span`.
    pub(crate) fn refuse(&self, span: &Range<usize>, key: &'static str, what: String) -> WorldError {
        WorldError::Value { file: self.file.to_owned(), line: self.line(span), key, what }
    }

    /// Refuses a number outside `[min, max]`, or one that is not finite.
    pub(crate) fn check(
        &self,
        span: &Range<usize>,
        key: &'static str,
        value: f64,
        (min, max): (f64, f64),
    ) -> Result<(), WorldError> {
        if (min..=max).contains(&value) {
            return Ok(());
        }
        Err(self.refuse(span, key, format!("{value} is not in [{min}, {max}]")))
    }

    /// The line, from 1, where a span begins.
    fn line(&self, span: &Range<usize>) -> usize {
        let end = span.start.min(self.text.len());
        1 + self.text.as_bytes()[..end].iter().filter(|&&byte| byte == b'\n').count()
    }
}
