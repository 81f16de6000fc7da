//! `ecmsk wireshark`, and what Wireshark shows with the plugin: the same as `ecmsk dump`.

use std::fs;

use crate::common::run;
use crate::common::tshark::plugin;

/// The plugin that is installed is the kept one, `share/wireshark/ecmsk.lua`, and an older one is written over.
#[test]
fn the_kept_plugin_is_installed() {
    let folder = tempfile::tempdir().expect("a folder");
    let plugins = folder.path().join("new/plugins");
    let file = plugins.join("ecmsk.lua");
    for _ in 0..2 {
        let ran = run(["wireshark", "install", "--dir", plugins.to_str().expect("UTF-8")]);
        assert_eq!((ran.code, ran.out), (Some(0), format!("{}\n", file.display())));
        assert!(ran.err.starts_with("note: ") && ran.err.contains("Reload Lua Plugins"), "{}", ran.err);
        support::kept(&plugin(), &fs::read_to_string(&file).expect("the plugin"));
        fs::write(&file, "older").expect("it is written");
    }
    let ran = run(["wireshark", "install", "--dir", file.to_str().expect("UTF-8")]);
    ran.expect_failure(1, &["cannot write"], "--dir");
}

/// Without --dir the plugin is installed into the folder of the user's Wireshark plugins.
#[cfg(unix)]
#[test]
fn the_folder_is_the_user_s() {
    use crate::common::{Ran, ecmsk};

    let home = tempfile::tempdir().expect("a folder");
    let install =
        |home: &str| Ran::from(ecmsk(["wireshark", "install"]).env("HOME", home).output().expect("it starts"));
    let ran = install(home.path().to_str().expect("UTF-8"));
    let file = home.path().join(".local/lib/wireshark/plugins/ecmsk.lua");
    assert_eq!((ran.code, ran.out), (Some(0), format!("{}\n", file.display())));
    assert!(file.is_file());
    install("").expect_failure(1, &["HOME is not set"], "name it with --dir");
}

mod needs_tshark {
    use std::path::{Path, PathBuf};
    use std::process::Command;

    use ecmsk::coe::{AbortCode, ObjectAddress};
    use ecmsk::sk::{
        BOARD_IDS, CommandId, FRAME_LEN, Frame, MASTER_CYCLIC, MasterResponse, MasterState, RawSlot, SdoResponse,
        SlotSize, StateByte, crc,
    };
    use serde_json::Value;
    use support::captures::convert::{Parts, USB_LINUX, USB_LINUX_MMAPPED, USBPCAP, events, pcap, pcapng};
    use support::captures::traffic::Traffic;
    use support::dice::Dice;
    use support::recorded::Program;
    use tempfile::TempDir;

    use super::fs;
    use crate::common::run;
    use crate::common::tshark::{compare_frames, dumped, remarks, shown, tshark};

    fn keep(folder: &TempDir, name: &str, bytes: &[u8]) -> PathBuf {
        let file = folder.path().join(name);
        fs::write(&file, bytes).expect("a file");
        file
    }

    /// The plugin shows each field of each slot of a recording as `dump` does, also of a board with alarms.
    #[test]
    fn recordings_are_shown_as_by_dump() {
        for keys in ["", "&fw=1.5"] {
            let run = Program { keys: keys.to_owned(), ..Program::default() }.record();
            let options: &[&str] = if keys.is_empty() { &[] } else { &["-o", "ecmsk.firmware:1.5"] };
            let fields = compare_frames(&run.file, &[], options);
            assert!(fields > 10_000, "{fields}");
        }
    }

    /// The plugin shows a recording in blocks that was exported as it shows the one that was recorded.
    #[test]
    fn an_exported_recording_is_shown_as_by_dump() {
        let recorded = Program::default().record();
        let folder = TempDir::new().expect("a folder");
        let [blocks, exported] = ["run.ecmrec", "run.pcapng"].map(|name| folder.path().join(name));
        for (from, to) in [(&recorded.file, &blocks), (&blocks, &exported)] {
            let [from, to] = [from, to].map(|file| file.to_str().expect("UTF-8"));
            run(["recording", "export", from, to]).expect_code(0);
        }
        let fields = compare_frames(&exported, &[], &[]);
        assert_eq!(fields, compare_frames(&recorded.file, &[], &[]));
    }

    /// The plugin shows each field of captures of a real kernel as `dump` does: of captures on Linux, and of the same with the
    /// headers of Windows.
    #[test]
    fn captures_are_shown_as_by_dump() {
        let folder = tempfile::tempdir().expect("a folder");
        for slot in [12, 16] {
            let captured = support::root().join(format!("tests/recordings/usbmon_{slot}.pcap"));
            let bytes = fs::read(&captured).expect("the fixture");
            let events = events(&bytes);
            for (name, bytes) in [
                ("usbmon.pcap", bytes.clone()),
                ("mapped.pcapng", pcapng(&events, USB_LINUX_MMAPPED)),
                ("windows.pcapng", pcapng(&events, USBPCAP)),
            ] {
                let file = keep(&folder, name, &bytes);
                let fields = compare_frames(&file, &[], &[]);
                assert!(fields > 1000, "{name}: {fields}");
            }
        }
    }

    /// Slots of all commands with random bytes, so that every value, every default that is left out and every reason for a
    /// malformed command occurs. The captures do not contain the USB ids of the device.
    #[test]
    fn frames_of_any_bytes_are_shown_as_by_dump() {
        let folder = tempfile::tempdir().expect("a folder");
        for (size, name, system) in [(SlotSize::Bytes12, "12.pcap", USB_LINUX), (SlotSize::Bytes16, "16.pcap", USBPCAP)]
        {
            let mut dice = Dice(size.bytes() as u64);
            let mut traffic = Traffic::default();
            for _ in 0..600 {
                let response = dice.one_in(2);
                let frame = any_frame(&mut dice, size);
                match response {
                    true => traffic.read(7, frame.bytes()),
                    false => traffic.write(7, frame.bytes()),
                };
            }
            let file = keep(&folder, name, &pcap(&traffic.events, system, Parts::Two, 65_535));
            let bytes = size.bytes().to_string();
            compare_frames(&file, &["--slot-size", &bytes], &["-o", &format!("ecmsk.slot_bytes:{bytes}")]);
            let malformed = dumped(&file, &["--slot-size", &bytes]);
            let malformed = malformed.iter().flat_map(|frame| frame["slots"].as_array().expect("slots"));
            assert!(malformed.filter(|slot| slot.get("malformed").is_some()).count() > 100);
        }
    }

    fn any_frame(dice: &mut Dice, size: SlotSize) -> Frame {
        let mut frame = Frame::new();
        frame.put(size, 0, &any_slot(dice));
        for n in 1..size.sdo_slot() {
            if dice.one_in(5) {
                frame.put(size, n, &any_slot(dice));
            }
        }
        frame.put(size, size.sdo_slot(), &any_slot(dice));
        frame.bytes_mut()[crc::CRC_BYTE] = 0;
        match dice.below(10) {
            0 => {}
            1 => frame.bytes_mut()[crc::CRC_BYTE] = dice.roll() as u8,
            _ => frame.fill_crc(size),
        }
        frame
    }

    /// A random slot of any command, in part with numbers that the command accepts.
    fn any_slot(dice: &mut Dice) -> RawSlot {
        let ids = CommandId::ALL.map(CommandId::code);
        let id = if dice.one_in(10) { dice.pick(&[MASTER_CYCLIC, 0x40]) } else { dice.pick(&ids) };
        let mut number = |usual: &[u32]| match dice.below(3) {
            0 => dice.roll() as u32,
            1 => u32::from(dice.roll() as u16),
            _ => dice.pick(usual),
        };
        RawSlot {
            id,
            index: number(&[0, 1, 8]) as u8,
            parm: number(&[0, 1, 2, 4, 8, 0x101, 0x201, 0x401, 0x8001, 0x1637, 0x021F]) as u16,
            data1: number(&[0, 1, 2, 4, 8, 9, 10, 250, 1000, 0x6060_0000, 0x6040_0001, 0xFFFF_F001, 512_000]),
            data2: number(&[0, 1, 0xFFFF, 0xFFFF_0000, 0x7500_0000]),
            data3: number(&[0, 0, 1]),
        }
    }

    /// Three runs in which something goes wrong: an alarm that ends again, a full FIFO with lost commands, and a lost slave.
    /// Each remark is on the frame that shows the change first, and on no other.
    #[test]
    fn remarks_say_what_goes_wrong() {
        let script = "at 600ms alarm 2 0x7500\n".to_owned();
        let alarm = Program { script, ..Program::default() }.record();
        expect_remarks(&alarm.file, &["ecmsk.alarm"]);
        let script = "at 500ms full for 180ms\n".to_owned();
        let full = Program { script, short: true, ..Program::default() }.record();
        expect_remarks(&full.file, &["ecmsk.fifo_full", "ecmsk.command_lost"]);
        let script = "at 600ms cut 3\n".to_owned();
        let cut = Program { script, short: true, ..Program::default() }.record();
        expect_remarks(&cut.file, &["ecmsk.slave_lost"]);
    }

    /// Compares the plugin's remarks on a recording with the changes that `dump` shows. Each of the remarks `kinds` has to
    /// occur.
    #[track_caller]
    fn expect_remarks(file: &Path, kinds: &[&str]) {
        let shown = shown(file, "ecmsk", &[]);
        let found: Vec<(u64, String)> = shown
            .iter()
            .flat_map(|(number, layer)| remarks(layer).into_iter().map(|(name, _)| (*number, name)))
            .collect();
        let expected = changes(&dumped(file, &[]));
        assert_eq!(found, expected, "{}", file.display());
        for kind in kinds {
            assert!(found.iter().any(|(_, name)| name == kind), "no {kind}: {found:?}");
        }
    }

    /// The numbers of the frames in which something that a remark names begins or ends, each with the name of the remark.
    fn changes(frames: &[Value]) -> Vec<(u64, String)> {
        let mut changes = Vec::new();
        let (mut board, mut alarms): (Value, [Option<String>; 41]) = (Value::Null, [const { None }; 41]);
        for frame in frames.iter().filter(|frame| frame["direction"] == "response") {
            let mut say =
                |name: &str| changes.push((frame["number"].as_u64().expect("a number"), format!("ecmsk.{name}")));
            for slot in frame["slots"].as_array().expect("slots") {
                if slot["role"] == "ecm" {
                    let changed = |name: &str| board.get(name).is_some_and(|before| *before != slot[name]);
                    let in_op = slot["state"].as_str().is_some_and(|state| state.starts_with("OP"));
                    if slot["state_failed"] == true && board["state_code"] != slot["state_code"] {
                        say("slave_lost");
                    }
                    if in_op && changed("full_count") {
                        say("command_lost");
                    }
                    if in_op && slot["fifo_free_entries"] == 0 && board["fifo_free_entries"] != 0 {
                        say("fifo_full");
                    }
                    board = slot.clone();
                } else if let Some(state) = slot["drive_state"].as_str() {
                    let alarm = &mut alarms[slot["slot"].as_u64().expect("a number") as usize];
                    let now = state.starts_with("Fault").then(|| slot["error_code"].to_string());
                    match (&alarm, &now) {
                        (before, Some(_)) if **before != now => say("alarm"),
                        (Some(_), None) => say("alarm_cleared"),
                        _ => {}
                    }
                    *alarm = now;
                }
            }
        }
        changes
    }

    /// A wrong CRC, a command in a slot that does not take it, and a malformed command each have a remark.
    #[test]
    fn remarks_name_commands_that_a_board_rejects() {
        let size = SlotSize::Bytes12;
        let frame = |slot: usize, id: CommandId, data1: u32| {
            let mut frame = Frame::new();
            frame.put(size, slot, &RawSlot { id: id.code(), data1, ..RawSlot::ZERO });
            frame.fill_crc(size);
            frame
        };
        let mut damaged = frame(0, CommandId::SetState, 8);
        damaged.bytes_mut()[crc::CRC_BYTE] ^= 0xFF;
        let cases = [
            (damaged, "ecmsk.crc_wrong"),
            (frame(0, CommandId::SetState, 3), "ecmsk.malformed"),
            (frame(1, CommandId::SetState, 8), "ecmsk.foreign"),
            (frame(2, CommandId::Csp, 100), ""),
        ];
        let mut traffic = Traffic::default();
        for (frame, _) in &cases {
            traffic.write(7, frame.bytes());
        }
        let folder = tempfile::tempdir().expect("a folder");
        let file = keep(&folder, "x.pcap", &pcap(&traffic.events, USB_LINUX, Parts::Two, 65_535));
        for ((_, layer), (_, expected)) in shown(&file, "ecmsk", &[]).iter().zip(cases) {
            let names: Vec<String> = remarks(layer).into_iter().map(|(name, _)| name).collect();
            assert_eq!(names.join(" "), expected);
        }
    }

    /// A failed state, another wrong CRC and an aborted transfer are remarked once, in the response that shows them first.
    #[test]
    fn remarks_compare_responses() {
        let size = SlotSize::Bytes12;
        let good = MasterResponse { state: StateByte::reached(MasterState::PreOp), ..MasterResponse::default() };
        let failed = MasterResponse { state: StateByte::failed(Some(MasterState::PreOp)), ..good };
        let counted = MasterResponse { error: 1, ..failed };
        let (id, slave, object) = (CommandId::SdoRead, 1, ObjectAddress::new(0x6060, 0));
        let aborted = SdoResponse::Aborted { id, slave, object, code: AbortCode(0x0602_0000) };
        let cases = [
            (good, SdoResponse::Empty, ""),
            (failed, SdoResponse::Empty, "ecmsk.state_failed"),
            (counted, SdoResponse::Empty, "ecmsk.crc_rejected"),
            (counted, aborted, "ecmsk.sdo_aborted"),
            (counted, aborted, ""),
        ];
        let mut traffic = Traffic::default();
        for (master, sdo, _) in &cases {
            let mut frame = Frame::new();
            frame.put(size, 0, &master.encode());
            frame.put(size, size.sdo_slot(), &sdo.encode());
            frame.fill_crc(size);
            traffic.read(7, frame.bytes());
        }
        let folder = tempfile::tempdir().expect("a folder");
        let file = keep(&folder, "x.pcap", &pcap(&traffic.events, USB_LINUX, Parts::Two, 65_535));
        let shown = shown(&file, "ecmsk", &[]);
        assert_eq!(shown.len(), cases.len());
        for ((_, layer), (_, _, expected)) in shown.iter().zip(cases) {
            let names: Vec<String> = remarks(layer).into_iter().map(|(name, _)| name).collect();
            assert_eq!(names.join(" "), expected);
        }
    }

    /// Transfers of other lengths than a frame, and transfers of a device with other USB ids, are not shown as frames of a
    /// board.
    #[test]
    fn other_traffic_is_left_alone() {
        let mut traffic = Traffic::default();
        traffic.write(7, &[0; 64]).read(7, &[1; 500]).bulk(7, &[0; FRAME_LEN]);
        let folder = tempfile::tempdir().expect("a folder");
        let file = keep(&folder, "x.pcap", &pcap(&traffic.events, USB_LINUX, Parts::Two, 65_535));
        assert_eq!(tshark(&file, &["-Y", "ecmsk"]), "");
        let mut other = fs::read(support::root().join("tests/recordings/usbmon_12.pcap")).expect("the fixture");
        let ids = [BOARD_IDS.0.to_le_bytes(), BOARD_IDS.1.to_le_bytes()].concat();
        let places: Vec<usize> = (0..other.len() - 4).filter(|at| other[*at..at + 4] == ids).collect();
        assert!(!places.is_empty());
        places.into_iter().for_each(|at| other[at] ^= 1);
        let file = keep(&folder, "other.pcap", &other);
        assert_eq!(tshark(&file, &["-Y", "ecmsk"]), "");
    }

    /// tshark loads the plugin from the user's folder, where `install` has written it, and accepts each filter of
    /// docs/WIRESHARK.md.
    #[test]
    fn the_installed_plugin_is_loaded_and_takes_the_filters_of_the_page() {
        let run_of_program = Program::default().record();
        let home = tempfile::tempdir().expect("a folder");
        let install =
            crate::common::ecmsk(["wireshark", "install"]).env("HOME", home.path()).output().expect("it starts");
        assert!(install.status.success());
        let filtered = |filter: &str| {
            let mut tshark = Command::new("tshark");
            tshark.env("HOME", home.path()).env_remove("XDG_CONFIG_HOME").arg("-r").arg(&run_of_program.file);
            support::succeed(tshark.args(["-Y", filter])).lines().count()
        };
        let commands = dumped(&run_of_program.file, &["--commands", "CSP", "--direction", "command"]).len();
        assert_eq!(filtered("ecmsk.slot.cmd == \"CSP\" && ecmsk.direction == \"command\""), commands);
        let page = fs::read_to_string(support::root().join("docs/WIRESHARK.md")).expect("the page");
        let (_, page) = page.split_once("## Filters").expect("the section");
        let (page, _) = page.split_once("## What frames do not show").expect("the section");
        let code =
            page.lines().filter(|line| line.starts_with('|')).flat_map(|line| line.split('`').skip(1).step_by(2));
        let filters: Vec<String> = code.map(|filter| format!("({})", filter.replace(r"\|", "|"))).collect();
        assert!(filters.len() >= 25 && filters.iter().all(|filter| filter.starts_with("(ecmsk")), "{filters:?}");
        // Filters are joined, since each run of tshark takes time. A name that does not exist is an error.
        assert!(filtered(&filters.join(" || ")) > 0);
    }
}
