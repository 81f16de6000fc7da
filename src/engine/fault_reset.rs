//! The pulse of ALM_CLR: bit 7 of the controlword rises, stays, and falls.

/// Sets of outputs with the bit set, and the least number without it before it rises again \[OURS]: 2 ms at the shortest
/// cycle, so that a drive that looks at its controlword more seldom than that sees the edge all the same.
const PULSE_SETS: u8 = 8;

/// The bit in the set of outputs made last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Bit {
    /// Clear, and free to rise.
    #[default]
    Clear,
    /// Set, and so often more.
    Set { more: u8 },
    /// Clear, and so often more before it may rise.
    Resting { more: u8 },
}

/// The pulses of one axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct FaultReset {
    bit: Bit,
    /// An ALM_CLR whose pulse has not op_start. One that comes during a pulse makes another one after it \[OURS]: the
    /// drive may be ready for it only then.
    requested: bool,
}

impl FaultReset {
    /// ALM_CLR.
    pub(super) const fn request(&mut self) {
        self.requested = true;
    }

    /// There is no fault (any more).
    pub(super) const fn end(&mut self) {
        self.requested = false;
        if let Bit::Set { more } = &mut self.bit {
            *more = 0;
        }
    }

    /// Whether the bit is set, or still has to change.
    pub(super) const fn is_under_way(&self) -> bool {
        self.requested || !matches!(self.bit, Bit::Clear)
    }

    /// The bit in the next set of outputs.
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

    /// SK-7.11 The pulse of ALM_CLR: 8 sets of outputs with the bit, then 8 without it before the next one.
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
