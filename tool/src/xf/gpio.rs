//! `xf gpio`: shows and sets the chip's general-purpose inputs and outputs (GPIO).

use clap::Subcommand;
use ecmsk::xf::request::{
    AllPins, GpioExtGetIntFlag, GpioExtGetValue, GpioExtSetValue, GpioGetIntFlag, GpioGetValue, GpioMode, GpioPull,
    GpioSetMode, GpioSetModeExt, GpioSetValue, UpperPins,
};
use serde_json::json;

use super::error::unless_refused;
use super::session::{ChipArgs, Session};
use super::words::{chosen, word};
use super::{Shown, XfVerbError};
use crate::board::whole;
use crate::filter::parse_range;

/// Show or set the chip's general inputs and outputs
///
/// Without a verb the levels and the interrupt flags of all pins are shown. All pins are floating inputs at first. The
/// chip cannot report which pins are outputs. Debouncing and interrupts are set with `ecmsk xf raw`.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    args_conflicts_with_subcommands = true,
    after_help = "\
Examples:
  ecmsk xf gpio
  ecmsk xf gpio mode 0,4-7 output
  ecmsk xf gpio mode 3 input --pull up
  ecmsk xf gpio set 0x0010"
)]
pub struct Args {
    #[command(subcommand)]
    verb: Option<Verb>,

    #[command(flatten)]
    chip: ChipArgs,
}

#[derive(Subcommand)]
enum Verb {
    /// Make pins inputs or outputs
    Mode {
        /// Pins from 0 to 19: 3, 0,4-7
        #[arg(value_name = "PINS", value_parser = pins)]
        pins: u32,
        /// Mode of the pins
        #[arg(value_name = "input|output|open-drain|quasi-bidirectional", value_parser = mode)]
        mode: GpioMode,
        /// Pull resistor of the pins
        #[arg(long, value_name = "none|up|down", default_value = "none", value_parser = pull)]
        pull: GpioPull,
        #[command(flatten)]
        chip: ChipArgs,
    },
    /// Set the levels of all outputs at once: bit k is GPIO k
    Set {
        /// Levels as bits, decimal or with 0x; bits 16 to 19 need firmware 9 or newer
        #[arg(value_name = "LEVELS", value_parser = levels)]
        levels: AllPins,
        #[command(flatten)]
        chip: ChipArgs,
    },
}

/// The mask of pins 0 to 15, which every firmware version has.
const LOWER: u32 = 0xFFFF;

fn mode(text: &str) -> Result<GpioMode, String> {
    chosen(text, GpioMode::NAMES).and_then(|code| GpioMode::from_code(code as u8).ok_or_else(String::new))
}

fn pull(text: &str) -> Result<GpioPull, String> {
    chosen(text, GpioPull::NAMES).and_then(|code| GpioPull::from_code(code as u8).ok_or_else(String::new))
}

fn levels(text: &str) -> Result<AllPins, String> {
    let levels = whole(text).and_then(|levels| u32::try_from(levels).ok()).and_then(AllPins::new);
    levels.ok_or_else(|| "allowed: 0 to 0xFFFFF".into())
}

/// Parses pins such as `3` or `0,4-7` to a mask with one bit per pin.
fn pins(text: &str) -> Result<u32, String> {
    let wrong = || "allowed: pins from 0 to 19, e.g. 3 or 0,4-7".to_owned();
    text.split(',').try_fold(0, |mask, part| {
        let (first, last) = parse_range(part, 0..=19).ok_or_else(wrong)?;
        Ok((first..=last).fold(mask, |mask, pin| mask | 1 << pin))
    })
}

impl Args {
    pub const fn chip(&self) -> &ChipArgs {
        match &self.verb {
            None => &self.chip,
            Some(Verb::Mode { chip, .. } | Verb::Set { chip, .. }) => chip,
        }
    }

    /// Shows the pins, changes their mode, or sets the outputs.
    ///
    /// # Errors
    /// [`XfVerbError`] if the chip does not answer or refuses a command, for example for pins that its firmware does not
    /// have.
    pub fn run(&self, session: &mut Session) -> Result<Vec<Shown>, XfVerbError> {
        match &self.verb {
            None => show(session),
            Some(Verb::Mode { pins, mode, pull, .. }) => set_mode(session, *pins, *mode, *pull),
            Some(Verb::Set { levels, .. }) => set_levels(session, *levels),
        }
    }
}

fn show(session: &mut Session) -> Result<Vec<Shown>, XfVerbError> {
    // Firmware versions before 9 have 16 pins and refuse the command for all 20 pins.
    let (levels, pins) = match unless_refused(session.xf.run(&GpioExtGetValue))? {
        Some(levels) => (levels, 20),
        None => (session.xf.run(&GpioGetValue)?.into(), 16),
    };
    let flags = match unless_refused(session.xf.run(&GpioExtGetIntFlag))? {
        Some(flags) => flags,
        None => session.xf.run(&GpioGetIntFlag)?.into(),
    };
    let high: Vec<u8> = (0..pins).filter(|pin| levels >> pin & 1 == 1).collect();
    let raised: Vec<u8> = (0..pins).filter(|pin| flags >> pin & 1 == 1).collect();
    let list = |pins: &[u8]| match pins {
        [] => "none".to_owned(),
        pins => pins.iter().map(u8::to_string).collect::<Vec<_>>().join(", "),
    };
    let text = format!(
        "levels      0x{levels:05X} of GPIO 0 to {}; high: {}\ninterrupts  0x{flags:05X}; raised: {}",
        pins - 1,
        list(&high),
        list(&raised)
    );
    let json = json!({
        "verb": "xf gpio", "pins": pins, "levels": levels, "high": high, "interrupts": flags, "raised": raised,
    });
    Ok(vec![(text, json)])
}

fn set_mode(session: &mut Session, pins: u32, mode: GpioMode, pull: GpioPull) -> Result<Vec<Shown>, XfVerbError> {
    if pins & LOWER != 0 {
        session.xf.run(&GpioSetMode { pins: (pins & LOWER) as u16, mode, pull })?;
    }
    if let Some(upper) = UpperPins::new((pins >> 16) as u8).filter(|upper| upper.get() != 0) {
        session.xf.run(&GpioSetModeExt { pins: upper, mode, pull })?;
    }
    let (mode, pull) = (word(&format!("{mode:?}")), word(&format!("{pull:?}")));
    let json = json!({"verb": "xf gpio mode", "pins": pins, "mode": mode, "pull": pull});
    Ok(vec![(format!("GPIO 0x{pins:05X}: {mode}, pull {pull}"), json)])
}

fn set_levels(session: &mut Session, levels: AllPins) -> Result<Vec<Shown>, XfVerbError> {
    // All 20 pins are set at once if the firmware can do this. The other command would silently leave pins 16 to 19
    // unchanged.
    let all = unless_refused(session.xf.run(&GpioExtSetValue { values: levels }))?;
    match (all, u16::try_from(levels.get())) {
        (Some(()), _) => {}
        (None, Ok(values)) => session.xf.run(&GpioSetValue { values })?,
        (None, Err(_)) => {
            return Err(XfVerbError::Refused {
                what: "xf gpio set",
                why: "the chip's firmware has GPIO 0 to 15 alone".into(),
                next: "give levels up to 0xFFFF".into(),
            });
        }
    }
    let levels = levels.get();
    Ok(vec![(format!("levels 0x{levels:05X}"), json!({"verb": "xf gpio set", "levels": levels}))])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// XF-18.9 Pins are given as numbers and ranges.
    #[test]
    fn pins_are_numbers_and_ranges() {
        assert_eq!((pins("3"), pins("0,4-7"), pins("16-19")), (Ok(8), Ok(0xF1), Ok(0xF_0000)));
        for wrong in ["", "20", "7-4", "a", "1,", "-1", "1-"] {
            assert!(pins(wrong).is_err(), "{wrong}");
        }
    }
}
