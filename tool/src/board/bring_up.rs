//! What a step needs of the network: it is there, or is brought up because the user says so, or the user is told what to
//! type.

use ecmsk::sk::MasterState;

use super::error::BoardError;
use super::network::list;
use super::session::{Board, StepSource, numbered, statusword_text};

/// What a step needs of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs<'a> {
    /// PreOP or higher.
    Sdo,
    /// OP.
    Op,
    /// OP, and these axes on.
    On(&'a [u8]),
}

impl Board {
    /// Sees to what a step needs, with `--up` by bringing the network up; else says what to type.
    ///
    /// # Errors
    /// [`BoardError::NotUp`], [`BoardError::AxisOff`], [`BoardError::Alarm`], and what goes wrong on the way up.
    pub fn ready(&self, what: &str, needs: Needs<'_>) -> Result<(), BoardError> {
        let found = self.ecm.state()?;
        let wanted = if needs == Needs::Sdo { MasterState::PreOp } else { MasterState::Op };
        // SDOs are what finds out why a change of state has failed.
        let state = found.state().filter(|_| needs == Needs::Sdo || !found.is_failed());
        if needs != Needs::Sdo {
            self.known_network(what)?;
        }
        if state.is_none_or(|state| state < wanted) {
            if !self.up {
                let needs = if wanted == MasterState::Op { "OP" } else { "PreOP, SafeOP or OP" };
                let next = self.next(if wanted == MasterState::Op { "`state op`" } else { "`state preop`" });
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
            let next = self.next(&format!("`servo on {slave}`"));
            return Err(BoardError::AxisOff {
                what: what.to_owned(),
                slave: *slave,
                state: statusword_text(*word),
                next,
            });
        }
        let axes: Vec<u8> = off.iter().map(|(slave, _)| *slave).collect();
        self.run_interruptible("switching on", |ecm| ecm.servo_on(&axes))?;
        self.reporter.note(format_args!("switched on: {}", numbered("axis", "axes", &axes)));
        Ok(())
    }

    /// Changes the state; on the way from PreOP to higher ones the network is configured.
    ///
    /// # Errors
    /// [`BoardError::UnknownNetwork`], and what the board says.
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

    /// What a step has to type to go on: the command line with `--up`, or the lines that bring it up.
    fn next(&self, lines: &str) -> String {
        match self.source {
            StepSource::CommandLine => format!("to bring it up first, type: {} --up", command_line()),
            StepSource::Lines => format!("write {lines} before it"),
        }
    }
}

/// What was typed, as a shell takes it again.
fn command_line() -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-./:=,+@%".contains(c);
    let quoted = std::env::args().skip(1).map(|word| {
        if !word.is_empty() && word.chars().all(plain) { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
    });
    std::iter::once("ecmsk".to_owned()).chain(quoted).collect::<Vec<_>>().join(" ")
}
