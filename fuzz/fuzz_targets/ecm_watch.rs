//! Frames that pass a watch. On a modelled board, some reports of which may be missed: it knows every axis that goes home, and
//! every threshold that holds the FIFO. Any frames at all: what it says is what they show, and missing reports makes it no
//! surer of anything.

#![no_main]

#[path = "support/board.rs"]
mod board;
#[path = "support/frames.rs"]
mod frames;

use ecmsk::cia402::Mode;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::ecm::Watch;
use ecmsk::engine::{Board, Firmware, HomingPhase};
use ecmsk::fieldbus::sim::SimHandle;
use ecmsk::link::{Dir, Stamp};
use ecmsk::sk::{
    CommandId, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, Motion, SdoCommand,
    SlaveCommand, SlotSize, StateByte,
};
use ecmsk::slave::{DeviceFault, Fault};
use libfuzzer_sys::fuzz_target;

/// Cycles of an input at most: a model lives through them.
const CYCLES_MAX: u32 = 20_000;
/// Bytes of a step.
const STEP: usize = 16;

fuzz_target!(|bytes: &[u8]| {
    let Some((&kind, bytes)) = bytes.split_first() else { return };
    let size = if kind & 1 == 0 { SlotSize::Bytes12 } else { SlotSize::Bytes16 };
    if kind & 2 == 0 { any_frames(bytes, size) } else { Watched::new(kind, size).run(bytes) }
});

fn any_frames(bytes: &[u8], size: SlotSize) {
    let mut watch = Watch::default();
    let mut misses = watch.clone();
    for (observed, n) in frames::frames(bytes, size).into_iter().zip(0..) {
        let at = Stamp(n);
        if observed.dir == Dir::Write {
            watch.command(&observed.frame, size, at);
            misses.command(&observed.frame, size, at);
        } else {
            watch.report(&observed.frame, size, at);
            misses.missed();
            misses.report(&observed.frame, size, at);
            let shown = MasterResponse::decode(&observed.frame.slot(size, 0)).state.state();
            assert_eq!(watch.state(), shown);
            assert!(shown == Some(MasterState::Op) || watch.homing().count() == 0 && !watch.has_threshold());
        }
        if let Some(config) = watch.config() {
            assert_eq!(config.check(size).map(|_| ()), Ok(()), "what is declared can be run");
        }
        let slaves = size.max_slaves();
        assert!(
            watch.homing().all(|slave| usize::from(slave) <= slaves && misses.homing().any(|other| other == slave))
        );
    }
}

/// A board and who watches it.
struct Watched {
    board: Board,
    network: SimHandle,
    size: SlotSize,
    watch: Watch,
    /// Reports are not seen, and some were not.
    blind: bool,
    missed: bool,
    left: u32,
    /// The newest report that was seen.
    shown: Frame,
}

impl Watched {
    fn new(kind: u8, size: SlotSize) -> Self {
        let firmware = if kind & 4 == 0 { Firmware::V17 } else { Firmware::V15 };
        let (board, network) = board::board(size, firmware);
        let watch = Watch::default();
        let mut watched =
            Self { board, network, size, watch, blind: false, missed: false, left: CYCLES_MAX, shown: Frame::new() };
        if kind & 8 == 0 {
            watched.come_up(kind >> 4);
        }
        watched
    }

    /// All axes are on, in modes that depend on `modes`.
    fn come_up(&mut self, modes: u8) {
        let [axes, op, on] = board::set_up(self.size, modes);
        self.send(&axes);
        self.send(&op);
        for _ in 0..100 {
            if self.board.engine().state() == StateByte::reached(MasterState::Op) {
                break;
            }
            self.cycle();
        }
        self.send(&on);
        (0..60).for_each(|_| self.cycle());
    }

    fn run(&mut self, bytes: &[u8]) {
        let mut frame = Frame::new();
        for step in bytes.chunks_exact(STEP) {
            let (count, slave) = (step[1], 1 + usize::from(step[1]) % board::SLAVES);
            match step[0] % 10 {
                0 => (0..count).for_each(|_| self.cycle()),
                1 => frame = Frame::new(),
                2 => frame.put(self.size, usize::from(count) % self.size.slots(), &frames::slot(&step[4..])),
                3 => {
                    for _ in 0..=count % 16 {
                        self.send(&frame);
                        (0..step[2] % 4).for_each(|_| self.cycle());
                    }
                }
                4 => {
                    use SlaveCommand::{AbortHome, AlarmClear, GetStatus, GoHome, ServoOff, ServoOn};
                    let command =
                        [GoHome, AbortHome, ServoOn, ServoOff, AlarmClear, GetStatus][usize::from(step[2]) % 6];
                    frame.put_slave(self.size, slave, &command.into());
                }
                5 => {
                    let target = i32::from(i16::from_le_bytes([step[3], step[4]]));
                    let command = match step[2] % 3 {
                        0 => SlaveCommand::Csp(Motion::to(target)),
                        1 => SlaveCommand::Csv(Motion::to(target)),
                        _ => SlaveCommand::Cst(target as i16),
                    };
                    frame.put_slave(self.size, slave, &command.into());
                }
                6 => {
                    use MasterState::{Init, Op, PreOp, SafeOp};
                    self.master(&match step[2] % 8 {
                        0 => MasterCommand::SetFifo(FifoAction::Clear),
                        1..=4 => MasterCommand::SetFifo(FifoAction::Threshold(step[3].max(1).into())),
                        5 | 6 => MasterCommand::SetState([Init, PreOp, SafeOp, Op][usize::from(step[3]) % 4]),
                        _ => MasterCommand::SoftReset,
                    });
                }
                // The mode of operation of an axis: homing, most often.
                7 => {
                    let object = ObjectAddress::new(if step[2] & 1 == 0 { 0x6060 } else { 0x6860 }, 0);
                    let value = if step[2] & 2 == 0 { 6 } else { step[3].into() };
                    let size = SdoSize::One;
                    frame.put_sdo(self.size, &SdoCommand::Write { slave: slave as u8, object, size, value });
                }
                8 => self.blind = count & 1 != 0,
                _ => match count % 4 {
                    0 => self.network.apply_fault(
                        1 + step[2] % 3,
                        Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x8611, resettable: true } },
                    ),
                    1 => self.network.cut_after(step[2] % 5),
                    2 => self.network.heal(),
                    _ => self.network.delay_sdo(1 + step[2] % 3, u64::from(step[3]) * 1_000_000),
                },
            }
        }
    }

    fn master(&mut self, command: &MasterCommand) {
        let mut frame = Frame::new();
        frame.put_master(self.size, command);
        self.send(&frame);
    }

    fn send(&mut self, frame: &Frame) {
        let mut frame = frame.clone();
        frame.fill_crc(self.size);
        if !self.board.engine().talks() {
            // SW_RESET: the link would be dead until it is opened again, and so would the watch.
            self.network.heal();
            assert!(self.board.boot(board::BOOT_NS));
            self.watch = Watch::default();
        }
        self.board.host(&frame, self.board.now(), &mut |_, _| unreachable!("no time passes"));
        self.watch.command(&frame, self.size, Stamp(self.board.now()));
    }

    fn cycle(&mut self) {
        if self.left == 0 {
            return;
        }
        self.left -= 1;
        let Self { board, watch, size, blind, missed, shown, .. } = self;
        let op = StateByte::reached(MasterState::Op);
        let waits = board.engine().fifo_free() < FIFO_ENTRIES && board.engine().state() == op;
        let is_free = waits && watch.state() == Some(MasterState::Op) && !watch.has_threshold() && !*missed && !*blind;
        let before = *board.engine().counters();
        let mut reported = false;
        board.cycle(&mut |report, at| {
            reported = true;
            *missed |= *blind;
            if !*blind {
                if std::mem::take(missed) {
                    watch.missed();
                }
                watch.report(report, *size, Stamp(at));
                shown.clone_from(report);
                assert_eq!(watch.state(), MasterResponse::decode(&report.slot(*size, 0)).state.state());
            }
        });
        if !reported || *blind {
            return;
        }
        let after = self.board.engine().counters();
        let stays = self.board.engine().state() == op;
        assert!(!is_free || !stays || after.executed > before.executed, "a threshold that the watch does not know");
        for slave in 1..=board::AXES {
            let command = CommandId::from_code(self.shown.slot(self.size, slave).id);
            let is_new = after.executed > before.executed && !self.board.engine().lost().contains(slave as u8);
            let motions = [(CommandId::Csp, Mode::Csp), (CommandId::Csv, Mode::Csv), (CommandId::Cst, Mode::Cst)];
            if let Some((_, mode)) = motions.iter().find(|(id, _)| is_new && *id == command) {
                let config = self.watch.config().expect("it runs, so it was declared");
                let known = config.slaves[slave - 1].axis().map(|axis| axis.mode);
                assert_eq!(known, Some(*mode), "slave {slave} follows {command}");
            }
        }
        for slave in 1..=board::SLAVES as u8 {
            let goes_home = self.board.engine().homing_phase(slave) == HomingPhase::Homing;
            assert!(
                !goes_home || self.watch.homing().any(|known| known == slave),
                "slave {slave} goes home, and the watch does not know"
            );
        }
    }
}
