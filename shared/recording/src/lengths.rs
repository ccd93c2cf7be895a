//! Lengths within an MCAP record, looked at before it is parsed: `mcap` takes as much memory as a text or map says it
//! is long, before it finds that there is not so much in the record.

use mcap::records::op;

/// What is wrong with a record whose lengths do not fit.
pub const BEYOND: &str = "a length that reaches past its record";

/// Whether every text and map of a record's body lies within it. Kinds of records without any are taken as they are.
pub fn fit(opcode: u8, body: &[u8]) -> bool {
    walk(opcode, &mut Fields(body)).is_some()
}

fn walk(opcode: u8, fields: &mut Fields<'_>) -> Option<()> {
    match opcode {
        op::CHANNEL => {
            fields.skip(4)?;
            fields.text()?;
            fields.text()?;
            fields.map()
        }
        op::CHUNK => {
            fields.skip(28)?;
            fields.text().map(|_| ())
        }
        op::CHUNK_INDEX => {
            fields.skip(32)?;
            fields.text()?;
            fields.skip(8)?;
            fields.text().map(|_| ())
        }
        op::METADATA => {
            fields.text()?;
            fields.map()
        }
        op::METADATA_INDEX => {
            fields.skip(16)?;
            fields.text().map(|_| ())
        }
        _ => Some(()),
    }
}

/// What is left of a body.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn skip(&mut self, bytes: usize) -> Option<&'a [u8]> {
        let (skipped, rest) = self.0.split_at_checked(bytes)?;
        self.0 = rest;
        Some(skipped)
    }

    /// A text, or anything else that begins with its length in bytes.
    fn text(&mut self) -> Option<&'a [u8]> {
        let length = u32::from_le_bytes(self.skip(4)?.try_into().ok()?);
        self.skip(usize::try_from(length).ok()?)
    }

    fn map(&mut self) -> Option<()> {
        let mut inner = Fields(self.text()?);
        while !inner.0.is_empty() {
            inner.text()?;
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::fit;
    use mcap::records::op;

    #[test]
    fn a_length_beyond_the_record_is_seen_before_memory_is_taken() {
        let channel = |topic: u32, map: u32, key: u32| {
            let mut body = vec![1, 0, 0, 0];
            body.extend(topic.to_le_bytes());
            body.extend(b"cue");
            body.extend(4u32.to_le_bytes());
            body.extend(b"json");
            body.extend(map.to_le_bytes());
            body.extend(key.to_le_bytes());
            body.extend([b'k', 0, 0, 0, 0]);
            body
        };
        assert!(fit(op::CHANNEL, &channel(3, 9, 1)));
        for (topic, map, key) in [(u32::MAX, 9, 1), (4, 9, 1), (3, u32::MAX, 1), (3, 9, u32::MAX - 2)] {
            assert!(!fit(op::CHANNEL, &channel(topic, map, key)), "{topic} {map} {key}");
        }
        for (opcode, fixed) in [(op::CHUNK, 28), (op::CHUNK_INDEX, 32), (op::METADATA_INDEX, 16), (op::METADATA, 0)] {
            let mut body = vec![0; fixed];
            body.extend([0xfd, 0xff, 0xff, 0xff, b'x']);
            assert!(!fit(opcode, &body), "{opcode}");
            assert!(!fit(opcode, &body[..fixed]), "{opcode} cut off");
        }
    }
}
