//! The simulated IO module as a slave: AL states, roles, objects, and outputs that come back as inputs.
use ecmsk::cia402::Mode;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::fieldbus::pdo::ProcessData;
use ecmsk::fieldbus::{AlState, AxisIn, AxisOut, MAX_AXES, Ns, Refusal, Role, SlaveConfig};
use ecmsk::sk::DriveSync;
use ecmsk::slave::{AlStatus, Io, IoConfig, Slave};

use AlState::*;

use crate::wired::{config, configure, exchange};

const MS: Ns = 1_000_000;

fn io_in(state: AlState) -> Io {
    let mut io = Io::new(IoConfig { serial: 0x1234, ..IoConfig::default() });
    for next in [PreOp, SafeOp, Op] {
        if next > state {
            break;
        }
        io.enter(next).expect("the state is open to it");
        if next == PreOp {
            configure(&mut io, &config(Role::Io)).expect("it is an IO module");
        }
    }
    io
}

/// One cycle: process data, then a millisecond. Says the inputs that were sent.
fn cycle(io: &mut Io, outputs: Option<u16>) -> u16 {
    let mut inputs = [AxisIn::default(); MAX_AXES];
    let outputs = outputs.map(|outputs| [AxisOut { outputs, ..AxisOut::default() }, AxisOut::default()]);
    let data = ProcessData::of(Role::Io, false).expect("16 and 16 lines");
    exchange(io, &data, outputs.as_ref(), &mut inputs);
    io.step(MS);
    inputs[0].inputs
}

fn read(io: &mut Io, index: u16, sub: u8) -> Result<(u8, u32), AbortCode> {
    io.upload(ObjectAddress::new(index, sub)).map(|value| (value.size, value.bits))
}

/// One step up, any way down, and no SafeOP without a configuration, which Init forgets and PreOP does not.
#[test]
fn al_states() {
    let all = [Init, PreOp, SafeOp, Op];
    for (n, from) in all.into_iter().enumerate() {
        for (m, to) in all.into_iter().enumerate() {
            let mut io = io_in(from);
            let expected = if m <= n + 1 { Ok(()) } else { Err(AlStatus(0x0011)) };
            assert_eq!(io.enter(to), expected, "{from:?} to {to:?}");
            assert_eq!(io.state(), if expected.is_ok() { to } else { from });
        }
    }
    let mut io = Io::default();
    io.enter(PreOp).unwrap();
    assert_eq!(io.enter(SafeOp), Err(AlStatus(0x001D)));
    let mut io = io_in(SafeOp);
    io.enter(PreOp).unwrap();
    io.enter(SafeOp).unwrap();
    io.enter(Init).unwrap();
    io.enter(PreOp).unwrap();
    assert_eq!(io.enter(SafeOp), Err(AlStatus(0x001D)));
    configure(&mut io, &config(Role::Io)).unwrap();
    configure(&mut io, &config(Role::Unused)).unwrap();
    assert_eq!(io.enter(SafeOp), Err(AlStatus(0x001D)), "not used");
}

/// SK-4.58 The module refuses to be configured as what it is not, and is configured in PreOP alone.
#[test]
fn roles() {
    let refused = |al_status| Err(Refusal { slave: 0, al_status, abort: None });
    let mut io = io_in(PreOp);
    for mode in [Mode::Csp, Mode::Csv, Mode::Cst] {
        for role in [Role::Drive(mode), Role::Step(Mode::Csp), Role::Hsp(Mode::Csp), Role::Hsp(Mode::Csv)] {
            assert_eq!(configure(&mut io, &config(role)), refused(0x001D), "{role:?}");
        }
    }
    for sync in [DriveSync::FreeRun, DriveSync::DcSync] {
        assert_eq!(configure(&mut io, &SlaveConfig { role: Role::Io, sync }), Ok(()));
    }
    for state in [Init, SafeOp, Op] {
        assert_eq!(configure(&mut io_in(state), &config(Role::Io)), refused(0x0011), "{state:?}");
    }
}

/// SK-7.7 The process data are 16 outputs and 16 inputs.
/// SK-6.12 The objects that programs look for in any slave are there; what cannot be written says so.
#[test]
fn objects() {
    let mut io = io_in(Init);
    assert_eq!(read(&mut io, 0x1000, 0), Err(AbortCode::TIMEOUT), "no mailbox");
    io.enter(PreOp).unwrap();
    assert_eq!(
        (read(&mut io, 0x1C12, 0), read(&mut io, 0x1C12, 1)),
        (Ok((1, 1)), Ok((2, 0x1600))),
        "mapped at power-on"
    );
    configure(&mut io, &config(Role::Io)).unwrap();
    assert_eq!(read(&mut io, 0x1000, 0), Ok((4, 0x0003_0191)), "device profile 401, inputs and outputs");
    assert_eq!(read(&mut io, 0x1001, 0), Ok((1, 0)));
    assert_eq!(read(&mut io, 0x1008, 0), Ok((4, u32::from_le_bytes(*b"IO16"))));
    assert_eq!(read(&mut io, 0x1018, 0), Ok((1, 4)));
    assert_eq!(read(&mut io, 0x1018, 4), Ok((4, 0x1234)));
    for (assign, pdo, object, area) in [(0x1C12, 0x1600, 0x7000, "outputs"), (0x1C13, 0x1A00, 0x6000, "inputs")] {
        assert_eq!((read(&mut io, assign, 0), read(&mut io, assign, 1)), (Ok((1, 1)), Ok((2, pdo.into()))), "{area}");
        let entry = object << 16 | 1 << 8 | 16;
        assert_eq!((read(&mut io, pdo, 0), read(&mut io, pdo, 1)), (Ok((1, 1)), Ok((4, entry))), "{area}");
        let object = object as u16;
        assert_eq!((read(&mut io, object, 0), read(&mut io, object, 1)), (Ok((1, 1)), Ok((2, 0))), "{area}");
        let refused = io.download(ObjectAddress::new(object, 1), SdoSize::Two, 1);
        assert_eq!(refused, Err(AbortCode::READ_ONLY), "{area}");
        assert_eq!(read(&mut io, object, 2), Err(AbortCode::NO_SUB_INDEX), "{area}");
    }
    assert_eq!(read(&mut io, 0x6060, 0), Err(AbortCode::NO_OBJECT), "it is no drive");
}

/// Output k comes back as input k a cycle later, and by SDO.
#[test]
fn inputs_follow_the_outputs() {
    let mut io = io_in(Op);
    assert_eq!((cycle(&mut io, Some(0)), io.outputs()), (0, 0));
    let mut last = 0;
    for bits in (0..16).map(|k| 1 << k).chain([0xFFFF, 0x0000, 0xA5C3]) {
        assert_eq!((cycle(&mut io, Some(bits)), io.outputs()), (last, bits));
        assert_eq!((read(&mut io, 0x7000, 1), read(&mut io, 0x6000, 1)), (Ok((2, bits.into())), Ok((2, bits.into()))));
        last = bits;
    }
}

/// Outside OP the outputs are off: before it, when it ends, and when outputs stay away for 100 ms, which ends it.
#[test]
fn outputs_are_off_outside_op() {
    let mut io = io_in(SafeOp);
    assert_eq!((cycle(&mut io, None), cycle(&mut io, Some(0xFFFF)), io.outputs()), (0, 0, 0), "SafeOP takes none");
    for state in [SafeOp, PreOp, Init] {
        let mut io = io_in(Op);
        cycle(&mut io, Some(0xFFFF));
        io.enter(state).unwrap();
        assert_eq!((io.outputs(), cycle(&mut io, None), cycle(&mut io, None)), (0, 0xFFFF, 0), "{state:?}");
    }
    let mut io = io_in(Op);
    cycle(&mut io, Some(0xFFFF));
    let held = (0..1000).take_while(|_| {
        io.step(MS);
        io.outputs() == 0xFFFF
    });
    assert!((98..=101).contains(&held.count()), "the watchdog");
    assert_eq!((io.state(), io.outputs(), cycle(&mut io, None)), (SafeOp, 0, 0));
}
