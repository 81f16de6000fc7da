//! Stopping the axes when their host has vanished.
//!
//! The server passes bytes on without decoding them. So it knows neither the slaves nor their axes, and nothing about
//! the packets: not the data size n, not the packet boundaries, not the index of the last packet. It starts like a host
//! without any knowledge, and then does what needs no knowledge of axes: it brings slaves in OP to SafeOP, in which the
//! outputs of a slave have no effect.

use std::time::Duration;

use crate::link::chip_link::{ChipError, ChipLink};
use crate::xf::host::{HostConfig, Timeouts};
use crate::xf::request::{CrcTypeSet, SlaveNumber, Slaves, StateGet, StateSet, StateUpdate};
use crate::xf::{CheckRule, CheckType, CommandHeader, EtherCatState, MAX_PACKET, write_request};
use crate::xf_api::{Xf, XfError};

/// How long the change to SafeOP may take. \[OURS]
const STATE_TIME_MAX: Duration = Duration::from_secs(5);

/// How often stopping is tried. If this process stalls meanwhile, a time limit of the driver may have passed although the
/// chip answers. \[OURS]
const TRIES: usize = 3;

/// The result of stopping the axes of a vanished host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stopped {
    /// No slave was in OP, so nothing had to be stopped.
    NotInOp,
    /// The number of slaves that were in OP and are in SafeOP now.
    Slaves(usize),
}

/// Switches the FIFO off, empties it, and brings slaves in OP to SafeOP. Afterwards the chip uses fixed check words, as
/// after power-on. Fails if the chip does not answer, or a slave stays in OP.
pub(super) fn bring_to_safe_op(link: &mut dyn ChipLink, config: HostConfig) -> Result<Stopped, XfError> {
    let mut stopped = try_to_stop(link, config);
    for _ in 1..TRIES {
        if stopped.is_ok() {
            break;
        }
        stopped = try_to_stop(link, config);
    }
    stopped
}

fn try_to_stop(link: &mut dyn ChipLink, config: HostConfig) -> Result<Stopped, XfError> {
    let busy_ns = STATE_TIME_MAX.as_nanos() as u64;
    let timeouts = Timeouts { busy_ns, ..config.timeouts };
    // The chip's data size n is not changed (`wanted_size: None`), because the next host expects the size that it has
    // seen last.
    let mut xf = Xf::over(link, HostConfig { wanted_size: None, timeouts, ..config })?;
    let stopped = leave_op(&mut xf);
    // An error is ignored: the chip accepts CRC_TYPE_SET with the fixed check word whatever type is set (XF-11.4), so
    // the next host can still set the type that it expects.
    let _ = set_fixed_check(&mut xf);
    stopped
}

/// Sets the chip to fixed check words, which a newly started host expects. The driver uses CRC-32 while it runs, so
/// this is the last packet to the chip.
fn set_fixed_check(xf: &mut Xf<&mut dyn ChipLink>) -> Result<(), ChipError> {
    let size = xf.host().size();
    let (mut packet, mut back) = ([0; MAX_PACKET], [0; MAX_PACKET]);
    // The chip does not run a packet with the same index and code as the previous one. The driver's packets have the
    // indices 1 to 255, so index 0 is new.
    let header = CommandHeader::with_index(0);
    // This cannot fail: the buffer has room for a packet of any size.
    let _ = write_request(&mut packet, size, CheckRule::FIXED, header, &CrcTypeSet { kind: CheckType::Fixed });
    let link = xf.link_mut();
    for _ in 0..2 {
        let ready = link.now().saturating_add(HostConfig::DEFAULT.idle_max_ns);
        link.wait_until(ready)?;
        // The chip ignores a packet while it still handles the previous one, so this packet is sent twice. If the chip
        // has run the first one, the second one changes nothing.
        link.exchange(&packet[..size.packet_len()], &mut back[..size.packet_len()])?;
    }
    Ok(())
}

fn leave_op(xf: &mut Xf<&mut dyn ChipLink>) -> Result<Stopped, XfError> {
    let found = xf.count_slaves()?;
    let in_op = slaves_in_op(xf, found)?;
    if in_op.is_empty() {
        return Ok(Stopped::NotInOp);
    }
    let all = in_op.len() == usize::from(found);
    let mut failed = None;
    for slaves in if all { vec![Slaves::All] } else { in_op.iter().copied().map(Slaves::One).collect() } {
        // The loop continues after a slave that refuses, so that this slave does not keep the others in OP.
        failed = xf.run(&StateSet { slaves, state: EtherCatState::SafeOp }).err().or(failed);
    }
    match slaves_in_op(xf, found) {
        Ok(left) if left.is_empty() => Ok(Stopped::Slaves(in_op.len())),
        Ok(left) => Err(failed.unwrap_or_else(|| XfError::StateStuck {
            wanted: EtherCatState::SafeOp,
            slaves: left.iter().map(|slave| (slave.get(), Some(EtherCatState::Op), 0)).collect(),
        })),
        Err(error) => Err(failed.unwrap_or(error)),
    }
}

fn slaves_in_op(xf: &mut Xf<&mut dyn ChipLink>, found: u8) -> Result<Vec<SlaveNumber>, XfError> {
    // A slave that does not answer makes this command fail, although the chip has read the states of all others. So the
    // error is returned only if no slave is in OP.
    let updated = xf.run(&StateUpdate);
    let mut in_op = Vec::new();
    for slave in (0..found).filter_map(SlaveNumber::new) {
        let state = xf.run(&StateGet { slaves: Slaves::One(slave) })?;
        if state.state() == Some(EtherCatState::Op) {
            in_op.push(slave);
        }
    }
    if in_op.is_empty() { updated.map(|_| in_op) } else { Ok(in_op) }
}
