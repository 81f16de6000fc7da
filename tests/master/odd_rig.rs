//! The master with a wire to slaves of another descent than the models of this crate: `support::odd_line`.

use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::ethercat::{AlState, SlaveSet};
use ecmsk::fieldbus::nic::NicWires;
use ecmsk::master::{CycleDone, Ending, FileError, Job, Master, SdoError, Settings, StateError};
use support::odd_line::{OddLine, OddSlave};

use super::rig::{CYCLE, SECOND, STEP};

pub struct Rig {
    pub master: Master,
    pub line: OddLine,
    /// When the next cycle is; `None`: there are no cycles.
    pub next_cycle: Option<u64>,
    pub last: CycleDone,
}

impl Rig {
    /// A line whose slaves were found.
    pub fn scanned(slaves: impl IntoIterator<Item = OddSlave>) -> Self {
        let line = OddLine::new(slaves);
        let master = Master::new(Settings::default());
        let mut rig = Self { master, line, next_cycle: None, last: CycleDone::default() };
        rig.scan();
        rig
    }

    /// One in PreOP.
    pub fn in_preop(slave: OddSlave) -> Self {
        let mut rig = Self::scanned([slave]);
        rig.reach(AlState::PreOp);
        rig
    }

    pub fn step(&mut self) {
        let until = self.line.now() + STEP;
        while self.line.now() < until {
            self.line.wait(until);
            self.master.poll(self.line.now(), &mut self.line);
        }
        let now = self.line.now();
        if self.next_cycle.is_some_and(|next| now >= next) {
            self.next_cycle = Some(now + CYCLE);
            self.master.cycle(now, &mut self.line);
        }
        self.master.poll(now, &mut self.line);
        if let Some(done) = self.master.take_cycle() {
            self.last = done;
        }
    }

    pub fn run_for(&mut self, ns: u64) {
        let until = self.line.now() + ns;
        while self.line.now() < until {
            self.step();
        }
    }

    #[track_caller]
    pub fn wait<T: Ending>(&mut self, job: Job<T>) -> T {
        let until = self.line.now() + 600 * SECOND;
        while self.line.now() < until {
            self.step();
            let ended = self.master.ended().next();
            if let Some(ended) = ended {
                assert_eq!(ended, job.id(), "another one has ended");
                return self.master.take(job).expect("it has ended");
            }
        }
        panic!("a job does not end");
    }

    #[track_caller]
    pub fn scan(&mut self) {
        let id = self.master.scan();
        assert!(matches!(self.wait(id), Ok(1..)));
    }

    #[track_caller]
    pub fn reach(&mut self, target: AlState) {
        assert_eq!(self.request(target), Ok(()), "{target:?}");
    }

    /// Requests a state of all slaves.
    #[track_caller]
    pub fn request(&mut self, target: AlState) -> Result<(), StateError> {
        let all = SlaveSet::first(self.master.slaves().len() as u8);
        let id = self.master.request_state(all, target, 10 * SECOND);
        self.wait(id)
    }

    /// Drives in OP, with the process data that they have at power-on.
    #[track_caller]
    pub fn in_op(slaves: impl IntoIterator<Item = OddSlave>) -> Self {
        let mut rig = Self::scanned(slaves);
        rig.bring_to_op();
        rig
    }

    /// Brings drives to OP, with the process data that they have at power-on.
    #[track_caller]
    pub fn bring_to_op(&mut self) {
        self.reach(AlState::PreOp);
        for slave in 1..=self.master.slaves().len() as u8 {
            self.master.configure(slave, 6, 10).expect("so many");
        }
        self.reach(AlState::SafeOp);
        self.next_cycle = Some(self.line.now());
        self.reach(AlState::Op);
    }

    pub fn upload(&mut self, index: u16, sub: u8) -> Result<Vec<u8>, SdoError> {
        let id = self.master.upload(1, ObjectAddress::new(index, sub), SdoScope::Entry, SECOND);
        self.wait(id)
    }

    pub fn download(&mut self, index: u16, sub: u8, value: &[u8]) -> Result<(), SdoError> {
        let id = self.master.download(1, ObjectAddress::new(index, sub), SdoScope::Entry, value, SECOND);
        self.wait(id)
    }

    pub fn read_file(&mut self, name: &str) -> Result<Vec<u8>, FileError> {
        let id = self.master.read_file(1, name.as_bytes(), 0, SECOND);
        self.wait(id)
    }
}
