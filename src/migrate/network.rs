//! The slaves that a program declares, and the length of their process data.

use crate::address::slaves::{self, SlaveModel};
use crate::ethercat::cia402::Mode;
use crate::fieldbus::pdo::ProcessData;
use crate::fieldbus::{MAX_SLAVES, Role};
use crate::sk::{CycleTime, SlaveKind};

/// The network that a program had declared when it left PreOP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Network {
    /// The kind of slave n is `kinds[n - 1]`; `None` if it was not declared.
    pub kinds: [Option<SlaveKind>; MAX_SLAVES],
    /// The mode of operation of slave n is `modes[n - 1]`; CSP until DRIVE_MODE sets another one.
    pub modes: [Mode; MAX_SLAVES],
    /// The EtherCAT cycle time in OP.
    pub cycle: CycleTime,
    /// Whether the program used the second channel of a pulse module; slave n is `second_channels[n - 1]`.
    pub second_channels: [bool; MAX_SLAVES],
    /// The number of slaves that the board has found, from its answers to SET_AXIS (SK-4.10), including those that are
    /// declared as none. 0 if no answer had it.
    pub found: usize,
}

impl Default for Network {
    fn default() -> Self {
        Self {
            kinds: [None; MAX_SLAVES],
            modes: [Mode::Csp; MAX_SLAVES],
            cycle: CycleTime::DEFAULT,
            second_channels: [false; MAX_SLAVES],
            found: 0,
        }
    }
}

impl Network {
    /// The role of a slave, from 1; [`Role::Unused`] if it was declared as none or not at all.
    pub fn role(&self, slave: usize) -> Role {
        self.kinds[slave - 1].map_or(Role::Unused, |kind| Role::of(kind, self.modes[slave - 1]))
    }

    /// The numbers of the slaves that are used, from 1.
    pub fn slaves(&self) -> impl Iterator<Item = usize> + '_ {
        (1..=MAX_SLAVES).filter(|slave| self.role(*slave) != Role::Unused)
    }

    /// The number of slaves that are used.
    pub fn count(&self) -> usize {
        self.slaves().count()
    }

    /// The number of slaves of a kind.
    pub fn count_of(&self, kind: SlaveKind) -> usize {
        self.kinds.iter().filter(|known| **known == Some(kind)).count()
    }

    /// The number of slaves on the cable, as far as it is known: the number that the board has found, but at least the
    /// number of the last slave that is used.
    pub fn length(&self) -> usize {
        self.slaves().last().unwrap_or(0).max(self.found.min(MAX_SLAVES))
    }

    /// The bytes of the outputs of all slaves. \[OURS] A pulse module counts with two channels, the most it may have.
    pub fn output_bytes(&self) -> usize {
        self.slaves().filter_map(|slave| ProcessData::of(self.role(slave), true)).map(|data| data.output_bytes()).sum()
    }

    /// The bytes of the inputs of all slaves. A pulse module counts with two channels.
    pub fn input_bytes(&self) -> usize {
        self.slaves().filter_map(|slave| ProcessData::of(self.role(slave), true)).map(|data| data.input_bytes()).sum()
    }

    /// The slaves as the key `slaves=` of a modelled chip names them, such as `drive*2,io`; empty if there are none. A
    /// slave that was found and is not used is named as an IO slave, which needs no declaration.
    pub fn models(&self) -> String {
        let model = |slave: usize| match self.role(slave) {
            Role::Drive(_) => SlaveModel::Drive,
            Role::Step(_) => SlaveModel::Step,
            Role::Hsp(_) if self.second_channels[slave - 1] => SlaveModel::Hsp2,
            Role::Hsp(_) => SlaveModel::Hsp,
            Role::Io | Role::Unused => SlaveModel::Io,
        };
        slaves::list((1..=self.length()).map(|slave| model(slave).name().to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The slaves are named as in a link, and their bytes are those of the process data that the board maps.
    #[test]
    fn a_mixed_network() {
        let mut network = Network::default();
        assert_eq!((network.models().as_str(), network.output_bytes(), network.input_bytes()), ("", 0, 0));
        for (n, kind) in
            [SlaveKind::Drive, SlaveKind::Drive, SlaveKind::None, SlaveKind::Io, SlaveKind::Hsp].into_iter().enumerate()
        {
            network.kinds[n] = Some(kind);
        }
        network.modes[1] = Mode::Cst;
        assert_eq!(network.models(), "drive*2,io*2,hsp");
        // Bytes of the outputs: 6 and 4 of the drives, 2 of the IO slave, 20 of a module with two channels.
        assert_eq!((network.output_bytes(), network.input_bytes(), network.count()), (32, 42, 4));
        // Two more slaves that the board has found are listed too, although their kind is not known.
        network.found = 7;
        assert_eq!((network.models().as_str(), network.length(), network.count()), ("drive*2,io*2,hsp,io*2", 7, 4));
        network.found = 5;
        network.second_channels[4] = true;
        assert_eq!((network.models().as_str(), network.output_bytes()), ("drive*2,io*2,hsp2", 32));
    }
}
