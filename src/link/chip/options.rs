//! The keys of links to a chip as Rust types.

use std::path::PathBuf;

use crate::ethercat::Ns;
#[cfg(all(feature = "usb", unix))]
use crate::io::hid::PacketPlace;
#[cfg(all(feature = "spi", target_os = "linux"))]
use crate::io::spi::{EdgeSettings, GpioLine, Level};
use crate::link::keys;
#[cfg(any(feature = "sim", all(feature = "spi", target_os = "linux"), all(feature = "usb", unix)))]
use crate::link::keys::Scheme;
#[cfg(feature = "sim")]
use crate::link::options::Clock;
#[cfg(feature = "sim")]
use crate::link::slaves::{self, SlaveSpec};
#[cfg(all(feature = "spi", target_os = "linux"))]
use crate::link::spi::device;
use crate::link::uri::{LinkUri, UriError};
#[cfg(feature = "sim")]
use crate::slave::Slave;
#[cfg(feature = "sim")]
use crate::slave::esc::UndescribedError;
#[cfg(feature = "sim")]
use crate::slave::handle::SimHandle;
#[cfg(feature = "sim")]
use crate::xf::chip::{Controllers, Profile, SimulatedNetwork, SlaveModels};
use crate::xf::{Coverage, Coverages, DataSize};

/// Options of every link to a chip: how the driver uses it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChipOptions {
    /// The idle time behind an exchange (`idle_us=`), in nanoseconds.
    pub idle_ns: Ns,
    /// The n that the chip is set to at the start (`use_n=`); `None`: it keeps what it has.
    pub use_n: Option<DataSize>,
}

impl ChipOptions {
    /// The options in a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError::BadValue`] if a value does not fit the type of its option.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        let use_n = uri.typed("use_n", data_size)?;
        if use_n.is_some() && uri.value("chip_fw") == Some("xfu") {
            let (key, value) = ("use_n".to_owned(), uri.value("use_n").unwrap_or_default().to_owned());
            let why = "an ECM-XFU has 992 always; allowed: with chip_fw=new or old, or leave it out".to_owned();
            return Err(UriError::BadValue { key, value, why });
        }
        let idle_ns = uri.required("idle_us", |value| Some(value.parse::<Ns>().ok()? * 1000))?;
        Ok(Self { idle_ns, use_n })
    }
}

/// Parses n.
fn data_size(value: &str) -> Option<DataSize> {
    DataSize::new(value.parse().ok()?)
}

/// Parses what a CRC-32 covers: of both directions, or of commands and behind a comma of answers.
fn coverages(value: &str) -> Option<Coverages> {
    let one = |value| match value {
        "all" => Some(Coverage::All),
        "valid" => Some(Coverage::Valid),
        "valid4" => Some(Coverage::Valid4),
        _ => None,
    };
    match value.split_once(',') {
        Some((commands, answers)) => Some(Coverages { commands: one(commands)?, answers: one(answers)? }),
        None => one(value).map(Coverages::from),
    }
}

/// The file to which the exchanges of a link are recorded (`record=`); `None`: there is no recording.
pub(super) fn record(uri: &LinkUri) -> Option<PathBuf> {
    uri.value("record").map(PathBuf::from)
}

/// The chips that can be modelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChipModel {
    /// An ECM-XF with firmware 0x22.
    New,
    /// An ECM-XF with firmware 0x0E.
    Old,
    /// An ECM-XFU.
    Xfu,
}

/// What is between a modelled chip and its simulated slaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChipNetwork {
    /// Calls: fast, without registers, EEPROMs, files and mailboxes.
    Models,
    /// Frames: a master in the chip, and a controller in front of each slave.
    Controllers,
}

impl ChipNetwork {
    fn parse(value: &str) -> Option<Self> {
        match value {
            "models" => Some(Self::Models),
            "controllers" => Some(Self::Controllers),
            _ => None,
        }
    }

    /// These slaves behind it, which `handle` reaches.
    ///
    /// # Errors
    /// [`UndescribedError`]: a slave does not say what belongs into the EEPROM of its controller.
    #[cfg(feature = "sim")]
    pub fn with(self, slaves: Vec<Box<dyn Slave>>, handle: SimHandle) -> Result<SimulatedNetwork, UndescribedError> {
        Ok(match self {
            Self::Models => SimulatedNetwork::Models(SlaveModels::new(slaves).reached_by(handle)),
            Self::Controllers => SimulatedNetwork::Controllers(Controllers::new(slaves, handle)?),
        })
    }
}

/// The chip that `xf-sim:` models, and the wires to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModelledChip {
    /// Which chip it is.
    pub model: ChipModel,
    /// Its n when it has got its power; `None`: that of the model.
    pub size: Option<DataSize>,
    /// What its CRC-32 covers.
    pub coverages: Coverages,
    /// The clock of SPI in Hz, 1 and more.
    pub speed_hz: u32,
    /// Whether INT0 is wired.
    pub int0: bool,
    /// What is between it and its slaves; `None`: models under a board, which is faster by that, and controllers for a program
    /// of the chip, which may use any of its commands.
    pub network: Option<ChipNetwork>,
}

impl ModelledChip {
    /// The chip in a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError::BadValue`] if a value does not fit the type of its option.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        let models = [("old", ChipModel::Old), ("new", ChipModel::New), ("xfu", ChipModel::Xfu)];
        Ok(Self {
            model: uri.choice("chip_fw", models)?,
            size: uri.typed("n", data_size)?,
            coverages: uri.required("crc_over", coverages)?,
            speed_hz: speed_hz(uri)?,
            int0: uri.choice("int0", [("no", false), ("yes", true)])?,
            network: uri.typed("network", ChipNetwork::parse)?,
        })
    }

    /// The properties of the chip.
    #[cfg(feature = "sim")]
    pub fn profile(&self) -> Profile {
        let profile = match self.model {
            ChipModel::New => Profile::NEW,
            ChipModel::Old => Profile::OLD,
            ChipModel::Xfu => Profile::XFU,
        };
        Profile { size: self.size.unwrap_or(profile.size), coverages: self.coverages, ..profile }
    }
}

/// Options of `xf-sim:`, opened as a chip.
#[cfg(feature = "sim")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimChipOptions {
    /// The slaves in network order: 0..=40.
    pub slaves: Vec<SlaveSpec>,
    /// Real or virtual time.
    pub clock: Clock,
    /// The chip and the wires to it.
    pub chip: ModelledChip,
    /// A file of events that happen to the slaves.
    pub script: Option<PathBuf>,
}

#[cfg(feature = "sim")]
impl SimChipOptions {
    /// The options in a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError::OtherScheme`] if it is not an `xf-sim:` link.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        uri.expect_scheme(Scheme::XfSim)?;
        Ok(Self {
            slaves: uri.required("slaves", |value| slaves::parse(value).ok())?,
            clock: uri.choice("clock", [("real", Clock::Real), ("virtual", Clock::Virtual)])?,
            chip: ModelledChip::from_uri(uri)?,
            script: uri.typed("script", |value| Some(PathBuf::from(value)))?,
        })
    }
}

/// The frequency of the clock of SPI.
fn speed_hz(uri: &LinkUri) -> Result<u32, UriError> {
    uri.required("speed", |value| keys::hertz(value)?.try_into().ok())
}

/// When an `xf-spi:` link resets its chip, which needs the line for it.
#[cfg(all(feature = "spi", target_os = "linux"))]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResetTimes {
    /// When it is opened.
    pub at_open: bool,
    /// When it is closed.
    pub at_close: bool,
}

/// When the chip is reset; never without the line.
///
/// # Errors
/// [`UriError::BadValue`]: another time than the opening, without the line.
#[cfg(all(feature = "spi", target_os = "linux"))]
pub(super) fn reset_times(uri: &LinkUri) -> Result<ResetTimes, UriError> {
    let has_line = uri.typed("reset", GpioLine::parse)?.is_some();
    let times = |at_open, at_close| ResetTimes { at_open, at_close };
    let chosen = uri.choice(
        "reset_at",
        [("open", times(true, false)), ("close", times(false, true)), ("both", times(true, true))],
    )?;
    match uri.value("reset_at") {
        Some(value) if !has_line && chosen.at_close => {
            let why = "it is about a line that the link does not name; allowed: with reset=CHIP/LINE".to_owned();
            Err(UriError::BadValue { key: "reset_at".to_owned(), value: value.to_owned(), why })
        }
        _ if has_line => Ok(chosen),
        _ => Ok(times(false, false)),
    }
}

/// The mode of the chip's SPI (XF EN 148).
#[cfg(all(feature = "spi", target_os = "linux"))]
const SPI_MODE: u8 = 0;

/// The devices that are the wires of an `xf-spi:` link.
///
/// # Errors
/// [`UriError::OtherScheme`] if it is not an `xf-spi:` link; [`UriError::BadPath`] without a device;
/// [`UriError::BadValue`] for a level of INT0 without its line.
#[cfg(all(feature = "spi", target_os = "linux"))]
pub(super) fn spi_settings(uri: &LinkUri) -> Result<EdgeSettings, UriError> {
    uri.expect_scheme(Scheme::XfSpi)?;
    let ready = uri.typed("int0", GpioLine::parse)?;
    let ready_level = uri.choice("int0_active", [("high", Level::High), ("low", Level::Low)])?;
    if ready.is_none() && ready_level == Level::Low {
        let why = "it is the level of a line that the link does not name; allowed: with int0=CHIP/LINE".to_owned();
        return Err(UriError::BadValue { key: "int0_active".to_owned(), value: "low".to_owned(), why });
    }
    Ok(EdgeSettings {
        device: device(uri, "xf-spi:/dev/spidevB.C, e.g. xf-spi:/dev/spidev0.0")?,
        speed_hz: speed_hz(uri)?,
        mode: SPI_MODE,
        ready,
        ready_level,
        interrupt: uri.typed("int1", GpioLine::parse)?,
        reset: uri.typed("reset", GpioLine::parse)?,
    })
}

/// The device of an `xf-usb:` link, and its endpoints. \[OURS] No source has the ids of an ECM-XFU or its endpoints.
///
/// # Errors
/// [`UriError::OtherScheme`] if it is not an `xf-usb:` link; [`UriError::MissingKey`].
#[cfg(all(feature = "usb", unix))]
pub(super) fn usb_place(uri: &LinkUri) -> Result<PacketPlace, UriError> {
    uri.expect_scheme(Scheme::XfUsb)?;
    let id = |key| uri.given(key, keys::usb_id);
    let endpoint = |key| uri.given(key, |value| value.parse().ok());
    Ok(PacketPlace { vendor: id("vid")?, product: id("pid")?, output: endpoint("ep_out")?, input: endpoint("ep_in")? })
}
