//! `ecmsk serve xf`: serves an ECM-XF to programs with any driver for that chip.

use std::process::ExitCode;
use std::sync::Arc;

use clap::ValueEnum;
use ecmsk::link::chip::ChipInfo;
use ecmsk::link::uri::LinkUri;
use ecmsk::port::xf::{Listen, OnVanish, Options, ServeError, Server};

use super::watch::WatchArgs;
use crate::stderr::say;
use crate::{CliError, signals, streams};

/// Serve a chip ECM-XF as a stream of bytes: a C driver for the chip runs on the model, with a shim instead of SPI
///
/// docs/XF-PORT.md describes the few bytes that the stream adds to each exchange; examples/c/xf_client.c is a short example of
/// a host. One host at a time has the chip. Standard output gives the address and what is served, standard error each host that
/// comes or goes. There is no password, so the server listens on this machine alone. Ctrl-C and SIGTERM end it, and stop axes
/// if there is a host.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk serve xf --link 'xf-sim:?slaves=drive*2'
  ecmsk serve xf --link 'xf-sim:?slaves=drive*2&chip_fw=old' --listen unix:/run/user/1000/xf")]
pub struct Args {
    /// Chip to serve, see `ecmsk link help` [default: ECMSK_LINK, else the one of machine.toml or ecmsk.toml]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    /// Address to listen on: a port of this machine, or a Unix socket, which this user alone may use
    #[arg(long, value_name = "ADDR:PORT|unix:PATH", default_value_t = Options::default().listen)]
    listen: Listen,

    /// Listen on an address that other machines reach, too: everybody there can move the axes, without a password. A
    /// tunnel is better: docs/XF-PORT.md
    #[arg(long)]
    insecure_anyone: bool,

    /// What happens when the host disconnects without closing the chip
    #[arg(long, value_enum, default_value_t = Vanish::SafeOp)]
    on_vanish: Vanish,

    #[command(flatten)]
    watch: WatchArgs,
}

#[derive(Clone, Copy, ValueEnum)]
enum Vanish {
    /// Bring slaves in OP to SafeOP: drives brake by themselves and switch off
    SafeOp,
    /// Leave the chip: it sends the rest of its FIFO, then repeats the last outputs
    Leave,
}

pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let failed = |source| ServeError::System { what: "catch signals", source };
    // Signals are caught before anything can move, so that Ctrl-C always ends the server in an orderly way.
    let end_request = signals::EndRequest::watch().map_err(failed)?;
    streams::queue().map_err(|source| ServeError::System { what: "start the thread of standard error", source })?;
    let mut watch = args.watch.begin("xf")?;
    let chip = watch.chip();
    let recorded = super::served(args.link.as_ref())?;
    let uri = recorded.to_string();
    let options = Options {
        listen: args.listen.clone(),
        insecure_anyone: args.insecure_anyone,
        on_vanish: match args.on_vanish {
            Vanish::SafeOp => OnVanish::SafeOp,
            Vanish::Leave => OnVanish::Leave,
        },
        tell: Arc::new(|line| say("serve", &line)),
        ..Options::default()
    };
    if let Listen::Tcp(address) = &args.listen
        && !address.ip().is_loopback()
        && args.insecure_anyone
    {
        say("note", &format_args!("anybody who reaches {address} can use the chip: nobody is asked for a password"));
    }
    let server = Server::start(move || chip.open(&uri), options)?;
    watch.ready(format!("listening on {}; serving {}\n", server.listen(), described(server.info())))?;
    let signal = end_request.wait(super::nothing_to_reload);
    server.flush();
    say("serve", &format_args!("stopped by {signal}"));
    watch.stopping();
    server.stop();
    watch.end();
    Ok(super::ended([&recorded]))
}

fn described(info: &ChipInfo) -> String {
    let clock = if info.virtual_time { "virtual clock" } else { "real clock" };
    let int0 = if info.has_int0 { "with INT0" } else { "without INT0" };
    format!("{} ({clock}, {int0})", info.name)
}
