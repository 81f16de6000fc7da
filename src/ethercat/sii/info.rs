//! The first 64 words of an EEPROM, which have a fixed layout.

use bytemuck::{Pod, Zeroable};

use super::{SII_INFO_LEN, checksum};
use crate::ethercat::{U16Le, U32Le, bits};

bits! {
    /// The mailbox protocols that a slave supports, word 0x1C.
    MailboxProtocols(u16) {
        /// Bit 0: ADS over EtherCAT.
        AOE = 1 << 0;
        /// Bit 1: Ethernet over EtherCAT.
        EOE = 1 << 1;
        /// Bit 2: CANopen over EtherCAT.
        COE = 1 << 2;
        /// Bit 3: file access over EtherCAT.
        FOE = 1 << 3;
        /// Bit 4: servo profile over EtherCAT.
        SOE = 1 << 4;
        /// Bit 5: vendor-specific protocol over EtherCAT.
        VOE = 1 << 5;
    }
}

/// Address and length of a mailbox in the memory of a slave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MailboxArea {
    /// The address of the mailbox's first byte in the slave's memory.
    pub start: u16,
    /// The length of the mailbox in bytes.
    pub len: u16,
}

/// The two mailboxes of a slave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MailboxAreas {
    /// The mailbox from the master to the slave.
    pub receive: MailboxArea,
    /// The mailbox from the slave to the master.
    pub send: MailboxArea,
}

/// The identity of a slave. Object 0x1018 holds the same numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SiiIdentity {
    /// Vendor ID.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Revision.
    pub revision: u32,
    /// Serial number.
    pub serial: u32,
}

/// The first 64 words, decoded. When they are encoded, words without a field here are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SiiInfo {
    /// Word 0: the value that registers 0x0140 and 0x0141 get at power-on.
    pub pdi_control: u16,
    /// Word 1: the value that registers 0x0150 and 0x0151 get at power-on.
    pub pdi_configuration: u16,
    /// Word 2: the value that register 0x0982 gets at power-on, in units of 10 ns.
    pub sync_pulse_length: u16,
    /// Word 3: the value that registers 0x0152 and 0x0153 get at power-on.
    pub extended_pdi_configuration: u16,
    /// Word 4: the station alias, the value that register 0x0012 gets at power-on.
    pub alias: u16,
    /// Words 5 and 6: additional configuration of newer controllers.
    pub extended_configuration: [u16; 2],
    /// Words 8 to 15: vendor ID, product code, revision, serial number.
    pub identity: SiiIdentity,
    /// Words 16 to 18: execution delay, and the delays of ports 0 and 1. Raw values, which this crate does not use.
    pub delays: [u16; 3],
    /// Words 20 to 23: the mailboxes in Bootstrap.
    pub boot_mailbox: MailboxAreas,
    /// Words 24 to 27: the mailboxes in all other states.
    pub mailbox: MailboxAreas,
    /// Word 28: supported mailbox protocols.
    pub protocols: MailboxProtocols,
    /// Word 62: the size of the EEPROM in kbit, minus 1, as the standard stores it: 15 means 16 kbit.
    pub kbit_less_1: u16,
    /// Word 63: the version of the layout, 1.
    pub version: u16,
}

/// Wire layout of the first 64 words.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Layout {
    pdi_control: U16Le,
    pdi_configuration: U16Le,
    sync_pulse_length: U16Le,
    extended_pdi_configuration: U16Le,
    alias: U16Le,
    extended_configuration: [U16Le; 2],
    checksum: [u8; 2],
    vendor: U32Le,
    product: U32Le,
    revision: U32Le,
    serial: U32Le,
    delays: [U16Le; 3],
    /// Word 0x13: reserved.
    reserved: [u8; 2],
    boot_mailbox: [U16Le; 4],
    mailbox: [U16Le; 4],
    protocols: U16Le,
    /// Words 0x1D to 0x3D: reserved.
    gap: [u8; 66],
    kbit_less_1: U16Le,
    version: U16Le,
}

const _: () = assert!(size_of::<Layout>() == SII_INFO_LEN && align_of::<Layout>() == 1);

const fn areas(words: [U16Le; 4]) -> MailboxAreas {
    let [receive, receive_len, send, send_len] = words;
    MailboxAreas {
        receive: MailboxArea { start: receive.get(), len: receive_len.get() },
        send: MailboxArea { start: send.get(), len: send_len.get() },
    }
}

fn words(areas: MailboxAreas) -> [U16Le; 4] {
    [areas.receive.start, areas.receive.len, areas.send.start, areas.send.len].map(U16Le::new)
}

impl SiiInfo {
    /// Decodes the words. The checksum is not verified.
    pub fn decode(bytes: &[u8; SII_INFO_LEN]) -> Self {
        let layout: &Layout = bytemuck::cast_ref(bytes);
        Self {
            pdi_control: layout.pdi_control.get(),
            pdi_configuration: layout.pdi_configuration.get(),
            sync_pulse_length: layout.sync_pulse_length.get(),
            extended_pdi_configuration: layout.extended_pdi_configuration.get(),
            alias: layout.alias.get(),
            extended_configuration: layout.extended_configuration.map(U16Le::get),
            identity: SiiIdentity {
                vendor: layout.vendor.get(),
                product: layout.product.get(),
                revision: layout.revision.get(),
                serial: layout.serial.get(),
            },
            delays: layout.delays.map(U16Le::get),
            boot_mailbox: areas(layout.boot_mailbox),
            mailbox: areas(layout.mailbox),
            protocols: MailboxProtocols(layout.protocols.get()),
            kbit_less_1: layout.kbit_less_1.get(),
            version: layout.version.get(),
        }
    }

    /// Encodes the words, with their checksum.
    pub fn encode(&self) -> [u8; SII_INFO_LEN] {
        let layout = Layout {
            pdi_control: self.pdi_control.into(),
            pdi_configuration: self.pdi_configuration.into(),
            sync_pulse_length: self.sync_pulse_length.into(),
            extended_pdi_configuration: self.extended_pdi_configuration.into(),
            alias: self.alias.into(),
            extended_configuration: self.extended_configuration.map(U16Le::new),
            checksum: [0; 2],
            vendor: self.identity.vendor.into(),
            product: self.identity.product.into(),
            revision: self.identity.revision.into(),
            serial: self.identity.serial.into(),
            delays: self.delays.map(U16Le::new),
            reserved: [0; 2],
            boot_mailbox: words(self.boot_mailbox),
            mailbox: words(self.mailbox),
            protocols: self.protocols.0.into(),
            gap: [0; 66],
            kbit_less_1: self.kbit_less_1.into(),
            version: self.version.into(),
        };
        let bytes: [u8; SII_INFO_LEN] = bytemuck::cast(layout);
        let checksum = [bytes.first_chunk().map_or(0, checksum), 0];
        bytemuck::cast(Layout { checksum, ..layout })
    }
}
