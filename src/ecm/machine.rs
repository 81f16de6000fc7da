//! The board and the configuration of a machine file.

use std::path::{self, Path};

use super::config::{Axis, Config, Slave};
use super::{Ecm, EcmError};
use crate::address::config::Environment;
use crate::address::uri::LinkUri;
use crate::link::LinkError;
use crate::machine_file::{MachineFile, MachineSlave};

impl Ecm {
    /// Opens the board of a machine file, in its present state. Nothing is sent: the program configures the network with
    /// [`Config::of_machine`]. The link is that of [`Self::machine_link`]. The link `sim:` simulates the slaves of the file.
    ///
    /// ```
    /// use ecmsk::ecm::{Close, Config, Ecm, EcmError};
    /// use ecmsk::sk::MasterState;
    ///
    /// # let folder = tempfile::tempdir().expect("a folder");
    /// # let path = folder.path().join("machine.toml");
    /// # let text = r#"
    /// # format = 1
    /// # link = "sim:?clock=virtual"
    /// # [axes]
    /// # X = { slave = 1, unit = "mm", per = 0.001 }
    /// # "#;
    /// # std::fs::write(&path, text).expect("a file");
    /// // link = "sim:?clock=virtual"
    /// // [axes]
    /// // X = { slave = 1, unit = "mm", per = 0.001 }
    /// let (ecm, machine) = Ecm::open_machine(&path)?;
    /// ecm.configure(&Config::of_machine(&machine))?;
    /// ecm.set_state(MasterState::Op)?;
    /// let x = machine.axis("X").expect("an axis").slave;
    /// ecm.servo_on(&[x])?;
    ///
    /// let mut stream = ecm.stream(20)?;
    /// for n in 1..=500 {
    ///     stream.csp_units(x, f64::from(n) * 0.01)?; // mm
    ///     stream.step()?;
    /// }
    /// stream.finish()?;
    /// let at = ecm.snapshot()?.position_units(x).unwrap_or_default();
    /// assert!((at - 5.0).abs() < 0.01, "{at} mm");
    /// ecm.close(Close::ServoOff)?;
    /// # Ok::<(), EcmError>(())
    /// ```
    ///
    /// # Errors
    /// [`EcmError::Machine`] if the file is wrong or names no link, and those of [`Ecm::open`].
    pub fn open_machine(file: &Path) -> Result<(Self, MachineFile), EcmError> {
        let machine = MachineFile::load(file)?;
        let link = Self::machine_link(&machine, None)?.ok_or_else(|| machine.names_no_link())?;
        Ok((Self::open(&link.to_string())?, machine))
    }

    /// The link of a program with a machine file. The first that exists of these three: `link`, which the program names
    /// itself; the link in the environment variable `ECMSK_LINK`, by which `ecmsk exec --link sim:` runs the program on
    /// a simulated board; the link in the file. `None` if there is none. The key `axes=` is added with the absolute
    /// path of the file, so that its soft limits apply; a simulated board gets the slaves of the file.
    ///
    /// # Errors
    /// [`LinkError`] if `ECMSK_LINK` is not the URI of a link.
    pub fn machine_link(machine: &MachineFile, link: Option<&LinkUri>) -> Result<Option<LinkUri>, LinkError> {
        let environment = Environment::from_process(None);
        let of_variable = match link {
            Some(_) => None,
            None => environment.link_of_variable()?.map(LinkUri::parse).transpose()?,
        };
        let mut machine = machine.clone();
        machine.path = path::absolute(&machine.path).unwrap_or(machine.path);
        let link = machine.link(link.or(of_variable.as_ref()));
        Ok(link.map(|link| link.with_axes(&machine.path.display().to_string())))
    }
}

impl Config {
    /// The configuration of the network of a [machine file](crate::machine_file), with the units and the soft limits of its
    /// axes: a [`Stream`](super::Stream) refuses targets beyond them, whatever the file says of other programs.
    pub fn of_machine(machine: &MachineFile) -> Self {
        let slave = |(number, slave): (u8, &MachineSlave)| {
            let (scale, limits) = machine.axis_of(number).map(|axis| (axis.scale, axis.limits)).unwrap_or_default();
            Slave::with_axis(slave.kind, Axis { mode: slave.mode, scale, limits, ..Axis::CSP })
        };
        let cycle_us = machine.cycle_us.unwrap_or(Self::default().cycle_us);
        Self { slaves: (1..).zip(&machine.slaves).map(slave).collect(), cycle_us }
    }
}
