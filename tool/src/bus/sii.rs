//! `bus sii`: reads and writes the EEPROM of a slave.

use std::path::{Path, PathBuf};

use clap::{Subcommand, ValueHint};
use ecmsk::bus::eeprom::{self, ContentError, WordChange};
use serde_json::json;

use super::contents::{self, word_name};
use super::{BusVerbError, Session, SlaveArgs, read_file};
use crate::hex::hex;
use crate::output_file::{Kind, OutputFile, OverwriteOption, Replace};
use crate::signals;

/// Read or write the EEPROM of a slave (SII)
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk bus sii read 2 --link nic:eth1
  ecmsk bus sii read 2 --output slave2.bin --link nic:eth1
  ecmsk bus sii write 2 slave2.bin --link nic:eth1         # shows what would change
  ecmsk bus sii write 2 slave2.bin --yes --link nic:eth1"
)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Show the content of an EEPROM, and write it to a file
    Read {
        #[command(flatten)]
        whose: SlaveArgs,
        /// Write the EEPROM's bytes, up to the end of its categories, to this file
        #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
        output: Option<PathBuf>,
        #[command(flatten)]
        overwrite: OverwriteOption,
    },
    /// Write a file into an EEPROM: changes are shown, written and read back
    ///
    /// The file is checked first: its length, the checksum of its first words, its categories, and whether it is for this device.
    /// A slave takes the new content when it is switched off and on.
    Write {
        #[command(flatten)]
        whose: SlaveArgs,
        /// File with the new content, as `bus sii read --output` writes it
        #[arg(value_hint = ValueHint::FilePath)]
        file: PathBuf,
        /// Write the EEPROM; without this option the changes are only shown
        #[arg(long)]
        yes: bool,
        /// Write the file even if its vendor or product is not the slave's
        #[arg(long)]
        other_device: bool,
    },
}

/// Shows or writes the EEPROM of a slave.
///
/// # Errors
/// [`BusVerbError`] if the network does not open, if the file does not fit the slave, if the EEPROM cannot be read or
/// written, or if a file or standard output cannot be used.
pub fn run(args: &Args) -> Result<(), BusVerbError> {
    match &args.verb {
        Verb::Read { whose, output, overwrite } => read(whose, output.as_deref(), overwrite.replace()),
        Verb::Write { whose, file, yes, other_device } => write(whose, file, *yes, *other_device),
    }
}

fn read(whose: &SlaveArgs, output: Option<&Path>, replace: Replace) -> Result<(), BusVerbError> {
    let file = output.map(|file| OutputFile { file, option: "--output", kind: Kind::Eeprom, replace });
    file.map_or(Ok(()), |file| file.check())?;
    let (mut session, slave) = whose.open()?;
    let content = session.network.read_eeprom(slave)?;
    if let Some(file) = file {
        file.write(&content)?;
    }
    let mut json = contents::json(&content);
    json["verb"] = "bus sii read".into();
    json["slave"] = slave.into();
    json["bytes"] = hex(&content).into();
    json["file"] = output.map(|file| file.display().to_string()).into();
    session.reporter.result(contents::text(&content), &json)?;
    if let Some(file) = output {
        session.reporter.note(format_args!("{} bytes were written to {}", content.len(), file.display()));
    }
    Ok(())
}

/// \[OURS] The longest file that may be written: the size of the largest EEPROM that a 16-bit word address can reach.
const FILE_BYTES_MAX: usize = 2 << 16;

fn write(whose: &SlaveArgs, file: &Path, yes: bool, other_device: bool) -> Result<(), BusVerbError> {
    let fit = |error: ContentError| BusVerbError::Content { file: file.to_owned(), error };
    let content = read_file(file, FILE_BYTES_MAX)?;
    if content.len() > FILE_BYTES_MAX {
        return Err(fit(ContentError::Len { len: content.len() }));
    }
    eeprom::check(&content).map_err(fit)?;
    let (Session { mut network, reporter, .. }, slave) = whose.open()?;
    // An EEPROM that cannot be read counts as empty, so that it can be repaired. Then the file counts as one for this
    // device.
    let present = network.read_eeprom(slave).unwrap_or_default();
    match eeprom::check_for(&content, &present) {
        Err(ContentError::OtherDevice { .. }) if other_device => {}
        checked => checked.map_err(fit)?,
    }
    let changes = eeprom::changes(&mut *network, slave, &content)?;
    for WordChange { word, from, to } in &changes {
        let name = word_name(*word).map_or(String::new(), |name| format!("  {name}"));
        let text = format!("word 0x{word:04X}: 0x{from:04X} -> 0x{to:04X}{name}");
        let json = json!({
            "verb": "bus sii write", "slave": slave, "word": word, "from": from, "to": to, "name": word_name(*word),
        });
        reporter.result(text, &json)?;
    }
    if changes.is_empty() {
        reporter.note(format_args!("the EEPROM of slave {slave} has this content already"));
        return Ok(());
    }
    if !yes {
        return Err(BusVerbError::NotConfirmed);
    }
    // A half-written EEPROM makes a slave useless, so a signal must not end the program before everything is written.
    let _end_request = signals::EndRequest::watch()?;
    eeprom::write(&mut *network, slave, &changes, |_| ())?;
    let text = format!("slave {slave}: {} words written and read back; switch it off and on", changes.len());
    let json = json!({ "verb": "bus sii write", "slave": slave, "written_words": changes.len() });
    Ok(reporter.result(text, &json)?)
}
