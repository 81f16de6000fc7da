//! `home`: homes axes, one after the other.

use std::time::Duration;

use clap::builder::RangedI64ValueParser;
use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Config, Homing, HomingPhase, HomingProgress};
use serde_json::json;

use super::motion::{AxisTarget, check_limits, counts};
use crate::board::{AxisWord, Board, BoardError, Needs, SlaveList, Units, position};

const WHAT: &str = "home";
/// The object 0x6098, "homing method".
const METHOD: ObjectAddress = ObjectAddress::new(0x6098, 0);
/// \[OURS] Timeout for the homing of one axis, after which it is aborted with ABORT_HOME. `--timeout` replaces it.
const LIMIT: Duration = Duration::from_secs(60);

/// Home axes, one after the other
///
/// Values that are not given are those of the machine file, or else stay as the drive has them. Ctrl-C ends homing with
/// ABORT_HOME.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk home 1 --link 'sim:?slaves=drive*2' --up
  ecmsk home 1,2 --method 1 --speed-switch 20000 --speed-zero 2000 --link 'sim:?slaves=drive*2' --up")]
pub struct Args {
    /// The axes, by the numbers of their slaves or by their names in the machine file, e.g. 1,2 or all
    #[arg(value_name = "AXES", required = true, value_parser = SlaveList::parse)]
    axes: Vec<SlaveList>,

    /// Homing method, 0x6098, e.g. 35: the present position is home [default: that of the machine file, else the drive's]
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = RangedI64ValueParser::<i8>::new().range(-128..=127))]
    method: Option<i8>,

    /// Speed while looking for the switch, 0x6099:1, in the drive's units
    #[arg(long, value_name = "N")]
    speed_switch: Option<u32>,

    /// Speed while looking for zero, 0x6099:2, in the drive's units
    #[arg(long, value_name = "N")]
    speed_zero: Option<u32>,

    /// Acceleration, 0x609A, in the drive's units
    #[arg(long, value_name = "N")]
    acceleration: Option<u32>,

    /// Home offset, 0x607C: whole counts, or units for an axis with a name or with --counts-per-unit, to the nearest count
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = position)]
    offset: Option<f64>,
}

impl Args {
    /// Checks the axes and the home offset before anything is sent.
    ///
    /// # Errors
    /// A slave does not exist or has no axis, or the offset is not possible for an axis. It may not be outside the
    /// range of positions or beyond the axis' limits in the machine file. Without a unit it must be a whole number.
    pub fn check(&self, network: &Config, units: Units<'_>) -> Result<(), BoardError> {
        SlaveList::axes(&self.axes, network, WHAT, units)?
            .iter()
            .try_for_each(|(slave, word)| self.offset_counts(*slave, word, units).map(|_| ()))
    }

    /// The home offset of an axis in counts; `None` without the option.
    fn offset_counts(&self, slave: u8, word: &AxisWord, units: Units<'_>) -> Result<Option<i32>, BoardError> {
        let Some(value) = self.offset else { return Ok(None) };
        let scale = units.scale(word, slave);
        let counts = counts(WHAT, &AxisTarget { slave, value, scale, is_named: word.is_name() }, units)?;
        check_limits(WHAT, units, slave, counts)?;
        Ok(Some(counts))
    }

    /// Homes the axes, one after the other.
    ///
    /// # Errors
    /// [`BoardError`] if a slave does not exist or has no axis, if an axis is not enabled or does not find its home in
    /// time, if the board does not answer, or if a signal stops the homing.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        let axes = SlaveList::axes(&self.axes, board.known_network(WHAT)?, WHAT, board.units())?;
        let slaves: Vec<u8> = axes.iter().map(|(slave, _)| *slave).collect();
        board.ready(WHAT, Needs::On(&slaves))?;
        axes.iter().try_for_each(|(slave, word)| self.home(board, *slave, word))
    }

    fn home(&self, board: &Board, slave: u8, word: &AxisWord) -> Result<(), BoardError> {
        let of_machine = board.units().axis(slave).map(|axis| axis.homing).unwrap_or_default();
        let method = match self.method.or(of_machine.method) {
            Some(method) => method,
            None => board.run_interruptible("reading the homing method", |ecm| ecm.sdo_read(slave, METHOD))?,
        };
        let label = board.label(slave);
        let homing = Homing {
            switch_speed: self.speed_switch.or(of_machine.speed_switch),
            zero_speed: self.speed_zero.or(of_machine.speed_zero),
            acceleration: self.acceleration.or(of_machine.acceleration),
            offset: self.offset_counts(slave, word, board.units())?.or(of_machine.offset_counts),
            limit: board.limit.unwrap_or(LIMIT),
            ..Homing::method(method)
        };
        board.forget_targets();
        let mut pace = board.reporter.pace();
        let mut seconds = 0.0;
        let (reporter, position_text) = (&board.reporter, board.position_text(slave));
        let abort = || {
            if let Err(error) = board.ecm.abort_homing() {
                reporter.note(format_args!("homing did not end: {error}"));
            }
        };
        let progress = |now: &HomingProgress| {
            seconds = now.elapsed.as_secs_f64();
            if pace.due(now.elapsed) {
                let phase = phase(now.phase);
                let counts = now.position;
                let at = position_text.of(counts).0;
                // An error of standard output is ignored here; it is reported when the result is printed.
                let _ = reporter.progress(format_args!("homing axis {label}: {phase}, at {at}, {seconds:.1} s"), || {
                    json!({"verb": WHAT, "axis": slave, "progress": phase, "position_counts": counts, "seconds": seconds})
                });
            }
        };
        board.run_stoppable("", |ecm| ecm.home(slave, &homing, progress), Some(&abort))?;
        let position = board.ecm.snapshot()?.position(slave).unwrap_or_default();
        let (text, units) = board.in_units(slave, position);
        let mut json =
            json!({"verb": WHAT, "axis": slave, "method": method, "position_counts": position, "seconds": seconds});
        if let Some(units) = units {
            json["position"] = units.into();
        }
        board.add_names(slave, &mut json);
        Ok(board.reporter.result(format_args!("axis {label}: home found (method {method}), at {text}"), &json)?)
    }
}

const fn phase(phase: HomingPhase) -> &'static str {
    match phase {
        HomingPhase::Preparing => "preparing",
        HomingPhase::Moving => "moving",
        HomingPhase::Restoring => "restoring",
    }
}
