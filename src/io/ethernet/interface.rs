//! Lists the network interfaces of this machine, and decides whether one may be used for EtherCAT frames without
//! disturbing another network.

use std::ffi::CStr;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::os::fd::{AsRawFd, OwnedFd};

use rustix::net::{AddressFamily, SocketFlags, SocketType, socket_with};

use crate::io::routes::{default_routes_v4, default_routes_v6};

/// Why a network interface cannot be used.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum InterfaceError {
    /// No interface has this name.
    #[error(
        "there is no network interface {name}; there are {found}. Correct the name, or make a pair: docs/SLAVES.md"
    )]
    Missing { name: String, found: String },
    /// The interface is not an Ethernet interface.
    #[error("the network interface {name} is no Ethernet; name another one")]
    NoEthernet { name: String },
    /// The interface is down.
    #[error("the network interface {name} is down; switch it on: sudo ip link set {name} up")]
    Down { name: String },
    /// The interface's MTU is too small.
    #[error(
        "the network interface {name} has frames of {mtu} bytes at most (MTU), and those of EtherCAT have up to {MTU_MIN}; set it: \
         sudo ip link set {name} mtu {MTU_MIN}"
    )]
    ShortFrames { name: String, mtu: u32 },
    /// The interface has an IP address, so another network uses it.
    #[error(
        "the network interface {name} has the address {address}, so that it belongs to another network; name an interface \
         that belongs to EtherCAT alone, or take the address away: sudo ip address flush dev {name}"
    )]
    HasAddress { name: String, address: IpAddr },
    /// The interface has this machine's default route.
    #[error(
        "the network interface {name} is this machine's way to others (its default route): everybody there would get \
         these frames; name another interface{}", override_option.map(|with| format!(", or insist with {with}")).unwrap_or_default()
    )]
    DefaultRoute { name: String, override_option: Option<&'static str> },
    /// Another master or other slaves of this project use the interface.
    #[error(
        "the network interface {name} is used by another program of ecmsk on this machine; end that program, or name another \
         interface"
    )]
    InUse { name: String },
    /// This program has no permission for raw frames.
    #[error(
        "raw frames on {name} need the capability CAP_NET_RAW, which this program does not have; give it to it: sudo setcap \
         cap_net_raw+ep {program}, or start it with sudo"
    )]
    NoRight { name: String, program: String },
    /// The operating system has refused a call on the interface.
    #[error("the network interface {name} cannot be used: {source}; look at it with: ip link show {name}")]
    System { name: String, source: io::Error },
}

/// The smallest MTU that is accepted, in bytes: the maximum size of an EtherCAT frame without its Ethernet header,
/// which is the usual MTU of Ethernet.
const MTU_MIN: u32 = 1500;

/// The MAC address of a network card.
pub type MacAddress = [u8; 6];

/// The properties of a network interface.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Interface {
    /// The interface's name.
    pub name: String,
    /// The number that the kernel has given to the interface, from 1.
    pub index: i32,
    /// Whether the interface is an Ethernet interface; the loopback interface is not.
    pub is_ethernet: bool,
    /// The MAC address of the interface.
    pub mac_address: MacAddress,
    /// Whether the interface is switched on (`ip link set up`).
    pub is_up: bool,
    /// Whether the interface has a link to a device at the other end of its cable.
    pub has_carrier: bool,
    /// The MTU: the maximum size of a frame without its Ethernet header, in bytes; `None` if unknown.
    pub mtu: Option<u32>,
    /// The interface's IP addresses.
    pub addresses: Vec<IpAddr>,
    /// Whether the interface has this machine's default route.
    pub has_default_route: bool,
}

impl Interface {
    /// Whether the interface may be used for EtherCAT frames without disturbing another network.
    ///
    /// \[OURS] An IPv6 link-local address does not count as an address, since every interface has one. An interface
    /// with the default route also has an IP address, so if its default route is allowed, its address is not checked.
    ///
    /// # Errors
    /// [`InterfaceError`], the first reason that is found.
    pub fn is_fit(&self, default_route: DefaultRoute) -> Result<(), InterfaceError> {
        let name = || self.name.clone();
        if !self.is_ethernet {
            return Err(InterfaceError::NoEthernet { name: name() });
        }
        if !self.is_up {
            return Err(InterfaceError::Down { name: name() });
        }
        if let Some(mtu) = self.mtu.filter(|mtu| *mtu < MTU_MIN) {
            return Err(InterfaceError::ShortFrames { name: name(), mtu });
        }
        if self.has_default_route {
            return match default_route {
                DefaultRoute::Allowed => Ok(()),
                DefaultRoute::Refused { override_option } => {
                    Err(InterfaceError::DefaultRoute { name: name(), override_option })
                }
            };
        }
        match self.address() {
            Some(address) => Err(InterfaceError::HasAddress { name: name(), address }),
            None => Ok(()),
        }
    }

    /// The first address that is not an IPv6 link-local one; `None` if there is none.
    pub fn address(&self) -> Option<IpAddr> {
        self.addresses.iter().find(|address| !is_of_link(address)).copied()
    }
}

/// Whether an interface with this machine's default route may be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DefaultRoute {
    /// An interface with the default route may be used.
    Allowed,
    /// The interface is refused. If the program has an option that allows it, the error text names this option.
    Refused {
        /// The command-line option with which a user allows it, for the error text; `None`: there is none.
        override_option: Option<&'static str>,
    },
}

/// Returns the interface `name`, if it may be used for EtherCAT frames.
///
/// # Errors
/// [`InterfaceError`]: the reason why the interface cannot be used, and the next step.
pub fn check(name: &str, default_route: DefaultRoute) -> Result<Interface, InterfaceError> {
    let failed = |source| InterfaceError::System { name: name.to_owned(), source };
    named(name, interfaces().map_err(failed)?, default_route)
}

/// Selects the interface `name` from `all`, if it may be used.
fn named(name: &str, all: Vec<Interface>, default_route: DefaultRoute) -> Result<Interface, InterfaceError> {
    let found = all.iter().map(|interface| &*interface.name).collect::<Vec<_>>().join(", ");
    let missing = || InterfaceError::Missing { name: name.to_owned(), found };
    let interface = all.into_iter().find(|interface| interface.name == name).ok_or_else(missing)?;
    interface.is_fit(default_route).map(|()| interface)
}

const fn is_of_link(address: &IpAddr) -> bool {
    matches!(address, IpAddr::V6(address) if address.is_unicast_link_local())
}

/// All network interfaces that this process can see.
///
/// # Errors
/// The error of the system, if it cannot list them.
pub fn interfaces() -> io::Result<Vec<Interface>> {
    let mut all = listed()?;
    // If the kernel's lists of routes below `/proc` are missing, the kernel has no IP and so no route.
    let read = |file: &str| std::fs::read_to_string(file).unwrap_or_default();
    let routes = [
        default_routes_v4(&read("/proc/thread-self/net/route")),
        default_routes_v6(&read("/proc/thread-self/net/ipv6_route")),
    ]
    .concat();
    let asked = socket_with(AddressFamily::INET, SocketType::DGRAM, SocketFlags::CLOEXEC, None);
    for interface in &mut all {
        interface.has_default_route = routes.contains(&interface.name);
        interface.mtu = asked.as_ref().ok().and_then(|socket| mtu(socket, &interface.name));
    }
    Ok(all)
}

/// A request about an interface for `ioctl`; `None` if the name is too long for one.
pub(super) fn request_about(name: &str) -> Option<libc::ifreq> {
    // SAFETY: all bytes of the structure may be zero.
    let mut request: libc::ifreq = unsafe { std::mem::zeroed() };
    // The name has to end with a zero in the field of the request, so it must be shorter than the field.
    if name.len() >= request.ifr_name.len() {
        return None;
    }
    request.ifr_name.iter_mut().zip(name.bytes()).for_each(|(to, byte)| *to = byte as libc::c_char);
    Some(request)
}

/// The MTU of an interface, in bytes.
fn mtu(asked: &OwnedFd, name: &str) -> Option<u32> {
    let mut request = request_about(name)?;
    // SAFETY: the call reads the name and writes the number, both in a structure of that type.
    let result = unsafe { libc::ioctl(asked.as_raw_fd(), libc::SIOCGIFMTU, &raw mut request) };
    if result != 0 {
        return None;
    }
    // SAFETY: the call has succeeded, and so has written the number.
    u32::try_from(unsafe { request.ifr_ifru.ifru_mtu }).ok()
}

/// Lists the interfaces with their addresses. The routes and the MTU, which `getifaddrs` does not give, are not filled
/// in.
fn listed() -> io::Result<Vec<Interface>> {
    let mut all: Vec<Interface> = Vec::new();
    let mut first = std::ptr::null_mut();
    // SAFETY: the call sets `first` to a list that stays valid until it is freed below, or fails.
    if unsafe { libc::getifaddrs(&raw mut first) } != 0 {
        return Err(io::Error::last_os_error());
    }
    let mut next = first;
    // SAFETY: each entry of the list is valid or null.
    while let Some(entry) = unsafe { next.as_ref() } {
        next = entry.ifa_next;
        // SAFETY: the name of an entry is a C string that lives as long as the list.
        let name = unsafe { CStr::from_ptr(entry.ifa_name) }.to_string_lossy();
        let at = all.iter().position(|known| known.name == name).unwrap_or_else(|| {
            all.push(Interface { name: name.into_owned(), ..Interface::default() });
            all.len() - 1
        });
        let interface = &mut all[at];
        interface.is_up = entry.ifa_flags & libc::IFF_UP as u32 != 0;
        interface.has_carrier = entry.ifa_flags & libc::IFF_RUNNING as u32 != 0;
        // SAFETY: the address of an entry is valid or null.
        let Some(address) = (unsafe { entry.ifa_addr.as_ref() }) else { continue };
        match i32::from(address.sa_family) {
            libc::AF_PACKET => {
                // SAFETY: addresses of this family have this type.
                let link = unsafe { entry.ifa_addr.cast::<libc::sockaddr_ll>().read_unaligned() };
                (interface.index, interface.is_ethernet) = (link.sll_ifindex, link.sll_hatype == libc::ARPHRD_ETHER);
                let [mac_address @ .., _, _] = link.sll_addr;
                interface.mac_address = mac_address;
            }
            libc::AF_INET => {
                // SAFETY: addresses of this family have this type.
                let address = unsafe { entry.ifa_addr.cast::<libc::sockaddr_in>().read_unaligned() };
                let octets = address.sin_addr.s_addr.to_ne_bytes();
                interface.addresses.push(Ipv4Addr::from(octets).into());
            }
            libc::AF_INET6 => {
                // SAFETY: addresses of this family have this type.
                let address = unsafe { entry.ifa_addr.cast::<libc::sockaddr_in6>().read_unaligned() };
                interface.addresses.push(Ipv6Addr::from(address.sin6_addr.s6_addr).into());
            }
            _ => {}
        }
    }
    // SAFETY: the list comes from `getifaddrs`, and nothing refers to it any more.
    unsafe { libc::freeifaddrs(first) };
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn veth() -> Interface {
        let link_local = "fe80::1".parse().expect("an address");
        let name = "veth1".to_owned();
        Interface {
            name,
            index: 7,
            is_ethernet: true,
            is_up: true,
            addresses: vec![link_local],
            ..Interface::default()
        }
    }

    /// ECAT-15.3 An interface is refused, with the next step, if it is missing, is no Ethernet interface, is down, has
    /// a small MTU, has an address or has the default route. Only the last reason can be overridden.
    #[test]
    fn each_unfit_interface_is_refused_with_its_reason() {
        let judged = |interface: Interface, force| {
            let route =
                if force { DefaultRoute::Allowed } else { DefaultRoute::Refused { override_option: Some("--force") } };
            let found = named("veth1", vec![interface], route);
            found.map(|interface| interface.index).map_err(|error| error.to_string())
        };
        assert_eq!(judged(veth(), false), Ok(7));
        let refused = |interface: Interface, force, reason: &str, step: &str| {
            let said = judged(interface, force).expect_err("it is refused");
            assert!(said.contains(reason) && said.contains(step), "{said}");
        };
        let other = Interface { name: "eth5".into(), ..veth() };
        refused(other, true, "no network interface veth1; there are eth5", "Correct the name");
        refused(Interface { is_ethernet: false, ..veth() }, true, "no Ethernet", "name another");
        refused(Interface { is_up: false, ..veth() }, true, "is down", "sudo ip link set veth1 up");
        refused(Interface { mtu: Some(1499), ..veth() }, true, "1499 bytes at most", "sudo ip link set veth1 mtu 1500");
        assert_eq!(judged(Interface { mtu: Some(1500), ..veth() }, false), Ok(7));
        let addresses = vec!["192.0.2.7".parse().expect("an address")];
        let with_address = Interface { addresses, ..veth() };
        refused(with_address.clone(), true, "has the address 192.0.2.7", "sudo ip address flush dev veth1");
        let default_route = Interface { has_default_route: true, ..with_address };
        refused(default_route.clone(), false, "default route", "--force");
        assert_eq!(judged(default_route, true), Ok(7));
    }

    /// ECAT-15.3 The loopback interface of this machine is listed, and is not an Ethernet interface.
    #[test]
    fn the_loopback_interface_is_known() {
        let all = interfaces().expect("the interfaces");
        let lo = all.iter().find(|interface| interface.name == "lo").expect("lo");
        assert!(lo.index > 0 && !lo.is_ethernet && !lo.has_default_route && lo.mtu > Some(0), "{lo:?}");
        assert!(matches!(check("lo", DefaultRoute::Allowed), Err(InterfaceError::NoEthernet { .. })));
    }
}
