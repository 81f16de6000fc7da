//! `fault`: injects an event of the simulation scripts into a simulated board, such as an alarm.

#[cfg(unix)]
use std::time::Duration;

use crate::board::{Board, BoardError};

/// The longest wait for the next cycle of a board on the real clock. \[OURS]
#[cfg(unix)]
const CYCLE_LIMIT: Duration = Duration::from_secs(10);

/// Make an event happen on a simulated board with control=NAME in its link, such as an alarm
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The event, as `ecmsk link help` lists them, e.g. alarm 2 0x7500
    #[arg(required = true, value_name = "EVENT")]
    event: Vec<String>,

    /// The name of the board [default: control= of its link]; for a board that a server has, `ecmsk serve tcp --control NAME`
    #[arg(long, value_name = "NAME")]
    control: Option<String>,
}

impl Args {
    /// Injects the event at the beginning of the board's next cycle, and waits until that cycle has passed.
    ///
    /// # Errors
    /// The board has no control socket, or the event is invalid.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        let refused = |why: String, next: &str| BoardError::Refused { what: "fault".into(), why, next: next.into() };
        let name = self.control.as_deref().or_else(|| board.uri.value("control"));
        let Some(name) = name else {
            let next = "write control=NAME into its link, sim: or xf-sim:, or name it with --control";
            return Err(refused(format!("the board {} has no control socket", board.uri), next));
        };
        inject(board, name, &self.event.join(" ")).map_err(|why| refused(why, "see `ecmsk link help`"))
    }
}

#[cfg(unix)]
fn inject(board: &Board, name: &str, event: &str) -> Result<(), String> {
    use ecmsk::link::control::{ControlError, Injection};

    let text = |error: ControlError| match error {
        ControlError::Wrong { text } => text,
        error => error.to_string(),
    };
    let mut injection = Injection::begin(name, event).map_err(text)?;
    // On a virtual clock, time advances only when this process lets a cycle pass.
    board.pass_cycle();
    injection.wait(CYCLE_LIMIT).map_err(text)?;
    Ok(())
}

#[cfg(not(unix))]
fn inject(_: &Board, _: &str, _: &str) -> Result<(), String> {
    Err("there are no control sockets on this system".to_owned())
}
