//! `cargo xtask test`: runs every part in order, each with its time, up to the first one that fails. Parts that this
//! machine cannot run are skipped and listed at the end.

use std::time::{Duration, Instant};

use crate::ahead::Ahead;
use crate::error::Error;
use crate::needs::{
    AXE, CHROMIUM, CLIPPY, CXX, DOTNET_CORE, IP, MAKE, MCS, MINGW_X64, MONO, NETWORK_NAMESPACE, NODE, NPM, Need, PIP,
    PKG_CONFIG, PYSOEM, PYTHON, RUSTFMT, SET_USER_ID, TSHARK, UNZIP, VALGRIND, ZIP,
};
use crate::project::Project;
use crate::spend::Spend;
use crate::windows::{self, Width};
use crate::{command, dist, features, groups, needs, python_packages, rig, stage, tidy};

#[derive(clap::Args)]
pub struct Arguments {
    /// Run everything: also lints, combinations of features, documentation and the other checks of the tree, long tests,
    /// the wire tests in a guest system, Windows programs under Wine, and packages
    #[arg(long)]
    all: bool,
    /// Begin with the part of this number, if an earlier run has passed the parts before it
    #[arg(long, value_name = "PART", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..))]
    from: u8,
    /// Run only the groups of tests on the machine's clock
    #[arg(long, conflicts_with_all = ["all", "alone"])]
    real_clock: bool,
    /// How often the groups of tests on the machine's clock are run
    #[arg(long, requires = "real_clock", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    times: u32,
    /// In every second run of the groups, run a busy loop on each processor, too, so that tests are late
    #[arg(long, requires = "real_clock")]
    busy: bool,
    /// Run only the wire tests: the tool and a real kernel's USB, SPI and GPIO code, in a guest system (QEMU)
    #[arg(long, conflicts_with = "all", group = "alone")]
    rig: bool,
    /// Run only the tests of the DLLs for Windows: programs of both widths under Wine
    #[arg(long, conflicts_with = "all", group = "alone")]
    windows: bool,
    /// Run only wire tests, or tests for Windows, whose names contain one of these words
    #[arg(requires = "alone", value_name = "NAME")]
    names: Vec<String>,
}

impl Arguments {
    /// The arguments of `cargo xtask test --all`.
    pub const ALL: Self = Self {
        all: true,
        from: 1,
        real_clock: false,
        times: 1,
        busy: false,
        rig: false,
        windows: false,
        names: Vec::new(),
    };
}

/// A part of `cargo xtask test`, such as lints or the packages.
#[derive(Clone, Copy)]
pub struct Part {
    pub name: &'static str,
    /// The programs without which the part is skipped.
    pub needs: &'static [Need],
    /// Whether the part may have tests whose names contain this text.
    takes: fn(&str) -> bool,
    run: fn(&Site) -> Result<(), Error>,
}

/// A part that may have tests of any name.
pub const fn part(name: &'static str, needs: &'static [Need], run: fn(&Site) -> Result<(), Error>) -> Part {
    Part { name, needs, takes: |_| true, run }
}

impl Part {
    /// Those of `names` that select tests of this part; `None` if names were given and none selects one.
    fn asked_for(&self, names: &[String]) -> Option<Vec<String>> {
        let own: Vec<String> = names.iter().filter(|name| (self.takes)(name)).cloned().collect();
        (names.is_empty() || !own.is_empty()).then_some(own)
    }
}

/// What a part needs to know: the project, which programs are missing, and which tests to run.
pub struct Site<'a> {
    pub project: &'a Project,
    /// The programs and rights that some part needs and this machine does not have.
    missing: &'a [Need],
    /// The names of the tests to run, for a part that can choose; all if empty.
    names: Vec<String>,
    /// Whether long tests are run, too.
    pub all: bool,
}

/// The parts that `cargo xtask test` runs without options, short enough for a person to wait for them.
pub const PARTS: &[Part] = &[
    part("rules and features", &[], rules),
    part("tests of units and groups", &[], groups::units_and_groups),
    part("examples in the documentation", &[], groups::documentation),
    part("tests on the machine's clock, three groups at a time", &[], groups::real_clock),
];

/// The parts that `--all` runs besides [`PARTS`].
pub const PARTS_OF_ALL: &[Part] = &[
    part("format", &[RUSTFMT], format),
    part("lints", &[CLIPPY], lints),
    part("combinations of features", &[], |site| tidy::combinations(site.project)),
    part("documentation", &[], documentation),
    part("fuzz targets compile", &[CXX], fuzz_targets),
    part("firmware for a microcontroller", tidy::FIRMWARE_NEEDS, |site| {
        tidy::firmware(site.project, &tidy::MICROCONTROLLERS[..1])
    }),
    part("library, headers and tool in place", &[], staged),
    tidy::PARTS[0],
    tidy::PARTS[3],
    tidy::PARTS[4],
    part("wire tests in a guest", rig::NEEDS, |site| rig::run(site.project, &site.names)),
    WINDOWS[0],
    WINDOWS[1],
    WINDOWS[2],
    WINDOWS[3],
    WINDOWS[4],
    part("packages", dist::TEST_NEEDS, |site| dist::test(site.project)),
];

/// The disk space and the time that `--all` takes, for the user.
const ALL: Spend = Spend { disk_mb: 7_000, time: "much time: each part says how long it took" };

/// What `--all` leaves out because it takes long, each with the command that runs it.
const LEFT_OUT_OF_ALL: &[&str] = &[
    "the packages as they are shipped, made twice, to the same bytes, since everything is compiled twice for that, \
     lintian's view of the static library, and the packages for arm64 and armhf: cargo xtask dist --check",
    "the files for Windows as they are shipped, since optimising them takes long: cargo xtask test --windows",
    "licences, sources and known weaknesses of dependencies, since the program for it (cargo-deny) takes minutes to \
     build, and only a change of Cargo.lock can change the result: cargo xtask tidy",
];

/// The parts that `--windows` runs.
const WINDOWS: [Part; 5] = [
    Part {
        name: "64-bit Windows programs under Wine",
        needs: windows::NEEDS_X64,
        takes: |name| windows::takes(Width::X64, name),
        run: |site| windows::test(site.project, Width::X64, &site.names),
    },
    Part {
        name: "32-bit Windows programs under Wine",
        needs: windows::NEEDS_X86,
        takes: |name| windows::takes(Width::X86, name),
        run: |site| windows::test(site.project, Width::X86, &site.names),
    },
    Part {
        name: "64-bit .NET programs on .NET Core for Windows under Wine",
        needs: windows::NEEDS_DOTNET_X64,
        takes: |name| windows::dotnet::takes(Width::X64, name),
        run: |site| windows::dotnet::test(site.project, Width::X64, &site.names),
    },
    Part {
        name: "32-bit .NET programs on .NET Core for Windows under Wine",
        needs: windows::NEEDS_DOTNET_X86,
        takes: |name| windows::dotnet::takes(Width::X86, name),
        run: |site| windows::dotnet::test(site.project, Width::X86, &site.names),
    },
    Part {
        name: "Windows programs on USB, in a guest",
        needs: windows::NEEDS_USB,
        takes: windows::usb::takes,
        run: |site| windows::usb::test(site.project, &site.names),
    },
];

/// The name of a module for tests that need other programs. If one of them is missing, the test programs are told to skip
/// the module (`--skip`).
#[derive(Clone, Copy)]
pub struct Gate {
    pub module: &'static str,
    pub needs: &'static [Need],
}

pub const GATES: &[Gate] = &[
    Gate { module: "needs_axe", needs: &[CHROMIUM, NPM, AXE] },
    Gate { module: "needs_chromium", needs: &[CHROMIUM] },
    Gate { module: "needs_cxx", needs: &[CXX, MAKE, PKG_CONFIG] },
    Gate { module: "needs_mono", needs: &[MCS, MONO, ZIP, UNZIP] },
    Gate { module: "needs_dotnet_core", needs: &[MCS, PYTHON, PIP, DOTNET_CORE, ZIP, UNZIP] },
    Gate { module: "needs_network_namespace", needs: &[IP, NETWORK_NAMESPACE] },
    Gate { module: "needs_node", needs: &[NODE] },
    Gate { module: "needs_pip", needs: python_packages::TESTS },
    Gate { module: "needs_pyright", needs: python_packages::PYRIGHT },
    Gate { module: "needs_pysoem", needs: &[PYTHON, PIP, PYSOEM, IP, NETWORK_NAMESPACE] },
    Gate { module: "needs_python", needs: &[PYTHON] },
    Gate { module: "needs_root", needs: &[CXX, SET_USER_ID] },
    Gate { module: "needs_tshark", needs: &[TSHARK] },
    Gate { module: "needs_valgrind", needs: &[CXX, MAKE, PKG_CONFIG, VALGRIND] },
];

/// The gates of the tests that run. Without `all` they do not have the modules that only `--all` runs, so that programs for
/// these are not needed.
fn gates(all: bool) -> Vec<Gate> {
    GATES.iter().filter(|gate| all || !groups::is_left_to_all(gate.module)).copied().collect()
}

/// Remembers whether any part has had one of the tests that were asked for by name. It is an error if no part has one.
#[derive(Default)]
struct Without {
    error: Option<Error>,
    others: bool,
}

impl Without {
    fn hear(&mut self, result: Result<(), Error>) -> Result<(), Error> {
        match result {
            Err(error @ Error::NoTest { .. }) => self.error = Some(error),
            other => {
                other?;
                self.others = true;
            }
        }
        Ok(())
    }

    fn all(self) -> Result<(), Error> {
        self.error.filter(|_| !self.others).map_or(Ok(()), Err)
    }
}

impl<'a> Site<'a> {
    /// A site that selects no tests by name, so that each part runs all of its tests; the long ones are among them only if
    /// `all`.
    pub fn new(project: &'a Project, missing: &'a [Need], all: bool) -> Self {
        Self { project, missing, names: Vec::new(), all }
    }

    fn lacks(&self, needs: &[Need]) -> Vec<Need> {
        needs.iter().copied().filter(|need| self.missing.contains(need)).collect()
    }

    fn closed_gates(&self) -> impl Iterator<Item = &'static Gate> {
        GATES.iter().filter(|gate| !self.lacks(gate.needs).is_empty())
    }

    /// The arguments with which a test program skips the modules whose programs this machine does not have.
    pub fn skipped_modules(&self) -> impl Iterator<Item = String> {
        self.closed_gates().map(|gate| format!("--skip={}::", gate.module))
    }
}

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    if arguments.rig {
        needs::require(project, rig::NEEDS)?;
        return rig::run(project, &arguments.names);
    }
    let project = &Project { for_tests: true, quick: arguments.all, ..project.clone() };
    if arguments.real_clock {
        let needed: Vec<Need> = gates(false).iter().flat_map(|gate| gate.needs).copied().collect();
        let missing = needs::set_up(project, &needed);
        let site = Site::new(project, &missing, false);
        return groups::repeat_real_clock(&site, arguments.times, arguments.busy);
    }
    let beyond = if arguments.all { PARTS_OF_ALL } else { &[] };
    let (parts, gates) = if arguments.windows { (&WINDOWS[..], Vec::new()) } else { (PARTS, gates(arguments.all)) };
    let asked = |part: &'static Part| Some((part, part.asked_for(&arguments.names)?));
    let parts: Vec<(&Part, Vec<String>)> = parts.iter().chain(beyond).filter_map(asked).collect();

    let needed = parts.iter().flat_map(|(part, _)| part.needs).chain(gates.iter().flat_map(|gate| gate.needs));
    let missing = needs::set_up(project, &needed.copied().collect::<Vec<Need>>());

    if arguments.all {
        ALL.announce(project);
    }
    let left_out = if arguments.all { LEFT_OUT_OF_ALL } else { &[] };
    let ahead = if arguments.all { Ahead::start(project, &missing) } else { None };
    run_parts(&Site::new(project, &missing, arguments.all), parts, arguments.from, &gates, left_out, ahead)
}

/// Whether a part uses results of the builds in the background. The first results that a part uses are those for Windows, which
/// only a part that needs MinGW uses; by waiting for them, it waits for all builds.
fn needs_ahead(part: &Part) -> bool {
    part.needs.contains(&MINGW_X64)
}

/// Runs the parts in order from number `from` (1 or more) on, each with the names of tests that select its tests. At the
/// end lists the parts that were skipped because programs are missing, and those that were `left_out` by choice. The first
/// part that needs what `ahead` builds waits for it.
pub fn run_parts(
    site: &Site,
    parts: Vec<(&Part, Vec<String>)>,
    from: u8,
    gates: &[Gate],
    left_out: &[&str],
    mut ahead: Option<Ahead>,
) -> Result<(), Error> {
    let begin = Instant::now();
    let mut skipped = Vec::new();
    let mut without = Without::default();
    let count = parts.len();
    for (number, (part, names)) in parts.into_iter().enumerate().skip(usize::from(from) - 1) {
        let site = Site { names, ..*site };
        let title = format!("[{}/{count}] {}", number + 1, part.name);
        let lacking = site.lacks(part.needs);
        if !lacking.is_empty() {
            println!("{title}: skipped");
            skipped.push((part.name.to_owned(), lacking));
            continue;
        }
        if let Some(ahead) = ahead.take_if(|_| needs_ahead(part)) {
            let started = Instant::now();
            ahead.wait()?;
            println!("waited {} for builds in the background", seconds(started.elapsed()));
        }
        println!("{title} ...");
        let started = Instant::now();
        let result = (part.run)(&site);
        let verdict = match &result {
            Ok(()) => "passed",
            Err(Error::NoTest { .. }) => "has no such test",
            Err(_) => "FAILED",
        };
        println!("{title}: {verdict} after {}", seconds(started.elapsed()));
        without.hear(result)?;
    }
    without.all()?;
    let closed = gates.iter().filter(|gate| !site.lacks(gate.needs).is_empty());
    skipped.extend(closed.map(|gate| (format!("tests in modules {}", gate.module), site.lacks(gate.needs))));

    println!("\nall that ran passed, in {}", seconds(begin.elapsed()));
    for what in left_out {
        println!("left out: {what}");
    }
    if !skipped.is_empty() {
        println!("skipped:");
        for (what, lacking) in skipped {
            println!("  {what}: no {}; to enable: {}", needs::names(&lacking), needs::install_line(&lacking));
        }
    }
    Ok(())
}

fn seconds(time: Duration) -> String {
    format!("{:.1} s", time.as_secs_f64())
}

pub fn format(site: &Site) -> Result<(), Error> {
    command::run(site.project.cargo().args(["fmt", "--all", "--check"]))?;
    command::run(site.project.cargo().args(["fmt", "--check", "--manifest-path=fuzz/Cargo.toml"]))
}

pub fn lints(site: &Site) -> Result<(), Error> {
    command::run(site.project.cargo().args(["clippy", "--workspace", "--all-targets", "--", "-Dwarnings"]))?;
    // `--all-targets` leaves out the tests that run in a guest system or under Wine: Cargo.toml sets `test = false` for
    // them. So they are checked here by their names.
    let others = ["--test=windows", "--test=windows_usb", "--", "-Dwarnings"];
    command::run(&mut site.project.cargo_as_in_tests("clippy", "rig", &others))
}

fn documentation(site: &Site) -> Result<(), Error> {
    let doc = |flags: &str, packages: &[&str]| {
        let mut cargo = site.project.cargo();
        command::run(cargo.env("RUSTDOCFLAGS", flags).args(["doc", "--no-deps"]).args(packages))
    };
    doc("-Dwarnings", &["--package=ecmsk", "--all-features"])?;
    // The packages other than `ecmsk` have no public Rust API, so their documentation is for developers and covers private
    // items.
    doc(
        "-Dwarnings -Arustdoc::private-intra-doc-links",
        &["--workspace", "--exclude=ecmsk", "--document-private-items"],
    )
}

pub fn rules(site: &Site) -> Result<(), Error> {
    features::check(site.project)
}

fn fuzz_targets(site: &Site) -> Result<(), Error> {
    let mut cargo = site.project.cargo();
    // Not in fuzz/target, where all dependencies would be compiled once more.
    cargo.args(["check", "--locked", "--manifest-path=fuzz/Cargo.toml", "--target-dir"]).arg(&site.project.target);
    command::run(&mut cargo)
}

fn staged(site: &Site) -> Result<(), Error> {
    stage::build_for_tests(site.project).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn site<'a>(project: &'a Project, missing: &'a [Need]) -> Site<'a> {
        Site::new(project, missing, false)
    }

    #[test]
    fn a_name_goes_to_the_parts_that_have_it() {
        let takers = |name: &str| WINDOWS.iter().map(|part| (part.takes)(name)).collect::<Vec<_>>();
        assert_eq!(takers("boards::x64::a"), [false, false, false, false, true]);
        assert_eq!(takers("a"), [true, true, false, false, false]);
        assert_eq!(takers("x86::a"), [false, true, false, false, false]);
        assert_eq!(takers("dotnet::a"), [false, false, true, true, false]);
        assert_eq!(takers("dotnet::x64::a"), [false, false, true, false, false]);
    }

    #[test]
    fn a_part_gets_its_own_names() {
        let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        let both = names(&["boards::x64::a", "b"]);
        let [x64, .., usb] = &WINDOWS;
        assert_eq!(usb.asked_for(&both), Some(names(&["boards::x64::a"])));
        assert_eq!(x64.asked_for(&both), Some(names(&["b"])));
        assert_eq!(usb.asked_for(&names(&["b"])), None);
        assert_eq!(usb.asked_for(&[]), Some(Vec::new()));
    }

    #[test]
    fn a_name_that_one_part_has_is_enough() {
        let none = || Err(Error::NoTest { names: "a".into() });
        let hear = |results: Vec<Result<(), Error>>| {
            let mut without = Without::default();
            results.into_iter().try_for_each(|result| without.hear(result))?;
            without.all()
        };
        assert!(hear(vec![]).is_ok() && hear(vec![none(), Ok(()), none()]).is_ok());
        assert!(matches!(hear(vec![none(), none()]), Err(Error::NoTest { .. })));
        assert!(matches!(hear(vec![none(), Err(Error::NoFigures), Ok(())]), Err(Error::NoFigures)));
    }

    /// Programs that only the tests of `--all` need are not fetched for `cargo xtask test`, for which a person waits.
    #[test]
    fn what_is_left_to_all_needs_nothing_before() {
        let modules = |all| gates(all).iter().map(|gate| gate.module).collect::<Vec<_>>();
        assert_eq!(modules(true).len(), GATES.len());
        assert_eq!(
            modules(false),
            ["needs_cxx", "needs_mono", "needs_network_namespace", "needs_python", "needs_root"]
        );
    }

    #[test]
    fn a_gate_closes_when_one_of_its_needs_is_missing() {
        let project = Project { root: "/".into(), target: "/target".into(), for_tests: false, quick: false };
        let closed =
            |missing: &[Need]| site(&project, missing).closed_gates().map(|gate| gate.module).collect::<Vec<_>>();
        assert!(closed(&[]).is_empty());
        assert_eq!(closed(&[VALGRIND]), ["needs_valgrind"]);
        assert_eq!(
            closed(&[PYTHON]),
            ["needs_dotnet_core", "needs_pip", "needs_pyright", "needs_pysoem", "needs_python"]
        );
        assert_eq!(closed(&[NETWORK_NAMESPACE]), ["needs_network_namespace", "needs_pysoem"]);
        assert_eq!(closed(&[TSHARK]), ["needs_tshark"]);
        assert_eq!(closed(&[CHROMIUM, NODE]), ["needs_axe", "needs_chromium", "needs_node", "needs_pyright"]);
        assert_eq!(closed(&[AXE]), ["needs_axe"]);
        assert_eq!(closed(&[MONO]), ["needs_mono"]);
        assert_eq!(closed(&[DOTNET_CORE]), ["needs_dotnet_core"]);
        assert_eq!(closed(&[CXX]), ["needs_cxx", "needs_root", "needs_valgrind"]);
        assert_eq!(closed(&[SET_USER_ID]), ["needs_root"]);
        assert!(closed(&[CLIPPY]).is_empty());
    }
}
