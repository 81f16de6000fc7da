//! Network cards: the files in `/sys/class/net`, the tables of routes and addresses, and network managers that
//! configure a card.

use super::Machine;
use crate::io::routes::{default_routes_v4, default_routes_v6};

const CARDS: &str = "/sys/class/net";
/// `ARPHRD_ETHER`, the value of Ethernet cards in the file `type`.
const ETHERNET: i64 = 1;
/// `IFF_UP`, the bit of cards that are switched on in the file `flags`.
const UP: u16 = 1;
/// The number of the capability that allows raw frames (capabilities(7)), which the link `nic:` needs.
const CAP_NET_RAW: u32 = 13;
/// The beginning of the name of the abstract socket by which programs of this project claim a network card. The
/// interface index follows.
const CLAIM: &str = "@ecmsk/nic/";

/// A network interface with Ethernet frames: a network card, or a virtual one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NetCard {
    /// The name of the card, such as `eth1`.
    pub name: String,
    /// The interface index of the card, from 1; `None` if it is not known.
    pub index: Option<i64>,
    /// The MAC address of the card, such as `00:1b:21:0a:0b:0c`.
    pub mac_address: Option<String>,
    /// The name of the card's driver; `None` if there is no hardware, or if it is not known.
    pub driver: Option<String>,
    /// The bus that the card is on, such as `pci` or `usb`; `None` if there is no hardware, or if it is not known.
    pub bus: Option<String>,
    /// Whether the card is switched on.
    pub is_up: bool,
    /// Whether the cable has a link to a device at its other end; `None` if the card is switched off, because it does
    /// not report the link then.
    pub has_carrier: Option<bool>,
    /// The speed of the card, Mbit/s; `None` if it is not known.
    pub speed: Option<i64>,
    /// The MTU: the longest frame of the card without its Ethernet header, bytes; `None` if it is not known.
    pub mtu: Option<i64>,
    /// Shows that the card belongs to another network: an IP address of the card, or a network that is routed over it,
    /// such as `192.168.2.0/24`; `None` if there is neither. IPv6 link-local addresses do not count.
    pub address: Option<String>,
    /// Whether the default route of this machine goes over the card.
    pub has_default_route: bool,
    /// Why the interface carries no EtherCAT: `wireless`, `a bridge` or `a bond`; `None` if it is none of these.
    pub unsuitable_kind: Option<&'static str>,
    /// Whether another program of ecmsk uses the card.
    pub is_claimed: bool,
    /// The network manager that configures the card: `NetworkManager` or `systemd-networkd`; `None` if there is none.
    pub manager: Option<&'static str>,
}

impl NetCard {
    /// The URI of the link that opens this card.
    pub fn link(&self) -> String {
        format!("nic:{}", self.name)
    }
}

impl Machine {
    /// All Ethernet cards, sorted by name.
    pub fn net_cards(&self) -> Vec<NetCard> {
        let mut cards = self.own_cards().unwrap_or_else(|| self.cards_in_files());
        // A thread may be in a network namespace of its own, so the file of this thread is read first.
        let sockets = ["/proc/thread-self/net/unix", "/proc/net/unix"].into_iter().find_map(|file| self.text(file));
        let sockets = sockets.unwrap_or_default();
        for card in &mut cards {
            let claim = card.index.map(|index| format!(" {CLAIM}{index}"));
            card.is_claimed = claim.is_some_and(|claim| sockets.lines().any(|line| line.ends_with(&claim)));
            card.manager = card.index.and_then(|index| self.manager(index));
            self.add_details(card);
        }
        cards.sort_by(|one, other| one.name.cmp(&other.name));
        cards
    }

    /// The cards of this machine, as the link `nic:` sees them; `None` if the machine's files are below a folder other
    /// than `/`, as in tests.
    fn own_cards(&self) -> Option<Vec<NetCard>> {
        #[cfg(any(feature = "nic", feature = "serve"))]
        if self.root == std::path::Path::new("/") {
            let all = crate::io::ethernet::interfaces().ok()?.into_iter().filter(|interface| interface.is_ethernet);
            let card = |interface: crate::io::ethernet::Interface| NetCard {
                index: Some(interface.index.into()),
                mac_address: Some(interface.mac_address.map(|byte| format!("{byte:02x}")).join(":")),
                is_up: interface.is_up,
                has_carrier: interface.is_up.then_some(interface.has_carrier),
                mtu: interface.mtu.map(i64::from),
                address: interface.address().map(|address| address.to_string()),
                has_default_route: interface.has_default_route,
                name: interface.name,
                ..NetCard::default()
            };
            return Some(all.map(card).collect());
        }
        None
    }

    /// The cards that the machine's files describe.
    fn cards_in_files(&self) -> Vec<NetCard> {
        let read = |file| self.text(file).unwrap_or_default();
        let (routes, routes_v6) = (read("/proc/net/route"), read("/proc/net/ipv6_route"));
        let defaults = [default_routes_v4(&routes), default_routes_v6(&routes_v6)].concat();
        let addresses_v6 = read("/proc/net/if_inet6");
        let card = |name: String| {
            let file = |file: &str| format!("{CARDS}/{name}/{file}");
            if self.number(&file("type")) != Some(ETHERNET) {
                return None;
            }
            let flags = self.attribute(&file("flags"));
            let flags = flags.and_then(|flags| u16::from_str_radix(flags.trim_start_matches("0x"), 16).ok());
            Some(NetCard {
                index: self.number(&file("ifindex")),
                mac_address: self.attribute(&file("address")),
                is_up: flags.is_some_and(|flags| flags & UP != 0),
                has_carrier: self.number(&file("carrier")).map(|carrier| carrier == 1),
                mtu: self.number(&file("mtu")),
                address: network(&routes, &name).or_else(|| address_v6(&addresses_v6, &name)),
                has_default_route: defaults.contains(&name),
                name,
                ..NetCard::default()
            })
        };
        self.names(CARDS).into_iter().filter_map(card).collect()
    }

    /// Adds driver, bus and speed of a card from sysfs, and why it carries no EtherCAT. In a network namespace sysfs
    /// may show another card of the same name, so the interface index is compared first.
    fn add_details(&self, card: &mut NetCard) {
        let file = |file: &str| format!("{CARDS}/{}/{file}", card.name);
        if self.number(&file("ifindex")) != card.index {
            return;
        }
        let kinds = [("wireless", "wireless"), ("phy80211", "wireless"), ("bridge", "a bridge"), ("bonding", "a bond")];
        let kind = kinds.into_iter().find(|(folder, _)| self.has(&file(folder)));
        let (driver, bus) = (self.link_name(&file("device/driver")), self.link_name(&file("device/subsystem")));
        let speed = self.number(&file("speed")).filter(|speed| *speed > 0);
        (card.unsuitable_kind, card.driver, card.bus, card.speed) = (kind.map(|(_, what)| what), driver, bus, speed);
    }

    /// The network manager that configures the card with this interface index; `None` if none does.
    fn manager(&self, index: i64) -> Option<&'static str> {
        let says = |file: String, no: &str| self.text(&file).is_some_and(|text| !text.lines().any(|line| line == no));
        if says(format!("/run/NetworkManager/devices/{index}"), "managed=false") {
            return Some("NetworkManager");
        }
        says(format!("/run/systemd/netif/links/{index}"), "ADMIN_STATE=unmanaged").then_some("systemd-networkd")
    }

    /// Whether this process may send and receive raw frames.
    pub fn may_use_raw_frames(&self) -> bool {
        self.capabilities() >> CAP_NET_RAW & 1 == 1
    }

    /// Whether the kernel is one for real time (PREEMPT_RT).
    pub fn is_real_time_kernel(&self) -> bool {
        self.number("/sys/kernel/realtime") == Some(1)
    }

    /// The processors that `isolcpus=` excludes from the kernel's scheduler, such as `3` or `2-3`; `None` if there are
    /// none.
    pub fn isolated_processors(&self) -> Option<String> {
        self.attribute("/sys/devices/system/cpu/isolated")
    }

    /// The deepest sleep state that processor 0 may enter, which is taken as that of all processors: its name, and the
    /// time to wake up from it, us. `None`: the kernel lists no sleep state that is allowed.
    pub fn deepest_sleep(&self) -> Option<(String, i64)> {
        const STATES: &str = "/sys/devices/system/cpu/cpu0/cpuidle";
        let states = self.names(STATES).into_iter().filter_map(|state| {
            let file = |file: &str| format!("{STATES}/{state}/{file}");
            let is_allowed = self.number(&file("disable")).unwrap_or(0) == 0;
            let latency = self.number(&file("latency")).filter(|_| is_allowed)?;
            Some((self.attribute(&file("name"))?, latency))
        });
        states.max_by_key(|(_, latency)| *latency)
    }
}

/// The first network in the kernel's table `route` that is routed over an interface; `None` if there is none.
fn network(routes: &str, name: &str) -> Option<String> {
    let rows = routes.lines().skip(1).map(|line| line.split_whitespace().collect::<Vec<_>>());
    rows.filter(|row| row.first() == Some(&name)).find_map(|row| {
        let number = |column: usize| row.get(column).and_then(|text| u32::from_str_radix(text, 16).ok());
        let (network, mask) = (number(1)?, number(7)?);
        let [a, b, c, d] = network.to_le_bytes();
        (network != 0).then(|| format!("{a}.{b}.{c}.{d}/{}", mask.count_ones()))
    })
}

/// The first IPv6 address of an interface in the kernel's table `if_inet6` that is not link-local; `None` if there is
/// none.
fn address_v6(addresses: &str, name: &str) -> Option<String> {
    let rows = addresses.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
    rows.filter(|row| row.get(5) == Some(&name) && row.get(3) != Some(&"20")).find_map(|row| {
        let digits = u128::from_str_radix(row[0], 16).ok()?;
        Some(std::net::Ipv6Addr::from(digits).to_string())
    })
}
