//! The text of a new machine file: what the network shows, and comments about what the user has to add.

use std::fmt::Write as _;

use ecmsk::link::slaves::SlaveModel;
use ecmsk::link::uri::LinkUri;

use super::network::FoundSlave;

/// The text of a new machine file, with the link and the slaves that were found on it.
pub fn text(link: &LinkUri, slaves: &[FoundSlave]) -> String {
    let link = link.to_string().replace('\\', "\\\\").replace('"', "\\\"");
    let kinds = SlaveModel::ALL.map(SlaveModel::name).join(", ");
    let mut text = format!(
        "# A machine file of ecmsk, see docs/MACHINE.md. `ecmsk machine check` checks it, with --link against the network;\n\
         # `ecmsk machine schema` prints the schema for an editor.\n\
         format = 1\n\
         link = \"{link}\"\n\
         # cycle_us = 1000\n\n\
         # The slaves in the order of the cable, and which devices they have to be. kind: {kinds},\n\
         # or none for one that is not used. mode = \"csv\" or \"cst\" if its axis does not run in CSP.\n"
    );
    for (number, slave) in (1..).zip(slaves) {
        // Writing to a String does not fail.
        let _ = text.write_str(&of_slave(number, slave));
    }
    text.push_str(
        "\n# The axes by their names, instead of axis1 for example X. What an axis may have:\n\
         #   unit = \"mm\"             mm, um, m, in, deg, rad, turn or counts\n\
         #   per = \"5/131072\"        units per count: here 131072 counts are 5 mm; or a number, negative for the other direction\n\
         #   min = -10, max = 250    where its targets have to be, units\n\
         #   max_velocity = 100, max_acceleration = 1000    units/s, units/s^2\n\
         #   homing = { method = 35, speed_switch = 20000, speed_zero = 2000, acceleration = 100000, offset = 0 }\n\
         [axes]\n",
    );
    let is_axis = |slave: &FoundSlave| slave.kind.is_some_and(|kind| kind.axes() > 0);
    for (number, _) in (1_u8..).zip(slaves).filter(|(_, slave)| is_axis(slave)) {
        let _ = writeln!(text, "axis{number} = {{ slave = {number} }}");
    }
    text.push_str(
        "\n# Inputs and outputs by their names, bits 0 to 15 of an io slave:\n\
         # [inputs]\n\
         # door_closed = { slave = 3, bit = 0 }\n\
         # [outputs]\n\
         # gripper = { slave = 3, bit = 4 }\n\n\
         # What error codes mean in words, by the drive's manual:\n\
         # [[alarms]]\n\
         # vendor = 0x0000066F\n\
         # texts = { 0x7305 = \"encoder cable\" }\n",
    );
    text
}

fn of_slave(number: usize, slave: &FoundSlave) -> String {
    let name: String = slave.name.chars().filter(|letter| !letter.is_control()).collect();
    let kind = slave.kind.map_or("none", SlaveModel::name);
    let unknown = if slave.kind.is_none() { "  # its device type says no kind: correct it" } else { "" };
    format!(
        "\n[slaves.{number}]{}\nkind = \"{kind}\"{unknown}\nvendor = 0x{:08X}\nproduct = 0x{:08X}\nrevision = 0x{:08X}\n",
        if name.is_empty() { String::new() } else { format!("  # {name}") },
        slave.vendor,
        slave.product,
        slave.revision,
    )
}

#[cfg(test)]
mod tests {
    use ecmsk::machine_file::MachineFile;

    use super::*;

    /// A new file is valid, whatever name a slave has. It is also valid if its commented examples are made active.
    #[test]
    fn a_new_file_is_a_machine_file() {
        let slave = |name: &str, kind| FoundSlave {
            vendor: 0x66F,
            product: u32::MAX,
            revision: 0,
            name: name.to_owned(),
            kind,
        };
        let slaves = [
            slave("A \"drive\"\nformat = 2", Some(SlaveModel::Drive)),
            slave("", None),
            slave("io", Some(SlaveModel::Io)),
        ];
        let link = LinkUri::parse("sim:?slaves=drive,io*2&script=C:\\x").unwrap();
        let written = text(&link, &slaves);
        let machine = MachineFile::parse("new", &written).unwrap();
        assert_eq!((machine.slaves.len(), machine.axes.len(), machine.link), (3, 1, Some(link)));
        assert_eq!(machine.slaves[0].expected.product, Some(u32::MAX));
        let lines = written.lines().skip_while(|line| !line.starts_with("# Inputs"));
        let rest: Vec<&str> =
            lines.filter(|line| !line.ends_with(':')).map(|line| line.trim_start_matches("# ")).collect();
        let commented = written.split("\n# Inputs").next().unwrap().to_owned() + "\n" + &rest.join("\n");
        let machine = MachineFile::parse("new", &commented).unwrap();
        assert_eq!((machine.inputs.len(), machine.outputs.len()), (1, 1));
        assert_eq!(machine.alarm_text(1, 0x7305), Some("encoder cable"));
    }
}
