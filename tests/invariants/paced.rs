//! The checks of a schedule on a bus that the runner paces: each cycle of the board is one of the bus, and its report
//! answers it.

use ecmsk::engine::Counters;
use ecmsk::fieldbus::Ns;
use ecmsk::sk::{Frame, SlaveCommand, SlotCommand, SlotSize};

use crate::books::Books;
use crate::machine::Machine;
use crate::program::{Checks, Done};
use crate::watch::Watch;

pub struct Paced {
    books: Books,
    watch: Watch,
}

impl Paced {
    pub fn new(machine: &Machine) -> Self {
        Self { books: Books::default(), watch: Watch::new(machine) }
    }
}

impl Checks for Paced {
    fn next_mark(&mut self) -> SlotCommand {
        SlaveCommand::IoRead.with_index(self.books.next_mark())
    }

    fn arrived(&mut self, frame: &Frame, size: SlotSize, before: &Counters, after: &Counters) {
        self.books.arrived(frame, size, before, after);
    }

    fn forget(&mut self) {
        self.books.forget();
    }

    fn jam(&mut self, _: &Machine, n: usize, jammed: bool) {
        self.watch.jam(n, jammed);
    }

    fn cycle(&mut self, machine: &Machine, reports: &[(Frame, Ns)], dt_ns: Ns, before: &Counters, after: &Counters) {
        let report = reports.first().map(|(report, _)| report);
        self.books.cycle(machine, report, before, after);
        self.watch.cycle(machine, report, dt_ns);
    }

    fn tell(&self, done: &mut Done) {
        (done.followed, done.discarded) = (self.books.followed, self.books.discarded);
        (done.homed, done.fastest) = (self.watch.homed, self.watch.fastest);
    }

    fn close(&self, _: &Machine) {}
}
