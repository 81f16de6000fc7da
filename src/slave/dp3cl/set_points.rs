//! Profile position: the handshake by which set-points are taken (controlword bits 4, 5 and 6, statusword bit 12).

use super::profile::Ramps;

/// Controlword bit 4: a new set-point.
const NEW_SET_POINT: u16 = 1 << 4;
/// Controlword bit 5: change at once, interrupting the motion.
const AT_ONCE: u16 = 1 << 5;
/// Controlword bit 6: the target position is relative.
const RELATIVE: u16 = 1 << 6;

/// The values that a set-point takes over when bit 4 rises.
#[derive(Clone, Copy, Debug)]
pub(super) struct SetPointValues {
    /// 0x607A, with its sign for the shaft.
    pub(super) target: i32,
    /// Speed and ramps. A speed of 0 cancels the set-point.
    pub(super) ramps: Ramps,
}

/// A motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Move {
    pub(super) target: i64,
    pub(super) ramps: Ramps,
}

/// The set-points of profile position.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SetPoints {
    /// The motion under way.
    current: Option<Move>,
    /// The set-point that begins after it, in the variant with a buffer: whether it is relative, and its values.
    buffered: Option<(bool, SetPointValues)>,
    /// The target of the newest set-point, to which relative ones are added \[OURS].
    last_target: i64,
    new_bit: bool,
    acknowledged: bool,
    /// A limit switch has ended the last motion before its target.
    missed: bool,
}

impl SetPoints {
    /// Profile position begins at a position. Bit 4 has to rise for a set-point.
    pub(super) fn begin(position: i64, word: u16) -> Self {
        Self { last_target: position, new_bit: word & NEW_SET_POINT != 0, ..Self::default() }
    }

    /// All set-points are void; the axis stands at a position.
    pub(super) fn void(&mut self, position: i64, word: u16) {
        *self = Self::begin(position, word);
    }

    /// A limit switch has stopped the motion.
    pub(super) const fn stop_short(&mut self, position: i64) {
        self.missed |= self.current.is_some();
        (self.current, self.buffered, self.last_target) = (None, None, position);
    }

    /// Takes a controlword. `buffers`: a set-point during a motion is kept for later instead of being ignored.
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

    /// Starts a motion. False: its speed is 0, and the motion before it is cancelled, too. \[OURS] It is not acknowledged then.
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

    /// The motion under way.
    pub(super) const fn current(&self) -> Option<&Move> {
        self.current.as_ref()
    }

    /// The motion has arrived at its target.
    pub(super) fn arrive(&mut self) {
        self.current = None;
        if let Some((relative, values)) = self.buffered.take() {
            self.start(relative, values);
            self.acknowledged &= self.new_bit;
        }
    }

    /// Statusword bit 12: a set-point was taken, and bit 4 has not fallen yet.
    pub(super) const fn is_acknowledged(&self) -> bool {
        self.acknowledged
    }

    /// Whether there is nothing left to do, and nothing was missed.
    pub(super) const fn are_complete(&self) -> bool {
        self.current.is_none() && self.buffered.is_none() && !self.missed
    }
}
