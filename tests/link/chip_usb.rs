//! The link `xf-usb:`: a chip ECM-XFU, with packets controlled by the test, in virtual time.
#![cfg(unix)]

use std::time::Duration;

use ecmsk::ethercat::Ns;
use ecmsk::io::hid::{PacketWires, UsbError, UsbPacketError};
use ecmsk::link::chip::{self, ChipError, ChipLink, UsbChip};
use ecmsk::link::uri::{LinkUri, UriError};
use ecmsk::slave::{Drive, DriveConfig, Slave};
use ecmsk::xf::DataSize;
use ecmsk::xf::chip::{Chip, ChipPort, Profile, SlaveModels};
use ecmsk::xf::host::HostConfig;
use ecmsk::xf::request::SpiPackSizeGet;
use ecmsk::xf_api::{Xf, XfError};
use support::chip_axis::move_axis;

const PACKET: usize = 1024;

/// Packets to the model of an ECM-XFU with one drive.
struct Packets {
    port: ChipPort<SlaveModels>,
    now: Ns,
    /// Number of the next exchanges that fail.
    failures: u32,
    /// Number of the next answers that are damaged.
    damaged: u32,
    exchanges: u32,
}

impl Packets {
    fn new() -> Self {
        let drive = Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>;
        let port = ChipPort::new(Chip::new(Profile::XFU, SlaveModels::new(vec![drive])));
        Self { port, now: 0, failures: 0, damaged: 0, exchanges: 0 }
    }

    fn open(self) -> Result<Xf<UsbChip<Self>>, XfError> {
        let link = UsbChip::over("xf-usb:test", self);
        let size = link.info().size;
        Xf::over(link, HostConfig { size, ..HostConfig::DEFAULT })
    }
}

impl PacketWires for Packets {
    fn now_ns(&self) -> u64 {
        self.now
    }

    fn sleep(&mut self, time: Duration) {
        self.now += time.as_nanos() as Ns;
    }

    fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), UsbPacketError> {
        assert_eq!((tx.len(), rx.len()), (PACKET, PACKET));
        self.exchanges += 1;
        if self.failures > 0 {
            self.failures -= 1;
            return Err(UsbError::Io.into());
        }
        self.now += 250_000;
        self.port.transfer(self.now, tx, rx);
        if self.damaged > 0 {
            self.damaged -= 1;
            rx.fill(0xA5);
        }
        Ok(())
    }
}

/// XF-16.10 An axis moves over USB, with packets of 1024 bytes only.
#[test]
fn an_axis_moves_over_usb() {
    let mut xf = Packets::new().open().unwrap();
    assert_eq!(xf.run(&SpiPackSizeGet).unwrap(), DataSize::XFU);
    move_axis(&mut xf).unwrap();
    let info = xf.link().info();
    assert_eq!((info.size, info.clock_hz, info.has_int0), (Some(DataSize::XFU), None, false));
    assert_eq!(xf.link_mut().int1().unwrap(), None);
}

/// XF-16.10 After invalid answers the driver finds the packets again, although it searches in steps smaller than a
/// packet of USB.
#[test]
fn packets_are_found_again() {
    let mut xf = Packets::new().open().unwrap();
    move_axis(&mut xf).unwrap();
    let searches = xf.host().counters().searches;
    xf.link_mut().wires_mut().damaged = 20;
    assert_eq!(xf.run(&SpiPackSizeGet).unwrap(), DataSize::XFU);
    assert!(xf.host().counters().searches > searches);
    move_axis(&mut xf).unwrap();
}

/// XF-16.11 A failed exchange returns an error to the caller; afterwards the driver goes on.
#[test]
fn an_exchange_that_fails_is_an_error() {
    let mut xf = Packets::new().open().unwrap();
    xf.link_mut().wires_mut().failures = 1;
    let error = xf.run(&SpiPackSizeGet).unwrap_err();
    assert!(matches!(error, XfError::Link(ChipError::Wires { .. })), "{error}");
    assert!(error.to_string().contains("xf-usb:test: input/output error; pull it"), "{error}");
    move_axis(&mut xf).unwrap();
}

/// XF-16.10 Ids and endpoints have to be given, since they are not documented; the error says so.
#[test]
fn ids_and_endpoints_have_to_be_given() {
    let refused = |uri: &str| chip::open(uri).err().expect("it does not open").to_string();
    for (uri, key) in [
        ("xf-usb:", "vid"),
        ("xf-usb:?vid=1234", "pid"),
        ("xf-usb:?vid=1234&pid=abcd", "ep_out"),
        ("xf-usb:?vid=1234&pid=abcd&ep_out=2", "ep_in"),
    ] {
        let said = refused(uri);
        assert!(said.contains(&format!("`xf-usb:` needs the key `{key}`: ")), "{said}");
        assert!(said.contains("no manual tells") && said.contains("allowed: "), "{said}");
    }
    let normal = |text: &str| LinkUri::parse(text).unwrap().to_string();
    assert_eq!(normal("xf-usb:?ep_in=1&pid=0xABCD&ep_out=2&vid=c"), "xf-usb:?vid=000c&pid=abcd&ep_out=2&ep_in=1");
    for (key, bad) in [("vid", "12345"), ("vid", "xyz"), ("pid", "0x"), ("pid", "+1"), ("ep_in", "0"), ("ep_out", "16")]
    {
        let error = LinkUri::parse(&format!("xf-usb:?{key}={bad}")).unwrap_err();
        assert!(matches!(&error, UriError::BadValue { key: named, .. } if named == key), "{key}={bad}: {error}");
    }
    // An ECM-XFU has packets of one size only.
    assert!(matches!(LinkUri::parse("xf-usb:?use_n=112"), Err(UriError::UnknownKey { .. })));
}
