//! A program on the native API whose slave's inputs become stale, over the bus of a network card.

use std::sync::Arc;
use std::time::Duration;

use ecmsk::ecm::{Close, Config, Ecm, EcmError, Options};
use ecmsk::engine::{Board, EngineConfig};
use ecmsk::ethercat::Command;
use ecmsk::fieldbus::nic::{ChainWires, NicBus};
use ecmsk::fieldbus::sim::SimHandle;
use ecmsk::link::Link;
use ecmsk::link::engine::{EngineLink, RunOptions};
use ecmsk::master::Settings;
use ecmsk::sk::MasterState;
use support::lying_wire::{Answer, Lies, LyingWires};

use crate::probe::drives;

/// The bytes of a drive in CSP: its outputs, and behind them its inputs.
const OUTPUTS: u32 = 6;
const INPUTS: usize = 10;

/// Two drives that are on, at the end of a wire that changes datagrams.
fn enabled() -> (Ecm, Arc<EngineLink>, Lies, SimHandle) {
    let (network, lies) = (SimHandle::default(), Lies::default());
    let wires = ChainWires::new(drives(2), network.clone()).expect("they have an EEPROM");
    let bus = NicBus::new(LyingWires::new(wires, lies.clone()), Settings::default());
    let mut board = Board::new(EngineConfig::default(), Box::new(bus));
    assert!(board.boot(60_000_000_000));
    let link = Arc::new(EngineLink::open("nic", board, RunOptions::default(), None).expect("it talks"));
    let ecm = Ecm::over(Arc::clone(&link) as Arc<dyn Link>, Options::default()).expect("it reports");
    ecm.configure(&Config::drives(2)).expect("they are there");
    ecm.set_state(MasterState::Op).expect("it comes up");
    ecm.servo_on(&[1, 2]).expect("they are well");
    (ecm, link, lies, network)
}

/// The inputs of slave 2 do not arrive any more.
fn mute(lies: &Lies) {
    lies.tell(|answer: &mut Answer<'_>| {
        // In a datagram without this slave its inputs cannot be missing.
        if answer.command != Command::Lrw || answer.counter > 3 {
            answer.silence(2 * OUTPUTS + INPUTS as u32, INPUTS);
        }
    });
}

fn is_of_two(error: &EcmError) -> bool {
    matches!(error, EcmError::SlaveLost { slave: Some(2), found } if found.is_failed())
}

/// A stream refuses the targets of the slave by name and goes on with the other one. The slave's axis brakes on its
/// quick-stop ramp, no further than the targets that were accepted, and it is counted.
#[test]
fn a_stream_refuses_the_targets_of_a_slave_with_stale_inputs() {
    let (ecm, link, lies, network) = enabled();
    let mut stream = ecm.stream(8).expect("it is in OP");
    let (mut refused, mut last) = (None, [0; 2]);
    for n in 1..=600 {
        if n == 300 {
            mute(&lies);
        }
        stream.csp(1, n * 10).expect("slave 1 is well");
        last[0] = n * 10;
        match stream.csp(2, n * 10) {
            Ok(()) => last[1] = n * 10,
            Err(error) => {
                refused.get_or_insert(error);
            }
        }
        stream.step().expect("the board reports");
    }
    assert!(is_of_two(refused.as_ref().expect("its targets are refused")), "{refused:?}");
    stream.finish().expect("the other axis");
    link.pass(Duration::from_secs(1)).expect("it is there");
    let [first, second] = [1, 2].map(|slave| network.shaft(slave, 0).expect("a shaft"));
    assert!((first - i64::from(last[0])).abs() <= 60, "{first} {last:?}");
    assert!((3000..=i64::from(last[1]) + 60).contains(&second), "{second} {last:?}");
    link.pass(Duration::from_secs(1)).expect("it is there");
    assert_eq!(network.shaft(2, 0), Some(second), "it stands");
    let counters = link.stats().board.expect("a model");
    assert!(counters.inputs_held >= 19 && counters.inputs_stale == 1, "{counters:?}");
    assert!(is_of_two(&ecm.servo_on(&[2]).expect_err("it is lost")));
    assert!(is_of_two(&ecm.close(Close::ServoOff).expect_err("it is lost")));
}
