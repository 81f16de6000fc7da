//! The registers of a slave controller.

use ecmsk::ethercat::registers::{
    self, AlControl, AlEvents, AlStatusRegister, AlStatusWithCode, BufferMode, DlControl, DlStatus, EcatEvents, Fmmu,
    FmmuDirections, LoopControl, MAP, RegisterAccess, RequestedState, SiiCommand, SiiControl, SmControl, SmDirection,
    SmStatus, SyncManager, SystemTimeDifference, register_at,
};
use ecmsk::ethercat::{AlState, AlStatus};
use proptest::prelude::*;

/// ECAT-2.1 Registers have the addresses of the data sheets, and a write clears, changes or leaves them.
#[test]
fn registers_are_where_the_data_sheets_have_them() {
    use RegisterAccess::*;
    for (address, offset, len, access, name) in [
        (0x0000, 0, 1, Read, "type"),
        (0x0009, 1, 2, Read, "features"),
        (0x0010, 0, 2, Write, "configured station address"),
        (0x0012, 0, 2, Read, "configured station alias"),
        (0x0103, 3, 4, Write, "ESC DL control"),
        (0x0110, 0, 2, Read, "ESC DL status"),
        (0x0120, 0, 2, Write, "AL control"),
        (0x0130, 0, 2, Read, "AL status"),
        (0x0134, 0, 2, Read, "AL status code"),
        (0x0210, 0, 2, Read, "ECAT event request"),
        (0x0220, 0, 4, Read, "AL event request"),
        (0x0300, 0, 8, Clear, "RX error counters"),
        (0x030C, 0, 1, Clear, "ECAT processing unit error counter"),
        (0x0313, 3, 4, Clear, "lost link counters"),
        (0x0420, 0, 2, Write, "watchdog time process data"),
        (0x0442, 0, 1, Clear, "watchdog counter process data"),
        (0x0503, 1, 2, Write, "EEPROM control/status"),
        (0x050F, 7, 8, Write, "EEPROM data"),
        (0x0610, 16, 256, Write, "FMMUs"),
        (0x080D, 13, 128, Write, "sync managers"),
        (0x0904, 4, 16, Write, "receive times"),
        (0x0910, 0, 8, Write, "system time"),
        (0x092C, 0, 4, Read, "system time difference"),
        (0x0981, 0, 1, Write, "SYNC activation"),
        (0x0990, 0, 8, Write, "start time cyclic operation"),
        (0x09A4, 0, 4, Write, "SYNC1 cycle time"),
    ] {
        let register = register_at(address).unwrap_or_else(|| panic!("0x{address:04X} is a register"));
        assert_eq!((register.address, register.len), (address - offset, len), "0x{address:04X}");
        assert_eq!((register.access, register.name), (access, name), "0x{address:04X}");
    }
    assert_eq!((registers::fmmu(1), registers::sync_manager(3), registers::receive_time(2)), (0x0610, 0x0818, 0x0908));
    let bytes = [registers::sync_manager_status, registers::sync_manager_activate, registers::sync_manager_pdi_control];
    assert_eq!(bytes.map(|byte| byte(1)), [0x080D, 0x080E, 0x080F]);
    for hole in [0x0014, 0x0140 - 1, 0x0880, 0x0940, 0x1000, 0xFFFF] {
        assert_eq!(register_at(hole), None, "0x{hole:04X}");
    }
    assert_eq!(
        MAP.iter().map(|register| usize::from(register.len)).sum::<usize>(),
        (0..0x1000).filter(|at| register_at(*at).is_some()).count()
    );
}

/// ECAT-2.2 AL control and AL status: the state in bits 0 to 3, acknowledge or error in bit 4, identification in bit 5;
/// other values survive. Status and code are read together.
#[test]
fn al_control_and_status() {
    for (code, state) in [
        (1, RequestedState::State(AlState::Init)),
        (2, RequestedState::State(AlState::PreOp)),
        (3, RequestedState::Boot),
        (4, RequestedState::State(AlState::SafeOp)),
        (8, RequestedState::State(AlState::Op)),
        (0, RequestedState::Unknown(0)),
        (7, RequestedState::Unknown(7)),
    ] {
        assert_eq!((AlControl(0x10 | code).state(), state.code()), (state, code as u8));
        assert_eq!(AlStatusRegister::of(state), AlStatusRegister(code));
    }
    assert!(AlControl(0x0012).contains(AlControl::ACKNOWLEDGE));
    assert!(AlControl(0x0021).contains(AlControl::REQUEST_ID));
    let both = AlStatusWithCode { status: AlStatusRegister(0x14), code: AlStatus::WATCHDOG };
    assert_eq!(both.encode(), [0x14, 0, 0, 0, 0x1B, 0]);
    assert_eq!(AlStatusWithCode::decode(&[0x14, 0, 9, 9, 0x1B, 0]), both);
    assert_eq!((AlEvents::sync_manager(1), AlEvents::sync_manager(16)), (AlEvents(0x200), AlEvents::NONE));
    assert_eq!((EcatEvents::sync_manager(7), EcatEvents::sync_manager(8)), (EcatEvents(0x800), EcatEvents::NONE));
}

/// ECAT-2.3 DL status has the link of port n in bit 4 + n, its closed loop in bit 8 + 2n and its communication in bit 9 + 2n;
/// DL control has two bits for the loop of each port.
#[test]
fn dl_control_and_status() {
    let status = |links: [bool; 4]| {
        let ready = DlStatus(DlStatus::SII_LOADED);
        links.into_iter().enumerate().fold(ready, |status, (port, link)| status.with_port(port, link, !link))
    };
    let inner = status([true, true, false, false]);
    assert_eq!((inner.0, status([true, false, false, false]).0), (0x5A31, 0x5611));
    assert_eq!((inner.has_link(1), inner.is_closed(1), inner.communicates(1)), (true, false, true));
    assert_eq!((inner.has_link(2), inner.is_closed(2), inner.communicates(2)), (false, true, false));
    assert_eq!(inner.with_port(1, true, true).0, 0x5631);

    let control = DlControl(0x0100_E400);
    let loops = [LoopControl::Auto, LoopControl::AutoClose, LoopControl::Open, LoopControl::Closed];
    assert_eq!([0, 1, 2, 3].map(|port| control.loop_control(port)), loops);
    assert!(control.uses_alias() && !DlControl::POWER_ON.uses_alias());
}

/// ECAT-2.4 The bytes of an FMMU, and how many bits it maps.
#[test]
fn an_fmmu_byte_by_byte() {
    let bytes = [0x11, 0, 1, 0, 3, 0, 3, 0, 0x01, 0x0F, 1, 2, 1, 0, 0, 0];
    let fmmu = Fmmu {
        logical: 0x0001_0011,
        len: 3,
        first_bit: 3,
        last_bit: 0,
        physical: 0x0F01,
        physical_bit: 1,
        directions: FmmuDirections::WRITE,
        enabled: true,
    };
    assert_eq!((fmmu.encode(), Fmmu::decode(&bytes)), (bytes, fmmu));
    assert_eq!((fmmu.bits(), fmmu.is_bytewise()), (14, false));
    let whole = Fmmu::bytes(0x0100_0000, 6, 0x1100, FmmuDirections::READ);
    assert_eq!((whole.bits(), whole.is_bytewise()), (48, true));
    assert_eq!((Fmmu::default().bits(), Fmmu { first_bit: 7, last_bit: 0, len: 1, ..whole }.bits()), (0, 0));
}

/// ECAT-2.5 The bytes of a sync manager: start, length, mode and direction, status, activation, the slave's own byte.
#[test]
fn a_sync_manager_byte_by_byte() {
    let outputs = SyncManager::enabled(0x1100, 6, SmControl::OUTPUTS);
    assert_eq!(outputs.encode(), [0x00, 0x11, 6, 0, 0x64, 0, 1, 0]);
    assert_eq!((outputs.control.mode(), outputs.control.direction()), (BufferMode::Buffered, SmDirection::Write));
    assert!(outputs.control.contains(SmControl::WATCHDOG) && outputs.is_enabled());
    let boxes = [SmControl::MAILBOX_OUT, SmControl::MAILBOX_IN];
    assert_eq!(boxes.map(SmControl::mode), [BufferMode::Mailbox; 2]);
    assert_eq!(boxes.map(SmControl::direction), [SmDirection::Write, SmDirection::Read]);
    assert_eq!(SmControl::INPUTS.direction(), SmDirection::Read);
    assert_eq!((SmControl(0x0B).mode(), SmControl(0x0B).direction()), (BufferMode::Unknown, SmDirection::Unknown));
    let status = SmStatus::FULL.with_last_buffer(2);
    assert_eq!((status.0, status.last_buffer(), status.with_last_buffer(3).0), (0x28, 2, 0x38));
}

/// ECAT-2.6 The SII's control word: the command in bits 8 to 10; unknown commands survive.
#[test]
fn the_control_word_of_the_sii() {
    for (word, command) in [
        (0x0000, SiiCommand::None),
        (0x0100, SiiCommand::Read),
        (0x0201, SiiCommand::Write),
        (0x0400, SiiCommand::Reload),
        (0x0780, SiiCommand::Unknown(7)),
    ] {
        assert_eq!(SiiControl(word).command(), command);
        assert_eq!(SiiControl(word | 0x8000).with_command(SiiCommand::None).with_command(command).0, word | 0x8000);
    }
    assert!(SiiControl(0x8000).contains(SiiControl::BUSY) && SiiControl(0x40).contains(SiiControl::READS_8_BYTES));
}

/// ECAT-2.7 The system time difference is a magnitude, with bit 31 where the slave's own time is the smaller one.
#[test]
fn the_difference_of_system_times() {
    for (ahead_ns, word) in [(0, 0), (25, 25), (-25, 0x8000_0019), (i64::MAX, 0x7FFF_FFFF), (i64::MIN, 0xFFFF_FFFF)] {
        assert_eq!(SystemTimeDifference::of(ahead_ns).0, word);
    }
    assert_eq!([25, 0x8000_0019].map(|word| SystemTimeDifference(word).ahead_ns()), [25, -25]);
}

proptest! {
    /// ECAT-2.2, ECAT-2.4, ECAT-2.5 Registers are the same after they were encoded and decoded, whatever their bits are.
    #[test]
    fn registers_come_back(manager: [u8; 8], fmmu: [u8; 16], status: [u8; 6], word: u16) {
        prop_assert_eq!(SyncManager::decode(&manager).encode(), manager);
        let read = Fmmu::decode(&fmmu);
        prop_assert_eq!(Fmmu::decode(&read.encode()), read);
        prop_assert!(read.bits() <= 65_535 * 8);
        let read = AlStatusWithCode::decode(&status);
        prop_assert_eq!(AlStatusWithCode::decode(&read.encode()), read);
        prop_assert_eq!(RequestedState::from_code(word as u8).code(), word as u8 & 0x0F);
        prop_assert_eq!(SiiControl(word).with_command(SiiControl(word).command()).0, word);
    }
}
