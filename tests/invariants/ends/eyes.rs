//! A link that observes the shafts and the drives' commands at each call.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use ecmsk::cia402::{Controlword, Mode};
use ecmsk::fieldbus::sim::{Shafts, SimHandle};
use ecmsk::link::engine::EngineLink;
use ecmsk::link::{Layer, Link, LinkError, ReadMeta, Stamp, Wait};
use ecmsk::sk::{CommandId, FIFO_ENTRIES, Frame, MasterResponse, MasterState, SlotSize};
use ecmsk::slave::{DeviceFault, Fault};
use support::dice::Dice;

use crate::machine::Unit;
use crate::tap::Seen as Taken;

/// An axis that does not move for that time counts as at rest.
const HELD_NS: u64 = 100_000_000;

/// An entry that is not executed within that many cycles counts as held.
const HELD_CYCLES: u32 = 4;

/// The link.
pub struct Eyes {
    inner: EngineLink,
    network: SimHandle,
    /// Slaves with axes: the number of axes, their mode, and a tap on their outputs.
    axes: Vec<(u8, usize, Mode, Taken)>,
    seen: Mutex<Seen>,
    size: SlotSize,
}

/// A fault while a server stops axes.
#[derive(Clone, Copy, Debug)]
pub enum Break {
    /// The cable behind that many slaves is cut.
    Cable(u8),
    /// A slave falls silent.
    Silence(u8),
    /// A slave loses its power.
    Power(u8),
    /// A drive has an alarm.
    Alarm(u8),
}

struct Seen {
    report: Frame,
    at: Stamp,
    moving: bool,
    last: Shafts,
    /// Calls until a fault, and the fault.
    breaks_in: Option<(u64, Break)>,
    is_broken: bool,
    /// Stalls of the server's process.
    stalls: Option<Stalls>,
    /// Time at rest.
    stood: Duration,
    /// Whether a drive was homing: it may begin to move by itself.
    has_homed: bool,
    /// Entries that the board has executed, and the positions of the shafts at the last one.
    executed: u64,
    since: Shafts,
    /// The drives' commands since the writer's end: the last target of each axis, and the greatest step or velocity.
    told: Option<BTreeMap<(u8, usize), Told>>,
}

/// Stalls to come.
struct Stalls {
    dice: Dice,
    left: u64,
    /// One comes before one of that many calls.
    rarely: u64,
}

#[derive(Clone, Copy)]
struct Told {
    last: i32,
    greatest: i64,
}

impl Eyes {
    pub fn new(inner: EngineLink, network: SimHandle, units: &[Unit]) -> Self {
        let size = inner.info().slot.expect("it knows");
        let axes = units.iter().map(|unit| (unit.slave as u8, unit.axes, unit.mode, unit.seen.clone())).collect();
        let last = network.shafts();
        let (report, since) = (Frame::new(), last.clone());
        let seen = Seen {
            report,
            at: Stamp(0),
            moving: false,
            last,
            breaks_in: None,
            is_broken: false,
            stalls: None,
            stood: Duration::ZERO,
            has_homed: false,
            executed: 0,
            since,
            told: None,
        };
        Self { inner, network, axes, seen: Mutex::new(seen), size }
    }

    fn seen(&self) -> std::sync::MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Records the shafts' positions after a call.
    fn look(&self) {
        let shafts = self.network.shafts();
        let executed = self.executed();
        let mut seen = self.seen();
        if executed != seen.executed {
            (seen.executed, seen.since) = (executed, shafts.clone());
        }
        if shafts.at > seen.last.at {
            let moving = self.ways(&seen.last, &shafts).any(|way| way.abs() > 20);
            seen.moving = moving;
            seen.last = shafts;
        }
        if let Some(told) = &mut seen.told {
            for (slave, axes, mode, taken) in &self.axes {
                let taken = *taken.lock().unwrap_or_else(PoisonError::into_inner);
                let Some(outputs) = taken else { continue };
                for (axis, output) in outputs.iter().enumerate().take(*axes) {
                    let entry = told.entry((*slave, axis)).or_insert(Told { last: output.target, greatest: 0 });
                    // The board itself sets the target of an axis that went off to its position. The axis has failed by
                    // itself, as by a following error, so this is no step of the ramp.
                    let is_on = output.controlword == Controlword::ENABLE_OPERATION;
                    let size = match mode {
                        _ if !is_on => 0,
                        Mode::Csp => i64::from(output.target.wrapping_sub(entry.last)).abs(),
                        _ => i64::from(output.target).abs(),
                    };
                    *entry = Told { last: output.target, greatest: size.max(entry.greatest) };
                }
            }
        }
    }

    /// From now on the drives' commands are the server's. Earlier stalls are over, and forgotten.
    pub fn begin_to_compare(&self) {
        let mut seen = self.seen();
        seen.told = Some(BTreeMap::new());
        (seen.stalls, seen.stood) = (None, Duration::ZERO);
    }

    /// The greatest steps and velocities since then, of axes in CSP and CSV.
    pub fn greatest(&self) -> Vec<(u8, usize, &'static str, i64)> {
        let told = self.seen().told.clone().unwrap_or_default();
        let name = |slave: u8| match self.axes.iter().find(|axis| axis.0 == slave)?.2 {
            Mode::Csp => Some("CSP"),
            Mode::Csv => Some("CSV"),
            _ => None,
        };
        let all = told.into_iter();
        all.filter_map(|((slave, axis), told)| Some((slave, axis, name(slave)?, told.greatest))).collect()
    }

    fn axes(&self) -> impl Iterator<Item = (u8, usize)> {
        self.axes.iter().flat_map(|(slave, axes, ..)| (0..*axes).map(|axis| (*slave, axis)))
    }

    /// The board's time.
    pub fn now(&self) -> Duration {
        let now = self.inner.pass(Duration::ZERO).expect("it is there").expect("virtual time");
        Duration::from_nanos(now.0)
    }

    /// Whether a shaft has moved lately.
    pub fn is_moving(&self) -> bool {
        self.seen().moving
    }

    /// Whether the board holds the entries of its FIFO, and no axis has moved for a while. If that is possible it lets
    /// some cycles pass, in which fresh entries would be executed.
    pub fn holds_what_waits(&self, cycle: Duration) -> bool {
        let holds = || {
            let seen = self.seen();
            let long = seen.last.at - seen.since.at > HELD_NS;
            long && !seen.has_homed && self.ways(&seen.since, &seen.last).all(|way| way.abs() <= 10)
        };
        if self.newest_free() >= FIFO_ENTRIES - 1 || !holds() {
            return false;
        }
        Layer::pass(self, HELD_CYCLES * cycle).expect("it is there");
        holds()
    }

    /// The distance that each axis has moved.
    fn ways(&self, from: &Shafts, to: &Shafts) -> impl Iterator<Item = i64> {
        self.axes().map(|(slave, axis)| {
            let place = usize::from(slave) - 1;
            to.positions[place][axis].unwrap_or(0) - from.positions[place][axis].unwrap_or(0)
        })
    }

    /// Free entries by the newest report that was read.
    pub fn newest_free(&self) -> u16 {
        let board = MasterResponse::decode(&self.report().slot(self.size, 0));
        if board.state.state() == Some(MasterState::Op) { board.fifo_free } else { FIFO_ENTRIES }
    }

    /// The newest report that was read.
    pub fn report(&self) -> Frame {
        self.seen().report.clone()
    }

    /// Sets a fault after that many calls from now on.
    pub fn break_in(&self, calls: u64, what: Break) {
        self.seen().breaks_in = Some((calls, what));
    }

    /// Makes the server's process stall before one of `rarely` calls from now on, several times.
    pub fn stand_still(&self, mut dice: Dice, rarely: u64) {
        let left = 1 + dice.below(3);
        self.seen().stalls = Some(Stalls { dice, left, rarely });
    }

    /// Time at rest.
    pub fn stood(&self) -> Duration {
        self.seen().stood
    }

    fn may_stand(&self) {
        let time = {
            let mut seen = self.seen();
            let Some(Stalls { dice, left, rarely }) = &mut seen.stalls else { return };
            if *left == 0 || !dice.one_in(*rarely) {
                return;
            }
            *left -= 1;
            let most = dice.pick(&[20, 200, 1200, 5000]);
            let time = Duration::from_millis(dice.below(most));
            seen.stood += time;
            time
        };
        // In short steps, so that the drives' commands meanwhile are seen.
        for _ in 0..time.as_millis() {
            self.inner.pass(Duration::from_millis(1)).expect("it is there");
            self.look();
        }
    }

    fn count_down(&self) {
        self.may_stand();
        let mut seen = self.seen();
        let Some((left, what)) = &mut seen.breaks_in else { return };
        if *left > 0 {
            *left -= 1;
            return;
        }
        match *what {
            Break::Cable(slaves) => self.network.cut_after(slaves),
            Break::Silence(slave) => self.network.silence(slave, true),
            Break::Power(slave) => self.network.lose(slave),
            Break::Alarm(slave) => {
                self.network.apply_fault(
                    slave,
                    Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x8611, resettable: true } },
                );
            }
        }
        (seen.breaks_in, seen.is_broken) = (None, true);
    }

    pub fn is_broken(&self) -> bool {
        self.seen().is_broken
    }

    /// Heals everything for good.
    pub fn heal(&self) {
        self.seen().stalls = None;
        self.network.heal();
        for (slave, ..) in &self.axes {
            self.network.find(*slave);
        }
        let mut seen = self.seen();
        (seen.breaks_in, seen.is_broken) = (None, false);
    }

    /// Entries that the board has executed.
    pub fn executed(&self) -> u64 {
        self.inner.stats().board.expect("a model").executed
    }

    /// Frames that found the FIFO full.
    pub fn full(&self) -> u64 {
        self.inner.stats().board.expect("a model").full
    }

    /// Reads until a report comes that was made after this call.
    pub fn drain(&self) {
        let now = self.now();
        let mut report = Frame::new();
        while Link::read(self, &mut report, Wait::For(Duration::from_secs(1)))
            .is_ok_and(|meta| u128::from(meta.at.0) < now.as_nanos())
        {}
    }

    pub fn shafts(&self) -> Shafts {
        self.network.shafts()
    }

    /// Asserts that no shaft is further than that from its old position.
    pub fn assert_still(&self, from: &Shafts, counts: i64, when: &str) {
        let now = self.network.shafts();
        for (slave, axis) in self.axes() {
            let place = usize::from(slave) - 1;
            let (was, is) = (from.positions[place][axis], now.positions[place][axis]);
            let way = is.unwrap_or(0) - was.unwrap_or(0);
            let time = Duration::from_nanos(now.at - from.at);
            assert!(
                way.abs() <= counts,
                "slave {slave}, axis {axis}, moved {way} counts in {time:?} {when}; {:?}",
                self.axes.iter().map(|axis| axis.2).collect::<Vec<_>>()
            );
        }
    }
}

impl Layer for Eyes {
    fn inner(&self) -> &dyn Link {
        &self.inner
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.count_down();
        let done = self.inner.write(frame, wait);
        let mut homes = self.axes.iter().map(|(slave, ..)| frame.slot(self.size, usize::from(*slave)).id);
        self.seen().has_homed |= homes.any(|id| id == CommandId::GoHome.code());
        self.look();
        done
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.count_down();
        let done = self.inner.read(out, wait);
        self.look();
        if let Ok(meta) = &done {
            let mut seen = self.seen();
            if meta.at >= seen.at {
                seen.at = meta.at;
                seen.report.clone_from(out);
            }
        }
        done
    }

    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        let done = self.inner.pass(time);
        self.look();
        done
    }
}
