//! Runs that are made of single frames, and the results for them. `host.rs`: runs whose host was late.

mod host;

use super::*;
use crate::compare::TimedFrame;
use crate::ethercat::cia402::Mode;
use crate::ethercat::coe::{ObjectAddress, SdoSize};
use crate::link::Dir;
use crate::sk::{
    CommandId, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, Motion, SdoCommand, SlaveCommand,
    SlaveKind, SlotSize, StateByte,
};

const SIZE: SlotSize = SlotSize::Bytes12;
const MS: i64 = 1_000_000;

/// A run that the test writes frame by frame.
struct Run {
    survey: Survey,
    number: u64,
    at_ns: i64,
}

impl Run {
    fn new() -> Self {
        Self { survey: Survey::new(SIZE), number: 0, at_ns: 0 }
    }

    /// A run with some drives, brought to OP with a cycle time.
    fn in_op(drives: usize, cycle_us: u32) -> Self {
        let mut run = Self::new();
        run.report(StateByte::reached(MasterState::PreOp), 0);
        for group in 0..drives.div_ceil(8) {
            let kinds =
                std::array::from_fn(|k| if group * 8 + k < drives { SlaveKind::Drive } else { SlaveKind::None });
            run.master(MasterCommand::SetAxis { group: group as u8, kinds });
        }
        let cycle = CycleTime::from_us(cycle_us).expect("a cycle");
        run.master(MasterCommand::SetDc { cycle, shift: crate::sk::DcShift::Auto });
        run.master(MasterCommand::SetState(MasterState::Op));
        run.pass(50 * MS).report(StateByte::reached(MasterState::Op), 160);
        run
    }

    fn take(&mut self, dir: Dir, frame: Frame) -> &mut Self {
        self.number += 1;
        self.survey.frame(&TimedFrame { number: self.number, at_ns: self.at_ns, dir, frame });
        self
    }

    fn pass(&mut self, ns: i64) -> &mut Self {
        self.at_ns += ns;
        self
    }

    fn report(&mut self, state: StateByte, fifo_free: u16) -> &mut Self {
        let mut frame = Frame::new();
        frame.put(SIZE, 0, &MasterResponse { state, fifo_free, ..MasterResponse::default() }.encode());
        self.take(Dir::Read, frame)
    }

    fn op(&mut self, waiting: u16) -> &mut Self {
        self.report(StateByte::reached(MasterState::Op), 160 - waiting)
    }

    fn master(&mut self, command: MasterCommand) -> &mut Self {
        let mut frame = Frame::new();
        frame.put_master(SIZE, &command);
        self.take(Dir::Write, frame)
    }

    fn slave(&mut self, slave: usize, command: SlaveCommand) -> &mut Self {
        let mut frame = Frame::new();
        frame.put_slave(SIZE, slave, &command.into());
        self.take(Dir::Write, frame)
    }

    fn csp(&mut self, target: i32) -> &mut Self {
        self.slave(1, SlaveCommand::Csp(Motion::to(target)))
    }

    fn sdo(&mut self, command: SdoCommand) -> &mut Self {
        let mut frame = Frame::new();
        frame.put_sdo(SIZE, &command);
        self.take(Dir::Write, frame)
    }

    /// A motion with one target a cycle, while `waiting` command frames wait in the FIFO.
    fn moves(&mut self, targets: std::ops::Range<i32>, waiting: u16, cycle_ns: i64) -> &mut Self {
        for n in targets {
            self.pass(cycle_ns / 2).op(waiting).pass(cycle_ns - cycle_ns / 2).csp(10 * n);
        }
        self
    }

    fn found(&self) -> Migration {
        Migration::of(&self.survey, &Setting::default())
    }
}

fn item(found: &Migration, subject: Subject) -> Item {
    let item = found.items.iter().find(|item| item.count.subject == subject);
    item.unwrap_or_else(|| panic!("{subject} is none of {:?}", found.items)).clone()
}

fn verdict(found: &Migration, subject: Subject) -> Verdict {
    item(found, subject).verdict
}

/// Each feature is listed once, with its count and its first frame.
#[test]
fn what_is_used_is_counted() {
    let homing = ObjectAddress::new(0x6098, 0);
    let mut run = Run::in_op(3, 2000);
    run.sdo(SdoCommand::Write { slave: 1, object: homing, size: SdoSize::One, value: 35 });
    run.sdo(SdoCommand::Write { slave: 2, object: homing, size: SdoSize::One, value: 35 });
    run.slave(1, SlaveCommand::GoHome).take(Dir::Write, Frame::new());
    let found = run.found();
    assert_eq!(
        (found.commands, found.polls, found.reports, found.op),
        (6, 1, 2, Some(Stretch { from_ns: 50 * MS, to_ns: 50 * MS }))
    );
    let count = |subject| item(&found, subject).count;
    assert_eq!(
        (count(Subject::Kind(SlaveKind::Drive)).times, count(Subject::Mode(SlaveKind::Drive, Mode::Csp)).times),
        (3, 3)
    );
    let cycle = CycleTime::from_us(2000).expect("a cycle");
    assert_eq!((count(Subject::Cycle(cycle)).times, found.cycle), (1, cycle));
    let homing = count(Subject::Write(homing));
    assert_eq!((homing.times, homing.first), (2, Place { frame: 6, at_ns: 50 * MS }));
    assert_eq!(count(Subject::Command(CommandId::SdoWrite)).times, 2);
    assert_eq!(count(Subject::Command(CommandId::GoHome)).times, 1);
    assert_eq!(count(Subject::Command(CommandId::GetStatus)).times, 1);
    assert_eq!(count(Subject::State(MasterState::Op)).times, 1);
    assert_eq!(Subject::Mode(SlaveKind::Drive, Mode::Csp).to_string(), "DRIVE in CSP");
    // The start to OP is the only difference, because it takes longer over a chip. A program that was recorded over a
    // chip has waited for that, so it runs unchanged.
    assert_eq!(found.rows(), [Row::Start]);
    assert!(Migration::of(&run.survey, &Setting { is_behind_chip: true, ..Setting::default() }).runs_as_it_is());
}

/// A program that computes targets from the newest report differs by the latency; a program that writes ahead does not.
#[test]
fn who_works_from_report_to_report_is_told() {
    let csp = Subject::Command(CommandId::Csp);
    let mut run = Run::in_op(1, 1000);
    assert_eq!(verdict(run.moves(0..100, 0, MS).found_ref(), csp), Verdict::Differs(Row::Latency));
    let mut run = Run::in_op(1, 1000);
    assert_eq!(verdict(run.moves(0..100, 20, MS).found_ref(), csp), Verdict::Yes);
    // A program that writes a command only now and then is no closed loop.
    let mut run = Run::in_op(1, 1000);
    for n in 0..100 {
        run.csp(n).pass(20 * MS).op(0);
    }
    assert_eq!(verdict(run.found_ref(), csp), Verdict::Yes);
}

impl Run {
    fn found_ref(&self) -> &'static Migration {
        Box::leak(Box::new(self.found()))
    }
}

/// Commands differ only if the recording shows circumstances in which an ECM-XF differs.
#[test]
fn circumstances_decide() {
    let read = SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x6041, 0) };
    let mut run = Run::in_op(2, 1000);
    run.sdo(read);
    assert_eq!(verdict(&run.found(), Subject::Command(CommandId::SdoRead)), Verdict::Yes);
    run.master(MasterCommand::SetState(MasterState::SafeOp)).sdo(read);
    assert_eq!(verdict(&run.found(), Subject::Command(CommandId::SdoRead)), Verdict::Differs(Row::Sdo));
    let mut run = Run::in_op(2, 1000);
    run.slave(2, SlaveCommand::ServoOn);
    assert_eq!(verdict(&run.found(), Subject::Command(CommandId::ServoOn)), Verdict::Yes);
    run.moves(0..20, 20, MS).slave(2, SlaveCommand::ServoOn);
    assert_eq!(verdict(&run.found(), Subject::Command(CommandId::ServoOn)), Verdict::Differs(Row::Hold));
    let mut run = Run::in_op(2, 1000);
    run.master(MasterCommand::SetFifo(FifoAction::Threshold(100)));
    assert_eq!(verdict(&run.found(), Subject::Command(CommandId::SetFifo)), Verdict::Yes);
    run.master(MasterCommand::SetFifo(FifoAction::Clear));
    assert_eq!(verdict(&run.found(), Subject::Command(CommandId::SetFifo)), Verdict::Differs(Row::Clear));
    run.master(MasterCommand::LocalRead);
    assert_eq!(verdict(&run.found(), Subject::Command(CommandId::LocalRead)).row(), Some(Row::Lio));
    assert_eq!(run.found().rows(), [Row::Clear, Row::Lio, Row::Start]);
}

/// A program that gives up a change of state before it is done would also give up over a chip, where the change takes
/// longer.
#[test]
fn a_program_that_gives_up() {
    let op = Subject::State(MasterState::Op);
    let mut run = Run::in_op(2, 1000);
    run.master(MasterCommand::SetState(MasterState::PreOp)).pass(MS).report(StateByte::reached(MasterState::PreOp), 0);
    // A recording does not show how long the program would wait for OP, so the verdict differs even without any exposed
    // use.
    let found = item(&run.found(), op);
    assert_eq!((found.verdict, found.count.exposed), (Verdict::Differs(Row::Start), 0));
    run.master(MasterCommand::SetState(MasterState::Op)).pass(500 * MS);
    run.report(StateByte::reached(MasterState::SafeOp), 0).master(MasterCommand::SetState(MasterState::Init));
    let found = item(&run.found(), op);
    assert_eq!((found.verdict, found.count.times, found.count.exposed), (Verdict::Differs(Row::Start), 2, 1));
}

/// The start to OP: the time that the board took from SET_STATE on, without what the program did between two changes.
/// Also the time over a chip for the slaves that were found. Slaves declared as none are in the links too.
#[test]
fn the_way_to_op() {
    let start = |run: &Run| run.found().plan.expect("a plan").start;
    assert_eq!(start(&Run::in_op(2, 1000)).recorded, Some((50 * MS, Place { frame: 5, at_ns: 50 * MS })));
    let mut run = Run::new();
    run.report(StateByte::reached(MasterState::PreOp), 0).slaves(8, 10);
    run.master(MasterCommand::SetState(MasterState::SafeOp)).pass(300 * MS);
    run.report(StateByte::reached(MasterState::SafeOp), 0).pass(1000 * MS);
    run.master(MasterCommand::SetState(MasterState::Op)).pass(5 * MS).master(MasterCommand::SetState(MasterState::Op));
    run.pass(25 * MS).op(0);
    assert_eq!(start(&run).recorded.map(|(ns, _)| ns), Some(330 * MS));
    let found = run.found();
    assert_eq!(verdict(&found, Subject::State(MasterState::SafeOp)), Verdict::Differs(Row::Start));
    let plan = found.plan.expect("a plan");
    assert_eq!((plan.network.found, plan.network.count()), (10, 8));
    assert!(plan.links.model.starts_with("xf-sim:?slaves=drive*8,io*2&"), "{}", plan.links.model);
    // If slaves are declared as none, the others change to OP one after the other.
    assert!(plan.start.chip_ns > start(&Run::in_op(8, 1000)).chip_ns + 400 * MS, "{:?}", plan.start);
    assert_eq!(plan.start.timeout_ms, None);
    let mut run = Run::new();
    run.report(StateByte::reached(MasterState::PreOp), 0).slaves(32, 40);
    run.master(MasterCommand::SetState(MasterState::Op)).pass(500 * MS).op(0);
    let plan = run.found().plan.expect("a plan");
    let ms = plan.start.timeout_ms.expect("it may take more than SET_STATE has");
    assert!(plan.start.chip_ns > 3000 * MS && ms > 10_000, "{:?}", plan.start);
    assert!(plan.links.machine.contains(&format!("&state_timeout_ms={ms}")), "{}", plan.links.machine);
    // A change that was given up or failed does not count.
    let mut run = Run::new();
    run.report(StateByte::reached(MasterState::PreOp), 0).slaves(2, 2);
    run.master(MasterCommand::SetState(MasterState::Op)).pass(500 * MS);
    run.report(StateByte::failed(Some(MasterState::PreOp)), 0).pass(5000 * MS);
    run.master(MasterCommand::SetState(MasterState::Op)).pass(40 * MS).op(0);
    assert_eq!(start(&run).recorded.map(|(ns, _)| ns), Some(40 * MS));
}

impl Run {
    /// Declares some drives; the board answers how many slaves it has found.
    fn slaves(&mut self, drives: usize, found: u32) -> &mut Self {
        for group in 0..5 {
            let kind = |k: usize| if group * 8 + k < drives { SlaveKind::Drive } else { SlaveKind::None };
            self.master(MasterCommand::SetAxis { group: group as u8, kinds: std::array::from_fn(kind) });
            let mut frame = Frame::new();
            let state = StateByte::reached(MasterState::PreOp);
            let id = CommandId::SetAxis.code();
            frame.put(SIZE, 0, &MasterResponse { id, state, result: found, ..MasterResponse::default() }.encode());
            self.take(Dir::Read, frame);
        }
        self
    }
}

/// Lost slaves and returning slaves are reported with the first frame that shows them.
#[test]
fn lost_slaves() {
    let mut run = Run::in_op(2, 1000);
    let failed = StateByte::failed(Some(MasterState::Op));
    run.pass(MS).report(failed, 160).pass(MS).report(failed, 160);
    run.master(MasterCommand::SetState(MasterState::Op)).pass(MS).op(0).pass(MS).report(failed, 160);
    let found = run.found();
    let lost = item(&found, Subject::Lost);
    assert_eq!((lost.count.times, lost.count.first.frame, lost.verdict), (2, 6, Verdict::Differs(Row::Loss)));
    let back = item(&found, Subject::Return);
    assert_eq!((back.count.times, back.verdict), (1, Verdict::Differs(Row::Remap)));
}

/// A cycle time that is too short for any packet gets the verdict "no"; the reason has the calculated time, and the next
/// step has the next cycle time that works.
#[test]
fn a_cycle_that_the_chip_cannot_hold() {
    let found = Run::in_op(40, 250).found();
    let Verdict::No { row, reason, next } = verdict(&found, Subject::Cycle(CycleTime::from_us(250).expect("a cycle")))
    else {
        panic!("{:?}", found.items)
    };
    assert_eq!(row, Row::Cycle);
    assert!(!reason.contains("INT0"), "INT0 is wired where this is said: {reason}");
    // A process image has 400 bytes, and three of them need packets of 1232 bytes: 411 us at 24 MHz and 100 us idle
    // time. With two exchanges in flight, two such packets serve three cycles: 2 * 511 us / 3 = 341 us.
    assert!(
        reason.contains("a cycle of 250 us cannot be held: the exchanges with the chip take 341 us for each"),
        "{reason}"
    );
    assert!(next.starts_with("a cycle of 1000 us holds"), "{next}");
    assert!(found.plan.expect("a plan").links.machine.contains("&speed=24M"));
    // This cycle time is long enough; without INT0 it needs larger packets.
    let found = Run::in_op(40, 1000).found();
    let plan = found.plan.as_ref().expect("a plan");
    let packets = plan.needs.with_int0.expect("packets");
    assert_eq!(
        (packets.size.bytes(), packets.sets, packets.in_flight, packets.least_clock_hz),
        (400, 1, 1, 17_141_000)
    );
    let packets = plan.needs.without_int0.expect("packets");
    assert_eq!((packets.size.bytes(), packets.sets), (800, 2));
    // The chip's memory of 16384 bytes has room for 25 process images of 640 bytes, outputs and inputs together.
    assert_eq!((plan.needs.entries, plan.needs.ahead_max), (25, 21));
    assert_eq!(plan.links.machine, "xf-spi:/dev/spidev0.0?int0=gpiochip0/24&ahead=4&use_n=400&speed=24M");
    assert_eq!(plan.links.model, "xf-sim:?slaves=drive*40&int0=yes&ahead=4&use_n=400&speed=24M");
}

/// Two exchanges in flight are allowed only if each carries one process image: with several in each, the model does not
/// reach OP.
#[test]
fn two_exchanges_under_way() {
    let at = |clock_hz| {
        let run = Run::in_op(40, 1000);
        let setting = Setting { clock_hz, ..Setting::default() };
        Migration::of(&run.survey, &setting)
    };
    let cycle = Subject::Cycle(CycleTime::from_us(1000).expect("a cycle"));
    let found = at(12_000_000);
    let packets = found.plan.as_ref().expect("a plan").needs.with_int0.expect("packets");
    assert_eq!((packets.in_flight, packets.sets, packets.size.bytes()), (2, 1, 400));
    assert_eq!(verdict(&found, cycle), Verdict::Differs(Row::Cycle));
    let found = at(8_000_000);
    assert!(matches!(verdict(&found, cycle), Verdict::No { row: Row::Cycle, .. }), "{:?}", found.items);
}

/// Small networks get packets of 112 bytes, the size that an ECM-XF starts with.
#[test]
fn small_packets() {
    let found = Run::in_op(2, 1000).found();
    let plan = found.plan.expect("a plan");
    assert_eq!((plan.needs.output_bytes, plan.needs.input_bytes), (12, 20));
    assert_eq!(plan.needs.least_size().expect("a size").bytes(), 32);
    assert!(plan.links.machine.ends_with("&ahead=4&use_n=112&speed=24M"), "{}", plan.links.machine);
    let packets = plan.needs.with_int0.expect("packets");
    // 24 MHz: five process images of 20 bytes fit into packets of 112 bytes. At the lowest clock eight of them are in a
    // packet of 192 bytes: 4 packets may take 8 cycles of 900 us, so each has 1700 us plus 100 us idle time.
    assert_eq!((packets.sets, packets.least_clock_hz), (5, 904_000));
    assert_eq!((plan.needs.entries, plan.needs.ahead_max), (64, 60));
    let slow = Setting { clock_hz: 1_000_000, ..Setting::default() };
    let found = Migration::of(&Run::in_op(2, 1000).survey, &slow);
    // At 1 MHz 144 bytes take 1152 us: too long for one cycle, but not for five.
    let packets = found.plan.expect("a plan").needs.with_int0.expect("packets");
    assert!(packets.sets > 1 && packets.least_clock_hz <= 1_000_000, "{packets:?}");
}

/// A program that was never in OP does not count as running unchanged.
#[test]
fn never_in_op() {
    let mut run = Run::new();
    run.report(StateByte::reached(MasterState::PreOp), 0).master(MasterCommand::SoftReset);
    let found = run.found();
    assert!(found.op.is_none() && !found.runs_as_it_is() && found.plan.is_none());
    assert_eq!(found.timing.stall(MS), None);
}

/// A cycle longer than the watchdog time of the slaves does not work, and the next step names the longest cycle time
/// that does. A shorter cycle works.
#[test]
fn a_cycle_beyond_the_watchdog_does_not_run() {
    let found = |cycle_us| {
        let run = Run::in_op(2, cycle_us);
        let found = Migration::of(&run.survey, &Setting::default());
        let item = found.items.iter().find(|item| matches!(item.count.subject, Subject::Cycle(_))).expect("SET_DC");
        item.verdict.clone()
    };
    assert_eq!(found(64_000), Verdict::Yes);
    for cycle_us in [128_000, 256_000, 512_000] {
        let Verdict::No { row: Row::Cycle, reason, next } = found(cycle_us) else { panic!("{cycle_us}") };
        assert!(reason.contains("watchdog") && reason.contains(&cycle_us.to_string()), "{reason}");
        assert_eq!(next, "take a cycle of 64000 us at most (SET_DC)");
    }
}
