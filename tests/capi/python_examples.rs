//! The programs of `examples/python/ctypes/` on a simulated board: in virtual time they print the same as those in C++ and C.
#![cfg(target_os = "linux")]

use std::fs;

use support::examples::run_python;
use support::root;

const DRIVES: &str = "sim:?slaves=drive*2&clock=virtual";
/// Every program, and the snapshot that it shares with another one.
const PROGRAMS: [(&str, &str); 3] = [("homing", "homing"), ("inputs_outputs", "io"), ("two_axes", "two_axes_12b")];

fn prints_the_same(name: &str, links: &[&str]) {
    let (_, snapshot) = PROGRAMS.into_iter().find(|(program, _)| *program == name).expect("a program of the table");
    for link in links {
        let ended = run_python(name, link);
        assert_eq!(ended.stderr, "", "{name} on {link}");
        support::snapshot(snapshot, &ended.success());
    }
}

mod needs_python {
    use super::*;

    /// Two axes on a square, on both firmwares; and with the drives behind an ECM-XF.
    #[test]
    fn two_axes() {
        prints_the_same("two_axes", &[DRIVES, &format!("{DRIVES}&fw=1.5"), &DRIVES.replace("sim:", "xf-sim:")]);
    }

    /// SK-7.24 Homing of two axes, and one that fails, on both firmwares.
    #[test]
    fn homing() {
        prints_the_same("homing", &[DRIVES, &format!("{DRIVES}&fw=1.5")]);
    }

    /// SK-3.17 An IO slave and the board's own IO.
    #[test]
    fn inputs_and_outputs() {
        let link = "sim:?slaves=io&clock=virtual&script=examples/scripts/local_inputs.ecmscript";
        prints_the_same("inputs_outputs", &[link]);
    }

    /// Errors are printed in the library's words, with code 1; axes are off then.
    #[test]
    fn errors_have_words() {
        let none = run_python("two_axes", "sim:?slaves=none&clock=virtual");
        assert_eq!(none.status.code(), Some(1));
        assert!(none.stderr.contains("ECMSK_LINK: no board at `sim:"), "{}", none.stderr);
        let wrong = run_python("two_axes", "sim:?slaves=lathe");
        assert!(wrong.stderr.contains("lathe"), "{}", wrong.stderr);
        let file = support::out_dir().join("alarm.pcapng");
        let keys = format!("script=examples/scripts/alarm.ecmscript&record={}", file.display());
        let alarm = run_python("two_axes", &format!("{DRIVES}&{keys}"));
        assert_eq!((alarm.status.code(), alarm.stderr.as_str()), (Some(1), "failed: an axis does not arrive\n"));
        support::both_axes_are_off_in_preop(&file);
    }

    /// Every program of the folder that uses the library is one of these.
    #[test]
    fn no_program_is_left_out() {
        let entries = fs::read_dir(root().join("examples/python/ctypes")).expect("the folder");
        let files = entries.map(|entry| entry.expect("readable").path());
        let mut names: Vec<String> = files
            .filter(|file| file.extension().is_some_and(|extension| extension == "py"))
            .map(|file| file.file_stem().expect("a name").to_string_lossy().into_owned())
            .filter(|name| name != "ecm")
            .collect();
        names.sort();
        assert_eq!(names, PROGRAMS.map(|(name, _)| name));
    }
}
