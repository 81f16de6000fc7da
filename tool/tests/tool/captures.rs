//! Verbs of the tool on captures: those that usbmon has made in the guest of the wire tests, and the same events in other
//! formats.

use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use crate::common::svg::{ALARM, Plot};
use crate::common::{Ran, run};
use support::captures::convert::{Event, Parts, USB_LINUX, USB_LINUX_MMAPPED, USBPCAP, events, pcap, pcapng};
use support::captures::{captured, kept};
use support::recorded::Program;

const MODEL: &str = "sim:?slaves=drive,hsp2,io";
/// The number of targets that the program of the captures sends to each axis.
const TARGETS: u32 = 12;
/// The number of command frames in a capture: 5 with SET_AXIS, SET_DC, an SDO, SET_STATE and SV_ON, one for each target, 2 with
/// IO_WR and SET_STATE.
const COMMANDS: u32 = 5 + TARGETS + 2;

/// The capture by usbmon of a program on a board with slots of `slot` bytes.
fn fixture(slot: u32) -> Vec<u8> {
    let file = support::root().join(format!("tests/recordings/usbmon_{slot}.pcap"));
    fs::read(file).expect("the fixture")
}

struct Files {
    folder: TempDir,
}

impl Files {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a folder") }
    }

    fn keep(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let file = self.folder.path().join(name);
        fs::write(&file, bytes).expect("a file");
        file
    }

    /// Files of the capture with slots of `slot` bytes: the unchanged one, and the same events in the formats of other systems.
    fn all(&self, slot: u32) -> Vec<PathBuf> {
        let captured = fixture(slot);
        let events = events(&captured);
        assert_eq!(pcap(&events, USB_LINUX, Parts::Two, 65_536), captured, "the converter loses nothing");
        vec![
            self.keep("usbmon.pcap", &captured),
            self.keep("mapped.pcapng", &pcapng(&events, USB_LINUX_MMAPPED)),
            self.keep("windows.pcapng", &pcapng(&events, USBPCAP)),
            self.keep("older.pcap", &pcap(&events, USBPCAP, Parts::Three, 65_535)),
        ]
    }
}

fn tool(verb: &str, file: &Path, options: &[&str]) -> Ran {
    run([&[verb, file.to_str().expect("UTF-8")], options].concat())
}

/// A capture of a real kernel, in slots of either size: the board is found by its descriptor, its frames are shown, and
/// the output is the same for files of all systems.
#[test]
fn a_capture_is_dumped() {
    for slot in [12, 16] {
        let files = Files::new();
        let dumps: Vec<String> = files.all(slot).iter().map(|file| tool("dump", file, &[]).expect_quiet()).collect();
        let first = &dumps[0];
        assert!(first.starts_with("# bus 1, device "), "{first}");
        for words in
            ["SET_AXIS group 0: 1 DRIVE, 2 HSP, 3 IO", "SDO_RD slave 1 0x6502:0 = ", "state OP", "HSP statusword"]
        {
            assert!(first.contains(words), "{slot}: `{words}` is missing in {first}");
        }
        for n in 1..=TARGETS {
            assert_eq!(first.matches(&format!("slave 1  CSP #{n} target {}\n", 10 * n)).count(), 1, "{first}");
        }
        assert!(dumps.iter().all(|dump| dump == first), "{slot}");
        let json = tool("dump", &files.folder.path().join("windows.pcapng"), &["--json"]).expect_quiet();
        assert!(json.lines().all(|line| line.contains(&format!("\"slot_bytes\":{slot}"))), "{json}");
    }
}

/// A capture is plotted, and compared with itself as another system would have saved it.
#[test]
fn a_capture_is_plotted_and_compared() {
    let files = Files::new();
    let all = files.all(16);
    for file in &all {
        let svg = files.folder.path().join("x.svg");
        tool("plot", file, &["-o", svg.to_str().expect("UTF-8")]).expect_quiet();
        let plot = Plot::parse(&fs::read_to_string(svg).expect("a plot"));
        assert!(plot.panel_names().iter().any(|name| name.starts_with("Axis 1")), "{:?}", plot.panel_names());
    }
    for other in &all[1..] {
        let found = tool("compare", &all[0], &[other.to_str().expect("UTF-8")]).expect_quiet();
        assert!(found.contains("\nequal: "), "{found}");
    }
}

/// A capture of a program on the model, which ran over the kernel's USB code, is replayed on the model: the answers are the
/// same.
#[test]
fn a_capture_of_the_model_is_its_replay() {
    for slot in [12, 16] {
        let files = Files::new();
        for file in files.all(slot) {
            let found = tool("replay", &file, &["--link", MODEL]).expect_quiet();
            assert!(found.starts_with(&format!("A is {} (device 1.", file.display())), "{found}");
            let slot_key = if slot == 16 { "&slot=16" } else { "" };
            assert!(found.contains(&format!("\nB is {MODEL}{slot_key}\n")), "{found}");
            assert!(found.contains(&format!("\nequal: {COMMANDS} commands and ")), "{found}");
        }
    }
}

/// A capture of a board is replayed on a board behind a chip at the pace at which its program would have run there: the
/// answers are equal, but later. At the recorded times the commands would come before OP.
#[test]
fn a_capture_is_played_to_a_model_behind_a_chip() {
    let run = Program::default().record();
    let capture = kept(&captured(&run.file), USB_LINUX);
    let model = ["--link", "xf-sim:?slaves=drive*2,io"];
    let ran = tool("replay", &capture.file, &model);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(ran.err.starts_with("note: B: the model took 0.") && ran.err.contains("--pace times"), "{}", ran.err);
    assert!(ran.out.contains("\nequal: 308 commands and ") && ran.out.contains("\nlatency: B answers "), "{}", ran.out);
    let json = tool("replay", &capture.file, &[&model[..], &["--json"]].concat());
    let found: serde_json::Value = serde_json::from_str(&json.out).expect("an object");
    let waited = found["waited_ns"].as_i64().expect("a number");
    assert!((100_000_000..900_000_000).contains(&waited), "{found}");
    let ran = tool("replay", &capture.file, &[&model[..], &["--pace", "times"]].concat());
    assert_eq!((ran.code, ran.err.as_str()), (Some(1), ""));
    assert!(ran.out.contains("state OP in A, PreOP in B"), "{}", ran.out);
    // A model of the same kind of board answers as early as the board did. `--pace answers` makes no difference then.
    for pace in [&[][..], &["--pace", "answers"]] {
        let found =
            tool("replay", &capture.file, &[&["--link", "sim:?slaves=drive*2,io"], pace].concat()).expect_quiet();
        assert!(found.contains("\nequal: 308 commands and "), "{found}");
    }
    tool("replay", &capture.file, &["--pace", "soon"]).expect_misuse(&["--pace", "answers"]);
}

/// If no frame of a capture has a CRC, the slot size is found by the contents of the slots.
#[test]
fn without_crc_the_slots_tell_the_size() {
    for slot in [12, 16] {
        let mut events = events(&fixture(slot));
        for data in events.iter_mut().filter_map(|event| event.data.as_mut()).filter(|data| data.len() == 512) {
            data[3] = 0;
        }
        let files = Files::new();
        let file = files.keep("x.pcap", &pcap(&events, USB_LINUX, Parts::Two, 65_535));
        let json = tool("dump", &file, &["--json"]).expect_quiet();
        assert!(json.lines().all(|line| line.contains(&format!("\"slot_bytes\":{slot}"))), "{slot}");
        let other = (28 - slot).to_string();
        let forced = tool("dump", &file, &["--json", "--slot-size", &other]).expect_quiet();
        assert!(forced.lines().all(|line| line.contains(&format!("\"slot_bytes\":{other}"))), "{slot}");
    }
}

/// The events of the capture with 12-byte slots, and the same events again as those of a second board on the bus.
fn two_boards() -> Vec<Event> {
    let one = events(&fixture(12));
    let mut both: Vec<Event> = one.clone();
    both.extend(one.into_iter().map(|mut event| {
        event.device += 40;
        event.id ^= 1 << 60;
        event
    }));
    both.sort_by_key(|event| event.at_us);
    both
}

/// If a capture has several boards, verbs that read one of them ask for `--device`; `dump` shows all of them.
#[test]
fn of_several_boards_in_a_capture_one_is_chosen() {
    let both = two_boards();
    let addresses = {
        let mut devices: Vec<u8> = both.iter().filter(|event| event.length == 512).map(|event| event.device).collect();
        devices.sort_unstable();
        devices.dedup();
        devices.iter().map(|device| format!("1.{device}")).collect::<Vec<_>>()
    };
    assert_eq!(addresses.len(), 2, "{addresses:?}");
    let files = Files::new();
    let file = files.keep("two.pcapng", &pcapng(&both, USBPCAP));
    let choose = format!("--device {}", addresses[0]);
    tool("replay", &file, &["--link", MODEL]).expect_failure(2, &[&addresses[0], &addresses[1], "16c0:05df"], "");
    assert!(tool("replay", &file, &["--link", MODEL]).err.trim_end().ends_with(&choose));
    assert!(tool("plot", &file, &[]).err.trim_end().ends_with(&choose));
    assert!(tool("compare", &file, &[file.to_str().expect("UTF-8")]).err.trim_end().ends_with(&choose));
    for address in &addresses {
        assert!(tool("replay", &file, &["--link", MODEL, "--device", address]).expect_quiet().contains("\nequal: "));
        let dump = tool("dump", &file, &["--device", address]).expect_quiet();
        assert_eq!(dump.matches("# bus").count(), 1, "{dump}");
    }
    let path = file.to_str().expect("UTF-8");
    let compared = tool("compare", &file, &[path, "--device", &addresses.join(",")]).expect_quiet();
    assert!(compared.contains("\nequal: "), "{compared}");
    tool("compare", &file, &[path, "--device", "1.1,1.2,1.3"]).expect_failure(2, &["3 devices"], "as 1.5,1.6");
    let dump = tool("dump", &file, &[]).expect_quiet();
    assert!(addresses.iter().all(|address| dump.contains(&format!("# bus 1, device {}\n", &address[2..]))));
    tool("replay", &file, &["--link", MODEL, "--device", "1.99"]).expect_failure(
        2,
        &["no frames of device 1.99"],
        "--device",
    );
    tool("replay", &file, &["--link", MODEL, "--device", "five"]).expect_misuse(&["five", "1.5"]);
}

/// If the board in a capture differs from the model, `replay` shows that by its exit code, as text, as JSON and as a picture.
#[test]
fn replay_shows_what_a_board_does_otherwise_than_the_model() {
    let run = Program { script: "at 600ms alarm 2 0x7500 stays".into(), ..Program::default() }.record();
    let capture = kept(&captured(&run.file), USB_LINUX);
    let model = ["--link", "sim:?slaves=drive*2,io"];
    let ran = tool("replay", &capture.file, &model);
    assert_eq!((ran.code, ran.err.as_str()), (Some(1), ""));
    let first =
        ran.out.lines().find(|line| line.contains(" in A, ") && line.contains("slave 2 error code")).expect("it");
    assert!(first.contains("0x7500 (communication) in A, 0x0000 in B"), "{first}");
    assert!(ran.out.contains("\nanswers to "), "{}", ran.out);

    let svg = capture.file.with_extension("svg");
    let options = [&model[..], &["--json", "--plot", svg.to_str().expect("UTF-8")]].concat();
    let found = tool("replay", &capture.file, &options).json();
    assert_eq!((&found["equal"], &found["a"]["commands"]), (&false.into(), &304.into()));
    let what = found["first"]["what"].as_array().expect("a list");
    let code = what.iter().find(|what| what["of"] == "error_code").expect("one of them");
    assert_eq!((&code["slave"], &code["values"][0], &code["values"][1]), (&2.into(), &0x7500.into(), &0.into()));
    assert_eq!(
        (&found["left_out"]["frames_taken_back"], &found["left_out"]["frames_before_start"]),
        (&0.into(), &0.into())
    );
    let plot = Plot::parse(&fs::read_to_string(&svg).expect("a picture"));
    assert!(plot.panel_names().contains(&"Difference: B minus A (counts)"), "{:?}", plot.panel_names());
    assert!(!plot.panel("Axis 2").samples(ALARM, false).is_empty());

    let same = capture.file.to_str().expect("UTF-8");
    tool("replay", &capture.file, &[&model[..], &["--plot", same]].concat()).expect_failure(
        2,
        &["would replace"],
        "with --plot",
    );
    // A recording names its model by its link. The files that the link names are opened only with `--allow-files`.
    tool("replay", &run.file, &[]).expect_failure(2, &["names a file (script=", "--allow-files"], "with --link");
    let found = tool("replay", &run.file, &["--allow-files"]).expect_quiet();
    assert!(found.contains("\nequal: 304 commands"), "{found}");
}

/// A capture that cannot be replayed ends with 2 and the next step; skipped frames are reported.
#[test]
fn a_capture_that_cannot_be_replayed_is_exit_code_2_with_the_next_step() {
    let files = Files::new();
    let captured = fixture(12);
    let whole = files.keep("x.pcap", &captured);
    tool("replay", &whole, &[]).expect_failure(2, &["which slaves the board has"], "--link 'sim:");
    tool("replay", &whole, &["--link", "usb:"]).expect_failure(2, &["`usb:` is no model"], "");
    tool("replay", Path::new("-"), &["--link", MODEL]).expect_failure(2, &["standard input"], "save it to a file");
    tool("replay", Path::new("/no/such/file"), &["--link", MODEL]).expect_failure(
        2,
        &["/no/such/file"],
        "check the path",
    );
    tool("replay", &whole, &["--link", "sim:?slaves=lamp"]).expect_misuse(&["lamp"]);

    // The capture is cut in the packet of its fourth command.
    let all = events(&captured);
    let is_command = |event: &Event| (event.what, event.endpoint, event.length) == (b'S', 0x02, 512);
    let commands: Vec<usize> = (0..all.len()).filter(|i| is_command(&all[*i])).collect();
    let whole_packets = pcap(&all[..=commands[3]], USB_LINUX, Parts::Two, 65_535);
    let cut = files.keep("cut.pcap", &whole_packets[..whole_packets.len() - 100]);
    let ran = tool("replay", &cut, &["--link", MODEL]);
    // A cut recording that is equal up to its end does not prove that the model answers as the board did.
    assert!(ran.code == Some(2) && ran.err.starts_with("note: A: ") && ran.err.contains("in the middle"), "{ran:?}");
    let ran = tool("replay", &cut, &["--link", MODEL, "--allow-incomplete"]);
    assert!(ran.code == Some(0) && ran.err.starts_with("note: A: ") && ran.err.contains("in the middle"), "{ran:?}");

    let snapped = files.keep("snap.pcap", &pcap(&events(&captured), USBPCAP, Parts::Two, 96));
    for verb in ["dump", "plot"] {
        tool(verb, &snapped, &[]).expect_failure(1, &["captured to 69 of 512 bytes"], "snap length 0");
    }
    tool("replay", &snapped, &["--link", MODEL]).expect_failure(2, &["captured to 69 of 512 bytes"], "snap length 0");

    let mut others = events(&captured);
    others.retain(|event| event.length != 512);
    let others = files.keep("others.pcap", &pcap(&others, USB_LINUX, Parts::Two, 65_535));
    for (verb, options, code) in [("dump", &[][..], 1), ("plot", &[], 1), ("replay", &["--link", MODEL], 2)] {
        tool(verb, &others, options).expect_failure(
            code,
            &["no frames of a board", "16c0:05df"],
            "while the program runs",
        );
    }
}

/// A frame that the board did not take does not count, and a note says so.
#[test]
fn a_frame_that_the_board_did_not_take_is_left_out_with_a_note() {
    let mut traffic = captured(&Program { short: true, ..Program::default() }.record().file);
    let at_us = traffic.events.last().expect("an event").at_us;
    let back = traffic.submitted(7, &[0xEE; 512]);
    traffic.completed(7, back, support::captures::traffic::TAKEN_BACK, 0);
    traffic.events.iter_mut().rev().take(2).for_each(|event| event.at_us = at_us);
    let capture = kept(&traffic, USBPCAP);
    let said = "left out: 1 frames that the board did not take; look at them in Wireshark\n";
    for (verb, options) in [("dump", &[][..]), ("replay", &["--link", "sim:?slaves=drive*2,io"])] {
        let ran = tool(verb, &capture.file, options);
        assert!(ran.code == Some(0) && ran.err.ends_with(said) && ran.err.lines().count() == 1, "{verb}: {ran:?}");
    }
}
