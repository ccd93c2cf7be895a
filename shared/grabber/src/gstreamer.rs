//! Depth frames of a GStreamer pipeline: `v4l2src` for cameras whose depth the kernel calls `Y16`, or any maker's own
//! source. `Z16`, as RealSense cameras have it, v4l2src does not know (GStreamer 1.22): they come by librealsense.
//!
//! A frame stays in the pipeline's buffer until it is written to shared memory. Whether it was copied before is the
//! source's affair: v4l2src hands over what the kernel wrote.

mod ffi;

use camera::{Head, Raw};
use settings::DepthSettings;
use transport::monotonic_ns;

use crate::{Frame, Grab, Trouble};
use ffi::{Change, Gst, Kind, LIBRARY, Mapped, NoPipeline, Pipeline, State};

/// The pipeline's sink: the newest frame, and none that waits.
const SINK: &str = "appsink name=guidedog-frames max-buffers=1 drop=true";
const SINK_NAME: &str = "guidedog-frames";
/// What a frame has to be.
const FORMAT: &str = "GRAY16_LE";
/// A device that is not open after so long will not be, nanoseconds.
const OPEN_LIMIT_NS: u64 = 5_000_000_000;
/// So long a frame is waited for at a time, nanoseconds.
const PULL_NS: u64 = 100_000_000;
/// Where GStreamer's parts come from.
const INSTALL: &str = "sudo apt-get install gstreamer1.0-plugins-base gstreamer1.0-plugins-good";

/// A pipeline that plays.
#[derive(Debug)]
pub struct GstCamera {
    pipeline: Pipeline,
    launch: String,
    /// What every frame begins with.
    head: Head,
    unit_mm: f32,
    latency_ns: u64,
}

/// Builds the pipeline, and opens nothing: what was found, in words.
///
/// # Errors
/// Where GStreamer or one of the elements is not there, or the text is no pipeline.
pub fn check(depth: &DepthSettings) -> Result<String, Trouble> {
    parse(depth).map(|_| "the pipeline and its elements are there; it was not started".to_owned())
}

fn parse(depth: &DepthSettings) -> Result<Pipeline, Trouble> {
    let gst = Gst::get().map_err(|why| Trouble::new(format!("{LIBRARY} cannot be opened: {why}"), INSTALL))?;
    let launch = &depth.gstreamer.pipeline;
    Pipeline::parse(gst, &format!("{launch} ! {SINK}"), SINK_NAME).map_err(|NoPipeline { why, element_missing }| {
        let fix = if element_missing {
            format!(
                "{INSTALL} (v4l2src is of -good, shmsrc of -bad), or its maker's plugin; gst-inspect-1.0 lists them"
            )
        } else {
            "depth.gstreamer.pipeline is as gst-launch-1.0 takes it, without a sink".to_owned()
        };
        Trouble::new(format!("no pipeline: {why}"), fix)
    })
}

impl GstCamera {
    /// Builds and starts the pipeline; where it is `live_only`, nothing that a file gives.
    ///
    /// # Errors
    /// Where it cannot be built or does not start; why, and what to do.
    pub fn open(depth: &DepthSettings, live_only: bool) -> Result<Self, Trouble> {
        let lens = depth.intrinsics.ok_or_else(|| Trouble::new("no lens is known", "give depth.intrinsics"))?;
        let pipeline = parse(depth)?;
        pipeline.set(State::Paused);
        let live = match pipeline.settle(OPEN_LIMIT_NS) {
            Change::Live => true,
            Change::Done => false,
            Change::Failed => return Err(broken(&pipeline)),
            Change::Begun => {
                return Err(Trouble::new("the pipeline does not start", "is the camera free, and sending?"));
            }
        };
        if live_only && !live {
            let fix =
                "locomotion.link commands a real robot: name a camera, with is-live=true where its element has that";
            return Err(Trouble::new("the pipeline is not live, as that of a file is not", fix));
        }
        // What is not live would come all at once.
        pipeline.pace(!live);
        if pipeline.set(State::Playing) == Change::Failed {
            return Err(broken(&pipeline));
        }
        Ok(Self {
            pipeline,
            launch: depth.gstreamer.pipeline.clone(),
            head: lens.head(depth),
            unit_mm: (depth.gstreamer.unit_m.get() * 1000.0) as f32,
            latency_ns: depth.gstreamer.latency.map_or(0, settings::Millis::ns),
        })
    }

    /// When it was taken, nanoseconds of the monotonic clock: by the time that its source gave it, less the latency;
    /// where it has no time, when it came. Never in the future.
    fn taken_ns(&self, frame: &Mapped) -> u64 {
        // In this order: who is held up between the two makes the frame older, not younger.
        let now_ns = monotonic_ns();
        let age_ns = self.pipeline.age_ns(frame).map_or(0, |age_ns| age_ns.max(0).cast_unsigned());
        now_ns.saturating_sub(age_ns.saturating_add(self.latency_ns))
    }
}

/// In GStreamer's own words.
fn broken(pipeline: &Pipeline) -> Trouble {
    let why = pipeline.error().unwrap_or_else(|| "it does not say why".to_owned());
    Trouble::new(format!("the pipeline broke: {why}"), "it is opened anew; gst-launch-1.0 -v tells more")
}

fn check_kind(kind: &Kind, head: &Head) -> Result<(), Trouble> {
    let wanted = Kind { media: "video/x-raw".to_owned(), format: FORMAT.to_owned(), size: [head.width, head.height] };
    if *kind == wanted {
        return Ok(());
    }
    let Kind { media, format, size: [width, height] } = kind;
    let caps = format!("video/x-raw,format={FORMAT},width={},height={}", head.width, head.height);
    let fix = format!("end depth.gstreamer.pipeline in \"{caps}\" (depth.width x depth.height)");
    Err(Trouble::new(format!("the pipeline gives {media} {format} of {width} x {height}"), fix))
}

impl Grab for GstCamera {
    type Item = Box<dyn Frame>;

    fn about(&self) -> String {
        format!("GStreamer: {}", self.launch)
    }

    fn grab(&mut self) -> Result<Option<Self::Item>, Trouble> {
        if let Some(sample) = self.pipeline.pull(PULL_NS) {
            check_kind(&sample.kind(), &self.head)?;
            let Some(mapped) = sample.map() else {
                return Err(Trouble::new("a frame's bytes cannot be read", "put videoconvert behind its source"));
            };
            let head = Head { taken_ns: self.taken_ns(&mapped), ..self.head };
            return Ok(Some(Box::new(GstFrame { mapped, head, unit_mm: self.unit_mm })));
        }
        if let Some(why) = self.pipeline.error() {
            return Err(Trouble::new(format!("the pipeline broke: {why}"), "it is opened anew"));
        }
        if self.pipeline.is_over() {
            return Err(Trouble::new("the pipeline has ended", "it is opened anew"));
        }
        Ok(None)
    }
}

/// A frame in the pipeline's buffer.
struct GstFrame {
    mapped: Mapped,
    head: Head,
    unit_mm: f32,
}

impl Frame for GstFrame {
    fn head(&self) -> Head {
        self.head
    }

    fn raw(&self) -> Raw<'_> {
        // Without a word to the contrary, which a sink has to ask for, rows begin at multiples of four bytes.
        let row_bytes = (2 * self.head.width as usize).next_multiple_of(4);
        Raw { bytes: self.mapped.bytes(), row_bytes, unit_mm: self.unit_mm }
    }
}

#[cfg(test)]
mod tests {
    use super::{FORMAT, Kind, check_kind};
    use camera::Head;

    #[test]
    fn frames_of_another_kind_are_refused_with_what_to_write() {
        let head = Head { taken_ns: 0, width: 640, height: 480, focal_px: [380.0; 2], axis_px: [320.0, 240.0] };
        let kind = |media: &str, format: &str, size| Kind { media: media.to_owned(), format: format.to_owned(), size };
        assert_eq!(check_kind(&kind("video/x-raw", FORMAT, [640, 480]), &head), Ok(()));
        for (wrong, found) in [
            (kind("video/x-raw", "GRAY8", [640, 480]), "video/x-raw GRAY8 of 640 x 480"),
            (kind("video/x-raw", FORMAT, [320, 240]), "GRAY16_LE of 320 x 240"),
            (kind("image/jpeg", "", [640, 480]), "image/jpeg  of"),
        ] {
            let trouble = check_kind(&wrong, &head).expect_err("it is of another kind");
            assert!(trouble.found.contains(found), "{trouble}");
            assert!(trouble.fix.contains("format=GRAY16_LE,width=640,height=480"), "{trouble}");
        }
    }
}
