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

/// `struct usbdevfs_ctrltransfer` of linux/usbdevice_fs.h.
#[repr(C)]
struct ControlTransfer {
    setup: [u8; 8],
    timeout_ms: u32,
    data: *mut c_void,
}

const _: () = assert!(size_of::<BulkTransfer>() == 24 && size_of::<ControlTransfer>() == 24);

/// `USBDEVFS_BULK`: `_IOWR('U', 2, struct usbdevfs_bulktransfer)`.
const BULK: u64 = 0xC018_5502;
/// `USBDEVFS_CONTROL`: `_IOWR('U', 0, struct usbdevfs_ctrltransfer)`.
const CONTROL: u64 = 0xC018_5500;
/// `USBDEVFS_RESET`: `_IO('U', 20)`.
const RESET: u64 = 0x5514;
/// `USBDEVFS_CLAIMINTERFACE`: `_IOR('U', 15, unsigned int)`.
const CLAIM_INTERFACE: u64 = 0x8004_550F;

/// `USBDEVFS_RELEASEINTERFACE`: `_IOR('U', 16, unsigned int)`.
const RELEASE_INTERFACE: u64 = 0x8004_5510;

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
        let board = Self { device };
        board.interface(CLAIM_INTERFACE).expect("nobody else has it");
        board
    }

    /// Claims or releases the interface.
    fn interface(&self, request: u64) -> io::Result<()> {
        let mut interface = 0_u32;
        // SAFETY: the call reads one u32 at the address, which is valid until it returns.
        let done = unsafe { libc::ioctl(self.device.as_raw_fd(), request, &raw mut interface) };
        if done == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
    }

    /// Sends `bytes`; returns how many were transferred.
    pub fn write(&self, bytes: &[u8; 512], limit: Duration) -> io::Result<usize> {
        self.transfer(0x02, &mut bytes.clone(), limit)
    }

    /// Waits for a report; returns its length.
    pub fn read(&self, bytes: &mut [u8; 512], limit: Duration) -> io::Result<usize> {
        self.transfer(0x81, bytes, limit)
    }

    /// A request on endpoint 0, whose setup packet stands in memory as on the bus; `data` is as long as the packet says. Gives
    /// the bytes to the host.
    pub fn control(&self, setup: [u8; 8], data: &[u8], limit: Duration) -> io::Result<Vec<u8>> {
        let length = usize::from(u16::from_le_bytes([setup[6], setup[7]]));
        let mut bytes = data.to_vec();
        bytes.resize(length.max(1), 0);
        let timeout_ms = limit.as_millis() as u32;
        let mut transfer = ControlTransfer { setup, timeout_ms, data: bytes.as_mut_ptr().cast() };
        // SAFETY: the structure is that of the kernel (its size is checked above), and `data` has as many bytes as its setup
        // packet says, which nobody else holds until the call returns.
        let moved = unsafe { libc::ioctl(self.device.as_raw_fd(), CONTROL, &raw mut transfer) };
        let moved = usize::try_from(moved).map_err(|_| io::Error::last_os_error())?;
        bytes.truncate(if setup[0] & 0x80 == 0 { 0 } else { moved });
        Ok(bytes)
    }

    /// Resets the device, as libusb does: a claimed interface would go to the kernel's driver.
    pub fn reset(&self) -> io::Result<()> {
        self.interface(RELEASE_INTERFACE)?;
        // SAFETY: the call takes no argument.
        let done = unsafe { libc::ioctl(self.device.as_raw_fd(), RESET) };
        if done != 0 {
            return Err(io::Error::last_os_error());
        }
        self.interface(CLAIM_INTERFACE)
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
