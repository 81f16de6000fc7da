//! `docs/GUIDE-CPP.md`: its programs are those of `examples/guide/`. Each is run on the link above it, and must print
//! the output below it. The commands of its `console` blocks print what it shows.
#![cfg(target_os = "linux")]

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use support::{Language, root};

/// The mark above a program, with its file and its link.
const HEAD: &str = "<!-- program: ";

/// The parts of the page that a test writes: from the head of a program to the end of its output.
fn programs(page: &str) -> Vec<(String, String)> {
    let heads = page.lines().filter_map(|line| line.strip_prefix(HEAD)?.strip_suffix(" -->"));
    heads.map(|head| head.split_once(" on ").expect("a program on a link")).map(|(a, b)| (a.into(), b.into())).collect()
}

/// The part of the page for a program, from its present source and output.
fn written(name: &str, link: &str, printed: &str) -> String {
    let source =
        fs::read_to_string(root().join("examples/guide").join(name).with_extension("cpp")).expect("the program");
    let mut text = format!("{HEAD}{name} on {link} -->\n");
    // Writing to a String does not fail.
    let _ = write!(
        text,
        "[`{name}.cpp`](../examples/guide/{name}.cpp) on `{link}`:\n\n```cpp\n{source}```\n\nprints\n\n```text\n{printed}```\n"
    );
    text
}

/// The page with the present programs and outputs.
fn again(page: &str, printed: impl Fn(&str, &str) -> String) -> String {
    let mut parts = page.split(HEAD);
    let mut again = parts.next().unwrap_or_default().to_owned();
    for (part, (name, link)) in parts.zip(programs(page)) {
        // The text after the output, or, for a new program, after the line with its name.
        let rest = match part.split_once("```text\n") {
            Some((_, output)) => output.split_once("```\n").expect("an output ends").1,
            None => part.split_once('\n').expect("a line ends").1,
        };
        again += &written(&name, &link, &printed(&name, &link));
        again += rest;
    }
    again
}

mod needs_cxx {
    use super::*;

    /// The guide's programs are the files beside it, compile without a warning as C++98 (the one with threads as C++11),
    /// succeed on the link above them, and print the output below them.
    #[test]
    fn the_programs_of_the_guide_compile_and_print_what_it_shows() {
        let page = root().join("docs/GUIDE-CPP.md");
        let text = fs::read_to_string(&page).expect("the page");
        support::kept(&page, &again(&text, printed));
    }

    /// The same with the slaves behind an ECM-XF: they print the same.
    #[test]
    fn the_programs_of_the_guide_print_the_same_behind_a_chip() {
        let text = fs::read_to_string(root().join("docs/GUIDE-CPP.md")).expect("the page");
        let behind_chip = |name: &str, link: &str| printed(name, &link.replace("sim:", "xf-sim:"));
        assert!(again(&text, behind_chip).replace("xf-sim:", "sim:") == text, "another output than the page's");
    }

    /// A program of Visual Studio compiles and runs by the commands of the page.
    #[test]
    fn a_program_of_visual_studio_runs_as_the_guide_shows() {
        let page = fs::read_to_string(root().join("docs/GUIDE-CPP.md")).expect("the page");
        let page = page.replace("/usr/share/ecmsk/msvc", &root().join("share/msvc").display().to_string());
        let folder = tempfile::tempdir().expect("a folder");
        assert!(crate::prefix::shows(&page, folder.path()) >= 5, "some commands are in no block `console`");
    }

    /// The output of a program on that link.
    fn printed(name: &str, link: &str) -> String {
        let source = root().join("examples/guide").join(name).with_extension("cpp");
        let standard = if name.ends_with("threads") { "c++11" } else { "c++98" };
        let program = support::compile(&source, Language::Cpp(standard));
        // Paths of the page start at the root of the repository.
        let here = link.replace("script=examples", &format!("script={}/examples", root().display()));
        let ended = program.run(&format!("{here}&clock=virtual"), [""; 0]);
        assert_eq!(ended.stderr, "", "{name} on {link}");
        ended.success()
    }
}

/// Every program of the folder is in the guide, once, and there are ten at least.
#[test]
fn no_program_is_left_out() {
    let page = fs::read_to_string(root().join("docs/GUIDE-CPP.md")).expect("the page");
    let shown: Vec<String> = programs(&page).into_iter().map(|(name, _)| name).collect();
    let files =
        fs::read_dir(root().join("examples/guide")).expect("the folder").map(|entry| entry.expect("readable").path());
    let is_program = |file: &Path| file.extension().is_some_and(|extension| extension == "cpp");
    let mut names: Vec<String> = files
        .filter(|file| is_program(file))
        .map(|file| file.file_stem().expect("a name").to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(shown, names);
    assert!(names.len() >= 10);
}
