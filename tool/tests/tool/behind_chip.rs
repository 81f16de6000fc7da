//! The verbs of a board with `xf-sim:`, whose slaves are behind the model of an ECM-XF.

use crate::common::run;

const SLAVES: &str = "slaves=drive*2,io,step,hsp2&slot=16&clock=virtual";

fn say(arguments: &[&str], scheme: &str) -> [String; 2] {
    let link = format!("{scheme}:?{SLAVES}");
    let ran = run(arguments.iter().copied().chain(["--link", &link]));
    assert_eq!(ran.code, Some(0), "{arguments:?} on {link}: {ran:?}");
    [ran.out.replace(&link, "LINK"), ran.said().replace(&link, "LINK")]
}

/// Verbs that read, change and move print the same with `xf-sim:` as with `sim:`.
#[test]
fn verbs_print_the_same_behind_a_chip() {
    for arguments in [
        &["info", "--scan"][..],
        &["info", "--scan", "--json"],
        &["state"],
        &["state", "op"],
        &["sdo", "read", "1", "0x1018:1"],
        &["sdo", "write", "2", "0x6065", "99"],
        &["io", "3", "--up", "--set", "0x00F5"],
        &["servo", "on", "1", "4", "--up"],
        &["home", "1", "2", "--up"],
        &["move", "1=500", "2=-300", "4=50", "5=70", "--up"],
    ] {
        assert_eq!(say(arguments, "xf-sim"), say(arguments, "sim"), "{arguments:?}");
    }
}

/// `monitor` knows the slaves of the link.
#[test]
fn monitor_knows_the_slaves_behind_a_chip() {
    let [shown, _] = say(&["monitor", "--once"], "xf-sim");
    let kinds: Vec<_> = shown.lines().filter(|line| line.starts_with("    ")).collect();
    assert!(kinds.len() == 5 && kinds[2].starts_with("    3 io") && kinds[4].starts_with("    5 hsp"), "{shown}");
}
