//! A slave as the simulated bus uses it: configured by the SDOs of the board, with process data as fields instead of
//! images; and its faults.

use ecmsk::fieldbus::pdo::{IMAGE_BYTES_MAX, ProcessData};
use ecmsk::fieldbus::sim;
use ecmsk::fieldbus::{AlState, Refusal, Role, SlaveConfig, SlaveIn, SlaveOut};
use ecmsk::sk::DriveSync;
use ecmsk::slave::{DeviceFault, Fault, Input, InputPattern, Slave};

/// A configuration with distributed clocks.
pub const fn config(role: Role) -> SlaveConfig {
    SlaveConfig { role, sync: DriveSync::DcSync }
}

/// Configures a slave in PreOP.
pub fn configure(slave: &mut impl Slave, config: &SlaveConfig) -> Result<(), Refusal> {
    sim::configure(slave, config).map(|_| ())
}

/// Configures a slave for that role; returns the mapped process data.
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

/// A slave in PreOP.
pub fn in_preop<S: Slave>(mut slave: S) -> S {
    slave.enter(AlState::PreOp).expect("every slave has a mailbox");
    slave
}

/// An alarm of the first axis, which a fault reset clears.
pub const fn alarm(code: u16) -> Fault {
    Fault::Alarm { axis: 0, fault: DeviceFault { code, resettable: true } }
}

/// An input of the first axis sticks, or works again.
pub const fn stick(input: Input, value: Option<bool>) -> Fault {
    Fault::Stick { axis: 0, input: Some(input), value }
}

/// The shaft of the first axis is jammed, or free.
pub const fn jam(jammed: bool) -> Fault {
    Fault::Jam { axis: 0, jammed }
}

/// The inputs of the first channel are forced.
pub const fn force(bits: u16) -> Fault {
    Fault::ForceInputs { channel: 0, pattern: Some(InputPattern::Bits(bits)) }
}
