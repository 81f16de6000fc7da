//! Judges a network card for the link `nic:`, and the settings of the machine that can make EtherCAT cycles late.

use super::{Finding, Machine};
use crate::address::keys::Scheme;
use crate::address::uri::LinkUri;
use crate::machine::net::NetCard;

/// The longest EtherCAT frame without its Ethernet header, bytes, which the MTU of the card has to allow.
const MTU_MIN: i64 = 1500;
/// \[OURS] Longest time that a processor may take to wake up from its deepest sleep, us. A longer one makes cycles
/// late.
const SLEEP_MAX_US: i64 = 50;

impl Machine {
    /// The findings for a link `nic:`; none if another link is wanted.
    pub(super) fn net_findings(&self, wanted: Option<&LinkUri>) -> Vec<Finding> {
        let Some(link) = wanted.filter(|link| link.scheme() == Scheme::Nic) else { return Vec::new() };
        let cards = self.net_cards();
        let Some(card) = cards.iter().find(|card| card.name == link.path()) else {
            let there: Vec<&str> = cards.iter().map(|card| card.name.as_str()).collect();
            let there =
                if there.is_empty() { "there is none".to_owned() } else { format!("there are {}", there.join(", ")) };
            let next = "correct the name in the link, or plug the card in";
            return vec![
                Finding::wrong("card", format!("no network card of Ethernet of that name; {there}"), next)
                    .of(link.path()),
            ];
        };
        let mut all: Vec<Finding> = vec![driver(card)];
        all.extend(self.obstacles(card));
        all.extend([carrier(card), manager(card)]);
        all.extend(self.card_settings(&card.name));
        let mut all: Vec<Finding> = all.into_iter().map(|finding| finding.of(&card.name)).collect();
        all.extend([
            kernel(self.is_real_time_kernel()),
            isolated(self.isolated_processors()),
            sleep(self.deepest_sleep()),
        ]);
        all
    }

    /// The first reason why a card cannot be opened, with the next step; `None` if it can.
    pub fn card_obstacle(&self, card: &NetCard) -> Option<Finding> {
        self.obstacles(card).into_iter().find(|finding| finding.blocks)
    }

    /// The checks that decide whether a card can be opened.
    fn obstacles(&self, card: &NetCard) -> Vec<Finding> {
        vec![fitness(card), claim(card), raw_frames(self.may_use_raw_frames(), card)]
    }

    /// The findings about the driver settings of a card, where its driver reports them.
    fn card_settings(&self, name: &str) -> Vec<Finding> {
        #[cfg(any(feature = "nic", feature = "serve"))]
        if self.file("/") == std::path::Path::new("/") {
            return settings::findings(name, &crate::io::ethernet::settings(name));
        }
        let _ = name;
        Vec::new()
    }
}

fn driver(card: &NetCard) -> Finding {
    const CHECK: &str = "card";
    let speed = card.speed.map_or(String::new(), |speed| format!(", {speed} Mbit/s"));
    match (&card.driver, card.bus.as_deref()) {
        (Some(driver), Some("usb")) => Finding::advice(
            CHECK,
            format!("driver {driver}, on USB{speed}: such adapters hold frames back"),
            "take a card on PCI Express, such as one with an Intel I210",
        ),
        (Some(driver), _) => Finding::fine(CHECK, format!("driver {driver}{speed}")),
        (None, _) => Finding::fine(CHECK, "no hardware: a virtual card"),
    }
}

fn fitness(card: &NetCard) -> Finding {
    const CHECK: &str = "card-fit";
    let name = &card.name;
    let wrong = |found: String, next: String| Finding::wrong(CHECK, found, next).blocking();
    if let Some(what) = card.unsuitable_kind {
        return wrong(format!("it is {what}, which carries no EtherCAT"), "name a card with a cable".into());
    }
    if card.has_default_route {
        let found = "it is this machine's way to others (its default route)".to_owned();
        return wrong(found, "name another card; EtherCAT needs one of its own".into());
    }
    if let Some(address) = &card.address {
        let found = format!("it belongs to another network ({address})");
        return wrong(found, format!("name another card, or take the address away: sudo ip address flush dev {name}"));
    }
    if !card.is_up {
        return wrong("it is switched off".into(), format!("sudo ip link set {name} up"));
    }
    if let Some(mtu) = card.mtu.filter(|mtu| *mtu < MTU_MIN) {
        let found = format!("its frames have {mtu} bytes at most (MTU), and those of EtherCAT up to {MTU_MIN}");
        return wrong(found, format!("sudo ip link set {name} mtu {MTU_MIN}"));
    }
    Finding::fine(CHECK, "for EtherCAT alone: switched on, without an address")
}

fn claim(card: &NetCard) -> Finding {
    const CHECK: &str = "card-use";
    match card.is_claimed {
        true => Finding::wrong(CHECK, "another program of ecmsk has it", "end that program").blocking(),
        false => Finding::fine(CHECK, "no other program of ecmsk has it"),
    }
}

fn raw_frames(may: bool, card: &NetCard) -> Finding {
    const CHECK: &str = "raw-frames";
    if may {
        return Finding::fine(CHECK, "allowed (CAP_NET_RAW)");
    }
    let found = format!("this program may not use raw frames on {} (CAP_NET_RAW)", card.name);
    Finding::wrong(
        CHECK,
        found,
        "sudo setcap cap_net_raw+ep PROGRAM, for each program that opens it, or start it with sudo",
    )
    .blocking()
}

fn carrier(card: &NetCard) -> Finding {
    const CHECK: &str = "card-cable";
    match card.has_carrier {
        Some(true) => Finding::fine(CHECK, "somebody is at its other end"),
        Some(false) => Finding::wrong(CHECK, "nobody is at its other end", "plug it in, and switch the first slave on"),
        None => Finding::fine(CHECK, "not known while the card is switched off"),
    }
}

fn manager(card: &NetCard) -> Finding {
    const CHECK: &str = "card-manager";
    let name = &card.name;
    match card.manager {
        Some("NetworkManager") => Finding::advice(
            CHECK,
            "NetworkManager takes care of it: it may give it an address or switch it off",
            format!("nmcli device set {name} managed no"),
        ),
        Some(manager) => Finding::advice(
            CHECK,
            format!("{manager} takes care of it: it may give it an address or switch it off"),
            format!(
                "write `[Match]`, `Name={name}`, `[Link]`, `Unmanaged=yes` into /etc/systemd/network/10-{name}.network"
            ),
        ),
        None => Finding::fine(CHECK, "nobody takes care of it by himself"),
    }
}

fn kernel(is_real_time: bool) -> Finding {
    const CHECK: &str = "kernel";
    match is_real_time {
        true => Finding::fine(CHECK, "for real time (PREEMPT_RT)"),
        false => Finding::advice(
            CHECK,
            "not for real time: a busy machine makes cycles late",
            "start a kernel with PREEMPT_RT, on Debian that of the package linux-image-rt-amd64",
        ),
    }
}

fn isolated(processors: Option<String>) -> Finding {
    const CHECK: &str = "isolated-processors";
    match processors {
        Some(processors) => Finding::fine(CHECK, format!("{processors}; name one in the link, e.g. cpu=3")),
        None => Finding::advice(
            CHECK,
            "none: other programs run where the cycle does",
            "add isolcpus=3 to the kernel's command line, and cpu=3 to the link",
        ),
    }
}

fn sleep(deepest: Option<(String, i64)>) -> Finding {
    const CHECK: &str = "processor-sleep";
    match deepest {
        None => Finding::fine(CHECK, "the machine shows none"),
        Some((name, latency)) if latency <= SLEEP_MAX_US => {
            Finding::fine(CHECK, format!("{name} at most, {latency} us to wake up")).figure("wake_up_us", latency)
        }
        Some((name, latency)) => Finding::advice(
            CHECK,
            format!("{name}, {latency} us to wake up"),
            format!("sudo cpupower idle-set -D {SLEEP_MAX_US}"),
        )
        .figure("wake_up_us", latency),
    }
}

#[cfg(any(feature = "nic", feature = "serve"))]
mod settings {
    //! Judges the driver settings of a card.

    use crate::io::ethernet::CardSettings;
    use crate::machine::findings::Finding;

    /// Judges coalescing, offloads and Energy Efficient Ethernet of a card, where its driver reports them.
    pub(super) fn findings(name: &str, settings: &CardSettings) -> Vec<Finding> {
        [coalescing(name, settings), offloads(name, settings), eee(name, settings)].into_iter().flatten().collect()
    }

    fn coalescing(name: &str, settings: &CardSettings) -> Option<Finding> {
        const CHECK: &str = "card-coalescing";
        let CardSettings { rx_usecs, tx_usecs, adaptive_rx, .. } = *settings;
        let (rx, tx) = (rx_usecs?, tx_usecs.unwrap_or(0));
        let adaptive = adaptive_rx == Some(true);
        if rx == 0 && tx == 0 && !adaptive {
            return Some(Finding::fine(CHECK, "frames are told of at once"));
        }
        let chosen = if adaptive { ", and chosen by the card itself" } else { "" };
        let found = format!("frames wait for others: up to {rx} us in, {tx} us out{chosen}");
        let next = format!("sudo ethtool -C {name} adaptive-rx off rx-usecs 0 tx-usecs 0");
        Some(Finding::advice(CHECK, found, next).figure("rx_us", rx.into()).figure("tx_us", tx.into()))
    }

    fn offloads(name: &str, settings: &CardSettings) -> Option<Finding> {
        const CHECK: &str = "card-offloads";
        let all = [("gro", settings.gro), ("lro", settings.lro), ("tso", settings.tso)];
        if all.iter().all(|(_, on)| on.is_none()) {
            return None;
        }
        let on: Vec<&str> = all.into_iter().filter(|(_, on)| *on == Some(true)).map(|(name, _)| name).collect();
        if on.is_empty() {
            return Some(Finding::fine(CHECK, "off"));
        }
        let found = format!("on: {}; they are for other networks, and cost time", on.join(", "));
        let off: Vec<String> = on.iter().map(|name| format!("{name} off")).collect();
        Some(Finding::advice(CHECK, found, format!("sudo ethtool -K {name} {}", off.join(" "))))
    }

    fn eee(name: &str, settings: &CardSettings) -> Option<Finding> {
        const CHECK: &str = "card-eee";
        Some(match settings.eee? {
            false => Finding::fine(CHECK, "off"),
            true => Finding::advice(
                CHECK,
                "on: the link sleeps between frames",
                format!("sudo ethtool --set-eee {name} eee off"),
            ),
        })
    }

    #[cfg(test)]
    mod tests {
        use super::*;
        use crate::machine::findings::FindingVerdict;

        /// Settings that delay frames get advice with the command that changes them; settings that the driver does not
        /// report are left out.
        #[test]
        fn what_holds_frames_back_is_advised_against() {
            let judged = |settings: CardSettings| -> Vec<(&str, FindingVerdict, String)> {
                let all = findings("eth1", &settings).into_iter();
                all.map(|finding| (finding.check, finding.verdict, finding.next.unwrap_or_default())).collect()
            };
            assert_eq!(judged(CardSettings::default()), []);
            let busy = CardSettings {
                rx_usecs: Some(3),
                tx_usecs: Some(50),
                adaptive_rx: Some(true),
                gro: Some(true),
                lro: Some(false),
                tso: Some(true),
                eee: Some(true),
            };
            assert_eq!(
                judged(busy),
                [
                    (
                        "card-coalescing",
                        FindingVerdict::Advice,
                        "sudo ethtool -C eth1 adaptive-rx off rx-usecs 0 tx-usecs 0".to_owned()
                    ),
                    ("card-offloads", FindingVerdict::Advice, "sudo ethtool -K eth1 gro off tso off".to_owned()),
                    ("card-eee", FindingVerdict::Advice, "sudo ethtool --set-eee eth1 eee off".to_owned()),
                ]
            );
            let quiet = CardSettings {
                rx_usecs: Some(0),
                tx_usecs: Some(0),
                adaptive_rx: Some(false),
                gro: Some(false),
                lro: Some(false),
                tso: Some(false),
                eee: Some(false),
            };
            assert!(judged(quiet).iter().all(|(_, verdict, _)| *verdict == FindingVerdict::Fine));
        }
    }
}
