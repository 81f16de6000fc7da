//! The cable of a simulated network and its faults: which slaves the frames reach, which slaves answer, lose their power,
//! refuse an AL state or abort an SDO, and the faults inside devices ([`Fault`]). Every kind of simulated network uses it.
//!
//! To add a malfunction for scripts, begin here if it affects the network, or in `slave/fault.rs` if it affects a
//! device. The verb that triggers it is in `testbed/script/verbs.rs`.
//!
//! Scripts and tests change the cable from any thread while the network runs. A cycle reads atomics and only tries to take
//! locks: a thread that holds a lock delays a fault by one cycle, but never delays the cycle. Other calls block on the
//! lock, which is held only for an assignment.

use std::num::NonZeroU16;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{AlStatus, Fault};
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::ethercat::{AlState, MAX_SLAVES, Ns, SlaveSet};

/// The maximum number of slaves on a cable. \[OURS] Slave numbers and the position of a cut are one byte; a board has at
/// most 40 slaves.
pub const SLAVES_MAX: usize = 254;

/// A set of slaves on a cable, one bit per slave number.
type Bits = [u64; 4];

/// The scripted responses of one slave to changes of state and SDOs.
#[derive(Clone, Copy, Default)]
struct ScriptedAnswers {
    /// An AL state that the slave refuses, with the AL status code of the refusal. `None`: it refuses none.
    refuse: Option<(AlState, AlStatus)>,
    sdo_delay_ns: Ns,
    /// The abort code with which the slave aborts every SDO transfer; `None`: no script demands aborts.
    sdo_abort: Option<AbortCode>,
    /// An object whose SDO transfers are aborted, with the abort code. `None`: there is no such object.
    object_abort: Option<(ObjectAddress, AbortCode)>,
}

/// A cable section that damages frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Noise {
    /// The slave at the far end of the section, from 1.
    pub slave: u8,
    /// One of this many frames is damaged: 1 damages every frame, 100 damages 1 % of them.
    pub one_of: NonZeroU16,
}

struct Shared {
    /// The number of slaves in front of the cut; `u8::MAX`: the cable is not cut.
    reach: AtomicU8,
    /// The present [`Noise`]: `slave` in the upper 16 bits, `one_of` in the lower 16 bits; 0 if no frames are damaged.
    noise: AtomicU32,
    /// The slaves that do not answer.
    silent: [AtomicU64; 4],
    /// The slaves that have lost their power since the network last took these bits. It takes them in each cycle.
    powered_off: [AtomicU64; 4],
    /// Whether there are faults that no cycle has applied yet.
    has_faults: AtomicBool,
    /// The faults that are waiting for a cycle, each with its slave.
    faults: Mutex<Vec<(u8, Fault)>>,
    answers: Mutex<Box<[ScriptedAnswers]>>,
}

/// A handle to the cable; clones refer to the same cable. Slaves are numbered from 1. A call for a slave that does not
/// exist has no effect.
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

/// Calls for scripts and tests, which change the network.
impl Cable {
    /// Cuts the cable after this many slaves. With 0 the cut is in front of the first slave, so that no slave answers.
    pub fn cut_after(&self, slaves: u8) {
        self.0.reach.store(slaves, Ordering::Relaxed);
    }

    /// Repairs the cable after [`Self::cut_after`].
    pub fn heal(&self) {
        self.cut_after(u8::MAX);
    }

    /// Makes the cable section in front of a slave damage frames; `None` ends this. Only one section at a time damages
    /// frames, and only in networks with frames: [`CabledChain`](super::esc::CabledChain).
    pub fn damage_frames(&self, noise: Option<Noise>) {
        let packed = noise.map_or(0, |Noise { slave, one_of }| u32::from(slave) << 16 | u32::from(one_of.get()));
        self.0.noise.store(packed, Ordering::Relaxed);
    }

    /// Makes a slave ignore its mailbox and process data, or makes it answer again. Frames still pass through the slave,
    /// and its time advances.
    pub fn silence(&self, slave: u8, silent: bool) {
        let (word, bit) = bit_of(slave);
        if silent {
            self.0.silent[word].fetch_or(bit, Ordering::Relaxed);
        } else {
            self.0.silent[word].fetch_and(!bit, Ordering::Relaxed);
        }
    }

    /// Takes the power from a slave: it goes to Init, loses its process data and does not answer. Frames still pass through
    /// it, so the slaves behind it stay on the network.
    pub fn lose(&self, slave: u8) {
        self.silence(slave, true);
        let (word, bit) = bit_of(slave);
        self.0.powered_off[word].fetch_or(bit, Ordering::Relaxed);
    }

    /// Restores the power of a slave after [`Self::lose`]: it answers again, in Init.
    pub fn find(&self, slave: u8) {
        self.silence(slave, false);
    }

    /// Makes a slave refuse an AL state with the given AL status code; `None`: it enters every state that it can.
    pub fn refuse(&self, slave: u8, state: Option<(AlState, AlStatus)>) {
        self.set_answers(slave, |answers| answers.refuse = state);
    }

    /// Delays SDO transfers with a slave by `ns`; a delay beyond the timeout of the request makes the transfers fail. 0
    /// ends the delay.
    pub fn delay_sdo(&self, slave: u8, ns: Ns) {
        self.set_answers(slave, |answers| answers.sdo_delay_ns = ns);
    }

    /// Makes a slave abort every SDO transfer with this abort code; the object keeps its value. `None` ends this.
    pub fn abort_sdo(&self, slave: u8, code: Option<AbortCode>) {
        self.set_answers(slave, |answers| answers.sdo_abort = code);
    }

    /// Makes a slave abort SDO transfers of one object with this abort code; the object keeps its value. `None` ends this.
    /// There is at most one such object per slave at a time.
    pub fn abort_object(&self, slave: u8, abort: Option<(ObjectAddress, AbortCode)>) {
        self.set_answers(slave, |answers| answers.object_abort = abort);
    }

    /// Starts or ends a fault inside a slave, from the next cycle on. A fault of an axis or channel that the slave does not
    /// have has no effect.
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

/// Calls for a simulated network, which reads the state of the cable.
impl Cable {
    /// The number of slaves that frames reach: all slaves in front of the cut.
    pub fn reach(&self) -> u8 {
        self.0.reach.load(Ordering::Relaxed)
    }

    /// The cable section that damages frames; `None` if there is none.
    pub fn noise(&self) -> Option<Noise> {
        let packed = self.0.noise.load(Ordering::Relaxed);
        Some(Noise { slave: (packed >> 16) as u8, one_of: NonZeroU16::new(packed as u16)? })
    }

    /// The slaves that frames reach and that answer, among the first 40: a board has at most 40 slaves.
    pub fn answering(&self) -> SlaveSet {
        let silent = SlaveSet::from_bits(self.0.silent[0].load(Ordering::Relaxed) >> 1);
        SlaveSet::first(self.reach().min(MAX_SLAVES as u8)).difference(silent)
    }

    /// The slaves that do not answer, without regard to a cut.
    pub(super) fn silent(&self) -> Bits {
        self.0.silent.each_ref().map(|word| word.load(Ordering::Relaxed))
    }

    /// The slaves that have lost their power since the last call, among the first 40: a board has at most 40 slaves.
    pub fn take_powered_off(&self) -> SlaveSet {
        SlaveSet::from_bits(take(&self.0.powered_off[0]) >> 1)
    }

    /// All slaves, up to 254, that have lost their power since the last call.
    pub(super) fn take_all_powered_off(&self) -> Bits {
        self.0.powered_off.each_ref().map(take)
    }

    /// The AL status code with which a script makes a slave refuse a state; `None` if no script does.
    pub fn refusal(&self, slave: u8, state: AlState) -> Option<AlStatus> {
        self.answers(slave).refuse.filter(|(refused, _)| *refused == state).map(|(_, status)| status)
    }

    /// The scripted delay of SDO transfers with a slave, ns.
    pub fn sdo_delay_ns(&self, slave: u8) -> Ns {
        self.answers(slave).sdo_delay_ns
    }

    /// The abort code with which a script makes a slave abort transfers of an object; `None` if no script does.
    pub fn sdo_abort(&self, slave: u8, object: ObjectAddress) -> Option<AbortCode> {
        let ScriptedAnswers { sdo_abort, object_abort, .. } = self.answers(slave);
        sdo_abort.or(object_abort.filter(|(aborted, _)| *aborted == object).map(|(_, code)| code))
    }

    /// Calls `apply` for each new fault since the last call. While another thread is adding a fault, all faults wait for
    /// the next call.
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

/// The index of the word and the mask of the bit for a slave.
const fn bit_of(slave: u8) -> (usize, u64) {
    (slave as usize / 64, 1 << (slave % 64))
}

/// Whether a slave is in a set.
pub(super) const fn has(set: &Bits, slave: u8) -> bool {
    let (word, bit) = bit_of(slave);
    set[word] & bit != 0
}

/// Takes the bits of a word and clears it. If the word is 0, a cycle only reads it, so that the cache line stays shared.
fn take(word: &AtomicU64) -> u64 {
    if word.load(Ordering::Relaxed) == 0 { 0 } else { word.swap(0, Ordering::Relaxed) }
}

/// Locks a mutex. Poisoning is ignored, because the plain data in the mutex are still valid after a panic.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
