//! The cable between a network card and its slaves, with random faults, and the runner of its board.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard};

use ecmsk::engine::Board;
use ecmsk::ethercat::{Command, DatagramHeader, FRAME_LEN_MAX, FrameHeader, FrameWriter};
use ecmsk::fieldbus::Ns;
use ecmsk::fieldbus::nic::{ChainWires, NicWires};
use ecmsk::master::{FrameBuffer, Wire, WireDown};
use ecmsk::sk::Frame;
use support::dice::Dice;
use support::lying_wire::{Answer, Lies};

use crate::followed::Ends;

const US: Ns = 1_000;
const MS: Ns = 1_000_000;
/// The greatest delay of an answer's copy: after 256 frames its index has another owner, and the copy could not be
/// distinguished from that one's answer.
const COPY_LATE_NS: Ns = 5 * MS;
/// The most successive frames with a wrong working counter: more than a slave's inputs may stay away.
const LYING_MAX: u64 = 60;
/// So many successive calls without elapsed time count as a hang.
const STANDSTILL: u32 = 10_000;

/// A fault of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Fault {
    LostOut,
    LostBack,
    DoubledOut,
    DoubledBack,
    LateOut,
    /// The frame comes back late, and later ones overtake it.
    LateBack,
    /// The card takes no frame.
    Refused,
    /// Another master's frame comes.
    Stranger,
    /// A frame of another protocol, or no frame at all.
    Garbage,
    /// In some frames the working counter of process data is wrong, and the inputs beside it are none.
    Lying,
    /// The card is down.
    Down,
    /// The runner is late.
    Late,
}

/// A frame that arrives at that time.
struct Arriving {
    at: Ns,
    frame: Vec<u8>,
}

struct Inside {
    wires: ChainWires,
    dice: Dice,
    /// One in this number of frames has a fault; `None`: none has.
    rarely: Option<u64>,
    down_until: Ns,
    /// The delay of the next cycle.
    late_ns: Ns,
    faults: BTreeMap<Fault, u64>,
    /// Frames on their way out, in their order.
    outward: VecDeque<Arriving>,
    homeward: Vec<Arriving>,
    /// The number of frames that are still to come back with a wrong working counter.
    lying: u64,
    calls: u32,
}

impl Inside {
    /// The random fault of a frame, if it is one of these.
    fn fault(&mut self, of: &[Fault]) -> Option<Fault> {
        let is_wrong = self.rarely.is_some_and(|rarely| self.dice.one_in(rarely));
        let fault = is_wrong.then(|| self.dice.pick(of))?;
        self.note(fault);
        Some(fault)
    }

    fn note(&mut self, fault: Fault) {
        *self.faults.entry(fault).or_default() += 1;
    }

    fn delay(&mut self) -> Ns {
        let most = self.dice.pick(&[100 * US, MS, 5 * MS, 50 * MS]);
        self.dice.below(most)
    }

    fn go_out(&mut self, frame: &[u8], delay: Ns) {
        self.deliver();
        let at = self.outward.back().map_or(0, |last| last.at).max(self.wires.now() + delay);
        if at == self.wires.now() {
            self.wires.send(frame).expect("its own wire takes every frame");
        } else {
            self.outward.push_back(Arriving { at, frame: frame.to_vec() });
        }
    }

    /// Delivers the frames that are due to the slaves.
    fn deliver(&mut self) {
        while let Some(Arriving { frame, .. }) = self.outward.pop_front_if(|first| first.at <= self.wires.now()) {
            self.wires.send(&frame).expect("its own wire takes every frame");
        }
    }

    /// Lets time pass until then, or until a frame is back.
    fn pass(&mut self, until: Ns) {
        let before = self.wires.now();
        let out = self.outward.front().map(|first| first.at);
        let back = self.homeward.iter().map(|one| one.at).min();
        let next = [out, back].into_iter().flatten().fold(until, Ns::min);
        self.wires.wait(next);
        self.deliver();
        self.calls = if self.wires.now() > before { 0 } else { self.calls + 1 };
        assert!(self.calls < STANDSTILL, "the bus stands still");
    }

    /// Lets time pass until then, whatever comes.
    fn pass_all(&mut self, until: Ns) {
        let mut buffer = [0; FRAME_LEN_MAX];
        while self.wires.now() < until {
            // Frames that are back wait in the card.
            while let Some(len) = self.wires.receive(&mut buffer) {
                self.homeward.push(Arriving { at: until, frame: buffer[..len].to_vec() });
            }
            let out = self.outward.front().map_or(until, |first| first.at.min(until));
            self.wires.wait(out);
            self.deliver();
        }
    }
}

/// The cable as the bus sees it; clones share it.
#[derive(Clone)]
pub struct Line {
    inside: Arc<Mutex<Inside>>,
    is_real_time: bool,
}

impl Line {
    pub fn new(wires: ChainWires, seed: u64, is_real_time: bool) -> Self {
        let inside = Inside {
            wires,
            dice: Dice(seed ^ 0x6361_626C),
            rarely: None,
            down_until: 0,
            late_ns: 0,
            faults: BTreeMap::new(),
            outward: VecDeque::new(),
            homeward: Vec::new(),
            lying: 0,
            calls: 0,
        };
        Self { inside: Arc::new(Mutex::new(inside)), is_real_time }
    }

    pub fn ends(&self, has_runner: bool) -> LineEnds {
        LineEnds { line: self.clone(), runner: has_runner.then_some(0) }
    }

    fn inside(&self) -> MutexGuard<'_, Inside> {
        self.inside.lock().expect("no panic")
    }
}

impl Wire for Line {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        use Fault::{DoubledOut, Down, LateOut, LostOut, Refused};
        let mut inside = self.inside();
        if inside.wires.now() < inside.down_until {
            inside.note(Down);
            return if inside.dice.one_in(2) { Err(WireDown) } else { Ok(()) };
        }
        match inside.fault(&[LostOut, DoubledOut, LateOut, Refused]) {
            Some(LostOut) => {}
            Some(Refused) => return Err(WireDown),
            Some(DoubledOut) => {
                inside.go_out(frame, 0);
                inside.go_out(frame, 0);
            }
            Some(_) => {
                let delay = inside.delay();
                inside.go_out(frame, delay);
            }
            None => inside.go_out(frame, 0),
        }
        Ok(())
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        use Fault::{DoubledBack, Garbage, LateBack, LostBack, Lying, Stranger};
        let mut inside = self.inside();
        let now = inside.wires.now();
        if let Some(n) = inside.homeward.iter().position(|one| one.at <= now) {
            let Arriving { frame, .. } = inside.homeward.remove(n);
            buffer[..frame.len()].copy_from_slice(&frame);
            return Some(frame.len());
        }
        loop {
            let len = inside.wires.receive(buffer)?;
            if now < inside.down_until {
                continue;
            }
            if inside.lying > 0 {
                inside.lying -= 1;
                lie(&mut buffer[..len], &mut inside.dice);
                return Some(len);
            }
            match inside.fault(&[LostBack, DoubledBack, LateBack, Stranger, Garbage, Lying]) {
                None => return Some(len),
                Some(Lying) => {
                    inside.lying = inside.dice.below(LYING_MAX);
                    lie(&mut buffer[..len], &mut inside.dice);
                    return Some(len);
                }
                Some(LostBack) => {}
                Some(DoubledBack) => {
                    let at = if inside.dice.one_in(2) { now } else { now + inside.dice.below(COPY_LATE_NS) };
                    inside.homeward.push(Arriving { at, frame: buffer[..len].to_vec() });
                    return Some(len);
                }
                Some(LateBack) => {
                    let at = now + inside.delay();
                    inside.homeward.push(Arriving { at, frame: buffer[..len].to_vec() });
                }
                Some(Stranger) => {
                    let frame = strange(&mut inside.dice);
                    inside.homeward.push(Arriving { at: now, frame });
                    return Some(len);
                }
                Some(_) => {
                    let garbage = (0..inside.dice.below(100)).map(|_| inside.dice.roll() as u8).collect();
                    inside.homeward.push(Arriving { at: now, frame: garbage });
                    return Some(len);
                }
            }
        }
    }
}

/// Makes working counters of process data 0 or too high, and inputs others than those of the slaves. No such counter is the
/// expected one, whichever slaves are missing.
fn lie(frame: &mut [u8], dice: &mut Dice) {
    let (is_too_high, byte) = (dice.one_in(2), dice.roll() as u8);
    let lies = Lies::default();
    lies.tell(move |answer: &mut Answer<'_>| {
        if answer.command == Command::Lrw {
            answer.data.fill(byte);
            answer.count = if is_too_high { 100 } else { answer.counter.wrapping_neg() };
        }
    });
    let sent = frame.to_vec();
    lies.change(&sent, frame);
}

/// A frame of another master, with an index that this master may use, too.
fn strange(dice: &mut Dice) -> Vec<u8> {
    let mut frame = [0; FRAME_LEN_MAX];
    let header = FrameHeader::datagrams([0x12, 0, 0, 0, 0, 7]);
    let mut writer = FrameWriter::new(&mut frame, header).expect("room");
    let datagram = DatagramHeader { index: dice.roll() as u8, ..DatagramHeader::register(Command::Brd, 0, 0, 0x0130) };
    writer.push(datagram, &[dice.roll() as u8, 0]).expect("room");
    writer.finish().to_vec()
}

impl NicWires for Line {
    fn now(&self) -> Ns {
        self.inside().wires.now()
    }

    fn wait(&mut self, until: Ns) {
        self.inside().pass(until);
    }

    fn is_real_time(&self) -> bool {
        self.is_real_time
    }
}

/// The cable, and the runner of the board, as the schedule sees them.
pub struct LineEnds {
    line: Line,
    /// How much the cable's clock is ahead of the board's time, which skips the cycles that the runner has skipped;
    /// `None`: the board has no runner.
    runner: Option<Ns>,
}

impl Ends for LineEnds {
    fn fault(&mut self, what: u64, cycle_us: u32, dice: &mut Dice) {
        let mut inside = self.line.inside();
        let now = inside.wires.now();
        let cycle_ns = Ns::from(cycle_us) * US;
        match what {
            0 | 1 if dice.one_in(2) => inside.down_until = now + 200 * MS + dice.below(3000 * MS),
            0..=2 => inside.down_until = now + dice.below(150 * MS),
            3..=6 => {
                let most = dice.pick(&[1, 2, 5, 100]);
                inside.late_ns = dice.below(most * cycle_ns);
                inside.note(Fault::Late);
            }
            _ => inside.rarely = dice.pick(&[None, None, Some(3), Some(10), Some(40), Some(200)]),
        }
    }

    /// Only a slave without a controller passes frames on and answers none; a slave that is back could not be
    /// distinguished from it.
    fn has_silent_slaves(&self) -> bool {
        false
    }

    fn mend(&mut self) {
        let mut inside = self.line.inside();
        (inside.rarely, inside.down_until, inside.late_ns, inside.lying) = (None, 0, 0, 0);
    }

    fn faults(&self) -> u64 {
        self.line.inside().faults.values().sum()
    }

    fn cycle(&mut self, board: &mut Board, report: &mut dyn FnMut(&Frame, Ns)) {
        let due = board.next_cycle();
        let late_ns = std::mem::take(&mut self.line.inside().late_ns);
        if let Some(ahead) = &mut self.runner {
            // This is what the runner in real time does.
            board.work_until(self.line.now().saturating_sub(*ahead), due);
            self.line.inside().pass_all(due + *ahead + late_ns);
            let late = self.line.now() - (due + *ahead);
            let period = board.period_ns();
            if late > period / 2 {
                let cycles = late.div_ceil(period);
                board.leave_out(cycles);
                *ahead += cycles * period;
                self.line.inside().pass_all(due + *ahead);
            }
        }
        // Virtual time is never late.
        board.cycle(report);
    }
}
