//! The two headers of 24 bytes, of a command and of an answer (XF EN 211 and 235, tables 1 and 2; XF ZH 190).

use super::command_table::CommandCode;
use super::value::EtherCatState;
use super::{CheckType, HEADER_LEN, START_WORD};
use crate::ethercat::bits;

bits! {
    /// Flags at word 0x08 of a command, called reserve in the manuals.
    Reserve(u16) {
        /// Bit 15: the chip takes the GPIO outputs of this header (XF EN 211).
        GPIO_OUTPUTS_VALID = 1 << 15;
        /// Bit 12, in ECAT_INIT_OP and from firmware 0x22 on: the first slave's clock is the reference clock
        /// (XF ZH 384).
        MASTER_SHIFT = 1 << 12;
        /// Bit 11, in ECAT_INIT_OP and from firmware 0x22 on: LRW datagrams are enabled (XF EN 375).
        LRW = 1 << 11;
    }

    /// Byte 0x0A of a command: clears error bits, and may request an update of the slaves' states in addition to the
    /// command itself.
    Control(u8) {
        /// Bit 0: "header outputs valid" in the manuals, "update state" in the vendor's header. Always send 0, since
        /// the sources disagree.
        BIT_0 = 1 << 0;
        /// Bit 1: the chip reads the states of all slaves. This takes time, so the packet counts as a non-immediate
        /// command, whatever its code (XF EN 211).
        UPDATE_STATE = 1 << 1;
        /// Bit 3: clears [`Errors::NON_IMMEDIATE`].
        CLEAR_NON_IMMEDIATE = 1 << 3;
        /// Bit 4: clears [`Errors::SPI`].
        CLEAR_SPI = 1 << 4;
        /// Bit 5: clears [`Errors::FIFO`].
        CLEAR_FIFO = 1 << 5;
        /// Bit 6: clears [`Errors::CRC`].
        CLEAR_CRC = 1 << 6;
        /// Bit 7: clears [`Errors::COMMAND`].
        CLEAR_COMMAND = 1 << 7;
        /// Bits 3 to 7: clears all errors.
        CLEAR_ALL = 0xF8;
    }

    /// Byte 0x09 of an answer. Bits 0 to 2 are levels: each shows a present condition and cannot be cleared. Bits 3 to
    /// 7 are errors: each stays set until a command clears it.
    Errors(u8) {
        /// Bit 0: pin 52 reports a network link. It does so only if the circuit around the chip wires that pin to a
        /// link signal (XF EN 236).
        LINK_PIN = 1 << 0;
        /// Bit 1: the PHY reported a network link while the network was initialised.
        PHY_LINK = 1 << 1;
        /// Bit 2: reserved in the manuals, "ECAT state error" in the vendor's header (OBS).
        STATE = 1 << 2;
        /// Bit 3: a non-immediate command failed.
        NON_IMMEDIATE = 1 << 3;
        /// Bit 4: a packet had a wrong start or end word.
        SPI = 1 << 4;
        /// Bit 5: a write found the RxFIFO full, or FIFO_INIT found that both FIFOs together need more than their
        /// 0x4000 bytes.
        FIFO = 1 << 5;
        /// Bit 6: a packet had a wrong check word.
        CRC = 1 << 6;
        /// Bit 7: a command had a wrong parameter, or a non-immediate command came while another one was running.
        COMMAND = 1 << 7;
        /// Bits 3 to 7: all error bits. Bits 0 to 2 are not among them, since they show present conditions, not errors.
        ALL = 0xF8;
    }

    /// Byte 0x0A of an answer: the state of the chip, and the type of the check word.
    Status(u8) {
        /// Bit 2: the cycle of the distributed clocks is stable.
        DC_STABLE = 1 << 2;
        /// Bit 3: the network port is initialised.
        PORT_READY = 1 << 3;
        /// Bit 4: process data are configured and exchanged.
        PDO_CONFIGURED = 1 << 4;
        /// Bit 5: the answer has no result, since the chip took the packet for a repetition of the previous packet, or
        /// rejected it. Its return byte and its data have no meaning.
        NOP = 1 << 5;
        /// Bit 6: the chip takes an RxPDO out of the RxFIFO in each cycle.
        FIFO_ON = 1 << 6;
        /// Bit 7: a non-immediate command runs.
        BUSY = 1 << 7;
    }

    /// Word 0x10: interrupts. In an answer these are flags, in a command they clear flags, in ECAT_INT_SET_ENABLE they
    /// are a mask.
    Interrupts(u32) {
        /// Bit 31: the chip received an EtherCAT frame.
        ETHERCAT = 1 << 31;
        /// Bit 29: encoder interrupt. It is used only in headers: in ECAT_INT_SET_ENABLE, byte 5 of the data enables
        /// the encoder's interrupts.
        ENCODER = 1 << 29;
        /// Bit 25: the RxFIFO fell to the level that ECAT_SET_FIFO_TH sets for it (XF EN 1310).
        RX_FIFO_LOW = 1 << 25;
        /// Bit 24: the TxFIFO rose to the level that ECAT_SET_FIFO_TH sets for it.
        TX_FIFO_HIGH = 1 << 24;
        /// Bit 23: a packet had a wrong check word.
        CRC = 1 << 23;
        /// Bit 22: the working counter of a cycle was wrong.
        WORKING_COUNTER = 1 << 22;
    }
}

impl Control {
    /// The control bits that clear these errors. Bits 0 to 2 of `errors` are left out, since they show present
    /// conditions, which cannot be cleared.
    pub const fn clearing(errors: Errors) -> Self {
        Self(errors.0 & Errors::ALL.0)
    }
}

/// Converts between the outputs in a command's header and GPIO bits: bit 12 drives GPIO 13, and bit 13 drives GPIO 12
/// (XF EN 211, XF ZH 246).
pub const fn swap_gpio_12_and_13(bits: u16) -> u16 {
    bits & !0x3000 | (bits & 0x1000) << 1 | (bits & 0x2000) >> 1
}

impl Status {
    /// Bits 1 and 0 of the status byte: the check type.
    const CHECK_TYPE: u8 = 0b11;

    /// The type of the answer's check word.
    ///
    /// # Errors
    /// The value of the two bits, if it is undefined: 1 or 2.
    pub const fn check_type(self) -> Result<CheckType, u8> {
        match CheckType::from_code(self.0 & Self::CHECK_TYPE) {
            Some(kind) => Ok(kind),
            None => Err(self.0 & Self::CHECK_TYPE),
        }
    }

    /// The same status byte, but with another type of the check word.
    #[must_use]
    pub const fn with_check_type(self, kind: CheckType) -> Self {
        Self(self.0 & !Self::CHECK_TYPE | kind.code())
    }
}

/// A byte that reports an EtherCAT state: byte 0x08 of an answer, and the return byte of ECAT_STATE_GET.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct NetworkState(pub u8);

impl NetworkState {
    /// 0: the network is not initialised.
    pub const NONE: Self = Self(0);
    /// Bit 4, in addition to the state: a slave reports an error, as by the error bit of its AL status (OBS).
    pub const ERROR: u8 = 0x10;

    /// The state; `None` for 0 and for values that are not in the manuals.
    pub const fn state(self) -> Option<EtherCatState> {
        EtherCatState::from_code(self.0 & 0x0F)
    }

    /// Whether [`Self::ERROR`] is set: a slave refused or left a state.
    pub const fn has_error(self) -> bool {
        self.0 & Self::ERROR != 0
    }
}

impl From<EtherCatState> for NetworkState {
    fn from(state: EtherCatState) -> Self {
        Self(state.code())
    }
}

/// Declares the types of the two headers, with the byte offset of each field.
macro_rules! headers {
    ($($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty = $at:literal,)* })*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: $type,)*
        }

        impl $name {
            /// Decodes the start word, without checking it, and the header.
            pub fn decode(bytes: &[u8; HEADER_LEN]) -> (u32, Self) {
                (u32::from_le_bytes(bytes_at(bytes, 0)), Self { $($field: HeaderField::get(bytes, $at),)* })
            }

            /// Encodes the header, with the start word.
            pub fn encode(&self) -> [u8; HEADER_LEN] {
                let mut bytes = [0; HEADER_LEN];
                bytes[..4].copy_from_slice(&START_WORD.to_le_bytes());
                $(self.$field.put(&mut bytes, $at);)*
                bytes
            }
        }
    )*};
}

/// A type that can be read from, and written to, a byte offset of a header.
trait HeaderField {
    fn get(bytes: &[u8; HEADER_LEN], at: usize) -> Self;
    fn put(self, bytes: &mut [u8; HEADER_LEN], at: usize);
}

macro_rules! header_fields {
    ($($type:ty, |$value:ident| $bytes:expr, |$found:ident| $read:expr;)*) => {$(
        impl HeaderField for $type {
            #[inline(always)]
            fn get(bytes: &[u8; HEADER_LEN], at: usize) -> Self {
                let $found = bytes_at(bytes, at);
                $read
            }

            #[inline(always)]
            fn put(self, bytes: &mut [u8; HEADER_LEN], at: usize) {
                let $value = self;
                let value = $bytes;
                bytes[at..at + value.len()].copy_from_slice(&value);
            }
        }
    )*};
}

header_fields! {
    u8, |byte| [byte], |bytes| u8::from_le_bytes(bytes);
    u16, |word| word.to_le_bytes(), |bytes| u16::from_le_bytes(bytes);
    [u8; 4], |info| info, |bytes| bytes;
    CommandCode, |code| [code.code()], |bytes| CommandCode::from_code(u8::from_le_bytes(bytes));
    NetworkState, |state| [state.0], |bytes| Self(u8::from_le_bytes(bytes));
    Control, |control| [control.0], |bytes| Self(u8::from_le_bytes(bytes));
    Errors, |errors| [errors.0], |bytes| Self(u8::from_le_bytes(bytes));
    Status, |status| [status.0], |bytes| Self(u8::from_le_bytes(bytes));
    Reserve, |reserve| reserve.0.to_le_bytes(), |bytes| Self(u16::from_le_bytes(bytes));
    Interrupts, |flags| flags.0.to_le_bytes(), |bytes| Self(u32::from_le_bytes(bytes));
}

#[inline(always)]
fn bytes_at<const N: usize>(bytes: &[u8; HEADER_LEN], at: usize) -> [u8; N] {
    core::array::from_fn(|n| bytes[at + n])
}

headers! {
    /// The header of a command, without the start word.
    CommandHeader {
        /// Bytes 0x04..0x07: the information bytes `i0` to `i3`, whose meaning depends on the command.
        info: [u8; 4] = 0x04,
        /// Word at 0x08: the flags that the manuals call reserve.
        reserve: Reserve = 0x08,
        /// Byte 0x0A: clears errors, and requests an update of the slaves' states.
        control: Control = 0x0A,
        /// Byte 0x0B: the index, which the answer repeats. A packet with the same index and code as the previous one
        /// counts as INFO_UPDATE_OP.
        index: u8 = 0x0B,
        /// Byte 0x0C: the command code.
        code: CommandCode = 0x0C,
        /// Byte 0x0D: the parameter `par`, whose meaning depends on the command.
        parameter: u8 = 0x0D,
        /// Word 0x0E: the number of bytes used in the data segment; in SPI_RECONFIG_OP the new n (size of the data
        /// segment).
        len: u16 = 0x0E,
        /// Double word 0x10: the interrupt flags to clear, bits 31 and 29.
        interrupt_clear: Interrupts = 0x10,
        /// Bytes 0x14..0x15: the interrupt flags of GPIO 0..15 to clear; bit k is GPIO k.
        gpio_interrupt_clear: u16 = 0x14,
        /// Bytes 0x16..0x17: the GPIO outputs, taken if [`Reserve::GPIO_OUTPUTS_VALID`] is set. Bit k is GPIO k, for k
        /// up to 11; from firmware 0x1E on also 12 to 15, see [`swap_gpio_12_and_13`] (XF ZH 246).
        gpio_outputs: u16 = 0x16,
    }

    /// The header of an answer, without the start word.
    AnswerHeader {
        /// Byte 0x04: number of packets that the chip received with a wrong check word. The driver in
        /// [`host`](super::host) assumes that the count stops at 255. CRC_ERR_CNT_CLR clears it.
        crc_errors: u8 = 0x04,
        /// Byte 0x05: number of cycles with a wrong working counter. The driver in [`host`](super::host) assumes that
        /// the count stops at 255.
        wkc_errors: u8 = 0x05,
        /// Byte 0x06: number of TxPDOs in the FIFO that the host has not read yet. The value lags two exchanges behind
        /// (OBS).
        tx_fifo: u8 = 0x06,
        /// Byte 0x07: number of RxPDOs in the FIFO that the chip has not sent yet. The value lags two exchanges behind
        /// (OBS).
        rx_fifo: u8 = 0x07,
        /// Byte 0x08: the lowest EtherCAT state of all slaves, as the chip last read their states.
        state: NetworkState = 0x08,
        /// Byte 0x09: present conditions in bits 0 to 2, such as a network link, and errors in bits 3 to 7.
        errors: Errors = 0x09,
        /// Byte 0x0A: flags of the chip's state, such as busy, and the type of the check word.
        status: Status = 0x0A,
        /// Byte 0x0B: the index of the answered command.
        index: u8 = 0x0B,
        /// Byte 0x0C: the code of the answered command.
        code: CommandCode = 0x0C,
        /// Byte 0x0D: the return byte `ret`, whose meaning depends on the command.
        ret: u8 = 0x0D,
        /// Word 0x0E: the number of valid bytes in the data segment.
        len: u16 = 0x0E,
        /// Double word 0x10: the interrupt flags.
        interrupts: Interrupts = 0x10,
        /// Bytes 0x14..0x15: the interrupt flags of GPIO 0..15; bit k is GPIO k.
        gpio_interrupts: u16 = 0x14,
        /// Bytes 0x16..0x17: the inputs of GPIO 0..15; bit k is GPIO k.
        gpio_inputs: u16 = 0x16,
    }
}

impl CommandHeader {
    /// The header of an INFO_UPDATE_OP packet with this index, in which all other fields are 0.
    /// [`write_request`](super::write_request) replaces the command code and the arguments by those of a request.
    pub const fn with_index(index: u8) -> Self {
        Self {
            info: [0; 4],
            reserve: Reserve::NONE,
            control: Control::NONE,
            index,
            code: CommandCode::InfoUpdate,
            parameter: 0,
            len: 0,
            interrupt_clear: Interrupts::NONE,
            gpio_interrupt_clear: 0,
            gpio_outputs: 0,
        }
    }
}

impl AnswerHeader {
    /// Decodes only the status and the length, on which the check word of an answer depends.
    pub(super) fn status_and_len(bytes: &[u8; HEADER_LEN]) -> (Status, u16) {
        (HeaderField::get(bytes, 0x0A), HeaderField::get(bytes, 0x0E))
    }
}
