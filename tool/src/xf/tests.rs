//! Tests of `xf` verbs on a model of the chip that keeps running between the verbs, as a real chip does.

use std::sync::{Arc, Mutex, PoisonError};

use ecmsk::ethercat::Ns;
use ecmsk::link::chip::{ChipError, ChipInfo, ChipLink, SimChip};
use ecmsk::link::uri::LinkUri;
use ecmsk::xf::host::{HostConfig, Wires};
use ecmsk::xf::request::{FifoEnable, HelperStatuswordGet, MotorNumber, Reconfig, Slaves};
use ecmsk::xf::{EtherCatState, Status};
use ecmsk::xf_api::{NetworkConfig, ProcessData, Xf};
use serde_json::Value;

use super::session::{ChipArgs, Session};
use super::{Shown, info, pdo, scan, sdo, state};
use crate::step::object::Object;
use crate::transfer::{Transfer, Written};

/// A link to a chip that keeps running when the link is closed.
#[derive(Clone)]
struct Lasting(Arc<Mutex<SimChip>>);

impl Lasting {
    fn new(uri: &str) -> Self {
        let uri = LinkUri::parse(uri).expect("a link");
        Self(Arc::new(Mutex::new(SimChip::from_uri(&uri).expect("a chip"))))
    }

    fn with<T>(&self, use_it: impl FnOnce(&mut SimChip) -> T) -> T {
        use_it(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Opens the chip as a verb of the tool does.
    fn session(&self) -> Session {
        Session::over(Box::new(self.clone()), HostConfig::DEFAULT, false).expect("it starts")
    }
}

impl Wires for Lasting {
    type Error = ChipError;

    fn now(&self) -> Ns {
        self.with(|chip| chip.now())
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), ChipError> {
        self.with(|chip| chip.exchange(to_chip, from_chip))
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), ChipError> {
        self.with(|chip| chip.wait_until(time))
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, ChipError> {
        self.with(|chip| chip.wait_ready(until))
    }
}

impl ChipLink for Lasting {
    fn info(&self) -> ChipInfo {
        self.with(|chip| chip.info())
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        self.with(|chip| chip.int1())
    }
}

/// A chip with a drive and an IO slave. A program has brought it to OP and then ended. It has left the FIFO on or off,
/// with three sets of outputs in it.
fn running(fifo_on: bool) -> (Lasting, ProcessData) {
    let chip = Lasting::new("xf-sim:?slaves=drive,io&clock=virtual");
    let mut xf = Xf::over(chip.clone(), HostConfig::DEFAULT).expect("it starts");
    xf.start_network(&NetworkConfig::default()).expect("a network");
    xf.set_state(Slaves::All, EtherCatState::PreOp).expect("PreOP");
    xf.run(&Reconfig).expect("process data");
    xf.set_state(Slaves::All, EtherCatState::SafeOp).expect("SafeOP");
    let mut data = xf.process_data().expect("a layout");
    xf.set_state(Slaves::All, EtherCatState::Op).expect("OP");
    xf.run(&FifoEnable { on: fifo_on }).expect("the FIFO");
    for _ in 0..3 {
        xf.cycle(&mut data).expect("there is room");
    }
    xf.leave();
    (chip, data)
}

fn json(shown: &[Shown]) -> Vec<&Value> {
    shown.iter().map(|(_, json)| json).collect()
}

/// XF-18.4 Verbs that only read do not change the chip of a running machine: its network stays in OP, its FIFO stays
/// on, and the FIFO keeps its content.
#[test]
fn verbs_that_look_leave_a_running_machine_alone() {
    let (chip, _) = running(true);
    for _ in 0..2 {
        let mut session = chip.session();
        let shown = info::info(&mut session).expect("it answers");
        assert_eq!(json(&shown)[0]["state"], "OP");
        scan::scan(&mut session, false).expect("it answers");
        state::state(&mut session, None, None).expect("it answers");
        let header = session.xf.header();
        assert_eq!(header.state.state(), Some(EtherCatState::Op));
        assert!(header.status.contains(Status::FIFO_ON));
    }
    let (chip, _) = running(false);
    for _ in 0..2 {
        let mut session = chip.session();
        session.xf.pass(std::time::Duration::from_millis(50)).expect("it answers");
        let shown = info::info(&mut session).expect("it answers");
        assert_eq!(json(&shown)[0]["rx_fifo_level"], 3, "{shown:?}");
        assert!(!session.xf.header().status.contains(Status::FIFO_ON));
    }
}

/// XF-18.3, XF-18.4 `scan` shows what the chip knows about a network above Init. It initialises such a network again
/// only with `--force`.
#[test]
fn scan_initialises_a_network_above_init_only_by_force() {
    let (chip, _) = running(true);
    let mut session = chip.session();
    let shown = scan::scan(&mut session, false).expect("it answers");
    let states: Vec<_> = json(&shown).iter().map(|slave| slave["state"].clone()).collect();
    assert_eq!((states, json(&shown)[1]["output_bytes"].as_u64()), (vec!["OP".into(), "OP".into()], Some(2)));
    let shown = scan::scan(&mut chip.session(), true).expect("it answers");
    assert_eq!(json(&shown)[0]["state"], "PreOP");
    // The first `scan` has brought the network to PreOP, so the second one does not change it.
    let mut session = chip.session();
    assert_eq!(session.state(), Some(EtherCatState::PreOp));
    assert_eq!(scan::scan(&mut session, false).expect("it answers").len(), 2);
}

/// XF-18.6 A state that one verb has set is kept, and the next verb finds it.
#[test]
fn a_state_stays_for_the_next_verb() {
    let chip = Lasting::new("xf-sim:?slaves=drive*2&clock=virtual");
    let shown = state::state(&mut chip.session(), Some(EtherCatState::SafeOp), None).expect("SafeOP");
    assert_eq!(json(&shown)[1]["state"], "SafeOP");
    let shown = state::state(&mut chip.session(), Some(EtherCatState::PreOp), Some(1)).expect("PreOP");
    assert_eq!((shown.len(), &json(&shown)[0]["state"], &json(&shown)[0]["slave"]), (1, &"PreOP".into(), &1.into()));
    let shown = state::state(&mut chip.session(), None, None).expect("it answers");
    let states: Vec<_> = json(&shown).iter().map(|slave| slave["state"].clone()).collect();
    assert_eq!(states, ["SafeOP", "PreOP"]);
}

/// XF-18.5 Errors that the chip had stored before it was opened are shown, although initialising clears them.
#[test]
fn errors_from_before_are_shown() {
    let (chip, _) = running(true);
    let motor = MotorNumber::MAX;
    chip.session().xf.run(&HelperStatuswordGet { motor }).expect_err("nobody has configured that axis");
    let shown = info::info(&mut chip.session()).expect("it answers");
    let errors = json(&shown)[0]["errors"].to_string();
    assert!(errors.contains("command"), "{errors}");
    let shown = info::info(&mut chip.session()).expect("it answers");
    assert!(!json(&shown)[0]["errors"].to_string().contains("command"));
}

/// XF-18.4, XF-18.7, XF-18.8 `sdo` and `pdo` read from a running machine, and it keeps running.
#[test]
fn slaves_of_a_running_machine_are_read() {
    let (chip, _) = running(true);
    let mut session = chip.session();
    let which = |object: &str| sdo::Which {
        slave: 0,
        transfer: Transfer { object: Object::parse(object).expect("an object"), of: None, complete: false },
        chip: ChipArgs::default(),
    };
    let statusword = sdo::read(&mut session, &which("statusword")).expect("an object");
    let shown = pdo::pdo(&mut session, Some(0)).expect("a layout");
    let inputs = &json(&shown)[0]["inputs"]["objects"];
    assert_eq!((&inputs[0]["name"], &inputs[0]["value"]), (&"statusword".into(), &json(&statusword)[0]["value"]));
    let value = Written::parse("-1").expect("a number");
    sdo::write(&mut session, &which("homing_method"), &value).expect("it is writable");
    let written = sdo::read(&mut chip.session(), &which("homing_method")).expect("an object");
    assert_eq!(json(&written)[0]["value"], -1);
    let header = session.xf.header();
    assert!(header.state.state() == Some(EtherCatState::Op) && header.status.contains(Status::FIFO_ON));
}

/// XF-18.7, XF-18.8 In Init no slave has a mailbox. The error says what the user can do, and the state does not change.
#[test]
fn in_init_the_error_says_how_to_go_on() {
    let chip = Lasting::new("xf-sim:?slaves=drive&clock=virtual");
    state::state(&mut chip.session(), None, None).expect("Init");
    let error = pdo::pdo(&mut chip.session(), None).expect_err("Init").to_string();
    assert!(error.contains("is in Init; bring it up with `ecmsk xf state preop`"), "{error}");
    assert_eq!(chip.session().state(), Some(EtherCatState::Init));
    state::state(&mut chip.session(), Some(EtherCatState::SafeOp), None).expect("SafeOP");
    assert_eq!(pdo::pdo(&mut chip.session(), None).expect("a layout").len(), 1);
}
