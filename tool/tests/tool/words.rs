//! Options that mean the same in every verb: the slot size, slots, the recording; and the amount of progress.

use std::fs;

use crate::common::run;
use support::recorded::Program;

const LINK: &str = "sim:?slaves=drive&clock=virtual";

/// In every verb `--slot-size` is the slot size and `--slots` selects slots.
#[test]
fn slot_size_and_slots_mean_the_same_in_every_verb() {
    let program = Program { short: true, ..Program::default() }.record();
    let file = program.path();
    // The program of this recording ran behind a chip and waited for OP. So `migrate` judges that it runs unchanged, and
    // succeeds.
    let behind_chip = Program { scheme: "xf-sim", short: true, ..Program::default() }.record();
    for arguments in [
        &["dump", file, "--slot-size", "12"][..],
        &["dump", file, "--slots", "12"],
        &["compare", file, file, "--slot-size", "12"],
        &["replay", file, "--slot-size", "12"],
        &["migrate", behind_chip.path(), "--allow-incomplete", "--slot-size", "12"],
        &["monitor", "--recording", file, "--once", "--slot-size", "12"],
        &["info", "--link", LINK, "--slot-size", "12"],
    ] {
        assert!(!run(arguments).expect_quiet().is_empty(), "{arguments:?}");
    }
}

/// `--slot` is accepted, with a hint at its present name, if only one of its two meanings is possible; otherwise the error
/// names the present options for both.
#[test]
fn the_former_option_slot_is_accepted_where_it_is_unambiguous() {
    let program = Program { short: true, ..Program::default() }.record();
    let file = program.path();
    for (arguments, new, hint) in [
        (&["dump", file, "--slot", "0,3-5"][..], &["dump", file, "--slots", "0,3-5"][..], "--slots"),
        (&["dump", file, "--slot", "12,13"], &["dump", file, "--slots", "12,13"], "--slots"),
        (&["compare", file, file, "--slot", "12"], &["compare", file, file, "--slot-size", "12"], "--slot-size 12"),
        (&["replay", file, "--slot", "12"], &["replay", file, "--slot-size", "12"], "--slot-size 12"),
        (
            &["monitor", "--recording", file, "--once", "--slot", "12"],
            &["monitor", "--recording", file, "--once", "--slot-size", "12"],
            "--slot-size 12",
        ),
        (&["info", "--link", LINK, "--slot", "12"], &["info", "--link", LINK, "--slot-size", "12"], "--slot-size 12"),
    ] {
        let (old, new) = (run(arguments), run(new));
        assert_eq!((old.code, &old.out), (new.code, &new.out), "{arguments:?}");
        let said = format!("note: --slot is understood here as {hint}; ");
        assert!(old.err.starts_with(&said) && old.err.lines().count() == 1, "{arguments:?}: {}", old.err);
    }
    for size in ["12", "16"] {
        let ran = run(["dump", file, "--slot", size]);
        ran.expect_misuse(&[&format!("--slots {size}"), &format!("--slot-size {size}")]);
    }
    run(["info", "--link", LINK, "--slot", "12", "--slot-size", "12"]).expect_misuse(&["--slot", "--slot-size"]);
    run(["monitor", "--recording", file, "--once", "--slot", "3"]).expect_misuse(&["allowed: 12, 16"]);
}

/// Verbs that talk to a board record it as `exec` does, scripts and the shell too; an existing recording is replaced
/// only on request, and another file never.
#[test]
fn every_verb_records() {
    let folder = tempfile::tempdir().expect("a folder");
    let script = folder.path().join("script");
    fs::write(&script, "move 1=100\n").expect("a file");
    let script = script.to_str().expect("UTF-8");
    for (n, verb) in
        [&["move", "1=100"][..], &["home", "1"], &["servo", "on", "1"], &["run", script], &["info"]].iter().enumerate()
    {
        let file = folder.path().join(format!("{n}.pcapng"));
        let file = file.to_str().expect("UTF-8");
        let with = |more: &[&str]| run([*verb, &["--link", LINK, "--up", "--record", file], more].concat());
        let verb_is_up = verb[0] != "info";
        let arguments = [*verb, &["--link", LINK, "--record", file][..]].concat();
        let ran = if verb_is_up { with(&[]) } else { run(arguments) };
        assert_eq!(ran.code, Some(0), "{verb:?}: {}", ran.err);
        assert!(run(["dump", file]).expect_quiet().contains("response"), "{verb:?}");
        let before = fs::read(file).expect("a recording");
        let ran = with(&[]);
        ran.expect_failure(
            1,
            &["cannot record to", &format!("{n}.pcapng"), "is there already", "--overwrite"],
            "with --record",
        );
        assert_eq!(fs::read(file).expect("a recording"), before);
        assert_eq!(with(&["--overwrite"]).code, Some(0), "{verb:?}");
        assert!(!fs::exists(format!("{file}.1")).expect("a folder"));
        fs::write(file, "a letter").expect("a file");
        with(&["--overwrite"]).expect_failure(1, &["no recording of ecmsk"], "with --record");
        assert_eq!(fs::read(file).expect("a letter"), b"a letter");
    }
    run(["move", "1=1", "--link", LINK, "--overwrite"]).expect_misuse(&["--record"]);
    run(["move", "1=1", "--link", "sim:?record=a", "--record", "b"]).expect_failure(
        1,
        &["`record` is given twice"],
        "link help",
    );
}

/// Without a terminal, a minute of virtual time gives some twelve lines of progress, ten minutes would give fifteen,
/// the same in every run.
#[test]
fn progress_on_a_virtual_clock_has_few_lines() {
    let ran = run(["move", "1=6400", "--velocity", "100", "--up", "--link", LINK]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let lines: Vec<_> = ran.err.lines().filter(|line| line.starts_with("progress: ")).collect();
    assert!((11..=13).contains(&lines.len()), "{lines:?}");
    let again = run(["move", "1=6400", "--velocity", "100", "--up", "--link", LINK]);
    assert_eq!((again.err, again.out), (ran.err, ran.out));
}
