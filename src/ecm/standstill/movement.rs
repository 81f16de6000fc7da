//! Judges whether axes are stationary. One cycle is not enough: encoders are noisy, and a slow axis moves less than the
//! noise in a cycle. So an axis that may be moving is observed over several cycles.

use std::time::Duration;

use crate::ecm::config::Slave;
use crate::ecm::exchange::Session;
use crate::link::Stamp;
use crate::sk::{Frame, HspResponse, SlotSize};

/// \[OURS] An axis that moves at most this many counts in a cycle counts as stationary in that cycle.
const STANDSTILL_COUNTS: u32 = 2;
/// \[OURS] An axis that moves more than [`STANDSTILL_COUNTS`] in a cycle is observed for this many cycles, but for no
/// longer than [`OBSERVATION_MAX`], and for at least one cycle.
const OBSERVATION_CYCLES: u64 = 8;
const OBSERVATION_MAX: Duration = Duration::from_millis(16);

/// \[OURS] How many cycles pass from the cycle of a report to the execution of a frame that was written after the report.
pub(super) const LATENCY_CYCLES: i32 = 2;

/// \[OURS] The longest time that a drive takes to reach a target once the board has executed it.
const LAG_MAX: Duration = Duration::from_millis(20);

/// An observation of the axes over several cycles: their movement since an earlier report.
pub(super) struct Observation {
    /// The report at which the observation began.
    report: Frame,
    at: Stamp,
    /// The number of reports read before the observation began, by which its cycles are counted.
    reports: u64,
}

impl Observation {
    /// Begins an observation at the newest report.
    pub(super) fn begin(session: &Session) -> Self {
        let at = session.reports.at();
        Self { report: Frame::clone(&session.reports.newest), at, reports: session.stats.reports }
    }

    /// An observation over the last cycle: from the report before the newest one to the newest one.
    pub(super) fn of_last_cycle(session: &Session) -> Self {
        Self {
            report: Frame::clone(&session.reports.previous),
            at: session.reports.previous_at(),
            reports: session.stats.reports - 1,
        }
    }

    /// Whether the observation has lasted for [`OBSERVATION_CYCLES`] or [`OBSERVATION_MAX`], long enough to notice a slow
    /// axis.
    pub(super) fn is_long_enough(&self, session: &Session) -> bool {
        let most = (OBSERVATION_MAX.as_nanos() / session.network.cycle().as_nanos()) as u64;
        session.stats.reports - self.reports >= most.clamp(1, OBSERVATION_CYCLES)
    }

    /// How far a slave's axes have moved since the observation began, counts.
    pub(super) fn moved(&self, session: &Session, slave: u8, config: &Slave) -> [i32; 2] {
        moved(session, &self.report, slave, config)
    }

    /// The duration of the observation, seconds.
    pub(super) fn seconds(&self, session: &Session) -> f64 {
        let now = session.reports.at().0;
        now.saturating_sub(self.at.0).max(1) as f64 / 1e9
    }

    /// Whether one of a slave's axes has moved further than its standstill threshold since the observation began.
    pub(super) fn moves(&self, session: &Session, slave: u8, config: &Slave) -> bool {
        let standstill = config.axis().map_or(u32::MAX, |axis| axis.standstill);
        commanded_ways(session, slave, config, self.moved(session, slave, config)).any(|counts| counts > standstill)
    }
}

/// The positions of a slave's axes in the newest report, counts.
pub(super) fn positions(session: &Session, slave: u8, config: &Slave) -> [i32; 2] {
    positions_in(&session.reports.newest, session.size, slave, config)
}

fn positions_in(report: &Frame, size: SlotSize, slave: u8, config: &Slave) -> [i32; 2] {
    let slot = report.slot(size, slave.into());
    if !matches!(config, Slave::Hsp(_)) {
        return [slot.data1 as i32, 0];
    }
    let answer = HspResponse::decode(&slot, size);
    [answer.first.position, answer.second.position]
}

/// The most cycles that a drive takes to reach a target: [`LAG_MAX`] in cycles, but at least 3. \[OURS]
pub(super) fn lag_cycles(session: &Session) -> f64 {
    LAG_MAX.div_duration_f64(session.network.cycle()).max(3.0)
}

/// The movement of a slave's axes in the last cycle, counts.
pub(super) fn moved_in_last_cycle(session: &Session, slave: u8, config: &Slave) -> [i32; 2] {
    moved(session, &session.reports.previous, slave, config)
}

/// Whether a slave's axes may be moving, judged by the last cycle alone.
pub(super) fn may_move(session: &Session, slave: u8, config: &Slave) -> bool {
    commanded_ways(session, slave, config, moved_in_last_cycle(session, slave, config))
        .any(|counts| counts > STANDSTILL_COUNTS)
}

/// Of the distances `ways` that a slave's two axes have moved, returns those of axes that follow commands, in counts.
/// Axes that are off or homing are left out.
fn commanded_ways(session: &Session, slave: u8, config: &Slave, ways: [i32; 2]) -> impl Iterator<Item = u32> + use<> {
    let is_free = config.axis().is_some() && !session.homing.active.contains(slave);
    let first = session.statusword(slave).is_enabled();
    let second = may_have_two_axes(session, config);
    ways.into_iter()
        .zip([first, first || second])
        .filter(move |(_, is_on)| is_free && *is_on)
        .map(|(way, _)| way.unsigned_abs())
}

/// Whether the slave may have two axes. Its slot has only the statusword of the first axis. The second axis may be on
/// while the first one is off, for example after an alarm, so it always counts as on.
pub(super) fn may_have_two_axes(session: &Session, config: &Slave) -> bool {
    matches!(config, Slave::Hsp(_)) && session.size == SlotSize::Bytes16
}

/// Whether a slave has an axis that may be on.
pub(super) fn may_be_on(session: &Session, slave: u8, config: &Slave) -> bool {
    session.statusword(slave).is_enabled() || may_have_two_axes(session, config)
}

/// The movement of a slave's axes from an earlier report to the newest one, counts.
fn moved(session: &Session, from: &Frame, slave: u8, config: &Slave) -> [i32; 2] {
    let (now, before) = (positions(session, slave, config), positions_in(from, session.size, slave, config));
    [0, 1].map(|i| now[i].wrapping_sub(before[i]))
}
