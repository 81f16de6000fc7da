//! A system that goes to sleep while a program has a board open, as far as possible in a guest with virtual USB.

use std::fs;
use std::thread;

use ecmsk::link::{self, LinkError, Share, Wait};
use ecmsk::sk::Frame;

use super::links::open;
use support::served::{PATIENCE, Served, attach, detach_all, until};

/// The phase at which going to sleep is aborted (Documentation/power/basic-pm-debugging.rst).
const TEST: &str = "/sys/power/pm_test";
const STATE: &str = "/sys/power/state";
/// The time it stays in that phase, s.
const DELAY: &str = "/sys/module/suspend/parameters/pm_test_delay";

/// Programs are frozen, devices put to sleep as far as the virtual controller allows, and everything is woken: the link
/// goes on. A board that lost its configuration, as after a loss of power, is lost, and can be opened again.
#[test]
fn a_system_that_sleeps_wakes_with_its_board() {
    let _served = Served::start(&["sim:?slaves=io"], &[]);
    let shown = attach("1-1");
    let board = open("usb:");
    let mut report = Frame::new();
    let mut next = || board.read(&mut report, Wait::For(PATIENCE)).expect("a report").sequence;
    fs::write(DELAY, "1").expect("the kernel has it");
    // vhci_hcd keeps a system awake while a device is plugged into it, after others have gone to sleep.
    for (test, sleeps) in [("freezer", true), ("devices", false)] {
        let before = next();
        fs::write(TEST, test).expect("the kernel has it");
        let slept = fs::write(STATE, "mem");
        assert_eq!(slept.is_ok(), sleeps, "{test}: {slept:?}");
        until("reports go on", || (next() > before + 100).then_some(()));
        board.write(&Frame::new(), Wait::For(PATIENCE)).expect("it takes it");
    }
    fs::write(TEST, "none").expect("the kernel has it");

    let reader = thread::spawn({
        let board = board.clone();
        move || until("it is lost", || board.read(&mut Frame::new(), Wait::Forever).err())
    });
    let authorized = shown.usb.join("authorized");
    fs::write(&authorized, "0").expect("sysfs takes it");
    let error = reader.join().expect("it ends");
    assert!(matches!(error, LinkError::Lost { .. }), "{error}");
    assert!(matches!(board.write(&Frame::new(), Wait::Forever), Err(LinkError::Lost { .. })));
    board.close();
    fs::write(&authorized, "1").expect("sysfs takes it");
    let again = until("it opens again", || link::open("usb:", Share::ByName).ok());
    again.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    again.close();
    detach_all();
}
