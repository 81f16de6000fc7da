//! `ecmsk doctor` on machines of files: each finding, right and wrong.
#![cfg(target_os = "linux")]

use std::fs;
use std::os::unix::fs::PermissionsExt;

use crate::common::machine::{FakeMachine, RELAY, page_block};
use crate::common::{Ran, json_lines, run};
use ecmsk::link::keys::Scheme;
use serde_json::Value;

const USB: &str = "usb:";
const SPI: &str = "spi:/dev/spidev0.0";
const XF_SPI: &str = "xf-spi:/dev/spidev0.0";
const SIM: &str = "sim:";

/// Runs `doctor` on a machine of files; its output is without the parts that depend on this build and on the machine of the
/// test.
fn report(tree: &FakeMachine, link: &str, arguments: &[&str]) -> Ran {
    let mut command = tree.tool(&[&["doctor", "--quick"], arguments].concat());
    let mut ran = Ran::from(command.env("ECMSK_LINK", link).output().expect("the tool starts"));
    let mut lines: Vec<&str> = ran.out.lines().collect();
    lines.retain(|line| {
        let words = ["versions", "timer", "\"check\":\"versions\"", "\"check\":\"timer\"", "\"check\":\"build\""];
        !words.iter().any(|word| line.contains(word))
    });
    if let Some(build) = lines.iter().position(|line| line.starts_with("wrong   build ")) {
        lines.drain(build..build + 2);
    }
    ran.out = lines.iter().map(|line| format!("{line}\n")).collect();
    ran
}

fn state(finding: &Value) -> &str {
    finding["state"].as_str().expect("a text")
}

fn wrongs(tree: &FakeMachine, link: &str) -> Vec<String> {
    let mut findings = tree.doctor(link);
    findings.retain(|finding| finding["state"] == "wrong" && finding["check"] != "build");
    findings.iter().map(|finding| finding["check"].as_str().expect("a text").to_owned()).collect()
}

/// `doctor` reports on a machine without faults and on one with all faults, as text and as JSON. Its exit code tells the two
/// apart.
#[test]
fn the_exit_code_says_whether_anything_is_wrong_with_the_machine() {
    let good = FakeMachine::good();
    let [text, json] = [&[][..], &["--json"]].map(|arguments| report(&good, USB, arguments));
    let is_missing = i32::from(!Scheme::Usb.in_build());
    assert_eq!((text.code, json.code), (Some(is_missing), Some(is_missing)), "{text:?}");
    let lines = text.out.lines().filter(|line| !line.ends_with("could be better"));
    let text: String = lines.map(|line| format!("{line}\n")).collect();
    support::snapshot("tool_doctor_good", &format!("{text}\n{}", json.out));

    let bad = bad();
    let [text, json] = [&[][..], &["--json"]].map(|arguments| report(&bad, USB, arguments));
    assert_eq!((text.code, json.code), (Some(1), Some(1)), "{text:?}");
    let lines = text.out.lines().filter(|line| !line.ends_with("could be better"));
    let text: String = lines.map(|line| format!("{line}\n")).collect();
    support::snapshot("tool_doctor_bad", &format!("{text}\n{}", json.out));
}

/// Makes a machine with all faults that `doctor` reports.
fn bad() -> FakeMachine {
    let bad = FakeMachine::bare();
    bad.hub("1-2", "80");
    bad.board("1-2.3", 5, "8");
    bad.deny("/dev/bus/usb/001/005");
    for (name, value) in [("speed", "12"), ("power/control", "auto"), ("power/runtime_status", "suspended")] {
        bad.usb("1-2.3", name, value);
    }
    bad.process(812, "old_program", "/dev/hidraw5");
    bad.spi("spidev0.0");
    bad.deny("/dev/spidev0.0");
    bad.file("/sys/module/spidev/parameters/bufsiz", "256\n");
    bad.dir("/sys/bus/gpio/devices/gpiochip0");
    bad.file("/dev/gpiochip0", "");
    bad.deny("/dev/gpiochip0");
    bad.file("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "powersave\n");
    bad.file(
        "/proc/self/limits",
        "Max locked memory         8388608              8388608              bytes     \n\
         Max realtime priority     0                    0                    \n",
    );
    bad
}

/// `doctor` prints what docs/TOOL-NETWORK.md shows.
#[test]
fn doctor_prints_what_tool_md_shows() {
    let printed = report(&bad(), USB, &[]).out;
    let shown = page_block("wrong   usb-permission");
    assert!(shown.len() >= 6, "{shown:?}");
    for line in shown {
        assert!(printed.lines().any(|printed| printed == line), "`{line}` is not in\n{printed}");
    }
}

/// The last line has the numbers of wrong findings and of advice.
#[test]
fn the_last_line_counts_what_is_wrong_and_what_could_be_better() {
    let tree = FakeMachine::good();
    let last = |tree: &FakeMachine| {
        let mut command = tree.tool(&["doctor", "--quick"]);
        let ran = Ran::from(command.env("ECMSK_LINK", SIM).output().expect("the tool starts"));
        (ran.code, ran.out.lines().last().map(str::to_owned))
    };
    assert_eq!(last(&tree), (Some(0), Some("nothing is wrong, 0 could be better".into())));
    tree.remove("/etc/udev/rules.d/60-ecmsk.rules");
    assert_eq!(last(&tree), (Some(0), Some("nothing is wrong, 1 could be better".into())));
    tree.usb("1-1", "speed", "12");
    tree.usb("1-1", "power/control", "auto");
    assert_eq!(last(&tree), (Some(1), Some("2 to put right, 1 could be better".into())));
}

/// For each fault: one change to a machine without faults makes one finding that reports it, with its text and what to do. All
/// other findings stay `ok`.
#[test]
fn each_thing_that_is_wrong_is_found_by_its_own_check() {
    type Change = fn(&FakeMachine);
    const LIMITS: &str = "/proc/self/limits";
    const GOVERNOR: &str = "/sys/devices/system/cpu/cpu1/cpufreq/scaling_governor";
    const BUFSIZ: &str = "/sys/module/spidev/parameters/bufsiz";
    let cases: &[(&str, Change, &str, &str, &str, &str)] = &[
        (
            USB,
            |t| t.deny("/dev/bus/usb/001/004"),
            "usb-permission",
            "wrong",
            "may not open",
            "sudo usermod -aG plugdev",
        ),
        (USB, |t| t.usb("1-1", "authorized", "0"), "usb-configuration", "wrong", "does not allow", "authorized"),
        (USB, |t| t.usb("1-1", "bConfigurationValue", "0"), "usb-configuration", "wrong", "the power", "power supply"),
        (USB, |t| t.process(9, "demo", "/dev/bus/usb/001/004"), "usb-holder", "wrong", "PID 9 (demo)", "serve tcp"),
        (USB, |t| t.driver("1-1", "usbfs"), "usb-holder", "wrong", "this user cannot see", "sudo ecmsk doctor"),
        (USB, |t| t.usb("1-1", "speed", "12"), "usb-speed", "wrong", "12 Mbit/s, not high speed", "another port"),
        (USB, |t| t.usb("1-1", "speed", "5000"), "usb-speed", "wrong", "5000 Mbit/s", "another port"),
        (USB, |t| t.remove("/sys/bus/usb/devices/1-1/speed"), "usb-speed", "wrong", "not known", "plug it in again"),
        (
            USB,
            |t| t.usb("1-1", "power/control", "auto"),
            "usb-autosuspend",
            "wrong",
            "after 2000 ms",
            "echo on | sudo tee",
        ),
        (
            USB,
            |t| t.usb("1-1", "port/over_current_count", "1"),
            "usb-power",
            "wrong",
            "too much current, once",
            "supply",
        ),
        (USB, |t| t.board("1-3", 9, "8"), "usb", "wrong", "2 boards: 1-1 (ECM-SK, serial 7), 1-3", "usb:?path=1-1"),
        ("usb:?path=1-9", |_| {}, "usb", "wrong", "no board as the link wants it, but 1-1", "correct path="),
        ("usb:?serial=8", |_| {}, "usb", "wrong", "no board as the link wants it, but 1-1", "correct path= or serial="),
        (USB, |t| t.remove("/etc/udev/rules.d/60-ecmsk.rules"), "udev-rule", "advice", "none", "--write-udev-rule"),
        (
            USB,
            |t| t.file("/etc/udev/rules.d/60-ecmsk.rules", "\"16c0\" \"05df\""),
            "udev-rule",
            "advice",
            "this version",
            "sudo rm",
        ),
        (USB, |t| t.remove("/usr"), "libusb", "advice", "no libusb-1.0.so.0", "apt-get install libusb-1.0-0"),
        (SPI, |t| t.deny("/dev/spidev0.0"), "spi-permission", "wrong", "may not open", "-aG spi,gpio"),
        (SPI, |t| t.remove("/dev/spidev0.0"), "spi-permission", "wrong", "there is no /dev/spidev0.0", "udev"),
        ("spi:/dev/spidev1.0", |_| {}, "spi", "wrong", "no /dev/spidev1.0, but /dev/spidev0.0", "correct the link"),
        (
            SPI,
            |t| t.file(BUFSIZ, "511\n"),
            "spi-bufsiz",
            "wrong",
            "up to 511 bytes; a frame has 512",
            "modprobe -r spidev",
        ),
        (SPI, |t| t.remove("/sys/module/spidev"), "spi-bufsiz", "wrong", "not loaded", "modprobe spidev"),
        (XF_SPI, |t| t.deny("/dev/spidev0.0"), "spi-permission", "wrong", "may not open", "-aG spi,gpio"),
        ("xf-spi:/dev/spidev1.0", |_| {}, "spi", "wrong", "no /dev/spidev1.0, but /dev/spidev0.0", "correct the link"),
        (
            XF_SPI,
            |t| t.file(BUFSIZ, "1439\n"),
            "spi-bufsiz",
            "wrong",
            "up to 1439 bytes; a packet has up to 1440",
            "modprobe -r spidev",
        ),
        (
            SPI,
            |t| t.deny("/dev/gpiochip0"),
            "gpio",
            "wrong",
            "may not use it; lines ID_SDA 0, BUSY 3, RESET 4",
            "spi,gpio",
        ),
        (
            SIM,
            |t| t.file(LIMITS, "Max realtime priority     0  0\n"),
            "realtime-priority",
            "advice",
            "not allowed",
            "rtprio 90",
        ),
        (
            SIM,
            |t| t.file(LIMITS, "Max locked memory  65536  9 bytes\n"),
            "locked-memory",
            "advice",
            "64 KiB",
            "memlock unlimited",
        ),
        (SIM, |t| t.file(GOVERNOR, "schedutil\n"), "governor", "advice", "performance, schedutil", "scaling_governor"),
    ];
    for (link, change, check, expected, found, next) in cases {
        let tree = FakeMachine::good();
        change(&tree);
        let finding = tree.finding(link, check);
        assert_eq!(state(&finding), *expected, "{check}: {finding}");
        let has = |key: &str, text: &str| finding[key].as_str().is_some_and(|said| said.contains(text));
        assert!(has("found", found) && has("next", next), "{check}: `{found}`, `{next}`: {finding}");
        let mut others = tree.doctor(link);
        others.retain(|other| other["state"] != "ok" && other["check"] != *check && other["check"] != "build");
        assert!(others.is_empty(), "{check}: {others:?}");
    }
}

/// XF-16.9 A machine that looks wrong and is not gets the finding `ok`.
#[test]
fn what_only_looks_wrong_is_not_reported() {
    type Change = fn(&FakeMachine);
    let cases: &[(&str, Change, &str, &str)] = &[
        (USB, |t| t.driver("1-1", "usbhid"), "usb-holder", "usb: takes it from the driver usbhid while open"),
        (USB, |t| t.remove("/sys/bus/usb/devices/1-1:1.0/driver"), "usb-holder", "nobody has it"),
        (USB, |t| t.process(9, "demo", "/dev/bus/usb/001/044"), "usb-holder", "no program has it"),
        (USB, |t| t.usb("1-1", "power/autosuspend_delay_ms", "-1"), "usb-autosuspend", "stays awake"),
        ("usb:?serial=8", |t| t.board("1-3", 9, "8"), "usb", "board at 1-3 (ECM-SK, serial 8)"),
        (SIM, |t| t.board("1-3", 9, "8"), "usb", "2 boards"),
        (SIM, |t| t.remove("/usr"), "libusb", "no libusb-1.0.so.0"),
        (SPI, |t| t.remove("/sys/bus/usb/devices/1-1"), "usb", "no board"),
        (SPI, |t| t.remove("/sys/bus/usb"), "usb", "this machine has no USB"),
        (USB, |t| t.deny("/dev/spidev0.0"), "spi-permission", "this user may not open it"),
        (USB, |t| t.deny("/dev/gpiochip0"), "gpio", "this user may not use it"),
        (SPI, |t| t.file("/sys/module/spidev/parameters/bufsiz", "512"), "spi-bufsiz", "up to 512 bytes"),
        (SPI, |t| t.remove("/sys/bus/gpio"), "gpio", "no GPIO chip: BUSY cannot be watched"),
        (XF_SPI, |t| t.file("/sys/module/spidev/parameters/bufsiz", "1440"), "spi-bufsiz", "up to 1440 bytes"),
        (XF_SPI, |t| t.remove("/sys/bus/gpio"), "gpio", "no GPIO chip: INT0 cannot be watched"),
        (SIM, |t| t.remove("/sys/devices/system/cpu"), "governor", "the machine shows none"),
        (SIM, |t| t.remove("/proc/self/limits"), "realtime-priority", "not known"),
    ];
    for (link, change, check, found) in cases {
        let tree = FakeMachine::good();
        change(&tree);
        let finding = tree.finding(link, check);
        assert_eq!(state(&finding), "ok", "{check}: {finding}");
        assert!(finding["found"].as_str().is_some_and(|text| text.contains(found)), "{check}: `{found}`: {finding}");
    }
    // A machine without SPI has no finding about it.
    let bare = FakeMachine::bare();
    assert_eq!(state(&bare.finding(SIM, "spi")), "ok");
    let named = bare.finding(SPI, "spi");
    assert_eq!((state(&named), named["subject"].as_str()), ("wrong", Some("/dev/spidev0.0")));
    assert!(named["next"].as_str().is_some_and(|next| next.contains("dtparam=spi=on")), "{named}");
}

/// A board behind a hub: with a power supply it is right, without one it could be better.
#[test]
fn a_board_behind_a_hub_without_power_supply_could_be_better() {
    for (attributes, state, found) in
        [("c0", "ok", "has a power supply"), ("a0", "advice", "no power supply"), ("", "ok", "does not say")]
    {
        let tree = FakeMachine::bare();
        tree.hub("1-2", attributes);
        tree.board("1-2.3", 5, "8");
        let finding = tree.finding(USB, "usb-power");
        assert_eq!((finding["state"].as_str(), finding["subject"].as_str()), (Some(state), Some("1-2.3")));
        assert!(finding["found"].as_str().is_some_and(|text| text.contains(found)), "{finding}");
    }
}

/// Without a board the link usb: has a wrong finding, another link has none; devices with the board's ids are named.
#[test]
fn without_a_board_only_a_usb_link_is_wrong() {
    let tree = FakeMachine::bare();
    assert_eq!((wrongs(&tree, USB), wrongs(&tree, SIM)), (vec!["usb".to_owned()], Vec::new()));
    tree.device("1-4", 7, &RELAY);
    tree.usb("1-4", "product", "Relay");
    let finding = tree.finding(USB, "usb");
    assert_eq!(finding["found"], "no board, only other devices with its ids: 1-4 (Relay)");
    assert!(finding["next"].as_str().is_some_and(|next| next.starts_with("plug it in, set CONFIG0 to USB")));
}

/// A board that is not configured is reported, and does not count as a second board: the link skips it.
#[test]
fn a_board_that_is_not_switched_on_is_passed_over() {
    let tree = FakeMachine::good();
    tree.board("1-3", 9, "8");
    tree.usb("1-3", "bConfigurationValue", "");
    assert_eq!(tree.finding(USB, "usb")["found"], "board at 1-1 (ECM-SK, serial 7)");
    assert_eq!(wrongs(&tree, USB), ["usb-configuration"]);
}

/// Processes that this user may not inspect are counted, so that a missing name is not mistaken for a free board.
#[test]
fn processes_that_this_user_may_not_inspect_are_counted() {
    let tree = FakeMachine::good();
    tree.process(9, "demo", "/dev/bus/usb/001/004");
    tree.deny("/proc/9/fd");
    let finding = tree.finding(USB, "usb-holder");
    assert_eq!(state(&finding), "ok");
    let found = finding["found"].as_str().expect("a text");
    assert!(found.contains("no program has it, as far as this user sees (1 process hidden)"), "{found}");
    fs::set_permissions(tree.path("/proc/9/fd"), fs::Permissions::from_mode(0o755)).expect("our own folder");
}

/// A capability allows real-time priority whatever the limit is.
#[test]
fn a_capability_allows_what_a_limit_forbids() {
    let tree = FakeMachine::good();
    tree.file("/proc/self/limits", "Max realtime priority     0    0\nMax locked memory   0  0 bytes\n");
    let both = |tree: &FakeMachine| {
        ["realtime-priority", "locked-memory"].map(|check| state(&tree.finding(SIM, check)).to_owned())
    };
    assert_eq!(both(&tree), ["advice", "advice"]);
    tree.file("/proc/self/status", "CapEff:\t0000000000800000\n");
    assert_eq!(both(&tree), ["ok", "advice"]);
    tree.file("/proc/self/status", "CapEff:\t0000000000004000\n");
    assert_eq!(both(&tree), ["advice", "ok"]);
}

/// `doctor` shows the link that would be used, where it is configured, and which other places were searched.
#[test]
fn the_link_that_would_be_used_is_shown_with_its_source() {
    let tree = FakeMachine::good();
    let link = |tree: &FakeMachine| {
        let ran = tree.run(&["doctor", "--quick", "--json"]);
        json_lines(&ran.out).into_iter().find(|finding| finding["check"] == "link").expect("it is told")
    };
    let home = "/home/user/.config/ecmsk/ecmsk.toml";
    let found = link(&tree)["found"].as_str().expect("a text").to_owned();
    assert!(found.starts_with("usb:, by default; ECMSK_LINK is not set, there is no "), "{found}");
    assert!(found.ends_with(&format!("/ecmsk.toml, {home}, /etc/ecmsk.toml")), "{found}");

    tree.file("/etc/ecmsk.toml", "link = \"sim:?slaves=drive\"\n");
    let found = link(&tree)["found"].as_str().expect("a text").to_owned();
    assert!(
        found.starts_with("sim:?slaves=drive, from /etc/ecmsk.toml; ECMSK_LINK is not set, there is no "),
        "{found}"
    );
    assert!(found.ends_with(home), "{found}");

    tree.file(home, "link = 5\n");
    let wrong = link(&tree);
    assert_eq!((state(&wrong), wrong["next"].as_str()), ("wrong", Some("see `ecmsk link help`")));
    assert!(wrong["found"].as_str().is_some_and(|text| text.contains("ecmsk.toml, line 1: ")), "{wrong}");

    let named = tree.finding("sim:?slaves=io", "link");
    assert_eq!((state(&named), named["found"].as_str()), ("ok", Some("sim:?slaves=io, from ECMSK_LINK")));
    let wrong = tree.finding("simm:", "link");
    assert_eq!(state(&wrong), "wrong");
    assert!(wrong["found"].as_str().is_some_and(|text| text.contains("unknown scheme `simm`")), "{wrong}");
}

/// A link that this build cannot open is wrong, and the finding says how to build one that can; versions are shown.
#[test]
fn a_link_that_this_build_cannot_open_is_wrong() {
    let tree = FakeMachine::good();
    for (link, scheme) in [(USB, Scheme::Usb), (SPI, Scheme::Spi), (SIM, Scheme::Sim)] {
        let found = tree.doctor(link).into_iter().find(|finding| finding["check"] == "build");
        assert_eq!(found.is_some(), !scheme.in_build(), "{link}");
        if let Some(found) = found {
            assert_eq!(state(&found), "wrong");
            let next =
                format!("it needs the feature `{scheme}`: build with `cargo build --release --features {scheme}`");
            let system = "this system has no such links";
            let expected = if scheme.is_of_this_system() { &next } else { system };
            assert!(found["next"].as_str().is_some_and(|text| text.starts_with(expected)), "{found}");
        }
    }
    let versions = tree.finding(SIM, "versions");
    let found = versions["found"].as_str().expect("a text");
    assert!(found.starts_with(&format!("ecmsk {} (links sim, ", env!("CARGO_PKG_VERSION"))), "{found}");
    assert!(found.ends_with("; Linux 6.1.0-test"), "{found}");
}

/// The wake-up latency of threads is measured, and shown in figures; `--quick` skips it.
#[test]
fn the_lateness_of_threads_is_measured_unless_quick() {
    let tree = FakeMachine::good();
    let ran = tree.run(&["doctor", "--json"]);
    let findings = json_lines(&ran.out);
    let found = findings.iter().find(|finding| finding["check"] == "wake-up").expect("it is measured");
    let figure = |name: &str| found["figures"][name].as_i64().unwrap_or_else(|| panic!("{name}: {found}"));
    assert!(figure("p50_us") <= figure("p99_us") && figure("p99_us") <= figure("max_us"), "{found}");
    assert!(found["found"].as_str().is_some_and(|text| text.contains("at a cycle of 1ms")), "{found}");
    assert!(tree.doctor(SIM).iter().all(|finding| finding["check"] != "wake-up"));
}

/// `doctor` also reports on the machine on which the test runs, whatever that has.
#[test]
fn doctor_reports_on_the_machine_it_runs_on() {
    let ran = run(["doctor", "--quick", "--json"]);
    assert!(matches!(ran.code, Some(0 | 1)), "{ran:?}");
    let checks: Vec<Value> = json_lines(&ran.out).into_iter().map(|finding| finding["check"].clone()).collect();
    for check in ["versions", "link", "usb", "udev-rule", "realtime-priority", "locked-memory", "governor", "timer"] {
        assert!(checks.contains(&Value::from(check)), "{check} is missing in {checks:?}");
    }
}
