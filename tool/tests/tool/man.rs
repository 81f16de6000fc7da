//! `ecmsk man`: manual pages of all verbs.

use std::fs;

use crate::common::run;

/// The names of the verbs that a help text of the tool lists.
fn verbs(help: &str) -> Vec<String> {
    let list = help.split("\nCommands:\n").nth(1).unwrap_or_default();
    list.lines()
        .take_while(|line| !line.is_empty())
        .filter_map(|line| line.split_whitespace().next())
        .map(str::to_owned)
        .collect()
}

/// `ecmsk man` makes a page for the tool and one for each verb, with its options, and its examples line by line.
#[test]
fn a_page_for_each_verb() {
    let folder = tempfile::tempdir().expect("a folder");
    let pages = folder.path().join("share/man/man1");
    let path = pages.to_str().expect("UTF-8");
    assert_eq!(run(["man", "--out", path]).expect_quiet(), format!("{path}\n"));
    let verbs: Vec<_> = verbs(&run(["--help"]).expect_quiet()).into_iter().filter(|verb| verb != "help").collect();
    assert!(verbs.len() >= 8, "{verbs:?}");
    for verb in &verbs {
        let page = fs::read_to_string(pages.join(format!("ecmsk-{verb}.1"))).expect("a page");
        assert!(
            page.starts_with(&format!(".ie \\n(.g .ds Aq \\(aq\n.el .ds Aq '\n.TH ecmsk-{verb} 1")),
            "{verb}: {page}"
        );
        assert_eq!(page, run(["man", verb]).expect_quiet(), "{verb}");
    }
    let tool = fs::read_to_string(pages.join("ecmsk.1")).expect("a page");
    assert_eq!(tool, run(["man"]).expect_quiet());
    for verb in &verbs {
        assert!(tool.contains(&format!("ecmsk\\-{verb}(1)")), "{verb} is missing in {tool}");
    }
    assert!(tool.contains(".SH \"EXIT CODES\"\n") || tool.contains(".SH EXIT CODES\n.nf\n"), "{tool}");
    assert!(fs::exists(pages.join("ecmsk-link-help.1")).expect("a folder"), "verbs of verbs too");
    let dump = run(["man", "dump"]).expect_quiet();
    for line in ["\\-\\-slots", "ecmsk dump run.pcapng \\-\\-slots 0,3\\-5,sdo | less\n", ".SH EXAMPLES\n.nf\n"] {
        assert!(dump.contains(line), "`{line}` is missing in {dump}");
    }
}

/// An unknown verb, and a folder that cannot be written, are errors with the next step.
#[test]
fn an_unknown_verb_or_an_unwritable_folder_is_an_error() {
    run(["man", "frobnicate"]).expect_failure(1, &["no verb `frobnicate`"], "`ecmsk --help` lists");
    run(["man", "link", "frobnicate"]).expect_failure(1, &["no verb `link frobnicate`"], "`ecmsk --help` lists");
    run(["man", "--out", "/dev/null/x"]).expect_failure(1, &["cannot write /dev/null/x"], "with --out");
    run(["man", "dump", "--out", "x"]).expect_misuse(&["--out"]);
}

/// In a manual page only requests that the formatters know begin with a dot; all other lines that begin with one are escaped.
#[test]
fn pages_are_well_formed() {
    const REQUESTS: [&str; 13] =
        [".ie", ".el", ".TH", ".SH", ".SS", ".TP", ".RS", ".RE", ".nf", ".fi", ".br", ".PP", ".IP"];
    let folder = tempfile::tempdir().expect("a folder");
    run(["man", "--out", folder.path().to_str().expect("UTF-8")]).expect_quiet();
    for page in fs::read_dir(folder.path()).expect("a folder") {
        let page = page.expect("a page").path();
        let text = fs::read_to_string(&page).expect("UTF-8");
        for line in text.lines().filter(|line| line.starts_with(['.', '\''])) {
            let request = line.split_whitespace().next().unwrap_or_default();
            assert!(REQUESTS.contains(&request), "{}: {line}", page.display());
        }
        let count = |request: &str| text.lines().filter(|line| line.split(' ').next() == Some(request)).count();
        assert_eq!((count(".nf"), count(".RS")), (count(".fi"), count(".RE")), "{}", page.display());
    }
}
