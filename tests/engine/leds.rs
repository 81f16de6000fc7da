//! LEDs, BUSY and the other visible signals of a board.

use MasterState::{Init, Op, PreOp, SafeOp};
use ecmsk::engine::{Board, EngineConfig, Leds};
use ecmsk::fieldbus::Fieldbus;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::link::engine::{EngineLink, RunOptions};
use ecmsk::link::{Link, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterState, SlaveKind, StateByte};
use ecmsk::slave::{AlStatus, Io, Slave};

use crate::host::BOOT_LIMIT;
use crate::network_rig::{Net, set, two_buses};
use crate::probe::drives;
use support::ahead_bus::{Ahead, AheadBus};

const OFF_OFF: (bool, bool) = (false, false);
const ON_OFF: (bool, bool) = (true, false);
const OFF_ON: (bool, bool) = (false, true);
const ON_ON: (bool, bool) = (true, true);

fn leds(net: &Net) -> (bool, bool) {
    let Leds { yellow, green } = net.host.board.engine().leds();
    assert_eq!(net.host.board.snapshot().leds, Leds { yellow, green });
    (yellow, green)
}

/// SK-11.1 Yellow and green in every state; SK-11.2 as values of the model.
#[test]
fn the_leds_of_every_state() {
    for how in two_buses() {
        let mut net = Net::new(how, 2);
        for (state, expected) in [(PreOp, OFF_OFF), (Init, OFF_OFF), (PreOp, OFF_OFF), (SafeOp, ON_OFF), (Op, OFF_ON)] {
            net.host.go(state);
            assert_eq!(leds(&net), expected, "{state}");
        }
        // A slave is not in the expected state.
        net.network.lose(2);
        net.until_state(0x18);
        assert_eq!((leds(&net), net.host.board.snapshot().lost), (ON_ON, set(&[2])));
        net.network.find(2);
        net.ask(Op, StateByte(8));
        assert_eq!(leds(&net), OFF_ON);
        net.host.go(SafeOp);
        net.network.refuse(1, Some((ecmsk::fieldbus::AlState::Op, AlStatus(0x0011))));
        net.ask(Op, StateByte(0x14));
        assert_eq!(leds(&net), ON_ON);
    }
}

/// SK-11.1 Without a slave the start never ends. SK-4.68 SK-10.5 BUSY is high while the board starts up, after
/// SW_RESET, too.
#[test]
fn a_board_that_starts() {
    let bus = SimBus::new(drives(1));
    let network = bus.handle();
    network.cut_after(0);
    let mut board = Board::new(EngineConfig::default(), Box::new(bus));
    assert!(board.busy() && board.snapshot().busy);
    assert!(!board.boot(3_000_000_000));
    assert_eq!((board.busy(), board.engine().leds()), (true, Leds { yellow: true, green: true }));
    network.heal();
    while board.busy() {
        assert!(!board.engine().talks());
        board.cycle(&mut |_, _| {});
        assert!(board.now() < BOOT_LIMIT);
    }
    assert_eq!((board.engine().state(), board.snapshot().busy), (StateByte::reached(PreOp), false));
    let mut reset = Frame::new();
    reset.put_master(ecmsk::sk::SlotSize::Bytes12, &MasterCommand::SoftReset);
    board.host(&reset, board.now(), &mut |_, _| {});
    assert!(board.busy());
}

/// SK-11.3 The power LED is on as long as there is a board. SK-11.4 Link and traffic as long as the cable to the first
/// slave is whole.
#[test]
fn power_link_and_traffic() {
    for how in two_buses() {
        let mut net = Net::on(how, 2);
        let seen = |net: &Net| {
            let snapshot = net.host.board.snapshot();
            assert!(snapshot.power);
            (snapshot.link, snapshot.traffic)
        };
        for _ in 0..50 {
            net.stream(1);
            assert_eq!(seen(&net), (true, true), "{how:?}");
        }
        net.network.cut_after(1);
        net.host.cycles(20);
        assert_eq!(seen(&net), (true, true), "{how:?}: the first slave is there");
        net.network.cut_after(0);
        // A bus that owns its cycle may have no cycle within one of the host's, by its phase.
        net.host.cycles(if how.is_none() { 1 } else { 5 });
        assert_eq!(seen(&net), (false, false), "{how:?}");
        net.network.heal();
        net.host.cycles(20);
        assert_eq!(seen(&net), (true, true), "{how:?}");
    }
}

/// SK-11.5 The clock that the others follow is the first slave's that has distributed clocks.
#[test]
fn the_reference_clock() {
    let clock = |ios: usize, n: usize| {
        let mut slaves: Vec<Box<dyn Slave>> = (0..ios).map(|_| Box::<Io>::default() as Box<dyn Slave>).collect();
        slaves.extend(drives(n));
        let mut board = Board::new(EngineConfig::default(), Box::new(SimBus::new(slaves)));
        assert_eq!(board.snapshot().reference_clock, None, "nobody was found yet");
        board.boot(BOOT_LIMIT);
        assert_eq!(usize::from(board.snapshot().slaves_found), ios + n);
        board.snapshot().reference_clock
    };
    assert_eq!([clock(0, 2), clock(1, 1), clock(3, 2), clock(2, 0)], [Some(1), Some(2), Some(4), None]);
    let how = Ahead::kind(4, 1, 1, 0);
    assert_eq!(AheadBus::new(SimBus::new(drives(1)), how).reference_clock(), None, "a bus that does not say");
}

/// SK-11.2 A link to a board in this process shows them, on virtual and on real time.
#[test]
fn a_link_shows_the_leds() {
    for virtual_time in [true, false] {
        let mut board = Board::new(EngineConfig::default(), Box::new(SimBus::new(drives(1))));
        assert!(board.boot(BOOT_LIMIT));
        let options = RunOptions { virtual_time, ..RunOptions::default() };
        let link = EngineLink::open("board", board, options, None).unwrap();
        let mut frame = Frame::new();
        let size = ecmsk::sk::SlotSize::Bytes12;
        frame.put_master(size, &MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Drive; 8] });
        link.write(&frame, Wait::Forever).unwrap();
        frame.put_master(size, &MasterCommand::SetState(SafeOp));
        link.write(&frame, Wait::Forever).unwrap();
        let mut report = Frame::new();
        for _ in 0..20_000 {
            if link.snapshot().unwrap().state == StateByte::reached(SafeOp) {
                break;
            }
            link.read(&mut report, Wait::Forever).unwrap();
        }
        let snapshot = link.snapshot().unwrap();
        assert_eq!((snapshot.leds, snapshot.busy), (Leds { yellow: true, green: false }, false));
    }
}
