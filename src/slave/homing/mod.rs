//! Homing (CiA 402-2, mode 6): the drive looks for a place on its travel by switches and the index pulse.
//!
//! [`method`] says what to look for; [`run`] is one search; [`Homing`] is the mode around it: start, halt,
//! interruption, and bits 10, 12 and 13 of the statusword. Nothing here moves anything: an axis asks for the velocity
//! that is wanted, moves its shaft, and tells how far it went.
//!
//! **What home is.** The count where the edge was seen, or the index pulse after it, to the count. The axis slows down
//! past it and runs back to it, at 0x6099:2 and with 0x609A. When it stands there home is attained: from then on the
//! position actual value is such that it is 0x607C there, and the statusword says so (OBS).
//!
//! **Decisions** \[OURS].
//! - Bits 10, 12 and 13 stand as in the table of CiA 402-2 whenever the mode is 6, in every state of the drive.
//! - 0x6098 to 0x609A and 0x607C are read when a run starts; a change meanwhile acts in the next run.
//! - On the way back no switch is looked at: the run has been there before. A run that ends on the way back, however it
//!   does, has changed no position.
//! - Bit 4 falling ends a run (interrupted), and the next run begins anew. Halt (bit 8) brakes by 0x605D, and the run
//!   goes on where it was when halt is taken back with bit 4 still set.
//! - A run during which the power stage is taken away (fault, quick stop, disabled, no master) ends in a homing error.
//! - A shaft that is slower than what bit 10 of CSV takes for reached may be started.
//! - Every outcome stays until the next start or until the mode is left.

pub mod method;
pub mod run;

use super::switches::{Input, Switches};
use crate::cia402::{Controlword, Statusword};
use run::Run;

/// What homing reads of a drive's objects, in counts, counts/s and counts/s².
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HomingSettings {
    /// 0x6098.
    pub method: i8,
    /// 0x607C: the position actual value at home.
    pub offset: i32,
    /// 0x6099:1, speed during the search for a switch.
    pub switch_speed: u32,
    /// 0x6099:2, speed during the search for zero.
    pub zero_speed: u32,
    /// 0x609A.
    pub acceleration: u32,
    /// 0x605D, halt option code.
    pub halt_option: i16,
}

/// Why a homing run ended without a home.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum HomingError {
    /// 0x6098 is none of the methods there are.
    #[error("homing method {0} is not supported; write one of 1..14, 17..30, 33, 34, 35, 37 to 0x6098")]
    UnsupportedMethod(i8),
    /// The method needs an input that is not wired.
    #[error("homing method {method} needs the {}, which is not wired; choose another method", .input.name())]
    NotWired {
        /// The method.
        method: i8,
        /// The input.
        input: Input,
    },
    /// A limit switch that has no part in the method is active ahead, or was run into.
    #[error("the {} ended the search; check the home switch and where the run starts", .0.name())]
    WrongLimit(Input),
    /// Both limit switches are active at once.
    #[error("both limit switches are active; check their wiring")]
    BothLimits,
    /// Nothing was found on a way that long \[OURS].
    #[error("nothing was found on a way of {0} counts; check the switches")]
    TooFar(u64),
    /// The shaft was moving at the start.
    #[error("the shaft was moving when homing was started; wait for statusword bit 10 first")]
    Moving,
    /// 0x6099:1, 0x6099:2 or 0x609A is 0.
    #[error("a homing speed or the homing acceleration is 0; write 0x6099:1, 0x6099:2 and 0x609A")]
    NoSpeed,
    /// The power stage was taken away.
    #[error("the drive left Operation enabled during homing; enable it and start again")]
    PowerLost,
}

/// Home has been found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Homed {
    /// Where, in counts of the shaft.
    pub at: i64,
    /// The position actual value there.
    pub offset: i32,
}

/// Where a shaft is and whether it moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shaft {
    /// Counts.
    pub position: i64,
    /// It moves, or is asked to.
    pub moves: bool,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    /// Not started, or interrupted.
    Idle,
    Searching(Run),
    /// Home was seen at this count of the shaft, which runs back to it.
    Returning(i64),
    Attained,
    Failed(HomingError),
}

/// The mode.
#[derive(Clone, Debug)]
pub struct Homing {
    phase: Phase,
    /// As they were at the last start.
    settings: HomingSettings,
    /// Bit 4 as it was last.
    start_bit: bool,
    halted: bool,
}

impl Homing {
    /// A mode that has not been entered.
    pub const fn new(settings: HomingSettings) -> Self {
        Self { phase: Phase::Idle, settings, start_bit: false, halted: false }
    }

    /// The mode is entered. A start bit that is set already starts nothing.
    pub fn enter(&mut self, word: Controlword, settings: HomingSettings) {
        *self = Self::new(settings);
        self.start_bit = starts(word);
    }

    /// The power stage follows no targets.
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

    /// The count that the shaft runs back to, and how fast at most, counts/s.
    pub fn destination(&self) -> Option<(i64, f64)> {
        match self.phase {
            Phase::Returning(at) if !self.halted => Some((at, self.settings.zero_speed.into())),
            _ => None,
        }
    }

    /// The shaft stands where it was to run back to: home is attained.
    pub fn arrive(&mut self) -> Option<Homed> {
        let (at, _) = self.destination()?;
        self.phase = Phase::Attained;
        Some(Homed { at, offset: self.settings.offset })
    }

    /// The velocity that is wanted in the search, counts/s.
    pub fn velocity(&self) -> f64 {
        match &self.phase {
            Phase::Searching(run) if !self.halted => run.velocity(&self.settings),
            _ => 0.0,
        }
    }

    /// How fast it may change, counts/s² (0x609A).
    pub fn acceleration(&self) -> f64 {
        self.settings.acceleration.into()
    }

    /// 0x605D, while halt is what stops the axis.
    pub fn halt_option(&self) -> Option<i16> {
        self.halted.then_some(self.settings.halt_option)
    }

    /// The shaft went from one count to another, with `way` counts asked for. What was on the way is seen.
    pub fn pass(&mut self, from: i64, to: i64, way: f64, switches: &Switches) {
        let Phase::Searching(run) = &mut self.phase else { return };
        match run.pass(from, to, way, switches) {
            Ok(None) => {}
            Ok(Some(at)) => self.phase = Phase::Returning(at),
            Err(error) => self.phase = Phase::Failed(error),
        }
    }

    /// Bits 10, 12 and 13 of the statusword (CiA 402-2, homing mode).
    pub fn status_bits(&self, stands: bool) -> u16 {
        let (bits, ended) = match self.phase {
            Phase::Idle => (0, true),
            Phase::Searching(_) | Phase::Returning(_) => (0, self.halted),
            Phase::Attained => (Statusword::BIT12, true),
            Phase::Failed(_) => (Statusword::BIT13, true),
        };
        if ended && stands { bits | Statusword::TARGET_REACHED } else { bits }
    }

    /// Why the last run ended without a home, until the next one starts.
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
