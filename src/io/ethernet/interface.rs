//! The network interfaces of this machine, and whether one is fit for frames that have no place on a network of people.

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
    /// There is none of that name.
    #[error(
        "there is no network interface {name}; there are {found}. Correct the name, or make a pair: docs/SLAVES.md"
    )]
    Missing { name: String, found: String },
    /// It is no Ethernet.
    #[error("the network interface {name} is no Ethernet; name another one")]
    NoEthernet { name: String },
    /// It is switched off.
    #[error("the network interface {name} is down; switch it on: sudo ip link set {name} up")]
    Down { name: String },
    /// Its frames are too short.
    #[error(
        "the network interface {name} has frames of {mtu} bytes at most (MTU), and those of EtherCAT have up to {MTU_MIN}; set it: \
         sudo ip link set {name} mtu {MTU_MIN}"
    )]
    ShortFrames { name: String, mtu: u32 },
    /// This machine is reached by it.
    #[error(
        "the network interface {name} has the address {address}, so that it belongs to another network; name an interface \
         that belongs to EtherCAT alone, or take the address away: sudo ip address flush dev {name}"
    )]
    HasAddress { name: String, address: IpAddr },
    /// Other machines are reached by it.
    #[error(
        "the network interface {name} is this machine's way to others (its default route): everybody there would get \
         these frames; name another interface{}", insist.map(|with| format!(", or insist with {with}")).unwrap_or_default()
    )]
    DefaultRoute { name: String, insist: Option<&'static str> },
    /// Another master or other slaves of this project have it.
    #[error(
        "the network interface {name} is used by another program of ecmsk on this machine; end that program, or name another \
         interface"
    )]
    InUse { name: String },
    /// This program may not use raw frames.
    #[error(
        "raw frames on {name} need the capability CAP_NET_RAW, which this program does not have; give it to it: sudo setcap \
         cap_net_raw+ep {program}, or start it with sudo"
    )]
    NoRight { name: String, program: String },
    /// The system does not let it be used.
    #[error("the network interface {name} cannot be used: {source}; look at it with: ip link show {name}")]
    System { name: String, source: io::Error },
}

/// How long a frame of EtherCAT may be without its Ethernet header, bytes: as long as Ethernet has them.
const MTU_MIN: u32 = 1500;

/// The address of an Ethernet card.
pub type MacAddress = [u8; 6];

/// What the system says about a network interface.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Interface {
    /// Its name.
    pub name: String,
    /// Its number, from 1.
    pub index: i32,
    /// Whether it carries Ethernet; the loopback interface does not.
    pub is_ethernet: bool,
    /// The address of an Ethernet card.
    pub mac_address: MacAddress,
    /// Whether it is switched on.
    pub is_up: bool,
    /// Whether there is a link: a cable with somebody at its other end.
    pub has_carrier: bool,
    /// How long its frames may be without their Ethernet header, bytes; `None`: not known.
    pub mtu: Option<u32>,
    /// Its addresses of IP.
    pub addresses: Vec<IpAddr>,
    /// Whether it is this machine's way to others.
    pub has_default_route: bool,
}

impl Interface {
    /// Whether it can be used for frames that are not of a network of people.
    ///
    /// \[OURS] An IPv6 address that the system has made up for the link alone is none: every interface has one. One that is the
    /// default route has an address, too, and both are allowed together.
    ///
    /// # Errors
    /// [`InterfaceError`].
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
                DefaultRoute::Refused { insist } => Err(InterfaceError::DefaultRoute { name: name(), insist }),
            };
        }
        match self.address() {
            Some(address) => Err(InterfaceError::HasAddress { name: name(), address }),
            None => Ok(()),
        }
    }

    /// The first of its addresses that is not for its link alone; `None`: it has none.
    pub fn address(&self) -> Option<IpAddr> {
        self.addresses.iter().find(|address| !is_of_link(address)).copied()
    }
}

/// Whether an interface may be this machine's way to others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DefaultRoute {
    /// It may be.
    Allowed,
    /// It may not; the error says how a user insists on it, if one can.
    Refused {
        /// The option with which a user insists.
        insist: Option<&'static str>,
    },
}

/// The interface of that name, if it can be used.
///
/// # Errors
/// [`InterfaceError`].
pub fn check(name: &str, default_route: DefaultRoute) -> Result<Interface, InterfaceError> {
    let failed = |source| InterfaceError::System { name: name.to_owned(), source };
    named(name, interfaces().map_err(failed)?, default_route)
}

/// The interface `name` among all, if it can be used.
fn named(name: &str, all: Vec<Interface>, default_route: DefaultRoute) -> Result<Interface, InterfaceError> {
    let found = all.iter().map(|interface| &*interface.name).collect::<Vec<_>>().join(", ");
    let missing = || InterfaceError::Missing { name: name.to_owned(), found };
    let interface = all.into_iter().find(|interface| interface.name == name).ok_or_else(missing)?;
    interface.is_fit(default_route).map(|()| interface)
}

const fn is_of_link(address: &IpAddr) -> bool {
    matches!(address, IpAddr::V6(address) if address.is_unicast_link_local())
}

/// All network interfaces that this process sees.
///
/// # Errors
/// That of the system, if it lists none.
pub fn interfaces() -> io::Result<Vec<Interface>> {
    let mut all = listed()?;
    // Without these files there is no IP, and no route.
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

/// A request about an interface to the system; `None`: no interface has such a name.
pub(super) fn request_about(name: &str) -> Option<libc::ifreq> {
    // SAFETY: all bytes of the structure may be zero.
    let mut request: libc::ifreq = unsafe { std::mem::zeroed() };
    // A zero ends the name.
    if name.len() >= request.ifr_name.len() {
        return None;
    }
    request.ifr_name.iter_mut().zip(name.bytes()).for_each(|(to, byte)| *to = byte as libc::c_char);
    Some(request)
}

/// How long frames of an interface may be.
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

/// The interfaces without their routes.
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

    /// ECAT-15.3 An interface that is missing, no Ethernet, down, has too short frames, has an address or is the default route is refused with the next
    /// step; the last alone can be insisted on.
    #[test]
    fn each_unfit_interface_is_refused_with_its_reason() {
        let judged = |interface: Interface, force| {
            let route = if force { DefaultRoute::Allowed } else { DefaultRoute::Refused { insist: Some("--force") } };
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

    /// ECAT-15.3 The loopback interface of this machine is found, with its address, and is no Ethernet.
    #[test]
    fn the_loopback_interface_is_known() {
        let all = interfaces().expect("the interfaces");
        let lo = all.iter().find(|interface| interface.name == "lo").expect("lo");
        assert!(lo.index > 0 && !lo.is_ethernet && !lo.has_default_route && lo.mtu > Some(0), "{lo:?}");
        assert!(matches!(check("lo", DefaultRoute::Allowed), Err(InterfaceError::NoEthernet { .. })));
    }
}
