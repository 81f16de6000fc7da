//! `ecmsk serve usbip`: serves boards over USB/IP, so that any machine can attach them to its USB bus.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use clap::ArgAction;
use ecmsk::link::uri::LinkUri;
use ecmsk::port::usbip::{BoardSpec, Identity, Options, ServeError, Server, VHCI, wire};

use super::watch::{BoardWatch, WatchArgs};
use crate::control_option::ControlOptionError;
use crate::flight_option::FlightArgs;
use crate::link_option::with_key;
use crate::stderr::say;
use crate::{CliError, control_option, signals, streams};

/// Serve boards over USB/IP: the USB stack of any machine then sees an ECM-SK, and programs need no change
///
/// Standard output gives the address and what is served, standard error each client that comes or goes. USB/IP has no
/// password, so the server listens on this machine alone; other machines use a tunnel (docs/VIRTUAL-BOARD.md). A lost board
/// is detached. When the board is back it can be attached again; with --attach the server attaches it. Ctrl-C and SIGTERM
/// detach the boards and end the server.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk serve usbip --link 'sim:?slaves=drive*2'
      then, there:  sudo modprobe vhci-hcd; sudo usbip attach -r 127.0.0.1 -b 1-1
  sudo ecmsk serve usbip --link 'sim:?slaves=drive*2' --attach
  ecmsk serve usbip --link 'sim:?name=left' --link 'sim:?name=right' --listen 127.0.0.1:3241

From another machine, through a tunnel: ssh -N -L 3240:127.0.0.1:3240 HOST, then usbip attach -r 127.0.0.1 -b 1-1")]
pub struct Args {
    /// Board to serve, see `ecmsk link help`; once for each board. The boards get the bus ids 1-1, 1-2 and so on
    /// [default: ECMSK_LINK, else the one of machine.toml or ecmsk.toml]
    #[arg(long = "link", value_name = "URI", value_parser = given_link, action = ArgAction::Append)]
    links: Vec<LinkUri>,

    /// Let `ecmsk fault NAME` make events happen on a simulated board while it runs; once for each board, in their order
    #[arg(long, value_name = "NAME", action = ArgAction::Append)]
    control: Vec<String>,

    #[command(flatten)]
    flight: FlightArgs,

    #[command(flatten)]
    watch: WatchArgs,

    /// Address to listen on
    #[arg(long, value_name = "ADDR:PORT", default_value_t = SocketAddr::from(([127, 0, 0, 1], wire::PORT)), value_parser = super::listen_at::<{ wire::PORT }>)]
    listen: SocketAddr,

    /// Listen on an address that other machines reach, too: everybody there can move the axes, since USB/IP has no
    /// password and no encryption. A tunnel is better: docs/VIRTUAL-BOARD.md
    #[arg(long)]
    insecure_anyone: bool,

    /// Attach the boards to this machine at once (needs root and the kernel module vhci-hcd)
    #[arg(long)]
    attach: bool,

    /// Vendor id that the boards show, hexadecimal
    #[arg(long, value_name = "ID", value_parser = id, default_value = "16c0", help_heading = IDENTITY)]
    vendor: u16,

    /// Product id that the boards show, hexadecimal
    #[arg(long, value_name = "ID", value_parser = id, default_value = "05df", help_heading = IDENTITY)]
    product: u16,

    /// Release (bcdDevice) that the boards show, hexadecimal
    #[arg(long, value_name = "N", value_parser = id, default_value = "0100", help_heading = IDENTITY)]
    release: u16,

    /// Name of the maker; empty: none
    #[arg(long, value_name = "TEXT", default_value_t = Identity::default().manufacturer, help_heading = IDENTITY)]
    manufacturer: String,

    /// Name of the product; empty: none
    #[arg(long, value_name = "TEXT", default_value_t = Identity::default().name, help_heading = IDENTITY)]
    name: String,

    /// Serial number; once for each board, in their order [default: the bus id]
    #[arg(long, value_name = "TEXT", action = ArgAction::Append, help_heading = IDENTITY)]
    serial: Vec<String>,

    /// bInterval of the endpoints: 2^(N-1) times 125 us
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16), help_heading = IDENTITY)]
    interval: u8,
}

const IDENTITY: &str = "How the boards show themselves";

pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    // Signals are caught before a board is attached, so that Ctrl-C always ends the server in an orderly way.
    let end_request = signals::EndRequest::watch().map_err(ServeError::Signals)?;
    streams::queue().map_err(ServeError::Thread)?;
    let mut watch = args.watch.begin("usbip")?;
    let links = controlled(links(args)?, &args.control)?;
    let links = args.flight.added_to_all(&links)?;
    let boards = links.iter().enumerate().map(|(index, link)| board(args, index, watch.board(link))).collect();
    let options = Options {
        listen: args.listen,
        insecure_anyone: args.insecure_anyone,
        attach: args.attach.then(|| PathBuf::from(VHCI)),
        ..Options::default()
    };
    if !args.listen.ip().is_loopback() && args.insecure_anyone {
        say("note", &format_args!("anybody who reaches {} can use the boards: USB/IP knows no password", args.listen));
    }
    let server = Server::start(options, boards, Arc::new(|event| say("serve", event)))?;

    let mut text = format!("listening on {}\n", server.address());
    for (bus_id, link) in server.bus_ids().zip(&links) {
        text.push_str(&format!("{bus_id} {link}\n"));
    }
    watch.ready(text)?;
    let signal = end_request.wait(super::nothing_to_reload);
    server.flush();
    say("serve", &format_args!("stopped by {signal}"));
    watch.stopping();
    server.stop();
    watch.end();
    Ok(super::ended(&links))
}

/// The links to serve: those of the command line, else the link of `ECMSK_LINK` or of a configuration file.
fn links(args: &Args) -> Result<Vec<LinkUri>, CliError> {
    if !args.links.is_empty() {
        return Ok(args.links.clone());
    }
    let link = super::served(None)?;
    Ok(vec![given_link(&link.to_string()).unwrap_or(link)])
}

/// Adds control sockets with these names to the links, the first name to the first link and so on.
fn controlled(links: Vec<LinkUri>, names: &[String]) -> Result<Vec<LinkUri>, ControlOptionError> {
    if names.len() > links.len() {
        return Err(ControlOptionError::TooMany { names: names.len(), boards: links.len() });
    }
    let one = |(index, link): (usize, LinkUri)| control_option::controlled(link, names.get(index).map(String::as_str));
    links.into_iter().enumerate().map(one).collect()
}

fn board(args: &Args, index: usize, watched: Arc<BoardWatch>) -> BoardSpec {
    let identity = Identity {
        vendor: args.vendor,
        product: args.product,
        release: args.release,
        interval: args.interval,
        manufacturer: args.manufacturer.clone(),
        name: args.name.clone(),
        serial: args.serial.get(index).cloned().unwrap_or_default(),
        ..Identity::default()
    };
    BoardSpec { identity, opener: Box::new(move || watched.open()) }
}

/// Parses a link and adds `queue=1` if it has no `queue=`. So only the newest report is buffered, because the remote
/// host has a queue of its own.
pub(super) fn given_link(text: &str) -> Result<LinkUri, String> {
    let link = LinkUri::parse(text).map_err(|error| error.to_string())?;
    let says = text.split(['?', '&']).any(|part| part.starts_with("queue="));
    if says {
        return Ok(link);
    }
    with_key(&link, "queue", "1").map_err(|error| error.to_string())
}

pub(super) fn id(text: &str) -> Result<u16, String> {
    let digits = text.strip_prefix("0x").unwrap_or(text);
    u16::from_str_radix(digits, 16).map_err(|_| "allowed: 0000 to ffff".to_owned())
}
