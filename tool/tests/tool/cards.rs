//! Network cards in `ecmsk list` and `ecmsk doctor`, on machines of files.
#![cfg(target_os = "linux")]

use serde_json::Value;

use crate::common::json_lines;
use crate::common::machine::FakeMachine;

const ROUTES: &str = "Iface\tDestination\tGateway\tFlags\tRefCnt\tUse\tMetric\tMask\tMTU\tWindow\tIRTT\n";

/// Cards of every kind: one that is usable, and one for each reason why a card is not.
fn several() -> FakeMachine {
    let tree = FakeMachine::bare();
    tree.allow_raw_frames();
    tree.card("eth0", 2, "e1000e");
    tree.card("eth1", 3, "igb");
    tree.card("eth2", 4, "igb");
    tree.file("/sys/class/net/eth2/flags", "0x1002\n");
    tree.remove("/sys/class/net/eth2/carrier");
    tree.card("eth3", 5, "r8169");
    tree.card("eth4", 6, "r8169");
    tree.card("eth5", 7, "igc");
    tree.file("/sys/class/net/eth5/carrier", "0\n");
    tree.card("wlan0", 8, "iwlwifi");
    tree.dir("/sys/class/net/wlan0/wireless");
    tree.card("br0", 9, "none");
    tree.remove("/sys/class/net/br0/device");
    tree.dir("/sys/class/net/br0/bridge");
    tree.card("eth6", 10, "igb");
    tree.card("lo", 1, "none");
    tree.file("/sys/class/net/lo/type", "772\n");
    let routes = "eth0\t00000000\t0102A8C0\t0003\t0\t0\t0\t00000000\t0\t0\t0\n\
                  eth3\t0002A8C0\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0\n";
    tree.file("/proc/net/route", format!("{ROUTES}{routes}"));
    let addresses = "20010db8000000000000000000000007 06 40 00 80     eth4\n\
                     fe800000000000000000000000000001 03 40 20 80     eth1\n";
    tree.file("/proc/net/if_inet6", addresses);
    tree.file(
        "/proc/net/unix",
        "Num       RefCount Protocol Flags    Type St Inode Path\n0: 2 0 10000 1 1 77 @ecmsk/nic/10\n",
    );
    tree
}

fn rows(tree: &FakeMachine) -> Vec<Value> {
    json_lines(&tree.run(&["list", "--json"]).out)
}

/// `list` shows each Ethernet card with its link and the reason why it is not usable, as text and as JSON. The exit code is
/// about boards and not about cards.
#[test]
fn cards_are_listed_with_what_they_lack() {
    let tree = several();
    let text = tree.run(&["list"]);
    assert_eq!(text.code, Some(1), "there is no board: {text:?}");
    support::snapshot("tool_list_cards", &format!("{}\n{}", text.out, tree.run(&["list", "--json"]).out));
    let fit: Vec<String> =
        rows(&tree).iter().filter(|row| row["can_open"] == true).map(|row| row["link"].to_string()).collect();
    assert_eq!(fit, ["\"nic:eth1\"", "\"nic:eth5\""]);
    tree.file("/proc/self/status", "CapEff:\t0000000000000000\n");
    let denied = rows(&tree);
    let eth1 = denied.iter().find(|row| row["path"] == "eth1").expect("it is there");
    assert!(eth1["reason"].as_str().expect("a reason").contains("CAP_NET_RAW"), "{eth1}");
    assert!(eth1["next"][0].as_str().expect("a step").contains("setcap cap_net_raw+ep"), "{eth1}");
    // If there is a board, the exit code is about boards alone: it is 0 although a card is not usable.
    let tree = FakeMachine::good();
    tree.card("eth2", 4, "igb");
    tree.file("/sys/class/net/eth2/flags", "0x1002\n");
    assert_eq!(tree.run(&["list"]).code, Some(0));
}

/// A card for `--scan` that does not exist is refused with the error of a link `nic:`, after the list was printed.
#[test]
fn slaves_are_looked_for_on_request() {
    let ran = several().run(&["list", "--scan", "no_card"]);
    assert_eq!(ran.code, Some(1));
    assert!(ran.out.contains("nic:eth1") && ran.err.contains("no network interface no_card"), "{ran:?}");
}

/// `doctor` on a link `nic:` reports what delays the card's cycle; on other links it does not mention the card.
#[test]
fn doctor_judges_a_card_and_the_machine() {
    let tree = several();
    tree.file("/run/NetworkManager/devices/3", "[device]\nmanaged=true\n");
    let state = |tree: &FakeMachine, link: &str, check: &str| tree.finding(link, check)["state"].clone();
    for (check, wanted) in [
        ("card", "ok"),
        ("card-fit", "ok"),
        ("card-use", "ok"),
        ("raw-frames", "ok"),
        ("card-cable", "ok"),
        ("card-manager", "advice"),
        ("kernel", "advice"),
        ("isolated-processors", "advice"),
        ("processor-sleep", "ok"),
    ] {
        assert_eq!(state(&tree, "nic:eth1", check), wanted, "{check}");
    }
    for (link, check, found, next) in [
        ("nic:eth0", "card-fit", "default route", "name another card"),
        ("nic:eth2", "card-fit", "switched off", "sudo ip link set eth2 up"),
        ("nic:eth3", "card-fit", "192.168.2.0/24", "sudo ip address flush dev eth3"),
        ("nic:eth4", "card-fit", "2001:db8::7", "sudo ip address flush dev eth4"),
        ("nic:eth5", "card-cable", "nobody", "plug it in"),
        ("nic:eth6", "card-use", "another program", "end that program"),
        ("nic:wlan0", "card-fit", "wireless", "a card with a cable"),
        ("nic:eth9", "card", "there are br0, eth0, eth1", "correct the name"),
    ] {
        let finding = tree.finding(link, check);
        let words = |field: &str| finding[field].as_str().unwrap_or_default().to_owned();
        assert_eq!(finding["state"], "wrong", "{link}: {finding}");
        assert!(words("found").contains(found) && words("next").contains(next), "{link}: {finding}");
    }
    // From here on nothing is wrong with the card and the machine.
    tree.file("/run/NetworkManager/devices/3", "[device]\nmanaged=false\n");
    tree.file("/sys/kernel/realtime", "1\n");
    tree.file("/sys/devices/system/cpu/isolated", "2-3\n");
    let sleep = "/sys/devices/system/cpu/cpu0/cpuidle";
    for (state, name, latency, disable) in [("state0", "POLL", "0", "0"), ("state1", "C6", "133", "0")] {
        tree.file(&format!("{sleep}/{state}/name"), format!("{name}\n"));
        tree.file(&format!("{sleep}/{state}/latency"), format!("{latency}\n"));
        tree.file(&format!("{sleep}/{state}/disable"), format!("{disable}\n"));
    }
    for check in ["card-manager", "kernel", "isolated-processors"] {
        assert_eq!(state(&tree, "nic:eth1", check), "ok", "{check}");
    }
    let deep = tree.finding("nic:eth1", "processor-sleep");
    assert_eq!((&deep["state"], &deep["figures"]["wake_up_us"]), (&"advice".into(), &133.into()), "{deep}");
    tree.file(&format!("{sleep}/state1/disable"), "1\n");
    assert_eq!(state(&tree, "nic:eth1", "processor-sleep"), "ok");
    tree.remove("/sys/class/net/eth1/device/subsystem");
    tree.link("/sys/class/net/eth1/device/subsystem", "../../../bus/usb");
    assert_eq!(state(&tree, "nic:eth1", "card"), "advice");
    tree.file("/run/systemd/netif/links/3", "ADMIN_STATE=configured\n");
    let manager = tree.finding("nic:eth1", "card-manager");
    assert!(manager["next"].as_str().expect("a step").contains("Unmanaged=yes"), "{manager}");
    let others = tree.run(&["doctor", "--quick", "--json"]);
    assert!(json_lines(&others.out).iter().all(|line| line["check"] != "card-fit"), "{others:?}");
}

/// `list` also works if the files of a card or of the network are empty, nonsense or very long.
#[test]
fn files_of_any_kind_do_no_harm() {
    let tree = several();
    let files =
        ["flags", "ifindex", "address", "carrier", "speed", "type"].map(|name| format!("/sys/class/net/eth1/{name}"));
    let tables = ["/proc/net/route", "/proc/net/if_inet6", "/proc/net/unix", "/proc/net/ipv6_route"].map(str::to_owned);
    for file in files.into_iter().chain(tables) {
        for content in [&b""[..], b"\xff\x1b[2J-99999999999999999999\0\n", &[b'1'; (1 << 20) + 1], b"0 0 0 0 0 eth1\n"]
        {
            tree.file(&file, content);
            let ran = tree.run(&["list", "--json"]);
            assert!(
                ran.code == Some(1) && !ran.out.contains('\x1b') && !ran.err.contains("panicked"),
                "{file}: {ran:?}"
            );
            json_lines(&ran.out);
        }
    }
}
