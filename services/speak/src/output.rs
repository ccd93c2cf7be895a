//! Where the sound goes: to a program that plays it, or to a WAV file.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;

use hound::WavWriter;
use settings::Speak;
use transport::Helper;

use crate::clip::Clip;

/// A player may take so much longer than the sound, nanoseconds: it opens a device.
const PLAYER_SLACK_NS: u64 = 3_000_000_000;
/// A file is written so much ahead of what would be heard by now, nanoseconds.
const AHEAD_NS: u64 = 100_000_000;
/// Between two sentences in a file.
const PAUSE: Duration = Duration::from_millis(200);

/// How far a sound is.
#[derive(Debug, PartialEq, Eq)]
pub enum Progress {
    /// It is being heard.
    Going,
    /// It was heard to its end.
    Done,
    /// It was not.
    Failed(String),
}

/// A place for sound, one at a time. Nothing here waits.
pub trait Output {
    /// Begins a sound: once this returns, all of it was handed over, to a file or to a player that was started.
    ///
    /// # Errors
    /// Where it cannot be heard; the reason says what to do.
    fn start(&mut self, clip: &Rc<Clip>, now_ns: u64) -> Result<(), String>;

    /// Time passes.
    fn tick(&mut self, now_ns: u64) -> Progress;

    /// No more of it.
    fn cut(&mut self);
}

/// The output that the settings name.
pub fn of(settings: &Speak) -> Box<dyn Output> {
    match &settings.file {
        Some(path) => Box::new(WavFile { path: path.clone().into(), now: None }),
        None => Box::new(Player { words: settings.player.clone(), now: None, ending: Vec::new() }),
    }
}

/// A program that plays a WAV from its standard input.
struct Player {
    words: Vec<String>,
    /// Who plays, and until when it has to be done.
    now: Option<(Helper, u64)>,
    ending: Vec<Helper>,
}

impl Output for Player {
    fn start(&mut self, clip: &Rc<Clip>, now_ns: u64) -> Result<(), String> {
        self.cut();
        let helper = Helper::start(&self.words, &clip.wav()?, false)?;
        self.now = Some((helper, now_ns + clip.duration_ns() + PLAYER_SLACK_NS));
        Ok(())
    }

    fn tick(&mut self, now_ns: u64) -> Progress {
        self.ending.retain_mut(|helper| helper.ended().is_none());
        let Some((helper, by_ns)) = &mut self.now else { return Progress::Done };
        let progress = match helper.ended() {
            Some(status) if status.success() => Progress::Done,
            Some(_) => Progress::Failed(helper.failure()),
            None if now_ns > *by_ns => Progress::Failed(format!("{}: it plays for too long", self.words[0])),
            None => return Progress::Going,
        };
        self.cut();
        progress
    }

    fn cut(&mut self) {
        if let Some((mut helper, _)) = self.now.take() {
            helper.kill();
            self.ending.push(helper);
        }
    }
}

/// A WAV file that holds what would have been heard, as it would have been heard: whoever is killed leaves it whole.
struct WavFile {
    path: PathBuf,
    now: Option<Writing>,
}

struct Writing {
    writer: WavWriter<BufWriter<File>>,
    clip: Rc<Clip>,
    written: usize,
    begun_ns: u64,
}

impl Writing {
    /// Writes what would have been heard by now.
    fn go_on(&mut self, now_ns: u64) -> Result<Progress, hound::Error> {
        let heard_ns = now_ns.saturating_sub(self.begun_ns);
        let until = self.clip.until(heard_ns + AHEAD_NS);
        for sample in &until[self.written..] {
            self.writer.write_sample(*sample)?;
        }
        self.written = until.len();
        let is_done = heard_ns >= self.clip.duration_ns();
        if is_done {
            for sample in self.clip.pause(PAUSE) {
                self.writer.write_sample(sample)?;
            }
        }
        // With the length in the header: a file is whole at any time.
        self.writer.flush()?;
        Ok(if is_done { Progress::Done } else { Progress::Going })
    }
}

impl Output for WavFile {
    fn start(&mut self, clip: &Rc<Clip>, now_ns: u64) -> Result<(), String> {
        let fail = |why: String| format!("speak.file {}: {why}", self.path.display());
        self.now = None;
        let writer = open(&self.path, clip).map_err(fail)?;
        let mut writing = Writing { writer, clip: Rc::clone(clip), written: 0, begun_ns: now_ns };
        writing.go_on(now_ns).map_err(|error| fail(error.to_string()))?;
        self.now = Some(writing);
        Ok(())
    }

    fn tick(&mut self, now_ns: u64) -> Progress {
        let Some(writing) = &mut self.now else { return Progress::Done };
        let progress = writing.go_on(now_ns);
        let progress =
            progress.unwrap_or_else(|error| Progress::Failed(format!("speak.file {}: {error}", self.path.display())));
        if progress != Progress::Going {
            self.now = None;
        }
        progress
    }

    fn cut(&mut self) {
        self.now = None;
    }
}

/// The file, at its end; a new one where there is none.
fn open(path: &Path, clip: &Clip) -> Result<WavWriter<BufWriter<File>>, String> {
    let Ok(found) = std::fs::metadata(path) else {
        return WavWriter::create(path, clip.spec()).map_err(|error| error.to_string());
    };
    // Before it is opened: opening a pipe would wait for its reader.
    if !found.is_file() {
        return Err("it is not a file".to_owned());
    }
    let writer = WavWriter::append(path).map_err(|error| format!("it is no WAV to go on with: {error}"))?;
    if writer.spec() != clip.spec() {
        let (is, gives) = (writer.spec().sample_rate, clip.spec().sample_rate);
        return Err(format!("it is a WAV of another kind ({is} Hz), and the voice gives {gives} Hz"));
    }
    Ok(writer)
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;
    use std::time::{Duration, Instant};

    use settings::Speak;

    use super::{Output, Progress, of};
    use crate::clip::tests::tone;

    const MS: u64 = 1_000_000;

    fn to_file(name: &str) -> (tempfile::TempDir, std::path::PathBuf, Box<dyn Output>) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join(name);
        let output = of(&Speak { file: Some(path.clone().into()), ..Speak::default() });
        (folder, path, output)
    }

    fn length(path: &std::path::Path) -> u32 {
        hound::WavReader::open(path).expect("a WAV").duration()
    }

    #[test]
    fn a_file_holds_what_would_have_been_heard_and_is_whole_at_any_time() {
        let (_folder, path, mut output) = to_file("said.wav");
        let clip = Rc::new(tone(1000, 0));
        output.start(&clip, 0).expect("it can be written");
        assert_eq!(length(&path), 1600, "the first sample is out, and a bit ahead");
        assert_eq!(output.tick(500 * MS), Progress::Going);
        assert_eq!(length(&path), 9600);
        // Cut short by another, which is heard to its end and goes behind it.
        output.start(&clip, 500 * MS).expect("it can be written");
        assert_eq!(output.tick(1499 * MS), Progress::Going);
        assert_eq!(output.tick(1500 * MS), Progress::Done);
        assert_eq!(length(&path), 9600 + 16_000 + 3200);
        output.cut();
        let (_, _, mut again) = to_file("other.wav");
        assert_eq!(again.tick(0), Progress::Done, "nothing is played");
    }

    #[test]
    fn what_cannot_be_gone_on_with_is_told_and_left_as_it_is() {
        let (folder, path, mut output) = to_file("said.wav");
        let clip = Rc::new(tone(100, 0));
        std::fs::write(&path, "mine").expect("written");
        assert!(output.start(&clip, 0).is_err_and(|why| why.contains("said.wav: it is no WAV")));
        assert_eq!(std::fs::read(&path).expect("there"), b"mine");
        std::fs::remove_file(&path).expect("ours");
        std::fs::create_dir(&path).expect("made");
        assert!(output.start(&clip, 0).is_err_and(|why| why.contains("not a file")));
        let nowhere = folder.path().join("none").join("said.wav");
        let mut output = of(&Speak { file: Some(nowhere.into()), ..Speak::default() });
        assert!(output.start(&clip, 0).is_err_and(|why| why.contains("none/said.wav")));
    }

    fn played(command: &str) -> Progress {
        let player = ["sh", "-c", command].map(str::to_owned).to_vec();
        let mut output = of(&Speak { player, ..Speak::default() });
        output.start(&Rc::new(tone(100, 0)), 0).expect("it starts");
        let since = Instant::now();
        loop {
            let progress = output.tick(0);
            if progress != Progress::Going {
                return progress;
            }
            assert!(since.elapsed() < Duration::from_secs(60), "it ends");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    #[test]
    fn a_player_is_given_a_wav_and_its_failure_is_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("played.wav");
        assert_eq!(played(&format!("cat > {}", path.display())), Progress::Done);
        assert_eq!(length(&path), 1600);
        let failed = played("echo no card >&2; exit 1");
        assert_eq!(failed, Progress::Failed("sh: exit status: 1: no card".to_owned()));
    }

    #[test]
    fn a_player_that_hangs_is_ended() {
        let player = ["sleep", "600"].map(str::to_owned).to_vec();
        let mut output = of(&Speak { player, ..Speak::default() });
        output.start(&Rc::new(tone(100, 0)), 0).expect("it starts");
        assert_eq!(output.tick(3000 * MS), Progress::Going);
        assert!(matches!(output.tick(3200 * MS), Progress::Failed(why) if why.contains("too long")));
        assert_eq!(output.tick(3200 * MS), Progress::Done, "it is gone");
    }
}
