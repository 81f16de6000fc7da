//! `ecmsk dump --hex`: bare frames in words and as JSON.

use crate::common::{Ran, json_lines, run, run_with_input};
use ecmsk::sk::SlotSize;
use vectors::{Vector, vector_named, vectors};

/// Hexadecimal digits of some bytes.
fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A golden frame as a line of input for `dump --hex`: its direction, its bytes, and its name as a comment.
fn line(vector: &Vector) -> String {
    format!("{} {} # {}\n", if vector.is_response() { '<' } else { '>' }, hex(&vector.bytes), vector.name)
}

fn dump(arguments: &[&str], input: impl AsRef<[u8]>) -> Ran {
    run_with_input(&[&["dump", "--hex"], arguments].concat(), input)
}

/// `dump --hex` shows every golden frame as text, as in a snapshot that was checked by hand.
#[test]
fn every_golden_frame_is_dumped_as_the_snapshot_says() {
    let input: String = vectors().iter().map(|vector| format!("# {}\n{}", vector.name, line(vector))).collect();
    support::snapshot("dump_hex", &dump(&[], &input).expect_quiet());
    support::snapshot("dump_hex_json", &dump(&["--json"], &input).expect_quiet());
}

/// SK-1.1, SK-1.2, SK-1.4 All slots of every golden frame have the numbers of its vector, and the slot size is found.
#[test]
fn json_has_the_numbers_of_the_golden_frames() {
    for vector in vectors() {
        let size = vector.size.bytes().to_string();
        let frames = json_lines(&dump(&["--json", "--all", "--slot-size", &size], line(&vector)).expect_quiet());
        let [frame] = &frames[..] else { panic!("one line gives one object, not {}", frames.len()) };
        assert_eq!(frame["slot_bytes"], vector.size.bytes(), "{}", vector.name);
        let slots = frame["slots"].as_array().expect("slots are a list");
        assert_eq!(slots.len(), vector.size.slots(), "{}", vector.name);
        for (i, (slot, expected)) in slots.iter().zip(&vector.slots).enumerate() {
            let raw = &slot["raw"];
            let number = |name: &str| raw[name].as_u64().unwrap_or_default() as u32;
            let parm = number("parm") & if i == 0 { 0xFF } else { 0xFFFF };
            let found = (number("id"), number("index"), parm, number("data1"), number("data2"), number("data3"));
            let expected = (expected.id, expected.index, expected.parm, expected.data1, expected.data2, expected.data3);
            let expected =
                (expected.0.into(), expected.1.into(), expected.2.into(), expected.3, expected.4, expected.5);
            assert_eq!(found, expected, "{}, slot {i}", vector.name);
            assert_eq!(slot["slot"], i);
            assert_eq!(raw.get("data3").is_some(), vector.size == SlotSize::Bytes16);
        }
    }
}

/// XF-15.7 `dump --hex` shows golden packets of a chip, commands and answers, of any size and check word, as text and as JSON,
/// also with a frame of a board between them.
#[test]
fn golden_packets_are_dumped() {
    let sign = |is_answer| if is_answer { '<' } else { '>' };
    let packets = vectors::xf::packets();
    for packet in &packets {
        let input = format!("{} {} # {}\n", sign(packet.is_answer), hex(&packet.bytes), packet.name);
        let object = json_lines(&dump(&["--json"], &input).expect_quiet())[0].clone();
        let direction = if packet.is_answer { "answer" } else { "command" };
        assert_eq!((&object["direction"], &object["direction_guessed"]), (&direction.into(), &false.into()));
        assert!(object.get("damaged").is_none(), "{}: {object}", packet.name);
        if object.get("not_ready").is_none() {
            assert_eq!(
                (&object["code"], &object["index"]),
                (&packet.field("cmd").into(), &packet.field("index").into())
            );
        }
        assert_eq!(object["bytes"], hex(&packet.bytes));
        let guessed = json_lines(&dump(&["--json"], hex(&packet.bytes)).expect_quiet())[0].clone();
        assert_eq!(guessed["direction_guessed"], true, "{}", packet.name);
        // In an answer of a chip without slaves and cable, with a fixed check word, nothing shows that it is no command.
        let is_bare = packet.is_answer && packet.bytes[8..10] == [0; 2] && packet.bytes[10] & 3 == 0;
        assert!(is_bare || guessed["direction"] == direction, "{}: {guessed}", packet.name);
    }
    let state = packets.iter().find(|packet| packet.name == "state-set-op").expect("it is golden");
    let input = format!("> {}\n{}", hex(&state.bytes), line(&vector_named("set-state-preop")));
    let text = dump(&[], &input).expect_quiet();
    assert!(
        text.contains("line 1    command\n") && text.contains("STATE_SET") && text.contains("line 2    command\n"),
        "{text}"
    );
    let mut damaged = state.bytes.clone();
    damaged[30] ^= 1;
    let text = dump(&["--command"], hex(&damaged)).expect_quiet();
    assert!(text.contains("damaged: the check word"), "{text}");
}

/// The JSON says of the CRC in byte 3 whether it is right, absent or wrong; a right CRC may also be 0.
#[test]
fn json_says_whether_the_crc_is_right_absent_or_wrong() {
    for (name, status) in
        [("set-state-preop", "right"), ("resp-preop-nocrc", "absent"), ("crc-wrong", "wrong"), ("crc-is-zero", "right")]
    {
        let vector = vector_named(name);
        let frame = &json_lines(&dump(&["--json"], line(&vector)).expect_quiet())[0];
        assert_eq!(frame["crc"]["status"], status, "{name}");
        assert_eq!(frame["crc"]["found"], vector.bytes[3], "{name}");
        if let Some(crc) = vector.crc8 {
            assert_eq!(frame["crc"]["expected"], crc, "{name}");
        }
    }
}

/// The fields of the JSON have names with units, so that a script needs no byte offsets.
#[test]
fn json_fields_have_names_with_units() {
    let slot = |name: &str, slot: &str, arguments: &[&str]| {
        let arguments = [&["--json", "--slots", slot], arguments].concat();
        json_lines(&dump(&arguments, line(&vector_named(name))).expect_quiet())[0]["slots"][0].clone()
    };
    let csp = slot("csp-index-7", "1", &[]);
    assert_eq!((&csp["role"], &csp["id"], &csp["index"]), (&"slave".into(), &"CSP".into(), &7.into()));
    assert_eq!(csp["target_counts"], -1_234_567);
    let drive = slot("resp-op-fw17", "1", &["--kinds", "drive,io"]);
    assert_eq!((&drive["kind"], &drive["kind_from"]), (&"drive".into(), &"given".into()));
    assert_eq!((&drive["statusword"], &drive["position_counts"]), (&0x1637.into(), &(-1_234_560).into()));
    assert_eq!((&drive["torque_permille"], &drive["index"]), (&37.into(), &7.into()));
    assert_eq!(slot("resp-op-fw17", "1", &[])["kind_from"], "guessed");
    assert_eq!(slot("resp-op-fw17", "2", &[])["kind_from"], "implied");
    let old = slot("resp-op-fw15", "1", &["--fw", "1.5"]);
    assert_eq!((&old["mode"], old.get("index")), (&8.into(), None));
    let master = slot("resp-op-fw17", "0", &[]);
    assert_eq!((&master["state"], &master["state_code"]), (&"OP".into(), &8.into()));
    assert_eq!((&master["fifo_free_entries"], &master["full_count"]), (&159.into(), &1.into()));
    let abort = slot("resp-sdo-abort", "41", &[]);
    assert_eq!((&abort["object"]["index"], &abort["abort_code"]), (&0x5FFF.into(), &0x0602_0000.into()));
    let hsp = slot("resp-hsp-2ch-16", "1", &["--kinds", "hsp"]);
    assert_eq!((&hsp["position_counts"], &hsp["axis2"]["position_counts"]), (&70_000.into(), &(-70_000).into()));
    assert_eq!(slot("set-dc-2000", "0", &[])["cycle_us"], 2000);
    assert_eq!(slot("set-fifo-threshold", "0", &[])["threshold_entries"], 120);
    assert_eq!(slot("cst-negative", "1", &[])["target_torque_permille"], -300);
    assert_eq!(slot("io-wr", "2", &[])["outputs"], 0xA5C3);
}

/// The direction of a line without a prefix is guessed, and the output says so; a flag or a prefix decides it.
#[test]
fn a_guessed_direction_is_marked_and_a_prefix_or_flag_settles_it() {
    for vector in vectors() {
        let frame = &json_lines(&dump(&["--json"], hex(&vector.bytes)).expect_quiet())[0];
        let expected = if vector.is_response() { "response" } else { "command" };
        assert_eq!(
            (&frame["direction"], &frame["direction_guessed"]),
            (&expected.into(), &true.into()),
            "{}",
            vector.name
        );
    }
    let digits = hex(&vector_named("set-state-preop").bytes);
    assert!(dump(&[], &digits).expect_quiet().starts_with("line 1    command (guessed)\n"));
    assert!(dump(&["--command"], &digits).expect_quiet().starts_with("line 1    command\n"));
    assert!(dump(&["--response"], &digits).expect_quiet().starts_with("line 1    response\n"));
    assert!(dump(&["--response"], format!(">{digits}")).expect_quiet().starts_with("line 1    command\n"));
    assert!(dump(&["--command"], format!(" < {digits}")).expect_quiet().starts_with("line 1    response\n"));
}

/// Blanks, comments and upper case in lines of digits do not change the output. The line numbers in the output count all lines
/// of the input, comments and empty lines too.
#[test]
fn blanks_comments_and_upper_case_do_not_matter() {
    let vector = vector_named("csp-index-7");
    let spaced: String = vector.bytes.iter().map(|byte| format!(" {byte:02X}\t")).collect();
    let input = format!("# a comment\n\n  \t\n>{spaced}# the first\r\n> {}", hex(&vector.bytes));
    let out = dump(&["--slots", "1"], &input).expect_quiet();
    let expected = "line 4    command\n  slave 1  CSP #7 target -1234567\n\
                    line 5    command\n  slave 1  CSP #7 target -1234567\n";
    assert_eq!(out, expected);
}

/// SK-9.6 Of a frame with 12-byte slots in 512 bytes only the first 504 count; the rest is filler. The CRC shows the slot size,
/// of this frame as of one with 16-byte slots.
#[test]
fn slot_size_is_found_by_the_crc() {
    let padded = |mut bytes: Vec<u8>| {
        bytes.resize(512, 0xCC);
        hex(&bytes)
    };
    let narrow = padded(vector_named("csp-all-40").bytes);
    let wide = hex(&vector_named("csp-hsp-2ch-16").bytes);
    let sizes = |input: &str| -> Vec<_> {
        json_lines(&dump(&["--json"], input).expect_quiet()).iter().map(|frame| frame["slot_bytes"].as_u64()).collect()
    };
    assert_eq!(sizes(&format!("{narrow}\n{wide}\n{narrow}")), [Some(12), Some(16), Some(12)]);
    let all = |digits: &str| dump(&["--json", "--all"], digits).expect_quiet();
    assert_eq!(all(&narrow), all(&hex(&vector_named("csp-all-40").bytes)));
    // A frame without a CRC gets the slot size that the CRCs of other frames show.
    assert_eq!(sizes(&format!("{wide}\n{}", "00".repeat(512))), [Some(16), Some(16)]);
}

/// If nothing shows the slot size, the default is used, and a note says so, once.
#[test]
fn an_assumed_slot_size_is_noted_once() {
    let zeros = "00".repeat(512);
    let ran = dump(&["--json"], format!("{zeros}\n{zeros}\n"));
    assert_eq!(ran.code, Some(0));
    assert_eq!(ran.out.matches("\"slot_bytes\":12").count(), 2);
    assert_eq!(
        ran.err,
        "note: line 1: no CRC tells the slot size, taken as 12 bytes; if it is not, give --slot-size\n"
    );
    let out = dump(&["--json", "--slot-size", "16"], &zeros).expect_quiet();
    assert!(out.contains("\"slot_bytes\":16"), "{out}");
}

/// Without `--kinds` the kinds of slaves are those of the last SET_AXIS.
#[test]
fn set_axis_tells_the_kinds() {
    let (axes, response) = (line(&vector_named("set-axis-group0")), line(&vector_named("resp-hsp-12")));
    let alone = dump(&["--slots", "1,3"], &response).expect_quiet();
    assert!(alone.contains("CSP #2 DRIVE? statusword"), "{alone}");
    let after = dump(&["--slots", "1,3"], format!("{axes}{response}")).expect_quiet();
    assert!(after.contains("CSP #2 DRIVE statusword"), "{after}");
    let given = dump(&["--slots", "1", "--kinds", "hsp"], format!("{axes}{response}")).expect_quiet();
    assert!(given.contains("CSP #2 HSP statusword") && given.contains("inputs 0x00A5"), "{given}");
    let reset = line(&vector_named("sw-reset"));
    let forgotten = dump(&["--slots", "1"], format!("{axes}{reset}{response}")).expect_quiet();
    assert!(forgotten.contains("CSP #2 DRIVE? statusword"), "{forgotten}");
}

/// A wrong line ends the dump with its number and the error; the lines before it are printed.
#[test]
fn a_wrong_line_ends_the_dump_with_its_number() {
    let good = line(&vector_named("set-state-preop"));
    let digits = hex(&vector_named("set-state-preop").bytes);
    for (input, words) in [
        (format!("{good}hello\n"), ["line 2: `h` is no hexadecimal digit", ""]),
        (format!("{good}{}", &digits[..1006]), ["line 2: 1006 hexadecimal digits are 503 bytes", "504 to 512"]),
        (format!("{good}{}", &digits[..1007]), ["503 and a half", "1008 digits to 1024"]),
        (format!("{good}{}", "0".repeat(1026)), ["513 bytes", "expected 504 to 512"]),
        (format!("{good}>\n"), ["0 hexadecimal digits are 0 bytes", ""]),
        (format!("{good}> {digits} <"), ["`<` is no", ""]),
        (format!("{good}\u{e4}{digits}"), ["`\u{e4}` is no", ""]),
    ] {
        let ran = dump(&[], &input);
        ran.expect_failure(1, &words, "put `#` before lines that are not frames");
        assert_eq!(ran.out, "line 1    command\n  ECM      SET_STATE PreOP, CRC 0xE7 ok\n", "{input}");
    }
    dump(&[], b"\xff\xfe\n").expect_failure(1, &["line 1", "is no hexadecimal digit"], "put `#` before");
    dump(&[], vec![0; 1 << 20]).expect_failure(1, &["line 1 is longer than 65536 bytes"], "one frame per line");
    dump(&["--slot-size", "16"], &digits).expect_failure(1, &["504 bytes", "512"], "leave out --slot-size 16");
    let wide = hex(&vector_named("all-zero-16").bytes);
    dump(&["--slots", "32"], &wide).expect_failure(1, &["16-byte slots has no slot 32"], "name slots from 0 to 31");
}

/// Without input, or with only comments, nothing is printed and there is no failure.
#[test]
fn empty_input_shows_nothing_and_is_no_failure() {
    assert_eq!(dump(&[], "").expect_quiet(), "");
    assert_eq!(dump(&["--json"], "# nothing\n\n").expect_quiet(), "");
}

/// Contradicting options are refused by name.
#[test]
fn contradicting_options_are_refused_by_name() {
    run(["dump"]).expect_misuse(&["<FILE>"]);
    run(["dump", "f", "--command"]).expect_misuse(&["--command", "[FILE]"]);
    run(["dump", "--hex", "--command", "--response"]).expect_misuse(&["--command", "--response"]);
    run(["dump", "--hex", "--slots", "1", "--all"]).expect_misuse(&["--slots", "--all"]);
    run(["dump", "--hex", "--slot-size", "14"]).expect_misuse(&["'14'", "--slot-size", "allowed: 12, 16"]);
    run(["dump", "--hex", "--fw", "2"]).expect_misuse(&["'2'", "--fw", "allowed: 1.7, 1.5"]);
    run(["dump", "--hex", "--kinds", "drive*2,dog"])
        .expect_misuse(&["kind `dog` is unknown; allowed: drive, io, step, dp3cl, hsp, hsp2, none"]);
    run(["dump", "--hex", "--kinds", "drive*0"]).expect_misuse(&["in `drive*0`, allowed: a whole number from 1 to 40"]);
    run(["dump", "--hex", "--kinds", "drive*40,io"]).expect_misuse(&["41 slaves, allowed: at most 40"]);
}
