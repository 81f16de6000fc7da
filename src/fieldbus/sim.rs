//! A network of simulated slaves; the runner of the engine decides when a cycle runs.
//!
//! A cycle is one [`Fieldbus::poll`] at a later time than the previous poll. The frame passes every slave and returns
//! the inputs as of the end of the previous cycle. Then each slave is simulated for the time since the previous poll.
//!
//! **Working counter.** It counts as for one LRW over the whole process image: 3 for a slave in OP (2 for its outputs, 1
//! for its inputs), 1 for a slave in SafeOP, and 0 for every other slave.
//!
//! **Lost slaves** \[OURS]. A slave in SafeOP or OP is lost when it does not answer a cycle: the cable before it is cut,
//! it is silent, or it has left its state by itself. Its inputs keep their values. It stays lost, even if it could answer
//! again, until a [`Job::State`] brings it back. A slave in Init or PreOP is lost only while it does not answer.
//!
//! **A cut before the first slave** takes the bus down: [`Fieldbus::room`] is 0 and [`Fieldbus::poll`] returns `None`. Time
//! goes on passing in the slaves.
//!
//! The bus allocates when it is created, never in a cycle.

mod configure;
mod jobs;
mod timing;

pub use crate::slave::handle::{Shafts, SimHandle};
pub use configure::configure;
pub use timing::Timing;

use super::pdo::{IMAGE_BYTES_MAX, ProcessData};
use super::{
    AlState, BusError, Busy, Cleared, CycleDone, Fieldbus, Inputs, Job, JobDone, MAX_SLAVES, Ns, Outputs, Pacing,
    SdoDone, SdoRequest, SlaveSet,
};
use crate::slave::{Slave, step_all};
use jobs::{RunningJob, RunningSdo};

/// A slave on the cable, and what the bus knows of it.
struct Station {
    slave: Box<dyn Slave>,
    /// The AL state that the newest job brought the slave to. The slave may have left it by itself.
    commanded: AlState,
    /// The mapped process data; `None`: none are mapped.
    process_data: Option<ProcessData>,
}

/// A bus with simulated slaves.
pub struct SimBus {
    /// The simulated slaves in the order of the cable.
    stations: Vec<Station>,
    timing: Timing,
    handle: SimHandle,
    found: u8,
    lost: SlaveSet,
    outputs: Outputs,
    /// Whether `outputs` are new: no frame has carried them yet.
    has_new_outputs: bool,
    /// The id of the newest outputs that a frame has carried.
    sent: Option<u64>,
    /// The time up to which the slaves have been simulated.
    clock: Ns,
    job: Option<Box<RunningJob>>,
    /// The memory for the next job. A job is large, and the thread that polls it may be one of the program with a small
    /// stack: so it is on the heap, in memory that is allocated once.
    spare_job: Option<Box<RunningJob>>,
    sdo: Option<RunningSdo>,
}

impl SimBus {
    /// A network of these slaves in the order of the cable, switched on at time 0. A scan finds at most the first 40
    /// slaves.
    pub fn new(slaves: Vec<Box<dyn Slave>>) -> Self {
        let stations =
            slaves.into_iter().map(|slave| Station { slave, commanded: AlState::Init, process_data: None }).collect();
        let mut bus = Self {
            stations,
            timing: Timing::default(),
            handle: SimHandle::default(),
            found: 0,
            lost: SlaveSet::EMPTY,
            outputs: Outputs::default(),
            has_new_outputs: false,
            sent: None,
            clock: 0,
            job: None,
            spare_job: Some(Box::new(RunningJob::IDLE)),
            sdo: None,
        };
        bus.publish_shafts();
        bus
    }

    /// Replaces the durations of the jobs.
    pub fn with_timing(mut self, timing: Timing) -> Self {
        self.timing = timing;
        self
    }

    /// The handle with which scripts and tests control the network while it runs, from any thread.
    pub fn handle(&self) -> SimHandle {
        self.handle.clone()
    }

    /// The slaves in the order of the cable, and the handle, for a caller that builds another kind of simulated network
    /// from them.
    pub fn into_parts(self) -> (Vec<Box<dyn Slave>>, SimHandle) {
        (self.stations.into_iter().map(|station| station.slave).collect(), self.handle)
    }

    /// Whether frames reach a slave (from 1) and the slave answers them.
    fn answers(&self, slave: u8) -> bool {
        self.handle.answering().contains(slave)
    }

    fn is_down(&self) -> bool {
        self.handle.reach() == 0
    }

    fn station(&mut self, slave: u8) -> &mut Station {
        &mut self.stations[usize::from(slave) - 1]
    }

    /// The AL state in which a slave (from 1) is, whatever state was commanded.
    fn state(&self, slave: u8) -> AlState {
        self.stations[usize::from(slave) - 1].slave.state()
    }

    /// Updates the set of lost slaves by the rules in the module documentation.
    fn update_lost(&mut self) {
        let answering = self.handle.answering();
        for (slave, Station { slave: device, commanded, .. }) in (1..).zip(&self.stations[..usize::from(self.found)]) {
            if !answering.contains(slave) || device.state() < *commanded {
                self.lost.insert(slave);
            } else if *commanded < AlState::SafeOp {
                self.lost.remove(slave);
            }
        }
    }

    /// Runs one cycle: a frame passes every slave.
    fn exchange(&mut self, inputs: &mut Inputs) -> CycleDone {
        let (mut working_counter, mut expected_working_counter) = (0, 0);
        let (mut without_outputs, mut without_inputs) = (SlaveSet::EMPTY, SlaveSet::EMPTY);
        let images = self.outputs.slaves.iter().zip(&mut inputs.slaves);
        // A scan exchanges no process data: after SW_RESET no slave gets outputs, even if it was in OP before.
        let has_cycles = !self.job.as_ref().is_some_and(|running| matches!(running.job, Job::Scan));
        let stations = &mut self.stations[..if has_cycles { usize::from(self.found) } else { 0 }];
        let (mut output_image, mut input_image) = ([0; IMAGE_BYTES_MAX], [0; IMAGE_BYTES_MAX]);
        for (slave, (station, (outputs, inputs))) in (1..).zip(stations.iter_mut().zip(images)) {
            let (in_op, count) = match station.commanded {
                AlState::Op => (true, 3),
                AlState::SafeOp => {
                    without_outputs.insert(slave);
                    (false, 1)
                }
                AlState::Init | AlState::PreOp => {
                    without_outputs.insert(slave);
                    without_inputs.insert(slave);
                    continue;
                }
            };
            expected_working_counter += count;
            if !self.lost.contains(slave) {
                if let Some(process_data) = &station.process_data {
                    let sent = in_op.then(|| process_data.put_outputs(outputs, &mut output_image));
                    let answer = &mut input_image[..process_data.input_bytes()];
                    station.slave.exchange(sent, answer);
                    process_data.take_inputs(answer, inputs);
                }
                working_counter += count;
            }
        }
        (inputs.lost, inputs.without_outputs, inputs.without_inputs) = (self.lost, without_outputs, without_inputs);
        let outputs = std::mem::take(&mut self.has_new_outputs).then_some(self.outputs.id);
        self.sent = outputs.or(self.sent);
        CycleDone {
            at: self.clock,
            outputs,
            outputs_lost: 0,
            answers_lost: 0,
            working_counter,
            expected_working_counter,
            next_deadline: None,
        }
    }

    /// Restarts the slaves whose power scripts or tests have switched off: they begin in Init again.
    fn power_off(&mut self) {
        for slave in self.handle.take_powered_off().iter() {
            if let Some(station) = self.stations.get_mut(usize::from(slave) - 1) {
                station.slave.restart();
            }
        }
    }

    fn apply_faults(&mut self) {
        let stations = &mut self.stations;
        self.handle.take_faults(|slave, fault| {
            if let Some(station) = stations.get_mut(usize::from(slave).wrapping_sub(1)) {
                station.slave.apply_fault(fault);
            }
        });
    }

    fn publish_shafts(&mut self) {
        let shafts = self.stations.iter().map(|station| station.slave.shafts());
        self.handle.publish(self.clock, shafts.take(MAX_SLAVES));
    }
}

impl Fieldbus for SimBus {
    fn pacing(&self) -> Pacing {
        Pacing::Runner
    }

    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy> {
        if self.job.is_some() || self.sdo.is_some() && !matches!(job, Job::State { .. }) {
            return Err(Busy);
        }
        let mut running = self.spare_job.take().unwrap_or_else(|| Box::new(RunningJob::IDLE));
        *running = self.begin(job, now);
        self.job = Some(running);
        Ok(())
    }

    fn start_sdo(&mut self, request: SdoRequest, now: Ns) -> Result<(), Busy> {
        if self.sdo.is_some() || self.job.as_ref().is_some_and(|running| !matches!(running.job, Job::State { .. })) {
            return Err(Busy);
        }
        self.sdo = Some(self.begin_sdo(request, now));
        Ok(())
    }

    fn poll_sdo(&mut self, now: Ns) -> Option<SdoDone> {
        let sdo = self.sdo.take()?;
        let done = self.end_of_sdo(&sdo, now);
        self.sdo = done.is_none().then_some(sdo);
        done
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        let mut job = self.job.take()?;
        let done = self.advance(&mut job, now);
        if done.is_some() {
            self.spare_job = Some(job);
        } else {
            self.job = Some(job);
        }
        done
    }

    fn cancel_job(&mut self) {
        self.spare_job = self.job.take().or(self.spare_job.take());
    }

    fn cancel_sdo(&mut self) {
        self.sdo = None;
    }

    fn room(&self) -> u16 {
        u16::from(!self.has_new_outputs && !self.is_down())
    }

    fn clear_ahead(&mut self, _now: Ns) {
        self.has_new_outputs = false;
    }

    fn poll_clear(&mut self, _now: Ns) -> Option<Cleared> {
        Some(Cleared { newest_sent: self.sent })
    }

    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError> {
        if self.is_down() {
            return Err(BusError::Down);
        }
        if self.has_new_outputs {
            return Err(BusError::Full);
        }
        self.outputs.clone_from(outputs);
        self.has_new_outputs = true;
        Ok(())
    }

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        let dt_ns = now.checked_sub(self.clock).filter(|dt_ns| *dt_ns > 0)?;
        self.clock = now;
        self.power_off();
        self.update_lost();
        let done = (!self.is_down()).then(|| self.exchange(inputs));
        self.apply_faults();
        step_all(&mut self.stations, |station| &mut *station.slave, dt_ns);
        self.publish_shafts();
        done
    }

    fn reference_clock(&self) -> Option<u8> {
        let stations = self.stations.iter().take(self.found.into());
        stations.zip(1..).find(|(station, _)| station.slave.has_dc()).map(|(_, slave)| slave)
    }
}
