//! The LEDs of the drive as values.

/// The red LED.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RedLed {
    /// Off: there is no alarm.
    #[default]
    Off,
    /// This many flashes, then a pause of 1 s, repeated.
    Flashes(u8),
    /// Always on: an alarm of the EtherCAT side.
    On,
}

/// The green LED of a port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LinkLed {
    /// There is no link.
    Off,
    /// There is a link but no traffic. \[OURS] On a network without slave controllers there is always a link.
    #[default]
    On,
    /// There is a link with traffic.
    Flashing,
}

/// The states of the LEDs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dp3clLeds {
    /// Green: the drive has power.
    pub power: bool,
    /// Red: alarms.
    pub alarm: RedLed,
    /// LED 1 and LED 3, yellow: the EtherCAT connection works. \[OURS] On in PreOP, SafeOP and OP without an alarm of
    /// the EtherCAT side.
    pub run: bool,
    /// LED 4, L/A IN, green: the link towards the master.
    pub link_in: LinkLed,
    /// LED 2, L/A OUT, green: the link to the next slave.
    pub link_out: LinkLed,
}
