//! Axes in CSP that stand far from their last targets: a jam, an end stop or a limit of the drive holds them back, and
//! their drives push. If such an axis came free, it would go to its last target by itself, although no program commands
//! it any more. So a stop makes the actual position of the axis its target. A vertical axis is held there, too. \[OURS]

use std::fmt;

use super::LeftBehind;
use super::axis_ramp::keeps_outputs;
use super::movement::{self, Observation};
use crate::ecm::config::Slave;
use crate::ecm::exchange::Session;
use crate::ecm::{Ecm, EcmError};
use crate::ethercat::cia402::{Mode, Statusword};
use crate::sk::{AxisTarget, Motion, SlaveCommand};

/// \[OURS] A stationary axis that is further than this many counts from its last target counts as one that does not
/// follow. Most axes that follow are nearer. An exception is an axis with a fine encoder and a load that pulls, if the
/// position loop of its drive has no integral part. A stop holds it at its actual position, too, so that it gives way
/// to the load by this distance.
const AWAY_COUNTS: u32 = 1000;
/// \[OURS] As [`AWAY_COUNTS`], for an axis whose drive shows that it cannot follow (bit 11, internal limit, or 13,
/// following error, of its statusword).
const AWAY_COUNTS_LIMITED: u32 = 64;

/// An axis that did not follow its target, and that a stop therefore holds at its actual position
/// ([`Ecm::take_held_back`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct HeldBack {
    /// The slave, 1 to 40.
    pub slave: u8,
    /// Whether the axis is the second one of an HSP.
    pub is_second: bool,
    /// The distance of the axis from its last target, counts; `None` if another program has set the target and it is
    /// not known.
    pub away: Option<u32>,
    /// The actual position of the axis, which is now its target, counts.
    pub position: i32,
    /// Whether its drive has shown that it cannot follow: bit 11 (internal limit) or 13 (following error) of its statusword.
    pub is_limited: bool,
}

impl fmt::Display for HeldBack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let which = if self.is_second { "the second axis of slave" } else { "axis" };
        match self.away {
            Some(away) => write!(f, "{which} {} pushed, {away} counts from its target", self.slave)?,
            None => write!(f, "{which} {} pushed, held back from its target", self.slave)?,
        }
        write!(f, ": its target is now its actual position, {}", self.position)
    }
}

/// The command that holds the axes of a slave at their actual positions, because they did not follow their targets.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hold {
    /// The actual positions of axes that are held back; the last targets of others.
    pub(super) command: SlaveCommand,
    axes: [Option<HeldBack>; 2],
}

impl Hold {
    /// Records the axes for [`Ecm::take_held_back`]. A newer finding for an axis replaces the older one.
    pub(super) fn note(&self, session: &mut Session) {
        for axis in self.axes.iter().flatten() {
            session.held_back.retain(|other| (other.slave, other.is_second) != (axis.slave, axis.is_second));
            session.held_back.push(*axis);
        }
    }
}

/// The command that holds a slave's axes in CSP at their actual positions if they do not follow their targets; `None`
/// if there are no such axes. `observed` shows whether the axes are stationary. If another program has set the last
/// target, so that it is unknown, the statusword has to show that the axis cannot follow. An axis whose homing was
/// aborted gets no command: the board holds it.
pub(super) fn hold_of(
    session: &Session,
    observed: &Observation,
    slave: u8,
    config: &Slave,
    left: &LeftBehind,
) -> Option<Hold> {
    let axis = config.axis()?;
    let is_homing = session.homing.active.contains(slave) || left.homing.contains(slave);
    if axis.mode != Mode::Csp || session.credit.ahead() > 0 || is_homing || session.lost.contains(slave) {
        return None;
    }
    if keeps_outputs(session, observed, slave, config, left) {
        return None;
    }
    // For an axis that this stop has ramped, the target in force is the end of the ramp.
    let targets = match session.targets.in_force(slave) {
        Some(SlaveCommand::Csp(last)) => Some([last.first.target, last.second.target]),
        _ => None,
    };
    let first = session.statusword(slave);
    let is_limited = |word: Statusword| word.0 & (Statusword::INTERNAL_LIMIT | Statusword::BIT13) != 0;
    let second = movement::may_have_two_axes(session, config).then(|| session.second_channels.statusword(slave));
    let is_on = [first.is_enabled(), second.is_some_and(|word| word.is_none_or(Statusword::is_enabled))];
    let is_limited = [is_limited(first), second.flatten().is_some_and(is_limited)];
    let moved = observed.moved(session, slave, config);
    let positions = movement::positions(session, slave, config);
    let axes = [0, 1].map(|i| {
        let away = targets.map(|targets| targets[i].wrapping_sub(positions[i]).unsigned_abs());
        let is_away = match away {
            Some(away) => away > if is_limited[i] { AWAY_COUNTS_LIMITED } else { AWAY_COUNTS },
            None => left.is_foreign && is_limited[i],
        };
        let is_held_back = is_on[i] && is_away && moved[i].unsigned_abs() <= axis.standstill;
        is_held_back.then_some(HeldBack {
            slave,
            is_second: i == 1,
            away,
            position: positions[i],
            is_limited: is_limited[i],
        })
    });
    if axes == [None; 2] {
        return None;
    }
    let outputs = session.targets.outputs()[usize::from(slave)];
    let [first, second] = [0, 1].map(|i| {
        let target = match (axes[i], targets) {
            (None, Some(targets)) => targets[i],
            _ => positions[i],
        };
        AxisTarget { target, outputs: outputs[i] }
    });
    Some(Hold { command: SlaveCommand::Csp(Motion { first, second }), axes })
}

impl Ecm {
    /// Takes the axes in CSP that did not follow their targets when they were stopped since the last call, by the end
    /// of a stream or by [`Ecm::stop`]: the newest finding for each axis. Such an axis was stationary more than 1000
    /// counts from its last target, or more than 64 with internal limit active or a following error in the statusword.
    /// Its drive pushed, and it would have moved on by itself once it came free. Now it is held at its actual position,
    /// enabled.
    ///
    /// The limit in counts is the same for all encoders: with 23 bits per turn, 1000 counts are 0.04 degrees. If the
    /// position loop of a drive has no integral part, a load may keep the axis farther from its target although nothing
    /// blocks it. Such an axis is held, too, and gives way to the load by that distance at each stop. An integral part
    /// in the loop prevents this.
    ///
    /// # Errors
    /// [`EcmError::Busy`] if another thread uses the board for too long, [`EcmError::Link`] once the board is closed.
    pub fn take_held_back(&self) -> Result<Vec<HeldBack>, EcmError> {
        Ok(std::mem::take(&mut self.exchange.lock()?.held_back))
    }
}
