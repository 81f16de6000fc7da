//! Behaviour of GPIOs that only single packets show.

use ecmsk::xf::chip::Profile;
use ecmsk::xf::request::{
    DebounceClock, DebounceSource, GpioEnableDebounce, GpioMode, GpioPull, GpioSetDebounceClock, GpioSetMode,
    InfoUpdate,
};
use ecmsk::xf::{CommandHeader, Reserve};

use super::Host;

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

/// XF-11.53 A fast clock: 2^15 / 192 MHz = 171 us. The first of two packets finds the old level, the second one the
/// new.
#[test]
fn debounce_of_a_fast_clock() {
    let mut host = Host::with_drives();
    host.run(&GpioEnableDebounce { pins: 0x0001, on: true });
    let clock = DebounceClock::new(15, DebounceSource::Mhz192).expect("0 to 15");
    host.run(&GpioSetDebounceClock { clock });
    host.pace = 120_000;
    host.chip.wire_gpio(host.now, 0, Some(true));
    let seen = [0, 1, 2].map(|_| host.send(&InfoUpdate).header.gpio_inputs & 1);
    assert_eq!(seen[1..], [0, 1]);
}
