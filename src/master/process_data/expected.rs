//! The right working counters of a datagram: the sum of what the certain participants add, plus what other slaves may add.

use crate::master::shared::Standing;

/// The working counters with which a datagram is accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Expected {
    /// The sum of what the slaves that take part for certain add to the working counter.
    certain: u16,
    /// Bit n: all other slaves together may add n. Forty slaves add 120 at most.
    besides: u128,
    /// The working counter if all slaves take part with all their data.
    most: u16,
}

impl Default for Expected {
    /// The right working counters of a datagram without slaves: only 0.
    fn default() -> Self {
        Self { certain: 0, besides: 1, most: 0 }
    }
}

impl Expected {
    /// Adds a slave to the datagram. `outputs` and `inputs`: what each of them adds to the working counter.
    pub(super) fn add(&mut self, standing: &Standing, slave: u8, [outputs, inputs]: [u16; 2]) {
        self.most += outputs + inputs;
        if standing.in_op.contains(slave) {
            self.certain += outputs + inputs;
        } else if standing.in_safe_op.contains(slave) {
            self.certain += inputs;
            self.add_any(outputs);
        } else if standing.gone.contains(slave) {
            self.besides |= self.besides << (outputs + inputs);
        } else if standing.unsure.contains(slave) {
            self.add_any(outputs + inputs);
        }
    }

    /// Allows the working counter to be higher by any number from 0 to `counts`.
    fn add_any(&mut self, counts: u16) {
        (0..counts).for_each(|_| self.besides |= self.besides << 1);
    }

    /// Whether a datagram with this working counter is accepted.
    pub(super) fn allows(&self, counter: u16) -> bool {
        let besides = counter.checked_sub(self.certain).filter(|besides| u32::from(*besides) < u128::BITS);
        besides.is_some_and(|besides| self.besides >> besides & 1 != 0)
    }

    /// Whether a working counter shows that all slaves in the datagram have taken part with all their data.
    pub(super) const fn is_of_all(&self, counter: u16) -> bool {
        counter == self.most
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ethercat::SlaveSet;

    /// The right working counters for `slaves` slaves with outputs and inputs; `change` takes some of them out of OP.
    fn allowed(slaves: u8, change: impl FnOnce(&mut Standing)) -> Vec<u16> {
        let mut standing = Standing { in_op: SlaveSet::first(slaves), ..Standing::default() };
        change(&mut standing);
        let mut expected = Expected::default();
        (1..=slaves).for_each(|slave| expected.add(&standing, slave, [2, 1]));
        (0..200).filter(|counter| expected.allows(*counter)).collect()
    }

    /// If all slaves are in OP, one working counter is right. A slave in SafeOP adds at least its inputs, a missing one
    /// all or nothing, and one that changes its state any part. No slave adds more than its data.
    #[test]
    fn what_slaves_may_add_together() {
        let first = SlaveSet::first(1);
        let out_of_op = |standing: &mut Standing| standing.in_op.remove(1);
        assert_eq!(allowed(3, |_| {}), [9]);
        assert_eq!(allowed(3, |all| (out_of_op(all), all.in_safe_op = first).1), [7, 8, 9]);
        assert_eq!(allowed(3, |all| (out_of_op(all), all.gone = first).1), [6, 9]);
        assert_eq!(allowed(2, |all| (out_of_op(all), all.unsure = first).1), [3, 4, 5, 6]);
        assert_eq!(allowed(2, out_of_op), [3]);
        assert_eq!(allowed(0, |_| {}), [0]);
        assert_eq!(allowed(40, |_| {}), [120]);
        let none_in_op = |all: &mut Standing| std::mem::replace(&mut all.in_op, SlaveSet::EMPTY);
        assert_eq!(allowed(40, |all| all.gone = none_in_op(all)).len(), 41);
        assert_eq!(allowed(40, |all| all.unsure = none_in_op(all)).len(), 121);
    }
}
