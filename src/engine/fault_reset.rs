//! The fault reset pulse of ALM_CLR: bit 7 of the controlword rises, stays set for some cycles, and falls.

/// The length of a pulse in sets of outputs (one set per cycle), and the minimum number of sets with the bit clear
/// until the next pulse \[OURS]. That is 2 ms at the shortest cycle, so that a drive that does not read its controlword
/// in every cycle still sees the edge.
const PULSE_SETS: u8 = 8;

/// The state of the fault reset bit in the set of outputs that was made last; each cycle sends one set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Bit {
    /// The bit is clear, and may rise with the next set.
    #[default]
    Clear,
    /// The bit is set, and stays set in the next `more` sets.
    Set { more: u8 },
    /// The bit is clear, and has to stay clear in the next `more` sets before it may rise.
    Resting { more: u8 },
}

/// The state of the fault reset pulses of one axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct FaultReset {
    bit: Bit,
    /// An ALM_CLR came whose pulse has not begun. An ALM_CLR during a pulse causes another pulse after it \[OURS],
    /// since the drive may not have been ready for a reset before.
    requested: bool,
}

impl FaultReset {
    /// Requests a pulse, for ALM_CLR.
    pub(super) const fn request(&mut self) {
        self.requested = true;
    }

    /// Called when the drive shows no fault: a pulse in progress ends with the outputs of the next cycle, and a requested pulse
    /// is dropped.
    pub(super) const fn end(&mut self) {
        self.requested = false;
        if let Bit::Set { more } = &mut self.bit {
            *more = 0;
        }
    }

    /// Whether a pulse is requested or in progress, or the pause after a pulse has not ended.
    pub(super) const fn is_under_way(&self) -> bool {
        self.requested || !matches!(self.bit, Bit::Clear)
    }

    /// The value of the fault reset bit for the next set of outputs.
    pub(super) const fn next_bit(&mut self) -> bool {
        self.bit = match self.bit {
            Bit::Clear if self.requested => {
                self.requested = false;
                Bit::Set { more: PULSE_SETS - 1 }
            }
            Bit::Clear => return false,
            Bit::Set { more: 0 } => Bit::Resting { more: PULSE_SETS - 2 },
            Bit::Set { more } => Bit::Set { more: more - 1 },
            Bit::Resting { more: 0 } => Bit::Clear,
            Bit::Resting { more } => Bit::Resting { more: more - 1 },
        };
        matches!(self.bit, Bit::Set { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SK-7.11 The pulse of ALM_CLR: 8 sets of outputs with the bit set, then at least 8 with the bit clear before the
    /// next pulse.
    #[test]
    fn pulses_are_as_long_as_the_pauses_between_them() {
        let mut reset = FaultReset::default();
        reset.request();
        let bits: Vec<bool> = (0..40)
            .map(|_| {
                reset.request();
                reset.next_bit()
            })
            .collect();
        let expected: Vec<bool> = (0..40).map(|set| set / 8 % 2 == 0).collect();
        assert_eq!(bits, expected);
    }
}
