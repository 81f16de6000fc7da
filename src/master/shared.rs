//! State that the sequences, the cycle and the user share: frames, the condition of each slave, events.

use std::collections::VecDeque;
use std::sync::Arc;

use parking_lot::Mutex;

use super::clock_tree::{ClockDatagram, Clocks, Passed, Place, ReferenceClock, extended};
use super::exchange::Exchange;
use super::mailbox::state::MailboxState;
use super::pace::Pacer;
use super::{Pace, Settings, SlaveInfo, place};
use crate::ethercat::coe::Emergency;
use crate::ethercat::registers::{AlStatusRegister, AlStatusWithCode, Features, RequestedState};
use crate::ethercat::{AlState, AlStatus, Command, Ns, SlaveSet};

/// \[OURS] The most events in the queue; when it is full, the oldest one is dropped.
pub const EVENTS_MAX: usize = 64;
/// \[OURS] If the newest cycle was sent less than this ago, acyclic datagrams wait for the next cycle.
const CYCLIC_NS: Ns = 20_000_000;

/// Something that has happened without a request of the user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A slave has sent an emergency message.
    Emergency {
        /// Slave, from 1.
        slave: u8,
        /// The emergency: error code, error register and the bytes of the maker.
        emergency: Emergency,
    },
    /// A slave no longer answers: its cable is cut, or it has no power.
    Lost {
        /// Slave, from 1.
        slave: u8,
    },
    /// A slave that was lost answers again.
    Returned {
        /// Slave, from 1.
        slave: u8,
    },
    /// A slave that was lost has had no power. It is in Init and must be configured again. [`Self::Returned`] comes
    /// first.
    PowerCycled {
        /// Slave, from 1.
        slave: u8,
    },
    /// A slave has left its state, or reports an error, without a request of the user.
    Status {
        /// Slave, from 1.
        slave: u8,
        /// The state and error flag of the slave.
        status: AlStatusRegister,
        /// The AL status code of the slave.
        code: AlStatus,
    },
}

/// The condition of a slave, as far as the master knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveStatus {
    /// Whether the slave answers.
    pub is_present: bool,
    /// The newest AL status of the slave.
    pub status: AlStatusRegister,
    /// The AL status code that was read together with `status`.
    pub code: AlStatus,
}

impl SlaveStatus {
    /// The AL state; `None`: Boot, or an invalid state code.
    pub const fn state(&self) -> Option<AlState> {
        match self.status.state() {
            RequestedState::State(state) => Some(state),
            _ => None,
        }
    }
}

/// What the master keeps of one slave while the network runs: its status, its mailbox, and which operations on it are
/// running.
#[derive(Clone, Debug)]
pub(super) struct Live {
    pub(super) status: SlaveStatus,
    pub(super) mailbox: MailboxState,
    /// The buffer for mailbox messages of the slave, while no sequence uses it.
    pub(super) mailbox_bytes: Vec<u8>,
    /// Whether a change of the slave's state is under way.
    is_changing: bool,
    /// Whether a user's job reads or writes the EEPROM of the slave.
    is_eeprom_used: bool,
    /// Whether unsolicited messages stay in the mailbox until a user reads them.
    pub(super) keeps_mail: bool,
    /// Whether the watch found a message in the mailbox at its last check.
    pub(super) has_mail: bool,
    /// Logical address and length of the inputs, bytes; `None`: there are none that may be read outside the cycle.
    pub(super) inputs_at: Option<(u32, usize)>,
}

impl Default for Live {
    fn default() -> Self {
        let status = AlStatusRegister::of(RequestedState::State(AlState::Init));
        Self {
            status: SlaveStatus { is_present: true, status, code: AlStatus::NONE },
            mailbox: MailboxState::default(),
            mailbox_bytes: Vec::new(),
            is_changing: false,
            is_eeprom_used: false,
            keeps_mail: false,
            has_mail: false,
            inputs_at: None,
        }
    }
}

/// How each slave takes part in the process data, as far as known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Standing {
    /// Slaves in OP that answer.
    pub(super) in_op: SlaveSet,
    /// Slaves in SafeOP that answer: they add their inputs to the working counter for certain, and may add outputs.
    pub(super) in_safe_op: SlaveSet,
    /// Slaves that do not answer, but may be back: they add all of their data to the working counter, or nothing.
    pub(super) gone: SlaveSet,
    /// Slaves that may add any part of their data to the working counter: their sync managers and FMMUs are being
    /// changed or may still be enabled from before, they have left their state, or their inputs do not come.
    pub(super) unsure: SlaveSet,
}

impl Standing {
    /// The slaves whose inputs are valid if the working counter is right.
    pub(super) const fn certain(&self) -> SlaveSet {
        self.in_op.union(self.in_safe_op)
    }
}

/// Preallocated memory for one measurement of propagation delays.
#[derive(Default)]
pub(super) struct Measurement {
    /// Slots for reading the receive times of all slaves concurrently.
    pub(super) reads: Vec<place::Place<(Bus, u16), Option<Passed>>>,
    pub(super) passed: Vec<Option<Passed>>,
    /// The propagation delay of each slave, ns.
    pub(super) delays: Vec<u32>,
}

/// A handle by which sequences access the shared state.
#[derive(Clone)]
pub(super) struct Bus(pub(super) Arc<Mutex<Shared>>);

impl Bus {
    /// Calls `action` with the shared state, under its lock.
    pub(super) fn with<R>(&self, action: impl FnOnce(&mut Shared) -> R) -> R {
        action(&mut self.0.lock())
    }

    pub(super) fn now(&self) -> Ns {
        self.with(|shared| shared.now)
    }
}

/// State that the async sequences of datagrams (jobs, mailboxes, the watch), the cycle and the calls of the user share.
pub(super) struct Shared {
    pub(super) settings: Settings,
    pub(super) now: Ns,
    /// When the newest cycle was sent, on the master's clock; `None`: none was sent since [`Self::reset`].
    pub(super) last_cycle: Option<Ns>,
    pub(super) exchange: Exchange,
    pub(super) live: Vec<Live>,
    /// The slaves in SafeOP or OP, which exchange process data.
    pub(super) active: SlaveSet,
    /// The slaves in `active` that are in OP, and in `in_safe_op` those in SafeOP. They have no error, and no lower
    /// state was requested of them since.
    pub(super) in_op: SlaveSet,
    pub(super) in_safe_op: SlaveSet,
    /// The slaves that do not answer.
    pub(super) missing: SlaveSet,
    /// The slaves whose sync managers and FMMUs for process data may be enabled, whatever their state is.
    pub(super) mapped: SlaveSet,
    /// The slaves that answer, but whose inputs cannot be read at their logical addresses.
    pub(super) mute: SlaveSet,
    /// Slaves with process data in a datagram that had a wrong working counter in the newest cycle.
    pub(super) doubtful: SlaveSet,
    /// When the last reading of all AL states began in which every slave has answered or was found to be missing.
    pub(super) states_read: Option<Ns>,
    /// When the last complete search for missing slaves began. A search reads all AL states and, if these do not
    /// explain a wrong working counter, the inputs of the doubtful slaves.
    pub(super) searched: Option<Ns>,
    /// Whether the newest cycle has shown that all slaves are in OP and take part. The watch then has no states to
    /// read.
    pub(super) is_all_in_op: bool,
    /// Whether the watch has to check the slaves at once, because a cycle had wrong working counters. They must also
    /// differ from those of the cycle before, so that a lasting fault causes one check and not one in each cycle.
    pub(super) is_alarmed: bool,
    /// Of the newest cycle: the working counter of process data, the expected one, and the number of slaves that the
    /// first frame has passed.
    pub(super) last_counters: (u16, u16, Option<u16>),
    pub(super) clocks: Clocks,
    /// Preallocated memory for measurements of propagation delays, while these do not run.
    pub(super) measurements: Vec<Measurement>,
    /// The clock that all distributed clocks follow.
    pub(super) reference: ReferenceClock,
    /// The cycle time, and the phase of cycles to the reference clock.
    pub(super) pace: Option<Pace>,
    pub(super) pacer: Pacer,
    pub(super) events: VecDeque<Event>,
}

impl Shared {
    pub(super) fn new(settings: Settings) -> Self {
        Self {
            settings,
            now: 0,
            last_cycle: None,
            exchange: Exchange::new(settings),
            live: Vec::new(),
            active: SlaveSet::EMPTY,
            in_op: SlaveSet::EMPTY,
            in_safe_op: SlaveSet::EMPTY,
            missing: SlaveSet::EMPTY,
            mapped: SlaveSet::EMPTY,
            mute: SlaveSet::EMPTY,
            doubtful: SlaveSet::EMPTY,
            states_read: None,
            searched: None,
            is_all_in_op: false,
            is_alarmed: false,
            last_counters: (0, 0, None),
            clocks: Clocks::default(),
            measurements: Vec::new(),
            reference: ReferenceClock::default(),
            pace: None,
            pacer: Pacer::default(),
            events: VecDeque::with_capacity(EVENTS_MAX),
        }
    }

    /// Forgets all slaves, with their states and clocks, and the cycle that ran with them. Settings, frames in flight
    /// and events stay.
    pub(super) fn reset(&mut self) {
        (self.last_cycle, self.last_counters) = (None, (0, 0, None));
        (self.states_read, self.searched) = (None, None);
        self.live.clear();
        (self.active, self.missing) = (SlaveSet::EMPTY, SlaveSet::EMPTY);
        (self.in_op, self.in_safe_op) = (SlaveSet::EMPTY, SlaveSet::EMPTY);
        (self.mapped, self.mute, self.doubtful) = (SlaveSet::EMPTY, SlaveSet::EMPTY, SlaveSet::EMPTY);
        (self.is_all_in_op, self.is_alarmed) = (false, false);
        (self.clocks, self.pacer) = (Clocks::default(), Pacer::default());
    }

    /// Takes over the slaves that a scan has found.
    pub(super) fn begin(&mut self, slaves: &[SlaveInfo]) {
        self.live.resize(slaves.len(), Live::default());
        for ((slave, info), live) in (1..).zip(slaves).zip(&mut self.live) {
            let areas = info.mailbox.map(|mailbox| mailbox.areas).unwrap_or_default();
            live.mailbox_bytes.reserve(areas.receive.len.max(areas.send.len).into());
            if info.features.contains(Features::CLOCK) {
                self.clocks.all.insert(slave);
            }
            if !info.features.contains(Features::CLOCK_64_BITS) {
                self.clocks.short.insert(slave);
            }
            self.clocks.places.push(Place { station: info.station, ports: info.ports, upstream: info.upstream });
        }
    }

    /// The datagram that distributes the reference time to all clocks; `None`: no slave that answers has a clock that
    /// is set.
    pub(super) fn clock_datagram(&self) -> Option<ClockDatagram> {
        let station = self.clocks.reference_station(self.missing)?;
        Some(match self.reference {
            ReferenceClock::FirstSlave => ClockDatagram { command: Command::Frmw, station, time: self.clocks.time },
            ReferenceClock::Master => ClockDatagram { command: Command::Bwr, station: 0, time: self.now },
        })
    }

    /// A system time that was read from a slave less than 2 s ago, extended to 64 bits if its clock has only 32.
    pub(super) fn system_time(&self, slave: u8, shown: u64) -> u64 {
        let near = match self.reference {
            ReferenceClock::FirstSlave => self.clocks.time,
            ReferenceClock::Master => self.now,
        };
        if self.clocks.short.contains(slave) { extended(shown as u32, near) } else { shown }
    }

    /// How each slave takes part in the next cycle, as far as known.
    pub(super) fn standing(&self) -> Standing {
        let Self { active, missing, mapped, mute, in_op, in_safe_op, .. } = *self;
        let answering = active.difference(missing).difference(mute);
        let (in_op, in_safe_op) = (answering.intersection(in_op), answering.intersection(in_safe_op));
        let gone = active.intersection(missing);
        Standing { in_op, in_safe_op, gone, unsure: mapped.difference(in_op).difference(in_safe_op).difference(gone) }
    }

    /// Logical address and length of a slave's inputs, bytes; `None`: it has none that may be read outside the cycle.
    pub(super) fn inputs_of(&self, slave: u8) -> Option<(u32, usize)> {
        self.live.get(usize::from(slave).checked_sub(1)?)?.inputs_at
    }

    pub(super) fn live_mut(&mut self, slave: u8) -> Option<&mut Live> {
        self.live.get_mut(usize::from(slave).checked_sub(1)?)
    }

    /// Whether cycles are running, so that acyclic datagrams have to wait until the frames of a cycle are sent.
    pub(super) fn has_cycles(&self) -> bool {
        self.last_cycle.is_some_and(|last| self.now.saturating_sub(last) < CYCLIC_NS)
    }

    /// Takes a newly read AL status of a slave. A slave that was missing is back; no other change becomes an event.
    pub(super) fn note_status(&mut self, slave: u8, status: AlStatusWithCode) {
        let Some(live) = self.live_mut(slave) else { return };
        let was_present = std::mem::replace(&mut live.status.is_present, true);
        (live.status.status, live.status.code) = (status.status, status.code);
        if matches!(live.status.state(), Some(AlState::SafeOp | AlState::Op)) {
            self.active.insert(slave);
        } else {
            self.active.remove(slave);
            self.mute.remove(slave);
        }
        let is_well = !status.status.contains(AlStatusRegister::ERROR);
        for (set, state) in [(&mut self.in_op, AlState::Op), (&mut self.in_safe_op, AlState::SafeOp)] {
            set.remove(slave);
            if is_well && status.status.state() == RequestedState::State(state) {
                set.insert(slave);
            }
        }
        self.missing.remove(slave);
        if !was_present {
            self.tell(Event::Returned { slave });
        }
    }

    /// Takes an AL status that the watch has read. A change without a request becomes an event.
    pub(super) fn see_status(&mut self, slave: u8, status: AlStatusWithCode) {
        let Some(live) = self.live_mut(slave) else { return };
        let before = live.status;
        let is_told = !live.is_changing && (before.status, before.code) != (status.status, status.code);
        self.note_status(slave, status);
        if is_told {
            self.tell(Event::Status { slave, status: status.status, code: status.code });
        }
    }

    /// Marks a slave as missing.
    pub(super) fn lose(&mut self, slave: u8) {
        self.missing.insert(slave);
        if let Some(live) = self.live_mut(slave)
            && std::mem::take(&mut live.status.is_present)
        {
            self.tell(Event::Lost { slave });
        }
    }

    /// Notes that a state is requested of a slave. If it is a lower state, the slave no longer counts as one that is in
    /// SafeOP or OP.
    pub(super) fn expect_state(&mut self, slave: u8, target: AlState) {
        if target < AlState::SafeOp {
            self.active.remove(slave);
        }
        if target < AlState::Op {
            self.in_op.remove(slave);
        }
    }

    /// Begins a change of a slave's state. Returns false if another one is under way, or the EEPROM, which a change may
    /// need, is in use.
    pub(super) fn begin_change(&mut self, slave: u8) -> bool {
        let live = self.live_mut(slave).filter(|live| !live.is_changing && !live.is_eeprom_used);
        live.is_some_and(|live| !std::mem::replace(&mut live.is_changing, true))
    }

    /// Marks that no change of the slave's state is under way any more.
    pub(super) fn end_change(&mut self, slave: u8) {
        if let Some(live) = self.live_mut(slave) {
            live.is_changing = false;
        }
    }

    /// Claims the EEPROM of a slave. Returns false if it is in use, or the slave is changing its state, which may need
    /// it.
    pub(super) fn claim_eeprom(&mut self, slave: u8) -> bool {
        let live = self.live_mut(slave).filter(|live| !live.is_changing && !live.is_eeprom_used);
        live.is_some_and(|live| !std::mem::replace(&mut live.is_eeprom_used, true))
    }

    /// Marks that no job uses the EEPROM of the slave any more.
    pub(super) fn release_eeprom(&mut self, slave: u8) {
        if let Some(live) = self.live_mut(slave) {
            live.is_eeprom_used = false;
        }
    }

    /// Whether the mailbox of a slave can be read now: the slave answers and is above Init, and no sequence is using
    /// the mailbox.
    pub(super) fn has_idle_mailbox(&mut self, slave: u8) -> bool {
        self.live_mut(slave).is_some_and(|live| {
            live.status.is_present && live.status.state() > Some(AlState::Init) && !live.mailbox.is_open()
        })
    }

    /// Notes the slaves with a full mailbox. Returns those whose messages a user reads.
    pub(super) fn note_mail(&mut self, full: SlaveSet) -> SlaveSet {
        let mut kept = SlaveSet::EMPTY;
        for (slave, live) in (1..).zip(&mut self.live) {
            live.has_mail = live.keeps_mail && full.contains(slave);
            if live.has_mail {
                kept.insert(slave);
            }
        }
        kept
    }

    /// Resets the mailbox state of a slave that enters PreOP.
    pub(super) fn begin_mailbox(&mut self, slave: u8) {
        if let Some(live) = self.live_mut(slave) {
            live.mailbox.begin();
        }
    }

    pub(super) fn tell(&mut self, event: Event) {
        if self.events.len() == EVENTS_MAX {
            self.events.pop_front();
        }
        self.events.push_back(event);
    }
}
