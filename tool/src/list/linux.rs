//! Lists USB boards, SPI devices and network cards on Linux.

use std::path::PathBuf;

use clap::ValueHint;
use ecmsk::link::keys::Scheme;
use ecmsk::machine::Machine;
use ecmsk::machine::findings::{Finding, FindingVerdict};
use ecmsk::machine::net::NetCard;
use ecmsk::machine::usb::UsbDevice;
use serde_json::json;

use super::Row;

/// The beginning of the note that is printed if there is no board and no SPI device.
pub const NONE: &str = "no board on USB and no SPI device";

#[derive(clap::Args)]
pub struct SystemArgs {
    /// The folder that /sys, /proc, /dev and /etc are below
    #[arg(long, hide = true, value_name = "DIR", default_value = "/", value_hint = ValueHint::DirPath)]
    root: PathBuf,

    /// Look for slaves on this network card, e.g. eth1, too, as `ecmsk bus scan` does: all of them go to Init
    #[arg(long, value_name = "CARD")]
    scan: Option<String>,
}

/// The network card of `--scan`, whose slaves are to be listed too.
pub fn scanned(args: &SystemArgs) -> Option<&str> {
    args.scan.as_deref()
}

/// Returns a row for each USB board, SPI device and network card.
pub fn rows(args: &SystemArgs) -> Vec<Row> {
    let machine = Machine::below(&args.root);
    usb(&machine).chain(spi(&machine)).chain(cards(&machine)).collect()
}

fn usb(machine: &Machine) -> impl Iterator<Item = Row> {
    let devices = machine.usb_devices();
    let files: Vec<String> = devices.iter().flat_map(UsbDevice::files).collect();
    let (holders, rule) = (machine.holders(&files), machine.udev_rule());
    devices.into_iter().map(move |device| {
        let findings = device.interface.is_ok().then(|| machine.board_findings(&device, &holders, &rule));
        usb_row(&device, findings.unwrap_or_default())
    })
}

fn usb_row(device: &UsbDevice, findings: Vec<Finding>) -> Row {
    let wrong: Vec<Finding> = findings.into_iter().filter(|finding| finding.verdict == FindingVerdict::Wrong).collect();
    let (blocking, others): (Vec<Finding>, Vec<Finding>) = wrong.into_iter().partition(|finding| finding.blocks);
    let facts = json!({
        "path": device.path, "name": device.name, "serial": device.serial, "manufacturer": device.manufacturer,
        "speed_mbit_per_s": device.speed.as_deref().and_then(|speed| speed.parse::<f64>().ok()),
        "board": device.interface.is_ok(),
    });
    let name = device.name.as_deref().unwrap_or("a board without a name");
    let serial = device.serial.as_ref().map_or(String::new(), |serial| format!(", serial {serial}"));
    let (link, what, obstacle) = match device.interface {
        Ok(_) => (Some(device.link()), format!("{name}{serial}"), None),
        Err(why) => (None, format!("{} at {}", device.shown().unwrap_or("a device".into()), device.path), Some(why)),
    };
    Row {
        scheme: Scheme::Usb,
        link,
        what,
        obstacle: blocking.first().map(|finding| finding.found.clone()).or(obstacle.map(|why| why.to_string())),
        but: others.iter().map(|finding| finding.found.clone()).collect(),
        // If there are several obstacles, only the first one shows its next step, because the others may be its
        // consequences.
        next: blocking.into_iter().take(1).chain(others).filter_map(|finding| finding.next).collect(),
        facts,
    }
}

fn spi(machine: &Machine) -> impl Iterator<Item = Row> {
    machine.spi_devices().into_iter().map(|device| {
        let obstacle = machine.spi_obstacle(&device);
        Row {
            scheme: Scheme::Spi,
            link: Some(device.link()),
            what: "SPI device (whether a board is behind it shows when it is opened)".to_owned(),
            obstacle: obstacle.as_ref().map(|finding| finding.found.clone()),
            but: Vec::new(),
            next: obstacle.into_iter().filter_map(|finding| finding.next).collect(),
            facts: json!({ "path": device.file, "board": null }),
        }
    })
}

fn cards(machine: &Machine) -> impl Iterator<Item = Row> {
    machine.net_cards().into_iter().map(|card| {
        let obstacle = machine.card_obstacle(&card);
        let hardware = card.driver.as_ref().map_or("virtual".to_owned(), |driver| driver.clone());
        let address = card.mac_address.as_ref().map_or(String::new(), |address| format!(", {address}"));
        let mut but = Vec::new();
        if card.is_up && card.has_carrier == Some(false) {
            but.push("nobody is at the other end of its cable".to_owned());
        }
        Row {
            scheme: Scheme::Nic,
            link: Some(card.link()),
            what: format!("network card ({hardware}{address})"),
            obstacle: obstacle.as_ref().map(|finding| finding.found.clone()),
            but,
            next: obstacle.into_iter().filter_map(|finding| finding.next).collect(),
            facts: facts(&card),
        }
    })
}

fn facts(card: &NetCard) -> serde_json::Value {
    json!({
        "path": card.name, "board": false, "driver": card.driver, "by": card.bus, "mac_address": card.mac_address,
        "up": card.is_up, "carrier": card.has_carrier, "speed_mbit_per_s": card.speed, "address": card.address,
        "default_route": card.has_default_route, "manager": card.manager,
    })
}
