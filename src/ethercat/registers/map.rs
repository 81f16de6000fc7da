//! The register map: address, length and write access of each register.

use super::{FMMU_LEN, LATCHES, LatchEdge, PORTS, SYNC_MANAGER_LEN};

/// The effect of a write by the master.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RegisterAccess {
    /// None: the register is read only for the master.
    Read,
    /// The write changes the register, or at least some of its bits.
    Write,
    /// The write clears the register, whatever the data.
    Clear,
}

/// A register of the slave controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Register {
    /// The address of the register's first byte.
    pub address: u16,
    /// The length of the register in bytes.
    pub len: u16,
    /// The effect of a write by the master.
    pub access: RegisterAccess,
    /// The name of the register in the data sheets.
    pub name: &'static str,
}

macro_rules! map {
    ($($(#[$doc:meta])* $name:ident = $address:expr, $len:expr, $access:ident, $text:literal;)*) => {
        $(
            #[doc = concat!("Address of the register \"", $text, "\".")]
            $(#[$doc])*
            pub const $name: u16 = $address;
        )*

        /// All registers in ascending order of address.
        pub const MAP: &[Register] = &[
            $(Register { address: $address, len: $len, access: RegisterAccess::$access, name: $text },)*
        ];
    };
}

map! {
    TYPE = 0x0000, 1, Read, "type";
    REVISION = 0x0001, 1, Read, "revision";
    BUILD = 0x0002, 2, Read, "build";
    FMMUS = 0x0004, 1, Read, "number of FMMUs";
    SYNC_MANAGERS = 0x0005, 1, Read, "number of sync managers";
    /// RAM size, KiB.
    RAM_SIZE = 0x0006, 1, Read, "RAM size";
    /// Two bits for each port: 0 none, 1 not configured, 2 EBUS, 3 MII.
    PORT_DESCRIPTOR = 0x0007, 1, Read, "port descriptor";
    /// What the controller supports, see [`Features`](super::Features).
    FEATURES = 0x0008, 2, Read, "features";
    STATION_ADDRESS = 0x0010, 2, Write, "configured station address";
    /// The station alias, loaded from the SII at power-on.
    STATION_ALIAS = 0x0012, 2, Read, "configured station alias";
    WRITE_REGISTER_ENABLE = 0x0020, 1, Write, "write register enable";
    WRITE_REGISTER_PROTECTION = 0x0021, 1, Write, "write register protection";
    ESC_WRITE_ENABLE = 0x0030, 1, Write, "ESC write enable";
    ESC_WRITE_PROTECTION = 0x0031, 1, Write, "ESC write protection";
    /// The master resets the controller by writing the bytes of [`RESET_SEQUENCE`] in three frames.
    RESET_ECAT = 0x0040, 1, Write, "ESC reset ECAT";
    RESET_PDI = 0x0041, 1, Read, "ESC reset PDI";
    /// How the controller forwards frames, see [`DlControl`](super::DlControl).
    DL_CONTROL = 0x0100, 4, Write, "ESC DL control";
    /// An offset that FPRW and APRW add to the address for their write.
    PHYSICAL_OFFSET = 0x0108, 2, Write, "physical read/write offset";
    /// The links and loops of the ports, see [`DlStatus`](super::DlStatus).
    DL_STATUS = 0x0110, 2, Read, "ESC DL status";
    /// The AL state that the master requests, see [`AlControl`](super::AlControl).
    AL_CONTROL = 0x0120, 2, Write, "AL control";
    /// The present AL state of the slave, see [`AlStatusRegister`](super::AlStatusRegister).
    AL_STATUS = 0x0130, 2, Read, "AL status";
    /// Two reserved bytes between the AL status and its code. Masters read the status, these bytes and the code with
    /// one datagram.
    AL_STATUS_GAP = 0x0132, 2, Read, "reserved";
    /// Why the slave has refused or left an AL state, see [`AlStatus`](crate::ethercat::AlStatus).
    AL_STATUS_CODE = 0x0134, 2, Read, "AL status code";
    RUN_LED = 0x0138, 1, Read, "RUN LED override";
    ERR_LED = 0x0139, 1, Read, "ERR LED override";
    /// The type of the process data interface (PDI), such as 0x04 digital I/O or 0x05 SPI. Loaded from the SII at
    /// power-on.
    PDI_CONTROL = 0x0140, 1, Read, "PDI control";
    /// Bit 0, device emulation: AL status copies AL control, for a slave without a processor that runs the AL state
    /// machine. Loaded from the SII at power-on.
    ESC_CONFIGURATION = 0x0141, 1, Read, "ESC configuration";
    /// The configuration of the process data interface, loaded from the SII at power-on.
    PDI_CONFIGURATION = 0x0150, 4, Read, "PDI configuration";
    /// The events that the controller reports in the `irq` field of datagrams, see [`EcatEvents`](super::EcatEvents).
    ECAT_EVENT_MASK = 0x0200, 2, Write, "ECAT event mask";
    AL_EVENT_MASK = 0x0204, 4, Read, "AL event mask";
    /// The pending events for the master, see [`EcatEvents`](super::EcatEvents).
    ECAT_EVENT = 0x0210, 2, Read, "ECAT event request";
    /// The pending events for the slave's processor, see [`AlEvents`](super::AlEvents).
    AL_EVENT = 0x0220, 4, Read, "AL event request";
    /// Two bytes for each port: the counter of invalid frames and the counter of physical layer errors.
    RX_ERRORS = 0x0300, 2 * PORTS as u16, Clear, "RX error counters";
    FORWARDED_ERRORS = 0x0308, PORTS as u16, Clear, "forwarded RX error counters";
    PROCESSING_UNIT_ERRORS = 0x030C, 1, Clear, "ECAT processing unit error counter";
    PDI_ERRORS = 0x030D, 1, Clear, "PDI error counter";
    PDI_ERROR_CODE = 0x030E, 1, Read, "PDI error code";
    LOST_LINKS = 0x0310, PORTS as u16, Clear, "lost link counters";
    /// The unit of [`WATCHDOG_PDI`] and [`WATCHDOG_PROCESS_DATA`]: (this value + 2) times 40 ns. The usual value 2498
    /// makes it 100 us.
    WATCHDOG_DIVIDER = 0x0400, 2, Write, "watchdog divider";
    WATCHDOG_PDI = 0x0410, 2, Write, "watchdog time PDI";
    WATCHDOG_PROCESS_DATA = 0x0420, 2, Write, "watchdog time process data";
    /// Bit 0: the process data watchdog has not expired, or it is disabled (its time is 0).
    WATCHDOG_STATUS = 0x0440, 2, Read, "watchdog status process data";
    WATCHDOG_COUNTER_PROCESS_DATA = 0x0442, 1, Clear, "watchdog counter process data";
    WATCHDOG_COUNTER_PDI = 0x0443, 1, Clear, "watchdog counter PDI";
    /// Bit 0: the EEPROM is assigned to the slave's processor; bit 1: the master takes the EEPROM away from it by force.
    SII_CONFIGURATION = 0x0500, 1, Write, "EEPROM configuration";
    /// Bit 0: the slave's processor currently has access to the EEPROM.
    SII_PDI_ACCESS = 0x0501, 1, Read, "EEPROM PDI access state";
    /// The command for the EEPROM and its status, see [`SiiControl`](super::SiiControl).
    SII_CONTROL = 0x0502, 2, Write, "EEPROM control/status";
    /// The EEPROM address, in words.
    SII_ADDRESS = 0x0504, 4, Write, "EEPROM address";
    SII_DATA = 0x0508, 8, Write, "EEPROM data";
    MII = 0x0510, 12, Read, "MII management";
    /// The registers of all FMMUs, see [`fmmu`] and [`Fmmu`](super::Fmmu).
    FMMU = 0x0600, 16 * FMMU_LEN as u16, Write, "FMMUs";
    /// The registers of all sync managers, see [`sync_manager`] and [`SyncManager`](super::SyncManager).
    SYNC_MANAGER = 0x0800, 16 * SYNC_MANAGER_LEN as u16, Write, "sync managers";
    /// For each port, the local time at which the frame that wrote to this register arrived; 4 bytes each.
    RECEIVE_TIMES = 0x0900, 4 * PORTS as u16, Write, "receive times";
    SYSTEM_TIME = 0x0910, 8, Write, "system time";
    RECEIVE_TIME_UNIT = 0x0918, 8, Read, "receive time processing unit";
    SYSTEM_TIME_OFFSET = 0x0920, 8, Write, "system time offset";
    SYSTEM_TIME_DELAY = 0x0928, 4, Write, "system time delay";
    /// The offset of the slave's clock to the reference clock, see
    /// [`SystemTimeDifference`](super::SystemTimeDifference).
    SYSTEM_TIME_DIFFERENCE = 0x092C, 4, Read, "system time difference";
    SPEED_COUNTER_START = 0x0930, 2, Write, "speed counter start";
    SPEED_COUNTER_DIFFERENCE = 0x0932, 2, Read, "speed counter difference";
    TIME_DIFFERENCE_FILTER = 0x0934, 1, Write, "system time difference filter depth";
    SPEED_FILTER = 0x0935, 1, Write, "speed counter filter depth";
    /// Bit 0, reverse mode: a write to [`RECEIVE_TIMES`] latches at ports 1 to 3 the times of the frame before it.
    RECEIVE_TIME_LATCH_MODE = 0x0936, 1, Write, "receive time latch mode";
    CYCLIC_UNIT_CONTROL = 0x0980, 1, Write, "cyclic unit control";
    /// Which SYNC pulses the slave's clock generates, see [`SyncActivation`](super::SyncActivation).
    SYNC_ACTIVATION = 0x0981, 1, Write, "SYNC activation";
    /// The length of a SYNC pulse in units of 10 ns, loaded from the SII at power-on.
    SYNC_PULSE_LENGTH = 0x0982, 2, Read, "pulse length of SYNC signals";
    /// Bit 0: the first SYNC0 pulse is still pending. Bit 1: the first SYNC1 pulse is still pending.
    SYNC_ACTIVATION_STATUS = 0x0984, 1, Read, "SYNC activation status";
    SYNC0_STATUS = 0x098E, 1, Read, "SYNC0 status";
    SYNC1_STATUS = 0x098F, 1, Read, "SYNC1 status";
    /// Write: the system time of the first SYNC0 pulse. Read: the system time of the next SYNC0 pulse.
    SYNC0_START = 0x0990, 8, Write, "start time cyclic operation";
    SYNC1_NEXT = 0x0998, 8, Read, "next SYNC1 pulse";
    /// The SYNC0 cycle time, ns; 0 for a single pulse.
    SYNC0_CYCLE = 0x09A0, 4, Write, "SYNC0 cycle time";
    /// The delay from a SYNC0 pulse to the SYNC1 pulse that belongs to it, ns. The data sheets call it a cycle time.
    SYNC1_CYCLE = 0x09A4, 4, Write, "SYNC1 cycle time";
    /// One byte per latch input: bit 0 for the positive edge, bit 1 for the negative edge. 1 selects single-event mode, in
    /// which only the first edge is captured until its time has been read; 0 selects continuous mode, in which every edge
    /// is captured.
    LATCH_CONTROL = 0x09A8, 2, Write, "latch control";
    /// One byte per latch input, see [`LatchStatus`](super::LatchStatus).
    LATCH_STATUS = 0x09AE, 2, Read, "latch status";
    /// The system times of the latched edges, see [`latch_time`].
    LATCH_TIMES = 0x09B0, 32, Read, "latch times";
    EVENT_TIMES = 0x09F0, 16, Read, "sync manager event times";
    /// The values of the digital outputs, which the master writes directly. Only for a controller that drives outputs
    /// itself, without a processor.
    DIGITAL_OUTPUTS = 0x0F00, 4, Write, "digital outputs";
    USER_RAM = 0x0F80, 128, Write, "user RAM";
}

/// The address range of the distributed-clock registers.
pub const CLOCK_REGISTERS: core::ops::Range<u16> = RECEIVE_TIMES..0x0A00;

/// The address at which the process data RAM begins.
pub const RAM: u16 = 0x1000;

/// The bytes that reset the controller when three consecutive frames write them to [`RESET_ECAT`].
pub const RESET_SEQUENCE: [u8; 3] = *b"RES";

/// Address of FMMU `n`, 0..=15.
pub const fn fmmu(n: u8) -> u16 {
    FMMU + n as u16 * FMMU_LEN as u16
}

/// Address of sync manager `n`, 0..=15.
pub const fn sync_manager(n: u8) -> u16 {
    SYNC_MANAGER + n as u16 * SYNC_MANAGER_LEN as u16
}

/// Address of the status byte of sync manager `n`, 0..=15. Bit 3 means "mailbox full".
pub const fn sync_manager_status(n: u8) -> u16 {
    sync_manager(n) + 5
}

/// Address of the activate byte of sync manager `n`, 0..=15, with which a master enables the sync manager and requests a
/// mailbox repeat.
pub const fn sync_manager_activate(n: u8) -> u16 {
    sync_manager(n) + 6
}

/// Address of the PDI control byte of sync manager `n`, 0..=15, which the slave's processor writes.
pub const fn sync_manager_pdi_control(n: u8) -> u16 {
    sync_manager(n) + 7
}

/// Address of the receive time of a port, 0..=3, 4 bytes.
pub const fn receive_time(port: u8) -> u16 {
    RECEIVE_TIMES + 4 * port as u16
}

/// Address of the latched system time, 8 bytes, of an edge of a latch input, 0..[`LATCHES`].
pub const fn latch_time(input: usize, edge: LatchEdge) -> u16 {
    let edge = match edge {
        LatchEdge::Positive => 0,
        LatchEdge::Negative => 8,
    };
    LATCH_TIMES + 16 * (input % LATCHES) as u16 + edge
}

/// The register that contains `address`; `None` if no register of [`MAP`] does.
pub fn register_at(address: u16) -> Option<&'static Register> {
    let behind = MAP.partition_point(|register| register.address <= address);
    MAP[..behind].last().filter(|register| address - register.address < register.len)
}

const _: () = {
    let mut n = 1;
    while n < MAP.len() {
        assert!(MAP[n - 1].address + MAP[n - 1].len <= MAP[n].address, "registers ascend without overlap");
        n += 1;
    }
};
