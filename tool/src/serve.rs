//! `ecmsk serve`: makes a board, a chip or slaves available to other processes and machines.

#[cfg(target_os = "linux")]
mod ethercat;
#[cfg(target_os = "linux")]
mod gadget;
#[cfg_attr(not(feature = "web"), allow(dead_code, reason = "the page needs more of it"))]
mod http;
mod http_server;
#[cfg_attr(not(feature = "web"), allow(dead_code, reason = "the page needs more of it"))]
mod http_stream;
mod service_manager;
mod usbip;
pub mod watch;
#[cfg(feature = "web")]
pub mod web;
mod xf;

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use clap::{Subcommand, ValueEnum, ValueHint};
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{KnownNetwork, LinkInfo, tcp::Secret};
use ecmsk::machine_file::MachineFile;
use ecmsk::port::tcp::{DEFAULT_PORT, OnVanish, ServeError, ServeOptions, Server};

use super::board::{BoardError, slaves_words, units_words};
use super::flight_option::FlightArgs;
use super::link_option::{ChoiceError, ChosenLink};
use super::stderr::say;
use super::{CliError, control_option, machine_option, recording_end, signals, streams};
use watch::WatchArgs;

/// Serve a board, a chip ECM-XF or slaves to other processes and machines
#[derive(clap::Args)]
#[command(disable_help_subcommand = true, arg_required_else_help = true)]
pub struct Args {
    #[command(subcommand)]
    port: Port,
}

#[derive(Subcommand)]
enum Port {
    Tcp(Tcp),
    #[cfg(target_os = "linux")]
    Ethercat(ethercat::Args),
    #[cfg(target_os = "linux")]
    Gadget(gadget::Args),
    Usbip(usbip::Args),
    #[cfg(feature = "web")]
    Web(web::Args),
    Xf(xf::Args),
}

/// Serve a board on TCP, for links tcp://HOST:PORT
///
/// Every client gets every report; one of them, the writer, sends commands. Standard output gives the address and what
/// is served, standard error each client that comes or goes. Ctrl-C and SIGTERM inform the clients, bring axes to a
/// standstill if there is a writer, and end the server. SIGHUP to a server without a terminal reads the file of
/// --secret-file again, and the board stays open.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk serve tcp --link 'sim:?slaves=drive*2'
  ecmsk serve tcp --link usb: --listen 0.0.0.0:4711 --secret-file ecmsk.secret

Make a secret: (umask 077; head -c 32 /dev/urandom | base64 > ecmsk.secret)")]
struct Tcp {
    /// Board to serve, see `ecmsk link help` [default: ECMSK_LINK, else the one of machine.toml or ecmsk.toml]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    #[arg(long, value_name = "NAME", help = control_option::HELP)]
    control: Option<String>,

    /// Address to listen on; any but this machine's own (127.0.0.1) needs a secret
    #[arg(long, value_name = "ADDR:PORT", default_value_t = ServeOptions::default().listen, value_parser = listen_at::<DEFAULT_PORT>)]
    listen: SocketAddr,

    /// Serve only clients that have the secret in this file, too, encrypted (TLS 1.3); only the file's owner may read
    /// it (mode 600) [default: the variable ECMSK_TCP_SECRET, which stays in the process: its children and a core dump
    /// of it have that, too]
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    secret_file: Option<PathBuf>,

    /// What moving axes do when the writer ends without closing its link
    #[arg(long, value_enum, default_value_t = Vanish::Ramp)]
    on_vanish: Vanish,

    /// The slaves in the order of the cable, e.g. drive*2,io, announced to clients [default: those of a sim: link, and
    /// those that a client configures]
    #[arg(long, value_name = "LIST", value_parser = slaves_words)]
    slaves: Option<String>,

    /// Counts per unit, announced to clients: one number for all axes, or e.g. 1=5000,2=131072/360
    #[arg(long, value_name = "N", value_parser = units_words, allow_hyphen_values = true)]
    counts_per_unit: Option<String>,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    #[command(flatten)]
    flight: FlightArgs,

    #[command(flatten)]
    watch: WatchArgs,

    /// Largest number of clients at the same time; while there is no writer, the last place is kept for one
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u16).range(1..=1000))]
    max_clients: u16,
}

#[derive(Clone, Copy, ValueEnum)]
enum Vanish {
    /// Ramp the axes to a standstill; they stay enabled
    Ramp,
    /// Send nothing: the board executes the rest of its FIFO, and a commanded velocity or torque stays in force
    Leave,
    /// Ramp the axes to a standstill and switch them off
    ServoOff,
}

impl From<Vanish> for OnVanish {
    fn from(vanish: Vanish) -> Self {
        match vanish {
            Vanish::Ramp => Self::Ramp,
            Vanish::Leave => Self::Leave,
            Vanish::ServoOff => Self::ServoOff,
        }
    }
}

pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    match &args.port {
        Port::Tcp(args) => serve_tcp(args),
        #[cfg(target_os = "linux")]
        Port::Ethercat(args) => ethercat::run(args),
        #[cfg(target_os = "linux")]
        Port::Gadget(args) => gadget::run(args),
        Port::Usbip(args) => usbip::run(args),
        #[cfg(feature = "web")]
        Port::Web(args) => web::run(args),
        Port::Xf(args) => xf::run(args),
    }
}

/// Parses the address of `--listen`. It must have a port; errors propose `PORT`.
fn listen_at<const PORT: u16>(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| match text.parse::<IpAddr>() {
        Ok(address) => format!("the port is missing: write {}", SocketAddr::new(address, PORT)),
        Err(_) => format!(
            "an address of this machine with a port is needed, e.g. 127.0.0.1:{PORT}, or 0.0.0.0:{PORT} for all its networks"
        ),
    })
}

fn serve_tcp(args: &Tcp) -> Result<ExitCode, CliError> {
    let failed = |message: std::io::Error| ServeError::System { what: "catch signals", message: message.to_string() };
    // Signals are watched before anything can move, so that Ctrl-C always ends the server in an orderly way.
    let end_request = signals::EndRequest::watch().map_err(failed)?;
    streams::queue().map_err(no_thread)?;
    let machine = machine_option::load(args.machine.as_deref()).map_err(BoardError::from)?;
    let link = served_with(args.link.as_ref(), machine.as_ref())?;
    let mut watch = args.watch.begin("tcp")?;
    let controlled = control_option::controlled(link, args.control.as_deref())?;
    let recorded = args.flight.added_to(&controlled)?;
    let carried = machine.as_ref().and_then(machine_option::carried).map(Arc::new);
    let board_watch = watch.board_carrying(&recorded, carried.clone());
    let options = ServeOptions {
        listen: args.listen,
        secret: Secret::find(args.secret_file.as_deref()).map_err(ServeError::from)?,
        on_vanish: args.on_vanish.into(),
        max_clients: args.max_clients.into(),
        network: KnownNetwork {
            slaves: args.slaves.clone().unwrap_or_default(),
            counts_per_unit: args.counts_per_unit.clone().unwrap_or_default(),
        },
        machine: carried,
        tell: Arc::new(|line| say("serve", &line)),
        ..ServeOptions::default()
    };
    let is_secret = options.secret.is_some();
    let server = Server::start(move || board_watch.open(), options)?;
    watch.count_clients(server.client_count());
    let protection = if is_secret { ", for clients with the secret" } else { "" };
    watch.ready(format!("listening on {}{protection}; serving {}\n", server.address(), board(server.info())))?;
    let signal = end_request.wait(|| reload(&server, args.secret_file.as_deref()));
    server.flush();
    say("serve", &format_args!("stopped by {signal}"));
    watch.stopping();
    server.stop();
    watch.end();
    Ok(ended([&recorded]))
}

/// Reads the secret again. If it cannot be read the old one stays.
fn reload(server: &Server, secret_file: Option<&Path>) {
    let Some(file) = secret_file else { return nothing_to_reload() };
    match Secret::load(file) {
        Ok(secret) => {
            // The server has a secret already, since it was started with this file.
            server.set_secret(secret);
            let what =
                format_args!("the secret was read again from {}; clients that are connected stay", file.display());
            say("serve", &what);
        }
        Err(error) => say("warning", &format_args!("the secret stays as it was: {error}")),
    }
}

/// Says that SIGHUP changes nothing here.
fn nothing_to_reload() {
    say(
        "note",
        &"SIGHUP: nothing is read again, all that is set stands on the command line; for other settings start it again",
    );
}

/// The exit code of a server that a signal has ended: success, unless one of the `links` to the served boards has a
/// recording that is incomplete.
fn ended<'a>(links: impl IntoIterator<Item = &'a LinkUri>) -> ExitCode {
    ended_with(links.into_iter().filter_map(|link| recording_end::not_whole(Some(link))).collect())
}

/// Prints warnings on incomplete recordings. The exit code is success if there are none.
fn ended_with(lacking: Vec<String>) -> ExitCode {
    lacking.iter().for_each(|lacks| say("warning", lacks));
    if lacking.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(recording_end::NOT_WHOLE) }
}

/// The link to serve. The user has to name it, so that a forgotten option does not serve a real board.
///
/// # Errors
/// No board is named, or the link is invalid.
fn served(link: Option<&LinkUri>) -> Result<LinkUri, CliError> {
    named(ChosenLink::find(link))
}

/// As [`served`], for a verb with a machine file.
fn served_with(link: Option<&LinkUri>, machine: Option<&MachineFile>) -> Result<LinkUri, CliError> {
    named(ChosenLink::find_with(link, machine))
}

fn named(chosen: Result<ChosenLink, ChoiceError>) -> Result<LinkUri, CliError> {
    let chosen = chosen.map_err(BoardError::from)?;
    if chosen.is_named() { Ok(chosen.uri) } else { Err(CliError::NothingToServe) }
}

fn no_thread(error: io::Error) -> ServeError {
    ServeError::System { what: "start a thread for output", message: error.to_string() }
}

fn board(info: &LinkInfo) -> String {
    let slot = info.slot.map(|slot| format!("slots of {} bytes", slot.bytes()));
    let clock = if info.virtual_time { "virtual clock" } else { "real clock" };
    format!("{} ({}, {clock})", info.name, slot.as_deref().unwrap_or("slot size not known"))
}
