//! The log's messages about commands that a board in this process has not executed, and about a chip with an unknown
//! CRC-32; and about targets beyond the limits of a machine file.
//!
//! A process has one log: in a program with other tests it would contain messages of their boards, too.

use ecmsk::cia402::Mode;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::ecm::{Config, Ecm};
use ecmsk::engine::StateFailure;
use ecmsk::ethercat::Ns;
use ecmsk::link::chip::{ChipBoard, ChipError, ChipInfo, ChipLink, SimChip};
use ecmsk::link::uri::LinkUri;
use ecmsk::sk::{DriveSync, Frame, MasterState, Motion, SdoCommand, SlaveCommand, SlaveKind, StateByte};
use ecmsk::xf::host::{HostConfig, HostError, Wires};
use ecmsk::xf_api::Xf;
use support::heard::{lines_with, listen};
use support::script_client::{Client, SIZE};

/// SK-4.78 For a program that writes faster than the board executes commands there is one message when the first frame
/// is lost, and one with the number of lost frames when this has ended.
#[test]
fn a_full_fifo_is_told_when_it_begins_and_when_it_ends() {
    let _turn = listen();
    let mut client = Client::stepped("log_full", "");
    client.op();
    let frame = Frame::new();
    // The FIFO has 160 entries, and each write takes an eighth of a cycle.
    for _ in 0..1000 {
        client.link.write(&frame, ecmsk::link::Wait::Forever).unwrap();
    }
    let lost = client.link.stats().board.expect("a board of this process").full;
    assert!(lost > 500, "{lost}");
    let told = lines_with(&["FIFO full"]);
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].contains("1 command frame(s)") && told[0].contains("slot 0"), "{told:?}");
    for _ in 0..1200 {
        client.read();
    }
    let told = lines_with(&["FIFO full"]);
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(told[1].contains(&format!("{lost} command frame(s)")), "{told:?}");
    client.link.close();
    assert_eq!(lines_with(&["FIFO full"]).len(), 2);
}

/// SK-4.78 Targets before SV_ON are logged with the next step; a link that is closed first logs the count.
#[test]
fn targets_for_a_drive_that_is_off_are_logged_with_the_next_step() {
    let _turn = listen();
    let mut client = Client::stepped("log_targets", "");
    client.op();
    for n in 0..50 {
        client.write(|f| f.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(n)).into()));
        client.read();
    }
    client.link.close();
    let told = lines_with(&["for a drive that was not on"]);
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(told[0].contains("SV_ON") && told[1].contains("50 target(s)"), "{told:?}");
}

/// SK-4.79 A write of an object that the simulated drive lacks is logged with the object, and how to add it.
#[test]
fn an_aborted_sdo_write_is_logged_with_its_object() {
    let _turn = listen();
    let mut client = Client::stepped("log_abort", "");
    let object = ObjectAddress::new(0x2101, 3);
    let command = SdoCommand::Write { slave: 2, object, size: SdoSize::Two, value: 7 };
    client.write(|f| f.put_sdo(SIZE, &command));
    client.until("the abort", |c| c.slot(SIZE.sdo_slot()).parm == 0x8002);
    client.read();
    let told = lines_with(&["SDO_WR of slave 2, 0x2101:3"]);
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].contains("0x06020000") && told[0].contains("objects@any"), "{told:?}");
    assert_eq!(client.link.stats().board.expect("a board of this process").sdo_aborted, 1);
}

/// SK-4.80 A failed change of state is logged with the slave that refused and the reason; the link returns both until
/// the state is reached.
#[test]
fn a_state_that_failed_is_explained() {
    let _turn = listen();
    let mut client = Client::with("drive,io", "log_state", "clock=virtual", "");
    // No kinds are declared: both are IO.
    client.request(MasterState::Op);
    client.until("0x12", |c| c.answer().state == StateByte::failed(Some(MasterState::PreOp)));
    let why = client.link.stats().state_failure.expect("a board of this process knows");
    assert!(matches!(why, StateFailure::Declared { slave: 1, kind: SlaveKind::Io, al_status: 0x001D, abort: None }));
    let told = lines_with(&["a change of state has failed"]);
    assert!(told.len() == 1 && told[0].contains("slave 1") && told[0].contains("SET_AXIS"), "{told:?}");
    assert_eq!(StateFailure::explain(client.answer().state, Some(&why)), Some(why.to_string()));
    client.op();
    assert_eq!(client.link.stats().state_failure, None);
    assert_eq!(StateFailure::explain(client.answer().state, None), None);
}

/// If a program closes the board while the change to OP is still in progress, this is logged; not if it has requested a
/// lower state, or is in OP.
#[test]
fn a_change_under_way_at_the_end_is_told() {
    let _turn = listen();
    const WORDS: &str = "was still under way when the program closed the board";
    let mut client = Client::stepped("log_gives_up", "");
    client.declare();
    client.request(MasterState::Op);
    client.read();
    client.link.close();
    let told = lines_with(&[WORDS]);
    assert!(told.len() == 1 && told[0].contains("SET_STATE OP") && told[0].contains(" ms)"), "{told:?}");

    let mut client = Client::stepped("log_ends", "");
    client.op();
    client.request(MasterState::Init);
    client.link.close();
    assert_eq!(lines_with(&[WORDS]).len(), 1, "only the first one");
}

/// SK-4.80 A mode that a kind does not have, a slave that refuses a state and one that does not answer are
/// distinguished.
#[test]
fn each_kind_of_failed_state_change_has_its_own_explanation() {
    let _turn = listen();
    let fails = |list: &str, name: &str, script: &str, mode: Mode| {
        let mut client = Client::with(list, name, "clock=virtual&state_timeout_ms=500", script);
        client.declare();
        let sync = DriveSync::DcSync;
        client.write(|f| f.put_slave(SIZE, 1, &SlaveCommand::DriveMode { mode, sync }.into()));
        client.request(MasterState::Op);
        client.until("a failure", |c| c.answer().state.is_failed());
        client.link.stats().state_failure
    };
    let mode = StateFailure::Mode { slave: 1, kind: SlaveKind::Step };
    assert_eq!(fails("step", "log_mode", "", Mode::Csv), Some(mode));
    let refused = StateFailure::Refused { slave: 2, target: MasterState::Op, al_status: 0x001B };
    assert_eq!(fails("drive*2", "log_refused", "refuse 2 op 0x001B\n", Mode::Csp), Some(refused));
    let silent = StateFailure::Silent { slave: 1 };
    assert_eq!(fails("drive*2", "log_silent", "mute 1\n", Mode::Csp), Some(silent));
}

/// SK-4.80 Without a board of this process there is a text for every state byte that means a failure, and for no other;
/// the one for 0x12 names the usual cause.
#[test]
fn every_failed_state_has_an_explanation() {
    for byte in 0..=u8::MAX {
        let state = StateByte(byte);
        assert_eq!(state.explanation().is_some(), state.is_failed(), "0x{byte:02X}");
        assert_eq!(StateFailure::explain(state, None).as_deref(), state.explanation());
    }
    let usual = StateByte(0x12).explanation().expect("it has failed");
    assert!(usual.contains("SET_AXIS") && usual.contains("not at all"), "{usual}");
}

/// A chip that accepts no packet with a CRC-32, whatever that covers.
struct StrangeCrc(SimChip);

impl StrangeCrc {
    const URI: &str = "xf-sim:?slaves=drive&clock=virtual";
    const START: [u8; 4] = [0xA4, 0xA3, 0xA2, 0xA1];
    const FIXED: [u8; 4] = [0x78, 0x56, 0x34, 0x12];

    fn new() -> Self {
        Self(SimChip::from_uri(&Self::uri()).unwrap())
    }

    fn uri() -> LinkUri {
        LinkUri::parse(Self::URI).unwrap()
    }
}

impl Wires for StrangeCrc {
    type Error = ChipError;

    fn now(&self) -> Ns {
        self.0.now()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), ChipError> {
        let mut taken = to_chip.to_vec();
        if taken.starts_with(&Self::START) {
            let check = taken.len() - 8;
            taken[check] ^= if taken[check..][..4] == Self::FIXED { 0 } else { 0xFF };
        }
        self.0.exchange(&taken, from_chip)
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), ChipError> {
        self.0.wait_until(time)
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, ChipError> {
        self.0.wait_ready(until)
    }
}

impl ChipLink for StrangeCrc {
    fn info(&self) -> ChipInfo {
        self.0.info()
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        self.0.int1()
    }
}

/// XF-12.17 A chip with an unknown coverage of its CRC-32 is logged once at its opening, with the consequence for the
/// wires: for a board over the chip, and for a program that uses the chip itself. For a chip with a known CRC-32
/// nothing is logged.
#[test]
fn a_crc_that_is_given_up_is_told() {
    let _turn = listen();
    let told = || lines_with(&[HostError::CRC_GIVEN_UP]);
    let board = ChipBoard::from_uri(&StrangeCrc::uri()).unwrap();
    for coverage in ["all", "valid", "valid4"] {
        let uri = format!("{}&crc_over={coverage}", StrangeCrc::URI);
        Xf::over(SimChip::from_uri(&LinkUri::parse(&uri).unwrap()).unwrap(), HostConfig::DEFAULT).unwrap().leave();
    }
    assert!(told().is_empty());
    drop(board.open_over(Box::new(StrangeCrc::new())).unwrap());
    assert!(told().len() == 1 && told()[0].starts_with("xf-sim:"), "{:?}", told());
    Xf::over(StrangeCrc::new(), HostConfig::DEFAULT).unwrap().leave();
    assert_eq!(told().len(), 2);
    assert!(told()[1].contains("keep the wires short"), "{:?}", told());
}

/// A drive that is on, whose machine file allows -1 mm to 2.5 mm and has this word for programs.
fn limited(program: &str) -> (Ecm, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("machine.toml");
    let text = format!(
        "format = 1\n[axes]\nX = {{ slave = 1, unit = \"mm\", per = 0.001, min = -1, max = 2.5 }}\n[limits]\nprogram = \"{program}\"\n"
    );
    std::fs::write(&file, text).unwrap();
    let name = folder.path().file_name().unwrap().to_str().unwrap().trim_start_matches('.').to_owned();
    let ecm = Ecm::open(&format!("sim:?slaves=drive&clock=virtual&name={name}&axes={}", file.display())).unwrap();
    ecm.configure(&Config::drives(1)).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    ecm.servo_on(&[1]).unwrap();
    (ecm, folder)
}

/// A target of a program beyond a limit of the machine file is told once for each excursion, with axis, target, limit and time,
/// and is sent.
#[test]
fn a_target_beyond_a_limit_is_told_once_for_each_excursion() {
    let _turn = listen();
    let (ecm, _folder) = limited("report");
    let mut stream = ecm.stream(8).unwrap();
    for hundredth in (0..=300).chain((-150..=300).rev()).chain(-150..=0) {
        stream.csp(1, hundredth * 10).unwrap();
        stream.step().unwrap();
    }
    stream.finish().unwrap();
    let told = lines_with(&["axis X: a target of "]);
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(
        told[0].contains("axis X: a target of 2.51 mm at ") && told[0].contains(" s is beyond max = 2.5 mm of "),
        "{told:?}"
    );
    assert!(
        told[1].contains("axis X: a target of -1.01 mm at ") && told[1].contains(" s is beyond min = -1 mm of "),
        "{told:?}"
    );
}

/// If the machine file says so, a target that leads beyond a limit is not sent: the write fails, and the axis stands at the
/// limit.
#[test]
fn a_target_beyond_a_limit_is_not_sent_if_the_file_says_so() {
    let _turn = listen();
    let (ecm, _folder) = limited("stop");
    let mut stream = ecm.stream(8).unwrap();
    let error = (0..=300).find_map(|hundredth| {
        stream.csp(1, hundredth * 10).unwrap();
        stream.step().err()
    });
    let error = error.expect("it is refused").to_string();
    assert!(error.contains("axis X: a target of 2.51 mm at "), "{error}");
    assert!(error.contains("; the frame was sent without its targets (CSP); "), "{error}");
    drop(stream);
    let told = lines_with(&["axis X: a target of ", "it is not sent"]);
    assert_eq!(told.len(), 1, "{told:?}");
    let position = (0..200).map(|_| ecm.snapshot().unwrap().position(1).unwrap()).max();
    assert!(position.is_some_and(|position| position < 2_505), "{position:?}");
}
