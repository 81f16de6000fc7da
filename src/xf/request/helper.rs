//! The CiA 402 helper: the chip itself leads the state machines of drives, by their controlwords.

use super::{MotorNumber, SlaveNumber};
use crate::ethercat::bits;
use crate::ethercat::cia402::{DriveState, Statusword};
use crate::xf::Malformed;
use crate::xf::fields::Kind;
use crate::xf::layout::{Fixed, field_values, info, layout};

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

layout! {
    /// 402_CONFIG_SET, code 26: where an axis has its words. `par` motor, `i0` offset of the controlword, `i1` of the
    /// statusword, `i2` control byte, `i3` slave (XF EN 750, XF ZH 708).
    pub struct HelperConfigSet {
        /// Which axis.
        pub motor: MotorNumber = par(),
        /// Bytes from the beginning of the slave's RxPDO to the controlword.
        pub controlword_offset: u8 = info(0),
        /// Bytes from the beginning of the slave's TxPDO to the statusword.
        pub statusword_offset: u8 = info(1),
        /// What the helper does.
        pub control: HelperControl = info(2),
        /// Which slave the axis belongs to.
        pub slave: SlaveNumber = info(3),
    }

    /// 402_STATE_SET, code 27: the state an axis shall reach. `par` motor, `i0` state (XF EN 767).
    pub struct HelperStateSet {
        /// Which axis.
        pub motor: MotorNumber = par(),
        /// The state.
        pub state: DriveState = info(0),
    }

    /// 402_STATE_GET, code 28: the state of an axis, in `ret`. `par` motor (XF EN 778).
    pub struct HelperStateGet {
        /// Which axis.
        pub motor: MotorNumber = par(),
    }

    /// 402_CTL_SET, code 29: what the helper does with an axis. `par` motor, `i0` control byte, `i1` 0x5A, `i2` number
    /// of motors, `i3` slave (XF EN 795).
    pub struct HelperControlSet {
        /// Which axis.
        pub motor: MotorNumber = par(),
        /// What the helper does.
        pub control: HelperControl = info(0),
        /// How many axes there are.
        pub motors: u8 = info(2).after(CONTROL_KEY),
        /// Which slave the axis belongs to.
        pub slave: SlaveNumber = info(3),
    }

    /// 402_CTL_GET, code 30: what the helper does with an axis, in `ret`. `par` motor (XF EN 813).
    pub struct HelperControlGet {
        /// Which axis.
        pub motor: MotorNumber = par(),
    }

    /// 402_GET_STATUSWORD, code 74: the statusword of an axis, @0 u16. `par` motor (XF EN 1432).
    pub struct HelperStatuswordGet {
        /// Which axis.
        pub motor: MotorNumber = par(),
    }
}

/// `i1` of [`HelperControlSet`].
const CONTROL_KEY: Fixed = Fixed::new::<u8>(info(1).named("key").hex().or(0x5A), 0xFF, "402_CTL_SET i1", "0x5A");

field_values! {
    HelperControl, 1, Kind::Bits(HelperControl::NAMES), |bits| bits.0.into(), |bits| Ok(HelperControl(bits as u8));
    DriveState, 1, Kind::DriveState, |state| state.status_bits().into(), |code| requested_state(code);
}

/// The state that a code asks for, which has to be one of the table's.
fn requested_state(code: u32) -> Result<DriveState, Malformed> {
    let allowed = "0x00, 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F or 0x08";
    match Statusword(code as u16).state() {
        Some(state) if u32::from(state.status_bits()) == code => Ok(state),
        _ => Err(Malformed::only("402_STATE_SET state", code, allowed)),
    }
}
