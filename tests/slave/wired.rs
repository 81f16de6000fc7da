//! A slave as the simulated bus has it: configured by the SDOs of the board, with process data as fields instead of images.

use ecmsk::fieldbus::pdo::{IMAGE_BYTES_MAX, ProcessData};
use ecmsk::fieldbus::sim;
use ecmsk::fieldbus::{Refusal, Role, SlaveConfig, SlaveIn, SlaveOut};
use ecmsk::sk::DriveSync;
use ecmsk::slave::Slave;

/// A configuration with distributed clocks.
pub const fn config(role: Role) -> SlaveConfig {
    SlaveConfig { role, sync: DriveSync::DcSync }
}

/// Configures a slave in PreOP.
pub fn configure(slave: &mut impl Slave, config: &SlaveConfig) -> Result<(), Refusal> {
    sim::configure(slave, config).map(|_| ())
}

/// Configures a slave for that role. The process data that are mapped then.
pub fn map(slave: &mut impl Slave, role: Role) -> ProcessData {
    sim::configure(slave, &config(role)).expect("it has the role").expect("it is used")
}

/// Exchanges the process data of one cycle.
pub fn exchange(slave: &mut impl Slave, data: &ProcessData, outputs: Option<&SlaveOut>, inputs: &mut SlaveIn) {
    let (mut sent, mut answer) = ([0xA5; IMAGE_BYTES_MAX], [0xA5; IMAGE_BYTES_MAX]);
    let sent = outputs.map(|outputs| data.put_outputs(outputs, &mut sent));
    slave.exchange(sent, &mut answer[..data.input_bytes()]);
    data.take_inputs(&answer, inputs);
}
