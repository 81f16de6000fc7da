//! `ecmsk stop`: brings all axes to a standstill, also while another program writes to the served board.

use std::path::PathBuf;

use clap::ValueHint;
use ecmsk::ecm::Close;
use ecmsk::link::LinkError;
use ecmsk::link::keys::Scheme;
use ecmsk::link::tcp::{DEFAULT_PORT, StopError, Stopped, served_board, stop};
use ecmsk::link::uri::LinkUri;
use ecmsk::sk::{MasterState, SlotSize};
use serde_json::json;

use super::board::network::Network;
use super::board::{self, Board, BoardError, BoardUse, Interrupt, Reporter, StepSource};
use super::link_option::is_simulated;
use super::stderr::say;
use super::{machine_option, slot_size};

const WHAT: &str = "stop";
/// \[OURS] The timeout for a server of this machine: one that does not answer at once is ignored.
const SERVER_KEYS: &str = "?connect_timeout_ms=1000";

/// Bring all axes to a standstill, also while another program moves them
///
/// If no board is named and none is at usb:, the board of the server at port 4711 of this machine is stopped, whichever it is.
///
/// On a served board (tcp:) the server ends the connection of the program that writes, and brakes its axes as those of one
/// that has vanished. If another link is in use, or simulated, the verb asks the server at port 4711 of this machine whether
/// it serves that board. Otherwise the link has to be free: the verb opens the board, and stops what a program has left moving.
/// It aborts homing, and axes stay on. It is no emergency stop, which works without software.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk stop --link tcp://localhost
  ecmsk stop
  ecmsk stop --link tcp://192.168.1.20?secret_file=secret --servo-off
  ecmsk stop --link usb: --slaves drive*2,io")]
pub struct Args {
    /// Board whose axes are stopped, see `ecmsk link help` [default: ECMSK_LINK, else the one of machine.toml or
    /// ecmsk.toml, else usb:]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    /// Switch the axes off when they stand; a vertical axis without a brake drops then
    #[arg(long)]
    servo_off: bool,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    /// The slaves in the order of the cable, as for `ecmsk move`, if no server knows them [default: those of the machine file]
    #[arg(long, value_name = "LIST", value_parser = Network::parse)]
    slaves: Option<Network>,

    /// EtherCAT cycle, microseconds, if no server knows it [default: that of the machine file, else 1000]
    #[arg(long, value_name = "N")]
    cycle_us: Option<u32>,

    /// Bytes of a slot, 12 or 16 [default: what the link says, else the size with which the CRCs of reports are right]
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,

    /// Print the result as a JSON object
    #[arg(long)]
    json: bool,
}

/// Stops the axes, and prints how that has ended.
///
/// # Errors
/// [`BoardError`] if axes may still move: no server or board answers, another program has a board that is not served, the
/// slaves are not known, or the brake has failed.
pub fn run(args: &Args) -> Result<(), BoardError> {
    run_with(args, Interrupt::watch, DEFAULT_PORT)
}

/// Runs the verb. `port` is the TCP port at which a server of this machine is looked for.
fn run_with(args: &Args, interrupt: fn() -> Result<Interrupt, BoardError>, port: u16) -> Result<(), BoardError> {
    let machine = match machine_option::load_or_pass_over(args.machine.as_deref()) {
        Ok(machine) => machine,
        Err(error) => return args.stop_served(error.into(), interrupt, port),
    };
    let chosen = match board::Args::for_stop(args).chosen(machine.as_ref()) {
        Ok(chosen) => chosen,
        Err(error) => return args.stop_served(error, interrupt, port),
    };
    if chosen.uri.scheme() != Scheme::Tcp {
        // If this program opened a simulated board, that would be a new one, not the one of a server. So the server is
        // asked first.
        let server = is_simulated(&chosen.uri).then(|| server_of(&chosen.uri, port).ok()).flatten();
        let server = match server {
            Some(server) => server,
            None => match args.stop_free_board(None, interrupt) {
                Err(error @ BoardError::Unnamed(_)) if user_of(&error).is_none() => {
                    return args.stop_served(error, interrupt, port);
                }
                Err(error) => {
                    let Some(user) = user_of(&error) else { return Err(error) };
                    server_of(&chosen.uri, port).map_err(|other| in_use(&user, other))?
                }
                done => return done,
            },
        };
        say("note", &format_args!("`{}` is served at {server}", chosen.uri));
        return run_with(&Args { link: Some(server), ..args.clone() }, interrupt, port);
    }
    match stop(&chosen.uri, args.servo_off) {
        Ok(stopped) => args.say(&Reporter::new(args.json, false), &stopped, true),
        // The server has stopped the writer, so this program can be the writer, and stop the axes that its options or
        // the machine file name.
        Err(StopError::Unknown { writer }) if args.slaves.is_some() || machine.is_some() => {
            args.stop_free_board(writer, interrupt)
        }
        Err(StopError::Unknown { .. }) => Err(BoardError::Refused {
            what: WHAT.to_owned(),
            why:
                "the network was configured before its server came, so that what moves is not known to it, and goes on"
                    .to_owned(),
            next: "say --slaves, with which this verb stops the axes, or use the emergency stop".to_owned(),
        }),
        Err(StopError::Link(error)) => Err(match chosen.if_unnamed(&error) {
            Some(unnamed) => unnamed.into(),
            None if error.to_string().contains("emergency stop") => error.into(),
            None => BoardError::NotStopped(error),
        }),
        Err(error) => Err(error.into()),
    }
}

/// The keys that choose one board of several.
const CHOOSING_KEYS: [&str; 4] = ["serial", "path", "vid", "pid"];

/// The link to the server at a port of this machine, and the name of the board that it has. The error is that of
/// [`server_of`].
fn server_at(port: u16) -> Result<(LinkUri, String), Option<String>> {
    let link = |keys| LinkUri::parse(&format!("tcp://localhost:{port}{keys}")).map_err(|error| Some(error.to_string()));
    let served = served_board(&link(SERVER_KEYS)?).map_err(|error| match error {
        LinkError::NoBoard { reason, .. } if reason.contains("nobody listens") => None,
        error => Some(format!("a server at port {port} of this machine cannot be asked for its board: {error}")),
    })?;
    Ok((link("")?, served))
}

/// The link to the server at a port of this machine, if it serves the board of the link `uri`. Otherwise the error says
/// what is at the port; `None` if no server listens there.
fn server_of(uri: &LinkUri, port: u16) -> Result<LinkUri, Option<String>> {
    let (server, served) = server_at(port)?;
    let other = || Some(format!("the server at port {port} of this machine has `{served}`"));
    let board = LinkUri::parse(&served).map_err(|_| other())?;
    let is_it = uri.scheme() == board.scheme()
        && if is_simulated(uri) {
            uri.path() == board.path() && uri.value("slaves") == board.value("slaves")
        } else {
            // A link that chooses no board means the only one there is, which the server has.
            let is_its = |chosen: &str, has: &str| chosen.is_empty() || chosen == has;
            let value = |uri: &LinkUri, key| uri.value(key).unwrap_or_default().to_owned();
            is_its(uri.path(), board.path())
                && CHOOSING_KEYS.iter().all(|key| is_its(&value(uri, key), &value(&board, key)))
        };
    if is_it { Ok(server) } else { Err(other()) }
}

/// The error for a board that another program has and that no server at the port serves. `other` says what is at the
/// port.
fn in_use(user: &str, other: Option<String>) -> BoardError {
    BoardError::Refused {
        what: WHAT.to_owned(),
        why: other.map_or_else(|| user.to_owned(), |other| format!("{user}; {other}")),
        next: "if `ecmsk serve tcp` has it, say `ecmsk stop --link tcp://localhost:PORT` with the port that it listens on, and \
               `?secret_file=FILE` behind it if it has a secret; otherwise stop the axes there, or use the emergency stop"
            .to_owned(),
    }
}

/// The text of the error if another program has the board; `None` for any other error.
fn user_of(error: &BoardError) -> Option<String> {
    let in_use = match error {
        BoardError::Link(error) => error,
        BoardError::Unnamed(unnamed) => unnamed.error(),
        _ => return None,
    };
    match in_use {
        LinkError::InUse { name, by, .. } => Some(format!("`{name}` is in use{by}")),
        _ => None,
    }
}

impl Args {
    /// For a person who has named no board, or whose files cannot be read: stops the axes of the board that a server of this
    /// machine has at `port`, whichever that is. Returns `error` if there is no such server.
    fn stop_served(
        &self,
        error: BoardError,
        interrupt: fn() -> Result<Interrupt, BoardError>,
        port: u16,
    ) -> Result<(), BoardError> {
        if self.link.is_some() {
            return Err(error);
        }
        let Ok((server, served)) = server_at(port) else { return Err(error) };
        say("note", &format_args!("no board is known here, so that of the server at {server} is stopped, `{served}`"));
        let is_readable = machine_option::load(self.machine.as_deref()).is_ok();
        let machine = if is_readable { self.machine.clone() } else { Some("none".into()) };
        run_with(&Self { link: Some(server), machine, ..self.clone() }, interrupt, port)
    }

    /// Opens the board, which no other program has, and stops what moves. `writer` is the program that a server has
    /// stopped, if any.
    fn stop_free_board(
        &self,
        writer: Option<String>,
        interrupt: fn() -> Result<Interrupt, BoardError>,
    ) -> Result<(), BoardError> {
        let args = board::Args::for_stop(self);
        let board = Board::open(&args, BoardUse::Switches, StepSource::CommandLine, interrupt()?)?;
        let done = self.stop(&board).and_then(|in_op| {
            if !in_op && is_simulated(&board.uri) {
                return Err(BoardError::Refused {
                    what: WHAT.to_owned(),
                    why: format!("`{}` is a new board of this program, on which nothing moves", board.uri),
                    next: "name the board whose axes move, e.g. `ecmsk stop --link tcp://localhost:PORT` for one that \
                           `ecmsk serve tcp` serves"
                        .to_owned(),
                });
            }
            let is_served = board.uri.scheme() == Scheme::Tcp;
            self.say(&board.reporter, &Stopped { writer, in_op, text: board.held_back().join("; ") }, is_served)
        });
        board.close(done)
    }

    fn stop(&self, board: &Board) -> Result<bool, BoardError> {
        if board.ecm.state()?.state() != Some(MasterState::Op) {
            return Ok(false);
        }
        Ok(board.ecm.stop(board.known_network(WHAT)?, self.servo_off)?)
    }

    fn say(&self, reporter: &Reporter, stopped: &Stopped, is_served: bool) -> Result<(), BoardError> {
        let Stopped { writer, in_op, text } = stopped;
        let json = json!({
            "verb": WHAT, "in_op": in_op, "servo_off": self.servo_off, "stopped": writer,
            "text": (!text.is_empty()).then_some(text),
        });
        Ok(reporter.result(stopped_text(stopped, self.servo_off, is_served), &json)?)
    }
}

/// How stopping has ended, for the user. `servo_off`: the axes were switched off. `is_served`: a server has stopped them.
pub fn stopped_text(stopped: &Stopped, servo_off: bool, is_served: bool) -> String {
    let Stopped { writer, in_op, text } = stopped;
    let axes = match (in_op, servo_off) {
        (false, _) => "no axis follows commands: the network is not in OP",
        (true, false) => "axes stand still",
        (true, true) => "axes stand still, and are off",
    };
    let whom = match writer {
        Some(writer) => format!("; {writer} was stopped"),
        None if is_served => "; no program was writing".to_owned(),
        None => String::new(),
    };
    let more = if text.is_empty() { String::new() } else { format!("; {text}") };
    format!("{axes}{whom}{more}")
}

impl board::Args {
    /// The options of a board for `stop`, which has fewer of them.
    fn for_stop(args: &Args) -> Self {
        let Args { link, servo_off, machine, slaves, cycle_us, slot_size, json } = args.clone();
        let close = if servo_off { Close::ServoOff } else { Close::Hold };
        Self::with(|args| {
            (args.link, args.machine, args.slaves) = (link, machine, slaves);
            (args.cycle_us, args.slot_size, args.json) = (cycle_us, slot_size, json);
            args.close = Some(close);
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use clap::Parser;
    use ecmsk::link::{self, Layer, Link, LinkInfo};
    use ecmsk::port::tcp::{ServeOptions, Server};

    use super::*;

    const LINK: &str = "sim:?slaves=drive*2&clock=virtual&name=stop-verb";
    /// A port at which no server listens.
    const NO_PORT: u16 = 1;

    #[derive(Parser)]
    struct Verb {
        #[command(flatten)]
        args: Args,
    }

    fn verb(options: &[&str]) -> Args {
        Verb::parse_from(["stop", "--link", LINK, "--machine", "none"].iter().chain(options)).args
    }

    fn serve(link: &'static str) -> Server {
        let open = move || ecmsk::link::open(link, ecmsk::link::Share::ByUri);
        let listen = ([127, 0, 0, 1], 0).into();
        Server::start(open, ServeOptions { listen, ..ServeOptions::default() }).unwrap()
    }

    /// The board as `stop` opens it, with axes that are left as they are when it is closed.
    fn board(slaves: &str) -> Board {
        let mut args = board::Args::for_stop(&verb(&["--slaves", slaves]));
        args.close = Some(Close::Leave);
        Board::open(&args, BoardUse::Moves, StepSource::Lines, Interrupt::default()).unwrap()
    }

    /// How far axis 1 moves in 100 cycles, counts, and whether it is on.
    fn axis_1() -> (i32, bool) {
        let board = board("drive*2");
        let first = board.ecm.snapshot().unwrap();
        let mut last = first.clone();
        (0..100).for_each(|_| last = board.ecm.next_cycle(board.options.read_limit).unwrap());
        let at = |snapshot: &ecmsk::ecm::Snapshot| snapshot.position(1).unwrap();
        let seen = (at(&last) - at(&first), board.statusword(&last, 1).is_enabled());
        board.close(Ok(())).unwrap();
        seen
    }

    /// A board that no program has: the verb opens it and stops what a program has left moving, in the mode that reports
    /// show, whatever the options say. It switches axes off only if it is asked for.
    #[test]
    fn what_a_program_has_left_moving_on_a_free_board_is_stopped() {
        let left = board("drive:csv,drive");
        left.go_to(MasterState::Op).unwrap();
        left.ecm.servo_on(&[1]).unwrap();
        let mut stream = left.ecm.stream(16).unwrap();
        for _ in 0..300 {
            stream.csv(1, 50_000).unwrap();
            stream.step().unwrap();
        }
        std::mem::forget(stream);
        left.close(Ok(())).unwrap();
        let (moved, is_on) = axis_1();
        assert!(moved > 4000 && is_on, "{moved}");

        run_with(&verb(&[]), || Ok(Interrupt::default()), NO_PORT).unwrap();
        let (moved, is_on) = axis_1();
        assert!(moved.abs() <= 2 && is_on, "{moved}");
        run_with(&verb(&["--servo-off"]), || Ok(Interrupt::default()), NO_PORT).unwrap();
        assert!(!axis_1().1);
    }

    /// Who names no board, or has a file that cannot be read, stops the board that a server of this machine has; without a
    /// server the error is that of the board or of the file.
    #[test]
    fn without_a_name_the_served_board_is_stopped() {
        let link = "sim:?slaves=drive&clock=virtual&name=stop-unnamed";
        let server = serve(link);
        let port = server.address().port();
        let unnamed = Verb::parse_from(["stop", "--machine", "none"]).args;
        let refused = || BoardError::Refused { what: WHAT.to_owned(), why: "no file".to_owned(), next: String::new() };
        let interrupt = || Ok(Interrupt::default());
        unnamed.stop_served(refused(), interrupt, port).unwrap();
        let error = unnamed.stop_served(refused(), interrupt, NO_PORT).unwrap_err();
        assert!(error.to_string().contains("no file"), "{error}");
        // Whoever names another board does not get this one stopped.
        let named = verb(&[]).stop_served(refused(), interrupt, port).unwrap_err();
        assert!(named.to_string().contains("no file"), "{named}");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("machine.toml");
        std::fs::write(&file, "format = 1\nlink = \"sim:\"\n[axes]\nX = { slave = 1, max = \n").unwrap();
        let half_written = Verb::parse_from(["stop".as_ref(), "--machine".as_ref(), file.as_os_str()]).args;
        run_with(&half_written, interrupt, port).unwrap();
    }

    /// A simulated board that a server of this machine has is stopped there, and not a new one of this program; without
    /// such a server the verb fails.
    #[test]
    fn a_simulated_board_is_stopped_where_it_is_served() {
        let link = "sim:?slaves=drive,io&clock=virtual&name=stop-served";
        let server = serve(link);
        let port = server.address().port();
        let of = |link: &str| server_of(&LinkUri::parse(link).unwrap(), port).map(|server| server.to_string());
        assert_eq!(of("sim:?slaves=drive,io"), Ok(format!("tcp://localhost:{port}")));
        let other = Some(format!("the server at port {port} of this machine has `{}`", server.info().name));
        assert_eq!([of("sim:?slaves=drive"), of("usb:")], [Err(other.clone()), Err(other)]);
        assert_eq!(server_of(&LinkUri::parse(link).unwrap(), NO_PORT), Err(None));
        let args = |link: &str| Verb::parse_from(["stop", "--machine", "none", "--link", link]).args;
        run_with(&args("sim:?slaves=drive,io"), || Ok(Interrupt::default()), port).unwrap();
        let error = run_with(&args("sim:?slaves=drive"), || Ok(Interrupt::default()), port).unwrap_err().to_string();
        assert!(
            error.contains("is a new board of this program") && error.contains("ecmsk stop --link tcp://"),
            "{error}"
        );
    }

    /// One of several boards is stopped only by the server that has that one, and not by one that has another, or any.
    #[test]
    fn a_board_that_the_link_chooses_is_stopped_where_it_is_served() {
        for (served, given, is_it) in [
            ("usb:?serial=B", "usb:?serial=B", true),
            ("usb:?serial=B", "usb:?serial=A", false),
            ("usb:?serial=B", "usb:", true),
            ("usb:", "usb:", true),
            ("usb:", "usb:?serial=A", false),
            ("usb:?serial=B", "usb:?path=1-2", false),
            ("nic:eth1", "nic:eth1", true),
            ("nic:eth1", "nic:eth2", false),
            ("nic:eth1", "usb:", false),
        ] {
            let board = link::open("sim:?slaves=drive&clock=virtual", link::Share::ByUri).unwrap();
            let listen = ([127, 0, 0, 1], 0).into();
            let open = move || Ok(Arc::new(Named { board: Arc::clone(&board), name: served }) as Arc<dyn Link>);
            let server = Server::start(open, ServeOptions { listen, ..ServeOptions::default() }).unwrap();
            let found = server_of(&LinkUri::parse(given).unwrap(), server.address().port());
            assert_eq!(found.is_ok(), is_it, "{served} for {given}: {found:?}");
        }
    }

    /// A board under another name.
    struct Named {
        board: Arc<dyn Link>,
        name: &'static str,
    }

    impl Layer for Named {
        fn inner(&self) -> &dyn Link {
            self.board.as_ref()
        }

        fn info(&self) -> LinkInfo {
            LinkInfo { name: self.name.to_owned(), ..self.board.info() }
        }
    }

    /// The error for a board that another program has names the command that stops its axes.
    #[test]
    fn a_board_in_use_is_stopped_by_its_server() {
        let by = " by mover (PID 12)".to_owned();
        let in_use = LinkError::InUse { name: "nic:eth1".to_owned(), by, instead: "end that program" };
        assert_eq!(user_of(&in_use.into()).unwrap(), "`nic:eth1` is in use by mover (PID 12)");
        assert!(user_of(&LinkError::Closed.into()).is_none());
    }
}
