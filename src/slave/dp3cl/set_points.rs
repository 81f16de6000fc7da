//! Profile position: the handshake for set-points (controlword bits 4, 5 and 6, statusword bit 12).

use super::profile::Ramps;

/// Controlword bit 4: its rising edge gives a new set-point.
const NEW_SET_POINT: u16 = 1 << 4;
/// Controlword bit 5: change immediately, interrupting the present motion.
const AT_ONCE: u16 = 1 << 5;
/// Controlword bit 6: the target position is relative.
const RELATIVE: u16 = 1 << 6;

/// The object values that a set-point latches at the rising edge of bit 4.
#[derive(Clone, Copy, Debug)]
pub(super) struct SetPointValues {
    /// The target position 0x607A, converted to the direction of the shaft by the polarity (0x607E).
    pub(super) target: i32,
    /// Speed and ramps. A speed of 0 cancels the motion.
    pub(super) ramps: Ramps,
}

/// A motion towards a target position, with its speed and ramps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Move {
    pub(super) target: i64,
    pub(super) ramps: Ramps,
}

/// The set-points of profile position: the present motion and the handshake.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SetPoints {
    /// The present motion to a set-point; `None`: all set-points are reached or cancelled.
    current: Option<Move>,
    /// The set-point that starts when the present motion ends: whether it is relative, and its values. Only used in the
    /// variant `one_deep_buffer` of the drive. `None`: there is none.
    buffered: Option<(bool, SetPointValues)>,
    /// The target of the newest set-point, command units. Relative set-points are added to it \[OURS].
    last_target: i64,
    new_bit: bool,
    acknowledged: bool,
    /// Whether a limit switch has ended the last motion before its target. If so, statusword bit 10 (target reached) is 0
    /// except during a halt.
    missed: bool,
}

impl SetPoints {
    /// The state when profile position is entered at `position` with the controlword `word`. If its bit 4 (new set-point) is
    /// set already, the bit must fall and rise again for a set-point.
    pub(super) fn begin(position: i64, word: u16) -> Self {
        Self { last_target: position, new_bit: word & NEW_SET_POINT != 0, ..Self::default() }
    }

    /// Cancels all set-points; the axis is at standstill at `position`.
    pub(super) fn void(&mut self, position: i64, word: u16) {
        *self = Self::begin(position, word);
    }

    /// Ends the present motion at `position`, because a limit switch has stopped it.
    pub(super) const fn stop_short(&mut self, position: i64) {
        self.missed |= self.current.is_some();
        (self.current, self.buffered, self.last_target) = (None, None, position);
    }

    /// Handles a controlword. With `buffers`, a set-point during a motion is stored for later instead of being ignored.
    pub(super) fn command(&mut self, word: u16, values: SetPointValues, buffers: bool) {
        let was_set = std::mem::replace(&mut self.new_bit, word & NEW_SET_POINT != 0);
        if !self.new_bit {
            self.acknowledged = self.buffered.is_some();
        }
        if was_set || !self.new_bit {
            return;
        }
        let relative = word & RELATIVE != 0;
        if self.current.is_none() || word & AT_ONCE != 0 {
            self.acknowledged = self.start(relative, values);
        } else if buffers && self.buffered.is_none() {
            self.buffered = Some((relative, values));
            self.acknowledged = true;
        }
    }

    /// Starts a motion. Returns false if the speed is 0; then the present motion is cancelled. \[OURS] Such a set-point is
    /// not acknowledged.
    fn start(&mut self, relative: bool, values: SetPointValues) -> bool {
        let target = i64::from(values.target);
        self.missed = false;
        if values.ramps.velocity <= 0.0 {
            self.current = None;
            return false;
        }
        self.last_target = if relative { self.last_target.wrapping_add(target) } else { target };
        self.current = Some(Move { target: self.last_target, ramps: values.ramps });
        true
    }

    /// The present motion; `None` if there is none.
    pub(super) const fn current(&self) -> Option<&Move> {
        self.current.as_ref()
    }

    /// Ends the present motion at its target, and starts the buffered set-point.
    pub(super) fn arrive(&mut self) {
        self.current = None;
        if let Some((relative, values)) = self.buffered.take() {
            self.start(relative, values);
            self.acknowledged &= self.new_bit;
        }
    }

    /// Statusword bit 12: a set-point was accepted, and bit 4 has not fallen yet.
    pub(super) const fn is_acknowledged(&self) -> bool {
        self.acknowledged
    }

    /// Whether all motions are done and none was stopped before its target.
    pub(super) const fn are_complete(&self) -> bool {
        self.current.is_none() && self.buffered.is_none() && !self.missed
    }
}
