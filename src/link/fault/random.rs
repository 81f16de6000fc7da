//! Decides which frame gets which fault. Each direction has its own pseudorandom sequence, which the seed determines.

use oorandom::Rand64;

use super::FaultRates;
use crate::address::Fraction;
use crate::link::Dir;

/// The faults to inject into one frame; several may come together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FrameFaults {
    pub(super) drop: bool,
    /// The index of the bit to flip; `None`: the frame is not corrupted.
    pub(super) corrupt: Option<usize>,
    pub(super) duplicate: bool,
    pub(super) delay: bool,
}

/// The pseudorandom sequence of faults in one direction.
#[derive(Clone, Debug)]
pub(super) struct FaultSequence {
    random: Rand64,
    rates: FaultRates,
    bits: u64,
}

impl FaultSequence {
    /// The sequence for frames of `bits` bits.
    pub(super) fn new(seed: u64, dir: Dir, rates: FaultRates, bits: usize) -> Self {
        Self { random: Rand64::new(u128::from(seed) << 1 | dir as u128), rates, bits: bits as u64 }
    }

    /// The faults of the next frame. Every frame uses the same number of random numbers, whatever its faults, so that
    /// changing the rate of one fault does not change which frames get the others.
    pub(super) fn next_frame(&mut self) -> FrameFaults {
        let mut meets = |rate| hits(self.random.rand_u64(), rate);
        let [drop, corrupt, duplicate, delay] =
            [self.rates.drop, self.rates.corrupt, self.rates.duplicate, self.rates.delay].map(&mut meets);
        let bit = self.random.rand_u64() % self.bits;
        FrameFaults { drop, corrupt: corrupt.then_some(bit as usize), duplicate, delay }
    }
}

/// Whether a uniformly distributed random number is a hit, which happens with the probability `rate`.
fn hits(number: u64, rate: Fraction) -> bool {
    u128::from(number) * u128::from(Fraction::ONE.billionths()) < u128::from(rate.billionths()) << 64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_happens_as_often_as_its_rate_says() {
        for number in [0, 1, u64::MAX / 2, u64::MAX] {
            assert!(!hits(number, Fraction::ZERO));
            assert!(hits(number, Fraction::ONE));
        }
        let half = Fraction::from_billionths(500_000_000);
        assert!(hits((1 << 63) - 1, half));
        assert!(!hits(1 << 63, half));
    }

    fn rates(drop: u32, corrupt: u32) -> FaultRates {
        FaultRates {
            drop: Fraction::from_billionths(drop),
            corrupt: Fraction::from_billionths(corrupt),
            ..FaultRates::default()
        }
    }

    /// The indices of the dropped frames among the first thousand.
    fn dropped(seed: u64, dir: Dir, rates: FaultRates) -> Vec<usize> {
        let mut sequence = FaultSequence::new(seed, dir, rates, 4032);
        (0..1000).filter(|_| sequence.next_frame().drop).collect()
    }

    #[test]
    fn seed_and_direction_choose_the_frames_and_another_rate_does_not() {
        let first = dropped(1, Dir::Write, rates(100_000_000, 0));
        assert!((50..150).contains(&first.len()), "{}", first.len());
        assert_eq!(dropped(1, Dir::Write, rates(100_000_000, 0)), first);
        assert_eq!(dropped(1, Dir::Write, rates(100_000_000, 500_000_000)), first);
        assert_ne!(dropped(2, Dir::Write, rates(100_000_000, 0)), first);
        assert_ne!(dropped(1, Dir::Read, rates(100_000_000, 0)), first);
    }

    #[test]
    fn any_bit_of_a_frame_can_be_corrupted() {
        let mut sequence = FaultSequence::new(1, Dir::Read, rates(0, 1_000_000_000), 16);
        let mut corrupted = [false; 16];
        for _ in 0..1000 {
            corrupted[sequence.next_frame().corrupt.expect("always")] = true;
        }
        assert_eq!(corrupted, [true; 16]);
    }
}
