//! Network, states, slaves and clocks.

use ecmsk::xf::request::{
    ConfigFmmu, ConfigMap, ConfigSyncManager, DcSync, DcTiming, DirectAssign, Direction, EcatInit, EnableLrw,
    InfoUpdate, InitDc, PdoWorkingCounterGet, Reconfig, ReferenceClock, SlaveCountGet, SlaveInfoGet, SlaveInfoItem,
    Slaves, StateCheck, StateGet, StateSet, StateUpdate, WorkingCounterItem,
};
use ecmsk::xf::{EtherCatState, Reserve};

use super::{case, long, short};
use crate::{Printed, bytes, slave};

const DC: DcTiming =
    DcTiming { assign_activate: 0x0730, sync0_ns: 0x1122_3344, sync1_ns: 0x5566_7788, shift_ns: -125_000 };

/// XF EN 375: @2 DC Activate, @4 SYNC0, @8 SYNC1, @12 shift, in nanoseconds.
fn dc_bytes(first: u8, second: u8) -> Vec<u8> {
    bytes![first, second, 0x0730_u16, 0x1122_3344_u32, 0x5566_7788_u32, -125_000_i32]
}

/// XF-5.1 ECAT_INIT_OP, XF-5.2 with its reserve bits.
#[test]
pub fn ecat_init() {
    let general =
        EcatInit { special_slaves: false, reference_clock: ReferenceClock::Chip, lrw: false, fifo_on: false, dc: DC };
    let printed = long(1, 0, dc_bytes(0xFF, 0x81));
    let at_12 = printed.data[12..16].to_vec();
    assert_eq!(at_12, (-125_000_i32).to_le_bytes(), "the drawing has the shift in byte 12");
    case(general, printed.clone());
    case(EcatInit { special_slaves: true, ..general }, Printed { par: 48, ..printed.clone() });
    case(
        EcatInit { reference_clock: ReferenceClock::FirstSlave, ..general },
        Printed { reserve: 1 << 12, ..printed.clone() },
    );
    case(EcatInit { lrw: true, ..general }, Printed { reserve: 1 << 11, ..printed });
    case(EcatInit { fifo_on: true, ..general }, long(1, 0, dc_bytes(0xFF, 0)));
    // Any byte but 0x81 leaves the FIFO on, and byte 0 is not looked at.
    for fifo in [0, 1, 0x80, 0x82] {
        long(1, 0, dc_bytes(0, fifo)).read(|read| match read {
            Ok(ecmsk::xf::Request::EcatInit(init)) => assert!(init.fifo_on),
            other => panic!("{other:?}"),
        });
    }
    // Other reserve bits change nothing.
    Printed { reserve: 0xE000, ..long(1, 49, dc_bytes(0xFF, 0x81)) }.read(|read| match read {
        Ok(ecmsk::xf::Request::EcatInit(init)) => {
            assert_eq!((init.reference_clock, init.lrw), (ReferenceClock::Chip, false));
            assert!(!init.special_slaves, "any parameter but 48 is for general slaves");
        }
        other => panic!("{other:?}"),
    });
    assert_eq!(Reserve::MASTER_SHIFT.with(Reserve::LRW).0, 0x1800);
}

/// XF-5.3 ECAT_DCSYNC.
#[test]
pub fn ecat_dcsync() {
    case(DcSync { slaves: slave(5).into(), dc: DC }, long(50, 0, dc_bytes(5, 0)));
    case(DcSync { slaves: Slaves::All, dc: DC }, long(50, 0, dc_bytes(0xFF, 0)));
}

/// XF-5.4 States of one slave and of all. XF EN 619 and 1187: par 0 to 127 or 0xFF, information the state.
#[test]
pub fn ecat_states() {
    use EtherCatState::{Boot, Init, Op, PreOp, SafeOp};
    case(StateUpdate, short(57, 0, [0; 4]));
    for (slaves, par) in [(slave(0).into(), 0), (slave(127).into(), 127), (Slaves::All, 0xFF)] {
        for (state, code) in [(Init, 1), (PreOp, 2), (Boot, 3), (SafeOp, 4), (Op, 8)] {
            case(StateSet { slaves, state }, short(12, par, [code, 0, 0, 0]));
            case(StateCheck { slaves, state }, short(41, par, [code, 0, 0, 0]));
        }
        case(StateGet { slaves }, short(13, par, [0; 4]));
    }
}

/// XF-5.5 Items about slaves, XF-5.6 numbers of slaves and the working counter. XF EN 421, 643, 661.
#[test]
pub fn numbers_and_items() {
    use SlaveInfoItem::*;
    case(SlaveCountGet, short(16, 0, [0; 4]));
    use WorkingCounterItem::{Counter, Inputs, Outputs};
    for (which, par) in [(Inputs, 1), (Outputs, 2), (Counter, 3)] {
        case(PdoWorkingCounterGet { which }, short(4, par, [0; 4]));
    }
    let items = [Vendor, Product, Revision, Name, StationAddress, Alias, State, AlStatus, OutputBytes, InputBytes];
    let newer = [HasDc, DcCycle, DcShift, DcActive];
    for (i0, item) in (0..).zip(items.into_iter().chain(newer)) {
        case(SlaveInfoGet { slave: slave(3), item }, short(15, 3, [i0, 0, 0, 0]));
    }
}

/// XF-5.7 Sync managers and FMMUs.
/// XF ZH 1297: @0 slave, @1 SM number, @2 start, @4 length, @6 control, @7 activate. XF ZH 1314: @0 slave, @1 to @4
/// FMMUs.
#[test]
pub fn sync_managers_and_fmmus() {
    let manager =
        ConfigSyncManager { slave: slave(1), number: 2, start: 0x1100, length: 0x0234, control: 0x64, activate: 0x01 };
    case(manager, long(71, 0, bytes![1_u8, 2_u8, 0x1100_u16, 0x0234_u16, 0x64_u8, 1_u8]));
    case(ConfigFmmu { slave: slave(9), functions: [1, 2, 3, 4] }, long(72, 0, vec![9, 1, 2, 3, 4]));
}

/// XF-5.8 DIRECT_ASSIGN. XF EN 1472.
#[test]
pub fn assigned_lengths() {
    let length = |direction| DirectAssign::Length { slave: slave(7), direction, bytes: 0x0102 };
    case(DirectAssign::Switch { slave: slave(7), on: false }, short(82, 0, [7, 0, 0, 0]));
    case(DirectAssign::Switch { slave: slave(7), on: true }, short(82, 0, [7, 1, 0, 0]));
    case(length(Direction::Output), short(82, 1, [7, 0, 0x02, 0x01]));
    case(length(Direction::Input), short(82, 1, [7, 1, 0x02, 0x01]));
}

/// XF-5.9 Commands without arguments, and ENABLE_LRW.
#[test]
pub fn commands_without_arguments() {
    case(InfoUpdate, short(0, 0, [0; 4]));
    case(Reconfig, short(2, 0, [0; 4]));
    case(InitDc, short(3, 0, [0; 4]));
    case(ConfigMap, short(73, 0, [0; 4]));
    case(EnableLrw { lrw: false }, short(142, 0, [0; 4]));
    case(EnableLrw { lrw: true }, short(142, 1, [0; 4]));
}
