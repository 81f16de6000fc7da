//! The package `ecmsk` for Python: its own tests, its examples, its types, its wheel and its plugin for pytest.
//!
//! `tests/unit/` has the tests that are written in Python. They run with the library of the standard installation alone, on
//! the module as it was just built. What needs packages of PyPI is in `needs_pip`.
#![cfg(target_os = "linux")]

mod package;
mod page;
mod wheel;

/// What Python alone can run.
mod needs_python {
    use crate::package::{python, succeed};
    use crate::page;

    /// Boards, axes, objects, streams, waits and recordings, with kind and with unkind input.
    #[test]
    fn its_own_tests_pass() {
        succeed(python().args(["-m", "unittest", "discover", "--start-directory", "python/tests/unit"]));
    }

    /// The front page of the package has the first program of docs/PYTHON.md.
    #[test]
    fn the_front_page_has_the_first_program() {
        let text = |file: &str| std::fs::read_to_string(support::root().join(file)).expect("a page");
        let front = text("python/README.md");
        let program = front.split("```").nth(1).expect("a program");
        assert!(program.starts_with("python\n# first.py\n") && text("docs/PYTHON.md").contains(program));
    }

    /// docs/PYTHON.md: its programs print what it shows.
    #[test]
    fn the_page_tells_the_truth() {
        assert_eq!(page::check(python, |command| command.starts_with("python3 ")), 3);
    }
}

/// The examples whose types are checked; the one of another master needs that.
const EXAMPLES: [&str; 6] =
    ["homing", "inputs_outputs", "read_recording", "test_three_languages", "test_two_axes", "two_axes"];

fn examples() -> [String; 6] {
    EXAMPLES.map(|name| format!("examples/python/{name}.py"))
}

/// A program with a wrong type: a state as text.
fn wrong() -> String {
    let wrong = support::out_dir().join("wrong.py");
    std::fs::write(&wrong, "import ecmsk\necmsk.sim().set_state(\"OP\")\n").expect("a file in the target folder");
    wrong.display().to_string()
}

/// What needs packages of PyPI.
mod needs_pip {
    use std::process::Command;

    use support::{out_dir, root, run};

    use crate::package::succeed;
    use crate::wheel::{installed, path_of, python};
    use crate::{examples, page, wrong};

    const PYTEST: [&str; 5] = ["pytest", "iniconfig", "packaging", "pluggy", "pygments"];
    const MYPY: [&str; 6] = ["mypy", "ast_serialize", "librt", "mypy_extensions", "pathspec", "typing_extensions"];

    /// The wheel is installed without a network and runs the examples. One of them reads the recording of another.
    #[test]
    fn the_wheel_runs_the_examples() {
        let example = |name: &str| {
            let mut python = python(&["numpy"]);
            python.arg(root().join("examples/python").join(name));
            python
        };
        let recording = out_dir().join("two_axes.pcapng");
        let _ = std::fs::remove_file(&recording);
        let link = format!("sim:?slaves=drive*2&clock=virtual&record={}", recording.display());
        let said = succeed(example("two_axes.py").arg(link));
        assert_eq!(said, "on\naxis 1: 90.0 degrees\naxis 2: -45.0 degrees\n2000 frames, 0 underruns, 0 losses\n");
        let said = succeed(example("read_recording.py").arg(&recording));
        assert!(said.contains("nothing went wrong\naxis 1: following error up to "), "{said}");
        let said = succeed(&mut example("homing.py"));
        assert!(said.contains("home found: at ") && said.contains("homing of slave 1 failed: "), "{said}");
        let said = succeed(&mut example("inputs_outputs.py"));
        assert_eq!(said.lines().count(), 17, "{said}");
        let ended = run(example("two_axes.py").arg("sim:?slaves=lathe"));
        assert_eq!(ended.status.code(), Some(1));
        assert!(ended.stderr.contains("lathe") && !ended.stderr.contains("Traceback"), "{}", ended.stderr);
    }

    /// The plugin is found by its entry, and runs a program on the machine by `ecmsk exec`.
    #[test]
    fn pytest_runs_programs_on_the_machine() {
        let mut pytest = python(&PYTEST);
        pytest.args(["-m", "pytest", "-q", "-p", "no:cacheprovider", "examples/python/test_two_axes.py"]);
        let said = succeed(&mut pytest);
        assert!(said.contains("2 passed"), "{said}");
        assert_eq!(page::check(|| python(&PYTEST), |command| command.starts_with("pytest ")), 1);
    }

    /// Also needs the compilers of C++ and C#.
    mod needs_cxx {
        mod needs_mono {
            use std::collections::BTreeMap;
            use std::fs;
            use std::path::Path;

            use ecmsk::recording::{Recorded, Recording};
            use support::{Language, compile, dotnet, out_dir, root};

            use crate::needs_pip::PYTEST;
            use crate::package::succeed;
            use crate::wheel::python;

            /// The frames of each recording below a folder, with their times, by the name of the test.
            fn recorded(folder: &Path) -> BTreeMap<String, Vec<Recorded>> {
                let of_test = |test: fs::DirEntry| {
                    let file = test.path().join("run-1.pcapng");
                    // Beside each folder pytest makes a link to the newest one of its name.
                    let is_one = file.exists() && !test.path().is_symlink();
                    let recording = is_one.then(|| Recording::open(&file).expect("a recording"))?;
                    let frames = recording.map(|frame| frame.expect("it is whole")).collect();
                    Some((test.file_name().to_string_lossy().into_owned(), frames))
                };
                let tests = fs::read_dir(folder).expect("a folder of each test");
                tests.map(|entry| entry.expect("readable")).filter_map(of_test).collect()
            }

            /// One test is right for programs in C++, C# and Python, also with faults on the way, and each run has the same
            /// frames at the same times.
            #[test]
            fn programs_in_three_languages_are_tested_alike() {
                let cpp = compile(&root().join("examples/cpp/two_axes_12b.cpp"), Language::Cpp("c++11")).exe;
                let csharp = dotnet::example("TwoAxes12B").exe;
                let run = |name: &str| {
                    let folder = out_dir().join(name);
                    let mut pytest = python(&PYTEST);
                    pytest.env("TWO_AXES_CPP", &cpp).env("TWO_AXES_CSHARP", &csharp).arg("-m").arg("pytest");
                    pytest.args(["-q", "-p", "no:cacheprovider", "--basetemp"]).arg(&folder);
                    let said = succeed(pytest.arg("examples/python/test_three_languages.py"));
                    assert!(said.contains("9 passed in "), "{said}");
                    recorded(&folder)
                };
                let (first, second) = (run("languages-1"), run("languages-2"));
                assert_eq!(first.len(), 9);
                assert!(first.values().all(|frames| frames.len() > 1000), "each has moved");
                assert!(first == second, "two runs have not the same frames");
            }
        }
    }

    /// Its own tests once more as they are installed, with NumPy.
    #[test]
    fn its_own_tests_pass_with_numpy() {
        succeed(python(&["numpy"]).args(["-m", "unittest", "discover", "--start-directory", "python/tests/unit"]));
    }

    /// The types of the package, and those with which the examples use the installed one. A wrong use is found.
    #[test]
    fn types_are_right() {
        let mypy = |files: &[&str]| {
            let mut mypy = Command::new("python3");
            mypy.current_dir(root()).env("PYTHONPATH", path_of(&[&MYPY[..], &PYTEST].concat()));
            mypy.args(["-m", "mypy", "--config-file=python/pyproject.toml", "--python-executable"]).arg(installed());
            mypy.arg("--cache-dir").arg(out_dir().join("mypy")).args(files);
            mypy
        };
        succeed(&mut mypy(&examples().each_ref().map(String::as_str)));
        succeed(&mut mypy(&["--package=ecmsk"]));
        let ended = run(&mut mypy(&[&wrong()]));
        assert_eq!(ended.status.code(), Some(1), "{}", ended.stdout);
        assert!(ended.stdout.contains("incompatible type \"str\"; expected \"MasterState\""), "{}", ended.stdout);
    }
}

/// What needs Pyright, the checker of types that editors have.
mod needs_pyright {
    use std::process::Command;

    use support::{root, run};

    use crate::package::succeed;
    use crate::wheel::{fetched, installed, path_of};
    use crate::{examples, wrong};

    /// The examples use the installed package with the right types, as Pyright sees them, and so does the package itself. A
    /// wrong use is found.
    #[test]
    fn types_are_right_for_an_editor() {
        let pyright = |files: &[String]| {
            let mut pyright = Command::new("node");
            pyright.current_dir(root()).env("PYTHONPATH", path_of(&["iniconfig", "numpy", "pluggy", "pytest"]));
            pyright.arg(fetched("pyright").join("index.js")).arg("--pythonpath").arg(installed()).args(files);
            pyright
        };
        succeed(&mut pyright(&examples()));
        succeed(&mut pyright(&["python/ecmsk".to_owned()]));
        let ended = run(&mut pyright(&[wrong()]));
        assert_eq!(ended.status.code(), Some(1), "{}", ended.stdout);
        assert!(ended.stdout.contains("cannot be assigned to parameter \"state\" of type \"MasterState\""));
    }
}
