//! The chip itself, its interrupts and the CiA 402 helper.

use ecmsk::cia402::DriveState;
use ecmsk::xf::request::{
    AsyncReset, AsyncResetActions, CrcErrorCountClear, CrcTypeSet, FirmwareVersionGet, HelperConfigSet, HelperControl,
    HelperControlGet, HelperControlSet, HelperStateGet, HelperStateSet, HelperStatuswordGet, InterruptEnable,
    InterruptGetEnable, InterruptSetEnable, Mdio, PeripheralInterrupts, Polarity, SpiPackSizeGet, SpiReconfig,
    WarmReset, WkcErrorCountGet, WkcErrorLimit, WkcErrorMaxGet, WkcErrorMaxSet,
};
use ecmsk::xf::{CheckType, DataSize, Interrupts, Request};

use super::{case, long, short};
use crate::{Printed, motor, slave};

/// XF-8.1 The size of packets, XF-8.2 the check word's type, XF-8.3 the version.
/// XF EN 704 to 741, 1285. The length of 23 is the new n.
#[test]
pub fn packet_size_and_check_word() {
    let sized = |len| Printed { code: 23, len, ..Printed::default() };
    case(SpiPackSizeGet, short(20, 0, [0; 4]));
    case(SpiReconfig { size: DataSize::MIN }, sized(32));
    case(SpiReconfig { size: DataSize::MAX }, sized(1408));
    case(CrcErrorCountClear, short(24, 0, [0; 4]));
    case(CrcTypeSet { kind: CheckType::Fixed }, short(25, 0, [0; 4]));
    case(CrcTypeSet { kind: CheckType::Crc32 }, short(25, 3, [0; 4]));
    case(FirmwareVersionGet, short(56, 0, [0; 4]));
}

/// XF-8.4 Interrupts, XF-4.3 whatever the length says.
/// XF EN 1310: par polarity, @0 u32 sources, @4 GPIO, @5 peripherals.
#[test]
pub fn enabled_interrupts() {
    let enable = InterruptEnable {
        polarity: Polarity::INT1_HIGH | Polarity::INT0_HIGH,
        sources: Interrupts::RX_FIFO_LOW | Interrupts::WORKING_COUNTER,
        gpio: 0xA5,
        peripherals: PeripheralInterrupts::ENCODER_OVERFLOW | PeripheralInterrupts::GPIO_8,
    };
    case(InterruptSetEnable { enable }, long(58, 3, vec![0, 0, 0x40, 0x02, 0xA5, 0x41]));
    case(InterruptGetEnable, short(59, 0, [0; 4]));
    Printed { len: 0, ..long(58, 1, vec![0, 0, 0, 0x80, 1, 2]) }.read(|read| match read {
        Ok(Request::InterruptSetEnable(set)) => {
            assert_eq!((set.enable.sources, set.enable.gpio), (Interrupts::ETHERCAT, 1));
        }
        other => panic!("{other:?}"),
    });
}

/// XF-8.5 Resets. XF EN 1446, 1517.
#[test]
pub fn resets_of_the_chip() {
    let reset = |actions| AsyncReset::new(actions).expect("known bits");
    case(reset(AsyncResetActions::CLEAR_BUSY), short(75, 1, [0; 4]));
    case(reset(AsyncResetActions::SKIP_PORT_WAIT), short(75, 2, [0; 4]));
    case(reset(AsyncResetActions::GIVE_UP), short(75, 4, [0; 4]));
    case(reset(AsyncResetActions::ALL), short(75, 7, [0; 4]));
    case(WarmReset, short(127, 0, [0; 4]));
}

/// XF-8.6 Errors of the working counter. XF EN 1526 to 1553.
#[test]
pub fn working_counter_errors() {
    let limit = |limit| WkcErrorMaxSet::new(limit).expect("not 0");
    case(WkcErrorCountGet, short(130, 0, [0; 4]));
    case(WkcErrorMaxGet, short(131, 0, [0; 4]));
    case(limit(WkcErrorLimit::from_code(1)), short(132, 1, [0; 4]));
    case(limit(WkcErrorLimit::from_code(254)), short(132, 254, [0; 4]));
    case(limit(WkcErrorLimit::NONE), short(132, 255, [0; 4]));
    assert_eq!(WkcErrorMaxSet::new(WkcErrorLimit::from_code(0)), None);
    let set = WkcErrorMaxSet::new(WkcErrorLimit::default()).expect("any number");
    assert_eq!((set.limit().most(), WkcErrorLimit::from_code(254).most()), (None, Some(254)));
}

/// XF-8.7 Registers of PHYs. XF EN 1455: par 0 write, 1 read; i0 register, i1 PHY, i2, i3 data.
#[test]
pub fn phy_registers() {
    case(Mdio::Write { phy: 1, register: 2, value: 0x0403 }, short(81, 0, [2, 1, 3, 4]));
    case(Mdio::Read { phy: 1, register: 2 }, short(81, 1, [2, 1, 0, 0]));
}

/// XF-9.1 Where an axis has its words and what the helper does, XF-9.4 and what can be read of it.
/// XF EN 750: par motor, i0 and i1 offsets, i2 control, i3 slave. XF EN 795: i0 control, i1 0x5A, i2 motors, i3 slave.
#[test]
pub fn helper_configuration() {
    let control = HelperControl::ON | HelperControl::RESET_ONCE;
    let config = HelperConfigSet {
        motor: motor(3),
        controlword_offset: 4,
        statusword_offset: 6,
        control: HelperControl::ON | HelperControl::RESET_ALWAYS,
        slave: slave(5),
    };
    case(config, short(26, 3, [4, 6, 0x90, 5]));
    case(HelperControlSet { motor: motor(3), control, motors: 8, slave: slave(5) }, short(29, 3, [0x18, 0x5A, 8, 5]));
    case(HelperControlGet { motor: motor(127) }, short(30, 127, [0; 4]));
    case(HelperStatuswordGet { motor: motor(0) }, short(74, 0, [0; 4]));
}

/// XF-9.2 States that are asked for. XF EN 767.
#[test]
pub fn helper_state_codes() {
    for (state, code) in [
        (DriveState::NotReadyToSwitchOn, 0x00),
        (DriveState::SwitchOnDisabled, 0x40),
        (DriveState::ReadyToSwitchOn, 0x21),
        (DriveState::SwitchedOn, 0x23),
        (DriveState::OperationEnabled, 0x27),
        (DriveState::QuickStopActive, 0x07),
        (DriveState::FaultReactionActive, 0x0F),
        (DriveState::Fault, 0x08),
    ] {
        case(HelperStateSet { motor: motor(2), state }, short(27, 2, [code, 0, 0, 0]));
    }
    case(HelperStateGet { motor: motor(2) }, short(28, 2, [0; 4]));
}
