//! Registers of the data link layer: DL control and DL status, with the state of each port.

/// The maximum number of ports of a controller.
pub const PORTS: usize = 4;

/// The loop setting of a port. With an open loop, frames leave through the port. With a closed loop, frames skip the
/// port and go on to the next one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LoopControl {
    /// Automatic: open with a link, closed without one.
    Auto,
    /// Automatic close: closes when the link is lost; opens only when the master writes DL control.
    AutoClose,
    /// Always open.
    Open,
    /// Always closed.
    Closed,
}

impl LoopControl {
    /// The loop setting for a 2-bit field; higher bits are ignored.
    pub const fn from_bits(bits: u8) -> Self {
        match bits & 0b11 {
            0 => Self::Auto,
            1 => Self::AutoClose,
            2 => Self::Open,
            _ => Self::Closed,
        }
    }
}

/// DL control, 0x0100: how the controller forwards frames, with the loop settings of its ports.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct DlControl(pub u32);

impl DlControl {
    /// Bit 0: the controller destroys frames that are not EtherCAT frames.
    pub const DESTROYS_OTHERS: u32 = 1 << 0;
    /// Bit 1: the loop settings apply for one second only.
    pub const TEMPORARY: u32 = 1 << 1;
    /// Bit 24: the station alias can be used as the address in FPRD, FPWR and the other node-addressed commands.
    pub const ALIAS: u32 = 1 << 24;
    /// The power-on value that slave models with two ports use: RX FIFO at its maximum size, non-EtherCAT frames
    /// destroyed, the loop of the missing port 3 closed, the others automatic.
    pub const POWER_ON: Self = Self(0x0007_C001);

    /// The loop setting of a port, 0..=3, in bits 8 to 15.
    pub const fn loop_control(self, port: usize) -> LoopControl {
        LoopControl::from_bits((self.0 >> (8 + 2 * (port as u32 & 3))) as u8)
    }

    /// This value with another loop setting for a port, 0..=3.
    #[must_use]
    pub const fn with_loop(self, port: usize, control: LoopControl) -> Self {
        let shift = 8 + 2 * (port as u32 & 3);
        Self(self.0 & !(0b11 << shift) | (control as u32) << shift)
    }

    /// Whether slaves can be addressed by their station alias.
    pub const fn uses_alias(self) -> bool {
        self.0 & Self::ALIAS != 0
    }
}

/// DL status, 0x0110: the link and the loop state of each port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct DlStatus(pub u16);

impl DlStatus {
    /// Bit 0: the SII is loaded, so the slave's processor may access the controller.
    pub const SII_LOADED: u16 = 1 << 0;
    /// Bit 1: the watchdog of the slave's processor (PDI) has not expired.
    pub const PDI_WATCHDOG: u16 = 1 << 1;

    /// Whether a port, 0..=3, has a physical link: bits 4 to 7.
    pub const fn has_link(self, port: usize) -> bool {
        self.0 & 1 << (4 + port) != 0
    }

    /// Whether the loop of a port, 0..=3, is closed: bits 8, 10, 12 and 14.
    pub const fn is_closed(self, port: usize) -> bool {
        self.0 & 1 << (8 + 2 * port) != 0
    }

    /// Whether a port, 0..=3, has stable communication, so that frames come in through it without errors: bits 9, 11,
    /// 13 and 15.
    pub const fn communicates(self, port: usize) -> bool {
        self.0 & 1 << (9 + 2 * port) != 0
    }

    /// This value with the link bit and the loop bit of a port, 0..=3, replaced by `link` and `closed`. The
    /// communication bit of the port becomes 1 if the port has a link and an open loop, else 0.
    #[must_use]
    pub const fn with_port(self, port: usize, link: bool, closed: bool) -> Self {
        let link_bit = if link { 1 << (4 + port) } else { 0 };
        let closed_bit = if closed { 1 << (8 + 2 * port) } else { 0 };
        let communication_bit = if link && !closed { 1 << (9 + 2 * port) } else { 0 };
        let all = 1 << (4 + port) | 0b11 << (8 + 2 * port);
        Self(self.0 & !all | link_bit | closed_bit | communication_bit)
    }
}
