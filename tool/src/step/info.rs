//! `info`: shows what is known about the board, the link and the network.

use std::fmt::Write;

use ecmsk::cia402::error_name;
use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::ecm::{EcmError, Slave, SlaveView, Snapshot};
use ecmsk::link::slaves;
use ecmsk::sk::{FIFO_ENTRIES, MasterState};
use serde_json::{Value, json};

use crate::board::{Board, BoardError, Needs, list, statusword_text};
use crate::output::counted;

/// Show the board, the link and the network; nothing is sent
///
/// Reports contain slaves only in SafeOP and OP; there each slave gets a line. A board that no program has brought to
/// SafeOP or OP is in PreOP. A real board that a program has brought to OP is shown in OP; --up brings the network to OP
/// first.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Read the identity of the slaves, by SDOs, from slave 1 to the first that does not answer
    #[arg(long)]
    scan: bool,
}

impl Args {
    /// Whether the step only reads reports, which is the case without `--scan`. It then sends no command, so it also
    /// works while another program sends commands.
    pub const fn only_looks(&self) -> bool {
        !self.scan
    }
}

/// The objects that identify a slave: device type (0x1000), and vendor, product and revision (0x1018).
const IDENTITY: [(&str, ObjectAddress); 4] = [
    ("device_type", ObjectAddress::new(0x1000, 0)),
    ("vendor_id", ObjectAddress::new(0x1018, 1)),
    ("product_code", ObjectAddress::new(0x1018, 2)),
    ("revision", ObjectAddress::new(0x1018, 3)),
];

impl Args {
    /// Prints what the reports show about the board, the link and the network; with `--scan` also the identity of the
    /// slaves.
    ///
    /// # Errors
    /// [`BoardError`] if the board does not answer, a signal stops the scan, or standard output cannot be written to.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        let snapshot = board.ecm.snapshot()?;
        let (mut text, mut json) = facts(board, &snapshot)?;
        if self.scan {
            board.ready("info --scan", Needs::Sdo)?;
            json["found"] = scan(board, &mut text)?.into();
        }
        Ok(board.reporter.result(text.trim_end(), &json)?)
    }
}

fn line(text: &mut String, name: &str, what: std::fmt::Arguments<'_>) {
    // Writing to a String does not fail.
    let _ = writeln!(text, "{name:<12}{what}");
}

fn facts(board: &Board, snapshot: &Snapshot) -> Result<(String, Value), BoardError> {
    let slot = board.ecm.slot_size()?;
    let (stats, link) = (board.ecm.stats()?, board.link_stats());
    let state = snapshot.state();
    let mut text = String::new();
    line(&mut text, "link", format_args!("{}", board.uri));
    line(&mut text, "slots", format_args!("of {} bytes, for up to {} slaves", slot.bytes(), slot.max_slaves()));
    let firmware = board.uri.scheme().is_model().then(|| board.uri.value("fw")).flatten();
    match firmware {
        Some(firmware) => line(&mut text, "firmware", format_args!("{firmware}, simulated")),
        None => line(&mut text, "firmware", format_args!("not known: the wire does not say")),
    }
    line(&mut text, "state", format_args!("{state}"));
    let why = board.why_failed(state);
    if let Some(why) = &why {
        line(&mut text, "", format_args!("{why}"));
    }
    match &board.config {
        Some(config) => line(&mut text, "network", format_args!("{}", list(config))),
        None => line(&mut text, "network", format_args!("not known: say it with --slaves, or ask with --scan")),
    }
    let fifo =
        (state.state() == Some(MasterState::Op)).then_some((snapshot.board.fifo_free, snapshot.board.full_count));
    match fifo {
        Some((free, full)) => {
            line(&mut text, "FIFO", format_args!("{free} of {FIFO_ENTRIES} entries free, full count {full}"))
        }
        None => line(&mut text, "FIFO", format_args!("in OP only")),
    }
    line(
        &mut text,
        "CRC errors",
        format_args!("{} of commands (byte 1), {} of reports", snapshot.board.error, stats.bad_crc),
    );
    let (lost, dropped) = (stats.reports_lost, link.reports_dropped);
    line(&mut text, "reports", format_args!("{} read, {lost} lost, {dropped} dropped by the link", stats.reports));
    let mut slaves = Vec::new();
    if fifo.is_some() {
        for number in 1..=snapshot.slaves() as u8 {
            let Some(slave) = snapshot.slave(number) else { continue };
            let (slave_values, mut json) = slave_values(board, number, &slave);
            json["slave"] = number.into();
            if let Some(slave) = config_of(board, number) {
                json["kind"] = slaves::word(slave.kind()).into();
            }
            line(&mut text, &format!("slave {number}"), format_args!("{slave_values}"));
            slaves.push(json);
        }
    }
    if fifo.is_none() {
        // Outside OP slaves report no values, but their kinds may be known.
        for (number, slave) in (1_u8..).zip(board.config.iter().flat_map(|config| &config.slaves)) {
            slaves.push(json!({"slave": number, "kind": slaves::word(slave.kind())}));
        }
    }
    let network = board.config.as_ref().map(list);
    let mut json = json!({
        "verb": "info", "link": board.uri.to_string(), "slot_bytes": slot.bytes(), "max_slaves": slot.max_slaves(),
        "firmware": firmware, "state": state.state().map(MasterState::name), "failed": state.is_failed(),
        "network": network, "fifo_free_entries": fifo.map(|(free, _)| free), "fifo_full_count": fifo.map(|(_, full)| full),
        "error_byte": snapshot.board.error, "reports": stats.reports, "reports_bad_crc": stats.bad_crc,
        "reports_lost": lost, "reports_dropped": dropped, "slaves": slaves,
    });
    if let Some(why) = why {
        json["why"] = why.into();
    }
    Ok((text, json))
}

fn config_of(board: &Board, number: u8) -> Option<&Slave> {
    board.config.as_ref()?.slaves.get(usize::from(number).checked_sub(1)?)
}

/// The values that a slave reports in OP, as text and as JSON.
fn slave_values(board: &Board, number: u8, slave: &SlaveView) -> (String, Value) {
    match slave {
        SlaveView::Drive(drive) => {
            let word = drive.statusword;
            let alarm = match drive.error_code {
                0 => String::new(),
                code => format!(", error code 0x{code:04X}: {}", error_name(code)),
            };
            let (position, units) = board.in_units(number, drive.position);
            let text = format!("{}, at {position}{alarm}", statusword_text(word));
            let mut json =
                json!({"statusword": word.0, "position_counts": drive.position, "error_code": drive.error_code});
            if let Some(units) = units {
                json["position"] = units.into();
            }
            (text, json)
        }
        SlaveView::Hsp(hsp) => {
            let positions = [hsp.first.position, hsp.second.position];
            let [first, second] = positions.map(|position| board.in_units(number, position));
            let text = format!("{}, at {} and {}", statusword_text(hsp.statusword), first.0, second.0);
            let mut json = json!({"statusword": hsp.statusword.0, "position_counts": positions});
            if let (Some(first), Some(second)) = (first.1, second.1) {
                json["position"] = json!([first, second]);
            }
            (text, json)
        }
        SlaveView::Io(_) => ("io, see `io`".to_owned(), json!({})),
    }
}

/// Reads the identities of the slaves in order, up to the first slave that does not answer.
fn scan(board: &Board, text: &mut String) -> Result<Vec<Value>, BoardError> {
    let mut found = Vec::new();
    for slave in 1..=board.ecm.slot_size()?.max_slaves() as u8 {
        let mut slave_values = Vec::new();
        let mut json = json!({"slave": slave});
        for (name, object) in IDENTITY {
            match board.run_interruptible("asking slaves", |ecm| ecm.sdo_read::<u32>(slave, object)) {
                Ok(value) => {
                    slave_values.push(format!("{} 0x{value:08X}", name.replace('_', " ")));
                    json[name] = value.into();
                }
                Err(BoardError::Ecm(EcmError::SdoAborted { code, .. })) if code != AbortCode::TIMEOUT => {}
                Err(BoardError::Ecm(EcmError::SdoAborted { .. } | EcmError::Timeout { .. })) => {
                    line(text, "found", format_args!("{}", counted(found.len(), "slave")));
                    return Ok(found);
                }
                Err(error) => return Err(error),
            }
        }
        line(text, &format!("slave {slave}"), format_args!("{}", slave_values.join(", ")));
        found.push(json);
    }
    line(text, "found", format_args!("{}", counted(found.len(), "slave")));
    Ok(found)
}
