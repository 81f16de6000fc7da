//! `xf-sim:` as a board: its slaves are behind the model of an ECM-XF, and a program sees the same as with `sim:`.

use std::fs::{self, File};
use std::path::Path;
use std::time::Duration;

use ecmsk::cia402::Mode;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::ecm::{Axis, Close, Config, Ecm, Homing, Slave};
use ecmsk::link::{self, Dir, LinkError, Share, Wait, chip};
use ecmsk::recording::Recording;
use ecmsk::recording::exchanges::{Exchanges, is_of_chip};
use ecmsk::sk::{
    CommandId, CycleTime, DcShift, DriveResponse, DriveSync, MasterCommand, MasterState, Motion, SdoCommand,
    SdoResponse, SlaveCommand, SlaveKind, StateByte,
};
use ecmsk::xf_api::{NetworkConfig, Xf};
use support::script_client;

use crate::client::{Client, MS, SIZE, soft_reset};

fn open(uri: &str, share: Share) -> Result<Client, LinkError> {
    link::open(uri, share).map(Client::on)
}

/// Opens; there must be no error.
fn opened(uri: &str, share: Share) -> Client {
    open(uri, share).unwrap_or_else(|error| panic!("{uri}: {error}"))
}

fn drive(client: &Client, slave: usize) -> DriveResponse {
    DriveResponse::decode(&client.slot(slave))
}

fn state(client: &mut Client) -> StateByte {
    client.read();
    client.answer().state
}

const PRE_OP: StateByte = StateByte::reached(MasterState::PreOp);
const OP: StateByte = StateByte::reached(MasterState::Op);

/// The start of a program for the board, with two drives and an IO slave; then drive 1 is on.
fn start(client: &mut Client) {
    let mut kinds = [SlaveKind::None; 8];
    kinds[..3].copy_from_slice(&[SlaveKind::Drive, SlaveKind::Drive, SlaveKind::Io]);
    client.go(MasterState::PreOp);
    client.master(MasterCommand::SetAxis { group: 0, kinds });
    let cycle = CycleTime::from_us(1000).expect("a cycle");
    client.master(MasterCommand::SetDc { cycle, shift: DcShift::Auto });
    for slave in [1, 2] {
        client.slave(slave, SlaveCommand::DriveMode { mode: Mode::Csp, sync: DriveSync::DcSync });
    }
    for state in [MasterState::SafeOp, MasterState::Op] {
        client.go(state);
    }
    client.slave(1, SlaveCommand::ServoOn);
    client.until("servo on", |client| drive(client, 1).statusword.is_enabled());
}

/// A motion of 2000 counts, outputs that are wired to inputs, an SDO written and read.
fn use_everything(client: &mut Client) {
    let from = drive(client, 1).position;
    for n in 1..=100 {
        client.until("room", |client| client.answer().fifo_free > 40);
        client.slave(1, SlaveCommand::Csp(Motion::to(from + 20 * n)));
    }
    client.until("the end of the way", |client| (drive(client, 1).position - from - 2000).abs() <= 2);
    client.slave(3, SlaveCommand::IoWrite(0xA5C3));
    client.until("the inputs", |client| client.slot(3).data1 == 0xA5C3);
    let (slave, object, value) = (2, ObjectAddress::new(0x6065, 0), 4321);
    for (id, command) in [
        (CommandId::SdoWrite, SdoCommand::Write { slave, object, size: SdoSize::Four, value }),
        (CommandId::SdoRead, SdoCommand::Read { slave, object }),
    ] {
        client.sdo(command);
        let answer = SdoResponse::Done { id, slave, object, value };
        client.until("the SDO", |client| SdoResponse::decode(&client.slot(SIZE.sdo_slot())) == answer);
    }
}

/// A program for the board, on every chip that can be modelled, over either network, on either clock.
#[test]
fn a_program_runs_behind_every_chip() {
    let chips = [
        "",
        "&chip_fw=old",
        "&chip_fw=xfu",
        "&int0=yes",
        "&use_n=512",
        "&n=256&speed=12M",
        "&ahead=1",
        "&network=controllers",
    ];
    let of_virtual = chips.iter().map(|keys| format!("&clock=virtual{keys}"));
    for keys in of_virtual.chain([String::new(), "&chip_fw=old&int0=yes&rate=0.5".to_owned()]) {
        let mut client = opened(&format!("xf-sim:?slaves=drive*2,io{keys}"), Share::ByName);
        start(&mut client);
        use_everything(&mut client);
        client.go(MasterState::PreOp);
    }
}

/// Through a server, with the server's network as that of `sim:`.
#[test]
fn a_server_shares_it() {
    let (server, _) = support::tcp::serve("xf-sim:?slaves=drive*2,io&clock=virtual");
    let mut client = Client::on(support::tcp::connect(&server, ""));
    assert_eq!(client.link.network().expect("the server knows").slaves, "drive*2,io");
    start(&mut client);
    use_everything(&mut client);
}

/// The native API, on either clock: its axis ends at its target, and closing switches it off.
#[test]
fn the_native_api_runs_on_it() {
    for clock in ["virtual", "real"] {
        let ecm = Ecm::open(&format!("xf-sim:?slaves=drive,io&clock={clock}")).expect(clock);
        let config = Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Io], ..Config::default() };
        ecm.configure(&config).expect(clock);
        ecm.set_state(MasterState::Op).expect(clock);
        ecm.servo_on(&[1]).expect(clock);
        let mut stream = ecm.stream(20).expect(clock);
        let from = stream.snapshot().expect(clock).position(1).expect("an axis");
        for n in 1..=320 {
            stream.csp(1, from + 10 * n.min(300)).expect(clock);
            stream.step().expect(clock);
        }
        stream.finish().expect(clock);
        let at = ecm.next_cycle(Duration::from_secs(5)).expect(clock).position(1).expect("an axis");
        assert!((at - from - 3000).abs() <= 2, "{clock}: at {at}, from {from}");
        ecm.set_outputs(2, 0x0F0F).expect(clock);
        assert_eq!(ecm.sdo_read::<u32>(1, ObjectAddress::new(0x1018, 1)).expect(clock), 0x4543_4D53);
        ecm.close(Close::ServoOff).expect(clock);
    }
}

/// A homing that the drive refuses fails, also behind a chip, where the board shows its effect before the answer to
/// GO_HOME: as the first homing, after a successful one, and after a failed one. A successful homing succeeds after
/// each of them.
#[test]
fn a_homing_that_is_refused_fails_behind_a_chip() {
    for keys in ["", "&use_n=112", "&ahead=1", "&ahead=30"] {
        let ecm = Ecm::open(&format!("xf-sim:?slaves=drive&clock=virtual{keys}")).expect(keys);
        ecm.configure(&Config { slaves: vec![Slave::Drive(Axis::CSP)], ..Config::default() }).expect(keys);
        ecm.set_state(MasterState::Op).expect(keys);
        ecm.servo_on(&[1]).expect(keys);
        for (method, is_well) in
            [(99, false), (35, true), (99, false), (99, false), (35, true), (35, true), (36, false)]
        {
            let ended = ecm.home(1, &Homing::method(method), |_| {});
            assert_eq!(ended.is_ok(), is_well, "{keys}: method {method}: {ended:?}");
        }
        ecm.close(Close::ServoOff).expect(keys);
    }
}

/// Scripts have the same events as for `sim:`: an alarm that is cleared, a slave that is lost for a time, a cable that
/// is cut before the first slave and plugged in again.
#[test]
fn scripts_act_behind_the_chip() {
    let file = script_client::file("behind-chip", "at 3s alarm 1 0x7500\nat 4s lose 2 for 1s\nat 10s cut 1 for 1s\n");
    let uri = format!("xf-sim:?slaves=drive*2,io&clock=virtual&script={}", file.display());
    let mut client = opened(&uri, Share::ByName);
    start(&mut client);
    client.until("the alarm", |client| drive(client, 1).error_code == 0x7500);
    client.slave(1, SlaveCommand::AlarmClear);
    client.until("it is cleared", |client| drive(client, 1).error_code == 0);

    let failed = StateByte::failed(Some(MasterState::Op));
    for slaves in ["slave 2 is lost", "all are lost"] {
        client.until(slaves, |client| client.answer().state == failed);
        // Until it has returned the change fails.
        while client.answer().state != OP {
            client.master(MasterCommand::SetState(MasterState::Op));
            for _ in 0..500 {
                client.read();
            }
        }
    }
    client.slave(1, SlaveCommand::ServoOn);
    client.until("servo on", |client| drive(client, 1).statusword.is_enabled());
    use_everything(&mut client);
}

/// A closed board is found again unchanged, including the chip's state; on the real clock it has gone on meanwhile.
#[test]
fn a_closed_board_is_found_again_behind_its_chip() {
    for (clock, passes_ms) in [("virtual", 0), ("real", 50)] {
        let uri = format!("xf-sim:?slaves=drive*2,io&clock={clock}&ahead=9");
        let mut client = opened(&uri, Share::ByUri);
        start(&mut client);
        let closed_at = client.read().at.0;
        client.link.close();
        std::thread::sleep(Duration::from_millis(passes_ms));
        let mut again = opened(&format!("{uri}&queue=7"), Share::ByUri);
        assert_eq!(state(&mut again), OP, "{clock}");
        assert!(drive(&again, 1).statusword.is_enabled(), "{clock}");
        assert!(again.read().at.0 >= closed_at + passes_ms * MS, "{clock}");
        use_everything(&mut again);
    }
}

/// Other keys of the chip are another board: a name has one set of them.
#[test]
fn the_keys_of_the_chip_tell_boards_apart() {
    let uri = "xf-sim:?clock=virtual&name=chips";
    opened(uri, Share::ByName).link.close();
    for other in ["&ahead=9", "&chip_fw=old", "&n=512", "&int0=yes", "&idle_us=200", "&use_n=512", "&speed=12M"] {
        let error = open(&format!("{uri}{other}"), Share::ByName).err().expect(other).to_string();
        assert!(error.contains("with other options"), "{other}: {error}");
    }
    let error = open("sim:?clock=virtual&name=chips", Share::ByName).err().expect("sim:").to_string();
    assert!(error.contains("with other options"), "{error}");
    opened(uri, Share::ByName);
}

/// SK-4.33 After SW_RESET the link is dead, and the board can be opened again when it has booted: the chip has gone on.
#[test]
fn a_reset_board_comes_back_behind_its_chip() {
    let uri = "xf-sim:?slaves=drive*2,io&clock=virtual";
    let mut client = opened(uri, Share::ByUri);
    start(&mut client);
    client.link.write(&soft_reset(), Wait::Forever).expect("it is taken");
    assert!(matches!(client.try_read(Wait::Forever), Err(LinkError::Lost { .. })));
    client.link.close();
    let again = |_| open(uri, Share::ByUri).ok();
    let mut again = (0..200).find_map(again).expect("it has booted");
    assert_eq!(state(&mut again), PRE_OP);
    start(&mut again);
    use_everything(&mut again);
}

/// SK-9.16 Without a slave it is refused as a board of `sim:` is.
#[test]
fn a_board_without_slaves_behind_its_chip_does_not_open() {
    let said = |scheme: &str| {
        let uri = format!("{scheme}:?slaves=none&clock=virtual");
        let Err(LinkError::NoBoard { name, reason }) = open(&uri, Share::ByName) else { panic!("{uri} is refused") };
        assert_eq!(name, uri);
        reason
    };
    assert_eq!(said("xf-sim"), said("sim"));
}

/// The same link can be opened as a board or as the chip itself: `record=` records frames or exchanges, respectively,
/// and keys of a board do not affect a host of the chip.
#[test]
fn the_same_link_is_the_chip_itself() {
    let folder = tempfile::tempdir().expect("a folder");
    let uri = |file: &Path| {
        let file = file.display();
        format!("xf-sim:?slaves=drive,io&slot=16&clock=virtual&ahead=5&queue=3&record={file}")
    };
    let [of_board, of_chip] = ["board", "chip"].map(|name| folder.path().join(name));

    let link = link::open(&uri(&of_board), Share::ByName).expect("a board");
    let mut report = ecmsk::sk::Frame::new();
    link.read(&mut report, Wait::Forever).expect("a report");
    drop(link);
    let is_of_chip = |file: &Path| is_of_chip(&fs::read(file).expect("a file"));
    assert!(!is_of_chip(&of_board));
    let frames: Vec<_> = Recording::open(&of_board).expect("a recording").map(|frame| frame.expect("whole")).collect();
    assert_eq!(frames.iter().map(|frame| frame.dir).collect::<Vec<_>>(), [Dir::Read]);

    let (wires, _) = chip::open(&uri(&of_chip)).expect("a chip");
    assert_eq!(wires.info().name, uri(&of_chip));
    drop(wires);
    let mut xf = Xf::open(&uri(&of_chip)).expect("a chip");
    xf.start_network(&NetworkConfig::default()).expect("its network");
    drop(xf);
    let exchanges = Exchanges::new(File::open(&of_chip).expect("a file"), "chip").expect("a recording");
    assert!(is_of_chip(&of_chip) && exchanges.count() > 20);
}
