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

/// A Cargo feature of this crate that some links need.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Feature {
    Sim,
    Usb,
    Spi,
    Tcp,
    Nic,
}

impl Feature {
    const COUNT: usize = 5;

    const fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Usb => "usb",
            Self::Spi => "spi",
            Self::Tcp => "tcp",
            Self::Nic => "nic",
        }
    }
}

/// An operating system, as far as links differ by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum System {
    Linux,
    OtherUnix,
    Windows,
    Other,
}

/// The systems that have the links of a scheme.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Systems {
    Any,
    UnixAndWindows,
    Unix,
    Linux,
}

impl Systems {
    const fn has(self, system: System) -> bool {
        match self {
            Self::Any => true,
            Self::UnixAndWindows => !matches!(system, System::Other),
            Self::Unix => matches!(system, System::Linux | System::OtherUnix),
            Self::Linux => matches!(system, System::Linux),
        }
    }
}

/// A build of this crate: the schemes that it can open, and the next step for the others. A test makes up builds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Build {
    /// Whether each [`Feature`] is on.
    features: [bool; Feature::COUNT],
    system: System,
}

impl Build {
    /// The build that this code is part of.
    pub(crate) const THIS: Self = Self {
        features: [
            cfg!(feature = "sim"),
            cfg!(feature = "usb"),
            cfg!(feature = "spi"),
            cfg!(feature = "tcp"),
            cfg!(feature = "nic"),
        ],
        system: if cfg!(target_os = "linux") {
            System::Linux
        } else if cfg!(unix) {
            System::OtherUnix
        } else if cfg!(windows) {
            System::Windows
        } else {
            System::Other
        },
    };

    const fn opens(self, scheme: Scheme) -> bool {
        self.features[scheme.row().feature as usize] && self.has_system_of(scheme)
    }

    const fn has_system_of(self, scheme: Scheme) -> bool {
        scheme.row().systems.has(self.system)
    }

    /// The next step for a user whose build cannot open links of the scheme.
    fn instead(self, scheme: Scheme) -> String {
        let feature = scheme.feature();
        match scheme {
            _ if self.has_system_of(scheme) => {
                format!("it needs the feature `{feature}`: build with `cargo build --release --features {feature}`")
            }
            Scheme::XfSpi | Scheme::XfUsb => {
                "this system has no such links: run the program on a machine with Linux that the chip is wired to".to_owned()
            }
            _ => "this system has no such links: serve the board by `ecmsk serve tcp` on a machine with Linux that it is wired to, and \
                  name it here by tcp://HOST:PORT"
                .to_owned(),
        }
    }

    /// The end of the scheme's line in the text of `ecmsk link help`.
    pub(crate) fn note(self, scheme: Scheme) -> String {
        match self.opens(scheme) {
            true => String::new(),
            false if self.has_system_of(scheme) => format!(" (not in this build: feature {})", scheme.feature()),
            false => " (not in this build: this system has none)".to_owned(),
        }
    }
}

/// The path of a link over SPI.
const SPI_DEVICE: Option<&str> = Some("/dev/spidevB.C");

/// The properties of a scheme. The code that opens its links is in `open/`.
struct Row {
    name: &'static str,
    feature: Feature,
    systems: Systems,
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
                feature: Feature::Sim,
                systems: Systems::Any,
                path: None,
                meaning: "a simulated board in this process",
            },
            Self::Usb => Row {
                name: "usb",
                feature: Feature::Usb,
                systems: Systems::UnixAndWindows,
                path: None,
                meaning: "a real ECM-SK on USB",
            },
            Self::Spi => Row {
                name: "spi",
                feature: Feature::Spi,
                systems: Systems::Linux,
                path: SPI_DEVICE,
                meaning: "a real ECM-SK on SPI",
            },
            Self::Tcp => Row {
                name: "tcp",
                feature: Feature::Tcp,
                systems: Systems::UnixAndWindows,
                path: Some("//HOST:PORT"),
                meaning: "a board that another process or machine serves (`ecmsk serve tcp`)",
            },
            Self::XfSim => Row {
                name: "xf-sim",
                feature: Feature::Sim,
                systems: Systems::Any,
                path: None,
                meaning: "a simulated board whose slaves are behind an ECM-XF; for `ecmsk xf` and `ecmsk::Xf` that chip itself, \
                          without the keys of a board",
            },
            Self::XfSpi => Row {
                name: "xf-spi",
                feature: Feature::Spi,
                systems: Systems::Linux,
                path: SPI_DEVICE,
                meaning: "a board of this process whose slaves are behind a real ECM-XF on SPI; or that chip itself",
            },
            Self::XfUsb => Row {
                name: "xf-usb",
                feature: Feature::Usb,
                systems: Systems::Unix,
                path: None,
                meaning: "the same behind a real ECM-XFU on USB",
            },
            Self::Nic => Row {
                name: "nic",
                feature: Feature::Nic,
                systems: Systems::Linux,
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
        self.row().feature.name()
    }

    /// The scheme with that name; `None` if there is none.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|scheme| scheme.name() == name)
    }

    /// Whether this build can open links of the scheme. It needs [its feature](Self::feature) and an operating system that
    /// [supports such links](Self::is_of_this_system).
    pub const fn in_build(self) -> bool {
        Build::THIS.opens(self)
    }

    /// Whether this operating system supports links of the scheme: links over SPI or a network card need Linux, and an
    /// ECM-XFU on USB any system but Windows.
    pub const fn is_of_this_system(self) -> bool {
        Build::THIS.has_system_of(self)
    }

    /// The next step for a user whose build cannot open links of the scheme, for messages.
    pub fn instead(self) -> String {
        Build::THIS.instead(self)
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

#[cfg(test)]
mod tests {
    use super::*;

    const EVERY: [Feature; Feature::COUNT] = [Feature::Sim, Feature::Usb, Feature::Spi, Feature::Tcp, Feature::Nic];

    fn build(system: System, has: impl Fn(Feature) -> bool) -> Build {
        Build { features: EVERY.map(has), system }
    }

    /// The feature of each scheme, and the systems that have its links.
    const EXPECTED: [(Scheme, &str, &[System]); 8] = {
        const EVERYWHERE: &[System] = &[System::Linux, System::OtherUnix, System::Windows, System::Other];
        let [linux, unix, with_windows] =
            [EVERYWHERE.split_at(1).0, EVERYWHERE.split_at(2).0, EVERYWHERE.split_at(3).0];
        [
            (Scheme::Sim, "sim", EVERYWHERE),
            (Scheme::Usb, "usb", with_windows),
            (Scheme::Spi, "spi", linux),
            (Scheme::Tcp, "tcp", with_windows),
            (Scheme::XfSim, "sim", EVERYWHERE),
            (Scheme::XfSpi, "spi", linux),
            (Scheme::XfUsb, "usb", unix),
            (Scheme::Nic, "nic", linux),
        ]
    };

    /// A link whose feature is not built names the feature, and how to build with it; also in `ecmsk link help`. A build with
    /// that feature alone opens it.
    #[test]
    fn a_link_whose_feature_is_not_built_names_the_feature() {
        for (scheme, feature, systems) in EXPECTED {
            for system in systems {
                let [without, only] =
                    [build(*system, |f| f.name() != feature), build(*system, |f| f.name() == feature)];
                assert!(!without.opens(scheme) && only.opens(scheme), "{scheme} {system:?}");
                let build_it = format!(
                    "it needs the feature `{feature}`: build with `cargo build --release --features {feature}`"
                );
                assert_eq!(without.instead(scheme), build_it);
                assert_eq!(without.note(scheme), format!(" (not in this build: feature {feature})"));
                assert_eq!(only.note(scheme), "");
            }
        }
    }

    /// A system without such links says so, whatever was built, and names a way over another machine.
    #[test]
    fn a_system_without_such_links_names_another_machine() {
        for (scheme, _, systems) in EXPECTED {
            for system in [System::Linux, System::OtherUnix, System::Windows, System::Other] {
                if systems.contains(&system) {
                    continue;
                }
                let every = build(system, |_| true);
                assert!(!every.opens(scheme), "{scheme} {system:?}");
                let text = every.instead(scheme);
                assert!(text.starts_with("this system has no such links: ") && text.contains("Linux"), "{text}");
                assert_eq!(text.contains("tcp://"), !scheme.has_chip(), "{text}");
                assert_eq!(every.note(scheme), " (not in this build: this system has none)");
            }
        }
    }
}
