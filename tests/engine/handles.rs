//! What a test or a script can change in a running board.

use ecmsk::engine::{EngineConfig, Event, EventKind, Script};
use ecmsk::fieldbus::Ns;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{FIFO_ENTRIES, MasterCommand, MasterState};

use crate::host::Host;
use crate::probe::drives;

fn board() -> Host {
    let mut host = Host::new(EngineConfig::default(), SimBus::new(drives(1)));
    host.op(1).drained();
    host
}

fn free(host: &Host) -> u16 {
    host.board.engine().fifo_free()
}

/// A muted board makes no reports and otherwise goes on.
#[test]
fn a_muted_board_goes_on() {
    let mut host = board();
    let handle = host.board.handle();
    handle.suppress_reports(true);
    host.cycle();
    let reports = host.reports;
    for _ in 0..3 {
        host.idle();
    }
    assert_eq!(free(&host), FIFO_ENTRIES - 3);
    host.cycles(3);
    assert_eq!((host.reports, free(&host)), (reports, FIFO_ENTRIES));
    handle.suppress_reports(false);
    host.cycles(3);
    assert_eq!(host.reports, reports + 3);
}

/// A held FIFO gives out no entry, so that it fills; it goes on when it is released.
#[test]
fn a_held_fifo_fills() {
    let mut host = board();
    let handle = host.board.handle();
    handle.hold_fifo(true);
    host.cycle();
    let full = host.counters().full;
    for _ in 0..FIFO_ENTRIES + 2 {
        host.idle();
    }
    host.cycles(3);
    assert_eq!((free(&host), host.counters().full), (0, full + 2));
    handle.hold_fifo(false);
    host.cycles(3);
    assert_eq!(free(&host), 3);
}

/// A board counts its cycles from when it was switched on, whatever state it is in; before OP each takes 1 ms.
#[test]
fn cycles_are_counted() {
    let mut host = board();
    let (cycles, now) = (host.board.cycles(), host.board.next_cycle());
    assert_eq!(cycles, now / 1_000_000 - 1, "from boot on");
    host.cycles(25);
    assert_eq!((host.board.cycles(), host.board.next_cycle()), (cycles + 25, now + 25_000_000));
}

/// Cycles that a runner skips are counted in OP, where they have an effect; docs/NIC.md: `cycles_left_out`.
#[test]
fn cycles_that_are_left_out_are_counted() {
    let mut host = board();
    host.go(MasterState::Op).board.leave_out(7);
    assert_eq!(host.cycles(20).counters().cycles_left_out, 7);
    host.go(MasterState::PreOp).board.leave_out(5);
    assert_eq!(host.counters().cycles_left_out, 7);
}

/// SK-8.1 The chip's inputs are six; an input that a test never set keeps its other source.
#[test]
fn inputs_are_set() {
    let mut host = board();
    let handle = host.board.handle();
    let read = |host: &mut Host| {
        host.master(MasterCommand::LocalRead).drained();
        host.answer().result
    };
    host.board.engine_mut().set_local_inputs(0x15);
    assert_eq!(read(&mut host), 0x15);
    for (bits, shown) in [(0x2A, 0x2A), (0xFF, 0x3F), (0, 0)] {
        handle.set_local_inputs(bits);
        host.cycle();
        assert_eq!(read(&mut host), shown, "{bits:02x}");
    }
}

/// Notes one event in the first cycle that it sees.
struct Once(bool);

impl Script for Once {
    fn run(&mut self, at: Ns, note: &mut dyn FnMut(Event)) {
        if !std::mem::replace(&mut self.0, true) {
            note(Event {
                at,
                kind: EventKind::Scripted { line: Some(7), verb: "full", slave: None, code: None, ended: true },
            });
        }
    }

    fn is_over(&self) -> bool {
        self.0
    }
}

/// A script's actions are among the board's events.
#[test]
fn a_script_is_noted() {
    let mut host = board();
    let mark = host.board.engine().events_total();
    host.board.set_script(Some(Box::new(Once(false))));
    let at = host.board.next_cycle();
    host.cycles(3);
    let events: Vec<_> = host.board.engine().events_since(mark).collect();
    assert_eq!(
        events,
        [Event { at, kind: EventKind::Scripted { line: Some(7), verb: "full", slave: None, code: None, ended: true } }]
    );
}
