//! The files that are evaluated, and what is said in them.

use std::fs::File;
use std::io::{BufReader, Read};
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use hearing::{PcmStream, RATE_HZ};
use messages::CueKind;

use crate::exit::Failure;

/// A file of over this is a stream, seconds.
const WORD_MAX_S: f64 = 5.0;
/// No file is longer: three hours, in samples and in bytes of a WAV.
const SAMPLES_MAX: usize = 3 * 3600 * RATE_HZ as usize;
const BYTES_MAX: u64 = 2 * SAMPLES_MAX as u64 + (1 << 20);
/// What stands before a file's samples is no longer, bytes.
const HEAD_BYTES: u64 = 4 << 20;
const TOO_LONG: &str = "it is longer than three hours";
/// Folders within folders, and files, are no more: a link that leads back has no end.
const DEPTH_MAX: usize = 12;
const FILES_MAX: usize = 200_000;
/// Folders of what is no speech, by the beginning of their name.
const STREAMS: [&str; 2] = ["noise", "silence"];

/// What is said in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum What {
    /// A cue.
    Cue(CueKind),
    /// One other word.
    Other(String),
    /// Something long, without a cue.
    Stream,
}

/// A file.
#[derive(Debug, Clone)]
pub struct Recorded {
    /// Where it is.
    pub path: PathBuf,
    /// What is said in it.
    pub what: What,
}

/// All files of these folders, lists and files, in the order of their names.
pub fn find(places: &[PathBuf]) -> Result<Vec<Recorded>, Failure> {
    let mut found = Vec::new();
    for place in places {
        let kind = place.metadata().map_err(|error| Failure::input(format!("{}: {error}", place.display())))?;
        if kind.is_dir() {
            of_folder(place, DEPTH_MAX, &mut found)?;
        } else if is_sound(place) {
            found.push(of_file(place)?);
        } else {
            of_list(place, &mut found)?;
        }
    }
    if found.is_empty() {
        let places: Vec<String> = places.iter().map(|place| place.display().to_string()).collect();
        return Err(Failure::input(format!("{}: no WAV or FLAC file is there", places.join(", "))));
    }
    Ok(found)
}

/// Whether it is called like a WAV or FLAC file.
pub fn is_sound(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("wav") || extension.eq_ignore_ascii_case("flac"))
}

fn of_folder(folder: &Path, depth: usize, found: &mut Vec<Recorded>) -> Result<(), Failure> {
    if depth == 0 || found.len() > FILES_MAX {
        let why = format!("over {DEPTH_MAX} folders deep, or over {FILES_MAX} files: does a link lead back?");
        return Err(Failure::input(format!("{}: {why}", folder.display())));
    }
    let failed = |error: std::io::Error| Failure::input(format!("{}: {error}", folder.display()));
    let entries = folder.read_dir().map_err(failed)?.collect::<Result<Vec<_>, _>>().map_err(failed)?;
    let mut paths: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            of_folder(&path, depth - 1, found)?;
        } else if is_sound(&path) {
            found.push(of_file(&path)?);
        }
    }
    Ok(())
}

/// A file is what its folder is called, if it is no longer than a word.
fn of_file(path: &Path) -> Result<Recorded, Failure> {
    let folder = path.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().to_lowercase();
    let is_long = read(path)?.len() as f64 > WORD_MAX_S * f64::from(RATE_HZ);
    let is_stream = is_long || STREAMS.iter().any(|name| folder.starts_with(name));
    let what = if is_stream { What::Stream } else { of_word(&folder) };
    Ok(Recorded { path: path.to_owned(), what })
}

fn of_word(word: &str) -> What {
    CueKind::from_name(word).map_or_else(|| What::Other(word.to_owned()), What::Cue)
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
        let what = if word.is_empty() { What::Stream } else { of_word(&word.to_lowercase()) };
        found.push(Recorded { path, what });
    }
    Ok(())
}

impl Recorded {
    /// Its samples, in [-1, 1].
    pub fn read(&self) -> Result<Vec<f32>, Failure> {
        read(&self.path)
    }
}

/// The samples of a file.
pub fn read(path: &Path) -> Result<Vec<f32>, Failure> {
    let wrong = |what: String| Failure::input(format!("{}: {what}", path.display()));
    // Before it is opened: opening a pipe would wait for its writer, and a device has no end.
    if !path.metadata().map_err(|error| wrong(error.to_string()))?.is_file() {
        return Err(wrong("it is not a file".to_owned()));
    }
    let file = File::open(path).map_err(|error| wrong(error.to_string()))?;
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("flac")) {
        return flac(BufReader::new(file)).map_err(wrong);
    }
    let mut bytes = Vec::new();
    file.take(BYTES_MAX).read_to_end(&mut bytes).map_err(|error| wrong(error.to_string()))?;
    let (mut pcm, mut samples) = (PcmStream::of_file(path), Vec::with_capacity(bytes.len() / 2));
    pcm.push(&bytes, &mut samples).map_err(|error| wrong(error.to_string()))?;
    let too_long = (samples.len() > SAMPLES_MAX).then_some(TOO_LONG);
    let none = samples.is_empty().then_some("no samples are in it");
    too_long.or(pcm.missing()).or(none).map_or(Ok(samples), |why| Err(wrong(why.to_owned())))
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

fn flac(file: impl Read) -> Result<Vec<f32>, String> {
    let broken = |error: claxon::Error| format!("it is no whole FLAC file: {error}");
    let mut reader = claxon::FlacReader::new(file).map_err(broken)?;
    let info = reader.streaminfo();
    if (info.sample_rate, info.channels) != (RATE_HZ, 1) {
        let (channels, rate_hz) = (info.channels, info.sample_rate);
        return Err(format!(
            "{channels} channels at {rate_hz} Hz: 1 channel at {RATE_HZ} Hz is wanted (sox IN -r {RATE_HZ} -c 1 OUT)"
        ));
    }
    let full = (1_u64 << (info.bits_per_sample - 1)) as f32;
    // A few bytes may stand for any number of samples.
    let samples = reader.samples().take(SAMPLES_MAX + 1);
    let samples = samples.map(|sample| Ok(sample.map_err(broken)? as f32 / full));
    let samples: Vec<f32> = samples.collect::<Result<_, String>>()?;
    if samples.len() > SAMPLES_MAX { Err(TOO_LONG.to_owned()) } else { Ok(samples) }
}
