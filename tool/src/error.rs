//! Errors of the verbs, their exit codes, and how they are shown.

use std::io;
use std::process::ExitCode;

use ecmsk::machine_file::MachineFileError;
use ecmsk::recording::RecordError;

use super::board::BoardError;
use super::bus::BusVerbError;
use super::machine::MachineVerbError;
use super::params::ParamsError;
use super::stderr::say;
use super::xf::XfVerbError;

/// Why the tool failed. Every text ends with the next step.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// Standard output cannot be written to.
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(#[from] io::Error),
    /// A recording cannot be read, or only in part.
    #[error(transparent)]
    Recording(#[from] RecordError),
    /// `ecmsk dump` stopped.
    #[error(transparent)]
    Dump(#[from] super::dump::DumpError),
    /// `ecmsk summary` has not written a file.
    #[error(transparent)]
    Summary(#[from] super::summary::SummaryError),
    /// `ecmsk find` has not looked for anything.
    #[error(transparent)]
    Find(#[from] super::find::FindError),
    /// `ecmsk plot` has made no plot.
    #[error(transparent)]
    Plot(#[from] super::plot::PlotError),
    /// A verb that talks to a board failed.
    #[error(transparent)]
    Board(#[from] super::board::BoardError),
    /// `ecmsk compare` could not compare two recordings.
    #[error(transparent)]
    Compare(#[from] super::compare::CompareVerbError),
    /// `ecmsk replay` could not replay a capture.
    #[error(transparent)]
    Replay(#[from] super::replay::ReplayVerbError),
    /// `ecmsk assert` could not judge a recording.
    #[error(transparent)]
    Assert(#[from] super::assert::AssertError),
    /// `ecmsk migrate` could not evaluate a recording.
    #[error(transparent)]
    Migrate(#[from] super::migrate::MigrateVerbError),
    /// A verb of `ecmsk recording` failed.
    #[error(transparent)]
    RecordingVerb(#[from] super::recording_files::RecordingVerbError),
    /// A verb of `ecmsk flight` failed.
    #[error(transparent)]
    FlightVerb(#[from] super::flight::FlightVerbError),
    /// A board gets no flight recorder.
    #[error(transparent)]
    Flight(#[from] super::flight_option::FlightOptionError),
    /// `ecmsk man` could not make a manual page.
    #[error(transparent)]
    Man(#[from] super::man::ManError),
    /// `ecmsk monitor` cannot show the board or the recording.
    #[error(transparent)]
    Monitor(#[from] super::monitor::MonitorError),
    /// `ecmsk doctor` has not written the udev rule.
    #[cfg(target_os = "linux")]
    #[error(transparent)]
    UdevRule(#[from] super::doctor::RuleError),
    /// `ecmsk doctor` has not packed its report.
    #[error(transparent)]
    Report(#[from] super::output_file::OutputFileError),
    /// `ecmsk doctor` cannot check the folder of a program.
    #[error(transparent)]
    Folder(#[from] super::doctor::FolderError),
    /// `ecmsk objects` has not made its file of objects.
    #[error(transparent)]
    Objects(#[from] super::objects::ObjectsError),
    /// `ecmsk params` has not kept, compared or written parameters.
    #[error(transparent)]
    Params(#[from] super::params::ParamsError),
    /// A verb of `ecmsk machine` failed.
    #[error(transparent)]
    Machine(#[from] super::machine::MachineVerbError),
    /// The machine file of a verb cannot be used.
    #[error(transparent)]
    MachineFile(#[from] MachineFileError),
    /// `ecmsk exec` has not run the program.
    #[error(transparent)]
    Exec(#[from] super::exec::ExecError),
    /// `ecmsk fault` has made nothing happen.
    #[error(transparent)]
    Fault(#[from] super::fault::FaultError),
    /// A board gets no control socket.
    #[error(transparent)]
    Control(#[from] super::control_option::ControlOptionError),
    /// The command line names no board to serve.
    #[error(
        "no board to serve was named: no --link, {} is not set, there is no {} and no link in {}; give one, e.g. --link \
         'sim:?slaves=drive*2', see `ecmsk link help`",
        ecmsk::link::config::LINK_VARIABLE,
        ecmsk::link::config::FILE_NAME,
        ecmsk::machine_file::FILE_NAME
    )]
    NothingToServe,
    /// `ecmsk slave` has not made its file.
    #[error(transparent)]
    Slave(#[from] super::slave::SlaveError),
    /// The board cannot be served over TCP.
    #[error(transparent)]
    Serve(#[from] ecmsk::port::tcp::ServeError),
    /// A server cannot be watched.
    #[error(transparent)]
    Watch(#[from] super::serve::watch::WatchError),
    /// The web page of a board or recording cannot be served.
    #[cfg(feature = "web")]
    #[error(transparent)]
    Web(#[from] super::serve::web::WebError),
    /// A verb of `ecmsk xf` failed.
    #[error(transparent)]
    Xf(#[from] super::xf::XfVerbError),
    /// `ecmsk wireshark` has not written its plugin.
    #[error(transparent)]
    Wireshark(#[from] super::wireshark::WiresharkError),
    /// A verb of `ecmsk bus` failed.
    #[error(transparent)]
    Bus(#[from] super::bus::BusVerbError),
    /// Boards cannot be served as USB devices over the network (USB/IP).
    #[error(transparent)]
    Usbip(#[from] ecmsk::port::usbip::ServeError),
    /// A chip cannot be served.
    #[error(transparent)]
    ServeXf(#[from] ecmsk::port::xf::ServeError),
    /// Simulated slaves cannot be served on a network card.
    #[cfg(target_os = "linux")]
    #[error(transparent)]
    ServeEthercat(#[from] ecmsk::port::ethercat::ServeError),
    /// A board cannot be served as a USB device of this machine (USB gadget).
    #[cfg(target_os = "linux")]
    #[error(transparent)]
    ServeGadget(#[from] ecmsk::port::gadget::ServeError),
}

impl CliError {
    /// Prints the error; returns the exit code.
    ///
    /// A reader that closes the pipe early (`ecmsk dump F | head`) is no failure, and nothing is printed then.
    pub fn report(&self) -> ExitCode {
        if let Self::Output(error)
        | Self::Board(BoardError::Output(error))
        | Self::Bus(BusVerbError::Output(error))
        | Self::Machine(MachineVerbError::Output(error))
        | Self::Params(ParamsError::Output(error))
        | Self::Xf(XfVerbError::Output(error)) = self
            && error.kind() == io::ErrorKind::BrokenPipe
        {
            return ExitCode::SUCCESS;
        }
        let code = self.code();
        if wants_json() {
            failed_in_json(&self.to_string(), code);
        } else {
            say("error", self);
        }
        ExitCode::from(code)
    }

    fn code(&self) -> u8 {
        match self {
            Self::Exec(error) => error.code(),
            Self::Find(error) => error.code(),
            Self::Params(error) => error.code(),
            Self::Machine(error) => error.code(),
            Self::Board(error) => error.code(),
            Self::Bus(error) => error.code(),
            Self::Xf(error) => error.code(),
            // The command line names no board, or an address at which other machines reach the server: as a wrong command line.
            Self::Flight(error) if error.is_wrong_command_line() => super::WRONG_COMMAND_LINE,
            #[cfg(feature = "web")]
            Self::Web(error) if error.is_wrong_command_line() => super::WRONG_COMMAND_LINE,
            Self::NothingToServe
            | Self::Control(_)
            | Self::Usbip(ecmsk::port::usbip::ServeError::NeedsTunnel { .. })
            | Self::ServeXf(ecmsk::port::xf::ServeError::NeedsTunnel { .. }) => super::WRONG_COMMAND_LINE,
            Self::Compare(_) | Self::Replay(_) | Self::Migrate(_) | Self::Assert(_) => super::compare::TROUBLE,
            _ => 1,
        }
    }
}

/// Whether the command line requests JSON, so that an error in the command line itself is printed as JSON too. Options after
/// `--` are not those of the tool, nor are those after the program of `exec`.
fn wants_json() -> bool {
    let mut words = std::env::args_os().skip(1).peekable();
    let is_exec = words.peek().is_some_and(|verb| verb == "exec");
    !is_exec && words.take_while(|word| word != "--").any(|word| word == "--json")
}

/// Prints an error as JSON, in the last line on standard error: `{"error": "..", "exit_code": 1}`. \[OURS]
fn failed_in_json(error: &str, code: u8) {
    super::stderr::line(&serde_json::json!({"error": error, "exit_code": code}).to_string());
}

/// Verbs that users may try and that this tool does not have, each with what to use instead.
const ELSEWHERE: &[(&str, &str)] = &[
    ("alarm", ALARMS),
    ("alarms", ALARMS),
    ("record", "`--record FILE`, which each verb has that talks to a board, and `record=FILE` of a link record"),
    ("reset", ALARMS),
    ("scan", "`ecmsk bus scan` lists the slaves of a network, `ecmsk info --scan` those of a board"),
    (
        "--slaves",
        "a network says itself which slaves it has; those of a simulated one are in its link: --link 'sim:?slaves=drive*2'",
    ),
];
const ALARMS: &str = "`ecmsk info` and `ecmsk monitor` show alarms, `ecmsk servo clear` resets them";

/// Ends the process because the command line is wrong, or requests help or the version. For an unknown verb the error
/// lists the existing ones.
pub fn wrong_command_line(mut error: clap::Error) -> ! {
    use clap::error::{ContextKind, ContextValue, ErrorKind};

    if matches!(error.kind(), ErrorKind::InvalidSubcommand | ErrorKind::UnknownArgument) {
        let written =
            [ContextKind::InvalidSubcommand, ContextKind::InvalidArg].into_iter().find_map(|of| error.get(of));
        let elsewhere = ELSEWHERE.iter().find(|(word, _)| written.is_some_and(|written| written.to_string() == *word));
        let there =
            verbs_there(std::env::args_os().skip(1)).map(|(verbs, names)| format!("`{verbs}` has the verbs {names}"));
        if let Some(told) = elsewhere.map(|(_, what)| (*what).to_owned()).or(there) {
            error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![told.into()]));
        }
    }
    if error.use_stderr() && wants_json() {
        let text = error.render().to_string();
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        failed_in_json(text.trim_start_matches("error: "), 2);
        std::process::exit(2);
    }
    error.exit()
}

/// How far the words of a command line name verbs: the command up to the last known verb, such as `ecmsk bus` for
/// `ecmsk bus other`, and a list of the verbs that may follow it, for the error. `None` if no verb may follow.
fn verbs_there(words: impl Iterator<Item = std::ffi::OsString>) -> Option<(String, String)> {
    let tool = <super::Cli as clap::CommandFactory>::command();
    let (mut at, mut name) = (&tool, tool.get_name().to_owned());
    for word in words {
        let Some(below) = at.find_subcommand(&word) else { break };
        at = below;
        name = format!("{name} {}", at.get_name());
    }
    let verbs: Vec<&str> =
        at.get_subcommands().filter(|verb| !verb.is_hide_set()).map(clap::Command::get_name).collect();
    (!verbs.is_empty()).then(|| (name, verbs.join(", ")))
}
