//! Distributed clocks: propagation delays, setting the clocks, and SYNC signals.
//!
//! A broadcast write to 0x0900 makes every slave latch the receive times of this one frame at its ports. From these
//! times the master computes the propagation delays in the tree and the offset of each local time. From then on each
//! cycle distributes the time of the reference clock, which is that of the first slave with a clock, to all others.

use std::future::poll_fn;
use std::task::Poll;

use super::bus::{Bus, Unanswered};
use super::clock_tree::{ClockDatagram, Passed, Place, SyncSignals, put_delays};
use super::exchange::Lost;
use super::place::place;
use super::shared::{Measurement, Shared};
use super::topology::is_open;
use crate::ethercat::registers::{
    CYCLIC_UNIT_CONTROL, PORTS, RECEIVE_TIME_UNIT, RECEIVE_TIMES, SPEED_COUNTER_START, SYNC0_CYCLE, SYNC0_START,
    SYSTEM_TIME, SYSTEM_TIME_DIFFERENCE, SYSTEM_TIME_OFFSET, SystemTimeDifference,
};
use crate::ethercat::{Command, Ns, SlaveSet};

/// The minimum time from writing the SYNC0 start time to the first pulse, ns, as with other masters; 10 cycles if these
/// are longer. A start time in the past would never cause a pulse.
const START_NS: u64 = 100_000_000;
/// \[OURS] The largest difference of a clock from the reference, ns, at which its SYNC signals may start, as with other
/// masters.
const NEAR_NS: i64 = 10_000;
/// \[OURS] How long the master waits for a clock to reach [`NEAR_NS`]; then the SYNC signals start in any case.
const NEAR_MAX_NS: Ns = 1_000_000_000;
/// \[OURS] A clock with a larger difference from the reference, ns, is set anew.
const FAR_NS: i64 = 1_000_000;
const NEAR_POLL_NS: Ns = 2_000_000;
/// \[OURS] An upper bound for the time that a frame is in flight, ns.
const ROUND_MAX_NS: i32 = 1_000_000;
/// The value for "speed counter start" that all known masters write. Writing it restarts the filters of the clock.
const SPEED_START: u16 = 0x1000;

async fn passed_at(bus: &Bus, station: u16) -> Result<Passed, Unanswered> {
    let times: [u8; 4 * PORTS] = bus.read(station, RECEIVE_TIMES).await?;
    let unit = u64::from_le_bytes(bus.read(station, RECEIVE_TIME_UNIT).await?);
    let mut ports = [0; PORTS];
    ports.iter_mut().zip(times.as_chunks().0).for_each(|(port, time)| *port = u32::from_le_bytes(*time));
    Ok(Passed { ports, unit })
}

/// Allocates memory for the largest number of concurrent measurements of propagation delays. After a loss of power all
/// slaves may come back at once, and each of them needs a measurement to set its clock.
pub(super) fn make_room(shared: &mut Shared, slaves: usize) {
    let clocks = usize::from(shared.clocks.all.len());
    shared.measurements.resize_with(clocks, || Measurement::new(slaves));
    shared.exchange.reserve_short(clocks * clocks);
}

impl Measurement {
    /// A measurement of propagation delays with memory for `slaves` slaves.
    fn new(slaves: usize) -> Self {
        let mut measurement = Self {
            reads: Vec::with_capacity(slaves),
            passed: Vec::with_capacity(slaves),
            delays: Vec::with_capacity(slaves),
        };
        measurement.make_room(slaves);
        measurement
    }

    fn make_room(&mut self, slaves: usize) {
        while self.reads.len() < slaves {
            self.reads.push(place(|(bus, station): (Bus, u16)| async move { passed_at(&bus, station).await.ok() }));
        }
    }
}

/// A running measurement of propagation delays. Dropping it returns its memory for the next one.
pub(super) struct Measuring<'a> {
    bus: &'a Bus,
    measurement: Measurement,
}

impl Drop for Measuring<'_> {
    fn drop(&mut self) {
        let mut measurement = std::mem::take(&mut self.measurement);
        measurement.reads.iter_mut().for_each(|read| read.give_up());
        self.bus.with(|shared| shared.measurements.push(measurement));
    }
}

impl<'a> Measuring<'a> {
    /// Reads the latched receive times of all slaves with clocks, and computes the propagation delays. In a ring the
    /// delays are those that the scan has measured while the ring was opened.
    async fn new(bus: &'a Bus) -> Self {
        let (measurement, all) = bus.with(|shared| (shared.measurements.pop(), shared.clocks.all));
        let mut measuring = Self { bus, measurement: measurement.unwrap_or_default() };
        let slaves = bus.with(|shared| shared.clocks.places.len());
        measuring.measurement.make_room(slaves);
        let Measurement { reads, passed, delays } = &mut measuring.measurement;
        passed.clear();
        passed.resize(slaves, None);
        let mut left = all;
        for slave in all.iter() {
            match bus.with(|shared| shared.clocks.station(slave)) {
                Some(station) => reads[usize::from(slave) - 1].begin((bus.clone(), station)),
                None => left.remove(slave),
            }
        }
        poll_fn(|context| {
            for slave in left.iter() {
                let n = usize::from(slave) - 1;
                if let Poll::Ready(times) = reads[n].poll(context) {
                    passed[n] = times;
                    left.remove(slave);
                }
            }
            if left.is_empty() { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
        delays.clear();
        bus.with(|shared| match &shared.clocks.ring_delays {
            Some(measured) => delays.extend_from_slice(measured),
            None => put_delays(&shared.clocks.places, passed, delays),
        });
        measuring
    }

    /// The receive times of a slave, and its propagation delay, ns.
    fn of(&self, slave: u8) -> Option<(Passed, u32)> {
        let n = usize::from(slave).checked_sub(1)?;
        Some(((*self.measurement.passed.get(n)?)?, *self.measurement.delays.get(n)?))
    }

    /// For each slave the port by which frames enter it: the one with the earliest receive time. It is another port
    /// than port 0 only if IN and OUT are swapped at the slave. If the times are unknown, port 0 is assumed.
    pub(super) fn entries(&self) -> Vec<u8> {
        let places = self.bus.with(|shared| shared.clocks.places.clone());
        let entry = |(place, passed): (&Place, &Option<Passed>)| {
            let mut open = (0..PORTS).filter(|port| is_open(place.ports, *port));
            if !is_open(place.ports, 0) {
                // At the end of a line, frames turn around: with a single open port it is the one by which they enter.
                return open.next().filter(|_| open.next().is_none());
            }
            let passed = (*passed)?;
            let after_port_0 = |port: &usize| passed.ports[*port].wrapping_sub(passed.ports[0]).cast_signed();
            // A port that the measuring frame has not passed still has the receive time of an earlier frame, so it is
            // left out.
            open.filter(|port| after_port_0(port) > -ROUND_MAX_NS).min_by_key(after_port_0)
        };
        places.iter().zip(&self.measurement.passed).map(|one| entry(one).unwrap_or(0) as u8).collect()
    }

    /// The propagation delay of each slave, ns.
    pub(super) fn delays(&self) -> &[u32] {
        &self.measurement.delays
    }
}

/// Sets the clocks of `slaves` to the time of the clocks that are set already, or to that of the master if none is.
/// Returns the measurement with the propagation delays.
pub(super) async fn set(bus: &Bus, slaves: SlaveSet) -> Result<Measuring<'_>, Lost> {
    let (all, set, missing) = bus.with(|shared| (shared.clocks.all, shared.clocks.set, shared.missing));
    let latched_at = bus.now();
    bus.write_all(RECEIVE_TIMES, &[0; 4]).await?;
    let measuring = Measuring::new(bus).await;
    let station = |slave| bus.with(|shared| shared.clocks.station(slave));
    // The time at which the measuring frame passed the first slave, computed from its receive time at a slave whose
    // clock is set.
    let running = set.difference(missing).difference(slaves).iter().next();
    let time = match running.and_then(|slave| Some((slave, station(slave)?, measuring.of(slave)?))) {
        Some((slave, station, (Passed { unit, .. }, delay))) => {
            let Ok(offset) = bus.read(station, SYSTEM_TIME_OFFSET).await else { return Err(Lost) };
            let shown = unit.wrapping_add(u64::from_le_bytes(offset)).wrapping_sub(delay.into());
            bus.with(|shared| shared.system_time(slave, shown))
        }
        None => {
            bus.with(|shared| shared.clocks.time = latched_at);
            latched_at
        }
    };
    for slave in slaves.intersection(all).iter() {
        let Some((Passed { unit, .. }, delay)) = measuring.of(slave) else { continue };
        let offset = time.wrapping_add(delay.into()).wrapping_sub(unit);
        let mut registers = [0; 12];
        registers[..8].copy_from_slice(&offset.to_le_bytes());
        registers[8..].copy_from_slice(&delay.to_le_bytes());
        let Some(station) = station(slave) else { continue };
        let written = bus.write(station, SYSTEM_TIME_OFFSET, &registers).await;
        let filters = bus.write(station, SPEED_COUNTER_START, &SPEED_START.to_le_bytes()).await;
        if written.is_ok() && filters.is_ok() {
            bus.with(|shared| shared.clocks.set.insert(slave));
        }
    }
    Ok(measuring)
}

/// Latches receive times and returns for each slave the port by which frames enter it ([`Measuring::entries`]).
pub(super) async fn entries(bus: &Bus) -> Result<Vec<u8>, Lost> {
    bus.write_all(RECEIVE_TIMES, &[0; 4]).await?;
    Ok(Measuring::new(bus).await.entries())
}

/// Distributes the time of the reference clock, or that of the master, to all clocks, as each cycle does.
pub(super) async fn distribute(bus: &Bus) {
    let Some(ClockDatagram { command, station, time }) = bus.with(|shared| shared.clock_datagram()) else { return };
    let mut data = time.to_le_bytes();
    let answer = bus.queue_with(command, station, SYSTEM_TIME, &data, 1).answer(&mut data).await;
    let slaves = bus.with(|shared| shared.live.len());
    // A valid working counter is at most the number of slaves: each adds 1.
    if command == Command::Frmw && answer.is_ok_and(|counter| (1..=slaves).contains(&counter.into())) {
        bus.with(|shared| shared.clocks.take_time(u64::from_le_bytes(data), shared.missing));
    }
}

/// Stops the SYNC signals of a slave.
pub(super) async fn stop_sync(bus: &Bus, slave: u8, station: u16) -> Result<(), Unanswered> {
    if !bus.with(|shared| shared.clocks.all.contains(slave)) {
        return Ok(());
    }
    // The PDI, the slave's own microcontroller, may control the SYNC unit; other writes to the unit then have no effect.
    // Writing 0 gives the control to the master.
    match bus.write(station, CYCLIC_UNIT_CONTROL, &[0; 2]).await {
        // Some controllers have a clock and no SYNC unit, so there is nothing to stop.
        Ok(()) | Err(Unanswered::Counter(0)) => Ok(()),
        Err(error) => Err(error),
    }
}

/// Sets the clock of a slave if necessary, and starts its SYNC signals.
pub(super) async fn start_sync(
    bus: &Bus,
    slave: u8,
    station: u16,
    sync: Option<SyncSignals>,
) -> Result<(), Unanswered> {
    if !bus.with(|shared| shared.clocks.all.contains(slave)) {
        return Ok(());
    }
    stop_sync(bus, slave, station).await?;
    let (is_set, is_reference) =
        bus.with(|shared| (shared.clocks.set.contains(slave), shared.clocks.reference(shared.missing) == Some(slave)));
    // A clock can be far off because it has missed the frame by which it was set. It would never come close to the
    // reference, so it is set again.
    if !is_set || !is_reference && difference_ns(bus, station).await?.abs() > FAR_NS {
        set(bus, [slave].into_iter().collect()).await?;
    }
    let Some(SyncSignals { assign_activate, cycle_ns, shift_ns, sync1_ns }) = sync.filter(|sync| sync.cycle_ns > 0)
    else {
        return Ok(());
    };
    wait_until_near(bus, slave, station).await?;
    let mut cycles = [0; 8];
    cycles[..4].copy_from_slice(&cycle_ns.to_le_bytes());
    cycles[4..].copy_from_slice(&sync1_ns.to_le_bytes());
    bus.write(station, SYNC0_CYCLE, &cycles).await?;
    let shown = u64::from_le_bytes(bus.read(station, SYSTEM_TIME).await?);
    // A clock of 32 bits compares only the lower 32 bits of the start time. But the start is a multiple of the cycle in
    // the 64-bit time by which the frames are paced, so the time of this clock is extended first.
    let now = bus.with(|shared| shared.system_time(slave, shown));
    let cycle = u64::from(cycle_ns);
    let earliest = now.wrapping_add(START_NS.max(10 * cycle));
    let start = (earliest / cycle).wrapping_add(1).wrapping_mul(cycle).wrapping_add_signed(shift_ns.into());
    bus.write(station, SYNC0_START, &start.to_le_bytes()).await?;
    bus.write(station, CYCLIC_UNIT_CONTROL, &assign_activate.to_le_bytes()).await
}

/// How much the clock of a slave is ahead of the reference, ns; negative: behind it. 0 for a controller without the
/// register.
async fn difference_ns(bus: &Bus, station: u16) -> Result<i64, Unanswered> {
    match bus.read(station, SYSTEM_TIME_DIFFERENCE).await {
        Ok(difference) => Ok(SystemTimeDifference(u32::from_le_bytes(difference)).ahead_ns()),
        Err(Unanswered::Counter(0)) => Ok(0),
        Err(error) => Err(error),
    }
}

async fn wait_until_near(bus: &Bus, slave: u8, station: u16) -> Result<(), Unanswered> {
    let until = bus.now().saturating_add(NEAR_MAX_NS);
    loop {
        // The reference clock follows no other one, so there is nothing to wait for. Its difference register still
        // shows the difference to an earlier reference.
        if bus.with(|shared| shared.clocks.reference(shared.missing) == Some(slave)) {
            return Ok(());
        }
        if difference_ns(bus, station).await?.abs() < NEAR_NS || bus.now() >= until {
            return Ok(());
        }
        bus.sleep(NEAR_POLL_NS).await;
    }
}
