//! A program on a board whose slaves obey within a cycle, with faults.

use ecmsk::coe::ObjectAddress;
use ecmsk::engine::{Board, EngineConfig};
use ecmsk::fieldbus::{AlState, Ns};
use ecmsk::sk::{
    CycleTime, DcShift, DriveResponse, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterState, Motion, SdoCommand,
    SlaveCommand, SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::al::WATCHDOG_NS;
use ecmsk::slave::handle::SimHandle;
use ecmsk::slave::{AlStatus, Slave};
use support::dice::Dice;

use super::books::{Books, IO};
use super::follower::Follower;
use super::{Done, Ends, Setting};

const US: Ns = 1_000;
const MS: Ns = 1_000_000;
const S: Ns = 1_000_000_000;
const SIZE: SlotSize = SlotSize::Bytes12;
/// After the last fault the board is in OP within this time: a chip's start that times out, and the change itself.
const BACK_WITHIN: Ns = 120 * S;
/// A bus reads the states of all slaves at least every 100 ms.
const STATES_READ_WITHIN: Ns = 150 * MS;
/// After this time no entry is held and the bus has none ahead.
const AT_REST_WITHIN: Ns = 20 * S;

/// The program's view of a drive's axis.
#[derive(Clone, Copy)]
struct Axis {
    /// The newest target that was sent.
    target: i32,
    streams: bool,
    /// Cycles until an SV_ON, after the axis was pushed.
    switch_on_in: u64,
}

/// A frame and its entries in the account.
#[derive(Default)]
struct Command {
    frame: Frame,
    values: Vec<(usize, i32)>,
    /// SV_ON and SV_OFF.
    switched: Vec<(usize, bool)>,
    is_empty: bool,
}

pub struct Program<S: Setting> {
    dice: Dice,
    board: Board,
    followers: Vec<Follower>,
    network: SimHandle,
    ends: S::Ends,
    drives: usize,
    cycle_us: u32,
    report: Frame,
    axes: Vec<Axis>,
    mark: u16,
    pause: u64,
    /// Cycles until cable and slaves are whole again.
    broken: u64,
    /// Whether there was no fault since the last rest, and no command of the program that loses others.
    quiet: bool,
    books: Books,
    done: Done,
}

impl<S: Setting> Program<S> {
    /// A board that has booted.
    pub fn new(seed: u64, setting: &S) -> Self {
        let network = SimHandle::default();
        let (drives, cycle_us) = (setting.drives(), setting.cycle_us());
        let followers: Vec<Follower> = (0..=drives).map(|_| Follower::new(setting.have_identity())).collect();
        let slaves = followers.iter().map(|follower| Box::new(follower.clone()) as Box<dyn Slave>).collect();
        let (bus, mut ends) = setting.bus(seed, slaves, network.clone());
        let engine = EngineConfig {
            state_timeout_ns: setting.state_timeout_ns(),
            sdo_timeout_ns: 200 * MS,
            slot: SIZE,
            ..EngineConfig::default()
        };
        let mut board = Board::new(engine, bus);
        let end = board.now() + BACK_WITHIN;
        while !board.engine().talks() {
            assert!(board.now() < end, "the board does not talk");
            ends.cycle(&mut board, &mut |_, _| {});
        }
        let books = Books::new(followers.len(), board.engine().counters());
        let axis = Axis { target: 0, streams: false, switch_on_in: 0 };
        let mut program = Self {
            dice: Dice(seed),
            axes: vec![axis; drives],
            board,
            followers,
            network,
            ends,
            drives,
            cycle_us,
            report: Frame::new(),
            mark: 0,
            pause: 0,
            broken: 0,
            quiet: true,
            books,
            done: Done::default(),
        };
        program.set_up();
        program
    }

    fn in_op(&self) -> bool {
        self.board.engine().state().state() == Some(MasterState::Op)
    }

    fn is_whole(&self) -> bool {
        self.board.engine().state() == StateByte::reached(MasterState::Op)
    }

    fn is_on(&self, n: usize) -> bool {
        DriveResponse::decode(&self.report.slot(SIZE, n + 2)).statusword.is_enabled() && self.in_op()
    }

    fn send(&mut self, command: &Command) {
        let counters = *self.board.engine().counters();
        let in_op = self.in_op();
        self.board.host(&command.frame, self.board.now(), &mut |_, _| {});
        let full = self.board.engine().counters().full > counters.full;
        if in_op && !full {
            self.books.accepted(&command.values, &command.switched);
        }
        self.done.full += u64::from(full);
    }

    fn master(&mut self, master: &MasterCommand) {
        let mut command = Command::default();
        command.frame.put_master(SIZE, master);
        self.send(&command);
    }

    /// Declares the slaves and the cycle.
    fn set_up(&mut self) {
        let mut kinds = [SlaveKind::None; 8];
        kinds[..=self.drives].fill(SlaveKind::Drive);
        kinds[IO - 1] = SlaveKind::Io;
        self.master(&MasterCommand::SetAxis { group: 0, kinds });
        let cycle = CycleTime::from_us(self.cycle_us).expect("a cycle of the guide's");
        self.master(&MasterCommand::SetDc { cycle, shift: DcShift::Auto });
    }

    /// Below OP the slaves are declared again; from Init the program goes to PreOP first.
    fn ask_for_op(&mut self) {
        let state = self.board.engine().state().state();
        if state == Some(MasterState::PreOp) {
            self.set_up();
        }
        let next = if state == Some(MasterState::Init) { MasterState::PreOp } else { MasterState::Op };
        self.master(&MasterCommand::SetState(next));
    }

    /// Runs a cycle.
    fn cycle(&mut self) {
        let Self { board, report, ends, .. } = self;
        ends.cycle(board, &mut |frame, _| report.clone_from(frame));
        self.books.look(&self.followers, self.board.engine().fifo_free());
        self.done.cycles += 1;
        self.done.in_op += u64::from(self.in_op());
    }

    /// The next frame of the stream.
    fn next(&mut self) -> Command {
        let mut command = Command { is_empty: true, ..Command::default() };
        for n in 0..self.axes.len() {
            if self.is_on(n) && self.axes[n].streams && !self.dice.one_in(8) {
                let axis = &mut self.axes[n];
                axis.target += 1 + self.dice.below(3) as i32;
                let motion = SlaveCommand::Csp(Motion::to(axis.target));
                command.frame.put_slave(SIZE, n + 2, &motion.into());
                command.values.push((n + 2, axis.target));
                command.is_empty = false;
            }
        }
        if self.dice.one_in(20) && self.in_op() {
            self.mark += 1;
            command.frame.put_slave(SIZE, IO, &SlaveCommand::IoWrite(self.mark).into());
            command.values.push((IO, self.mark.into()));
            command.is_empty = false;
        }
        command
    }

    fn servo(&mut self, n: usize, on: bool) {
        let mut command = Command::default();
        let servo = if on { SlaveCommand::ServoOn } else { SlaveCommand::ServoOff };
        command.frame.put_slave(SIZE, n + 2, &servo.into());
        command.switched.push((n + 2, on));
        self.send(&command);
    }

    /// Frames of a cycle.
    fn stream(&mut self) {
        if self.pause > 0 {
            self.pause -= 1;
            return;
        }
        let frames = if self.dice.one_in(800) { 200 } else { self.dice.pick(&[1, 1, 1, 1, 1, 0, 2]) };
        for _ in 0..frames {
            let command = self.next();
            if !command.is_empty {
                self.send(&command);
            }
        }
    }

    /// Another random action of programs.
    fn something(&mut self) {
        let n = self.dice.below(self.axes.len() as u64) as usize;
        match self.dice.below(16) {
            0..=5 if self.axes[n].switch_on_in == 0 => {
                self.servo(n, true);
                self.axes[n].streams = true;
            }
            6 => self.servo(n, false),
            7 => self.axes[n].streams = !self.axes[n].streams,
            8 => {
                self.quiet = false;
                self.done.clears += 1;
                self.master(&MasterCommand::SetFifo(FifoAction::Clear));
            }
            9 | 10 => {
                let mut command = Command::default();
                let object = ObjectAddress::new(self.dice.pick(&[0x1018, 0x1C12]), 0);
                command.frame.put_sdo(SIZE, &SdoCommand::Read { slave: 2, object });
                self.send(&command);
            }
            11 | 12 => self.pause = self.dice.below(100),
            13 if self.dice.one_in(4) => {
                self.quiet = false;
                use MasterState::{Init, Op, PreOp, SafeOp};
                let state = self.dice.pick(&[Init, PreOp, SafeOp, Op]);
                self.master(&MasterCommand::SetState(state));
            }
            14 => self.push(n),
            _ => {}
        }
    }

    /// Pushes an axis whose motor is off by hand; it stays off for a while.
    fn push(&mut self, n: usize) {
        let mut inside = self.followers[n + 1].inside();
        let asked = self.books.may_be_on(n + 2);
        if !inside.is_on() && !asked {
            let to = self.axes[n].target.max(inside.position()) + 1 + self.dice.below(1000) as i32;
            inside.shove(to);
            self.axes[n].target = to;
            self.axes[n].switch_on_in = 300;
        }
    }

    /// Makes a random fault.
    fn fault(&mut self) {
        self.quiet = false;
        let slave = 1 + self.dice.below(self.followers.len() as u64) as u8;
        let long = self.long();
        let network = &self.network;
        match self.dice.below(16) {
            7 | 8 => {
                network.lose(slave);
                // No frame passes a controller without power.
                if !self.ends.has_silent_slaves() {
                    network.cut_after(network.cable().reach().min(slave - 1));
                }
                self.broken = self.broken.max(1 + self.dice.below(200));
            }
            9 if self.ends.has_silent_slaves() => {
                network.silence(slave, true);
                self.broken = self.broken.max(long);
            }
            9 | 10 => {
                // No frame passes a controller without power, wherever else the cable is cut.
                let reach = if self.ends.has_silent_slaves() { u8::MAX } else { network.cable().reach() };
                network.cut_after(reach.min(slave - 1));
                self.broken = self.broken.max(long);
            }
            11 => {
                let state = self.dice.pick(&[AlState::SafeOp, AlState::Op, AlState::PreOp]);
                network.refuse(slave, Some((state, AlStatus::INVALID_OUTPUTS)));
                self.broken = self.broken.max(1 + self.dice.below(400));
            }
            12 => network.delay_sdo(slave, self.dice.pick(&[50 * MS, 300 * MS])),
            what => self.ends.fault(what, self.cycle_us, &mut self.dice),
        }
    }

    /// More cycles than a slave stays in OP without outputs: a slave that is back sooner has missed cycles, which is
    /// not seen while another one is lost.
    fn long(&mut self) -> u64 {
        WATCHDOG_NS / (Ns::from(self.cycle_us) * US) + 10 + self.dice.below(200)
    }

    fn repair(&mut self) {
        self.broken = self.broken.saturating_sub(1);
        if self.broken == 0 {
            self.mend_network();
        }
        for n in 0..self.axes.len() {
            self.axes[n].switch_on_in = self.axes[n].switch_on_in.saturating_sub(1);
        }
    }

    fn mend_network(&mut self) {
        self.network.heal();
        for slave in 1..=self.followers.len() as u8 {
            self.network.find(slave);
            self.network.refuse(slave, None);
            self.network.delay_sdo(slave, 0);
        }
    }

    /// Runs that many cycles of the program with faults.
    pub fn run(&mut self, cycles: u64) {
        let fault_every = self.dice.pick(&[60, 200, 400, 1_000_000]);
        for _ in 0..cycles {
            let state = self.board.engine().state();
            if state.state() != Some(MasterState::Op) && self.dice.one_in(60) {
                self.ask_for_op();
            } else if state.is_failed() && self.dice.one_in(100) {
                self.master(&MasterCommand::SetState(MasterState::Op));
            }
            if self.dice.one_in(15) {
                self.something();
            }
            if self.dice.one_in(fault_every) {
                self.done.faults += 1;
                self.fault();
            }
            self.stream();
            self.cycle();
            self.repair();
        }
    }

    /// Runs without faults and frames until no entry is held, the bus has none ahead, and no change of state and no SDO
    /// is under way, which would hide a loss.
    pub fn rest(&mut self) {
        self.ends.mend();
        let end = self.board.now() + AT_REST_WITHIN;
        let mut still_from = self.board.now();
        while self.board.now() - still_from < self.still_ns() {
            let engine = self.board.engine();
            let free = engine.fifo_free();
            assert!(
                self.board.now() < end,
                "never at rest: {:?}, {free} free, busy {}",
                engine.state(),
                engine.is_busy()
            );
            self.cycle();
            self.repair();
            let engine = self.board.engine();
            let is_still = engine.fifo_free() == FIFO_ENTRIES && !engine.is_busy() && self.broken == 0;
            if !is_still {
                still_from = self.board.now();
            }
        }
        self.books.compare(self.board.engine().counters(), self.quiet);
        // Effects of a fault may still be there: slaves that no SET_STATE has brought back.
        self.quiet = self.is_whole();
    }

    /// Within this time the bus sends the outputs that it has ahead, and lost slaves are noticed.
    fn still_ns(&self) -> Ns {
        (300 * Ns::from(self.cycle_us) * US).max(STATES_READ_WITHIN)
    }

    /// Brings the board back to OP after all faults, and checks that it moves its axes without a loss.
    pub fn comes_back(&mut self) {
        let end = self.board.now() + BACK_WITHIN;
        let mut next = 0;
        while !self.is_whole() {
            let why = self.board.engine().state_failure();
            assert!(self.board.now() < end, "never in OP again: {:?}, {why:?}", self.board.engine().state());
            if self.board.now() >= next {
                self.ask_for_op();
                next = self.board.now() + S;
            }
            self.cycle();
            self.repair();
        }
        self.quiet = false;
        self.rest();
        for n in 0..self.axes.len() {
            self.axes[n].streams = true;
            if !self.is_on(n) {
                self.servo(n, true);
            }
        }
        self.wait("all axes on", |program| (0..program.axes.len()).all(|n| program.is_on(n)));
        self.rest();
        for _ in 0..200 {
            let command = self.next();
            if !command.is_empty {
                self.send(&command);
            }
            self.cycle();
        }
        let before = self.books.account;
        self.rest();
        assert_eq!(self.books.account.single, before.single, "commands were not executed, and nothing went wrong");
        assert_eq!(self.books.account.cleared, before.cleared);
    }

    fn wait(&mut self, what: &str, done: impl Fn(&Self) -> bool) {
        let end = self.board.now() + AT_REST_WITHIN;
        while !done(self) {
            let engine = self.board.engine();
            assert!(self.board.now() < end, "never: {what}; {:?}, {} free", engine.state(), engine.fifo_free());
            self.cycle();
        }
    }

    pub fn done(mut self) -> Done {
        self.done.account(&self.books.account);
        self.done.on_wires = self.ends.faults();
        self.done
    }
}
