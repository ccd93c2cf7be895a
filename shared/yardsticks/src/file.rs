//! Reads files, packed (xz) or not.

use std::fs::File;
use std::io::{Error, Read};
use std::path::Path;

use lzma_rust2::XzReader;

use crate::YardstickError;

/// What an xz file begins with.
const XZ: [u8; 6] = [0xFD, b'7', b'z', b'X', b'Z', 0];
/// No file of a yardstick is larger when it is unpacked, bytes.
const SIZE_MAX: u64 = 256 << 20;

/// The bytes of a file, unpacked where it is an xz file.
///
/// # Errors
/// Where it cannot be read, is no file (a pipe may have no end), is cut short, or is larger than 256 MiB.
pub fn bytes(path: &Path) -> Result<Vec<u8>, YardstickError> {
    let failed = |source| YardstickError::Read { file: path.display().to_string(), source };
    let is_file = path.metadata().map_err(failed)?.is_file();
    let file = if is_file { File::open(path) } else { Err(Error::other("it is not a file")) };
    let (mut packed, mut bytes) = (Vec::new(), Vec::new());
    file.and_then(|file| file.take(SIZE_MAX + 1).read_to_end(&mut packed)).map_err(failed)?;
    if packed.starts_with(&XZ) {
        let unpacked = XzReader::new(&packed[..], true);
        unpacked.take(SIZE_MAX + 1).read_to_end(&mut bytes).map_err(failed)?;
    } else {
        bytes = packed;
    }
    if bytes.len() as u64 > SIZE_MAX {
        return Err(YardstickError::content(&path.display().to_string(), "over 256 MiB"));
    }
    Ok(bytes)
}

/// The text of a file, unpacked where it is an xz file.
///
/// # Errors
/// As [`bytes`], and where it is no UTF-8.
pub fn text(path: &Path) -> Result<String, YardstickError> {
    let no_text = |_| YardstickError::content(&path.display().to_string(), "no UTF-8 text");
    String::from_utf8(bytes(path)?).map_err(no_text)
}
