//! The text of a script: its syntax, and errors with their position.

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
fn valid_scripts_are_read() {
    for (text, steps) in [
        ("", 0),
        ("# nothing\n\n   \t# still nothing\r\n", 0),
        ("alarm 1 1", 1),
        ("at 0s alarm 2.1 0xFFFF stays\nend alarm 2.1", 2),
        ("  at\t1.5min  cut 2   for 1h # both ways\r\n", 2),
        ("refuse 1 op for 1s\nrefuse 1 op 0x11 for 1s\nrefuse 1 init 17\nend refuse 1", 6),
        ("sdo-abort 1 0x6098:0 1\nsdo-abort 1 24728:0x0 0xFFFFFFFF for 1us\nend sdo-abort 1", 4),
        ("sdo-delay 1 0ms\nat 1s end sdo-delay 1", 2),
        ("noise 2 100 for 1s\nend noise 2", 3),
        ("mute 1\nend mute 1\ncut 1\nend cut\nheal\nsilent\nend silent\nfull\nend full\ninputs 0x3F", 10),
    ] {
        let script = Script::parse("test", text, &slaves("drive*2"));
        assert_eq!(script.map(|script| script.len()), Ok(steps), "{text}");
    }
    let text = "lose 1 for 1s\nat 2s find 1\nend lose 1\njam 2\nend jam 2\nstick 1.2 home off for 1s\nstick 1 index on\n\
                end stick 1\nio 3 inputs 0xFFFF for 1s\nio 1.2 walk 20ms for 1s\nend io 1.2";
    assert_eq!(Script::parse("test", text, &slaves("hsp2,step,io")).map(|script| script.len()), Ok(15));
    for list in ["drive", "io", "hsp"] {
        let model = slaves(list)[0].model;
        assert_eq!(Script::parse("test", "jam 1", &slaves(list)).is_ok(), model.motors() > 0, "{list}");
        assert_eq!(Script::parse("test", "io 1 inputs 1", &slaves(list)).is_ok(), model.channels() > 0, "{list}");
    }
    let script = Script::parse("test", "alarm 1.2 0x7500\nalarm 2 0x7500", &slaves("hsp2,step"));
    assert_eq!(script.map(|script| script.len()), Ok(2), "the second channel of a module");
}

/// Files of editors on Windows: a leading byte order mark is ignored, UTF-16 is reported as such; invisible characters
/// are shown by their code in a message.
#[test]
fn a_byte_order_mark_is_accepted_and_utf_16_is_refused_by_name() {
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

/// An error is reported with its position and the allowed values.
#[test]
fn an_invalid_line_is_reported_with_its_position_and_what_is_allowed() {
    const VERBS: &str = "alarm, cut, heal, noise, mute, refuse, sdo-delay, sdo-abort, lose, find, stick, jam, \
                         io, silent, full, inputs";
    const LASTING: &str = "alarm, cut, noise, mute, refuse, sdo-delay, sdo-abort, lose, stick, jam, io, silent, full";
    const TIMES: &str = "a time with its unit, such as 2.5s; units: us, ms, s, min, h; at most 1000h";
    for (text, line, column, message) in [
        ("\n  alram 1 0x7500", 2, 3, format!("`alram` is no verb; did you mean `alarm`? allowed: at, end, from, {VERBS}")),
        ("explode", 1, 1, format!("`explode` is no verb; allowed: at, end, from, {VERBS}")),
        ("at", 1, 3, "TIME is missing; allowed: at TIME VERB ..".into()),
        ("at 2.5 heal", 1, 4, format!("`2.5` is no time; allowed: {TIMES}")),
        ("at 1001h heal", 1, 4, format!("`1001h` is no time; allowed: {TIMES}")),
        ("at 1s", 1, 6, format!("VERB is missing; allowed: {VERBS}")),
        ("at 1s end", 1, 10, format!("VERB is missing; allowed: {LASTING}")),
        ("from", 1, 5, "start|frame|op is missing; allowed: from start|frame|op".into()),
        ("from fame", 1, 6, "`fame` is no moment; did you mean `frame`? allowed: start, frame, op".into()),
        ("from op 2s", 1, 9, "`2s` is too much; allowed: from start|frame|op".into()),
        ("end heal", 1, 5, format!("`heal` is no verb that `end` ends; allowed: {LASTING}")),
        ("end alarm", 1, 10, "SLAVE is missing; allowed: end alarm SLAVE[.AXIS]".into()),
        ("end alarm 1 0x7500", 1, 13, "`0x7500` is too much; allowed: end alarm SLAVE[.AXIS]".into()),
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
        ("noise 2 0", 1, 9, "`0` is no N; allowed: a number from 0x1 to 0xFFFF".into()),
        ("inputs 0x40", 1, 8, "`0x40` is no BITS; allowed: a number from 0x0 to 0x3F".into()),
        ("lose 4", 1, 6, "`4` is no slave of this network; allowed: a number from 1 to 3".into()),
        ("find 1 for 1s", 1, 8, "`for` is too much; allowed: find SLAVE".into()),
        ("end find 1", 1, 5, format!("`find` is no verb that `end` ends; allowed: {LASTING}")),
        ("jam 3", 1, 5, "`3` is no axis; allowed: a slave with a motor; slave 3 is an io".into()),
        ("jam 1.2", 1, 5, "`1.2` is no axis; allowed: 1, slave 1 has one axis".into()),
        ("jam 1 2", 1, 7, "`2` is too much; allowed: jam SLAVE [for TIME]".into()),
        ("stick 1", 1, 8, "INPUT is missing; allowed: stick SLAVE[.AXIS] INPUT on|off [for TIME]".into()),
        (
            "stick 1 negative-limt on",
            1,
            9,
            "`negative-limt` is no input; did you mean `negative-limit`? allowed: negative-limit, positive-limit, home, index"
                .into(),
        ),
        ("stick 1 home", 1, 13, "on|off is missing; allowed: stick SLAVE[.AXIS] INPUT on|off [for TIME]".into()),
        ("stick 1 home open", 1, 14, "`open` is no value; allowed: on, off".into()),
        ("stick 3 home on", 1, 7, "`3` is no axis; allowed: a slave with a drive; slave 3 is an io".into()),
        ("end stick 1 home", 1, 13, "`home` is too much; allowed: end stick SLAVE[.AXIS]".into()),
        ("io 1 inputs 0", 1, 4, "`1` is no channel; allowed: a slave with digital inputs; slave 1 is a drive".into()),
        ("io 3.2 inputs 0", 1, 4, "`3.2` is no channel; allowed: 3, slave 3 has one channel".into()),
        (
            "io 3",
            1,
            5,
            "inputs|walk is missing; allowed: io SLAVE[.CHANNEL] inputs BITS|walk TIME [for TIME]".into(),
        ),
        ("io 3 input 1", 1, 6, "`input` is no pattern; did you mean `inputs`? allowed: inputs, walk".into()),
        ("io 3 inputs 0x10000", 1, 13, "`0x10000` is no BITS; allowed: a number from 0x0 to 0xFFFF".into()),
        ("io 3 walk 5", 1, 11, format!("`5` is no time; allowed: {TIMES}")),
        ("io 3 walk 0ms", 1, 11, "`0ms` is no TIME; allowed: a time that is longer than 0".into()),
        ("end io", 1, 7, "SLAVE is missing; allowed: end io SLAVE[.CHANNEL]".into()),
        ("# ä\nä 1", 2, 1, format!("`ä` is no verb; allowed: at, end, from, {VERBS}")),
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
        "noise SLAVE N [for TIME]",
        "lose SLAVE [for TIME]",
        "find SLAVE",
        "stick SLAVE[.AXIS] INPUT on|off [for TIME]",
        "jam SLAVE [for TIME]",
        "io SLAVE[.CHANNEL] inputs BITS|walk TIME [for TIME]",
    ] {
        assert!(help.contains(&format!("\n  {verb}")), "{verb}:\n{help}");
    }
}

fn word() -> impl Strategy<Value = String> {
    let words = "at end for alarm cut heal noise mute refuse sdo-delay sdo-abort silent full inputs stick jam lose find io walk home index on off 3 stays init safeop op 1 2 1.1 \
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
