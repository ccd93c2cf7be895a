//! What is used of librealsense's C interface (2.43 and newer), each call made safe.

use std::ffi::{CString, OsString, c_char, c_float, c_int, c_uint, c_void};
use std::path::{Path, PathBuf};
use std::ptr::null_mut;
use std::sync::OnceLock;

use crate::library::{self, Handle, functions, text};

/// As its developers' package has it; what runs alone is called after its version.
const LIBRARY: &str = "librealsense2.so";
const MINORS: std::ops::RangeInclusive<u32> = 43..=99;
/// `RS2_STREAM_DEPTH` and `RS2_FORMAT_Z16`; `RS2_STREAM_POSE` and `RS2_FORMAT_6DOF`.
const DEPTH: [c_int; 2] = [1, 1];
const POSE: [c_int; 2] = [8, 18];
/// `RS2_CAMERA_INFO_NAME`, `RS2_CAMERA_INFO_SERIAL_NUMBER`
const INFO: [c_int; 2] = [0, 1];
/// `RS2_TIMESTAMP_DOMAIN_HARDWARE_CLOCK`: the camera's own.
const CAMERA_CLOCK: c_int = 0;

type Errors = *mut *mut c_void;

functions! {
    /// Of librealsense; objects are `*mut c_void`, and all but those that give back may fail.
    Functions {
        rs2_get_api_version(Errors) -> c_int;
        rs2_get_error_message(*const c_void) -> *const c_char;
        rs2_free_error(*mut c_void);
        rs2_create_context(c_int, Errors) -> *mut c_void;
        rs2_delete_context(*mut c_void);
        rs2_query_devices(*const c_void, Errors) -> *mut c_void;
        rs2_get_device_count(*const c_void, Errors) -> c_int;
        rs2_delete_device_list(*mut c_void);
        rs2_create_device(*const c_void, c_int, Errors) -> *mut c_void;
        rs2_get_device_info(*const c_void, c_int, Errors) -> *const c_char;
        rs2_delete_device(*mut c_void);
        rs2_create_pipeline(*mut c_void, Errors) -> *mut c_void;
        rs2_delete_pipeline(*mut c_void);
        rs2_create_config(Errors) -> *mut c_void;
        rs2_delete_config(*mut c_void);
        rs2_config_enable_stream(*mut c_void, c_int, c_int, c_int, c_int, c_int, c_int, Errors);
        rs2_config_enable_device(*mut c_void, *const c_char, Errors);
        rs2_config_enable_device_from_file(*mut c_void, *const c_char, Errors);
        rs2_pipeline_start_with_config(*mut c_void, *mut c_void, Errors) -> *mut c_void;
        rs2_pipeline_profile_get_device(*mut c_void, Errors) -> *mut c_void;
        rs2_delete_pipeline_profile(*mut c_void);
        rs2_pipeline_try_wait_for_frames(*mut c_void, *mut *mut c_void, c_uint, Errors) -> c_int;
        rs2_embedded_frames_count(*mut c_void, Errors) -> c_int;
        rs2_extract_frame(*mut c_void, c_int, Errors) -> *mut c_void;
        rs2_release_frame(*mut c_void);
        rs2_get_frame_stream_profile(*const c_void, Errors) -> *const c_void;
        rs2_get_stream_profile_data(*const c_void, *mut c_int, *mut c_int, *mut c_int, *mut c_int, *mut c_int, Errors);
        rs2_get_video_stream_intrinsics(*const c_void, *mut Intrinsics, Errors);
        rs2_get_frame_data(*const c_void, Errors) -> *const c_void;
        rs2_get_frame_data_size(*const c_void, Errors) -> c_int;
        rs2_get_frame_stride_in_bytes(*const c_void, Errors) -> c_int;
        rs2_get_frame_timestamp(*const c_void, Errors) -> f64;
        rs2_get_frame_timestamp_domain(*const c_void, Errors) -> c_int;
        rs2_depth_frame_get_units(*const c_void, Errors) -> c_float;
        rs2_pose_frame_get_pose_data(*const c_void, *mut Pose, Errors);
    }
}

/// `rs2_intrinsics`
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub struct Intrinsics {
    /// Columns and rows.
    pub size: [c_int; 2],
    /// Column and row of the optical axis, pixels.
    pub axis_px: [c_float; 2],
    /// Focal lengths along columns and rows, pixels.
    pub focal_px: [c_float; 2],
    /// How the lens bends, where it does.
    pub model: c_int,
    /// By how much; all 0 where it does not.
    pub coefficients: [c_float; 5],
}

/// `rs2_pose`: by the library's axes (x right, y up, z backward), in a frame that begins where the camera did, level
/// with the ground.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pose {
    /// Place, metres.
    pub place_m: [c_float; 3],
    /// Velocity, metres per second.
    pub velocity_mps: [c_float; 3],
    /// Acceleration, metres per second squared.
    pub acceleration_mps2: [c_float; 3],
    /// Rotation, a unit quaternion: x, y, z, w.
    pub rotation: [c_float; 4],
    /// Angular velocity, radians per second.
    pub turn_radps: [c_float; 3],
    /// Angular acceleration, radians per second squared.
    pub turn_radps2: [c_float; 3],
    /// How sure its tracker is: 0 (it is lost) to 3.
    pub confidence: c_uint,
    /// How sure its map is.
    pub map_confidence: c_uint,
}

/// The library.
#[derive(Debug)]
pub struct Rs2(Functions);

static RS2: OnceLock<Rs2> = OnceLock::new();

/// What a camera is to give.
#[derive(Debug, Clone, Copy)]
pub enum Stream {
    /// Depth frames: columns, rows, frames a second; 0 lets the library choose.
    Depth([u32; 3]),
    /// Poses.
    Pose,
}

/// Which camera.
#[derive(Debug, Clone, Copy)]
pub enum Wanted<'a> {
    /// One that is plugged in, by its serial number where that matters.
    Live(Option<&'a str>),
    /// A file, again and again.
    File(&'a Path),
}

impl Rs2 {
    /// Opens it, once: the library of that name, or whichever the loader finds.
    ///
    /// # Errors
    /// Where it is not there, or older: what the loader says.
    pub fn get(library: Option<&Path>) -> Result<&'static Self, String> {
        if let Some(rs2) = RS2.get() {
            return Ok(rs2);
        }
        let names: Vec<OsString> = match library {
            Some(path) => vec![path.into()],
            None => {
                let versioned = MINORS.rev().map(|minor| format!("{LIBRARY}.2.{minor}").into());
                versioned.chain([LIBRARY.into()]).collect()
            }
        };
        // SAFETY: declared as in librealsense's headers since 2.43.
        let rs2 = Self(unsafe { Functions::of(library::open(names)?) }?);
        Ok(RS2.get_or_init(|| rs2))
    }

    /// Calls what may fail: its result, or the library's word.
    fn call<R>(&self, what: impl FnOnce(Errors) -> R) -> Result<R, String> {
        let mut error = null_mut();
        let result = what(&raw mut error);
        if error.is_null() {
            return Ok(result);
        }
        // SAFETY: the error is ours; its message lives as long as it.
        unsafe {
            let message = text((self.0.rs2_get_error_message)(error));
            (self.0.rs2_free_error)(error);
            Err(message)
        }
    }

    /// The same, of what gives something that is ours from then on.
    fn make(
        &self,
        give_back: unsafe extern "C" fn(*mut c_void),
        what: impl FnOnce(Errors) -> *mut c_void,
    ) -> Result<Handle, String> {
        let it = self.call(what)?;
        // SAFETY: whoever calls names the function that the library has for it.
        unsafe { Handle::new(it, give_back) }.ok_or_else(|| "the library gave nothing".to_owned())
    }

    fn context(&self) -> Result<Handle, String> {
        let f = &self.0;
        // SAFETY: no argument but a place for the error, and the library's own version.
        let version = self.call(|e| unsafe { (f.rs2_get_api_version)(e) })?;
        // SAFETY: as above.
        self.make(f.rs2_delete_context, |e| unsafe { (f.rs2_create_context)(version, e) })
    }

    /// Name and serial number; what a device does not tell is empty.
    fn about(&self, device: &Handle) -> [String; 2] {
        INFO.map(|which| {
            // SAFETY: the device is alive, and the text for as long as it.
            self.call(|e| unsafe { text((self.0.rs2_get_device_info)(device.get(), which, e)) }).unwrap_or_default()
        })
    }

    /// Stream and format of a frame, which is alive.
    fn kind(&self, frame: *const c_void) -> Result<[c_int; 2], String> {
        // SAFETY: the frame is alive, and its profile for as long as it.
        let profile = self.call(|e| unsafe { (self.0.rs2_get_frame_stream_profile)(frame, e) })?;
        let (mut stream, mut format, [mut index, mut id, mut rate]) = (0, 0, [0; 3]);
        let (which, what) = (&raw mut stream, &raw mut format);
        let others = [&raw mut index, &raw mut id, &raw mut rate];
        self.call(|e| {
            // SAFETY: as above; five places for what is told.
            unsafe { (self.0.rs2_get_stream_profile_data)(profile, which, what, others[0], others[1], others[2], e) }
        })?;
        Ok([stream, format])
    }

    /// When a frame, which is alive, was taken.
    fn taken_ms(&self, frame: *const c_void) -> Result<Option<f64>, String> {
        // SAFETY: the frame is alive.
        let domain = self.call(|e| unsafe { (self.0.rs2_get_frame_timestamp_domain)(frame, e) })?;
        // SAFETY: as above.
        let taken_ms = self.call(|e| unsafe { (self.0.rs2_get_frame_timestamp)(frame, e) })?;
        Ok((domain != CAMERA_CLOCK).then_some(taken_ms))
    }

    /// Names and serial numbers of the cameras that are plugged in.
    ///
    /// # Errors
    /// In the library's words.
    pub fn cameras(&self) -> Result<Vec<[String; 2]>, String> {
        let (f, context) = (&self.0, self.context()?);
        // SAFETY: context and list are alive while they are used.
        let list = self.make(f.rs2_delete_device_list, |e| unsafe { (f.rs2_query_devices)(context.get(), e) })?;
        // SAFETY: as above.
        let count = self.call(|e| unsafe { (f.rs2_get_device_count)(list.get(), e) })?;
        let device = |i| {
            // SAFETY: as above; it is one of so many.
            self.make(f.rs2_delete_device, |e| unsafe { (f.rs2_create_device)(list.get(), i, e) })
        };
        (0..count).map(|i| device(i).map(|device| self.about(&device))).collect()
    }
}

/// A camera that streams, or a file that is played; it ends when this is dropped.
#[derive(Debug)]
pub struct Streaming {
    rs2: &'static Rs2,
    pipeline: Handle,
    /// Outlives the pipeline, as fields are dropped in their order.
    _context: Handle,
    /// Its name and serial number.
    pub about: [String; 2],
}

impl Streaming {
    /// Begins.
    ///
    /// # Errors
    /// Where there is no such camera or file, or it cannot give that: in the library's words.
    pub fn start(rs2: &'static Rs2, stream: Stream, wanted: Wanted<'_>) -> Result<Self, String> {
        let (f, context) = (&rs2.0, rs2.context()?);
        let c_text = |text: &str| CString::new(text).map_err(|_| "it has a zero in it".to_owned());
        // SAFETY: no argument but a place for the error.
        let config = rs2.make(f.rs2_delete_config, |e| unsafe { (f.rs2_create_config)(e) })?;
        let (serial, file) = match wanted {
            Wanted::Live(serial) => (serial.map(c_text).transpose()?, None),
            Wanted::File(path) => (None, Some(c_text(&path.to_string_lossy())?)),
        };
        let ([kind, format], [width, height, rate_hz]) = match stream {
            Stream::Depth(size) => (DEPTH, size.map(u32::cast_signed)),
            Stream::Pose => (POSE, [0; 3]),
        };
        if let Some(serial) = serial {
            // SAFETY: here and below every object is alive while it is used, and every text ends in zero.
            rs2.call(|e| unsafe { (f.rs2_config_enable_device)(config.get(), serial.as_ptr(), e) })?;
        }
        if let Some(file) = file {
            // SAFETY: as above.
            rs2.call(|e| unsafe { (f.rs2_config_enable_device_from_file)(config.get(), file.as_ptr(), e) })?;
        }
        rs2.call(|e| {
            // SAFETY: as above; 0 for a number lets the library choose.
            unsafe { (f.rs2_config_enable_stream)(config.get(), kind, 0, width, height, format, rate_hz, e) }
        })?;
        // SAFETY: as above.
        let pipeline = rs2.make(f.rs2_delete_pipeline, |e| unsafe { (f.rs2_create_pipeline)(context.get(), e) })?;
        let profile = rs2.make(f.rs2_delete_pipeline_profile, |e| {
            // SAFETY: as above.
            unsafe { (f.rs2_pipeline_start_with_config)(pipeline.get(), config.get(), e) }
        })?;
        // SAFETY: as above.
        let device = |e| unsafe { (f.rs2_pipeline_profile_get_device)(profile.get(), e) };
        let about = rs2.about(&rs2.make(f.rs2_delete_device, device)?);
        Ok(Self { rs2, pipeline, _context: context, about })
    }

    /// The next depth frame, if it comes so soon.
    ///
    /// # Errors
    /// In the library's words.
    pub fn next_depth(&self, limit_ms: u32) -> Result<Option<Shot>, String> {
        self.next(limit_ms, Shot::of)
    }

    /// The next pose, if it comes so soon, and when it was taken, as [`Shot::taken_ms`].
    ///
    /// # Errors
    /// In the library's words.
    pub fn next_pose(&self, limit_ms: u32) -> Result<Option<(Pose, Option<f64>)>, String> {
        self.next(limit_ms, |rs2, frame| {
            let (f, it) = (&rs2.0, frame.get().cast_const());
            if rs2.kind(it)? != POSE {
                return Ok(None);
            }
            let mut pose = Pose::default();
            let place = &raw mut pose;
            // SAFETY: the frame is alive, and one of poses; a place of the library's own layout.
            rs2.call(|e| unsafe { (f.rs2_pose_frame_get_pose_data)(it, place, e) })?;
            Ok(Some((pose, rs2.taken_ms(it)?)))
        })
    }

    fn next<T>(
        &self,
        limit_ms: u32,
        of: impl Fn(&Rs2, Handle) -> Result<Option<T>, String>,
    ) -> Result<Option<T>, String> {
        let (rs2, f, mut frames) = (self.rs2, &self.rs2.0, null_mut());
        // SAFETY: the pipeline is alive; what comes is ours.
        let wait =
            |e| unsafe { (f.rs2_pipeline_try_wait_for_frames)(self.pipeline.get(), &raw mut frames, limit_ms, e) != 0 };
        let came = rs2.call(wait)?;
        // SAFETY: null, or a set of frames that is ours.
        let Some(set) = unsafe { Handle::new(frames, f.rs2_release_frame) }.filter(|_| came) else { return Ok(None) };
        // SAFETY: the set is alive; a frame that is taken out of it has a reference of its own.
        let count = rs2.call(|e| unsafe { (f.rs2_embedded_frames_count)(set.get(), e) })?;
        for i in 0..count {
            // SAFETY: as above; it is one of so many.
            let frame = rs2.make(f.rs2_release_frame, |e| unsafe { (f.rs2_extract_frame)(set.get(), i, e) })?;
            if let Some(it) = of(rs2, frame)? {
                return Ok(Some(it));
            }
        }
        Ok(None)
    }
}

/// A depth frame, still as the library has it.
#[derive(Debug)]
pub struct Shot {
    _frame: Handle,
    data: *const u8,
    len: usize,
    /// From one row to the next, bytes.
    pub row_bytes: usize,
    /// The lens.
    pub lens: Intrinsics,
    /// What 1 stands for, metres.
    pub unit_m: f32,
    /// When it was taken, milliseconds since 1970 by this machine's clock; none where only the camera's is known.
    pub taken_ms: Option<f64>,
}

// SAFETY: the data is the frame's, which may be read and released by any thread.
unsafe impl Send for Shot {}

impl Shot {
    /// All that is to be known of a frame; none of one that is not depth.
    fn of(rs2: &Rs2, frame: Handle) -> Result<Option<Self>, String> {
        let (f, it) = (&rs2.0, frame.get().cast_const());
        if rs2.kind(it)? != DEPTH {
            return Ok(None);
        }
        // SAFETY: the frame is alive for all these calls, and its profile for as long as it.
        let profile = rs2.call(|e| unsafe { (f.rs2_get_frame_stream_profile)(it, e) })?;
        let mut lens = Intrinsics::default();
        let place = &raw mut lens;
        // SAFETY: as above; a place of the library's own layout.
        rs2.call(|e| unsafe { (f.rs2_get_video_stream_intrinsics)(profile, place, e) })?;
        // SAFETY: as above.
        let row_bytes = rs2.call(|e| unsafe { (f.rs2_get_frame_stride_in_bytes)(it, e) })?;
        // SAFETY: as above.
        let len = rs2.call(|e| unsafe { (f.rs2_get_frame_data_size)(it, e) })?;
        let taken_ms = rs2.taken_ms(it)?;
        // SAFETY: as above.
        let unit_m = rs2.call(|e| unsafe { (f.rs2_depth_frame_get_units)(it, e) })?;
        // SAFETY: as above; so many bytes for as long as the frame lives.
        let data = rs2.call(|e| unsafe { (f.rs2_get_frame_data)(it, e) })?.cast();
        Ok(Some(Self {
            _frame: frame,
            data,
            len: usize::try_from(len).unwrap_or(0),
            row_bytes: usize::try_from(row_bytes).unwrap_or(0),
            lens,
            unit_m,
            taken_ms,
        }))
    }

    /// The bytes.
    pub fn bytes(&self) -> &[u8] {
        if self.data.is_null() {
            return &[];
        }
        // SAFETY: the library's own word, for as long as the frame lives; nobody writes to it.
        unsafe { std::slice::from_raw_parts(self.data, self.len) }
    }
}

/// Where the library is looked for.
pub fn place(library: Option<&Path>) -> PathBuf {
    library.unwrap_or(Path::new(LIBRARY)).to_owned()
}
