//! `ecmsk serve web`: shows a board or a recording in a browser of this machine.
//!
//! The page is a reader: nothing that a browser sends reaches the board. The thread that reads the board waits for no
//! browser. Files:
//!
//! - `web.rs`: the verb
//! - `hub.rs`: makes messages of reports, and puts them into the queue of each page
//! - `site.rs`: who may have the page, and what a request gets
//! - `client.rs`: a page's WebSocket

mod client;
mod hub;
mod site;

use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use clap::ValueHint;
use ecmsk::ecm::Scales;
use ecmsk::link::uri::LinkUri;
use ecmsk::sk::SlotSize;

use super::watch::{Watch, WatchArgs};
use crate::flight_option::FlightArgs;
use crate::kind_list::KindList;
use crate::link_option::{ChosenLink, with_key};
use crate::monitor::MonitorError;
use crate::stderr::say;
use crate::{CliError, machine_option, plot, signals, slot_size, streams};
use hub::{Hub, Subject};
use site::{Content, Site};

/// The port without `--listen`. \[OURS]
const DEFAULT_PORT: u16 = 4714;
/// How often the server looks for a signal while it makes the page of a recording. \[OURS]
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// Show a board or a recording in a browser: curves, states, alarms, inputs and outputs
///
/// The page draws the axes of the machine file in motion. Prints the address of the page; the token in it is what lets a
/// browser have the page. The page only reads: no frame is sent. A board of another program is watched through `ecmsk
/// serve tcp`. The server listens on this machine alone; from another one, ssh -L 4714:localhost:4714 HOST. Ctrl-C and
/// SIGTERM end the server.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk serve web --link tcp://localhost:4711
  ecmsk serve web run.pcapng

A recording as one file, which needs no server: ecmsk plot run.pcapng -o run.html")]
pub struct Args {
    /// Show this recording or capture instead of a board
    #[arg(value_name = "FILE", conflicts_with_all = ["link", "flight"], value_hint = ValueHint::FilePath)]
    file: Option<PathBuf>,

    /// Board to show, see `ecmsk link help` [default: ECMSK_LINK, else the one of machine.toml or ecmsk.toml]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    #[command(flatten)]
    flight: FlightArgs,

    #[command(flatten)]
    watch: WatchArgs,

    /// Address to listen on, one of this machine's own
    #[arg(long, value_name = "ADDR:PORT", default_value_t = SocketAddr::from(([127, 0, 0, 1], DEFAULT_PORT)), value_parser = listen_here)]
    listen: SocketAddr,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    #[arg(long, value_name = "LIST", conflicts_with = "file", value_parser = KindList::parse, help = KindList::help(
        "The slaves in the order of the network",
        " [default: those of the machine file, of a sim: link, or as a server tells]",
    ))]
    slaves: Option<KindList>,

    /// Counts per unit, for positions and speeds in mm or degrees: one number for all axes, or e.g. 1=5000,2=131072/360
    #[arg(long, value_name = "N", value_parser = Scales::parse, allow_hyphen_values = true)]
    counts_per_unit: Option<Scales>,

    /// Bytes of a slot, 12 or 16 [default: from the link or the recording, else from the CRCs]
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,
}

/// Why `ecmsk serve web` does not start.
#[derive(Debug, thiserror::Error)]
pub enum WebError {
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {source}; choose another port with --listen, 0 for any")]
    Listen {
        /// The address of `--listen`.
        address: SocketAddr,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The operating system refuses what the server needs, such as a thread.
    #[error("cannot {what}: {message}; free some of the system's memory or threads, then run it again")]
    System {
        /// What the server tried to do, for the message.
        what: &'static str,
        /// The error of the operating system, as text.
        message: String,
    },
}

pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let failed = |what| move |error: io::Error| WebError::System { what, message: error.to_string() };
    let mut end_request = signals::EndRequest::watch().map_err(failed("catch signals"))?;
    streams::queue().map_err(failed("start a thread for output"))?;
    let mut watch = args.watch.begin("web")?;
    let board = if args.file.is_none() { Some(board(args, &mut watch)?) } else { None };
    let (content, what) = match (&args.file, &board) {
        (Some(file), _) => match recording(args, file, &mut end_request)? {
            Some(content) => (content, file.display().to_string()),
            None => return Ok(ExitCode::SUCCESS),
        },
        (None, Some((hub, uri))) => (Content::Board(Arc::clone(hub)), uri.to_string()),
        (None, None) => return Err(CliError::NothingToServe),
    };
    let site = Site::start(args.listen, content)?;
    if let Some((hub, _)) = &board {
        let hub = Arc::clone(hub);
        watch.count_clients(move || hub.page_count());
    }
    watch.ready(format!("listening on {}; showing {what}\n", site.url()))?;
    let signal = end_request.wait(super::nothing_to_reload);
    say("serve", &format_args!("stopped by {signal}"));
    watch.stopping();
    site.stop();
    if let Some((hub, _)) = &board {
        hub.stop();
    }
    watch.end();
    Ok(super::ended(board.iter().map(|(_, uri)| uri)))
}

/// Makes the page of a recording, in a thread of its own: for a long one that takes minutes. `None`: a signal has ended the
/// server meanwhile.
fn recording(args: &Args, file: &Path, end_request: &mut signals::EndRequest) -> Result<Option<Content>, CliError> {
    let plot = plot::Args::of_file(file, args.machine.clone(), args.slot_size, args.counts_per_unit.clone());
    let (sender, made) = mpsc::channel();
    let make = move || drop(sender.send(plot::html::of_recording(&plot, || Ok(()), None)));
    let thread = thread::Builder::new().name("page".to_owned()).spawn(make);
    let thread =
        thread.map_err(|error| WebError::System { what: "start a thread for the page", message: error.to_string() })?;
    loop {
        match made.recv_timeout(LOOK_INTERVAL) {
            Ok(page) => return Ok(Some(Content::Recording(page?))),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                if let Err(panic) = thread.join() {
                    std::panic::resume_unwind(panic);
                }
                return Ok(None);
            }
        }
        if let Some(signal) = end_request.asked(super::nothing_to_reload) {
            say("serve", &format_args!("stopped by {signal}"));
            return Ok(None);
        }
    }
}

fn board(args: &Args, watch: &mut Watch) -> Result<(Arc<Hub>, LinkUri), CliError> {
    let local = machine_option::load(args.machine.as_deref())?;
    let mut chosen = ChosenLink::find_with(args.link.as_ref(), local.as_ref()).map_err(MonitorError::from)?;
    // The user has to name the board, as for every server, so that a forgotten option does not show a real board.
    if !chosen.is_named() {
        return Err(CliError::NothingToServe);
    }
    let machine = match local {
        Some(machine) => Some(machine),
        None => machine_option::of_link(args.machine.as_deref(), Some(&chosen.uri))?,
    };
    let machine = machine.map(Arc::new);
    let uri = args.flight.added_to(&chosen.uri)?;
    chosen.uri = with_long_queue(&uri);
    let subject = Subject {
        uri: uri.clone(),
        machine,
        slaves: args.slaves.clone(),
        scales: args.counts_per_unit.clone(),
        slot_size: args.slot_size,
    };
    let board = watch.board(&chosen.uri);
    Ok((Hub::start(&chosen, subject, board)?, uri))
}

/// The link with the key `queue=1000`: the queue holds a second of reports at 1 kHz while this process does not read, so
/// that a busy machine makes no gaps. \[OURS] If the user's link has the key `queue=`, it stays.
fn with_long_queue(uri: &LinkUri) -> LinkUri {
    // A link that has the key refuses a second one.
    with_key(uri, "queue", "1000").unwrap_or_else(|_| uri.clone())
}

/// Parses the address of `--listen`. Addresses that other machines reach are refused, because HTTP has no encryption.
fn listen_here(text: &str) -> Result<SocketAddr, String> {
    let address = super::listen_at::<DEFAULT_PORT>(text)?;
    if address.ip().is_loopback() {
        return Ok(address);
    }
    let port = address.port();
    Err(format!(
        "only this machine's own addresses are served, 127.0.0.1 or [::1]; from another machine use a tunnel: ssh -L \
         {port}:localhost:{port} HOST"
    ))
}
