//! Comparison with a run whose board answers later: the latency is reported, and hides no difference.

use std::sync::LazyLock;

use ecmsk::cia402::Statusword;
use ecmsk::compare::{CompareOptions, Comparison, Deviation, Gaps, RecordedRun, Side, Steps, TimedFrame, compare};
use ecmsk::link::Dir;
use ecmsk::sk::{
    CommandId, DriveResponse, Frame, IoResponse, MasterResponse, MasterState, RawSlot, SdoResponse, StateByte,
};
use support::recorded::{Program, SIZE, TARGETS};

type Frames = Vec<TimedFrame>;
/// A change of a run, and its name.
type Way<'a> = (&'a str, &'a dyn Fn(&mut Frames));

fn frames(program: &Program) -> Frames {
    let run = program.record();
    RecordedRun::open(&run.file, None, None).expect("a recording").collect()
}

/// The program on a board.
static BOARD: LazyLock<Frames> = LazyLock::new(|| frames(&Program::default()));
/// The same with the slaves behind a chip.
static CHIP: LazyLock<Frames> =
    LazyLock::new(|| frames(&Program { scheme: "xf-sim", keys: "&use_n=1024".into(), ..Program::default() }));

fn with(options: &CompareOptions, a: &Frames, b: &Frames) -> Comparison {
    compare(a.clone(), b.clone(), SIZE, options)
}

/// Compares the board's run with the chip's run after a change.
fn changed(change: impl FnOnce(&mut Frames)) -> Comparison {
    let mut chip = CHIP.clone();
    change(&mut chip);
    with(&CompareOptions::default(), &BOARD, &chip)
}

#[track_caller]
fn what(found: &Comparison) -> &[Deviation] {
    &found.first.as_ref().unwrap_or_else(|| panic!("no difference: {found}")).what
}

/// Indexes of the command frames with that command for slave 1.
fn commands(frames: &Frames, id: CommandId) -> Vec<usize> {
    let is_it = |frame: &Frame| frame.slot(SIZE, 1).id == id.code();
    (0..frames.len()).filter(|i| frames[*i].dir == Dir::Write && is_it(&frames[*i].frame)).collect()
}

/// Indexes of all reports.
fn all_reports(frames: &Frames) -> Vec<usize> {
    (0..frames.len()).filter(|i| frames[*i].dir == Dir::Read).collect()
}

/// Indexes of the reports in OP.
fn reports(frames: &Frames) -> Vec<usize> {
    let in_op = |frame: &Frame| board(frame).state == StateByte::reached(MasterState::Op);
    (0..frames.len()).filter(|i| frames[*i].dir == Dir::Read && in_op(&frames[*i].frame)).collect()
}

fn board(frame: &Frame) -> MasterResponse {
    MasterResponse::decode(&frame.slot(SIZE, 0))
}

fn put(frame: &mut Frame, slot: usize, with: RawSlot) {
    frame.put(SIZE, slot, &with);
    frame.fill_crc(SIZE);
}

fn drive(frame: &Frame, slave: usize) -> DriveResponse {
    DriveResponse::decode(&frame.slot(SIZE, slave))
}

/// Changes a drive's slot in a report.
fn shows(frame: &mut Frame, slave: usize, change: impl FnOnce(&mut DriveResponse)) {
    let mut shown = drive(frame, slave);
    change(&mut shown);
    put(frame, slave, shown.encode());
}

/// The same program on a board and behind a chip: equal, with the latency as a number, at any cycle and with any count
/// of outputs ahead; compared the other way round, the latency is negative.
#[test]
fn a_chip_answers_later_and_that_is_all() {
    for (cycle_us, keys) in [(1000, ""), (1000, "&ahead=20&chip_fw=old"), (500, ""), (2000, "&ahead=4")] {
        let [a, b] = ["sim", "xf-sim"].map(|scheme| {
            let keys = if scheme == "sim" { String::new() } else { keys.to_owned() };
            frames(&Program { scheme, keys, cycle_us, ..Program::default() })
        });
        let found = with(&CompareOptions::default(), &a, &b);
        assert!(found.is_equal(), "{cycle_us} us{keys}: {found}");
        assert!(found.answers > 250, "{found}");
        let latency = &found.latency;
        assert!((1..=8).contains(&latency.usual) && latency.least <= latency.usual, "{cycle_us} us{keys}: {found}");
        assert!(latency.usual <= latency.most && latency.commands >= 4, "{latency:?}");
        assert!(found.to_string().contains(&format!("B answers {} cycle", latency.usual)), "{found}");
        assert_eq!(found.gaps.map(|gaps| gaps.count), [0, 0], "{found}");
        let back = with(&CompareOptions::default(), &b, &a);
        assert!(back.is_equal(), "{back}");
        assert_eq!((back.latency.usual, back.latency.least), (-latency.usual, -latency.most));
    }
}

/// Different commands are a difference at any latency: a lost, duplicated or changed one, or two in another order.
#[test]
fn a_command_lost_doubled_changed_or_in_another_order() {
    let targets = commands(&CHIP, CommandId::Csp);
    assert_eq!(targets.len(), TARGETS as usize);
    for (n, at) in targets.iter().copied().enumerate().skip(1).step_by(23) {
        let ways: [Way; 4] = [
            ("lost", &|frames| {
                frames.remove(at);
            }),
            ("twice", &|frames| frames.insert(at, frames[at].clone())),
            ("other", &|frames| {
                let slot = frames[at].frame.slot(SIZE, 2);
                put(&mut frames[at].frame, 2, RawSlot { data1: slot.data1 + 1, ..slot });
            }),
            ("order", &|frames| {
                let other = frames[targets[n - 1]].frame.clone();
                frames[targets[n - 1]].frame = std::mem::replace(&mut frames[at].frame, other);
            }),
        ];
        for (way, change) in ways {
            let found = changed(change);
            assert!(!found.is_equal(), "{way}, {n}: {found}");
            let first = found.first.expect("a difference");
            // With a missing or additional frame in one recording, reports before it seem to answer other commands.
            let is_command = matches!(&first.what[..], [Deviation::Command { .. } | Deviation::Ends { .. }]);
            assert!(is_command || way == "lost" || way == "twice", "{way}, {n}: {first}");
        }
    }
}

/// Commands that one board has lost or refused are a difference.
#[test]
fn commands_that_the_board_has_lost() {
    for of in [0, 1] {
        let found = changed(|frames| {
            for at in reports(frames).into_iter().skip(250) {
                let shown = board(&frames[at].frame);
                let (full_count, error) = if of == 0 { (1, shown.error) } else { (0, 1) };
                put(&mut frames[at].frame, 0, MasterResponse { full_count, error, ..shown }.encode());
            }
        });
        assert!(what(&found).contains(&Deviation::Lost { side: Side::B }), "{found}");
    }
}

/// A different rest position of an axis is a difference, even by one count: at the end of the run, when OP is left and
/// no answer shows it any more, and between two motions.
#[test]
fn another_position_where_an_axis_stands() {
    let all = reports(&CHIP);
    let end = all.len();
    for (from, to) in [(end - 60, end), (end - 20, end), (end - 60, end - 40)] {
        let found = changed(|frames| {
            for at in &all[from..to] {
                shows(&mut frames[*at].frame, 2, |drive| drive.position += 1);
            }
        });
        let is_it =
            |what: &Deviation| matches!(what, Deviation::Position { slave: 2, counts: [a, b], .. } if b - a == 1);
        assert!(what(&found).iter().any(is_it), "{from}..{to}: {found}");
    }
}

/// A wrong value in a motion is a difference, even in a single answer and by one count.
#[test]
fn a_wrong_position_on_the_way() {
    let moves = |frame: &Frame| (100..5900).contains(&drive(frame, 2).position);
    let on_the_way: Vec<usize> = reports(&CHIP).into_iter().filter(|at| moves(&CHIP[*at].frame)).collect();
    assert!(on_the_way.len() > 250, "{}", on_the_way.len());
    for at in on_the_way.into_iter().step_by(17) {
        for counts in [1, -1, 7, 1000] {
            let found = changed(|frames| shows(&mut frames[at].frame, 2, |drive| drive.position += counts));
            let is_it = |what: &Deviation| matches!(what, Deviation::Position { slave: 2, .. });
            assert!(what(&found).iter().any(is_it), "{at}, {counts}: {found}");
        }
    }
}

/// A fault in only one run is a difference, even in a single report, at rest and in motion.
#[test]
fn an_alarm_of_one_run() {
    for at in reports(&CHIP).into_iter().skip(60).step_by(11) {
        let found = changed(|frames| {
            shows(&mut frames[at].frame, 1, |drive| {
                (drive.statusword, drive.error_code) = (Statusword(0x0218), 0x7500);
            });
        });
        let is_it = |what: &Deviation| {
            matches!(
                what,
                Deviation::Fault { slave: 1, side: Side::B, error_code: 0x7500 }
                    | Deviation::Statusword { slave: 1, .. }
            )
        };
        assert!(what(&found).iter().any(is_it), "{at}: {found}");
    }
}

/// Whether a moving axis has reached a cycle's target (bit 10) depends on timing: the bit may be set at other points of
/// the motion, and is a difference only if one run never shows it.
#[test]
fn a_bit_of_the_moment() {
    let moves = |frame: &Frame| (100..5900).contains(&drive(frame, 2).position);
    let flicker = |frames: &Frames, odd: i32| {
        let mut frames = frames.clone();
        for at in reports(&frames) {
            let place = drive(&frames[at].frame, 2).position / 20;
            if moves(&frames[at].frame) && place % 2 == odd {
                shows(&mut frames[at].frame, 2, |drive| drive.statusword.0 ^= Statusword::TARGET_REACHED);
            }
        }
        frames
    };
    for other in [&BOARD, &CHIP] {
        let found = with(&CompareOptions::default(), &flicker(&BOARD, 0), &flicker(other, 1));
        assert!(found.is_equal() && found.shifted_answers > 200, "{found}");
        let found = with(&CompareOptions::default(), &flicker(&BOARD, 0), other);
        let is_it = |what: &Deviation| matches!(what, Deviation::Statusword { slave: 2, .. });
        assert!(what(&found).iter().any(is_it), "{found}");
    }
}

/// A command that is answered much later than the others is reported as late, even if it is the only one.
#[test]
fn one_late_command() {
    let allowed =
        |cycles| with(&CompareOptions { latency_cycles: Some(cycles), ..CompareOptions::default() }, &BOARD, &CHIP);
    let latency = allowed(20).latency;
    assert!(allowed(latency.most.unsigned_abs() as u32).is_equal());
    // If the latency is longer by three cycles, no report can be taken for another one.
    let found = allowed((latency.most - 3) as u32);
    let is_it = |what: &Deviation| matches!(what, Deviation::Late { side: Side::B, .. });
    assert!(what(&found).iter().any(is_it), "{found}");
}

/// A state that never comes is a difference: of the network, of a drive, and of inputs.
#[test]
fn a_state_that_never_comes() {
    let found = changed(|frames| {
        for at in reports(frames) {
            let shown = board(&frames[at].frame);
            let state = StateByte::reached(MasterState::SafeOp);
            put(&mut frames[at].frame, 0, MasterResponse { state, ..shown }.encode());
        }
    });
    assert!(matches!(what(&found)[0], Deviation::State { .. }), "{found}");
    let found = changed(|frames| {
        for at in reports(frames) {
            shows(&mut frames[at].frame, 1, |drive| {
                if drive.statusword.is_enabled() {
                    drive.statusword = Statusword(0x0233);
                }
            });
        }
    });
    assert!(matches!(what(&found)[0], Deviation::Statusword { slave: 1, .. }), "{found}");
    let found = changed(|frames| {
        for at in reports(frames) {
            let shown = IoResponse::decode(&frames[at].frame.slot(SIZE, 3));
            put(&mut frames[at].frame, 3, IoResponse { bits: 0, ..shown }.encode());
        }
    });
    assert!(matches!(what(&found)[0], Deviation::Inputs { slave: 3, .. }), "{found}");
}

/// A different or missing answer to an SDO is a difference.
#[test]
fn another_answer_to_an_sdo() {
    let sdo = SIZE.sdo_slot();
    for (raw, is_done) in [(RawSlot::ZERO, false), (RawSlot { data2: 1234, ..RawSlot::ZERO }, true)] {
        let found = changed(|frames| {
            for at in all_reports(frames) {
                let shown = frames[at].frame.slot(SIZE, sdo);
                if let SdoResponse::Done { id: CommandId::SdoRead, .. } = SdoResponse::decode(&shown) {
                    put(&mut frames[at].frame, sdo, if is_done { RawSlot { data2: raw.data2, ..shown } } else { raw });
                }
            }
        });
        let is_it =
            |what: &Deviation| matches!(what, Deviation::Sdo { .. } | Deviation::NoSdoAnswer { side: Side::B, .. });
        assert!(what(&found).iter().any(is_it), "{found}");
    }
}

/// Three pauses in the motion, each longer than the entries in the FIFO last.
const PAUSES: &[(i32, usize)] = &[(60, 14), (150, 11), (220, 30)];

/// The program with pauses.
fn with_pauses(scheme: &'static str) -> Frames {
    frames(&Program { scheme, pauses: PAUSES, ..Program::default() })
}

/// Additional cycles of one run in a motion are gaps of that run, reported as numbers, and no difference: on a board
/// and behind a chip, in either run.
#[test]
fn gaps_are_counted() {
    let (board, chip) = (with_pauses("sim"), with_pauses("xf-sim"));
    let found = with(&CompareOptions::default(), &BOARD, &board);
    assert!(found.is_equal(), "{found}");
    // In the first one the 8 waiting targets are sent; the program does not write more of them afterwards.
    assert_eq!(found.gaps, [Gaps::default(), Gaps { count: 3, cycles: 6 + 11 + 30, longest: 30 }], "{found}");
    assert_eq!((found.latency.least, found.latency.most), (0, 0), "{found}");
    assert!(found.to_string().contains("\nB: 3 gaps of 47 cycles together, the longest 30\n"), "{found}");
    let back = with(&CompareOptions::default(), &board, &BOARD);
    assert!(back.is_equal() && back.gaps == [found.gaps[1], found.gaps[0]], "{back}");
    let found = with(&CompareOptions::default(), &BOARD, &chip);
    assert!(found.is_equal(), "{found}");
    assert_eq!((found.gaps[0].count, found.gaps[1].count), (0, 3), "{found}");
    let found = with(&CompareOptions::default(), &board, &chip);
    assert!(found.is_equal(), "{found}");
}

/// After a gap an axis may differ at most by its motion in that many cycles, and at rest its position equals that of
/// the other run.
#[test]
fn a_gap_hides_nothing() {
    let gapped = with_pauses("xf-sim");
    let moves = |frame: &Frame| (1300..5900).contains(&drive(frame, 2).position);
    let answers = Steps::new(gapped.clone().into_iter(), SIZE, false).filter_map(|step| step.answer);
    let places = answers.filter_map(|answer| gapped.iter().position(|frame| frame.number == answer.frame_number));
    let on_the_way: Vec<usize> = places.filter(|at| moves(&gapped[*at].frame)).collect();
    assert!(on_the_way.len() > 200, "{}", on_the_way.len());
    for at in on_the_way.into_iter().step_by(7) {
        let mut other = gapped.clone();
        shows(&mut other[at].frame, 2, |drive| drive.position += 3000);
        let found = with(&CompareOptions::default(), &BOARD, &other);
        assert!(matches!(what(&found)[0], Deviation::Position { slave: 2, .. }), "{at}: {found}");
    }
    let mut other = gapped;
    for at in reports(&other).into_iter().rev().take(60) {
        shows(&mut other[at].frame, 1, |drive| drive.position -= 1);
    }
    let found = with(&CompareOptions::default(), &BOARD, &other);
    assert!(matches!(what(&found)[0], Deviation::Position { slave: 1, .. }), "{found}");
}

/// A latency longer than allowed is a difference, at its begin; a shorter one is none. With 0 cycles the answers before
/// the next command count.
#[test]
fn a_latency_that_is_too_long() {
    let allowed =
        |cycles| with(&CompareOptions { latency_cycles: Some(cycles), ..CompareOptions::default() }, &BOARD, &CHIP);
    let usual = with(&CompareOptions::default(), &BOARD, &CHIP).latency.usual.unsigned_abs() as u32;
    assert!(allowed(usual).is_equal() && allowed(20).is_equal(), "{}", allowed(usual));
    let found = allowed(usual - 1);
    let is_it = |what: &Deviation| matches!(what, Deviation::Late { side: Side::B, .. });
    assert!(what(&found).iter().any(is_it), "{found}");
    assert!(found.to_string().contains("cycles later from command"), "{found}");
    assert!(!allowed(0).is_equal());
    // Without a latency every answer of the other board must have arrived.
    let run = |pauses| frames(&Program { pauses, ..Program::default() });
    let strict = CompareOptions { latency_cycles: Some(0), ..CompareOptions::default() };
    let found = with(&strict, &BOARD, &run(PAUSES));
    let is_it = |what: &Deviation| matches!(what, Deviation::Position { counts: [590, 602], .. });
    assert!(what(&found).iter().any(is_it), "{found}");
    assert!(with(&strict, &BOARD, &run(&[])).is_equal());
}
