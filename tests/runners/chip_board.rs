//! A board over a chip on the real clock, as `xf-spi:` has it: the wires are those of the model, whose clock runs by
//! itself.

use std::sync::{Arc, Mutex, MutexGuard};

use ecmsk::cia402::Mode;
use ecmsk::ethercat::{AlState, Ns};
use ecmsk::link::LinkError;
use ecmsk::link::chip::{ChipBoard, ChipError, ChipInfo, ChipLink, ModelledChip, SimChip};
use ecmsk::link::options::Clock;
use ecmsk::link::uri::LinkUri;
use ecmsk::sk::{DriveResponse, DriveSync, MasterCommand, MasterState, Motion, SlaveCommand, SlaveKind, StateByte};
use ecmsk::slave::handle::SimHandle;
use ecmsk::slave::{Drive, DriveConfig, Slave};
use ecmsk::xf::chip::{SimulatedNetwork, SlaveModels};
use ecmsk::xf::host::Wires;
use ecmsk::xf::request::WarmReset;
use ecmsk::xf::{CheckRule, CommandHeader, MAX_PACKET, write_request};

use crate::client::Client;

const URI: &str = "xf-sim:?int0=yes";

/// The chip, which exists before the board and after it.
#[derive(Clone)]
struct Lasting(Arc<Mutex<SimChip>>);

impl Lasting {
    fn new(drives: usize, handle: SimHandle) -> Self {
        let uri = LinkUri::parse(URI).expect("a link");
        let chip = ModelledChip::from_uri(&uri).expect("a chip");
        let slave = |_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>;
        let network = SlaveModels::new((0..drives).map(slave).collect()).reached_by(handle);
        Self(Arc::new(Mutex::new(SimChip::over(URI, chip, Clock::Real, SimulatedNetwork::Models(network)))))
    }

    fn open(&self) -> Result<Client, LinkError> {
        let options = ChipBoard::from_uri(&LinkUri::parse(URI)?)?;
        options.open_over(Box::new(self.clone())).map(|link| Client::on(Arc::new(link)))
    }

    fn chip(&self) -> MutexGuard<'_, SimChip> {
        self.0.lock().expect("no panic")
    }

    /// The chip is reset, as by its reset line.
    fn reset(&self) {
        let mut chip = self.chip();
        let (size, now) = (chip.chip().size(), chip.now().max(chip.chip().ready_at()));
        let mut buffer = [0; MAX_PACKET];
        let packet = write_request(&mut buffer, size, CheckRule::CRC32, CommandHeader::with_index(0), &WarmReset);
        let packet = packet.expect("it fits").to_vec();
        chip.chip_mut().exchange(now, &packet, &mut [0; MAX_PACKET][..packet.len()]);
    }

    fn state_of_drive_1(&self) -> AlState {
        self.chip().chip().network().slave(0).expect("a drive").state()
    }
}

impl Wires for Lasting {
    type Error = ChipError;

    fn now(&self) -> Ns {
        self.chip().now()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), ChipError> {
        self.chip().exchange(to_chip, from_chip)
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), ChipError> {
        self.chip().wait_until(time)
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, ChipError> {
        self.chip().wait_ready(until)
    }
}

impl ChipLink for Lasting {
    fn info(&self) -> ChipInfo {
        self.chip().info()
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        self.chip().int1()
    }
}

fn drive(client: &Client) -> DriveResponse {
    DriveResponse::decode(&client.slot(1))
}

/// Drive 1 is on in that mode.
fn start(client: &mut Client, mode: Mode) {
    client.go(MasterState::PreOp);
    client.master(MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Drive; 8] });
    client.slave(1, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync });
    client.go(MasterState::Op);
    client.slave(1, SlaveCommand::ServoOn);
    client.until("servo on", |client| drive(client).statusword.is_enabled());
}

/// On a real clock each target of a stream reaches the drive, and the board's own cycle is that of the chip.
#[test]
fn a_stream_arrives() {
    let chip = Lasting::new(1, SimHandle::default());
    let mut client = chip.open().expect("a board");
    start(&mut client, Mode::Csp);
    let from = drive(&client).position;
    for n in 1..=200 {
        client.until("room", |client| client.answer().fifo_free > 120);
        client.slave(1, SlaveCommand::Csp(Motion::to(from + 10 * n)));
    }
    client.until("the end", |client| (drive(client).position - from - 2000).abs() <= 2);
    assert_eq!(client.link.stats().board.expect("a model").outputs_lost, 0);
}

/// LINK-12 Closing a board whose axis moves with a velocity brakes the axis and takes the network out of OP; the chip
/// goes on, and the axis is at rest.
#[test]
fn closing_stops_the_axes() {
    let handle = SimHandle::default();
    let chip = Lasting::new(1, handle.clone());
    let mut client = chip.open().expect("a board");
    start(&mut client, Mode::Csv);
    client.slave(1, SlaveCommand::Csv(Motion::to(20_000)));
    let from = drive(&client).position;
    client.until("motion", |client| drive(client).position > from + 1000);
    client.link.close();
    assert!(chip.state_of_drive_1() < AlState::SafeOp);
    let stands_at = handle.shaft(1, 0).expect("a shaft");
    let mut wires = chip.clone();
    let later = wires.now() + 50_000_000;
    wires.wait_until(later).expect("wires");
    wires.exchange(&[0; 32], &mut [0; 32]).expect("wires");
    assert_eq!(handle.shaft(1, 0), Some(stands_at));
    assert!(matches!(client.link.check(), Err(LinkError::Closed)));
    // The next program finds a board as after power-on.
    let again = chip.open().expect("a board");
    assert_eq!(again.link.stats().board.expect("a model").executed, 0);
}

/// A chip whose network has no slave is no board; the message says what to check.
#[test]
fn a_network_without_a_slave_is_no_board() {
    let error = Lasting::new(0, SimHandle::default()).open().err().expect("no board").to_string();
    assert!(error.contains("finds no slave") && error.contains("ecmsk xf scan"), "{error}");
}

/// A chip that is reset is a board whose slaves are lost; the next SET_STATE brings them back.
#[test]
fn a_chip_that_is_reset_comes_back() {
    let chip = Lasting::new(1, SimHandle::default());
    let mut client = chip.open().expect("a board");
    start(&mut client, Mode::Csp);
    chip.reset();
    client.until("the loss", |client| client.answer().state == StateByte::failed(Some(MasterState::Op)));
    client.master(MasterCommand::SetState(MasterState::Op));
    client.until("OP", |client| client.answer().state == StateByte::reached(MasterState::Op));
    client.slave(1, SlaveCommand::ServoOn);
    client.until("servo on", |client| drive(client).statusword.is_enabled());
}

/// The board's local inputs and outputs are the pins of the chip that the link names; a line that is not wired reads 0.
#[test]
fn local_io_is_at_the_chips_pins() {
    let chip = Lasting::new(1, SimHandle::default());
    let uri = LinkUri::parse("xf-sim:?int0=yes&local_in=4,5,-,7&local_out=0,-,10,3").expect("a link");
    let options = ChipBoard::from_uri(&uri).expect("options");
    let mut client = options.open_over(Box::new(chip.clone())).map(|link| Client::on(Arc::new(link))).expect("a board");
    let level = |pin| chip.chip().chip().gpio_level(pin);
    client.master(MasterCommand::LocalWrite(0b01_1111));
    client.until("the outputs", |_| [0, 3, 10].iter().all(|pin| level(*pin)));
    client.master(MasterCommand::LocalWrite(0b00_1000));
    client.until("the outputs", |_| [0, 3, 10].map(level) == [false, true, false]);
    let now = chip.now();
    for (pin, is_high) in [(4, true), (5, false), (7, true), (6, true)] {
        chip.chip().chip_mut().wire_gpio(now, pin, Some(is_high));
    }
    client.until("the inputs", |client| {
        client.master(MasterCommand::LocalRead);
        client.answer().result == 0b1001
    });
}
