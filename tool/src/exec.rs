//! `ecmsk exec`: runs an existing program with the library of this build.
//!
//! A program that is linked with NEXTWUSBLib finds the library by the dynamic linker. This verb makes a private
//! folder with nothing but this build's library in it and puts it first on `LD_LIBRARY_PATH`. On Windows, the
//! library's own folder is put first on `PATH`, which Windows searches after the program's folder. `ECMSK_LINK` tells
//! the library which board to open.

mod child;
mod clock;
mod library;
mod link;
mod reasons;

use std::ffi::{OsStr, OsString};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use clap::ValueHint;
use ecmsk::link::config::{ConfigError, LINK_VARIABLE, OPENED_VARIABLE};
use ecmsk::link::uri::{LinkUri, UriError};
use ecmsk::machine_file::{FILE_NAME, MachineFileError};
use ecmsk::summary::writer::FILE_VARIABLE;

use super::flight_option::{FlightArgs, FlightOptionError};
use super::stderr::say;
use super::{control_option, machine_option, record_option, recording_end};
use clock::ProgramClock;
use library::LibraryFolder;
pub use library::find as find_library;
use reasons::{ReasonReader, ReportMode};

/// Run an existing program on the library of this build
///
/// The program links NEXTWUSBLib; it is not changed. It gets this build's library and, with --link, the board named
/// there. Ctrl-C reaches the program alone. If the board did not do what the program wanted, standard error gives each
/// reason once while the program runs, and a summary at its end. On Windows a NEXTWUSBLib.dll beside the program comes
/// before all others: it has to be this build's.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk exec --link 'sim:?slaves=drive*2' -- ./program
  ecmsk exec --link 'sim:?slaves=drive*2' --record run.pcapng -- ./program --its-own-option
  ecmsk exec --link 'sim:?slaves=drive*2' --control press -- ./press
      meanwhile:  ecmsk fault press alarm 2 0x7500
  ecmsk exec --link 'sim:?slaves=drive*2' --clock virtual -- ./program_that_sleeps
  ecmsk exec --link usb: --flight flight --flight-bytes 4G -- ./program

Exit code: the program's, 128 + n if signal n ended it; 124 if it ended with 0 and what it recorded is not whole; 125 if it could not be started because of something else than
PROGRAM, 126 if PROGRAM cannot be executed, 127 if it is not found; 2 if the command line is wrong.")]
pub struct Args {
    /// Board for the program, see `ecmsk link help`; without it the library looks for its link as usual
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    /// Write every frame to this file, for `ecmsk dump`, `ecmsk plot` and Wireshark; without --link the link that the
    /// library finds is recorded
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    record: Option<PathBuf>,

    /// Replace an existing recording; without this option an existing file is an error, and the program is not started
    #[arg(long, requires = "record")]
    overwrite: bool,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    #[arg(long, value_name = "NAME", help = control_option::HELP)]
    control: Option<String>,

    /// Put the program's waits and clocks on the simulated board's virtual clock, so that it runs as fast as it can (Linux)
    #[arg(long, value_enum, value_name = "CLOCK")]
    clock: Option<ProgramClock>,

    #[command(flatten)]
    flight: FlightArgs,

    /// The library, or its folder [default: beside this tool, then ../lib, then its sub-folder of Debian's libraries,
    /// e.g. x86_64-linux-gnu]
    #[arg(long, value_name = "DIR|FILE", value_hint = ValueHint::AnyPath)]
    library: Option<PathBuf>,

    /// Print on standard error which variables are set for the program, and with --clock how long its waits were
    #[arg(short, long)]
    verbose: bool,

    /// Do not report what goes wrong, neither while the program runs nor at its end
    #[arg(short, long, conflicts_with = "json")]
    quiet: bool,

    /// Print the summary as one JSON object on standard error, and nothing while the program runs
    #[arg(long)]
    json: bool,

    /// The program and its arguments
    #[arg(required = true, trailing_var_arg = true, value_name = "PROGRAM", value_hint = ValueHint::CommandWithArguments)]
    program: Vec<OsString>,
}

/// Why `ecmsk exec` has not run the program.
#[derive(Debug, thiserror::Error)]
pub enum ExecError {
    /// The library is neither at the path of `--library` nor in one of the usual folders.
    #[error(
        "no {} in {}; build it with `cargo build -p NEXTWUSBLib`, or name it with --library", library::FILE_NAME, list(.looked_in)
    )]
    NoLibrary {
        /// The folders that were searched.
        looked_in: Vec<PathBuf>,
    },
    /// The file is not a shared library that the dynamic linker accepts.
    #[error("{} is no shared library ({reason}); name the {} of this build with --library", .file.display(), library::FILE_NAME)]
    NotALibrary {
        /// The path of the file that was found or that `--library` names.
        file: PathBuf,
        /// Why the file is not accepted as a library.
        reason: String,
    },
    /// The private folder for the library could not be created.
    #[error("cannot make a folder for the library in {}: {source}; set TMPDIR to a folder that takes files", .place.display())]
    Folder {
        /// The folder in which it was to be created.
        place: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// Another library with the same name is in the program's folder, where Windows looks first.
    #[cfg(windows)]
    #[error(
        "{} is not of this build, and Windows loads it before any other; keep it under another name, and copy {} to \
         its place",
        .beside.display(), .ours.display()
    )]
    Beside {
        /// The library in the program's folder.
        beside: PathBuf,
        /// The library of this build.
        ours: PathBuf,
    },
    /// The path of the private folder contains a character that the search path cannot contain.
    #[error("the dynamic linker cannot look into {}: {}", .folder.display(), library::UNLINKABLE)]
    UnlinkableFolder {
        /// The path of the private folder.
        folder: PathBuf,
    },
    /// `--clock virtual` with a link to a board that is not simulated.
    #[error(
        "--clock virtual takes a simulated board, and the link is `{link}`; name one with --link, e.g. sim:?slaves=drive*2"
    )]
    ClockOfHardware {
        /// The link that was to be opened.
        link: LinkUri,
    },
    /// The library for `--clock virtual` is not in the folder of NEXTWUSBLib.
    #[cfg(all(target_os = "linux", target_pointer_width = "64"))]
    #[error("no {} beside {}, which --clock virtual needs; build it with `cargo build -p ecmsk-sleep`", clock::FILE_NAME, .library.display())]
    NoSleepLibrary {
        /// The path of NEXTWUSBLib.
        library: PathBuf,
    },
    /// This system has no way to put the program's waits on another clock.
    #[cfg(not(all(target_os = "linux", target_pointer_width = "64")))]
    #[error(
        "--clock virtual is for programs of Linux with 64 bits; here give the link clock=virtual, which lets time pass by the program's calls"
    )]
    NoSuchClock,
    /// This build cannot open the link.
    #[error("link `{link}` is not in this build; {}", .link.scheme().instead())]
    NotInBuild {
        /// The link that was to be opened.
        link: LinkUri,
    },
    /// The recording of `--record` cannot be made.
    #[error(transparent)]
    Record(#[from] record_option::RecordError),
    /// The machine file cannot be used.
    #[error(transparent)]
    MachineFile(#[from] MachineFileError),
    /// The machine file of the working directory is another user's. The program would move axes without its limits.
    #[error(
        "{FILE_NAME} in this folder is another user's, and may have limits; say --machine {FILE_NAME} to use it, or --machine \
         none to run the program without its limits"
    )]
    LimitsOfAnother,
    /// The board gets no control socket.
    #[error(transparent)]
    Control(#[from] control_option::ControlOptionError),
    /// The flight recorder of `--flight` cannot be made.
    #[error(transparent)]
    Flight(#[from] FlightOptionError),
    /// The link that the library would choose is invalid.
    #[error(transparent)]
    Uri(#[from] UriError),
    /// `ECMSK_LINK` or a configuration file is invalid.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The program does not exist.
    #[error("{}: not found; {}", .program.display(), not_found_hint(.program))]
    NotFound {
        /// The path as the user gave it.
        program: PathBuf,
    },
    /// The program exists but cannot be started.
    #[error("{}: {source}; {hint}", .program.display())]
    NotExecutable {
        /// The path as the user gave it.
        program: PathBuf,
        /// The error of the operating system.
        source: io::Error,
        /// What the user can do next; the error text ends with it.
        hint: String,
    },
    /// A call of the operating system failed, other than starting the program or making the private folder.
    #[error("cannot {what}: {source}; free some of the system's processes or files, then run it again")]
    System {
        /// What the failed call was for, such as `catch signals`.
        what: &'static str,
        /// The error of the operating system.
        source: io::Error,
    },
}

impl ExecError {
    /// The exit code, as `env`, `nohup` and shells define it; a wrong link counts as a wrong command line.
    pub const fn code(&self) -> u8 {
        match self {
            Self::NotFound { .. } => 127,
            Self::NotExecutable { .. } => 126,
            Self::Uri(_)
            | Self::Record(record_option::RecordError::Uri(_))
            | Self::Control(_)
            | Self::NotInBuild { .. }
            | Self::ClockOfHardware { .. } => 2,
            Self::Flight(error) if error.is_wrong_command_line() => 2,
            _ => 125,
        }
    }
}

impl Args {
    fn report_mode(&self) -> ReportMode {
        match std::env::var_os("ECMSK_LOG").filter(|wanted| !wanted.is_empty()) {
            _ if self.quiet => ReportMode::Quiet,
            _ if self.json => ReportMode::Json,
            Some(_) => ReportMode::Summary,
            None => ReportMode::Words,
        }
    }
}

/// Runs the program and returns its exit code when it has ended.
pub fn run(args: &Args) -> Result<ExitCode, ExecError> {
    // clap requires at least one word, so there is a first one.
    let Some((program, arguments)) = args.program.split_first() else { unreachable!("PROGRAM is required") };
    let file = library::find(args.library.as_deref(), Some(Path::new(program)))?;
    if machine_option::passes_over(args.machine.as_deref()) {
        return Err(ExecError::LimitsOfAnother);
    }
    let machine = machine_option::load(args.machine.as_deref())?;
    let link = link::for_program(args, machine, Path::new(program), &file)?;
    if let Some(file) = &args.record {
        record_option::make_room(file, args.overwrite)?;
    }
    // The private folder is removed when this is dropped.
    let library = LibraryFolder::make(&file)?;
    let search_path = library.first_on(std::env::var_os(library::SEARCH_PATH).as_deref());

    let mut command = Command::new(program);
    command.args(arguments).env(library::SEARCH_PATH, &search_path).env(OPENED_VARIABLE, library.opened_file());
    let reasons = library.reasons_file()?;
    command.env(FILE_VARIABLE, &reasons);
    let reasons = ReasonReader::follow(&reasons, args.report_mode())
        .map_err(|source| ExecError::System { what: "read", source })?;
    if let Some(link) = &link {
        command.env(LINK_VARIABLE, link.to_string());
    }
    let sleeps = match args.clock {
        Some(ProgramClock::Virtual) => Some(clock::Preloaded::set(&mut command, &library)?),
        None => None,
    };
    if args.verbose {
        say("library", &library.library().display());
        say(library::SEARCH_PATH, &search_path.display());
        if let Some(link) = link.as_ref().map(LinkUri::to_string).or_else(|| std::env::var(LINK_VARIABLE).ok()) {
            say(LINK_VARIABLE, &link);
        }
    }
    let ended = child::run(&mut command, Path::new(program))?;
    let summary = reasons.end();
    if let Some(sleeps) = sleeps {
        sleeps.say(Path::new(program), args.verbose, library.opened_file().exists());
    }
    if args.verbose {
        say("program", &ended);
    }
    let has_opened = library.opened_file().exists();
    if !has_opened {
        say("note", &format_args!("{} has opened no board; {}", Path::new(program).display(), library::UNOPENED));
    }
    // Removes the private folder now: on Windows `child::end_as` may end the process without dropping values.
    drop(library);
    let not_made = args.record.as_ref().filter(|file| has_opened && !file.exists()).map(|file| {
        format!(
            "{} was not made: the program has opened no board, or another one than that of ECMSK_LINK",
            file.display()
        )
    });
    let not_whole = not_made.or_else(|| recording_end::not_whole(link.as_ref()));
    if let Some(what) = &not_whole {
        say("warning", what);
    }
    if ended.success() && (not_whole.is_some() || summary.is_some_and(|summary| summary.record_dropped() > 0)) {
        return Ok(ExitCode::from(recording_end::NOT_WHOLE));
    }
    Ok(child::end_as(ended))
}

fn list(folders: &[PathBuf]) -> String {
    folders.iter().map(|folder| folder.display().to_string()).collect::<Vec<_>>().join(" or ")
}

fn not_found_hint(program: &Path) -> String {
    let here = Path::new(".").join(program);
    match program.components().count() {
        1 if here.is_file() && program.as_os_str() != OsStr::new(".") => format!("write {}", here.display()),
        1 => "give its path, or put its folder on PATH".into(),
        _ if program.exists() => {
            "it is there, but its interpreter or dynamic linker is not: look at it with `file`".into()
        }
        _ => "check the path".into(),
    }
}
