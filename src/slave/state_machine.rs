//! The state machine of a CiA 402 drive (CiA 402-2, IEC 61800-7-201, 7.1): states, transitions 0 to 16, option codes.
//!
//! The state machine moves nothing itself: it determines what the power stage does ([`Power`]). The caller reports
//! whether the shaft is at standstill. Transitions that take time in a real drive take time here too, so that programs
//! have to poll the statusword.

use crate::ethercat::Ns;
use crate::ethercat::cia402::{Controlword, DriveState, Statusword};

/// A fault that a drive shows in its statusword and its error code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceFault {
    /// The error code, 0x603F.
    pub code: u16,
    /// Whether a fault reset clears the fault; otherwise it stays until the device is switched off.
    pub resettable: bool,
}

/// The durations of a drive's transitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransitionTimes {
    /// The duration of transition 1, the self test from power-on to Switch on disabled, ns.
    pub self_test_ns: Ns,
    /// The duration of transition 3, in which the power stage charges, ns.
    pub switch_on_ns: Ns,
    /// The duration of transition 4, in which the motor is energised and the brake opens, ns.
    pub enable_ns: Ns,
}

impl Default for TransitionTimes {
    /// \[OURS] Typical durations of a small servo drive: 100 ms self test, 10 ms switch on, 40 ms enable.
    fn default() -> Self {
        Self { self_test_ns: 100_000_000, switch_on_ns: 10_000_000, enable_ns: 40_000_000 }
    }
}

/// The option codes that select how a drive stops, with the values of their objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OptionCodes {
    /// Quick stop option code, 0x605A, 0..=8.
    pub quick_stop: i16,
    /// Shutdown option code, 0x605B, 0..=1.
    pub shutdown: i16,
    /// Disable operation option code, 0x605C, 0..=1.
    pub disable_operation: i16,
    /// Fault reaction option code, 0x605E, 0..=4.
    pub fault_reaction: i16,
}

/// The ramp on which a drive brakes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ramp {
    /// The slow-down ramp, 0x6084.
    SlowDown,
    /// The quick-stop ramp, 0x6085.
    QuickStop,
    /// Braking at the maximum torque that the drive allows.
    TorqueLimit,
}

impl Ramp {
    /// The ramp that an option code selects: 1..=4, for quick stop also 5..=8. `None` for 0: the motor coasts.
    const fn of_option(code: i16) -> Option<Self> {
        match code {
            1 | 5 => Some(Self::SlowDown),
            2 | 6 => Some(Self::QuickStop),
            // "Current limit" (3, 7) and "voltage limit" (4, 8) have the same effect.
            3 | 4 | 7 | 8 => Some(Self::TorqueLimit),
            _ => None,
        }
    }
}

/// What the power stage does in a state of the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Power {
    /// The power stage is off, and the motor has no torque.
    Off,
    /// The motor follows its targets.
    Follow,
    /// The motor brakes to a standstill and is then held.
    Stop(Ramp),
}

/// A command of the controlword (CiA 402-2 table "command coding").
#[derive(Clone, Copy, PartialEq, Eq)]
enum Command {
    Shutdown,
    SwitchOn,
    EnableOperation,
    DisableVoltage,
    QuickStop,
    /// No change of state: bit 7, fault reset, is set, and only its rising edge has an effect; the other bits are ignored.
    None,
}

impl Command {
    const fn of(word: Controlword) -> Self {
        let word = word.0;
        if word & Controlword::FAULT_RESET != 0 {
            Self::None
        } else if word & 0b0010 == 0 {
            Self::DisableVoltage
        } else if word & 0b0100 == 0 {
            Self::QuickStop
        } else if word & 0b0001 == 0 {
            Self::Shutdown
        } else if word & 0b1000 == 0 {
            Self::SwitchOn
        } else {
            Self::EnableOperation
        }
    }
}

/// The CiA 402 state machine of one axis.
#[derive(Clone, Debug)]
#[repr(C)] // The fields that each cycle uses are adjacent, at the end.
pub struct StateMachine {
    times: TransitionTimes,
    options: OptionCodes,
    /// The transition in progress, if it takes time: its target state and the remaining time, ns. `None`: there is no
    /// such transition.
    delayed: Option<(DriveState, Ns)>,
    state: DriveState,
    controlword: Controlword,
    /// Whether controlword bit 7, fault reset, has risen since the last step.
    reset_requested: bool,
    /// Set when the master is lost in Operation enabled or Quick stop active: after the quick stop the drive goes to Switch on
    /// disabled, even if the quick stop option code says that it stays in Quick stop active.
    ends_switched_off: bool,
    /// In Operation enabled after the command Shutdown or Disable operation: the ramp on which the motor brakes, and
    /// the state to which the drive goes afterwards. Otherwise `None`.
    braking: Option<(Ramp, DriveState)>,
    /// In Fault reaction active: the ramp on which the motor brakes; `None` if it coasts.
    reaction: Option<Ramp>,
    fault: Option<DeviceFault>,
}

impl StateMachine {
    /// The state machine of a drive at power-on (transition 0).
    pub const fn new(times: TransitionTimes, options: OptionCodes) -> Self {
        Self {
            times,
            options,
            state: DriveState::NotReadyToSwitchOn,
            controlword: Controlword(0),
            reset_requested: false,
            delayed: None,
            braking: None,
            ends_switched_off: false,
            reaction: None,
            fault: None,
        }
    }

    /// The state of the drive.
    pub const fn state(&self) -> DriveState {
        self.state
    }

    /// The latest controlword; after the loss of the master, the value of the command Quick stop.
    pub const fn controlword(&self) -> Controlword {
        self.controlword
    }

    /// The present fault; `None` if there is no fault.
    pub const fn fault(&self) -> Option<DeviceFault> {
        self.fault
    }

    /// Applies new option codes, which a master has written.
    pub const fn set_options(&mut self, options: OptionCodes) {
        self.options = options;
    }

    /// Stores a controlword. It takes effect in the next [`StateMachine::step`].
    pub const fn command(&mut self, word: Controlword) {
        if word.0 & !self.controlword.0 & Controlword::FAULT_RESET != 0 {
            self.reset_requested = true;
        }
        self.controlword = word;
    }

    /// Requests a fault reset, like a rising bit 7 of the controlword. It takes effect in the next [`StateMachine::step`].
    pub const fn request_reset(&mut self) {
        self.reset_requested = true;
    }

    /// Raises a fault (transition 13). The new fault replaces an earlier fault that was not cleared. If the earlier
    /// fault cannot be reset, the new one cannot be reset either.
    pub fn raise(&mut self, fault: DeviceFault) {
        let resettable = fault.resettable && self.fault.is_none_or(|earlier| earlier.resettable);
        self.fault = Some(DeviceFault { resettable, ..fault });
        if matches!(self.state, DriveState::FaultReactionActive | DriveState::Fault) {
            return;
        }
        self.reaction = match self.power() {
            Power::Off => None,
            _ => Ramp::of_option(self.options.fault_reaction),
        };
        self.go(DriveState::FaultReactionActive);
    }

    /// The cause of the present fault is gone: a fault reset clears it from now on.
    pub const fn end_cause(&mut self) {
        if let Some(fault) = &mut self.fault {
            fault.resettable = true;
        }
    }

    /// Handles the loss of the master: the device has left OP, so no more controlwords come.
    ///
    /// \[OURS] The drive brakes as for a quick stop and ends in Switch on disabled; from then on [`Self::controlword`] returns
    /// the command Quick stop.
    pub fn lose_master(&mut self) {
        self.controlword = Controlword(0b0010);
        if matches!(self.state, DriveState::OperationEnabled | DriveState::QuickStopActive) {
            self.ends_switched_off = true;
        }
    }

    /// What the power stage does in the present state.
    pub fn power(&self) -> Power {
        match self.state {
            DriveState::OperationEnabled => self.braking.map_or(Power::Follow, |(ramp, _)| Power::Stop(ramp)),
            DriveState::QuickStopActive => Ramp::of_option(self.options.quick_stop).map_or(Power::Off, Power::Stop),
            DriveState::FaultReactionActive => self.reaction.map_or(Power::Off, Power::Stop),
            _ => Power::Off,
        }
    }

    /// Statusword bits 0..=6 and 9: the state, voltage enabled (after the self test) and remote.
    ///
    /// The low byte is 37h in Operation enabled and 50h in Switch on disabled (SK-7 \[OBS]).
    pub const fn status_bits(&self) -> u16 {
        match self.state {
            DriveState::NotReadyToSwitchOn => 0,
            state => state.status_bits() as u16 | Statusword::VOLTAGE_ENABLED | Statusword::REMOTE,
        }
    }

    /// Advances the state machine by `dt_ns`. At most one transition ends in a call, and the rest of `dt_ns` does not shorten
    /// the delay of the next transition. `standstill` says whether the shaft is at standstill.
    pub fn step(&mut self, dt_ns: Ns, standstill: bool) {
        use DriveState::*;
        let reset = std::mem::take(&mut self.reset_requested);
        let command = Command::of(self.controlword);
        match (self.state, command) {
            // Transition 1: the end of the self test.
            (NotReadyToSwitchOn, _) => self.go_delayed(SwitchOnDisabled, self.times.self_test_ns, dt_ns),
            (SwitchOnDisabled, Command::Shutdown) => self.go(ReadyToSwitchOn), // transition 2
            // Transitions 7 and 10.
            (ReadyToSwitchOn | SwitchedOn, Command::DisableVoltage | Command::QuickStop) => self.go(SwitchOnDisabled),
            (ReadyToSwitchOn, Command::SwitchOn | Command::EnableOperation) => {
                self.go_delayed(SwitchedOn, self.times.switch_on_ns, dt_ns); // transition 3
            }
            // Transition 4.
            (SwitchedOn, Command::EnableOperation) => self.go_delayed(OperationEnabled, self.times.enable_ns, dt_ns),
            (SwitchedOn, Command::Shutdown) => self.go(ReadyToSwitchOn), // transition 6
            (OperationEnabled, _) => self.step_enabled(command, standstill),
            (QuickStopActive, _) => self.step_quick_stop(command, standstill),
            (FaultReactionActive, _) => {
                if self.power() == Power::Off || standstill {
                    self.go(Fault); // transition 14
                }
            }
            (Fault, _) => {
                if reset && self.fault.is_none_or(|fault| fault.resettable) {
                    self.fault = None;
                    self.go(SwitchOnDisabled); // transition 15
                }
            }
            // The controlword no longer commands the transition in progress, so the transition is cancelled.
            (SwitchOnDisabled | ReadyToSwitchOn | SwitchedOn, _) => self.delayed = None,
        }
    }

    fn step_enabled(&mut self, command: Command, standstill: bool) {
        use DriveState::*;
        let (option, target) = match command {
            Command::DisableVoltage => return self.go(SwitchOnDisabled), // transition 9
            Command::QuickStop => return self.go(QuickStopActive),       // transition 11
            Command::SwitchOn => (self.options.disable_operation, SwitchedOn), // transition 5
            Command::Shutdown => (self.options.shutdown, ReadyToSwitchOn), // transition 8
            Command::EnableOperation => {
                self.braking = None;
                return;
            }
            Command::None => return,
        };
        self.braking = Ramp::of_option(option).map(|ramp| (ramp, target));
        if self.braking.is_none() || standstill {
            self.go(target);
        }
    }

    fn step_quick_stop(&mut self, command: Command, standstill: bool) {
        use DriveState::*;
        let stays = matches!(self.options.quick_stop, 5..=8) && !self.ends_switched_off;
        if command == Command::DisableVoltage {
            self.go(SwitchOnDisabled); // transition 12
        } else if command == Command::EnableOperation && stays {
            self.go(OperationEnabled); // transition 16
        } else if !stays && (self.power() == Power::Off || standstill) {
            self.go(SwitchOnDisabled); // transition 12
        }
    }

    fn go_delayed(&mut self, target: DriveState, takes_ns: Ns, dt_ns: Ns) {
        let left = match self.delayed {
            Some((to, left)) if to == target => left,
            _ => takes_ns,
        };
        if left <= dt_ns {
            self.go(target);
        } else {
            self.delayed = Some((target, left - dt_ns));
        }
    }

    fn go(&mut self, target: DriveState) {
        self.delayed = None;
        self.braking = None;
        if target == DriveState::SwitchOnDisabled {
            self.ends_switched_off = false;
        }
        self.state = target;
    }
}
