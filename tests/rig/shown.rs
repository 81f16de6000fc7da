//! A board as seen by Debian's `usbip` and by the kernel.

use std::fs;

use support::served::{Served, attach, detach_all, usbip};

/// SK-9.1 Debian's `usbip list` shows the board's pair.
#[test]
fn usbip_lists_the_boards() {
    let _served = Served::start(&["sim:?name=a", "sim:?name=b"], &[]);
    let output = usbip(&["list", "-r", "127.0.0.1"]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success() && said.contains("1-1:") && said.contains("1-2:"), "{output:?}");
    assert_eq!(said.matches("(16c0:05df)").count(), 2, "{said}");
}

/// SK-9.1, SK-9.3, SK-9.4 The kernel sees a high-speed HID device with interrupt IN 0x81 and OUT 0x02 of 512 bytes,
/// 125 us.
#[test]
fn the_kernel_sees_the_board() {
    let _served = Served::start(&["sim:"], &[]);
    let board = attach("1-1");
    let says = |file: &str| board.usb_says(file);
    assert_eq!((says("idVendor"), says("idProduct"), says("speed")), ("16c0".into(), "05df".into(), "480".into()));
    assert_eq!((says("bNumInterfaces"), says("serial")), ("1".into(), "1-1".into()));
    let interface = fs::canonicalize(board.hid.join("..")).expect("its parent");
    let says = |file: &str| fs::read_to_string(interface.join(file)).expect("sysfs has it").trim().to_owned();
    assert_eq!((says("bInterfaceClass"), says("bNumEndpoints")), ("03".into(), "02".into()));
    for (endpoint, direction) in [("ep_81", "in"), ("ep_02", "out")] {
        let says = |file: &str| says(&format!("{endpoint}/{file}"));
        assert_eq!((says("direction"), says("type")), (direction.into(), "Interrupt".into()));
        assert_eq!((says("wMaxPacketSize"), says("interval")), ("0200".into(), "125us".into()));
    }
    detach_all();
}

/// SK-9.5 The kernel's HID code finds reports of 512 bytes without an id.
#[test]
fn the_kernel_takes_the_report_descriptor() {
    let _served = Served::start(&["sim:"], &["--serial", "XYZ", "--name", "Other", "--manufacturer", ""]);
    let board = attach("1-1");
    let descriptor = fs::read(board.hid.join("report_descriptor")).expect("sysfs has it");
    assert_eq!(descriptor.len(), 26);
    assert!(!descriptor.chunks(2).any(|item| item[0] == 0x85), "no report id");
    let facts = fs::read_to_string(board.hid.join("uevent")).expect("sysfs has it");
    assert!(facts.contains("DRIVER=hid-generic\n") && facts.contains("HID_UNIQ=XYZ\n"), "{facts}");
    assert!(facts.contains("HID_NAME=Other\n"), "{facts}");
    detach_all();
}

#[test]
fn two_boards_are_two_devices() {
    let _served = Served::start(&["sim:?name=a", "sim:?name=b"], &[]);
    let (first, second) = (attach("1-1"), attach("1-2"));
    assert_eq!((first.usb_says("serial"), second.usb_says("serial")), ("1-1".into(), "1-2".into()));
    let third = usbip(&["attach", "-r", "127.0.0.1", "-b", "1-1"]);
    assert!(!third.status.success(), "it is attached already");
    detach_all();
}
