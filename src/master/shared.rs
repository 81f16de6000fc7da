//! What sequences of datagrams, the cycle and the user share: the frames, the condition of each slave, the events.

use std::collections::VecDeque;
use std::sync::Arc;

use parking_lot::Mutex;

use super::clock_tree::{ClockDatagram, Clocks, Passed, Place, ReferenceClock};
use super::exchange::Exchange;
use super::mailbox_state::MailboxState;
use super::pace::Pacer;
use super::{Pace, Settings, SlaveInfo, place};
use crate::ethercat::coe::Emergency;
use crate::ethercat::registers::{AlStatusRegister, AlStatusWithCode, Features, RequestedState};
use crate::ethercat::{AlState, AlStatus, Command, Ns, SlaveSet};

/// \[OURS] How many events wait at most; the oldest are lost.
pub const EVENTS_MAX: usize = 64;
/// \[OURS] How long after the last cycle datagrams beside it wait for the next one.
const CYCLIC_NS: Ns = 20_000_000;

/// What happens without being asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A slave has sent an emergency.
    Emergency {
        /// Which slave, from 1.
        slave: u8,
        /// What it says.
        emergency: Emergency,
    },
    /// A slave answers no more: its cable is cut, or it has no power.
    Lost {
        /// Which slave, from 1.
        slave: u8,
    },
    /// A slave that was lost answers again.
    Returned {
        /// Which slave, from 1.
        slave: u8,
    },
    /// A slave that was lost had no power. It is in Init and has to be configured again; [`Self::Returned`] comes first.
    PowerCycled {
        /// Which slave, from 1.
        slave: u8,
    },
    /// A slave has left its state, or reports an error, without being asked for a state.
    Status {
        /// Which slave, from 1.
        slave: u8,
        /// Its state and its error.
        status: AlStatusRegister,
        /// Why.
        code: AlStatus,
    },
}

/// What the master knows of the present condition of a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveStatus {
    /// It answers.
    pub is_present: bool,
    /// Its AL status when it was read last.
    pub status: AlStatusRegister,
    /// Its AL status code then.
    pub code: AlStatus,
}

impl SlaveStatus {
    /// The AL state; `None`: Boot, or one that does not exist.
    pub const fn state(&self) -> Option<AlState> {
        match self.status.state() {
            RequestedState::State(state) => Some(state),
            _ => None,
        }
    }
}

/// What changes of a slave.
#[derive(Clone, Debug)]
pub(super) struct Live {
    pub(super) status: SlaveStatus,
    pub(super) mailbox: MailboxState,
    /// Memory for a message of its mailbox, while nobody uses that.
    pub(super) mailbox_bytes: Vec<u8>,
    /// A change of its state is under way.
    is_changing: bool,
    /// A user's sequence reads or writes its EEPROM.
    is_eeprom_used: bool,
    /// What it sends unasked stays in its mailbox until a user takes it.
    pub(super) keeps_mail: bool,
    /// There was mail in its mailbox when the watch looked last.
    pub(super) has_mail: bool,
    /// Where its inputs are in the logical memory, and how many bytes; `None`: there are none that may be read beside the cycle.
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

/// What is known of the part of each slave in process data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Standing {
    /// They are in OP, and answer.
    pub(super) in_op: SlaveSet,
    /// They are in SafeOP, and answer: their inputs are there for certain, and whether outputs are taken is up to them.
    pub(super) in_safe_op: SlaveSet,
    /// They do not answer, and may be back: then all of their data are.
    pub(super) gone: SlaveSet,
    /// Any part of them may count: their sync managers and FMMUs are being changed or were left, they have left their state, or
    /// their inputs do not come.
    pub(super) unsure: SlaveSet,
}

impl Standing {
    /// The slaves whose inputs are there if the working counter is right.
    pub(super) const fn certain(&self) -> SlaveSet {
        self.in_op.union(self.in_safe_op)
    }
}

/// What a measurement needs of memory, to be used again.
#[derive(Default)]
pub(super) struct Measurement {
    /// Reads of all slaves, side by side.
    pub(super) reads: Vec<place::Place<(Bus, u16), Option<Passed>>>,
    pub(super) passed: Vec<Option<Passed>>,
    /// How long the way to each slave is, ns.
    pub(super) delays: Vec<u32>,
}

/// The way of a sequence to the frames.
#[derive(Clone)]
pub(super) struct Bus(pub(super) Arc<Mutex<Shared>>);

impl Bus {
    /// What sequences and the cycle share.
    pub(super) fn with<R>(&self, action: impl FnOnce(&mut Shared) -> R) -> R {
        action(&mut self.0.lock())
    }

    pub(super) fn now(&self) -> Ns {
        self.with(|shared| shared.now)
    }
}

/// What sequences and the cycle share.
pub(super) struct Shared {
    pub(super) settings: Settings,
    pub(super) now: Ns,
    /// When the last cycle was sent.
    pub(super) last_cycle: Option<Ns>,
    pub(super) exchange: Exchange,
    pub(super) live: Vec<Live>,
    /// The slaves that exchange process data.
    pub(super) active: SlaveSet,
    /// Those of them that are in OP and in SafeOP without an error, and were asked for no other state since.
    pub(super) in_op: SlaveSet,
    pub(super) in_safe_op: SlaveSet,
    /// The slaves that do not answer.
    pub(super) missing: SlaveSet,
    /// The slaves whose sync managers and FMMUs of process data may be on, in whatever state they are.
    pub(super) mapped: SlaveSet,
    /// The slaves that answer, and whose inputs do not come.
    pub(super) mute: SlaveSet,
    /// Slaves that share a datagram whose working counter was not right in the last cycle.
    pub(super) doubtful: SlaveSet,
    /// When the AL status of all slaves was asked for last, if all of that was answered.
    pub(super) states_read: Option<Ns>,
    /// When it was asked last who is missing, if all of that was answered: for the states, and where those did not tell for inputs.
    pub(super) searched: Option<Ns>,
    /// The last cycle has found all slaves in OP.
    pub(super) is_all_in_op: bool,
    /// A cycle was other than the one before, and other than expected.
    pub(super) is_alarmed: bool,
    /// The working counters of the last cycle: of process data, expected, of all slaves.
    pub(super) last_counters: (u16, u16, Option<u16>),
    pub(super) clocks: Clocks,
    /// Memory for measurements of delays, while there are none.
    pub(super) measurements: Vec<Measurement>,
    /// Whose time the clocks follow.
    pub(super) reference: ReferenceClock,
    /// How cycles follow the reference clock.
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

    /// Forgets all slaves.
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

    /// These slaves were found.
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

    /// The datagram that brings the time to all clocks; `None`: no clock has been set.
    pub(super) fn clock_datagram(&self) -> Option<ClockDatagram> {
        let station = self.clocks.reference_station(self.missing)?;
        Some(match self.reference {
            ReferenceClock::FirstSlave => ClockDatagram { command: Command::Frmw, station, time: self.clocks.time },
            ReferenceClock::Master => ClockDatagram { command: Command::Bwr, station: 0, time: self.now },
        })
    }

    /// Who takes part in cycles, for all that is known.
    pub(super) fn standing(&self) -> Standing {
        let Self { active, missing, mapped, mute, in_op, in_safe_op, .. } = *self;
        let answering = active.difference(missing).difference(mute);
        let (in_op, in_safe_op) = (answering.intersection(in_op), answering.intersection(in_safe_op));
        let gone = active.intersection(missing);
        Standing { in_op, in_safe_op, gone, unsure: mapped.difference(in_op).difference(in_safe_op).difference(gone) }
    }

    /// Where the inputs of a slave are in the logical memory, and how many bytes; `None`: none may be read beside the cycle.
    pub(super) fn inputs_of(&self, slave: u8) -> Option<(u32, usize)> {
        self.live.get(usize::from(slave).checked_sub(1)?)?.inputs_at
    }

    pub(super) fn live_mut(&mut self, slave: u8) -> Option<&mut Live> {
        self.live.get_mut(usize::from(slave).checked_sub(1)?)
    }

    /// Whether there are cycles, behind whose frames others wait for their turn.
    pub(super) fn has_cycles(&self) -> bool {
        self.last_cycle.is_some_and(|last| self.now.saturating_sub(last) < CYCLIC_NS)
    }

    /// The AL status of a slave was read in the course of a change of its state.
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

    /// The AL status of a slave was read without a reason.
    pub(super) fn see_status(&mut self, slave: u8, status: AlStatusWithCode) {
        let Some(live) = self.live_mut(slave) else { return };
        let before = live.status;
        let is_told = !live.is_changing && (before.status, before.code) != (status.status, status.code);
        self.note_status(slave, status);
        if is_told {
            self.tell(Event::Status { slave, status: status.status, code: status.code });
        }
    }

    /// A slave does not answer.
    pub(super) fn lose(&mut self, slave: u8) {
        self.missing.insert(slave);
        if let Some(live) = self.live_mut(slave)
            && std::mem::take(&mut live.status.is_present)
        {
            self.tell(Event::Lost { slave });
        }
    }

    /// A slave is asked for a state.
    pub(super) fn expect_state(&mut self, slave: u8, target: AlState) {
        if target < AlState::SafeOp {
            self.active.remove(slave);
        }
        if target < AlState::Op {
            self.in_op.remove(slave);
        }
    }

    /// A change of a slave's state begins. False: another one is under way, or its EEPROM is in use, which a change may need.
    pub(super) fn begin_change(&mut self, slave: u8) -> bool {
        let live = self.live_mut(slave).filter(|live| !live.is_changing && !live.is_eeprom_used);
        live.is_some_and(|live| !std::mem::replace(&mut live.is_changing, true))
    }

    /// The change of a slave's state has ended.
    pub(super) fn end_change(&mut self, slave: u8) {
        if let Some(live) = self.live_mut(slave) {
            live.is_changing = false;
        }
    }

    /// A sequence wants the EEPROM of a slave for itself. False: it is in use, or may be, in a change of the state.
    pub(super) fn claim_eeprom(&mut self, slave: u8) -> bool {
        let live = self.live_mut(slave).filter(|live| !live.is_changing && !live.is_eeprom_used);
        live.is_some_and(|live| !std::mem::replace(&mut live.is_eeprom_used, true))
    }

    /// Nobody uses the EEPROM of a slave any more.
    pub(super) fn release_eeprom(&mut self, slave: u8) {
        if let Some(live) = self.live_mut(slave) {
            live.is_eeprom_used = false;
        }
    }

    /// Whether a slave has a mailbox that nobody uses now.
    pub(super) fn has_idle_mailbox(&mut self, slave: u8) -> bool {
        self.live_mut(slave).is_some_and(|live| {
            live.status.is_present && live.status.state() > Some(AlState::Init) && !live.mailbox.is_open()
        })
    }

    /// These mailboxes are full. Those of them whose mail a user takes.
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

    /// The mailbox of a slave begins anew.
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
