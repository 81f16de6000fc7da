//! Stopping the axes of a network that another program has left running (`Ecm::stop`).

use crate::common::{SECOND, cycles, enable, open};
use ecmsk::ecm::{Axis, Close, Config, Ecm, Homing, HomingPhase, Options, Slave, SlaveView};
use ecmsk::link::{self, Share};
use ecmsk::sk::{AxisTarget, HspResponse, MasterState};

fn config(axis: Axis) -> Config {
    Config { slaves: vec![Slave::Drive(axis); 2], ..Config::default() }
}

/// The counts that axis 1 moves in 100 cycles.
fn moves(ecm: &Ecm) -> i32 {
    let from = ecm.next_cycle(SECOND).unwrap().position(1).unwrap();
    cycles(ecm, 100);
    ecm.snapshot().unwrap().position(1).unwrap() - from
}

/// Whether axis 1 is at rest 50 ms after the end of the brake (docs/SAFETY.md).
fn rests(ecm: &Ecm) -> bool {
    cycles(ecm, 50);
    moves(ecm).abs() <= 2
}

fn is_on(ecm: &Ecm) -> bool {
    ecm.snapshot().unwrap().drive(1).unwrap().statusword.is_enabled()
}

/// A program that moves axis 1 in this mode and leaves it moving. Another one opens the board.
fn left(name: &str, axis: Axis, command: impl Fn(&mut ecmsk::ecm::Stream<'_>, i32)) -> Ecm {
    let keys = format!("slaves=drive*2&name=stop-{name}");
    let ecm = enable(open(&keys), &config(axis));
    let mut stream = ecm.stream(16).unwrap();
    for n in 0..400 {
        command(&mut stream, n);
        stream.step().unwrap();
    }
    std::mem::forget(stream);
    ecm.close(Close::Leave).unwrap();
    open(&keys)
}

/// A velocity ends, though the configuration says another mode than the reports; the axis stays on, or is switched off.
#[test]
fn a_velocity_that_a_program_has_left_is_stopped() {
    for (off, said) in [(false, Axis::CSV), (false, Axis::CSP), (true, Axis::CSP)] {
        let name = format!("csv-{off}-{}", said.mode);
        let ecm = left(&name, Axis::CSV, |stream, _| stream.csv(1, 50_000).unwrap());
        ecm.adopt(&config(said)).unwrap();
        assert!(moves(&ecm) > 4000, "it moves");
        let began = ecm.snapshot().unwrap().meta.at.0;
        assert!(ecm.stop(&config(said), off).unwrap());
        let took = ecm.snapshot().unwrap().meta.at.0 - began;
        assert!(took <= 2_030_000_000, "docs/SAFETY.md: 2 s and some cycles, {took} ns");
        assert!(rests(&ecm));
        assert_eq!(is_on(&ecm), !off);
    }
}

/// In CSP the axis holds the last target.
#[test]
fn an_axis_in_csp_holds_its_last_target() {
    let ecm = left("csp", Axis::CSP, |stream, n| stream.csp(1, n * 50).unwrap());
    assert!(ecm.stop(&config(Axis::CSP), false).unwrap());
    let position = ecm.snapshot().unwrap().position(1).unwrap();
    assert!((position - 399 * 50).abs() < 20, "{position}: the last target");
    assert!(rests(&ecm) && is_on(&ecm));
}

/// What waits behind a threshold moves no axis any more, and the threshold is reset.
#[test]
fn what_waits_behind_a_threshold_is_dropped() {
    let keys = "slaves=drive*2&name=stop-threshold";
    let ecm = enable(open(keys), &config(Axis::CSP));
    let mut stream = ecm.stream(16).unwrap();
    stream.prefill(10).unwrap();
    for n in 0..5 {
        stream.csp(1, n * 1000).unwrap();
        stream.step().unwrap();
    }
    std::mem::forget(stream);
    ecm.close(Close::Leave).unwrap();
    let ecm = open(keys);
    assert!(ecm.snapshot().unwrap().board.fifo_free < ecmsk::sk::FIFO_ENTRIES, "they wait");
    assert!(ecm.stop(&config(Axis::CSP), false).unwrap());
    assert!(rests(&ecm));
    assert_eq!(ecm.snapshot().unwrap().board.fifo_free, ecmsk::sk::FIFO_ENTRIES);
}

/// Homing is aborted.
#[test]
fn homing_that_a_program_has_left_is_aborted() {
    let keys = "slaves=drive*2&name=stop-homing";
    let link = link::open(&crate::common::uri(keys), Share::ByName).unwrap();
    let ecm = enable(Ecm::over(link.clone(), Options::default()).unwrap(), &config(Axis::CSP));
    let mut moving = 0;
    let homing = Homing { offset: Some(0), ..Homing::method(17) };
    let ended = ecm.home(1, &homing, |progress| {
        moving += u32::from(progress.phase == HomingPhase::Moving);
        if moving == 20 {
            link.close();
        }
    });
    assert!(ended.is_err());
    drop((ecm, link));
    let ecm = open(keys);
    ecm.adopt(&config(Axis::CSP)).unwrap();
    assert!(moves(&ecm).abs() > 100, "it still looks for its home");
    assert!(ecm.stop(&config(Axis::CSP), false).unwrap());
    assert!(rests(&ecm) && is_on(&ecm));
}

/// Below OP no axis follows commands, and nothing is sent.
#[test]
fn below_op_there_is_nothing_to_stop() {
    let ecm = open("slaves=drive*2&name=stop-below");
    assert!(!ecm.stop(&config(Axis::CSP), true).unwrap());
    ecm.configure(&config(Axis::CSP)).unwrap();
    ecm.set_state(MasterState::SafeOp).unwrap();
    let written = ecm.stats().unwrap().written;
    assert!(!ecm.stop(&config(Axis::CSP), true).unwrap());
    assert_eq!(ecm.stats().unwrap().written, written);
    assert!(ecm.stop(&Config::default(), false).is_err());
}

/// The digital outputs of pulse modules are not known. One that stands keeps them; one that moves, however slowly, is
/// stopped.
#[test]
fn a_pulse_module_that_stands_keeps_its_outputs() {
    for mode in [Axis::CSV, Axis::CSP] {
        let config = Config { slaves: vec![Slave::Hsp(mode); 2], ..Config::default() };
        let keys = format!("slaves=hsp*2&name=stop-outputs-{}", mode.mode);
        let ecm = enable(open(&keys), &config);
        let mut stream = ecm.stream(16).unwrap();
        let at = |target, outputs| AxisTarget { target, outputs };
        for n in 0..100 {
            if mode == Axis::CSV {
                stream.csv_hsp(1, at(0, 5), at(0, 0)).unwrap();
                stream.csv_hsp(2, at(500, 6), at(0, 0)).unwrap();
            } else {
                stream.csp_hsp(1, at(0, 5), at(0, 0)).unwrap();
                stream.csp_hsp(2, at(n, 6), at(0, 0)).unwrap();
            }
            stream.step().unwrap();
        }
        std::mem::forget(stream);
        ecm.close(Close::Leave).unwrap();
        let ecm = open(&keys);
        assert!(ecm.stop(&config, false).unwrap());
        let seen = || -> [HspResponse; 2] {
            let seen = ecm.next_cycle(SECOND).unwrap();
            [1, 2].map(|slave| match seen.slave(slave) {
                Some(SlaveView::Hsp(hsp)) => hsp,
                other => panic!("{other:?}"),
            })
        };
        let first = seen();
        cycles(&ecm, 100);
        let last = seen();
        // Inputs are wired to outputs.
        assert_eq!(last[0].first.inputs, 5, "{mode:?}: {last:?}");
        assert_eq!([0, 1].map(|n| last[n].first.position - first[n].first.position), [0; 2], "{mode:?}");
    }
}
