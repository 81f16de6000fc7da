//! The software master on a wire that changes, loses, doubles and delays what slaves answer, while a user starts and cancels
//! everything that there is: nothing panics, everything that was started ends, and once the wire is honest a scan brings the slaves
//! to OP.

#![no_main]

use std::collections::VecDeque;

use ecmsk::coe::{EntryRequest, ObjectAddress, ObjectListType, SdoScope, ValueInfo};
use ecmsk::ethercat::{AlState, Command, Ns, SlaveSet, each_datagram};
use ecmsk::master::{Ending, FrameBuffer, Job, JobId, Master, Pace, Settings, SyncSignals, Wire, WireDown};
use ecmsk::slave::esc::{Chain, EscSettings, EscSlave, FrameFate};
use ecmsk::slave::{Drive, DriveConfig, Hsp, HspConfig, Io, Slave};
use libfuzzer_sys::fuzz_target;

/// Bytes of a step.
const STEP: usize = 6;
const MS: Ns = 1_000_000;
/// How long a user may have to wait for the end of what was started: a scan of slaves that lie about their EEPROMs takes longest.
const END_NS: Ns = 60_000 * MS;

fuzz_target!(|bytes: &[u8]| {
    let Some((&count, bytes)) = bytes.split_first() else { return };
    let mut rig = Rig::new(usize::from(count % 4));
    let steps = bytes.as_chunks::<STEP>().0;
    for step in steps.iter().take(200) {
        rig.step(*step);
    }
    rig.end();
});

struct Slaves {
    chain: Chain,
    now: Ns,
    back: VecDeque<Vec<u8>>,
    /// What is done to the next answers.
    changes: VecDeque<[u8; 4]>,
}

impl Wire for Slaves {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        let mut frame = frame.to_vec();
        let FrameFate::Returned(_) = self.chain.process(&mut frame, self.now) else { return Ok(()) };
        let Some([what, place, value, more]) = self.changes.pop_front() else {
            self.back.push_back(frame);
            return Ok(());
        };
        let place = usize::from(u16::from_le_bytes([place, more]));
        match what % 8 {
            0 => return Ok(()),
            1 => self.back.push_back(frame.clone()),
            2 => return Err(WireDown),
            3 => frame.truncate(place % frame.len()),
            4 => {
                let at = place % frame.len();
                frame[at] = value;
            }
            // Answers whose headers are right.
            5 => {
                let _ = each_datagram(&mut frame, |mut datagram| datagram.count(value.into()));
            }
            _ => {
                let _ = each_datagram(&mut frame, |datagram| {
                    if !datagram.data.is_empty() {
                        let at = place % datagram.data.len();
                        datagram.data[at] = value;
                    }
                });
            }
        }
        self.back.push_back(frame);
        Ok(())
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        let frame = self.back.pop_front()?;
        buffer[..frame.len()].copy_from_slice(&frame);
        Some(frame.len())
    }
}

struct Rig {
    master: Master,
    wire: Slaves,
    open: Vec<JobId>,
    is_cyclic: bool,
}

fn slave(n: usize) -> EscSlave {
    let device: Box<dyn Slave> = match n % 3 {
        0 => Box::new(Drive::new(DriveConfig::default())),
        1 => Box::new(Io::default()),
        _ => Box::new(Hsp::new(HspConfig::default())),
    };
    EscSlave::describe(device, EscSettings::default(), 0).expect("it can be described")
}

impl Rig {
    fn new(count: usize) -> Self {
        let chain = Chain::line((0..count).map(slave));
        let wire = Slaves { chain, now: MS, back: VecDeque::new(), changes: VecDeque::new() };
        Self { master: Master::new(Settings::default()), wire, open: Vec::new(), is_cyclic: false }
    }

    fn ended(&self) -> Option<JobId> {
        self.master.ended().next()
    }

    fn pass(&mut self, ns: Ns) {
        self.wire.now += ns;
        let now = self.wire.now;
        if self.is_cyclic {
            self.master.cycle(now, &mut self.wire);
        }
        self.master.poll(now, &mut self.wire);
        let _ = self.master.take_cycle();
        while self.master.take_event().is_some() {}
        while let Some(id) = self.ended() {
            let at = self.open.iter().position(|open| *open == id).expect("it was started and has not ended");
            self.open.remove(at);
            self.master.cancel(id);
        }
    }

    fn step(&mut self, step: [u8; STEP]) {
        let [what, a, b, c, d, e] = step;
        let slave = a % 5;
        let object = ObjectAddress::new(u16::from_le_bytes([b, c]), d);
        let timeout = u64::from(e) * MS;
        let id = match what % 29 {
            0 => {
                self.open.clear();
                self.master.scan().id()
            }
            1..4 => {
                let target = [AlState::Init, AlState::PreOp, AlState::SafeOp, AlState::Op][usize::from(b % 4)];
                let slaves = SlaveSet::from_bits(u64::from(a) & 0x0F);
                self.master.request_state(slaves, target, 10 * timeout).id()
            }
            4 => self.master.upload(slave, object, SdoScope::Entry, timeout).id(),
            5 => self.master.download(slave, object, SdoScope::Complete, &step, timeout).id(),
            6 => self.master.object_list(slave, ObjectListType::from_code(b.into()), timeout).id(),
            7 => self.master.describe_object(slave, object.index, timeout).id(),
            8 => self.master.describe_entry(slave, EntryRequest { object, wanted: ValueInfo(e) }, timeout).id(),
            9 => self.master.read_file(slave, &step, 0, timeout).id(),
            10 => self.master.write_file(slave, &step, 0, &[b; 200], timeout).id(),
            11 => {
                let _ = self.master.configure(slave, b.into(), c.into());
                return;
            }
            12 => {
                let _ = self.master.configure_as_described(slave);
                return;
            }
            13 => {
                let sync = SyncSignals {
                    assign_activate: u16::from_le_bytes([b, c]),
                    ..SyncSignals::sync0(u32::from(d) * 10_000, 7)
                };
                let _ = self.master.set_sync(slave, Some(sync));
                return;
            }
            14 => return self.master.set_pace(Some(Pace { cycle_ns: u64::from(b) * 10_000, phase_ns: c.into() })),
            15 => {
                if let Some(id) = self.open.pop() {
                    self.master.cancel(id);
                }
                return;
            }
            16 => return self.is_cyclic = !self.is_cyclic,
            17 if !self.wire.chain.is_empty() => {
                let (n, now) = (usize::from(a) % self.wire.chain.len(), self.wire.now);
                return self.wire.chain.power(n, b & 1 == 0, now);
            }
            18 if !self.wire.chain.is_empty() => {
                let n = usize::from(a) % self.wire.chain.len();
                return self.wire.chain.connect(n, b & 1 == 0);
            }
            21 => self.master.read_eeprom(slave, object.index, d.into()).id(),
            22 => self.master.write_eeprom(slave, object.index, &[object.index; 3]).id(),
            23 => self.master.read_registers(slave, object.index, d.into()).id(),
            24 => self.master.write_registers(slave, object.index, &step).id(),
            25 => self.master.datagram(Command::from_code(e), u32::from_le_bytes([a, b, c, d]), &step).id(),
            19 | 20 => return (0..a % 32).for_each(|_| self.pass(u64::from(b) * 10_000)),
            _ => return self.wire.changes.extend((0..1 + e % 8).map(|n| [a, b.wrapping_add(n), c, d])),
        };
        self.open.push(id);
        self.pass(50_000);
    }

    /// Everything ends; then, on an honest wire, the slaves get to OP.
    fn end(&mut self) {
        let until = self.wire.now + END_NS;
        while !self.open.is_empty() {
            assert!(self.wire.now < until, "{:?} do not end", self.open);
            self.pass(200_000);
        }
        self.wire.changes.clear();
        self.is_cyclic = false;
        let now = self.wire.now;
        for n in 0..self.wire.chain.len() {
            self.wire.chain.connect(n, true);
            self.wire.chain.power(n, false, now);
            self.wire.chain.power(n, true, now);
        }
        let count = self.wire.chain.len() as u8;
        // Frames of before are counted and dropped, but a scan takes the first ones for its own if they fit.
        (0..200).for_each(|_| self.pass(MS));
        let id = self.master.scan();
        assert_eq!(self.wait(id), Ok(count));
        let all = SlaveSet::first(count);
        (1..=count).for_each(|slave| self.master.configure_as_described(slave).expect("it is described"));
        for target in [AlState::PreOp, AlState::SafeOp, AlState::Op] {
            let id = self.master.request_state(all, target, 10_000 * MS);
            assert_eq!(self.wait(id), Ok(()));
            self.is_cyclic = target == AlState::SafeOp;
        }
    }

    fn wait<T: Ending>(&mut self, job: Job<T>) -> T {
        let until = self.wire.now + END_NS;
        while self.wire.now < until {
            self.wire.now += 200_000;
            let now = self.wire.now;
            if self.is_cyclic {
                self.master.cycle(now, &mut self.wire);
            }
            self.master.poll(now, &mut self.wire);
            if let Some(ended) = self.ended() {
                assert_eq!(ended, job.id());
                return self.master.take(job).expect("it has ended");
            }
        }
        panic!("it does not end");
    }
}
