//! The process data that the examples and packages of other masters map on a CiA 402 drive, each written as that master writes it,
//! up to OP; and the objects of CiA 402 that they read and write beside them.
//!
//! Facts of the examples of ethercrab (`ec400`, `c5-e`, `akd`), of programs for IgH's master as `ethercat cstruct` prints them,
//! of the configurations of ROS 2's generic CiA 402 driver, and of SOEM's own mapping.

use ecmsk::cia402::{Controlword, DriveState, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope, SdoSize};
use ecmsk::ethercat::AlState;
use ecmsk::slave::{Channels, Drive, DriveConfig, Hsp, HspConfig, Io, ManufacturerObjects, Slave};

use AlState::*;

/// One master's map: PDOs with their entries, outputs first.
struct Map {
    name: &'static str,
    rx: &'static [(u16, &'static [u32])],
    tx: &'static [(u16, &'static [u32])],
    /// The maker's objects among the entries, as in a file of objects.
    makers: &'static str,
}

#[rustfmt::skip]
const MAPS: &[Map] = &[
    Map {
        name: "ethercrab ec400, c5-e: CSV with velocity",
        rx: &[(0x1600, &[0x6040_0010, 0x60FF_0020])],
        tx: &[(0x1A00, &[0x6041_0010, 0x6064_0020, 0x606C_0020])],
        makers: "",
    },
    Map {
        name: "IgH, EPOS4 in CSP",
        rx: &[(0x1600, &[0x6040_0010, 0x607A_0020, 0x60B0_0020, 0x60B2_0010, 0x6060_0008, 0x60FE_0120])],
        tx: &[(0x1A00, &[0x6041_0010, 0x6064_0020, 0x606C_0020, 0x6077_0010, 0x6061_0008, 0x60FD_0020, 0x603F_0010])],
        makers: "",
    },
    Map {
        name: "IgH, EPOS4 in CSV",
        rx: &[(0x1600, &[0x6040_0010, 0x60FF_0020, 0x60B1_0020, 0x6060_0008, 0x60FE_0120, 0x607D_0120, 0x607D_0220])],
        tx: &[(0x1A00, &[0x6041_0010, 0x6064_0020, 0x606C_0020, 0x6077_0010, 0x6061_0008, 0x60FD_0020, 0x603F_0010])],
        makers: "",
    },
    Map {
        name: "IgH, a servo drive with profile objects and a touch probe",
        rx: &[(0x1600, &[
            0x6040_0010, 0x6060_0008, 0x607A_0020, 0x6081_0020, 0x6083_0020, 0x6084_0020, 0x60FF_0020,
            0x6071_0010, 0x60B8_0010, 0x60FE_0120,
        ])],
        tx: &[(0x1A00, &[
            0x6041_0010, 0x2100_0010, 0x6064_0020, 0x606C_0020, 0x6077_0010, 0x60F4_0020, 0x60B9_0010,
            0x60BA_0020, 0x60BB_0020, 0x60FD_0020, 0x1001_0008, 0x0000_0008,
        ])],
        makers: "0x2100:0 u16 ro tx 1 Status word 1\n",
    },
    Map {
        name: "IgH, a stepper drive with both digital outputs and all touch probes",
        rx: &[(0x1600, &[
            0x6040_0010, 0x6060_0008, 0x607A_0020, 0x60B8_0010, 0x60FE_0120, 0x60FE_0220, 0x6081_0020,
            0x6082_0020, 0x6083_0020, 0x6084_0020,
        ])],
        tx: &[(0x1A00, &[
            0x603F_0010, 0x6041_0010, 0x6061_0008, 0x6064_0020, 0x60B9_0010, 0x60BA_0020, 0x60BB_0020,
            0x60BC_0020, 0x60BD_0020, 0x60FD_0020,
        ])],
        makers: "",
    },
    Map {
        name: "IgH, a servo drive with every limit and a gap",
        rx: &[(0x1600, &[
            0x607A_0020, 0x60FF_0020, 0x6071_0010, 0x6072_0010, 0x6040_0010, 0x6060_0008, 0x0000_0008,
            0x6081_0020, 0x6083_0020, 0x6084_0020, 0x6085_0020,
        ])],
        tx: &[(0x1A00, &[
            0x6064_0020, 0x60F4_0020, 0x6077_0010, 0x6041_0010, 0x6061_0008, 0x0000_0008, 0x606C_0020,
            0x6079_0020, 0x6078_0010, 0x3611_0010, 0x603F_0010,
        ])],
        makers: "0x3611:0 u16 ro tx 0 Extra status\n",
    },
    Map {
        name: "IgH, all targets with their offsets",
        rx: &[(0x1600, &[0x6040_0010, 0x607A_0020, 0x60FF_0020, 0x60B1_0020, 0x60B2_0010, 0x6071_0010, 0x6060_0008])],
        tx: &[(0x1A00, &[0x6041_0010, 0x6064_0020, 0x60F4_0020, 0x606C_0020, 0x6077_0010, 0x6061_0008])],
        makers: "",
    },
    Map {
        name: "three PDOs of each direction, with the maker's objects among them",
        rx: &[
            (0x1600, &[0x6040_0010, 0x6060_0008, 0x6071_0010, 0x607A_0020, 0x60FF_0020, 0x60B2_0010, 0x2701_0020]),
            (0x1601, &[0x60FE_0120, 0x60FE_0220]),
            (0x1602, &[0x2703_0020, 0x60B1_0020]),
        ],
        tx: &[
            (0x1A00, &[0x6041_0010, 0x6061_0008, 0x6064_0020, 0x606C_0020, 0x6077_0010]),
            (0x1A01, &[0x2401_0010, 0x2402_0010, 0x2403_0010, 0x2404_0010, 0x2702_0020]),
            (0x1A02, &[0x60FD_0020]),
        ],
        makers: "0x2701:0 u32 rw rx 0 Tuning command\n0x2703:0 u32 rw rx 0 User MOSI\n0x2401:0 u16 ro tx 11 Analog 1\n\
                 0x2402:0 u16 ro tx 12 Analog 2\n0x2403:0 u16 ro tx 13 Analog 3\n0x2404:0 u16 ro tx 14 Analog 4\n\
                 0x2702:0 u32 ro tx 15 Tuning status\n",
    },
    Map {
        name: "ROS 2, EPOS4: the fourth PDOs",
        rx: &[(
            0x1603,
            &[0x6040_0010, 0x607A_0020, 0x60FF_0020, 0x6071_0010, 0x60B0_0020, 0x60B1_0020, 0x60B2_0010, 0x6060_0008],
        )],
        tx: &[(0x1A03, &[
            0x6041_0010, 0x6064_0020, 0x606C_0020, 0x6077_0010, 0x6061_0008, 0x3141_0110, 0x60B9_0010,
            0x60BA_0020, 0x60BB_0020,
        ])],
        makers: "0x3141:1 i16 ro tx 0 Digital inputs\n",
    },
    Map {
        name: "ROS 2, the driver's own test: the eighth PDOs",
        rx: &[(0x1607, &[0x607A_0020, 0x60FF_0020, 0x6071_0010, 0x6072_0010, 0x6040_0010, 0x6060_0008])],
        tx: &[(0x1A07, &[0x6064_0020, 0x606C_0020, 0x6077_0010, 0x6041_0010, 0x6061_0008])],
        makers: "",
    },
    Map {
        name: "ROS 2, two PDOs of each direction",
        rx: &[(0x1600, &[0x6040_0010, 0x607A_0020]), (0x1601, &[0x6060_0008, 0x60FF_0020])],
        tx: &[(0x1A00, &[0x6041_0010, 0x6064_0020]), (0x1A01, &[0x6061_0008, 0x606C_0020])],
        makers: "",
    },
];

fn write(slave: &mut dyn Slave, index: u16, sub: u8, value: &[u8]) -> Result<(), AbortCode> {
    slave.write(ObjectAddress::new(index, sub), SdoScope::Entry, value)
}

fn read(slave: &mut dyn Slave, index: u16, sub: u8) -> Result<u32, AbortCode> {
    slave.upload(ObjectAddress::new(index, sub)).map(|value| value.bits)
}

/// Writes a map as masters do: both assignments 0, each PDO, then the assignments. Returns the lengths of the images,
/// bytes.
fn map(slave: &mut dyn Slave, map: &Map) -> [usize; 2] {
    let mut lens = [0; 2];
    for (assignment, pdos, len) in [(0x1C12, map.rx, 0), (0x1C13, map.tx, 1)] {
        let of = |what: &str| format!("{}: {what}", map.name);
        assert_eq!(write(slave, assignment, 0, &[0]), Ok(()), "{}", of("assignment"));
        let mut bits = 0;
        for (place, (pdo, entries)) in (1..).zip(pdos) {
            assert_eq!(write(slave, *pdo, 0, &[0]), Ok(()), "{}", of(&format!("0x{pdo:04X}:0")));
            for (sub, entry) in (1..).zip(*entries) {
                let written = write(slave, *pdo, sub, &entry.to_le_bytes());
                assert_eq!(written, Ok(()), "{}", of(&format!("0x{pdo:04X}:{sub} = 0x{entry:08X}")));
                bits += entry & 0xFF;
            }
            assert_eq!(write(slave, *pdo, 0, &[entries.len() as u8]), Ok(()), "{}", of("count"));
            assert_eq!(write(slave, assignment, place, &pdo.to_le_bytes()), Ok(()), "{}", of("assigned"));
        }
        assert_eq!(write(slave, assignment, 0, &[pdos.len() as u8]), Ok(()), "{}", of("count"));
        lens[len] = bits.div_ceil(8) as usize;
    }
    lens
}

fn drive_with(makers: &str) -> Drive {
    let mut drive = Drive::new(DriveConfig::default());
    if !makers.is_empty() {
        drive.add_manufacturer_objects(ManufacturerObjects::parse(makers).expect("a file"));
    }
    drive.enter(PreOp).expect("open");
    drive
}

/// Writes a value at the position of a map's entry in its image.
fn put(image: &mut [u8], pdos: &[(u16, &[u32])], object: u32, value: u64) {
    let mut bit = 0;
    for entry in pdos.iter().flat_map(|(_, entries)| *entries) {
        let bits = (entry & 0xFF) as usize;
        if entry >> 8 == object {
            for n in 0..bits {
                let mask = 1 << ((bit + n) % 8);
                let is_set = value >> n & 1 != 0;
                let byte = &mut image[(bit + n) / 8];
                *byte = if is_set { *byte | mask } else { *byte & !mask };
            }
        }
        bit += bits;
    }
}

fn get(image: &[u8], pdos: &[(u16, &[u32])], object: u32) -> Option<u64> {
    let mut bit = 0;
    for entry in pdos.iter().flat_map(|(_, entries)| *entries) {
        let bits = (entry & 0xFF) as usize;
        if entry >> 8 == object {
            return Some(
                (0..bits).fold(0, |value, n| value | u64::from(image[(bit + n) / 8] >> ((bit + n) % 8) & 1) << n),
            );
        }
        bit += bits;
    }
    None
}

/// SK-7.57 Each map is accepted, and the drive is enabled with it and shows its position.
#[test]
fn maps_of_other_masters_are_taken() {
    for wanted in MAPS {
        let mut drive = drive_with(wanted.makers);
        let [out, back] = map(&mut drive, wanted);
        drive.set_sync_managers(out as u16, back as u16);
        drive.enter(SafeOp).unwrap_or_else(|status| panic!("{}: {status}", wanted.name));
        drive.enter(Op).unwrap_or_else(|status| panic!("{}: {status}", wanted.name));
        let (mut outputs, mut inputs) = (vec![0; out], vec![0; back]);
        put(&mut outputs, wanted.rx, 0x0060_7200, 3000);
        put(&mut outputs, wanted.rx, 0x0060_7D01, u64::from(i32::MIN as u32));
        put(&mut outputs, wanted.rx, 0x0060_7D02, u64::from(i32::MAX as u32));
        for (object, value) in [(0x0060_8100, 1), (0x0060_8300, 1), (0x0060_8400, 1), (0x0060_8500, 1)] {
            put(&mut outputs, wanted.rx, object, value);
        }
        for word in [Controlword::SHUTDOWN, Controlword::SWITCH_ON, Controlword::ENABLE_OPERATION] {
            put(&mut outputs, wanted.rx, 0x0060_4000, word.0.into());
            for _ in 0..300 {
                drive.exchange(Some(&outputs), &mut inputs);
                drive.step(1_000_000);
            }
        }
        let word = Statusword(get(&inputs, wanted.tx, 0x0060_4100).expect("a statusword") as u16);
        assert_eq!(word.state(), Some(DriveState::OperationEnabled), "{}", wanted.name);
        let position = get(&inputs, wanted.tx, 0x0060_6400).expect("a position") as u32;
        assert_eq!(position, read(&mut drive, 0x6064, 0).unwrap(), "{}", wanted.name);
        for (object, value) in [(0x0024_0100, 11), (0x0024_0400, 14), (0x0027_0200, 15), (0x0021_0000, 1)] {
            if let Some(found) = get(&inputs, wanted.tx, object) {
                assert_eq!(found, value, "{}: an object of the maker", wanted.name);
            }
        }
    }
}

/// SK-7.57 Every CiA 402 axis but a DP3CL, which is as its maker has it, has the first three PDOs of each direction, with
/// 0x60FE:1 among what they take.
#[test]
fn each_drive_has_three_pdos_of_each_direction() {
    const WANTED: Map = Map {
        name: "",
        rx: &[(0x1600, &[0x6040_0010, 0x607A_0020]), (0x1601, &[0x60FE_0120]), (0x1602, &[0x6060_0008])],
        tx: &[(0x1A00, &[0x6041_0010]), (0x1A01, &[0x6064_0020]), (0x1A02, &[0x606B_0020, 0x6061_0008])],
        makers: "",
    };
    let hsp = |channels| Box::new(Hsp::new(HspConfig::with(channels))) as Box<dyn Slave>;
    let slaves = [
        Box::new(Drive::new(DriveConfig::default())),
        Box::new(Drive::new(DriveConfig::stepper())),
        hsp(Channels::One),
        hsp(Channels::Two),
    ];
    for mut slave in slaves {
        slave.enter(PreOp).expect("open");
        let [out, back] = map(&mut *slave, &WANTED);
        slave.set_sync_managers(out as u16, back as u16);
        assert_eq!((slave.enter(SafeOp), slave.enter(Op)), (Ok(()), Ok(())), "{}", slave.name());
        let mut inputs = vec![0; back];
        slave.exchange(Some(&[6, 0, 0, 0, 0, 0, 0xA5, 0x5A, 0, 0, 8]), &mut inputs);
        assert_eq!(read(&mut *slave, 0x60FE, 1), Ok(0x5AA5), "{}", slave.name());
    }
}

/// SK-6.12 The mandatory objects of CiA 402-2 and ETG.6010 for the modes of a drive, and those that masters usually
/// read: each can be read, with its size; an entry of RxPDOs or TxPDOs can be mapped.
/// SK-7.58 Among them the demands of velocity and torque, 0x606B and 0x6074.
#[test]
fn objects_of_the_profile() {
    /// Sub-index, bytes, and whether it is an entry of RxPDOs, of TxPDOs or of none.
    const OBJECTS: &[(u8, u8, char, &[u16])] = &[
        (0, 1, 'r', &[0x6060, 0x607E, 0x6098]),
        (0, 1, 't', &[0x1001, 0x6061]),
        (0, 2, '-', &[0x605A, 0x605B, 0x605C, 0x605D, 0x605E]),
        (
            0,
            2,
            'r',
            &[
                0x6040, 0x6066, 0x6068, 0x606D, 0x606E, 0x606F, 0x6070, 0x6071, 0x6072, 0x6073, 0x6086, 0x60B2, 0x60B8,
                0x60E0, 0x60E1, 0x60F2,
            ],
        ),
        (0, 2, 't', &[0x603F, 0x6041, 0x6074, 0x6077, 0x6078, 0x60B9]),
        (0, 3, '-', &[0x1009, 0x100A]),
        (0, 4, '-', &[0x1000, 0x1008, 0x6075, 0x6076, 0x607C, 0x6080, 0x6502]),
        (
            0,
            4,
            'r',
            &[
                0x6065, 0x6067, 0x607A, 0x607F, 0x6081, 0x6082, 0x6083, 0x6084, 0x6085, 0x6087, 0x609A, 0x60B0, 0x60B1,
                0x60C5, 0x60C6, 0x60FF,
            ],
        ),
        (0, 4, 't', &[0x6062, 0x6063, 0x6064, 0x606B, 0x606C, 0x6079, 0x60BA, 0x60BD, 0x60F4, 0x60FC, 0x60FD]),
        (1, 1, '-', &[0x60C2]),
        (1, 4, '-', &[0x1018, 0x608F, 0x6091, 0x6092]),
        (1, 4, 'r', &[0x607D, 0x6099, 0x60FE]),
        (2, 1, '-', &[0x60C2]),
        (2, 4, '-', &[0x608F, 0x6091, 0x6092]),
        (2, 4, 'r', &[0x607D, 0x6099, 0x60FE]),
    ];
    let mut drive = drive_with("");
    let all =
        OBJECTS.iter().flat_map(|(sub, bytes, mapping, all)| all.iter().map(|index| (*index, *sub, *bytes, *mapping)));
    for (index, sub, bytes, mapping) in all {
        let len = drive.read(ObjectAddress::new(index, sub), SdoScope::Entry, &mut [0; 64]);
        let is_text = matches!(index, 0x1008..=0x100A);
        assert!(len.is_ok_and(|len| len == usize::from(bytes) || is_text && len >= 3), "0x{index:04X}:{sub}: {len:?}");
        let entry = u32::from(index) << 16 | u32::from(sub) << 8 | (u32::from(bytes) * 8);
        for (pdo, letter) in [(0x1600, 'r'), (0x1A00, 't')] {
            write(&mut drive, pdo, 0, &[0]).expect("PreOP");
            let taken = write(&mut drive, pdo, 1, &entry.to_le_bytes()).is_ok();
            assert_eq!(taken, mapping == letter, "0x{index:04X}:{sub} in 0x{pdo:04X}");
        }
    }
}

/// SK-7.58 A drive refuses functions that it does not have: a polarity, a gear, a touch probe.
#[test]
fn what_would_change_the_motion_is_refused() {
    let mut drive = drive_with("");
    for (index, sub, value) in [
        (0x607E, 0, &[0x80][..]),
        (0x6086, 0, &[3, 0]),
        (0x6091, 1, &[2, 0, 0, 0]),
        (0x6091, 2, &[10, 0, 0, 0]),
        (0x60B8, 0, &[0x11, 0]),
    ] {
        assert_eq!(write(&mut drive, index, sub, value), Err(AbortCode::VALUE_HIGH), "0x{index:04X}:{sub}");
    }
    for (index, sub, value) in [(0x607E, 0, &[0][..]), (0x6091, 1, &[1, 0, 0, 0]), (0x60B8, 0, &[0, 0])] {
        assert_eq!(write(&mut drive, index, sub, value), Ok(()), "0x{index:04X}:{sub}");
    }
}

/// A drive that is enabled in a mode, with the target of that mode mapped.
fn enabled(mode: u8, target: u32) -> Drive {
    let mut drive = drive_with("");
    write(&mut drive, 0x6060, 0, &[mode]).expect("it has the mode");
    for (pdo, entries) in [(0x1600, [0x6040_0010, target]), (0x1A00, [0x6041_0010, 0x6064_0020])] {
        write(&mut drive, pdo, 0, &[0]).expect("PreOP");
        for (sub, entry) in (1..).zip(entries) {
            write(&mut drive, pdo, sub, &entry.to_le_bytes()).expect("it can be mapped");
        }
        write(&mut drive, pdo, 0, &[2]).expect("PreOP");
    }
    drive.set_sync_managers(2 + (target & 0xFF) as u16 / 8, 6);
    drive.enter(SafeOp).expect("mapped");
    drive.enter(Op).expect("mapped");
    for word in [0x06, 0x07, 0x0F] {
        run(&mut drive, word, 0, 300);
    }
    drive
}

fn run(drive: &mut Drive, controlword: u16, target: i32, cycles: u32) {
    let mut outputs = controlword.to_le_bytes().to_vec();
    outputs.extend(target.to_le_bytes());
    for _ in 0..cycles {
        drive.exchange(Some(&outputs), &mut [0; 6]);
        drive.step(1_000_000);
    }
}

/// SK-7.58 0x60B0 is added to the target of CSP, 0x60B1 to that of CSV, 0x60B2 to that of CST; 0x606B and 0x6074 show
/// the demands of the loops.
#[test]
fn offsets_are_added_and_demands_shown() {
    let mut drive = enabled(8, 0x607A_0020);
    write(&mut drive, 0x60B0, 0, &500_i32.to_le_bytes()).unwrap();
    run(&mut drive, 0x0F, 1000, 500);
    assert_eq!((read(&mut drive, 0x6062, 0), read(&mut drive, 0x607A, 0)), (Ok(1500), Ok(1000)));
    assert!((1499..=1501).contains(&drive.axis().position()));
    for n in 1..=200 {
        run(&mut drive, 0x0F, 1000 + 100 * n, 1);
    }
    assert_eq!(read(&mut drive, 0x606B, 0), Ok(100_000), "100 counts in each millisecond");
    run(&mut drive, 0x0F, 21_000, 500);
    assert_eq!(read(&mut drive, 0x606B, 0), Ok(0), "it stands");
    // In another mode, and back, the axis holds its position, whatever the offset.
    for mode in [9, 8] {
        write(&mut drive, 0x6060, 0, &[mode]).unwrap();
        drive.step(1_000_000);
    }
    let at = drive.axis().position();
    assert_eq!(read(&mut drive, 0x607A, 0), Ok((at - 500) as u32));
    let mut drive = enabled(9, 0x60FF_0020);
    write(&mut drive, 0x60B1, 0, &(-20_000_i32).to_le_bytes()).unwrap();
    run(&mut drive, 0x0F, 50_000, 500);
    assert_eq!((read(&mut drive, 0x606B, 0), read(&mut drive, 0x60FF, 0)), (Ok(30_000), Ok(50_000)));
    assert!((29_900.0..30_100.0).contains(&drive.axis().plant().velocity()));
    let mut drive = enabled(10, 0x6071_0010);
    write(&mut drive, 0x60B2, 0, &100_i16.to_le_bytes()).unwrap();
    drive.exchange(Some(&[0x0F, 0, 50, 0]), &mut [0; 6]);
    drive.step(1_000_000);
    assert_eq!((read(&mut drive, 0x6077, 0), read(&mut drive, 0x6074, 0)), (Ok(150), Ok(150)));
}

/// SK-7.58 The lowest of the three limits of the torque is in force.
#[test]
fn torque_limits() {
    for limit in [0x6072, 0x60E0, 0x60E1] {
        let mut drive = enabled(10, 0x6071_0010);
        write(&mut drive, limit, 0, &200_u16.to_le_bytes()).unwrap();
        drive.exchange(Some(&[0x0F, 0, 0xF4, 0x01]), &mut [0; 6]);
        drive.step(1_000_000);
        assert_eq!(read(&mut drive, 0x6077, 0), Ok(200), "0x{limit:04X}");
    }
}

/// SK-7.47 Objects of a file are mapped where the file says so: outputs are stored, inputs sent, bits of a `bool` and of a short `u8`
/// lie one behind the other, on any kind of slave.
#[test]
fn objects_of_a_file_are_mapped() {
    let file = "0x2000:1 u16 rw rx 0 Out\n0x2000:2 i32 rw tx -2 In\n0x2000:3 bool rw rxtx 0 Bit\n0x2000:4 u8 rw rx 0 Three bits\n\
                0x2000:5 f32 rw rx 0 Real\n0x2001:0 u32 rw 7 Neither\n0x2002:0 text rw rx \"abc\" Text\n0x2003:0 u64 ro tx 9 Long\n";
    let wanted = Map {
        name: "an IO slave with objects of a file",
        rx: &[(0x1600, &[0x2000_0301, 0x2000_0403, 0x0000_0004, 0x2000_0110, 0x2000_0520, 0x7000_0110])],
        tx: &[(0x1A00, &[0x2000_0220, 0x2000_0301, 0x0000_0007, 0x2003_0040, 0x6000_0110])],
        makers: file,
    };
    let mut io = Io::default();
    io.add_manufacturer_objects(ManufacturerObjects::parse(file).expect("a file"));
    io.enter(PreOp).expect("open");
    for (pdo, entry, code) in [
        (0x1600, 0x2000_0220, AbortCode::NOT_MAPPABLE),
        (0x1A00, 0x2000_0110, AbortCode::NOT_MAPPABLE),
        (0x1600, 0x2000_0120, AbortCode::NOT_MAPPABLE),
        (0x1600, 0x2001_0020, AbortCode::NOT_MAPPABLE),
        (0x1600, 0x2002_0018, AbortCode::NOT_MAPPABLE),
        (0x1600, 0x2000_0910, AbortCode::NO_SUB_INDEX),
        (0x1600, 0x2004_0010, AbortCode::NO_OBJECT),
    ] {
        write(&mut io, pdo, 0, &[0]).expect("PreOP");
        assert_eq!(write(&mut io, pdo, 1, &u32::to_le_bytes(entry)), Err(code), "0x{entry:08X}");
    }
    let [out, back] = map(&mut io, &wanted);
    assert_eq!([out, back], [9, 15]);
    io.set_sync_managers(9, 15);
    assert_eq!((io.enter(SafeOp), io.enter(Op)), (Ok(()), Ok(())));
    let mut inputs = [0xFF; 15];
    let outputs = [0b0000_1011, 0x34, 0x12, 0, 0, 0xC0, 0x3F, 0xAA, 0x55];
    for _ in 0..2 {
        io.exchange(Some(&outputs), &mut inputs);
        io.step(1_000_000);
    }
    assert_eq!(
        [1, 3, 4, 5].map(|sub| read(&mut io, 0x2000, sub)),
        [Ok(0x1234), Ok(1), Ok(0b101), Ok(1.5_f32.to_bits())]
    );
    io.exchange(Some(&outputs), &mut inputs);
    assert_eq!(inputs[..5], [0xFE, 0xFF, 0xFF, 0xFF, 1], "the number, the bit that is an output too, and no padding");
    assert_eq!(inputs[5..13], 9_u64.to_le_bytes());
    assert_eq!(inputs[13..], [0xAA, 0x55], "its own inputs");
    io.download(ObjectAddress::new(0x2000, 2), SdoSize::Four, 77).expect("it can be written");
    io.exchange(Some(&outputs), &mut inputs);
    assert_eq!(inputs[..4], 77_i32.to_le_bytes());
    let listed = |index, access| {
        let entry =
            io.describe_entry(ObjectAddress::new(index, if index == 0x2000 { 3 } else { 0 })).expect("it is there");
        entry.access.contains(access)
    };
    let (rx, tx) = (ecmsk::coe::ObjectAccess::RX_MAPPABLE, ecmsk::coe::ObjectAccess::TX_MAPPABLE);
    assert!(listed(0x2000, rx) && listed(0x2000, tx) && !listed(0x2001, rx) && !listed(0x2002, rx));
}

/// SK-7.47 A text of a file is read and written whole, whatever its length.
#[test]
fn texts_of_a_file_are_whole() {
    let long = "x".repeat(300);
    let file = format!(
        "0x2010:0 text rw \"twenty-four letters long\" Nickname\n0x2011:0 text ro \"{long}\"\n0x2012:0 text rw - Empty\n"
    );
    let mut drive = drive_with(&file);
    let whole = |drive: &mut Drive, index| {
        let mut value = [0xEE; 512];
        let len = drive.read(ObjectAddress::new(index, 0), SdoScope::Entry, &mut value).expect("it can be read");
        value[..len].to_vec()
    };
    assert_eq!(whole(&mut drive, 0x2010), b"twenty-four letters long");
    assert_eq!(whole(&mut drive, 0x2011), long.as_bytes());
    assert_eq!(whole(&mut drive, 0x2012), b"");
    for text in ["a", "nine byte", &long, ""] {
        assert_eq!(write(&mut drive, 0x2010, 0, text.as_bytes()), Ok(()));
        assert_eq!(whole(&mut drive, 0x2010), text.as_bytes());
    }
    assert_eq!(write(&mut drive, 0x2011, 0, b"a"), Err(AbortCode::READ_ONLY));
    assert_eq!(write(&mut drive, 0x2010, 0, &vec![0; 0x1_0001]), Err(AbortCode::TOO_LONG));
}
