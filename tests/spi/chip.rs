//! The link `xf-spi:`: a chip ECM-XF on SPI.

use ecmsk::io::spi::Level;
use ecmsk::link::chip::{self, ChipError, ChipLink, ResetTimes, SpiChip};
use ecmsk::link::uri::{LinkUri, UriError};
use ecmsk::xf::chip::Profile;
use ecmsk::xf::host::{Host, HostConfig, HostError, HostPacing, Wires};
use ecmsk::xf::request::{
    InterruptEnable, InterruptSetEnable, PeripheralInterrupts, Polarity, SlaveCountGet, SpiPackSizeGet,
};
use ecmsk::xf::{CheckRule, CommandHeader, DataSize, Interrupts, MAX_PACKET, Request, write_request};
use ecmsk::xf_api::{NetworkConfig, XfError};
use support::chip_axis::move_axis;

use super::chip_wires::{ChipWires, Int0, SPEED_HZ};

const HIGH: Int0 = Int0::To(Level::High);
const LOW: Int0 = Int0::To(Level::Low);
const US: u64 = 1_000;
const MS: u64 = 1_000 * US;

/// XF-16.1 Defaults and normal forms of the keys.
#[test]
fn keys_have_these_defaults_and_normal_forms() {
    let normal = |text: &str| LinkUri::parse(text).unwrap().to_string();
    for (text, expected) in [
        ("xf-spi:/dev/spidev0.0?speed=24M&idle_us=150&int0_active=high", "xf-spi:/dev/spidev0.0"),
        ("xf-spi:/dev/spidev1.2?speed=96000k&use_n=256", "xf-spi:/dev/spidev1.2?use_n=256&speed=96M"),
        ("xf-spi:/dev/spidev0.0?reset_at=open&reset=gpiochip0/23", "xf-spi:/dev/spidev0.0?reset=gpiochip0/23"),
        (
            "xf-spi:/dev/spidev0.0?int1=gpiochip0/7&int0_active=low&int0=/dev/gpiochip0/READY",
            "xf-spi:/dev/spidev0.0?int0=/dev/gpiochip0/READY&int0_active=low&int1=gpiochip0/7",
        ),
    ] {
        assert_eq!(normal(text), expected);
        assert_eq!(normal(expected), expected);
    }
    for (key, bad) in [
        ("speed", "97M"),
        ("speed", "99999"),
        ("int0", "yes"),
        ("int0", "gpiochip0/"),
        ("int1", "7"),
        ("int0_active", "1"),
        ("use_n", "31"),
        ("idle_us", "-1"),
        ("reset", "gpiochip0"),
        ("reset_at", "now"),
    ] {
        let error = LinkUri::parse(&format!("xf-spi:/dev/spidev0.0?{key}={bad}")).unwrap_err();
        assert!(matches!(&error, UriError::BadValue { key: named, .. } if named == key), "{key}={bad}: {error}");
        assert!(error.to_string().contains("allowed: "), "{error}");
    }
}

#[track_caller]
fn fails(uri: &str, parts: &[&str]) -> ChipError {
    let error = chip::open(uri).err().expect("it does not open");
    for part in parts {
        assert!(error.to_string().contains(part), "{uri}: {error}: no {part}");
    }
    error
}

/// XF-16.1 XF-16.6 An error in a link is named, with the next step: keys that exclude each other, a device that is
/// missing, of another kind, or in use.
#[test]
fn what_is_wrong_with_a_link_is_named() {
    fails("xf-spi:", &["as its place", "xf-spi:/dev/spidev0.0"]);
    fails("xf-spi:spidev0.0", &["as its place", "xf-spi:/dev/spidev0.0"]);
    fails("xf-spi:/dev/spidev0.0?int0_active=low", &["`int0_active`", "int0=CHIP/LINE"]);
    fails("xf-spi:/dev/spidev0.0?reset_at=both", &["`reset_at`", "reset=CHIP/LINE"]);
    fails("xf-spi:/dev/spidev0.0?busy=gpiochip0/1", &["`busy`", "int0, int0_active, int1"]);
    fails("xf-spi:/dev/spidev999.7", &["/dev/spidev999.7 is not there", "switch SPI on", "correct the link"]);
    fails("xf-spi:/dev/null", &["/dev/null is no device of that kind", "correct the link"]);
    let file = tempfile::NamedTempFile::new().unwrap();
    rustix::fs::flock(&file, rustix::fs::FlockOperation::NonBlockingLockExclusive).unwrap();
    fails(&format!("xf-spi:{}", file.path().display()), &["is in use by another program", "end what uses it"]);
    assert!(matches!(fails("spi:/dev/spidev0.0", &["xf-sim:"]), ChipError::NotAChip { .. }));
    // The same if a board is opened over them.
    let board = ecmsk::link::open("xf-spi:/dev/spidev999.7", ecmsk::link::Share::ByName).err().expect("no board");
    for part in ["no board at `xf-spi:/dev/spidev999.7`", "is not there", "switch SPI on"] {
        assert!(board.to_string().contains(part), "{board}: no {part}");
    }
}

/// XF-16.2 The link's description.
#[test]
fn a_link_says_what_it_is() {
    let link = |int0| SpiChip::over("xf-spi:test", ChipWires::new(Profile::NEW, 1, int0), SPEED_HZ).info();
    let info = link(HIGH);
    assert_eq!((info.name.as_str(), info.size, info.clock_hz), ("xf-spi:test", None, Some(SPEED_HZ)));
    assert!(info.has_int0 && !info.virtual_time);
    assert!(!link(Int0::None).has_int0);
}

/// XF-16.2 XF-16.3 An axis moves over SPI, with INT0 and by idle time. Each exchange is one whole packet once the begin
/// of packets is known; with INT0 no packet is sent before the chip is ready.
#[test]
fn an_axis_moves() {
    for (profile, int0) in [(Profile::NEW, HIGH), (Profile::NEW, Int0::None), (Profile::OLD, HIGH)] {
        let mut xf = ChipWires::new(profile, 1, int0).open().unwrap();
        xf.link_mut().wires_mut().lengths.clear();
        let before = xf.host().counters();
        move_axis(&mut xf).unwrap();
        let counters = xf.host().counters();
        assert_eq!((counters.damaged, counters.int0_missed), (before.damaged, before.int0_missed));
        assert_eq!(counters.not_ready, before.not_ready);
        // Process data have set the largest size that fits their cycle.
        let packets = [profile.size, xf.host().size()].map(DataSize::packet_len);
        assert!(xf.link_mut().wires_mut().lengths.iter().all(|length| packets.contains(length)));
    }
}

/// XF-16.3 INT0 is faster than idle time: the same commands take less time with it.
#[test]
fn int0_saves_time() {
    let took = |int0| {
        let mut xf = ChipWires::new(Profile::OLD, 1, int0).open().unwrap();
        let begin = xf.link().now();
        (0..100).for_each(|_| assert_eq!(xf.run(&SpiPackSizeGet).unwrap(), DataSize::MANUAL));
        xf.link().now() - begin
    };
    // 48 us on the wires, and then 100 us of the model against 150 us of idle time.
    let (by_int0, by_time) = (took(HIGH), took(Int0::None));
    assert!(by_int0 * 4 < by_time * 3, "{by_int0} and {by_time} ns");
}

/// XF-16.3 An edge from before an exchange does not count: the driver waits for the edge after the exchange began.
#[test]
fn an_older_edge_does_not_count() {
    let mut link = SpiChip::over("xf-spi:test", ChipWires::new(Profile::OLD, 1, HIGH), SPEED_HZ);
    link.wait_until(1_000 * MS).unwrap();
    let mut packet = [0; MAX_PACKET];
    let header = CommandHeader::with_index(1);
    let packet =
        write_request(&mut packet, DataSize::MANUAL, CheckRule::FIXED, header, &Request::from(SlaveCountGet)).unwrap();
    let mut back = vec![0; packet.len()];
    for stray in [0, 1, 40] {
        link.wires_mut().edges = stray;
        link.exchange(packet, &mut back).unwrap();
        let end = link.now();
        assert!(!link.wait_ready(end + 50 * US).unwrap(), "{stray}");
        assert_eq!(link.now(), end + 50 * US);
        assert!(link.wait_ready(end + 10 * MS).unwrap(), "{stray}");
        assert_eq!(link.now(), end + 100 * US, "{stray}");
    }
    // Without the line there is nothing to wait for.
    link.wires_mut().int0 = Int0::None;
    let begin = link.now();
    assert!(!link.wait_ready(begin + MS).unwrap());
    assert_eq!(link.now(), begin);
}

fn interrupts(polarity: Polarity, sources: Interrupts) -> InterruptEnable {
    InterruptEnable { polarity, sources, gpio: 0, peripherals: PeripheralInterrupts::NONE }
}

/// XF-16.4 The polarity of INT0 is that of INT_SET_ENABLE: with `int0_active=low` the chip starts, but slowly; once the
/// polarity is set, every edge means that the chip is ready.
#[test]
fn int0_may_be_active_low() {
    let mut xf = ChipWires::new(Profile::NEW, 1, LOW).open().unwrap();
    let enable = interrupts(Polarity::NONE, Interrupts::NONE);
    xf.run(&InterruptSetEnable { enable }).unwrap();
    xf.run(&SlaveCountGet).unwrap();
    let before = xf.host().counters();
    move_axis(&mut xf).unwrap();
    let counters = xf.host().counters();
    assert_eq!((counters.not_ready, counters.int0_missed), (before.not_ready, before.int0_missed));
}

/// XF-16.5 A lost edge of INT0 costs its deadline, and nothing else.
#[test]
fn lost_edges_are_survived() {
    let mut wires = ChipWires::new(Profile::NEW, 1, HIGH);
    wires.loses_every = 7;
    let mut xf = wires.open().unwrap();
    move_axis(&mut xf).unwrap();
    let counters = xf.host().counters();
    assert!(counters.int0_missed > 100, "{counters:?}");
    assert_eq!((counters.rx_dropped, counters.rx_unknown), (0, 0));
}

/// XF-16.5 INT0 that never comes is an error that says so.
#[test]
fn int0_on_another_line_is_an_error() {
    let mut wires = ChipWires::new(Profile::NEW, 1, HIGH);
    wires.loses_every = 1;
    let error = wires.open().err().expect("it does not start");
    assert!(matches!(error, XfError::Chip(HostError::Int0Missing { times: 3, .. })), "{error}");
    assert!(error.to_string().contains("INT0"), "{error}");
}

/// XF-16.6 A failed exchange returns an error to the caller, with the next step; when the wires work again the driver
/// goes on, and a pending command is executed once.
#[test]
fn an_exchange_that_fails_is_an_error() {
    let mut xf = ChipWires::new(Profile::NEW, 1, HIGH).open().unwrap();
    xf.link_mut().wires_mut().failures = 1;
    let error = xf.start_network(&NetworkConfig::default()).expect_err("the wires are away");
    let text = error.to_string();
    assert!(matches!(error, XfError::Link(ChipError::Wires { .. })), "{text}");
    assert!(text.contains("no such device; look at speed=") && text.contains("xf-spi:test"), "{text}");
    move_axis(&mut xf).unwrap();
}

/// XF-16.7 After a reset of the chip, pending commands end with that error once it has started; the driver starts it
/// again, and it works as before.
#[test]
fn a_chip_that_was_reset_starts_again() {
    for int0 in [HIGH, Int0::None] {
        let mut xf = ChipWires::new(Profile::NEW, 1, int0).open().unwrap();
        move_axis(&mut xf).unwrap();
        xf.link_mut().wires_mut().reset_chip();
        let (mut resets, mut silent) = (0, 0);
        while let Err(error) = xf.run(&SlaveCountGet) {
            match error {
                XfError::Chip(HostError::ChipReset) => resets += 1,
                // While it starts it answers nothing.
                XfError::Chip(HostError::NoAnswer { .. }) => silent += 1,
                other => panic!("{other}"),
            }
            assert!(silent < 20, "it does not come back");
        }
        assert_eq!(resets, 1);
        move_axis(&mut xf).unwrap();
        assert_eq!(xf.host().counters().chip_resets, 1);
    }
}

/// XF-16.12 XF-11.74 The reset line is low for 100 ms when the link is opened, closed, or both; the chip starts as
/// after power-on, also in the middle of a packet.
///
/// Row: reset.
#[test]
fn the_reset_line() {
    for (at_open, at_close) in [(false, false), (true, false), (false, true), (true, true)] {
        let mut wires = ChipWires::new(Profile::NEW, 1, HIGH);
        let resets = wires.resets.clone();
        // An earlier host has left the chip in the middle of a packet, with another n.
        ecmsk::io::spi::EdgeWires::sleep(&mut wires, std::time::Duration::from_secs(1));
        ecmsk::io::spi::EdgeWires::exchange(&mut wires, &[0; 700], &mut [0; 700]).unwrap();
        let count = || resets.lock().unwrap().clone();
        let link = SpiChip::over("xf-spi:test", wires, SPEED_HZ).reset_at(ResetTimes { at_open, at_close }).unwrap();
        let low = std::time::Duration::from_millis(100);
        assert_eq!(count(), vec![low; usize::from(at_open)]);
        let mut xf =
            ecmsk::xf_api::Xf::over(link, HostConfig { pacing: HostPacing::Int0, ..HostConfig::DEFAULT }).unwrap();
        move_axis(&mut xf).unwrap();
        xf.link_mut().reset().unwrap();
        drop(xf);
        assert_eq!(count().len(), 1 + usize::from(at_open) + usize::from(at_close));
    }
}

/// XF-16.2 `use_n=` sets the size of the packets at the start.
#[test]
fn the_size_of_packets_is_set_at_the_start() {
    let wanted = DataSize::new(256).unwrap();
    for int0 in [HIGH, Int0::None] {
        let config = HostConfig { wanted_size: Some(wanted), ..HostConfig::DEFAULT };
        let mut xf = ChipWires::new(Profile::NEW, 1, int0).open_with(config).unwrap();
        assert_eq!(xf.host().size(), wanted);
        xf.link_mut().wires_mut().lengths.clear();
        move_axis(&mut xf).unwrap();
        assert!(xf.link_mut().wires_mut().lengths.iter().all(|length| *length == 288));
    }
}

/// XF-16.8 The level of INT1 is the chip's: low while an enabled flag is set, and high otherwise.
#[test]
fn int1_has_its_level() {
    let mut xf = ChipWires::new(Profile::NEW, 1, HIGH).open().unwrap();
    assert_eq!(xf.link_mut().int1().unwrap(), Some(true));
    let enable = interrupts(Polarity::INT0_HIGH, Interrupts::ETHERCAT);
    xf.run(&InterruptSetEnable { enable }).unwrap();
    move_axis(&mut xf).unwrap();
    assert_eq!(xf.link_mut().int1().unwrap(), Some(false));
}

/// XF-16.2 In an exchange and a wait the link allocates nothing.
#[test]
fn an_exchange_allocates_nothing() {
    let mut wires = ChipWires::new(Profile::NEW, 1, HIGH);
    wires.lengths.reserve(100_000);
    let mut link = SpiChip::over("xf-spi:test", wires, SPEED_HZ);
    let mut host = Host::new(0, HostConfig { pacing: ecmsk::xf::host::HostPacing::Int0, ..HostConfig::DEFAULT });
    let counted = allocation_counter::measure(|| {
        for _ in 0..1000 {
            host.step(&mut link, u64::MAX).unwrap();
        }
    });
    assert_eq!(counted.count_total, 0, "{counted:?}");
}
