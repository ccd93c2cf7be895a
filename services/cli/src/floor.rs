//! `guidedog floor`: what the shield makes of the floor in one depth frame.

use std::io::Cursor;
use std::path::Path;

use guidance::se2::Point;
use guidance::{DepthView, Stance, StepMax, Tilt};
use image::codecs::pnm::PnmDecoder;
use image::{DynamicImage, ImageFormat, ImageReader};
use messages::{Attitude, DepthHeader};
use serde_json::{Value, json};
use settings::{DepthIntrinsics, DepthSettings, Profile};

use crate::args::floor::FloorArgs;
use crate::exit::Failure;
use crate::out;
use crate::prepare;

/// Side of a cell of the picture, metres, and how far it reaches ahead and to either side.
const CELL_M: f64 = 0.1;
const AHEAD_M: f64 = 4.0;
const ASIDE_M: f64 = 2.5;

/// `guidedog floor`.
///
/// # Errors
/// Where the frame cannot be read, is no depth frame of that camera, or shows no floor by which it could be found how
/// the body is held.
pub fn floor(args: &FloorArgs, as_json: bool) -> Result<(), Failure> {
    let frame = || args.frame.display();
    let (pixels_mm, [width, height]) = read(&args.frame)?;
    let settings = prepare::load(Profile::Walk, args.config.as_deref())?;
    let header = header(args, settings.depth.clone(), [width, height])?;
    let refused = |error: &dyn std::fmt::Display| Failure::input(format!("{}: {error}", frame()));
    let attitude = if args.find {
        let found = Stance::default().attitude(&header, &pixels_mm, header.robot_from_camera.z_m);
        found.map_err(|error| refused(&error))?.ok_or_else(|| {
            refused(&"it shows no floor within 12 degrees of a level body; --height-m and --pitch-deg say better")
        })?
    } else {
        Attitude::at_height(1, args.roll_deg.to_radians(), 0.0, header.robot_from_camera.z_m)
    };
    // The camera's height is over the floor on which the body stands as it is held.
    let attitude = Attitude { stamp_ns: 1, ..attitude };
    let tilt = Tilt::of(&attitude).ok_or_else(|| refused(&"this attitude cannot be used"))?;
    let mut view = DepthView::with_steps(settings.step_max());
    view.fill_tilted(&header, &pixels_mm, Some(&tilt)).map_err(|error| refused(&error))?;
    let report = report(args, &pixels_mm, &attitude, &view, settings.step_max());
    out::tell(as_json, &report, || lines(&report, &view))
}

fn read(path: &Path) -> Result<(Vec<u16>, [u32; 2]), Failure> {
    let failed = |error: &dyn std::fmt::Display| Failure::input(format!("{}: {error}", path.display()));
    if !std::fs::metadata(path).map_err(|error| failed(&error))?.is_file() {
        return Err(failed(&"it is no regular file"));
    }
    let bytes = std::fs::read(path).map_err(|error| failed(&error))?;
    let reader = ImageReader::new(Cursor::new(&bytes[..])).with_guessed_format().map_err(|error| failed(&error))?;
    if reader.format() == Some(ImageFormat::Pnm) {
        // Of another maximum, its numbers would be scaled.
        let header = PnmDecoder::new(&bytes[..]).map_err(|error| failed(&error))?.header().maximal_sample();
        if header != u32::from(u16::MAX) && header > u32::from(u8::MAX) {
            return Err(failed(&format!("its greatest number is {header}; of millimetres it has to be 65535")));
        }
    }
    match reader.decode().map_err(|error| failed(&error))? {
        DynamicImage::ImageLuma16(frame) => Ok((frame.as_raw().clone(), [frame.width(), frame.height()])),
        other => Err(failed(&format!("its pixels are {:?}, not grey of 16 bits: it is no depth frame", other.color()))),
    }
}

fn header(args: &FloorArgs, mut depth: DepthSettings, [width, height]: [u32; 2]) -> Result<DepthHeader, Failure> {
    if args.lens.is_none() && depth.intrinsics.is_some() && (depth.width, depth.height) != (width, height) {
        let (path, of) = (args.frame.display(), (depth.width, depth.height));
        return Err(Failure::input(format!(
            "{path}: it has {width}x{height} pixels, and depth.intrinsics is of {}x{}; --lens says better",
            of.0, of.1
        )));
    }
    (depth.width, depth.height) = (width, height);
    let mut header = depth.header();
    if let Some(lens) = args.lens {
        let [fx_px, fy_px, cx_px, cy_px] = lens.map(|px| px as f32);
        let told = DepthIntrinsics { fx_px, fy_px, cx_px, cy_px };
        told.head(&depth).check().map_err(|refused| Failure::input(format!("--lens: {refused}")))?;
        let [fx_px, fy_px, cx_px, cy_px] = lens;
        header = DepthHeader { fx_px, fy_px, cx_px, cy_px, ..header };
    }
    let mount = &mut header.robot_from_camera;
    mount.z_m = args.height_m.unwrap_or(mount.z_m);
    mount.pitch_rad = args.pitch_deg.map_or(mount.pitch_rad, f64::to_radians);
    Ok(header)
}

fn report(args: &FloorArgs, pixels_mm: &[u16], attitude: &Attitude, view: &DepthView, step_max: StepMax) -> Value {
    let known = pixels_mm.iter().filter(|pixel| **pixel > 0).count();
    let places = |places: &[Point]| places.iter().map(|place| json!([place.x, place.y])).collect::<Vec<_>>();
    let seen = || cells().flat_map(|(_, row)| row).filter(|place| view.shows_floor(*place));
    json!({
        "frame": args.frame,
        "known": known as f64 / pixels_mm.len().max(1) as f64,
        "attitude": {
            "roll_deg": attitude.roll_rad.to_degrees(),
            "pitch_deg": attitude.pitch_rad.to_degrees(),
        },
        "floor": {
            "shown": view.shows_any_floor(),
            "area_m2": seen().count() as f64 * CELL_M * CELL_M,
            "from_m": seen().map(|place| place.x).min_by(f64::total_cmp),
            "to_m": seen().map(|place| place.x).max_by(f64::total_cmp),
        },
        "edges": places(view.edges()),
        "steps": view.steps().iter().map(|step| json!({
            "place": [step.place.x, step.place.y],
            "rise_m": step.rise_m,
            "can_be_taken": step_max.allows(step.rise_m),
        })).collect::<Vec<_>>(),
        "obstacles": places(view.points()),
    })
}

/// Rows of cells, the farthest first, and in each the middles of its cells from left to right.
fn cells() -> impl Iterator<Item = (f64, impl Iterator<Item = Point>)> {
    let count = |m: f64| (m / CELL_M).round() as i32;
    let rows = (0..count(AHEAD_M)).rev().map(|row| (f64::from(row) + 0.5) * CELL_M);
    rows.map(move |x| {
        let columns = (-count(ASIDE_M)..count(ASIDE_M)).rev();
        (x, columns.map(move |column| Point::new(x, (f64::from(column) + 0.5) * CELL_M)))
    })
}

fn lines(report: &Value, view: &DepthView) -> Vec<String> {
    let is_in = |place: Point, points: &[Point]| points.iter().any(|point| (point - place).amax() <= CELL_M / 2.0);
    let steps: Vec<Point> = view.steps().iter().map(|step| step.place).collect();
    let character = |place: Point| match () {
        () if is_in(place, view.edges()) => 'E',
        () if is_in(place, &steps) => 's',
        () if is_in(place, view.points()) => '#',
        () if view.shows_floor(place) => '.',
        () if view.is_beyond_edge(place) => '~',
        () => ' ',
    };
    let rows = cells().map(|(x_m, row)| format!("{x_m:4.2} {}", row.map(character).collect::<String>().trim_end()));
    let mut lines: Vec<String> = rows.collect();
    let number = |path: &str| out::number(report, path);
    let count = |key: &str| report[key].as_array().map_or(0, Vec::len);
    let [roll, pitch] = ["roll_deg", "pitch_deg"].map(|key| number(&format!("/attitude/{key}")));
    let floor = if number("/floor/area_m2") > 0.0 {
        format!(
            "{:.1} m2, {:.2} to {:.2} m ahead",
            number("/floor/area_m2"),
            number("/floor/from_m"),
            number("/floor/to_m")
        )
    } else {
        "none is seen".to_owned()
    };
    lines.extend([
        format!("measured {:.0} % of the pixels", 100.0 * number("/known")),
        format!("held     roll {roll:.1}, pitch {pitch:.1} degrees"),
        format!("floor    {floor}"),
        format!("edges    in {} columns; obstacles in {}", count("edges"), count("obstacles")),
        format!("steps    {}", steps_told(view)),
    ]);
    lines
}

/// In how many places the floor steps down and up, and by how much: of one step they differ by the camera's noise.
fn steps_told(view: &DepthView) -> String {
    let told = |way: f64, name: &str| {
        let steps_cm = || view.steps().iter().map(|step| 100.0 * way * step.rise_m).filter(|step_cm| *step_cm > 0.0);
        let [least, most] = [steps_cm().min_by(f64::total_cmp)?, steps_cm().max_by(f64::total_cmp)?];
        Some(format!("{} places step {name} by {least:.1} to {most:.1} cm", steps_cm().count()))
    };
    let both: Vec<String> = [told(-1.0, "down"), told(1.0, "up")].into_iter().flatten().collect();
    if both.is_empty() { "none".to_owned() } else { both.join("; ") }
}
