//! The LEDs of the drive as values.

/// The state of the red LED, which shows alarms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RedLed {
    /// Off: there is no alarm.
    #[default]
    Off,
    /// This many flashes, then a pause of 1 s, repeated: the number shows which alarm of the drive itself is present.
    Flashes(u8),
    /// Always on: an alarm of the EtherCAT side.
    On,
}

/// The state of the green LED of an EtherCAT port.
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
