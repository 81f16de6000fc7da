//! `ecmsk serve tcp`, between a writer here and a board that this process serves: whatever fails in it, the axis is at
//! rest after the end of the writer or the server.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use ecmsk::ecm::{Close, Config, Ecm, EcmError, Options};
use ecmsk::link::{self, Share};
use ecmsk::sk::MasterState;
use rustix::process::{Pid, Signal, kill_process};
use support::failing_calls::{self, Run, Watched, Whose};
use support::tool_without_link;

use crate::served::Served;
use crate::{FEW, LIMIT, strike};

const END: i32 = 1000;
const STEPS: i32 = 50;
/// Cycles in which the axis comes to rest.
const REST: i32 = 20;
/// The time after which the writer gives up a server that does not answer.
const PATIENCE: Duration = Duration::from_secs(20);

/// Moves the axis to its end, and closes the board, or vanishes without closing it.
fn write(uri: &str, closes: bool) -> Result<(), EcmError> {
    let limit = Duration::from_secs(5);
    let options = Options { state_limit: limit, servo_limit: limit, ..Options::default() };
    let link = link::open(uri, Share::ByName)?;
    let ecm = Ecm::over(Arc::clone(&link), options)?;
    ecm.configure(&Config::drives(1))?;
    ecm.set_state(MasterState::Op)?;
    ecm.servo_on(&[1])?;
    let mut stream = ecm.stream(20)?;
    for step in 1..=STEPS + REST {
        stream.csp(1, END / STEPS * step.min(STEPS))?;
        stream.step()?;
        if !closes && step == STEPS / 2 {
            std::mem::forget(stream);
            link.vanish();
            return Ok(());
        }
    }
    stream.finish()?;
    ecm.close(Close::Hold)
}

/// The address in the server's first line.
fn address(watched: &Watched) -> Option<String> {
    let said = watched.stdout();
    let (_, rest) = said.split_once("listening on ")?;
    Some(rest.split_once(';')?.0.to_owned())
}

/// Waits until the server listens; `None`: it has ended, or does not listen.
fn listening(watched: &Watched, has_ended: impl Fn() -> bool) -> Option<String> {
    let began = Instant::now();
    loop {
        if let Some(address) = address(watched) {
            return Some(address);
        }
        if has_ended() || began.elapsed() > PATIENCE {
            return None;
        }
        thread::sleep(Duration::from_millis(2));
    }
}

fn serve(test: &str, closes: bool) {
    strike(test, FEW, |blow| {
        let served = Served::start();
        let link = served.uri();
        let watched = Watched::default();
        // Before the writer waits for it: the first one builds the tool.
        let mut tool = tool_without_link(&["serve", "tcp", "--listen", "127.0.0.1:0", "--link", &link]);
        let (struck, written) = thread::scope(|scope| {
            let watched = &watched;
            let server = scope.spawn(|| failing_calls::run(&mut tool, Whose::Program, blow, LIMIT, Some(watched)));
            let written =
                listening(watched, || server.is_finished()).map(|address| write(&format!("tcp://{address}"), closes));
            if let Some(id) = watched.id().and_then(Pid::from_raw).filter(|_| !server.is_finished()) {
                let _ = kill_process(id, Signal::TERM);
            }
            (server.join().expect("no panic"), written)
        });
        let has_arrived = closes && matches!(written, Some(Ok(())));
        let run = Run::judge(struck, |struck| match (blow, &written) {
            (None, Some(Err(error))) => Err(format!("the writer: {error}")),
            (None, None) => Err("it does not listen".to_owned()),
            _ if struck.ended.stdout.starts_with("listening on ") => Ok(()),
            // Closing the pipe is the reader's choice, and no failure.
            _ if struck.dealt.is_some_and(|dealt| dealt.is_write_to(1) && dealt.errno == Some(libc::EPIPE)) => Ok(()),
            _ => Err("it does not say where it listens".to_owned()),
        });
        run.and(|_| served.stands_within(END, has_arrived))
    });
}

#[test]
fn a_server() {
    serve("a_server", true);
}

#[test]
fn a_server_whose_writer_vanishes() {
    serve("a_server_whose_writer_vanishes", false);
}
