//! Requests for the CiA 402 helper: the chip itself drives the state machines of drives by means of their controlwords.

use super::{MotorNumber, SlaveNumber};
use crate::ethercat::bits;
use crate::ethercat::cia402::{DriveState, Statusword};
use crate::xf::Malformed;
use crate::xf::fields::FieldKind;
use crate::xf::layout::{Fixed, field_values, info, layout};

bits! {
    /// The control byte: what the helper does with an axis.
    HelperControl(u8) {
        /// Bit 3: the helper gives one fault reset.
        RESET_ONCE = 1 << 3;
        /// Bit 4: the helper drives the axis: it overwrites bits 0 to 3 of the controlword, and bit 7 if a fault reset
        /// is selected (XF ZH 708).
        ON = 1 << 4;
        /// Bit 7: the helper gives a fault reset whenever a fault occurs.
        RESET_ALWAYS = 1 << 7;
    }
}

layout! {
    /// 402_CONFIG_SET, command code 26: sets the positions of an axis's controlword and statusword in the process data
    /// (XF EN 750, XF ZH 708). Parameter byte: motor; information bytes: `i0` offset of the controlword, `i1` offset of
    /// the statusword, `i2` control byte, `i3` slave.
    pub struct HelperConfigSet {
        /// The axis, as the helper's motor number.
        pub motor: MotorNumber = par(),
        /// Offset of the controlword in the slave's RxPDO, in bytes.
        pub controlword_offset: u8 = info(0),
        /// Offset of the statusword in the slave's TxPDO, in bytes.
        pub statusword_offset: u8 = info(1),
        /// What the helper does with the axis: the control byte.
        pub control: HelperControl = info(2),
        /// The slave to which the axis belongs.
        pub slave: SlaveNumber = info(3),
    }

    /// 402_STATE_SET, command code 27: sets the state that an axis has to reach (XF EN 767). Parameter byte: motor;
    /// information bytes: `i0` state.
    pub struct HelperStateSet {
        /// The axis, as the helper's motor number.
        pub motor: MotorNumber = par(),
        /// The CiA 402 state to which the helper brings the axis.
        pub state: DriveState = info(0),
    }

    /// 402_STATE_GET, command code 28: reads the state of an axis from the return byte (XF EN 778). Parameter byte:
    /// motor.
    pub struct HelperStateGet {
        /// The axis, as the helper's motor number.
        pub motor: MotorNumber = par(),
    }

    /// 402_CTL_SET, command code 29: sets what the helper does with an axis (XF EN 795). Parameter byte: motor;
    /// information bytes: `i0` control byte, `i1` 0x5A, `i2` number of motors, `i3` slave.
    pub struct HelperControlSet {
        /// The axis, as the helper's motor number.
        pub motor: MotorNumber = par(),
        /// What the helper does with the axis: the control byte.
        pub control: HelperControl = info(0),
        /// The number of axes that the helper drives. No source says what the chip does with it; the modelled chip
        /// ignores it.
        pub motors: u8 = info(2).after(CONTROL_KEY),
        /// The slave to which the axis belongs.
        pub slave: SlaveNumber = info(3),
    }

    /// 402_CTL_GET, command code 30: reads the control byte of an axis from the return byte (XF EN 813). Parameter
    /// byte: motor.
    pub struct HelperControlGet {
        /// The axis, as the helper's motor number.
        pub motor: MotorNumber = par(),
    }

    /// 402_GET_STATUSWORD, command code 74: reads the statusword of an axis (XF EN 1432). Parameter byte: motor.
    /// Answer: u16 at byte 0 of the data.
    pub struct HelperStatuswordGet {
        /// The axis, as the helper's motor number.
        pub motor: MotorNumber = par(),
    }
}

/// The value 0x5A, which the manuals prescribe for `i1` of [`HelperControlSet`] without an explanation.
const CONTROL_KEY: Fixed = Fixed::new::<u8>(info(1).named("key").hex().or(0x5A), 0xFF, "402_CTL_SET i1", "0x5A");

field_values! {
    HelperControl, 1, FieldKind::Bits(HelperControl::NAMES), |bits| bits.0.into(), |bits| Ok(HelperControl(bits as u8));
    DriveState, 1, FieldKind::DriveState, |state| state.status_bits().into(), |code| requested_state(code);
}

/// The state that a code requests; the manuals' table lists the allowed codes.
fn requested_state(code: u32) -> Result<DriveState, Malformed> {
    let allowed = "0x00, 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F or 0x08";
    match Statusword(code as u16).state() {
        Some(state) if u32::from(state.status_bits()) == code => Ok(state),
        _ => Err(Malformed::only("402_STATE_SET state", code, allowed)),
    }
}
