//! The ends of the lifelines that locomotion holds.

use messages::ServiceId;
use transport::{Io, Line, Received, TransportError};

#[derive(Debug)]
struct Armed {
    token: u64,
    service: ServiceId,
    incarnation: u32,
    line: Line,
}

/// One line for each critical service incarnation.
#[derive(Debug, Default)]
pub struct Lines {
    armed: Vec<Armed>,
    next_token: u64,
}

impl Lines {
    /// Watches a line from now on: its token.
    ///
    /// # Errors
    /// Where the kernel refuses.
    pub fn arm(&mut self, service: ServiceId, incarnation: u32, line: Line, io: &Io) -> Result<u64, TransportError> {
        self.next_token += 1;
        io.watch(&line, self.next_token)?;
        self.armed.push(Armed { token: self.next_token, service, incarnation, line });
        Ok(self.next_token)
    }

    /// Whose line it was, where the line of that token has closed.
    pub fn closed(&mut self, token: u64, io: &Io) -> Option<(ServiceId, u32)> {
        let armed = self.armed.iter().find(|armed| armed.token == token)?;
        match armed.line.receive_bytes(&mut [0; 16]) {
            Received::Closed => {
                let whose = (armed.service, armed.incarnation);
                self.remove(|armed| armed.token == token, io);
                Some(whose)
            }
            Received::Nothing | Received::Message(..) => None,
        }
    }

    fn remove(&mut self, which: impl Fn(&Armed) -> bool, io: &Io) {
        if let Some(i) = self.armed.iter().position(which) {
            let armed = self.armed.swap_remove(i);
            io.unwatch(&armed.line);
        }
    }
}
