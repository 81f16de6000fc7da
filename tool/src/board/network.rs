//! The network as the options describe it: the kinds and modes of the slaves, and the limits and units of the axes.

use ecmsk::cia402::Mode;
use ecmsk::ecm::{Axis, Config, Guard, Scale, Slave};
use ecmsk::link::options::SimOptions;
use ecmsk::link::slaves;
use ecmsk::link::uri::LinkUri;
use ecmsk::machine_file::MachineFile;
use ecmsk::sk::SlaveKind;

use super::error::BoardError;

const MODES: &str = ":csp, :csv, :cst";

/// The slaves of the network, in network order, from `--slaves`, a simulated link or a machine file.
#[derive(Clone, Debug, PartialEq)]
pub struct Network(Vec<Slave>);

impl Network {
    /// Parses a list such as `drive*2,io,hsp:csv`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is wrong and what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let slave = |kind, modes: &[&str]| {
            let modes: Vec<_> = modes.iter().map(|word| mode(word)).collect::<Result<_, _>>()?;
            let axis = Axis { mode: modes.last().copied().unwrap_or(Mode::Csp), ..Axis::CSP };
            Ok(Slave::with_axis(kind, axis))
        };
        slaves::parse_declared(text, slave).map(Self)
    }

    /// The slaves of a `sim:` or `xf-sim:` link; `None` for any other link.
    pub fn of_link(link: &LinkUri) -> Option<Self> {
        let options = SimOptions::from_uri(link).ok()?;
        Some(Self::of_kinds(options.slaves.iter().map(|slave| slave.model.kind())))
    }

    /// Slaves of these kinds, axes in CSP.
    pub fn of_kinds(kinds: impl IntoIterator<Item = SlaveKind>) -> Self {
        Self(kinds.into_iter().map(Slave::of_kind).collect())
    }

    /// The slaves that a machine file lists, with their modes, limits and units.
    pub fn of_machine(machine: &MachineFile) -> Self {
        Self(Config::of_machine(machine).slaves)
    }

    /// The configuration of these slaves, with the cycle time. Each axis gets the limit `lead_limit`, unless it is
    /// `None`. Its unit is the one that `scale` returns for its slave number, else counts.
    pub fn config(self, cycle_us: u32, lead_limit: Option<Guard>, scale: impl Fn(u8) -> Option<Scale>) -> Config {
        let mut slaves = self.0;
        for (number, slave) in (1..).zip(&mut slaves) {
            if let Slave::Drive(axis) | Slave::Step(axis) | Slave::Hsp(axis) = slave {
                axis.guard = lead_limit.unwrap_or(axis.guard);
                axis.scale = scale(number).unwrap_or(Scale::COUNTS);
            }
        }
        Config { slaves, cycle_us }
    }
}

fn mode(word: &str) -> Result<Mode, String> {
    let mode = [Mode::Csp, Mode::Csv, Mode::Cst].into_iter().find(|mode| mode.name().eq_ignore_ascii_case(word));
    mode.ok_or_else(|| format!("mode `{word}` is unknown; allowed: {MODES}"))
}

/// The help text of `--slaves`, with the kinds that a slave may have.
pub fn help() -> String {
    format!(
        "The slaves in the order of the cable, e.g. drive*2,io,hsp:csv; of {}, each with :csv or :cst if it does not run in CSP \
         [default: those of a sim: or xf-sim: link]",
        slaves::declared_words()
    )
}

/// The slave with this number, or the error if the network has none.
pub fn find_slave<'a>(config: &'a Config, what: &str, slave: u8) -> Result<&'a Slave, BoardError> {
    let found = usize::from(slave).checked_sub(1).and_then(|index| config.slaves.get(index));
    found.ok_or_else(|| BoardError::NoSlave { what: what.to_owned(), slave, network: list(config) })
}

/// The axis of the slave with this number, or the error if it has no axis.
pub fn find_axis<'a>(config: &'a Config, what: &str, slave: u8) -> Result<&'a Axis, BoardError> {
    let found = find_slave(config, what, slave)?;
    found.axis().ok_or_else(|| wrong_kind(what, slave, found, "a drive, step or hsp"))
}

/// The error for a slave of another kind than the `wanted` ones.
pub fn wrong_kind(what: &str, slave: u8, found: &Slave, wanted: &'static str) -> BoardError {
    BoardError::WrongKind { what: what.to_owned(), slave, found: found.to_string(), wanted }
}

/// The numbers of all slaves that have an axis.
pub fn slaves_with_axis(config: &Config) -> Vec<u8> {
    (1..).zip(&config.slaves).filter(|(_, slave)| slave.axis().is_some()).map(|(number, _)| number).collect()
}

/// The slaves as text: `1 drive, 2 io`.
pub fn list(config: &Config) -> String {
    if config.slaves.is_empty() {
        return "empty".into();
    }
    let slaves = (1..).zip(&config.slaves).map(|(number, slave): (u8, _)| format!("{number} {slave}"));
    slaves.collect::<Vec<_>>().join(", ")
}

/// Parses the value of `--guard` and of `--lead-limit`.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn guard(text: &str) -> Result<Guard, String> {
    match (text, text.parse()) {
        ("off", _) => Ok(Guard::Off),
        (_, Ok(counts @ 1..)) => Ok(Guard::Within(counts)),
        _ => Err("allowed: counts, 1 or more, or off".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In a list of slaves, the mode and the repeat count may be in either order: `drive:csv*2` is `drive*2:csv`.
    #[test]
    fn a_list_of_slaves_has_kinds_with_modes_and_counts() {
        let csv = Slave::Drive(Axis::CSV);
        let Network(slaves) = Network::parse("drive:csv*2,io, drive*2:csv,HSP,step,none").unwrap();
        let rest = [Slave::Hsp(Axis::CSP), Slave::Step(Axis::CSP), Slave::Unused];
        assert_eq!(slaves, [&[csv, csv, Slave::Io, csv, csv][..], &rest].concat());
        for (wrong, why) in [
            ("", "kind `` is unknown"),
            ("drive,,io", "kind `` is unknown"),
            ("motor", "kind `motor` is unknown; allowed: drive, io, step, dp3cl, hsp, hsp2, none"),
            ("drive*0", "from 1 to 40"),
            ("drive*", "from 1 to 40"),
            ("drive:pp", "mode `pp` is unknown; allowed: :csp"),
            ("drive*40,io", "41 slaves, allowed: at most 40"),
        ] {
            let said = Network::parse(wrong).map_or_else(|said| said, |network| format!("{network:?}"));
            assert!(said.contains(why), "{wrong}: {said}");
        }
    }
}
