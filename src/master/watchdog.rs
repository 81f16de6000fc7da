//! The watchdog of process data, registers 0x0400 and 0x0420: without new outputs a slave leaves OP.
//!
//! When the master is killed, only this watchdog stops an axis. So both registers are written on each way to SafeOP,
//! since another master may have changed them, and read back.

use super::bus::{Bus, Unanswered};
use super::process_data::Registers;
use super::state_error::StateReason;
use crate::ethercat::Ns;
use crate::ethercat::registers::{SmControl, TYPE, WATCHDOG_DIVIDER, WATCHDOG_PROCESS_DATA};

/// The values that the two watchdog registers of a slave have after power-on: a divider that makes units of 100 us, and
/// a time of 1000 units, which is 100 ms.
pub(super) const DIVIDER: u16 = 2498;
pub(super) const UNITS: u16 = 1000;
/// The length of a tick of the divider, ns.
const TICK_NS: Ns = 40;
/// \[OURS] How many cycles without outputs the watchdog tolerates at least.
const CYCLES: Ns = 3;

/// The length of a watchdog unit for a divider, ns.
pub(crate) const fn unit_ns(divider: u16) -> Ns {
    (divider as Ns + 2) * TICK_NS
}

/// A watchdog time as the values of both registers: the divider, and the number of units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Time {
    divider: u16,
    units: u16,
}

impl Time {
    /// The longest time that does not exceed `ns` with that divider, but at least one unit.
    fn nearest(divider: u16, ns: Ns) -> Self {
        Self { divider, units: u16::try_from(ns / unit_ns(divider)).unwrap_or(u16::MAX).max(1) }
    }

    const fn ns(self) -> Ns {
        self.units as Ns * unit_ns(self.divider)
    }
}

/// Sets the watchdog of a slave whose outputs trigger it, if the cycle time is known: to 100 ms, or to [`CYCLES`]
/// cycles if these are longer. If the divider of a slave controller is fixed, the units are computed for it. A
/// controller without these registers has no watchdog; the slave is accepted, since otherwise it could never go to OP.
/// \[OURS]
pub(super) async fn set(bus: &Bus, station: u16, registers: Option<&Registers>) -> Result<(), StateReason> {
    let Some(pace) = bus.with(|shared| shared.pace) else { return Ok(()) };
    let managers = registers.into_iter().flat_map(|registers| &registers.managers);
    if !managers.into_iter().any(|(_, one)| one.len > 0 && one.control.contains(SmControl::WATCHDOG)) {
        return Ok(());
    }
    let shortest_ns = CYCLES.saturating_mul(pace.cycle_ns);
    let wanted = Time::nearest(DIVIDER, shortest_ns.max(Time { divider: DIVIDER, units: UNITS }.ns()));
    let mut time = wanted;
    let Some(mut is) = write(bus, station, time).await? else { return Ok(()) };
    if is.divider != DIVIDER {
        time = Time::nearest(is.divider, wanted.ns());
        is = write(bus, station, time).await?.unwrap_or(is);
    }
    let is_right = is == time && time.ns() >= shortest_ns.min(wanted.ns());
    if is_right { Ok(()) } else { Err(StateReason::Watchdog { is_ns: is.ns(), wanted_ns: wanted.ns() }) }
}

/// Writes both registers and reads them back; `None`: the slave does not have them.
async fn write(bus: &Bus, station: u16, time: Time) -> Result<Option<Time>, StateReason> {
    for (ado, value) in [(WATCHDOG_DIVIDER, time.divider), (WATCHDOG_PROCESS_DATA, time.units)] {
        // A refused write shows when the register is read back.
        if bus.write(station, ado, &value.to_le_bytes()).await == Err(Unanswered::Lost) {
            return Err(StateReason::NoAnswer);
        }
    }
    let divider = read(bus, station, WATCHDOG_DIVIDER).await?;
    let units = read(bus, station, WATCHDOG_PROCESS_DATA).await?;
    Ok(divider.zip(units).map(|(divider, units)| Time { divider, units }))
}

/// Reads a 16-bit register; `None`: the slave answers, but does not have it.
async fn read(bus: &Bus, station: u16, ado: u16) -> Result<Option<u16>, StateReason> {
    match bus.read::<2>(station, ado).await {
        Ok(bytes) => Ok(Some(u16::from_le_bytes(bytes))),
        Err(Unanswered::Lost) => Err(StateReason::NoAnswer),
        // Either the slave does not have the register, or it does not answer at all. A read of the type register, which
        // every slave has, shows which.
        Err(Unanswered::Counter(_)) => Ok(bus.read::<1>(station, TYPE).await.map(|_| None)?),
    }
}
