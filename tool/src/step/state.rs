//! `state`: shows or changes the state of the network.

use ecmsk::sk::MasterState;
use serde_json::json;

use crate::board::{Board, BoardError, slaves_with_axis};

/// Show or change the network's state
///
/// On the way up from PreOP the network is configured first (SET_AXIS, SET_DC, DRIVE_MODE), as --slaves or the sim:
/// link describes it. No axis is switched on. Leaving OP switches the axes off.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The state to go to; without it the state is shown
    #[arg(value_name = "init|preop|safeop|op", value_parser = parse)]
    to: Option<MasterState>,
}

impl Args {
    /// Whether the step only reads reports, so that it sends no command.
    pub const fn only_looks(&self) -> bool {
        self.to.is_none()
    }
}

const STATES: [MasterState; 4] = [MasterState::Init, MasterState::PreOp, MasterState::SafeOp, MasterState::Op];

/// Parses the name of a state: `init`, `preop`, `safeop` or `op`.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn parse(text: &str) -> Result<MasterState, String> {
    let state = STATES.into_iter().find(|state| state.name().eq_ignore_ascii_case(text));
    state.ok_or_else(|| "allowed: init, preop, safeop, op".into())
}

impl Args {
    /// Changes the network to the given state, if there is one, and prints the present state.
    ///
    /// # Errors
    /// [`BoardError`] if the network does not reach the state, the board does not answer, or a signal stops the change.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        if let Some(to) = self.to {
            leave_op(board, to)?;
            board.go_to(to)?;
        }
        let state = board.ecm.state()?;
        let failed = state.is_failed();
        let name = state.state().map(MasterState::name);
        let why = board.why_failed(state);
        let text = why.as_ref().map_or_else(|| state.to_string(), |why| format!("{state}: {why}"));
        let mut json = json!({"verb": "state", "state": name, "failed": failed});
        if let Some(why) = why {
            json["why"] = why.into();
        }
        Ok(board.reporter.result(text, &json)?)
    }
}

/// If the change leaves OP, prints a note on the axes that it switches off, because a vertical axis without a brake
/// drops.
fn leave_op(board: &Board, to: MasterState) -> Result<(), BoardError> {
    let snapshot = board.ecm.snapshot()?;
    if to == MasterState::Op || snapshot.state().state() != Some(MasterState::Op) {
        return Ok(());
    }
    let axes = board.config.iter().flat_map(slaves_with_axis);
    let on: Vec<u8> = axes.filter(|slave| board.statusword(&snapshot, *slave).is_enabled()).collect();
    if !on.is_empty() {
        board.reporter.note(format_args!("leaving OP switches off {}", board.labels(&on)));
    }
    Ok(())
}
