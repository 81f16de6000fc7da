//! `xf info`: shows what the chip reports about itself.

use std::fmt::Write;

use ecmsk::link::chip::ChipLink;
use ecmsk::xf::host::HostCounters;
use ecmsk::xf::request::{
    Fifo, FifoGetRxCount, FifoGetTxCount, FifoPackSizeGet, InterruptGetEnable, PdoWorkingCounterGet, Polarity,
    SlaveCountGet, WkcErrorCountGet, WkcErrorMaxGet, WorkingCounterItem,
};
use ecmsk::xf::{CheckType, Errors};
use serde_json::{Map, Value, json};

use super::error::unless_refused;
use super::session::{ChipArgs, Session};
use super::words::{listed, state_name, state_text, word, words};
use super::{Shown, XfVerbError};
use crate::output::counted;

/// Show the chip: firmware, packets, FIFOs, errors, interrupts, and the driver's counters
///
/// Nothing is changed except errors that the chip has stored: reading clears them. If the link does not give the size
/// of packets, looking for it makes the chip count one or two wrong packets.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub chip: ChipArgs,
}

/// Reads the chip's identity, settings, network, FIFOs, errors, interrupts and counters.
///
/// # Errors
/// [`XfVerbError`] if the chip does not answer or refuses a command.
pub fn info(session: &mut Session) -> Result<Vec<Shown>, XfVerbError> {
    let mut page = Page::default();
    identity(session, &mut page);
    packets(session, &mut page);
    network(session, &mut page)?;
    fifos(session, &mut page)?;
    errors(session, &mut page);
    interrupts(session, &mut page)?;
    counters(session, &mut page);
    page.json.insert("verb".into(), "xf info".into());
    Ok(vec![(page.text.trim_end().to_owned(), Value::Object(page.json))])
}

/// The output of `xf info`, as lines of text and as a JSON object.
#[derive(Default)]
struct Page {
    text: String,
    json: Map<String, Value>,
}

impl Page {
    fn line(&mut self, name: &str, what: impl std::fmt::Display) {
        // Writing to a String does not fail.
        let _ = writeln!(self.text, "{name:<16}{what}");
    }

    fn set(&mut self, key: &str, value: impl Into<Value>) {
        self.json.insert(key.to_owned(), value.into());
    }
}

fn identity(session: &Session, page: &mut Page) {
    page.line("link", &session.link);
    page.set("link", session.link.as_str());
    let Some(version) = session.xf.host().version() else { return };
    page.set("firmware", version.version);
    let Some(identity) = version.identity else {
        page.line("firmware", format_args!("0x{:02X}, which says no more of itself", version.version));
        return;
    };
    let (extended, series) = (identity.extended, identity.series.0);
    let identification: String = identity.identification.iter().map(|byte| format!("{byte:02X}")).collect();
    page.line("firmware", format_args!("0x{:02X}, extended version 0x{extended:04X}", version.version));
    page.line("series", format_args!("{series} (the manual gives the chips no numbers)"));
    page.line("identification", &identification);
    page.set("extended_version", extended);
    page.set("series", series);
    page.set("identification", identification);
}

fn packets(session: &Session, page: &mut Page) {
    let n = session.xf.host().size().bytes();
    let check = match session.xf.header().status.check_type() {
        Ok(CheckType::Crc32) => "CRC-32",
        Ok(CheckType::Fixed) => "fixed",
        Err(_) => "undefined",
    };
    let fixed = if session.xf.link().info().size.is_some() { " and no other" } else { "" };
    page.line("packets", format_args!("{n} bytes of data (n){fixed}, check word {check}"));
    page.set("data_bytes", n);
    page.set("check_word", check);
}

fn network(session: &mut Session, page: &mut Page) -> Result<(), XfVerbError> {
    let header = session.xf.header();
    let slaves = session.xf.run(&SlaveCountGet)?;
    page.line("state", format_args!("{}, {}", state_text(header.state), counted(slaves, "slave")));
    page.set("state", header.state.state().map(state_name));
    page.set("failed", header.state.has_error());
    page.set("slaves", slaves);
    let status = words(header.status.names());
    page.line("status", listed(&status));
    page.set("status", status);

    let mut item = |which| unless_refused(session.xf.run(&PdoWorkingCounterGet { which }));
    let inputs = item(WorkingCounterItem::Inputs)?;
    let outputs = item(WorkingCounterItem::Outputs)?;
    let counter = item(WorkingCounterItem::Counter)?;
    let in_row = unless_refused(session.xf.run(&WkcErrorCountGet))?;
    let limit = unless_refused(session.xf.run(&WkcErrorMaxGet))?;
    let number = |number: Option<u32>| number.map_or("not known".to_owned(), |number| number.to_string());
    let limit_text = match limit.map(|limit| limit.most()) {
        None => "limit not known".to_owned(),
        Some(None) => "no limit".to_owned(),
        Some(Some(most)) => format!("limit {most}"),
    };
    let (inputs_text, outputs_text) = (number(inputs), number(outputs));
    page.line(
        "working counter",
        format_args!("{}; slaves with inputs {inputs_text}, with outputs {outputs_text}", number(counter)),
    );
    let in_row_text = number(in_row.map(u32::from));
    page.line("", format_args!("wrong {} times, {in_row_text} in a row ({limit_text})", header.wkc_errors));
    page.set("working_counter", counter);
    page.set("slaves_with_inputs", inputs);
    page.set("slaves_with_outputs", outputs);
    page.set("working_counter_errors", header.wkc_errors);
    page.set("working_counter_errors_in_a_row", in_row);
    page.set("working_counter_errors_limit", limit.and_then(|limit| limit.most()));
    Ok(())
}

fn fifos(session: &mut Session, page: &mut Page) -> Result<(), XfVerbError> {
    let header = session.xf.header();
    let entries = (session.xf.run(&FifoGetRxCount)?, session.xf.run(&FifoGetTxCount)?);
    let mut bytes = |fifo| unless_refused(session.xf.run(&FifoPackSizeGet { fifo }));
    let bytes = (bytes(Fifo::Rx)?, bytes(Fifo::Tx)?);
    let fifos =
        [("RxFIFO", "rx", header.rx_fifo, entries.0, bytes.0), ("TxFIFO", "tx", header.tx_fifo, entries.1, bytes.1)];
    for (name, key, level, entries, bytes) in fifos {
        let size = bytes.map_or("of unknown size".to_owned(), |bytes| format!("of {bytes} bytes"));
        page.line(name, format_args!("{level} of {entries} entries {size}"));
        page.set(&format!("{key}_fifo_level"), level);
        page.set(&format!("{key}_fifo_entries"), entries);
        page.set(&format!("{key}_pdo_bytes"), bytes);
    }
    Ok(())
}

fn errors(session: &Session, page: &mut Page) {
    let found = session.found;
    let (errors, levels) = (Errors(found.errors.0 & Errors::ALL.0), found.errors.without(Errors::ALL));
    let (errors, levels) = (words(errors.names()), words(levels.names()));
    let searched = session.xf.host().counters().searches > 0;
    let own = if searched && !errors.is_empty() { " (of spi and crc some are of the search for packets)" } else { "" };
    page.line("errors", format_args!("{}{own}", listed(&errors)));
    page.line("levels", listed(&levels));
    page.line("CRC errors", found.crc_errors);
    page.set("errors", errors);
    page.set("levels", levels);
    page.set("crc_errors", found.crc_errors);
    page.set("packets_searched", searched);
}

fn interrupts(session: &mut Session, page: &mut Page) -> Result<(), XfVerbError> {
    let header = session.xf.header();
    let enabled = session.xf.run(&InterruptGetEnable)?;
    let int1 = session.xf.link_mut().int1().map_err(ecmsk::xf_api::XfError::Link)?;
    let flags = words(header.interrupts.names());
    let mut sources = words(enabled.sources.names());
    sources.extend((0..8).filter(|pin| enabled.gpio >> pin & 1 == 1).map(|pin| format!("gpio-{pin}")));
    sources.extend(words(enabled.peripherals.names()));
    let level = |bit| if enabled.polarity.contains(bit) { "high" } else { "low" };
    let (int0_active, int1_active) = (level(Polarity::INT0_HIGH), level(Polarity::INT1_HIGH));
    page.line("interrupts", format_args!("{}; GPIO 0x{:04X}", listed(&flags), header.gpio_interrupts));
    page.line("raise INT1", listed(&sources));
    let wired = match int1 {
        Some(true) => "high now",
        Some(false) => "low now",
        None => "not wired",
    };
    page.line("lines", format_args!("INT0 active {int0_active}, INT1 active {int1_active}, {wired}"));
    page.line("GPIO inputs", format_args!("0x{:04X}", header.gpio_inputs));
    page.set("interrupts", flags);
    page.set("gpio_interrupts", header.gpio_interrupts);
    page.set("int1_sources", sources);
    page.set("int0_active", int0_active);
    page.set("int1_active", int1_active);
    page.set("int1_is_high", int1);
    page.set("gpio_inputs", header.gpio_inputs);
    Ok(())
}

fn counters(session: &Session, page: &mut Page) {
    let counters = named(session.xf.host().counters());
    let text = |(name, count): &(&str, u64)| format!("{} {count}", word(name).replace('-', " "));
    let counted: Vec<String> = counters.iter().filter(|(_, count)| *count > 0).map(text).collect();
    page.line("driver", listed(&counted));
    let counters: Map<String, Value> =
        counters.iter().map(|(name, count)| ((*name).to_owned(), json!(count))).collect();
    page.set("driver", counters);
}

/// All counters of the driver on this PC, each with its name.
fn named(counters: HostCounters) -> Vec<(&'static str, u64)> {
    macro_rules! all {
        ($($name:ident)*) => {{
            // All fields are listed here, so that a new counter that is missing is a compile error.
            let HostCounters { $($name,)* } = counters;
            vec![$((stringify!($name), $name),)*]
        }};
    }
    all! {
        exchanges answers damaged not_ready nops stray repeated rejected asked_again answers_lost searches chip_resets
        int0_missed rx_written rx_full rx_dropped rx_unknown tx_lost reports_overwritten
    }
}
