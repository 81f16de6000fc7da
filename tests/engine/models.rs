//! Slaves of every kind, as working models.

use ecmsk::sk::{MasterCommand, SlaveKind};
use ecmsk::slave::{Channels, Drive, DriveConfig, HspConfig, Slave};

use crate::host::Host;

/// The models: the kind to declare them as, and whether they have a second channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    Servo,
    Io,
    Step,
    Hsp,
    Hsp2,
}
use Model::*;

pub const MODELS: [Model; 5] = [Servo, Io, Step, Hsp, Hsp2];

impl Model {
    pub fn kind(self) -> SlaveKind {
        match self {
            Servo => SlaveKind::Drive,
            Io => SlaveKind::Io,
            Step => SlaveKind::Step,
            Hsp | Hsp2 => SlaveKind::Hsp,
        }
    }

    pub fn build(self) -> Box<dyn Slave> {
        match self {
            Servo => Box::new(Drive::new(DriveConfig::default())),
            Io => Box::<ecmsk::slave::Io>::default(),
            Step => Box::new(Drive::new(DriveConfig::stepper())),
            Hsp => Box::<ecmsk::slave::Hsp>::default(),
            Hsp2 => Box::new(ecmsk::slave::Hsp::new(HspConfig::with(Channels::Two))),
        }
    }
}

/// Declares slaves, those beyond the list as none.
pub fn declare(host: &mut Host, kinds: &[SlaveKind]) {
    for group in 0..5u8 {
        let kind = |k: usize| kinds.get(usize::from(group) * 8 + k).copied().unwrap_or(SlaveKind::None);
        host.master(MasterCommand::SetAxis { group, kinds: std::array::from_fn(kind) });
    }
}
