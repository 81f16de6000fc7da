//! `ecmsk list`: lists the boards of this machine, and the network cards with which a link `nic:` can replace a board.

#[cfg(target_os = "linux")]
mod linux;
#[cfg(windows)]
mod windows;

use std::fmt::Write as _;
use std::process::ExitCode;

use ecmsk::link::keys::Scheme;
use serde_json::Value;

use super::stderr::say;
use super::{CliError, output};
#[cfg(target_os = "linux")]
use linux as system;
#[cfg(windows)]
use windows as system;

/// List the boards of this machine; for a board that cannot be opened, say why and what to do
///
/// Nothing is opened, and no special rights are needed. Boards on USB are recognised by their descriptors; an SPI
/// device shows only when it is opened whether a board is behind it. Network cards can have slaves at their end,
/// without a board; on Linux --scan looks for them. Each line begins with the link to give to --link.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk list
  ecmsk list --json | jq -r 'select(.can_open) | .link'")]
pub struct Args {
    /// Print one JSON object for each device, each on a line of its own
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    system: system::SystemArgs,
}

/// A device of this machine, as a row of the list.
struct Row {
    scheme: Scheme,
    /// The link to the device; `None` for another device with the board's vendor and product id.
    link: Option<String>,
    /// The device as text: its name or type, and its serial number or address.
    what: String,
    /// Why the device cannot be opened, or why it is no board.
    obstacle: Option<String>,
    /// Problems that do not keep the board from being opened.
    but: Vec<String>,
    /// What the user can do about the obstacle and the problems.
    next: Vec<String>,
    /// Further fields of the row's JSON object, such as the speed of a board on USB.
    facts: Value,
}

impl Row {
    fn can_open(&self) -> bool {
        self.link.is_some() && self.obstacle.is_none()
    }
}

/// Prints the list; the exit code says whether any board can be opened.
///
/// # Errors
/// [`CliError::Output`] if standard output cannot be written to, [`CliError::Bus`] if `--scan` fails.
pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let rows = system::rows(&args.system);
    output::print(if args.json { lines(&rows) } else { table(&rows) })?;
    if let Some(card) = system::scanned(&args.system) {
        super::bus::scan_card(card, args.json)?;
    }
    let is_board = |row: &&Row| row.link.is_some() && row.scheme != Scheme::Nic;
    let links: Vec<&Row> = rows.iter().filter(is_board).collect();
    if links.is_empty() {
        say(
            "note",
            &format!(
                "{}; plug it in, set CONFIG0 to USB, and give it power enough, or simulate one: \
                 --link 'sim:?slaves=drive*2'",
                system::NONE
            ),
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
