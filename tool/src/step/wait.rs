//! `wait`: waits until a time has passed on the board's clock, which is a virtual clock on some simulated boards.

use std::time::Duration;

use serde_json::json;

use crate::board::{Board, BoardError, duration};

/// Wait, by the board's clock; enabled axes hold their position
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// How long, e.g. 0.5s or 500ms
    #[arg(value_name = "TIME", value_parser = duration)]
    time: Duration,
}

impl Args {
    /// Waits for the given time, and shows its progress.
    ///
    /// # Errors
    /// [`BoardError`] if the board sends no report in time, a signal stops the wait, or standard output cannot be written
    /// to.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        let start = board.ecm.snapshot()?.meta.at.0;
        let mut pace = board.reporter.pace();
        loop {
            board.check_stop()?;
            let at = board.ecm.next_cycle(board.options.read_limit)?.meta.at.0;
            let elapsed = Duration::from_nanos(at.saturating_sub(start));
            if elapsed >= self.time {
                board.reporter.clear();
                return Ok(());
            }
            if pace.due(elapsed) {
                let (now, all) = (elapsed.as_secs_f64(), self.time.as_secs_f64());
                board.reporter.part(
                    now / all,
                    format_args!("waiting, {now:.1} of {all} s"),
                    || json!({"verb": "wait", "progress": now / all, "seconds": now}),
                )?;
            }
        }
    }
}
