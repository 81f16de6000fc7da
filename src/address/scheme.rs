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

/// The operating systems, one bit each; [`Row::systems`] combines those on which a scheme can be used.
const LINUX: u8 = 1 << 0;
const OTHER_UNIX: u8 = 1 << 1;
const WINDOWS: u8 = 1 << 2;
const OTHER: u8 = 1 << 3;
const UNIX: u8 = LINUX | OTHER_UNIX;
const EVERY: u8 = UNIX | WINDOWS | OTHER;

/// The operating system of this build, as one of the bits above.
const SYSTEM: u8 = if cfg!(target_os = "linux") {
    LINUX
} else if cfg!(unix) {
    OTHER_UNIX
} else if cfg!(windows) {
    WINDOWS
} else {
    OTHER
};

/// The name of a Cargo feature together with a `bool`: whether this build was compiled with the feature.
macro_rules! feature {
    ($name:tt) => {
        ($name, cfg!(feature = $name))
    };
}

/// The path of links over SPI, for the help: bus B and chip select C of Linux' spidev. Used by `spi:` and `xf-spi:`.
const SPI_DEVICE: Option<&str> = Some("/dev/spidevB.C");

/// The properties of a scheme. The code that opens its links is in `open/`.
struct Row {
    name: &'static str,
    /// The Cargo feature that links of the scheme need, and whether this build has the feature.
    feature: (&'static str, bool),
    /// The operating systems on which links of the scheme exist: [`LINUX`] and the other bits above, combined.
    systems: u8,
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
                feature: feature!("sim"),
                systems: EVERY,
                path: None,
                meaning: "a simulated board in this process",
            },
            Self::Usb => Row {
                name: "usb",
                feature: feature!("usb"),
                systems: UNIX | WINDOWS,
                path: None,
                meaning: "a real ECM-SK on USB",
            },
            Self::Spi => Row {
                name: "spi",
                feature: feature!("spi"),
                systems: LINUX,
                path: SPI_DEVICE,
                meaning: "a real ECM-SK on SPI",
            },
            Self::Tcp => Row {
                name: "tcp",
                feature: feature!("tcp"),
                systems: UNIX | WINDOWS,
                path: Some("//HOST:PORT"),
                meaning: "a board that another process or machine serves (`ecmsk serve tcp`)",
            },
            Self::XfSim => Row {
                name: "xf-sim",
                feature: feature!("sim"),
                systems: EVERY,
                path: None,
                meaning: "a simulated board whose slaves are behind an ECM-XF; for `ecmsk xf` and `ecmsk::Xf` that chip itself, \
                          without the keys of a board",
            },
            Self::XfSpi => Row {
                name: "xf-spi",
                feature: feature!("spi"),
                systems: LINUX,
                path: SPI_DEVICE,
                meaning: "a board of this process whose slaves are behind a real ECM-XF on SPI; or that chip itself",
            },
            Self::XfUsb => Row {
                name: "xf-usb",
                feature: feature!("usb"),
                systems: UNIX,
                path: None,
                meaning: "the same behind a real ECM-XFU on USB",
            },
            Self::Nic => Row {
                name: "nic",
                feature: feature!("nic"),
                systems: LINUX,
                path: Some("INTERFACE"),
                meaning: "a board of this process whose slaves are at the end of a network card, e.g. nic:eth1: no board is \
                          there at all",
            },
        }
    }

    /// The word before the colon of a link.
    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// The Cargo feature of this crate that links of the scheme need.
    pub const fn feature(self) -> &'static str {
        self.row().feature.0
    }

    /// The scheme with that name; `None` if there is none.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|scheme| scheme.name() == name)
    }

    /// Whether this build can open links of the scheme. It needs [its feature](Self::feature) and an operating system that
    /// [supports such links](Self::is_of_this_system).
    pub const fn in_build(self) -> bool {
        self.row().feature.1 && self.is_of_this_system()
    }

    /// Whether this operating system supports links of the scheme: links over SPI or a network card need Linux, and an
    /// ECM-XFU on USB any system but Windows.
    pub const fn is_of_this_system(self) -> bool {
        self.is_of(SYSTEM)
    }

    const fn is_of(self, system: u8) -> bool {
        self.row().systems & system != 0
    }

    /// The next step for a user whose build cannot open links of the scheme, for messages.
    pub fn instead(self) -> String {
        self.instead_on(SYSTEM)
    }

    fn instead_on(self, system: u8) -> String {
        let feature = self.feature();
        match self {
            _ if self.is_of(system) => {
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

    /// The reason why this build cannot open links of the scheme, as the end of its line in `ecmsk link help`. Empty if
    /// it can.
    pub(crate) fn note(self) -> String {
        self.note_on(SYSTEM, self.row().feature.1)
    }

    fn note_on(self, system: u8, has_feature: bool) -> String {
        match (self.is_of(system), has_feature) {
            (true, true) => String::new(),
            (true, false) => format!(" (not in this build: feature {})", self.feature()),
            (false, _) => " (not in this build: this system has none)".to_owned(),
        }
    }

    /// Whether the network is simulated in this process. Only such links can have virtual time (`clock=virtual`).
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

#[cfg(test)]
mod tests {
    use super::*;

    const SYSTEMS: [u8; 4] = [LINUX, OTHER_UNIX, WINDOWS, OTHER];

    /// For each scheme: its feature, whether this build has the feature, and how many entries of `SYSTEMS`, from the
    /// first on, can open such links.
    const EXPECTED: [(Scheme, &str, bool, usize); 8] = [
        (Scheme::Sim, "sim", cfg!(feature = "sim"), 4),
        (Scheme::Usb, "usb", cfg!(feature = "usb"), 3),
        (Scheme::Spi, "spi", cfg!(feature = "spi"), 1),
        (Scheme::Tcp, "tcp", cfg!(feature = "tcp"), 3),
        (Scheme::XfSim, "sim", cfg!(feature = "sim"), 4),
        (Scheme::XfSpi, "spi", cfg!(feature = "spi"), 1),
        (Scheme::XfUsb, "usb", cfg!(feature = "usb"), 2),
        (Scheme::Nic, "nic", cfg!(feature = "nic"), 1),
    ];

    /// If the feature of a link is not built in, the error and `ecmsk link help` name the feature and how to build with
    /// it. A build with only that feature opens the link.
    #[test]
    fn a_link_whose_feature_is_not_built_names_the_feature() {
        for (scheme, feature, has_feature, systems) in EXPECTED {
            assert_eq!(scheme.row().feature, (feature, has_feature), "{scheme}");
            for system in &SYSTEMS[..systems] {
                let build_it = format!(
                    "it needs the feature `{feature}`: build with `cargo build --release --features {feature}`"
                );
                assert_eq!(scheme.instead_on(*system), build_it);
                assert_eq!(scheme.note_on(*system, false), format!(" (not in this build: feature {feature})"));
                assert_eq!(scheme.note_on(*system, true), "");
            }
        }
    }

    /// On an operating system without such links, the error says so, whether the feature is built in or not, and
    /// suggests a board on another machine.
    #[test]
    fn a_system_without_such_links_names_another_machine() {
        for (scheme, _, _, systems) in EXPECTED {
            for system in &SYSTEMS[systems..] {
                let text = scheme.instead_on(*system);
                assert!(text.starts_with("this system has no such links: ") && text.contains("Linux"), "{text}");
                assert_eq!(text.contains("tcp://"), !scheme.has_chip(), "{text}");
                assert_eq!(scheme.note_on(*system, true), " (not in this build: this system has none)");
            }
        }
    }

    /// This build can open the links whose features it has, on operating systems that have such links.
    #[test]
    fn this_build_opens_what_it_has() {
        for (scheme, _, has_feature, systems) in EXPECTED {
            let is_of_this_system = SYSTEMS[..systems].contains(&SYSTEM);
            assert_eq!(scheme.in_build(), has_feature && is_of_this_system, "{scheme}");
            assert_eq!(scheme.note().is_empty(), scheme.in_build(), "{scheme}");
        }
    }
}
