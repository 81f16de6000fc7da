//! What scripts and tests do to a simulated bus while it runs, from any thread.
//!
//! A cycle reads atomics and takes locks only by trying: a thread that holds one delays a fault or a snapshot by a
//! cycle, never the cycle itself. Jobs, which are no part of a cycle, take the script's lock, which is never held for
//! longer than an assignment.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::{AlState, MAX_AXES, MAX_SLAVES, Ns, SlaveSet};
use crate::slave::{AlStatus, DeviceFault, Input, InputPattern};

/// Where the shafts really are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shafts {
    /// End of the cycle in which they were there, board time.
    pub at: Ns,
    /// Slave n is `positions[n - 1]`, one entry for each axis, counts; `None`: no such axis.
    pub positions: [[Option<i64>; MAX_AXES]; MAX_SLAVES],
}

/// What one slave is made to do.
#[derive(Clone, Copy, Default)]
pub(super) struct Orders {
    /// A state that it refuses, and why.
    pub(super) refuse: Option<(AlState, AlStatus)>,
    pub(super) sdo_delay_ns: Ns,
    pub(super) sdo_abort: Option<AbortCode>,
    /// One object only.
    pub(super) object_abort: Option<(ObjectAddress, AbortCode)>,
}

/// What happens to one axis in the next cycle.
#[derive(Clone, Copy)]
pub(super) enum Mishap {
    Fault(DeviceFault),
    Stuck(Input, Option<bool>),
    Jam(bool),
    Forced(Option<InputPattern>),
}

struct Shared {
    /// Slaves that the cable reaches.
    reach: AtomicU8,
    /// Bit n - 1: slave n does not answer.
    silent: AtomicU64,
    /// Bit n - 1: slave n loses its power in the next cycle.
    powered_off: AtomicU64,
    has_mishaps: AtomicBool,
    /// Slave, axis, mishap; not yet happened.
    mishaps: Mutex<Vec<(u8, usize, Mishap)>>,
    orders: Mutex<[Orders; MAX_SLAVES]>,
    shafts: Mutex<Shafts>,
}

/// A handle on a [`super::SimBus`]; clones are handles on the same bus. Slaves are numbered from 1; what is said of a
/// slave that the bus does not have is without effect.
#[derive(Clone)]
pub struct SimHandle(Arc<Shared>);

impl Default for SimHandle {
    fn default() -> Self {
        let positions = [[None; MAX_AXES]; MAX_SLAVES];
        Self(Arc::new(Shared {
            reach: AtomicU8::new(u8::MAX),
            silent: AtomicU64::new(0),
            powered_off: AtomicU64::new(0),
            has_mishaps: AtomicBool::new(false),
            mishaps: Mutex::new(Vec::with_capacity(MAX_SLAVES * MAX_AXES)),
            orders: Mutex::new([Orders::default(); MAX_SLAVES]),
            shafts: Mutex::new(Shafts { at: 0, positions }),
        }))
    }
}

impl SimHandle {
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

    /// A fault happens in a slave, on an axis (from 0), in the next cycle.
    pub fn raise_fault(&self, slave: u8, axis: usize, fault: DeviceFault) {
        self.befall(slave, axis, Mishap::Fault(fault));
    }

    /// An input of a slave's axis (from 0) sticks at a value from the next cycle on, or works again: `None`. An index
    /// pulse that sticks does not come any more.
    pub fn stick_input(&self, slave: u8, axis: usize, input: Input, value: Option<bool>) {
        self.befall(slave, axis, Mishap::Stuck(input, value));
    }

    /// The shaft of a slave's axis (from 0) is jammed from the next cycle on, so that it stands whatever the torque, or
    /// is free again.
    pub fn jam(&self, slave: u8, axis: usize, jammed: bool) {
        self.befall(slave, axis, Mishap::Jam(jammed));
    }

    /// The digital inputs of a slave's channel (from 0) are forced from the next cycle on, or work again: `None`.
    pub fn force_inputs(&self, slave: u8, channel: usize, pattern: Option<InputPattern>) {
        self.befall(slave, channel, Mishap::Forced(pattern));
    }

    /// Where the shafts were at the end of a cycle, all at the same time.
    pub fn shafts(&self) -> Shafts {
        lock(&self.0.shafts).clone()
    }

    /// Where one shaft was at the end of a cycle, counts; `None`: there is no such axis.
    pub fn shaft(&self, slave: u8, axis: usize) -> Option<i64> {
        let place = usize::from(slave).checked_sub(1)?;
        *lock(&self.0.shafts).positions.get(place)?.get(axis)?
    }

    pub(super) fn reach(&self) -> u8 {
        self.0.reach.load(Ordering::Relaxed)
    }

    /// Slaves that frames reach and that answer them.
    pub(super) fn answering(&self) -> SlaveSet {
        let silent = SlaveSet::from_bits(self.0.silent.load(Ordering::Relaxed));
        SlaveSet::first(self.reach().min(MAX_SLAVES as u8)).difference(silent)
    }

    /// Slaves whose power goes now.
    pub(super) fn take_powered_off(&self) -> impl Iterator<Item = u8> + use<> {
        let mut bits = match self.0.powered_off.load(Ordering::Relaxed) {
            0 => 0,
            _ => self.0.powered_off.swap(0, Ordering::Relaxed),
        };
        std::iter::from_fn(move || {
            let slave = (bits != 0).then(|| bits.trailing_zeros() as u8 + 1)?;
            bits &= bits - 1;
            Some(slave)
        })
    }

    pub(super) fn orders(&self, slave: u8) -> Orders {
        lock(&self.0.orders)[usize::from(slave) - 1]
    }

    /// Hands out the mishaps that have not yet happened, unless a thread is just adding one.
    pub(super) fn take_mishaps(&self, mut happens: impl FnMut(u8, usize, Mishap)) {
        if !self.0.has_mishaps.load(Ordering::Acquire) {
            return;
        }
        let Ok(mut mishaps) = self.0.mishaps.try_lock() else { return };
        self.0.has_mishaps.store(false, Ordering::Release);
        for (slave, axis, mishap) in mishaps.drain(..) {
            happens(slave, axis, mishap);
        }
    }

    /// Keeps the shafts of a cycle, unless a thread is just reading those of the one before.
    pub(super) fn publish(&self, at: Ns, positions: impl Iterator<Item = [Option<i64>; MAX_AXES]>) {
        let Ok(mut shafts) = self.0.shafts.try_lock() else { return };
        shafts.at = at;
        for (shown, position) in shafts.positions.iter_mut().zip(positions) {
            *shown = position;
        }
    }

    fn befall(&self, slave: u8, axis: usize, mishap: Mishap) {
        lock(&self.0.mishaps).push((slave, axis, mishap));
        self.0.has_mishaps.store(true, Ordering::Release);
    }

    fn order(&self, slave: u8, change: impl FnOnce(&mut Orders)) {
        if let Some(place) = usize::from(slave).checked_sub(1)
            && let Some(orders) = lock(&self.0.orders).get_mut(place)
        {
            change(orders);
        }
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
