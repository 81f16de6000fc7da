//! `ecmsk move`.

use std::fs;
use std::path::Path;

use ecmsk::recording::{Recorded, Recording};
use support::failing_calls::{self, Blow, Run, Struck, Whose};
use support::tool_without_link;

use crate::served::Served;
use crate::{EACH_ONCE, FEW, LIMIT, strike};

const TARGET: i32 = 500;

fn moves(link: &str, blow: Option<Blow>) -> Struck {
    let target = format!("1={TARGET}");
    let words = ["move", &target, "--up", "--velocity", "20000", "--acceleration", "400000", "--link", link];
    failing_calls::run(&mut tool_without_link(&words), Whose::Program, blow, LIMIT, None)
}

/// With exit status 0 the output reports the axis at its target, unless the output's reader has closed it.
fn arrived(struck: &Struck) -> Result<(), String> {
    let is_closed = struck.dealt.is_some_and(|dealt| dealt.is_write_to(1) && dealt.errno == Some(libc::EPIPE));
    let said = &struck.ended.stdout;
    if is_closed || *said == format!("axis 1: at {TARGET}\n") { Ok(()) } else { Err(format!("it says `{said}`")) }
}

/// The number of frames in a recording, if it has lost none.
pub fn whole(file: &Path) -> Result<usize, String> {
    let mut recording = Recording::open(file).map_err(|error| error.to_string())?;
    let frames: Result<Vec<Recorded>, _> = recording.by_ref().collect();
    let frames = frames.map_err(|error| error.to_string())?.len();
    match ecmsk::recording::lacks_at_end(file) {
        Ok(lacks) if lacks.is_nothing() => Ok(frames),
        Ok(lacks) => Err(format!("its recording lacks frames: {lacks}")),
        Err(error) => Err(error.to_string()),
    }
}

#[test]
fn a_move() {
    strike("a_move", EACH_ONCE, |blow| Run::judge(moves("sim:?slaves=drive&clock=virtual", blow), arrived));
}

/// Each thread of a shell and a monitor, and their reads and writes, may fail.
#[test]
fn a_shell_and_a_monitor() {
    for words in [&["shell"][..], &["monitor", "--once"]] {
        let run = |blow| {
            let mut tool = tool_without_link(words);
            tool.args(["--link", "sim:?slaves=drive&clock=virtual"]);
            Run::judge(failing_calls::run(&mut tool, Whose::Program, blow, LIMIT, None), |_| Ok(()))
        };
        strike("a_shell_and_a_monitor", FEW, run);
    }
}

#[test]
fn a_move_on_the_real_clock() {
    strike("a_move_on_the_real_clock", FEW, |blow| Run::judge(moves("sim:?slaves=drive&clock=real", blow), arrived));
}

#[test]
fn a_recorded_move() {
    let file = support::out_dir().join("move.pcapng");
    let link = format!("sim:?slaves=drive&clock=virtual&record={}", file.display());
    strike("a_recorded_move", EACH_ONCE, |blow| {
        let _ = fs::remove_file(&file);
        Run::judge(moves(&link, blow), |struck| {
            arrived(struck)?;
            whole(&file).and_then(|frames| if frames > 200 { Ok(()) } else { Err(format!("{frames} frames")) })
        })
    });
}

#[test]
fn a_move_on_a_served_board() {
    strike("a_move_on_a_served_board", FEW, |blow| {
        let served = Served::start();
        let run = Run::judge(moves(&served.uri(), blow), arrived);
        run.and(|struck| served.stands_within(TARGET, struck.ended.status.success()))
    });
}
