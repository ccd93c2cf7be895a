//! Tracks of real pedestrians, as `ETH` and `UCY` are shared: CSV of four rows, each with a value for every sighting.
//! The rows are frame numbers, pedestrian numbers, and places along two axes in metres (which is which is told beside
//! the file).

use std::collections::BTreeMap;

use crate::WorldError;

/// No track is farther from the origin, metres.
const PLACE_MAX_M: f64 = 1e4;

/// One sighting of a pedestrian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Number of the frame.
    pub frame: i64,
    /// Place, metres: the last row of the file.
    pub x_m: f64,
    /// Place, metres: the third row of the file.
    pub y_m: f64,
}

/// Where pedestrians were, by their number in the file; each one's sightings are in the order of frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tracks {
    pedestrians: BTreeMap<i64, Vec<Sighting>>,
}

impl Tracks {
    /// The tracks in the text of a file, which `name` names in errors.
    ///
    /// # Errors
    /// Where there are not four rows of equal length, or a value is no number. The error names row and column.
    pub fn parse(name: &str, text: &str) -> Result<Self, WorldError> {
        let refuse = |line: usize, what: String| WorldError::Parse { file: name.to_owned(), line, what };
        let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').map(str::trim).collect()).collect();
        let [frames, numbers, y, x] = &rows[..] else {
            return Err(refuse(rows.len().max(1), format!("four rows are wanted, not {}", rows.len())));
        };
        if let Some((row, cells)) = rows.iter().enumerate().find(|(_, cells)| cells.len() != frames.len()) {
            return Err(refuse(row + 1, format!("{} values, where row 1 has {}", cells.len(), frames.len())));
        }
        let value = |row: usize, column: usize, cell: &str, max: f64| {
            let value = cell.parse::<f64>().ok().filter(|value| value.abs() <= max);
            value.ok_or_else(|| refuse(row, format!("value {}: {cell:?} is no number up to {max}", column + 1)))
        };
        let whole = |row: usize, column: usize, cell: &str| {
            let value = value(row, column, cell, 1e12)?;
            if value.fract() == 0.0 {
                Ok(value as i64)
            } else {
                Err(refuse(row, format!("value {}: {cell:?} is no whole number", column + 1)))
            }
        };
        let mut pedestrians = BTreeMap::<i64, Vec<Sighting>>::new();
        for column in 0..frames.len() {
            let (frame, number) = (whole(1, column, frames[column])?, whole(2, column, numbers[column])?);
            let (y_m, x_m) = (value(3, column, y[column], PLACE_MAX_M)?, value(4, column, x[column], PLACE_MAX_M)?);
            let track = pedestrians.entry(number).or_default();
            if track.last().is_some_and(|last| last.frame >= frame) {
                return Err(refuse(1, format!("value {}: frame {frame} of {number} is not after", column + 1)));
            }
            track.push(Sighting { frame, x_m, y_m });
        }
        Ok(Self { pedestrians })
    }

    /// Numbers of the pedestrians, rising, each with their sightings.
    pub fn pedestrians(&self) -> impl Iterator<Item = (i64, &[Sighting])> {
        self.pedestrians.iter().map(|(number, track)| (*number, track.as_slice()))
    }

    /// The sightings of a pedestrian.
    #[must_use]
    pub fn of(&self, number: i64) -> Option<&[Sighting]> {
        self.pedestrians.get(&number).map(Vec::as_slice)
    }
}

#[cfg(test)]
mod tests {
    use super::{Sighting, Tracks};

    #[test]
    fn each_pedestrian_has_their_sightings_in_order() {
        let tracks = Tracks::parse("t", "0,0,1\n1,2,1\n0.5,7,0.6\n1,8,1.1\n").expect("tracks");
        let one = [Sighting { frame: 0, x_m: 1.0, y_m: 0.5 }, Sighting { frame: 1, x_m: 1.1, y_m: 0.6 }];
        assert_eq!(tracks.of(1), Some(&one[..]));
        assert_eq!(
            tracks.pedestrians().map(|(number, track)| (number, track.len())).collect::<Vec<_>>(),
            [(1, 2), (2, 1)]
        );
        assert_eq!(tracks.of(3), None);
    }

    #[test]
    fn what_are_no_tracks_is_refused_with_row_and_value() {
        for (text, why) in [
            ("", "t:1: four rows are wanted, not 0"),
            ("1\n1\n1\n", "t:3: four rows are wanted, not 3"),
            ("1,2\n1,1\n1\n1,2\n", "t:3: 1 values, where row 1 has 2"),
            ("1,2\n1,1\n1,nan\n1,2\n", "t:3: value 2: \"nan\" is no number"),
            ("1,2.5\n1,1\n1,1\n1,2\n", "t:1: value 2: \"2.5\" is no whole number"),
            ("1,1\n1,1\n1,1\n1,2\n", "t:1: value 2: frame 1 of 1 is not after"),
        ] {
            let error = Tracks::parse("t", text).expect_err(why).to_string();
            assert!(error.contains(why), "{error}");
        }
    }
}
