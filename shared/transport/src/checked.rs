//! What lies in shared memory is checked before it is believed: another process, even a dead or a mad one, wrote it.
//!
//! A message is copied out first and then looked at, so that nobody can change it in between. Where iceoryx2's own
//! bookkeeping points is looked up in this process's mappings, so that a wrong pointer is no crash.

use std::mem::MaybeUninit;

use iceoryx2::prelude::ZeroCopySend;
use messages::Message;

/// Publishers whose memory is remembered: more than are alive at once on any topic but `clock/ack`, where a mapping is
/// looked up again now and then.
const REMEMBERED: usize = 16;

/// A message as it lies in shared memory: bytes that may or may not be a value of `M`.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(crate) struct Wire<M: Copy>(MaybeUninit<M>);

impl<M: Copy> std::fmt::Debug for Wire<M> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Wire")
    }
}

// SAFETY: it is `M` in all but that nobody has said yet that its bytes are a value of it.
unsafe impl<M: Copy + ZeroCopySend> ZeroCopySend for Wire<M> {
    unsafe fn type_name() -> &'static str {
        // SAFETY: the caller's word on the layout holds for both, which have the same.
        unsafe { <M as ZeroCopySend>::type_name() }
    }
}

impl<M: Message> Wire<M> {
    /// A message on its way into shared memory.
    pub fn new(message: M) -> Self {
        Self(MaybeUninit::new(message))
    }

    /// The message, where it is one: it lies in memory that is mapped, its bytes are a value of `M`, its counts fit.
    pub fn read(&self, mapped: &mut Mapped, publisher: u128) -> Option<M> {
        mapped.copy(publisher, std::ptr::from_ref(self).cast()).filter(M::counts_fit)
    }
}

/// The parts of this process's memory in which publishers' messages lie.
#[derive(Debug, Default)]
pub(crate) struct Mapped(Vec<(u128, std::ops::Range<usize>)>);

impl Mapped {
    /// Whether `bytes` bytes from `from` on lie in the memory of that publisher. Looks it up where it is not known yet.
    pub fn holds(&mut self, publisher: u128, from: *const u8, bytes: usize) -> bool {
        let from = from.addr();
        let Some(end) = from.checked_add(bytes) else { return false };
        if !self.0.iter().any(|(who, range)| *who == publisher && range.contains(&from)) {
            let Some(range) = mapping_around(from) else { return false };
            self.0.retain(|(who, _)| *who != publisher);
            self.0.truncate(REMEMBERED - 1);
            self.0.insert(0, (publisher, range));
        }
        self.0.iter().any(|(who, range)| *who == publisher && range.contains(&from) && end <= range.end)
    }

    /// A copy of the `T` at `from`; `None` where no memory of that publisher is there, or what is there is no `T`.
    pub fn copy<T: zerocopy::TryFromBytes>(&mut self, publisher: u128, from: *const u8) -> Option<T> {
        if !self.holds(publisher, from, size_of::<T>()) {
            return None;
        }
        let mut copy = MaybeUninit::<T>::uninit();
        // SAFETY: `from` points to as many mapped bytes of a file, which always have a value; whatever another process
        // writes there meanwhile, the copy holds some bytes and keeps them.
        let bytes = unsafe {
            std::ptr::copy_nonoverlapping(from, copy.as_mut_ptr().cast::<u8>(), size_of::<T>());
            std::slice::from_raw_parts(copy.as_ptr().cast::<u8>(), size_of::<T>())
        };
        T::try_read_from_bytes(bytes).ok()
    }
}

/// The mapping of a file in `/dev/shm` that holds an address, if there is one.
fn mapping_around(address: usize) -> Option<std::ops::Range<usize>> {
    let maps = std::fs::read_to_string("/proc/self/maps").ok()?;
    maps.lines().filter(|line| line.contains("/dev/shm/")).find_map(|line| {
        let (from, to) = line.split_once(' ')?.0.split_once('-')?;
        let range = usize::from_str_radix(from, 16).ok()?..usize::from_str_radix(to, 16).ok()?;
        range.contains(&address).then_some(range)
    })
}

#[cfg(test)]
mod tests;
