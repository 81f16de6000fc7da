//! `ecmsk serve web`: shows a board or a recording in a browser.
//!
//! The page only reads: nothing that a browser sends reaches the board, unless `--control` is given. The thread that reads
//! the board never waits for a browser. Files:
//!
//! - `web.rs`: the verb
//! - `hub.rs`: makes messages from reports, and puts them into the queue of each page
//! - `site.rs`: checks who may read the page, and answers requests
//! - `certificate.rs`: the certificate of a page that other machines reach
//! - `client.rs`: the WebSocket to a page
//! - `control.rs`: with `--control`, which of the pages has control, and stops; `desk.rs`: what that page wants; `hand.rs`:
//!   the thread that commands the board for it

mod certificate;
mod client;
mod control;
mod desk;
mod hand;
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
use ecmsk::link::LinkError;
use ecmsk::link::keys::Scheme;
use ecmsk::link::tcp::Secret;
use ecmsk::link::uri::LinkUri;
use ecmsk::sk::SlotSize;

use super::http_stream::Tls;
use super::watch::{Watch, WatchArgs};
use crate::board::{self, network::Network};
use crate::find::{ExpressionError, Search};
use crate::flight_option::FlightArgs;
use crate::kind_list::KindList;
use crate::link_option::{ChosenLink, as_reader, is_simulated, with_key};
use crate::monitor::MonitorError;
use crate::stderr::say;
use crate::{CliError, machine_option, plot, signals, slot_size, streams};
use certificate::{Certificate, CertificateError};
use control::Controls;
use hub::{Hub, Subject};
use site::{Content, Site, TOKEN_LEN};

/// The default port of `--listen`. \[OURS]
const DEFAULT_PORT: u16 = 4714;
/// The labels of the tokens in addresses, among what is derived from a secret: of a page that only reads, and (next constant)
/// of one that may move axes. So who may look may not move.
const READS: &str = "page";
const CONTROLS: &str = "page with control";
/// The interval at which the server checks for signals while it makes the page of a recording. \[OURS]
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// Show a board or a recording in a browser: curves, states, alarms, inputs and outputs
///
/// The page draws the axes of the machine file in motion. Prints the address of the page; the token in it is what lets a
/// browser have the page. A board of another program is watched through `ecmsk serve tcp`. Without --control the page only
/// reads: no frame is sent. With it, one page at a time may move the axes of a served board: an axis runs as long as its
/// button is held, and STOP acts on whoever moves. The server listens on this machine alone; from another one, ssh -L
/// 4714:localhost:4714 HOST, or --cert and --listen. Ctrl-C and SIGTERM end the server.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk serve web --link tcp://localhost:4711
  ecmsk serve web --link tcp://localhost:4711 --control
  ecmsk serve web --link tcp://localhost:4711 --listen 0.0.0.0:4714 --cert ecmsk.pem
  ecmsk serve web run.pcapng

A recording as one file, which needs no server: ecmsk plot run.pcapng -o run.html")]
pub struct Args {
    /// Show this recording or capture instead of a board
    #[arg(value_name = "FILE", conflicts_with_all = ["link", "flight"], value_hint = ValueHint::FilePath)]
    file: Option<PathBuf>,

    /// Board to show, see `ecmsk link help` [default: ECMSK_LINK, else the one of machine.toml or ecmsk.toml]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    /// Let the pages switch, home and jog axes, set outputs and stop: for a link tcp:
    #[arg(long, conflicts_with = "file")]
    control: bool,

    #[command(flatten)]
    flight: FlightArgs,

    #[command(flatten)]
    watch: WatchArgs,

    /// Address to listen on; any but this machine's own (127.0.0.1) needs a certificate
    #[arg(long, value_name = "ADDR:PORT", default_value_t = SocketAddr::from(([127, 0, 0, 1], DEFAULT_PORT)), value_parser = super::listen_at::<DEFAULT_PORT>)]
    listen: SocketAddr,

    /// Serve encrypted (HTTPS), with the certificate and key of this PEM file; one is made if it is not there
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    cert: Option<PathBuf>,

    /// Make the token of the address from the secret in this file, so that the address stays the same
    #[arg(long, value_name = "FILE", requires = "cert", value_hint = ValueHint::FilePath)]
    secret_file: Option<PathBuf>,

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

    /// List when this condition becomes true, and offer it as a trigger; see `ecmsk find --help`
    #[arg(long, value_name = "EXPRESSION")]
    find: Option<String>,

    /// EtherCAT cycle, microseconds, for --control [default: that of the machine file, else 1000]
    #[arg(long, value_name = "N", requires = "control")]
    cycle_us: Option<u32>,

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
    /// An address that other machines reach, without `--cert`.
    #[error(
        "other machines reach {address}: encrypt the page with --cert FILE, which is made if it is not there; or serve it on 127.0.0.1, \
         and use a tunnel from the other machine: ssh -L PORT:localhost:PORT HOST"
    )]
    NotSecured {
        /// The address of `--listen`.
        address: SocketAddr,
    },
    /// The certificate cannot be used.
    #[error(transparent)]
    Certificate(#[from] CertificateError),
    /// The secret cannot be used.
    #[error(transparent)]
    Secret(#[from] LinkError),
    /// `--control` with a board that this server would have itself.
    #[error(
        "--control needs a board that `ecmsk serve tcp` has, which brakes axes also if this server dies: `ecmsk serve tcp --link \
         '{uri}'`, then `ecmsk serve web --link tcp://localhost --control`"
    )]
    NotServed {
        /// The link.
        uri: String,
    },
    /// `--control` with a link that may not write.
    #[error("--control needs a link that may move axes: leave out role=reader")]
    OnlyReads,
    /// `--find` with a condition that no reader of a board can see.
    #[error(
        "--find `{expression}`: a page sees what a board reports, and not what a program sends to it; leave out target, following_error, \
         target_step, velocity, homing and gap, or show a recording"
    )]
    FindNeedsCommands {
        /// The expression.
        expression: String,
    },
    /// The expression of `--find` is wrong.
    #[error("--find: {0}; see `ecmsk find --help`")]
    Find(#[from] ExpressionError),
    /// The operating system refuses something that the server needs, such as a thread.
    #[error("cannot {what}: {message}; free some of the system's memory or threads, then run it again")]
    System {
        /// The action that failed, for the message.
        what: &'static str,
        /// The error of the operating system, as text.
        message: String,
    },
}

impl WebError {
    /// Whether the command line is wrong.
    pub const fn is_wrong_command_line(&self) -> bool {
        matches!(
            self,
            Self::NotServed { .. }
                | Self::OnlyReads
                | Self::NotSecured { .. }
                | Self::FindNeedsCommands { .. }
                | Self::Find(_)
        )
    }
}

impl Args {
    /// The control of the board `uri` for its pages.
    fn controls(&self, uri: &LinkUri) -> Arc<Controls> {
        let board = board::Args::with(|board| {
            (board.link, board.machine) = (Some(uri.clone()), self.machine.clone());
            board.slaves = self.slaves.as_ref().map(|slaves| Network::of_kinds(slaves.kinds().iter().copied()));
            (board.slot_size, board.counts_per_unit) = (self.slot_size, self.counts_per_unit.clone());
            board.cycle_us = self.cycle_us;
        });
        Controls::new(uri.clone(), board)
    }
}

impl Args {
    /// The certificate, and the token of the secret.
    fn protection(&self) -> Result<(Option<Tls>, Option<[u8; TOKEN_LEN]>), WebError> {
        let secret = self.secret_file.as_deref().map(Secret::load).transpose()?;
        let token = secret.map(|secret| {
            let derived = secret.derived(if self.control { CONTROLS } else { READS });
            std::array::from_fn(|i| derived[i])
        });
        let Some(file) = &self.cert else {
            return match self.listen.ip().is_loopback() {
                true => Ok((None, token)),
                false => Err(WebError::NotSecured { address: self.listen }),
            };
        };
        let certificate = Certificate::load_or_make(file, self.listen)?;
        let made = if certificate.is_new { "made " } else { "" };
        let words = format!(
            "{made}{}; a browser warns of a certificate that it does not know: go on only if it shows this SHA-256 fingerprint: {}",
            file.display(),
            certificate.fingerprint
        );
        say("certificate", &words);
        Ok((Some(certificate.tls), token))
    }
}

pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let failed = |what| move |error: io::Error| WebError::System { what, message: error.to_string() };
    let mut end_request = signals::EndRequest::watch().map_err(failed("catch signals"))?;
    streams::queue().map_err(failed("start a thread for output"))?;
    let (tls, token) = args.protection()?;
    let mut watch = args.watch.begin("web")?;
    let board = if args.file.is_none() { Some(served(args, &mut watch)?) } else { None };
    let controls = board.as_ref().filter(|_| args.control).map(|(_, uri)| args.controls(&without_recording(uri)));
    let (content, what) = match (&args.file, &board) {
        (Some(file), _) => match recording(args, file, &mut end_request)? {
            Some(content) => (content, file.display().to_string()),
            None => return Ok(ExitCode::SUCCESS),
        },
        (None, Some((hub, uri))) => (Content::Board(Arc::clone(hub), controls.clone()), uri.to_string()),
        (None, None) => return Err(CliError::NothingToServe),
    };
    let site = Site::start(args.listen, tls, token, content)?;
    if let Some((_, uri)) = &board
        && is_simulated(uri)
    {
        say(
            "note",
            &format_args!(
                "`{uri}` is a new board of this server, which no program moves; to see the board of a program: `ecmsk serve \
                 tcp --link ...` has it, and `ecmsk serve web --link tcp://localhost` shows it"
            ),
        );
    }
    if let Some((hub, _)) = &board {
        let hub = Arc::clone(hub);
        watch.count_clients(move || hub.page_count());
    }
    watch.ready(format!("listening on {} (showing {what})\n", site.url()))?;
    let signal = end_request.wait(super::nothing_to_reload);
    say("serve", &format_args!("stopped by {signal}"));
    watch.stopping();
    site.stop();
    controls.iter().for_each(|controls| controls.end());
    if let Some((hub, _)) = &board {
        hub.stop();
    }
    watch.end();
    Ok(super::ended(board.iter().map(|(_, uri)| uri)))
}

/// Makes the page of a recording in a separate thread, because this takes minutes for a long recording. Returns `None`
/// if a signal has ended the server meanwhile.
fn recording(args: &Args, file: &Path, end_request: &mut signals::EndRequest) -> Result<Option<Content>, CliError> {
    let plot = plot::Args::of_file(
        file,
        args.machine.clone(),
        args.slot_size,
        args.counts_per_unit.clone(),
        args.find.clone(),
    );
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

fn served(args: &Args, watch: &mut Watch) -> Result<(Arc<Hub>, LinkUri), CliError> {
    let local = machine_option::load(args.machine.as_deref())?;
    let mut chosen = ChosenLink::find_with(args.link.as_ref(), local.as_ref()).map_err(MonitorError::from)?;
    // As for every server, the user must name the board, so that a forgotten option does not show a real board.
    if !chosen.is_named() {
        return Err(CliError::NothingToServe);
    }
    if args.control && chosen.uri.scheme() != Scheme::Tcp {
        return Err(WebError::NotServed { uri: chosen.uri.to_string() }.into());
    }
    if args.control && chosen.uri.value("role") == Some("reader") {
        return Err(WebError::OnlyReads.into());
    }
    let machine = match local {
        Some(machine) => Some(machine),
        None => machine_option::of_link(args.machine.as_deref(), Some(&chosen.uri))?,
    };
    let machine = machine.map(Arc::new);
    let find = match &args.find {
        None => None,
        Some(expression) => {
            let search = Search::parse(expression, machine.as_deref()).map_err(WebError::from)?;
            if search.needs_commands() {
                return Err(WebError::FindNeedsCommands { expression: expression.clone() }.into());
            }
            Some((expression.clone(), search))
        }
    };
    let uri = args.flight.added_to(&chosen.uri)?;
    chosen.uri = with_reconnection(&with_long_queue(&uri));
    let subject = Subject {
        uri: uri.clone(),
        machine,
        slaves: args.slaves.clone(),
        scales: args.counts_per_unit.clone(),
        slot_size: args.slot_size,
        find,
        has_control: args.control,
    };
    let board = watch.board(&chosen.uri);
    Ok((Hub::start(&chosen, subject, board)?, uri))
}

/// Adds the key `queue=1000` to the link. The queue then holds the reports of a second at 1 kHz, so that delays on a
/// busy machine make no gaps. \[OURS] A `queue=` of the user's link is kept.
fn with_long_queue(uri: &LinkUri) -> LinkUri {
    // `with_key` fails if the link has the key already; the link then stays unchanged.
    with_key(uri, "queue", "1000").unwrap_or_else(|_| uri.clone())
}

/// Lets the reader of a served board connect again for a day, the longest time there is: who looks at the page cannot start
/// this server again. \[OURS] A `reconnect_ms=` of the user's link is kept.
fn with_reconnection(uri: &LinkUri) -> LinkUri {
    if uri.scheme() != Scheme::Tcp {
        return uri.clone();
    }
    with_key(&as_reader(uri), "reconnect_ms", "86400000").unwrap_or_else(|_| uri.clone())
}

/// The link without its recording, flight recorder and reconnection, which the reader of the board has already.
fn without_recording(uri: &LinkUri) -> LinkUri {
    let text = uri.to_string();
    let Some((board, keys)) = text.split_once('?') else { return uri.clone() };
    let is_left = |key: &&str| !["record", "flight", "reconnect_ms"].iter().any(|other| key.starts_with(other));
    let keys: Vec<&str> = keys.split('&').filter(is_left).collect();
    let sign = if keys.is_empty() { "" } else { "?" };
    LinkUri::parse(&format!("{board}{sign}{}", keys.join("&"))).unwrap_or_else(|_| uri.clone())
}
