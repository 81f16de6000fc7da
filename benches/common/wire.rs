//! A bare socket for the frames of a network interface.

#![allow(dead_code, reason = "each bench takes what it needs")]

use std::ffi::CString;
use std::mem::size_of;
use std::os::fd::{AsRawFd, OwnedFd};
use std::time::Duration;

use rustix::net::sockopt::{Timeout, set_socket_timeout};
use rustix::net::{AddressFamily, Protocol, RecvFlags, SendFlags, SocketFlags, SocketType, recv, send, socket_with};

use ecmsk::ethercat::ETHERTYPE;

/// A network interface.
pub struct Interface {
    socket: OwnedFd,
}

impl Interface {
    /// Opens the interface of that name. It gives frames of EtherCAT alone.
    ///
    /// # Panics
    /// The system refuses it.
    pub fn open(name: &str) -> Self {
        let protocol = std::num::NonZeroU32::new(u16::to_be(ETHERTYPE).into()).map(Protocol::from_raw);
        let socket = socket_with(AddressFamily::PACKET, SocketType::RAW, SocketFlags::CLOEXEC, protocol)
            .expect("a socket for raw frames");
        let name = CString::new(name).expect("a name");
        // SAFETY: the call reads a string that ends with 0.
        let index = unsafe { libc::if_nametoindex(name.as_ptr()) };
        let address = libc::sockaddr_ll {
            sll_family: libc::AF_PACKET as u16,
            sll_protocol: ETHERTYPE.to_be(),
            sll_ifindex: index as i32,
            sll_hatype: 0,
            sll_pkttype: 0,
            sll_halen: 0,
            sll_addr: [0; 8],
        };
        let len = size_of::<libc::sockaddr_ll>() as u32;
        // SAFETY: the call reads a value of that type and length, which lives until it returns.
        let bound = unsafe { libc::bind(socket.as_raw_fd(), (&raw const address).cast(), len) };
        assert_eq!(bound, 0, "{}", std::io::Error::last_os_error());
        Self { socket }
    }

    /// Opens it to look at the frames that come, each with the time at which the kernel got it. A wait for one ends after
    /// 100 ms.
    ///
    /// # Panics
    /// The system refuses it.
    pub fn open_stamped(name: &str) -> Self {
        let interface = Self::open(name);
        set_socket_timeout(&interface.socket, Timeout::Recv, Some(Duration::from_millis(100))).expect("a limit");
        // From this first question on frames get their times when they come.
        let _ = interface.stamp();
        interface
    }

    /// Waits for a frame; its time, ns. `None`: none has come for a while.
    pub fn take_stamped(&self, frame: &mut [u8]) -> Option<u64> {
        recv(&self.socket, frame, RecvFlags::empty()).ok()?;
        self.stamp()
    }

    /// The time of the newest frame, ns; `None`: there has been none.
    fn stamp(&self) -> Option<u64> {
        /// SIOCGSTAMPNS, include/uapi/asm-generic/sockios.h.
        const TIME_STAMP: u64 = 0x8907;
        let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
        // SAFETY: the call writes a value of that type, which lives until it returns.
        let told = unsafe { libc::ioctl(self.socket.as_raw_fd(), TIME_STAMP, &raw mut time) };
        (told == 0).then_some(time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64)
    }

    /// Sends a frame.
    pub fn send(&self, frame: &[u8]) {
        send(&self.socket, frame, SendFlags::empty()).expect("it goes out");
    }

    /// Waits for a frame; its length.
    pub fn take(&self, frame: &mut [u8]) -> usize {
        recv(&self.socket, frame, RecvFlags::empty()).expect("a frame").0
    }
}
