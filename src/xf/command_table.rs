//! All command codes and functions, as one table (XF EN 272, tables 3 and 4, and the block of each command).
//!
//! Five codes, 31 to 35, have 29 functions, selected by the parameter byte; the other codes are one function each. A
//! code that only the vendor's header names is [`CommandCode::Unknown`] here, since the chip does not know it either.
//!
//! To add a command, add its row here, then its type in [`request`](super::request) and its row in the table there, its
//! answer in [`response`](super::response), its effect in the model's `chip/commands.rs`, and its entries in the lists
//! of the tests.

use core::fmt;

/// Whether the chip completes a command before the next packet, or needs more time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CommandTiming {
    /// The command is complete at once: its answer has the result.
    Immediate,
    /// The command takes time. Meanwhile [`Status::BUSY`](super::Status::BUSY) is set and the chip accepts no other
    /// non-immediate command.
    NonImmediate,
    /// `[OURS]` RECV_MAILBOX: with parameter 0 the chip fetches a message from a slave's mailbox, which takes time.
    /// With any other parameter it returns bytes that it has fetched already, and the command is complete at once.
    ByParameter,
}

/// The part of an answer that carries the result of the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AnswerForm {
    /// The command has no result.
    Nothing,
    /// The result is in the return byte of the header.
    Value,
    /// The result is in the data segment.
    Data,
    /// The result is in the return byte and in the data segment.
    ValueAndData,
    /// The codes 31 to 35: the row of the function in [`CommandInfo::functions`] says which part has the result.
    ByFunction,
}

/// Whether a command changes anything, so that it must not run again when its answer was lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CommandEffect {
    /// The command only reads: all immediate commands with a result, except those under the other variants. In the rows
    /// of the codes 31 to 35 this is true only for functions with a result.
    Reads,
    /// The command has an effect. Two such commands return a result as well: 5 (PDO_DATA_FIFO_OP) takes TxPDOs out of
    /// the FIFO, and 24 (CRC_ERR_CNT_CLR) clears a counter.
    Acts,
    /// The arguments select a read or an effect.
    ByArguments,
}

/// A command of the chip: its code, its name, its timing, its answer and its effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandInfo {
    /// The code in byte 0x0C of the command that this row describes.
    pub code: CommandCode,
    /// The command's name in the manuals, such as `ECM_CMD_ECAT_INIT_OP`.
    pub name: &'static str,
    /// Whether the chip completes the command before the next packet, or needs more time.
    pub timing: CommandTiming,
    /// The part of the answer that carries the result.
    pub answer: AnswerForm,
    /// Whether the command changes anything.
    pub effect: CommandEffect,
    /// The functions that the parameter byte selects; empty if the command is a single function.
    pub functions: &'static [Function],
}

/// A function of the codes 31 to 35, each of which has several functions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Function {
    /// The parameter byte that selects the function.
    pub parameter: u8,
    /// The function's name in the manuals, such as `ECM_GpioSetMode`.
    pub name: &'static str,
    /// The first firmware version that has the function, in the numbers that FW_VERSION_GET returns, such as 9 or 0x22.
    /// 0 if the manuals name no version or only "certain versions".
    pub since: u8,
    /// The part of the answer that carries the result.
    pub answer: AnswerForm,
}

macro_rules! commands {
    ($($variant:ident = $code:literal, $name:literal, $timing:ident, $answer:ident, $effect:ident;)*) => {
        /// A command code: byte 0x0C of a command's header, repeated in the header of its answer. A code that is not in
        /// the manuals becomes [`Self::Unknown`] with its number.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum CommandCode {
            $(#[doc = concat!("Code ", $code, ", `", $name, "`.")] #[doc(alias = $name)] $variant,)*
            /// A code that is not in the manuals, with its number; the chip refuses it.
            Unknown(u8),
        }

        /// All commands in ascending order of their codes.
        pub static COMMANDS: [CommandInfo; [$($code),*].len()] = [$(CommandInfo {
            code: CommandCode::$variant,
            name: $name,
            timing: CommandTiming::$timing,
            answer: AnswerForm::$answer,
            effect: CommandEffect::$effect,
            functions: functions_of($code),
        },)*];

        impl CommandCode {
            /// The command with this code; [`Self::Unknown`] for a code that is not in the manuals.
            pub const fn from_code(code: u8) -> Self {
                match code {
                    $($code => Self::$variant,)*
                    other => Self::Unknown(other),
                }
            }

            /// The code on the wire.
            pub const fn code(self) -> u8 {
                match self {
                    $(Self::$variant => $code,)*
                    Self::Unknown(code) => code,
                }
            }
        }
    };
}

commands! {
    InfoUpdate = 0, "ECM_CMD_INFO_UPDATE_OP", Immediate, Nothing, Acts;
    EcatInit = 1, "ECM_CMD_ECAT_INIT_OP", NonImmediate, Nothing, Acts;
    Reconfig = 2, "ECM_CMD_ECAT_RECONFIG_OP", NonImmediate, Nothing, Acts;
    InitDc = 3, "ECM_CMD_ECAT_INIT_DC_OP", NonImmediate, Nothing, Acts;
    PdoWorkingCounterGet = 4, "ECM_CMD_ECAT_PDO_WC_GET", Immediate, Data, Reads;
    PdoDataFifo = 5, "ECM_CMD_ECAT_PDO_DATA_FIFO_OP", Immediate, ValueAndData, Acts;
    PdoData = 6, "ECM_CMD_ECAT_PDO_DATA_OP", Immediate, ValueAndData, ByArguments;
    PdoConfigSet = 7, "ECM_CMD_ECAT_PDO_CONFIG_SET", NonImmediate, Nothing, Acts;
    PdoConfigRequest = 8, "ECM_CMD_ECAT_PDO_CONFIG_REQ", NonImmediate, Nothing, Acts;
    PdoConfigGet = 9, "ECM_CMD_ECAT_PDO_CONFIG_GET", Immediate, Data, Reads;
    SdoRequest = 10, "ECM_CMD_ECAT_SDO_REQ", NonImmediate, Nothing, Acts;
    SdoGet = 11, "ECM_CMD_ECAT_SDO_GET", Immediate, Data, Reads;
    StateSet = 12, "ECM_CMD_ECAT_STATE_SET", NonImmediate, Nothing, Acts;
    StateGet = 13, "ECM_CMD_ECAT_STATE_GET", Immediate, Value, Reads;
    SlaveInfoGet = 15, "ECM_CMD_ECAT_SLV_INFO_GET", Immediate, Data, Reads;
    SlaveCountGet = 16, "ECM_CMD_ECAT_SLV_CNT_GET", Immediate, Value, Reads;
    FifoEnable = 18, "ECM_CMD_FIFO_ENABLE", Immediate, Nothing, Acts;
    FifoPackSizeGet = 19, "ECM_CMD_FIFO_PACK_SIZE_GET", Immediate, Data, Reads;
    SpiPackSizeGet = 20, "ECM_CMD_SPI_PACK_SIZE_GET", Immediate, Data, Reads;
    SpiReconfig = 23, "ECM_CMD_SPI_RECONFIG_OP", Immediate, Nothing, Acts;
    CrcErrorCountClear = 24, "ECM_CMD_CRC_ERR_CNT_CLR", Immediate, Value, Acts;
    CrcTypeSet = 25, "ECM_CMD_CRC_TYPE_SET", Immediate, Nothing, Acts;
    HelperConfigSet = 26, "ECM_CMD_402_CONFIG_SET", Immediate, Nothing, Acts;
    HelperStateSet = 27, "ECM_CMD_402_STATE_SET", Immediate, Nothing, Acts;
    HelperStateGet = 28, "ECM_CMD_402_STATE_GET", Immediate, Value, Reads;
    HelperControlSet = 29, "ECM_CMD_402_CTL_SET", Immediate, Nothing, Acts;
    HelperControlGet = 30, "ECM_CMD_402_CTL_GET", Immediate, Value, Reads;
    GpioConfig = 31, "ECM_GPIO_CONFIG_SET", Immediate, ByFunction, Reads;
    GpioFunction = 32, "ECM_GPIO_FUNC_OP", Immediate, ByFunction, Reads;
    EncoderFunction = 33, "ECM_QEI_FUNC_OP", Immediate, ByFunction, Reads;
    DacFunction = 34, "ECM_DAC_FUNC_OP", Immediate, ByFunction, Reads;
    AdcFunction = 35, "ECM_ADC_FUNC_OP", Immediate, ByFunction, Reads;
    EepromRequest = 38, "ECM_EEPROM_REQ", NonImmediate, Nothing, Acts;
    EepromGet = 39, "ECM_EEPROM_GET", Immediate, ValueAndData, Reads;
    StateCheck = 41, "ECM_CMD_ECAT_STATE_CHECK", NonImmediate, Nothing, Acts;
    DcSync = 50, "ECM_CMD_ECAT_DCSYNC", NonImmediate, Nothing, Acts;
    FifoClear = 51, "ECM_CMD_FIFO_CLR_OP", Immediate, Nothing, Acts;
    FifoSetTxCount = 52, "ECM_CMD_FIFO_SET_TX_CNT", Immediate, Nothing, Acts;
    FifoGetTxCount = 53, "ECM_CMD_FIFO_GET_TX_CNT", Immediate, Value, Reads;
    FifoSetRxCount = 54, "ECM_CMD_FIFO_SET_RX_CNT", Immediate, Nothing, Acts;
    FifoGetRxCount = 55, "ECM_CMD_FIFO_GET_RX_CNT", Immediate, Value, Reads;
    FirmwareVersionGet = 56, "ECM_CMD_FW_VERSION_GET", Immediate, ValueAndData, Reads;
    StateUpdate = 57, "ECM_CMD_ECAT_STATE_UPDATE", NonImmediate, Nothing, Acts;
    InterruptSetEnable = 58, "ECM_CMD_ECAT_INT_SET_ENABLE", Immediate, Nothing, Acts;
    InterruptGetEnable = 59, "ECM_CMD_ECAT_INT_GET_ENABLE", Immediate, ValueAndData, Reads;
    FifoInit = 66, "ECM_CMD_FIFO_INIT", NonImmediate, Nothing, Acts;
    SdoAbortCodeGet = 69, "ECM_CMD_ECAT_SDO_ABORTCODE_GET", Immediate, Data, Reads;
    FifoThresholdSet = 70, "ECM_CMD_ECAT_SET_FIFO_TH", Immediate, Nothing, Acts;
    ConfigSyncManager = 71, "ECM_CMD_ECAT_CONFIG_SM", NonImmediate, Nothing, Acts;
    ConfigFmmu = 72, "ECM_CMD_ECAT_CONFIG_FMMU", NonImmediate, Nothing, Acts;
    ConfigMap = 73, "ECM_CMD_ECAT_CONFIG_MAP", NonImmediate, Nothing, Acts;
    HelperStatuswordGet = 74, "ECM_CMD_402_GET_STATUSWORD", Immediate, Data, Reads;
    AsyncReset = 75, "ECM_CMD_ASYNCCMD_RESET", Immediate, Nothing, Acts;
    Mdio = 81, "ECM_CMD_MDIO", Immediate, Data, ByArguments;
    DirectAssign = 82, "ECM_CMD_DIRECT_ASSIGN", Immediate, Nothing, Acts;
    CoeEmergency = 83, "ECM_CMD_COE_EMERGENCY", Immediate, Data, Reads;
    WarmReset = 127, "ECM_CMD_WARM_RESET", Immediate, Nothing, Acts;
    WkcErrorCountGet = 130, "ECM_CMD_ECAT_WKC_CONTI_ERR_CNT_GET", Immediate, Value, Reads;
    WkcErrorMaxGet = 131, "ECM_CMD_ECAT_WKC_CONTI_ERR_MAX_GET", Immediate, Value, Reads;
    WkcErrorMaxSet = 132, "ECM_CMD_ECAT_WKC_CONTI_ERR_MAX_SET", Immediate, Nothing, Acts;
    RawRequest = 137, "ECM_CMD_RAW_ECAT_FUNC_REQ", NonImmediate, Nothing, Acts;
    RawGet = 138, "ECM_CMD_RAW_ECAT_FUNC_GET", Immediate, Data, Reads;
    FoeRequest = 139, "ECM_CMD_FOE_FUNC_REQ", NonImmediate, Nothing, Acts;
    FoeGet = 140, "ECM_CMD_FOE_FUNC_GET", Immediate, Data, Reads;
    EnableLrw = 142, "ECM_CMD_ENABLE_LRW", Immediate, Nothing, Acts;
    ReceiveMailbox = 143, "ECM_CMD_RECV_MAILBOX", ByParameter, Data, Reads;
    MailboxStatus = 144, "ECM_CMD_MBX_STAT", Immediate, Data, ByArguments;
}

impl Default for CommandCode {
    /// The default is INFO_UPDATE_OP, which asks the chip only for a new header.
    fn default() -> Self {
        Self::InfoUpdate
    }
}

impl CommandCode {
    /// The command's row in [`COMMANDS`]; `None` for an unknown code.
    pub fn command(self) -> Option<&'static CommandInfo> {
        COMMANDS.binary_search_by_key(&self.code(), |row| row.code.code()).ok().map(|row| &COMMANDS[row])
    }

    /// The name as in the manuals; `None` for an unknown code.
    pub fn name(self) -> Option<&'static str> {
        self.command().map(|row| row.name)
    }

    /// The function that `parameter` selects with the codes 31 to 35; `None` for other codes and unknown parameters.
    pub fn function(self, parameter: u8) -> Option<&'static Function> {
        self.command()?.functions.iter().find(|function| function.parameter == parameter)
    }

    /// Whether the chip completes the command with this parameter byte at once. This is true for an unknown code, which
    /// the chip answers with an error.
    ///
    /// The manuals say this for 30 of the codes. For the others the value follows the vendor's driver, which waits for
    /// the end of some commands (OBS). For 139 and 143 it is `[OURS]`.
    pub fn is_immediate(self, parameter: u8) -> bool {
        match self.command().map(|row| row.timing) {
            Some(CommandTiming::NonImmediate) => false,
            Some(CommandTiming::ByParameter) => parameter != 0,
            Some(CommandTiming::Immediate) | None => true,
        }
    }
}

impl fmt::Display for CommandCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name() {
            Some(name) => write!(f, "{name} ({})", self.code()),
            None => write!(f, "unknown command {}", self.code()),
        }
    }
}

const fn functions_of(code: u8) -> &'static [Function] {
    match code {
        31 => GPIO_CONFIG,
        32 => GPIO_FUNCTION,
        33 => ENCODER,
        34 => DAC,
        35 => ADC,
        _ => &[],
    }
}

const GPIO_CONFIG: &[Function] = &[
    Function { parameter: 0, name: "ECM_GpioSetMode", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 1, name: "ECM_GpioIntEnable", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 2, name: "ECM_GpioEnableDebounce", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 3, name: "ECM_GpioSetDebounceClock", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 4, name: "ECM_GpioIntClear", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 6, name: "ECM_GpioIntClear", since: 9, answer: AnswerForm::Nothing },
    Function { parameter: 8, name: "ECM_GpioSetMode", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 9, name: "ECM_GpioEnableDebounce", since: 0, answer: AnswerForm::Nothing },
];

const GPIO_FUNCTION: &[Function] = &[
    Function { parameter: 0, name: "ECM_GpioSetValue", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 1, name: "ECM_GpioGetValue", since: 0, answer: AnswerForm::Data },
    Function { parameter: 2, name: "ECM_GpioExtSetValue", since: 9, answer: AnswerForm::Nothing },
    Function { parameter: 3, name: "ECM_GpioExtGetValue", since: 9, answer: AnswerForm::Data },
    Function { parameter: 5, name: "ECM_GpioGetIntFlag", since: 0, answer: AnswerForm::Data },
    Function { parameter: 7, name: "ECM_GpioExtGetIntFlag", since: 0, answer: AnswerForm::Data },
];

const ENCODER: &[Function] = &[
    Function { parameter: 4, name: "ECM_EncOpen", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 5, name: "ECM_EncStart", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 6, name: "ECM_EncStop", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 21, name: "ECM_EncGetCount", since: 0, answer: AnswerForm::Data },
];

const DAC: &[Function] = &[
    Function { parameter: 0, name: "ECM_DacStartConv", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 11, name: "ECM_DacSetData", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 20, name: "ECM_DacOpen", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 21, name: "ECM_DacClose", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 22, name: "ECM_DacSetDelayTime", since: 0, answer: AnswerForm::Nothing },
];

const ADC: &[Function] = &[
    Function { parameter: 12, name: "ECM_AdcStartConv", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 15, name: "ECM_AdcGetConvData", since: 0, answer: AnswerForm::Data },
    Function { parameter: 17, name: "ECM_AdcGetDataValidFlag", since: 0, answer: AnswerForm::Data },
    Function { parameter: 40, name: "ECM_AdcOpen", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 41, name: "ECM_AdcClose", since: 0, answer: AnswerForm::Nothing },
    Function { parameter: 42, name: "ECM_AdcConfigSampleModule", since: 0, answer: AnswerForm::Nothing },
];
