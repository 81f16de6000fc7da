//! A board through usbfs, one transfer after the other: a host that reads only on demand.

use std::ffi::c_void;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::fd::AsRawFd;
use std::time::Duration;

use support::served::Board;

/// `struct usbdevfs_bulktransfer` of linux/usbdevice_fs.h, which moves interrupt transfers too.
#[repr(C)]
struct BulkTransfer {
    endpoint: u32,
    length: u32,
    timeout_ms: u32,
    data: *mut c_void,
}

const _: () = assert!(size_of::<BulkTransfer>() == 24);

/// `USBDEVFS_BULK`: `_IOWR('U', 2, struct usbdevfs_bulktransfer)`.
const BULK: u64 = 0xC018_5502;
/// `USBDEVFS_CLAIMINTERFACE`: `_IOR('U', 15, unsigned int)`.
const CLAIM_INTERFACE: u64 = 0x8004_550F;

/// An open board.
pub struct Usbfs {
    device: File,
}

impl Usbfs {
    /// Detaches it from the kernel's driver.
    pub fn open(board: &Board) -> Self {
        let interface = board.hid.parent().and_then(|path| path.file_name()).expect("the interface's folder");
        fs::write("/sys/bus/usb/drivers/usbhid/unbind", interface.as_encoded_bytes()).expect("the driver lets go");
        let number = |file: &str| board.usb_says(file).parse::<u16>().expect("a number");
        let node = format!("/dev/bus/usb/{:03}/{:03}", number("busnum"), number("devnum"));
        let device = OpenOptions::new().read(true).write(true).open(node).expect("root may open it");
        let mut interface = 0_u32;
        // SAFETY: the call reads one u32 at the address, which is valid until it returns.
        let done = unsafe { libc::ioctl(device.as_raw_fd(), CLAIM_INTERFACE, &raw mut interface) };
        assert_eq!(done, 0, "{}", io::Error::last_os_error());
        Self { device }
    }

    /// Sends `bytes`; returns how many were transferred.
    pub fn write(&self, bytes: &[u8; 512], limit: Duration) -> io::Result<usize> {
        self.transfer(0x02, &mut bytes.clone(), limit)
    }

    /// Waits for a report; returns its length.
    pub fn read(&self, bytes: &mut [u8; 512], limit: Duration) -> io::Result<usize> {
        self.transfer(0x81, bytes, limit)
    }

    fn transfer(&self, endpoint: u32, bytes: &mut [u8; 512], limit: Duration) -> io::Result<usize> {
        let timeout_ms = limit.as_millis() as u32;
        let mut transfer =
            BulkTransfer { endpoint, length: bytes.len() as u32, timeout_ms, data: bytes.as_mut_ptr().cast() };
        // SAFETY: the structure is the kernel's (its size is checked above), and `data` has `length` bytes that have no
        // other user until the call returns.
        let moved = unsafe { libc::ioctl(self.device.as_raw_fd(), BULK, &raw mut transfer) };
        usize::try_from(moved).map_err(|_| io::Error::last_os_error())
    }
}
