//! States that slaves refuse: ethercrab prints the code and what it means.

use async_io::Timer;
use ethercrab::error::{Error, TimeoutError};
use ethercrab::{AlStatusCode, RegisterAddress};

use crate::rig::{CYCLE, InPreOp, Master, PRE_OP, al_status, fault, scan};

pub async fn run(master: &Master) {
    let group: InPreOp = scan(master, 2).await;
    fault("refuse 2 safeop 0x8001");
    // OP from PreOP; an unknown state; no sync managers for the process data; a code from a script.
    for (n, control, code) in [
        (0, 0x08_u16, AlStatusCode::InvalidRequestedStateChange),
        (0, 0x17, AlStatusCode::UnknownRequestedState),
        (0, 0x14, AlStatusCode::InvalidOutputConfiguration),
        (1, 0x14, AlStatusCode::Unknown(0x8001)),
    ] {
        let slave = group.iter(master).nth(n).expect("a slave");
        let ask = async |control: u16| {
            slave.register_write(RegisterAddress::AlControl, control).await.expect("it is written");
            Timer::after(CYCLE).await;
            al_status(&slave).await
        };
        let refused = ask(control).await;
        assert_eq!(refused, Err(Error::SubDevice(code)), "AL control {control:#x}");
        println!("AL control {control:#04x}: {}", refused.expect_err("an error"));
        assert_eq!(ask(0x12).await, Ok((PRE_OP, AlStatusCode::NoError)), "acknowledged");
    }
    // ethercrab 0.7.1 looks for the error of a change of all slaves in its own written value, so that a refusal is a
    // timeout. Then it drops the frame under way, whose answer ends the task of the frames: no later request works.
    let refused = group.into_safe_op(master).await.map(drop);
    assert_eq!(refused, Err(Error::Timeout(TimeoutError::StateTransition)), "the change of all");
}
