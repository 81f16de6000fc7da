//! `cargo xtask demo`: runs a C++ program on a simulated board, on which a drive gets an alarm, and plots the run. With
//! `--link` the program also runs on another simulated board, and both runs are in one picture.

use std::env;
use std::fs;
use std::io::{self, IsTerminal};
use std::path::Path;
use std::process::{Command, Stdio};

use crate::error::Error;
use crate::needs::{CXX, IP, NETWORK_NAMESPACE};
use crate::project::Project;
use crate::spend::Spend;
use crate::{command, needs, stage};

const SOURCE: &str = "examples/cpp/alarm_recovery.cpp";
const LINK: &str = "sim:?slaves=drive*2&clock=real&script=examples/scripts/alarm_on_the_way.ecmscript";
/// The fault script that gives the alarm, if the link has no `script=`: for simulated slaves of the model, and (next constant)
/// for simulated slaves behind an ECM-XF.
const SCRIPT: &str = "script=examples/scripts/alarm_on_the_way.ecmscript";
const SCRIPT_BEHIND_CHIP: &str = "script=examples/scripts/alarm_on_the_way_behind_chip.ecmscript";

/// The schemes of links to simulated slaves, each with its default fault script.
const SIMULATED: [(&str, &str); 2] = [("sim:", SCRIPT), ("xf-sim:", SCRIPT_BEHIND_CHIP)];

/// The value of `--link` that means a pair of virtual network cards, with simulated slaves at the other end of the cable.
const CARD: &str = "nic";
/// The shell script for [`CARD`]: makes the pair of network cards, simulates two drives at one card, and runs a program on the
/// other card. $1 is the tool, $2 the recording, $3 the program, $4 the log of the slaves.
const ON_A_CARD: &str = "
ip link add veth0 type veth peer name veth1
ip link set veth0 up
ip link set veth1 up
$1 serve ethercat --on veth1 --slaves 'drive*2' --priority 10 \
    --script examples/scripts/alarm_on_the_way_on_a_wire.ecmscript > $4 2>&1 &
slaves=$!
trap 'kill $slaves' EXIT
tries=0
until grep -q answering $4 || [ $tries = 100 ]; do sleep 0.05; tries=$((tries + 1)); done
$1 exec --link 'nic:veth0?priority=20' --record $2 -- $3
";

/// The cost of building the library and the tool as in the tests, printed before the build. The build of `cargo xtask` itself is
/// done when this is printed, so it is not included.
const SPEND: Spend = Spend {
    disk_mb: 1_800,
    time: "on two free cores, four minutes beside the build of `cargo xtask` itself, now done",
};

#[derive(clap::Args)]
pub struct Arguments {
    /// Run the same program on this simulated board too, such as 'xf-sim:?slaves=drive*2', whose slaves are behind an ECM-XF,
    /// and draw both runs in one picture. It has the two drives and the alarm of the first run, if the link says nothing
    /// else. `nic` stands for a pair of virtual network cards, with the program on our own master at one end and simulated
    /// slaves at the other (needs root). Links that may reach a real machine are refused: the program moves its axes by
    /// 1,000,000 counts
    #[arg(long)]
    link: Option<String>,
}

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    if let Some(link) = &arguments.link {
        refuse_real(link, project.relative(&project.target))?;
    }
    println!(
        "builds the library and the tool as `cargo xtask test` does, compiles {SOURCE}, runs it on a simulated board and draws \
         what it did"
    );
    SPEND.announce(project);
    let on_card = arguments.link.as_deref() == Some(CARD);
    needs::require(project, if on_card { &[CXX, IP, NETWORK_NAMESPACE] } else { &[CXX] })?;
    // Commands are shown as users type them at the project's root.
    env::set_current_dir(&project.root).map_err(Error::file("go to", &project.root))?;
    let target = project.relative(&project.target);
    let folder = target.join("demo");
    let [staged, program, recording, plot, page, other, both] = [
        "stage",
        "alarm_recovery",
        "two_axes.pcapng",
        "two_axes.svg",
        "two_axes.html",
        "other_board.pcapng",
        "both.svg",
    ]
    .map(|name| folder.join(name));
    let ecmsk = staged.join("bin/ecmsk");
    fs::create_dir_all(&folder).map_err(Error::file("make", &folder))?;

    // The tests need the same build, which is done in a third of the time of an optimised one.
    stage::build_as_in_tests_into(&Project { for_tests: true, ..project.clone() }, &staged)?;
    let other_link = arguments.link.as_deref().filter(|_| !on_card).map(with_script);
    if let Some(link) = &other_link {
        // The tool checks the link without opening it, so that a wrong key is found before the first run.
        show_and_run(Command::new(&ecmsk).args(["exec", "--link", link, "--", "true"]))?;
    }

    let mut compile = Command::new(CXX.program);
    compile.args(["-std=c++17", "-O2", "-Wall", "-Wextra", "-pthread", SOURCE]);
    compile.arg("-I").arg(staged.join("include")).arg("-L").arg(staged.join("lib"));
    // The run path lets users start the program without `ecmsk exec` too. A DT_RUNPATH is searched after LD_LIBRARY_PATH, so
    // that `exec` still decides which library is loaded.
    compile.args(["-lNEXTWUSBLib", "-Wl,--enable-new-dtags,-rpath,$ORIGIN/stage/lib", "-o"]).arg(&program);
    show_and_run(&mut compile)?;

    let exec = |link: &str, recording: &Path| {
        // An older recording is removed, because the library would append to it.
        let _ = fs::remove_file(recording);
        let mut exec = Command::new(&ecmsk);
        show_and_run(exec.args(["exec", "--link", link, "--record"]).arg(recording).arg("--").arg(&program))
    };
    exec(LINK, &recording)?;
    for output in [&plot, &page] {
        show_and_run(Command::new(&ecmsk).arg("plot").arg(&recording).arg("-o").arg(output))?;
    }
    if arguments.link.is_some() {
        if let Some(link) = &other_link {
            exec(link, &other)?;
        } else {
            let _ = fs::remove_file(&other);
            let mut run = Command::new("unshare");
            run.args(["--net", "sh", "-euc", ON_A_CARD, "sh"]).args([
                &ecmsk,
                &other,
                &program,
                &folder.join("slaves.log"),
            ]);
            show_and_run(&mut run)?;
        }
        let mut draw = Command::new(&ecmsk);
        draw.arg("plot").arg(&recording).arg("--beside").arg(&other).arg("-o").arg(&both);
        show_and_run(&mut draw)?;
    }

    println!("{}", end(&folder, arguments.link.is_some()));
    open_page(&folder.join("two_axes.html"));
    Ok(())
}

/// Opens the page in the browser of a person at a desktop. It is no error if there is none: the demo has printed its path.
fn open_page(page: &Path) {
    let is_desktop =
        ["WAYLAND_DISPLAY", "DISPLAY"].iter().any(|name| env::var_os(name).is_some_and(|at| !at.is_empty()));
    if is_desktop && io::stdout().is_terminal() {
        let mut browser = Command::new("xdg-open");
        let _ = browser.arg(page).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    }
}

/// Refuses a link that may reach real slaves, because nobody knows whether that machine may move.
fn refuse_real(link: &str, target: &Path) -> Result<(), Error> {
    if link == CARD || SIMULATED.iter().any(|(scheme, _)| link.starts_with(scheme)) {
        return Ok(());
    }
    let mut instead = Command::new(target.join("demo/stage/bin/ecmsk"));
    instead.args(["exec", "--link", link, "--"]).arg(target.join("demo/alarm_recovery"));
    Err(Error::NotSimulated { link: link.to_owned(), instead: command::shown(&instead) })
}

/// The link, with the fault script that gives the alarm if it has no script of its own.
fn with_script(link: &str) -> String {
    match SIMULATED.into_iter().find(|(scheme, _)| link.starts_with(scheme)) {
        Some((_, script)) if !link.contains("script=") => {
            let between = if link.contains('?') { '&' } else { '?' };
            format!("{link}{between}{script}")
        }
        _ => link.to_owned(),
    }
}

/// The last lines of the demo's output: the files that were made, and commands to go on with.
fn end(folder: &Path, has_both: bool) -> String {
    let folder = folder.display();
    let both =
        if has_both { format!("\nboth runs:     {folder}/both.svg, the other one in black") } else { String::new() };
    let successor = if has_both {
        ""
    } else {
        "
  cargo xtask demo --link 'xf-sim:?slaves=drive*2'                          # the same program on an ECM-XF, both in a picture
  cargo xtask demo --link nic                                               # the same on a network card, without a board (root)"
    };
    format!(
        "
the recording: {folder}/two_axes.pcapng
the plot:      {folder}/two_axes.svg
the page:      {folder}/two_axes.html (open it in a browser: events, curves, states){both}

next, in this folder:
  export PATH=$PWD/{folder}/stage/bin:$PATH PKG_CONFIG_PATH=$PWD/{folder}/stage/lib/pkgconfig
  ecmsk dump {folder}/two_axes.pcapng --slots 2 --from 2.749s --to 2.752s   # the alarm, cycle by cycle
  ecmsk serve web --link 'sim:?slaves=drive*2'                              # the page of a board, live
  ecmsk home 1 --up --link 'sim:?slaves=drive*2'                            # an axis without a program
  g++ YOURS.cpp -o yours $(pkg-config --cflags --libs nextwusblib)          # your program, unchanged
  ecmsk exec --link 'sim:?slaves=drive*2' -- ./yours
  cargo xtask stage --prefix $HOME/.local                                   # both optimised, for a machine{successor}
docs/GUIDE-CPP.md goes on from there in C++, docs/GUIDE.md in Rust, docs/DOTNET.md in C#, docs/TOOL.md with the tool alone"
    )
}

fn show_and_run(step: &mut Command) -> Result<(), Error> {
    println!("$ {}", command::shown(step));
    command::run(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The last lines of the demo's output name the files that were made and commands to go on with. The pages of docs/
    /// that they name exist.
    #[test]
    fn a_next_step() {
        let text = end(Path::new("target/demo"), true);
        assert!(text.contains("target/demo/two_axes.svg") && text.contains("target/demo/two_axes.html"), "{text}");
        assert!(text.contains("export PATH=$PWD/target/demo/stage/bin:$PATH"), "{text}");
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let pages: Vec<&str> = text.split([' ', ',', '\n']).filter(|word| word.starts_with("docs/")).collect();
        assert_eq!(pages.len(), 4, "{text}");
        assert!(pages.iter().all(|page| root.join(page).is_file()), "{pages:?}");
        assert!(text.contains("target/demo/both.svg"), "{text}");
        assert!(!text.contains("demo --link"), "it was just run: {text}");
        let of_one = end(Path::new("target/demo"), false);
        assert!(!of_one.contains("both.svg") && of_one.contains("demo --link 'xf-sim:?slaves=drive*2'"), "{of_one}");
    }

    /// A link that may reach a real machine, or that is invalid, is refused with the reason and with a command for the
    /// user.
    #[test]
    fn no_real_machine_is_moved() {
        for link in
            ["usb:", "spi:", "tcp:host:5000", "nic:eth1", "xf-spi:", "xf-usb:", "xfsim:", "", "simulated", "nic:"]
        {
            let refusal = refuse_real(link, Path::new("target")).expect_err(link).to_string();
            assert!(refusal.contains("1,000,000 counts") && refusal.contains("exec --link"), "{refusal}");
            assert!(refusal.contains(&format!("`{link}`")), "{refusal}");
        }
        for link in ["sim:", "sim:?slaves=drive*2", "xf-sim:?ahead=4", "nic"] {
            assert!(refuse_real(link, Path::new("target")).is_ok(), "{link}");
        }
    }

    /// The second board has the alarm too, unless its link has a script of its own.
    #[test]
    fn the_alarm_of_the_other_board() {
        for (link, expected) in [
            ("xf-sim:", format!("xf-sim:?{SCRIPT_BEHIND_CHIP}")),
            ("xf-sim:?ahead=4", format!("xf-sim:?ahead=4&{SCRIPT_BEHIND_CHIP}")),
            ("sim:?script=a", "sim:?script=a".to_owned()),
        ] {
            assert_eq!(with_script(link), expected);
        }
    }
}
