//! The cable of a simulated network and what goes wrong along it, whichever way the network is simulated: whom frames reach,
//! who answers, who loses its power, who refuses what, and the faults of devices.
//!
//! Scripts and tests change it from any thread while the network runs. A cycle reads atomics and takes locks only by trying:
//! a thread that holds one delays a fault by a cycle, never the cycle itself. What is no part of a cycle takes the lock, which
//! is never held for longer than an assignment.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::{AlState, MAX_AXES, MAX_SLAVES, Ns, SlaveSet};
use crate::slave::{AlStatus, Fault};

/// What one slave is made to do.
#[derive(Clone, Copy, Default)]
struct Orders {
    /// A state that it refuses, and why.
    refuse: Option<(AlState, AlStatus)>,
    sdo_delay_ns: Ns,
    sdo_abort: Option<AbortCode>,
    /// One object only.
    object_abort: Option<(ObjectAddress, AbortCode)>,
}

struct Shared {
    /// Slaves that the cable reaches.
    reach: AtomicU8,
    /// Bit n - 1: slave n does not answer.
    silent: AtomicU64,
    /// Bit n - 1: slave n loses its power in the next cycle.
    powered_off: AtomicU64,
    has_faults: AtomicBool,
    /// Of which slave; not yet happened.
    faults: Mutex<Vec<(u8, Fault)>>,
    orders: Mutex<[Orders; MAX_SLAVES]>,
}

/// The cable; clones are the same one. Slaves are numbered from 1; what is said of a slave that is not there is without
/// effect.
#[derive(Clone)]
pub struct Cable(Arc<Shared>);

impl Default for Cable {
    fn default() -> Self {
        Self(Arc::new(Shared {
            reach: AtomicU8::new(u8::MAX),
            silent: AtomicU64::new(0),
            powered_off: AtomicU64::new(0),
            has_faults: AtomicBool::new(false),
            faults: Mutex::new(Vec::with_capacity(MAX_SLAVES * MAX_AXES)),
            orders: Mutex::new([Orders::default(); MAX_SLAVES]),
        }))
    }
}

/// What scripts and tests do to it.
impl Cable {
    /// Cuts the cable after that many slaves. 0: before the first one, so that the bus is silent.
    pub fn cut_after(&self, slaves: u8) {
        self.0.reach.store(slaves, Ordering::Relaxed);
    }

    /// Makes the cable whole.
    pub fn heal(&self) {
        self.cut_after(u8::MAX);
    }

    /// A slave stops answering, while frames still pass it and time passes in it; or it answers again.
    pub fn silence(&self, slave: u8, silent: bool) {
        let bit = bit_of(slave);
        if silent {
            self.0.silent.fetch_or(bit, Ordering::Relaxed);
        } else {
            self.0.silent.fetch_and(!bit, Ordering::Relaxed);
        }
    }

    /// A slave loses its power: it falls to Init, forgets its process data and does not answer, while frames still pass
    /// it and those behind it stay.
    pub fn lose(&self, slave: u8) {
        self.silence(slave, true);
        self.0.powered_off.fetch_or(bit_of(slave), Ordering::Relaxed);
    }

    /// A slave that was lost has power again: it answers, in Init.
    pub fn find(&self, slave: u8) {
        self.silence(slave, false);
    }

    /// A slave refuses to enter a state, with that AL status code; `None`: it enters every state that it can.
    pub fn refuse(&self, slave: u8, state: Option<(AlState, AlStatus)>) {
        self.order(slave, |orders| orders.refuse = state);
    }

    /// SDO transfers with a slave take that much longer; beyond the timeout of the request they fail. 0: no delay.
    pub fn delay_sdo(&self, slave: u8, ns: Ns) {
        self.order(slave, |orders| orders.sdo_delay_ns = ns);
    }

    /// A slave aborts every SDO transfer with that code, and does nothing of it; `None`: no longer.
    pub fn abort_sdo(&self, slave: u8, code: Option<AbortCode>) {
        self.order(slave, |orders| orders.sdo_abort = code);
    }

    /// A slave aborts transfers of one object with that code, and does nothing of them; `None`: no longer. One object of
    /// a slave at a time.
    pub fn abort_object(&self, slave: u8, abort: Option<(ObjectAddress, AbortCode)>) {
        self.order(slave, |orders| orders.object_abort = abort);
    }

    /// Something goes wrong in a slave, or is as it was, from the next cycle on. An axis or a channel that the slave does not
    /// have is without effect.
    pub fn inflict(&self, slave: u8, fault: Fault) {
        lock(&self.0.faults).push((slave, fault));
        self.0.has_faults.store(true, Ordering::Release);
    }

    fn order(&self, slave: u8, change: impl FnOnce(&mut Orders)) {
        if let Some(place) = usize::from(slave).checked_sub(1)
            && let Some(orders) = lock(&self.0.orders).get_mut(place)
        {
            change(orders);
        }
    }
}

/// What a network asks of it.
impl Cable {
    /// How many slaves frames reach; those behind a cut are not reached.
    pub fn reach(&self) -> u8 {
        self.0.reach.load(Ordering::Relaxed)
    }

    /// Slaves that frames reach and that answer them.
    pub fn answering(&self) -> SlaveSet {
        let silent = SlaveSet::from_bits(self.0.silent.load(Ordering::Relaxed));
        SlaveSet::first(self.reach().min(MAX_SLAVES as u8)).difference(silent)
    }

    /// Slaves whose power goes now.
    pub fn take_powered_off(&self) -> SlaveSet {
        match self.0.powered_off.load(Ordering::Relaxed) {
            0 => SlaveSet::EMPTY,
            _ => SlaveSet::from_bits(self.0.powered_off.swap(0, Ordering::Relaxed)),
        }
    }

    /// With which AL status code a slave refuses a state whatever it could do; `None`: it does not.
    pub fn refusal(&self, slave: u8, state: AlState) -> Option<AlStatus> {
        self.orders(slave).refuse.filter(|(refused, _)| *refused == state).map(|(_, status)| status)
    }

    /// How much longer SDO transfers with a slave take.
    pub fn sdo_delay_ns(&self, slave: u8) -> Ns {
        self.orders(slave).sdo_delay_ns
    }

    /// With which code a slave aborts a transfer of that object whatever it could do; `None`: it does not.
    pub fn sdo_abort(&self, slave: u8, object: ObjectAddress) -> Option<AbortCode> {
        let Orders { sdo_abort, object_abort, .. } = self.orders(slave);
        sdo_abort.or(object_abort.filter(|(aborted, _)| *aborted == object).map(|(_, code)| code))
    }

    /// Hands out the faults that have not yet happened, unless a thread is just adding one.
    pub fn take_faults(&self, mut happens: impl FnMut(u8, Fault)) {
        if !self.0.has_faults.load(Ordering::Acquire) {
            return;
        }
        let Ok(mut faults) = self.0.faults.try_lock() else { return };
        self.0.has_faults.store(false, Ordering::Release);
        faults.drain(..).for_each(|(slave, fault)| happens(slave, fault));
    }

    fn orders(&self, slave: u8) -> Orders {
        let place = usize::from(slave).wrapping_sub(1);
        lock(&self.0.orders).get(place).copied().unwrap_or_default()
    }
}

fn bit_of(slave: u8) -> u64 {
    match slave {
        1..=64 => 1 << (slave - 1),
        _ => 0,
    }
}

/// A panic elsewhere leaves plain data behind, which is as good as before.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
