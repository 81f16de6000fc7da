//! `ecmsk params`: parameters of drives are kept, compared and put back, on networks of simulated slaves in virtual time.

use crate::common::board::{file, text};
use crate::common::{json_lines, run};

/// The link of the tests: a stepper, a drive, and an IO slave.
const NETWORK: &str = "sim:?slaves=dp3cl,drive,io";

/// A backup of slave 1, a stepper, in a file of this name.
fn backup(name: &str) -> String {
    let path = file(name);
    let _ = std::fs::remove_file(&path);
    let path = path.display().to_string();
    let ran = run(["params", "backup", "1", "--link", NETWORK, "--output", &path]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    path
}

/// `params backup` writes the identity of the drive and its parameters, but nothing that commands the drive or stores
/// something. The file is equal to the drive, and is not overwritten.
#[test]
fn a_backup_is_equal_to_its_drive() {
    let path = backup("params_equal");
    let kept = std::fs::read_to_string(&path).expect("it is written");
    assert!(kept.starts_with("# parameters of slave 1 of sim:?slaves=dp3cl,drive,io, read 20"), "{kept}");
    assert!(kept.contains("\n# vendor 0x") && kept.contains("\n0x6098:0 i8 rw "), "{kept}");
    for not_kept in ["\n0x6040:", "\n0x607A:", "\n0x6041:", "\n0x1010:", "\n0x1018:"] {
        assert!(!kept.contains(not_kept), "{not_kept}");
    }
    let ran = run(["params", "diff", &path, "1", "--link", NETWORK]);
    assert_eq!((ran.code, ran.out.as_str()), (Some(0), ""), "{ran:?}");
    assert!(ran.err.contains("0 parameters differ, "), "{ran:?}");
    let ran = run(["params", "backup", "1", "--link", NETWORK, "--output", &path]);
    assert!(ran.code == Some(1) && ran.err.contains("--overwrite"), "{ran:?}");
    let ran = run(["params", "backup", "1", "--link", NETWORK, "--output", &path, "--overwrite", "--json"]);
    assert_eq!(
        json_lines(&ran.out)[0]["parameters"],
        kept.lines().filter(|line| !line.starts_with('#')).count(),
        "{ran:?}"
    );
}

/// `params restore` shows the parameters that differ, writes them only with --yes, and reads them back.
#[test]
fn what_differs_is_put_back() {
    let path = backup("params_changed");
    let kept = std::fs::read_to_string(&path).expect("it is written");
    let line = kept.lines().find(|line| line.starts_with("0x6099:1 ")).expect("a speed of homing");
    let changed = kept.replace(line, "0x6099:1 u32 rw 1234 the speed");
    let changed = text("params_changed_2", &changed);
    let ran = run(["params", "diff", &changed, "1", "--link", NETWORK]);
    assert!(
        ran.code == Some(1) && ran.out.starts_with("0x6099:1    file 1234 | drive ") && ran.out.lines().count() == 1,
        "{ran:?}"
    );
    let ran = run(["params", "diff", &path, &changed, "--json"]);
    assert_eq!((ran.code, &json_lines(&ran.out)[0]["other"]), (Some(1), &"D2040000".into()), "{ran:?}");
    let ran = run(["params", "restore", &changed, "1", "--link", NETWORK]);
    assert!(ran.code == Some(1) && ran.err.contains("--yes") && ran.out.contains(" -> 1234"), "{ran:?}");
    let ran = run(["params", "restore", &changed, "1", "--link", NETWORK, "--yes", "--json"]);
    assert_eq!((ran.code, &json_lines(&ran.out)[0]["result"]), (Some(0), &"written".into()), "{ran:?}");
    let refused = text("params_refused", &kept.replace(line, &format!("{line}\n0x2FFE:0 u16 rw 1")));
    let ran = run(["params", "restore", &refused, "1", "--link", NETWORK, "--yes"]);
    assert!(ran.code == Some(1) && ran.out.starts_with("0x2FFE:0 ") && ran.out.contains("refused"), "{ran:?}");
}

/// The parameters of one product are not written to another one, unless it is forced.
#[test]
fn another_product_is_refused() {
    let path = backup("params_other");
    let ran = run(["params", "restore", &path, "2", "--link", NETWORK, "--yes"]);
    assert!(ran.code == Some(1) && ran.err.contains("nothing was written: the file is of vendor"), "{ran:?}");
    let ran = run(["params", "restore", &path, "2", "--link", NETWORK, "--force"]);
    assert!(ran.err.contains("the file is of vendor") && ran.err.contains("say --yes"), "{ran:?}");
    let nobody = text("params_nobody", "0x6098:0 i8 rw 1\n");
    let ran = run(["params", "restore", &nobody, "1", "--link", NETWORK, "--yes"]);
    assert!(ran.code == Some(1) && ran.err.contains("does not say of which device"), "{ran:?}");
}

/// `params backup all` writes a file for each slave of a network; a slave without a mailbox is an error that names it.
#[test]
fn all_slaves_are_kept() {
    let folder = file("params_all");
    let place = folder.display().to_string();
    let all = |link: &str| run(["params", "backup", "all", "--link", link, "--output", &place, "--overwrite"]);
    let ran = all("sim:?slaves=dp3cl,drive*2");
    assert_eq!((ran.code, ran.out.lines().count()), (Some(0), 3), "{ran:?}");
    let names = ["slave1.params", "slave2.params", "slave3.params"];
    assert!(names.iter().all(|name| folder.join(name).exists()));
    let ran = run(["params", "backup", "all", "--link", NETWORK]);
    assert!(ran.code == Some(2) && ran.err.contains("--output"), "{ran:?}");
}

/// Wrong files, slaves and links are errors that say what to do; a comparison that was not made ends with 2.
#[test]
fn what_is_wrong_is_said() {
    let broken = text("params_broken", "0x2000:0 u99 rw 1\n");
    let empty = text("params_empty", "# nothing\n");
    let missing = file("params_missing").display().to_string();
    let good = backup("params_good");
    let esi = text("params_other.xml", &crate::objects::ESI.replace("#x00001234", "#x00001235"));
    for (words, code, said) in [
        (&["diff", &broken, "1", "--link", NETWORK][..], 2, "line 1"),
        (&["diff", &empty, "1", "--link", NETWORK], 2, "no object"),
        (&["diff", &missing, "1", "--link", NETWORK], 2, "params_missing"),
        (&["diff", &good, "9", "--link", NETWORK], 2, "no slave 9"),
        (&["diff", &good, "41", "--link", NETWORK], 2, "1 to 40"),
        (&["restore", &good, "4", "--link", NETWORK, "--yes"], 1, "no slave 4"),
        (&["backup", "1"], 2, "--link"),
        (&["backup", "1", "--link", NETWORK, "--objects", &missing], 1, "params_missing"),
        (&["backup", "1", "--link", NETWORK, "--objects", &esi], 1, "it has no device `0x30305070`; allowed: SV2"),
        (&["backup", "1", "--link", NETWORK, "--output", "/nowhere/a"], 1, "/nowhere/a"),
    ] {
        let ran = run([&["params"], words].concat());
        assert!(ran.code == Some(code) && ran.err.contains(said), "{words:?}: {ran:?}");
    }
}

/// A backup is a file of objects for a simulated drive: a drive that is made of it has the same parameters.
#[test]
fn a_backup_makes_a_simulated_drive() {
    let objects = text(
        "params_makers",
        "0x2000:0 u16 rw 7 Gain\n0x2001:0 text rw \"ab\\x00\" Name\n0x2002:0 any rw \"\\x01\\x02\\x03\" Curve\n",
    );
    let of_maker = format!("sim:?slaves=drive:objects@{objects}");
    let path = file("params_simulated").display().to_string();
    let ran = run(["params", "backup", "1", "--link", &of_maker, "--output", &path, "--overwrite"]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let again = format!("sim:?slaves=drive:objects@{path}");
    let ran = run(["params", "diff", &path, "1", "--link", &again]);
    assert_eq!((ran.code, ran.out.as_str()), (Some(0), ""), "{ran:?}");
    let ran = run(["params", "diff", &path, "1", "--link", "sim:?slaves=drive"]);
    assert!(
        ran.code == Some(1) && ran.out.lines().count() == 3 && ran.out.contains("0x2000:0    file 7 | drive ("),
        "{ran:?}"
    );
}

/// What a drive refuses is named with its reason, and the rest is written.
#[test]
fn what_a_drive_refuses_is_named() {
    let path = backup("params_abort");
    let kept = std::fs::read_to_string(&path).expect("it is written");
    let line = |object: &str| kept.lines().find(|line| line.starts_with(object)).expect("it is kept").to_owned();
    let changed =
        kept.replace(&line("0x6099:1 "), "0x6099:1 u32 rw 1234").replace(&line("0x6099:2 "), "0x6099:2 u32 rw 99");
    let changed = text("params_abort_2", &changed);
    let script = text("params_abort.ecmscript", "at 0s sdo-abort 1 0x6099:1 0x08000021\n");
    let link = format!("{NETWORK}&script={script}");
    let ran = run(["params", "restore", &changed, "1", "--link", &link, "--yes"]);
    assert_eq!((ran.code, ran.out.lines().count()), (Some(1), 2), "{ran:?}");
    assert!(ran.out.contains(": refused, 0x08000021") && ran.err.contains("written and read back: 1 of 2"), "{ran:?}");
    // An object that cannot be read is not kept, and named.
    let path = file("params_abort_3").display().to_string();
    let ran = run(["params", "backup", "1", "--link", &link, "--output", &path, "--overwrite", "--json"]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert_eq!(json_lines(&ran.out)[0]["left_out"][0]["why"], "not_read", "{ran:?}");
    assert!(ran.err.contains("not kept, because the drive does not let them be read: 0x08000021"), "{ran:?}");
    let ran = run(["params", "diff", &path, "1", "--link", NETWORK]);
    assert!(ran.code == Some(0) && ran.err.contains("the file does not have 1 parameter"), "{ran:?}");
}
