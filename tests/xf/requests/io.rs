//! GPIO, encoder, DAC and ADC.

use ecmsk::xf::Request;
use ecmsk::xf::request::{
    AdcClose, AdcConfigSampleModule, AdcGetConvData, AdcGetDataValidFlag, AdcMode, AdcOpen, AdcStartConv, AllPins,
    Analog, DacClose, DacDelay, DacOpen, DacSetData, DacSetDelayTime, DacStartConv, DacTrigger, DebounceClock,
    DebounceSource, EncGetCount, EncOpen, EncStart, EncStop, EncoderMode, GpioChannel, GpioEnableDebounce,
    GpioEnableDebounceExt, GpioExtGetIntFlag, GpioExtGetValue, GpioExtSetValue, GpioGetIntFlag, GpioGetValue,
    GpioIntClear, GpioIntClearExt, GpioIntEnable, GpioMode, GpioPull, GpioSetDebounceClock, GpioSetMode,
    GpioSetModeExt, GpioSetValue, GpioTrigger, UpperPins,
};

use super::{case, long, short};
use crate::{Printed, bytes};

/// XF-10.1 Directions and debouncing of GPIOs. XF EN 825 to 876.
#[test]
pub fn gpio_configuration() {
    let modes =
        [(GpioMode::Input, 0), (GpioMode::Output, 1), (GpioMode::OpenDrain, 2), (GpioMode::QuasiBidirectional, 3)];
    let pulls = [(GpioPull::None, 0), (GpioPull::Up, 1), (GpioPull::Down, 2)];
    let upper = UpperPins::new(0x0B).expect("4 bits");
    for (mode, i2) in modes {
        for (pull, i3) in pulls {
            case(GpioSetMode { pins: 0x8001, mode, pull }, short(31, 0, [0x01, 0x80, i2, i3]));
            case(GpioSetModeExt { pins: upper, mode, pull }, short(31, 8, [0x0B, 0, i2, i3]));
        }
    }
    for on in [false, true] {
        let i2 = u8::from(on);
        case(GpioEnableDebounce { pins: 0x1234, on }, short(31, 2, [0x34, 0x12, i2, 0]));
        case(GpioEnableDebounceExt { pins: upper, on }, short(31, 9, [0x0B, 0, i2, 0]));
    }
    for (exponent, source, i0) in [(0, DebounceSource::Mhz192, 0), (15, DebounceSource::Khz10, 0x1F)] {
        let clock = DebounceClock::new(exponent, source).expect("0 to 15");
        assert_eq!((clock.exponent(), clock.source()), (exponent, source));
        case(GpioSetDebounceClock { clock }, short(31, 3, [i0, 0, 0, 0]));
    }
}

/// XF-10.1 Interrupts of GPIOs, XF-10.2 with the types of the manuals and of the vendor's driver. XF EN 890 to 910.
#[test]
pub fn gpio_interrupt_types() {
    use GpioTrigger::{Both, Driver4, Driver5, Falling, Off, Rising};
    let channel = GpioChannel::new(19).expect("0 to 19");
    case(GpioIntClear { pins: 0x4002 }, short(31, 4, [0x02, 0x40, 0, 0]));
    case(GpioIntClearExt { pins: AllPins::new(0xF_1234).expect("20 bits") }, short(31, 6, [0x34, 0x12, 0x0F, 0]));
    for (trigger, i1) in [(Off, 0), (Both, 1), (Falling, 2), (Rising, 3), (Driver4, 4), (Driver5, 5)] {
        case(GpioIntEnable { channel, trigger }, short(31, 1, [19, i1, 0, 0]));
    }
}

/// XF-10.3 Outputs and inputs. XF EN 920 to 980.
#[test]
pub fn gpio_outputs_and_inputs() {
    case(GpioSetValue { values: 0x8001 }, short(32, 0, [0x01, 0x80, 0, 0]));
    case(GpioExtSetValue { values: AllPins::new(0x9_8001).expect("20 bits") }, short(32, 2, [0x01, 0x80, 0x09, 0]));
    case(GpioGetValue, short(32, 1, [0; 4]));
    case(GpioExtGetValue, short(32, 3, [0; 4]));
    case(GpioGetIntFlag, short(32, 5, [0; 4]));
    case(GpioExtGetIntFlag, short(32, 7, [0; 4]));
}

/// XF-10.4 The encoder. XF EN 995 to 1021.
#[test]
pub fn encoder_functions() {
    use EncoderMode::{X2Compare, X2Free, X4Compare, X4Free};
    let modes = [(X4Free, 0x000_u32), (X2Free, 0x100), (X4Compare, 0x200), (X2Compare, 0x300)];
    for (mode, number) in modes {
        case(EncOpen { mode }, long(33, 4, bytes![number]));
    }
    case(EncStart, short(33, 5, [0; 4]));
    case(EncStop, short(33, 6, [0; 4]));
    case(EncGetCount, short(33, 21, [0; 4]));
}

/// XF-10.5 The DAC. XF EN 1034 to 1069.
#[test]
pub fn dac_functions() {
    use DacTrigger::{PinFalling, PinHigh, PinLow, PinRising, SetData, StartConv};
    for (trigger, number) in [
        (SetData, 0x0000_u32),
        (StartConv, 0x0010),
        (PinLow, 0x0030),
        (PinHigh, 0x1030),
        (PinRising, 0x2030),
        (PinFalling, 0x3030),
    ] {
        case(DacOpen { trigger }, long(34, 20, bytes![number]));
    }
    case(DacClose, short(34, 21, [0; 4]));
    case(DacSetDelayTime { delay: DacDelay::MAX }, long(34, 22, bytes![1023_u32]));
    case(DacSetData { value: Analog::MAX }, long(34, 11, bytes![4095_u32]));
    case(DacStartConv, short(34, 0, [0; 4]));
}

/// XF-10.6 The ADC. XF EN 1076 to 1128.
#[test]
pub fn adc_functions() {
    case(AdcOpen { mode: AdcMode::SingleEnded }, long(35, 40, bytes![0_u32]));
    case(AdcOpen { mode: AdcMode::Differential }, long(35, 40, bytes![0x100_u32]));
    case(AdcClose, short(35, 41, [0; 4]));
    case(AdcConfigSampleModule, long(35, 42, vec![0; 12]));
    case(AdcGetDataValidFlag, long(35, 17, bytes![0x1000_u32]));
    case(AdcStartConv, long(35, 12, bytes![0x1000_u32]));
    case(AdcGetConvData, long(35, 15, bytes![12_u32]));
}

/// XF-10.6 Numbers of the ADC that are reserved say nothing, and neither do bits beside the fixed 0x1000.
#[test]
fn adc_numbers_that_are_ignored() {
    for (par, data, request) in [
        (42, bytes![7_u32, 0_u32, 9_u32], Request::from(AdcConfigSampleModule)),
        (17, bytes![0x1001_u32], AdcGetDataValidFlag.into()),
        (12, bytes![u32::MAX], AdcStartConv.into()),
    ] {
        let printed = Printed { code: 35, par, len: data.len() as u16, data, ..Printed::default() };
        printed.read(|read| assert_eq!(read, Ok(request)));
    }
}
