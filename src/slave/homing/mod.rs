//! Homing (CiA 402-2, mode 6): the drive searches for a position on its travel, using switches and the index pulse.
//!
//! [`method`] defines what a homing method searches for, [`run`] is one search, and [`Homing`] is the mode: start, halt,
//! interruption, and statusword bits 10, 12 and 13. Nothing moves here: the axis reads the velocity that a run requests,
//! moves its shaft, and reports how far the shaft has moved (`axis/homing.rs`).
//!
//! **Where home is.** Home is the count at which the edge was detected, or the count of the first index pulse after the
//! edge. The axis brakes beyond that count and runs back to it, with speed 0x6099:2 and acceleration 0x609A. When it
//! has stopped there, homing is attained: from then on the position actual value at that count is 0x607C, and the
//! statusword shows "homing attained" (OBS). An axis that [stays beyond home](HomingSettings::stays_beyond_home) has
//! its new position actual value as soon as home is found, and stops where it has braked.
//!
//! **Decisions** \[OURS].
//! - Statusword bits 10, 12 and 13 follow the table in CiA 402-2 whenever the mode is 6, in every state of the drive.
//! - 0x6098 to 0x609A and 0x607C are read when a run starts; later changes apply to the next run.
//! - While the shaft runs back to home, no switch is evaluated, because the shaft has been there before. A run that ends
//!   for any reason while it runs back changes no position.
//! - When controlword bit 4 falls, the run ends (interrupted), and the next run starts from the beginning. Halt (bit 8)
//!   brakes as 0x605D says, and the run continues when halt is reset while bit 4 is still set.
//! - A run ends in a homing error when the power stage is switched off (fault, quick stop, disabled, no master).
//! - A run may start while the shaft moves more slowly than the window of statusword bit 10 in CSV.
//! - Every result stays until the next start, or until the mode is left.

pub mod method;
pub mod run;

use super::switches::{Input, Switches};
use crate::ethercat::cia402::{Controlword, Statusword};
use run::Run;

/// The settings that homing reads from the objects of a drive, in counts, counts/s and counts/s².
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
    /// Whether the axis brakes beyond home and stays there instead of running back to home.
    pub stays_beyond_home: bool,
}

/// Why a homing run ended without a home.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum HomingError {
    /// The value of 0x6098 is an unsupported method.
    #[error("homing method {0} is not supported; write one of {list} to 0x6098", list = method::SUPPORTED)]
    UnsupportedMethod(i8),
    /// The method needs an input that is not wired.
    #[error("homing method {method} needs the {}, which is not wired; choose another method", .input.name())]
    NotWired {
        /// The homing method, a value of 0x6098.
        method: i8,
        /// The input that is not wired.
        input: Input,
    },
    /// A limit switch that the method does not use has become active, or was active in the direction of the run.
    #[error("the {} ended the search; check the home switch and where the run starts", .0.name())]
    WrongLimit(Input),
    /// Both limit switches are active at once.
    #[error("both limit switches are active; check their wiring")]
    BothLimits,
    /// Home was not found although the search has covered this distance, [`Switches::search_limit`], counts \[OURS].
    #[error("home was not found within {0} counts; check the switches")]
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

/// The result of homing: the shaft's count at home, and the position there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HomePosition {
    /// Home, in counts of the shaft.
    pub at: i64,
    /// The new position actual value at home, counts: the home offset 0x607C.
    pub offset: i32,
}

/// The state of a shaft at the start of homing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shaft {
    /// Position of the shaft, counts.
    pub position: i64,
    /// Whether the shaft or the position demand of the axis moves.
    pub moves: bool,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    /// No run was started, or the last run was interrupted.
    Idle,
    Searching(Run),
    /// Home was found at this count, and the shaft is running back to it.
    Returning(i64),
    Attained,
    Failed(HomingError),
}

/// The state of homing mode for one axis.
#[derive(Clone, Debug)]
pub struct Homing {
    phase: Phase,
    /// The settings from the start of the last run.
    settings: HomingSettings,
    /// Bit 4 (start of homing) of the last controlword, to detect its rise.
    start_bit: bool,
    halted: bool,
}

impl Homing {
    /// The state before homing mode is entered for the first time.
    pub const fn new(settings: HomingSettings) -> Self {
        Self { phase: Phase::Idle, settings, start_bit: false, halted: false }
    }

    /// Enters homing mode. A run starts when bit 4 rises; if bit 4 is set already, no run starts.
    pub fn enter(&mut self, word: Controlword, settings: HomingSettings) {
        *self = Self::new(settings);
        self.start_bit = starts(word);
    }

    /// Ends a run in a homing error, because the power stage no longer follows the demand.
    pub fn lose_power(&mut self, word: Controlword) {
        self.start_bit = starts(word);
        if let Phase::Searching(_) | Phase::Returning(_) = self.phase {
            self.phase = Phase::Failed(HomingError::PowerLost);
        }
    }

    /// Handles the controlword while the drive is in Operation enabled: starts or interrupts a run by bit 4, halts it by bit 8.
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

    /// The count to which the shaft has to run back, and its maximum speed, counts/s. `None` if home was not found, if
    /// homing is already completed, or during a halt.
    pub fn destination(&self) -> Option<(i64, f64)> {
        match self.phase {
            Phase::Returning(at) if !self.halted => Some((at, self.settings.zero_speed.into())),
            _ => None,
        }
    }

    /// Completes homing once the shaft has stopped at home. Returns the new home position. `None`: home was not found,
    /// homing is completed already, or halt is commanded.
    pub fn arrive(&mut self) -> Option<HomePosition> {
        let (at, _) = self.destination()?;
        self.phase = Phase::Attained;
        Some(HomePosition { at, offset: self.settings.offset })
    }

    /// The velocity that the search requests, counts/s.
    pub fn velocity(&self) -> f64 {
        match &self.phase {
            Phase::Searching(run) if !self.halted => run.velocity(&self.settings),
            _ => 0.0,
        }
    }

    /// The maximum acceleration of the search and of the return to home, counts/s² (0x609A).
    pub fn acceleration(&self) -> f64 {
        self.settings.acceleration.into()
    }

    /// Whether the axis stays beyond home instead of running back to home.
    pub const fn stays_beyond_home(&self) -> bool {
        self.settings.stays_beyond_home
    }

    /// The halt option code 0x605D while halt is commanded; `None` without halt.
    pub fn halt_option(&self) -> Option<i16> {
        self.halted.then_some(self.settings.halt_option)
    }

    /// Evaluates the switches and the index pulse between the counts `from` and `to` that the shaft has moved through. `way` is
    /// the distance of the position demand in the same time, counts, which counts toward the limit of the search.
    pub fn pass(&mut self, from: i64, to: i64, way: f64, switches: &Switches) {
        let Phase::Searching(run) = &mut self.phase else { return };
        match run.pass(from, to, way, switches) {
            Ok(None) => {}
            Ok(Some(at)) => self.phase = Phase::Returning(at),
            Err(error) => self.phase = Phase::Failed(error),
        }
    }

    /// Statusword bits 10, 12 and 13 (CiA 402-2, homing mode). `stands`: whether the shaft is at standstill.
    pub fn status_bits(&self, stands: bool) -> u16 {
        let (bits, ended) = match self.phase {
            Phase::Idle => (0, true),
            Phase::Searching(_) | Phase::Returning(_) => (0, self.halted),
            Phase::Attained => (Statusword::BIT12, true),
            Phase::Failed(_) => (Statusword::BIT13, true),
        };
        if ended && stands { bits | Statusword::TARGET_REACHED } else { bits }
    }

    /// The homing error of the last run, until the next run starts; `None` if there is no error.
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
