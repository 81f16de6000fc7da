//! `xf dac`: sets the chip's analog output.

use ecmsk::xf::request::{Analog, DacClose, DacOpen, DacSetData, DacTrigger};
use serde_json::json;

use super::session::{ChipArgs, Session};
use super::words::volts;
use super::{Shown, XfVerbError};

/// The request to the DAC: a value to output, or to close the DAC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    Value(Analog),
    Off,
}

/// Output a voltage, or close the analog output
///
/// The DAC is opened so that it outputs each value at once, and stays open.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk xf dac 1.65V
  ecmsk xf dac 4095
  ecmsk xf dac off")]
pub struct Args {
    /// 0 to 4095 for 0 V to 3.3 V, or off
    #[arg(value_name = "VALUE|off", value_parser = output)]
    pub output: Output,

    #[command(flatten)]
    pub chip: ChipArgs,
}

fn output(text: &str) -> Result<Output, String> {
    if text.eq_ignore_ascii_case("off") {
        return Ok(Output::Off);
    }
    let value = match text.strip_suffix(['V', 'v']) {
        Some(volts) => {
            let volts = volts.trim().parse::<f64>().ok().filter(|volts| (0.0..=3.3).contains(volts));
            volts.map(|volts| (volts / 3.3 * 4095.0).round() as u32)
        }
        None => crate::board::whole(text).and_then(|value| u32::try_from(value).ok()),
    };
    value.and_then(Analog::new).map(Output::Value).ok_or_else(|| "allowed: 0 to 4095 for 0 V to 3.3 V, or off".into())
}

/// Sets the analog output, or closes the DAC.
///
/// # Errors
/// [`XfVerbError`] if the chip does not answer or refuses a command.
pub fn dac(session: &mut Session, output: Output) -> Result<Vec<Shown>, XfVerbError> {
    let Output::Value(value) = output else {
        session.xf.run(&DacClose)?;
        return Ok(vec![("off".to_owned(), json!({"verb": "xf dac", "value": null, "volts": null}))]);
    };
    session.xf.run(&DacOpen { trigger: DacTrigger::SetData })?;
    session.xf.run(&DacSetData { value })?;
    let value = value.get();
    let json = json!({"verb": "xf dac", "value": value, "volts": volts(value)});
    Ok(vec![(format!("{value} of 4095 ({:.3} V)", volts(value)), json)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// XF-18.9 A value of the DAC is a number of 12 bits or a voltage.
    #[test]
    fn values_are_numbers_or_voltages() {
        let value = |n| Ok(Output::Value(Analog::new(n).expect("12 bits")));
        assert_eq!(
            (output("4095"), output("3.3V"), output("0v"), output("0x10")),
            (value(4095), value(4095), value(0), value(16))
        );
        assert_eq!((output("1.65 V"), output("OFF")), (value(2048), Ok(Output::Off)));
        for wrong in ["", "4096", "-1", "3.4V", "V", "nanV", "on"] {
            assert!(output(wrong).is_err(), "{wrong}");
        }
    }
}
