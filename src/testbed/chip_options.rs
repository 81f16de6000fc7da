//! The keys of `xf-sim:` about the chip that it models, as Rust types.

use std::path::PathBuf;

use super::clock_and_script::{clock, script};
use crate::address::keys::Scheme;
use crate::address::slaves::SlaveSpec;
use crate::address::uri::{LinkUri, UriError};
use crate::link::chip_link::{data_size, speed_hz};
use crate::recording::Clock;
use crate::slave::Slave;
use crate::slave::esc::UndescribedError;
use crate::slave::handle::SimHandle;
use crate::xf::chip::{Controllers, Profile, SimulatedNetwork, SlaveModels};
use crate::xf::{Coverage, Coverages, DataSize};

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
    /// The chip and the wires to it.
    pub chip: ModelledChip,
    /// A file of events that happen to the slaves.
    pub script: Option<PathBuf>,
}

impl SimChipOptions {
    /// The options in a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError::OtherScheme`] if it is not an `xf-sim:` link.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        uri.expect_scheme(Scheme::XfSim)?;
        Ok(Self { slaves: uri.slaves()?, clock: clock(uri)?, chip: ModelledChip::from_uri(uri)?, script: script(uri)? })
    }
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

#[cfg(all(test, feature = "sim"))]
mod tests {
    use super::*;

    /// XF-13.6 Each value of `crc_over=` is what the model covers in the direction for which it is given.
    #[test]
    fn what_a_crc_covers_is_given_by_direction() {
        const NAMES: [(&str, Coverage); 3] =
            [("all", Coverage::All), ("valid", Coverage::Valid), ("valid4", Coverage::Valid4)];
        let covered = |value: &str| {
            let uri = LinkUri::parse(&format!("xf-sim:?crc_over={value}")).expect("a link");
            ModelledChip::from_uri(&uri).expect("a chip").profile().coverages
        };
        for (name, commands) in NAMES {
            assert_eq!(covered(name), Coverages::from(commands));
            for (other, answers) in NAMES.into_iter().filter(|(other, _)| *other != name) {
                assert_eq!(covered(&format!("{name},{other}")), Coverages { commands, answers });
            }
        }
    }
}
