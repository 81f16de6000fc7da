//! The wires of an `XfBus` to the model of the chip, with random faults: those of [`Fault`], wires that are dead for a
//! while, a late host, lost edges of INT0.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};

use ecmsk::fieldbus::Ns;
use ecmsk::xf::DataSize;
use ecmsk::xf::chip::{Chip, SlaveModels};
use ecmsk::xf::host::Wires;
use support::dice::Dice;
use support::faulty_wire::{Fault, Wire};

use crate::followed::Ends;

const MS: Ns = 1_000_000;
/// The time of one byte.
const BYTE_NS: Ns = 333;
/// The interval at which INT0 is sampled.
const LOOK_NS: Ns = 10_000;
/// So many successive calls without elapsed time count as a hang.
const STANDSTILL: u32 = 1000;

/// The faults to come, which the schedule sets at any time.
#[derive(Default)]
pub struct Trouble {
    /// One in this number of exchanges has a fault; `None`: none has.
    pub rarely: Option<u64>,
    /// The wires carry nothing for that time from now on.
    pub dead_ns: Ns,
    /// The wires are whole again now.
    pub mended: bool,
    /// The delay of the next exchange.
    pub late_ns: Ns,
    /// The chip is reset now.
    pub reset: bool,
    /// The faults so far.
    pub faults: BTreeMap<Fault, u64>,
    /// A host that stalls before any exchange, and for how long; `None`: it does not.
    pub stalls: Option<Stalls>,
}

/// Says before each exchange for how long the host stalls.
pub type Stalls = Box<dyn FnMut() -> Option<Ns> + Send>;

impl Ends for Arc<Mutex<Trouble>> {
    fn fault(&mut self, what: u64, cycle_us: u32, dice: &mut Dice) {
        let mut trouble = self.lock().expect("no panic");
        match what {
            0 => trouble.reset = true,
            1 if dice.one_in(2) => {
                let most = dice.pick(&[1, 3, 3, 15]);
                trouble.dead_ns = 200 * MS + dice.below(most * 1000 * MS);
            }
            1 | 2 => trouble.dead_ns = dice.below(150 * MS),
            3..=6 => trouble.late_ns = dice.below(100) * Ns::from(cycle_us) * 1000,
            _ => trouble.rarely = dice.pick(&[None, None, Some(10), Some(40), Some(200)]),
        }
    }

    fn mend(&mut self) {
        let mut trouble = self.lock().expect("no panic");
        *trouble = Trouble { mended: true, faults: std::mem::take(&mut trouble.faults), ..Trouble::default() };
    }

    fn faults(&self) -> u64 {
        self.lock().expect("no panic").faults.values().sum()
    }
}

/// The wires.
pub struct Line {
    wire: Wire<SlaveModels>,
    trouble: Arc<Mutex<Trouble>>,
    dice: Dice,
    now: Ns,
    dead_until: Ns,
    resizes: bool,
    calls: u32,
    edge_lost: bool,
}

/// The exchange has failed before its end.
#[derive(Clone, Copy, Debug)]
pub struct Failed;

impl Line {
    /// Wires to that chip; `resizes`: the size of its packets may change by itself.
    pub fn new(chip: Chip<SlaveModels>, trouble: Arc<Mutex<Trouble>>, seed: u64, resizes: bool) -> Self {
        let dice = Dice(seed ^ 0x6C69_6E65);
        Self { wire: Wire::new(chip), trouble, dice, now: 0, dead_until: 0, resizes, calls: 0, edge_lost: false }
    }

    fn trouble(&self) -> MutexGuard<'_, Trouble> {
        self.trouble.lock().expect("no panic")
    }

    fn called(&mut self, before: Ns) {
        self.calls = if self.now > before { 0 } else { self.calls + 1 };
        assert!(self.calls < STANDSTILL, "the driver stands still");
    }
}

impl Wires for Line {
    type Error = Failed;

    fn now(&self) -> Ns {
        self.now
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), Failed> {
        let mut trouble = self.trouble();
        let rarely = trouble.rarely;
        let dead_ns = std::mem::take(&mut trouble.dead_ns);
        let stalled = trouble.stalls.as_mut().and_then(|stalls| stalls());
        let late_ns = std::mem::take(&mut trouble.late_ns).max(stalled.unwrap_or(0));
        let [mended, reset] = [std::mem::take(&mut trouble.mended), std::mem::take(&mut trouble.reset)];
        drop(trouble);
        let before = self.now;
        if mended {
            self.dead_until = 0;
        }
        self.now += late_ns;
        self.dead_until = self.dead_until.max(if dead_ns > 0 { self.now + dead_ns } else { 0 });
        from_chip.fill(0);
        if self.now < self.dead_until {
            self.now += BYTE_NS * to_chip.len() as Ns;
            self.wire.port.chip_mut().run_until(self.now);
            self.called(before);
            return Ok(());
        }
        let mut fault = rarely.and_then(|rarely| Fault::random(rarely, &mut self.dice));
        if reset {
            fault = Some(Fault::Reset);
        }
        match fault {
            Some(Fault::Reset) => self.wire.reset(self.now),
            Some(Fault::Resized) if self.resizes => {
                let size = self.dice.pick(&[32, 112, 300, 1024]);
                self.wire.resize(self.now, DataSize::new(size).expect("32 to 1408"));
            }
            Some(Fault::Resized) => fault = None,
            _ => {}
        }
        if let Some(fault) = fault {
            *self.trouble().faults.entry(fault).or_default() += 1;
        }
        let (end, answer) = self.wire.exchange(self.now, to_chip, fault, &mut self.dice);
        self.now = end;
        self.called(before);
        self.edge_lost = rarely.is_some() && self.dice.one_in(200);
        if fault == Some(Fault::Failed) {
            return Err(Failed);
        }
        let len = answer.len().min(from_chip.len());
        from_chip[..len].copy_from_slice(&answer[..len]);
        Ok(())
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), Failed> {
        let before = self.now;
        self.now = self.now.max(time);
        self.wire.port.chip_mut().run_until(self.now);
        self.called(before);
        Ok(())
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, Failed> {
        let before = self.now;
        let is_dead = self.now < self.dead_until;
        while self.now < until {
            if !is_dead && !self.edge_lost && self.wire.port.chip_mut().int0(self.now) {
                self.called(before);
                return Ok(true);
            }
            let step = if is_dead || self.edge_lost { until } else { LOOK_NS };
            self.now = until.min(self.now.saturating_add(step));
        }
        self.called(before);
        Ok(false)
    }
}
