//! A system that goes to sleep while a program has a board.

use std::fs;
use std::thread;

use ecmsk::link::{LinkError, Wait};
use ecmsk::sk::Frame;

use super::links::open;
use super::served::{PATIENCE, Served, attach, detach_all, until};

#[test]
fn try_sleep() {
    let _served = Served::start(&["sim:?slaves=io"], &[]);
    attach("1-1");
    let board = open("usb:");
    board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    println!("{:?} {:?}", fs::read_to_string("/sys/power/state"), fs::read_to_string("/sys/power/pm_test"));
    println!("{:?}", fs::write("/sys/module/suspend/parameters/pm_test_delay", "1"));
    fs::write("/sys/power/pm_test", "devices").expect("pm_test");
    let done = fs::write("/sys/power/state", "mem");
    println!("{done:?}");
    let read = until("x", || Some(board.read(&mut Frame::new(), Wait::For(PATIENCE))));
    println!("{read:?} {:?}", board.stats());
    for _ in 0..50 {
        let read = board.read(&mut Frame::new(), Wait::For(PATIENCE));
        if read.is_err() { println!("{read:?}"); break; }
    }
    println!("{:?}", std::process::Command::new("/bin/busybox").arg("dmesg").output().map(|o| String::from_utf8_lossy(&o.stdout).lines().rev().take(40).map(str::to_owned).collect::<Vec<_>>().join("\n")));
    let _ = thread::sleep;
    let _: Option<LinkError> = None;
    panic!("look");
}
