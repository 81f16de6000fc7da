//! Random frames at random times: nothing panics, every report is sound, and no frame is lost uncounted.

use ecmsk::engine::{Board, Counters, EngineConfig, Firmware};
use ecmsk::fieldbus::Fieldbus;
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::sk::{FIFO_ENTRIES, Frame, MasterResponse, RawSlot, SlaveKind, SlotSize};

use crate::crc::crc8;
use crate::host::{BOOT_LIMIT, MICROFRAME};
use crate::probe::{any_slaves, drives};
use support::ahead_bus::{Ahead, AheadBus};
use support::dice::Dice;
use support::swift::SWIFT;

/// Frames of one run, at least.
const FRAMES: u64 = 500;
/// Runs for each size of slot: 10,000 frames.
const RUNS: u64 = 20;

/// Random choices of this test.
trait Throws {
    fn noise(&mut self) -> RawSlot;
    fn plausible(&mut self, slot: usize, size: SlotSize) -> RawSlot;
    fn frame(&mut self, size: SlotSize) -> Frame;
}

impl Throws for Dice {
    fn noise(&mut self) -> RawSlot {
        let (a, b) = (self.roll(), self.roll());
        RawSlot {
            id: a as u8,
            index: (a >> 8) as u8,
            parm: (a >> 16) as u16,
            data1: (a >> 32) as u32,
            data2: b as u32,
            data3: (b >> 32) as u32,
        }
    }

    /// A plausible command for a slot, with mostly right arguments.
    fn plausible(&mut self, slot: usize, size: SlotSize) -> RawSlot {
        let noise = self.noise();
        let (id, parm, data1) = if slot == 0 {
            let id = self.pick(&[0x01, 0x02, 0x03, 0x04, 0x05, 0x05, 0x21, 0x22]);
            let data1 = match id {
                0x01 => self.pick(&[1, 2, 2, 4, 8, 8, 8, 8, 8, 3]),
                0x02 => self.pick(&[0, 0, 0x1111_1111, 0xFFFF_FF00, 0x0000_3210, 0x4444_4444]),
                0x03 => self.pick(&[250, 500, 1000, 2000, 16_000, 777]),
                0x04 => self.pick(&[0x00, 0x01, 0x10, 0x10, 0x10, 0x11]),
                0x05 => self.pick(&[0, 1, 20, 100, 160, 1000]),
                _ => noise.data1,
            };
            (if self.one_in(100) { 0xBB } else { id }, self.pick(&[0, 1, 2, 2, 4, 5]), data1)
        } else if slot == size.sdo_slot() {
            let parm = u16::from(self.pick(&[0u8, 1, 2, 4])) << 8 | self.pick(&[0u16, 1, 2, 3, 39]);
            (self.pick(&[0x07, 0x08]), parm, self.pick(&[0x6060_0000, 0x1018_0001, 0x6041_0000, 0x1234_0000]))
        } else {
            let ids = [0x06, 0x10, 0x11, 0x11, 0x12, 0x13, 0x14, 0x15, 0x15, 0x15, 0x16, 0x17, 0x18, 0x19];
            let data1 = if self.one_in(2) { self.pick(&[8, 9, 10]) } else { noise.data1 };
            (self.pick(&ids), noise.parm, data1)
        };
        RawSlot { id, parm, data1, ..noise }
    }

    fn frame(&mut self, size: SlotSize) -> Frame {
        let mut frame = Frame::new();
        match self.below(10) {
            0 => frame.bytes_mut().iter_mut().for_each(|byte| *byte = self.roll() as u8),
            1 => {}
            _ => {
                for slot in 0..size.slots() {
                    let odds = if slot == 0 || slot == size.sdo_slot() { 6 } else { 3 };
                    if self.one_in(odds) {
                        let raw = if self.one_in(20) { self.noise() } else { self.plausible(slot, size) };
                        frame.put(size, slot, &raw);
                    }
                }
            }
        }
        if !self.one_in(8) {
            frame.bytes_mut()[3] = crc8(frame.wire(size));
        }
        frame
    }
}

/// What a board must show after the frames that were sent to it.
#[derive(Default)]
struct Books {
    /// Switches in force, and those of the next boot: check, fill.
    switches: (bool, bool),
    remembered: (bool, bool),
    /// Frames that arrived in OP, how many of them had a wrong CRC, and how many executed a SW_RESET.
    arrived: u64,
    wrong: u64,
    resets: u64,
    /// Counters at the last boot.
    boot: Counters,
}

pub struct Run {
    config: EngineConfig,
    pub board: Board,
    books: Books,
    /// The declared kinds of the slaves; all others are drives.
    kinds: Vec<SlaveKind>,
    what: String,
}

impl Run {
    pub fn new(config: EngineConfig, bus: Box<dyn Fieldbus>, kinds: Vec<SlaveKind>, what: String) -> Self {
        let mut board = Board::new(config, bus);
        assert!(board.boot(BOOT_LIMIT));
        let books = Books { switches: (false, true), remembered: (false, true), ..Books::default() };
        Self { config, board, books, kinds, what }
    }

    /// Lets time pass, and checks every report.
    fn advance(&mut self, to: u64) {
        while self.board.next_cycle() <= to {
            let mut report = None;
            self.board.cycle(&mut |frame, _| report = Some(frame.clone()));
            if let Some(report) = report {
                self.check_report(&report);
            }
        }
        self.board.advance(to, &mut |_, _| unreachable!());
        self.check_books();
    }

    fn check_report(&self, report: &Frame) {
        let Self { config: EngineConfig { slot: size, firmware, .. }, board, books, what, .. } = self;
        let size = *size;
        let counters = board.engine().counters();
        let right = if books.switches.1 { crc8(report.wire(size)) } else { 0 };
        assert_eq!(report.crc_byte(), right, "{what}: CRC");
        let answer = MasterResponse::decode(&report.slot(size, 0));
        let op = answer.state.0 & 0x0F == 8;
        assert!(matches!(answer.state.0 & !0x10, 1 | 2 | 4 | 8), "{what}: state {:02X}", answer.state.0);
        assert_eq!(answer.id == 0xBF, op, "{what}: id {:02X} in state {:02X}", answer.id, answer.state.0);
        let crc_errors = if *firmware == Firmware::V17 { counters.crc - books.boot.crc } else { 0 };
        assert_eq!(answer.error, crc_errors as u8, "{what}: error count");
        let full_step = match firmware {
            Firmware::V17 => 1,
            Firmware::V15 => size.frame_len() as u64 / 4,
        };
        let full_count = ((counters.full - books.boot.full) * full_step) as u16;
        let shown = (answer.fifo_free, answer.full_count);
        assert_eq!(shown, if op { (board.engine().fifo_free(), full_count) } else { (0, 0) }, "{what}: FIFO");
        assert_eq!(report.slot(size, 0).data3, 0, "{what}");
        for slave in 1..=size.max_slaves() {
            let id = report.slot(size, slave).id;
            assert!(matches!(id, 0 | 0x06 | 0x10..=0x19), "{what}: id {id:02X} in slot {slave}");
        }
        let sdo = report.slot(size, size.sdo_slot());
        assert!(matches!((sdo.id, sdo.index, sdo.data3), (0 | 7 | 8, 0, 0)), "{what}: {sdo:?}");
    }

    /// Every frame that arrived in OP is executed, lost to a full FIFO, cleared, wrong or still queued.
    fn check_books(&self) {
        let Self { board, books, what, .. } = self;
        let counters = board.engine().counters();
        let queued = u64::from(FIFO_ENTRIES - board.engine().fifo_free());
        let known = counters.executed + counters.full + counters.cleared + books.wrong + books.resets + queued;
        assert_eq!(books.arrived, known, "{what}: {counters:?}, {queued} queued, {} resets", books.resets);
    }

    fn send(&mut self, frame: &Frame) {
        self.advance(self.board.now() + MICROFRAME);
        let size = self.config.slot;
        let (before, boots) = (*self.board.engine().counters(), self.board.engine().boots());
        let (talks, op) = (self.board.engine().talks(), self.board.engine().state().0 & 0x0F == 8);
        self.board.host(frame, self.board.now(), &mut |_, _| unreachable!());

        let counters = *self.board.engine().counters();
        assert_eq!(counters.frames - before.frames, u64::from(talks), "{}", self.what);
        let wrong = talks && self.books.switches.0 && frame.crc_byte() != crc8(frame.wire(size));
        assert_eq!(counters.crc - before.crc, u64::from(wrong), "{}", self.what);
        let slot_0 = frame.slot(size, 0);
        if talks && !wrong && !op && slot_0.id == 0x04 {
            self.books.remembered = (slot_0.data1 & 0x01 != 0, slot_0.data1 & 0x10 != 0);
        }
        let reset = self.board.engine().boots() > boots;
        assert_eq!(reset, talks && !wrong && slot_0.id == 0xBB, "{}", self.what);
        if talks && op {
            self.books.arrived += 1;
            self.books.wrong += u64::from(wrong);
            self.books.resets += u64::from(reset);
        }
        if reset {
            self.books.switches = self.books.remembered;
            self.books.boot = counters;
        }
        self.check_books();
    }

    fn send_master(&mut self, command: RawSlot) {
        let mut frame = Frame::new();
        frame.put(self.config.slot, 0, &command);
        frame.fill_crc(self.config.slot);
        self.send(&frame);
    }

    /// Switches the CRCs and boots.
    pub fn switch_crc(&mut self, data1: u32) {
        self.send_master(RawSlot { id: 0x04, data1, ..RawSlot::ZERO });
        self.send_master(RawSlot { id: 0xBB, ..RawSlot::ZERO });
        self.advance(self.board.now() + self.patience());
    }

    /// Declares the slaves, and goes to OP.
    fn reach_op(&mut self) {
        for group in 0..5 {
            let nibble = |k: u16| self.kinds.get(usize::from(group * 8 + k)).map_or(0, |kind| kind.nibble());
            let data1 = (0..8).rev().fold(0, |word, k| word << 4 | u32::from(nibble(k)));
            self.send_master(RawSlot { id: 0x02, parm: group, data1, ..RawSlot::ZERO });
        }
        self.send_master(RawSlot { id: 0x01, data1: 8, ..RawSlot::ZERO });
        self.advance(self.board.now() + self.patience());
    }

    /// The longest boot and way to OP with [`SWIFT`].
    fn patience(&self) -> u64 {
        50_000_000 + 3_000_000 * self.kinds.len() as u64
    }

    /// Makes a random fault in the network, or heals everything.
    fn disturb(dice: &mut Dice, network: &SimHandle) {
        let slave = 1 + dice.below(5) as u8;
        match dice.below(6) {
            0 => network.cut_after(dice.below(6) as u8),
            1 => network.lose(slave),
            2 => network.silence(slave, true),
            3 => network.find(slave),
            _ => {
                network.heal();
                (1..=5).for_each(|slave| network.find(slave));
            }
        }
    }

    /// One step of a run.
    pub fn step(&mut self, dice: &mut Dice, network: &SimHandle, disturbed: bool) {
        if disturbed && dice.one_in(15) {
            Self::disturb(dice, network);
        }
        if self.board.engine().state().0 != 8 && dice.one_in(4) {
            self.reach_op();
        }
        if !disturbed && dice.one_in(20) {
            network.silence(2, dice.one_in(4));
        }
        for _ in 0..if dice.one_in(60) { dice.below(400) } else { 1 } {
            self.send(&dice.frame(self.config.slot));
        }
        let cycles = if dice.one_in(20) { dice.below(100) } else { dice.below(3) };
        self.advance(self.board.now() + cycles * 1_000_000);
    }
}

fn run(size: SlotSize, ahead: Option<Ahead>) {
    let disturbed = false;
    let totals = run_all(size, ahead, disturbed);
    // There were enough frames of every kind.
    totals.at_least(&[2001, 501, 101, 101, 3, 0, 0]);
}

fn run_all(size: SlotSize, ahead: Option<Ahead>, disturbed: bool) -> Totals {
    let mut totals = Totals::default();
    for seed in 0..RUNS {
        let firmware = if seed % 2 == 0 { Firmware::V17 } else { Firmware::V15 };
        let mut slaves = drives(3);
        slaves.extend(any_slaves(2));
        let bus = SimBus::new(slaves).with_timing(SWIFT);
        let network = bus.handle();
        let config = EngineConfig { slot: size, firmware, state_timeout_ns: 100_000_000, ..EngineConfig::default() };
        let bus: Box<dyn Fieldbus> = match ahead {
            Some(how) => Box::new(AheadBus::new(bus, how)),
            None => Box::new(bus),
        };
        let mut run = Run::new(config, bus, Vec::new(), format!("{size:?}, {ahead:?}, seed {seed}"));
        let mut dice = Dice(seed);
        run.switch_crc(dice.pick(&[0x00, 0x01, 0x10, 0x11]));
        while run.board.engine().counters().frames < FRAMES {
            run.step(&mut dice, &network, disturbed);
            totals.failed_in_op += u64::from(run.board.engine().state().0 == 0x18);
        }
        totals.add(&run);
    }
    assert!(totals.frames >= 10_000, "{totals:?}");
    totals
}

/// The totals of all runs.
#[derive(Debug, Default)]
pub struct Totals {
    frames: u64,
    executed: u64,
    cleared: u64,
    full: u64,
    wrong: u64,
    resets: u64,
    for_lost: u64,
    /// Steps that ended in OP with a slave lost.
    failed_in_op: u64,
}

impl Totals {
    pub fn add(&mut self, run: &Run) {
        let counters = run.board.engine().counters();
        self.frames += counters.frames;
        self.executed += counters.executed;
        self.cleared += counters.cleared;
        self.full += counters.full;
        self.wrong += run.books.wrong;
        self.resets += run.books.resets;
        self.for_lost += counters.for_lost;
    }

    pub fn at_least(&self, least: &[u64; 7]) {
        let Self { executed, cleared, full, wrong, resets, for_lost, failed_in_op, .. } = *self;
        let seen = [executed, cleared, full, wrong, resets, for_lost, failed_in_op];
        assert!(seen.iter().zip(least).all(|(seen, least)| seen >= least), "{self:?}");
    }
}

/// SK-4.44 Nothing is lost uncounted. SK-2.10 SK-2.20 SK-2.21 SK-3.2 SK-3.7 Every report is sound.
/// SK-5.7 SK-5.8
#[test]
fn random_frames_in_12_byte_slots() {
    run(SlotSize::Bytes12, None);
}

/// SK-4.44 SK-2.10 SK-2.20 SK-2.21 SK-3.2 SK-3.7 SK-5.7 SK-5.8 The same in 16-byte mode.
#[test]
fn random_frames_in_16_byte_slots() {
    run(SlotSize::Bytes16, None);
}

/// SK-4.44 SK-2.10 SK-2.20 SK-2.21 SK-3.2 SK-3.7 SK-5.7 SK-5.8 The same over buses that take outputs ahead.
#[test]
fn random_frames_over_a_bus_that_takes_ahead() {
    run(SlotSize::Bytes12, Some(Ahead::kind(64, 4, 333_333, 700)));
    run(SlotSize::Bytes16, Some(Ahead::kind(8, 1, 999_999, 0)));
}

/// SK-4.44 SK-2.9 SK-2.20 SK-4.59 SK-4.61 SK-4.62 The same while the cable is cut and healed and slaves come and go: the
/// state is always a legal one, and every frame is executed or counted.
#[test]
fn random_frames_on_a_network_that_breaks() {
    for ahead in [None, Some(Ahead::kind(16, 3, 333_333, 700))] {
        run_all(SlotSize::Bytes12, ahead, true).at_least(&[500, 100, 25, 100, 1, 200, 100]);
    }
}

/// SK-4.44 SK-2.9 SK-4.61 SK-4.62 SK-12.1 SK-12.2 The same over buses with the losses and delays of real ones.
#[test]
fn random_frames_over_honest_buses() {
    for seed in 1..=4 {
        let size = if seed % 2 == 0 { SlotSize::Bytes12 } else { SlotSize::Bytes16 };
        run_all(size, Some(Ahead::honest(seed)), true).at_least(&[100, 100, 0, 0, 1, 0, 0]);
    }
}
