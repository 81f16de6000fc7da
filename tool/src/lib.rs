//! The tool `ecmsk`: it runs existing programs on the library of this build, commands boards and shows recordings. It is a
//! library only for `fuzz/`; programs use the package `ecmsk`.
//!
//! A new verb (subcommand) is a file, a variant of `Verb` and its line in `Verb::run`. A verb that scripts have too is a step
//! (`step.rs`). Files:
//!
//! - `lib.rs`: every verb with its arguments (`Verb`), exit codes
//! - `exec.rs`: `ecmsk exec`, with `exec/` for the library, the link and the signals of the program
//! - `fault.rs`: `ecmsk fault`, events on a simulated board that runs
//! - `dump.rs`, `plot.rs`, `compare.rs`, `replay.rs`, `summary.rs`, `assert.rs`, `find.rs`, `migrate.rs`: verbs that show
//!   recordings, each with a folder of its parts; `recording.rs` reads a recording, `filter.rs` selects frames and slots,
//!   `motion.rs` follows axes, `kind_list.rs` parses kinds of slaves
//! - `recording_files.rs`: `ecmsk recording`, what is in a recording and its export, in `recording_files/`
//! - `step.rs`: the verbs that talk to a board (`info`, `move` and others), in `step/`; `script.rs` and `shell.rs` run several
//!   of them; `board.rs` is the code that they share
//! - `monitor.rs`, `serve.rs`, `link.rs`, `objects.rs`, `slave.rs`, `list.rs`, `doctor.rs`, `completions.rs`, `man.rs`:
//!   one verb each; `image.rs` reads Windows programs for `doctor` and `exec`
//! - `stop.rs`: `ecmsk stop`, which stops the axes of whatever program moves them
//! - `flight.rs`: `ecmsk flight`, what a flight recorder has kept
//! - `params.rs`: `ecmsk params`, the parameters of drives, in `params/`
//! - `machine.rs`: `ecmsk machine`, the machine file, in `machine/`
//! - `bus.rs`: `ecmsk bus`, the look at any network, one file for each verb in `bus/`
//! - `xf.rs`: `ecmsk xf`, the verbs that talk to an ECM-XF, one file each in `xf/`
//! - `link_option.rs`, `machine_option.rs`, `record_option.rs`, `flight_option.rs`, `control_option.rs`, `slot_size.rs`: the
//!   options `--link`, `--machine`, `--record`, `--flight`, `--control` and `--slot-size`;
//!   `recording_end.rs` checks whether a recording is complete
//! - `web.rs`: the page of `plot -o run.html` and `serve web`, in `web/`; its own sources are in `tool/web/`
//! - `transfer.rs`, `hex.rs`: SDO values and bytes as text, for `bus` and `xf`
//! - `error.rs`, `output.rs`, `stderr.rs`, `streams.rs`: errors, and output that does not wait for whoever reads it;
//!   `output_file.rs`: files that verbs write; `visible.rs`: control characters in output; `markup.rs`, `junit.rs`: text in HTML and XML, results of tests; `signals/`: Ctrl-C
//! - `fuzzed.rs`: the functions that `fuzz/` calls

mod assert;
mod board;
mod bus;
mod compare;
mod completions;
mod control_option;
mod doctor;
mod dump;
mod error;
mod exec;
mod fault;
mod filter;
mod find;
mod flight;
mod flight_option;
#[doc(hidden)]
pub mod fuzzed;
mod hex;
mod image;
mod junit;
mod kind_list;
mod link;
mod link_option;
mod list;
mod lock;
mod machine;
mod machine_option;
mod man;
mod markup;
mod migrate;
mod monitor;
mod motion;
mod objects;
mod output;
mod output_file;
mod params;
mod plot;
mod record_option;
mod recording;
mod recording_end;
mod recording_files;
mod replay;
mod script;
mod serve;
mod shell;
mod signals;
mod slave;
mod slot_size;
mod stderr;
mod step;
mod stop;
mod streams;
mod summary;
mod transfer;
mod visible;
#[cfg(feature = "web")]
mod web;
mod wireshark;
mod xf;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use error::CliError;

/// Shown at the end of `ecmsk --help`. Scripts rely on these codes.
const EXIT_CODES: &str = "\
Exit codes:
  0    done (also when whoever read the output has closed it)
  1    failed; the last line on standard error says why and what to do, with --json as an object of `error` and `exit_code`
  2    the command line is wrong
  124  done, and the recording that was asked for (--record, record=, --flight, flight=) is not whole
  130  ended by Ctrl-C, 143 by SIGTERM: what moved came to a standstill first, unless a second one ended it at once;
       `serve`, which nothing else ends, has 0 then
  compare
       0 the recordings are equal, 1 they differ, 2 they could not be compared (as diff)
  replay
       0 the model answers as the board did, 1 otherwise, 2 it could not be replayed
  summary
       with --exit-code: 0 nothing went wrong, 1 something did, or the recording is not whole
  find 0 the condition became true, 1 it never did, 2 it could not be looked for (as grep)
  assert
       0 every rule is kept, 1 one is broken, 2 the run could not be judged
  migrate
       0 the program runs on an ECM-XF as it is, 1 it runs with differences or not, 2 it could not be said
  params diff
       0 the parameters are equal, 1 they differ, 2 they could not be compared (as diff)
  machine check
       0 nothing is wrong, 1 the network differs from the file, 2 it could not be compared
  stop 0 axes stand still, or the network is not in OP; 1 axes may still move
  params restore
       0 all were written and read back, 1 some were not
  bus errors, bus dc
       0 nothing is wrong, 1 a cable is bad, or clocks do not keep together
  list 0 if each board that was found on USB can be opened, or an SPI device if there is none
  doctor
       0 nothing is wrong, 1 something has to be put right
  exec the program's own code, or 128 + n if signal n ended it; of `ecmsk exec` itself:
       124 the program ended with 0, and its recording is not whole,
       125 not able to start anything, 126 PROGRAM cannot be executed, 127 PROGRAM not found";

/// The exit code for a command line that is wrong, as clap has it.
const WRONG_COMMAND_LINE: u8 = 2;

/// Tools for the ECM-SK, an EtherCAT master on a board, and for its software model.
#[derive(Parser)]
#[command(name = "ecmsk", bin_name = "ecmsk", version, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    Exec(exec::Args),
    Fault(fault::Args),
    Dump(dump::Args),
    Plot(plot::Args),
    Summary(summary::Args),
    Find(find::Args),
    Assert(assert::Args),
    #[command(flatten)]
    Step(step::Verb),
    Jog(step::OnBoard<step::jog::Args>),
    Stop(stop::Args),
    Run(script::Args),
    Shell(shell::Args),
    Compare(compare::Args),
    Replay(replay::Args),
    Recording(recording_files::Args),
    Flight(flight::Args),
    Migrate(migrate::Args),
    Monitor(monitor::Args),
    Link(link::Args),
    Objects(objects::Args),
    Params(params::Args),
    Machine(machine::Args),
    List(list::Args),
    Doctor(doctor::Args),
    Serve(serve::Args),
    Slave(slave::Args),
    Bus(bus::Args),
    Xf(xf::Args),
    Wireshark(wireshark::Args),
    Completions(completions::Args),
    Man(man::Args),
}

/// Runs the tool on the arguments of this process.
pub fn main() -> ExitCode {
    let cli = Cli::try_parse().unwrap_or_else(|error| error::wrong_command_line(error));
    env_logger::Builder::from_env(env_logger::Env::new().filter_or("ECMSK_LOG", "off"))
        .target(env_logger::Target::Pipe(Box::new(stderr::Log)))
        .init();
    let code = match cli.verb.run() {
        Ok(code) => code,
        Err(error) => error.report(),
    };
    match streams::finish() {
        Err(error) if code == ExitCode::SUCCESS => {
            let code = CliError::Output(error).report();
            streams::flush_error();
            code
        }
        _ => code,
    }
}

impl Verb {
    fn run(self) -> Result<ExitCode, CliError> {
        match self {
            Self::Exec(args) => Ok(exec::run(&args)?),
            Self::Fault(args) => fault::run(&args),
            Self::Dump(args) => dump::run(&args).map(|()| ExitCode::SUCCESS),
            Self::Summary(args) => summary::run(&args),
            Self::Find(args) => find::run(&args),
            Self::Assert(args) => assert::run(&args),
            Self::Plot(args) => plot::run(&args).map(|()| ExitCode::SUCCESS),
            Self::Step(verb) => Ok(step::run(verb).map(|()| ExitCode::SUCCESS)?),
            Self::Jog(args) => Ok(step::jog::run(args).map(|()| ExitCode::SUCCESS)?),
            Self::Stop(args) => Ok(stop::run(&args).map(|()| ExitCode::SUCCESS)?),
            Self::Run(args) => Ok(script::run(&args).map(|()| ExitCode::SUCCESS)?),
            Self::Shell(args) => Ok(shell::run(&args)?),
            Self::Compare(args) => Ok(compare::run(&args)?),
            Self::Replay(args) => Ok(replay::run(&args)?),
            Self::Recording(args) => recording_files::run(&args).map(|()| ExitCode::SUCCESS),
            Self::Flight(args) => flight::run(&args).map(|()| ExitCode::SUCCESS),
            Self::Migrate(args) => Ok(migrate::run(&args)?),
            Self::Monitor(args) => monitor::run(&args),
            Self::Link(args) => link::run(&args).map(|()| ExitCode::SUCCESS),
            Self::Objects(args) => objects::run(&args).map(|()| ExitCode::SUCCESS),
            Self::Params(args) => Ok(recording_end::of_opened(params::run(&args)?)),
            Self::Machine(args) => Ok(recording_end::of_opened(machine::run(&args)?)),
            Self::List(args) => list::run(&args),
            Self::Doctor(args) => doctor::run(&args),
            Self::Man(args) => man::run(&args).map(|()| ExitCode::SUCCESS),
            Self::Serve(args) => serve::run(&args),
            Self::Slave(args) => slave::run(&args),
            Self::Bus(args) => Ok(recording_end::of_opened(bus::run(&args)?)),
            Self::Xf(args) => Ok(xf::run(&args).map(|()| recording_end::of_opened(ExitCode::SUCCESS))?),
            Self::Wireshark(args) => wireshark::run(&args).map(|()| ExitCode::SUCCESS),
            Self::Completions(args) => completions::run(&args).map(|()| ExitCode::SUCCESS),
        }
    }
}
