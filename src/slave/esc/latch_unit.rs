//! The latch unit: captures the system times at which the latch inputs of a controller change, registers 0x09A8 to 0x09CF.
//!
//! Source: ETG.1000.4 and the data sheets of slave controllers; rules ECAT-13.6 and following.

use super::clock::Clock;
use super::memory::Memory;
use crate::ethercat::Ns;
use crate::ethercat::registers::{
    AL_EVENT, AlEvents, CYCLIC_UNIT_CONTROL, ECAT_EVENT, EcatEvents, LATCH_CONTROL, LATCH_STATUS, LATCHES, LatchEdge,
    LatchStatus, latch_time,
};

/// Bit 4 of [`CYCLIC_UNIT_CONTROL`]: the slave's processor controls latch input 0, instead of the master; bit 5: latch input 1.
const OWNED_BY_DEVICE: u8 = 1 << 4;

/// Whether the slave's processor controls a latch input, instead of the master.
pub(super) fn is_devices(input: usize, memory: &Memory) -> bool {
    memory.u8(CYCLIC_UNIT_CONTROL) & OWNED_BY_DEVICE << input != 0
}

fn status(input: usize, memory: &Memory) -> LatchStatus {
    LatchStatus(memory.u8(LATCH_STATUS + input as u16))
}

/// Sets the levels of the latch inputs without an edge, so no time is captured; bit 0 is input 0.
pub(super) fn set_levels(levels: u8, memory: &mut Memory) {
    for input in 0..LATCHES {
        let without = status(input, memory).without(LatchStatus::PIN);
        let pin = if levels & 1 << input != 0 { LatchStatus::PIN } else { LatchStatus::NONE };
        memory.set_u8(LATCH_STATUS + input as u16, (without | pin).0);
    }
}

/// Sets the level of an input from the simulated time `at` on. In continuous mode the time of every edge is captured;
/// in single-event mode only the time of the first edge, until that time is read.
pub(super) fn set_level(input: usize, is_on: bool, at: Ns, clock: &Clock, memory: &mut Memory) {
    let before = status(input, memory);
    if before.contains(LatchStatus::PIN) == is_on {
        return;
    }
    let edge = if is_on { LatchEdge::Positive } else { LatchEdge::Negative };
    set_levels(levels(memory) ^ 1 << input, memory);
    let is_single = memory.u8(LATCH_CONTROL + input as u16) & edge.bit() != 0;
    if is_single && before.contains(LatchStatus(edge.bit())) {
        return;
    }
    memory.set_u64(latch_time(input, edge), clock.system_at(at));
    if is_single {
        let with = status(input, memory) | LatchStatus(edge.bit());
        memory.set_u8(LATCH_STATUS + input as u16, with.0);
        show_events(memory);
    }
}

/// The levels of the latch inputs; bit 0 is input 0.
fn levels(memory: &Memory) -> u8 {
    (0..LATCHES)
        .filter(|input| status(*input, memory).contains(LatchStatus::PIN))
        .fold(0, |bits, input| bits | 1 << input)
}

/// Acknowledges an edge whose time the master has read: if the master controls the input, the next edge is captured again.
pub(super) fn acknowledge(input: usize, edge: LatchEdge, memory: &mut Memory) {
    if !is_devices(input, memory) {
        forget(input, edge, memory);
    }
}

/// Handles a write to the latch control registers, or to the register that assigns the inputs to master or processor. \[OURS]
/// An edge that is now in continuous mode is no longer shown as an event.
pub(super) fn control_written(memory: &mut Memory) {
    for input in 0..LATCHES {
        for edge in LatchEdge::ALL {
            if memory.u8(LATCH_CONTROL + input as u16) & edge.bit() == 0 {
                forget(input, edge, memory);
            }
        }
    }
    show_events(memory);
}

fn forget(input: usize, edge: LatchEdge, memory: &mut Memory) {
    let without = status(input, memory).without(LatchStatus(edge.bit()));
    memory.set_u8(LATCH_STATUS + input as u16, without.0);
    show_events(memory);
}

/// Updates the event registers of the master and of the slave's processor: whether a captured edge is waiting to be read.
fn show_events(memory: &mut Memory) {
    let waits = |of_device: bool, memory: &Memory| {
        let mine = (0..LATCHES).filter(|input| is_devices(*input, memory) == of_device);
        mine.into_iter()
            .any(|input| LatchEdge::ALL.iter().any(|edge| status(input, memory).contains(LatchStatus(edge.bit()))))
    };
    let others = EcatEvents(memory.u16(ECAT_EVENT)).without(EcatEvents::DC_LATCH);
    let event = if waits(false, memory) { EcatEvents::DC_LATCH } else { EcatEvents::NONE };
    memory.set_u16(ECAT_EVENT, (others | event).0);
    let others = AlEvents(memory.u32(AL_EVENT)).without(AlEvents::DC_LATCH);
    let event = if waits(true, memory) { AlEvents::DC_LATCH } else { AlEvents::NONE };
    memory.set_u32(AL_EVENT, (others | event).0);
}
