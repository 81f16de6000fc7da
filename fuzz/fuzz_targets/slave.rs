//! Any SDO transfers, process data, states and faults to a slave of any kind: it answers or refuses, what it describes can be read,
//! and it stays within the diagrams of its states.

#![no_main]

use ecmsk::cia402::Statusword;
use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::ethercat::AlState;
use ecmsk::ethercat::registers::RequestedState;
use ecmsk::slave::{
    Channels, DeviceFault, Dp3cl, Drive, DriveConfig, Fault, Hsp, HspConfig, InputPattern, Io, Slave, SyncEvent,
};
use libfuzzer_sys::fuzz_target;

/// The longest value that a transfer carries here.
const VALUE_BYTES_MAX: usize = 64;
/// The longest process image of any kind.
const IMAGE_BYTES_MAX: usize = 64;

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, mut rest)) = bytes.split_first() else { return };
    let mut slave = slave(*kind);
    let _ = slave.enter(AlState::PreOp);
    while let Some((action, after)) = rest.split_first() {
        rest = act(&mut *slave, *action, after);
    }
});

fn slave(kind: u8) -> Box<dyn Slave> {
    match kind % 6 {
        0 => Box::<Dp3cl>::default(),
        1 => Box::new(Drive::new(DriveConfig::default())),
        2 => Box::new(Drive::new(DriveConfig::stepper())),
        3 => Box::new(Hsp::new(HspConfig::with(Channels::One))),
        4 => Box::new(Hsp::new(HspConfig::with(Channels::Two))),
        _ => Box::<Io>::default(),
    }
}

/// Takes `N` bytes; those that are missing are 0.
fn take<const N: usize>(bytes: &[u8]) -> ([u8; N], &[u8]) {
    let (here, rest) = bytes.split_at(bytes.len().min(N));
    let mut taken = [0; N];
    taken[..here.len()].copy_from_slice(here);
    (taken, rest)
}

/// Does one thing. The bytes that are left.
fn act<'a>(slave: &mut dyn Slave, action: u8, bytes: &'a [u8]) -> &'a [u8] {
    match action % 8 {
        0 | 1 => {
            let ([low, high, sub, len], rest) = take(bytes);
            // The next object that there is, so that most transfers meet one.
            let index = slave.object_from(u16::from_le_bytes([low, high])).unwrap_or(u16::MAX);
            let (value, rest) = rest.split_at(rest.len().min(usize::from(len) % VALUE_BYTES_MAX));
            let scope = if action & 0x80 == 0 { SdoScope::Entry } else { SdoScope::Complete };
            transfer(slave, ObjectAddress::new(index, sub % 40), scope, value);
            rest
        }
        2 => {
            let ([code, outputs, inputs], rest) = take(bytes);
            slave.set_sync_managers((outputs % 65).into(), (inputs % 65).into());
            let was = slave.state();
            match slave.request_state(RequestedState::from_code(code)) {
                Ok(()) => assert_eq!(slave.state() as u8, code % 16),
                Err(status) => assert!(slave.state() <= was && status.0 != 0 && slave.al_status() == status),
            }
            rest
        }
        3..=5 => {
            let (image, rest) = take::<12>(bytes);
            let mut outputs = [0; IMAGE_BYTES_MAX];
            outputs[..12].copy_from_slice(&image);
            slave.exchange((action & 0x80 == 0).then_some(&outputs), &mut [0; IMAGE_BYTES_MAX]);
            slave.step(u64::from(action) * 100_000);
            in_a_state(slave);
            rest
        }
        6 => {
            let ([what, axis, low, high], rest) = take(bytes);
            let (axis, bits) = (usize::from(axis % 3), u16::from_le_bytes([low, high]));
            slave.apply_fault(match what % 4 {
                0 => Fault::Alarm { axis, fault: DeviceFault { code: bits, resettable: what & 0x80 == 0 } },
                1 => Fault::Stick { axis, input: None, value: [None, Some(false), Some(true)][usize::from(low % 3)] },
                2 => Fault::Jam { axis, jammed: low & 1 != 0 },
                _ => Fault::ForceInputs { channel: axis, pattern: (high & 1 != 0).then_some(InputPattern::Bits(bits)) },
            });
            rest
        }
        _ => {
            let ([what], rest) = take(bytes);
            match what % 6 {
                0 => slave.restart(),
                1 => slave.expire_watchdog(),
                2 => slave.report_sync(SyncEvent::Deviation),
                3 => slave.report_sync(SyncEvent::LockLost),
                4 => slave.set_sync_cycle(Some(1_000_000)),
                _ => slave.set_sync_cycle(None),
            }
            rest
        }
    }
}

/// A download, then an upload: what is described has the length that it is said to have.
fn transfer(slave: &mut dyn Slave, at: ObjectAddress, scope: SdoScope, value: &[u8]) {
    let _ = slave.write(at, scope, value);
    let mut room = [0; 1024];
    let read = slave.read(at, scope, &mut room);
    if scope == SdoScope::Complete || slave.state() == AlState::Init {
        return;
    }
    let described = slave.describe_entry(at).map(|entry| usize::from(entry.bits).div_ceil(8));
    assert_eq!(read, described, "{at}");
}

/// The statusword shows a state of CiA 402.
fn in_a_state(slave: &mut dyn Slave) {
    if slave.state() == AlState::Init {
        return;
    }
    if let Ok(word) = slave.upload(ObjectAddress::new(0x6041, 0)) {
        assert!(Statusword(word.bits as u16).state().is_some(), "{:04X}", word.bits);
    }
}
