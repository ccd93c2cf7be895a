//! What a walk or a replay shows while it runs: a compact view on a terminal, plain lines elsewhere.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use control::{Client, Status};

use crate::find::socket;
use crate::map_view::MapView;
use crate::operate::{ages_line, cue_line, mode_line, robot_line};
use crate::out::say;

/// Plain lines come this often, and at every change of mode or cue.
const LINE_PERIOD: Duration = Duration::from_secs(2);
/// Services named on one line.
const SERVICES_A_LINE: usize = 4;

/// The view of one run.
#[derive(Debug)]
pub struct Live {
    run: String,
    client: Option<Client>,
    map: Option<MapView>,
    terminal: bool,
    /// Lines on the terminal that the next drawing replaces.
    drawn: usize,
    last_line: Option<Instant>,
    last_words: String,
}

impl Live {
    /// A view of the run, with a map where the world is known.
    pub fn new(run: &str, map: Option<MapView>) -> Self {
        Self {
            run: run.to_owned(),
            client: None,
            map,
            terminal: std::io::stderr().is_terminal(),
            drawn: 0,
            last_line: None,
            last_words: String::new(),
        }
    }

    /// Asks how the run is, and shows it. A supervisor that does not answer is asked again the next time.
    pub fn tick(&mut self) {
        if self.client.is_none() {
            self.client = Client::connect(&socket(&self.run)).ok();
        }
        let Some(client) = &mut self.client else { return };
        match client.read() {
            Ok(status) if self.terminal => self.draw(&status),
            Ok(status) => self.line(&status),
            Err(_) => self.client = None,
        }
    }

    fn line(&mut self, status: &Status) {
        let words = format!("{}, cue {}", mode_line(&status.mode), cue_line(&status.mode));
        let due = self.last_line.is_none_or(|last| last.elapsed() >= LINE_PERIOD);
        if due || words != self.last_words {
            say(format!("{:7.1} s  {words}; {}", status.now_s, robot_line(status)));
            self.last_line = Some(Instant::now());
            self.last_words = words;
        }
    }

    fn draw(&mut self, status: &Status) {
        let (columns, rows) = size();
        let mut lines = vec![
            format!("{} {:.1} s   {}", self.run, status.now_s, mode_line(&status.mode)),
            format!("cue      {}", cue_line(&status.mode)),
            format!("robot    {}", robot_line(status)),
            format!("streams  {}", ages_line(status)),
        ];
        lines.extend(service_lines(status));
        if let Some(map) = &mut self.map {
            let view = map.lines(status.world.as_ref());
            if lines.len() + view.len() < rows {
                lines.extend(view);
            }
        }
        let mut text = String::new();
        if self.drawn > 0 {
            text += &format!("\x1b[{}A", self.drawn);
        }
        for line in &lines {
            let line: String = line.chars().take(columns.saturating_sub(1)).collect();
            text += &format!("\x1b[2K{line}\n");
        }
        // A view that became shorter leaves nothing below it.
        text += "\x1b[J";
        self.drawn = lines.len();
        let mut err = std::io::stderr().lock();
        // Whoever closed the terminal does not look.
        let _ = err.write_all(text.as_bytes()).and_then(|()| err.flush());
    }
}

/// Columns and rows of the terminal; one that does not say counts as the smallest usual one.
fn size() -> (usize, usize) {
    let size = rustix::termios::tcgetwinsize(std::io::stderr());
    let (columns, rows) = size.map_or((0, 0), |size| (usize::from(size.ws_col), usize::from(size.ws_row)));
    (if columns == 0 { 80 } else { columns }, if rows == 0 { 24 } else { rows })
}

fn service_lines(status: &Status) -> Vec<String> {
    let words: Vec<String> = status
        .services
        .iter()
        .map(|service| {
            let restarts = service.restarts;
            let restarts = if restarts > 0 { format!(" ({restarts} restarts)") } else { String::new() };
            format!("{} {}{restarts}", service.name, service.state)
        })
        .collect();
    let head = |i: usize| if i == 0 { "services " } else { "         " };
    words.chunks(SERVICES_A_LINE).enumerate().map(|(i, words)| format!("{}{}", head(i), words.join(", "))).collect()
}
