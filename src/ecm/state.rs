//! Configuring the network and changing its state.

use std::sync::Arc;
use std::time::Duration;

use super::config::{Config, Slave};
use super::error::Suspect;
use super::exchange::Task;
use super::exchange::marks::Marks;
use super::{Ecm, EcmError};
use crate::ethercat::cia402;
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::sk::{
    CommandId, DcShift, MasterCommand, MasterState, RawSlot, SdoCommand, SlaveCommand, SlaveKind, StateByte,
};

/// SK-4 `[OURS]`: how long the board may take to answer SET_AXIS with the number of slaves, and to answer SET_DC and
/// DRIVE_MODE.
const CONFIGURE_LIMIT: Duration = Duration::from_secs(2);
/// \[OURS] The time limit of the search for the slave that has prevented a change of state.
const SUSPECT_LIMIT: Duration = Duration::from_secs(3);
/// \[OURS] After a change to a lower state: how long the board may show a failure in that state while it brings lost
/// slaves back. The ESI files of slaves allow 2 s for PreOP.
const RECOVERY_LIMIT: Duration = Duration::from_secs(3);
const HINT: &str = "see whether frames get lost (Ecm::stats), then configure again";

impl Ecm {
    /// Sends the configuration of the network to the board, in PreOP (SET_AXIS, SET_DC, DRIVE_MODE). The whole
    /// configuration is checked before anything is sent, and the call waits for each answer.
    ///
    /// # Errors
    /// [`EcmError::Config`] if the configuration is invalid, [`EcmError::WrongState`] outside PreOP (for a board found in OP
    /// see [`Ecm::adopt`]), [`EcmError::SlaveCount`] if the board has found another number of slaves, [`EcmError::Timeout`] if
    /// the board does not answer in time, [`EcmError::Link`] if the link fails.
    pub fn configure(&self, config: &Config) -> Result<(), EcmError> {
        let size = self.slot_size()?;
        let cycle = config.check(size)?;
        let found = self.state()?;
        if found.state() != Some(MasterState::PreOp) {
            return Err(EcmError::WrongState { what: "configure", needs: "PreOP", found });
        }
        let mut count = 0;
        for group in 0..size.max_slaves().div_ceil(8) {
            let kinds = std::array::from_fn(|k| config.slaves.get(group * 8 + k).map_or(SlaveKind::None, Slave::kind));
            count = self.master("SET_AXIS", &MasterCommand::SetAxis { group: group as u8, kinds })?;
        }
        if count as usize != config.slaves.len() {
            return Err(EcmError::SlaveCount { declared: config.slaves.len(), found: count as usize });
        }
        self.master("SET_DC", &MasterCommand::SetDc { cycle, shift: DcShift::Auto })?;
        let modes: Vec<(usize, RawSlot)> = (1..)
            .zip(&config.slaves)
            .filter_map(|(slave, config)| {
                let axis = config.axis()?;
                let command = SlaveCommand::DriveMode { mode: axis.mode, sync: axis.sync };
                Some((slave, command.with_index(Marks::PROBE).encode(size)))
            })
            .collect();
        if !modes.is_empty() {
            let id = CommandId::DriveMode.code();
            let task = Task::new("DRIVE_MODE", HINT, CONFIGURE_LIMIT, &modes).exclusive();
            self.exchange.run(&task, |session, _| {
                if !modes.iter().all(|(slot, _)| session.slot(*slot).id == id) {
                    return Ok(None);
                }
                let echoes = modes.iter().all(|(slot, _)| session.slot(*slot).index == Marks::PROBE);
                session.marks.set_echo(echoes);
                Ok(Some(()))
            })?;
        }
        self.exchange.set_network(config)
    }

    /// Takes over a board that is configured already, for example one in OP. `config` is its present configuration.
    /// Nothing is sent, and moving axes go on.
    ///
    /// # Errors
    /// [`EcmError::Config`] if the configuration is invalid, [`EcmError::Busy`] if another thread uses the board for too long.
    pub fn adopt(&self, config: &Config) -> Result<(), EcmError> {
        config.check(self.slot_size()?)?;
        self.exchange.set_network(config)
    }

    /// Sends a command for the board itself, outside OP, and waits for its answer. Returns the result in the answer,
    /// Data1 of slot 0.
    ///
    /// # Errors
    /// [`EcmError::Timeout`] without an answer, [`EcmError::Busy`], [`EcmError::NoReport`], [`EcmError::Link`].
    pub(super) fn master(&self, what: &'static str, command: &MasterCommand) -> Result<u32, EcmError> {
        let slot = command.encode();
        self.exchange.run(&Task::new(what, HINT, CONFIGURE_LIMIT, &[(0, slot)]).exclusive(), |session, _| {
            Ok((session.board().id == slot.id).then_some(session.board().result))
        })
    }

    /// Changes the state of the network and waits until it is reached. From Init the network must first go to PreOP,
    /// where it is configured.
    ///
    /// # Errors
    /// [`EcmError::StateStuck`], with the state in which the change ended and the slave that probably prevented it;
    /// [`EcmError::WrongState`] from Init to SafeOP or OP, [`EcmError::NoReport`] if the board is silent, [`EcmError::Timeout`]
    /// if the change does not end in time, [`EcmError::Link`] if the link fails.
    pub fn set_state(&self, wanted: MasterState) -> Result<(), EcmError> {
        self.set_state_within(wanted, self.exchange.options.state_limit)
    }

    /// As [`Ecm::set_state`], with another timeout than that of the options.
    ///
    /// # Errors
    /// As [`Ecm::set_state`].
    pub fn set_state_within(&self, wanted: MasterState, limit: Duration) -> Result<(), EcmError> {
        let commands = [(0, MasterCommand::SetState(wanted).encode())];
        let hint = "give it more time, or look at the slaves' LEDs";
        // SET_STATE is not sent again, as that would restart a failed change. So a lost frame ends in a timeout.
        let task = Task::new("a change of state", hint, limit, &commands).once();
        // The state byte may still show the failure of an earlier change. So a failure counts only after the byte has
        // differed from this old value.
        let old = self.state()?;
        // From Init the board rejects SET_STATE to SafeOP or OP, and no report shows that (SK-4.63). So the call fails
        // here.
        if old.state() == Some(MasterState::Init) && wanted > MasterState::PreOp {
            return Err(EcmError::WrongState { what: "a change to SafeOP or OP", needs: "PreOP", found: old });
        }
        let mut moved = !old.is_failed();
        // On the way down a board does not wait for lost slaves. It brings them back afterwards, and shows a failure until then.
        let goes_down = old.is_failed() && old.state().is_some_and(|state| wanted < state);
        let mut down_since = None;
        let ended = self.exchange.run(&task, |session, _| {
            let now = session.board().state;
            moved |= now != old;
            if now == StateByte::reached(wanted) {
                return Ok(Some(None));
            }
            if goes_down && moved && now == StateByte::failed(Some(wanted)) {
                let at = self.exchange.now();
                if at.saturating_sub(*down_since.get_or_insert(at)) < RECOVERY_LIMIT {
                    return Ok(None);
                }
            }
            Ok((moved && now.is_failed()).then_some(Some(now)))
        });
        match ended {
            Ok(None) => Ok(()),
            Ok(Some(found)) => Err(EcmError::StateStuck { wanted, found, suspect: self.suspect() }),
            Err(EcmError::Timeout { .. }) if self.state()?.is_failed() => {
                Err(EcmError::StateStuck { wanted, found: self.state()?, suspect: self.suspect() })
            }
            Err(error) => Err(error),
        }
    }

    /// Searches for the slave that prevents a change of state, by reading from each slave an object that its kind must
    /// have. The first slave that does not answer or lacks the object is the suspect.
    fn suspect(&self) -> Suspect {
        let began = self.exchange.now();
        let Ok(session) = self.exchange.lock() else { return Suspect::Network };
        let network = Arc::clone(&session.network);
        drop(session);
        if network.count == 0 {
            return Suspect::Undeclared;
        }
        let mut asked = 0;
        for (slave, config) in network.slaves() {
            let left = SUSPECT_LIMIT.saturating_sub(self.exchange.now().saturating_sub(began));
            let needed = match config {
                Slave::Unused => continue,
                Slave::Io => ObjectAddress::new(0x1000, 0),
                _ => ObjectAddress::new(cia402::STATUSWORD, 0),
            };
            match self.transfer(SdoCommand::Read { slave, object: needed }, left) {
                Ok(_) => asked += 1,
                Err(EcmError::SdoAborted { code: AbortCode::NO_OBJECT, .. }) => {
                    return Suspect::NotOfKind { slave, kind: config.kind().name(), missing: needed };
                }
                Err(EcmError::SdoAborted { code: AbortCode::TIMEOUT, .. } | EcmError::Timeout { .. }) => {
                    return Suspect::Silent { slave };
                }
                Err(EcmError::SdoAborted { .. }) => asked += 1,
                Err(_) => return Suspect::Network,
            }
        }
        if asked > 0 { Suspect::Unknown } else { Suspect::Network }
    }
}
