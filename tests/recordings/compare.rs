//! Comparison of two runs of a program: differences, and mere timing.

use ecmsk::cia402::Statusword;
use ecmsk::coe::ObjectAddress;
use ecmsk::compare::{CompareError, CompareOptions, Comparison, Deviation, Side, TimedFrame, compare, files};
use ecmsk::link::Dir;
use ecmsk::sk::{
    CommandId, DriveResponse, Frame, MasterCommand, MasterResponse, MasterState, Motion, RawSlot, SdoCommand,
    SdoResponse, SlaveCommand, SlaveKind, SlaveResponse, SlotSize, StateByte,
};
use support::recorded::{BEFORE, Program, Run, SIZE, TARGETS};

fn compared(a: &Run, b: &Run, options: &CompareOptions) -> Comparison {
    files(&a.file, &b.file, options).expect("two recordings")
}

fn first(a: &Run, b: &Run) -> (u64, Deviation, String) {
    let found = compared(a, b, &CompareOptions::default());
    let first = found.first.unwrap_or_else(|| panic!("no difference"));
    (first.command, first.what[0].clone(), first.to_string())
}

/// A run is equal to itself, command for command, with an answer to nearly each.
#[test]
fn a_run_is_equal_to_itself() {
    let run = Program::default().record();
    let found = compared(&run, &run, &CompareOptions::default());
    assert!(found.is_equal(), "{found}");
    let commands = BEFORE + TARGETS as u64 + 4;
    assert_eq!(found.counts.map(|counts| counts.commands), [commands; 2]);
    // SET_AXIS and SET_DC are written without a report between them.
    assert!(found.answers >= commands - 2, "{found}");
    assert_eq!((found.ends_early, found.differing_answers), (None, 0));
}

/// Slower writes, more polls and more reports are no difference.
#[test]
fn timing_is_no_difference() {
    let a = Program::default().record();
    for (keys, polls) in [("&host_us=400", 0), ("&host_us=20", 1), ("", 2), ("&host_us=300", 3)] {
        let b = Program { keys: keys.into(), polls, ..Program::default() }.record();
        let found = compared(&a, &b, &CompareOptions::default());
        assert!(found.is_equal(), "{keys} {polls}: {found}");
        assert!(polls == 0 || found.counts[1].polls > 20, "{found}");
        assert_ne!(found.counts[0].last_ns, found.counts[1].last_ns, "{keys} {polls}");
        assert!(found.answers > 300, "{found}");
    }
}

/// Answers are found at any cycle: that of SET_DC.
#[test]
fn other_cycles() {
    for cycle_us in [250, 2000] {
        let run = |keys: &str| Program { cycle_us, keys: keys.into(), ..Program::default() }.record();
        let found = compared(&run("&host_us=100"), &run("&host_us=60"), &CompareOptions::default());
        assert!(found.is_equal() && found.answers > 300, "{cycle_us}: {found}");
    }
}

/// A different command is reported with its number, slave and both targets.
#[test]
fn another_target() {
    let a = Program::default().record();
    let b = Program { other_target: Some((100, 5)), ..Program::default() }.record();
    let (command, what, text) = first(&a, &b);
    assert_eq!(command, BEFORE + 101);
    assert!(matches!(what, Deviation::Command { .. }), "{what:?}");
    assert!(text.starts_with("command 105 at "), "{text}");
    assert!(text.ends_with("slave 2 CSP #101 target 2020 in A, CSP #101 target 2025 in B"), "{text}");
    let found = compared(&a, &b, &CompareOptions::default());
    let context: Vec<_> = found.context.iter().map(|line| line.command).collect();
    assert_eq!(context, [102, 103, 104]);
    assert_eq!(found.counts[0].commands, found.counts[1].commands, "what follows is counted");
}

/// A fault on one board is found at the command in whose cycle it occurred, with both statuswords; that the program
/// ended because of it is reported, too.
#[test]
fn a_fault_of_one_board() {
    let a = Program::default().record();
    let b = Program { script: "at 600ms alarm 2 0x7500 stays".into(), ..Program::default() }.record();
    let found = compared(&a, &b, &CompareOptions::default());
    let first = found.first.as_ref().expect("a difference");
    let fault = first.what.iter().any(
        |what| matches!(what, Deviation::Statusword { slave: 2, words: [a, b] } if a.is_enabled() && b.0 & 0x08 != 0),
    );
    assert!(fault, "{first}");
    assert!(first.what.contains(&Deviation::ErrorCode { slave: 2, codes: [0, 0x7500] }), "{first}");
    assert!((BEFORE..BEFORE + TARGETS as u64).contains(&first.command), "{first}");
    assert!(first.text.starts_with("slave 2 CSP #"), "{first}");
    assert!(first.to_string().contains(" in A, 0x") && first.to_string().contains("(Fault"), "{first}");
    assert_eq!(found.ends_early, Some(Side::B));
    assert!(found.differing_answers > 1, "{found}");
    assert!(found.to_string().ends_with("B ends early: 304 of 308 commands"), "{found}");
}

/// A board with constructed frames: one drive, cycle 1 ms, in OP.
#[derive(Clone)]
struct Board {
    frames: Vec<TimedFrame>,
    state: MasterState,
    at_ns: i64,
    full: u16,
}

impl Board {
    /// A board that is in OP.
    fn op() -> Self {
        let mut board = Self { frames: Vec::new(), state: MasterState::Op, at_ns: 0, full: 0 };
        board.send(&MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Drive; 8] });
        board.report(160, 0, 0x1637, 0);
        board
    }

    fn pass(&mut self, dir: Dir, mut frame: Frame) {
        frame.fill_crc(SIZE);
        self.at_ns += 100_000;
        self.frames.push(TimedFrame { number: self.frames.len() as u64 + 1, at_ns: self.at_ns, dir, frame });
    }

    fn send(&mut self, command: &MasterCommand) {
        let mut frame = Frame::new();
        frame.put_master(SIZE, command);
        self.pass(Dir::Write, frame);
    }

    fn csp(&mut self, target: i32) {
        let mut frame = Frame::new();
        frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(target)).into());
        self.pass(Dir::Write, frame);
    }

    fn poll(&mut self) {
        self.pass(Dir::Write, Frame::new());
    }

    fn sdo_read(&mut self) {
        let mut frame = Frame::new();
        frame.put_sdo(SIZE, &SdoCommand::Read { slave: 1, object: OBJECT });
        self.pass(Dir::Write, frame);
    }

    /// The report of the next cycle.
    fn report(&mut self, free: u16, position: i32, statusword: u16, error_code: u16) {
        self.report_with(free, position, statusword, error_code, SdoResponse::Empty);
    }

    fn report_with(&mut self, free: u16, position: i32, statusword: u16, error_code: u16, sdo: SdoResponse) {
        self.at_ns = (self.at_ns / 1_000_000 + 1) * 1_000_000 - 100_000;
        let mut frame = Frame::new();
        let state = StateByte::reached(self.state);
        let full_count = self.full;
        let board = MasterResponse { id: 0xBF, state, fifo_free: free, full_count, ..Default::default() };
        frame.put(SIZE, 0, &board.encode());
        let head = SlaveResponse { id: 0x15, index: 0 };
        let statusword = Statusword(statusword);
        frame.put(SIZE, 1, &DriveResponse { head, statusword, position, torque: 0, error_code }.encode());
        frame.put(SIZE, SIZE.sdo_slot(), &sdo.encode());
        self.pass(Dir::Read, frame);
    }
}

const OBJECT: ObjectAddress = ObjectAddress::new(0x6064, 0);

fn what(a: &Board, b: &Board, options: &CompareOptions) -> Option<(u64, Vec<Deviation>)> {
    compare(a.frames.clone(), b.frames.clone(), SIZE, options).first.map(|first| (first.command, first.what))
}

/// Positions may differ by the tolerance, and masked bits of a statusword do not count.
#[test]
fn tolerance_and_mask() {
    let run = |position, statusword| {
        let mut board = Board::op();
        board.csp(1000);
        board.report(160, position, statusword, 0);
        board
    };
    let (a, b) = (run(1000, 0x1637), run(1003, 0x1637));
    let apart = |tolerance_counts| what(&a, &b, &CompareOptions { tolerance_counts, ..CompareOptions::default() });
    assert_eq!(apart(2), Some((2, vec![Deviation::Position { slave: 1, axis: 1, counts: [1000, 1003] }])));
    assert_eq!(apart(3), None);
    let far = |options: &CompareOptions| what(&run(i32::MIN, 0x1637), &run(i32::MAX, 0x1637), options);
    assert!(far(&CompareOptions { tolerance_counts: u32::MAX - 1, ..CompareOptions::default() }).is_some());
    let masked = |statusword_mask| {
        what(&a, &run(1000, 0x9637), &CompareOptions { statusword_mask, ..CompareOptions::default() })
            .map(|(command, _)| command)
    };
    assert_eq!((masked(0xFFFF), masked(0x006F)), (Some(2), None));
}

/// The board's last answer before the next command counts, not the answers before it.
#[test]
fn the_last_answer_counts() {
    let run = |on_the_way: &[u16]| {
        let mut board = Board::op();
        board.csp(5);
        for statusword in on_the_way {
            board.poll();
            board.report(160, 5, *statusword, 0);
        }
        board.csp(6);
        board.report(160, 6, 0x1637, 0);
        board
    };
    let a = run(&[0x0231, 0x0233, 0x1637]);
    assert_eq!(what(&a, &run(&[0x0233, 0x1637]), &CompareOptions::default()), None);
    let late = what(&a, &run(&[0x0231, 0x0233]), &CompareOptions::default()).expect("a difference");
    assert_eq!(late.0, 2);
}

/// The final position of an axis counts, although both runs have shown both positions shortly before: at the end of the
/// run, and of OP.
#[test]
fn the_last_position_counts() {
    let run = |positions: &[(i32, usize)], leaves: bool| {
        let mut board = Board::op();
        board.csp(5);
        for (position, reports) in positions {
            for _ in 0..*reports {
                board.poll();
                board.report(160, *position, 0x1637, 0);
            }
        }
        if leaves {
            board.send(&MasterCommand::SetState(MasterState::PreOp));
            board.state = MasterState::PreOp;
            board.report(0, 0, 0, 0);
        }
        board
    };
    for leaves in [false, true] {
        let (a, b) = (run(&[(5, 12), (6, 10)], leaves), run(&[(6, 12), (5, 10)], leaves));
        let expected = Deviation::Position { slave: 1, axis: 1, counts: [6, 5] };
        assert_eq!(what(&a, &b, &CompareOptions::default()), Some((2, vec![expected])), "{leaves}");
        assert_eq!(what(&a, &run(&[(5, 3), (6, 40)], leaves), &CompareOptions::default()), None, "{leaves}");
    }
}

/// Outside OP slaves' slots keep their content (SK-4), and do not count; the state does.
#[test]
fn slaves_count_in_op_alone() {
    let run = |state, position| {
        let mut board = Board::op();
        board.send(&MasterCommand::SetState(MasterState::SafeOp));
        board.state = state;
        board.report(0, position, 0x1637, 0);
        board
    };
    let safe_op = |position| run(MasterState::SafeOp, position);
    assert_eq!(what(&safe_op(1), &safe_op(2), &CompareOptions::default()), None);
    let (command, found) =
        what(&safe_op(1), &run(MasterState::PreOp, 1), &CompareOptions::default()).expect("a difference");
    let states = [MasterState::SafeOp, MasterState::PreOp].map(StateByte::reached);
    assert_eq!((command, found), (2, vec![Deviation::State { states }]));
}

/// A temporary fault of one board is reported although it has ended before the next command.
#[test]
fn a_fault_on_the_way() {
    let run = |on_the_way: &[(u16, u16)]| {
        let mut board = Board::op();
        board.csp(5);
        for (statusword, error_code) in on_the_way {
            board.report(160, 5, *statusword, *error_code);
        }
        board.report(160, 5, 0x1637, 0);
        board
    };
    let (none, fault) = (run(&[]), run(&[(0x0218, 0), (0x0218, 0x7500)]));
    let expected = |side| Some((2, vec![Deviation::Fault { slave: 1, side, error_code: 0x7500 }]));
    let text = Deviation::Fault { slave: 1, side: Side::B, error_code: 0x7500 }.to_string();
    assert_eq!(text, "slave 1 had a fault in B, error code 0x7500 (communication)");
    assert_eq!(what(&none, &fault, &CompareOptions::default()), expected(Side::B));
    assert_eq!(what(&fault, &none, &CompareOptions::default()), expected(Side::A));
    assert_eq!(what(&fault, &run(&[(0x0218, 0x7500)]), &CompareOptions::default()), None, "the code may come later");
}

/// A command is answered when it has been executed, not when it was sent: an answer does not belong to commands that
/// wait in the FIFO.
#[test]
fn answers_belong_to_the_command_executed() {
    let run = |ahead: i32| {
        let mut board = Board::op();
        for i in 0..20 + ahead {
            if i < 20 {
                board.csp(i);
            }
            if i >= ahead {
                let waiting = (19 - (i - ahead)).min(ahead);
                board.report(160 - waiting as u16, i - ahead, 0x1637, 0);
            }
        }
        board
    };
    for ahead in [1, 5, 12] {
        assert_eq!(what(&run(0), &run(ahead), &CompareOptions::default()), None, "{ahead}");
    }
}

/// An SDO has one answer, in any report; a missing answer is a difference too.
#[test]
fn sdo_answers() {
    let run = |waits: usize, value: Option<u32>| {
        let mut board = Board::op();
        board.sdo_read();
        let answer = value.map_or(SdoResponse::Empty, |value| SdoResponse::Done {
            id: CommandId::SdoRead,
            slave: 1,
            object: OBJECT,
            value,
        });
        for i in 0..4 {
            board.csp(i);
            let sdo = if i as usize >= waits { answer } else { SdoResponse::Empty };
            board.report_with(160, i, 0x1637, 0, sdo);
        }
        board
    };
    let a = run(0, Some(7));
    assert_eq!(what(&a, &run(3, Some(7)), &CompareOptions::default()), None);
    let (command, other) = what(&a, &run(2, Some(8)), &CompareOptions::default()).expect("a difference");
    assert!(command == 5 && matches!(other[..], [Deviation::Sdo { .. }]), "{command} {other:?}");
    let (_, none) = what(&a, &run(0, None), &CompareOptions::default()).expect("a difference");
    assert!(matches!(none[..], [Deviation::NoSdoAnswer { side: Side::B, .. }]), "{none:?}");
}

/// Commands lost in one run are a difference.
#[test]
fn lost_commands() {
    let run = |lost: u16| {
        let mut board = Board::op();
        for i in 0..4 {
            board.csp(i);
            board.full = if i == 2 { lost } else { board.full };
            board.report(160, i, 0x1637, 0);
        }
        board
    };
    let (_, found) = what(&run(0), &run(3), &CompareOptions::default()).expect("a difference");
    assert_eq!(found[0], Deviation::Lost { side: Side::B });
}

/// Commands repeated until their effect is reached count once, if requested.
#[test]
fn repeats() {
    let a = Program::default().record();
    let b = Program { repeats: 3, polls: 1, ..Program::default() }.record();
    assert!(!compared(&a, &b, &CompareOptions::default()).is_equal());
    let found = compared(&a, &b, &CompareOptions { ignore_repeats: true, ..CompareOptions::default() });
    assert!(found.is_equal(), "{found}");
    assert!(found.counts[1].repeats >= 6, "{found}");
}

/// A run that ends early is reported with the first missing command.
#[test]
fn an_early_end() {
    let a = Program::default().record();
    let b = Program { short: true, ..Program::default() }.record();
    for (one, other, side) in [(&a, &b, Side::B), (&b, &a, Side::A)] {
        let found = compared(one, other, &CompareOptions::default());
        assert_eq!(found.ends_early, Some(side));
        let first = found.first.expect("a difference");
        assert_eq!((first.command, &first.what[..]), (BEFORE + TARGETS as u64 + 1, &[Deviation::Ends { side }][..]));
        assert_eq!(first.text, "slave 3 IO_WR outputs 0x5A5A");
    }
}

/// CRCs and filler bytes are no part of a command.
#[test]
fn crcs_do_not_count() {
    let a = Board::op();
    let mut b = a.clone();
    b.frames[0].frame.bytes_mut()[3] ^= 0x55;
    b.frames[0].frame.bytes_mut()[511] = 0xCC;
    assert_eq!(what(&a, &b, &CompareOptions::default()), None);
}

/// Runs that cannot be compared are an error that says what to do.
#[test]
fn what_cannot_be_compared() {
    let run = Program::default().record();
    let nowhere = std::path::Path::new("/no/such/file");
    let error = files(&run.file, nowhere, &CompareOptions::default()).expect_err("no file");
    assert!(matches!(error, CompareError::Recording(_)) && error.to_string().contains("check the path"), "{error}");
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("wide.pcapng");
    let uri = format!("sim:?slot=16&clock=virtual&record={}", file.display());
    let link = ecmsk::link::open(&uri, ecmsk::link::Share::ByName).expect("a board");
    link.write(&Frame::new(), ecmsk::link::Wait::Now).expect("written");
    link.close();
    let error = files(&run.file, &file, &CompareOptions::default()).expect_err("other slots");
    assert_eq!(error, CompareError::SlotSizes { a: SlotSize::Bytes12, b: SlotSize::Bytes16 });
    assert!(error.to_string().ends_with("give the slot size"), "{error}");
}

mod any_frames {
    use proptest::prelude::*;

    use super::*;

    prop_compose! {
        /// A slot, often with a valid command.
        fn slots()(code: u8, index in 0_u8..4, parm: u16, data1: u32, data2: u32) -> RawSlot {
            let id = CommandId::ALL.get(usize::from(code)).map_or(code, |known| known.code());
            RawSlot { id, index, parm, data1, data2, data3: 0 }
        }
    }

    prop_compose! {
        /// A frame and the time since the previous one: a command of any kind, or a report of any state.
        fn frames()(
            is_report: bool,
            state in prop::sample::select(vec![0_u8, 1, 2, 4, 8, 8, 8, 0x12, 0x18, 0xFF]),
            fifo_free in 0_u16..200,
            place in 0_usize..42,
            slot in slots(),
            after_ns in 0_i64..1_000_000,
        ) -> (Dir, Frame, i64) {
            let mut frame = Frame::new();
            frame.put(SIZE, place, &slot);
            if is_report {
                let board = MasterResponse { id: 0xBF, state: StateByte(state), fifo_free, ..Default::default() };
                frame.put(SIZE, 0, &board.encode());
            }
            (if is_report { Dir::Read } else { Dir::Write }, frame, after_ns)
        }
    }

    fn runs() -> impl Strategy<Value = Vec<TimedFrame>> {
        prop::collection::vec(frames(), 0..200).prop_map(|frames| {
            let mut at_ns = 0;
            let observe = |(number, (dir, frame, after_ns))| {
                at_ns += after_ns;
                TimedFrame { number, at_ns, dir, frame }
            };
            (1..).zip(frames).map(observe).collect()
        })
    }

    proptest! {
        /// For any frames a run is equal to itself, and the differences of two runs are symmetric.
        #[test]
        fn compare_takes_any_frames(
            a in runs(),
            b in runs(),
            ignore_repeats: bool,
            latency_cycles in prop::option::of(0_u32..30),
        ) {
            let options = CompareOptions { ignore_repeats, latency_cycles, ..CompareOptions::default() };
            let same = compare(a.clone(), a.clone(), SIZE, &options);
            prop_assert!(same.is_equal(), "{same}");
            let one = compare(a.clone(), b.clone(), SIZE, &options);
            let other = compare(b, a, SIZE, &options);
            prop_assert_eq!(one.first.map(|first| first.command), other.first.map(|first| first.command));
            prop_assert_eq!(one.counts[0], other.counts[1]);
            prop_assert_eq!(one.ends_early, other.ends_early.map(Side::other));
        }
    }
}
