//! `io`: reads inputs and sets outputs of IO slaves and of the board itself, by number or by the names of the machine
//! file.

use std::collections::BTreeMap;

use ecmsk::ecm::{Config, Slave};
use ecmsk::machine_file::{IoLine, MachineFile};
use serde_json::json;

use crate::board::{Board, BoardError, Needs, find_slave, whole, wrong_kind};

const WHAT: &str = "io";

/// Read the inputs of an IO slave or of the board, or set outputs
///
/// An IO slave has 16 inputs and 16 outputs and needs OP; the board itself has six of each, in any state.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The IO slave's number, or local for the board itself; or names of the machine file: an input to read, or an output to
    /// set, e.g. lamp=on gripper=off
    #[arg(value_name = "SLAVE|local|NAME[=on|off]", required = true, value_parser = Word::parse)]
    words: Vec<Word>,

    /// Set all outputs of the slave (16) or of the board (6): bit k is output k, from 0, e.g. 0x0003; they stay until they
    /// are set again
    #[arg(long, value_name = "BITS", value_parser = bits)]
    set: Option<u16>,

    /// Switch off the outputs with names that are not given; without it they keep what this script or shell has set
    #[arg(long, conflicts_with = "set")]
    others_off: bool,
}

/// The inputs or outputs that are read or set.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Word {
    Slave(u8),
    Local,
    /// An input or output by its name in the machine file. `on`: the new value of an output; `None` for an input.
    Line {
        name: String,
        on: Option<bool>,
    },
}

impl Word {
    fn parse(text: &str) -> Result<Self, String> {
        if text.eq_ignore_ascii_case("local") {
            return Ok(Self::Local);
        }
        if text.chars().next().is_some_and(char::is_alphabetic) {
            let (name, on) = named(text)?;
            return Ok(Self::Line { name: name.to_owned(), on });
        }
        let number = text.parse().ok().filter(|number| (1..=40).contains(number));
        number
            .map(Self::Slave)
            .ok_or_else(|| "allowed: a slave from 1 to 40, local, or names of the machine file".into())
    }
}

/// Splits `NAME=on` or `NAME=off`; the value is `None` for a name alone.
///
/// # Errors
/// The value is neither on nor off; the error says what is allowed.
pub fn named(text: &str) -> Result<(&str, Option<bool>), String> {
    let Some((name, value)) = text.split_once('=') else { return Ok((text.trim(), None)) };
    let on = match value.trim() {
        "on" | "1" => true,
        "off" | "0" => false,
        _ => return Err(format!("allowed: {}=on or {}=off", name.trim(), name.trim())),
    };
    Ok((name.trim(), Some(on)))
}

/// The input with this name.
///
/// # Errors
/// [`BoardError::Refused`] if there is no machine file, or it has no such input. `what` is the verb, for the error.
pub fn input<'m>(machine: Option<&'m MachineFile>, what: &str, name: &str) -> Result<&'m IoLine, BoardError> {
    let machine = with_file(machine, what, name)?;
    machine.input(name).ok_or_else(|| match machine.output(name) {
        Some(_) => refused(
            what,
            format!("`{name}` is an output, and a board does not tell which outputs are on"),
            format!("set it: io {name}=on"),
        ),
        None => no_line(machine, what, "input", name, &machine.inputs),
    })
}

fn output<'m>(machine: Option<&'m MachineFile>, name: &str) -> Result<&'m IoLine, BoardError> {
    let machine = with_file(machine, WHAT, name)?;
    machine.output(name).ok_or_else(|| match machine.input(name) {
        Some(_) => refused(WHAT, format!("`{name}` is an input, which cannot be set"), format!("read it: io {name}")),
        None => no_line(machine, WHAT, "output", name, &machine.outputs),
    })
}

fn with_file<'m>(machine: Option<&'m MachineFile>, what: &str, name: &str) -> Result<&'m MachineFile, BoardError> {
    machine.ok_or_else(|| {
        let why = format!("`{name}` is no slave from 1 to 40 and not local, and there is no machine file");
        refused(what, why, "name its slave, or say --machine FILE".into())
    })
}

fn no_line(machine: &MachineFile, what: &str, kind: &str, name: &str, lines: &[IoLine]) -> BoardError {
    let names: Vec<&str> = lines.iter().map(|line| &*line.name).collect();
    let there = if names.is_empty() { format!("no {kind}") } else { names.join(", ") };
    refused(what, format!("{} has no {kind} `{name}`", machine.path.display()), format!("it has {there}"))
}

fn refused(what: &str, why: String, next: String) -> BoardError {
    BoardError::Refused { what: what.to_owned(), why, next }
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
    /// Checks the names before the board is opened.
    ///
    /// # Errors
    /// There is no machine file, it has no such input or output, or names are mixed with slaves.
    pub fn check_names(&self, machine: Option<&MachineFile>) -> Result<(), BoardError> {
        if self.words.len() == 1 && !matches!(self.words[0], Word::Line { .. }) {
            return Ok(());
        }
        for word in &self.words {
            match word {
                Word::Line { name, on: Some(_) } => output(machine, name).map(|_| ())?,
                Word::Line { name, on: None } => input(machine, WHAT, name).map(|_| ())?,
                Word::Slave(_) | Word::Local => {
                    let why = "one slave, or inputs and outputs by their names, are read or set at a time".to_owned();
                    return Err(refused(WHAT, why, "use a command for each".into()));
                }
            }
        }
        if self.set.is_some() {
            return Err(refused(WHAT, "--set sets the outputs of a slave".into(), "write NAME=on or NAME=off".into()));
        }
        Ok(())
    }

    /// Checks the slaves, the names and the outputs before anything is sent.
    ///
    /// # Errors
    /// A slave is not an IO slave, the board does not have these outputs, or the errors of [`Self::check_names`].
    pub fn check(&self, network: &Config, machine: Option<&MachineFile>) -> Result<(), BoardError> {
        self.check_names(machine)?;
        self.words.iter().try_for_each(|word| match word {
            Word::Slave(slave) => io_slave(network, WHAT, *slave),
            Word::Local => self.local_bits().map(|_| ()),
            Word::Line { name, on: Some(_) } => io_slave(network, WHAT, output(machine, name)?.slave),
            Word::Line { name, on: None } => io_slave(network, WHAT, input(machine, WHAT, name)?.slave),
        })
    }

    /// Reads the inputs or sets the outputs, and prints their values.
    ///
    /// # Errors
    /// [`BoardError`] if the slave does not exist or is no IO slave, if the bits do not fit, if the network is not in
    /// OP (for a slave), or if the board does not answer.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        match self.words[..] {
            [Word::Slave(slave)] => {
                board.ready(WHAT, Needs::Op)?;
                let (name, json) = (format!("slave {slave}"), json!({"verb": WHAT, "slave": slave}));
                let Some(bits) = self.set else {
                    let inputs = board.run_interruptible("reading inputs", |ecm| ecm.inputs(slave))?;
                    return say(board, &name, "inputs", json, inputs, 4);
                };
                set(board, slave, bits)?;
                say(board, &name, "outputs", json, bits, 4)
            }
            [Word::Local] => {
                let json = json!({"verb": WHAT, "slave": "local"});
                let Some(bits) = self.local_bits()? else {
                    let inputs = board.run_interruptible("reading inputs", |ecm| ecm.local_inputs())?;
                    return say(board, "board", "inputs", json, inputs.into(), 2);
                };
                board.run_interruptible("setting outputs", |ecm| ecm.set_local_outputs(bits))?;
                say(board, "board", "outputs", json, bits.into(), 2)
            }
            _ => self.run_named(board),
        }
    }

    /// Sets the outputs and reads the inputs that are given by name; prints a line for each.
    fn run_named(&self, board: &Board) -> Result<(), BoardError> {
        let machine = board.machine.as_ref();
        self.check_names(machine)?;
        let mut wanted: BTreeMap<u8, Vec<(&IoLine, bool)>> = BTreeMap::new();
        for word in &self.words {
            if let Word::Line { name, on: Some(on) } = word {
                let line = output(machine, name)?;
                wanted.entry(line.slave).or_default().push((line, *on));
            }
        }
        let bits = wanted.iter().map(|(slave, lines)| Ok((*slave, self.outputs(board, *slave, lines)?)));
        let bits: Vec<(u8, u16)> = bits.collect::<Result<_, BoardError>>()?;
        board.ready(WHAT, Needs::Op)?;
        for (slave, bits) in bits {
            set(board, slave, bits)?;
        }
        for word in &self.words {
            let Word::Line { name, on } = word else { continue };
            let (line, which, on) = match on {
                Some(on) => (output(machine, name)?, "output", *on),
                None => {
                    let line = input(machine, WHAT, name)?;
                    let inputs = board.run_interruptible("reading inputs", |ecm| ecm.inputs(line.slave))?;
                    (line, "input", inputs >> line.bit & 1 == 1)
                }
            };
            let IoLine { name, slave, bit } = line;
            let json = json!({"verb": WHAT, "name": name, "slave": slave, which: bit, "on": on});
            let on = if on { "on" } else { "off" };
            board.reporter.result(format_args!("{name}: {on} (slave {slave}, {which} {bit})"), &json)?;
        }
        Ok(())
    }

    /// The values of all outputs of a slave with those of `lines` set. The other outputs keep the values that this
    /// process has set.
    ///
    /// # Errors
    /// This process has not set the other outputs of the slave, and some of them have names. Their values are unknown,
    /// since a board does not report its outputs.
    fn outputs(&self, board: &Board, slave: u8, lines: &[(&IoLine, bool)]) -> Result<u16, BoardError> {
        let with_names = board.machine.iter().flat_map(|machine| &machine.outputs).filter(|line| line.slave == slave);
        let others: Vec<&IoLine> =
            with_names.filter(|line| !lines.iter().any(|(given, _)| given.name == line.name)).collect();
        let mut bits = match board.outputs(slave) {
            Some(bits) => bits,
            None if others.is_empty() || self.others_off => 0,
            None => {
                let names: Vec<&str> = others.iter().map(|line| &*line.name).collect();
                let why = format!(
                    "a board does not tell which outputs are on, and slave {slave} has others: {}",
                    names.join(", ")
                );
                return Err(refused(WHAT, why, "give those too, or say --others-off".into()));
            }
        };
        if self.others_off {
            others.iter().for_each(|line| bits &= !(1 << line.bit));
        }
        for (line, on) in lines {
            bits = if *on { bits | 1 << line.bit } else { bits & !(1 << line.bit) };
        }
        Ok(bits)
    }

    fn local_bits(&self) -> Result<Option<u8>, BoardError> {
        match self.set {
            None => Ok(None),
            Some(bits @ 0..=0x3F) => Ok(Some(bits as u8)),
            Some(bits) => {
                let why = format!("the board has six outputs, 0x{bits:X} is more");
                Err(refused(WHAT, why, "set 0x00 to 0x3F".into()))
            }
        }
    }
}

/// Sets all outputs of a slave.
fn set(board: &Board, slave: u8, bits: u16) -> Result<(), BoardError> {
    board.run_interruptible("setting outputs", |ecm| ecm.set_outputs(slave, bits))?;
    board.note_outputs(slave, bits);
    Ok(())
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
