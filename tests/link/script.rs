//! Scripts of a simulated board's events, `script=`.

use std::fs;
use std::time::Duration;

use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::engine::{Board, EngineConfig, Event, EventKind, Script as _};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::link::script::{Script, ScriptError};
use ecmsk::link::{self, LinkError, Share, simulated_slaves};
use ecmsk::sk::{MasterCommand, MasterResponse, MasterState, RawSlot, SdoCommand, SdoResponse, StateByte};
use ecmsk::slave::{Drive, DriveConfig, Slave};

use support::script_client::{Client, MS, SIZE, file, slaves};

/// A drive's error code: bytes 10..11 of its slot (SK-7).
fn error_code(slot: &RawSlot) -> u16 {
    slot.data2_high()
}

/// An alarm comes in the cycle after its time.
#[test]
fn an_alarm_comes_in_the_cycle_after_its_time() {
    let mut client = Client::stepped("alarm", "at 2.5s alarm 1 0x7500 # communication\n");
    client.op();
    let at = client.until("the alarm", |c| error_code(&c.slot(1)) == 0x7500);
    // Raised at the end of the cycle of 2.5 s, measured in the next.
    assert_eq!(at, 2501 * MS);
    assert_eq!(error_code(&client.slot(2)), 0);
}

/// The same script produces the same bytes.
#[test]
fn the_same_script_gives_the_same_bytes() {
    let run = |name| {
        let text = "at 1s alarm 2 0x5441\nat 1.2s mute 2 for 100ms\nat 1.4s silent for 3ms\nat 1.1s inputs 0x15";
        let mut client = Client::stepped(name, text);
        client.op();
        let mut seen = Vec::new();
        while client.read() < 2000 * MS {
            seen.extend_from_slice(client.report.bytes());
        }
        seen
    };
    assert_eq!(run("same-1"), run("same-2"));
}

/// SK-8.1 Data1 of LIO_RD shows the chip's inputs.
#[test]
fn the_inputs_of_the_chip_change_at_their_time() {
    let mut client = Client::stepped("inputs", "at 10ms inputs 0x15\nat 20ms inputs 42\nat 30ms inputs 0");
    let mut changes = vec![(0, 0)];
    loop {
        client.write(|f| f.put_master(SIZE, &MasterCommand::LocalRead));
        let at = client.read();
        if at > 50 * MS {
            break;
        }
        let inputs = client.answer().result;
        if changes.last().is_none_or(|(_, before)| *before != inputs) {
            changes.push((at, inputs));
        }
    }
    // A command that came after the cycle of 10 ms is answered in the report of the next.
    assert_eq!(changes, [(0, 0), (11 * MS, 0x15), (21 * MS, 42), (31 * MS, 0)]);
}

/// SK-5.4 Frames that find the FIFO full are lost and counted.
#[test]
fn a_full_fifo_loses_frames_until_it_is_emptied_again() {
    let mut client = Client::stepped("full", "at 2s full for 100ms");
    client.op();
    client.until("2 s", |c| c.link.pass(Duration::ZERO).unwrap().unwrap().0 >= c.zero + 2000 * MS);
    for _ in 0..200 {
        client.write(|_| {});
    }
    while client.read() < 2050 * MS {}
    assert_eq!((client.answer().fifo_free, client.answer().full_count), (0, 40));
    let before = client.link.stats().board.unwrap().executed;
    let at = client.until("it goes on", |c| c.answer().fifo_free > 0);
    assert_eq!(at, 2100 * MS);
    client.until("all", |c| c.answer().fifo_free == 160);
    assert_eq!(client.link.stats().board.unwrap().executed - before, 160);
}

#[test]
fn a_silent_board_goes_on_without_reports() {
    let mut client = Client::stepped("silent", "at 100ms silent for 50ms\nat 300ms silent");
    let mut last = 0;
    let mut gaps = Vec::new();
    let error = loop {
        match client.try_read() {
            Ok(meta) => {
                let at = meta.at.0 - client.zero;
                if at - last > MS {
                    gaps.push((last, at));
                }
                last = at;
            }
            Err(error) => break error,
        }
    };
    assert_eq!(gaps, [(99 * MS, 150 * MS)], "a read waits for the script");
    assert_eq!(last, 299 * MS);
    assert_eq!(
        error,
        LinkError::Silent { since_ns: client.zero + last, cycles: 1 },
        "nothing is left that could change it"
    );
}

/// SK-9.12 In OP a cut before the first slave is silence until it heals; SK-9.8 below OP reports go on.
#[test]
fn a_cut_before_the_first_slave_heals_by_itself() {
    let cuts = "at 100ms cut 1 for 50ms\nat 2100ms cut 1 for 50ms\nat 2200ms cut 1\nat 2220ms heal";
    let mut client = Client::stepped("cut-1", cuts);
    let (mut gaps, mut last) = (Vec::new(), 0);
    while last < 2300 * MS {
        let at = client.read();
        if at - last > MS {
            gaps.push((last, at));
        }
        last = at;
        if at == 200 * MS {
            client.op();
            last = client.link.pass(Duration::ZERO).unwrap().unwrap().0 - client.zero;
            assert!(last < 2000 * MS);
        }
    }
    assert_eq!(gaps, [(2099 * MS, 2150 * MS), (2199 * MS, 2220 * MS)]);
}

/// SK-4.14 A slave that refuses makes the change fail; once it no longer does, the change succeeds.
#[test]
fn a_slave_refuses_a_state_for_a_while() {
    let mut client = Client::stepped("refuse", "refuse 2 safeop 0x001E for 2s");
    client.declare();
    client.request(MasterState::SafeOp);
    client.until("the failure", |c| c.answer().state.is_failed());
    while client.read() < 2000 * MS {}
    client.request(MasterState::PreOp);
    client.until("PreOP", |c| c.answer().state == StateByte::reached(MasterState::PreOp));
    client.request(MasterState::SafeOp);
    client.until("SafeOP", |c| c.answer().state == StateByte::reached(MasterState::SafeOp));
}

/// Reads an object of slave 1; returns the answer and its duration in milliseconds.
fn read_sdo(client: &mut Client, index: u16) -> (Result<u32, AbortCode>, u64) {
    let wanted = ObjectAddress::new(index, 0);
    let begin = client.read();
    client.write(|f| f.put_sdo(SIZE, &SdoCommand::Read { slave: 1, object: wanted }));
    let end = client.until("the answer", |c| match SdoResponse::decode(&c.slot(41)) {
        SdoResponse::Done { object, .. } | SdoResponse::Aborted { object, .. } => object == wanted,
        _ => false,
    });
    match SdoResponse::decode(&client.slot(41)) {
        SdoResponse::Done { value, .. } => (Ok(value), (end - begin) / MS),
        SdoResponse::Aborted { code, .. } => (Err(code), (end - begin) / MS),
        other => panic!("{other:?}"),
    }
}

/// SK-6.1 A transfer takes as long as the slave does.
#[test]
fn sdo_transfers_are_slow_or_aborted() {
    let text = "sdo-delay 1 200ms for 1s\nsdo-abort 1 0x6098:0 0x06020000\nat 2s sdo-abort 1 0x08000000 for 1s";
    let mut client = Client::stepped("sdo", text);
    let (value, takes) = read_sdo(&mut client, 0x1000);
    assert!(value.is_ok() && (200..220).contains(&takes), "{value:?} after {takes} ms");
    assert_eq!(read_sdo(&mut client, 0x6098).0, Err(AbortCode(0x0602_0000)));
    while client.read() < 1000 * MS {}
    let (value, takes) = read_sdo(&mut client, 0x1018);
    assert!(value.is_ok() && takes < 20, "{value:?} after {takes} ms");
    while client.read() < 2000 * MS {}
    assert_eq!(read_sdo(&mut client, 0x1000).0, Err(AbortCode(0x0800_0000)));
    while client.read() < 3000 * MS {}
    assert!(read_sdo(&mut client, 0x1018).0.is_ok(), "the end takes back what held");
}

/// On the real clock the lines take effect at the same board times.
#[test]
fn on_the_real_clock_lines_come_at_their_board_time() {
    let mut client = Client::open("real", "queue=1024", "at 40ms silent for 7ms\nat 20ms silent for 3ms");
    let (mut gaps, mut last) = (Vec::new(), 0);
    while last < 60 * MS {
        let at = client.read();
        if at - last > MS {
            gaps.push((last, at));
        }
        last = at;
    }
    assert_eq!(client.link.stats().reports_dropped, 0, "the queue holds them all");
    assert_eq!(gaps, [(19 * MS, 23 * MS), (39 * MS, 47 * MS)]);
}

/// Every opening restarts the script, on a network without faults.
#[test]
fn opening_again_starts_the_script_over() {
    let text = "at 10ms silent\nat 10ms full";
    let mut first = Client::open("again", "clock=virtual&name=script-again", text);
    while first.try_read().is_ok() {}
    first.link.close();
    let mut second = Client::open("again", "clock=virtual&name=script-again", "at 30ms silent");
    assert!(second.zero > first.zero, "it is the same board");
    while second.try_read().is_ok() {}
    let last = second.report.clone();
    second.link.close();
    assert_eq!(MasterResponse::decode(&last.slot(SIZE, 0)).state, StateByte::reached(MasterState::PreOp));
    let mut third = Client::open("again", "clock=virtual&name=script-again", "");
    (0..100).for_each(|_| assert!(third.try_read().is_ok()));
}

/// The same from Rust: a test has the handles, and starts a script on them.
#[test]
fn a_script_in_rust_does_what_the_handles_do() {
    let bus = SimBus::new(vec![Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>]);
    let network = bus.handle();
    let mut board = Board::new(EngineConfig::default(), Box::new(bus));
    assert!(board.boot(60_000 * MS));
    let handle = board.handle();
    let reports = |board: &mut Board, ms: u64| {
        let mut reports = 0;
        let to = board.now() + ms * MS;
        board.advance(to, &mut |_, _| reports += 1);
        reports
    };
    handle.suppress_reports(true);
    assert_eq!(reports(&mut board, 10), 0);
    handle.suppress_reports(false);
    assert_eq!(reports(&mut board, 10), 10);

    let script =
        Script::parse("test", "at 5ms silent for 3ms\nat 2ms cut 1 for 1ms", &slaves("drive")).expect("a script");
    assert_eq!(script.len(), 4);
    let events = board.engine().events_total();
    let run = script.start(network.cable().clone(), board.handle(), board.now());
    assert!(!run.is_over());
    board.set_script(Some(Box::new(run)));
    let counted = allocation_counter::measure(|| assert_eq!(reports(&mut board, 20), 17));
    assert_eq!(counted.count_total, 0, "a script allocates nothing once it runs: {counted:?}");
    let zero = board.now() - 20 * MS;
    let scripted = |after, line, verb, ended: bool| {
        let slave = (verb == "cut" && !ended).then_some(1);
        Event { at: zero + after * MS, kind: EventKind::Scripted { line: Some(line), verb, slave, code: None, ended } }
    };
    assert_eq!(
        board.engine().events_since(events).collect::<Vec<_>>(),
        [
            scripted(2, 2, "cut", false),
            scripted(3, 2, "cut", true),
            scripted(5, 1, "silent", false),
            scripted(8, 1, "silent", true)
        ]
    );
    let event = scripted(3, 2, "cut", true).to_string();
    assert_eq!(event, format!("script, line 2: the end of `cut` at {:.3} s", (zero + 3 * MS) as f64 / 1e9));
    let alarm = Event {
        at: MS,
        kind: EventKind::Scripted { line: Some(1), verb: "alarm", slave: Some(2), code: Some(0x7500), ended: false },
    };
    assert_eq!(alarm.to_string(), "script, line 1: `alarm 2 0x7500` at 0.001 s");
}

/// ECAT-15.24 On a board a line that waits for a master is refused. An invalid script is found before the board is
/// opened, and its name stays free.
#[test]
fn a_wrong_file_opens_nothing() {
    let open = |path: &std::path::Path| {
        let uri = format!("sim:?slaves=drive&clock=virtual&name=script-wrong&script={}", path.display());
        link::open(&uri, Share::ByName).map(drop)
    };
    let wrong = file("wrong", "heal\nat 1s cut 9\n");
    let error = open(&wrong).expect_err("slave 9");
    assert!(matches!(error, LinkError::Script(ScriptError::Line { line: 2, column: 11, .. })), "{error}");
    assert!(error.to_string().starts_with(&format!("{}, line 2, column 11: ", wrong.display())), "{error}");

    let missing = support::out_dir().join("missing.ecmscript");
    let error = open(&missing).expect_err("no file").to_string();
    assert!(error.starts_with(&format!("cannot read the script {}: ", missing.display())), "{error}");
    assert!(error.ends_with("; name another file or leave it out"), "{error}");
    let waits = file("waits", "at 1s heal\nfrom op\nat 1s heal\n");
    let error = open(&waits).expect_err("it waits for OP").to_string();
    assert!(error.contains("line 3") && error.contains("`from` is for `ecmsk serve ethercat` alone"), "{error}");
    open(&support::out_dir()).expect_err("a folder");
    let bytes = support::out_dir().join("bytes.ecmscript");
    fs::write(&bytes, [0xFF, 0xFE]).expect("a file");
    open(&bytes).expect_err("no text");
    let long = file("long", &"#".repeat((1 << 20) + 1));
    assert!(open(&long).expect_err("too long").to_string().contains("more than 1048576 bytes"));
    open(&file("right", &"#".repeat(1 << 20))).expect("the longest");
}

/// The scripts of `examples/` are valid.
#[test]
fn every_example_script_is_valid() {
    let mut found = 0;
    for entry in fs::read_dir(support::root().join("examples/scripts")).expect("the folder") {
        let path = entry.expect("readable").path();
        if path.extension().is_none_or(|extension| extension != "ecmscript") {
            continue;
        }
        let slaves = slaves("drive*2");
        // Scripts for slaves without a board may wait for a master.
        let script = match path.to_string_lossy().ends_with("_on_a_wire.ecmscript") {
            true => simulated_slaves::script(&path, &slaves).map_err(|error| error.to_string()),
            false => Script::load(&path, &slaves).map_err(|error| error.to_string()),
        };
        assert!(!script.unwrap_or_else(|error| panic!("{error}")).is_empty(), "{}", path.display());
        found += 1;
    }
    assert!(found >= 2);
}

mod needs_cxx {
    use super::*;
    use support::{Language, compile, root};

    /// An unmodified program gets the alarm of a script file.
    #[test]
    fn an_unmodified_program_meets_an_alarm() {
        let program = compile(&root().join("examples/cpp/two_axes_12b.cpp"), Language::Cpp("c++17"));
        let script = root().join("examples/scripts/alarm.ecmscript");
        let ended = program.run(&format!("sim:?slaves=drive*2&clock=virtual&script={}", script.display()), [""; 0]);
        assert_eq!(ended.status.code(), Some(1), "{ended:?}");
        assert!(ended.stderr.starts_with("failed: "), "{ended:?}");

        let wrong = file("wrong-for-c", "at 1s alarn 1 1");
        let ended = program.run(&format!("sim:?slaves=drive*2&script={}", wrong.display()), [""; 0]);
        assert_eq!(ended.status.code(), Some(1), "{ended:?}");
    }
}
