//! `bus scan`: shows the slaves of a network as a tree of cables.

use std::fmt::Write as _;

use ecmsk::bus::port_errors::{self, PortErrors, SlaveErrors};
use ecmsk::bus::{BusError, FoundSlave, Network};
use ecmsk::ethercat::registers::AlStatusRegister;
use ecmsk::ethercat::sii::MailboxProtocols;
use serde_json::{Value, json};

use super::words::{behind, name, port_kind, ports, state_name, state_text};
use super::{BusVerbError, NetworkArgs, Session};

/// List the slaves as a tree: identity, states, and the ports with their connections and error counters
///
/// All slaves are in Init afterwards. The list shows the state that each slave had before, with its AL status in words.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk bus scan --link nic:eth1
  ecmsk bus scan --link 'sim:?slaves=drive*2,io' --json | jq -r .name")]
pub struct Args {
    #[command(flatten)]
    network: NetworkArgs,
}

/// Finds the slaves and prints them as a tree, or as JSON with `--json`.
///
/// # Errors
/// [`BusVerbError`] if the network does not open, if no slave answers, or if standard output cannot be written to.
pub fn run(args: &Args) -> Result<(), BusVerbError> {
    show(args.network.open()?)
}

/// Shows the slaves of an open network as a tree of cables, with the error counters of their ports.
///
/// # Errors
/// [`BusVerbError`] if the counters cannot be read, or standard output cannot be written to.
pub fn show(session: Session) -> Result<(), BusVerbError> {
    let Session { mut network, slaves, reporter } = session;
    if !are_ports_known(&slaves) {
        reporter.note("the ports of the slaves are not known: the chip sends no datagrams for others");
    }
    let (tree, lines) = shown(&mut *network, &slaves)?;
    reporter.results(tree.trim_end(), &lines)?;
    Ok(())
}

fn are_ports_known(slaves: &[FoundSlave]) -> bool {
    slaves.iter().any(|slave| slave.port_types != 0)
}

/// The slaves of a scan with the error counters of their ports: as a tree, and as JSON.
///
/// # Errors
/// The counters cannot be read.
pub fn shown(network: &mut dyn Network, slaves: &[FoundSlave]) -> Result<(String, Vec<Value>), BusError> {
    let errors = if are_ports_known(slaves) {
        port_errors::read(network, slaves)?
    } else {
        slaves.iter().map(|slave| SlaveErrors { slave: slave.slave, ..SlaveErrors::default() }).collect()
    };
    let in_ring = network.ring().and_then(|_| slaves.last()).map(|last| last.slave);
    let lines = slaves.iter().zip(&errors).map(|(slave, errors)| line(slaves, slave, errors)).collect();
    Ok((text(slaves, &errors, in_ring), lines))
}

/// The slaves as a tree in text form, as `bus scan` prints it. If the slaves form a ring, `in_ring` is the slave whose
/// cable leads to the second network card.
fn text(slaves: &[FoundSlave], errors: &[SlaveErrors], in_ring: Option<u8>) -> String {
    let mut tree = Tree { slaves, errors, in_ring, text: "master\n".to_owned() };
    tree.put(0, "");
    tree.text
}

/// Formats the slaves as a tree.
struct Tree<'a> {
    slaves: &'a [FoundSlave],
    errors: &'a [SlaveErrors],
    /// The slave whose cable leads to the second network card, if the slaves form a ring.
    in_ring: Option<u8>,
    text: String,
}

impl Tree<'_> {
    /// Appends the slave with the index `place` and all slaves that are connected after it. The last branch of a slave
    /// continues below it without indentation, so that a simple line of slaves is not indented.
    fn put(&mut self, place: usize, indent: &str) {
        let slave = &self.slaves[place];
        let behind: Vec<usize> = (0..self.slaves.len())
            .filter(|other| self.slaves[*other].upstream.is_some_and(|up| up.slave == slave.slave))
            .collect();
        let below = if behind.is_empty() { ' ' } else { '|' };
        // Writing to a String does not fail.
        let _ = writeln!(self.text, "{indent}+- {}  {}: {}", slave.slave, name(&slave.name), state_text(slave.found));
        for detail in self.details(slave, &self.errors[place]) {
            let _ = writeln!(self.text, "{indent}{below}     {detail}");
        }
        let Some((last, branches)) = behind.split_last() else { return };
        for branch in branches {
            let port = self.slaves[*branch].upstream.map_or(0, |up| up.port);
            let _ = writeln!(self.text, "{indent}|\\ port {port}");
            self.put(*branch, &format!("{indent}| "));
        }
        self.put(*last, indent);
    }

    fn details(&self, slave: &FoundSlave, errors: &SlaveErrors) -> Vec<String> {
        let identity = slave.identity;
        let mut lines = vec![format!(
            "vendor 0x{:08X}, product 0x{:08X}, revision 0x{:08X}, serial {}, alias {}, station 0x{:04X}",
            identity.vendor, identity.product, identity.revision, identity.serial, slave.alias, slave.station
        )];
        if let Some(error) = &slave.eeprom_error {
            lines.push(format!("EEPROM: {error}"));
        }
        let protocols = protocols(slave).join(", ");
        let clock = if slave.has_clock { "distributed clocks" } else { "no distributed clocks" };
        let process_data = match slave.process_bytes {
            (Some(outputs), Some(inputs)) => format!("{outputs} bytes out, {inputs} in"),
            (Some(outputs), None) => format!("{outputs} bytes out, how many in its EEPROM does not say"),
            (None, Some(inputs)) => format!("{inputs} bytes in, how many out its EEPROM does not say"),
            (None, None) if slave.protocols.is_none() => "process data not known".to_owned(),
            (None, None) => "its EEPROM does not say how many bytes out and in".to_owned(),
        };
        let mailbox = match slave.protocols {
            None => "mailbox not known".to_owned(),
            Some(_) if protocols.is_empty() => "no mailbox".to_owned(),
            Some(_) => protocols,
        };
        lines.push(format!("{mailbox}; {clock}; {process_data}"));
        lines.extend(ports(slave).map(|port| {
            let kind = port_kind(slave.port_types, port).unwrap_or_default();
            let counted = counted(&errors.ports[port]);
            let counted = if counted.is_empty() { String::new() } else { format!("; counted: {}", counted.join(", ")) };
            // In an interrupted ring, frames reach the slaves after the interruption from the other end. Their entry
            // port is then not swapped by mistake.
            let swapped = if port > 0 && port == usize::from(slave.entry_port) && self.in_ring.is_none() {
                "; frames come in here and not by port 0: IN and OUT of this slave are SWAPPED, change its cables"
            } else {
                ""
            };
            format!("port {port} ({kind}): {}{counted}{swapped}", self.connected(slave, port))
        }));
        lines
    }

    /// What is connected to a port, as text: the master, a slave, a link without an answer, or nothing.
    fn connected(&self, slave: &FoundSlave, port: usize) -> String {
        if port == 0 {
            return slave
                .upstream
                .map_or("the master".to_owned(), |up| format!("slave {}, port {}", up.slave, up.port));
        }
        match (behind(self.slaves, slave.slave, port), slave.ports.has_link(port)) {
            (Some(other), _) => format!("slave {other}"),
            (None, true) if self.in_ring == Some(slave.slave) => "the second card".to_owned(),
            (None, true) => "a link, and nobody who answers".to_owned(),
            (None, false) => "nothing".to_owned(),
        }
    }
}

/// The counters of a port that are not 0, each as text.
pub fn counted(errors: &PortErrors) -> Vec<String> {
    let of = |count: u8, one: &str, many: &str| match count {
        0 => None,
        1 => Some(format!("1 {one}")),
        port_errors::COUNTER_MAX => Some(format!("{count} or more {many}")),
        _ => Some(format!("{count} {many}")),
    };
    let PortErrors { invalid, physical, forwarded, lost_links } = *errors;
    let all = [
        of(invalid, "invalid frame", "invalid frames"),
        of(physical, "error of the physical layer", "errors of the physical layer"),
        of(forwarded, "frame damaged before", "frames damaged before"),
        of(lost_links, "lost link", "lost links"),
    ];
    all.into_iter().flatten().collect()
}

fn protocols(slave: &FoundSlave) -> Vec<&'static str> {
    const NAMES: [(MailboxProtocols, &str); 6] = [
        (MailboxProtocols::AOE, "AoE"),
        (MailboxProtocols::EOE, "EoE"),
        (MailboxProtocols::COE, "CoE"),
        (MailboxProtocols::FOE, "FoE"),
        (MailboxProtocols::SOE, "SoE"),
        (MailboxProtocols::VOE, "VoE"),
    ];
    let spoken = slave.protocols.unwrap_or(MailboxProtocols::NONE);
    NAMES.into_iter().filter(|(protocol, _)| spoken.contains(*protocol)).map(|(_, name)| name).collect()
}

/// The counters of a port as JSON.
pub fn port_json(errors: &PortErrors) -> Value {
    json!({
        "invalid_frames": errors.invalid, "physical_errors": errors.physical, "forwarded_errors": errors.forwarded,
        "lost_links": errors.lost_links,
    })
}

fn line(slaves: &[FoundSlave], slave: &FoundSlave, errors: &SlaveErrors) -> Value {
    let port = |port: usize| {
        let mut json = port_json(&errors.ports[port]);
        json["port"] = port.into();
        json["kind"] = port_kind(slave.port_types, port).into();
        json["link"] = slave.ports.has_link(port).into();
        json["open"] = (slave.ports.communicates(port) && !slave.ports.is_closed(port)).into();
        json["slave"] = match port {
            0 => slave.upstream.map(|up| up.slave).into(),
            port => behind(slaves, slave.slave, port).into(),
        };
        json
    };
    let identity = slave.identity;
    json!({
        "verb": "bus scan", "slave": slave.slave, "name": slave.name, "vendor_id": identity.vendor,
        "product_code": identity.product, "revision": identity.revision, "serial_number": identity.serial,
        "station_address": slave.station, "alias": slave.alias,
        "found_in": state_name(slave.found.status.state()),
        "failed": slave.found.status.contains(AlStatusRegister::ERROR),
        "al_status": slave.found.code.0, "al_status_text": slave.found.code.text(),
        "upstream": slave.upstream.map(|up| json!({ "slave": up.slave, "port": up.port })),
        "entry_port": slave.entry_port, "ports": ports(slave).map(port).collect::<Vec<_>>(),
        "protocols": slave.protocols.map(|_| protocols(slave)), "has_dc": slave.has_clock, "output_bytes": slave.process_bytes.0,
        "input_bytes": slave.process_bytes.1, "eeprom_error": slave.eeprom_error,
    })
}

#[cfg(test)]
mod tests {
    use ecmsk::bus;
    use ecmsk::master::Settings;
    use support::odd_line::{OddLine, OddSlave, drive, drive_of, sii};

    use super::*;

    /// Returns the output of `ecmsk bus scan` for these slaves.
    fn scan(slaves: Vec<OddSlave>) -> String {
        let mut network = bus::over(OddLine::new(slaves), Settings::default());
        let slaves = network.scan().expect("slaves");
        let errors = port_errors::read(&mut *network, &slaves).expect("counters");
        text(&slaves, &errors, None)
    }

    /// Splits the output into one text for each slave.
    fn each(printed: &str) -> Vec<&str> {
        printed.split("+- ").skip(1).collect()
    }

    /// BUS-2.3 Swapped IN and OUT plugs are reported at the affected slave and at no other one. The test has two cases:
    /// only the receive times of the ports are swapped, or the frame arrives at port 1 and the slave processes it after
    /// the following slaves.
    #[test]
    fn swapped_ends_are_told_at_their_slave() {
        const SWAPPED: &str = "IN and OUT of this slave are SWAPPED";
        for swapped in 0..3 {
            let slaves = (0..3)
                .map(|n| drive().with(|slave| slave.clock.as_mut().expect("it has one").swaps_times = n == swapped));
            let printed = scan(slaves.collect());
            let told: Vec<bool> = each(&printed).iter().map(|slave| slave.contains(SWAPPED)).collect();
            // At the last slave swapped times cannot be detected, because nothing is connected to its port 1.
            let expected: Vec<bool> = (0..3).map(|n| n == swapped && n < 2).collect();
            assert_eq!(told, expected, "{printed}");
        }
        for swapped in 0..3 {
            let named = |n: usize| {
                let names: [&[u8]; 3] = [b"first", b"second", b"third"];
                let content = sii::Content::new(4).strings(&[names[n]]).general(1).managers(&sii::MANAGERS);
                drive_of(content.end()).with(|slave| slave.is_swapped = n == swapped)
            };
            let printed = scan((0..3).map(named).collect());
            let name = ["first", "second", "third"][swapped];
            for slave in each(&printed) {
                assert_eq!(slave.contains(SWAPPED), slave.contains(name), "{name}\n{printed}");
            }
        }
    }
}
