//! The native API with DP3CL drives.

use crate::common::{Tap, config, open};
use ecmsk::ecm::{Axis, Config, Homing, Slave};
use ecmsk::link::Link;
use ecmsk::sk::MasterState;

/// DP3CL-10.1 As a stepper and as a drive: it moves to its targets, homes with a switch, and moves on from there.
#[test]
fn it_moves_and_homes() {
    for slave in [Slave::Step(Axis::CSP), Slave::Drive(Axis::CSP)] {
        for keys in ["slaves=dp3cl:start@20000", "slaves=dp3cl:start@20000&slot=16"] {
            let (tap, ecm) = Tap::enabled(keys, &config(vec![slave]));
            assert_eq!(ecm.snapshot().unwrap().position(1), Some(0), "0x6064 is 0 at power-on");
            let mut stream = ecm.stream(8).unwrap();
            for n in 1..=550 {
                stream.csp(1, n.min(500) * 20).unwrap();
                stream.step().unwrap();
            }
            stream.finish().unwrap();
            assert_eq!(ecm.snapshot().unwrap().position(1), Some(10_000), "{keys}");
            ecm.home(1, &Homing { offset: Some(500), ..Homing::method(21) }, |_| {}).unwrap();
            let beyond = ecm.snapshot().unwrap().position(1).unwrap();
            assert!((500..700).contains(&beyond), "{keys}: {beyond}");
            let mut stream = ecm.stream(8).unwrap();
            for n in 0..=150 {
                stream.csp(1, beyond + n.min(100) * 10).unwrap();
                stream.step().unwrap();
            }
            stream.finish().unwrap();
            assert_eq!(ecm.snapshot().unwrap().position(1), Some(beyond + 1000), "{keys}");
            assert_eq!(tap.stats().board.unwrap().rejected_total(), 0, "{keys}");
        }
    }
}

/// DP3CL-10.2 A cycle that the drive does not have.
#[test]
fn cycles() {
    for (cycle_us, answer) in [(500, Ok(())), (1000, Ok(())), (2000, Ok(())), (4000, Ok(())), (250, Err(()))] {
        let ecm = open("slaves=io,dp3cl");
        let config = Config { cycle_us, ..config(vec![Slave::Io, Slave::Step(Axis::CSP)]) };
        ecm.configure(&config).unwrap();
        let reached = ecm.set_state(MasterState::Op);
        assert_eq!(reached.is_ok(), answer.is_ok(), "{cycle_us}: {reached:?}");
        if let Err(error) = reached {
            let text = error.to_string();
            assert!(text.contains("in PreOP") && text.contains("one refuses"), "{text}");
        }
    }
}
