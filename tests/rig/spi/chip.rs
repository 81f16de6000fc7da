//! The link `xf-spi:`, with the kernel's SPI and GPIO code between it and the model of an ECM-XF.

use std::fs;
use std::thread;
use std::time::{Duration, Instant};

use ecmsk::ethercat::Ns;
use ecmsk::link::chip::{self, ChipLink};
use ecmsk::slave::{Drive, DriveConfig, Slave};
use ecmsk::xf::chip::{Chip, ChipPort, Profile, SlaveModels};
use ecmsk::xf::host::{HostConfig, Timeouts};
use ecmsk::xf::request::{
    InterruptEnable, InterruptSetEnable, PeripheralInterrupts, Polarity, SlaveCountGet, SpiPackSizeGet,
};
use ecmsk::xf::{DataSize, Interrupts};
use ecmsk::xf_api::{Xf, XfError};

use super::played::{Board, Busy, Played, Seen};
use super::{BUSY, CHIP, RESET_KEY};
use support::chip_axis::move_axis;
use support::served::until;

const BY_TIME: &str = "xf-spi:/dev/spidev0.0";
const BY_INT0: &str = "xf-spi:/dev/spidev0.0?int0=gpiochip0/BUSY";

/// The chip on the wires. The line BUSY is its INT0.
pub struct WiredChip {
    port: ChipPort<SlaveModels>,
    power_on: Instant,
}

impl WiredChip {
    /// A chip with one drive, powered on now.
    #[track_caller]
    fn start(profile: Profile) -> Played {
        Self::start_with(profile, vec![Box::new(Drive::new(DriveConfig::default()))])
    }

    /// A chip with these slaves, powered on now.
    #[track_caller]
    pub fn start_with(profile: Profile, slaves: Vec<Box<dyn Slave>>) -> Played {
        let port = ChipPort::new(Chip::new(profile, SlaveModels::new(slaves)));
        Played::start(Self { port, power_on: Instant::now() }, Busy::True)
    }

    fn now(&self) -> Ns {
        self.power_on.elapsed().as_nanos() as Ns
    }
}

impl Board for WiredChip {
    fn exchange(&mut self, mosi: &[u8], miso: &mut [u8]) {
        self.port.transfer(self.now(), mosi, miso);
    }

    fn process(&mut self) {
        thread::sleep(Duration::from_nanos(self.port.chip().ready_at().saturating_sub(self.now())));
    }

    fn is_busy(&mut self) -> bool {
        let now = self.now();
        self.port.chip_mut().int0(now);
        !self.port.chip().is_ready()
    }

    fn level(&mut self, busy: bool) -> bool {
        let now = self.port.chip().now();
        let is_active_high = self.port.chip_mut().int0(now) == self.port.chip().is_ready();
        busy != is_active_high
    }
}

/// A started chip behind that link. The guest is slow, so that the driver waits longer than elsewhere. While it waits for an
/// answer and while it searches it exchanges one packet after the other, which takes the host of the guest much time, so that
/// those two limits are only some times the usual ones.
#[track_caller]
fn open(uri: &str) -> Xf {
    const S: Ns = 1_000_000_000;
    let (link, config) = chip::open(uri).unwrap_or_else(|error| panic!("{uri}: {error}"));
    let timeouts = Timeouts {
        search_ns: 6 * S,
        start_ns: 60 * S,
        int0_ns: 5 * S,
        answer_ns: 2 * S,
        busy_ns: 60 * S,
        ..config.timeouts
    };
    Xf::over(link, HostConfig { timeouts, ..config }).unwrap_or_else(|error| panic!("{uri}: {error}"))
}

/// Length and transfers of the exchanges since the last change of their length.
fn shapes(seen: &Seen, len: usize) -> Vec<(usize, u32, u8, u8, u16)> {
    let behind = seen.exchanges.iter().rposition(|exchange| exchange.len != len).map_or(0, |last| last + 1);
    let shape = |each: &super::wires::Exchange| (each.len, each.speed_hz, each.mode, each.bits, each.transfers);
    let mut shapes: Vec<_> = seen.exchanges[behind..].iter().map(shape).collect();
    shapes.dedup();
    shapes
}

/// XF-16.2 XF-16.3 A chip is started, its network brought to OP, objects read and written and an axis moved by process
/// data, by idle time and by INT0, with packets of its default size and of another one. On the wires there is one
/// transfer per packet, and with INT0 none before the chip is ready.
#[test]
fn an_axis_moves() {
    let old = Profile::OLD;
    for (profile, uri, len) in [
        (old, BY_TIME.to_owned(), 144),
        (old, BY_INT0.to_owned(), 144),
        (Profile::NEW, format!("{BY_INT0}&use_n=112"), 144),
        (Profile::NEW, format!("{BY_TIME}?use_n=256"), 288),
        (Profile::NEW, BY_INT0.to_owned(), 1056),
    ] {
        let played = WiredChip::start(profile);
        let mut xf = open(&uri);
        assert_eq!(xf.run(&SpiPackSizeGet).unwrap().packet_len(), len, "{uri}");
        let before = played.seen();
        move_axis(&mut xf).unwrap_or_else(|error| panic!("{uri}: {error}"));
        let counters = xf.host().counters();
        assert_eq!(counters.int0_missed, 0, "{uri}: {counters:?}");
        // Process data have set the largest size that fits their cycle, unless the link sets it.
        let last_len = xf.host().size().packet_len();
        assert!(last_len == len || !uri.contains("use_n"), "{uri}");
        drop(xf);
        let seen = played.stop();
        assert!(seen.exchanges.len() > before.exchanges.len() + 500, "{uri}");
        if uri.contains("int0") {
            assert_eq!(seen.while_busy, before.while_busy, "{uri}");
        }
        assert_eq!(shapes(&seen, last_len), [(last_len, 24_000_000, 0, 8, 1)], "{uri}");
    }
}

/// XF-16.12 The chip's reset line is low for 100 ms or a little longer, when the link is opened, when it is closed, or at both.
#[test]
fn the_reset_line_is_pulled() {
    for (key, at_open, at_close) in [("", 1, 0), ("&reset_at=close", 0, 1), ("&reset_at=both", 1, 1)] {
        let played = WiredChip::start(Profile::NEW);
        let xf = open(&format!("{BY_INT0}&reset={RESET_KEY}{key}"));
        let pulses = || played.seen().resets.chunks(2).map(|edges| edges.to_vec()).collect::<Vec<_>>();
        assert_eq!(pulses().len(), at_open, "{key}");
        drop(xf);
        let all = until("each pulse has its end", || {
            let pulses = pulses();
            (pulses.len() == at_open + at_close && pulses.iter().all(|edges| edges.len() == 2)).then_some(pulses)
        });
        for edges in all {
            assert!(!edges[0].high && edges[1].high, "{key}: {edges:?}");
            assert!(edges[1].at_ns - edges[0].at_ns >= 100_000_000, "{key}: {edges:?}");
        }
    }
}

/// XF-16.1 The link opened as by programs, with the driver's default timeouts and the link's clock.
#[test]
fn a_chip_is_opened_by_its_link() {
    let played = WiredChip::start(Profile::NEW);
    for uri in [format!("{BY_TIME}?speed=6M"), format!("{BY_INT0}&speed=6M")] {
        let mut xf = until("it opens", || Xf::open(&uri).ok());
        let size = until("it answers", || xf.run(&SpiPackSizeGet).ok());
        assert_eq!(size, DataSize::NEWER);
        assert_eq!(xf.link().info().has_int0, uri.contains("int0"));
    }
    assert!(played.stop().exchanges.iter().all(|each| each.speed_hz == 6_000_000));
}

/// XF-16.4 INT0 of a chip that is set to active low.
#[test]
fn int0_is_active_low() {
    let played = WiredChip::start(Profile::OLD);
    let mut xf = open(&format!("{BY_INT0}&int0_active=low"));
    let enable = InterruptEnable {
        polarity: Polarity::NONE,
        sources: Interrupts::NONE,
        gpio: 0,
        peripherals: PeripheralInterrupts::NONE,
    };
    xf.run(&InterruptSetEnable { enable }).unwrap();
    xf.run(&SlaveCountGet).unwrap();
    let before = played.seen().while_busy;
    move_axis(&mut xf).unwrap();
    drop(xf);
    assert_eq!(played.stop().while_busy, before);
}

/// XF-16.7 A chip that loses its power is started again by the same driver.
#[test]
fn a_chip_that_was_reset_starts_again() {
    let played = WiredChip::start(Profile::OLD);
    let mut xf = open(BY_INT0);
    move_axis(&mut xf).unwrap();
    drop(played);
    let _again = WiredChip::start(Profile::OLD);
    until("it answers", || match xf.run(&SpiPackSizeGet) {
        Ok(_) => Some(()),
        Err(XfError::Chip(_)) => None,
        Err(error) => panic!("{error}"),
    });
    assert_eq!(xf.host().counters().chip_resets, 1);
    move_axis(&mut xf).unwrap();
}

/// XF-16.6 A missing device and one that is in use are named, with the next step; afterwards no file is left open.
#[test]
fn wires_that_cannot_be_used_are_named() {
    let _played = WiredChip::start(Profile::OLD);
    let refused = |uri: &str| chip::open(uri).err().expect("it does not open").to_string();
    let files = || fs::read_dir("/proc/self/fd").expect("the guest has it").count();
    let before = files();
    let missing = refused("xf-spi:/dev/spidev7.0");
    assert!(missing.contains("/dev/spidev7.0 is not there") && missing.contains("/dev/spidev0.0"), "{missing}");
    let no_chip = refused(&format!("{BY_TIME}?int0=gpiochip7/0"));
    assert!(no_chip.contains("/dev/gpiochip7 is not there") && no_chip.contains("/dev/gpiochip0"), "{no_chip}");
    let no_line = refused(&format!("{BY_TIME}?int1=gpiochip0/2"));
    assert!(no_line.contains("lines 0 to 1"), "{no_line}");
    let xf = open(BY_INT0);
    let device = refused(BY_TIME);
    assert!(device.contains("/dev/spidev0.0 is in use") && device.contains("end what uses it"), "{device}");
    drop(xf);
    let line = gpiocdev::Request::builder().on_chip(CHIP).with_line(BUSY).as_input().request();
    let taken = refused(BY_INT0);
    assert!(taken.contains("line BUSY of /dev/gpiochip0 is in use"), "{taken}");
    drop(line);
    open(BY_INT0);
    assert_eq!(files(), before, "files that stay open");
}

/// XF-16.5 A missing INT0, because another line was named or its wire is off, is an error that names it.
#[test]
fn int0_that_stays_away_is_named() {
    for stuck in [false, true] {
        let drive = Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>;
        let port = ChipPort::new(Chip::new(Profile::OLD, SlaveModels::new(vec![drive])));
        let _played = Played::start(WiredChip { port, power_on: Instant::now() }, Busy::Stuck(stuck));
        let error = Xf::open(BY_INT0).err().expect("it does not start").to_string();
        assert!(error.contains("INT0"), "{error}");
    }
}
