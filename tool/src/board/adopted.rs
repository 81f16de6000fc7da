//! Checks a network that was already running when the verb began. Before an axis moves, the cycle time and the modes
//! given by the user are compared with those of the network. With a wrong cycle time the axes would move faster or
//! slower than requested, and in another mode they would interpret the targets differently.

use ecmsk::cia402::Mode;
use ecmsk::coe::ObjectAddress;

use super::error::BoardError;
use super::session::Board;

/// \[OURS] The number of cycles over which the cycle time is measured.
const CYCLES: u64 = 50;
/// \[OURS] The largest relative deviation of the measured cycle time. A third is enough, since the next longer cycle
/// time is twice as long. It is needed because some links stamp reports late.
const TOLERANCE: f64 = 0.33;
/// The object "modes of operation display", 0x6061.
const MODE_DISPLAY: ObjectAddress = ObjectAddress::new(0x6061, 0);

impl Board {
    /// Checks that these axes run in CSP, with the cycle time given by the user. If this process has configured the
    /// network itself, nothing is checked.
    ///
    /// # Errors
    /// [`BoardError::Refused`] if the measured cycle time or the mode of an axis differs;
    /// [`BoardError::UnknownNetwork`] if the slaves are not known; errors of reading reports and the mode.
    pub fn check_adopted(&self, what: &str, axes: &[u8]) -> Result<(), BoardError> {
        if !self.adopted.get() {
            return Ok(());
        }
        let refused = |why, next: String| BoardError::Refused { what: what.to_owned(), why, next };
        let said = self.known_network(what)?.cycle_us;
        let limit = self.options.read_limit;
        let first = self.ecm.next_cycle(limit)?.meta;
        let mut last = first;
        while last.sequence < first.sequence + CYCLES {
            self.check_stop()?;
            last = self.ecm.next_cycle(limit)?.meta;
        }
        let cycles = (last.sequence - first.sequence) as f64;
        let measured = (last.at.0 - first.at.0) as f64 / cycles / 1e3;
        if (measured / f64::from(said) - 1.0).abs() > TOLERANCE {
            let why = format!("the network runs with a cycle of {measured:.0} us, not of {said} us");
            return Err(refused(why, format!("give --cycle-us {}", nearest(measured))));
        }
        for slave in axes {
            let code: u8 = self.run_interruptible("reading the mode", |ecm| ecm.sdo_read(*slave, MODE_DISPLAY))?;
            if Mode::from_code(code) != Some(Mode::Csp) {
                let mode = Mode::from_code(code).map_or_else(|| code.to_string(), |mode| format!("{code} ({mode})"));
                let next = "configure the network again: `state preop`, then `state op`".to_owned();
                let axis = self.label(*slave);
                return Err(refused(format!("axis {axis} is in mode {mode}, not in {}", Mode::Csp), next));
            }
        }
        Ok(())
    }
}

/// The possible cycle time of a board that is nearest to the measured one. Both are in microseconds.
fn nearest(measured: f64) -> u32 {
    let steps = (measured / 250.0).log2().round().clamp(0.0, 11.0);
    250 << steps as u32
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::board::{Args, BoardUse, Interrupt, StepSource};
    use crate::step::{Line, OnBoard};

    #[derive(Parser)]
    struct Words {
        #[command(flatten)]
        words: OnBoard<Nothing>,
    }

    #[derive(clap::Args)]
    struct Nothing {}

    /// Runs the lines of a script on a simulated board, and leaves the axes unchanged at the end. Returns the error of
    /// the first line that fails.
    fn lines(options: &[&str], lines: &[&str]) -> Result<(), BoardError> {
        let link = ["ecmsk", "--link", "sim:?slaves=drive*2&clock=virtual&name=adopted", "--close", "leave"];
        let args: Args = Words::parse_from(link.iter().chain(options)).words.board;
        let board = Board::open(&args, BoardUse::Moves, StepSource::Lines, Interrupt::default())?;
        let done = lines.iter().try_for_each(|line| match Line::parse(line) {
            Ok(Line::Step(step)) => step.run(&board),
            other => panic!("{line}: {other:?}"),
        });
        board.close(done)
    }

    /// Axes of a network that was already running are moved only if the given cycle time and mode are those of the
    /// network.
    #[test]
    fn a_running_network_is_moved_only_with_its_own_cycle_and_mode() {
        lines(&["--cycle-us", "2000", "--slaves", "drive,drive:csv"], &["state op", "servo on all"]).unwrap();
        let wrong = |options: &[&str], line, why: &str| {
            let error = lines(options, &[line]).unwrap_err().to_string();
            assert!(error.contains(why), "{error}");
        };
        wrong(&[], "move 1=100", "a cycle of 2000 us, not of 1000 us; give --cycle-us 2000");
        wrong(
            &["--cycle-us", "2000"],
            "move 1=100 2=5",
            "axis 2 is in mode 9 (CSV), not in CSP; configure the network again",
        );
        wrong(&["--slaves", "drive"], "move 2=5", "there is no slave 2");
        lines(&["--cycle-us", "2000"], &["expect state op", "move 1=100", "expect position 1=100 --within 2"]).unwrap();
        // A network that this process has configured needs no check.
        lines(&[], &["state preop", "state op", "servo on all", "move 1=200 2=5"]).unwrap();
    }

    /// A measured cycle time is rounded to the nearest possible cycle time of a board.
    #[test]
    fn a_measured_cycle_is_rounded_to_one_that_the_board_has() {
        assert_eq!([100.0, 240.0, 510.0, 1990.0, 4100.0].map(nearest), [250, 250, 500, 2000, 4000]);
    }
}
