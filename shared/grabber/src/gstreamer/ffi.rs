//! What is used of GStreamer's C interface (1.0, whose layouts are fixed), each call made safe.

use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::ptr::{NonNull, null_mut};
use std::sync::OnceLock;

use crate::library::{self, Handle, functions, text};

/// It brings libgstreamer and GLib with it.
pub const LIBRARY: &str = "libgstapp-1.0.so.0";

/// Nanoseconds that are none, as GStreamer has them.
const NONE_NS: u64 = u64::MAX;
/// `GST_MAP_READ`, `GST_MESSAGE_ERROR`, `GST_FORMAT_TIME`, `GST_PARSE_ERROR_NO_SUCH_ELEMENT`
const MAP_READ: c_uint = 1;
const MESSAGE_ERROR: c_uint = 1 << 1;
const FORMAT_TIME: c_uint = 3;
const NO_SUCH_ELEMENT: c_int = 1;

functions! {
    /// Of libgstapp, libgstreamer and GLib; objects are `*mut c_void`.
    Functions {
        gst_init_check(*mut c_int, *mut *mut *mut c_char, *mut *mut GError) -> c_int;
        gst_parse_launch(*const c_char, *mut *mut GError) -> *mut c_void;
        gst_parse_error_quark() -> u32;
        gst_object_ref_sink(*mut c_void) -> *mut c_void;
        gst_object_unref(*mut c_void);
        gst_mini_object_unref(*mut c_void);
        gst_bin_get_by_name(*mut c_void, *const c_char) -> *mut c_void;
        gst_util_set_object_arg(*mut c_void, *const c_char, *const c_char);
        gst_system_clock_obtain() -> *mut c_void;
        gst_clock_get_time(*mut c_void) -> u64;
        gst_pipeline_use_clock(*mut c_void, *mut c_void);
        gst_element_set_state(*mut c_void, c_int) -> c_int;
        gst_element_get_state(*mut c_void, *mut c_int, *mut c_int, u64) -> c_int;
        gst_element_get_base_time(*mut c_void) -> u64;
        gst_element_get_bus(*mut c_void) -> *mut c_void;
        gst_bus_timed_pop_filtered(*mut c_void, u64, c_uint) -> *mut c_void;
        gst_message_parse_error(*mut c_void, *mut *mut GError, *mut *mut c_char);
        gst_app_sink_try_pull_sample(*mut c_void, u64) -> *mut c_void;
        gst_app_sink_is_eos(*mut c_void) -> c_int;
        gst_sample_get_buffer(*mut c_void) -> *mut Buffer;
        gst_sample_get_caps(*mut c_void) -> *mut c_void;
        gst_sample_get_segment(*mut c_void) -> *mut c_void;
        gst_segment_to_running_time(*const c_void, c_uint, u64) -> u64;
        gst_caps_get_structure(*const c_void, c_uint) -> *mut c_void;
        gst_structure_get_name(*const c_void) -> *const c_char;
        gst_structure_get_string(*const c_void, *const c_char) -> *const c_char;
        gst_structure_get_int(*const c_void, *const c_char, *mut c_int) -> c_int;
        gst_buffer_map(*mut Buffer, *mut MapInfo, c_uint) -> c_int;
        gst_buffer_unmap(*mut Buffer, *mut MapInfo);
        g_error_free(*mut GError);
        g_free(*mut c_void);
    }
}

/// `GError`
#[repr(C)]
struct GError {
    domain: u32,
    code: c_int,
    message: *mut c_char,
}

/// The beginning of `GstBuffer`, whose time has no function.
#[repr(C)]
struct Buffer {
    /// `GstMiniObject`: type, reference count, lock, flags, three functions, two more of its own.
    kind: usize,
    counts: [c_int; 3],
    functions: [*mut c_void; 3],
    private: (c_uint, *mut c_void),
    pool: *mut c_void,
    pts: u64,
}

/// `GstMapInfo`
#[repr(C)]
#[derive(Debug)]
struct MapInfo {
    memory: *mut c_void,
    flags: c_uint,
    data: *mut u8,
    size: usize,
    size_max: usize,
    user_data: [*mut c_void; 4],
    reserved: [*mut c_void; 4],
}

/// What a pipeline goes through.
#[derive(Debug, Clone, Copy)]
pub enum State {
    /// `GST_STATE_NULL`
    Null = 1,
    /// `GST_STATE_PAUSED`
    Paused = 3,
    /// `GST_STATE_PLAYING`
    Playing = 4,
}

/// What comes of a change of state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// The pipeline's bus says why.
    Failed,
    /// It is in its new state.
    Done,
    /// It is on its way.
    Begun,
    /// It is paused, and gives frames only as they are taken: it is live.
    Live,
}

/// Why a text is no pipeline.
#[derive(Debug, PartialEq, Eq)]
pub struct NoPipeline {
    /// GStreamer's word.
    pub why: String,
    /// It names an element that is not installed.
    pub element_missing: bool,
}

/// GStreamer, begun.
#[derive(Debug)]
pub struct Gst(Functions);

static GST: OnceLock<Gst> = OnceLock::new();

impl Gst {
    /// Opens and begins it, once.
    ///
    /// # Errors
    /// Where it is not there or cannot begin: why.
    pub fn get() -> Result<&'static Self, String> {
        if let Some(gst) = GST.get() {
            return Ok(gst);
        }
        // SAFETY: declared as in GStreamer 1.0's headers, which later releases keep.
        let gst = Self(unsafe { Functions::of(library::open([LIBRARY])?) }?);
        let mut error = null_mut();
        // SAFETY: no arguments are given, and an error is asked for.
        if unsafe { (gst.0.gst_init_check)(null_mut(), null_mut(), &raw mut error) } == 0 {
            return Err(gst.take_error(error).map_or_else(|| "it does not begin".to_owned(), |(_, why)| why));
        }
        Ok(GST.get_or_init(|| gst))
    }

    /// An error's domain and code, and its message.
    fn take_error(&self, error: *mut GError) -> Option<((u32, c_int), String)> {
        let error = NonNull::new(error)?;
        // SAFETY: not null, hence an error of GLib's that is ours; it is read before it is freed.
        unsafe {
            let GError { domain, code, message } = error.read();
            let message = text(message);
            (self.0.g_error_free)(error.as_ptr());
            Some(((domain, code), message))
        }
    }

    /// An object that is ours.
    ///
    /// # Safety
    /// It is null, or a `GstObject` of which the caller has a reference to give away.
    unsafe fn object(&self, it: *mut c_void) -> Option<Handle> {
        // SAFETY: as promised by who calls.
        unsafe { Handle::new(it, self.0.gst_object_unref) }
    }
}

/// A pipeline that ends in an `appsink`, stopped when this is dropped.
#[derive(Debug)]
pub struct Pipeline {
    gst: &'static Gst,
    sink: Handle,
    bus: Handle,
    clock: Handle,
    pipeline: Handle,
}

impl Pipeline {
    /// Builds it of its text; its sink is called `sink`, and its time is the system clock's.
    ///
    /// # Errors
    /// Where the text is none.
    pub fn parse(gst: &'static Gst, launch: &str, sink: &str) -> Result<Self, NoPipeline> {
        let no = |why: &str| NoPipeline { why: why.to_owned(), element_missing: false };
        let [launch, sink] = [launch, sink].map(|text| CString::new(text).map_err(|_| no("it has a zero in it")));
        let (launch, sink) = (launch?, sink?);
        let (f, mut error) = (&gst.0, null_mut());
        // SAFETY: the texts end in zero and outlive their calls; what comes back is null or a floating object, which
        // is made ours; it is a pipeline, since its text has a link. By name, bus and clock come as references.
        unsafe {
            let parsed = NonNull::new((f.gst_parse_launch)(launch.as_ptr(), &raw mut error));
            let pipeline = parsed.and_then(|it| gst.object((f.gst_object_ref_sink)(it.as_ptr())));
            if let Some((which, why)) = gst.take_error(error) {
                return Err(NoPipeline {
                    why,
                    element_missing: which == ((f.gst_parse_error_quark)(), NO_SUCH_ELEMENT),
                });
            }
            let pipeline = pipeline.ok_or_else(|| no("it is none"))?;
            let clock = gst.object((f.gst_system_clock_obtain)()).ok_or_else(|| no("there is no clock"))?;
            (f.gst_pipeline_use_clock)(pipeline.get(), clock.get());
            let sink = gst.object((f.gst_bin_get_by_name)(pipeline.get(), sink.as_ptr()));
            let bus = gst.object((f.gst_element_get_bus)(pipeline.get()));
            let (sink, bus) = sink.zip(bus).ok_or_else(|| no("it has no sink"))?;
            Ok(Self { gst, sink, bus, clock, pipeline })
        }
    }

    /// Asks for a state.
    pub fn set(&self, state: State) -> Change {
        // SAFETY: the pipeline is ours; this may be called at any time.
        change(unsafe { (self.gst.0.gst_element_set_state)(self.pipeline.get(), state as c_int) })
    }

    /// Waits for the state that was asked for, so long at most.
    pub fn settle(&self, limit_ns: u64) -> Change {
        let state = |to| {
            // SAFETY: as above; where no state is wanted, null is allowed.
            unsafe { (self.gst.0.gst_element_get_state)(to, null_mut(), null_mut(), limit_ns) }
        };
        change(state(self.pipeline.get()))
    }

    /// Whether frames are given at their times (of what is not live), or as they come.
    pub fn pace(&self, at_their_times: bool) {
        let value = if at_their_times { c"true" } else { c"false" };
        // SAFETY: a sink has that property, and the texts are constants.
        unsafe { (self.gst.0.gst_util_set_object_arg)(self.sink.get(), c"sync".as_ptr(), value.as_ptr()) }
    }

    /// The next frame, if it comes so soon.
    pub fn pull(&self, limit_ns: u64) -> Option<Sample> {
        let f = &self.gst.0;
        // SAFETY: the sink is an appsink, by the pipeline's text; a sample is ours to give back.
        let sample = unsafe {
            Handle::new((f.gst_app_sink_try_pull_sample)(self.sink.get(), limit_ns), f.gst_mini_object_unref)
        };
        sample.map(|sample| Sample { gst: self.gst, sample })
    }

    /// Whether nothing more will come.
    pub fn is_over(&self) -> bool {
        // SAFETY: the sink is an appsink.
        unsafe { (self.gst.0.gst_app_sink_is_eos)(self.sink.get()) != 0 }
    }

    /// What went wrong, if anything: the message, and the last line of what is said for developers, which as a rule
    /// is the reason.
    pub fn error(&self) -> Option<String> {
        let (f, mut error, mut debug) = (&self.gst.0, null_mut(), null_mut());
        // SAFETY: messages of this kind alone are taken, each ours to give back; error and text are copies, and ours.
        let (message, reason) = unsafe {
            let popped = (f.gst_bus_timed_pop_filtered)(self.bus.get(), 0, MESSAGE_ERROR);
            let popped = Handle::new(popped, f.gst_mini_object_unref)?;
            (f.gst_message_parse_error)(popped.get(), &raw mut error, &raw mut debug);
            let reason = text(debug);
            (f.g_free)(debug.cast());
            (self.gst.take_error(error).map(|(_, message)| message).unwrap_or_default(), reason)
        };
        let reason = reason.lines().last().map(|line| format!(" ({line})")).unwrap_or_default();
        Some(format!("{message}{reason}"))
    }

    /// How old a frame is, where it has a time, nanoseconds: negative where that is still to come.
    pub fn age_ns(&self, frame: &Mapped) -> Option<i64> {
        let (f, sample) = (&self.gst.0, &frame.sample.sample);
        // SAFETY: sample, pipeline and clock are alive; a sample has a buffer where it was mapped, and its segment is
        // null or lives as long as it.
        unsafe {
            let (segment, pts) = ((f.gst_sample_get_segment)(sample.get()), (*frame.buffer).pts);
            if segment.is_null() || pts == NONE_NS {
                return None;
            }
            let running_ns = (f.gst_segment_to_running_time)(segment, FORMAT_TIME, pts);
            let taken_ns = (f.gst_element_get_base_time)(self.pipeline.get()).checked_add(running_ns)?;
            let now_ns = (f.gst_clock_get_time)(self.clock.get());
            (running_ns != NONE_NS).then(|| now_ns.wrapping_sub(taken_ns).cast_signed())
        }
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        // Its threads end before it is given back, as GStreamer wants it.
        self.set(State::Null);
    }
}

fn change(from: c_int) -> Change {
    match from {
        1 => Change::Done,
        2 => Change::Begun,
        3 => Change::Live,
        _ => Change::Failed,
    }
}

/// A frame, still as GStreamer has it.
#[derive(Debug)]
pub struct Sample {
    gst: &'static Gst,
    sample: Handle,
}

/// What kind of frame it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Kind {
    /// Such as `video/x-raw`.
    pub media: String,
    /// Such as `GRAY16_LE`; empty where there is none.
    pub format: String,
    /// Columns and rows; 0 where they are not told.
    pub size: [u32; 2],
}

impl Sample {
    /// Its kind.
    pub fn kind(&self) -> Kind {
        let f = &self.gst.0;
        // SAFETY: a sample's caps are null or live as long as it, and so do their first structure and its texts.
        unsafe {
            let caps = (f.gst_sample_get_caps)(self.sample.get());
            if caps.is_null() {
                return Kind { media: "no media".to_owned(), format: String::new(), size: [0; 2] };
            }
            let structure = (f.gst_caps_get_structure)(caps, 0);
            let size = [c"width", c"height"].map(|name| {
                let mut value = 0;
                (f.gst_structure_get_int)(structure, name.as_ptr(), &raw mut value);
                u32::try_from(value).unwrap_or(0)
            });
            let format = text((f.gst_structure_get_string)(structure, c"format".as_ptr()));
            Kind { media: text((f.gst_structure_get_name)(structure)), format, size }
        }
    }

    /// Its bytes, where they can be read.
    pub fn map(self) -> Option<Mapped> {
        let f = &self.gst.0;
        // SAFETY: zero is a value of every field. A buffer is null or lives as long as its sample.
        let (mut info, buffer) =
            unsafe { (std::mem::zeroed::<MapInfo>(), (f.gst_sample_get_buffer)(self.sample.get())) };
        // SAFETY: the buffer is there; what maps it outlives the call.
        let mapped = !buffer.is_null() && unsafe { (f.gst_buffer_map)(buffer, &raw mut info, MAP_READ) } != 0;
        mapped.then(|| Mapped { sample: self, buffer, info })
    }
}

/// A frame whose bytes can be read.
#[derive(Debug)]
pub struct Mapped {
    sample: Sample,
    buffer: *mut Buffer,
    info: MapInfo,
}

// SAFETY: the pointers are into the sample, which may be sent; mapped memory may be read and unmapped by any thread.
unsafe impl Send for Mapped {}

impl Mapped {
    /// The bytes.
    pub fn bytes(&self) -> &[u8] {
        if self.info.data.is_null() {
            return &[];
        }
        // SAFETY: mapped for reading until this is dropped, so many bytes, which nobody writes to meanwhile.
        unsafe { std::slice::from_raw_parts(self.info.data, self.info.size) }
    }
}

impl Drop for Mapped {
    fn drop(&mut self) {
        // SAFETY: mapped once, by `Sample::map`; the sample is given back after this.
        unsafe { (self.sample.gst.0.gst_buffer_unmap)(self.buffer, &raw mut self.info) }
    }
}

#[cfg(test)]
mod tests {
    use super::{Buffer, MapInfo};
    use std::mem::{offset_of, size_of};

    #[test]
    #[cfg(target_pointer_width = "64")]
    fn the_layouts_are_those_of_the_headers() {
        // As a C compiler has them, of GStreamer 1.22.
        assert_eq!((offset_of!(Buffer, pool), offset_of!(Buffer, pts)), (64, 72));
        assert_eq!((offset_of!(MapInfo, data), offset_of!(MapInfo, size), size_of::<MapInfo>()), (16, 24, 104));
    }
}
