//! The text of a script: what it may say, what is wrong and where.

use ecmsk::link::keys::help;
use ecmsk::link::options::SimOptions;
use ecmsk::link::script::{Script, ScriptError};
use ecmsk::link::slaves::SlaveSpec;
use ecmsk::link::uri::LinkUri;
use proptest::prelude::*;

fn slaves(list: &str) -> Vec<SlaveSpec> {
    let uri = LinkUri::parse(&format!("sim:?slaves={list}")).expect(list);
    SimOptions::from_uri(&uri).expect(list).slaves
}

#[test]
fn what_a_script_may_say() {
    for (text, steps) in [
        ("", 0),
        ("# nothing\n\n   \t# still nothing\r\n", 0),
        ("alarm 1 1", 1),
        ("at 0s alarm 2.1 0xFFFF stays", 1),
        ("  at\t1.5min  cut 2   for 1h # both ways\r\n", 2),
        ("refuse 1 op for 1s\nrefuse 1 op 0x11 for 1s\nrefuse 1 init 17\nend refuse 1", 6),
        ("sdo-abort 1 0x6098:0 1\nsdo-abort 1 24728:0x0 0xFFFFFFFF for 1us\nend sdo-abort 1", 4),
        ("sdo-delay 1 0ms\nat 1s end sdo-delay 1", 2),
        ("mute 1\nend mute 1\ncut 1\nend cut\nheal\nsilent\nend silent\nfull\nend full\ninputs 0x3F", 10),
    ] {
        let script = Script::parse("test", text, &slaves("drive*2"));
        assert_eq!(script.map(|script| script.len()), Ok(steps), "{text}");
    }
    let script = Script::parse("test", "alarm 1.2 0x7500\nalarm 2 0x7500", &slaves("hsp2,step"));
    assert_eq!(script.map(|script| script.len()), Ok(2), "the second channel of a module");
}

/// What editors on Windows make of a file: a byte order mark in front is no part of it, UTF-16 is named as what it is; what
/// nobody can see in a message is shown by its code.
#[test]
fn files_of_other_editors() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("script");
    let load = |bytes: &[u8]| {
        std::fs::write(&path, bytes).expect("a file");
        Script::load(&path, &slaves("drive*2"))
    };
    assert_eq!(load(b"\xEF\xBB\xBFat 5ms mute 1\r\nat 6ms end mute 1\r\n").map(|script| script.len()), Ok(2));
    let utf_16: Vec<u8> = [0xFEFF].into_iter().chain("mute 1".encode_utf16()).flat_map(u16::to_le_bytes).collect();
    for bytes in [utf_16.as_slice(), b"\xFF"] {
        let said = load(bytes).unwrap_err().to_string();
        assert!(said.contains("no text in UTF-8; save it as UTF-8"), "{said}");
    }
    for (bytes, shown) in [(b"mute\0 1".as_slice(), "`mute\\u{0}`"), (b"at 5ms\x1b[2J mute 1", "`5ms\\u{1b}[2J`")] {
        let said = load(bytes).unwrap_err().to_string();
        assert!(said.contains(shown) && !said.chars().any(char::is_control), "{said}");
    }
}

#[test]
fn what_is_wrong_is_said_with_its_place_and_what_is_allowed() {
    const VERBS: &str = "alarm, cut, heal, mute, refuse, sdo-delay, sdo-abort, silent, full, inputs";
    const LASTING: &str = "cut, mute, refuse, sdo-delay, sdo-abort, silent, full";
    const TIMES: &str = "a time with its unit, such as 2.5s; units: us, ms, s, min, h; at most 1000h";
    for (text, line, column, message) in [
        ("\n  alram 1 0x7500", 2, 3, format!("`alram` is no verb; did you mean `alarm`? allowed: at, end, {VERBS}")),
        ("explode", 1, 1, format!("`explode` is no verb; allowed: at, end, {VERBS}")),
        ("at", 1, 3, "TIME is missing; allowed: at TIME VERB ..".into()),
        ("at 2.5 heal", 1, 4, format!("`2.5` is no time; allowed: {TIMES}")),
        ("at 1001h heal", 1, 4, format!("`1001h` is no time; allowed: {TIMES}")),
        ("at 1s", 1, 6, format!("VERB is missing; allowed: {VERBS}")),
        ("at 1s end", 1, 10, format!("VERB is missing; allowed: {LASTING}")),
        ("end alarm 1", 1, 5, format!("`alarm` is no verb that `end` ends; allowed: {LASTING}")),
        ("end muet 1", 1, 5, format!("`muet` is no verb that `end` ends; did you mean `mute`? allowed: {LASTING}")),
        ("end refuse", 1, 11, "SLAVE is missing; allowed: end refuse SLAVE".into()),
        ("end refuse 1 op", 1, 14, "`op` is too much; allowed: end refuse SLAVE".into()),
        ("alarm 1", 1, 8, "CODE is missing; allowed: alarm SLAVE[.AXIS] CODE [stays]".into()),
        ("alarm 1 0", 1, 9, "`0` is no CODE; allowed: a number from 0x1 to 0xFFFF".into()),
        ("alarm 1 0x10000", 1, 9, "`0x10000` is no CODE; allowed: a number from 0x1 to 0xFFFF".into()),
        ("alarm 1 1 for 2s", 1, 11, "`for` is too much; allowed: alarm SLAVE[.AXIS] CODE [stays]".into()),
        ("alarm 1.2 1", 1, 7, "`1.2` is no axis; allowed: 1, slave 1 has one axis".into()),
        ("alarm 3 1", 1, 7, "`3` is no axis; allowed: a slave with a drive; slave 3 is an io".into()),
        ("cut 4", 1, 5, "`4` is no slave of this network; allowed: a number from 1 to 3".into()),
        ("cut 0", 1, 5, "`0` is no slave of this network; allowed: a number from 1 to 3".into()),
        ("cut 1 for", 1, 10, "TIME is missing; allowed: cut SLAVE [for TIME]".into()),
        ("cut 1 2", 1, 7, "`2` is too much; allowed: cut SLAVE [for TIME]".into()),
        (
            "refuse 1 saveop",
            1,
            10,
            "`saveop` is no state; did you mean `safeop`? allowed: init, preop, safeop, op".into(),
        ),
        ("refuse 1 op x", 1, 13, "`x` is no AL_STATUS; allowed: a number from 0x1 to 0xFFFF".into()),
        ("sdo-delay 1 5", 1, 13, format!("`5` is no time; allowed: {TIMES}")),
        (
            "sdo-abort 1 0x6098:300 1",
            1,
            13,
            "`0x6098:300` is no object; allowed: index and subindex, such as 0x6098:0".into(),
        ),
        ("sdo-abort 1 0x6098:0", 1, 21, "CODE is missing; allowed: sdo-abort SLAVE [INDEX:SUB] CODE [for TIME]".into()),
        ("inputs 0x40", 1, 8, "`0x40` is no BITS; allowed: a number from 0x0 to 0x3F".into()),
        ("# ä\nä 1", 2, 1, format!("`ä` is no verb; allowed: at, end, {VERBS}")),
        ("silent ä x", 1, 8, "`ä` is too much; allowed: silent [for TIME]".into()),
    ] {
        let error = Script::parse("my.ecmscript", text, &slaves("drive*2,io")).expect_err(text);
        assert_eq!(
            error,
            ScriptError::Line { file: "my.ecmscript".into(), line, column, message: message.clone() },
            "{text}"
        );
        let words = format!("my.ecmscript, line {line}, column {column}: {message}; see `ecmsk link help`");
        assert_eq!(error.to_string(), words);
    }
    let error = Script::parse("x", "cut 1", &slaves("none")).expect_err("no slave");
    assert!(error.to_string().contains("allowed: none, the network has no slaves"), "{error}");
}

#[test]
fn the_help_has_every_verb() {
    let help = help();
    for verb in [
        "alarm SLAVE",
        "cut SLAVE [for TIME]",
        "sdo-abort SLAVE [INDEX:SUB] CODE [for TIME]",
        "silent [for TIME]",
        "inputs BITS",
    ] {
        assert!(help.contains(&format!("\n  {verb}")), "{verb}:\n{help}");
    }
}

fn word() -> impl Strategy<Value = String> {
    let words = "at end for alarm cut heal mute refuse sdo-delay sdo-abort silent full inputs stays init safeop op 1 2 1.1 \
                 0x7500 0x6098:0 2.5s 200ms 0s # ä";
    let known: Vec<String> = words.split(' ').map(String::from).collect();
    prop_oneof![4 => proptest::sample::select(known), 1 => any::<String>()]
}

proptest! {
    #[test]
    fn no_text_makes_the_parser_panic(text in any::<String>(), lines in proptest::collection::vec(proptest::collection::vec(word(), 0..8), 0..6)) {
        let network = slaves("drive*2,io");
        let lines: Vec<String> = lines.iter().map(|words| words.join(" ")).collect();
        for text in [text, lines.join("\n")] {
            if let Err(ScriptError::Line { line, column, message, .. }) = Script::parse("any", &text, &network) {
                let wrong = text.lines().nth(line as usize - 1).expect("a line of the text");
                prop_assert!((1..=wrong.chars().count() + 1).contains(&column), "{wrong}: column {column}");
                prop_assert!(message.contains("allowed: "), "{message}");
            }
        }
    }
}
