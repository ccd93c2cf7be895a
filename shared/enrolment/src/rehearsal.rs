//! The rehearsal set: windows of the training data as the head's convolutions see them.
//!
//! Its file, little-endian: `GDRH`; u32 version, 2; u32 windows *n*; u32 features *f*; f32 scale; u8 label\[n\];
//! u8 feature\[n\]\[f\]. Feature times scale is the value.

use std::path::Path;

use hearing::{Head, LABELS, Rules, digest, read};
use messages::CueKind;

use crate::{Change, Changes, Dense, EnrolError, Features, HeadFile};

const MAGIC: &[u8] = b"GDRH";
const VERSION: u32 = 2;
const HEADER: usize = 20;

/// The rehearsal set of a head.
#[derive(Debug, Clone, PartialEq)]
pub struct Rehearsal {
    features: Features,
    /// One window in five: they train nothing, and tell what other voices come to.
    held_out: Features,
}

/// Which of five windows is held out.
const HELD_OUT: usize = 4;

impl Rehearsal {
    /// Reads it, and verifies it by the head's manifest.
    ///
    /// # Errors
    /// Where it cannot be read, or is not the one that the manifest names.
    pub fn read(path: &Path, head: &Head) -> Result<Self, EnrolError> {
        let wrong = |what: String| EnrolError::Content { path: path.to_owned(), what };
        let bytes = read(path)?;
        match &head.manifest.rehearsal_sha256 {
            None => {
                return Err(wrong(format!("{} names no rehearsal set", head.path.with_extension("toml").display())));
            }
            Some(wanted) if *wanted != digest(&bytes) => {
                return Err(wrong(format!("its digest is {}, and the head's manifest says {wanted}", digest(&bytes))));
            }
            Some(_) => {}
        }
        Self::parse(&bytes).ok_or_else(|| wrong(format!("it is no rehearsal set of version {VERSION}")))
    }

    /// The set in these bytes; none where they hold none of this version.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let (header, body) = bytes.split_at_checked(HEADER)?;
        let word = |i: usize| header[4 * i..].first_chunk().map(|bytes| u32::from_le_bytes(*bytes));
        let (windows, flat) = (word(2)? as usize, word(3)? as usize);
        let scale = f32::from_bits(word(4)?);
        let is_whole = windows.checked_mul(flat.checked_add(1)?) == Some(body.len());
        if !header.starts_with(MAGIC) || word(1) != Some(VERSION) || !is_whole || flat == 0 || !scale.is_finite() {
            return None;
        }
        let (labels, stored) = body.split_at(windows);
        let (mut features, mut held_out) = (Features::new(flat), Features::new(flat));
        for (number, (label, stored)) in labels.iter().zip(stored.chunks_exact(flat)).enumerate() {
            if usize::from(*label) >= LABELS.len() {
                return None;
            }
            let numbers: Vec<f32> = stored.iter().map(|number| f32::from(*number) * scale).collect();
            let part = if number % 5 == HELD_OUT { &mut held_out } else { &mut features };
            part.push(usize::from(*label), &numbers);
        }
        Some(Self { features, held_out })
    }

    /// Its windows that train.
    #[must_use]
    pub fn features(&self) -> &Features {
        &self.features
    }

    /// What other layers than these make of what is held out: of each window alone, by the rules' thresholds.
    pub(crate) fn changes(&self, before: &Dense, after: &Dense, rules: &Rules) -> Changes {
        let mut changes = Changes::default();
        let sure = [before, after].map(|dense| dense.sure(&self.held_out, &|word| rules.least(word) as f32));
        for (window, label) in self.held_out.labels().iter().enumerate() {
            let heard = [sure[0][window], sure[1][window]];
            let is_cue = *label < LABELS.len() - 1;
            let counts =
                |heard: Option<usize>| usize::from(if is_cue { heard == Some(*label) } else { heard.is_some() });
            let count = |change: &mut Change| {
                change.before += counts(heard[0]);
                change.after += counts(heard[1]);
                change.of += 1;
            };
            match is_cue {
                true => count(&mut changes.cues),
                false => count(&mut changes.others),
            }
            if LABELS[*label] == CueKind::Stop.name() {
                count(&mut changes.stop);
            }
        }
        changes
    }

    /// Whether it is of such a head's convolutions.
    pub(crate) fn fits(&self, file: &HeadFile) -> Result<(), EnrolError> {
        if self.features.flat() == file.flat() {
            return Ok(());
        }
        let what = format!("its windows have {} numbers, and the head makes {}", self.features.flat(), file.flat());
        Err(EnrolError::Content { path: file.path(), what })
    }
}

#[cfg(test)]
mod tests {
    use super::Rehearsal;

    #[test]
    fn a_set_is_read_and_one_that_is_none_is_not() {
        let mut bytes = b"GDRH".to_vec();
        for word in [2_u32, 2, 3] {
            bytes.extend(word.to_le_bytes());
        }
        bytes.extend(0.5_f32.to_le_bytes());
        bytes.extend([5, 1, 0, 2, 4, 6, 8, 10]);
        let set = Rehearsal::parse(&bytes).expect("it is one");
        assert_eq!((set.features().len(), set.features().flat()), (2, 3));
        assert_eq!(Rehearsal::parse(&bytes[..bytes.len() - 1]), None, "it was cut off");
        bytes[20] = 6;
        assert_eq!(Rehearsal::parse(&bytes), None, "there is no such label");
        assert_eq!(Rehearsal::parse(b"GDRH"), None);
    }
}
