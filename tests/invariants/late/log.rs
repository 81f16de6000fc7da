//! The events at the seam between the engine and a bus that takes outputs ahead, and on the wire behind that bus, in
//! their order.

use std::sync::{Arc, Mutex};

use ecmsk::cia402::{MODES_OF_OPERATION, SECOND_AXIS_OFFSET};
use ecmsk::coe::ObjectAddress;
use ecmsk::fieldbus::sim::SimHandle;
use ecmsk::fieldbus::{
    AlState, BusError, Busy, Cleared, CycleDone, Fieldbus, Inputs, Job, JobDone, MAX_AXES, Ns, Outputs, SdoDone,
    SdoRequest, SlaveIn, SlaveOut, SlaveSet,
};

use support::hand_on;

/// The most slaves of a machine.
pub const SLAVES: usize = 8;

/// A cycle of the bus on the wire.
#[derive(Clone, Debug)]
pub struct Cycle {
    pub at: Ns,
    pub dt_ns: Ns,
    /// The outputs that it carried, new ones or those of the cycle before; `None`: no slave was in OP, or the cable was
    /// cut.
    pub outputs: Option<(u64, [SlaveOut; SLAVES])>,
    /// Slaves that have not got them: those that did not answer, and those that were not in OP.
    pub lost: SlaveSet,
    pub without_outputs: SlaveSet,
    pub inputs: [SlaveIn; SLAVES],
    /// The positions of the shafts when the slaves measured these inputs, and those after the cycle.
    pub measured: [[Option<i64>; MAX_AXES]; SLAVES],
    pub shafts: [[Option<i64>; MAX_AXES]; SLAVES],
}

/// An event.
#[derive(Clone, Debug)]
pub enum Event {
    /// A cycle has passed on the wire.
    Passed(Arc<Cycle>),
    /// The engine has passed outputs to the bus.
    Pushed { id: u64, outputs: Box<[SlaveOut; SLAVES]> },
    /// The engine has taken the answer of the cycle at that time; it names these slaves as lost.
    Answered { at: Ns, lost: SlaveSet },
    /// A clear has ended.
    Cleared { newest_sent: Option<u64> },
    /// 0x6060 of a slave's axis has that value, as the board knows.
    Mode { slave: u8, axis: usize, mode: u8 },
    /// Slaves are in OP.
    Op,
}

/// The events that were not processed yet.
pub type Log = Arc<Mutex<Vec<Event>>>;

fn note(log: &Log, event: Event) {
    log.lock().expect("no panic").push(event);
}

fn first<T: Copy>(all: &[T]) -> [T; SLAVES] {
    all[..SLAVES].try_into().expect("there are more")
}

/// The wire: a simulated network whose cycles are recorded.
pub struct Wire<B> {
    bus: B,
    network: SimHandle,
    log: Log,
    sent: Option<(u64, [SlaveOut; SLAVES])>,
    clock: Ns,
}

impl<B> Wire<B> {
    pub fn new(bus: B, network: SimHandle, log: Log) -> Self {
        Self { bus, network, log, sent: None, clock: 0 }
    }
}

impl<B: Fieldbus> Fieldbus for Wire<B> {
    hand_on!(bus: pacing, start, start_sdo, poll_job, poll_sdo, cancel_job, cancel_sdo, room, clear_ahead, poll_clear);

    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError> {
        self.bus.push(outputs)?;
        self.sent = Some((outputs.id, first(&outputs.slaves)));
        Ok(())
    }

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        let measured = first(&self.network.shafts().positions);
        let done = self.bus.poll(now, inputs);
        let cycle = Cycle {
            at: now,
            dt_ns: now - self.clock,
            outputs: self.sent.take().filter(|_| done.is_some()),
            lost: inputs.lost,
            without_outputs: inputs.without_outputs,
            inputs: first(&inputs.slaves),
            measured,
            shafts: first(&self.network.shafts().positions),
        };
        self.clock = now;
        note(&self.log, Event::Passed(Arc::new(cycle)));
        done
    }
}

/// The seam: a bus that takes outputs ahead, as the engine sees it.
pub struct Seam<B> {
    bus: B,
    log: Log,
    /// The write of a mode that is under way.
    mode: Option<(u8, usize)>,
    job: Option<Job>,
}

impl<B> Seam<B> {
    pub fn new(bus: B, log: Log) -> Self {
        Self { bus, log, mode: None, job: None }
    }
}

/// The axis whose mode of operation that object is.
fn mode_object(object: ObjectAddress) -> Option<usize> {
    (0..MAX_AXES).find(|axis| object == ObjectAddress::new(MODES_OF_OPERATION + SECOND_AXIS_OFFSET * *axis as u16, 0))
}

impl<B: Fieldbus> Fieldbus for Seam<B> {
    hand_on!(bus: pacing, room, clear_ahead);

    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy> {
        self.bus.start(job, now)?;
        self.job = Some(job);
        Ok(())
    }

    fn start_sdo(&mut self, request: SdoRequest, now: Ns) -> Result<(), Busy> {
        self.bus.start_sdo(request, now)?;
        self.mode = request.write.and(mode_object(request.object)).map(|axis| (request.slave, axis));
        Ok(())
    }

    fn poll_sdo(&mut self, now: Ns) -> Option<SdoDone> {
        let result = self.bus.poll_sdo(now)?;
        if let (Some((slave, axis)), Ok(mode)) = (self.mode.take(), result) {
            note(&self.log, Event::Mode { slave, axis, mode: mode as u8 });
        }
        Some(result)
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        let done = self.bus.poll_job(now)?;
        match (done, self.job) {
            (JobDone::Configure(Ok(_)), Some(Job::Configure(config))) => {
                for slave in config.selected.iter().filter(|slave| usize::from(*slave) <= SLAVES) {
                    let Some(mode) = config.slaves[usize::from(slave) - 1].role.mode() else { continue };
                    for axis in 0..MAX_AXES {
                        note(&self.log, Event::Mode { slave, axis, mode: mode.code() });
                    }
                }
            }
            (JobDone::State(Ok(())), Some(Job::State { target: AlState::Op, .. })) => note(&self.log, Event::Op),
            _ => {}
        }
        self.job = None;
        Some(done)
    }

    fn cancel_job(&mut self) {
        self.job = None;
        self.bus.cancel_job();
    }

    fn cancel_sdo(&mut self) {
        self.mode = None;
        self.bus.cancel_sdo();
    }

    fn poll_clear(&mut self, now: Ns) -> Option<Cleared> {
        let cleared = self.bus.poll_clear(now)?;
        note(&self.log, Event::Cleared { newest_sent: cleared.newest_sent });
        Some(cleared)
    }

    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError> {
        self.bus.push(outputs)?;
        note(&self.log, Event::Pushed { id: outputs.id, outputs: Box::new(first(&outputs.slaves)) });
        Ok(())
    }

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        let done = self.bus.poll(now, inputs)?;
        note(&self.log, Event::Answered { at: done.at, lost: inputs.lost });
        Some(done)
    }
}
