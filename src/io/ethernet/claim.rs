//! Reserves a network interface for one program of this project at a time: a master or slaves, never both.

use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};

use super::interface::{Interface, InterfaceError};

/// A claim on a network interface, held until it is dropped or the process ends. No other claim on the interface
/// succeeds meanwhile.
///
/// The claim is an abstract socket whose name contains the number of the interface. In a network namespace there is
/// only one interface with this number, and only one socket with this name.
pub struct Claim {
    _listener: UnixListener,
}

impl Claim {
    /// Reserves an interface until the claim is dropped: no other process that uses this library can open it meanwhile.
    ///
    /// # Errors
    /// [`InterfaceError::InUse`] if another claim exists; [`InterfaceError::System`] if the system refuses the socket.
    pub fn new(interface: &Interface) -> Result<Self, InterfaceError> {
        let name = || interface.name.clone();
        let failed = |source: io::Error| match source.kind() {
            io::ErrorKind::AddrInUse => InterfaceError::InUse { name: name() },
            _ => InterfaceError::System { name: name(), source },
        };
        let address = SocketAddr::from_abstract_name(format!("ecmsk/nic/{}", interface.index));
        let listener = address.and_then(|address| UnixListener::bind_addr(&address)).map_err(failed)?;
        Ok(Self { _listener: listener })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ECAT-15.21 A second claim on an interface fails until the first one is dropped.
    #[test]
    fn an_interface_is_claimed_once() {
        // No interface of this machine has this number.
        let interface = Interface { name: "veth1".into(), index: i32::MAX, ..Interface::default() };
        let first = Claim::new(&interface).expect("it is free");
        let refused = Claim::new(&interface).err().expect("it is in use");
        assert!(refused.to_string().contains("veth1 is used by another program of ecmsk"), "{refused}");
        drop(first);
        assert!(Claim::new(&interface).is_ok());
    }
}
