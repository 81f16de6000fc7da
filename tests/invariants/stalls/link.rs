//! The link of a process that stalls at any call, before it or after it: of a program to its board, or to a server; of a
//! server to its board.

use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use ecmsk::link::engine::EngineLink;
use ecmsk::link::{Dir, Layer, Link, LinkError, ReadMeta, Stamp, Wait};
use ecmsk::sk::{Frame, SlaveCommand, SlotCommand};
use ecmsk::slave::handle::SimHandle;
use support::dice::Dice;

use super::SIZE;
use super::remote::Remote;

/// Four keep-alive times: a server ends the connection of a program that was silent for so long.
const SILENT: Duration = Duration::from_secs(2);

/// The link.
pub struct Stalling {
    /// The board, whose time passes during a stall.
    board: Arc<EngineLink>,
    /// The server between the program and the board.
    server: Option<Remote>,
    inside: Mutex<Inside>,
}

struct Inside {
    dice: Dice,
    /// It stalls in one of that many calls; `None`: in none.
    rarely: Option<u64>,
    /// The number of stalls left.
    left: u64,
    stood: u64,
    stood_in_brake: u64,
    is_braking: bool,
    /// Frames that the board has taken from the program and from its brake.
    accepted: Vec<Frame>,
    braked: Vec<Frame>,
    /// The newest report that was read.
    read: Option<(Frame, ReadMeta)>,
    /// Whether the server has ended the program's connection.
    is_missed: bool,
}

impl Stalling {
    pub fn new(board: Arc<EngineLink>, server: Option<Remote>, dice: Dice) -> Self {
        let (stood, stood_in_brake, is_braking) = (0, 0, false);
        let (accepted, braked) = (Vec::new(), Vec::new());
        let (rarely, left, read, is_missed) = (None, 0, None, false);
        let inside =
            Inside { dice, rarely, left, stood, stood_in_brake, is_braking, accepted, braked, read, is_missed };
        Self { board, server, inside: Mutex::new(inside) }
    }

    fn inside(&self) -> MutexGuard<'_, Inside> {
        self.inside.lock().expect("no panic")
    }

    /// From now on it stalls in one of that many calls, several times. Earlier frames do not belong to the program's
    /// motion.
    pub fn stand_still(&self, rarely: Option<u64>) {
        let mut inside = self.inside();
        if rarely.is_some() {
            inside.accepted.clear();
        }
        (inside.rarely, inside.left) = (rarely, 1 + inside.dice.below(3));
    }

    /// Frames from now on belong to the brake.
    pub fn begin_to_brake(&self) {
        let mut inside = self.inside();
        (inside.is_braking, inside.left) = (true, 1 + inside.dice.below(4));
    }

    /// The commands that the program has given a slave, in order.
    pub fn accepted(&self, slave: usize) -> Vec<SlaveCommand> {
        commands(&self.inside().accepted, slave)
    }

    /// The commands of its brake.
    pub fn braked(&self, slave: usize) -> Vec<SlaveCommand> {
        commands(&self.inside().braked, slave)
    }

    /// The newest report that was read.
    pub fn last_read(&self) -> (Frame, ReadMeta) {
        self.inside().read.clone().expect("a report")
    }

    /// Whether the server has ended the program's connection.
    pub fn is_missed(&self) -> bool {
        self.inside().is_missed
    }

    pub fn stood(&self) -> u64 {
        self.inside().stood
    }

    pub fn stood_in_brake(&self) -> u64 {
        self.inside().stood_in_brake
    }

    /// Whether a shaft moves within a few cycles.
    pub fn is_moving(&self, network: &SimHandle, count: usize) -> bool {
        let shafts = || (1..=count as u8).map(|slave| network.shaft(slave, 0)).collect::<Vec<_>>();
        let before = shafts();
        self.let_pass(Duration::from_millis(4));
        let moves = |(a, b): (Option<i64>, Option<i64>)| a.zip(b).is_some_and(|(a, b)| (a - b).abs() > 40);
        before.into_iter().zip(shafts()).any(moves)
    }

    /// Lets time pass for the board.
    pub fn let_pass(&self, time: Duration) {
        self.board.pass(time).expect("it is there");
    }

    /// The process stalls.
    fn stall(&self, time: Duration) {
        let _ = self.board.pass(time.min(SILENT));
        let Some(rest) = time.checked_sub(SILENT) else { return };
        if self.server.as_ref().is_some_and(|server| server.end(false)) {
            self.inside().is_missed = true;
        }
        let _ = self.board.pass(rest);
    }

    /// Stalls, or not; returns the time of the stall.
    fn may_stand(&self) -> Option<Duration> {
        let time = {
            let mut inside = self.inside();
            let rarely = inside.rarely?;
            if inside.left == 0 || !inside.dice.one_in(rarely) {
                return None;
            }
            inside.left -= 1;
            inside.stood += 1;
            inside.stood_in_brake += u64::from(inside.is_braking);
            let most = inside.dice.pick(&[20, 200, 1200, 5000]);
            Duration::from_micros(inside.dice.below(most * 1000))
        };
        self.stall(time);
        Some(time)
    }
}

fn commands(frames: &[Frame], slave: usize) -> Vec<SlaveCommand> {
    frames
        .iter()
        .filter_map(|frame| SlotCommand::decode(&frame.slot(SIZE, slave), SIZE).ok())
        .map(|slot| slot.command)
        .collect()
}

impl Layer for Stalling {
    fn inner(&self) -> &dyn Link {
        match &self.server {
            Some(server) => server,
            None => &*self.board,
        }
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.may_stand();
        let done = self.inner().write(frame, wait);
        if done.is_ok() {
            let mut inside = self.inside();
            let frames = if inside.is_braking { &mut inside.braked } else { &mut inside.accepted };
            frames.push(frame.clone());
        }
        self.may_stand();
        done
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let stood = self.may_stand();
        if let (Some(waited), Wait::For(limit)) = (stood, wait)
            && waited > limit
        {
            // After the stall its wait is over, and no report was read.
            return Err(LinkError::Timeout { dir: Dir::Read, waited, what: "it stood still" });
        }
        let done = self.inner().read(out, wait);
        if let Ok(meta) = &done {
            self.inside().read = Some((out.clone(), *meta));
        }
        self.may_stand();
        done
    }

    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        let done = self.inner().pass(time);
        self.may_stand();
        done
    }

    /// A real board goes on when it is closed, and so does this one.
    fn close(&self) {
        self.server.iter().for_each(|server| server.close());
    }

    fn vanish(&self) {
        self.server.iter().for_each(|server| server.vanish());
    }
}
