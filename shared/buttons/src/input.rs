//! A Linux input device.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::os::unix::fs::OpenOptionsExt;

use messages::StopInput;
use nix::libc;
use settings::EstopInput;

use crate::keys::{EVENT_LEN, Keys, is_set};

/// Events that are read at once.
const EVENTS: usize = 64;
/// Bytes of a bit for each key.
const KEY_BYTES: usize = 96;

nix::ioctl_read_buf!(
    /// `EVIOCGKEY`: which keys are down.
    keys_down,
    b'E',
    0x18,
    u8
);

nix::ioctl_read_buf!(
    /// `EVIOCGBIT(EV_KEY)`: which keys there are.
    keys_there,
    b'E',
    0x21,
    u8
);

/// An input device that is open.
#[derive(Debug)]
pub struct InputDevice {
    file: File,
    name: String,
    keys: Keys,
}

impl InputDevice {
    /// Opens it, and asks what is down. What cannot be asked is no input device, whose unplugging the kernel would
    /// tell: where a `real` robot moves it is refused, in simulation its key is unknown until that tells.
    ///
    /// # Errors
    /// Where it cannot be opened; the reason says what to do.
    pub fn open(settings: &EstopInput, real: bool) -> Result<Self, String> {
        let name = settings.device.display().to_string();
        let mut options = OpenOptions::new();
        options.read(true).custom_flags(libc::O_NONBLOCK | libc::O_CLOEXEC);
        let file = options.open(&settings.device).map_err(|error| match error.kind() {
            ErrorKind::NotFound => format!("there is no {name}: is it plugged in, is its name right?"),
            ErrorKind::PermissionDenied => format!(
                "{name} may not be read by this user: add the user to its group (sudo usermod -aG input $USER, then \
                 log in again)"
            ),
            _ => format!("{name} cannot be opened: {error}"),
        })?;
        let mut device = Self { file, name, keys: Keys::new(settings.key, settings.held) };
        device.has(settings.key, real)?;
        device.ask();
        Ok(device)
    }

    /// A key that is not there would never be pressed.
    fn has(&self, key: Option<u16>, real: bool) -> Result<(), String> {
        let mut bits = [0; KEY_BYTES];
        // SAFETY: as in `ask`.
        if unsafe { keys_there(self.file.as_raw_fd(), &mut bits) }.is_err() {
            let why = format!("{} is no input device: of what is none nobody would see that it is gone", self.name);
            return if real { Err(why) } else { Ok(()) };
        }
        match key {
            Some(key) if !is_set(&bits, usize::from(key)) => {
                Err(format!("{} has no key {key}: name one of its own (evtest {0} lists them)", self.name))
            }
            None if bits.iter().all(|byte| *byte == 0) => Err(format!("{} has no key at all", self.name)),
            _ => Ok(()),
        }
    }

    fn ask(&mut self) {
        let mut bits = [0; KEY_BYTES];
        // SAFETY: the kernel writes at most as many bytes as the buffer has, whose length goes with the request.
        if unsafe { keys_down(self.file.as_raw_fd(), &mut bits) }.is_ok() {
            self.keys.answered(&bits);
        }
    }
}

impl AsFd for InputDevice {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }
}

impl InputDevice {
    /// What has become of it: the worst since it was last asked, so that no press is too short.
    ///
    /// # Errors
    /// Where it is gone; the reason says what to do.
    pub fn read(&mut self) -> Result<StopInput, String> {
        let mut bytes = [0; EVENT_LEN * EVENTS];
        let state = match self.file.read(&mut bytes) {
            Ok(0) => return Err(format!("{} has come to its end: it is no input device, or was unplugged", self.name)),
            Ok(count) => self.keys.take(&bytes[..count]),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => self.keys.take(&[]),
            Err(error) => return Err(format!("{} is gone: it was unplugged ({error})", self.name)),
        };
        if !self.keys.is_known() {
            self.ask();
        }
        Ok(state)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::path::Path;

    use super::InputDevice;
    use messages::StopInput::{Pressed, Released, Unknown};
    use settings::EstopInput;

    /// A pipe in a device's place: it cannot be asked what is down.
    fn pipe(dir: &Path) -> (EstopInput, std::fs::File) {
        let device = dir.join("event0");
        nix::unistd::mkfifo(&device, nix::sys::stat::Mode::from_bits_truncate(0o600)).expect("made");
        let writer = std::fs::OpenOptions::new().read(true).write(true).open(&device).expect("opened");
        (EstopInput { device: device.into(), key: Some(304), held: false }, writer)
    }

    fn event(value: i32) -> Vec<u8> {
        let mut bytes = vec![0; 16];
        bytes.extend(1_u16.to_le_bytes());
        bytes.extend(304_u16.to_le_bytes());
        bytes.extend(value.to_le_bytes());
        bytes
    }

    #[test]
    fn what_cannot_be_asked_is_unknown_until_its_key_tells() {
        let dir = tempfile::tempdir().expect("a folder");
        let (settings, mut writer) = pipe(dir.path());
        assert!(InputDevice::open(&settings, true).is_err_and(|why| why.contains("is no input device")));
        let mut device = InputDevice::open(&settings, false).expect("opened");
        assert_eq!(device.read(), Ok(Unknown));
        writer.write_all(&event(0)).expect("written");
        assert_eq!(device.read(), Ok(Released));
        writer.write_all(&[event(1), event(0)].concat()).expect("written");
        assert_eq!((device.read(), device.read()), (Ok(Pressed), Ok(Released)));
        drop(writer);
        assert!(device.read().is_err_and(|why| why.contains("was unplugged")));
    }

    #[test]
    fn what_is_not_there_is_told_with_what_to_do() {
        let settings = EstopInput { device: "/dev/input/none".into(), ..EstopInput::default() };
        let why = InputDevice::open(&settings, false).map(|_| ()).expect_err("there is none");
        assert!(why.contains("there is no /dev/input/none: is it plugged in"), "{why}");
    }
}
