//! An interface belongs to one program of ours at a time: a master or slaves, never two of them.

use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};

use super::interface::{Interface, InterfaceError};

/// An interface that nobody else who claims it has, until this is dropped or the process ends.
///
/// It is an abstract socket, whose name exists once in a network namespace, as the number of the interface does.
pub struct Claim {
    _listener: UnixListener,
}

impl Claim {
    /// Claims an interface for this value.
    ///
    /// # Errors
    /// [`InterfaceError::InUse`]: another one has it; [`InterfaceError::System`].
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

    /// ECAT-15.21 An interface is claimed once, until the claim is given back.
    #[test]
    fn an_interface_is_claimed_once() {
        // No interface of this machine has that number.
        let interface = Interface { name: "veth1".into(), index: i32::MAX, ..Interface::default() };
        let first = Claim::new(&interface).expect("it is free");
        let refused = Claim::new(&interface).err().expect("it is in use");
        assert!(refused.to_string().contains("veth1 is used by another program of ecmsk"), "{refused}");
        drop(first);
        assert!(Claim::new(&interface).is_ok());
    }
}
