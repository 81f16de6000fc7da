//! GPIO, encoder, DAC, ADC, PHY.

use ecmsk::xf::Interrupts;
use ecmsk::xf::request::*;

use super::interrupts::int1;
use super::{MS, Pair};

fn inputs(pair: &mut Pair) -> u32 {
    pair.get(&GpioExtGetValue, |values| values)
}

fn wire(pair: &mut Pair, channel: u8, level: bool) {
    let now = pair.now;
    pair.chip().wire_gpio(now, channel, Some(level));
}

fn upper(bits: u8) -> UpperPins {
    UpperPins::new(bits).expect("4 pins")
}

fn all(bits: u32) -> AllPins {
    AllPins::new(bits).expect("20 pins")
}

/// XF-13.1 XF-11.50 ECM_GpioSetMode (XF EN 825, 838): pulls of inputs, outputs, open drain, quasi-bidirectional, of
/// GPIO 0 to 15.
#[test]
pub fn gpio_modes() {
    let mut pair = Pair::running();
    assert_eq!(inputs(&mut pair), 0, "floating inputs (XF EN, GPIO)");
    pair.run(&GpioSetMode { pins: 0x00F0, mode: GpioMode::Input, pull: GpioPull::Up });
    assert_eq!(inputs(&mut pair), 0x00F0);
    wire(&mut pair, 4, false);
    assert_eq!(inputs(&mut pair), 0x00E0);
    pair.run(&GpioSetMode { pins: 0x0400, mode: GpioMode::OpenDrain, pull: GpioPull::Up });
    assert!(!pair.chip().gpio_level(10), "it pulls down");
    pair.run(&GpioSetValue { values: 0x0400 });
    assert!(pair.chip().gpio_level(10), "it lets go");
    wire(&mut pair, 10, false);
    assert!(!pair.chip().gpio_level(10));
    pair.run(&GpioSetValue { values: 0x0800 });
    pair.run(&GpioSetMode { pins: 0x0800, mode: GpioMode::QuasiBidirectional, pull: GpioPull::None });
    assert!(pair.chip().gpio_level(11), "high by itself");
}

/// XF-13.1 ECM_GpioSetMode of GPIO 16 to 19 (XF EN 838).
#[test]
pub fn gpio_modes_of_upper_pins() {
    let mut pair = Pair::running();
    pair.run(&GpioSetModeExt { pins: upper(0b1010), mode: GpioMode::Input, pull: GpioPull::Up });
    assert_eq!(inputs(&mut pair), 0b1010 << 16);
}

/// XF-13.1 XF-11.50 ECM_GpioSetValue and ECM_GpioExtSetValue (XF EN 920, 930) set levels.
#[test]
pub fn gpio_outputs() {
    let mut pair = Pair::running();
    pair.run(&GpioSetMode { pins: 0xFFFF, mode: GpioMode::Output, pull: GpioPull::None });
    pair.run(&GpioSetModeExt { pins: upper(0b1111), mode: GpioMode::Output, pull: GpioPull::None });
    let levels = |pair: &mut Pair| (0..20).fold(0, |bits, k| bits | u32::from(pair.chip().gpio_level(k)) << k);
    pair.run(&GpioSetValue { values: 0xA5C3 });
    assert_eq!(levels(&mut pair), 0xA5C3);
    pair.run(&GpioExtSetValue { values: all(0x9_5A3C) });
    assert_eq!(levels(&mut pair), 0x9_5A3C);
    // The header of every packet drives GPIO 0 to 11, and with newer firmware 12 to 15 (XF ZH 246).
    pair.host.set_gpio_outputs(Some(0x9A55));
    assert_eq!(pair.header().gpio_inputs, 0xAA55);
    assert_eq!(levels(&mut pair), 0x9_AA55);
}

/// XF-13.1 XF-11.50 ECM_GpioGetValue and ECM_GpioExtGetValue (XF EN 940, 953) read levels; the header shows GPIO 0 to
/// 15.
#[test]
pub fn gpio_inputs() {
    let mut pair = Pair::running();
    wire(&mut pair, 3, true);
    wire(&mut pair, 17, true);
    assert_eq!(pair.get(&GpioGetValue, |values| values), 1 << 3);
    assert_eq!(inputs(&mut pair), 1 << 17 | 1 << 3);
    assert_eq!(pair.header().gpio_inputs, 1 << 3);
}

/// ECM_GpioEnableDebounce and ECM_GpioSetDebounceClock: a level counts after 2^7
/// periods of 10 kHz, 12.8 ms.
fn debounced(pin: u8, enable: impl Fn(&mut Pair)) {
    let mut pair = Pair::running();
    enable(&mut pair);
    let clock = DebounceClock::new(7, DebounceSource::Khz10).expect("0 to 15");
    pair.run(&GpioSetDebounceClock { clock });
    for level in [true, false] {
        wire(&mut pair, 1, level);
        assert_eq!(inputs(&mut pair) & 1 << 1 != 0, level, "not debounced");
        wire(&mut pair, pin, level);
        pair.pass(5 * MS);
        assert_eq!(inputs(&mut pair) & 1 << pin != 0, !level, "not yet");
        // A bounce restarts the time.
        wire(&mut pair, pin, !level);
        wire(&mut pair, pin, level);
        pair.pass(10 * MS);
        assert_eq!(inputs(&mut pair) & 1 << pin != 0, !level, "not yet");
        pair.pass(5 * MS);
        assert_eq!(inputs(&mut pair) & 1 << pin != 0, level);
    }
}

/// XF-13.1 XF-11.53 ECM_GpioEnableDebounce of GPIO 0 to 15 (XF EN 850), and the clock (XF EN 876).
#[test]
pub fn debounce() {
    debounced(9, |pair| pair.run(&GpioEnableDebounce { pins: 1 << 9, on: true }));
}

/// XF-13.1 XF-11.53 ECM_GpioEnableDebounce of GPIO 16 to 19 (XF EN 861).
#[test]
pub fn debounce_of_upper_pins() {
    debounced(18, |pair| pair.run(&GpioEnableDebounceExt { pins: upper(0b0100), on: true }));
}

/// XF-13.1 XF-11.52 ECM_GpioIntEnable (XF EN 890): 0 none, 1 both edges, 2 falling, 3 rising, and of the vendor's
/// driver 4 as 2 and 5 as 3; ECM_GpioGetIntFlag and
/// ECM_GpioExtGetIntFlag (XF EN 968, 980) tell the flags, ECM_GpioIntClear (XF EN 899, 910) clears them.
#[test]
pub fn gpio_interrupts() {
    let mut pair = Pair::running();
    let channel = |n| GpioChannel::new(n).expect("0 to 19");
    for (trigger, rising, falling) in [
        (GpioTrigger::Off, false, false),
        (GpioTrigger::Both, true, true),
        (GpioTrigger::Falling, false, true),
        (GpioTrigger::Rising, true, false),
        (GpioTrigger::Driver4, false, true),
        (GpioTrigger::Driver5, true, false),
    ] {
        pair.run(&GpioIntEnable { channel: channel(9), trigger });
        for (level, raised) in [(true, rising), (false, falling)] {
            wire(&mut pair, 9, level);
            let flag = u16::from(raised) << 9;
            assert_eq!(pair.get(&GpioGetIntFlag, |flags| flags), flag, "{trigger:?} {level}");
            assert_eq!(pair.get(&GpioExtGetIntFlag, |flags| flags), u32::from(flag));
            assert_eq!(pair.header().gpio_interrupts, flag);
            pair.run(&GpioIntClear { pins: 1 << 9 });
            assert_eq!(pair.get(&GpioExtGetIntFlag, |flags| flags), 0);
        }
    }
    pair.run(&GpioIntEnable { channel: channel(19), trigger: GpioTrigger::Rising });
    wire(&mut pair, 19, true);
    assert_eq!(pair.get(&GpioExtGetIntFlag, |flags| flags), 1 << 19);
    pair.run(&GpioIntClearExt { pins: all(1 << 19) });
    assert_eq!(pair.get(&GpioExtGetIntFlag, |flags| flags), 0);
}

/// XF-13.1 XF-11.54 ECM_EncOpen (XF EN 995), ECM_EncStart, ECM_EncStop (XF EN 1007, 1014) and ECM_EncGetCount (XF EN
/// 1021): it counts four or two edges of a period while it is started.
#[test]
pub fn encoder() {
    let mut pair = Pair::running();
    let count = |pair: &mut Pair| pair.get(&EncGetCount, |count| count);
    pair.is_refused(&EncGetCount);
    pair.run(&EncOpen { mode: EncoderMode::X4Free });
    pair.chip().turn_encoder(10);
    assert_eq!(count(&mut pair), 0, "it is not started");
    pair.run(&EncStart);
    pair.chip().turn_encoder(10);
    pair.chip().turn_encoder(-4);
    assert_eq!(count(&mut pair), 6);
    pair.run(&EncStop);
    pair.chip().turn_encoder(100);
    assert_eq!(count(&mut pair), 6);
    pair.run(&EncOpen { mode: EncoderMode::X2Free });
    pair.run(&EncStart);
    pair.chip().turn_encoder(7);
    assert_eq!(count(&mut pair), 3);
    pair.chip().turn_encoder(-8);
    assert_eq!(count(&mut pair), u32::MAX);
}

/// XF-11.54 Index, overflow and comparison of the encoder raise INT1 by bits of their own, and bit 29 of the header's
/// flags, which clears them.
#[test]
fn encoder_interrupts() {
    type Event = fn(&mut Pair);
    let overflows: Event = |pair| pair.chip().turn_encoder(-1);
    let cases: [(EncoderMode, PeripheralInterrupts, Event); 3] = [
        (EncoderMode::X4Free, PeripheralInterrupts::ENCODER_INDEX, |pair| pair.chip().index_encoder()),
        (EncoderMode::X4Free, PeripheralInterrupts::ENCODER_OVERFLOW, overflows),
        (EncoderMode::X4Compare, PeripheralInterrupts::ENCODER_COMPARE, overflows),
    ];
    for (mode, peripherals, event) in cases {
        let mut pair = Pair::running();
        pair.run(&EncOpen { mode });
        pair.run(&EncStart);
        let enable = InterruptEnable { polarity: Polarity::INT0_HIGH, sources: Interrupts::NONE, gpio: 0, peripherals };
        pair.run(&InterruptSetEnable { enable });
        assert!(int1(&mut pair), "active is low");
        event(&mut pair);
        assert!(!int1(&mut pair), "{mode:?}");
        assert!(pair.header_now().interrupts.contains(Interrupts::ENCODER), "{mode:?}");
        pair.host.clear_interrupts(Interrupts::ENCODER, 0);
        pair.run(&InfoUpdate);
        assert!(!pair.header_now().interrupts.contains(Interrupts::ENCODER), "{mode:?}");
        assert!(int1(&mut pair), "{mode:?}");
    }
}

/// XF-13.1 XF-11.55 ECM_DacOpen (XF EN 1034), ECM_DacSetData (XF EN 1058), ECM_DacStartConv (XF EN 1069),
/// ECM_DacSetDelayTime (XF EN 1050) and ECM_DacClose (XF EN 1042): a value is output with its trigger, after the delay.
#[test]
pub fn dac() {
    let mut pair = Pair::running();
    let output = |pair: &mut Pair, later| {
        let at = pair.now + later;
        pair.chip().dac_output(at)
    };
    let data = |n| DacSetData { value: Analog::new(n).expect("12 bits") };
    pair.is_refused(&data(5));
    assert_eq!(output(&mut pair, 0), None);
    pair.run(&DacOpen { trigger: DacTrigger::SetData });
    pair.run(&data(1000));
    assert_eq!(output(&mut pair, 0), Some(1000));
    pair.run(&DacOpen { trigger: DacTrigger::StartConv });
    pair.run(&data(2000));
    assert_eq!(output(&mut pair, 0), Some(1000));
    pair.run(&DacStartConv);
    assert_eq!(output(&mut pair, 0), Some(2000));
    // The pin triggers the output, which comes 960 / 96 us later.
    pair.run(&DacSetDelayTime { delay: DacDelay::new(960).expect("at most 1023") });
    let start_pin = |pair: &mut Pair, level| {
        let now = pair.now;
        pair.chip().wire_dac_start(now, level);
    };
    let mut value = 2000;
    for (trigger, idle) in [
        (DacTrigger::PinRising, false),
        (DacTrigger::PinFalling, true),
        (DacTrigger::PinHigh, false),
        (DacTrigger::PinLow, true),
    ] {
        let before = value;
        value += 100;
        start_pin(&mut pair, idle);
        pair.run(&DacOpen { trigger });
        pair.run(&data(value.into()));
        assert_eq!(output(&mut pair, 0), Some(before), "{trigger:?}");
        start_pin(&mut pair, !idle);
        assert_eq!([9_000, 11_000].map(|later| output(&mut pair, later)), [Some(before), Some(value)], "{trigger:?}");
    }
    pair.run(&DacClose);
    assert_eq!(output(&mut pair, 0), None);
}

/// XF-13.1 XF-11.56 ECM_AdcOpen (XF EN 1076), ECM_AdcConfigSampleModule (XF EN 1091), ECM_AdcStartConv (XF EN 1117),
/// ECM_AdcGetDataValidFlag (XF EN 1102), ECM_AdcGetConvData (XF EN 1128) and ECM_AdcClose (XF EN 1084): software starts
/// a conversion, whose value is valid until it is read; in differential mode it is half the difference around 2048.
#[test]
pub fn adc() {
    let mut pair = Pair::running();
    let valid = |pair: &mut Pair| pair.get(&AdcGetDataValidFlag, |flag| flag != 0);
    pair.is_refused(&AdcStartConv);
    pair.is_refused(&AdcConfigSampleModule);
    pair.run(&AdcOpen { mode: AdcMode::SingleEnded });
    pair.run(&AdcConfigSampleModule);
    let converts = |pair: &mut Pair, positive, negative, value: u32| {
        let now = pair.now;
        pair.chip().wire_adc(now, positive, negative);
        assert!(!valid(pair));
        pair.run(&AdcStartConv);
        assert!(valid(pair));
        assert_eq!(pair.get(&AdcGetConvData, Analog::get), value);
    };
    for (input, value) in [(1234, 1234), (0, 0), (4095, 4095)] {
        converts(&mut pair, input, 4000, value);
    }
    pair.run(&AdcOpen { mode: AdcMode::Differential });
    for (positive, negative, value) in [(0, 0, 2048), (4095, 0, 4095), (0, 4095, 1), (2000, 1000, 2548)] {
        converts(&mut pair, positive, negative, value);
    }
    pair.run(&AdcClose);
    pair.is_refused(&AdcStartConv);
}

/// XF-13.1 XF-11.57 MDIO (XF EN 1455) writes a register of a PHY, and reads one; there are 32 of each.
#[test]
pub fn phy() {
    let mut pair = Pair::running();
    pair.run(&Mdio::Write { phy: 1, register: 4, value: 0x01E1 });
    assert_eq!(pair.chip().phy_register_mut(1, 4).copied(), Some(0x01E1));
    *pair.chip().phy_register_mut(31, 31).expect("32 of each") = 7;
    assert_eq!(pair.get(&Mdio::Read { phy: 31, register: 31 }, |answer| answer.0), Some(7));
    pair.is_refused(&Mdio::Read { phy: 32, register: 0 });
}
