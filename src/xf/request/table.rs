//! The 91 functions by ascending code and parameter: the type of each, its purpose, and its answer.

use super::super::response::*;
use super::*;
use crate::ethercat::cia402::Statusword;
use crate::ethercat::coe::AbortCode;
use crate::xf::fields::{AnswerFields, FunctionFields};
use crate::xf::layout::{FieldLayout, Forms, field_slice, type_of, value};
use crate::xf::{DataSize, NetworkState};

/// Defines [`Request`], the [`Call`] of each type, and the table of fields. A row has the type, code and parameter if
/// several functions share one code, the purpose, and after `->` the answer, with a name if it is a single value.
macro_rules! requests {
    ($($name:ident $(<$life:lifetime>)? $(= $code:ident($function:literal))?, $what:literal
        $(-> $answer:ty $(= $value:expr)? $(, by $read:path)?)?;)*) => {
        /// Any request to the chip.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Request<'d> {
            $(#[doc = concat!("See [`", stringify!($name), "`].")] $name($name $(<$life>)?),)*
            /// A command whose code or function is not in the manuals.
            Unknown(UnknownCommand<'d>),
        }

        /// All functions, by ascending code and parameter.
        pub static FUNCTIONS: [FunctionFields; Request::FUNCTIONS] = [$(FunctionFields {
            type_name: stringify!($name),
            code: <type_of!($name $(<$life>)?) as Call<'static>>::CODE,
            function: <type_of!($name $(<$life>)?) as Call<'static>>::FUNCTION,
            what: $what,
            request: field_slice!(<type_of!($name $(<$life>)?) as FieldLayout<'static>>::FIELDS),
            answers: forms!(type_of!($name $(<$life>)?), $($answer $(= $value)?)?),
        },)*];

        impl<'d> Request<'d> {
            /// The number of functions.
            pub const FUNCTIONS: usize = [$(stringify!($name)),*].len();

            /// Decodes the request of a command from its code, the fields of its header and its whole data segment.
            ///
            /// # Errors
            /// A field has a value that the manuals do not allow.
            pub fn decode(code: CommandCode, arguments: &Arguments, data: &'d [u8]) -> Result<Self, Malformed> {
                $(if is_for::<$name>(code, arguments) {
                    return $name::decode(arguments, data).map(Self::$name);
                })*
                Ok(Self::Unknown(UnknownCommand { code, arguments: *arguments, data }))
            }

            /// The command code.
            pub fn code(&self) -> CommandCode {
                match self {
                    $(Self::$name(_) => $name::CODE,)*
                    Self::Unknown(unknown) => unknown.code,
                }
            }

            /// Calls a visitor with the request as its own type; `None` if the request is unknown.
            pub fn visit<V: Visit>(&self, visitor: V) -> Option<V::Output> {
                match self {
                    $(Self::$name(request) => Some(visitor.call(request)),)*
                    Self::Unknown(_) => None,
                }
            }

            /// The parameter that selects the function, for the codes 31 to 35.
            pub fn function(&self) -> Option<u8> {
                match self {
                    $(Self::$name(_) => $name::FUNCTION,)*
                    Self::Unknown(unknown) => Some(unknown.arguments.parameter),
                }
            }
        }

        impl Encode for Request<'_> {
            fn command(&self, data: &mut [u8]) -> Result<(CommandCode, Arguments), Malformed> {
                match self {
                    $(Self::$name(request) => request.command(data),)*
                    Self::Unknown(unknown) => {
                        segment::put_at(data, 0, unknown.data)?;
                        Ok((unknown.code, unknown.arguments))
                    }
                }
            }
        }

        $(
            impl<'d> Call<'d> for $name $(<$life>)? {
                const CODE: CommandCode = code!($name $($code)?);
                $(const FUNCTION: Option<u8> = Some($function);)?
                type Answer<'a> = answer!($($answer)?);

                fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
                    self.encoded(data)
                }

                fn decode(arguments: &Arguments, data: &'d [u8]) -> Result<Self, Malformed> {
                    Self::decoded(arguments, data)
                }

                $($(fn answer<'a>(&self, returned: Returned, data: &'a [u8]) -> Result<$answer, Malformed> {
                    $read(self, returned, data)
                })?)?
            }

            impl<'d> From<$name $(<$life>)?> for Request<'d> {
                fn from(request: $name $(<$life>)?) -> Self {
                    Self::$name(request)
                }
            }
        )*
    };
}

/// The command code, which mostly has the same name as the type.
macro_rules! code {
    ($name:ident) => {
        CommandCode::$name
    };
    ($name:ident $code:ident) => {
        CommandCode::$code
    };
}

/// Expands to the type of an answer; `()` without one.
macro_rules! answer {
    () => {
        ()
    };
    ($answer:ty) => {
        $answer
    };
}

/// Expands to the forms of an answer.
macro_rules! forms {
    ($name:ty,) => {
        &[]
    };
    ($name:ty, $answer:ty) => {
        <<$name as Call<'static>>::Answer<'static> as Forms>::FORMS
    };
    ($name:ty, $answer:ty = $value:expr) => {
        &[AnswerFields::of(&[$value.returned::<$answer>()])]
    };
}

/// Whether a command with this code and these fields is a request of type `C`.
fn is_for<'d, C: Call<'d>>(code: CommandCode, arguments: &Arguments) -> bool {
    code == C::CODE && C::FUNCTION.is_none_or(|function| function == arguments.parameter)
}

requests! {
    InfoUpdate, "asks for a new header and nothing else";
    EcatInit, "initialises the network";
    Reconfig, "lays out the chip's memory anew after a change of process data";
    InitDc, "initialises the distributed clocks";
    PdoWorkingCounterGet, "reads the working counter, or how many slaves count in it" -> u32 = value("value");
    PdoDataFifo<'d>, "moves process data through the FIFOs" -> PdoExchange<'a>;
    PdoData<'d>, "moves process data past the FIFOs" -> PdoExchange<'a>;
    PdoConfigSet, "sets the PDOs of a slave";
    PdoConfigRequest, "has the PDOs of a slave read, for PDO_CONFIG_GET";
    PdoConfigGet, "gives what PDO_CONFIG_REQ has read" -> PdoConfig;
    SdoRequest<'d>, "reads an object of a slave, for SDO_GET, or writes one";
    SdoGet, "gives the object that SDO_REQ has read" -> &'a [u8];
    StateSet, "brings slaves to a state";
    StateGet, "gives the state of slaves from the chip's memory" -> NetworkState;
    SlaveInfoGet, "gives an item about a slave" -> SlaveInfo<'a>, by SlaveInfoGet::info;
    SlaveCountGet, "gives the number of slaves" -> u8 = value("count");
    FifoEnable, "switches the RxFIFO's cyclic output on or off";
    FifoPackSizeGet, "gives the bytes of one PDO" -> u16 = value("bytes");
    SpiPackSizeGet, "gives n, the size of the data segment" -> DataSize;
    SpiReconfig, "sets n";
    CrcErrorCountClear, "clears the count of wrong check words" -> u8 = value("returned");
    CrcTypeSet, "chooses the check word";
    HelperConfigSet, "tells the CiA 402 helper where an axis has its words";
    HelperStateSet, "leads an axis to a state";
    HelperStateGet, "gives the state of an axis" -> DriveStateByte = value("state");
    HelperControlSet, "changes what the helper does with an axis";
    HelperControlGet, "gives what the helper does with an axis" -> HelperControl = value("control");
    GpioSetMode = GpioConfig(0), "makes GPIO 0 to 15 inputs or outputs";
    GpioIntEnable = GpioConfig(1), "chooses the edges at which a GPIO raises an interrupt";
    GpioEnableDebounce = GpioConfig(2), "debounces inputs among GPIO 0 to 15";
    GpioSetDebounceClock = GpioConfig(3), "chooses how often debounced inputs are sampled";
    GpioIntClear = GpioConfig(4), "clears interrupt flags of GPIO 0 to 15";
    GpioIntClearExt = GpioConfig(6), "clears interrupt flags of GPIO 0 to 19";
    GpioSetModeExt = GpioConfig(8), "makes GPIO 16 to 19 inputs or outputs: bit k of pins is GPIO 16 + k";
    GpioEnableDebounceExt = GpioConfig(9), "debounces inputs among GPIO 16 to 19: bit k of pins is GPIO 16 + k";
    GpioSetValue = GpioFunction(0), "sets the outputs of GPIO 0 to 15";
    GpioGetValue = GpioFunction(1), "gives the inputs of GPIO 0 to 15" -> u16 = value("values").hex();
    GpioExtSetValue = GpioFunction(2), "sets the outputs of GPIO 0 to 19";
    GpioExtGetValue = GpioFunction(3), "gives the inputs of GPIO 0 to 19" -> u32 = value("values").hex();
    GpioGetIntFlag = GpioFunction(5), "gives the interrupt flags of GPIO 0 to 15" -> u16 = value("flags").hex();
    GpioExtGetIntFlag = GpioFunction(7), "gives the interrupt flags of GPIO 0 to 19" -> u32 = value("flags").hex();
    EncOpen = EncoderFunction(4), "opens the encoder";
    EncStart = EncoderFunction(5), "starts the encoder";
    EncStop = EncoderFunction(6), "stops the encoder";
    EncGetCount = EncoderFunction(21), "gives the encoder's count" -> u32 = value("count");
    DacStartConv = DacFunction(0), "puts out the DAC's value";
    DacSetData = DacFunction(11), "sets the DAC's value, 0 to 4095 for 0 V to 3.3 V";
    DacOpen = DacFunction(20), "opens the DAC";
    DacClose = DacFunction(21), "closes the DAC";
    DacSetDelayTime = DacFunction(22), "sets how long a conversion of the DAC takes, in 1/96 us";
    AdcStartConv = AdcFunction(12), "starts a conversion of the ADC";
    AdcGetConvData = AdcFunction(15), "gives the ADC's value, 0 to 4095 for 0 V to 3.3 V" -> Analog = value("value");
    AdcGetDataValidFlag = AdcFunction(17), "tells whether a conversion of the ADC is done" -> u32 = value("valid");
    AdcOpen = AdcFunction(40), "opens the ADC";
    AdcClose = AdcFunction(41), "closes the ADC";
    AdcConfigSampleModule = AdcFunction(42), "has conversions of the ADC started by software";
    EepromRequest, "reads a slave's EEPROM, for EEPROM_GET, or writes it";
    EepromGet, "gives what EEPROM_REQ has read" -> EepromAnswer<'a>;
    StateCheck, "brings slaves to a state and reads it back";
    DcSync, "sets other times of the distributed clocks for one slave";
    FifoClear, "empties FIFOs";
    FifoSetTxCount, "sets the entries of the TxFIFO, which hold from FIFO_INIT on";
    FifoGetTxCount, "gives the entries of the TxFIFO" -> u8 = value("entries");
    FifoSetRxCount, "sets the entries of the RxFIFO, which hold from FIFO_INIT on";
    FifoGetRxCount, "gives the entries of the RxFIFO" -> u8 = value("entries");
    FirmwareVersionGet, "gives version and series of the chip" -> FirmwareVersion;
    StateUpdate, "reads the states of the slaves into the chip's memory";
    InterruptSetEnable, "chooses what raises INT1, and the polarity of INT0 and INT1";
    InterruptGetEnable, "gives what INT_SET_ENABLE has set" -> InterruptEnable;
    FifoInit, "builds the FIFOs from their entries and the sizes of the PDOs";
    SdoAbortCodeGet, "gives the abort code of the last SDO transfer" -> AbortCode = value("abort");
    FifoThresholdSet, "sets the limits at which FIFOs raise an interrupt";
    ConfigSyncManager, "sets a sync manager of a slave";
    ConfigFmmu, "sets the functions of a slave's FMMUs, without effect";
    ConfigMap, "as RECONFIG, for slaves that fall back to their default process data with that";
    HelperStatuswordGet, "gives the statusword of an axis" -> Statusword = value("statusword");
    AsyncReset, "ends what keeps the chip busy";
    Mdio, "reads or writes a register of a PHY" -> MdioAnswer;
    DirectAssign, "assigns the length of a slave's process data by hand";
    CoeEmergency, "lists the newest emergencies of slaves" -> Emergencies;
    WarmReset, "resets the chip: all is as after power-on";
    WkcErrorCountGet, "gives how many working counters in a row were wrong" -> u8 = value("count");
    WkcErrorMaxGet, "gives how many of them are allowed" -> WkcErrorLimit;
    WkcErrorMaxSet, "sets how many of them are allowed";
    RawRequest<'d>, "sends an EtherCAT datagram, whose answer is for RAW_ECAT_FUNC_GET";
    RawGet, "gives what came back of the datagram" -> RawAnswer<'a>;
    FoeRequest<'d>, "moves a file between a slave and the flash memory, or reads or writes that";
    FoeGet, "gives the part of the flash memory that FOE_FUNC_REQ has read" -> &'a [u8];
    EnableLrw, "chooses LRW, or LRD and LWR, for process data";
    ReceiveMailbox, "fetches a slave's mailbox, or gives a part of it" -> &'a [u8];
    MailboxStatus, "tells which mailboxes are full, or which are polled, or sets that" -> SlaveBits;
}
