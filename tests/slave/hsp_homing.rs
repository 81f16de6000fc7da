//! Homing of the simulated pulse module: every method on both channels, independently, and everything besides homing.

use ecmsk::cia402::{Controlword, Mode, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::slave::homing::HomingError;
use ecmsk::slave::{Channels, Fault, HomeSwitch, HspConfig, Input, Slave, Travel};

use crate::hsp::{MS, Master};
use support::homing_tables::{METHODS, Places};

const TURN: i64 = 10_000;
const FIRST: i64 = -2600;
const LAST: i64 = 3100;
const NEGATIVE_LIMIT: i64 = -15_000;
const POSITIVE_LIMIT: i64 = 22_000;
/// Pulses at ..., -18 766, -8766, 1234, 11 234, ...
const INDEX: i64 = 1234;
/// The channels' positions at power-on: outside the cam, on its right and on its left.
const STARTS: [i64; 2] = [9000, -8000];
const SECOND: u16 = 0x800;

const PLACES: Places =
    Places { limits: (NEGATIVE_LIMIT, POSITIVE_LIMIT), cam: (FIRST, LAST), index: INDEX, turn: TURN };

fn travel() -> Travel {
    Travel {
        negative_limit: Some(NEGATIVE_LIMIT),
        positive_limit: Some(POSITIVE_LIMIT),
        home: Some(HomeSwitch::Cam { first: FIRST, last: LAST }),
        index: Some(INDEX as u32),
        limits_stop_motion: true,
        stops: None,
        search_limit: 500_000,
    }
}

fn master(channels: Channels, mode: Mode, travel: Travel) -> Master {
    Master::enabled(HspConfig { positions: STARTS, travels: [travel; 2], ..HspConfig::with(channels) }, mode, MS)
}

impl Master {
    fn write(&mut self, index: u16, sub: u8, size: SdoSize, value: i64) -> Result<(), AbortCode> {
        self.hsp.download(ObjectAddress::new(index, sub), size, value as u32)
    }

    fn read(&mut self, index: u16) -> u32 {
        self.hsp.upload(ObjectAddress::new(index, 0)).unwrap().bits
    }

    /// Mode 6 and a method, for one channel.
    fn prepare(&mut self, channel: usize, method: i8) {
        let offset = SECOND * channel as u16;
        self.write(0x6098 + offset, 0, SdoSize::One, method.into()).unwrap();
        self.write(0x6060 + offset, 0, SdoSize::One, 6).unwrap();
    }

    /// Runs cycles in which the master sends the actual positions, and so never commands a jump.
    fn hold(&mut self, cycles: u64) {
        for _ in 0..cycles {
            for (out, seen) in self.out.iter_mut().zip(&self.seen) {
                out.target = seen.position;
            }
            self.cycle();
        }
    }

    fn start(&mut self, channel: usize, starts: bool) {
        self.out[channel].controlword.0 &= !Controlword::HOMING_START;
        self.out[channel].controlword.0 |= if starts { Controlword::HOMING_START } else { 0 };
    }

    /// Bits 13, 12 and 10 of a channel.
    fn bits(&self, channel: usize) -> u16 {
        let Statusword(word) = self.seen[channel].statusword;
        (word >> 13 & 1) << 2 | (word >> 12 & 1) << 1 | word >> 10 & 1
    }

    /// Runs until the channels are at their end, each with bits 10 and 12 or 10 and 13.
    fn until_end(&mut self, channels: &[usize]) {
        // What it shows now was measured in another mode.
        self.hold(2);
        for _ in 0..60_000 {
            self.hold(1);
            if channels.iter().all(|channel| matches!(self.bits(*channel), 0b011 | 0b101)) {
                return;
            }
        }
        panic!("no end: {:?}", self.seen);
    }

    fn pulses(&self, channel: usize) -> i64 {
        self.hsp.shaft(channel).unwrap()
    }

    /// Where on the travel the position actual value is 0.
    fn origin(&self, channel: usize) -> i64 {
        self.pulses(channel) - i64::from(self.seen[channel].position)
    }

    fn error(&self, channel: usize) -> Option<HomingError> {
        self.hsp.axes()[channel].homing().error()
    }
}

/// SK-7.20 Every method ends where CiA 402-2 says, to the pulse, and shows bits 10 and 12; with 0x607C the position
/// there is the offset. Both channels at once, from different places; and back in CSP nothing moves.
#[test]
fn every_method_on_both_channels() {
    for (method, mode) in METHODS.into_iter().flat_map(|method| [(method, Mode::Csp), (method, Mode::Csv)]) {
        let mut bench = master(Channels::Two, mode, travel());
        for channel in 0..2 {
            bench.prepare(channel, method);
            bench.write(0x607C + SECOND * channel as u16, 0, SdoSize::Four, 500 * channel as i64).unwrap();
            bench.start(channel, true);
        }
        bench.until_end(&[0, 1]);
        bench.hold(1);
        for (channel, start) in STARTS.into_iter().enumerate() {
            let expected = PLACES.home(method, start);
            let name = format!("method {method}, channel {channel}, {mode}");
            let Some(expected) = expected else {
                assert!(matches!(bench.error(channel), Some(HomingError::WrongLimit(_))), "{name}");
                assert_eq!((bench.bits(channel), bench.origin(channel)), (0b101, 0), "{name}");
                continue;
            };
            assert_eq!((bench.bits(channel), bench.error(channel)), (0b011, None), "{name}");
            assert_eq!(bench.origin(channel) + 500 * channel as i64, expected, "{name}");
        }
        let there = [0, 1].map(|channel| bench.pulses(channel));
        for channel in 0..2 {
            bench.start(channel, false);
            bench.write(0x6060 + SECOND * channel as u16, 0, SdoSize::One, mode.code().into()).unwrap();
            bench.out[channel].target = 0;
        }
        if mode == Mode::Csp {
            bench.hold(200);
        } else {
            bench.cycles(200);
        }
        assert_eq!([0, 1].map(|channel| bench.pulses(channel)), there, "method {method}, {mode}: nothing moves");
    }
}

/// SK-3.28 SK-3.29 A channel that is not in mode 6 goes on with its targets, to the pulse, while the other one homes.
#[test]
fn one_channel_homes_and_the_other_moves() {
    for homing in [0, 1] {
        let other = 1 - homing;
        let mut bench = master(Channels::Two, Mode::Csp, travel());
        bench.prepare(homing, 17);
        bench.start(homing, true);
        let mut sent = STARTS[other] as i32;
        let mut cycles = 0;
        while bench.bits(homing) != 0b011 || cycles < 10 {
            bench.out[homing].target = bench.seen[homing].position;
            let before = sent;
            sent += 7;
            bench.out[other].target = sent;
            bench.cycle();
            if cycles > 0 {
                assert_eq!(bench.seen[other].position, before, "cycle {cycles}");
                assert_eq!(bench.seen[other].statusword.0 & 0x1800, 0x1000, "it follows its target");
            }
            cycles += 1;
        }
        bench.cycles(3);
        assert!(cycles > 200, "{cycles}: it was a long search");
        assert_eq!(bench.origin(homing), NEGATIVE_LIMIT + 1);
        assert_eq!(bench.origin(other), 0, "its coordinate stays");
    }
}

/// 0x6502 says homing, CSP and CSV on either axis; 0x6098 takes any value, and what is no method, or needs an input that
/// is not wired, ends in bit 13 without a pulse. 0x60FD shows the wired lines and not the switches.
#[test]
fn failures() {
    let mut bench = master(Channels::Two, Mode::Csp, Travel::NONE);
    assert_eq!([bench.read(0x6502), bench.read(0x6D02)], [0x1A0; 2]);
    for (method, error) in [
        (15, HomingError::UnsupportedMethod(15)),
        (-1, HomingError::UnsupportedMethod(-1)),
        (17, HomingError::NotWired { method: 17, input: Input::NegativeLimit }),
        (33, HomingError::NotWired { method: 33, input: Input::Index }),
    ] {
        bench.prepare(1, method);
        bench.start(1, true);
        bench.hold(1);
        bench.until_end(&[1]);
        assert_eq!((bench.bits(1), bench.error(1)), (0b101, Some(error)));
        assert_eq!(bench.pulses(1), STARTS[1]);
        bench.start(1, false);
        bench.write(0x6860, 0, SdoSize::One, 8).unwrap();
        bench.hold(1);
    }
    let mut wired = master(Channels::One, Mode::Csp, Travel { negative_limit: Some(20_000), ..travel() });
    wired.hold(1);
    assert_eq!((wired.read(0x60FD), wired.seen[0].inputs), (0, 0), "on the limit switch");
}

/// The default travel lets every method find home from where a module stands at power-on; an input that sticks, and one
/// that works again.
#[test]
fn the_default_travel() {
    for method in METHODS {
        let mut hsp = Master::enabled(HspConfig::default(), Mode::Csp, MS);
        hsp.prepare(0, method);
        hsp.start(0, true);
        hsp.until_end(&[0]);
        assert_eq!((hsp.bits(0), hsp.error(0)), (0b011, None), "method {method}");
    }
    let mut bench = master(Channels::Two, Mode::Csp, travel());
    assert!(bench.hsp.apply_fault(Fault::Stick { axis: 1, input: Some(Input::NegativeLimit), value: Some(true) }));
    bench.prepare(1, 34);
    bench.prepare(0, 34);
    bench.start(1, true);
    bench.start(0, true);
    bench.hsp.apply_fault(Fault::Stick { axis: 1, input: Some(Input::PositiveLimit), value: Some(true) });
    bench.until_end(&[0, 1]);
    assert_eq!(bench.error(1), Some(HomingError::BothLimits));
    assert_eq!(bench.error(0), None, "the inputs of the other channel work");
}
