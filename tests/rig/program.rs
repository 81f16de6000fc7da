//! A whole program through the kernel: two axes are configured, switched on, moved and switched off.

use std::sync::Arc;
use std::sync::Mutex;

use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Options, Scale, Slave};
use ecmsk::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use ecmsk::sk::{Frame, MasterState};

use super::hidraw::Hidraw;
use super::served::{Served, attach, detach_all, recorded};

/// What a guest without KVM follows easily.
const CYCLE_US: u32 = 4000;

/// A board, and what the program has sent it.
struct Noted {
    board: Hidraw,
    sent: Arc<Mutex<Vec<Frame>>>,
}

impl Link for Noted {
    fn info(&self) -> LinkInfo {
        self.board.info()
    }
    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let stamp = self.board.write(frame, wait)?;
        self.sent.lock().unwrap().push(frame.clone());
        Ok(stamp)
    }
    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.board.read(out, wait)
    }
    fn cancel(&self, dir: Dir) {
        self.board.cancel(dir);
    }
    fn close(&self) {
        self.board.close();
    }
    fn check(&self) -> Result<(), LinkError> {
        self.board.check()
    }
    fn stats(&self) -> LinkStats {
        self.board.stats()
    }
}

/// The program of examples/rust/two_axes.rs, with a shorter way; gives both positions in degrees.
fn two_axes(link: Noted) -> Result<[f64; 2], EcmError> {
    let axis = Axis { scale: Scale::per_unit(131_072.0 / 360.0), ..Axis::CSP };
    let ecm = Ecm::over(Arc::new(link), Options::default())?;
    ecm.configure(&Config { slaves: vec![Slave::Drive(axis); 2], cycle_us: CYCLE_US })?;
    ecm.set_state(MasterState::Op)?;
    ecm.servo_on(&[1, 2])?;
    let start = ecm.snapshot()?;
    let from = [1, 2].map(|slave| start.position_units(slave).unwrap_or_default());
    let mut stream = ecm.stream(40)?;
    for cycle in 1..=500 {
        let share = f64::from(cycle) / 500.0;
        stream.csp_units(1, from[0] + 9.0 * share)?;
        stream.csp_units(2, from[1] - 4.0 * share)?;
        stream.step()?;
    }
    let done = stream.finish()?;
    assert_eq!(done.losses, 0);
    let end = ecm.snapshot()?;
    let way = [1, 2].map(|slave| end.position_units(slave).unwrap_or_default() - from[usize::from(slave == 2)]);
    ecm.close(Close::ServoOff)?;
    Ok(way)
}

/// WIRE-2 The axes move, and the board has executed the commands that the program sent, none lost or doubled.
#[test]
fn two_axes_move_behind_a_real_kernel() {
    let served = Served::start(&["sim:?slaves=drive*2&record=%2Ftmp%2Ftwo.pcapng"], &[]);
    let sent = Arc::default();
    let board = Noted { board: Hidraw::open(&attach("1-1")), sent: Arc::clone(&sent) };
    let way = two_axes(board).unwrap_or_else(|error| panic!("{error}"));
    assert!((way[0] - 9.0).abs() < 0.1 && (way[1] + 4.0).abs() < 0.1, "{way:?}");
    detach_all();
    served.stop();
    let (sent, arrived) = (sent.lock().unwrap(), recorded("/tmp/two.pcapng", Dir::Write));
    assert!(sent.len() > 500, "{}", sent.len());
    assert_eq!(arrived.len(), sent.len());
    assert!(arrived == *sent, "other frames than were sent, or in another order");
}
