//! `xf sdo`: reads and writes objects of slaves.

use clap::Subcommand;
use ecmsk::xf::EtherCatState;
use ecmsk::xf_api::XfError;

use super::session::{ChipArgs, Session};
use super::words::slave_number;
use super::{Shown, XfVerbError};
use crate::transfer::{SizeMismatch, Transfer, Written, WrongValue};

const READ: &str = "xf sdo read";
const WRITE: &str = "xf sdo write";

/// Read or write an object of a slave (SDO)
///
/// A network that is not up is initialised and brought to PreOP.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk xf sdo read 0 statusword
  ecmsk xf sdo read 0 0x1018 --complete
  ecmsk xf sdo write 0 0x6099:1 50000
  ecmsk xf sdo write 0 0x2100 hex:01020304"
)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Read an object
    Read(Which),
    /// Write an object
    Write {
        #[command(flatten)]
        which: Which,
        /// The value to write: decimal, or hexadecimal with 0x; or bytes as hex:0102FF, lowest byte first
        #[arg(value_name = "VALUE", allow_hyphen_values = true, value_parser = Written::parse)]
        value: Written,
    },
}

#[derive(Clone, clap::Args)]
pub struct Which {
    /// The slave, the first one is 0
    #[arg(value_name = "SLAVE", value_parser = slave_number)]
    pub slave: u8,
    #[command(flatten)]
    pub transfer: Transfer,
    #[command(flatten)]
    pub chip: ChipArgs,
}

impl Args {
    pub const fn chip(&self) -> &ChipArgs {
        match &self.verb {
            Verb::Read(which) | Verb::Write { which, .. } => &which.chip,
        }
    }

    /// Reads or writes the object.
    ///
    /// # Errors
    /// [`XfVerbError`] as for [`read`] and [`write()`].
    pub fn run(&self, session: &mut Session) -> Result<Vec<Shown>, XfVerbError> {
        match &self.verb {
            Verb::Read(which) => read(session, which),
            Verb::Write { which, value } => write(session, which, value),
        }
    }

    /// Checks the command line before the chip is opened.
    ///
    /// # Errors
    /// The type of the value is not known, or the value does not fit it.
    pub fn check(&self) -> Result<(), XfVerbError> {
        match &self.verb {
            Verb::Read(_) => Ok(()),
            Verb::Write { which, value } => encoded(which, value).map(|_| ()),
        }
    }
}

/// Reads the object, and returns its value.
///
/// # Errors
/// [`XfVerbError`] if the network is below PreOP, the slave does not exist or aborts the SDO, the length of the value
/// is not that of the type, or the chip does not answer.
pub fn read(session: &mut Session, which: &Which) -> Result<Vec<Shown>, XfVerbError> {
    session.join_or_start(EtherCatState::PreOp)?;
    session.expect_mailboxes(READ)?;
    let Which { slave, transfer, .. } = which;
    let (slave, object) = (*slave, transfer.object.address);
    let bytes = session.xf.sdo_read_bytes(slave, object, transfer.scope())?;
    let shown = transfer.read(READ, slave, &bytes);
    let size_mismatch = |SizeMismatch { found, wanted }| XfError::SdoSize { slave, object, found, wanted };
    Ok(vec![shown.map_err(size_mismatch)?])
}

/// Writes the value to the object.
///
/// # Errors
/// [`XfVerbError`] if the type of the value is not known or the value does not fit it, if the network is below PreOP,
/// if the slave does not exist or aborts the SDO, or if the chip does not answer.
pub fn write(session: &mut Session, which: &Which, value: &Written) -> Result<Vec<Shown>, XfVerbError> {
    let bytes = encoded(which, value)?;
    session.join_or_start(EtherCatState::PreOp)?;
    session.expect_mailboxes(WRITE)?;
    let Which { slave, transfer, .. } = which;
    session.xf.sdo_write_bytes(*slave, transfer.object.address, transfer.scope(), &bytes)?;
    Ok(vec![transfer.written(WRITE, *slave, value, &bytes)])
}

/// Converts the value to the bytes to write.
fn encoded(which: &Which, value: &Written) -> Result<Vec<u8>, XfVerbError> {
    let refused = |WrongValue { why, next }| XfVerbError::WrongRequest { what: WRITE.into(), why, next };
    which.transfer.encoded(WRITE, value).map_err(refused)
}
