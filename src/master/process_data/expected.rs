//! Which working counters of a datagram are right: that of the slaves which take part for certain, and what others may add.

use crate::master::shared::Standing;

/// The working counters of a datagram that are right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Expected {
    /// What is added for certain.
    certain: u16,
    /// Bit n: the others may add n. Forty slaves add 120 at most.
    besides: u128,
    /// What all add together.
    most: u16,
}

impl Default for Expected {
    /// Of no slave: 0.
    fn default() -> Self {
        Self { certain: 0, besides: 1, most: 0 }
    }
}

impl Expected {
    /// A slave is in the datagram, for whose outputs and inputs so much is counted.
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

    /// Anything up to that may be added.
    fn add_any(&mut self, counts: u16) {
        (0..counts).for_each(|_| self.besides |= self.besides << 1);
    }

    /// Whether a working counter is one of these.
    pub(super) fn allows(&self, counter: u16) -> bool {
        let besides = counter.checked_sub(self.certain).filter(|besides| u32::from(*besides) < u128::BITS);
        besides.is_some_and(|besides| self.besides >> besides & 1 != 0)
    }

    /// Whether it shows that all slaves in the datagram have taken part, whatever was known of them.
    pub(super) const fn is_of_all(&self, counter: u16) -> bool {
        counter == self.most
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ethercat::SlaveSet;

    /// The working counters that are right for slaves with outputs and inputs, of which some are not in OP.
    fn allowed(slaves: u8, change: impl FnOnce(&mut Standing)) -> Vec<u16> {
        let mut standing = Standing { in_op: SlaveSet::first(slaves), ..Standing::default() };
        change(&mut standing);
        let mut expected = Expected::default();
        (1..=slaves).for_each(|slave| expected.add(&standing, slave, [2, 1]));
        (0..200).filter(|counter| expected.allows(*counter)).collect()
    }

    /// Where all are in OP one working counter is right; a slave in SafeOP adds its inputs, one that is gone all or nothing, one
    /// that is on its way any part, and none adds more than it has.
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
