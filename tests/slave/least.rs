//! A slave that implements only the required functions of [`Slave`]: what the default functions answer.

use crate::wired::{alarm, force, jam, stick};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::ethercat::{AlState, Ns};
use ecmsk::slave::{AlStatus, Input, Slave};

struct Least;

impl Slave for Least {
    fn name(&self) -> &str {
        "least"
    }

    fn state(&self) -> AlState {
        AlState::Init
    }

    fn enter(&mut self, _: AlState) -> Result<(), AlStatus> {
        Err(AlStatus::INVALID_CHANGE)
    }

    fn read(&mut self, _: ObjectAddress, _: SdoScope, _: &mut [u8]) -> Result<usize, AbortCode> {
        Err(AbortCode::TIMEOUT)
    }

    fn write(&mut self, _: ObjectAddress, _: SdoScope, _: &[u8]) -> Result<(), AbortCode> {
        Err(AbortCode::TIMEOUT)
    }

    fn exchange(&mut self, _: Option<&[u8]>, _: &mut [u8]) {}

    fn step(&mut self, _: Ns) {}
}

/// It refuses every fault of an axis or a channel, since it has none.
#[test]
fn it_has_no_axis_and_no_channel() {
    let mut slave = Least;
    assert!(!slave.apply_fault(alarm(0x7305)));
    assert!(!slave.apply_fault(stick(Input::Home, Some(true))));
    assert!(!slave.apply_fault(jam(true)));
    assert!(!slave.apply_fault(force(1)));
    assert_eq!(slave.shaft(0), None);
}

/// A slave has distributed clocks by default, as most slaves have (UG15, DC reference clock).
#[test]
fn it_has_distributed_clocks() {
    assert!(Least.has_dc());
}
