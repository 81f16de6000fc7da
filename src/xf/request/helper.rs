//! The CiA 402 helper: the chip itself leads the state machines of drives, by their controlwords.

use super::{Arguments, MotorNumber, SlaveNumber, short};
use crate::ethercat::bits;
use crate::ethercat::cia402::{DriveState, Statusword};
use crate::xf::Malformed;
use crate::xf::response::DriveStateByte;

bits! {
    /// What the helper does with an axis.
    HelperControl(u8) {
        /// Bit 3: a fault is reset once.
        RESET_ONCE = 1 << 3;
        /// Bit 4: the helper leads the axis: it overwrites bits 0 to 3 of the controlword, and bit 7 if a reset of
        /// faults is chosen (XF ZH 708).
        ON = 1 << 4;
        /// Bit 7: faults are reset whenever there is one.
        RESET_ALWAYS = 1 << 7;
    }
}

short! {
    /// 402_CONFIG_SET, code 26: where an axis has its words. `par` motor, `i0` offset of the controlword, `i1` of the
    /// statusword, `i2` control byte, `i3` slave (XF EN 750, XF ZH 708).
    HelperConfigSet {
        /// Which axis.
        pub motor: MotorNumber,
        /// Bytes from the beginning of the slave's RxPDO to the controlword.
        pub controlword_offset: u8,
        /// Bytes from the beginning of the slave's TxPDO to the statusword.
        pub statusword_offset: u8,
        /// What the helper does.
        pub control: HelperControl,
        /// Which slave the axis belongs to.
        pub slave: SlaveNumber,
    }, HelperConfigSet -> (),
        |request| Arguments::NONE.parameter(request.motor.get()).info([
            request.controlword_offset,
            request.statusword_offset,
            request.control.0,
            request.slave.get(),
        ]),
        |a| Self {
            motor: MotorNumber::decode(a.parameter)?,
            controlword_offset: a.info[0],
            statusword_offset: a.info[1],
            control: HelperControl(a.info[2]),
            slave: SlaveNumber::decode(a.info[3])?,
        };

    /// 402_STATE_SET, code 27: the state an axis shall reach. `par` motor, `i0` state (XF EN 767).
    HelperStateSet {
        /// Which axis.
        pub motor: MotorNumber,
        /// The state.
        pub state: DriveState,
    }, HelperStateSet -> (),
        |request| Arguments::NONE.parameter(request.motor.get()).info([request.state.status_bits(), 0, 0, 0]),
        |a| Self { motor: MotorNumber::decode(a.parameter)?, state: requested_state(a.info[0])? };

    /// 402_STATE_GET, code 28: the state of an axis, in `ret`. `par` motor (XF EN 778).
    HelperStateGet {
        /// Which axis.
        pub motor: MotorNumber,
    }, HelperStateGet -> DriveStateByte,
        |request| Arguments::NONE.parameter(request.motor.get()),
        |a| Self { motor: MotorNumber::decode(a.parameter)? };

    /// 402_CTL_SET, code 29: what the helper does with an axis. `par` motor, `i0` control byte, `i1` 0x5A, `i2` number
    /// of motors, `i3` slave (XF EN 795).
    HelperControlSet {
        /// Which axis.
        pub motor: MotorNumber,
        /// What the helper does.
        pub control: HelperControl,
        /// How many axes there are.
        pub motors: u8,
        /// Which slave the axis belongs to.
        pub slave: SlaveNumber,
    }, HelperControlSet -> (),
        |request| Arguments::NONE.parameter(request.motor.get()).info([
            request.control.0,
            CONTROL_KEY,
            request.motors,
            request.slave.get(),
        ]),
        |a| Self {
            motor: MotorNumber::decode(a.parameter)?,
            control: HelperControl(a.info[0]),
            motors: keyed(a.info[1], a.info[2])?,
            slave: SlaveNumber::decode(a.info[3])?,
        };

    /// 402_CTL_GET, code 30: what the helper does with an axis, in `ret`. `par` motor (XF EN 813).
    HelperControlGet {
        /// Which axis.
        pub motor: MotorNumber,
    }, HelperControlGet -> HelperControl,
        |request| Arguments::NONE.parameter(request.motor.get()),
        |a| Self { motor: MotorNumber::decode(a.parameter)? };

    /// 402_GET_STATUSWORD, code 74: the statusword of an axis, @0 u16. `par` motor (XF EN 1432).
    HelperStatuswordGet {
        /// Which axis.
        pub motor: MotorNumber,
    }, HelperStatuswordGet -> Statusword,
        |request| Arguments::NONE.parameter(request.motor.get()),
        |a| Self { motor: MotorNumber::decode(a.parameter)? };
}

/// `i1` of [`HelperControlSet`], a fixed value.
const CONTROL_KEY: u8 = 0x5A;

/// `value` if `key` is the fixed one.
fn keyed(key: u8, value: u8) -> Result<u8, Malformed> {
    if key == CONTROL_KEY { Ok(value) } else { Err(Malformed::only("402_CTL_SET i1", key.into(), "0x5A")) }
}

/// The state that a code asks for, which has to be one of the table's.
fn requested_state(code: u8) -> Result<DriveState, Malformed> {
    let allowed = "0x00, 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F or 0x08";
    match Statusword(code.into()).state() {
        Some(state) if state.status_bits() == code => Ok(state),
        _ => Err(Malformed::only("402_STATE_SET state", code.into(), allowed)),
    }
}
