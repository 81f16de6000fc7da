//! `ecmsk::Xf`: a chip over its link as used by a program, on the model.
#![cfg(feature = "sim")]

mod ends;
mod example;
mod network;
mod picture;
mod process;
mod stalls;
mod stops;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ecmsk::ethercat::Ns;
use ecmsk::link::chip::{ChipError, ChipInfo, ChipLink, SimChip};
use ecmsk::link::uri::LinkUri;
use ecmsk::xf::EtherCatState;
use ecmsk::xf::host::{HostConfig, HostPacing, Wires};
use ecmsk::xf::request::{FifoEnable, Reconfig, Slaves};
use ecmsk::xf_api::{NetworkConfig, ProcessData, Xf, XfError};
use ecmsk::{coe::ObjectAddress, slave::Slave};

const MODE: ObjectAddress = ObjectAddress::new(0x6060, 0);
const TARGET: ObjectAddress = ObjectAddress::new(0x607A, 0);
const POSITION: ObjectAddress = ObjectAddress::new(0x6064, 0);

/// A model that the test keeps after the program's end, as a chip outlives its host.
#[derive(Clone)]
struct Kept(Arc<Mutex<SimChip>>, Arc<Mutex<Behaviour>>);

/// The effect on an exchange that begins at this time with these bytes to the chip.
type Behaviour = Box<dyn FnMut(Ns, &[u8]) -> Exchange + Send>;

#[derive(Clone, Copy)]
enum Exchange {
    Passes,
    /// It fails, and the chip receives nothing.
    Fails,
    /// The chip receives nothing, and the answer is zeros.
    Silent,
}

impl Kept {
    fn new(uri: &str) -> Self {
        let chip = SimChip::from_uri(&LinkUri::parse(uri).expect("a URI")).expect("a chip");
        Self(Arc::new(Mutex::new(chip)), Arc::new(Mutex::new(Box::new(|_, _| Exchange::Passes))))
    }

    fn chip(&self) -> MutexGuard<'_, SimChip> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Cuts the wires after that many exchanges.
    fn cut_after(&self, exchanges: u32) {
        let mut left = exchanges;
        self.behaves(move |_, _| match left.checked_sub(1) {
            Some(fewer) => {
                left = fewer;
                Exchange::Passes
            }
            None => Exchange::Fails,
        });
    }

    /// Sets the effect on exchanges from now on.
    fn behaves(&self, behaviour: impl FnMut(Ns, &[u8]) -> Exchange + Send + 'static) {
        *self.1.lock().unwrap() = Box::new(behaviour);
    }

    /// Lets the chip run without a host.
    fn alone(&self, ns: Ns) {
        let mut chip = self.chip();
        let until = chip.now() + ns;
        chip.wait_until(until).unwrap();
        let _ = chip.int1();
    }

    fn state(&self, slave: u8) -> Option<ecmsk::ethercat::AlState> {
        use ecmsk::xf::chip::SlaveNetwork as _;
        self.chip().chip().network().state(slave)
    }

    /// The object of a slave, as a number.
    fn object(&self, slave: u8, object: ObjectAddress) -> u32 {
        let mut chip = self.chip();
        let slave: &mut dyn Slave = chip.chip_mut().network_mut().slave_mut(slave).expect("a slave");
        slave.upload(object).expect("the object").bits
    }
}

impl Wires for Kept {
    type Error = ChipError;

    fn now(&self) -> Ns {
        self.chip().now()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), ChipError> {
        let now = self.now();
        let what = (self.1.lock().unwrap())(now, to_chip);
        match what {
            Exchange::Passes => {}
            Exchange::Fails => return Err(ChipError::Wires { name: "test".into(), message: "cut".into() }),
            Exchange::Silent => {
                from_chip.fill(0);
                return self.wait_until(now + 100_000);
            }
        }
        self.chip().exchange(to_chip, from_chip)
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), ChipError> {
        self.chip().wait_until(time)
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, ChipError> {
        self.chip().wait_ready(until)
    }
}

impl ChipLink for Kept {
    fn info(&self) -> ChipInfo {
        self.chip().info()
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        self.chip().int1()
    }
}

/// A program that has started a chip with these slaves, on virtual time.
fn started(slaves: &str) -> (Xf<Kept>, Kept) {
    opened(&format!("xf-sim:?clock=virtual&slaves={slaves}"))
}

fn opened(uri: &str) -> (Xf<Kept>, Kept) {
    let chip = Kept::new(uri);
    let pacing = if chip.info().has_int0 { HostPacing::Int0 } else { HostPacing::Idle };
    let config = HostConfig { size: chip.info().size, pacing, ..HostConfig::DEFAULT };
    (Xf::over(chip.clone(), config).expect("it starts"), chip)
}

/// Brings the drives of a chip to SafeOP in a mode; each slave is the axis with its number.
fn safe_op(xf: &mut Xf<Kept>, mode: i8) -> Result<ProcessData, XfError> {
    let slaves = xf.start_network(&NetworkConfig::default())?;
    xf.set_state(Slaves::All, EtherCatState::PreOp)?;
    for slave in 0..slaves {
        xf.sdo_write(slave, MODE, mode)?;
    }
    xf.run(&Reconfig)?;
    xf.set_state(Slaves::All, EtherCatState::SafeOp)?;
    let data = xf.process_data()?;
    for slave in 0..slaves {
        xf.add_axis(slave, slave, &data)?;
    }
    Ok(data)
}

/// Brings the drives to Operation enabled in CSP.
fn enabled(xf: &mut Xf<Kept>) -> Result<ProcessData, XfError> {
    let mut data = safe_op(xf, 8)?;
    let slaves = data.layout().outputs.len() as u8;
    for slave in 0..slaves {
        let start = data.get(data.input::<i32>(slave, POSITION)?);
        data.set(data.output(slave, TARGET)?, start);
    }
    xf.set_state(Slaves::All, EtherCatState::Op)?;
    xf.run(&FifoEnable { on: true })?;
    xf.cycle(&mut data)?;
    for motor in 0..slaves {
        xf.enable(motor)?;
    }
    Ok(data)
}
