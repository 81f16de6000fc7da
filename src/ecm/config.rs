//! The configuration of a network. It is checked as a whole before any part of it is sent.

use std::fmt;

use crate::address::scale::{Scale, SoftLimits};
use crate::address::slaves;
use crate::ethercat::cia402::Mode;
use crate::sk::{CycleTime, DriveSync, SlaveKind, SlotSize};

/// \[OURS] The default guard of an axis, counts: a target may be up to one turn of a motor with a 17-bit encoder away
/// from the actual position. See [`Guard`].
pub const DEFAULT_GUARD_COUNTS: u32 = 1 << 17;

/// \[OURS] How far a stationary axis may move within 8 cycles by default, counts: encoders are noisy.
pub const DEFAULT_STANDSTILL_COUNTS: u32 = 16;

/// The limit for the distance between a CSP target of a stream and the actual position of the axis; `--lead-limit` in
/// the tool. The guard stops a motion whose axis does not follow, and one that does not begin at the actual position.
/// It does not limit the length of a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guard {
    /// The distance is limited to this many counts, 1 or more.
    Within(u32),
    /// No guard: any distance is allowed.
    Off,
}

impl Default for Guard {
    fn default() -> Self {
        Self::Within(DEFAULT_GUARD_COUNTS)
    }
}

/// The settings of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// CSP, CSV or CST. The mode decides which process data are mapped (SK-7.31).
    pub mode: Mode,
    /// How the drive is synchronized with the cycle: by distributed clocks, or without them.
    pub sync: DriveSync,
    /// The largest allowed distance of a target from the actual position.
    pub guard: Guard,
    /// The number of counts in one unit of the program, for example per mm.
    pub scale: Scale,
    /// The positions between which targets have to be, counts. On an HSP they are those of its first axis.
    pub limits: SoftLimits,
    /// The standstill threshold, counts: an axis that moves at most this far within 8 cycles (at most 16 ms, at least
    /// one cycle) counts as stationary. Set it above the noise of the encoder.
    pub standstill: u32,
}

impl Axis {
    /// The settings of an axis in CSP: distributed clocks, the default guard, and counts as the unit of the program.
    pub const CSP: Self = Self::new(Mode::Csp);
    /// As [`Axis::CSP`], but in CSV. The guard checks no velocities.
    pub const CSV: Self = Self::new(Mode::Csv);
    /// As [`Axis::CSP`], but in CST. The guard checks no torques.
    pub const CST: Self = Self::new(Mode::Cst);

    const fn new(mode: Mode) -> Self {
        Self {
            mode,
            sync: DriveSync::DcSync,
            guard: Guard::Within(DEFAULT_GUARD_COUNTS),
            scale: Scale::COUNTS,
            limits: SoftLimits::NONE,
            standstill: DEFAULT_STANDSTILL_COUNTS,
        }
    }
}

impl Default for Axis {
    fn default() -> Self {
        Self::CSP
    }
}

/// One slave of the network.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Slave {
    /// A servo drive.
    Drive(Axis),
    /// A stepper, which supports CSP alone (SK-7.36).
    Step(Axis),
    /// A pulse module of one or two channels, in CSP or CSV (SK-7.35). Both channels share the settings.
    Hsp(Axis),
    /// An IO slave with 16 inputs and 16 outputs.
    Io,
    /// A slave that is connected but not used; it stays in PreOP.
    Unused,
}

impl Slave {
    /// A slave of the given kind. If it has an axis, the axis has the settings [`Axis::CSP`].
    pub const fn of_kind(kind: SlaveKind) -> Self {
        Self::with_axis(kind, Axis::CSP)
    }

    /// A slave of the given kind. Its axis, if it has one, gets the settings `axis`.
    pub const fn with_axis(kind: SlaveKind, axis: Axis) -> Self {
        match kind {
            SlaveKind::Drive => Self::Drive(axis),
            SlaveKind::Step => Self::Step(axis),
            SlaveKind::Hsp => Self::Hsp(axis),
            SlaveKind::Io => Self::Io,
            SlaveKind::None => Self::Unused,
        }
    }

    /// The kind of slave that SET_AXIS declares for this slave.
    pub const fn kind(&self) -> SlaveKind {
        match self {
            Self::Drive(_) => SlaveKind::Drive,
            Self::Step(_) => SlaveKind::Step,
            Self::Hsp(_) => SlaveKind::Hsp,
            Self::Io => SlaveKind::Io,
            Self::Unused => SlaveKind::None,
        }
    }

    /// The settings of the slave's axis; `None` for an IO slave and an unused one.
    pub const fn axis(&self) -> Option<&Axis> {
        match self {
            Self::Drive(axis) | Self::Step(axis) | Self::Hsp(axis) => Some(axis),
            Self::Io | Self::Unused => None,
        }
    }
}

/// The modes that a kind of slave supports (SK-7.35, SK-7.36).
pub(super) const fn modes(kind: SlaveKind) -> &'static [Mode] {
    match kind {
        SlaveKind::Drive => &[Mode::Csp, Mode::Csv, Mode::Cst],
        SlaveKind::Hsp => &[Mode::Csp, Mode::Csv],
        SlaveKind::Step => &[Mode::Csp],
        SlaveKind::Io | SlaveKind::None => &[],
    }
}

/// Formats a slave as in the option `--slaves` of the tool: `drive`, `drive:csv`, `io`.
impl fmt::Display for Slave {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(slaves::word(self.kind()))?;
        match self.axis() {
            Some(axis) if axis.mode != Mode::Csp => write!(f, ":{}", axis.mode.name().to_ascii_lowercase()),
            _ => Ok(()),
        }
    }
}

/// The configuration of the network, which [`Ecm::configure`](super::Ecm::configure) sends to the board.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The slaves in network order: slave 1 is the first.
    pub slaves: Vec<Slave>,
    /// EtherCAT cycle, microseconds: 250 * 2^n, at most 1 s.
    pub cycle_us: u32,
}

impl Default for Config {
    /// An empty configuration with a cycle of 1000 us, to be filled with slaves: [`Self::check`] refuses a
    /// configuration without slaves.
    fn default() -> Self {
        Self { slaves: Vec::new(), cycle_us: CycleTime::DEFAULT.us() }
    }
}

impl Config {
    /// A network of `count` drives in CSP, with a cycle of 1000 us.
    pub fn drives(count: usize) -> Self {
        Self { slaves: vec![Slave::Drive(Axis::CSP); count], ..Self::default() }
    }

    /// Checks whether a board with slots of `size` bytes can run the configuration. Returns the cycle time.
    ///
    /// # Errors
    /// [`ConfigError`], for the first setting that is wrong.
    pub fn check(&self, size: SlotSize) -> Result<CycleTime, ConfigError> {
        let cycle = CycleTime::from_us(self.cycle_us).ok_or(ConfigError::Cycle { found_us: self.cycle_us })?;
        if self.slaves.is_empty() || self.slaves.len() > size.max_slaves() {
            return Err(ConfigError::Count { found: self.slaves.len(), max: size.max_slaves(), slot: size.bytes() });
        }
        for (slave, config) in (1..).zip(&self.slaves) {
            let Some(axis) = config.axis() else { continue };
            let allowed = modes(config.kind());
            if !allowed.contains(&axis.mode) {
                return Err(ConfigError::Mode { slave, kind: config.kind().name(), found: axis.mode, allowed });
            }
            if axis.guard == Guard::Within(0) {
                return Err(ConfigError::Guard { slave });
            }
            if !axis.scale.is_valid() {
                return Err(ConfigError::Scale { slave, found: axis.scale.counts_per_unit });
            }
        }
        Ok(cycle)
    }
}

/// Why a [`Config`] cannot be used. Nothing of it was sent to the board.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// The board does not support this cycle time.
    #[error("cycle_us is {found_us}: a cycle is 250 us * 2^n, at most 1 s; set 250, 500, 1000, 2000 or 4000")]
    Cycle {
        /// The cycle time of the configuration, microseconds.
        found_us: u32,
    },
    /// The configuration has no slaves, or too many.
    #[error("{found} slaves: with slots of {slot} bytes a board drives 1 to {max}; list the slaves in `slaves`")]
    Count {
        /// The number of slaves in the configuration.
        found: usize,
        /// The most slaves that a board with this slot size drives.
        max: usize,
        /// The slot size, bytes.
        slot: usize,
    },
    /// The kind of slave does not support the mode.
    #[error("slave {slave} is a {kind} in {found}: set its mode to {}", names(allowed))]
    Mode {
        /// Slave, from 1.
        slave: u8,
        /// The kind of the slave.
        kind: &'static str,
        /// The mode in the configuration.
        found: Mode,
        /// The modes that the kind supports.
        allowed: &'static [Mode],
    },
    /// The guard is 0 counts: it would refuse every target.
    #[error("slave {slave} has a guard of 0 counts, which lets no target pass; set 1 or more, or Guard::Off")]
    Guard {
        /// Slave, from 1.
        slave: u8,
    },
    /// The number of counts in one unit is 0, infinite or NaN.
    #[error("slave {slave} has {found} counts per unit; set a number that is finite and not 0")]
    Scale {
        /// Slave, from 1.
        slave: u8,
        /// The counts per unit in the configuration.
        found: f64,
    },
}

fn names(modes: &[Mode]) -> String {
    modes.iter().map(|mode| mode.name()).collect::<Vec<_>>().join(", ")
}
