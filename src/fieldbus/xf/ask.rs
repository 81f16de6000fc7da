//! The chip commands that the async functions of a job submit one at a time. The answer to each is a number.

use crate::ethercat::coe::{ObjectAddress, SdoScope, SdoSize};
use crate::ethercat::{AlState, Ns};
use crate::fieldbus::pdo::MappingImage;
use crate::xf::host::{Host, HostError, Ticket};
use crate::xf::request::{
    ConfigMap, DcSync, DcTiming, EcatInit, FifoClear, FifoEnable, FifoInit, FifoSetRxCount, FifoSetTxCount, Fifos,
    GpioMode, GpioPull, GpioSetMode, InitDc, Reconfig, ReferenceClock, SdoGet, SdoOperation, SdoRequest, SlaveCountGet,
    SlaveInfoGet, SlaveInfoItem, SlaveNumber, Slaves, StateGet, StateSet, StateUpdate,
};

/// The timeout for the command that initialises the network, ns. \[OURS]
const INIT_NS: Ns = 30_000_000_000;
/// The timeout for any other command that waits for slaves, ns. \[OURS]
const COMMAND_NS: Ns = 10_000_000_000;

/// The number of bytes that are requested of a mapping object: enough for 15 entries, more than are compared. The
/// driver of a chip may report an error if the object is longer than the requested number of bytes. \[OURS]
const COMPARED_BYTES: u16 = 64;

/// A command to the chip. Slaves count from 1 here, as in the whole project; in the chip they count from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ask {
    Fifo {
        on: bool,
    },
    Clear(Fifos),
    Init {
        sync0_ns: u32,
    },
    /// Sets whether one slave gets SYNC0, from the next [`Self::InitDc`] on.
    DcSync {
        slave: u8,
        sync0_ns: u32,
        is_active: bool,
    },
    InitDc,
    Count,
    /// Brings one slave to a state; `None`: all slaves.
    Enter(Option<u8>, AlState),
    UpdateStates,
    /// Reads the lowest AL state of all slaves, as of the newest [`Self::UpdateStates`].
    StateOfAll,
    StateOf(u8),
    Info(u8, SlaveInfoItem),
    Upload {
        slave: u8,
        object: ObjectAddress,
        timeout_ns: Ns,
    },
    Download {
        slave: u8,
        object: ObjectAddress,
        size: SdoSize,
        value: u32,
        timeout_ns: Ns,
    },
    /// Reads a mapping object with complete access. The answer is 1 if it has the wanted content, otherwise 0.
    Compare {
        slave: u8,
        image: MappingImage,
        timeout_ns: Ns,
    },
    /// Reads the mapping of a PDO with complete access. The answer is the length of its entries in bits; 0 if the upload is
    /// incomplete.
    MappedBits {
        slave: u8,
        pdo: u16,
        timeout_ns: Ns,
    },
    /// Lays out the process data in the chip's process image.
    Reconfig,
    /// Lays out the process data like [`Self::Reconfig`]. Used if a slave falls back to its default process data with
    /// that command (XF ZH 410).
    ConfigMap,
    /// Makes those GPIO pins of the chip outputs whose bits are set: bit k is pin k.
    OutputPins(u16),
    RxEntries(u8),
    TxEntries(u8),
    BuildFifos,
}

/// The answer to a command of the chip: a number, or why there is none.
pub(super) type Reply = Result<u32, HostError>;

/// A command that was submitted to the driver and whose answer is awaited.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    ask: Ask,
    ticket: Ticket,
}

/// The chip's number for a slave. If the slave's number is too high for the chip, the result is the highest number,
/// which no slave has, so the command fails.
fn number(slave: u8) -> SlaveNumber {
    SlaveNumber::new(slave.saturating_sub(1)).unwrap_or(SlaveNumber::MAX)
}

fn to_us(ns: Ns) -> u32 {
    u32::try_from(ns / 1000).unwrap_or(u32::MAX).max(1)
}

impl Ask {
    /// Submits the command to the driver.
    ///
    /// # Errors
    /// The queue is full, or the driver has stopped.
    pub(super) fn submit(self, host: &mut Host, now: Ns) -> Result<Asked, HostError> {
        let ticket = match self {
            Self::Fifo { on } => host.submit(now, &FifoEnable { on }),
            Self::Clear(fifos) => host.submit(now, &FifoClear { fifos }),
            Self::Init { sync0_ns } => host.submit_within(now, &init(sync0_ns), INIT_NS),
            Self::DcSync { slave, sync0_ns, is_active } => {
                host.submit_within(now, &dc_sync(slave, sync0_ns, is_active), COMMAND_NS)
            }
            Self::InitDc => host.submit_within(now, &InitDc, COMMAND_NS),
            Self::Count => host.submit(now, &SlaveCountGet),
            Self::Enter(slave, state) => host.submit_within(now, &enter(slave, state), COMMAND_NS),
            Self::UpdateStates => host.submit_within(now, &StateUpdate, COMMAND_NS),
            Self::StateOfAll => host.submit(now, &StateGet { slaves: Slaves::All }),
            Self::StateOf(slave) => host.submit(now, &state_of(slave)),
            Self::Info(slave, item) => host.submit(now, &SlaveInfoGet { slave: number(slave), item }),
            Self::Upload { slave, object, timeout_ns } => {
                let request = sdo(slave, object, timeout_ns, SdoOperation::Read { bytes: 4 });
                host.submit_pair(now, &request, &SdoGet, timeout_ns.saturating_add(COMMAND_NS))
            }
            Self::Compare { slave, image, timeout_ns } => {
                let request = whole(slave, image.object(), timeout_ns);
                host.submit_pair(now, &request, &SdoGet, timeout_ns.saturating_add(COMMAND_NS))
            }
            Self::MappedBits { slave, pdo, timeout_ns } => {
                let request = whole(slave, ObjectAddress::new(pdo, 0), timeout_ns);
                host.submit_pair(now, &request, &SdoGet, timeout_ns.saturating_add(COMMAND_NS))
            }
            Self::Download { slave, object, size, value, timeout_ns } => {
                let bytes = value.to_le_bytes();
                let request = sdo(slave, object, timeout_ns, SdoOperation::Write(&bytes[..size.bytes().into()]));
                host.submit_within(now, &request, timeout_ns.saturating_add(COMMAND_NS))
            }
            Self::Reconfig => host.submit_within(now, &Reconfig, COMMAND_NS),
            Self::ConfigMap => host.submit_within(now, &ConfigMap, COMMAND_NS),
            Self::OutputPins(pins) => host.submit(now, &output_pins(pins)),
            Self::RxEntries(entries) => host.submit(now, &FifoSetRxCount { entries }),
            Self::TxEntries(entries) => host.submit(now, &FifoSetTxCount { entries }),
            Self::BuildFifos => host.submit_within(now, &FifoInit, COMMAND_NS),
        }?;
        Ok(Asked { ask: self, ticket })
    }
}

/// The distributed-clock settings of a slave: the SYNC0 period, and whether SYNC0 is active.
const fn timing(sync0_ns: u32, is_active: bool) -> DcTiming {
    let assign_activate = if is_active { 0x0300 } else { 0 };
    DcTiming { assign_activate, sync0_ns, sync1_ns: 0, shift_ns: 0 }
}

fn dc_sync(slave: u8, sync0_ns: u32, is_active: bool) -> DcSync {
    DcSync { slaves: Slaves::One(number(slave)), dc: timing(sync0_ns, is_active) }
}

/// \[OURS] The chip's own clock is the reference clock: reserve bit 12 is 0. The two manuals contradict each other about the
/// meaning of that bit (XF EN 375, XF ZH 384), and older firmware does not know it, so the bus does not set it.
const fn init(sync0_ns: u32) -> EcatInit {
    let dc = timing(sync0_ns, true);
    EcatInit { special_slaves: false, reference_clock: ReferenceClock::Chip, lrw: true, fifo_on: false, dc }
}

const fn output_pins(pins: u16) -> GpioSetMode {
    GpioSetMode { pins, mode: GpioMode::Output, pull: GpioPull::None }
}

fn enter(slave: Option<u8>, state: AlState) -> StateSet {
    let slaves = slave.map_or(Slaves::All, |slave| Slaves::One(number(slave)));
    StateSet { slaves, state: state.into() }
}

fn state_of(slave: u8) -> StateGet {
    StateGet { slaves: Slaves::One(number(slave)) }
}

fn sdo(slave: u8, object: ObjectAddress, timeout_ns: Ns, operation: SdoOperation<'_>) -> SdoRequest<'_> {
    let timeout_us = to_us(timeout_ns);
    SdoRequest { slave: number(slave), object, scope: SdoScope::Entry, timeout_us, operation }
}

/// The request that reads a mapping object with complete access.
fn whole(slave: u8, object: ObjectAddress, timeout_ns: Ns) -> SdoRequest<'static> {
    let read = SdoOperation::Read { bytes: COMPARED_BYTES };
    SdoRequest { scope: SdoScope::Complete, ..sdo(slave, object, timeout_ns, read) }
}

/// The sum of the lengths of a PDO's entries, bits. The lowest byte of an entry is its length (ETG.1000.6).
fn mapped_bits(upload: &[u8]) -> u32 {
    let Some((&count, [_, entries @ ..])) = upload.split_first() else { return 0 };
    let mut bits = entries.chunks_exact(4).map(|entry| u32::from(entry[0]));
    if bits.len() < count.into() { 0 } else { bits.by_ref().take(count.into()).sum() }
}

impl Asked {
    /// The answer to the command; `None`: it has not come yet.
    pub(super) fn reply(&self, host: &mut Host) -> Option<Reply> {
        let Self { ask, ticket } = *self;
        let done = |unit: Result<(), HostError>| unit.map(|()| 0);
        Some(match ask {
            Ask::Fifo { on } => done(host.take(ticket, &FifoEnable { on })?),
            Ask::Clear(fifos) => done(host.take(ticket, &FifoClear { fifos })?),
            Ask::Init { sync0_ns } => done(host.take(ticket, &init(sync0_ns))?),
            Ask::DcSync { slave, sync0_ns, is_active } => {
                done(host.take(ticket, &dc_sync(slave, sync0_ns, is_active))?)
            }
            Ask::InitDc => done(host.take(ticket, &InitDc)?),
            Ask::Count => host.take(ticket, &SlaveCountGet)?.map(u32::from),
            Ask::Enter(slave, state) => done(host.take(ticket, &enter(slave, state))?),
            Ask::UpdateStates => done(host.take(ticket, &StateUpdate)?),
            Ask::StateOfAll => host.take(ticket, &StateGet { slaves: Slaves::All })?.map(|state| state.0.into()),
            Ask::StateOf(slave) => host.take(ticket, &state_of(slave))?.map(|state| state.0.into()),
            Ask::Info(slave, item) => {
                let info = host.take(ticket, &SlaveInfoGet { slave: number(slave), item })?;
                info.map(|info| info.number().unwrap_or(0))
            }
            Ask::Upload { .. } => host.take(ticket, &SdoGet)?.map(little_endian),
            Ask::Compare { image, .. } => host.take(ticket, &SdoGet)?.map(|bytes| image.is_shown_by(bytes).into()),
            Ask::MappedBits { .. } => host.take(ticket, &SdoGet)?.map(mapped_bits),
            Ask::Download { slave, object, size, value, timeout_ns } => {
                let bytes = value.to_le_bytes();
                let request = sdo(slave, object, timeout_ns, SdoOperation::Write(&bytes[..size.bytes().into()]));
                done(host.take(ticket, &request)?)
            }
            Ask::Reconfig => done(host.take(ticket, &Reconfig)?),
            Ask::ConfigMap => done(host.take(ticket, &ConfigMap)?),
            Ask::OutputPins(pins) => done(host.take(ticket, &output_pins(pins))?),
            Ask::RxEntries(entries) => done(host.take(ticket, &FifoSetRxCount { entries })?),
            Ask::TxEntries(entries) => done(host.take(ticket, &FifoSetTxCount { entries })?),
            Ask::BuildFifos => done(host.take(ticket, &FifoInit)?),
        })
    }

    /// Drops the command: its answer will be ignored.
    pub(super) fn abandon(self, host: &mut Host) {
        host.abandon(self.ticket);
    }
}

/// The first 4 bytes of a value as a little-endian number. Missing bytes count as 0.
fn little_endian(bytes: &[u8]) -> u32 {
    let mut word = [0; 4];
    let len = bytes.len().min(4);
    word[..len].copy_from_slice(&bytes[..len]);
    u32::from_le_bytes(word)
}
