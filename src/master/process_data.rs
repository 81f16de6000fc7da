//! Process data: the logical addresses of each slave's outputs and inputs, and the frames of a cycle.
//!
//! The outputs and inputs of slaves are placed one after the other in one LRW, as many as its datagram has room for.
//! Slaves without LRW share an LWR and an LRD. The data of a slave are never split, so that one working counter covers
//! them. An outgoing frame contains the newest inputs of each slave, so that the inputs of a slave that does not answer
//! come back unchanged.
//!
//! **A working counter is right** if it is the sum of what the certain participants add, plus an amount that the other
//! slaves together may add. The other slaves are those that are lost, that are changing their state, or whose inputs
//! are known not to come ([`Standing`]). The inputs of a datagram with any other working counter are ignored, whether
//! it is too low or too high.

mod expected;
mod segment;
mod slave;

use std::ops::Range;
use std::sync::Arc;

use super::clock_tree::ClockDatagram;
use super::exchange::Exchange;
use super::shared::Standing;
use super::{SlaveInfo, SyncSignals, Wire};
use crate::ethercat::registers::{
    AL_STATUS, BufferMode, RequestedState, SYSTEM_TIME, SmActivate, SmControl, SyncManager,
};
use crate::ethercat::{Command, DATA_LEN_MAX, DATAGRAM_OVERHEAD, Datagram, Ns, SlaveSet};
use expected::Expected;
use segment::Segment;
pub(super) use slave::Registers;
use slave::{Place, SlaveData, bytes_of};

/// The most process data in one datagram, bytes: the first frame also carries the datagrams of the clock and of all AL
/// states.
pub const SEGMENT_BYTES_MAX: usize = DATA_LEN_MAX - (DATAGRAM_OVERHEAD + CLOCK_LEN) - (DATAGRAM_OVERHEAD + STATE_LEN);
const CLOCK_LEN: usize = 8;
const STATE_LEN: usize = 2;
/// The distance between the logical addresses of two process data datagrams: more than the bytes of one.
const SEGMENT_STEP: u32 = 0x800;
/// The numbers of the first two datagrams of a cycle: the one that distributes the reference time, and the one that
/// reads the AL status of all slaves. The datagrams with process data have the numbers after these.
const CLOCK: u8 = 0;
const STATES: u8 = 1;
const SEGMENTS: u8 = 2;
/// \[OURS] The most datagrams with process data of one cycle.
const SEGMENTS_MAX: usize = 64;
/// \[OURS] For how many datagrams with process data memory is allocated in advance.
const SEGMENTS_USUAL: usize = 4;
/// With LRW off, the outputs of a segment are in a second datagram (LWR). The number of the LWR is the number of the
/// first datagram plus this constant.
const WRITES: u8 = SEGMENTS_MAX as u8;

/// Why process data cannot be configured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConfigureError {
    /// There is no slave with that number.
    #[error("there is no slave {0}; the scan found fewer")]
    NoSlave(u8),
    /// The slave describes no sync manager for a direction that should have process data.
    #[error("slave {0} describes no sync manager for its process data in this direction")]
    NoManager(u8),
    /// The slave is in SafeOP or OP, where its process data cannot be changed.
    #[error("slave {0} exchanges process data; bring it to PreOP first")]
    Active(u8),
    /// The process data of the slave do not fit into a datagram.
    #[error("slave {slave} has {bytes} bytes of process data, and a datagram has room for {SEGMENT_BYTES_MAX}")]
    TooLong {
        /// Slave, from 1.
        slave: u8,
        /// Bytes of the slave's outputs and inputs together.
        bytes: usize,
    },
    /// The slave has fewer FMMUs than sync managers with process data.
    #[error("slave {slave} has {has} FMMUs and needs {needs}")]
    TooFewFmmus {
        /// Slave, from 1.
        slave: u8,
        /// The number of FMMUs that the slave needs: one for each sync manager with process data.
        needs: usize,
        /// The number of FMMUs that the slave has.
        has: u8,
    },
}

/// The result of a cycle whose frames have come back or were given up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CycleDone {
    /// The number of the cycle, from 1.
    pub number: u64,
    /// When the frames of the cycle were sent, ns of the master's clock.
    pub sent_at: Ns,
    /// The sum of the working counters of all datagrams with process data.
    pub working_counter: u16,
    /// The part of `working_counter` that comes from LWRs, if LRW is not used. Other masters count outputs twice in any
    /// case, as LRW does: their working counter is higher by this part.
    pub written: u16,
    /// The working counter if all slaves in SafeOP or OP take part.
    pub expected_working_counter: u16,
    /// The number of datagrams with process data that did not come back in time. With LRW off an LWR and its LRD count
    /// as one.
    pub lost: u8,
    /// The slaves with process data in a datagram that was lost or had a working counter below the expected one.
    /// [`Master::missing`](super::Master::missing) later names those that do not answer.
    pub short: SlaveSet,
    /// The slaves whose inputs are those of this cycle. All others keep their previous inputs, because their datagram
    /// was lost or had a wrong working counter.
    pub fresh: SlaveSet,
    /// The slaves with process data in a datagram whose working counter was wrong, too low or too high.
    pub doubtful: SlaveSet,
    /// The number of slaves that the first frame of the cycle has passed; `None`: it did not come back.
    pub present: Option<u16>,
    /// Whether all slaves are in OP without an error.
    pub all_in_op: bool,
    /// The AL status registers of all slaves that the first frame of the cycle has passed, combined by OR.
    pub states: u16,
    /// The time of the reference clock when the first frame of the cycle passed it, ns.
    pub reference_time: Option<u64>,
    /// When the next cycle should be sent to keep the pace, ns of the master's clock; `None`: no pace is set, or no
    /// reference clock has answered.
    pub next_deadline: Option<Ns>,
}

/// The process data of all slaves, and the state of the present cycle.
#[derive(Debug, Default)]
pub(super) struct ProcessData {
    slaves: Vec<SlaveData>,
    segments: Vec<Segment>,
    /// Preallocated buffers for segments that are added later.
    spare: Vec<Vec<u8>>,
    /// Whether an LWR and an LRD are sent in place of each LRW.
    is_lrw_off: bool,
    /// The states of the slaves for which the expected working counters were computed; `None`: the layout of the data
    /// has changed since.
    standing: Option<Standing>,
    /// The time that the clock datagram of the present cycle was sent with. If it comes back unchanged, no reference
    /// clock has written its time.
    sent_time: u64,
    cycle: CycleDone,
    /// The number of datagrams that have not come back yet.
    pending: usize,
    is_open: bool,
    done: Option<CycleDone>,
}

/// The sync manager with that length; a length of 0 disables it.
pub(super) const fn with_len(manager: SyncManager, len: u16) -> SyncManager {
    let activate = if len > 0 { SmActivate::ENABLE } else { SmActivate::NONE };
    SyncManager { len, activate, control: SmControl(manager.control.0), ..manager }
}

impl ProcessData {
    /// Resets everything for the slaves that a scan has found: they have no process data, and no cycle is open. Only
    /// the LRW setting is kept.
    pub(super) fn reset(&mut self, slaves: &[SlaveInfo]) {
        let (slaves, is_lrw_off) = (slaves.iter().map(SlaveData::of).collect(), self.is_lrw_off);
        *self = Self { slaves, is_lrw_off, ..Self::default() };
        self.segments.reserve(SEGMENTS_USUAL);
        self.spare.extend((0..SEGMENTS_USUAL).map(|_| Vec::with_capacity(SEGMENT_BYTES_MAX)));
    }

    /// Sets the sync managers of a slave. `active`: the slaves whose logical addresses must stay. Allocates nothing if
    /// nothing changes.
    pub(super) fn configure(
        &mut self,
        slave: u8,
        outputs: impl Iterator<Item = (u8, SyncManager)> + Clone,
        inputs: impl Iterator<Item = (u8, SyncManager)> + Clone,
        lacks_lrw: bool,
        active: SlaveSet,
    ) -> Result<(), ConfigureError> {
        let (output_bytes, input_bytes) = (bytes_of(outputs.clone()), bytes_of(inputs.clone()));
        let bytes = output_bytes + input_bytes;
        if bytes > SEGMENT_BYTES_MAX {
            return Err(ConfigureError::TooLong { slave, bytes });
        }
        let place = usize::from(slave).checked_sub(1).and_then(|n| self.slaves.get_mut(n));
        let data = place.ok_or(ConfigureError::NoSlave(slave))?;
        let is_same = data.output_place.range.len() == output_bytes
            && data.input_place.range.len() == input_bytes
            && data.lacks_lrw == lacks_lrw;
        if is_same && data.outputs.iter().copied().eq(outputs.clone()) && data.inputs.iter().copied().eq(inputs.clone())
        {
            return Ok(());
        }
        data.outputs.clear();
        data.outputs.extend(outputs);
        data.inputs.clear();
        data.inputs.extend(inputs);
        data.lacks_lrw = lacks_lrw;
        self.standing = None;
        if is_same {
            data.update_registers();
            return Ok(());
        }
        if active.is_empty() {
            self.spare.extend(self.segments.drain(..).map(|segment| segment.data));
            (1..=self.slaves.len() as u8).for_each(|slave| self.place(slave));
        } else {
            self.segments.iter_mut().for_each(|segment| segment.slaves.remove(slave));
            self.place(slave);
        }
        Ok(())
    }

    /// Assigns logical addresses to the data of a slave.
    fn place(&mut self, slave: u8) {
        let n = usize::from(slave) - 1;
        let SlaveData { outputs, inputs, lacks_lrw, .. } = &self.slaves[n];
        let (outputs, inputs, lacks_lrw) =
            (bytes_of(outputs.iter().copied()), bytes_of(inputs.iter().copied()), *lacks_lrw);
        let (output_place, input_place) = if lacks_lrw {
            (self.reserve(Command::Lwr, slave, outputs), self.reserve(Command::Lrd, slave, inputs))
        } else {
            let Place { segment, range: Range { start, .. } } = self.reserve(Command::Lrw, slave, outputs + inputs);
            let middle = start + outputs;
            (Place { segment, range: start..middle }, Place { segment, range: middle..middle + inputs })
        };
        let data = &mut self.slaves[n];
        (data.output_place, data.input_place) = (output_place, input_place);
        data.update_registers();
    }

    fn reserve(&mut self, command: Command, slave: u8, len: usize) -> Place {
        if len == 0 {
            return Place::default();
        }
        let fits = |segment: &Segment| segment.command == command && segment.data.len() + len <= SEGMENT_BYTES_MAX;
        let segment = self.segments.iter().position(fits).unwrap_or_else(|| {
            let mut data = self.spare.pop().unwrap_or_else(|| Vec::with_capacity(SEGMENT_BYTES_MAX));
            data.clear();
            self.segments.push(Segment::new(command, data));
            self.segments.len() - 1
        });
        let Segment { data, slaves, .. } = &mut self.segments[segment];
        let start = data.len();
        data.resize(start + len, 0);
        slaves.insert(slave);
        Place { segment, range: start..start + len }
    }

    fn slave(&self, slave: u8) -> Option<&SlaveData> {
        self.slaves.get(usize::from(slave).checked_sub(1)?)
    }

    /// The sync managers of a slave, and the FMMUs that map them; `None`: there is no such slave.
    pub(super) fn registers(&self, slave: u8) -> Option<Arc<Registers>> {
        self.slave(slave).map(|data| Arc::clone(&data.registers))
    }

    /// The SYNC signals that were set for a slave; `None`: none were set, or there is no such slave.
    pub(super) fn sync(&self, slave: u8) -> Option<SyncSignals> {
        self.slave(slave)?.sync
    }

    /// Sets the SYNC signals of a slave. Returns false if there is no slave with that number.
    pub(super) fn set_sync(&mut self, slave: u8, sync: Option<SyncSignals>) -> bool {
        let data = usize::from(slave).checked_sub(1).and_then(|n| self.slaves.get_mut(n));
        data.map(|data| data.sync = sync).is_some()
    }

    /// The outputs of a slave, which every cycle sends.
    pub(super) fn outputs_mut(&mut self, slave: u8) -> Option<&mut [u8]> {
        let Place { segment, range } = self.slave(slave)?.output_place.clone();
        if range.is_empty() {
            return Some(&mut []);
        }
        self.segments.get_mut(segment)?.data.get_mut(range)
    }

    /// The newest inputs of a slave.
    pub(super) fn inputs(&self, slave: u8) -> Option<&[u8]> {
        let Place { segment, range } = &self.slave(slave)?.input_place;
        if range.is_empty() {
            return Some(&[]);
        }
        self.segments.get(*segment)?.data.get(range.clone())
    }

    /// Whether the outputs and the inputs of a slave are in the datagram `segment`, each as 1 or 0.
    fn parts(&self, slave: u8, segment: usize) -> [u16; 2] {
        let Some(data) = self.slave(slave) else { return [0; 2] };
        [&data.output_place, &data.input_place]
            .map(|place| u16::from(!place.range.is_empty() && place.segment == segment))
    }

    /// What a slave adds to the working counter of a segment; with LRW off, to both datagrams of the segment together.
    fn counts(&self, slave: u8, segment: usize) -> u16 {
        let [outputs, inputs] = self.parts(slave, segment);
        let lacks_lrw = self.slave(slave).is_some_and(|data| data.lacks_lrw);
        if lacks_lrw || self.is_lrw_off { outputs + inputs } else { 2 * outputs + inputs }
    }

    /// Sets whether LRW is used.
    pub(super) const fn set_lrw(&mut self, is_used: bool) {
        if self.is_lrw_off == is_used {
            self.standing = None;
        }
        self.is_lrw_off = !is_used;
    }

    /// The logical address and length of a slave's inputs, bytes; `None`: it has no inputs that may be read outside the
    /// cycle.
    pub(super) fn inputs_at(&self, slave: u8) -> Option<(u32, usize)> {
        let SlaveData { inputs, input_place: Place { segment, range }, .. } = self.slave(slave)?;
        // Reading a sync manager in mailbox mode would take the data away from the cycle.
        let is_buffered = inputs.iter().all(|(_, manager)| manager.control.mode() == BufferMode::Buffered);
        let at = *segment as u32 * SEGMENT_STEP + range.start as u32;
        (is_buffered && !range.is_empty()).then_some((at, range.len()))
    }

    /// Computes the right working counters for the next cycles, if the participants have changed.
    fn expect(&mut self, standing: Standing) {
        if self.standing == Some(standing) {
            return;
        }
        self.standing = Some(standing);
        for n in 0..self.segments.len() {
            let Segment { command, slaves, .. } = self.segments[n];
            let is_split = self.is_lrw_off && command == Command::Lrw;
            let mut expected = [Expected::default(); 2];
            for slave in slaves.iter() {
                let [outputs, inputs] = self.parts(slave, n);
                if is_split {
                    expected[0].add(&standing, slave, [0, inputs]);
                    expected[1].add(&standing, slave, [outputs, 0]);
                } else {
                    let writes = if command == Command::Lrw { 2 } else { 1 };
                    expected[0].add(&standing, slave, [writes * outputs, inputs]);
                }
            }
            self.segments[n].expected = expected;
        }
    }

    /// What these slaves add to the working counter of a cycle.
    pub(super) fn expected(&self, slaves: SlaveSet) -> u16 {
        let of = |(n, segment): (usize, &Segment)| {
            segment.slaves.intersection(slaves).iter().map(|slave| self.counts(slave, n)).sum::<u16>()
        };
        self.segments.iter().enumerate().map(of).sum()
    }

    /// Sends the frames of a cycle, after the end of the previous one. `clock`: the datagram that distributes the
    /// reference time.
    pub(super) fn send(
        &mut self,
        now: Ns,
        standing: Standing,
        clock: Option<ClockDatagram>,
        exchange: &mut Exchange,
        wire: &mut (impl Wire + ?Sized),
    ) {
        self.cycle = CycleDone { number: self.cycle.number + 1, sent_at: now, ..CycleDone::default() };
        (self.pending, self.is_open) = (0, true);
        self.expect(standing);
        let is_lrw_off = self.is_lrw_off;
        self.segments.iter_mut().for_each(|segment| segment.begin(is_lrw_off));
        let Some(mut frame) = exchange.begin_cyclic(now) else { return };
        if let Some(ClockDatagram { command, station, time }) = clock {
            self.sent_time = time;
            let address = u32::from(station) | u32::from(SYSTEM_TIME) << 16;
            self.pending += usize::from(frame.push(command, address, &time.to_le_bytes(), CLOCK));
        }
        self.pending += usize::from(frame.push(Command::Brd, u32::from(AL_STATUS) << 16, &[0; STATE_LEN], STATES));
        for (n, segment) in self.segments.iter().enumerate().take(SEGMENTS_MAX) {
            if segment.slaves.is_empty() {
                continue;
            }
            let (address, number) = (n as u32 * SEGMENT_STEP, SEGMENTS + n as u8);
            let split = [(Command::Lwr, number + WRITES), (Command::Lrd, number)];
            let datagrams = if segment.is_split(is_lrw_off) { &split[..] } else { &[(segment.command, number)][..] };
            for (command, number) in datagrams {
                if !frame.push(*command, address, &segment.data, *number) {
                    frame.send(wire);
                    let Some(next) = exchange.begin_cyclic(now) else { return };
                    frame = next;
                    frame.push(*command, address, &segment.data, *number);
                }
                self.pending += 1;
            }
        }
        frame.send(wire);
    }

    /// Takes a datagram of the cycle that has come back.
    pub(super) fn receive(&mut self, number: u8, datagram: &Datagram<'_>) {
        self.pending = self.pending.saturating_sub(1);
        // A slave adds at most 1 to the working counter of `CLOCK` and of `STATES`. If the counter is higher than the
        // number of slaves, the data are not used.
        let is_believed = usize::from(datagram.working_counter) <= self.slaves.len();
        match number {
            CLOCK if !is_believed => {}
            CLOCK => {
                // If the time comes back as it was sent, no clock has written it.
                let time = datagram.data.first_chunk().map(|bytes| u64::from_le_bytes(*bytes));
                self.cycle.reference_time = time.filter(|time| *time != self.sent_time);
            }
            STATES => {
                let op = RequestedState::State(crate::ethercat::AlState::Op).code();
                self.cycle.present = Some(datagram.working_counter);
                if !is_believed {
                    return;
                }
                self.cycle.all_in_op = datagram.data == [op, 0];
                self.cycle.states = datagram.data.first_chunk().map_or(0, |bytes| u16::from_le_bytes(*bytes));
            }
            number => self.receive_segment(usize::from(number - SEGMENTS), datagram),
        }
    }

    fn receive_segment(&mut self, n: usize, datagram: &Datagram<'_>) {
        let is_written = n >= SEGMENTS_MAX;
        let n = n % SEGMENTS_MAX;
        let Some(segment) = self.segments.get_mut(n) else { return };
        if !segment.receive(is_written, datagram.working_counter) {
            return;
        }
        for slave in segment.slaves.iter() {
            let Some(SlaveData { input_place: Place { segment: at, range }, .. }) =
                self.slaves.get(usize::from(slave) - 1)
            else {
                continue;
            };
            if *at == n
                && let Some(inputs) = segment.data.get_mut(range.clone())
                && let Some(came) = datagram.data.get(range.clone())
            {
                inputs.copy_from_slice(came);
            }
        }
    }

    /// Whether all datagrams of the present cycle have come back.
    pub(super) const fn is_whole(&self) -> bool {
        self.is_open && self.pending == 0
    }

    /// Ends the present cycle; `None`: there is none.
    pub(super) fn finish(&mut self, active: SlaveSet) -> Option<CycleDone> {
        if !std::mem::take(&mut self.is_open) {
            return None;
        }
        let certain = self.standing.map_or(SlaveSet::EMPTY, |standing| standing.certain());
        let mut cycle = self.cycle;
        for (n, segment) in self.segments.iter().enumerate().filter(|(_, segment)| !segment.slaves.is_empty()) {
            let taking_part = segment.slaves.intersection(active);
            let expected = taking_part.iter().map(|slave| self.counts(slave, n)).sum();
            segment.end(&mut cycle, taking_part, expected, certain);
        }
        self.cycle = cycle;
        self.done = Some(self.cycle);
        self.done
    }

    /// Adds the reference time and the next deadline to the cycle that has ended.
    pub(super) const fn note_time(&mut self, time: u64, next_deadline: Option<Ns>) {
        if let Some(done) = &mut self.done {
            (done.reference_time, done.next_deadline) = (Some(time), next_deadline);
        }
    }

    /// When the newest cycle was sent.
    pub(super) const fn sent_at(&self) -> Ns {
        self.cycle.sent_at
    }

    /// Whether a cycle was sent and has not ended.
    pub(super) const fn is_open(&self) -> bool {
        self.is_open
    }

    /// The cycle that has ended last; each is returned once.
    pub(super) const fn take_done(&mut self) -> Option<CycleDone> {
        self.done.take()
    }
}
