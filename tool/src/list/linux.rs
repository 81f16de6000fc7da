//! Lists boards on USB and SPI devices, on Linux.

use std::path::PathBuf;

use clap::ValueHint;
use ecmsk::link::keys::Scheme;
use ecmsk::machine::Machine;
use ecmsk::machine::findings::{Finding, Verdict};
use ecmsk::machine::usb::UsbDevice;
use serde_json::json;

use super::Row;

/// The text for an empty list.
pub const NONE: &str = "no board on USB and no SPI device";

#[derive(clap::Args)]
pub struct SystemArgs {
    /// The folder that /sys, /proc, /dev and /etc are below
    #[arg(long, hide = true, value_name = "DIR", default_value = "/", value_hint = ValueHint::DirPath)]
    root: PathBuf,
}

/// All devices of the list.
pub fn rows(args: &SystemArgs) -> Vec<Row> {
    let machine = Machine::below(&args.root);
    usb(&machine).chain(spi(&machine)).collect()
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
    let wrong: Vec<Finding> = findings.into_iter().filter(|finding| finding.verdict == Verdict::Wrong).collect();
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
        // Only the first obstacle has its step, because the others may follow from it.
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
