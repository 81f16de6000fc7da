//! `bus foe`: reads and writes files of a slave by FoE.

use std::io::{self, IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};

use clap::{Subcommand, ValueHint};
use serde_json::json;

use super::{BusVerbError, SlaveArgs, read_file};
use crate::output_file::{Kind, OutputFile, OverwriteOption, Replace};

/// Read or write a file of a slave (FoE, in PreOP)
///
/// A slave that takes firmware only in bootstrap (BOOT) refuses it here: use the tool of its maker for that.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk bus foe read 1 parameters.txt --output parameters.txt --link nic:eth1
  ecmsk bus foe write 1 parameters.txt --link nic:eth1"
)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Read a file from a slave
    Read {
        #[command(flatten)]
        whose: Whose,
        /// Name of the file in the slave
        name: String,
        /// File of this machine to which the slave's file is written [default: standard output]
        #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
        output: Option<PathBuf>,
        #[command(flatten)]
        overwrite: OverwriteOption,
    },
    /// Write a file to a slave
    Write {
        #[command(flatten)]
        whose: Whose,
        /// File of this machine that is written to the slave
        #[arg(value_hint = ValueHint::FilePath)]
        file: PathBuf,
        /// Name of the file in the slave [default: the name of FILE, without folders]
        #[arg(long, value_name = "NAME")]
        name: Option<String>,
    },
}

#[derive(clap::Args)]
struct Whose {
    #[command(flatten)]
    of: SlaveArgs,
    /// Password that the slave asks for, a number
    #[arg(long, value_name = "N", default_value_t = 0)]
    password: u32,
}

/// Reads a file of a slave or writes one.
///
/// # Errors
/// [`BusVerbError`] if the command line is wrong, if the network does not open, if the slave refuses the file, or if a
/// file or standard output cannot be used.
pub fn run(args: &Args) -> Result<(), BusVerbError> {
    match &args.verb {
        Verb::Read { whose, name, output, overwrite } => read(whose, name, output.as_deref(), overwrite.replace()),
        Verb::Write { whose, file, name } => write(whose, file, name.as_deref()),
    }
}

fn read(whose: &Whose, name: &str, output: Option<&Path>, replace: Replace) -> Result<(), BusVerbError> {
    if output.is_none() && io::stdout().is_terminal() {
        let (why, next) = ("a file may be bytes, not for a terminal".into(), "name a file with --output".into());
        return Err(BusVerbError::WrongRequest { what: "bus foe read", why, next });
    }
    let output = output.map(|file| OutputFile { file, option: "--output", kind: Kind::Any, replace });
    output.map_or(Ok(()), |output| output.check())?;
    let (mut session, slave) = whose.of.open()?;
    let content = session.network.read_file(slave, name, whose.password)?;
    let Some(output) = output else {
        let mut out = io::stdout().lock();
        out.write_all(&content)?;
        return Ok(out.flush()?);
    };
    output.write(&content)?;
    let file = output.file;
    let text = format!("{} bytes of {name} written to {}", content.len(), file.display());
    let json = json!({
        "verb": "bus foe read", "slave": slave, "name": name, "bytes": content.len(), "file": file.display().to_string(),
    });
    Ok(session.reporter.result(text, &json)?)
}

/// \[OURS] The longest file that may be written to a slave, in bytes.
const FILE_BYTES_MAX: usize = 64 << 20;

fn write(whose: &Whose, file: &Path, name: Option<&str>) -> Result<(), BusVerbError> {
    let content = read_file(file, FILE_BYTES_MAX)?;
    if content.len() > FILE_BYTES_MAX {
        let why = format!("{} has more than {} MB", file.display(), FILE_BYTES_MAX >> 20);
        return Err(BusVerbError::WrongRequest { what: "bus foe write", why, next: "name another file".into() });
    }
    let own = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let name = name.unwrap_or(&own);
    let (mut session, slave) = whose.of.open()?;
    session.network.write_file(slave, name, whose.password, &content)?;
    let text = format!("slave {slave}: {name} written, {} bytes", content.len());
    let json = json!({ "verb": "bus foe write", "slave": slave, "name": name, "bytes": content.len() });
    Ok(session.reporter.result(text, &json)?)
}
