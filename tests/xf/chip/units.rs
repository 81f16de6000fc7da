//! Interrupts, GPIO, encoder, DAC, ADC, PHY.

use ecmsk::xf::request::*;
use ecmsk::xf::{CommandHeader, Errors, EtherCatState, Interrupts, Reserve, Status};

use super::{Host, MS};
use ecmsk::xf::chip::Profile;

fn enable(polarity: Polarity, sources: Interrupts, gpio: u8, peripherals: PeripheralInterrupts) -> InterruptSetEnable {
    InterruptSetEnable { enable: InterruptEnable { polarity, sources, gpio, peripherals } }
}

fn clear_interrupts(host: &mut Host, flags: Interrupts, gpio: u16) {
    host.index = host.index.wrapping_add(1);
    let header = CommandHeader::with_index(host.index);
    host.send_with(CommandHeader { interrupt_clear: flags, gpio_interrupt_clear: gpio, ..header }, &InfoUpdate);
}

fn int1(host: &mut Host) -> bool {
    host.chip.int1(host.now)
}

const NO_PERIPHERALS: PeripheralInterrupts = PeripheralInterrupts::NONE;

/// XF-11.46 A flag is set whether it is enabled or not; INT1 is active, low at first, while a flag that is enabled is
/// set, until the header clears it.
#[test]
fn int1_and_its_flags() {
    let mut host = Host::in_state(EtherCatState::SafeOp);
    host.pass(5 * MS);
    assert!(host.call(&InfoUpdate).header.interrupts.contains(Interrupts::ETHERCAT));
    assert!(int1(&mut host), "nothing is enabled");
    host.run(&enable(Polarity::INT0_HIGH, Interrupts::ETHERCAT, 0, NO_PERIPHERALS));
    assert!(!int1(&mut host));
    // Cleared, the next cycle sets it again.
    host.pace = 100_000;
    while host.now % MS > 300_000 {
        host.pass(50_000);
    }
    clear_interrupts(&mut host, Interrupts::ETHERCAT, 0);
    assert!(int1(&mut host));
    host.pass(MS);
    assert!(!int1(&mut host));
    host.run(&enable(Polarity::INT0_HIGH | Polarity::INT1_HIGH, Interrupts::ETHERCAT, 0, NO_PERIPHERALS));
    assert!(int1(&mut host));
}

/// XF-11.47 INT_GET_ENABLE tells what was set; INT0's polarity is bit 1, high at first.
#[test]
fn enable_is_read() {
    let mut host = Host::with_drives();
    let first = host.call(&InterruptGetEnable).to(&InterruptGetEnable);
    assert_eq!((first.polarity, first.sources, first.gpio), (Polarity::INT0_HIGH, Interrupts::NONE, 0));
    let set = enable(Polarity::INT1_HIGH, Interrupts::CRC, 0x81, PeripheralInterrupts::GPIO_9);
    host.run(&set);
    assert_eq!(host.call(&InterruptGetEnable).to(&InterruptGetEnable), set.enable);
    assert!(host.chip.int0(host.now), "busy with a packet, active is low");
    host.pass(MS);
    assert!(!host.chip.int0(host.now));
}

/// XF-11.48 A wrong check word and a wrong working counter raise interrupts 23 and 22.
#[test]
fn error_interrupts() {
    let mut host = Host::in_state(EtherCatState::Op);
    let flags = |host: &mut Host| host.call(&InfoUpdate).header.interrupts;
    let both = Interrupts::CRC | Interrupts::WORKING_COUNTER;
    assert_eq!(flags(&mut host).0 & both.0, 0);
    let mut bytes = host.packet(CommandHeader::with_index(250), &InfoUpdate);
    bytes[30] ^= 1;
    let end = bytes.len() - 8;
    bytes[end] ^= 1;
    host.exchange_bytes(&bytes);
    assert!(flags(&mut host).contains(Interrupts::CRC));
    host.chip.network_mut().silence(0, true);
    host.pass(2 * MS);
    assert!(flags(&mut host).contains(both));
    host.chip.network_mut().silence(0, false);
    host.pass(2 * MS);
    clear_interrupts(&mut host, both, 0);
    assert_eq!(flags(&mut host).0 & both.0, 0);
}

/// XF-11.49 SET_FIFO_TH: the TxFIFO's interrupt comes with the step up to its limit, the RxFIFO's with the step down to
/// it.
#[test]
fn fifo_limits() {
    let mut host = Host::in_state(EtherCatState::Op);
    host.run(&FifoClear { fifos: Fifos::Both });
    host.run(&FifoThresholdSet { tx_high: Some(10), rx_low: Some(3) });
    let both = Interrupts::TX_FIFO_HIGH | Interrupts::RX_FIFO_LOW;
    let flags = |host: &mut Host| Interrupts(host.call(&InfoUpdate).header.interrupts.0 & both.0);
    host.run(&PdoDataFifo { count: 5, operation: PdoOperation::WRITE, data: &[0; 70] });
    assert_eq!(flags(&mut host), Interrupts::NONE);
    host.run(&FifoEnable { on: true });
    host.pass(2 * MS);
    assert_eq!(flags(&mut host), Interrupts::RX_FIFO_LOW);
    host.pass(10 * MS);
    assert_eq!(flags(&mut host), both);
    // Above the limit it does not come again.
    clear_interrupts(&mut host, both, 0);
    host.pass(20 * MS);
    assert_eq!(flags(&mut host), Interrupts::NONE);
    host.run(&FifoThresholdSet { tx_high: None, rx_low: None });
    host.run(&FifoClear { fifos: Fifos::Both });
    host.pass(30 * MS);
    assert_eq!(flags(&mut host), Interrupts::NONE);
}

fn values(host: &mut Host) -> u32 {
    host.call(&GpioExtGetValue).to(&GpioExtGetValue)
}

/// XF-11.50 GPIOs are floating inputs at first; modes and pulls act on the pins, and the header shows the inputs.
#[test]
fn gpio_modes() {
    let mut host = Host::with_drives();
    assert_eq!(values(&mut host), 0);
    host.chip.wire_gpio(host.now, 3, Some(true));
    host.chip.wire_gpio(host.now, 17, Some(true));
    assert_eq!(values(&mut host), 1 << 17 | 1 << 3);
    assert_eq!(host.call(&GpioGetValue).to(&GpioGetValue), 1 << 3);
    assert_eq!(host.call(&InfoUpdate).header.gpio_inputs, 1 << 3);
    host.run(&GpioSetMode { pins: 0x00F0, mode: GpioMode::Input, pull: GpioPull::Up });
    assert_eq!(values(&mut host) & 0xFF, 0xF8);
    host.chip.wire_gpio(host.now, 4, Some(false));
    assert_eq!(values(&mut host) & 0xFF, 0xE8);

    host.run(&GpioSetMode { pins: 0x0300, mode: GpioMode::Output, pull: GpioPull::None });
    host.run(&GpioSetValue { values: 0x0100 });
    assert!(host.chip.gpio_level(8) && !host.chip.gpio_level(9));
    let upper = UpperPins::new(0b0100).expect("4 pins");
    host.run(&GpioSetModeExt { pins: upper, mode: GpioMode::Output, pull: GpioPull::None });
    host.run(&GpioExtSetValue { values: AllPins::new(1 << 18).expect("20 pins") });
    assert!(host.chip.gpio_level(18) && !host.chip.gpio_level(8));

    // Open drain pulls down or lets go; quasi-bidirectional is high by itself.
    host.run(&GpioSetMode { pins: 0x0400, mode: GpioMode::OpenDrain, pull: GpioPull::Up });
    assert!(!host.chip.gpio_level(10));
    host.run(&GpioSetValue { values: 0x0C00 });
    assert!(host.chip.gpio_level(10));
    host.chip.wire_gpio(host.now, 10, Some(false));
    assert!(!host.chip.gpio_level(10));
    host.run(&GpioSetMode { pins: 0x0800, mode: GpioMode::QuasiBidirectional, pull: GpioPull::None });
    assert!(host.chip.gpio_level(11));
}

/// XF-11.51 The header drives GPIO 0 to 11 if reserve bit 15 is set; from firmware 0x1E on 12 to 15 too, bit 12 being
/// GPIO 13 and bit 13 GPIO 12.
#[test]
fn gpio_by_header() {
    for (profile, wide) in [(Profile::OLD, false), (Profile { version: 0x1E, ..Profile::OLD }, true)] {
        let mut host = Host::new(profile, vec![]);
        host.run(&GpioSetMode { pins: 0xFFFF, mode: GpioMode::Output, pull: GpioPull::None });
        let levels = |host: &Host| (0..16).fold(0_u16, |bits, k| bits | u16::from(host.chip.gpio_level(k)) << k);
        let header = CommandHeader { gpio_outputs: 0x9A55, ..CommandHeader::with_index(100) };
        host.send_with(header, &InfoUpdate);
        assert_eq!(levels(&host), 0);
        host.send_with(CommandHeader { index: 101, reserve: Reserve::GPIO_OUTPUTS_VALID, ..header }, &InfoUpdate);
        assert_eq!(levels(&host), if wide { 0xAA55 } else { 0x0A55 });
    }
}

/// XF-11.52 Edges raise the interrupts of GPIOs as chosen, 4 and 5 as falling and rising; flags are cleared by command
/// and by header, and INT1 has an enable bit for each of GPIO 0 to 11.
#[test]
fn gpio_interrupts() {
    let mut host = Host::with_drives();
    let flags = |host: &mut Host| host.call(&GpioExtGetIntFlag).to(&GpioExtGetIntFlag);
    for (trigger, rising, falling) in [
        (GpioTrigger::Off, false, false),
        (GpioTrigger::Both, true, true),
        (GpioTrigger::Falling, false, true),
        (GpioTrigger::Rising, true, false),
        (GpioTrigger::Driver4, false, true),
        (GpioTrigger::Driver5, true, false),
    ] {
        host.run(&GpioIntEnable { channel: GpioChannel::new(9).expect("0 to 19"), trigger });
        for (level, is_raised) in [(true, rising), (false, falling)] {
            host.chip.wire_gpio(host.now, 9, Some(level));
            assert_eq!(flags(&mut host), u32::from(is_raised) << 9, "{trigger:?} {level}");
            assert_eq!(host.call(&GpioGetIntFlag).to(&GpioGetIntFlag), u16::from(is_raised) << 9);
            assert_eq!(host.call(&InfoUpdate).header.gpio_interrupts, u16::from(is_raised) << 9);
            host.run(&GpioIntClear { pins: 1 << 9 });
            assert_eq!(flags(&mut host), 0);
        }
    }
    let channel = |n| GpioChannel::new(n).expect("0 to 19");
    for (n, gpio, peripherals) in [(0, 1, NO_PERIPHERALS), (8, 0, PeripheralInterrupts::GPIO_8)] {
        host.run(&GpioIntEnable { channel: channel(n), trigger: GpioTrigger::Both });
        host.chip.wire_gpio(host.now, n, Some(true));
        assert!(int1(&mut host));
        host.run(&enable(Polarity::INT0_HIGH, Interrupts::NONE, gpio, peripherals));
        assert!(!int1(&mut host), "active is low");
        clear_interrupts(&mut host, Interrupts::NONE, 1 << n);
        assert!(int1(&mut host));
    }
    host.run(&GpioIntEnable { channel: channel(19), trigger: GpioTrigger::Both });
    host.chip.wire_gpio(host.now, 19, Some(true));
    assert_eq!(flags(&mut host), 1 << 19);
    host.run(&GpioIntClearExt { pins: AllPins::new(1 << 19).expect("20 pins") });
    assert_eq!(flags(&mut host), 0);
}

/// XF-11.53 A debounced input counts when it has kept its level for a period of the clock, 2^exponent of its source.
#[test]
fn debounce() {
    let mut host = Host::with_drives();
    host.run(&GpioEnableDebounce { pins: 0x0001, on: true });
    let upper = UpperPins::new(0b0001).expect("4 pins");
    host.run(&GpioEnableDebounceExt { pins: upper, on: true });
    let clock = DebounceClock::new(7, DebounceSource::Khz10).expect("0 to 15");
    host.run(&GpioSetDebounceClock { clock });
    // 2^7 * 100 us = 12.8 ms.
    for (pin, is_debounced) in [(0, true), (16, true), (1, false)] {
        host.chip.wire_gpio(host.now, pin, Some(true));
        host.pass(5 * MS);
        assert_eq!(values(&mut host) & 1 << pin != 0, !is_debounced);
        // A bounce begins the time again.
        host.chip.wire_gpio(host.now, pin, Some(false));
        host.chip.wire_gpio(host.now, pin, Some(true));
        host.pass(10 * MS);
        assert_eq!(values(&mut host) & 1 << pin != 0, !is_debounced);
        host.pass(5 * MS);
        assert_ne!(values(&mut host) & 1 << pin, 0);
    }
    let fast = DebounceClock::new(15, DebounceSource::Mhz192).expect("0 to 15");
    host.run(&GpioSetDebounceClock { clock: fast });
    // 2^15 / 192 MHz = 171 us: the first of two packets finds the old level, the second one the new.
    host.pace = 120_000;
    host.chip.wire_gpio(host.now, 0, Some(false));
    host.send(&InfoUpdate);
    assert_eq!(host.send(&InfoUpdate).header.gpio_inputs & 1, 1);
    assert_eq!(host.send(&InfoUpdate).header.gpio_inputs & 1, 0);
}

/// XF-11.54 The encoder counts in x4 and x2 while it is started, and raises the interrupts of index and overflow, which
/// bit 29 of the header's flags shows and clears.
#[test]
fn encoder() {
    let mut host = Host::with_drives();
    let count = |host: &mut Host| host.call(&EncGetCount).to(&EncGetCount);
    assert_eq!(host.call(&EncGetCount).errors(), Errors::COMMAND, "it is not open");
    let mut host = Host::with_drives();
    host.run(&EncOpen { mode: EncoderMode::X4Free });
    host.chip.turn_encoder(10);
    assert_eq!(count(&mut host), 0, "it is not started");
    host.run(&EncStart);
    host.chip.turn_encoder(10);
    assert_eq!(count(&mut host), 10);
    host.chip.turn_encoder(-4);
    assert_eq!(count(&mut host), 6);
    host.run(&EncStop);
    host.chip.turn_encoder(100);
    assert_eq!(count(&mut host), 6);
    host.run(&EncOpen { mode: EncoderMode::X2Free });
    host.run(&EncStart);
    host.chip.turn_encoder(7);
    assert_eq!(count(&mut host), 3);

    let encoder = PeripheralInterrupts::ENCODER_INDEX | PeripheralInterrupts::ENCODER_OVERFLOW;
    host.run(&enable(Polarity::INT0_HIGH, Interrupts::NONE, 0, encoder));
    for event in [|host: &mut Host| host.chip.index_encoder(), |host: &mut Host| host.chip.turn_encoder(-8)] {
        assert!(int1(&mut host));
        event(&mut host);
        assert!(!int1(&mut host));
        assert!(host.call(&InfoUpdate).header.interrupts.contains(Interrupts::ENCODER));
        clear_interrupts(&mut host, Interrupts::ENCODER, 0);
        assert!(!host.call(&InfoUpdate).header.interrupts.contains(Interrupts::ENCODER));
    }
    assert_eq!(count(&mut host), u32::MAX);
    // Up to a comparison, the same edge is that one's interrupt.
    host.run(&EncOpen { mode: EncoderMode::X4Compare });
    host.run(&EncStart);
    host.run(&enable(Polarity::INT0_HIGH, Interrupts::NONE, 0, PeripheralInterrupts::ENCODER_COMPARE));
    host.chip.turn_encoder(-1);
    assert!(!int1(&mut host));
}

/// XF-11.55 The DAC puts out what was set when its trigger comes, after its delay.
#[test]
fn dac() {
    let mut host = Host::with_drives();
    let output = |host: &mut Host| host.chip.dac_output(host.now);
    let data = |n| DacSetData { value: Analog::new(n).expect("12 bits") };
    assert_eq!(host.call(&data(5)).errors(), Errors::COMMAND, "it is closed");
    let mut host = Host::with_drives();
    assert_eq!(output(&mut host), None);
    host.run(&DacOpen { trigger: DacTrigger::SetData });
    host.run(&data(1000));
    assert_eq!(output(&mut host), Some(1000));
    host.run(&DacOpen { trigger: DacTrigger::StartConv });
    host.run(&DacSetDelayTime { delay: DacDelay::new(960).expect("10 us") });
    host.run(&data(2000));
    assert_eq!(output(&mut host), Some(1000));
    host.send(&DacStartConv);
    assert_eq!(host.chip.dac_output(host.now + 9_000), Some(1000));
    assert_eq!(host.chip.dac_output(host.now + 11_000), Some(2000));
    let mut value = 2000;
    for (trigger, idle) in [
        (DacTrigger::PinRising, false),
        (DacTrigger::PinFalling, true),
        (DacTrigger::PinHigh, false),
        (DacTrigger::PinLow, true),
    ] {
        host.chip.wire_dac_start(host.now, idle);
        host.run(&DacOpen { trigger });
        value += 100;
        host.run(&data(value));
        assert_eq!(output(&mut host), Some(value as u16 - 100), "{trigger:?}");
        host.chip.wire_dac_start(host.now, !idle);
        host.pass(20_000);
        assert_eq!(output(&mut host), Some(value as u16), "{trigger:?}");
    }
    host.run(&DacClose);
    assert_eq!(output(&mut host), None);
}

/// XF-11.56 The ADC converts its input, or half the difference of two, and says when a value is there.
#[test]
fn adc() {
    let mut host = Host::with_drives();
    assert_eq!(host.call(&AdcStartConv).errors(), Errors::COMMAND, "it is closed");
    let mut host = Host::with_drives();
    let valid = |host: &mut Host| host.call(&AdcGetDataValidFlag).to(&AdcGetDataValidFlag) != 0;
    let value = |host: &mut Host| host.call(&AdcGetConvData).to(&AdcGetConvData).get();
    host.run(&AdcOpen { mode: AdcMode::SingleEnded });
    host.run(&AdcConfigSampleModule);
    host.chip.wire_adc(host.now, 1234, 4000);
    assert!(!valid(&mut host));
    host.run(&AdcStartConv);
    assert!(valid(&mut host));
    assert_eq!(value(&mut host), 1234);
    assert!(!valid(&mut host), "it was read");
    host.run(&AdcOpen { mode: AdcMode::Differential });
    for (positive, negative, read) in [(0, 0, 2048), (4095, 0, 4095), (0, 4095, 1), (2000, 1000, 2548)] {
        host.chip.wire_adc(host.now, positive, negative);
        host.run(&AdcStartConv);
        assert_eq!(value(&mut host), read);
    }
    host.run(&AdcClose);
    assert_eq!(host.call(&AdcStartConv).errors(), Errors::COMMAND);
}

/// XF-11.57 MDIO writes and reads registers of PHYs; there are 32 of each.
#[test]
fn mdio() {
    let mut host = Host::with_drives();
    host.run(&Mdio::Write { phy: 1, register: 4, value: 0x01E1 });
    let read = Mdio::Read { phy: 1, register: 4 };
    assert_eq!(host.call(&read).to(&read).0, Some(0x01E1));
    *host.chip.phy_register_mut(31, 31).expect("the last one") = 7;
    let read = Mdio::Read { phy: 31, register: 31 };
    assert_eq!(host.call(&read).to(&read).0, Some(7));
    let got = host.call(&Mdio::Read { phy: 32, register: 0 });
    assert_eq!((got.errors(), got.has(Status::BUSY)), (Errors::COMMAND, false));
}
