//! `ecmsk list`: the boards of this machine.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::ValueHint;
use ecmsk::link::keys::Scheme;
use ecmsk::machine::Machine;
use ecmsk::machine::findings::{Finding, State};
use ecmsk::machine::usb::UsbDevice;
use serde_json::{Value, json};

use super::error::say;
use super::{CliError, output};

/// List the boards of this machine, those that cannot be opened, too, with the reason and what to do
///
/// Nothing is opened, and no right is needed. Boards on USB are known by what they say of themselves; whether there is a
/// board behind an SPI device shows only when it is opened. What stands first is the link to give to --link.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk list
  ecmsk list --json | jq -r 'select(.can_open) | .link'")]
pub struct Args {
    /// Print one JSON object for each device, each on a line of its own
    #[arg(long)]
    json: bool,

    /// The folder that /sys, /proc, /dev and /etc are below
    #[arg(long, hide = true, value_name = "DIR", default_value = "/", value_hint = ValueHint::DirPath)]
    root: PathBuf,
}

/// A device.
struct Row {
    scheme: Scheme,
    /// `None`: it is another device with the board's ids.
    link: Option<String>,
    /// What it is, for people.
    what: String,
    /// Why it cannot be opened; or why it is no board.
    obstacle: Option<String>,
    /// What is wrong with it all the same.
    but: Vec<String>,
    /// What to do.
    next: Vec<String>,
    /// What a program wants to know besides.
    facts: Value,
}

impl Row {
    fn can_open(&self) -> bool {
        self.link.is_some() && self.obstacle.is_none()
    }
}

/// # Errors
/// [`CliError::Output`]
pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let machine = Machine::below(&args.root);
    let rows: Vec<Row> = usb(&machine).chain(spi(&machine)).collect();
    output::print(if args.json { lines(&rows) } else { table(&rows) })?;
    let links: Vec<&Row> = rows.iter().filter(|row| row.link.is_some()).collect();
    if links.is_empty() {
        say(
            "note",
            &"no board on USB and no SPI device; plug it in, set CONFIG0 to USB, and give it power enough, or simulate one: \
              --link 'sim:?slaves=drive*2'",
        );
    }
    let missing = |scheme: &Scheme| !scheme.in_build() && links.iter().any(|row| row.scheme == *scheme);
    for scheme in [Scheme::Usb, Scheme::Spi].into_iter().filter(missing) {
        say("note", &super::doctor::not_in_build(scheme));
    }
    let (boards, others): (Vec<&Row>, Vec<&Row>) = links.into_iter().partition(|row| row.scheme == Scheme::Usb);
    let opens = |row: &&Row| row.can_open() && row.scheme.in_build();
    let is_well = if boards.is_empty() { others.iter().any(opens) } else { boards.iter().all(opens) };
    Ok(if is_well { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn usb(machine: &Machine) -> impl Iterator<Item = Row> {
    let devices = machine.usb_devices();
    let files: Vec<String> = devices.iter().flat_map(UsbDevice::files).collect();
    let (holders, rule) = (machine.holders(&files), machine.udev_rule());
    devices.into_iter().map(move |device| {
        let findings = device.shape.is_ok().then(|| machine.board_findings(&device, &holders, &rule));
        usb_row(&device, findings.unwrap_or_default())
    })
}

fn usb_row(device: &UsbDevice, findings: Vec<Finding>) -> Row {
    let wrong: Vec<Finding> = findings.into_iter().filter(|finding| finding.state == State::Wrong).collect();
    let (blocking, others): (Vec<Finding>, Vec<Finding>) = wrong.into_iter().partition(|finding| finding.blocks);
    let facts = json!({
        "path": device.path, "name": device.name, "serial": device.serial, "manufacturer": device.manufacturer,
        "speed_mbit_per_s": device.speed.as_deref().and_then(|speed| speed.parse::<f64>().ok()),
        "board": device.shape.is_ok(),
    });
    let name = device.name.as_deref().unwrap_or("a board without a name");
    let serial = device.serial.as_ref().map_or(String::new(), |serial| format!(", serial {serial}"));
    let (link, what, obstacle) = match device.shape {
        Ok(_) => (Some(device.link()), format!("{name}{serial}"), None),
        Err(why) => (None, format!("{} at {}", device.shown().unwrap_or("a device".into()), device.path), Some(why)),
    };
    Row {
        scheme: Scheme::Usb,
        link,
        what,
        obstacle: blocking.first().map(|finding| finding.found.clone()).or(obstacle.map(|why| why.to_string())),
        but: others.iter().map(|finding| finding.found.clone()).collect(),
        // One step after the other: the first obstacle may be the reason for the next.
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

fn table(rows: &[Row]) -> String {
    let width = rows.iter().filter_map(|row| row.link.as_ref()).map(|link| link.chars().count()).max().unwrap_or(1);
    let mut text = String::new();
    for row in rows {
        let link = row.link.as_deref().unwrap_or("-");
        let state = match (&row.link, &row.obstacle) {
            (None, Some(why)) => format!("no board: {why}"),
            (_, Some(why)) => format!("cannot be opened: {why}"),
            (_, None) => "can be opened".to_owned(),
        };
        // Writing to a String does not fail.
        let _ = writeln!(text, "{link:<width$}  {}: {state}", row.what);
        for but in &row.but {
            let _ = writeln!(text, "{:<width$}  but: {but}", "");
        }
        for next in &row.next {
            let _ = writeln!(text, "{:<width$}  do: {next}", "");
        }
    }
    text
}

fn lines(rows: &[Row]) -> String {
    let line = |row: &Row| {
        let mut object = row.facts.clone();
        object["verb"] = "list".into();
        object["scheme"] = row.scheme.name().into();
        object["link"] = row.link.clone().into();
        object["can_open"] = row.can_open().into();
        object["in_build"] = row.scheme.in_build().into();
        object["reason"] = row.obstacle.clone().into();
        object["also_wrong"] = row.but.clone().into();
        object["next"] = row.next.clone().into();
        format!("{object}\n")
    };
    rows.iter().map(line).collect()
}
