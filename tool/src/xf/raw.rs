//! `xf raw`: calls any function of the chip. The request is given field by field, and the answer is shown field by
//! field.
//!
//! - `raw.rs`: the verb: finds the function and runs it
//! - `raw/fields_in.rs`: converts fields of the command line to a request
//! - `raw/fields_out.rs`: converts the answer to fields

mod fields_in;
mod fields_out;

use std::time::Duration;

use ecmsk::link::chip::ChipLink;
use ecmsk::xf::fields::{Draft, FUNCTIONS, FunctionFields, function};
use ecmsk::xf::host::HostError;
use ecmsk::xf::response::Returned;
use ecmsk::xf::{CommandCode, DataSize, Request};
use ecmsk::xf_api::{Xf, XfError};

use super::session::{ChipArgs, Session};
use super::{Shown, XfVerbError, on_chip};
use fields_in::Assignment;

/// The time within which the chip must have been reset after WARM_RESET; the vendor's driver waits 1 s (XF EN 1517,
/// OBS).
const RESET_MAX: Duration = Duration::from_secs(3);
/// The interval at which the reset is checked. \[OURS]
const PAUSE: Duration = Duration::from_millis(10);
/// The length of the longest data segment of a packet to or from the chip, in bytes.
const SEGMENT: usize = DataSize::MAX.bytes();

/// Run any function of the chip, and show the fields of its answer
///
/// NAME is the name in the manuals, with or without ECM_CMD_ and ECAT_, or the name of the Rust type; `ecmsk xf
/// commands` lists both. A name without fields prints the fields of the function. Only the request is sent: a network
/// that is not up is not brought up. CRC_TYPE_SET and SPI_RECONFIG_OP are reserved for the driver.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk xf raw FW_VERSION_GET
  ecmsk xf raw ECAT_SLV_INFO_GET slave=0 item=name
  ecmsk xf raw StateSet slaves=all state=preop
  ecmsk xf raw InterruptSetEnable polarity=int0-high sources=crc,rx-fifo-low
  ecmsk xf raw FOE_FUNC_REQ operation=write-flash start=0x100 data=0102FF")]
pub struct Args {
    /// The function to run, by its name in the manuals or in Rust
    #[arg(value_name = "NAME", value_parser = find)]
    function: Function,

    /// The fields of the request, by the names that `ecmsk xf raw NAME` prints
    #[arg(value_name = "FIELD=VALUE", value_parser = Assignment::parse)]
    fields: Vec<Assignment>,

    #[command(flatten)]
    chip: ChipArgs,
}

/// A function of the chip, as a row of the table of all functions.
#[derive(Clone, Copy)]
struct Function(&'static FunctionFields);

/// Finds a function by its name in the manuals or by its Rust type.
///
/// # Errors
/// There is no such function, or several functions have this name in the manuals.
fn find(name: &str) -> Result<Function, String> {
    let found: Vec<_> = function(name).collect();
    match found[..] {
        [one] => Ok(Function(one)),
        [] => {
            let near = near(name);
            let near = if near.is_empty() { String::new() } else { format!("did you mean {}? ", near.join(", ")) };
            Err(format!("{near}no function has that name; `ecmsk xf commands` lists all"))
        }
        _ => {
            let types: Vec<_> = found.iter().map(|row| format!("{} ({})", row.type_name, row.what)).collect();
            Err(format!("the manuals give that name to several functions; name one by its type: {}", types.join("; ")))
        }
    }
}

/// The names of the functions that are most similar to `name`, at most three.
fn near(name: &str) -> Vec<&'static str> {
    let manuals = FUNCTIONS.iter().map(|row| row.name().trim_start_matches("ECM_").trim_start_matches("CMD_"));
    let types = FUNCTIONS.iter().map(|row| row.type_name);
    let likeness = |known: &str| strsim::jaro_winkler(&known.to_ascii_lowercase(), &name.to_ascii_lowercase());
    let mut near: Vec<_> = types.chain(manuals).map(|known| (likeness(known), known)).collect();
    near.retain(|(likeness, _)| *likeness > 0.85);
    near.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    near.into_iter().take(3).map(|(_, known)| known).collect()
}

/// Sends one request to the chip and prints its answer.
///
/// # Errors
/// [`XfVerbError`] if the arguments do not form a valid request, or the chip cannot be opened or does not answer.
pub fn run(args: &Args) -> Result<(), XfVerbError> {
    // The request is checked first, so that a wrong request is reported before the chip is opened.
    let mut data = [0; SEGMENT];
    let request_draft = draft(args.function.0, &args.fields, &mut data)?;
    if let Ok(Request::CrcTypeSet(_) | Request::SpiReconfig(_)) = request_draft.request() {
        return Err(XfVerbError::WrongRequest {
            what: format!("xf raw {}", args.function.0.type_name),
            why: "check word and n are the driver's own, which sets CRC-32 at the start".into(),
            next: "give another n in the link, e.g. use_n=512, see `ecmsk link help`".into(),
        });
    }
    on_chip(&args.chip, |session| raw(session, args.function.0, &args.fields))
}

/// Makes a request from the fields. Checks that the function has these fields and that their values are valid.
fn draft<'b>(
    row: &'static FunctionFields,
    fields: &[Assignment],
    data: &'b mut [u8],
) -> Result<Draft<'b>, XfVerbError> {
    let wrong = |why| XfVerbError::WrongRequest {
        what: format!("xf raw {}", row.type_name),
        why,
        next: format!("its fields: {}; see `ecmsk xf raw --help`", fields_in::described(row)),
    };
    let mut draft = Draft::new(row, data);
    fields_in::fill(&mut draft, row, fields).map_err(wrong)?;
    Ok(draft)
}

/// Sends the request, and returns the fields of the answer.
///
/// # Errors
/// [`XfVerbError`] if a field is unknown or its value is invalid, or if the chip does not answer or refuses the
/// request.
fn raw(session: &mut Session, row: &'static FunctionFields, fields: &[Assignment]) -> Result<Vec<Shown>, XfVerbError> {
    let mut data = [0; SEGMENT];
    let draft = draft(row, fields, &mut data)?;
    let mut answer = [0; SEGMENT];
    let resets = session.xf.host().counters().chip_resets;
    let returned = match run_draft(&mut session.xf, &draft, &mut answer) {
        Err(XfError::Chip(HostError::NoAnswer { code: CommandCode::WarmReset, .. } | HostError::ChipReset)) => {
            expect_reset(session, resets)?;
            Returned::NONE
        }
        done => done?,
    };
    Ok(vec![fields_out::shown(row, returned, &answer)])
}

/// Waits until the driver has detected the reset of the chip, because WARM_RESET has no answer. `before` is the number
/// of resets that the driver had counted before the request. It is an error if there is no reset within [`RESET_MAX`].
fn expect_reset(session: &mut Session, before: u64) -> Result<(), XfVerbError> {
    let mut waited = Duration::ZERO;
    while session.xf.host().counters().chip_resets == before {
        if waited >= RESET_MAX {
            return Err(XfVerbError::Refused {
                what: "xf raw",
                why: format!("the chip was not reset after {} ms", waited.as_millis()),
                next: "see with `ecmsk xf info` how it is".into(),
            });
        }
        session.xf.pass(PAUSE)?;
        waited += PAUSE;
    }
    session.reporter.note("the chip was reset: its network has to be initialised anew");
    Ok(())
}

fn run_draft<L: ChipLink>(xf: &mut Xf<L>, draft: &Draft<'_>, answer: &mut [u8]) -> Result<Returned, XfError> {
    let request = draft.request()?;
    xf.run_request(&request, answer)
}

#[cfg(test)]
mod tests;
