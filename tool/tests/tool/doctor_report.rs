//! `ecmsk doctor --report`: what is packed, what is said to be missing, and that no secret is in it.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::Path;

use crate::common::{Ran, ecmsk, run};

/// The files of a report, with their contents.
fn files(report: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut archive = tar::Archive::new(std::fs::File::open(report).expect("the report"));
    let file = |entry: std::io::Result<tar::Entry<'_, std::fs::File>>| {
        let mut entry = entry.expect("a file");
        let mut content = Vec::new();
        entry.read_to_end(&mut content).expect("its content");
        (entry.path().expect("a name").display().to_string(), content)
    };
    archive.entries().expect("a tar").map(file).collect()
}

fn text<'a>(files: &'a BTreeMap<String, Vec<u8>>, name: &str) -> &'a str {
    std::str::from_utf8(&files[&format!("report/{name}")]).expect("text")
}

/// TOOL-203 A report has the machine, the findings, the network with EEPROMs and counters, the machine file, the newest
/// frames, and the list of them, which is also printed. No secret of the environment, of the configuration or of a link is in it.
#[test]
fn a_report_has_what_a_support_asks_for_and_no_secret() {
    const SECRETS: [&str; 4] =
        ["environment-3b1f90aa7c", "config-file-9d2e01bb44", "machine-file-77aa01cc2e", "password-in-a-link-1f"];
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("tcp.secret"), format!("{}\n", SECRETS[1])).expect("a file");
    std::fs::write(
        path("machine.toml"),
        format!(
            "format = 1\nlink = \"tcp://host?secret_file=tcp.secret\"\n# password: {}\n[axes]\nX = {{ slave = 1, unit = \
             \"mm\", per = 0.001 }}\n",
            SECRETS[2]
        ),
    )
    .expect("a file");
    let flight = path("flight");
    let recorded = format!("sim:?slaves=drive*2,io&clock=virtual&flight={}", flight.display());
    let moved = run(["move", "1=100", "--up", "--link", &recorded]);
    assert_eq!(moved.code, Some(0), "{moved:?}");

    let report = |arguments: &[&str], variables: &[(&str, &str)]| {
        let mut command = ecmsk([&["doctor", "--quick", "--report", "press.tar"][..], arguments].concat());
        command.current_dir(folder.path()).envs(variables.iter().copied());
        Ran::from(command.output().expect("the tool starts"))
    };
    let flight = flight.to_str().expect("UTF-8");
    let ran = report(&["--link", "sim:?slaves=drive*2,io", "--flight", flight], &[("ECMSK_TCP_SECRET", SECRETS[0])]);
    let packed = files(&path("press.tar"));
    let list = text(&packed, "CONTENTS.txt");
    assert!(ran.out.ends_with(&format!("press.tar\n{list}")), "{ran:?}");
    for name in packed.keys().filter_map(|name| name.strip_prefix("report/")).filter(|name| *name != "CONTENTS.txt") {
        assert!(list.contains(&format!("  {name}: ")), "{name} of {list}");
    }
    assert!(text(&packed, "versions.txt").starts_with(&format!("ecmsk {}\n", env!("CARGO_PKG_VERSION"))));
    assert!(text(&packed, "doctor.txt").contains("sim:?slaves=drive*2,io, from --link"));
    assert!(text(&packed, "machine.toml").contains("X = { slave = 1"));
    assert_eq!(text(&packed, "network.json").lines().count(), 3);
    assert!(text(&packed, "network.txt").contains("+- 3  io: "));
    for slave in 1..=3 {
        let eeprom =
            run(["bus", "sii", "read", &slave.to_string(), "--link", "sim:?slaves=drive*2,io", "--json"]).json();
        let bytes = &packed[&format!("report/eeprom/slave-{slave:02}.bin")];
        let hex: String = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
        assert_eq!(eeprom["bytes"].as_str().map(|text| text.replace(' ', "").to_uppercase()), Some(hex));
    }
    let frames: Vec<&String> = packed.keys().filter(|name| name.starts_with("report/flight/")).collect();
    assert_eq!(frames.len(), 1, "{list}");
    std::fs::write(path("packed.ecmrec"), &packed[frames[0]]).expect("a file");
    let shown = run(["dump", path("packed.ecmrec").to_str().expect("UTF-8")]);
    assert_eq!(shown.code, Some(0), "{shown:?}");
    assert!(!list.contains("Not in it"), "{list}");

    // Frames that carry the machine file are packed without its secret, or not at all.
    let carrying = path("carrying");
    let recorded = format!("sim:?slaves=drive&clock=virtual&axes=machine.toml&flight={}", carrying.display());
    let mut moves = ecmsk(["move", "1=100", "--up", "--machine", "none", "--link", &recorded]);
    let moved = Ran::from(moves.current_dir(folder.path()).output().expect("the tool starts"));
    assert_eq!(moved.code, Some(0), "{moved:?}");
    report(&["--flight", carrying.to_str().expect("UTF-8")], &[]);
    let packed = files(&path("press.tar"));
    let list = text(&packed, "CONTENTS.txt");
    assert!(packed.keys().all(|name| !name.starts_with("report/flight/")), "{list}");
    assert!(list.contains(".ecmrec: the machine file or the link in it has a secret; take it out"), "{list}");
    let is_in = |bytes: &[u8]| bytes.windows(SECRETS[2].len()).any(|part| part == SECRETS[2].as_bytes());
    assert!(!packed.values().any(|content| is_in(content)));

    // The link of a configuration has a secret in its file, and one that somebody wrote into it.
    let link = format!("tcp://me:{}@localhost:1?secret_file=tcp.secret", SECRETS[3]);
    let ran = report(&[], &[("ECMSK_LINK", &*link), ("ECMSK_TCP_SECRET", SECRETS[0])]);
    let packed = files(&path("press.tar"));
    let list = text(&packed, "CONTENTS.txt");
    for reason in ["the network: no link was named", "frames: no flight recorder was named"] {
        assert!(list.contains(reason), "{list}");
    }
    for secret in SECRETS {
        let is_in = |bytes: &[u8]| bytes.windows(secret.len()).any(|part| part == secret.as_bytes());
        assert!(packed.values().all(|content| !is_in(content)), "{secret}");
    }
    assert!(text(&packed, "machine.toml").contains("# password: [removed]"));
    assert!(!ran.out.contains(SECRETS[0]) && !ran.out.contains(SECRETS[1]), "{ran:?}");
}

/// A network behind a board, a card that is not there, and a folder that is no flight recorder's are said to be missing; the rest
/// is packed. A file that cannot be written, or that is no report by its name, is an error.
#[test]
fn what_cannot_be_had_is_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("press.tar");
    let name = file.to_str().expect("UTF-8");
    let report = |arguments: &[&str]| {
        let mut command = ecmsk([&["doctor", "--quick", "--report", name][..], arguments].concat());
        Ran::from(command.current_dir(folder.path()).output().expect("the tool starts"))
    };
    let list = |arguments: &[&str]| {
        report(arguments);
        text(&files(&file), "CONTENTS.txt").to_owned()
    };
    let nowhere = list(&["--link", "tcp://localhost:1", "--flight", "nowhere"]);
    for reason in
        ["the network: behind a board (tcp:)", "frames of nowhere: ", "there is no machine.toml in this folder"]
    {
        assert!(nowhere.contains(reason), "{nowhere}");
    }
    assert!(list(&["--link", "sim:?slaves=none"]).contains("the network: "));
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 1, "nothing is left beside it");
    let elsewhere = folder.path().join("no-folder").join("press.tar");
    let failed = run(["doctor", "--quick", "--report", elsewhere.to_str().expect("UTF-8")]);
    assert!(failed.code == Some(1) && failed.err.contains("cannot write "), "{failed:?}");
    // A report replaces one, and no other file.
    let other = folder.path().join("backup.tar");
    std::fs::write(&other, "a backup").expect("a file");
    let other = other.to_str().expect("UTF-8");
    let failed = run(["doctor", "--quick", "--report", other]);
    failed.expect_failure(1, &["backup.tar is there already and is no report"], "replace it with --overwrite");
    assert_eq!(std::fs::read_to_string(other).expect("a file"), "a backup");
    run(["doctor", "--report", "machine.toml"]).expect_misuse(&["a name that ends with .tar"]);
}
