//! Boards in this process by their links: found again, shared by name, in use, lost and returned.

use std::sync::{Arc, Barrier};
use std::thread;
use std::time::Duration;

use ecmsk::link::keys::Scheme;
use ecmsk::link::{self, LinkError, Share, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterState, SlaveCommand, SlaveKind, SlotSize, StateByte};

use crate::client::{Client, MS, soft_reset};

fn open(uri: &str, share: Share) -> Result<Client, LinkError> {
    link::open(uri, share).map(Client::on)
}

/// Opens; there must be no error.
fn opened(uri: &str, share: Share) -> Client {
    open(uri, share).unwrap_or_else(|error| panic!("{uri}: {error}"))
}

fn refused(uri: &str, share: Share) -> LinkError {
    open(uri, share).err().unwrap_or_else(|| panic!("{uri} was opened"))
}

fn state(client: &mut Client) -> StateByte {
    client.read();
    client.answer().state
}

const PRE_OP: StateByte = StateByte::reached(MasterState::PreOp);
const OP: StateByte = StateByte::reached(MasterState::Op);

/// A closed board is found again unchanged: by its options if links share that way. Options of only the link (limits,
/// the length of the queue) may differ.
#[test]
fn a_closed_board_is_found_again() {
    let uri = "sim:?clock=virtual&slaves=drive*5";
    let mut client = opened(uri, Share::ByUri);
    client.op();
    let closed_at = client.read().at;
    client.link.close();
    let mut again = opened(&format!("{uri}&read_timeout_ms=50&queue=7"), Share::ByUri);
    assert_eq!(state(&mut again), OP);
    let meta = again.read();
    assert_eq!((meta.sequence, meta.at.0), (1, closed_at.0 + 2 * MS), "no virtual time has passed while it was closed");
    // Dropping the link closes it.
    drop(again);
    assert_eq!(state(&mut opened(uri, Share::ByUri)), OP);
    // Other options are another board.
    assert_eq!(state(&mut opened("sim:?clock=virtual&slaves=drive*6", Share::ByUri)), PRE_OP);
}

/// On the real clock the board has gone on meanwhile.
#[test]
fn a_closed_board_goes_on_in_real_time() {
    let uri = "sim:?clock=real&slaves=drive*5";
    let mut client = opened(uri, Share::ByUri);
    client.op();
    let closed_at = client.read().at;
    client.link.close();
    thread::sleep(Duration::from_millis(50));
    let mut again = opened(uri, Share::ByUri);
    assert_eq!(state(&mut again), OP);
    assert!(again.read().at.0 >= closed_at.0 + 50 * MS);
}

/// Links share a board by its name, however they share otherwise; without a name a board belongs to its link.
#[test]
fn a_name_shares_a_board() {
    let uri = "sim:?clock=virtual&name=shared";
    let mut client = opened(uri, Share::ByName);
    client.op();
    client.link.close();
    for share in [Share::ByUri, Share::ByName] {
        let mut again = opened(uri, share);
        assert_eq!(state(&mut again), OP, "{share:?}");
    }
    // Without a name: two boards at once, each its own.
    let uri = "sim:?clock=virtual&slaves=drive*7";
    let mut first = opened(uri, Share::ByName);
    first.op();
    let mut second = opened(uri, Share::ByName);
    assert_eq!(state(&mut second), PRE_OP);
    drop(first);
    assert_eq!(state(&mut opened(uri, Share::ByName)), PRE_OP);
}

/// A board can be open only once: until it is closed, another link gets an error that it is in use, with the next step.
#[test]
fn a_second_open_is_in_use() {
    for (uri, share) in [
        ("sim:?clock=virtual&name=one", Share::ByName),
        ("sim:?clock=virtual&slaves=drive*8", Share::ByUri),
        ("sim:?clock=real&slaves=drive*8", Share::ByUri),
    ] {
        let client = opened(uri, share);
        for _ in 0..3 {
            let error = refused(uri, share);
            assert!(matches!(error, LinkError::InUse { .. }), "{error:?}");
            let text = error.to_string();
            assert!(text.contains("in use by this process") && text.contains("close it there"), "{text}");
        }
        client.link.close();
        opened(uri, share);
    }
}

/// Many threads that open one board at once: one of them gets it, the others get an error.
#[test]
fn one_of_many_gets_the_board() {
    for round in 0..20 {
        let uri = format!("sim:?clock=virtual&name=race{}", round % 2);
        let start = Arc::new(Barrier::new(6));
        let all: Vec<_> = (0..6)
            .map(|_| {
                let (uri, start) = (uri.clone(), Arc::clone(&start));
                thread::spawn(move || {
                    start.wait();
                    let opened = open(&uri, Share::ByName);
                    start.wait();
                    opened.map(drop)
                })
            })
            .collect();
        let ended: Vec<_> = all.into_iter().map(|thread| thread.join().unwrap()).collect();
        assert_eq!(ended.iter().filter(|end| end.is_ok()).count(), 1, "{ended:?}");
        assert_eq!(ended.iter().filter(|end| matches!(end, Err(LinkError::InUse { .. }))).count(), 5, "{ended:?}");
    }
}

/// The same name with other options is an error, while the board is open and afterwards.
#[test]
fn a_name_has_one_set_of_options() {
    let client = opened("sim:?clock=virtual&name=fixed&slaves=drive*2", Share::ByName);
    let other = "sim:?clock=virtual&name=fixed&slaves=drive*3";
    for _ in 0..2 {
        let text = refused(other, Share::ByName).to_string();
        assert!(
            text.contains("name=fixed") && text.contains("other options") && text.contains("another `name=`"),
            "{text}"
        );
        client.link.close();
    }
    opened("sim:?clock=virtual&name=fixed&slaves=drive*2", Share::ByUri);
}

/// SK-9.16 Opening fails if no slave was found; LIB-42 at once, each time, with a text that says what to do.
#[test]
fn a_board_without_slaves_does_not_open() {
    for clock in ["real", "virtual"] {
        for share in [Share::ByName, Share::ByUri] {
            let uri = format!("sim:?slaves=none&clock={clock}");
            for _ in 0..3 {
                let error = refused(&uri, share);
                assert!(matches!(error, LinkError::NoBoard { .. }), "{error:?}");
                let text = error.to_string();
                assert!(text.contains("no slave") && text.contains("`slaves=`"), "{text}");
            }
        }
    }
}

/// A link that this build does not support is an error that names it and the way to run without a board.
#[test]
fn links_that_are_not_in_this_build() {
    for scheme in Scheme::ALL.into_iter().filter(|scheme| !scheme.in_build()) {
        let path = match scheme {
            Scheme::Sim | Scheme::Usb | Scheme::XfSim | Scheme::XfUsb => "",
            Scheme::Spi | Scheme::XfSpi => "/dev/spidev0.0",
            Scheme::Tcp => "//localhost:5000",
            Scheme::Nic => "eth1",
        };
        let error = refused(&format!("{scheme}:{path}"), Share::ByUri);
        let text = error.to_string();
        assert!(matches!(&error, LinkError::Unsupported { scheme: named, .. } if named == scheme.name()), "{error:?}");
        for part in [&format!("`{scheme}:`"), "sim:?slaves=drive*2", "ecmsk link help"] {
            assert!(text.contains(part), "{text}: no {part}");
        }
    }
    for uri in ["", "board", "simm:", "sim:?slave=drive"] {
        assert!(matches!(refused(uri, Share::ByUri), LinkError::Uri(_)), "{uri}");
    }
}

/// LIB-43 On virtual time a failed open advances the board by 50 ms, so that a loop that opens again after SW_RESET ends.
/// LIB-49 After SW_RESET the link is dead until it is opened again.
/// SK-4.33 All variables are reset.
#[test]
fn a_loop_of_opens_after_a_reset_ends() {
    let uri = "sim:?clock=virtual&slaves=drive*9";
    let mut client = opened(uri, Share::ByUri);
    client.op();
    let reset_at = client.link.write(&soft_reset(), Wait::Forever).unwrap();
    assert!(matches!(client.try_read(Wait::Forever), Err(LinkError::Lost { .. })));
    assert!(matches!(refused(uri, Share::ByUri), LinkError::InUse { .. }), "the dead link holds it");
    client.link.close();
    let mut fails = 0;
    let mut again = loop {
        match open(uri, Share::ByUri) {
            Ok(again) => break again,
            Err(LinkError::NoBoard { reason, .. }) => assert!(reason.contains("booting"), "{reason}"),
            Err(other) => panic!("{other}"),
        }
        fails += 1;
        assert!(fails < 100);
    };
    let opened_at = again.link.info().opened_at.0;
    let passed = opened_at - reset_at.0;
    assert!(fails >= 1 && (fails..=fails + 1).contains(&(passed / (50 * MS))), "{passed} ns, {fails} failed");
    assert_eq!(state(&mut again), PRE_OP);
    assert_eq!(again.answer().id, 0, "SW_RESET has no answer");
}

/// LIB-49 On the real clock it comes back by itself, whatever `catch_up_ms` says.
#[test]
fn a_reset_board_comes_back_in_real_time() {
    for catch_up in [0, 60_000] {
        let uri = format!("sim:?slaves=drive*9&catch_up_ms={catch_up}");
        let client = opened(&uri, Share::ByUri);
        client.write(&soft_reset());
        client.link.close();
        let tries = (0..3000).find_map(|_| match open(&uri, Share::ByUri) {
            Ok(again) => Some(again),
            Err(LinkError::NoBoard { .. }) => {
                thread::sleep(Duration::from_millis(10));
                None
            }
            Err(other) => panic!("{other}"),
        });
        assert_eq!(state(&mut tries.expect("it has booted by now")), PRE_OP, "catch_up_ms={catch_up}");
    }
}

/// SK-3.17 A list of slaves of two kinds: an IO slave behind two drives, whose outputs come back as its inputs.
#[test]
fn an_io_slave_in_a_link() {
    let mut client = opened("sim:?clock=virtual&slaves=drive*2,io", Share::ByName);
    let mut kinds = [SlaveKind::Drive; 8];
    kinds[2] = SlaveKind::Io;
    client.master(MasterCommand::SetAxis { group: 0, kinds });
    client.read();
    assert_eq!(client.answer().result, 3, "three slaves");
    client.go(MasterState::Op);
    client.slave(3, SlaveCommand::IoWrite(0x5AC3));
    client.until("the output image", |client| (client.slot(3).id, client.slot(3).data1) == (0x14, 0x5AC3));
    client.slave(3, SlaveCommand::IoRead);
    client.until("the inputs", |client| (client.slot(3).id, client.slot(3).data1) == (0x13, 0x5AC3));
}

/// SK-1.2 The options in the URI are those of the link and of the board.
#[test]
fn options_reach_the_board() {
    let client =
        opened("sim:?slot=16&clock=virtual&slaves=drive&read_timeout_ms=20&write_timeout_ms=30", Share::ByName);
    let info = client.link.info();
    assert_eq!((info.slot, info.virtual_time), (Some(SlotSize::Bytes16), true));
    assert_eq!(info.read_wait, Wait::For(Duration::from_millis(20)));
    assert_eq!(info.write_wait, Wait::For(Duration::from_millis(30)));
    assert!(info.name.starts_with("sim:?") && info.name.contains("slot=16"), "{}", info.name);
    let mut report = Frame::new();
    client.link.read(&mut report, info.read_wait).unwrap();
    assert_eq!(report.crc_byte(), report.crc(SlotSize::Bytes16));
    assert_eq!(client.link.stats().read, 1);
}
