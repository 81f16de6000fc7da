//! Steps: the verbs that talk to a board. They have the same syntax on the command line, in a script and in the shell. A new
//! step is a file of `step/`, a variant of [`Step`], and a row of `verbs!` if it is a verb of the command line as well and not
//! only a line of scripts.
//!
//! Files:
//!
//! - `line.rs`: a step from a line of a script
//! - `info.rs`, `state.rs`, `sdo.rs`, `io.rs`, `servo.rs`, `home.rs`, `wait.rs`, `expect.rs`, `fault.rs`: one step each
//! - `object.rs`: objects, types and values of `sdo`
//! - `motion.rs`, `motion/`, `profile.rs`: `move`: its targets, the straight path of all axes, and the motion profile along it
//! - `jog.rs`, `jog/`: `jog`, which is no step of a script, because it needs a hand
//! - `frames.rs`: the frames of a motion, which `move` and `jog` share

mod expect;
mod fault;
mod frames;
mod home;
mod info;
mod io;
pub mod jog;
mod line;
mod motion;
pub mod object;
mod profile;
mod sdo;
mod servo;
mod state;
mod wait;

use clap::Subcommand;
use ecmsk::ecm::Config;
pub use line::Line;
pub use state::parse as parse_state;

use super::board::{self, Board, BoardError, BoardUse, Interrupt, StepSource, Units};

/// One verb with its options.
#[derive(Clone, Debug, Subcommand)]
pub enum Step {
    Info(info::Args),
    State(state::Args),
    Sdo(sdo::Args),
    Io(io::Args),
    Servo(servo::Args),
    Home(home::Args),
    Move(motion::Args),
    Wait(wait::Args),
    Expect(expect::Args),
    Fault(fault::Args),
}

impl Step {
    /// How the step uses the board: whether it reads, sends commands, switches or moves axes.
    pub const fn uses(&self) -> BoardUse {
        match self {
            Self::Servo(_) => BoardUse::Switches,
            Self::Home(_) | Self::Move(_) => BoardUse::Moves,
            Self::Info(args) if args.only_looks() => BoardUse::Reads,
            Self::State(args) if args.only_looks() => BoardUse::Reads,
            _ => BoardUse::Looks,
        }
    }

    /// Checks the step before anything is sent. `units` are the scales and names of the axes.
    pub fn check(&self, network: Option<&Config>, units: Units<'_>) -> Result<(), BoardError> {
        if let Self::Move(args) = self {
            args.check_units(units)?;
        }
        let Some(network) = network else { return Ok(()) };
        match self {
            Self::Io(args) => args.check(network, units.machine),
            Self::Servo(args) => args.check(network, units),
            Self::Home(args) => args.check(network, units),
            Self::Move(args) => args.check(network, units),
            Self::Expect(args) => args.check(network, units),
            Self::Sdo(args) => args.check(units.machine),
            Self::Info(_) | Self::State(_) | Self::Wait(_) | Self::Fault(_) => Ok(()),
        }
    }

    /// Checks the step and runs it on the board.
    ///
    /// # Errors
    /// [`BoardError`] if the step is invalid on this network, fails, or is stopped by a signal.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        board.check_stop()?;
        self.check(board.config.as_ref(), board.units())?;
        match self {
            Self::Info(args) => args.run(board),
            Self::State(args) => args.run(board),
            Self::Sdo(args) => args.run(board),
            Self::Io(args) => args.run(board),
            Self::Servo(args) => args.run(board),
            Self::Home(args) => args.run(board),
            Self::Move(args) => args.run(board),
            Self::Wait(args) => args.run(board),
            Self::Expect(args) => args.run(board),
            Self::Fault(args) => args.run(board),
        }
    }
}

// A step as a verb of the command line, with the options of the board. No doc comment: clap would show it as the help
// of the verb.
#[derive(Debug, clap::Args)]
#[group(skip)]
pub struct OnBoard<T: clap::Args> {
    #[command(flatten)]
    pub step: T,
    #[command(flatten)]
    pub board: board::Args,
}

/// Defines the verbs of the command line that consist of one step.
macro_rules! verbs {
    ($($name:ident => $args:ty,)*) => {
        /// One step as a verb of the command line.
        #[derive(Debug, Subcommand)]
        pub enum Verb {
            $($name(OnBoard<$args>),)*
        }

        impl Verb {
            /// The step and the options of its board.
            pub fn split(self) -> (Step, board::Args) {
                match self {
                    $(Self::$name(OnBoard { step, board }) => (Step::$name(step), board),)*
                }
            }
        }
    };
}

verbs! {
    Info => info::Args,
    State => state::Args,
    Sdo => sdo::Args,
    Io => io::Args,
    Servo => servo::Args,
    Home => home::Args,
    Move => motion::Args,
}

/// Opens the board, runs the step, and closes the board.
///
/// # Errors
/// [`BoardError`] if the board cannot be opened, the step is invalid on this network or fails, or a signal stops it.
pub fn run(verb: Verb) -> Result<(), BoardError> {
    let (step, args) = verb.split();
    if let Step::Io(io) = &step {
        io.check_names(args.machine(step.uses())?.as_ref())?;
    }
    if let Step::Move(moves) = &step {
        let machine = args.machine(step.uses())?;
        moves.check_only_units(Units { option: args.scales(), numbers: args.scales(), machine: machine.as_ref() })?;
    }
    let board = Board::open(&args, step.uses(), StepSource::CommandLine, Interrupt::watch()?)?;
    let done = step.run(&board);
    board.close(done)
}
