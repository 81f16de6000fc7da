//! Homing (CiA 402-2, mode 6): the drive searches for a position on its travel by switches and the index pulse.
//!
//! [`method`] says what a homing method searches for; [`run`] is one search; [`Homing`] is the mode around it: start,
//! halt, interruption, and bits 10, 12 and 13 of the statusword. Nothing moves here: the axis reads which velocity a run
//! asks for, moves its shaft, and reports how far the shaft has moved (`axis/homing.rs`).
//!
//! **Where home is.** Home is the count at which the edge was detected, or that of the index pulse after it. The axis
//! brakes beyond that count and runs back to it, with speed 0x6099:2 and acceleration 0x609A. When it stands there homing
//! is attained: from then on the position actual value is 0x607C at that count, and the statusword shows it (OBS). An axis
//! that [stays beyond home](HomingSettings::stays_beyond_home) has its new position actual value from the moment when home is
//! found, and brakes where that happens.
//!
//! **Decisions** \[OURS].
//! - Bits 10, 12 and 13 are those of the table in CiA 402-2 whenever the mode is 6, in every state of the drive.
//! - 0x6098 to 0x609A and 0x607C are read when a run starts; a change meanwhile acts in the next run.
//! - While the shaft runs back to home no switch is evaluated, since the shaft has been there before. A run that ends while
//!   it runs back, for whatever reason, changes no position.
//! - When bit 4 falls the run ends (interrupted), and the next run starts from the beginning. Halt (bit 8) brakes as 0x605D
//!   says, and the run continues when halt is reset with bit 4 still set.
//! - A run during which the power stage is switched off (fault, quick stop, disabled, no master) ends in a homing error.
//! - A run may start with a shaft that moves more slowly than bit 10 of CSV requires for target reached.
//! - Every result stays until the next start, or until the mode is left.

pub mod method;
pub mod run;

use super::switches::{Input, Switches};
use crate::ethercat::cia402::{Controlword, Statusword};
use run::Run;

/// What homing reads from the objects of a drive, in counts, counts/s and counts/s².
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HomingSettings {
    /// Homing method, 0x6098.
    pub method: i8,
    /// Home offset, 0x607C: the position actual value at home.
    pub offset: i32,
    /// Speed during search for switch, 0x6099:1.
    pub switch_speed: u32,
    /// Speed during search for zero, 0x6099:2.
    pub zero_speed: u32,
    /// Homing acceleration, 0x609A.
    pub acceleration: u32,
    /// Halt option code, 0x605D.
    pub halt_option: i16,
    /// The axis brakes beyond home and stays there, instead of running back to it.
    pub stays_beyond_home: bool,
}

/// Why a homing run ended without a home.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum HomingError {
    /// 0x6098 is a method that is not supported.
    #[error("homing method {0} is not supported; write one of 1..14, 17..30, 33, 34, 35, 37 to 0x6098")]
    UnsupportedMethod(i8),
    /// The method needs an input that is not wired.
    #[error("homing method {method} needs the {}, which is not wired; choose another method", .input.name())]
    NotWired {
        /// The homing method.
        method: i8,
        /// The input that is missing.
        input: Input,
    },
    /// A limit switch that the method does not use is active in the direction of the run, or the shaft has reached it.
    #[error("the {} ended the search; check the home switch and where the run starts", .0.name())]
    WrongLimit(Input),
    /// Both limit switches are active at once.
    #[error("both limit switches are active; check their wiring")]
    BothLimits,
    /// Home was not found within that many counts \[OURS].
    #[error("nothing was found on a way of {0} counts; check the switches")]
    TooFar(u64),
    /// The shaft was moving when the run was started.
    #[error("the shaft was moving when homing was started; wait for statusword bit 10 first")]
    Moving,
    /// 0x6099:1, 0x6099:2 or 0x609A is 0.
    #[error("a homing speed or the homing acceleration is 0; write 0x6099:1, 0x6099:2 and 0x609A")]
    NoSpeed,
    /// The power stage was switched off during the run.
    #[error("the drive left Operation enabled during homing; enable it and start again")]
    PowerLost,
}

/// The position where home was attained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HomePosition {
    /// Home, in counts of the shaft.
    pub at: i64,
    /// The position actual value that this count has from now on.
    pub offset: i32,
}

/// The position of a shaft, and whether it moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shaft {
    /// The position, counts.
    pub position: i64,
    /// The shaft moves, or its demand does.
    pub moves: bool,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    /// No run was started, or the last one was interrupted.
    Idle,
    Searching(Run),
    /// Home was found at this count, and the shaft runs back to it.
    Returning(i64),
    Attained,
    Failed(HomingError),
}

/// Homing mode of one axis.
#[derive(Clone, Debug)]
pub struct Homing {
    phase: Phase,
    /// The settings when the last run was started.
    settings: HomingSettings,
    /// Bit 4 of the last controlword.
    start_bit: bool,
    halted: bool,
}

impl Homing {
    /// Homing mode before it was entered.
    pub const fn new(settings: HomingSettings) -> Self {
        Self { phase: Phase::Idle, settings, start_bit: false, halted: false }
    }

    /// The mode is entered. Bit 4 has to rise to start a run: if it is set already no run starts.
    pub fn enter(&mut self, word: Controlword, settings: HomingSettings) {
        *self = Self::new(settings);
        self.start_bit = starts(word);
    }

    /// The power stage follows no demand: a run that is under way ends in a homing error.
    pub fn lose_power(&mut self, word: Controlword) {
        self.start_bit = starts(word);
        if let Phase::Searching(_) | Phase::Returning(_) = self.phase {
            self.phase = Phase::Failed(HomingError::PowerLost);
        }
    }

    /// Takes the controlword of a drive in Operation enabled.
    pub fn command(&mut self, word: Controlword, shaft: Shaft, settings: &HomingSettings, switches: &Switches) {
        let was_set = std::mem::replace(&mut self.start_bit, starts(word));
        self.halted = word.0 & Controlword::HALT != 0;
        match (was_set, self.start_bit, &self.phase) {
            (false, true, _) => {
                self.settings = *settings;
                match Run::start(settings, shaft, switches) {
                    Ok(Some(run)) => self.phase = Phase::Searching(run),
                    Ok(None) => self.phase = Phase::Returning(shaft.position),
                    Err(error) => self.phase = Phase::Failed(error),
                }
            }
            (_, false, Phase::Searching(_) | Phase::Returning(_)) => self.phase = Phase::Idle,
            _ => {}
        }
    }

    /// The count to which the shaft runs back, and the greatest speed, counts/s.
    pub fn destination(&self) -> Option<(i64, f64)> {
        match self.phase {
            Phase::Returning(at) if !self.halted => Some((at, self.settings.zero_speed.into())),
            _ => None,
        }
    }

    /// The shaft has run back to home and stands there: homing is attained.
    pub fn arrive(&mut self) -> Option<HomePosition> {
        let (at, _) = self.destination()?;
        self.phase = Phase::Attained;
        Some(HomePosition { at, offset: self.settings.offset })
    }

    /// The velocity that the search asks for, counts/s.
    pub fn velocity(&self) -> f64 {
        match &self.phase {
            Phase::Searching(run) if !self.halted => run.velocity(&self.settings),
            _ => 0.0,
        }
    }

    /// The greatest change of that velocity, counts/s² (0x609A).
    pub fn acceleration(&self) -> f64 {
        self.settings.acceleration.into()
    }

    /// Whether the axis stays beyond home instead of running back to it.
    pub const fn stays_beyond_home(&self) -> bool {
        self.settings.stays_beyond_home
    }

    /// The halt option code 0x605D while halt is commanded; `None`: it is not.
    pub fn halt_option(&self) -> Option<i16> {
        self.halted.then_some(self.settings.halt_option)
    }

    /// The shaft has moved from one count to another, while the demand moved by `way` counts: evaluates the switches and
    /// the index pulse between them.
    pub fn pass(&mut self, from: i64, to: i64, way: f64, switches: &Switches) {
        let Phase::Searching(run) = &mut self.phase else { return };
        match run.pass(from, to, way, switches) {
            Ok(None) => {}
            Ok(Some(at)) => self.phase = Phase::Returning(at),
            Err(error) => self.phase = Phase::Failed(error),
        }
    }

    /// Bits 10, 12 and 13 of the statusword (CiA 402-2, homing mode). `stands`: the shaft stands still.
    pub fn status_bits(&self, stands: bool) -> u16 {
        let (bits, ended) = match self.phase {
            Phase::Idle => (0, true),
            Phase::Searching(_) | Phase::Returning(_) => (0, self.halted),
            Phase::Attained => (Statusword::BIT12, true),
            Phase::Failed(_) => (Statusword::BIT13, true),
        };
        if ended && stands { bits | Statusword::TARGET_REACHED } else { bits }
    }

    /// The homing error of the last run, until the next one starts; `None`: there was none.
    pub fn error(&self) -> Option<HomingError> {
        match self.phase {
            Phase::Failed(error) => Some(error),
            _ => None,
        }
    }
}

const fn starts(word: Controlword) -> bool {
    word.0 & Controlword::HOMING_START != 0
}
