//! The schemes of links: the ways to reach a board or a chip.

use std::fmt;

/// The scheme of a link, which is the way to reach a board or a chip: the word before the colon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Scheme {
    /// A simulated board in this process.
    Sim,
    /// A real ECM-SK on USB.
    Usb,
    /// A real ECM-SK on SPI.
    Spi,
    /// A board that another process or another machine serves over TCP.
    Tcp,
    /// A simulated ECM-XF in this process: a board that reaches its slaves over the chip, or, by
    /// [`chip::open`](crate::link::chip::open), the chip itself.
    XfSim,
    /// A real ECM-XF on SPI: a board that reaches its slaves over the chip, or the chip itself, as with `xf-sim:`.
    XfSpi,
    /// A real ECM-XFU on USB: a board that reaches its slaves over the chip, or the chip itself, as with `xf-sim:`.
    XfUsb,
    /// A board of this process whose slaves are connected to a network card.
    Nic,
}

/// A Cargo feature of this crate.
struct Feature {
    name: &'static str,
    is_on: bool,
}

const SIM: Feature = Feature { name: "sim", is_on: cfg!(feature = "sim") };
const USB: Feature = Feature { name: "usb", is_on: cfg!(feature = "usb") };
const SPI: Feature = Feature { name: "spi", is_on: cfg!(feature = "spi") };
const TCP: Feature = Feature { name: "tcp", is_on: cfg!(feature = "tcp") };
const NIC: Feature = Feature { name: "nic", is_on: cfg!(feature = "nic") };

/// The path of a link over SPI.
const SPI_DEVICE: Option<&str> = Some("/dev/spidevB.C");

/// The properties of a scheme. The code that opens its links is in `open/`.
struct Row {
    name: &'static str,
    feature: Feature,
    /// Whether this operating system supports links of the scheme.
    is_of_this_system: bool,
    path: Option<&'static str>,
    meaning: &'static str,
}

impl Scheme {
    /// All schemes, including those that this build cannot open.
    pub const ALL: [Self; 8] =
        [Self::Sim, Self::Usb, Self::Spi, Self::Tcp, Self::XfSim, Self::XfSpi, Self::XfUsb, Self::Nic];

    const fn row(self) -> Row {
        match self {
            Self::Sim => Row {
                name: "sim",
                feature: SIM,
                is_of_this_system: true,
                path: None,
                meaning: "a simulated board in this process",
            },
            Self::Usb => Row {
                name: "usb",
                feature: USB,
                is_of_this_system: cfg!(any(unix, windows)),
                path: None,
                meaning: "a real ECM-SK on USB",
            },
            Self::Spi => Row {
                name: "spi",
                feature: SPI,
                is_of_this_system: cfg!(target_os = "linux"),
                path: SPI_DEVICE,
                meaning: "a real ECM-SK on SPI",
            },
            Self::Tcp => Row {
                name: "tcp",
                feature: TCP,
                is_of_this_system: cfg!(any(unix, windows)),
                path: Some("//HOST:PORT"),
                meaning: "a board that another process or machine serves (`ecmsk serve tcp`)",
            },
            Self::XfSim => Row {
                name: "xf-sim",
                feature: SIM,
                is_of_this_system: true,
                path: None,
                meaning: "a simulated board whose slaves are behind an ECM-XF; for `ecmsk xf` and `ecmsk::Xf` that chip itself, \
                          without the keys of a board",
            },
            Self::XfSpi => Row {
                name: "xf-spi",
                feature: SPI,
                is_of_this_system: cfg!(target_os = "linux"),
                path: SPI_DEVICE,
                meaning: "a board of this process whose slaves are behind a real ECM-XF on SPI; or that chip itself",
            },
            Self::XfUsb => Row {
                name: "xf-usb",
                feature: USB,
                is_of_this_system: cfg!(unix),
                path: None,
                meaning: "the same behind a real ECM-XFU on USB",
            },
            Self::Nic => Row {
                name: "nic",
                feature: NIC,
                is_of_this_system: cfg!(target_os = "linux"),
                path: Some("INTERFACE"),
                meaning: "a board of this process whose slaves are at the end of a network card, e.g. nic:eth1: no board is \
                          there at all",
            },
        }
    }

    /// The word before the colon.
    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// The Cargo feature of this crate that links of the scheme need.
    pub const fn feature(self) -> &'static str {
        self.row().feature.name
    }

    /// The scheme with that name; `None` if there is none.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|scheme| scheme.name() == name)
    }

    /// Whether this build can open links of the scheme. It needs [its feature](Self::feature) and an operating system that
    /// [supports such links](Self::is_of_this_system).
    pub const fn in_build(self) -> bool {
        self.row().feature.is_on && self.is_of_this_system()
    }

    /// Whether this operating system supports links of the scheme: links over SPI or a network card need Linux, and an
    /// ECM-XFU on USB any system but Windows.
    pub const fn is_of_this_system(self) -> bool {
        self.row().is_of_this_system
    }

    /// The next step for a user whose build cannot open links of the scheme, for messages.
    pub fn instead(self) -> String {
        let feature = self.feature();
        match self {
            _ if self.is_of_this_system() => {
                format!("it needs the feature `{feature}`: build with `cargo build --release --features {feature}`")
            }
            Self::XfSpi | Self::XfUsb => {
                "this system has no such links: run the program on a machine with Linux that the chip is wired to".to_owned()
            }
            _ => "this system has no such links: serve the board by `ecmsk serve tcp` on a machine with Linux that it is wired to, and \
                  name it here by tcp://HOST:PORT"
                .to_owned(),
        }
    }

    /// Whether the network is a model in this process, with simulated slaves and a clock that can be virtual.
    pub const fn is_model(self) -> bool {
        matches!(self, Self::Sim | Self::XfSim)
    }

    /// Whether links of this scheme contain an ECM-XF, which [`chip::open`](crate::link::chip::open) can open directly.
    pub const fn has_chip(self) -> bool {
        matches!(self, Self::XfSim | Self::XfSpi | Self::XfUsb)
    }

    /// The syntax of the text between the colon and the question mark; `None` if the scheme allows no text there.
    pub const fn path(self) -> Option<&'static str> {
        self.row().path
    }

    /// The meaning of the scheme in the text of `ecmsk link help`.
    pub(crate) const fn meaning(self) -> &'static str {
        self.row().meaning
    }
}

impl fmt::Display for Scheme {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
