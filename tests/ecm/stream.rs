//! The native API's stream: credit, underruns, guard, no allocation, several threads.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::common::{SIZE, Tap, cycles, enable, enabled, follow, open, script, steps};
use ecmsk::cia402::Mode;
use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Axis, Config, Ecm, EcmError, Guard, News, Options, Scale, Slave};
use ecmsk::link::{self, Link, LinkError, Share, Wait};
use ecmsk::sk::{AxisTarget, CommandId, Frame, MasterCommand, MasterState};

/// SK-5.11 At least one CSP frame a cycle, several at first, paused when `depth` frames are ahead: the axis follows
/// without a gap and nothing is lost.
#[test]
fn a_stream_keeps_its_depth_and_the_axis_follows() {
    for keys in ["slaves=drive*2", "slaves=drive*2&fw=1.5", "slaves=drive*2&slot=16", "slaves=drive*2&host_us=0"] {
        let (tap, ecm) = Tap::enabled(keys, &Config::drives(2));
        let start = ecm.snapshot().unwrap().position(1).unwrap();
        let mut stream = ecm.stream(20).unwrap();
        for n in 0..500 {
            stream.csp(1, start + n * 20).unwrap();
            stream.step().unwrap();
            let ahead = 160 - stream.snapshot().unwrap().board.fifo_free;
            assert!(ahead <= 20, "{keys}: {ahead} entries");
            assert!(n < 40 || ahead >= 17, "{keys}: it is ahead, {ahead} entries at {n}");
        }
        let stats = stream.finish().unwrap();
        assert_eq!((stats.frames, stats.underruns, stats.losses), (500, 0, 0), "{keys}");
        let board = tap.stats().board.unwrap();
        assert_eq!((board.full, board.rejected_total(), board.discarded_before_enabled), (0, 0, 0), "{keys}");
        let end = ecm.snapshot().unwrap().position(1).unwrap();
        assert!((end - start - 499 * 20).abs() < 3000 && end > start + 499 * 20, "{keys}: the ramp goes on to {end}");
    }
}

/// SK-5.4 A program that is late makes underruns, each cycle without an entry is counted, and no other is.
#[test]
fn underruns_are_the_cycles_without_an_entry() {
    let (tap, ecm) = Tap::enabled("slaves=drive&queue=64", &Config::drives(1));
    let mut stream = ecm.stream(10).unwrap();
    let at = stream.snapshot().unwrap().position(1).unwrap();
    for _ in 0..100 {
        stream.csp(1, at).unwrap();
        stream.step().unwrap();
    }
    // 9 or 10 entries are ahead and 30 cycles pass.
    let before = stream.stats().unwrap();
    let entries = u64::from(160 - stream.snapshot().unwrap().board.fifo_free);
    tap.pass(Duration::from_millis(30)).unwrap();
    for _ in 0..50 {
        stream.step().unwrap();
        let now = tap.pass(Duration::ZERO).unwrap().unwrap().0;
        assert!(now - stream.snapshot().unwrap().meta.at.0 <= 2_000_000, "the newest report counts");
    }
    let gaps = stream.stats().unwrap().underruns - before.underruns;
    assert!(gaps.abs_diff(30 - entries) <= 1, "{gaps} gaps, {entries} entries were there");
    assert_eq!(before.underruns, 0);
    // The stream is as far ahead again: old reports in the queue did not mislead it.
    assert!(stream.snapshot().unwrap().board.fifo_free <= 153, "{:?}", stream.snapshot().unwrap().board);
}

/// SK-5.11 A board that takes nothing out makes the stream wait, with a limit; it never overfills.
#[test]
fn a_full_board_is_waited_for_and_never_overfilled() {
    let file = script("full", "at 1s full for 500ms\nat 3s full\n");
    let (tap, ecm) = Tap::enabled(&format!("slaves=drive&script={file}"), &Config::drives(1));
    let mut stream = ecm.stream(150).unwrap();
    let at = stream.snapshot().unwrap().position(1).unwrap();
    let mut steps = 0;
    let error = loop {
        stream.csp(1, at).unwrap();
        match stream.step() {
            Ok(_) => steps += 1,
            Err(error) => break error,
        }
    };
    assert!(steps > 2000, "{steps}");
    assert!(matches!(error, EcmError::Timeout { what: "room in the FIFO", .. }), "{error}");
    assert_eq!(stream.stats().unwrap().losses, 0);
    drop(stream);
    assert_eq!(tap.stats().board.unwrap().full, 0);
}

/// SK-5.10 Any increase of the full count is a loss, by 1 or by 126, also over the wrap; the raw increase is reported.
#[test]
fn any_increase_of_the_full_count_is_a_loss() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &Config::drives(1));
    ecm.take_news().unwrap();
    let counts = [0_u16, 1, 1, 127, 65_500, 3, 3];
    tap.bend_slot(0, move |n, slot| {
        let count = counts[(n as usize).min(counts.len() - 1)];
        slot.data2 = slot.data2 & 0xFFFF | u32::from(count) << 16;
    });
    let before = ecm.stats().unwrap().losses;
    cycles(&ecm, 8);
    assert_eq!(ecm.stats().unwrap().losses - before, 4);
    let lost: Vec<_> =
        ecm.take_news().unwrap().into_iter().filter(|news| matches!(news, News::CommandsLost { .. })).collect();
    let lost_at = |from, to| News::CommandsLost { from, to };
    assert_eq!(lost, [lost_at(0, 1), lost_at(1, 127), lost_at(127, 65_500), lost_at(65_500, 3)]);
}

/// SK-5.10 A full count that rises because another program writes during the stream counts as a loss of the stream.
#[test]
fn losses_show_in_the_stream() {
    let (tap, ecm) = Tap::enabled("slaves=drive&fw=1.5", &Config::drives(1));
    let mut stream = ecm.stream(4).unwrap();
    stream.step().unwrap();
    // Eight frames a cycle: the FIFO fills and overflows.
    for _ in 0..300 {
        tap.write(&Frame::new(), Wait::Now).unwrap();
    }
    steps(&mut stream, 3);
    let board = tap.stats().board.unwrap();
    assert!(board.full > 0, "{board:?}");
    assert!(stream.stats().unwrap().losses > 0);
}

/// API-3 The guard refuses a target that is too far from the actual position, and no part of it reaches the board.
#[test]
fn the_guard_refuses_what_is_too_far() {
    let axis = Axis { guard: Guard::Within(500), ..Axis::CSP };
    let off = Axis { guard: Guard::Off, ..Axis::CSP };
    let config = Config { slaves: vec![Slave::Drive(axis), Slave::Drive(off)], ..Config::default() };
    let (tap, ecm) = Tap::enabled("slaves=drive*2", &config);
    let mut stream = ecm.stream(4).unwrap();
    let at = stream.snapshot().unwrap().position(1).unwrap();
    stream.csp(1, at.wrapping_add(500)).unwrap();
    stream.csp(1, at.wrapping_sub(500)).unwrap();
    for target in [at.wrapping_add(501), at.wrapping_sub(501), at.wrapping_add(i32::MIN)] {
        assert_eq!(stream.csp(1, target), Err(EcmError::TooFar { slave: 1, target, actual: at, limit: 500 }));
    }
    stream.csp(2, 1_000_000).unwrap();
    tap.take();
    stream.step().unwrap();
    let frame = tap.take().remove(0);
    assert_eq!(frame.slot(SIZE, 1).data1 as i32, at.wrapping_sub(500), "the last target that was let pass");
    drop(stream);
    drop(ecm);

    let ecm = Ecm::over(Tap::open("slaves=drive"), Options { guard: false, ..Options::default() }).unwrap();
    let ecm = enable(ecm, &Config { slaves: vec![Slave::Drive(axis)], ..Config::default() });
    ecm.stream(4).unwrap().csp(1, 9_999).unwrap();
}

/// Units: 90 degrees of a 17-bit encoder are 32768 counts.
#[test]
fn a_target_in_units_is_converted_to_counts() {
    let axis = Axis { scale: Scale::per_unit(131_072.0 / 360.0), ..Axis::CSP };
    let config = Config { slaves: vec![Slave::Drive(axis)], ..Config::default() };
    let (tap, ecm) = Tap::enabled("slaves=drive", &config);
    let mut stream = ecm.stream(4).unwrap();
    tap.take();
    stream.csp_units(1, 90.0).unwrap();
    stream.step().unwrap();
    assert_eq!(tap.take()[0].slot(SIZE, 1).data1, 32_768);
    assert_eq!(stream.csp_units(1, 1e9), Err(EcmError::OutOfRange { slave: 1, units: 1e9 }));
    assert!(matches!(stream.csp_units(1, f64::NAN), Err(EcmError::OutOfRange { .. })));
}

/// API-23 SK-7.31 SK-7.33 An impossible target is refused before it is sent, with the reason.
#[test]
fn targets_that_make_no_sense_are_refused() {
    let slaves = vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSV), Slave::Io, Slave::Drive(Axis::CST)];
    let config = Config { slaves, ..Config::default() };
    let ecm = open("slaves=drive*2,io,drive");
    assert!(matches!(ecm.stream(4).map(|_| ()), Err(EcmError::WrongState { .. })));
    crate::common::in_op(&ecm, &config);
    ecm.servo_on(&[1, 2]).unwrap();
    assert!(matches!(ecm.stream(0).map(|_| ()), Err(EcmError::Setting { .. })));
    assert!(matches!(ecm.stream(151).map(|_| ()), Err(EcmError::Setting { .. })));
    let mut stream = ecm.stream(4).unwrap();
    assert!(matches!(ecm.stream(4).map(|_| ()), Err(EcmError::Busy { .. })));
    let wrong = |mode, wanted, slave| Err(EcmError::WrongMode { slave, mode, wanted });
    assert_eq!(stream.csv(1, 5), wrong(Mode::Csp, Mode::Csv, 1));
    assert_eq!(stream.csp(2, 5), wrong(Mode::Csv, Mode::Csp, 2));
    assert_eq!(stream.cst(2, 5), wrong(Mode::Csv, Mode::Cst, 2));
    assert!(matches!(stream.csp(3, 5), Err(EcmError::WrongKind { slave: 3, .. })));
    assert!(matches!(stream.cst(4, 5), Err(EcmError::NotEnabled { slave: 4, .. })));
    for slave in [0, 5, 40, 255] {
        assert_eq!(stream.csp(slave, 5), Err(EcmError::NoSuchSlave { slave, declared: 4 }));
    }
}

/// API-14 An axis that got an alarm is refused further targets, the others go on; on again it gets no old target.
#[test]
fn an_alarm_of_one_axis_stops_that_one_alone() {
    let file = script("stream-alarm", "at 1s alarm 1 0x7500\n");
    let (tap, ecm) = Tap::enabled(&format!("slaves=drive*2&script={file}"), &Config::drives(2));
    let mut stream = ecm.stream(8).unwrap();
    let mut refused = None;
    for n in 0..2000 {
        stream.csp(2, n * 10).unwrap();
        if let Err(error) = stream.csp(1, n * 10) {
            refused.get_or_insert(error);
        }
        stream.step().unwrap();
    }
    assert_eq!(refused, Some(EcmError::Alarm { slave: 1, code: 0x7500 }));
    assert!(stream.snapshot().unwrap().position(2).unwrap() > 19_000);
    assert!(tap.take().last().unwrap().slot(SIZE, 1).is_zero(), "no target for an axis that is off");
}

/// SK-1.22 Every frame that is written carries its CRC: a board that checks them (SET_EX, SW_RESET) takes them all.
#[test]
fn every_frame_carries_its_crc() {
    let keys = "slaves=drive,io&name=checking";
    let link = link::open(&crate::common::uri(keys), Share::ByName).unwrap();
    for command in [MasterCommand::SetEx { check_commands: true, fill_responses: true }, MasterCommand::SoftReset] {
        let mut frame = Frame::new();
        frame.put_master(SIZE, &command);
        link.write(&frame, Wait::Now).unwrap();
    }
    drop(link);
    let tap = loop {
        match link::open(&crate::common::uri(keys), Share::ByName) {
            Ok(link) => break Tap::around(link),
            Err(LinkError::NoBoard { .. }) => {}
            Err(other) => panic!("{other}"),
        }
    };
    let config = Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Io], ..Config::default() };
    let ecm = enable(tap.ecm(Options::default()).unwrap(), &config);
    ecm.sdo_read::<u32>(1, ObjectAddress::new(0x1000, 0)).unwrap();
    ecm.set_outputs(2, 0x55).unwrap();
    let mut stream = ecm.stream(4).unwrap();
    follow(&mut stream, 1, 0, 10, 50);
    drop(stream);
    let frames = tap.take();
    assert!(frames.len() > 60);
    assert!(frames.iter().all(|frame| frame.crc_byte() == frame.crc(SIZE)));
    assert_eq!(tap.stats().board.unwrap().crc, 0);
    // The board does check.
    tap.write(&Frame::new(), Wait::Now).unwrap();
    assert_eq!(tap.stats().board.unwrap().crc, 1);
}

/// A stream of 40 axes allocates nothing: targets, steps, and reading the axes.
#[test]
fn a_stream_allocates_nothing() {
    let ecm = enabled("slaves=drive*40", &Config::drives(40));
    let mut stream = ecm.stream(16).unwrap();
    let mut run = |from: i32| {
        for n in from..from + 300 {
            (1..=40).for_each(|slave| stream.csp(slave, n * i32::from(slave)).unwrap());
            stream.step().unwrap();
            assert!(stream.snapshot().unwrap().drive(40).is_some());
        }
    };
    run(0);
    let counted = allocation_counter::measure(|| run(300));
    assert_eq!((counted.count_total, counted.count_current), (0, 0), "{counted:?}");
    assert!(stream.snapshot().unwrap().position(40).unwrap() > 20_000);
}

/// API-15 SK-5.2 Commands of other threads share the stream's frames: none of them takes a cycle from the motion.
#[test]
fn other_threads_ride_along() {
    let config = Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Io], ..Config::default() };
    let (tap, ecm) = Tap::enabled("slaves=drive,io", &config);
    let mut stream = ecm.stream(16).unwrap();
    stream.csp(1, 0).unwrap();
    stream.step().unwrap();
    tap.take();
    let over = AtomicBool::new(false);
    let steps = std::thread::scope(|scope| {
        let others = scope.spawn(|| {
            for bits in 1..20 {
                ecm.set_outputs(2, bits).unwrap();
                let limit: u32 = ecm.sdo_read(1, ObjectAddress::new(0x6065, 0)).unwrap();
                assert!(limit > 0);
                ecm.local_inputs().unwrap();
            }
            over.store(true, Ordering::Release);
        });
        let mut steps = 0;
        while !over.load(Ordering::Acquire) && !others.is_finished() {
            stream.csp(1, 10 * (steps % 1000)).unwrap();
            stream.step().unwrap();
            steps += 1;
            if steps % 64 == 0 {
                std::thread::yield_now();
            }
        }
        others.join().unwrap();
        steps
    });
    let frames = tap.take();
    let csp = CommandId::Csp.code();
    assert!(frames.iter().all(|frame| frame.slot(SIZE, 1).id == csp), "each frame has the axis's target");
    // 57 commands; a few may go alone while the stream's thread gets no time.
    let alone = frames.len() - steps as usize;
    assert!(alone < 30, "{alone} frames beside the stream's {steps}");
    assert_eq!(tap.stats().board.unwrap().rejected_total(), 0);
}

/// SK-9.12 Reports that stop end the stream's wait with an error.
#[test]
fn a_cut_cable_ends_the_wait() {
    let file = script("cut", "at 1s cut 1\n");
    let ecm = enabled(&format!("slaves=drive&script={file}"), &Config::drives(1));
    let mut stream = ecm.stream(8).unwrap();
    let error = loop {
        match stream.step() {
            Ok(_) => {}
            Err(error) => break error,
        }
    };
    assert!(matches!(error, EcmError::NoReport { network_down: true, .. }), "{error}");
    let said = error.to_string();
    assert!(said.contains("nothing comes back from the network: look at the cable to the first slave"), "{said}");
    // A board that is silent although its network answers.
    let file = script("silent", "at 1s silent\n");
    let ecm = enabled(&format!("slaves=drive&script={file}"), &Config::drives(1));
    let error = (0..2000).find_map(|_| ecm.next_cycle(Duration::from_secs(1)).err()).expect("it ends");
    assert!(matches!(error, EcmError::NoReport { network_down: false, .. }), "{error}");
    assert!(error.to_string().ends_with("check the cable to the first slave and the board's power"), "{error}");
}

/// SK-5.25 A stream ends with an error when the network leaves OP.
#[test]
fn leaving_op_ends_the_stream() {
    let ecm = enabled("slaves=drive", &Config::drives(1));
    let mut stream = ecm.stream(8).unwrap();
    stream.step().unwrap();
    ecm.set_state(MasterState::PreOp).unwrap();
    assert!(matches!(stream.step(), Err(EcmError::WrongState { .. })));
}

/// API-3 SK-3.23 An HSP of two channels takes both targets and outputs, and the guard checks both.
#[test]
fn a_stream_moves_both_channels_of_an_hsp() {
    let axis = Axis { guard: Guard::Within(1000), ..Axis::CSP };
    let config = Config { slaves: vec![Slave::Hsp(axis)], ..Config::default() };
    let ecm = enabled("slaves=hsp2&slot=16", &config);
    let mut stream = ecm.stream(8).unwrap();
    let to = |target, outputs| AxisTarget { target, outputs };
    let far = stream.csp_hsp(1, to(10, 0), to(1001, 0));
    assert!(matches!(far, Err(EcmError::TooFar { target: 1001, .. })), "{far:?}");
    stream.csp_hsp(1, to(100, 1), to(-200, 2)).unwrap();
    steps(&mut stream, 500);
    let Some(ecmsk::ecm::SlaveView::Hsp(hsp)) = stream.snapshot().unwrap().slave(1) else { panic!("an HSP") };
    assert_eq!((hsp.first.position, hsp.second.position), (100, -200));
}
