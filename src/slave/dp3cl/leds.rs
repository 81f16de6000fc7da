//! The LEDs of the drive as values: what a person in front of it sees.

/// The red LED.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RedLed {
    /// Off: there is no alarm.
    #[default]
    Off,
    /// That many flashes, then a pause of 1 s, and again.
    Flashes(u8),
    /// Always on: an alarm of the EtherCAT side.
    On,
}

/// The green LED of a port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LinkLed {
    /// There is no link.
    Off,
    /// There is a link, and no traffic. \[OURS] On a network without controllers there always is a link.
    #[default]
    On,
    /// There is traffic.
    Flashing,
}

/// What the LEDs show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dp3clLeds {
    /// Green: the drive has power.
    pub power: bool,
    /// Red: alarms.
    pub alarm: RedLed,
    /// LED 1 and LED 3, yellow: the connection is normal. \[OURS] That is so in PreOP, SafeOP and OP without an alarm of the
    /// EtherCAT side.
    pub run: bool,
    /// LED 4, L/A IN, green: the link to the slave before, or to the master.
    pub link_in: LinkLed,
    /// LED 2, L/A OUT, green: the link to the slave behind.
    pub link_out: LinkLed,
}
