//! `xf pdo`: shows which bits of the process image each PDO entry of the slaves has, and the present inputs.

use std::fmt::Write;

use ecmsk::xf::request::{PdoData, PdoOperation};
use ecmsk::xf::{DataSize, EtherCatState};
use ecmsk::xf_api::{Layout, MappedField, SlaveLayout, XfError};
use serde_json::{Value, json};

use super::session::{ChipArgs, Session};
use super::words::slave_number;
use super::{Shown, XfVerbError};
use crate::step::object::KNOWN;

/// Show the layout of each slave's process data, and the present inputs
///
/// The PDO mapping of the slaves is read by SDOs. A network that is not up is initialised and brought to SafeOP, where
/// inputs begin; in PreOP only the layout is shown. The FIFOs are not used: a program that reads them loses nothing.
#[derive(clap::Args)]
pub struct Args {
    /// Only this slave, from 0
    #[arg(value_name = "SLAVE", value_parser = slave_number)]
    pub slave: Option<u8>,

    #[command(flatten)]
    pub chip: ChipArgs,
}

/// Shows the process data of one slave or of all slaves, with the values of the inputs in SafeOP and OP.
///
/// # Errors
/// [`XfVerbError`] if the slave does not exist, the network is below PreOP, or the chip or a slave does not answer.
pub fn pdo(session: &mut Session, slave: Option<u8>) -> Result<Vec<Shown>, XfVerbError> {
    let found = session.join_or_start(EtherCatState::SafeOp)?;
    session.expect_mailboxes("xf pdo")?;
    if let Some(slave) = slave.filter(|slave| *slave >= found) {
        return Err(XfError::NoSuchSlave { slave, found }.into());
    }
    let layout = session.xf.layout()?;
    let inputs = match session.state() {
        Some(EtherCatState::PreOp) => {
            session.reporter.note("the network is in PreOP: there are inputs from SafeOP on");
            None
        }
        _ if layout.inputs.iter().all(|slave| slave.bytes == 0) => None,
        _ => Some(read_inputs(session)?),
    };
    let shown = |number: &u8| slave.is_none_or(|slave| slave == *number);
    Ok((0..found).filter(shown).map(|slave| show(&layout, inputs.as_deref(), slave)).collect())
}

/// Reads the inputs of all slaves with a single request. `Xf::process_data` is not used, because it also changes the
/// packet size of the chip.
fn read_inputs(session: &mut Session) -> Result<Vec<u8>, XfVerbError> {
    let read = PdoData { operation: PdoOperation::READ | PdoOperation::VALID, data: &[] };
    let mut data = vec![0; DataSize::MAX.bytes()];
    let returned = session.xf.run_request(&read.into(), &mut data)?;
    data.truncate(returned.len.into());
    Ok(data)
}

fn show(layout: &Layout, inputs: Option<&[u8]>, slave: u8) -> Shown {
    let mut text = String::new();
    let mut json = json!({"verb": "xf pdo", "slave": slave});
    let at = usize::from(slave);
    let directions = [("outputs", &layout.outputs[at], None), ("inputs", &layout.inputs[at], inputs)];
    for (name, part, image) in directions {
        let bytes = part.bytes;
        // Writing to a String does not fail.
        let _ = match bytes {
            0 => writeln!(text, "slave {slave} {name}: none"),
            _ => writeln!(text, "slave {slave} {name}: {bytes} bytes from byte {} on", part.at),
        };
        json[name] = json!({"at": part.at, "bytes": bytes, "objects": objects(part, image, &mut text)});
    }
    (text.trim_end().to_owned(), json)
}

fn objects(part: &SlaveLayout, image: Option<&[u8]>, text: &mut String) -> Vec<Value> {
    let mut list = Vec::new();
    for field in &part.fields {
        let (byte, bit) = (part.at + field.at / 8, field.at % 8);
        let known = KNOWN.iter().find(|(_, index, sub, _)| (*index, *sub) == (field.object.index, field.object.sub));
        let name = match (field.object.index, known) {
            (0, _) => "gap",
            (_, Some((name, ..))) => name,
            (_, None) => "",
        };
        let raw = image.and_then(|image| bits(image, part.at * 8 + field.at, field.bits)).filter(|_| name != "gap");
        let value = raw.map(|raw| match known {
            Some((.., of)) if of.bits() == u32::from(field.bits) => of.number(raw as u32),
            _ => raw as i64,
        });
        let shown = raw.zip(value).map_or(String::new(), |(raw, value)| {
            format!("  = {value} (0x{raw:0digits$X})", digits = usize::from(field.bits).div_ceil(4))
        });
        let object = field.object.to_string();
        let line = format!("  byte {byte:>4}.{bit}  {:>3} bits  {object:<9}  {name:<16}{shown}", field.bits);
        let _ = writeln!(text, "{}", line.trim_end());
        list.push(object_json(field, byte, bit, name, value));
    }
    list
}

fn object_json(field: &MappedField, byte: usize, bit: usize, name: &str, value: Option<i64>) -> Value {
    json!({
        "index": field.object.index, "sub": field.object.sub, "bits": field.bits, "byte": byte, "bit": bit,
        "name": (!name.is_empty()).then_some(name), "value": value,
    })
}

/// Up to 64 bits of a little-endian process image as a number; `None` if the image is too short or `width` is above 64.
fn bits(image: &[u8], at: usize, width: u8) -> Option<u64> {
    let all = (0..usize::from(width)).map(|n| {
        let at = at + n;
        image.get(at / 8).map(|byte| u64::from(byte >> (at % 8) & 1) << n)
    });
    if width > 64 { None } else { all.sum() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// XF-18.8 Objects are read from the process image bit by bit, across bytes and up to 64 bits.
    #[test]
    fn objects_are_bits_of_the_image() {
        let image = [0x34, 0x12, 0xF0, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x7F];
        assert_eq!(bits(&image, 0, 16), Some(0x1234));
        assert_eq!((bits(&image, 4, 8), bits(&image, 2, 1), bits(&image, 3, 1)), (Some(0x23), Some(1), Some(0)));
        assert_eq!(bits(&image, 16, 64), Some(0x7FFF_FFFF_FFFF_FFF0));
        assert_eq!((bits(&image, 73, 8), bits(&image, 0, 65)), (None, None));
    }
}
