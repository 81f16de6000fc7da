//! The schemes and keys of a link's URI. The parser, the defaults and [`help`] are all made from one table,
//! `keys/table.rs`. A new key is a row there and a field of the options that use it: `options.rs` has those of every link,
//! `options/sim.rs` those of `sim:` and `xf-sim:`, and `usb/`, `spi/`, `tcp/` and `fault/` each have an `options.rs` of their own.

mod table;

use std::fmt;

use super::fraction::Fraction;
use super::slaves;
pub use table::KEYS;

/// The end of every error message about a link.
pub(super) const WHERE_TO_LOOK: &str = "see `ecmsk link help`";

/// How a board or a chip is reached: the word before the colon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Scheme {
    /// A simulated board in this process.
    Sim,
    /// A real ECM-SK on USB.
    Usb,
    /// A real ECM-SK on SPI.
    Spi,
    /// A board that another process or machine serves.
    Tcp,
    /// A simulated ECM-XF in this process: a board that reaches its slaves over the chip, or, by
    /// [`chip::open`](super::chip::open), the chip itself.
    XfSim,
    /// A real ECM-XF on SPI: in the same two ways.
    XfSpi,
    /// A real ECM-XFU on USB: in the same two ways.
    XfUsb,
    /// A board of this process whose slaves are at the end of a network card.
    Nic,
}

impl Scheme {
    /// All schemes, including those that this build cannot open.
    pub const ALL: [Self; 8] =
        [Self::Sim, Self::Usb, Self::Spi, Self::Tcp, Self::XfSim, Self::XfSpi, Self::XfUsb, Self::Nic];

    /// The word before the colon.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Usb => "usb",
            Self::Spi => "spi",
            Self::Tcp => "tcp",
            Self::XfSim => "xf-sim",
            Self::XfSpi => "xf-spi",
            Self::XfUsb => "xf-usb",
            Self::Nic => "nic",
        }
    }

    /// The feature of this crate that has such links.
    pub const fn feature(self) -> &'static str {
        match self {
            Self::Sim | Self::XfSim => "sim",
            Self::Usb | Self::XfUsb => "usb",
            Self::Spi | Self::XfSpi => "spi",
            Self::Tcp => "tcp",
            Self::Nic => "nic",
        }
    }

    /// The scheme with that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|scheme| scheme.name() == name)
    }

    /// Whether this build can open such a link: it needs [its feature](Self::feature), and [a system](Self::is_of_this_system) that has
    /// such links.
    pub const fn in_build(self) -> bool {
        let has_feature = match self {
            Self::Sim | Self::XfSim => cfg!(feature = "sim"),
            Self::Tcp => cfg!(feature = "tcp"),
            Self::Usb | Self::XfUsb => cfg!(feature = "usb"),
            Self::Spi | Self::XfSpi => cfg!(feature = "spi"),
            Self::Nic => cfg!(feature = "nic"),
        };
        has_feature && self.is_of_this_system()
    }

    /// Whether this system has such links: what is on SPI or a network card exists on Linux only, and an ECM-XFU on USB not on
    /// Windows.
    pub const fn is_of_this_system(self) -> bool {
        match self {
            Self::Sim | Self::XfSim => true,
            Self::Tcp | Self::Usb => cfg!(any(unix, windows)),
            Self::XfUsb => cfg!(unix),
            Self::Spi | Self::XfSpi | Self::Nic => cfg!(target_os = "linux"),
        }
    }

    /// What to do where this build cannot open such a link.
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

    /// Whether there is an ECM-XF, which [`chip::open`](super::chip::open) opens as such.
    pub const fn has_chip(self) -> bool {
        matches!(self, Self::XfSim | Self::XfSpi | Self::XfUsb)
    }

    /// The form of the text between the colon and the question mark; `None` if the scheme allows none.
    pub const fn path(self) -> Option<&'static str> {
        match self {
            Self::Sim | Self::Usb | Self::XfSim | Self::XfUsb => None,
            Self::Spi | Self::XfSpi => Some("/dev/spidevB.C"),
            Self::Tcp => Some("//HOST:PORT"),
            Self::Nic => Some("INTERFACE"),
        }
    }

    const fn meaning(self) -> &'static str {
        match self {
            Self::Sim => "a simulated board in this process",
            Self::Usb => "a real ECM-SK on USB",
            Self::Spi => "a real ECM-SK on SPI",
            Self::Tcp => "a board that another process or machine serves (`ecmsk serve tcp`)",
            Self::XfSim => {
                "a simulated board whose slaves are behind an ECM-XF; for `ecmsk xf` and `ecmsk::Xf` that chip itself, without the \
                 keys of a board"
            }
            Self::XfSpi => "a board of this process whose slaves are behind a real ECM-XF on SPI; or that chip itself",
            Self::XfUsb => "the same behind a real ECM-XFU on USB",
            Self::Nic => {
                "a board of this process whose slaves are at the end of a network card, e.g. nic:eth1: no board is there at all"
            }
        }
    }
}

impl fmt::Display for Scheme {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The syntax of a key's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Syntax {
    /// One of these words.
    Choice(&'static [&'static str]),
    /// A decimal integer in this range, both ends included.
    Number(u64, u64),
    /// A decimal number in this range, both ends included, with at most 9 digits after the point.
    Fraction(Fraction, Fraction),
    /// The path of a file.
    File,
    /// 1 to 64 letters, digits, `-`, `_` and `.`.
    Name,
    /// A USB string descriptor: 1 to 126 characters.
    Text,
    /// A vendor or product id of USB: 1 to 4 hexadecimal digits, or those behind `0x`.
    UsbId,
    /// A frequency in Hz in this range, both ends included: an integer, optionally followed by `k` or `M`.
    Hertz(u64, u64),
    /// A GPIO line: `CHIP/LINE`.
    Line,
    /// A list of simulated slaves, see [`slaves`].
    Slaves,
    /// 1 to 6 pins of a chip, the highest of which may be this one; each once, `-` for none.
    Pins(u8),
}

/// The longest USB string descriptor, in characters (USB 2.0 9.6.7).
const TEXT_MAX: usize = 126;

/// The longest name of a board, in characters. \[OURS]
const NAME_MAX: usize = 64;

impl Syntax {
    /// The value in its normal form.
    ///
    /// # Errors
    /// Why the value is invalid, and what is allowed.
    pub fn normal(self, value: &str) -> Result<String, String> {
        let normal = match self {
            Self::Choice(words) => words.contains(&value).then(|| value.to_owned()),
            Self::Number(min, max) => {
                decimal(value).filter(|number| (min..=max).contains(number)).map(|number| number.to_string())
            }
            Self::Fraction(min, max) => {
                let number = Fraction::parse(value).filter(|number| (min..=max).contains(number));
                number.map(|number| number.to_string())
            }
            Self::File => (!value.is_empty() && !value.contains('\0')).then(|| value.to_owned()),
            Self::Name => {
                let plain = value.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.".contains(&b));
                (plain && (1..=NAME_MAX).contains(&value.len())).then(|| value.to_owned())
            }
            Self::Text => (1..=TEXT_MAX).contains(&value.chars().count()).then(|| value.to_owned()),
            Self::UsbId => usb_id(value).map(|id| format!("{id:04x}")),
            Self::Hertz(min, max) => hertz(value).filter(|number| (min..=max).contains(number)).map(hertz_text),
            Self::Line => value
                .rsplit_once('/')
                .is_some_and(|(chip, line)| !chip.is_empty() && !chip.ends_with('/') && !line.is_empty())
                .then(|| value.to_owned())
                .filter(|value| !value.contains('\0')),
            Self::Slaves => return Ok(slaves::normal(&slaves::parse(value)?)),
            Self::Pins(max) => pins(value, max).map(|_| value.to_owned()),
        };
        normal.ok_or_else(|| self.allowed())
    }

    /// `allowed: ` and the allowed values, for an error message.
    pub fn allowed(self) -> String {
        match self {
            Self::Choice(words) => format!("allowed: {}", words.join(", ")),
            Self::Number(min, max) => format!("allowed: a whole number from {min} to {max}"),
            Self::Fraction(min, max) => {
                format!("allowed: a number from {min} to {max}, at most 9 digits after the point")
            }
            Self::File => "allowed: the path of a file".to_owned(),
            Self::Name => format!("allowed: 1 to {NAME_MAX} letters, digits, `-`, `_` and `.`"),
            Self::Text => format!("allowed: 1 to {TEXT_MAX} characters"),
            Self::UsbId => "allowed: 1 to 4 hexadecimal digits, e.g. 16c0".to_owned(),
            Self::Hertz(min, max) => {
                format!("allowed: a frequency from {} to {} Hz, e.g. 500k or 24M", hertz_text(min), hertz_text(max))
            }
            Self::Line => {
                "allowed: CHIP/LINE, a GPIO chip and the number or name of its line, e.g. gpiochip0/25".to_owned()
            }
            Self::Slaves => format!("allowed: {}", slaves::form()),
            Self::Pins(max) => format!(
                "allowed: 1 to 6 GPIO numbers from 0 to {max}, or - for a line that is not wired, each number once, e.g. 0,1,-,3"
            ),
        }
    }

    /// The placeholder for the value in the help.
    fn placeholder(self) -> String {
        match self {
            Self::Choice(words) => words.join("|"),
            Self::Number(min, max) => format!("{min}..{max}"),
            Self::Fraction(min, max) => format!("{min}..{max}"),
            Self::File => "FILE".to_owned(),
            Self::Name => "NAME".to_owned(),
            Self::Text => "TEXT".to_owned(),
            Self::UsbId => "HEX".to_owned(),
            Self::Hertz(min, max) => format!("{}..{}", hertz_text(min), hertz_text(max)),
            Self::Line => "CHIP/LINE".to_owned(),
            Self::Slaves => "LIST".to_owned(),
            Self::Pins(_) => "GPIO,GPIO,..".to_owned(),
        }
    }
}

/// Parses a list of pins as links write it: place k is line k, `None` if that is not wired.
pub(super) fn pins(value: &str, max: u8) -> Option<[Option<u8>; 6]> {
    let mut pins = [None; 6];
    for (place, pin) in value.split(',').enumerate() {
        let number = match pin {
            "-" => None,
            digits => Some(decimal(digits).filter(|number| *number <= max.into())? as u8),
        };
        if number.is_some() && pins.contains(&number) {
            return None;
        }
        *pins.get_mut(place)? = number;
    }
    Some(pins)
}

/// Parses a frequency as links write it, in Hz.
pub(super) fn hertz(value: &str) -> Option<u64> {
    let (digits, unit) = match value.strip_suffix('M') {
        Some(digits) => (digits, 1_000_000),
        None => value.strip_suffix('k').map_or((value, 1), |digits| (digits, 1000)),
    };
    decimal(digits)?.checked_mul(unit)
}

/// Parses a vendor or product id.
pub(super) fn usb_id(value: &str) -> Option<u16> {
    let digits = value.strip_prefix("0x").unwrap_or(value);
    u16::from_str_radix(digits, 16).ok().filter(|_| digits.bytes().all(|byte| byte.is_ascii_hexdigit()))
}

/// A whole number of decimal digits alone: `parse` would let a plus sign pass.
pub(super) fn decimal(text: &str) -> Option<u64> {
    text.parse().ok().filter(|_| text.bytes().all(|byte| byte.is_ascii_digit()))
}

/// The shortest text for a frequency in Hz.
fn hertz_text(number: u64) -> String {
    match number {
        0 => "0".to_owned(),
        _ if number.is_multiple_of(1_000_000) => format!("{}M", number / 1_000_000),
        _ if number.is_multiple_of(1000) => format!("{}k", number / 1000),
        _ => number.to_string(),
    }
}

/// One key of a link's URI.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key {
    /// The name of the key.
    pub name: &'static str,
    /// The schemes that have the key.
    pub schemes: &'static [Scheme],
    /// The syntax of its value.
    pub syntax: Syntax,
    /// The value that applies if the key is not given, in normal form; `None` if there is none, in which case `meaning`
    /// says what happens.
    pub default: Option<&'static str>,
    /// A valid value other than the default.
    pub example: &'static str,
    /// What the key does, with the unit of its value.
    pub meaning: &'static str,
}

impl Key {
    /// The row of a key in links of that scheme.
    pub fn find(scheme: Scheme, name: &str) -> Option<&'static Self> {
        Self::of(scheme).find(|key| key.name == name)
    }

    /// The keys of links of that scheme, in the order of the table.
    pub fn of(scheme: Scheme) -> impl Iterator<Item = &'static Self> {
        KEYS.iter().filter(move |key| key.schemes.contains(&scheme))
    }
}

/// The text of `ecmsk link help`: the form of a link, every scheme, and every key with its default.
pub fn help() -> String {
    use fmt::Write as _;

    let mut text = String::from(
        "A link names a board, or a chip ECM-XF, and the way to it:\n\n    \
         scheme:path?key=value&key=value        for example  sim:?slaves=drive*3&clock=virtual\n\n\
         In a value, write % & ? # and blanks as %25 %26 %3F %23 %20.\n\nSchemes:\n",
    );
    for scheme in Scheme::ALL {
        let form = format!("{scheme}:{}", scheme.path().unwrap_or_default());
        let later = match scheme.in_build() {
            true => String::new(),
            false if scheme.is_of_this_system() => format!(" (not in this build: feature {})", scheme.feature()),
            false => " (not in this build: this system has none)".to_owned(),
        };
        // Writing to a String does not fail.
        let _ = writeln!(text, "  {form:<24} {}{later}", scheme.meaning());
    }
    text.push_str("\nKeys:\n");
    for key in KEYS {
        let form = format!("{}={}", key.name, key.syntax.placeholder());
        let whose = if key.schemes == Scheme::ALL {
            "any board".to_owned()
        } else {
            key.schemes.iter().map(|scheme| format!("{scheme}:")).collect::<Vec<_>>().join(" ")
        };
        let default = key.default.map(|value| format!("; default {value}")).unwrap_or_default();
        let _ = writeln!(text, "  {form}\n      {} [{whose}{default}]", key.meaning);
    }
    let _ = writeln!(text, "\nA list of slaves is {}.", slaves::form());
    let _ = write!(text, "\n{}", super::travel::help());
    let _ = write!(text, "\n{}", slaves::manufacturer_objects_help());
    #[cfg(feature = "sim")]
    let _ = write!(text, "\n{}", super::script::help());
    text
}
