//! One line of JSON each way: limits, how a line is written, and how what a client has sent is cut into lines. Pure:
//! bytes in, lines out, whatever the bytes.

use serde::Serialize;

use crate::Request;

/// Longest request, bytes.
pub const MAX_REQUEST: usize = 4096;
/// Longest answer, bytes.
pub const MAX_ANSWER: u64 = 16 << 20;
/// Requests that may wait at once: a client asks, and waits for the answer.
pub const MAX_WAITING: usize = 4;

/// What is sent as a line, its end included; members are in the order of their names.
///
/// # Errors
/// Where it is not JSON, such as a path that is not UTF-8.
pub fn line(sent: &impl Serialize) -> Result<String, serde_json::Error> {
    Ok(format!("{}\n", serde_json::to_value(sent)?))
}

/// Why a client is let go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Abuse {
    /// A line without an end.
    #[error("a request of over {MAX_REQUEST} bytes")]
    TooLong,
    /// Requests come faster than they are answered.
    #[error("over {MAX_WAITING} requests at once")]
    TooMany,
}

/// The beginning of a line whose end has not come.
#[derive(Debug, Default)]
pub struct Inbox {
    begun: Vec<u8>,
}

impl Inbox {
    /// Takes a piece of what is sent: the whole lines that are there now, without their ends, and what is wrong with
    /// what follows them, if anything. What came before that still counts, and so does a stop in the rest of the piece.
    pub fn take(&mut self, piece: &[u8]) -> (Vec<Vec<u8>>, Option<Abuse>) {
        let mut lines = Vec::new();
        let mut abuse = None;
        for part in piece.split_inclusive(|byte| *byte == b'\n') {
            let (text, ends) = part.strip_suffix(b"\n").map_or((part, false), |text| (text, true));
            if self.begun.len() + text.len() > MAX_REQUEST {
                abuse = abuse.or(Some(Abuse::TooLong));
            } else if ends && lines.len() == MAX_WAITING {
                abuse = abuse.or(Some(Abuse::TooMany));
            }
            if abuse.is_some() {
                self.begun.clear();
                if ends && Request::parse(text) == Ok(Request::Stop) {
                    lines.push(text.to_vec());
                    return (lines, abuse);
                }
                continue;
            }
            self.begun.extend_from_slice(text);
            if ends {
                lines.push(std::mem::take(&mut self.begun));
            }
        }
        (lines, abuse)
    }
}

#[cfg(test)]
mod tests {
    use super::{Abuse, Inbox, MAX_REQUEST};

    #[test]
    fn lines_are_whole_however_they_come() {
        let mut inbox = Inbox::default();
        assert_eq!(inbox.take(b"{\"verb\""), (vec![], None));
        assert_eq!(inbox.take(b":\"stop\"}"), (vec![], None));
        assert_eq!(inbox.take(b"\n\nab"), (vec![b"{\"verb\":\"stop\"}".to_vec(), vec![]], None));
        assert_eq!(inbox.take(b"\xff\n"), (vec![b"ab\xff".to_vec()], None));
    }

    #[test]
    fn a_line_without_an_end_and_a_flood_are_abuse_and_what_came_before_counts() {
        let mut inbox = Inbox::default();
        assert_eq!(inbox.take(&[b'x'; MAX_REQUEST]), (vec![], None));
        assert_eq!(inbox.take(b"x"), (vec![], Some(Abuse::TooLong)));
        let mut long = b"stop\n".to_vec();
        long.extend([b'x'; MAX_REQUEST + 1]);
        assert_eq!(Inbox::default().take(&long), (vec![b"stop".to_vec()], Some(Abuse::TooLong)));
        let (lines, abuse) = Inbox::default().take(&b"\n".repeat(1000));
        assert_eq!((lines.len(), abuse), (4, Some(Abuse::TooMany)));
    }

    #[test]
    fn a_stop_after_too_much_is_obeyed_all_the_same() {
        let stop = br#"{"verb":"stop"}"#.to_vec();
        let flood = [b"\n".repeat(9), stop.clone(), b"\n".to_vec()].concat();
        let (lines, abuse) = Inbox::default().take(&flood);
        assert_eq!((lines.len(), lines.last(), abuse), (5, Some(&stop), Some(Abuse::TooMany)));
        let long = [vec![b'x'; MAX_REQUEST + 1], b"\n".to_vec(), stop.clone(), b"\n".to_vec()].concat();
        assert_eq!(Inbox::default().take(&long), (vec![stop], Some(Abuse::TooLong)));
    }
}
