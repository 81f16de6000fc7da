//! A network namespace of its own for a bench, with pairs of virtual interfaces.

use std::process::Command;

/// The word by which the program knows that it runs in its own network namespace.
const INSIDE: &str = "inside-a-namespace";

/// Runs `measure` in a network namespace, in this program started once more; `bench` is left out where there can be none.
pub fn run(bench: &str, measure: impl FnOnce()) {
    if std::env::args().any(|word| word == INSIDE) {
        return measure();
    }
    let this = std::env::current_exe().expect("the program that runs");
    if let Some(reason) = missing() {
        eprintln!("{bench}: left out: {reason}");
        return;
    }
    let ended = Command::new("unshare").arg("--net").arg(this).arg(INSIDE).status().expect("it was there");
    assert!(ended.success(), "{ended}");
}

/// Why there can be no pairs of interfaces here.
fn missing() -> Option<String> {
    let tried = Command::new("unshare").args(["--net", "ip", "link", "add", "type", "veth"]).output();
    match tried {
        Ok(tried) if tried.status.success() => None,
        Ok(tried) => Some(format!("it runs as root: {}", String::from_utf8_lossy(&tried.stderr).trim())),
        Err(error) => Some(format!("it needs unshare (util-linux) and ip (iproute2): {error}")),
    }
}

/// Makes a pair of interfaces, which are up.
pub fn make_pair(near: &str, far: &str) {
    ip(&["link", "add", near, "type", "veth", "peer", "name", far]);
    // The system's own frames, of IPv6, would come between.
    for end in [near, far] {
        let _ = std::fs::write(format!("/proc/sys/net/ipv6/conf/{end}/disable_ipv6"), "1");
        ip(&["link", "set", end, "up"]);
    }
}

fn ip(arguments: &[&str]) {
    let ended = Command::new("ip").args(arguments).status().expect("it was there");
    assert!(ended.success(), "ip {arguments:?}");
}
