//! Recorded tracks of pedestrians, as SocNavBench has those of ETH, Hotel and Zara: a text of four rows of numbers that
//! commas separate (frames, pedestrian numbers, x and y in metres), a column for each pedestrian in each frame.

use std::collections::BTreeMap;

use guidance::se2::Point;

use crate::WorldError;

/// The rows, as errors call them.
const ROWS: [&str; 4] = ["frames", "pedestrians", "x", "y"];

/// The track of one pedestrian: a place in each frame, without a gap.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// The pedestrian's number.
    pub number: u32,
    /// The frame of the first place.
    pub first_frame: u32,
    /// Places, one for each frame, metres, in the recording's own frame.
    pub places: Vec<Point>,
}

impl Track {
    /// The place in a frame; none where the pedestrian is not in view.
    #[must_use]
    pub fn at(&self, frame: u32) -> Option<Point> {
        self.places.get(frame.checked_sub(self.first_frame)? as usize).copied()
    }

    /// The way walked from the first place to the last, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.places.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
    }

    /// The straight way from the first place to the last, metres.
    #[must_use]
    pub fn straight_m(&self) -> f64 {
        self.places.first().zip(self.places.last()).map_or(0.0, |(first, last)| (last - first).norm())
    }
}

/// All tracks of a recording, by their pedestrians' numbers.
///
/// # Errors
/// Where a row is missing, rows are not equally long, a value is no number, or a pedestrian is twice in a frame or
/// missing in one between two others; the error names the row (its line) or the pedestrian. `file` names the text.
pub fn read(file: &str, text: &str) -> Result<Vec<Track>, WorldError> {
    let refuse = |row: usize, what: String| WorldError::Parse { file: file.to_owned(), line: row + 1, what };
    let mut rows = [const { Vec::new() }; 4];
    let mut lines = text.lines();
    for (row, values) in rows.iter_mut().enumerate() {
        let line = lines.next().ok_or_else(|| refuse(row, format!("the row of {} is missing", ROWS[row])))?;
        for (column, value) in line.split(',').enumerate() {
            let number = value.trim().parse::<f64>().ok().filter(|number| number.is_finite());
            let wrong = || format!("{}: column {}: {value:?} is no number", ROWS[row], column + 1);
            values.push(number.ok_or_else(|| refuse(row, wrong()))?);
        }
    }
    if let Some(row) = (1..4).find(|row| rows[*row].len() != rows[0].len()) {
        let (is, needed) = (rows[row].len(), rows[0].len());
        return Err(refuse(row, format!("{} has {is} columns, {} has {needed}", ROWS[row], ROWS[0])));
    }
    let [frames, numbers, x, y] = rows;
    let whole = |row: usize, column: usize, value: f64| {
        let fits = value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0;
        let wrong = || format!("{}: column {}: {value} is no whole number from 0 on", ROWS[row], column + 1);
        if fits { Ok(value as u32) } else { Err(refuse(row, wrong())) }
    };
    let mut seen: BTreeMap<u32, Vec<(u32, Point)>> = BTreeMap::new();
    for column in 0..frames.len() {
        let (frame, number) = (whole(0, column, frames[column])?, whole(1, column, numbers[column])?);
        seen.entry(number).or_default().push((frame, Point::new(x[column], y[column])));
    }
    let track = |(number, mut places): (u32, Vec<(u32, Point)>)| {
        places.sort_by_key(|(frame, _)| *frame);
        if let Some(pair) = places.windows(2).find(|pair| pair[1].0 != pair[0].0 + 1) {
            let what = format!("pedestrian {number} is in frame {}, and next in frame {}", pair[0].0, pair[1].0);
            return Err(refuse(0, what));
        }
        let first_frame = places[0].0;
        Ok(Track { number, first_frame, places: places.into_iter().map(|(_, at)| at).collect() })
    };
    seen.into_iter().map(track).collect()
}

#[cfg(test)]
mod tests {
    use super::read;
    use guidance::se2::Point;

    #[test]
    fn columns_become_tracks() {
        let tracks = read("t.csv", "5,6,6,7\n2,2,9,2\n0,1,4.5,2\n0,0,-1,0\n").unwrap();
        assert_eq!(tracks.iter().map(|track| (track.number, track.first_frame)).collect::<Vec<_>>(), [(2, 5), (9, 6)]);
        assert_eq!(tracks[0].at(6), Some(Point::new(1.0, 0.0)));
        assert_eq!((tracks[0].at(4), tracks[0].at(8)), (None, None));
        assert_eq!((tracks[0].length_m(), tracks[0].straight_m()), (2.0, 2.0));
        assert_eq!(tracks[1].places, [Point::new(4.5, -1.0)]);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, told) in [
            ("1\n1\n0\n", "t.csv:4: the row of y is missing"),
            ("1,2\n1\n0,0\n0,0\n", "t.csv:2: pedestrians has 1 columns, frames has 2"),
            ("1\n1\nwide\n0\n", "t.csv:3: x: column 1: \"wide\" is no number"),
            ("1\n1\nNaN\n0\n", "t.csv:3: x: column 1: \"NaN\" is no number"),
            ("1.5\n1\n0\n0\n", "t.csv:1: frames: column 1: 1.5 is no whole number from 0 on"),
            ("1,3\n1,1\n0,0\n0,0\n", "t.csv:1: pedestrian 1 is in frame 1, and next in frame 3"),
            ("1,1\n1,1\n0,0\n0,0\n", "t.csv:1: pedestrian 1 is in frame 1, and next in frame 1"),
        ] {
            assert_eq!(read("t.csv", text).unwrap_err().to_string(), told);
        }
    }
}
