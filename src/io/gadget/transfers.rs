//! Transfers of the two interrupt endpoints, at most one in flight in each direction. They use Linux' asynchronous I/O,
//! because with it the transfer of a report that the host does not fetch can be cancelled.
//!
//! Sources: io_setup(2), io_submit(2), io_cancel(2), io_getevents(2); include/uapi/linux/aio_abi.h of Linux.

use std::fmt;
use std::io;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::ptr::NonNull;

use rustix::event::{EventfdFlags, eventfd};

/// The size of a packet in bytes, either way.
pub const PACKET: usize = 512;

/// Constants of Linux' header `aio_abi.h`: `IOCB_CMD_PREAD`, `IOCB_CMD_PWRITE` and `IOCB_FLAG_RESFD`, in this order.
const READ: u16 = 0;
const WRITE: u16 = 1;
const TELL_BY_EVENT_FD: u32 = 1;

/// `struct iocb`: a request to the kernel's asynchronous I/O.
#[repr(C)]
#[derive(Clone, Copy)]
struct ControlBlock {
    data: u64,
    /// Two fields: `aio_key`, which the kernel writes, and `aio_rw_flags`. They are an array because their order
    /// depends on the byte order of the machine; both are 0 here.
    key_and_flags: [u32; 2],
    opcode: u16,
    priority: i16,
    file: u32,
    buffer: u64,
    length: u64,
    offset: i64,
    reserved: u64,
    flags: u32,
    event_fd: u32,
}

/// `struct io_event`: what the kernel's asynchronous I/O reports when a request has ended.
#[repr(C)]
#[derive(Clone, Copy, Default)]
struct CompletionEvent {
    data: u64,
    block: u64,
    result: i64,
    second_result: i64,
}

const _: () = assert!(size_of::<ControlBlock>() == 64 && size_of::<CompletionEvent>() == 32);

/// The direction of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// To the host.
    In,
    /// From the host.
    Out,
}

/// A transfer that has ended.
#[derive(Debug)]
pub struct End {
    /// The direction of the transfer.
    pub direction: Direction,
    /// How many bytes were moved, or the kernel's error: ECONNRESET for a cancelled transfer, ESHUTDOWN or EAGAIN if
    /// the endpoint is off because no host has selected the configuration.
    pub result: io::Result<usize>,
}

/// The memory that the kernel reads and writes while a transfer is under way. The control block is the first field, so
/// its address is also the address of this value.
#[repr(C)]
struct Memory {
    block: ControlBlock,
    bytes: [u8; PACKET],
}

/// One endpoint, with the memory for its transfer.
struct Slot {
    _file: OwnedFd,
    /// Comes from a `Box` and has no other owner. While `under_way`, only the kernel uses it.
    memory: NonNull<Memory>,
    under_way: bool,
}

impl Slot {
    fn new(file: OwnedFd, direction: Direction, event_fd: &OwnedFd) -> Self {
        let (data, opcode) = match direction {
            Direction::In => (0, WRITE),
            Direction::Out => (1, READ),
        };
        let block = ControlBlock {
            data,
            key_and_flags: [0; 2],
            opcode,
            priority: 0,
            file: file.as_raw_fd() as u32,
            buffer: 0,
            length: PACKET as u64,
            offset: 0,
            reserved: 0,
            flags: TELL_BY_EVENT_FD,
            event_fd: event_fd.as_raw_fd() as u32,
        };
        let mut memory = Box::new(Memory { block, bytes: [0; PACKET] });
        let bytes = &raw mut memory.bytes;
        memory.block.buffer = bytes as usize as u64;
        Self { _file: file, memory: NonNull::from(Box::leak(memory)), under_way: false }
    }
}

/// The transfers of both endpoints. When this value is dropped, transfers that are under way are cancelled.
pub struct Transfers {
    context: libc::c_ulong,
    ended: OwnedFd,
    input: Slot,
    output: Slot,
}

// SAFETY: the memory of the slots belongs to this value alone, and the kernel's context is not bound to a thread.
unsafe impl Send for Transfers {}

impl Transfers {
    /// Transfers of an IN endpoint and an OUT endpoint.
    ///
    /// # Errors
    /// Errors of the kernel.
    pub fn new(input: OwnedFd, output: OwnedFd) -> io::Result<Self> {
        let ended = eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?;
        let (places, mut context): (libc::c_long, libc::c_ulong) = (2, 0);
        // SAFETY: the kernel writes one number, which is valid until the call returns.
        if unsafe { libc::syscall(libc::SYS_io_setup, places, &raw mut context) } != 0 {
            return Err(io::Error::last_os_error());
        }
        let input = Slot::new(input, Direction::In, &ended);
        let output = Slot::new(output, Direction::Out, &ended);
        Ok(Self { context, ended, input, output })
    }

    /// A descriptor to wait for: it becomes readable when a transfer has ended, see [`Self::next_end`].
    pub fn waited(&self) -> BorrowedFd<'_> {
        self.ended.as_fd()
    }

    /// Whether a transfer in that direction is under way.
    pub const fn is_under_way(&self, direction: Direction) -> bool {
        match direction {
            Direction::In => self.input.under_way,
            Direction::Out => self.output.under_way,
        }
    }

    /// Starts the transfer of a packet to the host. If another one is still under way, the call does nothing, and this
    /// packet is not sent.
    ///
    /// # Errors
    /// Errors of the kernel: no transfer was begun.
    pub fn send(&mut self, packet: &[u8; PACKET]) -> io::Result<()> {
        if self.input.under_way {
            return Ok(());
        }
        // SAFETY: no transfer of this slot is under way, so the memory belongs to this value.
        unsafe { self.input.memory.as_mut() }.bytes = *packet;
        submit(self.context, &mut self.input)
    }

    /// Starts the transfer of a packet from the host. If one is under way already, the call does nothing.
    ///
    /// # Errors
    /// Errors of the kernel: no transfer was begun.
    pub fn receive(&mut self) -> io::Result<()> {
        if self.output.under_way { Ok(()) } else { submit(self.context, &mut self.output) }
    }

    /// Asks the kernel to cancel the transfer of a packet to the host. The result of [`Self::next_end`] shows whether
    /// the host has fetched the packet before.
    pub fn take_back(&mut self) {
        if self.input.under_way {
            let mut unused = CompletionEvent::default();
            // SAFETY: the block lives as long as this value, and the kernel writes at most one event to `unused`. An
            // error means that the transfer has ended already, or will be reported as cancelled by `next_end`.
            unsafe {
                libc::syscall(libc::SYS_io_cancel, self.context, self.input.memory.as_ptr(), &raw mut unused);
            }
        }
    }

    /// The next transfer that has ended, if there is one.
    pub fn next_end(&mut self) -> Option<End> {
        // The read resets the descriptor, so that transfers that end from now on make it readable again.
        let mut count = [0; 8];
        let _ = rustix::io::read(&self.ended, &mut count);
        let mut event = CompletionEvent::default();
        let mut no_wait = libc::timespec { tv_sec: 0, tv_nsec: 0 };
        let (least, most): (libc::c_long, libc::c_long) = (0, 1);
        // SAFETY: there is room for one event and the time is valid, both until the call returns.
        let found = unsafe {
            libc::syscall(libc::SYS_io_getevents, self.context, least, most, &raw mut event, &raw mut no_wait)
        };
        if found != 1 {
            return None;
        }
        let (direction, slot) = match event.data {
            0 => (Direction::In, &mut self.input),
            _ => (Direction::Out, &mut self.output),
        };
        slot.under_way = false;
        let result =
            usize::try_from(event.result).map_err(|_| io::Error::from_raw_os_error(event.result.unsigned_abs() as i32));
        Some(End { direction, result })
    }

    /// The packet that was received last; empty while the next transfer from the host is under way.
    pub fn received(&self) -> &[u8] {
        if self.output.under_way {
            return &[];
        }
        // SAFETY: no transfer of this slot is under way, so the memory belongs to this value.
        unsafe { &self.output.memory.as_ref().bytes }
    }
}

/// Begins the transfer of a slot. No transfer of this slot may be under way.
fn submit(context: libc::c_ulong, slot: &mut Slot) -> io::Result<()> {
    let (count, mut block): (libc::c_long, _) = (1, slot.memory.as_ptr());
    // SAFETY: `block` is the address of a valid control block, whose memory nobody uses until the transfer has ended; the
    // list has one entry and is valid until the call returns.
    let begun = unsafe { libc::syscall(libc::SYS_io_submit, context, count, &raw mut block) };
    if begun != 1 {
        return Err(io::Error::last_os_error());
    }
    slot.under_way = true;
    Ok(())
}

impl Drop for Transfers {
    fn drop(&mut self) {
        // SAFETY: the context is this value's own. The call returns when no transfer uses its memory any more.
        let destroyed = unsafe { libc::syscall(libc::SYS_io_destroy, self.context) } == 0;
        for slot in [&self.input, &self.output] {
            if destroyed || !slot.under_way {
                // SAFETY: the memory was made by a `Box`, and neither the kernel nor anybody else has it.
                drop(unsafe { Box::from_raw(slot.memory.as_ptr()) });
            }
        }
    }
}

impl fmt::Debug for Transfers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Transfers").finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Transfers over two files instead of endpoints: they end without a host. `None` where the kernel has no
    /// asynchronous I/O.
    fn over_files() -> Option<(Transfers, tempfile::NamedTempFile)> {
        let file = tempfile::NamedTempFile::new().expect("a file");
        let input = file.reopen().expect("it opens");
        let output = file.reopen().expect("it opens");
        match Transfers::new(input.into(), output.into()) {
            Ok(transfers) => Some((transfers, file)),
            Err(error) if error.raw_os_error() == Some(libc::ENOSYS) => None,
            Err(error) => panic!("{error}"),
        }
    }

    fn next(transfers: &mut Transfers) -> End {
        loop {
            if let Some(end) = transfers.next_end() {
                return end;
            }
        }
    }

    /// A packet is sent and one is received, each whole. Each direction has one transfer in flight, whose completion is
    /// reported once.
    #[test]
    fn a_packet_goes_each_way() {
        let Some((mut transfers, file)) = over_files() else { return };
        assert!(transfers.next_end().is_none());
        let packet: [u8; PACKET] = std::array::from_fn(|at| at as u8);
        transfers.send(&packet).expect("it begins");
        assert!(transfers.is_under_way(Direction::In) && !transfers.is_under_way(Direction::Out));
        transfers.send(&[0; PACKET]).expect("nothing happens");
        let end = next(&mut transfers);
        assert_eq!((end.direction, end.result.expect("it was moved")), (Direction::In, PACKET));
        assert!(!transfers.is_under_way(Direction::In) && transfers.next_end().is_none());
        assert_eq!(std::fs::read(file.path()).expect("it was written"), packet);

        transfers.receive().expect("it begins");
        assert!(transfers.received().is_empty(), "the kernel has its place");
        let end = next(&mut transfers);
        assert_eq!((end.direction, end.result.expect("it was moved")), (Direction::Out, PACKET));
        assert_eq!(transfers.received(), packet);
        transfers.take_back();
        assert!(transfers.next_end().is_none(), "nothing is under way");
    }

    /// The result of a transfer of a shorter packet is its length, and a failed transfer ends with the kernel's error.
    #[test]
    fn ends_say_what_was_moved() {
        let Some((mut transfers, file)) = over_files() else { return };
        std::fs::write(file.path(), [7; 100]).expect("it is written");
        transfers.receive().expect("it begins");
        assert_eq!(next(&mut transfers).result.expect("a part"), 100);
        assert_eq!(transfers.received()[..100], [7; 100]);
        drop(transfers);

        let read_only = std::fs::File::open(file.path()).expect("it opens");
        let output = file.reopen().expect("it opens");
        let mut transfers = Transfers::new(read_only.into(), output.into()).expect("as before");
        // The kernel reports the error at once, or as the end of the transfer.
        let error = match transfers.send(&[1; PACKET]) {
            Err(error) => error,
            Ok(()) => next(&mut transfers).result.expect_err("it cannot be written"),
        };
        assert_eq!(error.raw_os_error(), Some(libc::EBADF), "{error}");
        assert!(!transfers.is_under_way(Direction::In));
    }
}
