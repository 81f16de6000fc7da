//! The groups of tests: each is a test program of its own. Lists say which are quick and which run on the machine's clock, and
//! which tests only `--all` runs. Each group is in exactly one list; a test below fails if one is missing.

use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::{hint, thread};

use crate::command;
use crate::error::Error;
use crate::side_by_side::{self, Named};
use crate::test::Site;

/// Groups that take seconds and need no program besides the test program. `cargo xtask ci --fast` runs them.
const QUICK: &[&str] =
    &["engine", "ethercat", "fieldbus", "link", "link_log", "recordings", "rooms", "sk", "slave", "xf"];

/// Groups that take longer, or need a compiler or other programs.
const OTHERS: &[&str] =
    &["bus", "capi", "counters", "ecm", "ecmsk_header", "esi", "invariants", "master", "migration", "python", "xf_api"];

/// Groups that depend on the machine's clock: runners, processes, sockets, network cards, masters of other projects. Two
/// groups run at a time, since they mostly wait. Nothing else runs beside them, because they depend on the clock; the tests
/// of a group run one after the other. Their assertions also hold on a machine that is late. The longest groups come first.
const REAL_CLOCK: &[&str] = &[
    "bus_on_card",
    "failing_calls",
    "failing_calls_on_card",
    "gadget",
    "nic",
    "ring",
    "runners",
    "spi",
    "tcp",
    "tool_on_card",
    "usbip",
    "xf_port",
];

/// Groups on the machine's clock that need a master of another project. Only `--all` runs them, because that master is fetched
/// and built first.
const OTHER_MASTERS: &[&str] = &["ethercrab", "pysoem"];

/// The group in which only some tests depend on the machine's clock, and (next constant) the parts of the names of those tests.
const TOOL: &str = "tool";
const TOOL_ON_REAL_CLOCK: &[&str] = &[
    "card_picture::",
    "jog::",
    "monitor_tcp::",
    "page::",
    "serve_",
    "stalled::",
    "stop::",
    "stop_verb::",
    "tcp_",
    "terminal::",
];

/// The group on the machine's clock that `ci --fast` runs too, since it takes only seconds. It tests the runners of the board:
/// the thread, or the calls, that let its time pass.
const QUICK_ON_REAL_CLOCK: &str = "runners";

/// Parts of the names of tests and modules that only `--all` runs. They repeat other tests with other hardware, other
/// languages or another implementation to compare with, or cause an event at hundreds of times, one after the other. No
/// part may occur in the name of any other test.
const LONG: &[&str] = &[
    "a_crowd_locks_nobody_out",
    "all_that_a_program_sees_is_the_same",
    "further_programs_in_cpp_run_on_a_card",
    "needs_axe::",
    "needs_chromium::",
    "needs_dotnet_core::",
    "needs_node::",
    "needs_pip::",
    "needs_pyright::",
    "needs_pysoem::",
    "needs_tshark::",
    "needs_valgrind::",
    "page::every_command_of_the_pages_succeeds_on_the_real_clock",
    "programs_in_cpp_overcome_alarms_on_a_network_card",
    "programs_in_csharp_run_on_a_network_card",
    "python_programs_run_on_a_network_card",
    "rust_programs_run_on_a_network_card",
    "xf_bus::an_enabled_drive_stays_enabled",
    "xf_doubts::",
];

/// Whether only `--all` runs the tests in modules that are named `module`.
pub fn is_left_to_all(module: &str) -> bool {
    LONG.iter().any(|name| name.strip_suffix("::") == Some(module))
}

/// Runs the unit tests, and all groups that do not depend on the machine's clock.
pub fn units_and_groups(site: &Site) -> Result<(), Error> {
    run(site, &[QUICK, OTHERS], &["--lib", "--bins"], &[])?;
    let others: Vec<String> = TOOL_ON_REAL_CLOCK.iter().map(|name| format!("--skip={name}")).collect();
    run(site, &[&[TOOL]], &[], &others.iter().map(String::as_str).collect::<Vec<_>>())
}

/// Runs the unit tests and the quick groups.
pub fn quick(site: &Site) -> Result<(), Error> {
    run(site, &[QUICK], &["--lib", "--bins"], &[])?;
    run(site, &[&[QUICK_ON_REAL_CLOCK]], &[], &["--test-threads=1"])
}

/// The groups that [`quick`] does not run.
pub fn not_quick() -> impl Iterator<Item = &'static str> {
    OTHERS
        .iter()
        .chain(REAL_CLOCK)
        .chain(OTHER_MASTERS)
        .chain([&TOOL])
        .copied()
        .filter(|group| *group != QUICK_ON_REAL_CLOCK)
}

/// Runs the groups that depend on the machine's clock.
pub fn real_clock(site: &Site) -> Result<(), Error> {
    let others = if site.all { OTHER_MASTERS } else { &[] };
    let groups = [&[TOOL][..], others, REAL_CLOCK].concat();
    // All groups are built first. Otherwise a group would wait while cargo builds the one beside it.
    command::run(tests(site, &groups, &[]).arg("--no-run"))?;
    let named = groups.into_iter().map(|group| {
        let chosen = if group == TOOL { TOOL_ON_REAL_CLOCK } else { &[] };
        let options = [&["--test-threads=1"][..], chosen].concat();
        let mut command = tests(site, &[group], &[]);
        choose(&mut command, site, &options);
        Named { name: group.to_owned(), command }
    });
    side_by_side::run(named.collect(), &site.project.target.join("xtask/groups"))
}

/// Runs the examples in the documentation comments (doctests).
pub fn documentation(site: &Site) -> Result<(), Error> {
    command::run(site.project.cargo().args(["test", "--workspace", "--doc", "--", "--quiet"]))
}

/// Runs these groups with one cargo command for the whole workspace: all of them then use the library with the same features,
/// and it is compiled once.
fn run(site: &Site, groups: &[&[&str]], targets: &[&str], options: &[&str]) -> Result<(), Error> {
    let mut cargo = tests(site, &groups.concat(), targets);
    choose(&mut cargo, site, options);
    command::run(&mut cargo)
}

/// The cargo command that builds and runs these groups and `targets` (such as `--lib`).
fn tests(site: &Site, groups: &[&str], targets: &[&str]) -> Command {
    let mut cargo = site.project.cargo();
    cargo.args(["test", "--workspace"]).args(targets);
    cargo.args(groups.iter().map(|group| format!("--test={group}")));
    cargo
}

/// Adds the arguments after `--` with which the test programs select tests: `options`, and `--skip` for tests whose
/// programs are missing and, without `--all`, for those in [`LONG`].
fn choose(cargo: &mut Command, site: &Site, options: &[&str]) {
    cargo.args(["--", "--quiet"]).args(options).args(site.skipped_modules());
    if !site.all {
        cargo.args(LONG.iter().map(|name| format!("--skip={name}")));
    }
}

/// Runs the groups on the machine's clock `times` times. With `is_busy`, a busy loop runs on each processor in every second
/// run, so that both a free and a busy machine are tried.
pub fn repeat_real_clock(site: &Site, times: u32, is_busy: bool) -> Result<(), Error> {
    for n in 1..=times {
        let is_busy = is_busy && n.is_multiple_of(2);
        println!("run {n} of {times}{}", if is_busy { ", beside a busy loop on each processor" } else { "" });
        if is_busy { beside_busy_loops(|| real_clock(site)) } else { real_clock(site) }?;
    }
    Ok(())
}

fn beside_busy_loops<T>(call: impl FnOnce() -> T) -> T {
    let is_over = AtomicBool::new(false);
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(2, usize::from) {
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    hint::spin_loop();
                }
            });
        }
        let result = call();
        is_over.store(true, Ordering::Relaxed);
        result
    })
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::{Path, PathBuf};

    use super::*;

    /// The folders that contain groups of tests.
    const FOLDERS: [&str; 5] = ["tests", "capi/tests", "python/tests", "tests/masters/tests", "tool/tests"];
    /// Groups that `cargo test` does not run here: `cargo xtask` starts them in a guest system or under Wine.
    const ELSEWHERE: [&str; 2] = ["rig", "windows"];
    /// Texts in a source from which a test of this file concludes that the source uses the machine's clock.
    const SIGNS: [&str; 4] = ["clock=real", "virtual_time: false", "Instant::now", "thread::sleep"];
    /// Files of groups outside [`REAL_CLOCK`] that contain one of [`SIGNS`] nevertheless. Their tests also pass on a
    /// machine that is late.
    const WITH_A_SIGN: [&str; 23] = [
        "tests/capi/behaviour.rs",
        "tests/capi/cpp_examples.rs",
        "tests/capi/log.rs",
        "tests/capi/vanish.rs",
        "tests/ecm/example.rs",
        "tests/ecm/targets.rs",
        "tests/ecm/threads.rs",
        "tests/engine/random_networks.rs",
        "tests/invariants/day.rs",
        "tests/link/flight.rs",
        "tests/link/rate.rs",
        "tests/link/record.rs",
        "tests/link/uri.rs",
        "tool/tests/tool/fault.rs",
        "tool/tests/tool/jog.rs",
        "tool/tests/tool/monitor_terminal.rs",
        "tool/tests/tool/page.rs",
        "tool/tests/tool/serve_service.rs",
        "tool/tests/tool/serve_web.rs",
        "tool/tests/tool/serve_web_control.rs",
        "tool/tests/tool/serve_web_control/needs_chromium.rs",
        "tool/tests/tool/stop.rs",
        "tool/tests/tool/terminal.rs",
    ];

    fn root() -> &'static Path {
        Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a folder of the project")
    }

    /// The groups by their names, each with its file or folder.
    fn groups() -> Vec<(String, PathBuf)> {
        let paths = FOLDERS.iter().flat_map(|folder| entries(&root().join(folder)));
        let is_group = |path: &PathBuf| path.join("main.rs").exists() || path.extension().is_some_and(|of| of == "rs");
        let name = |path: &PathBuf| path.file_stem().expect("a name").to_string_lossy().into_owned();
        paths.filter(is_group).map(|path| (name(&path), path)).collect()
    }

    fn entries(folder: &Path) -> Vec<PathBuf> {
        folder.read_dir().expect("a folder").map(|entry| entry.expect("an entry").path()).collect()
    }

    /// The Rust sources below a folder; for a file, the file itself.
    fn sources(path: &Path) -> Vec<PathBuf> {
        if path.is_dir() {
            return entries(path).iter().flat_map(|path| sources(path)).collect();
        }
        path.extension().filter(|of| *of == "rs").map(|_| path.to_path_buf()).into_iter().collect()
    }

    /// Each group exists, has a unique name, and is in exactly one list.
    #[test]
    fn each_group_stands_in_one_list() {
        let mut there: Vec<String> = groups().into_iter().map(|(name, _)| name).collect();
        let lists = [QUICK, OTHERS, REAL_CLOCK, OTHER_MASTERS, &[TOOL], &ELSEWHERE];
        let mut listed: Vec<&str> = lists.iter().copied().flatten().copied().collect();
        there.sort();
        listed.sort();
        assert_eq!(there, listed);
        assert!(REAL_CLOCK.contains(&QUICK_ON_REAL_CLOCK));
    }

    /// A group whose sources use the machine's clock is in [`REAL_CLOCK`], or the file that uses it is listed in
    /// [`WITH_A_SIGN`] because its tests also pass on a machine that is late.
    #[test]
    fn what_looks_at_the_clock_runs_alone() {
        let mut found = Vec::new();
        for (name, path) in groups() {
            if [REAL_CLOCK, OTHER_MASTERS, &ELSEWHERE].iter().any(|groups| groups.contains(&&*name)) {
                continue;
            }
            for source in sources(&path) {
                let text = fs::read_to_string(&source).expect("a source");
                if SIGNS.iter().any(|sign| text.contains(sign)) {
                    let source = source.strip_prefix(root()).expect("it is of the project");
                    found.push(source.to_string_lossy().replace('\\', "/"));
                }
            }
        }
        found.sort();
        assert_eq!(found, WITH_A_SIGN);
    }

    /// Each entry of [`LONG`] is the name of an existing test, or of a module of tests.
    #[test]
    fn long_tests_are_there() {
        let sources: Vec<PathBuf> = groups().iter().flat_map(|(_, path)| sources(path)).collect();
        let texts: Vec<String> = sources.iter().map(|path| fs::read_to_string(path).expect("a source")).collect();
        for name in LONG {
            let name = name.trim_end_matches("::").rsplit("::").next().expect("a name");
            let words = [format!("mod {name} {{"), format!("mod {name};"), format!("fn {name}(")];
            assert!(texts.iter().any(|text| words.iter().any(|word| text.contains(word))), "{name}");
        }
    }

    #[test]
    fn a_call_runs_beside_busy_loops() {
        assert_eq!(beside_busy_loops(|| 7), 7);
    }
}
