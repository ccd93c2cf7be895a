//! `bundle`: everything that an engineer needs to look at an incident, in one file.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;
use messages::NS_PER_S;
use records::PastRun;
use rustix::fs::OFlags;
use serde_json::{Value, json};

use crate::args::BundleArgs;
use crate::exit::{Failure, chain};
use crate::out;
use crate::prepare::absolute;
use crate::{doctor, history};

/// Folder of the services' logs in a record.
const LOGS: &str = "logs";
/// So much of the recording is packed, from its end.
const LAST_NS: u64 = 60 * NS_PER_S;

/// `guidedog bundle`
///
/// # Errors
/// Where there is no such run, or the file is there already or cannot be written.
pub fn bundle(args: &BundleArgs, as_json: bool) -> Result<(), Failure> {
    let run = history::chosen(args.run.as_deref())?;
    let name = args.output.clone().unwrap_or_else(|| PathBuf::from(format!("{}.tar.gz", run.id)));
    let path = absolute(&name)?;
    if path.symlink_metadata().is_ok() {
        return Err(Failure::input(format!("{} already exists", path.display())));
    }
    let unwritable = |error: std::io::Error| Failure::input(format!("{}: {error}", path.display()));
    let folder = path.parent().unwrap_or(Path::new("/"));
    // What is left of a failure goes by itself.
    let work = tempfile::Builder::new().prefix(".guidedog-bundle-").tempdir_in(folder).map_err(unwritable)?;
    let about = json!({ "run": run.about, "guidedog": env!("CARGO_PKG_VERSION"), "machine": machine() });
    let doctor = doctor::report_for(&run.settings()).unwrap_or_else(|failure| json!({ "error": failure.message }));
    let (recording, missing) = last_minute(&run, work.path());
    let packed = work.path().join("bundle");
    let written = pack(&packed, &run, &[("versions.json", &about), ("doctor.json", &doctor)], recording.as_deref())
        .and_then(|()| std::fs::rename(&packed, &path));
    written.map_err(unwritable)?;
    let bytes = std::fs::metadata(&path).map_err(unwritable)?.len();
    let report = json!({
        "bundle": path.display().to_string(), "run": run.about.name, "id": run.id, "bytes": bytes,
        "recording": recording.is_some(), "missing": missing,
    });
    out::tell(as_json, &report, || {
        let first = format!("{}: {} KiB, run {}", path.display(), bytes.div_ceil(1024), run.id);
        let part = recording.as_ref().map(|_| "with the last minute of its recording, without depth frames".to_owned());
        std::iter::once(first).chain(part).chain(missing.iter().map(|why| format!("not in it: {why}"))).collect()
    })
}

/// What this machine is.
fn machine() -> Value {
    let uname = rustix::system::uname();
    let os = std::fs::read_to_string("/etc/os-release").unwrap_or_default();
    let name = os.lines().find_map(|line| line.strip_prefix("PRETTY_NAME=")).map(|name| name.trim_matches('"'));
    json!({
        "kernel": uname.release().to_string_lossy(), "architecture": uname.machine().to_string_lossy(), "os": name,
        "cpus": std::thread::available_parallelism().map_or(0, std::num::NonZero::get),
    })
}

/// The last minute of the run's newest recording, or why the bundle lacks it; neither where nothing was recorded.
fn last_minute(run: &PastRun, work: &Path) -> (Option<PathBuf>, Option<String>) {
    let recordings = run.recordings().unwrap_or_default();
    let Some(ordered) = recordings.last() else { return (None, None) };
    // A recorder that was restarted went on in a file of its own.
    let newest = recording::later_lives(ordered).last().unwrap_or_else(|| ordered.clone());
    let to = work.join("recording.mcap");
    match recording::write_last(&newest, &to, LAST_NS) {
        Ok(_) => (Some(to), None),
        Err(error) => (None, Some(format!("the recording: {}", chain(&error)))),
    }
}

type Tar = tar::Builder<GzEncoder<File>>;

fn pack(to: &Path, run: &PastRun, told: &[(&str, &Value)], recording: Option<&Path>) -> std::io::Result<()> {
    // The bundle shows where the handler walked: other users may not read it.
    let file = OpenOptions::new().write(true).create_new(true).mode(0o640).open(to)?;
    let mut tar = tar::Builder::new(GzEncoder::new(file, Compression::default()));
    let root = Path::new(&run.id);
    for folder in [run.folder.clone(), run.folder.join(LOGS)] {
        let mut files: Vec<PathBuf> = std::fs::read_dir(&folder)?.flatten().map(|entry| entry.path()).collect();
        files.sort();
        for file in files {
            let name = file.strip_prefix(&run.folder).unwrap_or(&file);
            append(&mut tar, &file, &root.join("record").join(name))?;
        }
    }
    for (name, value) in told {
        let text = format!("{value:#}\n");
        append_bytes(&mut tar, &root.join(name), text.len() as u64, text.as_bytes())?;
    }
    if let Some(recording) = recording {
        append(&mut tar, recording, &root.join("recording.mcap"))?;
    }
    tar.into_inner()?.finish()?.flush()
}

/// Packs a file as long as it is now: that of a live run grows on, and that of an old life may go. No link is followed.
fn append(tar: &mut Tar, path: &Path, name: &Path) -> std::io::Result<()> {
    // Nor does a pipe make it wait.
    let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK).bits().cast_signed();
    let Ok(file) = OpenOptions::new().read(true).custom_flags(flags).open(path) else { return Ok(()) };
    let found = file.metadata()?;
    if !found.is_file() {
        return Ok(());
    }
    append_bytes(tar, name, found.len(), file.chain(std::io::repeat(0)).take(found.len()))
}

fn append_bytes(tar: &mut Tar, name: &Path, bytes: u64, content: impl Read) -> std::io::Result<()> {
    let mut header = tar::Header::new_gnu();
    header.set_size(bytes);
    header.set_mode(0o640);
    tar.append_data(&mut header, name, content)
}
