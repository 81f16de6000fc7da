//! Looks for one condition in frames, of a recording or of a board.

use ecmsk::machine_file::MachineFile;
use ecmsk::recording::Kinds;

use super::condition::{Condition, Flag};
use super::expression::{self, ExpressionError};
use super::spans::{Span, Spans};
use super::values::Watch;
use crate::recording::Framed;

/// A condition, and the frames that were processed so far.
pub struct Search {
    watch: Watch,
    spans: Spans,
    needs_commands: bool,
}

impl Search {
    /// Parses the expression. `machine` is needed for axes that are given by name.
    ///
    /// # Errors
    /// [`ExpressionError`] if the expression is wrong.
    pub fn parse(expression: &str, machine: Option<&MachineFile>) -> Result<Self, ExpressionError> {
        let condition = expression::parse(expression, machine)?;
        let is_of_commands = |condition: &Condition| {
            matches!(condition, Condition::Gap | Condition::Flag { flag: Flag::Homing, .. })
                || condition.has_target()
                || condition.has_velocity()
        };
        let needs_commands = condition.has(&is_of_commands);
        Ok(Self { watch: Watch::new(), spans: Spans::new(condition), needs_commands })
    }

    /// Whether the condition depends on the commands of a program, which a reader of a board does not see.
    pub const fn needs_commands(&self) -> bool {
        self.needs_commands
    }

    /// The kinds of the slaves, where no command has said them.
    pub fn set_kinds(&mut self, kinds: Kinds) {
        self.watch.set_kinds(kinds);
    }

    /// Processes the next frame; frames must be sorted by time. `counts`: the condition is looked at in this report.
    pub fn frame(&mut self, framed: &Framed, counts: bool) {
        if let Some(execution) = self.watch.frame(framed)
            && counts
        {
            self.spans.report(framed.time_ns, &self.watch, execution);
        }
    }

    /// When the condition became true, if that was since the last call: the time of the report in nanoseconds. For boards,
    /// whose time spans have no end: those that are over are forgotten.
    pub fn begun(&mut self) -> Option<i64> {
        self.spans.begun()
    }

    /// Must be called after the last frame. Returns the time spans in which the condition was true.
    pub fn finish(self) -> Vec<Span> {
        self.spans.finish()
    }
}
