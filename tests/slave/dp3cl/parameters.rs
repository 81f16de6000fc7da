//! Parameters and commands of a DP3CL, its dial switch and its LEDs.

use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::ethercat::AlState;
use ecmsk::slave::dictionary::DataTypeCode;
use ecmsk::slave::dp3cl::{Dial, Dp3cl, Dp3clAlarm, Dp3clConfig, LinkLed, Rating, RedLed};
use ecmsk::slave::{AlStatus, Slave};

use super::bench::{Bench, MS, in_preop, list, read, restarted, usual, write};
use crate::wired::alarm;

fn of(rating: Rating) -> Dp3clConfig {
    Dp3clConfig { rating, ..Dp3clConfig::default() }
}

/// DP3CL-1.2 The peak current of each rating.
#[test]
fn peak_currents() {
    for (rating, usual, most) in [(Rating::A3, 30, 40), (Rating::A7, 70, 70), (Rating::A8, 84, 84)] {
        let mut drive = in_preop(of(rating));
        assert_eq!(read(&mut drive, 0x2400, 0), Ok(usual));
        assert_eq!(drive.peak_ma(), usual as u32 * 100);
        assert_eq!(write(&mut drive, 0x2400, 0, most), Ok(()));
        assert_eq!(write(&mut drive, 0x2400, 0, most + 1), Err(AbortCode::VALUE_HIGH));
        assert_eq!(write(&mut drive, 0x2400, 0, 0), Err(AbortCode::VALUE_LOW));
    }
}

/// DP3CL-1.3 SW1 to SW3 by the tables of the manual.
#[test]
fn dial_currents() {
    let tables = [
        (Rating::A3, [3000, 560, 840, 1400, 1820, 2100, 2660, 3000]),
        (Rating::A7, [7000, 2500, 3400, 4200, 5000, 5600, 6400, 7000]),
        (Rating::A8, [8400, 2700, 3600, 4600, 5500, 6400, 7300, 8400]),
    ];
    for (rating, currents) in tables {
        for (code, current) in (0..).zip(currents) {
            let mut drive = in_preop(Dp3clConfig { dial: Dial(code), ..of(rating) });
            assert_eq!(drive.peak_ma(), current, "{rating:?} {code:03b}");
            write(&mut drive, 0x2400, 0, 10).unwrap();
            let expected = if code == 0 { 1000 } else { current };
            assert_eq!(drive.peak_ma(), expected, "P4-00 counts with code 0 alone");
        }
    }
}

/// DP3CL-1.4 SW4 to SW7.
#[test]
fn dial_functions() {
    for (dial, filter) in [(0x00, None), (0x20, Some(3000)), (0x10, Some(12_000)), (0x30, Some(0))] {
        assert_eq!(Dial(dial).filter_us(), filter, "{dial:02X}");
    }
    let holding = |dial| {
        let mut bench = Bench::enabled_with(Dp3clConfig { dial: Dial(dial), ..Dp3clConfig::default() }, 8);
        bench.run_for(200 * MS);
        bench.drive.motor_ma()
    };
    assert_eq!((holding(0x00), holding(0x08)), (3500, 7000));
    let mut bench = Bench::enabled_with(Dp3clConfig { dial: Dial(0x40), ..Dp3clConfig::default() }, 8);
    bench.target = -200_000;
    bench.run_for(3 * MS);
    assert_eq!(bench.read(0x60FD, 0), 0b010, "the positive limit is on the other side");
}

/// DP3CL-1.5 The station number is kept; number 0 changes nothing.
/// DP3CL-2.12 P7-00 is the station alias.
#[test]
fn station_number() {
    for number in 1..=127 {
        let drive = Dp3cl::new(Dp3clConfig { dial: Dial(0x80 | number), ..Dp3clConfig::default() });
        assert_eq!(drive.station_alias(), u16::from(number));
    }
    let mut drive = in_preop(Dp3clConfig { dial: Dial(0x80 | 0x55), ..Dp3clConfig::default() });
    assert_eq!((read(&mut drive, 0x2700, 0), drive.station_alias()), (Ok(0x55), 0x55));
    assert_eq!(drive.peak_ma(), 7000, "the switches set no current meanwhile");
    drive.set_dial(Dial(0));
    let mut drive = restarted(drive);
    assert_eq!(read(&mut drive, 0x2700, 0), Ok(0x55));
    drive.set_dial(Dial(0x80));
    assert_eq!(read(&mut restarted(drive), 0x2700, 0), Ok(0x55));
    let mut drive = usual();
    write(&mut drive, 0x2700, 0, 40_000).unwrap();
    write(&mut drive, 0x4002, 0, 1).unwrap();
    assert_eq!(restarted(drive).station_alias(), 40_000);
}

/// DP3CL-1.6 The codes of the red LED. DP3CL-5.19 No codes without an alarm; those of IEC 61800-7-201 for the alarms of
/// the LED.
#[test]
fn red_led() {
    let mut drive = usual();
    assert_eq!((drive.leds().alarm, drive.leds().power), (RedLed::Off, true));
    assert_eq!((read(&mut drive, 0x1001, 0), read(&mut drive, 0x603F, 0)), (Ok(0), Ok(0)));
    for (code, flashes) in [(0x2310, 1), (0x3210, 2), (0x3220, 3), (0x7120, 4)] {
        let mut drive = usual();
        assert!(drive.apply_fault(alarm(code)));
        assert_eq!(drive.leds().alarm, RedLed::Flashes(flashes));
        assert_eq!((read(&mut drive, 0x1001, 0), read(&mut drive, 0x603F, 0)), (Ok(0x80), Ok(code.into())));
    }
    assert_eq!(drive.enter(AlState::Op), Err(AlStatus(0x0011)));
    assert_eq!(drive.leds().alarm, RedLed::On);
    drive.step(10 * MS);
    write(&mut drive, 0x4000, 0, 1).unwrap();
    drive.step(10 * MS);
    assert_eq!((drive.leds().alarm, drive.alarm()), (RedLed::Off, None), "it was cleared");
}

/// DP3CL-1.7 The LEDs of the connection.
#[test]
fn connection_leds() {
    let drive = Dp3cl::default();
    assert!(!drive.leds().run, "Init");
    let mut drive = usual();
    assert_eq!((drive.leds().run, drive.leds().link_in), (true, LinkLed::On));
    assert!(drive.enter(AlState::Op).is_err());
    assert!(!drive.leds().run, "E-800");
    let mut bench = Bench::in_op(Dp3clConfig::default(), 8, MS);
    assert_eq!((bench.drive.leds().run, bench.drive.leds().link_out), (true, LinkLed::Flashing));
    bench.drive.step(MS);
    for (links, shown) in [
        ([true, true, false, false], [LinkLed::On, LinkLed::On]),
        ([true, false, false, false], [LinkLed::On, LinkLed::Off]),
        ([false, false, false, false], [LinkLed::Off, LinkLed::Off]),
    ] {
        bench.drive.note_links(links);
        assert_eq!([bench.drive.leds().link_in, bench.drive.leds().link_out], shown);
    }
}

/// DP3CL-1.8 A missing motor is detected at power-on, with P1-00. DP3CL-1.9 The alarms of the supply.
#[test]
fn motor_and_supply() {
    let mut drive = in_preop(Dp3clConfig { has_motor: false, ..Dp3clConfig::default() });
    assert_eq!(drive.alarm(), Some(Dp3clAlarm::OpenMotor));
    write(&mut drive, 0x2100, 0, 0).unwrap();
    write(&mut drive, 0x4002, 0, 1).unwrap();
    assert_eq!(restarted(drive).alarm(), None);
    for (rating, most) in [(Rating::A3, 50_000), (Rating::A7, 50_000), (Rating::A8, 80_000)] {
        let mut drive = in_preop(of(rating));
        drive.set_supply(most);
        assert_eq!(drive.alarm(), None);
        drive.set_supply(most + 1);
        assert_eq!(drive.alarm(), Some(Dp3clAlarm::OverVoltage));
    }
    let mut drive = usual();
    drive.set_supply(5000);
    assert_eq!(drive.alarm(), None, "P3-02 is 0");
    write(&mut drive, 0x2302, 0, 20).unwrap();
    drive.set_supply(20_000);
    assert_eq!(drive.alarm(), None);
    drive.set_supply(19_999);
    assert_eq!(drive.alarm(), Some(Dp3clAlarm::UnderVoltage));
}

/// DP3CL-1.10 The current in the motor.
#[test]
fn currents() {
    let mut bench = Bench::in_op(Dp3clConfig::default(), 8, MS);
    assert_eq!(bench.drive.motor_ma(), 0);
    bench.write(0x2005, 0, 80);
    bench.write(0x2008, 0, 30);
    bench.write(0x200C, 0, 20);
    bench.enable();
    for step in 1..=30 {
        bench.target = step;
        bench.cycle();
        assert_eq!(bench.drive.motor_ma(), 5600);
    }
    bench.run_for(19 * MS);
    assert_eq!(bench.drive.motor_ma(), 5600);
    bench.cycle();
    assert_eq!((bench.drive.motor_ma(), bench.read(0x301F, 0)), (2100, 2100));
}

/// DP3CL-2.1 Groups and their lengths; parameters are of 16 bits without a sign, as are most monitors, and commands are
/// BOOL.
/// DP3CL-2.11 None can be mapped.
#[test]
fn groups() {
    let mut drive = usual();
    let parameters = [20, 15, 20, 10, 10, 15, 15, 5, 27];
    let monitors = [50, 30, 20, 12, 10];
    let commands = [3];
    let numbered = |from: u16, counts: &[u16]| (from..).step_by(0x100).zip(counts.to_vec());
    let groups = numbered(0x2000, &parameters).chain(numbered(0x3000, &monitors)).chain(numbered(0x4000, &commands));
    for (first, count) in groups {
        for index in first..first + count {
            let value = read(&mut drive, index, 0).unwrap_or_else(|code| panic!("{index:04X}: {code}"));
            let data_type = match index {
                0x4000.. => 1,
                0x3000..=0x3001 | 0x3018..=0x301B | 0x301D..=0x301E | 0x3101..=0x310C => 3,
                _ => 6,
            };
            let entry = drive.describe_entry(ObjectAddress::new(index, 0)).unwrap();
            assert_eq!(entry.data_type, DataTypeCode(data_type), "{index:04X}");
            assert_eq!(read(&mut drive, index, 1), Err(AbortCode::NO_SUB_INDEX));
            let is_fixed = matches!(index, 0x2209 | 0x220A | 0x2401 | 0x3000..=0x3FFF);
            let expected = if is_fixed { Err(AbortCode::READ_ONLY) } else { Ok(()) };
            assert_eq!(write(&mut drive, index, 0, value), expected, "{index:04X}");
            let bits = if first == 0x4000 { 1 } else { 16 };
            let entry = u32::from(index) << 16 | bits;
            assert_eq!(list(&mut drive, 0x1600, &[entry]), Err(AbortCode::NOT_MAPPABLE));
            assert_eq!(list(&mut drive, 0x1A00, &[entry]), Err(AbortCode::NOT_MAPPABLE));
        }
        assert_eq!(read(&mut drive, first + count, 0), Err(AbortCode::NO_OBJECT), "{first:04X}");
    }
}

/// DP3CL-2.2 Ranges and defaults as printed.
/// DP3CL-2.3 Parameters that cannot be written.
#[test]
fn ranges() {
    let mut drive = usual();
    let any_number = [0x2700, 0x2802, 0x2803, 0x2806, 0x2807].into_iter().chain(0x280A..=0x280F).chain(0x2813..=0x2816);
    let any_number = any_number.map(|index| (index, 0, 65_535, 0));
    let others = [
        (0x2001, 200, 51_200, 10_000),
        (0x2002, 0, 50, 0),
        (0x2005, 1, 100, 100),
        (0x2008, 0, 100, 50),
        (0x200B, 0, 2, 0),
        (0x200C, 1, 10_000, 100),
        (0x2100, 0, 1, 1),
        (0x2101, 1, 65_535, 1500),
        (0x2102, 1, 65_535, 800),
        (0x210D, 0, 100, 3),
        (0x2202, 0, 65_535, 1),
        (0x2203, 0, 65_535, 2),
        (0x2205, 0, 65_535, 1),
        (0x2206, 0, 65_535, 2),
        (0x2207, 0, 65_535, 3),
        (0x2208, 0, 65_535, 4),
        (0x2301, 0, 255, 255),
        (0x2302, 0, 20, 0),
        (0x2400, 1, 70, 70),
        (0x2402, 0, 1, 0),
        (0x2800, 0, 65_535, 0x8001),
        (0x2801, 0, 65_535, 0x8003),
        (0x2804, 0, 65_535, 0x8002),
        (0x2805, 0, 65_535, 0x8004),
        (0x2808, 0, 65_535, 0x1008),
        (0x2809, 0, 65_535, 0x1009),
        (0x2810, 0, 8, 1),
        (0x2811, 1, 65_535, 36),
        (0x2812, 0, 65_535, 1024),
        (0x2817, 0, 100, 100),
        (0x2818, 0, 1, 0),
        (0x2819, 0, 1, 0),
        (0x281A, 0, 1, 0),
    ];
    for (index, low, high, default) in any_number.chain(others) {
        assert_eq!(read(&mut drive, index, 0), Ok(default), "{index:04X}");
        for value in [low, high] {
            assert_eq!(write(&mut drive, index, 0, value), Ok(()), "{index:04X} {value}");
        }
        if low > 0 {
            assert_eq!(write(&mut drive, index, 0, low - 1), Err(AbortCode(0x0609_0032)), "{index:04X}");
        }
        if high < 65_535 {
            assert_eq!(write(&mut drive, index, 0, high + 1), Err(AbortCode(0x0609_0031)), "{index:04X}");
        }
    }
    for (index, value) in [(0x2401, 4000), (0x2209, 1), (0x220A, 2)] {
        assert_eq!(read(&mut drive, index, 0), Ok(value));
        assert_eq!(write(&mut drive, index, 0, value), Err(AbortCode::READ_ONLY));
    }
}

/// DP3CL-2.4 Values that are not saved are lost. DP3CL-2.6 The factory settings. DP3CL-2.7 The effects of the commands.
#[test]
fn saving() {
    let mut drive = usual();
    write(&mut drive, 0x2005, 0, 77).unwrap();
    let mut drive = restarted(drive);
    assert_eq!(read(&mut drive, 0x2005, 0), Ok(100));
    write(&mut drive, 0x2005, 0, 77).unwrap();
    write(&mut drive, 0x6081, 0, 1234).unwrap();
    write(&mut drive, 0x4002, 0, 1).unwrap();
    assert_eq!(read(&mut drive, 0x4002, 0), Ok(0));
    write(&mut drive, 0x2005, 0, 50).unwrap();
    write(&mut drive, 0x4002, 0, 1).unwrap();
    let mut drive = restarted(drive);
    assert_eq!(read(&mut drive, 0x2005, 0), Ok(77), "1 after 1 does not save");
    assert_eq!(read(&mut drive, 0x6081, 0), Ok(0), "no parameter");
    write(&mut drive, 0x2005, 0, 60).unwrap();
    for value in [1, 0, 1] {
        write(&mut drive, 0x4002, 0, value).unwrap();
        write(&mut drive, 0x2005, 0, 50 + value).unwrap();
    }
    let mut drive = restarted(drive);
    assert_eq!(read(&mut drive, 0x2005, 0), Ok(50), "1 after 0 saves again");
    write(&mut drive, 0x4001, 0, 1).unwrap();
    assert_eq!(read(&mut drive, 0x2005, 0), Ok(100));
    assert_eq!(read(&mut restarted(drive), 0x2005, 0), Ok(100));
    let mut bench = Bench::enabled(8);
    for (index, expected) in
        [(0x4000, Ok(())), (0x4001, Err(AbortCode(0x0800_0022))), (0x4002, Err(AbortCode(0x0800_0022)))]
    {
        assert_eq!(write(&mut bench.drive, index, 0, 1), expected, "{index:04X}");
    }
}

/// DP3CL-2.5 The subdivision acts after a restart, with its saved value.
#[test]
fn after_restart() {
    let mut drive = usual();
    write(&mut drive, 0x2001, 0, 2000).unwrap();
    write(&mut drive, 0x2002, 0, 7).unwrap();
    let speed = |drive: Dp3cl| {
        let mut bench = Bench::of(drive, 8, MS);
        bench.enable();
        for step in 1..=5 {
            bench.target = step * 100;
            bench.cycle();
        }
        (bench.read(0x606B, 0), bench.read(0x6063, 0))
    };
    assert_eq!((drive.filter_time(), speed(drive.clone())), (0, (6000, 160)), "10000 a turn still");
    assert_eq!(speed(restarted(drive.clone())), (6000, 160), "not saved");
    write(&mut drive, 0x4002, 0, 1).unwrap();
    let drive = restarted(drive);
    assert_eq!((drive.filter_time(), speed(drive)), (7, (30_000, 800)));
}
