//! What the fuzz targets have in common: files with what was thought up, and recordings around it.

use std::path::PathBuf;

/// A folder of this process for the files of one input after the other.
#[must_use]
pub fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("guidedog-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder can be made");
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("a file can be written");
    path
}

/// Where a result may be written; what the last input left there is gone.
#[must_use]
pub fn out() -> PathBuf {
    let path = file("out.mcap", b"");
    std::fs::remove_file(&path).expect("it was just written");
    path
}

/// Between the parts of an input that has several.
pub const BORDER: u8 = 0;

/// A recording that is right but for what was thought up: messages without compression and checksums, so that whatever
/// is in them reaches who reads them. Each part is a channel, two bytes of time, and the message.
///
/// # Errors
/// Where `mcap` refuses to write that.
pub fn recording(parts: &[u8]) -> Result<Vec<u8>, mcap::McapError> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().compression(None).calculate_chunk_crcs(false);
    let mut writer = options.create(&mut bytes)?;
    let mut channels = Vec::new();
    for topic in ["lidar/scan", "odometry"] {
        channels.push(writer.add_channel(0, topic, "json", &std::collections::BTreeMap::new())?);
    }
    for (sequence, part) in (0..).zip(parts.split(|byte| *byte == BORDER)) {
        let Some((&[channel, low, high], message)) = part.split_first_chunk() else { continue };
        let time = u64::from(u16::from_le_bytes([low, high]));
        let header = mcap::records::MessageHeader {
            channel_id: channels[usize::from(channel) % channels.len()],
            sequence,
            log_time: time,
            publish_time: time,
        };
        writer.write_to_known_channel(&header, message)?;
        if channel >= 128 {
            writer.flush()?;
        }
    }
    let text = |value: &str| value.to_owned();
    let entries = [("format", "1"), ("source", "fuzz"), ("robot", "none"), ("field_of_view_rad", "6.3")];
    let span = [("start_ns", "0"), ("duration_ns", "65535")];
    let metadata = entries.into_iter().chain(span).map(|(key, value)| (text(key), text(value))).collect();
    writer.write_metadata(&mcap::records::Metadata { name: text("guidedog"), metadata })?;
    writer.finish()?;
    drop(writer);
    Ok(bytes.into_inner())
}
