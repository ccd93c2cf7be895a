//! What is used of ALSA's C interface (libasound 1.x), each call made safe.

use std::ffi::{CString, c_char, c_int, c_long, c_uint, c_ulong, c_void};
use std::ptr::null_mut;
use std::sync::OnceLock;

use crate::library::{self, Handle, functions, text};

/// ALSA's library.
pub const LIBRARY: &str = "libasound.so.2";

/// `SND_PCM_STREAM_CAPTURE`, `SND_PCM_NONBLOCK`, `SND_PCM_FORMAT_S16_LE`, `SND_PCM_ACCESS_RW_INTERLEAVED`
const CAPTURE: c_int = 1;
const NONBLOCK: c_int = 1;
const S16_LE: c_int = 2;
const INTERLEAVED: c_int = 3;
/// `-EAGAIN`, `-EPIPE` (samples were lost), `-ESTRPIPE` (it was suspended)
const AGAIN: c_long = -11;
const LOST: c_long = -32;
const SUSPENDED: c_long = -86;

functions! {
    /// Of libasound; a `snd_pcm_t` is `*mut c_void`.
    Functions {
        snd_pcm_open(*mut *mut c_void, *const c_char, c_int, c_int) -> c_int;
        snd_pcm_close(*mut c_void) -> c_int;
        snd_pcm_hw_params_malloc(*mut *mut c_void) -> c_int;
        snd_pcm_hw_params_free(*mut c_void);
        snd_pcm_hw_params_any(*mut c_void, *mut c_void) -> c_int;
        snd_pcm_hw_params_set_rate_resample(*mut c_void, *mut c_void, c_uint) -> c_int;
        snd_pcm_hw_params_set_access(*mut c_void, *mut c_void, c_int) -> c_int;
        snd_pcm_hw_params_set_format(*mut c_void, *mut c_void, c_int) -> c_int;
        snd_pcm_hw_params_set_channels(*mut c_void, *mut c_void, c_uint) -> c_int;
        snd_pcm_hw_params_set_rate(*mut c_void, *mut c_void, c_uint, c_int) -> c_int;
        snd_pcm_hw_params_set_period_time_near(*mut c_void, *mut c_void, *mut c_uint, *mut c_int) -> c_int;
        snd_pcm_hw_params_set_buffer_time_near(*mut c_void, *mut c_void, *mut c_uint, *mut c_int) -> c_int;
        snd_pcm_hw_params(*mut c_void, *mut c_void) -> c_int;
        snd_pcm_start(*mut c_void) -> c_int;
        snd_pcm_wait(*mut c_void, c_int) -> c_int;
        snd_pcm_readi(*mut c_void, *mut c_void, c_ulong) -> c_long;
        snd_pcm_recover(*mut c_void, c_int, c_int) -> c_int;
        snd_strerror(c_int) -> *const c_char;
    }
}

static ALSA: OnceLock<Functions> = OnceLock::new();

fn alsa() -> Result<&'static Functions, String> {
    if let Some(functions) = ALSA.get() {
        return Ok(functions);
    }
    // SAFETY: declared as in libasound 1's headers, which later releases keep.
    let functions = unsafe { Functions::of(library::open([LIBRARY])?) }?;
    Ok(ALSA.get_or_init(|| functions))
}

/// Whether the library is there.
///
/// # Errors
/// What the loader says.
pub fn check() -> Result<(), String> {
    alsa().map(|_| ())
}

/// What a read came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Read {
    /// So many samples.
    Samples(usize),
    /// None came within the time.
    Nothing,
    /// Some were lost; it goes on.
    Lost,
}

/// A device that is recorded from: one channel of 16 bits. Closed when this is dropped.
#[derive(Debug)]
pub struct Capture {
    alsa: &'static Functions,
    /// A `snd_pcm_t`, which any thread may use, one at a time.
    pcm: Handle,
}

/// Of ALSA's number.
fn why(alsa: &Functions, error: c_long) -> String {
    // SAFETY: the function takes any number, and its text lives as long as the library.
    unsafe { text((alsa.snd_strerror)(c_int::try_from(error).unwrap_or(c_int::MIN))) }
}

/// How a device is to be read.
#[derive(Debug, Clone, Copy)]
pub struct Format {
    /// Samples a second.
    pub rate_hz: u32,
    /// As near as the device can: so often there is something to read, microseconds;
    pub period_us: u32,
    /// and so much is kept for who is late, microseconds.
    pub room_us: u32,
}

/// The signature that [`Handle`] wants: what closing comes to, nobody can help.
unsafe extern "C" fn close(pcm: *mut c_void) {
    if let Some(alsa) = ALSA.get() {
        // SAFETY: called once, by the handle that owns it.
        unsafe { (alsa.snd_pcm_close)(pcm) };
    }
}

impl Capture {
    /// Opens a device by ALSA's name for it and starts it.
    ///
    /// # Errors
    /// What ALSA says.
    pub fn open(name: &str, format: &Format) -> Result<Self, String> {
        let alsa = alsa()?;
        let name = CString::new(name).map_err(|_| "its name has a zero in it".to_owned())?;
        let failed = |error: c_int| if error < 0 { Err(why(alsa, error.into())) } else { Ok(()) };
        let mut pcm = null_mut();
        // SAFETY: the name ends in zero and outlives the call; what is opened is ours, and closed once.
        let pcm = unsafe {
            failed((alsa.snd_pcm_open)(&raw mut pcm, name.as_ptr(), CAPTURE, NONBLOCK))?;
            Handle::new(pcm, close).ok_or_else(|| "it opens to nothing".to_owned())?
        };
        let capture = Self { alsa, pcm };
        capture.set(format)?;
        // SAFETY: it is open and set.
        failed(unsafe { (alsa.snd_pcm_start)(capture.pcm.get()) })?;
        Ok(capture)
    }

    /// `snd_pcm_set_params` would do, but with it a device is read four times in all of its room alone: a word that is
    /// heard late stops the robot late.
    fn set(&self, format: &Format) -> Result<(), String> {
        let (alsa, pcm) = (self.alsa, self.pcm.get());
        let failed = |error: c_int| if error < 0 { Err(why(alsa, error.into())) } else { Ok(()) };
        let (mut params, mut period_us, mut room_us) = (null_mut(), format.period_us, format.room_us);
        // SAFETY: what is allocated is ours, and freed once.
        let params = unsafe {
            failed((alsa.snd_pcm_hw_params_malloc)(&raw mut params))?;
            Handle::new(params, alsa.snd_pcm_hw_params_free).ok_or_else(|| "no memory".to_owned())?
        };
        let params = params.get();
        // SAFETY: both live; ALSA itself makes other rates of it (the 1). Directions (null) are not asked for.
        unsafe {
            failed((alsa.snd_pcm_hw_params_any)(pcm, params))?;
            failed((alsa.snd_pcm_hw_params_set_rate_resample)(pcm, params, 1))?;
            failed((alsa.snd_pcm_hw_params_set_access)(pcm, params, INTERLEAVED))?;
            failed((alsa.snd_pcm_hw_params_set_format)(pcm, params, S16_LE))?;
            failed((alsa.snd_pcm_hw_params_set_channels)(pcm, params, 1))?;
            failed((alsa.snd_pcm_hw_params_set_rate)(pcm, params, format.rate_hz, 0))?;
            failed((alsa.snd_pcm_hw_params_set_period_time_near)(pcm, params, &raw mut period_us, null_mut()))?;
            failed((alsa.snd_pcm_hw_params_set_buffer_time_near)(pcm, params, &raw mut room_us, null_mut()))?;
            failed((alsa.snd_pcm_hw_params)(pcm, params))
        }
    }

    /// Reads what there is, waiting for `wait_ms` at most.
    ///
    /// # Errors
    /// Where the device is gone: what ALSA says.
    pub fn read(&mut self, samples: &mut [i16], wait_ms: i32) -> Result<Read, String> {
        // SAFETY: it is open; no more samples are asked for than there is room.
        let got = unsafe {
            (self.alsa.snd_pcm_wait)(self.pcm.get(), wait_ms);
            (self.alsa.snd_pcm_readi)(self.pcm.get(), samples.as_mut_ptr().cast(), samples.len() as c_ulong)
        };
        match got {
            0 | AGAIN => Ok(Read::Nothing),
            LOST | SUSPENDED => {
                // SAFETY: it is open. A stream of lost samples is prepared anew and has to be started.
                let recovered = unsafe {
                    match (self.alsa.snd_pcm_recover)(self.pcm.get(), got as c_int, 1) {
                        0 => (self.alsa.snd_pcm_start)(self.pcm.get()),
                        error => error,
                    }
                };
                if recovered < 0 { Err(why(self.alsa, recovered.into())) } else { Ok(Read::Lost) }
            }
            error if error < 0 => Err(why(self.alsa, error)),
            count => Ok(Read::Samples(usize::try_from(count).unwrap_or(0).min(samples.len()))),
        }
    }
}
