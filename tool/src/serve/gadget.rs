//! `ecmsk serve gadget`: makes a board available at a USB device port of this machine.

use std::process::ExitCode;
use std::sync::Arc;

use ecmsk::engine::RealTime;
use ecmsk::link::uri::LinkUri;
use ecmsk::port::gadget::{Identity, Options, ServeError, Server};

use super::Vanish;
use super::usbip::{given_link, id};
use super::watch::WatchArgs;
use crate::flight_option::FlightArgs;
use crate::stderr::say;
use crate::{CliError, control_option, signals, streams};

/// Serve a board at a USB device port of this machine: the PC at the other end of the cable sees an ECM-SK, and nothing
/// there needs a change
///
/// This machine needs a USB port that can be a device (Raspberry Pi 4 and 5, CM4, BeagleBone Black and others) and the
/// kernel's FunctionFS. The server makes the kernel's USB gadget and removes it at its end; a gadget that a killed server
/// has left is cleaned up first. The cable may be plugged and unplugged at any time. When the host is gone (unplugged,
/// switched off, asleep), axes that it has moved are brought to a standstill. Standard output says what is served, standard
/// error what the host does. The server needs root. Ctrl-C and SIGTERM unplug the board and end the server.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sudo ecmsk serve gadget --link nic:eth0
  sudo ecmsk serve gadget --link 'sim:?slaves=drive*2' --serial 7
  sudo modprobe dummy_hcd; sudo ecmsk serve gadget --link 'sim:?slaves=drive*2' --udc dummy_udc.0")]
pub struct Args {
    /// Board to serve, see `ecmsk link help` [default: ECMSK_LINK, else the one of machine.toml or ecmsk.toml]
    #[arg(long, value_name = "URI", value_parser = given_link)]
    link: Option<LinkUri>,

    #[arg(long, value_name = "NAME", help = control_option::HELP)]
    control: Option<String>,

    #[command(flatten)]
    flight: FlightArgs,

    #[command(flatten)]
    watch: WatchArgs,

    /// USB device controller, as /sys/class/udc lists them [default: the only one]
    #[arg(long, value_name = "NAME")]
    udc: Option<String>,

    /// What happens to moving axes when the host is gone: unplugged, switched off or asleep
    #[arg(long, value_enum, default_value_t = Vanish::Ramp)]
    on_vanish: Vanish,

    /// Real-time priority (SCHED_FIFO) of the threads between the port and the board, 1 to 99. The cycle of a board in this
    /// process has its own, `priority=` in the link, which should be higher
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=99))]
    priority: Option<u8>,

    /// Vendor id that the board shows, hexadecimal
    #[arg(long, value_name = "ID", value_parser = id, default_value = "16c0", help_heading = IDENTITY)]
    vendor: u16,

    /// Product id that the board shows, hexadecimal
    #[arg(long, value_name = "ID", value_parser = id, default_value = "05df", help_heading = IDENTITY)]
    product: u16,

    /// Release (bcdDevice) that the board shows, hexadecimal
    #[arg(long, value_name = "N", value_parser = id, default_value = "0100", help_heading = IDENTITY)]
    release: u16,

    /// Name of the maker
    #[arg(long, value_name = "TEXT", default_value_t = Identity::default().manufacturer, help_heading = IDENTITY)]
    manufacturer: String,

    /// Name of the product
    #[arg(long, value_name = "TEXT", default_value_t = Identity::default().name, help_heading = IDENTITY)]
    name: String,

    /// Serial number, by which two boards at one PC are told apart
    #[arg(long, value_name = "TEXT", default_value = "1-1", help_heading = IDENTITY)]
    serial: String,

    /// bInterval of the endpoints: 2^(N-1) times 125 us
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16), help_heading = IDENTITY)]
    interval: u8,
}

const IDENTITY: &str = "How the board shows itself";

pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let system = |what| move |source| ServeError::System { what, source };
    // Signals are caught before anything can move, so that Ctrl-C always ends the server in an orderly way.
    let end_request = signals::EndRequest::watch().map_err(system("catch signals"))?;
    streams::queue().map_err(system("start the thread of standard error"))?;
    let mut watch = args.watch.begin("gadget")?;
    let served = super::served(args.link.as_ref())?;
    let served = given_link(&served.to_string()).unwrap_or(served);
    let served = control_option::controlled(served, args.control.as_deref())?;
    let served = args.flight.added_to(&served)?;
    let options = Options {
        identity: identity(args),
        controller: args.udc.clone(),
        on_vanish: args.on_vanish.into(),
        real_time: RealTime { priority: args.priority, cpu: None, lock_memory: false },
        tell: Arc::new(|line| say("serve", &line)),
        failed: Arc::new(end_request.ender()),
        ..Options::default()
    };
    let board = watch.board(&served);
    let server = Server::start(Box::new(move || board.open()), options)?;
    watch.ready(format!("at the device port of {}; serving {served}\n", server.controller()))?;
    let signal = end_request.wait_unless_ended(super::nothing_to_reload);
    server.flush();
    if let Some(signal) = signal {
        say("serve", &format_args!("stopped by {signal}"));
    }
    watch.stopping();
    server.stop()?;
    watch.end();
    Ok(super::ended([&served]))
}

fn identity(args: &Args) -> Identity {
    Identity {
        vendor: args.vendor,
        product: args.product,
        release: args.release,
        interval: args.interval,
        manufacturer: args.manufacturer.clone(),
        name: args.name.clone(),
        serial: args.serial.clone(),
        ..Identity::default()
    }
}
