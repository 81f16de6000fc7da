//! The two headers of 24 bytes, of a command and of an answer (XF EN 211 and 235, tables 1 and 2; XF ZH 190).

use bytemuck::{Pod, Zeroable};

use super::code::CommandCode;
use super::value::EtherCatState;
use super::{CheckType, HEADER_LEN, START_WORD};
use crate::ethercat::bits;
use crate::ethercat::{U16Le, U32Le};

/// The header of a command as bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct CommandLayout {
    /// 0x00: [`START_WORD`].
    start: U32Le,
    /// 0x04..0x07.
    info: [u8; 4],
    /// 0x08.
    reserve: U16Le,
    /// 0x0A.
    control: u8,
    /// 0x0B.
    index: u8,
    /// 0x0C.
    code: u8,
    /// 0x0D.
    parameter: u8,
    /// 0x0E.
    len: U16Le,
    /// 0x10.
    interrupt_clear: U32Le,
    /// 0x14..0x15.
    gpio_interrupt_clear: [u8; 2],
    /// 0x16..0x17.
    gpio_outputs: [u8; 2],
}

/// The header of an answer as bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct AnswerLayout {
    /// 0x00: [`START_WORD`].
    start: U32Le,
    /// 0x04.
    crc_errors: u8,
    /// 0x05.
    wkc_errors: u8,
    /// 0x06.
    tx_fifo: u8,
    /// 0x07.
    rx_fifo: u8,
    /// 0x08.
    state: u8,
    /// 0x09.
    errors: u8,
    /// 0x0A.
    status: u8,
    /// 0x0B.
    index: u8,
    /// 0x0C.
    code: u8,
    /// 0x0D.
    ret: u8,
    /// 0x0E.
    len: U16Le,
    /// 0x10.
    interrupts: U32Le,
    /// 0x14..0x15.
    gpio_interrupts: [u8; 2],
    /// 0x16..0x17.
    gpio_inputs: [u8; 2],
}

const _: () = assert!(size_of::<CommandLayout>() == HEADER_LEN && align_of::<CommandLayout>() == 1);
const _: () = assert!(size_of::<AnswerLayout>() == HEADER_LEN && align_of::<AnswerLayout>() == 1);

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

/// The header of a command, without its start word.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct CommandHeader {
    /// 0x04..0x07: `i0` to `i3`, by command.
    pub info: [u8; 4],
    /// 0x08.
    pub reserve: Reserve,
    /// 0x0A.
    pub control: Control,
    /// 0x0B: tells the answer to this command from others. A packet with the index and the code of the one before it
    /// counts as INFO_UPDATE_OP.
    pub index: u8,
    /// 0x0C.
    pub code: CommandCode,
    /// 0x0D: `par`, by command.
    pub parameter: u8,
    /// 0x0E: how many bytes of the data segment are used; in SPI_RECONFIG_OP the new n.
    pub len: u16,
    /// 0x10: the interrupt flags to clear, bits 31 and 29.
    pub interrupt_clear: Interrupts,
    /// 0x14..0x15: the interrupt flags of GPIO 0..15 to clear; bit k is GPIO k.
    pub gpio_interrupt_clear: u16,
    /// 0x16..0x17: outputs, taken if [`Reserve::GPIO_OUTPUTS_VALID`]. Bit k is GPIO k, for k up to 11; from firmware
    /// 0x1E on also 12 to 15, see [`swap_gpio_12_and_13`] (XF ZH 246).
    pub gpio_outputs: u16,
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

    /// The header in `bytes`, and their start word, whatever that is.
    pub fn decode(bytes: &[u8; HEADER_LEN]) -> (u32, Self) {
        let layout: &CommandLayout = bytemuck::cast_ref(bytes);
        let header = Self {
            info: layout.info,
            reserve: Reserve(layout.reserve.get()),
            control: Control(layout.control),
            index: layout.index,
            code: CommandCode::from_code(layout.code),
            parameter: layout.parameter,
            len: layout.len.get(),
            interrupt_clear: Interrupts(layout.interrupt_clear.get()),
            gpio_interrupt_clear: u16::from_le_bytes(layout.gpio_interrupt_clear),
            gpio_outputs: u16::from_le_bytes(layout.gpio_outputs),
        };
        (layout.start.get(), header)
    }

    /// The header as bytes, with its start word.
    pub fn encode(&self) -> [u8; HEADER_LEN] {
        bytemuck::cast(CommandLayout {
            start: START_WORD.into(),
            info: self.info,
            reserve: self.reserve.0.into(),
            control: self.control.0,
            index: self.index,
            code: self.code.code(),
            parameter: self.parameter,
            len: self.len.into(),
            interrupt_clear: self.interrupt_clear.0.into(),
            gpio_interrupt_clear: self.gpio_interrupt_clear.to_le_bytes(),
            gpio_outputs: self.gpio_outputs.to_le_bytes(),
        })
    }
}

/// The header of an answer, without its start word.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct AnswerHeader {
    /// 0x04: packets that the chip received with a wrong check word.
    pub crc_errors: u8,
    /// 0x05: cycles in which the working counter was wrong.
    pub wkc_errors: u8,
    /// 0x06: TxPDOs in the FIFO that the host has not read yet. It lags two exchanges behind (OBS).
    pub tx_fifo: u8,
    /// 0x07: RxPDOs in the FIFO that are not sent yet. It lags two exchanges behind (OBS).
    pub rx_fifo: u8,
    /// 0x08: the state of the network.
    pub state: NetworkState,
    /// 0x09.
    pub errors: Errors,
    /// 0x0A.
    pub status: Status,
    /// 0x0B: the index of the command that is answered.
    pub index: u8,
    /// 0x0C: the code of the command that is answered.
    pub code: CommandCode,
    /// 0x0D: `ret`, by command.
    pub ret: u8,
    /// 0x0E: how many bytes of the data segment are valid.
    pub len: u16,
    /// 0x10: the interrupt flags.
    pub interrupts: Interrupts,
    /// 0x14..0x15: the interrupt flags of GPIO 0..15; bit k is GPIO k.
    pub gpio_interrupts: u16,
    /// 0x16..0x17: the inputs of GPIO 0..15; bit k is GPIO k.
    pub gpio_inputs: u16,
}

impl AnswerHeader {
    /// The status and the length in `bytes`, which are what the check word of an answer depends on.
    pub(super) fn status_and_len(bytes: &[u8; HEADER_LEN]) -> (Status, u16) {
        let layout: &AnswerLayout = bytemuck::cast_ref(bytes);
        (Status(layout.status), layout.len.get())
    }

    /// The header in `bytes`, and their start word, whatever that is.
    pub fn decode(bytes: &[u8; HEADER_LEN]) -> (u32, Self) {
        let layout: &AnswerLayout = bytemuck::cast_ref(bytes);
        let header = Self {
            crc_errors: layout.crc_errors,
            wkc_errors: layout.wkc_errors,
            tx_fifo: layout.tx_fifo,
            rx_fifo: layout.rx_fifo,
            state: NetworkState(layout.state),
            errors: Errors(layout.errors),
            status: Status(layout.status),
            index: layout.index,
            code: CommandCode::from_code(layout.code),
            ret: layout.ret,
            len: layout.len.get(),
            interrupts: Interrupts(layout.interrupts.get()),
            gpio_interrupts: u16::from_le_bytes(layout.gpio_interrupts),
            gpio_inputs: u16::from_le_bytes(layout.gpio_inputs),
        };
        (layout.start.get(), header)
    }

    /// The header as bytes, with its start word.
    pub fn encode(&self) -> [u8; HEADER_LEN] {
        bytemuck::cast(AnswerLayout {
            start: START_WORD.into(),
            crc_errors: self.crc_errors,
            wkc_errors: self.wkc_errors,
            tx_fifo: self.tx_fifo,
            rx_fifo: self.rx_fifo,
            state: self.state.0,
            errors: self.errors.0,
            status: self.status.0,
            index: self.index,
            code: self.code.code(),
            ret: self.ret,
            len: self.len.into(),
            interrupts: self.interrupts.0.into(),
            gpio_interrupts: self.gpio_interrupts.to_le_bytes(),
            gpio_inputs: self.gpio_inputs.to_le_bytes(),
        })
    }
}
