//! `ecmsk dump` of the recording of a chip ECM-XF, and the errors of other verbs for such a file.

use std::path::Path;

use ecmsk::coe::ObjectAddress;
use ecmsk::link::chip;
use ecmsk::xf::EtherCatState;
use ecmsk::xf::host::Wires;
use ecmsk::xf::request::Slaves;
use ecmsk::xf_api::{NetworkConfig, Xf};

use crate::common::{Ran, ecmsk};

fn run(words: &[&str]) -> Ran {
    ecmsk(words).output().expect("the tool starts").into()
}

fn link(file: &Path) -> String {
    format!("xf-sim:?slaves=drive&clock=virtual&chip_fw=old&record={}", file.display())
}

/// XF-15.7 `dump` shows commands of a chip's recording by name with their fields, and answers by the name of the command with
/// the state, errors and FIFOs of the header. Answers "not ready" and damaged packets are shown as such. `--hex` adds the
/// bytes, `--json` has the numbers.
#[test]
fn packets_are_shown_in_words() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    let mut xf = Xf::open(&link(&file)).expect("it starts");
    xf.start_network(&NetworkConfig::default()).expect("a network");
    xf.set_state(Slaves::All, EtherCatState::PreOp).expect("PreOP");
    xf.sdo_write(0, ObjectAddress::new(0x6060, 0), 8_i8).expect("CSP");
    drop(xf);
    let (mut wires, _) = chip::open(&link(&file)).expect("a chip");
    wires.exchange(&[0xEE; 144], &mut [0; 144]).expect("it passes");
    wires.exchange(&[0xEE; 10], &mut [0; 10]).expect("it passes");
    drop(wires);
    let file = file.to_str().expect("UTF-8");
    let dumped = run(&["dump", file]);
    assert_eq!((dumped.code, dumped.err.as_str()), (Some(0), ""), "{dumped:?}");
    for part in [
        "# xf-sim:?slaves=drive&clock=virtual&chip_fw=old\n",
        "ECM_CMD_FW_VERSION_GET: FirmwareVersionGet\n",
        "ECM_CMD_FW_VERSION_GET: ret 0x0E\n",
        "ECM_CMD_ECAT_STATE_SET: StateSet { slaves: All, state: PreOp }\n",
        "check CRC-32\n",
        "check fixed\n",
        ": NOP, no result\n",
        "  state PreOp, errors none, RxFIFO 0, TxFIFO 0, CRC errors ",
        "damaged: the start word is 0xEEEEEEEE",
        "  10 bytes, as no packet has\n",
    ] {
        assert!(dumped.out.contains(part), "no {part:?}:\n{}", dumped.out);
    }
    let commands = run(&["dump", file, "--direction", "command"]);
    assert!(commands.out.contains(" command\n") && !commands.out.contains(" answer\n"), "{commands:?}");
    let hex = run(&["dump", file, "--hex"]);
    assert!(hex.out.contains("\n  a4 a3 a2 a1 ") && hex.out.contains("\n  ee ee ee ee ee ee ee ee ee ee\n"), "{hex:?}");
    let json = run(&["dump", file, "--json"]);
    let objects: Vec<serde_json::Value> =
        json.out.lines().map(|line| serde_json::from_str(line).expect("an object")).collect();
    let set =
        objects.iter().find(|object| object["code"] == 12 && object["direction"] == "command").expect("STATE_SET");
    assert!(set["index"].is_u64() && set["bytes"].as_str().is_some_and(|bytes| bytes.len() == 288), "{set}");
    assert!(objects.iter().any(|object| object["nop"] == true) && objects.iter().any(|object| object["ret"] == 0x0E));
    assert!(objects.last().expect("some")["text"][0] == "10 bytes, as no packet has");
}

/// XF-15.7 A driver that transfers single bytes while it searches the packet size gives only a few lines: its bytes are joined,
/// and the packets in them are shown. The same holds for a packet that is transferred in parts.
///
/// Row: 1 byte per exchange.
#[test]
fn pieces_are_joined() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    let (mut wires, _) = chip::open(&link(&file)).expect("a chip");
    wires.wait_until(1_000_000_000).expect("it waits");
    for _ in 0..5 * 144 {
        wires.exchange(&[0], &mut [0]).expect("it passes");
        let next = wires.now() + 1_000_000;
        wires.wait_until(next).expect("it waits");
    }
    wires.exchange(&vectors::xf::packet_named("info-update-fixed").bytes, &mut [0; 144]).expect("it passes");
    drop(wires);
    let file = file.to_str().expect("UTF-8");
    let dumped = run(&["dump", file]);
    assert_eq!((dumped.code, dumped.err.as_str()), (Some(0), ""), "{dumped:?}");
    assert!(dumped.out.lines().count() < 30, "{}", dumped.out);
    for part in [
        "  720 bytes in 720 pieces: 0 packets, and 720 bytes in none\n",
        "  720 bytes in 720 pieces: 5 packets, and 0 bytes in none\n",
        ", up to packet 1439 at ",
        " NOP, no result\n",
        ": InfoUpdate\n",
    ] {
        assert!(dumped.out.contains(part), "no {part:?}:\n{}", dumped.out);
    }
    let answers = run(&["dump", file, "--direction", "response", "--json"]);
    let first: serde_json::Value =
        serde_json::from_str(answers.out.lines().next().expect("a line")).expect("an object");
    assert_eq!(
        (&first["pieces"], &first["bytes_in_no_packet"], &first["last_number"]),
        (&720.into(), &0.into(), &1440.into())
    );
    assert!(first["packets"].as_array().is_some_and(|packets| packets.iter().all(|packet| packet["errors"].is_u64())));
    let hex = run(&["dump", file, "--hex"]);
    assert!(hex.out.contains("\n  00 00 00 00 ") && hex.out.lines().count() < 120, "{hex:?}");
}

/// XF-15.5 Other verbs refuse the recording of a chip; the error says what the file is and which verb shows it. `--hex` with
/// the recording of a board is refused.
#[test]
fn other_verbs_say_what_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    drop(Xf::open(&link(&file)).expect("it starts"));
    let file = file.to_str().expect("UTF-8");
    for words in
        [&["plot", file][..], &["summary", file], &["replay", file], &["compare", file, file], &["migrate", file]]
    {
        let ran = run(words);
        assert!(ran.code != Some(0) && ran.err.contains("the recording of a chip ECM-XF"), "{words:?}: {ran:?}");
        assert!(ran.err.contains("`ecmsk dump`"), "{words:?}: {ran:?}");
    }
    let board = folder.path().join("board.pcapng");
    let uri = format!("sim:?clock=virtual&record={}", board.display());
    drop(ecmsk::link::open(&uri, ecmsk::link::Share::ByUri).expect("a board"));
    let refused = run(&["dump", "--hex", board.to_str().expect("UTF-8")]);
    assert!(refused.code == Some(1) && refused.err.contains("leave out --hex"), "{refused:?}");
}
