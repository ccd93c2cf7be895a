//! The files that are evaluated, and what is said in them.

use std::fs::File;
use std::io::Read;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use hearing::{PcmStream, RATE_HZ};
use messages::CueKind;

use super::decode;
use crate::exit::Failure;

/// A file of over this is a stream, seconds.
const WORD_MAX_S: f64 = 5.0;
/// What stands before a file's samples is no longer, bytes.
const HEAD_BYTES: u64 = 4 << 20;
/// Folders within folders, and files, are no more: a link that leads back has no end.
const DEPTH_MAX: usize = 12;
const FILES_MAX: usize = 200_000;
/// Folders of what is no speech, by the beginning of their name.
const STREAMS: [&str; 2] = ["noise", "silence"];

/// What is said in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum What {
    /// A word that is a cue: forward, left, right, stop; go.
    Cue(String, CueKind),
    /// One other word.
    Other(String),
    /// Something long, without a cue.
    Stream,
}

impl What {
    /// The word, where there is one.
    pub fn word(&self) -> Option<&str> {
        match self {
            Self::Cue(word, _) | Self::Other(word) => Some(word),
            Self::Stream => None,
        }
    }

    /// The cue that it is.
    pub fn cue(&self) -> Option<CueKind> {
        match self {
            Self::Cue(_, cue) => Some(*cue),
            Self::Other(_) | Self::Stream => None,
        }
    }
}

/// A file.
#[derive(Debug, Clone)]
pub struct Recorded {
    /// Where it is.
    pub path: PathBuf,
    /// What is said in it.
    pub what: What,
}

/// What there is to be heard.
#[derive(Debug, Clone, Default)]
pub struct Found {
    /// The files that can be, in the order of their names.
    pub recorded: Vec<Recorded>,
    /// Files of folders that cannot be, and why.
    pub left_out: Vec<(PathBuf, String)>,
}

/// All files of these folders, lists and files. One in a folder that cannot be heard is left out.
///
/// # Errors
/// Where a named file cannot be read, or no file can.
pub fn find(places: &[PathBuf]) -> Result<Found, Failure> {
    let mut found = Found::default();
    for place in places {
        let kind = place.metadata().map_err(|error| Failure::input(format!("{}: {error}", place.display())))?;
        if kind.is_dir() {
            of_folder(place, DEPTH_MAX, &mut found)?;
        } else if is_sound(place) {
            found.recorded.push(of_file(place)?);
        } else {
            of_list(place, &mut found.recorded)?;
        }
    }
    match (found.recorded.is_empty(), found.left_out.first()) {
        (false, _) => Ok(found),
        // The first says what the others may lack, too.
        (true, Some((_, why))) => Err(Failure::input(why.clone())),
        (true, None) => {
            let places: Vec<String> = places.iter().map(|place| place.display().to_string()).collect();
            Err(Failure::input(format!("{}: no WAV or FLAC file is there", places.join(", "))))
        }
    }
}

/// Whether it is called like a WAV or FLAC file.
pub fn is_sound(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("wav") || extension.eq_ignore_ascii_case("flac"))
}

fn of_folder(folder: &Path, depth: usize, found: &mut Found) -> Result<(), Failure> {
    let too_many = || {
        let why = format!("over {DEPTH_MAX} folders deep, or over {FILES_MAX} files: does a link lead back?");
        Failure::input(format!("{}: {why}", folder.display()))
    };
    if depth == 0 {
        return Err(too_many());
    }
    let failed = |error: std::io::Error| Failure::input(format!("{}: {error}", folder.display()));
    let entries = folder.read_dir().map_err(failed)?.collect::<Result<Vec<_>, _>>().map_err(failed)?;
    let mut paths: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        if found.recorded.len() + found.left_out.len() > FILES_MAX {
            return Err(too_many());
        }
        if path.is_dir() {
            of_folder(&path, depth - 1, found)?;
        } else if is_sound(&path) {
            match of_file(&path) {
                Ok(recorded) => found.recorded.push(recorded),
                Err(failure) => found.left_out.push((path, failure.message)),
            }
        }
    }
    Ok(())
}

/// A file is what its folder is called, if it is no longer than a word.
fn of_file(path: &Path) -> Result<Recorded, Failure> {
    let folder = path.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().to_lowercase();
    let is_long = decode::read(path)?.len() as f64 > WORD_MAX_S * f64::from(RATE_HZ);
    let is_stream = is_long || STREAMS.iter().any(|name| folder.starts_with(name));
    let what = if is_stream { What::Stream } else { of_word(&folder) };
    Ok(Recorded { path: path.to_owned(), what })
}

fn of_word(word: &str) -> What {
    match hearing::cue_of(word) {
        Some(cue) => What::Cue(word.to_owned(), cue),
        None => What::Other(word.to_owned()),
    }
}

fn of_list(list: &Path, found: &mut Vec<Recorded>) -> Result<(), Failure> {
    let no_list = |why: String| {
        let what = "it is neither a folder, a WAV or FLAC file, nor a list of these";
        Failure::input(format!("{}: {what} ({why})", list.display()))
    };
    if !list.is_file() {
        return Err(no_list("it is not a file".to_owned()));
    }
    let text = std::fs::read_to_string(list).map_err(|error| no_list(error.to_string()))?;
    let text = text.trim_start_matches('\u{feff}');
    let folder = list.parent().unwrap_or(Path::new(""));
    for (number, line) in
        text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty() && !line.trim_start().starts_with('#'))
    {
        let (path, word) = match line.split_once('\t') {
            Some((path, word)) => (path.trim(), word.trim()),
            None => line.trim().rsplit_once(char::is_whitespace).unwrap_or((line.trim(), "")),
        };
        // A path may have blanks in it, too.
        let (path, word) = if is_sound(Path::new(line.trim())) { (line.trim(), "") } else { (path, word) };
        let path = folder.join(path.trim());
        if !is_sound(&path) || !path.is_file() {
            return Err(Failure::input(format!(
                "{}:{}: {} is no WAV or FLAC file",
                list.display(),
                number + 1,
                path.display()
            )));
        }
        // What cannot be heard is told before anything is heard.
        let at = |failure: Failure| Failure::input(format!("{}:{}: {}", list.display(), number + 1, failure.message));
        decode::read(&path).map_err(at)?;
        let what = if word.is_empty() { What::Stream } else { of_word(&word.to_lowercase()) };
        found.push(Recorded { path, what });
    }
    Ok(())
}

impl Recorded {
    /// Its samples, in [-1, 1].
    pub fn read(&self) -> Result<Vec<f32>, Failure> {
        decode::read(&self.path)
    }
}

/// Whether a file or pipe can stand in a microphone's place; of a file its beginning is looked at, of a pipe nothing.
///
/// # Errors
/// Where it cannot; nobody would be heard.
pub fn check_stream(path: &Path) -> Result<(), Failure> {
    let wrong = |what: String| Failure::input(format!("{}: {what}", path.display()));
    let kind = path.metadata().map_err(|error| wrong(error.to_string()))?.file_type();
    if kind.is_fifo() {
        return Ok(());
    }
    if !kind.is_file() {
        return Err(wrong("it is neither a file nor a pipe".to_owned()));
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|error| wrong(error.to_string()))?;
    file.take(HEAD_BYTES).read_to_end(&mut bytes).map_err(|error| wrong(error.to_string()))?;
    let (mut pcm, mut samples) = (PcmStream::of_file(path), Vec::new());
    pcm.push(&bytes, &mut samples).map_err(|error| wrong(error.to_string()))?;
    let why = pcm.missing().unwrap_or("no samples are in it");
    if samples.is_empty() { Err(wrong(why.to_owned())) } else { Ok(()) }
}
