//! Whether axes stand. One cycle tells little: encoders have noise, and a slow axis moves less than that. What moves at
//! all in a cycle is looked at for a while.

use std::time::Duration;

use super::config::Slave;
use super::session::Session;
use crate::link::Stamp;
use crate::sk::{Frame, HspResponse, SlotSize};

/// \[OURS] An axis that moves no further than that in a cycle stands, whatever it was told.
const STILL: u32 = 2;
/// \[OURS] How long an axis is looked at that does not: cycles, but no longer than that and at least one.
const CYCLES: u64 = 8;
const LONGEST: Duration = Duration::from_millis(16);

/// \[OURS] Cycles from the one that a report shows until a frame is executed that was written after it.
pub(super) const LATENCY: i32 = 2;

/// \[OURS] How far a drive may be behind its targets.
const LAG: Duration = Duration::from_millis(20);

/// Where all axes were a while ago.
pub(super) struct Since {
    report: Frame,
    at: Stamp,
    reports: u64,
}

impl Since {
    pub(super) fn now(session: &Session) -> Self {
        let at = session.meta.map_or(Stamp(0), |meta| meta.at);
        Self { report: Frame::clone(&session.report), at, reports: session.stats.reports }
    }

    /// The report before the newest one.
    pub(super) fn previous(session: &Session) -> Self {
        Self { report: Frame::clone(&session.previous), at: session.previous_at, reports: session.stats.reports - 1 }
    }

    /// Whether it is long enough ago.
    pub(super) fn is_over(&self, session: &Session) -> bool {
        let longest = (LONGEST.as_nanos() / session.plan.cycle().as_nanos()) as u64;
        session.stats.reports - self.reports >= longest.clamp(1, CYCLES)
    }

    /// Counts that a slave's axes have gone since.
    pub(super) fn way(&self, session: &Session, slave: u8, config: &Slave) -> [i32; 2] {
        way(session, &self.report, slave, config)
    }

    /// Seconds since.
    pub(super) fn seconds(&self, session: &Session) -> f64 {
        let now = session.meta.map_or(0, |meta| meta.at.0);
        now.saturating_sub(self.at.0).max(1) as f64 / 1e9
    }

    /// Whether a slave's axes have moved since.
    pub(super) fn moves(&self, session: &Session, slave: u8, config: &Slave) -> bool {
        let standstill = config.axis().map_or(u32::MAX, |axis| axis.standstill);
        free_ways(session, slave, config, self.way(session, slave, config)).any(|counts| counts > standstill)
    }
}

/// Where a slave's axes are, counts.
pub(super) fn positions(session: &Session, slave: u8, config: &Slave) -> [i32; 2] {
    let slot = session.slot(slave.into());
    if !matches!(config, Slave::Hsp(_)) {
        return [slot.data1 as i32, 0];
    }
    let answer = HspResponse::decode(&slot, session.size);
    [answer.first.position, answer.second.position]
}

/// Cycles that a drive needs for no more than what it lags behind its targets. \[OURS]
pub(super) fn lag_cycles(session: &Session) -> f64 {
    LAG.div_duration_f64(session.plan.cycle()).max(3.0)
}

/// Counts that a slave's axes moved in the last cycle.
pub(super) fn last_cycle(session: &Session, slave: u8, config: &Slave) -> [i32; 2] {
    way(session, &session.previous, slave, config)
}

/// Whether a slave's axes may be moving, by the last cycle.
pub(super) fn may_move(session: &Session, slave: u8, config: &Slave) -> bool {
    free_ways(session, slave, config, last_cycle(session, slave, config)).any(|counts| counts > STILL)
}

/// How far the axes have gone that a host moves.
fn free_ways(session: &Session, slave: u8, config: &Slave, ways: [i32; 2]) -> impl Iterator<Item = u32> + use<> {
    let is_free = config.axis().is_some() && session.homing & 1 << slave == 0;
    let first = session.statusword(slave).is_enabled();
    let second = has_two(session, config);
    ways.into_iter()
        .zip([first, first || second])
        .filter(move |(_, is_on)| is_free && *is_on)
        .map(|(way, _)| way.unsigned_abs())
}

/// Whether reports and commands may be those of two axes. The statusword is that of the first one alone, and the second one
/// goes on when the first has an alarm.
fn has_two(session: &Session, config: &Slave) -> bool {
    matches!(config, Slave::Hsp(_)) && session.size == SlotSize::Bytes16
}

/// Whether a slave has an axis that may be on.
pub(super) fn may_be_on(session: &Session, slave: u8, config: &Slave) -> bool {
    session.statusword(slave).is_enabled() || has_two(session, config)
}

fn way(session: &Session, from: &Frame, slave: u8, config: &Slave) -> [i32; 2] {
    let (now, before) = (session.slot(slave.into()), from.slot(session.size, slave.into()));
    if !matches!(config, Slave::Hsp(_)) {
        return [(now.data1 as i32).wrapping_sub(before.data1 as i32), 0];
    }
    let (now, before) = (HspResponse::decode(&now, session.size), HspResponse::decode(&before, session.size));
    [now.first.position.wrapping_sub(before.first.position), now.second.position.wrapping_sub(before.second.position)]
}
