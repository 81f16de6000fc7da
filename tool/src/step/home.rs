//! `home`: finds the home of axes, one after the other.

use std::time::Duration;

use clap::builder::RangedI64ValueParser;
use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Config, Homing, HomingPhase, HomingProgress};
use serde_json::json;

use super::motion::{Target, counts};
use crate::board::{Board, BoardError, Needs, SlaveList, find_axis, position};

const WHAT: &str = "home";
/// The object 0x6098, "homing method".
const METHOD: ObjectAddress = ObjectAddress::new(0x6098, 0);
/// \[OURS] Timeout for the homing of one axis.
const LIMIT: Duration = Duration::from_secs(60);

/// Home axes, one after the other
///
/// Values that are not given stay as the drive has them. Ctrl-C ends homing with ABORT_HOME.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk home 1 --link 'sim:?slaves=drive*2' --up
  ecmsk home 1,2 --method 1 --speed-switch 20000 --speed-zero 2000 --link 'sim:?slaves=drive*2' --up")]
pub struct Args {
    /// The axes, by the numbers of their slaves, e.g. 1,2 or all
    #[arg(value_name = "AXES", required = true, value_parser = SlaveList::parse)]
    axes: Vec<SlaveList>,

    /// Homing method, 0x6098, e.g. 35: the present position is home [default: as the drive has it]
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

    /// Home offset, 0x607C: whole counts, or units with --counts-per-unit, to the nearest count
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = position)]
    offset: Option<f64>,
}

impl Args {
    /// # Errors
    /// A slave does not exist or has no axis, or the offset does not fit into a position.
    pub fn check(&self, network: &Config) -> Result<(), BoardError> {
        for slave in SlaveList::axes(&self.axes, network, WHAT)? {
            if let Some(value) = self.offset {
                counts(WHAT, &Target { slave, value }, find_axis(network, WHAT, slave)?.scale)?;
            }
        }
        Ok(())
    }

    /// # Errors
    /// [`BoardError`]
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        let axes = SlaveList::axes(&self.axes, board.known_network(WHAT)?, WHAT)?;
        board.ready(WHAT, Needs::On(&axes))?;
        axes.into_iter().try_for_each(|slave| self.home(board, slave))
    }

    fn home(&self, board: &Board, slave: u8) -> Result<(), BoardError> {
        let method = match self.method {
            Some(method) => method,
            None => board.run_interruptible("reading the homing method", |ecm| ecm.sdo_read(slave, METHOD))?,
        };
        let offset = self.offset.map(|value| counts(WHAT, &Target { slave, value }, board.axis(WHAT, slave)?.scale));
        let offset = offset.transpose()?;
        let homing = Homing {
            switch_speed: self.speed_switch,
            zero_speed: self.speed_zero,
            acceleration: self.acceleration,
            offset,
            limit: board.limit.unwrap_or(LIMIT),
            ..Homing::method(method)
        };
        board.forget_targets();
        let mut pace = board.reporter.pace();
        let mut seconds = 0.0;
        let reporter = &board.reporter;
        let abort = || {
            if let Err(error) = board.ecm.abort_homing() {
                reporter.note(format_args!("homing did not end: {error}"));
            }
        };
        let progress = |now: &HomingProgress| {
            seconds = now.elapsed.as_secs_f64();
            if pace.due(now.elapsed) {
                let phase = phase(now.phase);
                let at = now.position;
                // An error of standard output is reported with the result.
                let _ = reporter.progress(format_args!("homing axis {slave}: {phase}, at {at}, {seconds:.1} s"), || {
                    json!({"verb": WHAT, "axis": slave, "progress": phase, "position_counts": at, "seconds": seconds})
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
        Ok(board.reporter.result(format_args!("axis {slave}: home found (method {method}), at {text}"), &json)?)
    }
}

const fn phase(phase: HomingPhase) -> &'static str {
    match phase {
        HomingPhase::Preparing => "preparing",
        HomingPhase::Moving => "moving",
        HomingPhase::Restoring => "restoring",
    }
}
