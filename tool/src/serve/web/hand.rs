//! The thread that commands the board for the page that has control: the only writer of the board meanwhile.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use ecmsk::link::LinkError;

use super::control::Controls;
use super::desk::{Desk, End, Next, Order, Press};
use crate::board::{self, Board, BoardError, BoardUse, Interrupt, Reporter, StepSource};
use crate::lock::lock;
use crate::step::Line;
use crate::step::jog::{self, Held, HoldToRun, JogMotion};

const LATE: &str = "the page has answered too late, so its button does not count and the axis stands; press it again. If \
                    this happens again, the line to the page is too slow, or the page is busy";

/// Opens the board with these options, does what the page wants until control ends, and closes the board. Axes stop
/// then, and stay on.
pub fn run(controls: &Arc<Controls>, desk: &Arc<Desk>, args: &board::Args) {
    let told = Arc::clone(controls);
    let interrupt = Interrupt::when({
        let desk = Arc::clone(desk);
        move || desk.is_stopped(Instant::now())
    });
    let opened = Board::open(args, BoardUse::Moves, StepSource::Page, interrupt);
    let mut board = match opened {
        Ok(board) => board,
        Err(BoardError::Link(LinkError::InUse { by, .. })) => {
            let text = format!("no control: the board is in use{by}; end that, or press STOP, then take control");
            return controls.say(&text, true);
        }
        Err(error) => return controls.say(&format!("no control: {error}"), true),
    };
    // What the next result is of, where the result itself does not say it.
    let of = Arc::new(Mutex::new(String::new()));
    let result_of = Arc::clone(&of);
    board.reporter = Reporter::to(move |text, is_progress| match is_progress {
        true => told.set_busy(Some(&text)),
        false => told.say(&format!("{}{text}", lock(&result_of)), false),
    });
    controls.set_busy(None);
    // The axes that were jogged since the last order. This is the only writer of the board, so they are as they were.
    let mut checked = BTreeSet::new();
    let mut failed = Ok(());
    loop {
        let next = desk.next();
        if desk.take_late() {
            controls.say(LATE, true);
        }
        let (what, done) = match next {
            Next::Over => break,
            // The server ends the connection of a writer that is stopped by somebody else.
            Next::Nothing if board.ecm.state().is_ok() => continue,
            Next::Nothing => break,
            Next::Order(order) => {
                checked.clear();
                let line = order.line();
                *lock(&of) = if matches!(order, Order::Read { .. }) { format!("{line}: ") } else { String::new() };
                controls.set_busy(Some(&line));
                (line.clone(), run_line(&board, &line))
            }
            Next::Jog(press) => {
                lock(&of).clear();
                controls.set_busy(Some("jog"));
                let mut hand = Hand { desk, press };
                let is_checked = checked.contains(&press.slave);
                let done = jog::Args::jog_one(&board, press.slave, press.part, is_checked, &mut hand);
                if done.is_ok() {
                    checked.insert(press.slave);
                }
                // A press that was refused moves nothing later.
                desk.drop_press(press);
                ("jog".to_owned(), done)
            }
        };
        desk.done();
        controls.set_busy(None);
        match done {
            Ok(()) => {}
            // The server of the board has ended the connection: the stop says what has become of the axes.
            Err(_) if desk.why_ended(Instant::now()) == Some(End::Stopped) => {}
            Err(error) if !matches!(error, BoardError::Stopped { .. }) && board.ecm.state().is_err() => {
                failed = Err(error);
                break;
            }
            Err(BoardError::Stopped { .. }) => controls.say(&format!("{what}: ended before it was done"), false),
            Err(error) => controls.say(&error.to_string(), true),
        }
    }
    let why = match desk.why_ended(Instant::now()) {
        Some(End::Given) => "control is given up",
        Some(End::Gone) => "the page that had control is gone",
        Some(End::Silent) => "the page has answered nothing for a second, and has lost control",
        Some(End::Server) => "the server ends",
        // What has become of it is said by the stop itself. The board's server has ended this connection.
        Some(End::Stopped) => return drop(board.close(Ok(()))),
        None => "control has ended",
    };
    match board.close(failed) {
        Ok(()) => controls.say(&format!("{why}; axes that were on stand, and stay on"), false),
        Err(error) => controls.say(&format!("{why}; {error}"), true),
    }
}

fn run_line(board: &Board, line: &str) -> Result<(), BoardError> {
    let refused = |why| BoardError::Refused { what: line.to_owned(), why, next: "see `ecmsk help`".into() };
    match Line::parse(line).map_err(refused)? {
        Line::Step(step) => step.run(board),
        Line::Empty => Ok(()),
    }
}

impl Order {
    /// The order as a line of a script.
    pub fn line(&self) -> String {
        let of = |of: &Option<String>| of.as_ref().map(|of| format!(" --type {of}")).unwrap_or_default();
        match self {
            Self::Op => "state op".into(),
            Self::On { slave } => format!("servo on {slave}"),
            Self::Off { slave } => format!("servo off {slave}"),
            Self::Clear { slave } => format!("servo clear {slave}"),
            Self::Home { slave } => format!("home {slave}"),
            Self::Outputs { slave: 0, bits } => format!("io local --set 0x{bits:02X}"),
            Self::Outputs { slave, bits } => format!("io {slave} --set 0x{bits:04X}"),
            Self::Read { slave, object, r#type } => format!("sdo read {slave} {object}{}", of(r#type)),
            Self::Write { slave, object, r#type, value } => {
                format!("sdo write {slave} {object} {value}{}", of(r#type))
            }
        }
    }
}

/// A button of the page that is held.
struct Hand<'a> {
    desk: &'a Desk,
    press: Press,
}

impl HoldToRun for Hand<'_> {
    fn held(&mut self) -> Result<Held, BoardError> {
        let Press { is_positive, .. } = self.press;
        let is_held = self.desk.is_held(self.press, Instant::now());
        Ok(if is_held { Held::Runs(JogMotion { axis: 0, is_positive }) } else { Held::End })
    }

    fn stalled(&mut self) {
        self.desk.drop_press(self.press);
    }

    fn trouble(&self) -> Option<String> {
        None
    }

    fn width(&self) -> usize {
        usize::MAX
    }
}
