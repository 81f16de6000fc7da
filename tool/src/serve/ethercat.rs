//! `ecmsk serve ethercat`: simulates slaves on a network interface, for any EtherCAT master.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use clap::ValueHint;
use ecmsk::engine::RealTime;
use ecmsk::link::slaves::{self, SlaveSpec};
use ecmsk::port::ethercat::{Options, ServeError, Server};

use super::watch::{LogArgs, Watch};
use crate::stderr::say;
use crate::{CliError, signals, streams};

/// Serve simulated slaves on a network interface: any EtherCAT master finds them there
///
/// The server answers EtherCAT frames on the interface as slaves at the other end of the cable would: registers,
/// EEPROM, states, mailbox, process data, distributed clocks. A pair of virtual interfaces in a network namespace is
/// enough: docs/SLAVES.md. Standard output lists what is served, standard error the events of the slaves. The server
/// needs the capability CAP_NET_RAW, or root. Ctrl-C and SIGTERM end it with exit code 0; it fails when its interface
/// is deleted.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sudo ecmsk serve ethercat --on veth1 --slaves 'drive*2,dp3cl,io'
  sudo ecmsk serve ethercat --on veth1 --slaves 'drive*2' --script faults.ecmscript --record run.pcapng
  sudo ecmsk serve ethercat --on veth1 --second veth3 --slaves 'drive*3'")]
pub struct Args {
    /// Network interface: of Ethernet, up, without an address
    #[arg(long, value_name = "INTERFACE")]
    on: String,

    /// Second network interface, at the other end of the cable: while it has a link it closes a ring, so that a master with two
    /// cards goes on when a cable is cut
    #[arg(long, value_name = "INTERFACE")]
    second: Option<String>,

    /// The slaves in the order of the cable, as in a sim: link, see `ecmsk link help`; at most 254
    #[arg(long, value_name = "LIST", value_parser = slave_list)]
    slaves: SlaveList,

    /// Crystal errors of the slaves' clocks: the first slave is PPM parts per million too fast, the last one PPM too slow,
    /// and the others are evenly distributed in between
    #[arg(long, value_name = "PPM", default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=1000))]
    drift: u16,

    /// Script of timed faults of the slaves, one per line, see `ecmsk link help`; events of a board, which is not simulated
    /// here, are refused. Times count from the start of the server, or from a master's first frame or OP (`from frame`,
    /// `from op`)
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    script: Option<PathBuf>,

    /// Record every frame and its answer, for Wireshark. An existing recording is renamed to FILE.1, which replaces an
    /// older FILE.1
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    record: Option<PathBuf>,

    /// Real-time priority (SCHED_FIFO) of the thread that answers, 1 to 99, for short answers on a busy machine
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=99))]
    priority: Option<u8>,

    /// Use the interface even if it is this machine's default route, whose network connection is then lost
    #[arg(long)]
    force: bool,

    #[command(flatten)]
    log: LogArgs,
}

/// A list of slaves, with the text from which it was parsed.
#[derive(Clone)]
struct SlaveList {
    words: String,
    slaves: Vec<SlaveSpec>,
}

fn slave_list(text: &str) -> Result<SlaveList, String> {
    if text.is_empty() {
        return Err("no slave is to be served; name some, e.g. 'drive*2,io'".to_owned());
    }
    Ok(SlaveList { words: text.to_owned(), slaves: slaves::parse_for_network(text)? })
}

pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    // Signals are caught before the slaves answer, so that Ctrl-C always ends the server in an orderly way.
    let system = |what| move |source| ServeError::System { what, source };
    let end_request = signals::EndRequest::watch().map_err(system("catch signals"))?;
    streams::queue().map_err(system("start the thread of standard error"))?;
    args.log.begin();
    let mut watch = Watch::without_metrics("ethercat");
    let SlaveList { words, slaves } = args.slaves.clone();
    let ender = end_request.ender();
    let options = Options {
        interface: args.on.clone(),
        second: args.second.clone(),
        slaves,
        drift_ppm: args.drift,
        script: args.script.clone(),
        record: args.record.clone(),
        allow_default_route: args.force,
        real_time: RealTime { priority: args.priority, cpu: None, lock_memory: false },
        tell: Arc::new(|line| say("serve", &line)),
        failed: Arc::new(ender),
    };
    let server = Server::start(options)?;
    let second = args.second.as_ref().map(|second| format!(" and {second}")).unwrap_or_default();
    watch.ready(format!("answering EtherCAT on {}{second}; serving {words}\n", args.on))?;
    let signal = end_request.wait_unless_ended(super::nothing_to_reload);
    server.flush();
    if let Some(signal) = signal {
        say("serve", &format_args!("stopped by {signal}"));
    }
    watch.stopping();
    server.stop()?;
    watch.end();
    Ok(ExitCode::SUCCESS)
}
