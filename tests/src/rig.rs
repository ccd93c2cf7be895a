//! A sound card that is not there: a PulseAudio server of a test's own, with a microphone that a test speaks into and a
//! loudspeaker that it listens to. ALSA's "default" is both.

use std::ffi::OsString;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};

use crate::until;

/// Whether there can be one.
#[must_use]
pub fn has_sound() -> bool {
    let there = std::env::var_os("GUIDEDOG_SOUND").is_some();
    test_data::has(there, "GUIDEDOG_SOUND is not set: scripts/test installs PulseAudio, and sets it")
}

/// The server with what is plugged into it.
#[derive(Debug)]
pub struct SoundRig {
    home: tempfile::TempDir,
    server: Option<Child>,
    ear: Option<Child>,
}

impl Default for SoundRig {
    fn default() -> Self {
        Self::new()
    }
}

impl SoundRig {
    /// A server, a microphone and a loudspeaker.
    #[must_use]
    pub fn new() -> Self {
        // Short: the server's socket lies in it.
        let home = tempfile::Builder::new().prefix("gs").tempdir_in("/tmp").expect("a folder in /tmp");
        let alsa = "pcm.!default { type pulse }\nctl.!default { type pulse }\n";
        fs::write(home.path().join(".asoundrc"), alsa).expect("written");
        let mut rig = Self { home, server: None, ear: None };
        rig.plug_in();
        rig
    }

    /// What a program has to know to find it.
    #[must_use]
    pub fn variables(&self) -> [(OsString, OsString); 2] {
        ["HOME", "XDG_RUNTIME_DIR"].map(|name| (name.into(), self.home.path().into()))
    }

    fn command(&self, program: &str, words: &[&str]) -> Command {
        let mut command = Command::new(program);
        command.args(words).envs(self.variables()).env_remove("PULSE_SERVER");
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command
    }

    /// Starts the server, once more where it was unplugged.
    pub fn plug_in(&mut self) {
        let modules = [
            "module-native-protocol-unix",
            "module-null-sink sink_name=mouth",
            "module-remap-source master=mouth.monitor source_name=microphone",
            "module-null-sink sink_name=loudspeaker",
        ];
        let mut words = vec!["-n", "--daemonize=no", "--exit-idle-time=-1", "--use-pid-file=no"];
        words.extend(modules.iter().flat_map(|module| ["-L", module]));
        self.server = Some(self.command("pulseaudio", &words).spawn().expect("pulseaudio starts"));
        until("the server comes up", || {
            self.asks(&["set-default-source", "microphone"]) && self.asks(&["set-default-sink", "loudspeaker"])
        });
    }

    fn asks(&self, words: &[&str]) -> bool {
        self.command("pactl", words).status().is_ok_and(|status| status.success())
    }

    /// Ends the server: microphone and loudspeaker are gone.
    pub fn unplug(&mut self) {
        for mut child in [self.server.take(), self.ear.take()].into_iter().flatten() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }

    /// Where to speak: raw samples of 16 bits, 16,000 a second, are what the microphone hears. Until then, zeros.
    #[must_use]
    pub fn mouth(&self) -> ChildStdin {
        let words = ["--playback", "--raw", "-d", "mouth", "--rate=16000", "--channels=1", "--format=s16le"];
        let mut pacat = self.command("pacat", &[&words[..], &["--latency-msec=40"]].concat());
        pacat.stdin(Stdio::piped()).spawn().expect("pacat starts").stdin.take().expect("it is piped")
    }

    /// Listens to the loudspeaker from now on.
    pub fn listen(&mut self) {
        let file = File::create(self.heard_path()).expect("written");
        let words = ["--record", "--raw", "-d", "loudspeaker.monitor", "--rate=16000", "--channels=1"];
        let mut pacat = self.command("pacat", &[&words[..], &["--format=s16le", "--latency-msec=40"]].concat());
        self.ear = Some(pacat.stdout(file).spawn().expect("pacat starts"));
        until("the loudspeaker is heard", || fs::metadata(self.heard_path()).is_ok_and(|file| file.len() > 0));
    }

    fn heard_path(&self) -> PathBuf {
        self.home.path().join("heard.raw")
    }

    /// What the loudspeaker gave since then, in [-1, 1], 16,000 a second.
    #[must_use]
    pub fn heard(&self) -> Vec<f64> {
        let bytes = fs::read(self.heard_path()).expect("it was listened to");
        bytes.chunks_exact(2).map(|pair| f64::from(i16::from_le_bytes([pair[0], pair[1]])) / 32_768.0).collect()
    }

    /// Its folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.home.path()
    }
}

impl Drop for SoundRig {
    fn drop(&mut self) {
        self.unplug();
    }
}

/// Seconds of speech among samples: of windows of 20 ms as loud as a voice is.
#[must_use]
pub fn speech_s(samples: &[f64], rate_hz: u32) -> f64 {
    let rms = |window: &[f64]| (window.iter().map(|x| x * x).sum::<f64>() / window.len() as f64).sqrt();
    samples.chunks(rate_hz as usize / 50).filter(|window| rms(window) > 0.02).count() as f64 * 0.02
}
