//! A network that this crate's own master runs over a network card, or over simulated slaves.

use std::time::Duration;

use super::mailboxes::{self, ANSWER_MAX_NS, Mailboxes};
use super::{BusError, FoundSlave, Network, SlaveState};
use crate::ethercat::coe::{EntryRequest, ObjectAddress, SdoScope};
use crate::ethercat::registers::{
    AL_STATUS, AlStatusWithCode, Features, PORT_DESCRIPTOR, RequestedState, SYNC_MANAGER, SYNC_MANAGER_LEN, SmControl,
    SyncManager, WATCHDOG_DIVIDER, WATCHDOG_PROCESS_DATA, WATCHDOG_STATUS,
};
use crate::ethercat::sii::MailboxProtocols;
use crate::ethercat::{AlState, Command, Ns, SlaveSet};
use crate::fieldbus::RingState;
use crate::fieldbus::nic::NicWires;
use crate::master::{DatagramAnswer, Ending, FrameCounters, Job, MailboxInfo, Master, Settings, SlaveInfo, watchdog};

/// \[OURS] Timeout for a slave to reach PreOP, the most common value in ESI files.
const PREOP_MAX_NS: Ns = 10_000_000_000;
/// \[OURS] Longest wait for frames between two polls of the master, ns.
const TURN_NS: Ns = 200_000;
/// \[OURS] Interval of the master's watch over the slaves, ns. Without cycles the watch also has to distribute the time
/// of the reference clock. The interval equals a cycle of 1 ms, in which a cyclic master distributes it.
const WATCH_NS: Ns = 1_000_000;
/// \[OURS] The maximum number of attempts to send a datagram that reads states before the scan, if it does not come back.
const TRIES: u32 = 3;

/// \[OURS] The longest watchdog time of a slave in OP that is waited for, and the margin that is added to the wait, ns.
const WATCHDOG_MAX_NS: Ns = 10_000_000_000;
const WATCHDOG_MARGIN_NS: Ns = 20_000_000;
/// The bit of [`WATCHDOG_STATUS`] that is set while the process data watchdog has not expired.
const WATCHDOG_RUNS: u8 = 1 << 0;
/// The number of sync managers whose settings are read.
const SYNC_MANAGERS_MAX: usize = 16;

/// \[OURS] Interval of the long frames that put load on the cables, ns, their length, and the byte that fills them:
/// 0x55 makes the signal change with each bit.
const LOAD_NS: Ns = 250_000;
const LOAD_BYTES: usize = 1400;
const LOAD_BYTE: u8 = 0x55;

fn is_op(state: SlaveState) -> bool {
    state.status.state() == RequestedState::State(AlState::Op)
}

/// A network of slaves that this crate's own master runs over a network card or over simulated wires.
pub(super) struct SoftwareNetwork<W> {
    master: Master,
    wires: W,
    /// The states of the slaves before the scan.
    found: Vec<SlaveState>,
}

impl<W: NicWires> SoftwareNetwork<W> {
    /// A network that this crate's own master reaches over these wires. Nothing is sent yet.
    pub(super) fn new(wires: W, settings: Settings) -> Self {
        let settings = Settings { watch_ns: WATCH_NS, ..settings };
        Self { master: Master::new(settings), wires, found: Vec::new() }
    }

    /// Polls the master until a job has ended, and returns its result.
    fn wait_for<T: Ending>(&mut self, job: Job<T>) -> T {
        loop {
            self.master.poll(self.wires.now(), &mut self.wires);
            if let Some(end) = self.master.take(job) {
                return end;
            }
            // Events are dropped: nobody reads them here, and they would fill the master's event queue.
            while self.master.take_event().is_some() {}
            self.wires.wait(self.wires.now().saturating_add(TURN_NS));
        }
    }

    /// Sends a datagram up to [`TRIES`] times until it comes back; `None` if it does not.
    fn datagram(&mut self, command: Command, position: u16, address: u16, len: usize) -> Option<DatagramAnswer> {
        (0..TRIES).find_map(|_| {
            let address = u32::from(position) | u32::from(address) << 16;
            let job = self.master.datagram(command, address, &vec![0; len]);
            self.wait_for(job).ok()
        })
    }

    /// Reads the AL states of all slaves into `found`, since the scan that follows takes all slaves to Init. Fails if a
    /// slave in OP gets outputs, which means that another master runs the network.
    fn look(&mut self) -> Result<(), BusError> {
        self.found.clear();
        let counted = self.datagram(Command::Brd, 0, AL_STATUS, 2).map_or(0, |answer| answer.working_counter);
        self.check_cards()?;
        let (mut watched, mut longest_ns) = (Vec::new(), 0);
        for position in 0..counted {
            let state = self.state_at(position);
            if is_op(state)
                && let Some(watchdog_ns) = self.watchdog_at(position)
            {
                watched.push(position);
                longest_ns = watchdog_ns.min(WATCHDOG_MAX_NS).max(longest_ns);
            }
            self.found.push(state);
        }
        if watched.is_empty() {
            return Ok(());
        }
        // A slave without a state machine, or without outputs, may stay in OP when its master is gone. The process data
        // watchdog shows whether outputs still arrive.
        self.wait(Duration::from_nanos(longest_ns + WATCHDOG_MARGIN_NS))?;
        for position in watched {
            if is_op(self.state_at(position))
                && self.register_at::<2>(position, WATCHDOG_STATUS)[0] & WATCHDOG_RUNS != 0
            {
                return Err(BusError::Runs { slave: position as u8 + 1 });
            }
        }
        Ok(())
    }

    fn state_at(&mut self, position: u16) -> SlaveState {
        let AlStatusWithCode { status, code } = AlStatusWithCode::decode(&self.register_at(position, AL_STATUS));
        SlaveState { status, code }
    }

    /// The time of the process data watchdog of the slave at that position, ns; `None` if no sync manager restarts the
    /// watchdog, or if it is off.
    fn watchdog_at(&mut self, position: u16) -> Option<Ns> {
        let managers: [u8; SYNC_MANAGERS_MAX * SYNC_MANAGER_LEN] = self.register_at(position, SYNC_MANAGER);
        let triggers = |manager: &[u8; SYNC_MANAGER_LEN]| {
            let manager = SyncManager::decode(manager);
            manager.is_enabled() && manager.len > 0 && manager.control.contains(SmControl::WATCHDOG)
        };
        if !managers.as_chunks::<SYNC_MANAGER_LEN>().0.iter().any(triggers) {
            return None;
        }
        let [divider, units] =
            [WATCHDOG_DIVIDER, WATCHDOG_PROCESS_DATA].map(|at| u16::from_le_bytes(self.register_at(position, at)));
        Some(watchdog::unit_ns(divider) * Ns::from(units)).filter(|ns| *ns > 0)
    }

    /// Registers of the slave at that position; 0 if it does not answer.
    fn register_at<const N: usize>(&mut self, position: u16, address: u16) -> [u8; N] {
        let answer = self.datagram(Command::Aprd, position.wrapping_neg(), address, N);
        answer.and_then(|answer| answer.data.first_chunk().copied()).unwrap_or([0; N])
    }

    /// Waits for the end of a job and checks that a network card is still there.
    ///
    /// # Errors
    /// [`BusError::CardGone`]: all network cards are gone.
    fn finish<T: Ending>(&mut self, job: Job<T>) -> Result<T, BusError> {
        let end = self.wait_for(job);
        self.check_cards().map(|()| end)
    }

    /// Fails if all network cards are gone.
    ///
    /// # Errors
    /// [`BusError::CardGone`]: all network cards are gone.
    fn check_cards(&self) -> Result<(), BusError> {
        match self.wires.cards_gone().filter(|gone| gone.is_all) {
            Some(gone) => Err(BusError::CardGone { text: gone.text.to_string() }),
            None => Ok(()),
        }
    }

    fn info(&self, slave: u8) -> Result<&SlaveInfo, BusError> {
        let found = self.master.slaves().len();
        self.master.slave(slave).ok_or(BusError::NoSuchSlave { slave, found })
    }
}

impl<W: NicWires> Mailboxes for SoftwareNetwork<W> {
    fn mailbox(&mut self, slave: u8) -> Result<Option<MailboxInfo>, BusError> {
        Ok(self.info(slave)?.mailbox)
    }

    fn run<T: Ending>(&mut self, slave: u8, start: impl FnOnce(&mut Master, u8) -> Job<T>) -> Result<T, BusError> {
        let job = start(&mut self.master, slave);
        self.finish(job)
    }
}

impl<W: NicWires> Network for SoftwareNetwork<W> {
    fn scan(&mut self) -> Result<Vec<FoundSlave>, BusError> {
        self.look()?;
        let scan = self.master.scan();
        if self.finish(scan)?? == 0 {
            return Err(match self.master.counters().unpassed {
                0 => BusError::NoSlave,
                frames => BusError::Echo { frames },
            });
        }
        let mut slaves = Vec::new();
        let found = std::mem::take(&mut self.found).into_iter().map(Some).chain(std::iter::repeat(None));
        for ((slave, info), found) in (1..).zip(self.master.slaves().to_vec()).zip(found) {
            let mut port_types = [0];
            self.read(slave, PORT_DESCRIPTOR, &mut port_types)?;
            let unknown = SlaveState { status: Default::default(), code: Default::default() };
            slaves.push(FoundSlave {
                slave,
                station: info.station,
                alias: info.alias,
                identity: info.identity,
                found: found.unwrap_or(unknown),
                ports: info.ports,
                port_types: port_types[0],
                upstream: info.upstream,
                entry_port: info.entry_port,
                has_clock: info.features.contains(Features::CLOCK),
                protocols: info
                    .eeprom
                    .as_ref()
                    .ok()
                    .map(|_| info.mailbox.map_or(MailboxProtocols::NONE, |mailbox| mailbox.protocols)),
                process_bytes: info.described_bytes().into(),
                eeprom_error: info.eeprom_fault().map(|fault| fault.to_string()),
                name: info.name,
            });
        }
        Ok(slaves)
    }

    fn is_virtual(&self) -> bool {
        !self.wires.is_real_time()
    }

    fn resets_slaves(&self) -> bool {
        true
    }

    fn value_bytes_max(&self) -> usize {
        usize::MAX
    }

    fn wait(&mut self, time: Duration) -> Result<(), BusError> {
        let until = self.wires.now().saturating_add(Ns::try_from(time.as_nanos()).unwrap_or(Ns::MAX));
        while self.wires.now() < until {
            self.master.poll(self.wires.now(), &mut self.wires);
            while self.master.take_event().is_some() {}
            self.wires.wait(until.min(self.wires.now().saturating_add(TURN_NS)));
        }
        self.check_cards()
    }

    fn load(&mut self, time: Duration) -> Result<(), BusError> {
        let until = self.wires.now().saturating_add(Ns::try_from(time.as_nanos()).unwrap_or(Ns::MAX));
        while self.wires.now() < until {
            // A NOP datagram has no effect in slaves.
            let job = self.master.datagram(Command::Nop, 0, &[LOAD_BYTE; LOAD_BYTES]);
            let next = until.min(self.wires.now().saturating_add(LOAD_NS));
            // Lost frames are no error: a bad cable loses some, and its error counters show that.
            let _ = self.wait_for(job);
            self.wait(Duration::from_nanos(next.saturating_sub(self.wires.now())))?;
        }
        Ok(())
    }

    fn read(&mut self, slave: u8, address: u16, data: &mut [u8]) -> Result<(), BusError> {
        self.info(slave)?;
        let job = self.master.read_registers(slave, address, data.len());
        let read = self.finish(job)?.map_err(|error| BusError::Register { slave, address, error })?;
        data.iter_mut().zip(read).for_each(|(to, from)| *to = from);
        Ok(())
    }

    fn write(&mut self, slave: u8, address: u16, data: &[u8]) -> Result<(), BusError> {
        self.info(slave)?;
        let job = self.master.write_registers(slave, address, data);
        self.finish(job)?.map_err(|error| BusError::Register { slave, address, error })
    }

    fn bring_to_preop(&mut self, slave: u8) -> Result<(), BusError> {
        self.info(slave)?;
        let job = self.master.request_state([slave].into_iter().collect::<SlaveSet>(), AlState::PreOp, PREOP_MAX_NS);
        self.finish(job)?.map_err(BusError::State)
    }

    fn upload(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope) -> Result<Vec<u8>, BusError> {
        mailboxes::open(self, slave, MailboxProtocols::COE, BusError::NoCoe { slave })?;
        let job = self.master.upload(slave, object, scope, ANSWER_MAX_NS);
        let value = self.finish(job)?;
        value.map_err(|error| mailboxes::unless_gone(self, slave, BusError::Sdo { slave, object, error }))
    }

    fn download(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), BusError> {
        mailboxes::open(self, slave, MailboxProtocols::COE, BusError::NoCoe { slave })?;
        let job = self.master.download(slave, object, scope, value, ANSWER_MAX_NS);
        let written = self.finish(job)?;
        written.map_err(|error| mailboxes::unless_gone(self, slave, BusError::Sdo { slave, object, error }))
    }

    fn object_list(&mut self, slave: u8) -> Result<Vec<u16>, BusError> {
        mailboxes::object_list(self, slave)
    }

    fn describe_object(&mut self, slave: u8, index: u16) -> Result<Vec<u8>, BusError> {
        mailboxes::describe_object(self, slave, index)
    }

    fn describe_entry(&mut self, slave: u8, request: EntryRequest) -> Result<Vec<u8>, BusError> {
        mailboxes::describe_entry(self, slave, request)
    }

    fn read_eeprom(&mut self, slave: u8) -> Result<Vec<u8>, BusError> {
        self.info(slave)?.eeprom.clone().map_err(|error| BusError::Eeprom { slave, error })
    }

    fn read_eeprom_words(&mut self, slave: u8, first: u16, count: usize) -> Result<Vec<u16>, BusError> {
        self.info(slave)?;
        let job = self.master.read_eeprom(slave, first, count);
        self.finish(job)?.map_err(|error| BusError::Eeprom { slave, error })
    }

    fn write_eeprom_words(&mut self, slave: u8, first: u16, words: &[u16]) -> Result<(), BusError> {
        self.info(slave)?;
        let job = self.master.write_eeprom(slave, first, words);
        self.finish(job)?.map_err(|error| BusError::Eeprom { slave, error })
    }

    fn read_file(&mut self, slave: u8, name: &str, password: u32) -> Result<Vec<u8>, BusError> {
        mailboxes::read_file(self, slave, name, password)
    }

    fn write_file(&mut self, slave: u8, name: &str, password: u32, content: &[u8]) -> Result<(), BusError> {
        mailboxes::write_file(self, slave, name, password, content)
    }

    fn reference_clock(&self) -> Option<u8> {
        self.master.reference_clock()
    }

    fn ring(&self) -> Option<RingState> {
        self.wires.ring()
    }

    fn frames(&self) -> Option<FrameCounters> {
        Some(self.master.counters())
    }
}

#[cfg(all(test, feature = "sim"))]
mod tests;
