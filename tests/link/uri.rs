//! The URI that names a link: grammar, defaults, normal form, errors, help.

use std::path::Path;
use std::time::Duration;

use ecmsk::engine::Firmware;
use ecmsk::link::chip::ChipOptions;
use ecmsk::link::fault::{FaultOptions, FaultRates};
use ecmsk::link::keys::{KEYS, Scheme, help};
use ecmsk::link::options::{BoardOptions, Clock, CommonOptions, SimOptions};
use ecmsk::link::slaves::{SlaveModel, parse_declared, word};
use ecmsk::link::uri::{LinkUri, UriError};
use ecmsk::link::{Fraction, LinkError, Wait};
use ecmsk::sk::{SlaveKind, SlotSize};
use proptest::prelude::*;

fn uri(text: &str) -> LinkUri {
    LinkUri::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

fn sim(text: &str) -> SimOptions {
    SimOptions::from_uri(&uri(text)).unwrap_or_else(|error| panic!("{text}: {error}"))
}

fn common(text: &str) -> CommonOptions {
    CommonOptions::from_uri(&uri(text)).unwrap_or_else(|error| panic!("{text}: {error}"))
}

/// The error's text, which must contain all of `parts` and where to look.
fn refused(text: &str, parts: &[&str]) -> UriError {
    let error = LinkUri::parse(text).expect_err(text);
    let words = error.to_string();
    for part in parts.iter().chain(&["allowed: ", "ecmsk link help"]) {
        assert!(words.contains(part), "{text}: `{words}` does not say `{part}`");
    }
    error
}

/// SK-1.1 slots have 12 bytes by default
/// LIB-35 a read waits without end by default
/// LIB-38 the limit of a write is 5000 ms by default
/// LIB-55 32 reports are kept by default
#[test]
fn defaults_are_those_of_the_specification() {
    let common = common("sim:");
    assert_eq!(common.slot, Some(SlotSize::Bytes12));
    assert_eq!(common.queue, 32);
    assert_eq!(common.record, None);
    assert_eq!(common.read_wait(), Wait::Forever);
    assert_eq!(common.write_wait(), Wait::For(Duration::from_millis(5000)));

    let sim = sim("sim:");
    assert_eq!(sim.slaves.iter().map(|slave| slave.model).collect::<Vec<_>>(), [SlaveModel::Drive; 2]);
    assert_eq!(sim.board.slot, SlotSize::Bytes12);
    assert_eq!(sim.clock, Clock::Real);
    assert_eq!(sim.board.firmware, Firmware::V17);
    assert_eq!(sim.name, None);
    assert_eq!(sim.board.host_us, 125);
    assert_eq!(sim.board.state_timeout, Duration::from_secs(10));
    assert_eq!(sim.board.sdo_timeout, Duration::from_secs(1));
    assert_eq!(sim.board.priority, None);
    assert!(!sim.board.lock_memory && !sim.board.test);
    assert_eq!(sim.catch_up, Duration::from_secs(60));
}

/// LIB-36 `read_timeout_ms` limits a read
/// LIB-38 `write_timeout_ms` limits a write
#[test]
fn every_key_reaches_its_option() {
    let text = "sim:?slaves=drive*3&slot=16&fw=1.5&test=1&name=left-arm.1&host_us=0&state_timeout_ms=20\
                &sdo_timeout_ms=30&priority=99&cpu=3&lock_memory=yes&catch_up_ms=0&queue=1&record=/tmp/a%20b.pcapng\
                &read_timeout_ms=40&write_timeout_ms=50&rate=0.25&script=/tmp/a.ecmscript&control=press";
    let common = common(text);
    assert_eq!(common.slot, Some(SlotSize::Bytes16));
    assert_eq!(common.queue, 1);
    assert_eq!(common.record.as_deref(), Some(Path::new("/tmp/a b.pcapng")));
    assert_eq!(common.read_timeout, Some(Duration::from_millis(40)));
    assert_eq!(common.read_wait(), Wait::For(Duration::from_millis(40)));
    assert_eq!(common.write_timeout, Duration::from_millis(50));

    let sim = sim(text);
    assert_eq!(sim.slaves.len(), 3);
    assert_eq!(sim.board.slot, SlotSize::Bytes16);
    assert_eq!(sim.clock, Clock::Real);
    assert_eq!(self::sim("sim:?clock=virtual").clock, Clock::Virtual);
    assert_eq!(sim.board.firmware, Firmware::V15);
    assert!(sim.board.test);
    assert_eq!(sim.name.as_deref(), Some("left-arm.1"));
    assert_eq!(sim.board.host_us, 0);
    assert_eq!(sim.board.state_timeout, Duration::from_millis(20));
    assert_eq!(sim.board.sdo_timeout, Duration::from_millis(30));
    assert_eq!(sim.board.priority, Some(99));
    assert!(sim.board.lock_memory && sim.board.cpu == Some(3));
    assert_eq!(sim.catch_up, Duration::ZERO);
    assert_eq!(sim.rate, Fraction::from_billionths(250_000_000));
    assert_eq!(sim.script.as_deref(), Some(Path::new("/tmp/a.ecmscript")));
    assert_eq!(sim.control.as_deref(), Some("press"));
}

/// `machine=` gives the slaves of a machine file, with the identities that they have to have; what is wrong with the file, or
/// too much for the slot, is an error of the link.
#[test]
fn the_slaves_of_a_machine_file_are_simulated() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("machine.toml");
    let link = |keys: &str| LinkUri::parse(&format!("xf-sim:?machine={}{keys}", file.display())).expect("a link");
    std::fs::write(&file, "format = 1\n[slaves.1]\nkind = \"io\"\nvendor = 7\n[axes]\nX = { slave = 2 }\n")
        .expect("a file");
    let slaves = SimOptions::from_uri(&link("")).expect("options").slaves;
    assert_eq!((slaves.len(), slaves[0].model, slaves[0].identity.vendor), (2, SlaveModel::Io, Some(7)));
    let axes: String = (1..=31).map(|slave| format!("A{slave} = {{ slave = {slave} }}\n")).collect();
    std::fs::write(&file, format!("format = 1\n[axes]\n{axes}")).expect("a file");
    let error = SimOptions::from_uri(&link("&slot=16")).expect_err("31 slaves").to_string();
    assert!(
        error.contains("key `machine` does not take") && error.contains("at most 30 slaves with slot=16"),
        "{error}"
    );
    std::fs::write(&file, "format = 1\n[axes]\nX = { slave = 0 }\n").expect("a file");
    let error = SimOptions::from_uri(&link("")).expect_err("slave 0").to_string();
    assert!(error.contains("line 3: axes.X.slave: there is no slave 0"), "{error}");
}

/// A key for both directions and one for each; the key of one direction overrides the common one.
#[test]
fn fault_keys_reach_their_options() {
    let share = Fraction::from_billionths;
    let quiet = FaultRates::default();
    assert_eq!(common("sim:").fault, FaultOptions::default());
    assert!(!common("sim:?fault.seed=7&fault.delay_ms=1").fault.any());

    let text = "tcp://host:1?fault.seed=18446744073709551615&fault.drop=0.5&fault.corrupt.write=1&fault.duplicate.read=.25\
                &fault.delay=0.1&fault.delay.read=0&fault.delay_ms=7&fault.disconnect_after=3&fault.disconnect_ms=4";
    assert_eq!(
        common(text).fault,
        FaultOptions {
            seed: u64::MAX,
            write: FaultRates { drop: share(500_000_000), corrupt: Fraction::ONE, delay: share(100_000_000), ..quiet },
            read: FaultRates { drop: share(500_000_000), duplicate: share(250_000_000), ..quiet },
            delay: Duration::from_millis(7),
            disconnect_after: Some(3),
            disconnect_at: Some(Duration::from_millis(4)),
        }
    );
    for one in ["drop.read=0.1", "corrupt=0.1", "duplicate.write=1", "delay=1", "disconnect_after=1", "disconnect_ms=1"]
    {
        assert!(common(&format!("usb:?fault.{one}")).fault.any(), "{one}");
    }
    for key in ["drop", "corrupt.write", "duplicate.read", "delay"] {
        for value in ["1.5", "-1", "", "1%", "0.0000000001", "half"] {
            let text = format!("usb:?fault.{key}={}", value.replace('%', "%25"));
            refused(&text, &[&format!("`fault.{key}`"), &format!("`{value}`"), "a number from 0 to 1"]);
        }
    }
    refused("sim:?fault.drap=1", &["`fault.drap`", "did you mean `fault.drop`?"]);
    refused("usb:?fault.break=1", &["`fault.break`", "fault.disconnect_ms"]);
}

/// A key without effect on a virtual clock is refused there; its default is not.
#[test]
fn keys_of_the_real_clock_are_refused_on_a_virtual_one() {
    for (key, value, why) in [
        (
            "rate",
            "0.5",
            "with clock=virtual time passes by calls alone, at no rate; allowed: rate= with clock=real, or rate=1",
        ),
        ("priority", "50", "with clock=virtual there is no thread of the cycle; allowed: priority= with clock=real"),
        ("cpu", "3", "with clock=virtual there is no thread to keep somewhere; allowed: cpu= with clock=real"),
        (
            "lock_memory",
            "yes",
            "with clock=virtual no cycle has a time to keep; allowed: lock_memory= with clock=real, or lock_memory=no",
        ),
    ] {
        for text in [format!("sim:?clock=virtual&{key}={value}"), format!("sim:?{key}={value}&clock=virtual")] {
            refused(&text, &[&format!("key `{key}` does not take `{value}`; {why}; see")]);
        }
        uri(&format!("sim:?{key}={value}"));
    }
    uri("sim:?clock=virtual&rate=1.0&lock_memory=no");
    for value in ["0", "0.0009", "1.1", "2", "fast"] {
        refused(&format!("sim:?rate={value}"), &["`rate`", &format!("`{value}`"), "a number from 0.001 to 1"]);
    }
}

/// The help's text agrees with the parser.
#[test]
fn the_table_the_parser_and_the_help_agree() {
    let help = help();
    for key in KEYS {
        assert!(!key.schemes.is_empty(), "{}", key.name);
        for scheme in key.schemes {
            let bare = uri(&format!("{scheme}:"));
            assert_eq!(bare.value(key.name), key.default, "{scheme}: {}", key.name);

            let example = uri(&format!("{scheme}:?{}={}", key.name, key.example));
            assert_eq!(example.value(key.name), Some(key.example), "{scheme}: {}", key.name);
            assert_ne!(example, bare, "the example of {} is its default", key.name);

            if let Some(default) = key.default {
                let explicit = uri(&format!("{scheme}:?{}={default}", key.name));
                assert_eq!(explicit, bare, "the default of {} in its normal form", key.name);
            }
        }
        assert!(help.contains(&format!("\n  {}=", key.name)), "the help lacks {}", key.name);
        assert!(help.contains(key.meaning), "the help lacks what {} means", key.name);
        if let Some(default) = key.default {
            assert!(help.contains(&format!("; default {default}]")), "the help lacks the default of {}", key.name);
        }
    }
    for scheme in Scheme::ALL {
        assert_eq!(Scheme::from_name(scheme.name()), Some(scheme));
        let line = help.lines().find(|line| line.starts_with(&format!("  {scheme}:"))).expect("a line per scheme");
        assert_eq!(line.contains("not in this build"), !scheme.in_build(), "{line}");
    }
}

#[test]
fn no_key_stands_twice_in_the_table_for_one_scheme() {
    for scheme in Scheme::ALL {
        let names: Vec<_> = KEYS.iter().filter(|key| key.schemes.contains(&scheme)).map(|key| key.name).collect();
        let mut unique = names.clone();
        unique.sort_unstable();
        unique.dedup();
        assert_eq!(unique.len(), names.len(), "{scheme}: {names:?}");
    }
}

#[test]
fn the_normal_form_is_sorted_without_defaults_and_encoded() {
    for (text, normal) in [
        ("sim:", "sim:"),
        ("  sim:?\n", "sim:"),
        ("sim:?queue=32&fw=1.7&slaves=drive,drive", "sim:"),
        ("sim:?clock=virtual&slaves=drive,drive*2", "sim:?slaves=drive*3&clock=virtual"),
        ("sim:?slaves=none", "sim:?slaves=none"),
        ("sim:?slaves=drive", "sim:?slaves=drive"),
        ("sim:?slaves=drive*1", "sim:?slaves=drive"),
        ("sim:?host_us=0007", "sim:?host_us=7"),
        ("sim:?write_timeout_ms=1&read_timeout_ms=0", "sim:?read_timeout_ms=0&write_timeout_ms=1"),
        ("sim:?record=/tmp/a b&queue=1", "sim:?queue=1&record=/tmp/a%20b"),
        ("sim:?record=100%&queue=1", "sim:?queue=1&record=100%25"),
        ("sim:?rec%6Frd=a%26b%3D%3F%23", "sim:?record=a%26b%3D%3F%23"),
        ("sim:?record=a=b", "sim:?record=a%3Db"),
        ("usb:?serial=A%20B&queue=1", "usb:?queue=1&serial=A%20B"),
        ("usb:?slot=12", "usb:?slot=12"),
        ("spi:/dev/spidev0.0?speed=24M&busy=gpiochip0/25", "spi:/dev/spidev0.0?busy=gpiochip0/25"),
        ("tcp://host:4711", "tcp://host:4711"),
        ("spi:/dev/a b%3f", "spi:/dev/a%20b%3F"),
    ] {
        let parsed = uri(text);
        assert_eq!(parsed.to_string(), normal, "{text}");
        assert_eq!(uri(normal), parsed, "{text}");
    }
}

#[test]
fn scheme_path_and_keys_are_given_out_decoded() {
    let parsed = uri("spi:/dev/a%20b?record=a%26b&queue=7");
    assert_eq!((parsed.scheme(), parsed.path()), (Scheme::Spi, "/dev/a b"));
    assert_eq!(parsed.keys().collect::<Vec<_>>(), [("queue", "7"), ("record", "a&b")]);
    assert_eq!(parsed.value("write_timeout_ms"), Some("5000"));
    assert_eq!(parsed.value("nonsense"), None);
    assert_eq!("sim:".parse::<LinkUri>(), LinkUri::parse("sim:"));
}

/// Slaves of two kinds keep their order.
#[test]
fn slaves_of_two_kinds_stand_in_order() {
    use SlaveModel::{Drive, Hsp, Hsp2, Io, Step};
    for (list, models, normal) in [
        ("io", vec![Io], "io"),
        ("drive*2,io", vec![Drive, Drive, Io], "drive*2,io"),
        ("io,io,drive,io*1", vec![Io, Io, Drive, Io], "io*2,drive,io"),
        ("hsp,hsp2,hsp2,step,hsp", vec![Hsp, Hsp2, Hsp2, Step, Hsp], "hsp,hsp2*2,step,hsp"),
    ] {
        let text = format!("sim:?slaves={list}");
        assert_eq!(sim(&text).slaves.iter().map(|slave| slave.model).collect::<Vec<_>>(), models, "{list}");
        assert_eq!(uri(&text).to_string(), format!("sim:?slaves={normal}"), "{list}");
    }
}

/// SK-1.3 up to 40 slaves with 12-byte slots, 30 with 16-byte slots
#[test]
fn a_board_takes_40_slaves_or_30() {
    assert_eq!(sim("sim:?slaves=drive*40").slaves.len(), 40);
    assert_eq!(sim("sim:?slot=16&slaves=drive*30").slaves.len(), 30);
    refused("sim:?slaves=", &["key `slaves`", "a network without one is slaves=none"]);
    assert_eq!(sim("sim:?slaves=none").slaves.len(), 0);
    refused("sim:?slaves=drive*2:limits@-1..1", &["the number stands last", "drive:limits@-1..1*2"]);
    refused("sim:?slaves=drive*40,drive", &["`slaves`", "`drive*40,drive`", "at most 40 slaves"]);
    refused("sim:?slot=16&slaves=drive*31", &["`slaves`", "`drive*31`", "at most 30 slaves with slot=16"]);
    refused("sim:?slaves=drive*31&slot=16", &["`slaves`", "`drive*31`", "at most 30 slaves with slot=16"]);
}

#[test]
fn unknown_kinds_of_slaves_are_refused_by_name() {
    let why = "kind `dp4cl` is unknown; did you mean `dp3cl`? allowed: drive, io, step, dp3cl, hsp, hsp2";
    refused("sim:?slaves=drive*3,dp4cl*2", &["`slaves`", why]);
    refused("sim:?slaves=servo", &["`servo`", "unknown", "allowed: drive"]);
    for list in ["drive*0", "drive*", "drive*41", "drive*+1", "drive*99999999999999999999", "drive*1*2"] {
        refused(&format!("sim:?slaves={list}"), &["`slaves`", list, "from 1 to 40"]);
    }
    for list in [",", "drive,", "Drive", "drive ,drive", "none,drive"] {
        refused(&format!("sim:?slaves={list}"), &["`slaves`", list, "unknown"]);
    }
}

/// An error names key and value, and says what is allowed.
#[test]
fn an_error_names_key_value_and_what_is_allowed() {
    refused("", &["no scheme", "sim:", "usb:"]);
    refused("sim", &["`sim`", "no scheme"]);
    refused("xyz:?a=b", &["`xyz`", "sim:, usb:, spi:, tcp:", "e.g. sim:?slaves=drive*2"]);
    refused("can:eth1", &["unknown scheme `can`", "sim:, usb:, spi:, tcp:", "e.g. sim:?slaves=drive*2"]);
    refused("Sim:", &["`Sim`", "did you mean `sim`?"]);
    refused("spy:", &["`spy`", "did you mean `spi`?"]);
    refused("sim:left", &["`left`", "sim:?key=value"]);
    refused("sim://left?slot=12", &["`//left`"]);
    refused("sim:?slavs=drive", &["`slavs`", "`drive`", "did you mean `slaves`?", "lock_memory"]);
    refused("sim:?timeout=4", &["`timeout`", "`4`", "write_timeout_ms"]);
    refused("sim:?fault.drop=3", &["`fault.drop`", "`3`", "from 0 to 1"]);
    refused("usb:?fault.drop=3", &["`fault.drop`", "`3`", "from 0 to 1"]);
    refused("sim:?lock_memory", &["`lock_memory`", "no, yes"]);
    refused("sim:?nonsense", &["`nonsense`", "slaves, machine, slot"]);
    refused("sim:?queue=1&&slot=12", &["``"]);
    refused("sim:?queue=1&", &["``"]);
    refused("sim:?=1", &["key ``", "`1`"]);
    refused("sim:?queue=1&queue=2", &["`queue`", "twice", "`1`", "`2`"]);
    refused("sim:?queue=1&q%75eue=1", &["`queue`", "twice"]);
    refused("sim:?record=%FF", &["`%FF`", "UTF-8"]);
    refused("sim:?record=", &["`record`", "path of a file"]);
    refused("sim:?record=a%00b", &["`record`", "path of a file"]);
    refused("sim:?slot=14", &["`slot`", "`14`", "12, 16"]);
    refused("sim:?clock=fake", &["`clock`", "`fake`", "real, virtual"]);
    refused("sim:?fw=1.6", &["`fw`", "`1.6`", "1.7, 1.5"]);
    refused("sim:?test=2", &["`test`", "`2`", "0, 1"]);
    refused("sim:?lock_memory=maybe", &["`lock_memory`", "`maybe`", "no, yes"]);
    refused("sim:?name=", &["`name`", "1 to 64 letters"]);
    refused("sim:?name=a/b", &["`name`", "`a/b`"]);
    refused(&format!("sim:?name={}", "n".repeat(65)), &["`name`"]);
    for (key, below, above, range) in [
        ("host_us", None, "1000001", "from 0 to 1000000"),
        ("state_timeout_ms", Some("0"), "3600001", "from 1 to 3600000"),
        ("sdo_timeout_ms", Some("0"), "3600001", "from 1 to 3600000"),
        ("priority", Some("0"), "100", "from 1 to 99"),
        ("catch_up_ms", None, "86400001", "from 0 to 86400000"),
        ("queue", Some("0"), "65537", "from 1 to 65536"),
        ("read_timeout_ms", None, "86400001", "from 0 to 86400000"),
        ("write_timeout_ms", None, "86400001", "from 0 to 86400000"),
    ] {
        for value in [above, "-1", "+1", "1.5", "1s", "", " 1", "18446744073709551616"].into_iter().chain(below) {
            refused(&format!("sim:?{key}={value}"), &[&format!("`{key}`"), &format!("`{value}`"), range]);
        }
    }
}

#[test]
fn a_link_error_says_what_the_uri_error_says() {
    let error = refused("sim:?slot=14", &[]);
    let words = error.to_string();
    assert_eq!(LinkError::from(error).to_string(), words);
}

#[test]
fn the_options_of_sim_are_not_read_from_another_scheme() {
    let error = SimOptions::from_uri(&uri("usb:?queue=4")).expect_err("usb");
    assert_eq!(error, UriError::OtherScheme { uri: "usb:?queue=4".into(), expected: Scheme::Sim });
    assert_eq!(common("usb:").slot, None);
    assert_eq!(common("usb:?slot=16").slot, Some(SlotSize::Bytes16));
}

/// A key of that scheme with a valid value.
fn any_key(scheme: Scheme) -> impl Strategy<Value = (&'static str, String)> {
    let rows: Vec<_> = KEYS.iter().filter(|key| key.schemes.contains(&scheme)).collect();
    (proptest::sample::select(rows), any::<u64>(), "\\PC{1,12}").prop_map(|(row, number, text)| {
        let candidates = [text, number.to_string(), (number % 40).to_string(), row.example.to_owned()];
        let from = (number % 4) as usize;
        let fits = candidates[from..].iter().find_map(|value| row.syntax.normal(value).ok());
        (row.name, fits.expect("at least the example fits"))
    })
}

/// A link of any scheme: scheme, path, keys, each once.
fn any_link() -> impl Strategy<Value = (Scheme, String, Vec<(&'static str, String)>)> {
    proptest::sample::select(&Scheme::ALL[..]).prop_flat_map(|scheme| {
        let path = if scheme.path().is_some() { "\\PC{0,12}" } else { "" };
        let keys = proptest::collection::vec(any_key(scheme), 0..8).prop_map(|mut keys| {
            let mut seen = Vec::new();
            keys.retain(|(key, _)| {
                !seen.contains(key) && {
                    seen.push(*key);
                    true
                }
            });
            if keys.iter().any(|(key, _)| *key == "machine") {
                keys.retain(|(key, _)| *key != "slaves");
            }
            if keys.contains(&("clock", "virtual".to_owned())) {
                keys.retain(|(key, _)| !["rate", "priority", "cpu", "lock_memory"].contains(key));
            }
            keys
        });
        (Just(scheme), path, keys)
    })
}

fn encode(text: &str) -> String {
    text.bytes().map(|byte| format!("%{byte:02x}")).collect()
}

proptest! {
    #[test]
    fn a_uri_prints_as_what_parses_to_the_same((scheme, path, keys) in any_link()) {
        let query: Vec<_> = keys.iter().map(|(key, value)| format!("{}={}", encode(key), encode(value))).collect();
        let text = format!("{scheme}:{}?{}", encode(&path), query.join("&"));
        let parsed = LinkUri::parse(&text).map_err(|error| TestCaseError::fail(format!("{text}: {error}")))?;
        prop_assert_eq!((parsed.scheme(), parsed.path()), (scheme, path.as_str()));
        for (key, value) in &keys {
            prop_assert_eq!(parsed.value(key), Some(value.as_str()));
        }

        let normal = parsed.to_string();
        let again = LinkUri::parse(&normal).map_err(|error| TestCaseError::fail(format!("{normal}: {error}")))?;
        prop_assert_eq!(&again, &parsed);
        prop_assert_eq!(again.to_string(), normal);
        prop_assert!(CommonOptions::from_uri(&parsed).is_ok());
        prop_assert_eq!(ChipOptions::from_uri(&parsed).is_ok(), scheme.has_chip());
        prop_assert_eq!(BoardOptions::from_uri(&parsed).is_ok(), [Scheme::Sim, Scheme::Nic].contains(&scheme) || scheme.has_chip());
        // There is no file of that name.
        let has_machine = parsed.value("machine").is_some();
        prop_assert_eq!(SimOptions::from_uri(&parsed).is_ok(), scheme.is_model() && !has_machine);
    }

    #[test]
    fn no_text_makes_the_parser_panic(text in any::<String>(), rest in ".{0,40}") {
        let _ = LinkUri::parse(&text);
        for scheme in Scheme::ALL {
            for text in [format!("{scheme}:{rest}"), format!("{scheme}:?{rest}"), format!("{scheme}:?slaves={rest}")] {
                if let Ok(parsed) = LinkUri::parse(&text) {
                    prop_assert_eq!(LinkUri::parse(&parsed.to_string()), Ok(parsed));
                }
            }
        }
    }
}

/// Invisible characters in a value are shown by their code.
#[test]
fn control_characters_in_a_value_are_shown_by_their_codes() {
    for (uri, shown) in
        [("sim:?slaves=%00", "`\\u{0}`"), ("sim:?slot=1%0A2", "`1\\u{a}2`"), ("sim:?rate=%E2%80%8B1", "`\\u{200b}1`")]
    {
        let said = LinkUri::parse(uri).unwrap_err().to_string();
        assert!(said.contains(shown) && !said.contains(char::is_control), "{said}");
    }
}

/// The help and the page of simulated slaves describe each kind, and no other.
#[test]
fn the_help_and_the_page_of_slaves_have_each_kind() {
    let help = help();
    for kind in SlaveModel::ALL {
        let line = help.lines().find(|line| line.starts_with(&format!("  {:<6} {}", kind.name(), kind.meaning())));
        let parts = line.and_then(|line| line.rsplit('[').next()).unwrap_or_else(|| panic!("{}: {help}", kind.name()));
        assert_eq!(parts.contains("limits"), kind.axes() > 0, "{parts}");
        assert_eq!(parts.contains("stops"), kind.motors() > 0, "{parts}");
        assert!(parts.contains("objects"), "{parts}");
    }
    let page = std::fs::read_to_string(support::root().join("docs/SLAVES.md")).expect("the page");
    let rows = page.lines().skip_while(|line| !line.starts_with("| kind | what it is |")).skip(2);
    let cells = rows.map_while(|row| row.strip_prefix("| ")?.split(" | ").next());
    let mut said: Vec<&str> = cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).collect();
    let mut kinds = SlaveModel::ALL.map(SlaveModel::name);
    said.sort_unstable();
    kinds.sort_unstable();
    assert_eq!(said, kinds);
}

/// A program's declaration is a list of the same form: upper case, blanks and the position of the number do not matter,
/// `none` is an unused slave. The reader of the list interprets the text after a kind.
#[test]
fn a_list_of_declared_slaves_has_the_same_form() {
    use SlaveKind::{Drive, Hsp, Io, None, Step};
    let kinds = |list| parse_declared(list, |kind, _| Ok(kind));
    assert_eq!(kinds("drive*2, IO ,dp3cl,hsp2,step:csp,none"), Ok(vec![Drive, Drive, Io, Step, Hsp, Step, None]));
    for (list, parts) in [("drive:csv*2", "csv"), ("drive * 2 : csv", "csv"), ("drive:a:b", "a b"), ("drive", "")] {
        let read = parse_declared(list, |_, parts| Ok(parts.join(" "))).expect(list);
        assert!(read.iter().all(|read| read == parts), "{list}: {read:?}");
    }
    let count = "allowed: a whole number from 1 to 40 after the *";
    for (list, why) in [
        ("", "kind `` is unknown; allowed: drive, io, step, dp3cl, hsp, hsp2, none".to_owned()),
        ("io,drve", "kind `drve` is unknown; did you mean `drive`? allowed: drive, io".to_owned()),
        ("io*0", format!("in `io*0`, {count}")),
        ("io*+2", format!("in `io*+2`, {count}")),
        ("io*1*2", format!("in `io*1*2`, {count}")),
        ("drive*40,io*2", "42 slaves, allowed: at most 40 slaves".to_owned()),
    ] {
        let said = kinds(list).expect_err(list);
        assert!(said.contains(&why), "{list}: {said}");
    }
    let wrong = parse_declared("io,drive:x*2", |_, parts| if parts.is_empty() { Ok(()) } else { Err("no".to_owned()) });
    assert_eq!(wrong, Err("in `drive:x*2`, no".to_owned()));
    for kind in [Drive, Io, Hsp, Step, None] {
        assert_eq!(kinds(word(kind)), Ok(vec![kind]));
    }
}

/// For a misspelt kind the nearest one is suggested.
#[test]
fn a_misspelt_kind_of_slave_gets_a_suggestion() {
    for (list, near) in [("Drive*2", "did you mean `drive`?"), ("drve", "did you mean `drive`?"), ("hps2", "`hsp2`?")] {
        let said = LinkUri::parse(&format!("sim:?slaves={list}")).unwrap_err().to_string();
        assert!(said.contains(near), "{said}");
    }
}
