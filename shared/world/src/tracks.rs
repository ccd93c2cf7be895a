//! Tracks of real pedestrians, as `ETH` and `UCY` are shared: CSV of four rows, each with a value for every sighting.
//! The rows are frame numbers, pedestrian numbers, and places along two axes in metres (which is which is told beside
//! the file).

use std::collections::BTreeMap;

use guidance::se2::Point;

use crate::WorldError;

/// No track is farther from the origin, metres.
const PLACE_MAX_M: f64 = 1e4;
/// No recording has more frames or pedestrians.
const COUNT_MAX: i64 = 1_000_000_000;

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

/// The tracks of a recording in which each pedestrian is in view without a gap, by their numbers. Places are as the
/// third and the fourth row have them. `file` names the text in errors.
///
/// # Errors
/// As [`Tracks::parse`]; where a pedestrian is missing in a frame between two others; or where a number is below 0 or
/// over 1e9.
pub fn read(file: &str, text: &str) -> Result<Vec<Track>, WorldError> {
    let refuse = |what: String| WorldError::Parse { file: file.to_owned(), line: 1, what };
    let tracks = Tracks::parse(file, text)?;
    let track = |(number, seen): (i64, &[Sighting])| {
        if let Some(pair) = seen.windows(2).find(|pair| pair[1].frame != pair[0].frame + 1) {
            let (before, next) = (pair[0].frame, pair[1].frame);
            return Err(refuse(format!("pedestrian {number} is in frame {before}, and next in frame {next}")));
        }
        let count = |value: i64| match u32::try_from(value) {
            Ok(count) if value <= COUNT_MAX => Ok(count),
            _ => Err(refuse(format!("{value} is no whole number from 0 to {COUNT_MAX}"))),
        };
        let places = seen.iter().map(|sighting| Point::new(sighting.y_m, sighting.x_m)).collect();
        Ok(Track { number: count(number)?, first_frame: count(seen[0].frame)?, places })
    };
    tracks.pedestrians().map(track).collect()
}

#[cfg(test)]
mod tests {
    use super::{Sighting, Tracks, read};
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
    fn a_gap_in_a_track_is_refused() {
        let gap = read("t.csv", "1,3\n1,1\n0,0\n0,0\n").unwrap_err().to_string();
        assert_eq!(gap, "t.csv:1: pedestrian 1 is in frame 1, and next in frame 3");
        let below = read("t.csv", "-1\n1\n0\n0\n").unwrap_err().to_string();
        assert_eq!(below, "t.csv:1: -1 is no whole number from 0 to 1000000000");
        let late = read("t.csv", "4294967295\n1\n0\n0\n").unwrap_err().to_string();
        assert_eq!(late, "t.csv:1: 4294967295 is no whole number from 0 to 1000000000");
    }

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
