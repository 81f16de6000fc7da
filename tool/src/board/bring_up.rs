//! Makes sure that the network is in the state that a step (an action such as `move` or `sdo`) needs. If it is not,
//! `--up` brings the network up. Without `--up`, the error says how to do this.

use ecmsk::machine_file::FILE_NAME;
use ecmsk::sk::MasterState;

use super::error::BoardError;
use super::network::list;
use super::session::{Board, StepSource, statusword_text};

/// The state of the network that a step needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs<'a> {
    /// The network is in PreOP or higher, for SDOs.
    Sdo,
    /// The network is in OP, for process data such as outputs.
    Op,
    /// The network is in OP, and these axes are in Operation enabled.
    On(&'a [u8]),
}

impl Board {
    /// Makes sure that the network is in the state that a step needs; with `--up` the network is brought up if it is
    /// not.
    ///
    /// # Errors
    /// [`BoardError::NotUp`] if the network is in a lower state, and [`BoardError::AxisOff`] if an axis is off, both
    /// only without `--up`. [`BoardError::Refused`] if two machine files differ in an axis, [`BoardError::Alarm`] if an
    /// axis has an alarm, and errors of bringing the network up.
    pub fn ready(&self, what: &str, needs: Needs<'_>) -> Result<(), BoardError> {
        if let Needs::On(axes) = needs {
            self.refuse_differing(what, axes)?;
        }
        let found = self.ecm.state()?;
        let wanted = if needs == Needs::Sdo { MasterState::PreOp } else { MasterState::Op };
        // SDOs also work after a failed state change, and can show why it has failed.
        let state = found.state().filter(|_| needs == Needs::Sdo || !found.is_failed());
        if needs != Needs::Sdo {
            self.known_network(what)?;
        }
        if state.is_none_or(|state| state < wanted) {
            if !self.up {
                let needs = if wanted == MasterState::Op { "OP" } else { "PreOP, SafeOP or OP" };
                let line = if wanted == MasterState::Op { "`state op`" } else { "`state preop`" };
                let next = self.next(line, "Start network (OP)");
                return Err(BoardError::NotUp { what: what.to_owned(), needs, found, next });
            }
            self.go_to(wanted)?;
        }
        let Needs::On(axes) = needs else { return Ok(()) };
        let snapshot = self.ecm.snapshot()?;
        let mut off = Vec::new();
        for slave in axes {
            let word = self.statusword(&snapshot, *slave);
            self.refuse_alarm(&snapshot, *slave)?;
            if !word.is_enabled() {
                off.push((*slave, word));
            }
        }
        let Some((slave, word)) = off.first() else { return Ok(()) };
        if !self.up {
            let axis = self.label(*slave);
            let next = self.next(&format!("`servo on {axis}`"), &format!("On of axis {axis}"));
            return Err(BoardError::AxisOff {
                what: what.to_owned(),
                axis: self.label(*slave),
                state: statusword_text(*word),
                next,
            });
        }
        let axes: Vec<u8> = off.iter().map(|(slave, _)| *slave).collect();
        self.run_interruptible("switching on", |ecm| ecm.servo_on(&axes))?;
        self.reporter.note(format_args!("switched on: {}", self.labels(&axes)));
        Ok(())
    }

    /// Refuses to move axes for which the machine file of the current folder differs from that of the server: the same
    /// position would mean another place, or the limits differ. The user has not named the file of the folder, so the
    /// server's file may be the right one. \[OURS]
    fn refuse_differing(&self, what: &str, axes: &[u8]) -> Result<(), BoardError> {
        let differs = self.differing.iter().find(|differs| axes.contains(&differs.slave));
        differs.map_or(Ok(()), |differs| {
            Err(BoardError::Refused {
                what: what.to_owned(),
                why: differs.text.clone(),
                next: format!(
                    "correct the file that is wrong, or say --machine {FILE_NAME} to move by that of this folder"
                ),
            })
        })
    }

    /// Changes the state of the network. On the way from PreOP to a higher state the network is configured.
    ///
    /// # Errors
    /// [`BoardError::UnknownNetwork`] if the network must be configured but its slaves are not known, and errors of the
    /// state change.
    pub fn go_to(&self, wanted: MasterState) -> Result<(), BoardError> {
        let change = |to: MasterState| {
            let done = self.run_interruptible(&format!("going to {to}"), |ecm| ecm.set_state(to));
            done.map_err(|error| match error {
                BoardError::Ecm(error) => self.explain(error),
                other => other,
            })
        };
        let from = self.ecm.state()?;
        let settled = from.state().filter(|_| !from.is_failed());
        self.forget_targets();
        if wanted <= MasterState::PreOp || matches!(settled, Some(MasterState::SafeOp | MasterState::Op)) {
            return change(wanted);
        }
        let config = self.known_network(&format!("going to {wanted}"))?;
        if settled != Some(MasterState::PreOp) {
            change(MasterState::PreOp)?;
        }
        self.run_interruptible("configuring", |ecm| ecm.configure(config))?;
        self.adopted.set(false);
        self.reporter.note(format_args!("configured: {}, cycle {} us", list(config), config.cycle_us));
        change(wanted)
    }

    /// The advice at the end of an error: the command line with `--up`, or the script lines or the button that bring the
    /// network up.
    fn next(&self, lines: &str, button: &str) -> String {
        match self.source {
            StepSource::CommandLine => format!("to bring it up first, type: {} --up", command_line()),
            StepSource::Lines => format!("write {lines} before it"),
            StepSource::Page => format!("press {button} before it"),
        }
    }
}

/// The command line, quoted for a shell.
fn command_line() -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-./:=,+@%".contains(c);
    let quoted = std::env::args().skip(1).map(|word| {
        if !word.is_empty() && word.chars().all(plain) { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
    });
    std::iter::once("ecmsk".to_owned()).chain(quoted).collect::<Vec<_>>().join(" ")
}
