//! The row `stall`: a PC that stalls while axes move.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use ecmsk::fieldbus::sim::SimHandle;
use ecmsk::fieldbus::xf::{XfBus, XfBusOptions};
use ecmsk::fieldbus::{
    BusError, Busy, Cleared, CycleDone, Fieldbus, Inputs, Job, JobDone, Ns, Outputs, Pacing, SdoDone, SdoRequest,
};
use ecmsk::sk::SlotSize;
use ecmsk::xf::DataSize;
use ecmsk::xf::chip::SlaveModels;
use ecmsk::xf::host::{HostConfig, Wires};
use support::chip_line::{ChipLine, xf_bus_with};

use crate::drives;
use crate::judge;
use crate::machine::{Behind, Machine};
use crate::tap::Log;

/// Small packets, as in the manuals.
pub const SMALL: Option<DataSize> = Some(DataSize::MANUAL);
/// The packet size newer chips start with, if a link requests it.
pub const LARGE: Option<DataSize> = Some(DataSize::NEWER);

/// A bus whose chip goes on while the PC, including the board's model, stalls.
pub struct Stalling {
    inner: XfBus<ChipLine<SlaveModels>>,
    /// Time of stalls, which the board's own time does not include.
    stood: Arc<AtomicU64>,
    seen: Ns,
    told_at: Ns,
}

impl Stalling {
    /// The time of the bus. A stall since the last call has ended now.
    fn time(&mut self, now: Ns) -> Ns {
        let stood = self.stood.load(Ordering::Relaxed);
        let stall = stood - std::mem::replace(&mut self.seen, stood);
        if stall > 0 {
            let mut wires = self.inner.wires_mut();
            let until = wires.now() + stall;
            let Ok(()) = wires.wait_until(until);
        }
        now + stood
    }
}

impl Fieldbus for Stalling {
    fn pacing(&self) -> Pacing {
        self.inner.pacing()
    }

    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy> {
        let time = self.time(now);
        self.inner.start(job, time)
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        let time = self.time(now);
        self.inner.poll_job(time)
    }

    fn start_sdo(&mut self, request: SdoRequest, now: Ns) -> Result<(), Busy> {
        let time = self.time(now);
        self.inner.start_sdo(request, time)
    }

    fn poll_sdo(&mut self, now: Ns) -> Option<SdoDone> {
        let time = self.time(now);
        self.inner.poll_sdo(time)
    }

    fn cancel_job(&mut self) {
        self.inner.cancel_job();
    }

    fn cancel_sdo(&mut self) {
        self.inner.cancel_sdo();
    }

    fn room(&self) -> u16 {
        self.inner.room()
    }

    fn clear_ahead(&mut self, now: Ns) {
        let time = self.time(now);
        self.inner.clear_ahead(time);
    }

    fn poll_clear(&mut self, now: Ns) -> Option<Cleared> {
        let time = self.time(now);
        self.inner.poll_clear(time)
    }

    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError> {
        self.inner.push(outputs)
    }

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        let time = self.time(now);
        let done = self.inner.poll(time, inputs)?;
        let at = done.at.saturating_sub(self.stood.load(Ordering::Relaxed)).max(self.told_at + 1).min(now);
        self.told_at = at;
        Some(CycleDone { at, ..done })
    }
}

/// A machine behind a chip with packets of that size, or of the default size, and a counter to which the nanoseconds of
/// a stall are added.
pub fn machine(ahead: u16, drives: usize, wanted_size: Option<DataSize>) -> (Machine, Arc<AtomicU64>) {
    let (stood, log, network) = (Arc::new(AtomicU64::new(0)), Log::default(), SimHandle::default());
    let options = XfBusOptions { ahead, ..XfBusOptions::DEFAULT };
    let config = HostConfig { wanted_size, ..HostConfig::DEFAULT };
    let inner = xf_bus_with(log.tapped(drives::models(drives)), network.clone(), config, options);
    let bus = Stalling { inner, stood: stood.clone(), seen: 0, told_at: 0 };
    let mut machine = Machine::over(SlotSize::Bytes12, Box::new(bus), network, log);
    machine.drives_in_op(drives, 1000);
    (machine, stood)
}

/// The longest stall, in cycles of 1 ms, in which moving axes do not stop.
fn bridged(ahead: u16, drives: usize, size: Option<DataSize>) -> u64 {
    drives::most(63, |cycles| {
        let (mut machine, stood) = machine(ahead, drives, size);
        drives::switch_on(&mut machine, drives);
        drives::fill(&mut machine, 1..=drives, 1, 140);
        machine.read_some(40);
        stood.fetch_add(cycles * 1_000_000, Ordering::Relaxed);
        machine.settle();
        judge::repeats(&machine.log.take(), 1, 0).is_empty()
    })
}

/// XF-20.3 On a board the FIFO bridges a stall of the PC; with slaves behind a chip, the chip's FIFO does: `ahead=`
/// cycles, or as many as it holds.
#[test]
fn what_lies_in_the_chip_bridges_a_stall() {
    let mut board = drives::on(Behind::Board, 2);
    drives::fill(&mut board, 1..=2, 1, 140);
    board.read_some(20).sleep(Duration::from_millis(100)).settle();
    assert_eq!(judge::repeats(&board.log.take(), 1, 0), [0; 0]);
    for (ahead, drives, size, least) in [
        (1, 2, None, 1),
        (4, 2, None, 4),
        (4, 2, SMALL, 4),
        (4, 40, None, 4),
        (20, 2, None, 20),
        (60, 2, None, 54),
        (60, 2, LARGE, 54),
        (60, 40, None, 18),
    ] {
        let cycles = bridged(ahead, drives, size);
        assert!((least..=u64::from(ahead) + 3).contains(&cycles), "ahead {ahead}, {drives} drives: {cycles}");
    }
}
