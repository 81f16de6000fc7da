//! Registers of the data link layer: which ports are open.

/// How many ports a controller can have.
pub const PORTS: usize = 4;

/// How a port decides whether frames leave by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LoopControl {
    /// Closed without a link, open with one.
    Auto,
    /// Closed without a link; opened by a write to DL control alone.
    AutoClose,
    /// Always open.
    Open,
    /// Always closed.
    Closed,
}

impl LoopControl {
    /// The meaning of two bits.
    pub const fn from_bits(bits: u8) -> Self {
        match bits & 0b11 {
            0 => Self::Auto,
            1 => Self::AutoClose,
            2 => Self::Open,
            _ => Self::Closed,
        }
    }
}

/// DL control, 0x0100.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct DlControl(pub u32);

impl DlControl {
    /// Bit 0: frames that are not of EtherCAT are destroyed.
    pub const DESTROYS_OTHERS: u32 = 1 << 0;
    /// Bit 1: the loops are as written for one second.
    pub const TEMPORARY: u32 = 1 << 1;
    /// Bit 24: the station alias addresses the slave, too.
    pub const ALIAS: u32 = 1 << 24;
    /// The value at power-on of a controller with two ports: the FIFO at its greatest, other frames destroyed, and the loop
    /// of port 3 closed.
    pub const POWER_ON: Self = Self(0x0007_C001);

    /// What bits 8 to 15 say about a port, 0..=3.
    pub const fn loop_control(self, port: usize) -> LoopControl {
        LoopControl::from_bits((self.0 >> (8 + 2 * (port as u32 & 3))) as u8)
    }

    /// The same with another loop control of a port, 0..=3.
    #[must_use]
    pub const fn with_loop(self, port: usize, control: LoopControl) -> Self {
        let shift = 8 + 2 * (port as u32 & 3);
        Self(self.0 & !(0b11 << shift) | (control as u32) << shift)
    }

    /// Whether the station alias addresses the slave.
    pub const fn uses_alias(self) -> bool {
        self.0 & Self::ALIAS != 0
    }
}

/// DL status, 0x0110.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct DlStatus(pub u16);

impl DlStatus {
    /// Bit 0: the SII was loaded, and the slave's own controller may run.
    pub const SII_LOADED: u16 = 1 << 0;
    /// Bit 1: the watchdog of the slave's own controller has not expired.
    pub const PDI_WATCHDOG: u16 = 1 << 1;

    /// A port has a physical link: bits 4 to 7.
    pub const fn has_link(self, port: usize) -> bool {
        self.0 & 1 << (4 + port) != 0
    }

    /// The loop of a port is closed: bits 8, 10, 12 and 14.
    pub const fn is_closed(self, port: usize) -> bool {
        self.0 & 1 << (8 + 2 * port) != 0
    }

    /// A port has stable communication: bits 9, 11, 13 and 15.
    pub const fn communicates(self, port: usize) -> bool {
        self.0 & 1 << (9 + 2 * port) != 0
    }

    /// The status with what is true of a port, 0..=3. A port communicates if it has a link and is open.
    #[must_use]
    pub const fn with_port(self, port: usize, link: bool, closed: bool) -> Self {
        let link_bit = if link { 1 << (4 + port) } else { 0 };
        let closed_bit = if closed { 1 << (8 + 2 * port) } else { 0 };
        let communication_bit = if link && !closed { 1 << (9 + 2 * port) } else { 0 };
        let all = 1 << (4 + port) | 0b11 << (8 + 2 * port);
        Self(self.0 & !all | link_bit | closed_bit | communication_bit)
    }
}
