//! Reads a ROS map_server map: a YAML description and the image (PGM or PNG) that it names.
//!
//! Unknown cells are not free, in whatever mode: a robot may not go there, and a lidar's beam ends there. Keys that
//! map_server does not know are passed over, as it does.

use std::io::{BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

use image::codecs::pnm::PnmDecoder;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use messages::Pose2;
use serde::Deserialize;
use serde_saphyr::Spanned;

use crate::grid_map::{Cell, GridMap};
use crate::{WorldError, text_file};

/// The largest image, pixels: 400 m x 400 m at 5 cm.
const MAX_PIXELS: u64 = 64_000_000;
/// Resolutions in use are 1 cm to 20 cm, metres.
const RESOLUTION_M: (f64, f64) = (1e-3, 10.0);
/// No origin is farther from the world's, metres.
const MAX_ORIGIN_M: f64 = 1e6;

/// The keys of the YAML.
#[derive(Deserialize)]
struct Description {
    image: Spanned<String>,
    resolution: Spanned<f64>,
    origin: Spanned<[f64; 3]>,
    negate: Spanned<Negate>,
    occupied_thresh: Spanned<f64>,
    free_thresh: Spanned<f64>,
    #[serde(default)]
    mode: Mode,
}

/// 0 and 1 in ROS 1, true and false in some of ROS 2.
#[derive(Deserialize, Clone, Copy)]
#[serde(untagged)]
enum Negate {
    Flag(bool),
    Number(i64),
}

/// How a pixel becomes an occupancy.
#[derive(Deserialize, Clone, Copy, Default, PartialEq)]
#[serde(rename_all = "lowercase")]
enum Mode {
    /// Dark is occupied, light is free, the rest is unknown.
    #[default]
    Trinary,
    /// As trinary: what scale mode grades is not free.
    Scale,
    /// The pixel is the occupancy in percent, over 100 unknown.
    Raw,
}

impl GridMap {
    /// Reads a map_server YAML and its image; a relative image path is taken from the YAML's folder.
    ///
    /// # Errors
    /// Where one of the files cannot be read, a key is missing or wrong, or the image has a bad header, is cut short,
    /// or has over 64 million pixels. The error names the file, and for the YAML line and key.
    pub fn load(path: &Path) -> Result<Self, WorldError> {
        let file = path.display().to_string();
        let description = Description::load(path)?;
        let classify = description.classifier(&file)?;
        let (width, pixels) = read_image(&description.image_beside(path))?;
        // Row 0 of the image is the upper edge, row 0 of a map the lower one.
        let rows = pixels.chunks_exact(width).rev();
        let cells = rows.flat_map(|row| row.iter().map(|&pixel| classify(pixel))).collect();
        let [x_m, y_m, yaw_rad] = description.origin.value;
        Ok(Self::new(width, description.resolution.value, Pose2::new(x_m, y_m, yaw_rad), cells))
    }

    /// The image that a map_server YAML names.
    ///
    /// # Errors
    /// Where the YAML cannot be read, or a key is missing or wrong.
    pub fn image(path: &Path) -> Result<PathBuf, WorldError> {
        Description::load(path).map(|description| description.image_beside(path))
    }
}

/// A pixel: grey in [0, 255], `None` where it is transparent.
type Pixel = Option<u8>;

impl Description {
    fn load(path: &Path) -> Result<Self, WorldError> {
        let text = text_file::read(path)?;
        serde_saphyr::from_str(&text).map_err(|error| WorldError::Parse {
            file: path.display().to_string(),
            line: error.location().map_or(1, |location| location.line().max(1) as usize),
            what: without_place(&first_line(&error.without_snippet().to_string())),
        })
    }

    fn image_beside(&self, path: &Path) -> PathBuf {
        path.parent().unwrap_or(Path::new("")).join(&self.image.value)
    }

    /// What a pixel says, by the thresholds; refuses keys out of bounds.
    fn classifier(&self, file: &str) -> Result<impl Fn(Pixel) -> Cell + use<>, WorldError> {
        let refuse = |line: u64, key, what| WorldError::Value { file: file.to_owned(), line: line as usize, key, what };
        let check = |key, value: &Spanned<f64>, (min, max): (f64, f64)| {
            let line = value.referenced.line();
            let inside = (min..=max).contains(&value.value);
            inside.then_some(()).ok_or_else(|| refuse(line, key, format!("{} is not in [{min}, {max}]", value.value)))
        };
        check("resolution", &self.resolution, RESOLUTION_M)?;
        check("occupied_thresh", &self.occupied_thresh, (0.0, 1.0))?;
        check("free_thresh", &self.free_thresh, (0.0, 1.0))?;
        let (occupied, free) = (self.occupied_thresh.value, self.free_thresh.value);
        if free > occupied {
            let what = format!("{free} is over occupied_thresh {occupied}");
            return Err(refuse(self.free_thresh.referenced.line(), "free_thresh", what));
        }
        if !self.origin.value.iter().all(|number| number.abs() <= MAX_ORIGIN_M) {
            let what = format!("{:?} is not finite or over {MAX_ORIGIN_M} m", self.origin.value);
            return Err(refuse(self.origin.referenced.line(), "origin", what));
        }
        let negate = match self.negate.value {
            Negate::Flag(flag) => flag,
            Negate::Number(number @ 0..=1) => number == 1,
            Negate::Number(other) => {
                return Err(refuse(self.negate.referenced.line(), "negate", format!("{other} is neither 0 nor 1")));
            }
        };
        let raw = self.mode == Mode::Raw;
        Ok(move |pixel: Pixel| {
            let Some(grey) = pixel else { return Cell::Unknown };
            let occupancy = match (raw, negate) {
                (false, false) => f64::from(255 - grey) / 255.0,
                (false, true) => f64::from(grey) / 255.0,
                (true, negate) => f64::from(if negate { 255 - grey } else { grey }) / 100.0,
            };
            if occupancy > 1.0 {
                Cell::Unknown
            } else if occupancy > occupied {
                Cell::Occupied
            } else if occupancy < free {
                Cell::Free
            } else {
                Cell::Unknown
            }
        })
    }
}

/// Width and pixels of an image, row by row from the top.
fn read_image(path: &Path) -> Result<(usize, Vec<Pixel>), WorldError> {
    let name = path.display().to_string();
    let failed = |source| WorldError::Read { file: name.clone(), source };
    let file = BufReader::new(text_file::open(path).map_err(failed)?);
    let reader = ImageReader::new(file).with_guessed_format().map_err(failed)?;
    let refuse = |what: String| WorldError::Image { file: name.clone(), what };
    match reader.format() {
        Some(ImageFormat::Pnm) => {
            let decoder =
                PnmDecoder::new(reader.into_inner()).map_err(|error| refuse(first_line(&error.to_string())))?;
            decode(decoder).map_err(refuse)
        }
        Some(ImageFormat::Png) => {
            let decoder = png(reader.into_inner()).map_err(|error| refuse(first_line(&error.to_string())))?;
            decode(decoder).map_err(refuse)
        }
        _ => Err(refuse("image is neither PGM nor PNG".to_owned())),
    }
}

fn png<R: BufRead + Seek>(reader: R) -> image::ImageResult<image::codecs::png::PngDecoder<R>> {
    image::codecs::png::PngDecoder::new(reader)
}

/// Reads the pixels. The decoder brings samples of other depths to 0..=255.
fn decode(decoder: impl ImageDecoder) -> Result<(usize, Vec<Pixel>), String> {
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MAX_PIXELS {
        return Err(format!("image has {width} x {height} pixels, not 1 to {MAX_PIXELS}"));
    }
    let image = DynamicImage::from_decoder(decoder).map_err(|error| {
        let what = first_line(&error.to_string());
        // The decoder's own words say what it did, not what is wrong.
        if what.contains("failed to fill whole buffer") {
            format!("cut short: {width} x {height} pixels are not there")
        } else {
            what
        }
    })?;
    let pixels = if image.color().has_alpha() {
        let image = image.into_luma_alpha8();
        image.pixels().map(|pixel| (pixel.0[1] == 255).then_some(pixel.0[0])).collect()
    } else {
        image.into_luma8().pixels().map(|pixel| Some(pixel.0[0])).collect()
    };
    Ok((width as usize, pixels))
}

fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().to_owned()
}

/// The parser's message without its own "at line 3, column 1": the error names the line already.
fn without_place(text: &str) -> String {
    text.rsplit_once(" at line ").map_or(text, |(what, _)| what).to_owned()
}
