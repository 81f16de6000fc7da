//! AL status codes: why a slave refuses a change of its AL state, or has left a state.

use super::named_codes::named_codes;

/// The AL status code, register 0x0134 (ETG.1000.6 table 11, ETG.1020).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct AlStatus(pub u16);

named_codes! {
    AlStatus as "0x{:04X}";
    NONE = 0x0000, "no error";
    UNSPECIFIED = 0x0001, "unspecified error";
    NO_MEMORY = 0x0002, "no memory";
    INVALID_SETUP = 0x0003, "invalid device setup";
    REVISION_MISMATCH = 0x0004, "revision mismatch";
    SII_MISMATCH = 0x0006, "SII and firmware do not match";
    FIRMWARE_UPDATE = 0x0007, "firmware update failed";
    LICENSE = 0x000E, "license error";
    INVALID_CHANGE = 0x0011, "invalid requested state change";
    UNKNOWN_STATE = 0x0012, "unknown requested state";
    BOOT_UNSUPPORTED = 0x0013, "bootstrap not supported";
    NO_FIRMWARE = 0x0014, "no valid firmware";
    INVALID_BOOT_MAILBOX = 0x0015, "invalid mailbox configuration in bootstrap";
    INVALID_MAILBOX = 0x0016, "invalid mailbox configuration in pre-operational";
    INVALID_SYNC_MANAGER = 0x0017, "invalid sync manager configuration";
    NO_INPUTS = 0x0018, "no valid inputs available";
    NO_OUTPUTS = 0x0019, "no valid outputs";
    SYNCHRONIZATION = 0x001A, "synchronization error";
    WATCHDOG = 0x001B, "sync manager watchdog";
    SYNC_MANAGER_TYPES = 0x001C, "invalid sync manager types";
    INVALID_OUTPUTS = 0x001D, "invalid output configuration: sync manager 2 does not fit the mapped outputs";
    INVALID_INPUTS = 0x001E, "invalid input configuration: sync manager 3 does not fit the mapped inputs";
    INVALID_WATCHDOG = 0x001F, "invalid watchdog configuration";
    NEEDS_COLD_START = 0x0020, "slave needs a cold start";
    NEEDS_INIT = 0x0021, "slave needs Init";
    NEEDS_PREOP = 0x0022, "slave needs pre-operational";
    NEEDS_SAFEOP = 0x0023, "slave needs safe-operational";
    INVALID_INPUT_MAPPING = 0x0024, "invalid input mapping (0x1A00 to 0x1BFF, 0x1C13)";
    INVALID_OUTPUT_MAPPING = 0x0025, "invalid output mapping (0x1600 to 0x17FF, 0x1C12)";
    INCONSISTENT_SETTINGS = 0x0026, "inconsistent settings";
    FREE_RUN_UNSUPPORTED = 0x0027, "free run not supported";
    SYNC_MODE_UNSUPPORTED = 0x0028, "synchronization mode not supported";
    NEEDS_THREE_BUFFERS = 0x0029, "free run needs three-buffer mode";
    BACKGROUND_WATCHDOG = 0x002A, "background watchdog";
    NO_INPUTS_AND_OUTPUTS = 0x002B, "no valid inputs and outputs";
    FATAL_SYNC = 0x002C, "fatal synchronization error: SYNC is missing";
    NO_SYNC = 0x002D, "no SYNC received";
    CYCLE_TOO_SMALL = 0x002E, "cycle time too small, in older lists invalid input FMMU";
    INVALID_DC_SYNC = 0x0030, "invalid DC SYNC configuration";
    INVALID_DC_LATCH = 0x0031, "invalid DC latch configuration";
    PLL = 0x0032, "PLL error";
    DC_SYNC_IO = 0x0033, "DC SYNC IO error";
    DC_SYNC_TIMEOUT = 0x0034, "DC SYNC timeout";
    INVALID_DC_CYCLE = 0x0035, "invalid DC SYNC cycle time";
    INVALID_SYNC0_CYCLE = 0x0036, "invalid SYNC0 cycle time";
    INVALID_SYNC1_CYCLE = 0x0037, "invalid SYNC1 cycle time";
    MAILBOX_AOE = 0x0041, "mailbox: ADS over EtherCAT";
    MAILBOX_EOE = 0x0042, "mailbox: Ethernet over EtherCAT";
    MAILBOX_COE = 0x0043, "mailbox: CANopen over EtherCAT";
    MAILBOX_FOE = 0x0044, "mailbox: file access over EtherCAT";
    MAILBOX_SOE = 0x0045, "mailbox: servo profile over EtherCAT";
    MAILBOX_VOE = 0x004F, "mailbox: vendor-specific protocol over EtherCAT";
    EEPROM_NO_ACCESS = 0x0050, "EEPROM has not been assigned to the slave's controller";
    EEPROM_ERROR = 0x0051, "EEPROM access error";
    EXTERNAL_HARDWARE = 0x0052, "external hardware not ready";
    RESTARTED_LOCALLY = 0x0060, "slave restarted locally";
    ID_UPDATED = 0x0061, "device identification value updated";
    MODULES_MISMATCH = 0x0070, "detected modules do not match the configured ones";
    SUPPLY_LOW = 0x0080, "supply voltage too low";
    SUPPLY_HIGH = 0x0081, "supply voltage too high";
    TEMPERATURE_LOW = 0x0082, "temperature too low";
    TEMPERATURE_HIGH = 0x0083, "temperature too high";
    APPLICATION = 0x00F0, "application controller available";
}
