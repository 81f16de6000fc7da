//! The two headers of 24 bytes, of a command and of an answer (XF EN 211 and 235, tables 1 and 2; XF ZH 190).

use super::code::CommandCode;
use super::value::EtherCatState;
use super::{CheckType, HEADER_LEN, START_WORD};
use crate::ethercat::bits;

bits! {
    /// Word 0x08 of a command, which the manuals call reserve.
    Reserve(u16) {
        /// Bit 15: the GPIO output bytes of this header are to be taken (XF EN 211).
        GPIO_OUTPUTS_VALID = 1 << 15;
        /// Bit 12, in ECAT_INIT_OP and from firmware 0x22 on: the clock of the first slave leads (XF ZH 384).
        MASTER_SHIFT = 1 << 12;
        /// Bit 11, in ECAT_INIT_OP and from firmware 0x22 on: LRW is enabled (XF EN 375).
        LRW = 1 << 11;
    }

    /// Byte 0x0A of a command: clears errors, and asks for what a packet can ask for beside its command.
    Control(u8) {
        /// Bit 0: "header outputs valid" in the manuals, "update state" in the vendor's header: send 0.
        BIT_0 = 1 << 0;
        /// Bit 1: the chip reads the states of all slaves, which makes the packet non-immediate (XF EN 211).
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

    /// Byte 0x09 of an answer: levels in bits 0 to 2, errors in bits 3 to 7. An error stays until a command clears it.
    Errors(u8) {
        /// Bit 0: pin 52 reports a link; depends on the circuit (XF EN 236).
        LINK_PIN = 1 << 0;
        /// Bit 1: the PHY reported a link while the network was initialised.
        PHY_LINK = 1 << 1;
        /// Bit 2: reserved in the manuals, "ECAT state error" in the vendor's header (OBS).
        STATE = 1 << 2;
        /// Bit 3: a non-immediate command failed.
        NON_IMMEDIATE = 1 << 3;
        /// Bit 4: a packet with a wrong start or end word.
        SPI = 1 << 4;
        /// Bit 5: a write found the RxFIFO full, or the FIFOs exceed their memory.
        FIFO = 1 << 5;
        /// Bit 6: a packet with a wrong check word.
        CRC = 1 << 6;
        /// Bit 7: a command with a wrong parameter, or a non-immediate one while another runs.
        COMMAND = 1 << 7;
        /// Bits 3 to 7: those that are errors.
        ALL = 0xF8;
    }

    /// Byte 0x0A of an answer.
    Status(u8) {
        /// Bit 2: the cycle of the distributed clocks is stable.
        DC_STABLE = 1 << 2;
        /// Bit 3: the network port is initialised.
        PORT_READY = 1 << 3;
        /// Bit 4: process data are configured and exchanged.
        PDO_CONFIGURED = 1 << 4;
        /// Bit 5: the answer is to no command; its return byte and its data mean nothing.
        NOP = 1 << 5;
        /// Bit 6: the RxFIFO is put out in each cycle.
        FIFO_ON = 1 << 6;
        /// Bit 7: a non-immediate command runs.
        BUSY = 1 << 7;
    }

    /// Word 0x10: interrupts, as flags in an answer, to clear them in a command, and as a mask in ECAT_INT_SET_ENABLE.
    Interrupts(u32) {
        /// Bit 31: an EtherCAT packet was received.
        ETHERCAT = 1 << 31;
        /// Bit 29: encoder; in the header alone.
        ENCODER = 1 << 29;
        /// Bit 25: the RxFIFO fell to its low limit (XF EN 1310).
        RX_FIFO_LOW = 1 << 25;
        /// Bit 24: the TxFIFO rose to its high limit.
        TX_FIFO_HIGH = 1 << 24;
        /// Bit 23: a packet had a wrong check word.
        CRC = 1 << 23;
        /// Bit 22: the working counter was wrong.
        WORKING_COUNTER = 1 << 22;
    }
}

impl Control {
    /// The bits that clear these errors; the levels among them have none.
    pub const fn clearing(errors: Errors) -> Self {
        Self(errors.0 & Errors::ALL.0)
    }
}

/// The outputs of a command's header as GPIOs, or GPIOs as those outputs: bit 12 drives GPIO 13, and bit 13 GPIO 12
/// (XF EN 211, XF ZH 246).
pub const fn swap_gpio_12_and_13(bits: u16) -> u16 {
    bits & !0x3000 | (bits & 0x1000) << 1 | (bits & 0x2000) >> 1
}

impl Status {
    /// Bits 1 and 0 of the byte: the check type.
    const CHECK_TYPE: u8 = 0b11;

    /// The type of the answer's check word; the two bits where they are undefined, 1 or 2.
    ///
    /// # Errors
    /// The bits, if they are 1 or 2.
    pub const fn check_type(self) -> Result<CheckType, u8> {
        match CheckType::from_code(self.0 & Self::CHECK_TYPE) {
            Some(kind) => Ok(kind),
            None => Err(self.0 & Self::CHECK_TYPE),
        }
    }

    /// The same status with that check type.
    #[must_use]
    pub const fn with_check_type(self, kind: CheckType) -> Self {
        Self(self.0 & !Self::CHECK_TYPE | kind.code())
    }
}

/// A byte that reports an EtherCAT state: 0x08 of an answer, and the return byte of ECAT_STATE_GET.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct NetworkState(pub u8);

impl NetworkState {
    /// 0: the network is not initialised.
    pub const NONE: Self = Self(0);
    /// Bit 4: an error, beside the state (OBS).
    pub const ERROR: u8 = 0x10;

    /// The state; `None` for 0 and for values that no manual lists.
    pub const fn state(self) -> Option<EtherCatState> {
        EtherCatState::from_code(self.0 & 0x0F)
    }

    /// Whether the error bit is set.
    pub const fn has_error(self) -> bool {
        self.0 & Self::ERROR != 0
    }
}

impl From<EtherCatState> for NetworkState {
    fn from(state: EtherCatState) -> Self {
        Self(state.code())
    }
}

/// Headers, with the place of each field.
macro_rules! headers {
    ($($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty = $at:literal,)* })*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: $type,)*
        }

        impl $name {
            /// The header in `bytes`, and their start word, whatever that is.
            pub fn decode(bytes: &[u8; HEADER_LEN]) -> (u32, Self) {
                (u32::from_le_bytes(bytes_at(bytes, 0)), Self { $($field: HeaderField::get(bytes, $at),)* })
            }

            /// The header as bytes, with its start word.
            pub fn encode(&self) -> [u8; HEADER_LEN] {
                let mut bytes = [0; HEADER_LEN];
                bytes[..4].copy_from_slice(&START_WORD.to_le_bytes());
                $(self.$field.put(&mut bytes, $at);)*
                bytes
            }
        }
    )*};
}

/// What stands in a header.
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
    /// The header of a command, without its start word.
    CommandHeader {
        /// 0x04..0x07: `i0` to `i3`, by command.
        info: [u8; 4] = 0x04,
        /// 0x08.
        reserve: Reserve = 0x08,
        /// 0x0A.
        control: Control = 0x0A,
        /// 0x0B: tells the answer to this command from others. A packet with the index and the code of the one before it
        /// counts as INFO_UPDATE_OP.
        index: u8 = 0x0B,
        /// 0x0C.
        code: CommandCode = 0x0C,
        /// 0x0D: `par`, by command.
        parameter: u8 = 0x0D,
        /// 0x0E: how many bytes of the data segment are used; in SPI_RECONFIG_OP the new n.
        len: u16 = 0x0E,
        /// 0x10: the interrupt flags to clear, bits 31 and 29.
        interrupt_clear: Interrupts = 0x10,
        /// 0x14..0x15: the interrupt flags of GPIO 0..15 to clear; bit k is GPIO k.
        gpio_interrupt_clear: u16 = 0x14,
        /// 0x16..0x17: outputs, taken if [`Reserve::GPIO_OUTPUTS_VALID`]. Bit k is GPIO k, for k up to 11; from firmware
        /// 0x1E on also 12 to 15, see [`swap_gpio_12_and_13`] (XF ZH 246).
        gpio_outputs: u16 = 0x16,
    }

    /// The header of an answer, without its start word.
    AnswerHeader {
        /// 0x04: packets that the chip received with a wrong check word.
        crc_errors: u8 = 0x04,
        /// 0x05: cycles in which the working counter was wrong.
        wkc_errors: u8 = 0x05,
        /// 0x06: TxPDOs in the FIFO that the host has not read yet. It lags two exchanges behind (OBS).
        tx_fifo: u8 = 0x06,
        /// 0x07: RxPDOs in the FIFO that are not sent yet. It lags two exchanges behind (OBS).
        rx_fifo: u8 = 0x07,
        /// 0x08: the state of the network.
        state: NetworkState = 0x08,
        /// 0x09.
        errors: Errors = 0x09,
        /// 0x0A.
        status: Status = 0x0A,
        /// 0x0B: the index of the command that is answered.
        index: u8 = 0x0B,
        /// 0x0C: the code of the command that is answered.
        code: CommandCode = 0x0C,
        /// 0x0D: `ret`, by command.
        ret: u8 = 0x0D,
        /// 0x0E: how many bytes of the data segment are valid.
        len: u16 = 0x0E,
        /// 0x10: the interrupt flags.
        interrupts: Interrupts = 0x10,
        /// 0x14..0x15: the interrupt flags of GPIO 0..15; bit k is GPIO k.
        gpio_interrupts: u16 = 0x14,
        /// 0x16..0x17: the inputs of GPIO 0..15; bit k is GPIO k.
        gpio_inputs: u16 = 0x16,
    }
}

impl CommandHeader {
    /// The header that asks for nothing, with an index.
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
    /// The status and the length in `bytes`, which are what the check word of an answer depends on.
    pub(super) fn status_and_len(bytes: &[u8; HEADER_LEN]) -> (Status, u16) {
        (HeaderField::get(bytes, 0x0A), HeaderField::get(bytes, 0x0E))
    }
}
