//! `xf adc`: runs a conversion of the chip's analog input.

use std::time::Duration;

use ecmsk::xf::request::{
    AdcClose, AdcConfigSampleModule, AdcGetConvData, AdcGetDataValidFlag, AdcMode, AdcOpen, AdcStartConv,
};
use serde_json::json;

use super::session::{ChipArgs, Session};
use super::words::volts;
use super::{Shown, XfVerbError};

/// The timeout of a conversion. \[OURS]
const CONVERSION_MAX: Duration = Duration::from_millis(100);
/// The interval at which the chip is polled for the end of the conversion. \[OURS]
const PAUSE: Duration = Duration::from_millis(1);

/// Convert the analog input once
///
/// The ADC is opened for the conversion and closed again.
#[derive(clap::Args)]
pub struct Args {
    /// Measure the difference of the chip's two analog inputs, instead of one against ground
    #[arg(long)]
    pub differential: bool,

    #[command(flatten)]
    pub chip: ChipArgs,
}

/// Converts the analog input once. The ADC is closed even if the conversion fails.
///
/// # Errors
/// [`XfVerbError`] if the chip does not answer or refuses a command, or if the conversion takes too long.
pub fn adc(session: &mut Session, differential: bool) -> Result<Vec<Shown>, XfVerbError> {
    let mode = if differential { AdcMode::Differential } else { AdcMode::SingleEnded };
    session.xf.run(&AdcOpen { mode })?;
    let value = convert(session);
    session.xf.run(&AdcClose)?;
    let value = value?;
    // No manual describes how to convert a differential value to volts.
    let volts = (!differential).then(|| volts(value));
    let text = volts.map_or(String::new(), |volts| format!(" ({volts:.3} V)"));
    let json = json!({"verb": "xf adc", "value": value, "volts": volts, "differential": differential});
    Ok(vec![(format!("{value} of 4095{text}"), json)])
}

fn convert(session: &mut Session) -> Result<u32, XfVerbError> {
    session.xf.run(&AdcConfigSampleModule)?;
    session.xf.run(&AdcStartConv)?;
    let mut waited = Duration::ZERO;
    while session.xf.run(&AdcGetDataValidFlag)? == 0 {
        if waited >= CONVERSION_MAX {
            return Err(XfVerbError::Refused {
                what: "xf adc",
                why: format!("no value was there after {} ms", waited.as_millis()),
                next: "check the reference voltage and the supply of the ADC".into(),
            });
        }
        session.xf.pass(PAUSE)?;
        waited += PAUSE;
    }
    Ok(session.xf.run(&AdcGetConvData)?.get())
}
