//! Frames of one EtherType at a network interface. The socket receives no other frames, and none that this machine
//! sends.

use std::io;
use std::mem::size_of;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};

use rustix::io::Errno;
use rustix::net::netdevice::index_to_name_inlined;
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketFlags, SocketType, recv, send, socket_with};

use super::interface::{Interface, InterfaceError, request_about};

/// Why a frame was not sent, or none was received.
///
/// The meaning of the error codes of packet(7) for the user of the interface:
///
/// | code | what has happened | what it means |
/// | --- | --- | --- |
/// | `ENXIO`, `ENODEV` | the interface of the socket does not exist any more: its adapter was pulled, or it was deleted or moved to another namespace | [`SocketError::Gone`]: an interface that gets the same name later is another one, which this socket never reaches |
/// | `ENETDOWN` | the interface is down; `recv` also returns this code, once, when the interface was deleted | [`SocketError::System`]: the frame is lost; frames pass again when the interface is up |
/// | `ENOBUFS`, `EAGAIN`, `ENOMEM` | there is no room for the frame | the frame is lost, as on a cable |
/// | `EMSGSIZE` | the frame is longer than the MTU, which was lowered since the interface was opened | the frame is lost |
/// | `EINTR` | a signal interrupted the call | a frame to send is lost; a received frame is returned by the next call |
/// | any other one | | the frame is lost |
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// The interface does not exist any more. Open it again when it is back.
    #[error("the network interface is gone; plug it in, and open it again")]
    Gone,
    /// An error of the operating system. This frame was not sent or received; the socket can still be used.
    #[error("{0}; look at the interface with: ip link")]
    System(io::Error),
}

impl From<Errno> for SocketError {
    fn from(error: Errno) -> Self {
        match error {
            Errno::NXIO | Errno::NODEV => Self::Gone,
            error => Self::System(error.into()),
        }
    }
}

/// A socket at one network interface, for frames of one EtherType.
pub struct EthernetSocket {
    fd: OwnedFd,
    index: u32,
}

/// The state of the link at an interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkState {
    /// A device at the other end of the cable is connected.
    Up,
    /// No device is connected at the other end of the cable, or the interface is switched off.
    Down,
    /// The interface does not exist any more.
    Gone,
}

impl EthernetSocket {
    /// Opens a socket at the interface for frames of that EtherType.
    ///
    /// # Errors
    /// [`InterfaceError::NoRight`]: this program has no permission for raw frames. [`InterfaceError::System`]: the
    /// system refuses the socket for another reason.
    pub fn open(interface: &Interface, ethertype: u16) -> Result<Self, InterfaceError> {
        let name = &interface.name;
        Self::open_raw(interface.index, ethertype).map_err(|source| match source.kind() {
            io::ErrorKind::PermissionDenied => {
                let program =
                    std::env::current_exe().map_or_else(|_| "ecmsk".into(), |path| path.display().to_string());
                InterfaceError::NoRight { name: name.clone(), program }
            }
            _ => InterfaceError::System { name: name.clone(), source },
        })
    }

    fn open_raw(index: i32, ethertype: u16) -> io::Result<Self> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        // The socket is created without a protocol, so that it receives nothing before it is bound. With a protocol it
        // would receive frames of all interfaces until then.
        let fd = socket_with(AddressFamily::PACKET, SocketType::RAW, flags, None)?;
        let address = libc::sockaddr_ll {
            sll_family: libc::AF_PACKET as u16,
            sll_protocol: ethertype.to_be(),
            sll_ifindex: index,
            sll_hatype: 0,
            sll_pkttype: 0,
            sll_halen: 0,
            sll_addr: [0; 8],
        };
        // In promiscuous mode the card accepts frames to any MAC address. Otherwise it would drop frames that are
        // addressed to other devices.
        let membership = libc::packet_mreq {
            mr_ifindex: index,
            mr_type: libc::PACKET_MR_PROMISC as u16,
            mr_alen: 0,
            mr_address: [0; 8],
        };
        // SAFETY: both calls read a value of that type and length, which lives until they return.
        let results = unsafe {
            [
                libc::bind(fd.as_raw_fd(), (&raw const address).cast(), size_of::<libc::sockaddr_ll>() as u32),
                libc::setsockopt(
                    fd.as_raw_fd(),
                    libc::SOL_PACKET,
                    libc::PACKET_ADD_MEMBERSHIP,
                    (&raw const membership).cast(),
                    size_of::<libc::packet_mreq>() as u32,
                ),
            ]
        };
        let index = u32::try_from(index).map_err(|_| io::Error::from(Errno::NODEV))?;
        if results.contains(&-1) { Err(io::Error::last_os_error()) } else { Ok(Self { fd, index }) }
    }

    /// The state of the link. The kernel gives it for a name, so the present name of the interface is looked up first:
    /// the interface may have been renamed since it was opened.
    pub fn link_state(&self) -> LinkState {
        let Ok(name) = index_to_name_inlined(&self.fd, self.index) else { return LinkState::Gone };
        let Some(mut request) = request_about(name.as_str()) else { return LinkState::Gone };
        // SAFETY: the call reads the name and writes the flags, both in a structure of that type.
        let result = unsafe { libc::ioctl(self.fd.as_raw_fd(), libc::SIOCGIFFLAGS, &raw mut request) };
        if result == -1 {
            return LinkState::Gone;
        }
        // SAFETY: the call has succeeded, and so has written the flags.
        let flags = unsafe { request.ifr_ifru.ifru_flags };
        if i32::from(flags) & libc::IFF_RUNNING != 0 { LinkState::Up } else { LinkState::Down }
    }

    /// Receives a frame. Returns its full length, even if it does not fit into `frame`; `None` if there is no frame.
    ///
    /// # Errors
    /// [`SocketError`], if the frame could not be received.
    pub fn take(&self, frame: &mut [u8]) -> Result<Option<usize>, SocketError> {
        match recv(&self.fd, frame, RecvFlags::DONTWAIT | RecvFlags::TRUNC) {
            Ok((_, len)) => Ok(Some(len)),
            Err(Errno::AGAIN | Errno::INTR) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Sends a frame. The call never waits: if the system has no room for the frame, the frame is lost and the call
    /// fails.
    ///
    /// # Errors
    /// [`SocketError`], if the frame was not sent.
    pub fn send(&self, frame: &[u8]) -> Result<(), SocketError> {
        send(&self.fd, frame, SendFlags::DONTWAIT)?;
        Ok(())
    }
}

/// Lets callers wait for frames with `poll`.
impl AsFd for EthernetSocket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}
