//! The folder of a handler: `head.toml`, `head.onnx`, `clips/WORD/N.wav`. Beside it lies `NAME.before`, which an undo
//! brings back. During an enrolment `NAME.new` lies there, too; a file in it tells where its clips come from. What is
//! in force changes in one step, and is always whole; what somebody else has put there is left as it is.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use hearing::{Head, RATE_HZ};
use rustix::fs::{CWD, FlockOperation, RenameFlags, flock, renameat_with};

use super::{CUES, TAKES_LEAST, TAKES_MOST};
use crate::cues::{decode, files};
use crate::exit::Failure;

const MANIFEST: &str = "head.toml";
const HEAD: &str = "head.onnx";
const CLIPS: &str = "clips";
const ORIGIN: &str = "origin";
/// A clip is no shorter and no longer, seconds.
const CLIP_S: std::ops::Range<f64> = 0.2..5.0;
/// What is less is silence: -60 dB of full scale.
const POWER_MIN: f32 = 1e-6;

/// Where the clips of an enrolment come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// They are spoken, one after another: who breaks off goes on with them.
    Spoken,
    /// They are copied, all at once.
    Copied,
}

impl Origin {
    const fn name(self) -> &'static str {
        match self {
            Self::Spoken => "spoken\n",
            Self::Copied => "copied\n",
        }
    }
}

/// Where a handler's head is. One command at a time may change it.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    /// Held until this is dropped, or the process ends.
    lock: Option<File>,
}

fn failed(path: &Path, error: &std::io::Error) -> Failure {
    Failure::run(format!("{}: {error}", path.display()))
}

fn not_ours(path: &Path) -> Failure {
    Failure::input(format!("{}: it is no folder that `cue enrol` has made, and is left as it is", path.display()))
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder).and_then(|()| fs::write(path, bytes)).map_err(|error| failed(path, &error))
}

fn remove(folder: &Path) -> Result<(), Failure> {
    if !folder.exists() {
        return Ok(());
    }
    fs::remove_dir_all(folder).map_err(|error| failed(folder, &error))
}

/// Whether a clip can hold a word: its loud half stands out from its quietest part.
fn usable(samples: &[f32]) -> Result<(), String> {
    let length_s = samples.len() as f64 / f64::from(RATE_HZ);
    if !(CLIP_S.contains(&length_s)) {
        return Err(format!("it takes {length_s:.2} s, and a word takes {:.1} to {:.0} s", CLIP_S.start, CLIP_S.end));
    }
    if hearing::speech_power(samples) < POWER_MIN {
        return Err("nothing is to be heard in it".to_owned());
    }
    Ok(())
}

/// The words in a folder of folders: cues first, then others by their names.
pub fn words_of(folder: &Path) -> Result<Vec<String>, Failure> {
    let mut others = Vec::new();
    if !folder.is_dir() {
        return Ok(others);
    }
    for entry in fs::read_dir(folder).map_err(|error| failed(folder, &error))? {
        let path = entry.map_err(|error| failed(folder, &error))?.path();
        let word = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() && !CUES.contains(&word.as_str()) && !clips_of(folder, &word)?.is_empty() {
            others.push(word);
        }
    }
    others.sort();
    let cues = CUES.iter().filter(|cue| folder.join(cue).is_dir()).map(|cue| (*cue).to_owned());
    Ok(cues.chain(others).collect())
}

/// The clips of a word in a folder of folders, in the order of their names.
pub fn clips_of(folder: &Path, word: &str) -> Result<Vec<PathBuf>, Failure> {
    let folder = folder.join(word);
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(&folder).map_err(|error| failed(&folder, &error))? {
        let path = entry.map_err(|error| failed(&folder, &error))?.path();
        if files::is_sound(&path) {
            found.push(path);
        }
    }
    found.sort();
    found.truncate(TAKES_MOST);
    Ok(found)
}

impl Folder {
    /// One that there is, or is to be.
    ///
    /// # Errors
    /// Where something else is there.
    pub fn new(path: PathBuf) -> Result<Self, Failure> {
        let folder = Self { path, lock: None };
        // A link to nowhere is something else, too.
        let is_other = folder.path.symlink_metadata().is_ok() && !folder.manifest().is_file();
        if is_other || folder.path.file_name().is_none() {
            return Err(not_ours(&folder.path));
        }
        Ok(folder)
    }

    /// The folder itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What a configuration names.
    pub fn manifest(&self) -> PathBuf {
        self.path.join(MANIFEST)
    }

    fn beside(&self, what: &str) -> PathBuf {
        let mut name = self.path.file_name().unwrap_or_default().to_owned();
        name.push(what);
        self.path.with_file_name(name)
    }

    fn before(&self) -> PathBuf {
        self.beside(".before")
    }

    fn new_one(&self) -> PathBuf {
        self.beside(".new")
    }

    /// Where clips are put until they have trained a head.
    pub fn new_clips(&self) -> PathBuf {
        self.new_one().join(CLIPS)
    }

    /// The manifest that is not in force yet.
    pub fn new_manifest(&self) -> PathBuf {
        self.new_one().join(MANIFEST)
    }

    /// Begins an enrolment.
    ///
    /// # Errors
    /// Where nothing can be written there, somebody is just enrolling, or something else lies there.
    pub fn begin(&mut self, origin: Origin) -> Result<(), Failure> {
        let (new, before) = (self.new_one(), self.before());
        if before.symlink_metadata().is_ok() && !before.join(MANIFEST).is_file() {
            return Err(not_ours(&before));
        }
        let unusable = |error: std::io::Error| Failure::input(format!("{}: {error}", new.display()));
        let lock = fs::create_dir_all(&new).and_then(|()| File::open(&new)).map_err(unusable)?;
        if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err() {
            return Err(Failure::input(format!("{}: somebody is enrolling there already", self.path.display())));
        }
        self.lock = Some(lock);
        match fs::read_to_string(new.join(ORIGIN)).ok() {
            // Made just now, or by who was ended right after.
            None if fs::read_dir(&new).is_ok_and(|mut entries| entries.next().is_none()) => {}
            Some(was) if was == origin.name() => {}
            Some(was) if was == Origin::Copied.name() => remove(&self.new_clips())?,
            Some(was) if was == Origin::Spoken.name() => {
                let (new, path) = (new.display(), self.path.display());
                return Err(Failure::input(format!(
                    "{new}: what was spoken before has trained no head yet: `guidedog cue enrol -o {path}` goes on \
                     with it, or remove it"
                )));
            }
            Some(_) | None => return Err(not_ours(&new)),
        }
        write(&new.join(ORIGIN), origin.name().as_bytes())
    }

    /// Lets go of an enrolment that came to nothing; clips that somebody has spoken stay.
    pub fn give_up(&self, keep_clips: bool) {
        if !(keep_clips && self.new_clips().exists()) {
            // Whoever cannot remove it has been told of something worse.
            let _ = fs::remove_dir_all(self.new_one());
        }
    }

    /// Where clips of an enrolment that came to nothing are, if they were kept: the same command goes on with them.
    pub fn kept(&self) -> String {
        let folder = self.new_one();
        if !folder.exists() {
            return String::new();
        }
        format!("\nwhat was spoken is in {}: to speak it anew, remove that folder", folder.display())
    }

    /// Where nobody was enrolled before, an undo brings back the head that is enrolled upon.
    pub fn keep_before(&self, base: &Head, manifest: &Path) -> Result<(), Failure> {
        if self.path.exists() {
            return Ok(());
        }
        let before = self.before();
        write(&before.join(HEAD), &base.bytes)?;
        write(&before.join(MANIFEST), &hearing::read(manifest).map_err(Failure::of_input)?)
    }

    /// The clips of a folder of folders, each named by its word, in place of any that lie there.
    pub fn copy_clips(&self, from: &Path) -> Result<(), Failure> {
        remove(&self.new_clips())?;
        let words = words_of(from)?;
        for word in &words {
            let paths = clips_of(from, word)?;
            for (take, path) in (1..).zip(&paths) {
                let samples = decode::read(path)?;
                usable(&samples).map_err(|why| Failure::input(format!("{}: {why}", path.display())))?;
                self.put_clip(word, take, &samples)?;
            }
            if CUES.contains(&word.as_str()) && (1..TAKES_LEAST).contains(&paths.len()) {
                let (count, folder) = (paths.len(), from.join(word));
                let folder = folder.display();
                return Err(Failure::input(format!("{folder}: {count} clips, and at least {TAKES_LEAST} are needed")));
            }
        }
        if CUES.iter().any(|cue| self.new_clips().join(cue).is_dir()) {
            return Ok(());
        }
        Err(Failure::input(format!("{}: no WAV or FLAC file in {}", from.display(), CUES.join(", "))))
    }

    /// One more clip, at [`RATE_HZ`]; takes are counted from 1.
    pub fn put_clip(&self, word: &str, take: usize, samples: &[f32]) -> Result<(), Failure> {
        let path = self.new_clips().join(word).join(format!("{take:02}.wav"));
        let spec = hound::WavSpec {
            channels: 1,
            sample_rate: RATE_HZ,
            bits_per_sample: 16,
            sample_format: hound::SampleFormat::Int,
        };
        let mut bytes = std::io::Cursor::new(Vec::new());
        let mut written = || {
            let mut writer = hound::WavWriter::new(&mut bytes, spec)?;
            samples.iter().try_for_each(|sample| writer.write_sample((sample * 32_767.0) as i16))?;
            writer.finalize()
        };
        written().map_err(|error| Failure::run(format!("{}: {error}", path.display())))?;
        write(&path, &bytes.into_inner())
    }

    /// The head and its manifest, not in force yet.
    pub fn put(&self, head: &[u8], manifest: &str) -> Result<(), Failure> {
        write(&self.new_one().join(HEAD), head)?;
        write(&self.new_manifest(), manifest.as_bytes())
    }

    /// What was put is in force, what was in force is what an undo brings back.
    pub fn put_in_force(&self) -> Result<(), Failure> {
        let origin = self.new_one().join(ORIGIN);
        fs::remove_file(&origin).map_err(|error| failed(&origin, &error))?;
        if !self.path.exists() {
            return fs::rename(self.new_one(), &self.path).map_err(|error| failed(&self.path, &error));
        }
        exchange(&self.new_one(), &self.path)?;
        remove(&self.before())?;
        fs::rename(self.new_one(), self.before()).map_err(|error| failed(&self.before(), &error))
    }

    /// What was in force before is so again, and the other way round.
    pub fn undo(&self) -> Result<(), Failure> {
        if !self.path.exists() || !self.before().exists() {
            return Err(Failure::input(format!(
                "{}: nothing was enrolled there, so nothing is undone",
                self.path.display()
            )));
        }
        exchange(&self.before(), &self.path)
    }
}

/// Each takes the other's place, in one step.
fn exchange(one: &Path, other: &Path) -> Result<(), Failure> {
    renameat_with(CWD, one, CWD, other, RenameFlags::EXCHANGE).map_err(|errno| failed(other, &errno.into()))
}
