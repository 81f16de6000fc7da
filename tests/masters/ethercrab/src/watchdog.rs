//! A master that pauses finds its slaves in SafeOP, reads the reason, acknowledges it and goes on.

use async_io::Timer;
use ethercrab::error::Error;
use ethercrab::{AlStatusCode, RegisterAddress, SubDeviceState};

use crate::rig::{CYCLE, InPreOp, Master, OP, al_status, cycle, scan, to_op, wait_for};

/// The time of the watchdog in units of 100 us.
const SHORT: u16 = 1_000;
const LONG: u16 = 20_000;

pub async fn run(master: &Master) {
    let group: InPreOp = scan(master, 2).await;
    let group = to_op(master, group).await;
    let set_watchdog = async |units: u16| {
        for slave in group.iter(master) {
            slave.register_write(RegisterAddress::SyncManagerWatchdog, units).await.expect("it is written");
        }
    };
    set_watchdog(SHORT).await;
    // No process data.
    for slave in group.iter(master) {
        let expired = async || {
            Timer::after(CYCLE).await;
            al_status(&slave).await == Err(Error::SubDevice(AlStatusCode::SyncManagerWatchdog))
        };
        wait_for("the watchdog", expired).await;
        println!("{}", al_status(&slave).await.expect_err("an error"));
    }
    set_watchdog(LONG).await;
    let states = cycle(master, &group).await.subdevice_states;
    assert_eq!(states[..], [SubDeviceState::SafeOp; 2], "states behind the watchdog");
    for (control, state) in [(0x14_u16, SubDeviceState::SafeOp), (0x08, SubDeviceState::Op)] {
        for slave in group.iter(master) {
            slave.register_write(RegisterAddress::AlControl, control).await.expect("it is written");
        }
        wait_for("the state", async || cycle(master, &group).await.is_in_state(state)).await;
    }
    assert_eq!(cycle(master, &group).await.working_counter, 6);
    for slave in group.iter(master) {
        assert_eq!(al_status(&slave).await, Ok((OP, AlStatusCode::NoError)));
    }
}
