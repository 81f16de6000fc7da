//! The keys of `xf-sim:` that describe the modelled chip, as Rust types.

use std::path::PathBuf;

use super::shared_options::{clock, script};
use crate::address::keys::Scheme;
use crate::address::slaves::SlaveSpec;
use crate::address::uri::{LinkUri, UriError};
use crate::link::chip_link::{data_size, speed_hz};
use crate::machine_file::slaves_of_link;
use crate::recording::Clock;
use crate::slave::Slave;
use crate::slave::esc::UndescribedError;
use crate::slave::handle::SimHandle;
use crate::xf::chip::{Controllers, Profile, SimulatedNetwork, SlaveModels};
use crate::xf::{CrcCoverage, CrcCoverages, DataSize};

/// The chips that have a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChipModel {
    /// An ECM-XF with firmware 0x22.
    New,
    /// An ECM-XF with firmware 0x0E.
    Old,
    /// An ECM-XFU.
    Xfu,
}

/// How a modelled chip reaches its simulated slaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChipNetwork {
    /// By function calls to the models of the slaves: fast, but without registers, EEPROMs, files and mailboxes.
    Models,
    /// By EtherCAT frames: the chip contains a master, and each slave has a modelled slave controller.
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

    /// Builds the simulated network of these slaves; scripts and tests inject faults into it by `handle`.
    ///
    /// # Errors
    /// [`UndescribedError`]: a slave does not define the content of the EEPROM of its slave controller.
    pub fn with(self, slaves: Vec<Box<dyn Slave>>, handle: SimHandle) -> Result<SimulatedNetwork, UndescribedError> {
        Ok(match self {
            Self::Models => SimulatedNetwork::Models(SlaveModels::new(slaves).reached_by(handle)),
            Self::Controllers => SimulatedNetwork::Controllers(Controllers::new(slaves, handle)?),
        })
    }
}

/// The chip that `xf-sim:` models, and the SPI or USB connection to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModelledChip {
    /// The type of the chip and its firmware.
    pub model: ChipModel,
    /// The number of data bytes in a packet at power-on (`n=`); `None`: the default of the chip type.
    pub size: Option<DataSize>,
    /// The bytes of a packet that the CRC-32 covers, for each direction: the whole data segment or only its valid bytes.
    pub coverages: CrcCoverages,
    /// The SPI clock in Hz, at least 1.
    pub speed_hz: u32,
    /// Whether the INT0 line is connected to the host.
    pub int0: bool,
    /// How the chip reaches its slaves. `None`: by calls to the models if a board uses the chip, because that is faster
    /// and supports all commands of a board; through slave controllers if a program uses the chip directly, because it
    /// may use any command.
    pub network: Option<ChipNetwork>,
}

impl ModelledChip {
    /// The chip that a URI describes; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError::BadValue`] if the value of a key is invalid.
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

    /// What distinguishes this chip from others: firmware version, data size and coverage of the CRC-32.
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
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimChipOptions {
    /// The slaves in network order: 0..=40.
    pub slaves: Vec<SlaveSpec>,
    /// Real or virtual time.
    pub clock: Clock,
    /// The chip, and the SPI or USB connection to it.
    pub chip: ModelledChip,
    /// The script file with events that happen to the slaves.
    pub script: Option<PathBuf>,
}

impl SimChipOptions {
    /// The options in a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError::OtherScheme`] if it is not an `xf-sim:` link; [`UriError::BadValue`] if a value is invalid, or if
    /// the link has the key `control=`.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        uri.expect_scheme(Scheme::XfSim)?;
        if let Some(value) = uri.value("control") {
            return Err(UriError::BadValue {
                key: "control".to_owned(),
                value: value.to_owned(),
                why: "a program that uses the chip itself has `script=` alone; allowed: for a board".to_owned(),
            });
        }
        Ok(Self {
            slaves: slaves_of_link(uri)?,
            clock: clock(uri)?,
            chip: ModelledChip::from_uri(uri)?,
            script: script(uri)?,
        })
    }
}

/// Parses the coverage of the CRC-32: one value for both directions, or a value for commands and one for responses,
/// separated by a comma.
fn coverages(value: &str) -> Option<CrcCoverages> {
    let one = |value| match value {
        "all" => Some(CrcCoverage::All),
        "valid" => Some(CrcCoverage::Valid),
        "valid4" => Some(CrcCoverage::Valid4),
        _ => None,
    };
    match value.split_once(',') {
        Some((commands, answers)) => Some(CrcCoverages { commands: one(commands)?, answers: one(answers)? }),
        None => one(value).map(CrcCoverages::from),
    }
}

#[cfg(all(test, feature = "sim"))]
mod tests {
    use super::*;

    /// XF-13.6 Each value of `crc_over=` sets the part of a packet that the CRC covers, in the direction for which the
    /// value is given.
    #[test]
    fn what_a_crc_covers_is_given_by_direction() {
        const NAMES: [(&str, CrcCoverage); 3] =
            [("all", CrcCoverage::All), ("valid", CrcCoverage::Valid), ("valid4", CrcCoverage::Valid4)];
        let covered = |value: &str| {
            let uri = LinkUri::parse(&format!("xf-sim:?crc_over={value}")).expect("a link");
            ModelledChip::from_uri(&uri).expect("a chip").profile().coverages
        };
        for (name, commands) in NAMES {
            assert_eq!(covered(name), CrcCoverages::from(commands));
            for (other, answers) in NAMES.into_iter().filter(|(other, _)| *other != name) {
                assert_eq!(covered(&format!("{name},{other}")), CrcCoverages { commands, answers });
            }
        }
    }
}
