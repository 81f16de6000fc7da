//! The board that a verb (a subcommand of the tool) works on: the options that all such verbs share, and their common code.
//! `session.rs` is the open board; `bring_up.rs`, `adopted.rs` and `interruptible.rs` are its long calls: bringing the network
//! up, checking a network that is already running, and waiting until Ctrl-C. `network.rs`, `slaves.rs` and `number.rs` parse
//! options and operands; `units.rs` writes positions in their units; `reporter.rs` prints results and progress, `question/`
//! asks at a terminal, `error.rs` has the errors, `interrupt.rs` the signals.

mod adopted;
mod axis_word;
mod bring_up;
mod error;
mod interrupt;
mod interruptible;
pub mod network;
mod number;
mod question;
mod reporter;
mod session;
mod slaves;
mod units;

use std::path::PathBuf;
use std::time::Duration;

use clap::ValueHint;
use ecmsk::ecm::{Close, Config, Guard, Scales};
use ecmsk::link::KnownNetwork;
use ecmsk::link::uri::LinkUri;
use ecmsk::machine_file::{FILE_NAME, MachineFile};
use ecmsk::sk::SlotSize;

pub use axis_word::{AxisWord, SLAVES_MAX, Units};
pub use bring_up::Needs;
pub use error::BoardError;
pub use interrupt::Interrupt;
pub use network::{find_axis, find_slave, list, slaves_with_axis, wrong_kind};
pub use number::{duration, not_negative, position, positive, whole};
pub use reporter::Reporter;
pub use session::{Board, BoardUse, NEAR_COUNTS, StepSource, in_mode, numbered, statusword_text};
pub use slaves::SlaveList;

use super::link_option::ChosenLink;
use super::machine_option::ServedFileError;
use super::{machine_option, record_option, slot_size};
use network::Network;

const HEADING: &str = "Board";

// No doc comment: clap would show it as the help of every verb.
#[derive(Clone, Debug, Default, clap::Args)]
#[group(skip)]
pub struct Args {
    /// Board to talk to, see `ecmsk link help` [default: ECMSK_LINK, else the one of machine.toml or ecmsk.toml, else
    /// usb:]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse, global = true, help_heading = HEADING)]
    pub link: Option<LinkUri>,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, global = true, help_heading = HEADING, help = machine_option::HELP)]
    pub machine: Option<PathBuf>,

    #[arg(long, value_name = "LIST", value_parser = Network::parse, global = true, help_heading = HEADING, help = network::help())]
    pub slaves: Option<Network>,

    /// Bring the network up as far as the verb needs: configure it, enter OP, switch on the axes that it moves
    #[arg(long, global = true, help_heading = HEADING)]
    up: bool,

    /// EtherCAT cycle, microseconds: 250, 500, 1000, 2000, 4000 .. [default: that of the machine file, else 1000]
    #[arg(long, value_name = "N", global = true, help_heading = HEADING)]
    pub cycle_us: Option<u32>,

    /// Bytes of a slot, 12 or 16 [default: what the link says, else the size with which the CRCs of reports are right]
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse, global = true, help_heading = HEADING)]
    pub slot_size: Option<SlotSize>,

    /// Former name of --slot-size
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse, global = true, hide = true, conflicts_with = "slot_size")]
    slot: Option<SlotSize>,

    /// Write every frame to this file, for `ecmsk dump`, `ecmsk plot` and Wireshark, as record= of a link does
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, global = true, help_heading = HEADING)]
    record: Option<PathBuf>,

    /// Replace an existing recording; without this option an existing file is an error, and nothing is done
    #[arg(long, requires = "record", global = true, help_heading = HEADING)]
    overwrite: bool,

    /// Timeout of every step, e.g. 10s or 500ms [default: SDOs 3s, servo and IO 5s, states 30s, homing 60s]
    #[arg(long, value_name = "TIME", value_parser = duration, global = true, help_heading = HEADING)]
    timeout: Option<Duration>,

    /// Refuse a move, before it begins, if its target is further than this from the axis's position: counts, or off
    /// [default: off]
    #[arg(long, value_name = "COUNTS|off", value_parser = network::guard, global = true, help_heading = HEADING)]
    guard: Option<Guard>,

    /// End a move if the target of a cycle is further than this ahead of the actual position, because the axis does not
    /// follow: counts, or off [default: 131072]
    #[arg(long, value_name = "COUNTS|off", value_parser = network::guard, global = true, help_heading = HEADING)]
    lead_limit: Option<Guard>,

    /// Counts per unit, for positions and speeds in mm or degrees of axes that are named by numbers: one number for all, or
    /// e.g. 1=5000,2=131072/360
    #[arg(long, value_name = "N", value_parser = Scales::parse, allow_hyphen_values = true, global = true, help_heading = HEADING)]
    pub counts_per_unit: Option<Scales>,

    /// What the axes do at the end: hold (stop and stay on), servo-off (stop and switch off), leave (change nothing). Behind
    /// nic:, xf-spi: and xf-usb: they are always off then [default: hold; leave for a verb that moves nothing]
    #[arg(long, value_name = "HOW", value_parser = close, global = true, help_heading = HEADING)]
    pub close: Option<Close>,

    /// Print one JSON object a line: results, and progress once a second
    #[arg(long, global = true, help_heading = HEADING)]
    pub json: bool,
}

impl Args {
    /// The options of a verb that has only some of them: those that `set` sets. The others have their defaults.
    pub fn with(set: impl FnOnce(&mut Self)) -> Self {
        let mut args = Self::default();
        set(&mut args);
        args
    }

    /// The machine file that `--machine` names, otherwise `machine.toml` in the working directory, otherwise that of
    /// the server of the link; `None` if there is none. Without `--machine`, a verb that moves no axes ignores the file
    /// of another user. A verb that switches axes also ignores a file that cannot be used.
    ///
    /// # Errors
    /// The file cannot be read, or its content is not that of a machine file. A verb that moves axes also fails if the
    /// file is another user's, or if the server does not give its file: it would move without the limits in that file.
    pub fn machine(&self, board_use: BoardUse) -> Result<Option<MachineFile>, BoardError> {
        if board_use == BoardUse::Moves && machine_option::passes_over(self.machine.as_deref()) {
            return Err(BoardError::Refused {
                what: "moving axes".into(),
                why: format!("{FILE_NAME} in this folder is another user's, and may have limits"),
                next: format!("say --machine {FILE_NAME} to use it, or --machine none to move without its limits"),
            });
        }
        let given = self.machine.as_deref();
        let loaded = match board_use {
            BoardUse::Switches => machine_option::load_or_pass_over(given)?,
            _ => machine_option::load(given)?,
        };
        if board_use != BoardUse::Moves || loaded.is_some() || given.is_some() {
            return Ok(machine_option::or_of_server(loaded, given, self.named_link()?.as_ref()));
        }
        machine_option::of_server(self.link.as_ref()).map_err(|error| match error {
            ServedFileError::Link(error) => error.into(),
            ServedFileError::File(error) => BoardError::Refused {
                what: "moving axes".into(),
                why: format!("the machine file of the server may have limits, and cannot be used: {error}"),
                next: "or say --machine none to move without its limits".into(),
            },
        })
    }

    /// The board that the options, the environment, the machine file or the configuration name.
    ///
    /// # Errors
    /// `ECMSK_LINK` or `ecmsk.toml` is invalid. The machine file may name the board, but cannot be used.
    pub fn chosen(&self, machine: Option<&MachineFile>) -> Result<ChosenLink, BoardError> {
        Ok(ChosenLink::find_with(self.named_link()?.as_ref(), machine)?)
    }

    /// The link of `--link`, otherwise the link in a machine file that is ignored because it cannot be used.
    fn named_link(&self) -> Result<Option<LinkUri>, BoardError> {
        if self.link.is_some() || self.machine.is_some() {
            return Ok(self.link.clone());
        }
        machine_option::link_passed_over().map_err(|error| BoardError::Refused {
            what: "finding the board".into(),
            why: format!("the machine file may name it, and cannot be used: {error}"),
            next: "or name the board with --link".into(),
        })
    }

    /// The slot size, if an option gives it.
    pub fn slot_size(&self) -> Option<SlotSize> {
        slot_size::given(self.slot_size, self.slot)
    }

    /// The link `uri`, with the recording of `--record` if the option is given. The recording also carries the machine
    /// file, unless that comes from the server.
    ///
    /// # Errors
    /// The recording cannot be made.
    pub fn with_record(&self, uri: &LinkUri, machine: Option<&MachineFile>) -> Result<LinkUri, BoardError> {
        match &self.record {
            None => Ok(uri.clone()),
            Some(file) => {
                let recorded = record_option::with_record(uri, file)?;
                record_option::make_room(file, self.overwrite)?;
                let machine = machine.filter(|machine| machine_option::is_on_disk(self.machine.as_deref(), machine));
                Ok(machine.map_or(recorded.clone(), |machine| recorded.with_axes(&machine.path.display().to_string())))
            }
        }
    }

    /// The configuration of the network, from the options, the machine file or the link; `known` is what the server of
    /// the link has reported about its slaves and units. `None` if the network is not known.
    pub fn network(
        &self,
        uri: &LinkUri,
        known: Option<&KnownNetwork>,
        machine: Option<&MachineFile>,
    ) -> Option<Config> {
        let network = self.slaves.clone().or_else(|| machine.map(Network::of_machine));
        let network = network.or_else(|| Network::of_link(uri));
        let network = network.or_else(|| Network::parse(&known?.slaves).ok())?;
        let scales = self.number_scales(known);
        let scale = |slave| {
            let axis = machine.and_then(|machine| machine.axis_of(slave)).map(|axis| axis.scale);
            let of_option = self.scales().filter(|scales| scales.has(slave)).map(|scales| scales.of(slave));
            of_option.or(axis).or_else(|| scales.as_ref().map(|scales| scales.of(slave)))
        };
        let cycle_us =
            self.cycle_us.or(machine.and_then(|machine| machine.cycle_us)).unwrap_or(Config::default().cycle_us);
        Some(network.config(cycle_us, self.lead_limit, scale))
    }

    /// The counts per unit for axes that are named by their slave numbers: from `--counts-per-unit`, otherwise from the
    /// server of the link; `None` if neither gives any.
    pub fn number_scales(&self, known: Option<&KnownNetwork>) -> Option<Scales> {
        self.counts_per_unit.clone().or_else(|| Scales::parse(&known?.counts_per_unit).ok())
    }

    /// The counts per unit of `--counts-per-unit`, without those that a server reports.
    pub const fn scales(&self) -> Option<&Scales> {
        self.counts_per_unit.as_ref()
    }
}

/// Checks a list of slaves that a server passes on to its clients as text, and returns the text unchanged.
///
/// # Errors
/// The text is invalid; the error says what is wrong and what is allowed.
pub fn slaves_words(text: &str) -> Result<String, String> {
    Network::parse(text).and_then(|_| checked_length(text))
}

/// Checks counts per unit that a server passes on to its clients as text, and returns the text unchanged.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn units_words(text: &str) -> Result<String, String> {
    Scales::parse(text).and_then(|_| checked_length(text))
}

/// Checks that a text fits into a message of the TCP server.
fn checked_length(text: &str) -> Result<String, String> {
    const TEXT_BYTES_MAX: usize = 256;
    if text.len() <= TEXT_BYTES_MAX {
        Ok(text.to_owned())
    } else {
        Err(format!("at most {TEXT_BYTES_MAX} bytes; write N in a row as *N"))
    }
}

fn close(text: &str) -> Result<Close, String> {
    match text {
        "hold" => Ok(Close::Hold),
        "servo-off" => Ok(Close::ServoOff),
        "leave" => Ok(Close::Leave),
        _ => Err("allowed: hold, servo-off, leave".into()),
    }
}
