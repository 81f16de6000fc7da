//! `io`: reads inputs and sets outputs of IO slaves and of the board itself.

use ecmsk::ecm::{Config, Slave};
use serde_json::json;

use crate::board::{Board, BoardError, Needs, find_slave, whole, wrong_kind};

const WHAT: &str = "io";

/// Read the inputs of an IO slave or of the board, or set outputs
///
/// An IO slave has 16 inputs and 16 outputs and needs OP; the board itself has six of each, in any state.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The IO slave's number, or local for the board itself
    #[arg(value_name = "SLAVE|local", value_parser = Side::parse)]
    side: Side,

    /// Set all outputs of the slave (16) or of the board (6): bit k is output k, from 0, e.g. 0x0003; they stay until they
    /// are set again
    #[arg(long, value_name = "BITS", value_parser = bits)]
    set: Option<u16>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Slave(u8),
    Local,
}

impl Side {
    fn parse(text: &str) -> Result<Self, String> {
        if text.eq_ignore_ascii_case("local") {
            return Ok(Self::Local);
        }
        let number = text.parse().ok().filter(|number| (1..=40).contains(number));
        number.map(Self::Slave).ok_or_else(|| "allowed: a slave from 1 to 40, or local".into())
    }
}

/// Parses the values of 16 inputs or outputs, one bit each.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn bits(text: &str) -> Result<u16, String> {
    let bits = whole(text).and_then(|number| u16::try_from(number).ok());
    bits.ok_or_else(|| "allowed: 0 to 0xFFFF".into())
}

impl Args {
    /// Checks the slave or the outputs before anything is sent.
    ///
    /// # Errors
    /// A slave is not an IO slave, or the board does not have these outputs.
    pub fn check(&self, network: &Config) -> Result<(), BoardError> {
        match self.side {
            Side::Slave(slave) => io_slave(network, WHAT, slave),
            Side::Local => self.local_bits().map(|_| ()),
        }
    }

    /// Reads the inputs or sets the outputs, and prints them.
    ///
    /// # Errors
    /// [`BoardError`] if the slave does not exist or is no IO slave, the bits do not fit, the network is not in OP for a
    /// slave, or the board does not answer.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        match self.side {
            Side::Slave(slave) => {
                board.ready(WHAT, Needs::Op)?;
                let (name, json) = (format!("slave {slave}"), json!({"verb": WHAT, "slave": slave}));
                let Some(bits) = self.set else {
                    let inputs = board.run_interruptible("reading inputs", |ecm| ecm.inputs(slave))?;
                    return say(board, &name, "inputs", json, inputs, 4);
                };
                board.run_interruptible("setting outputs", |ecm| ecm.set_outputs(slave, bits))?;
                say(board, &name, "outputs", json, bits, 4)
            }
            Side::Local => {
                let json = json!({"verb": WHAT, "slave": "local"});
                let Some(bits) = self.local_bits()? else {
                    let inputs = board.run_interruptible("reading inputs", |ecm| ecm.local_inputs())?;
                    return say(board, "board", "inputs", json, inputs.into(), 2);
                };
                board.run_interruptible("setting outputs", |ecm| ecm.set_local_outputs(bits))?;
                say(board, "board", "outputs", json, bits.into(), 2)
            }
        }
    }

    fn local_bits(&self) -> Result<Option<u8>, BoardError> {
        match self.set {
            None => Ok(None),
            Some(bits @ 0..=0x3F) => Ok(Some(bits as u8)),
            Some(bits) => Err(BoardError::Refused {
                what: WHAT.into(),
                why: format!("the board has six outputs, 0x{bits:X} is more"),
                next: "set 0x00 to 0x3F".into(),
            }),
        }
    }
}

/// Checks that the slave is an IO slave. `what` is the verb, for the error.
pub fn io_slave(network: &Config, what: &str, slave: u8) -> Result<(), BoardError> {
    match find_slave(network, what, slave)? {
        Slave::Io => Ok(()),
        other => Err(wrong_kind(what, slave, other, "an io slave")),
    }
}

fn say(
    board: &Board,
    name: &str,
    which: &str,
    mut json: serde_json::Value,
    bits: u16,
    digits: usize,
) -> Result<(), BoardError> {
    json[which] = bits.into();
    Ok(board.reporter.result(format_args!("{name}: {which} 0x{bits:0digits$X}"), &json)?)
}
