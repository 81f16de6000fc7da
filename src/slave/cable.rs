//! The cable of a simulated network and what goes wrong along it: which slaves frames reach, which slaves answer, lose
//! their power, refuse an AL state or abort an SDO, and the faults inside devices ([`Fault`]). Every way to simulate a
//! network uses it.
//!
//! A new kind of trouble for scripts begins here if it is one of the network, or in `slave/fault.rs` if it is one of a
//! device; the verb that causes it stands in `testbed/script/verbs.rs`.
//!
//! Scripts and tests change the cable from any thread while the network runs. A cycle reads atomics and only tries to
//! take locks: a thread that holds one delays a fault by a cycle, never the cycle itself. Other calls take the lock,
//! which is never held for longer than an assignment.

use std::num::NonZeroU16;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{AlStatus, Fault};
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::ethercat::{AlState, MAX_SLAVES, Ns, SlaveSet};

/// The most slaves on a cable. \[OURS] Their numbers, and the place of a cut, are one byte; a board has 40 of them at most.
pub const SLAVES_MAX: usize = 254;

/// A set of slaves on a cable, by the bits of their numbers.
type Bits = [u64; 4];

/// How one slave is made to answer changes of state and SDOs.
#[derive(Clone, Copy, Default)]
struct ScriptedAnswers {
    /// An AL state that the slave refuses, and with which AL status code.
    refuse: Option<(AlState, AlStatus)>,
    sdo_delay_ns: Ns,
    /// The abort code of all SDO transfers.
    sdo_abort: Option<AbortCode>,
    /// The abort code of the SDO transfers of one object.
    object_abort: Option<(ObjectAddress, AbortCode)>,
}

/// A cable that damages frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Noise {
    /// The slave before which the cable is, from 1.
    pub slave: u8,
    /// One of so many frames is damaged there.
    pub one_of: NonZeroU16,
}

struct Shared {
    /// How many slaves the cable reaches.
    reach: AtomicU8,
    /// The slave before which frames are damaged, in the upper half, and one of how many; 0: none is damaged.
    noise: AtomicU32,
    /// The slaves that do not answer.
    silent: [AtomicU64; 4],
    /// The slaves that have lost their power since the last cycle.
    powered_off: [AtomicU64; 4],
    /// There are faults that no cycle has taken yet.
    has_faults: AtomicBool,
    /// Those faults, each with its slave.
    faults: Mutex<Vec<(u8, Fault)>>,
    answers: Mutex<Box<[ScriptedAnswers]>>,
}

/// The cable; clones are the same cable. Slaves are numbered from 1. A call for a slave that does not exist has no effect.
#[derive(Clone)]
pub struct Cable(Arc<Shared>);

impl Default for Cable {
    fn default() -> Self {
        Self(Arc::new(Shared {
            reach: AtomicU8::new(u8::MAX),
            noise: AtomicU32::new(0),
            silent: Default::default(),
            powered_off: Default::default(),
            has_faults: AtomicBool::new(false),
            faults: Mutex::new(Vec::with_capacity(2 * SLAVES_MAX)),
            answers: Mutex::new(vec![ScriptedAnswers::default(); SLAVES_MAX].into()),
        }))
    }
}

/// What scripts and tests do to the network.
impl Cable {
    /// Cuts the cable after that many slaves. 0: before the first one, so that no slave answers.
    pub fn cut_after(&self, slaves: u8) {
        self.0.reach.store(slaves, Ordering::Relaxed);
    }

    /// Repairs the cable after [`Self::cut_after`].
    pub fn heal(&self) {
        self.cut_after(u8::MAX);
    }

    /// Makes the cable before a slave damage frames; `None`: no longer. One cable at a time does so, and only where there are
    /// frames: [`CabledChain`](super::esc::CabledChain).
    pub fn damage_frames(&self, noise: Option<Noise>) {
        let packed = noise.map_or(0, |Noise { slave, one_of }| u32::from(slave) << 16 | u32::from(one_of.get()));
        self.0.noise.store(packed, Ordering::Relaxed);
    }

    /// Makes a slave not answer at all, neither its mailbox nor process data, or makes it answer again. Frames still pass
    /// it, and time passes in it.
    pub fn silence(&self, slave: u8, silent: bool) {
        let (word, bit) = bit_of(slave);
        if silent {
            self.0.silent[word].fetch_or(bit, Ordering::Relaxed);
        } else {
            self.0.silent[word].fetch_and(!bit, Ordering::Relaxed);
        }
    }

    /// Takes the power from a slave: it goes to Init, loses its process data and does not answer. Frames still pass it,
    /// so that the slaves behind it stay on the network.
    pub fn lose(&self, slave: u8) {
        self.silence(slave, true);
        let (word, bit) = bit_of(slave);
        self.0.powered_off[word].fetch_or(bit, Ordering::Relaxed);
    }

    /// Gives a slave its power back after [`Self::lose`]: it answers, in Init.
    pub fn find(&self, slave: u8) {
        self.silence(slave, false);
    }

    /// Makes a slave refuse an AL state with that AL status code; `None`: it enters every state that it can.
    pub fn refuse(&self, slave: u8, state: Option<(AlState, AlStatus)>) {
        self.set_answers(slave, |answers| answers.refuse = state);
    }

    /// Makes SDO transfers with a slave take that much longer; beyond the timeout of the request they fail. 0: no delay.
    pub fn delay_sdo(&self, slave: u8, ns: Ns) {
        self.set_answers(slave, |answers| answers.sdo_delay_ns = ns);
    }

    /// Makes a slave abort every SDO transfer with that abort code, without effect on the object; `None`: no longer.
    pub fn abort_sdo(&self, slave: u8, code: Option<AbortCode>) {
        self.set_answers(slave, |answers| answers.sdo_abort = code);
    }

    /// Makes a slave abort SDO transfers of one object with that abort code, without effect on the object; `None`: no
    /// longer. A slave has at most one such object at a time.
    pub fn abort_object(&self, slave: u8, abort: Option<(ObjectAddress, AbortCode)>) {
        self.set_answers(slave, |answers| answers.object_abort = abort);
    }

    /// Causes a fault inside a slave, or ends it, from the next cycle on. A fault of an axis or a channel that the slave
    /// does not have has no effect.
    pub fn apply_fault(&self, slave: u8, fault: Fault) {
        lock(&self.0.faults).push((slave, fault));
        self.0.has_faults.store(true, Ordering::Release);
    }

    fn set_answers(&self, slave: u8, change: impl FnOnce(&mut ScriptedAnswers)) {
        if let Some(place) = usize::from(slave).checked_sub(1)
            && let Some(answers) = lock(&self.0.answers).get_mut(place)
        {
            change(answers);
        }
    }
}

/// What a simulated network reads.
impl Cable {
    /// How many slaves frames reach: all before the place where the cable is cut.
    pub fn reach(&self) -> u8 {
        self.0.reach.load(Ordering::Relaxed)
    }

    /// The cable that damages frames; `None`: none does.
    pub fn noise(&self) -> Option<Noise> {
        let packed = self.0.noise.load(Ordering::Relaxed);
        Some(Noise { slave: (packed >> 16) as u8, one_of: NonZeroU16::new(packed as u16)? })
    }

    /// The slaves of a board that frames reach and that answer.
    pub fn answering(&self) -> SlaveSet {
        let silent = SlaveSet::from_bits(self.0.silent[0].load(Ordering::Relaxed) >> 1);
        SlaveSet::first(self.reach().min(MAX_SLAVES as u8)).difference(silent)
    }

    /// The slaves that do not answer, wherever the cable is cut.
    pub(super) fn silent(&self) -> Bits {
        self.0.silent.each_ref().map(|word| word.load(Ordering::Relaxed))
    }

    /// The slaves of a board that have lost their power since the last call.
    pub fn take_powered_off(&self) -> SlaveSet {
        SlaveSet::from_bits(take(&self.0.powered_off[0]) >> 1)
    }

    /// All slaves that have lost their power since the last call.
    pub(super) fn take_all_powered_off(&self) -> Bits {
        self.0.powered_off.each_ref().map(take)
    }

    /// The AL status code with which a slave is made to refuse a state; `None`: it is not.
    pub fn refusal(&self, slave: u8, state: AlState) -> Option<AlStatus> {
        self.answers(slave).refuse.filter(|(refused, _)| *refused == state).map(|(_, status)| status)
    }

    /// How much longer SDO transfers with a slave are made to take.
    pub fn sdo_delay_ns(&self, slave: u8) -> Ns {
        self.answers(slave).sdo_delay_ns
    }

    /// The abort code with which a slave is made to abort a transfer of that object; `None`: it is not.
    pub fn sdo_abort(&self, slave: u8, object: ObjectAddress) -> Option<AbortCode> {
        let ScriptedAnswers { sdo_abort, object_abort, .. } = self.answers(slave);
        sdo_abort.or(object_abort.filter(|(aborted, _)| *aborted == object).map(|(_, code)| code))
    }

    /// Calls `apply` for each fault since the last call. While a thread is adding one, the faults wait for the next call.
    pub fn take_faults(&self, mut apply: impl FnMut(u8, Fault)) {
        if !self.0.has_faults.load(Ordering::Acquire) {
            return;
        }
        let Ok(mut faults) = self.0.faults.try_lock() else { return };
        self.0.has_faults.store(false, Ordering::Release);
        faults.drain(..).for_each(|(slave, fault)| apply(slave, fault));
    }

    fn answers(&self, slave: u8) -> ScriptedAnswers {
        let place = usize::from(slave).wrapping_sub(1);
        lock(&self.0.answers).get(place).copied().unwrap_or_default()
    }
}

/// The word and the bit of a slave.
const fn bit_of(slave: u8) -> (usize, u64) {
    (slave as usize / 64, 1 << (slave % 64))
}

/// Whether a slave is in a set.
pub(super) const fn has(set: &Bits, slave: u8) -> bool {
    let (word, bit) = bit_of(slave);
    set[word] & bit != 0
}

/// A cycle only reads a word that nobody has written.
fn take(word: &AtomicU64) -> u64 {
    if word.load(Ordering::Relaxed) == 0 { 0 } else { word.swap(0, Ordering::Relaxed) }
}

/// A thread that has panicked leaves plain data behind, which is still valid.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
