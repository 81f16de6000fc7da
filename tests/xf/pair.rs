//! The driver and the model of the chip, byte by byte: they were written from the same manuals, and each has to do what the
//! other one expects.

use ecmsk::ethercat::Ns;
use ecmsk::slave::{Drive, DriveConfig, Slave};
use ecmsk::xf::chip::{Chip, ChipPort, Profile, SlaveModels};
use ecmsk::xf::host::{Host, HostConfig, HostState, Next, Ticket};
use ecmsk::xf::request::{
    Call, DcTiming, EcatInit, ReferenceClock, SdoGet, SdoOperation, SdoRequest, SlaveCountGet, Slaves, StateGet,
    StateSet, StateUpdate,
};
use ecmsk::xf::{EtherCatState, MAX_PACKET};
use ecmsk::{coe::ObjectAddress, coe::SdoScope};

use crate::slave;

/// How long a byte takes at 24 MHz.
const BYTE: Ns = 333;
const S: Ns = 1_000_000_000;

/// A driver whose bytes go to a model.
struct Pair {
    host: Host,
    port: ChipPort<SlaveModels>,
    now: Ns,
}

impl Pair {
    /// Two drives behind a chip that gets its power now; `skipped` bytes have passed before the driver begins.
    fn new(profile: Profile, config: HostConfig, skipped: usize) -> Self {
        let drive = || Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>;
        let mut port = ChipPort::new(Chip::new(profile, SlaveModels::new(vec![drive(), drive()])));
        port.transfer(0, &vec![0; skipped], &mut vec![0; skipped]);
        Self { host: Host::new(0, config), port, now: 0 }
    }

    /// Goes on until `done`, a minute at most.
    fn until(&mut self, what: &str, done: impl Fn(&Host) -> bool) {
        let end = self.now + 60 * S;
        while !done(&self.host) {
            assert!(self.now < end, "never: {what}; {:?} {:?}", self.host.state(), self.host.counters());
            let mut back = [0; MAX_PACKET];
            match self.host.next(self.now).expect("it runs") {
                Next::Exchange(bytes) => {
                    let len = bytes.len();
                    self.now += BYTE * len as Ns;
                    self.port.transfer(self.now, bytes, &mut back[..len]);
                    self.host.received(self.now, &back[..len]);
                }
                Next::WaitUntil(time) | Next::WaitForReady { until: time } => self.now = time.max(self.now + 1),
            }
        }
    }

    /// Runs a command to its end.
    fn run<'d, C: Call<'d>>(&mut self, call: &C) {
        let ticket = self.host.submit(self.now, call).expect("there is room");
        self.result(ticket, call, |_| ());
    }

    fn result<'d, C: Call<'d>>(&mut self, ticket: Ticket, call: &C, look: impl FnOnce(C::Answer<'_>)) {
        self.until("the end of a command", |host| host.is_done(ticket));
        look(self.host.take(ticket, call).expect("it is done").expect("it has a result"));
    }
}

fn all(state: EtherCatState) -> StateSet {
    StateSet { slaves: Slaves::All, state }
}

/// XF-12.1 The driver starts the model, wherever it begins in the stream, whether it knows n or not.
#[test]
fn the_driver_starts_the_model() {
    for profile in [Profile::OLD, Profile::NEW, Profile::XFU] {
        for skipped in [0, 1, 50, 143, 144, 700] {
            let mut pair = Pair::new(profile, HostConfig::DEFAULT, skipped);
            pair.until("a start", |host| host.state() == HostState::Running);
            assert_eq!(pair.host.size(), profile.size, "{skipped}");
            assert_eq!(pair.host.version().expect("a version").version, profile.version, "{skipped}");
        }
    }
}

/// XF-12.8 XF-12.9 Commands have on the model the effects that the driver reports.
#[test]
fn commands_have_their_effects() {
    let mut pair = Pair::new(Profile::NEW, HostConfig::DEFAULT, 7);
    let dc = DcTiming { assign_activate: 0x0300, sync0_ns: 1_000_000, ..DcTiming::default() };
    pair.run(&EcatInit { special_slaves: false, reference_clock: ReferenceClock::Chip, lrw: true, fifo_on: false, dc });
    let ticket = pair.host.submit(pair.now, &SlaveCountGet).unwrap();
    pair.result(ticket, &SlaveCountGet, |count| assert_eq!(count, 2));
    pair.run(&all(EtherCatState::PreOp));
    let state = StateGet { slaves: Slaves::All };
    let ticket = pair.host.submit_pair(pair.now, &StateUpdate, &state, S).unwrap();
    pair.result(ticket, &state, |state| assert_eq!(state.state(), Some(EtherCatState::PreOp)));
    let read = SdoRequest {
        slave: slave(1),
        object: ObjectAddress::new(0x1000, 0),
        scope: SdoScope::Entry,
        timeout_us: 100_000,
        operation: SdoOperation::Read { bytes: 4 },
    };
    let ticket = pair.host.submit_pair(pair.now, &read, &SdoGet, S).unwrap();
    pair.result(ticket, &SdoGet, |value| assert_eq!(value, 0x0002_0192_u32.to_le_bytes()));
}
