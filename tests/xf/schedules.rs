//! The driver and the model over a wire with random faults, by seeds: no command runs twice, each ends once with its
//! true outcome, no RxPDO and no TxPDO is lost uncounted, and the driver goes on.
//!
//! - `support::faulty_wire`: the faults; `network.rs`: what reached the slaves
//! - `rig.rs`: driver and chip with a clock; `books.rs`: what must hold
//!
//! `cargo xtask soak` runs many more of them. One schedule again: `ECMSK_SOAK_FIRST=<seed> ECMSK_SOAK_SCHEDULES=1`.

mod books;
mod network;
mod rig;

use std::collections::BTreeMap;
use std::ops::AddAssign;

use ecmsk::xf::request::FifoEnable;
use support::faulty_wire::Fault;
use support::schedules::run_all;

use books::End;
use rig::Rig;

/// Schedules of the test; `cargo xtask soak` asks for 10,000.
const SCHEDULES: u64 = 200;
/// Turns of the driver between two rests.
const TURNS: u64 = 900;

/// Totals of the schedules, to check that they did enough.
#[derive(Default, Debug)]
struct Done {
    faults: BTreeMap<Fault, u64>,
    ends: BTreeMap<String, u64>,
    outcomes: BTreeMap<String, u64>,
    errors: BTreeMap<String, u64>,
    bursts: u64,
    gaps: u64,
    silences: u64,
    indices_went_round: u64,
    int0_missed: u64,
    not_ready: u64,
    rejected: u64,
    asked_again: u64,
}

impl Done {
    fn numbers(&mut self) -> [&mut u64; 8] {
        [
            &mut self.bursts,
            &mut self.gaps,
            &mut self.silences,
            &mut self.indices_went_round,
            &mut self.int0_missed,
            &mut self.not_ready,
            &mut self.rejected,
            &mut self.asked_again,
        ]
    }

    fn end(&mut self, end: End) {
        *self.ends.entry(format!("{end:?}")).or_default() += 1;
    }

    /// Checks that every possible event happened, and often enough.
    fn assert_enough(&mut self, schedules: u64) {
        assert_eq!(self.faults.len(), 11, "{self:?}");
        assert_eq!(self.ends.len(), 4, "{self:?}");
        assert_eq!(self.outcomes.len(), 7, "{self:?}");
        let kinds = self.faults.values().chain(self.ends.values()).chain(self.outcomes.values());
        let least = kinds.copied().min();
        assert!(least.is_some_and(|least| least >= schedules / 10), "{self:?}");
        assert!(self.numbers().iter().all(|number| **number >= schedules / 10), "{self:?}");
    }
}

impl AddAssign for Done {
    fn add_assign(&mut self, mut other: Self) {
        for (all, one) in self.numbers().into_iter().zip(other.numbers()) {
            *all += *one;
        }
        for (fault, times) in other.faults {
            *self.faults.entry(fault).or_default() += times;
        }
        let maps =
            [(&mut self.ends, other.ends), (&mut self.outcomes, other.outcomes), (&mut self.errors, other.errors)];
        for (all, one) in maps {
            for (name, times) in one {
                *all.entry(name).or_default() += times;
            }
        }
    }
}

fn schedule(seed: u64) -> Done {
    let mut rig = Rig::new(seed);
    for _ in 0..3 {
        rig.bring_up();
        rig.stream(TURNS);
        rig.rest();
        burst(&mut rig);
    }
    rig.rest();
    rig.close()
}

/// Writes RxPDOs with random faults while the FIFO is stopped: the chip then has as many as were reported, and sends
/// each in one cycle.
fn burst(rig: &mut Rig) {
    let life = rig.bring_up();
    if !rig.run_quietly(&FifoEnable { on: false }) {
        return;
    }
    rig.pass(100);
    let before = rig.entries();
    let first = rig.write_with_faults();
    rig.rest();
    if life == rig.life() {
        rig.compare_entries(first, rig.entries() - before);
    }
    let on = rig.run_quietly(&FifoEnable { on: true });
    rig.pass(200);
    if on && life == rig.life() {
        rig.each_took_one_cycle(first);
    }
}

/// XF-12.7 XF-12.8 XF-12.10 XF-12.11 XF-12.15: bits flipped both ways, clocks lost and added, exchanges that fail,
/// packets cut, repeated, late and of a stranger, resets, another size of packets, INT0 lost, a host that is silent, a
/// chip that is slow or stays busy, too many process data and too few.
#[test]
fn random_schedules_of_faults() {
    let (schedules, mut all) = run_all("xf", "random_schedules_of_faults", SCHEDULES, schedule);
    if schedules >= SCHEDULES {
        all.assert_enough(schedules);
    }
}
