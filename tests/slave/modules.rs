//! Common properties of the simulated modules and drives: names, clocks, forced inputs, the error register.

use ecmsk::cia402::Mode;
use ecmsk::coe::ObjectAddress;
use ecmsk::fieldbus::{AlState, Ns, Role};
use ecmsk::slave::{
    Channels, DeviceFault, Drive, DriveConfig, Fault, HomeSwitch, Hsp, HspConfig, InputPattern, Io, IoConfig, Slave,
};

use crate::wired::{alarm, exchange, force, in_preop, map};

const MS: Ns = 1_000_000;

fn read(slave: &mut impl Slave, index: u16, sub: u8) -> u32 {
    slave.upload(ObjectAddress::new(index, sub)).expect("the object is there").bits
}

/// Names are those that a link's `slaves=` has, or the user's.
#[test]
fn names() {
    let hsp = |channels| Hsp::new(HspConfig::with(channels));
    let names = [
        Drive::new(DriveConfig::default()).name().to_owned(),
        Drive::new(DriveConfig::stepper()).name().to_owned(),
        hsp(Channels::One).name().to_owned(),
        hsp(Channels::Two).name().to_owned(),
        Io::new(IoConfig { name: "panel".into(), ..IoConfig::default() }).name().to_owned(),
    ];
    assert_eq!(names, ["drive", "step", "hsp", "hsp2", "panel"]);
}

/// SK-11.5 Drives and pulse modules have distributed clocks, digital IO has none.
#[test]
fn distributed_clocks() {
    assert!(Drive::new(DriveConfig::default()).has_dc());
    assert!(Hsp::new(HspConfig::with(Channels::One)).has_dc());
    assert!(!Io::new(IoConfig::default()).has_dc());
}

/// 0x6000:1 of an IO module after a millisecond.
fn inputs(io: &mut Io) -> u32 {
    io.step(MS);
    read(io, 0x6000, 1)
}

/// Inputs are forced to a pattern, or walk, or are wired to the outputs again.
#[test]
fn inputs_of_a_module_are_forced() {
    let mut io = in_preop(Io::new(IoConfig::default()));
    assert_eq!(inputs(&mut io), 0);
    assert!(io.apply_fault(force(0xA5C3)));
    assert_eq!([inputs(&mut io), inputs(&mut io)], [0xA5C3; 2]);
    assert!(io.apply_fault(Fault::ForceInputs { channel: 0, pattern: Some(InputPattern::Walk { step_ns: 2 * MS }) }));
    let walk: Vec<u32> = (0..34).map(|_| inputs(&mut io)).collect();
    let expected: Vec<u32> = (0..34).map(|n| 1 << (n / 2 % 16)).collect();
    assert_eq!(walk, expected);
    assert!(
        io.apply_fault(Fault::ForceInputs { channel: 0, pattern: Some(InputPattern::Walk { step_ns: 0 }) }),
        "every nanosecond is the fastest"
    );
    let fastest: Vec<u32> = (0..5)
        .map(|_| {
            io.step(3);
            read(&mut io, 0x6000, 1)
        })
        .collect();
    assert_eq!(fastest, [1, 1 << 3, 1 << 6, 1 << 9, 1 << 12]);
    assert!(io.apply_fault(Fault::ForceInputs { channel: 0, pattern: None }));
    assert_eq!(inputs(&mut io), 0);
    assert!(
        !io.apply_fault(Fault::ForceInputs { channel: 1, pattern: Some(InputPattern::Bits(1)) }),
        "it has one channel"
    );
    assert_eq!(inputs(&mut io), 0);
}

/// A channel of a pulse module is forced independently; a drive has no channel.
#[test]
fn inputs_of_channels() {
    for (channels, count) in [(Channels::One, 1), (Channels::Two, 2)] {
        let mut hsp = in_preop(Hsp::new(HspConfig::with(channels)));
        for channel in 0..3 {
            let pattern = InputPattern::Bits(0x0101 << channel);
            assert_eq!(
                hsp.apply_fault(Fault::ForceInputs { channel, pattern: Some(pattern) }),
                channel < count,
                "{channels:?} {channel}"
            );
        }
        let data = map(&mut hsp, Role::Hsp(Mode::Csp));
        let mut seen = Default::default();
        hsp.enter(AlState::SafeOp).unwrap();
        hsp.step(MS);
        exchange(&mut hsp, &data, None, &mut seen);
        let expected = if count == 2 { [0x0101, 0x0202] } else { [0x0101, 0] };
        assert_eq!(seen.map(|axis| axis.inputs), expected, "{channels:?}");
    }
    assert!(!Drive::new(DriveConfig::default()).apply_fault(force(1)));
}

/// CiA 301 7.5.2.2 The error register has bit 0 for any error, and the bit of its group.
#[test]
fn error_registers() {
    for (code, expected) in [
        (0x1000, 0x21), // generic
        (0x2310, 0x03), // current
        (0x3210, 0x05), // voltage
        (0x4310, 0x09), // temperature
        (0x8110, 0x11), // communication
        (0x81FF, 0x11),
        (0x8200, 0x21), // of the profile, as are the others
        (0x8611, 0x21),
        (0x7305, 0x21),
        (0xFF01, 0x81), // the maker's own
    ] {
        let mut drive = in_preop(Drive::new(DriveConfig::default()));
        assert!(drive.apply_fault(alarm(code)));
        drive.step(MS);
        assert_eq!(read(&mut drive, 0x603F, 0), u32::from(code));
        assert_eq!(read(&mut drive, 0x1001, 0), expected, "{code:#06x}");
    }
    let mut hsp = in_preop(Hsp::new(HspConfig::with(Channels::Two)));
    for (axis, code) in [(0, 0x2310), (1, 0x3210)] {
        assert!(hsp.apply_fault(Fault::Alarm { axis, fault: DeviceFault { code, resettable: true } }));
    }
    hsp.step(MS);
    assert_eq!(read(&mut hsp, 0x1001, 0), 0x07, "the register is of both axes");
}

/// The stepper is a stepper: its motor's steps per turn, and switches along some turns of it.
#[test]
fn the_stepper_by_default() {
    let (servo, stepper) = (DriveConfig::default(), DriveConfig::stepper());
    assert_eq!(servo.motor.counts_per_turn, 1 << 17);
    assert_eq!(stepper.motor.counts_per_turn, 10_000);
    let cam = HomeSwitch::Cam { first: -2500, last: 2500 };
    assert_eq!((stepper.travel.home, stepper.travel.search_limit), (Some(cam), 1_000_000), "half a turn; 100 turns");
    let turns = |config: &DriveConfig| {
        let limits = [config.travel.negative_limit, config.travel.positive_limit];
        limits.map(|limit| limit.expect("it is wired") / i64::from(config.motor.counts_per_turn))
    };
    assert_eq!(turns(&servo), turns(&stepper));
    assert!(turns(&stepper)[0] < turns(&stepper)[1]);
}
