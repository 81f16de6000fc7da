//! Axes whose host has vanished.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use ecmsk::cia402::DriveState;
use ecmsk::coe::ObjectAddress;
use ecmsk::ethercat::Ns;
use ecmsk::link::chip::{self, ChipError, ChipInfo, ChipLink};
use ecmsk::port::xf::{Listen, OnVanish, Options, Server};
use ecmsk::xf::host::Wires;
use ecmsk::xf::request::{FifoEnable, Reconfig, Slaves};
use ecmsk::xf::{CommandHeader, EtherCatState};
use ecmsk::xf_api::{NetworkConfig, Xf};

use support::dice::Dice;

use crate::client::{CLOSE, Remote, any_port, serve, serve_with};

const URI: &str = "xf-sim:?slaves=drive*2,io&clock=virtual";
const DRIVES: u8 = 2;

/// This project's driver over the server, with two axes that move in CSP.
fn moving(to: &Listen) -> Xf<Remote> {
    let mut xf = Xf::over(Remote::connect(to), Default::default()).expect("it starts");
    assert_eq!(xf.start_network(&NetworkConfig::default()).expect("a network"), 3);
    xf.set_state(Slaves::All, EtherCatState::PreOp).expect("PreOP");
    for slave in 0..DRIVES {
        xf.sdo_write(slave, ObjectAddress::new(0x6060, 0), 8_i8).expect("CSP");
    }
    xf.run(&Reconfig).expect("a layout");
    xf.set_state(Slaves::All, EtherCatState::SafeOp).expect("SafeOP");
    let mut data = xf.process_data().expect("process data");
    let mut targets = Vec::new();
    for axis in 0..DRIVES {
        let target = data.output::<i32>(axis, ObjectAddress::new(0x607A, 0)).expect("mapped");
        let position = data.input::<i32>(axis, ObjectAddress::new(0x6064, 0)).expect("mapped");
        data.set(target, data.get(position));
        targets.push((target, data.get(position)));
        xf.add_axis(axis, axis, &data).expect("an axis");
    }
    xf.set_state(Slaves::All, EtherCatState::Op).expect("OP");
    xf.run(&FifoEnable { on: true }).expect("the FIFO is on");
    xf.cycle(&mut data).expect("a cycle");
    for axis in 0..DRIVES {
        xf.enable(axis).expect("it is on");
    }
    for n in 1..=100 {
        for (target, start) in &targets {
            data.set(*target, start + 10 * n);
        }
        xf.cycle(&mut data).expect("a cycle");
    }
    xf
}

/// The state of the network and the drives that are on, as the next host finds them.
fn found(to: &Listen) -> (Option<EtherCatState>, Vec<bool>) {
    let mut xf = Xf::over(Remote::connect(to), Default::default()).expect("it starts");
    xf.count_slaves().expect("a network");
    let state = xf.state().expect("a state").state();
    // Drives that brake come to rest.
    xf.pass(Duration::from_secs(1)).expect("time passes");
    let mut on = |slave| {
        let statusword: u16 = xf.sdo_read(slave, ObjectAddress::new(0x6041, 0)).expect("a statusword");
        ecmsk::cia402::Statusword(statusword).state() == Some(DriveState::OperationEnabled)
    };
    let drives = (0..DRIVES).map(&mut on).collect();
    xf.link_mut().client.ask(CLOSE, &[]);
    (state, drives)
}

const STOPPED: (Option<EtherCatState>, [bool; 2]) = (Some(EtherCatState::SafeOp), [false, false]);
const AS_IT_WAS: (Option<EtherCatState>, [bool; 2]) = (Some(EtherCatState::Op), [true, true]);

/// XF-14.8 A host whose connection ends without a close has vanished: slaves in OP go to SafeOP, drives are off, and
/// this is logged.
#[test]
fn a_host_that_vanishes() {
    let (server, log) = serve(URI);
    let xf = moving(server.listen());
    xf.link().client.hang_up();
    drop(xf);
    let (state, drives) = found(server.listen());
    assert_eq!((state, &drives[..]), (STOPPED.0, &STOPPED.1[..]));
    server.stop();
    let said = log.lines();
    assert!(said.iter().any(|line| line.contains("3 slaves that were in OP are in SafeOP")), "{said:?}");
}

/// XF-14.8 The same if it vanishes in the middle of a packet, so that packets begin at another byte than a host
/// expects, in the middle of a message, and after nonsense.
#[test]
fn a_host_that_vanishes_within_a_packet() {
    for sent in [&[1, 0, 7, 0, 1, 2, 3, 4, 5, 6, 7][..], &[1, 0, 144, 0, 9], &[1, 0, 0xFF, 0xFF]] {
        let (server, _) = serve(URI);
        let mut xf = moving(server.listen());
        let client = &mut xf.link_mut().client;
        client.send(sent);
        client.hang_up();
        drop(xf);
        let (state, drives) = found(server.listen());
        assert_eq!((state, &drives[..]), (STOPPED.0, &STOPPED.1[..]), "{sent:?}");
    }
}

/// XF-14.8 A host that closes the connection properly leaves everything unchanged.
#[test]
fn a_host_that_closes() {
    let (server, _) = serve(URI);
    let mut xf = moving(server.listen());
    assert_eq!(xf.link_mut().client.ask(CLOSE, &[]), (0, Vec::new()));
    drop(xf);
    let (state, drives) = found(server.listen());
    assert_eq!((state, &drives[..]), (AS_IT_WAS.0, &AS_IT_WAS.1[..]));
}

/// XF-14.8 With `leave` nothing is sent after a host that has vanished.
#[test]
fn a_chip_that_is_left() {
    let (server, log) =
        serve_with(URI, Options { listen: any_port(), on_vanish: OnVanish::Leave, ..Options::default() });
    let xf = moving(server.listen());
    xf.link().client.hang_up();
    drop(xf);
    let (state, drives) = found(server.listen());
    assert_eq!((state, &drives[..]), (AS_IT_WAS.0, &AS_IT_WAS.1[..]));
    server.stop();
    assert!(log.lines().iter().any(|line| line.contains("on-vanish=leave")), "{:?}", log.lines());
}

/// XF-14.8 A server that is stopped while there is a host stops the axes, and tells the host that it ends.
#[test]
fn a_server_that_is_stopped() {
    let (server, log) = serve(URI);
    let mut xf = moving(server.listen());
    server.stop();
    let (kind, status, _) = xf.link_mut().client.receive().expect("a word");
    assert_eq!((kind, status), (5, 5));
    let said = log.lines();
    assert!(said.iter().any(|line| line.contains("3 slaves that were in OP are in SafeOP")), "{said:?}");
}

/// A chip whose server stalls for up to 5 s before some exchanges, while chip and slaves go on.
struct Stalling {
    chip: Box<dyn ChipLink>,
    dice: Dice,
    /// The number of stalls to come.
    left: Arc<AtomicU64>,
}

impl Wires for Stalling {
    type Error = ChipError;

    fn now(&self) -> Ns {
        self.chip.now()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), ChipError> {
        if self.left.load(Ordering::Relaxed) > 0 && self.dice.one_in(4) {
            self.left.fetch_sub(1, Ordering::Relaxed);
            let until = self.chip.now() + self.dice.below(5_000_000_000);
            self.chip.wait_until(until)?;
        }
        self.chip.exchange(to_chip, from_chip)
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), ChipError> {
        self.chip.wait_until(time)
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, ChipError> {
        self.chip.wait_ready(until)
    }
}

impl ChipLink for Stalling {
    fn info(&self) -> ChipInfo {
        self.chip.info()
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        self.chip.int1()
    }
}

/// XF-14.8 A server that stalls while it stops the axes stops them all the same.
#[test]
fn a_server_that_stalls() {
    for seed in 0..4 {
        let left = Arc::<AtomicU64>::default();
        let stalls = Arc::clone(&left);
        let open = move || {
            let (chip, config) = chip::open(URI)?;
            let stalling = Stalling { chip, dice: Dice(seed), left: Arc::clone(&stalls) };
            Ok((Box::new(stalling) as Box<dyn ChipLink>, config))
        };
        let tell = Arc::new(|line: &str| println!("{line}"));
        let server =
            Server::start(open, Options { listen: any_port(), tell, ..Options::default() }).expect("it is served");
        let xf = moving(server.listen());
        left.store(1 + seed, Ordering::Relaxed);
        xf.link().client.hang_up();
        drop(xf);
        let (state, drives) = found(server.listen());
        assert_eq!((state, &drives[..]), (STOPPED.0, &STOPPED.1[..]), "seed {seed}");
        assert_eq!(left.load(Ordering::Relaxed), 0, "seed {seed}");
    }
}

/// XF-14.9 A host that has sent nothing has moved nothing: the chip gets no byte after it, and so is still in its state
/// after power-on, with its first answer.
#[test]
fn a_host_that_has_sent_nothing() {
    let (server, _) = serve("xf-sim:?clock=virtual&chip_fw=old");
    crate::client::Client::connect(server.listen()).hang_up();
    let mut client = crate::client::Client::connect_when_free(server.listen());
    client.ask(crate::client::DELAY, &1_000_000_u32.to_le_bytes());
    let first = client.exchange(&[0; 144]);
    // The first answer belongs to no command: index and code are 0.
    let (_, header) = CommandHeader::decode(first.first_chunk().expect("a header"));
    assert_eq!((header.index, header.code.code()), (0, 0));
}

/// XF-14.9 After a host that has vanished the chip has its earlier n and fixed check words.
#[test]
fn the_chip_after_it() {
    let (server, log) = serve("xf-sim:?slaves=drive&clock=virtual&chip_fw=old");
    let xf = Xf::over(Remote::connect(server.listen()), Default::default()).expect("it starts");
    xf.link().client.hang_up();
    drop(xf);
    let mut client = crate::client::Client::connect_when_free(server.listen());
    client.ask(crate::client::DELAY, &1_000_000_u32.to_le_bytes());
    let mut packet = vec![0; 144];
    let rule = ecmsk::xf::CheckRule::FIXED;
    let size = ecmsk::xf::DataSize::new(112).expect("a size");
    let request = ecmsk::xf::request::FirmwareVersionGet;
    ecmsk::xf::write_request(&mut packet, size, rule, CommandHeader::with_index(77), &request).expect("a packet");
    client.exchange(&packet);
    client.ask(crate::client::DELAY, &1_000_000_u32.to_le_bytes());
    let answer = client.exchange(&packet);
    assert_eq!((answer[0x0B], answer[0x0C], answer[0x0D]), (77, 56, 0x0E), "index, code, version");
    assert_eq!(answer[136..140], 0x1234_5678_u32.to_le_bytes());
    server.stop();
    let said = log.lines();
    assert!(!said.iter().any(|line| line.contains("axes may still move")), "{said:?}");
}
