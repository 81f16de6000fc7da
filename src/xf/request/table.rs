//! All functions by ascending code and parameter: the file and the type of each, its purpose, and its answer.

use super::super::response::{
    DriveStateByte, EepromAnswer, Emergencies, FirmwareVersion, MdioAnswer, PdoExchange, RawAnswer, Returned, SlaveInfo,
};
use super::{
    Analog, Arguments, Call, Encode, HelperControl, InterruptEnable, PdoConfig, SlaveBits, UnknownCommand, Visit,
    WkcErrorLimit,
};
use crate::ethercat::cia402::Statusword;
use crate::ethercat::coe::AbortCode;
use crate::xf::fields::{AnswerFields, FunctionFields};
use crate::xf::layout::{FieldLayout, Forms, field_slice, type_of, value};
use crate::xf::{CommandCode, DataSize, Malformed, NetworkState, segment};

/// Defines [`Request`], the [`Call`] of each type, and the table of fields. A row has the file and the type, then the
/// code and the parameter if several functions share one code, then the purpose. After `->` it has the type of the
/// answer, with a name if the answer is a single value. After `by` it names a function that decodes the answer.
macro_rules! requests {
    ($($file:ident::$name:ident $(<$life:lifetime>)? $(= $code:ident($function:literal))?, $what:literal
        $(-> $answer:ty $(= $value:expr)? $(, by $read:path)?)?;)*) => {
        /// The types of all requests.
        pub mod types {
            $(pub use super::super::$file::$name;)*
        }

        use types::*;

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
            /// The number of functions of all commands, which is also the number of known request types.
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

            /// The code of the command that carries the request.
            pub fn code(&self) -> CommandCode {
                match self {
                    $(Self::$name(_) => $name::CODE,)*
                    Self::Unknown(unknown) => unknown.code,
                }
            }

            /// Calls a visitor with the request as its concrete type; `None` if the request is unknown.
            pub fn visit<V: Visit>(&self, visitor: V) -> Option<V::Output> {
                match self {
                    $(Self::$name(request) => Some(visitor.call(request)),)*
                    Self::Unknown(_) => None,
                }
            }

            /// The parameter that selects the function, for the codes 31 to 35. For an unknown request it is the
            /// parameter byte.
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

/// Expands to the command code of a request, which has the same name as the type unless the row gives another.
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

/// Expands to the possible forms of an answer, as [`AnswerFields`].
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
    network::InfoUpdate, "asks for a new header and nothing else";
    network::EcatInit, "initialises the network";
    network::Reconfig, "lays out the chip's memory anew after a change of process data";
    network::InitDc, "initialises the distributed clocks";
    network::PdoWorkingCounterGet, "reads the working counter, or how many slaves count in it" -> u32 = value("value");
    pdo::PdoDataFifo<'d>, "moves process data through the FIFOs" -> PdoExchange<'a>;
    pdo::PdoData<'d>, "moves process data past the FIFOs" -> PdoExchange<'a>;
    pdo::PdoConfigSet, "sets the PDOs of a slave";
    pdo::PdoConfigRequest, "has the PDOs of a slave read, for PDO_CONFIG_GET";
    pdo::PdoConfigGet, "gives what PDO_CONFIG_REQ has read" -> PdoConfig;
    sdo::SdoRequest<'d>, "reads an object of a slave, for SDO_GET, or writes one";
    sdo::SdoGet, "gives the object that SDO_REQ has read" -> &'a [u8];
    network::StateSet, "brings slaves to a state";
    network::StateGet, "gives the state of slaves from the chip's memory" -> NetworkState;
    network::SlaveInfoGet, "gives an item about a slave" -> SlaveInfo<'a>, by SlaveInfoGet::info;
    network::SlaveCountGet, "gives the number of slaves" -> u8 = value("count");
    fifo::FifoEnable, "switches the RxFIFO's cyclic output on or off";
    fifo::FifoPackSizeGet, "gives the bytes of one PDO" -> u16 = value("bytes");
    chip::SpiPackSizeGet, "gives n, the size of the data segment" -> DataSize;
    chip::SpiReconfig, "sets n";
    chip::CrcErrorCountClear, "clears the count of wrong check words" -> u8 = value("returned");
    chip::CrcTypeSet, "chooses the check word";
    helper::HelperConfigSet, "tells the CiA 402 helper where an axis has its words";
    helper::HelperStateSet, "leads an axis to a state";
    helper::HelperStateGet, "gives the state of an axis" -> DriveStateByte = value("state");
    helper::HelperControlSet, "changes what the helper does with an axis";
    helper::HelperControlGet, "gives what the helper does with an axis" -> HelperControl = value("control");
    gpio::GpioSetMode = GpioConfig(0), "makes GPIO 0 to 15 inputs or outputs";
    gpio::GpioIntEnable = GpioConfig(1), "chooses the edges at which a GPIO raises an interrupt";
    gpio::GpioEnableDebounce = GpioConfig(2), "debounces inputs among GPIO 0 to 15";
    gpio::GpioSetDebounceClock = GpioConfig(3), "chooses how often debounced inputs are sampled";
    gpio::GpioIntClear = GpioConfig(4), "clears interrupt flags of GPIO 0 to 15";
    gpio::GpioIntClearExt = GpioConfig(6), "clears interrupt flags of GPIO 0 to 19";
    gpio::GpioSetModeExt = GpioConfig(8), "makes GPIO 16 to 19 inputs or outputs: bit k of pins is GPIO 16 + k";
    gpio::GpioEnableDebounceExt = GpioConfig(9), "debounces inputs among GPIO 16 to 19: bit k of pins is GPIO 16 + k";
    gpio::GpioSetValue = GpioFunction(0), "sets the outputs of GPIO 0 to 15";
    gpio::GpioGetValue = GpioFunction(1), "gives the inputs of GPIO 0 to 15" -> u16 = value("values").hex();
    gpio::GpioExtSetValue = GpioFunction(2), "sets the outputs of GPIO 0 to 19";
    gpio::GpioExtGetValue = GpioFunction(3), "gives the inputs of GPIO 0 to 19" -> u32 = value("values").hex();
    gpio::GpioGetIntFlag = GpioFunction(5), "gives the interrupt flags of GPIO 0 to 15" -> u16 = value("flags").hex();
    gpio::GpioExtGetIntFlag = GpioFunction(7), "gives the interrupt flags of GPIO 0 to 19" -> u32 = value("flags").hex();
    encoder::EncOpen = EncoderFunction(4), "opens the encoder";
    encoder::EncStart = EncoderFunction(5), "starts the encoder";
    encoder::EncStop = EncoderFunction(6), "stops the encoder";
    encoder::EncGetCount = EncoderFunction(21), "gives the encoder's count" -> u32 = value("count");
    dac::DacStartConv = DacFunction(0), "puts out the DAC's value";
    dac::DacSetData = DacFunction(11), "sets the DAC's value, 0 to 4095 for 0 V to 3.3 V";
    dac::DacOpen = DacFunction(20), "opens the DAC";
    dac::DacClose = DacFunction(21), "closes the DAC";
    dac::DacSetDelayTime = DacFunction(22), "sets how long a conversion of the DAC takes, in 1/96 us";
    adc::AdcStartConv = AdcFunction(12), "starts a conversion of the ADC";
    adc::AdcGetConvData = AdcFunction(15), "gives the ADC's value, 0 to 4095 for 0 V to 3.3 V" -> Analog = value("value");
    adc::AdcGetDataValidFlag = AdcFunction(17), "tells whether a conversion of the ADC is done" -> u32 = value("valid");
    adc::AdcOpen = AdcFunction(40), "opens the ADC";
    adc::AdcClose = AdcFunction(41), "closes the ADC";
    adc::AdcConfigSampleModule = AdcFunction(42), "has conversions of the ADC started by software";
    eeprom::EepromRequest, "reads a slave's EEPROM, for EEPROM_GET, or writes it";
    eeprom::EepromGet, "gives what EEPROM_REQ has read" -> EepromAnswer<'a>;
    network::StateCheck, "brings slaves to a state and reads it back";
    network::DcSync, "sets other times of the distributed clocks for one slave";
    fifo::FifoClear, "empties FIFOs";
    fifo::FifoSetTxCount, "sets the entries of the TxFIFO, which hold from FIFO_INIT on";
    fifo::FifoGetTxCount, "gives the entries of the TxFIFO" -> u8 = value("entries");
    fifo::FifoSetRxCount, "sets the entries of the RxFIFO, which hold from FIFO_INIT on";
    fifo::FifoGetRxCount, "gives the entries of the RxFIFO" -> u8 = value("entries");
    chip::FirmwareVersionGet, "gives version and series of the chip" -> FirmwareVersion;
    network::StateUpdate, "reads the states of the slaves into the chip's memory";
    interrupt::InterruptSetEnable, "chooses what raises INT1, and the polarity of INT0 and INT1";
    interrupt::InterruptGetEnable, "gives what INT_SET_ENABLE has set" -> InterruptEnable;
    fifo::FifoInit, "builds the FIFOs from their entries and the sizes of the PDOs";
    sdo::SdoAbortCodeGet, "gives the abort code of the last SDO transfer" -> AbortCode = value("abort");
    fifo::FifoThresholdSet, "sets the limits at which FIFOs raise an interrupt";
    slave::ConfigSyncManager, "sets a sync manager of a slave";
    slave::ConfigFmmu, "sets the functions of a slave's FMMUs, without effect";
    network::ConfigMap, "as RECONFIG, for slaves that fall back to their default process data with that";
    helper::HelperStatuswordGet, "gives the statusword of an axis" -> Statusword = value("statusword");
    chip::AsyncReset, "ends what keeps the chip busy";
    chip::Mdio, "reads or writes a register of a PHY" -> MdioAnswer;
    slave::DirectAssign, "assigns the length of a slave's process data by hand";
    mailbox::CoeEmergency, "lists the newest emergencies of slaves" -> Emergencies;
    chip::WarmReset, "resets the chip: all is as after power-on";
    chip::WkcErrorCountGet, "gives how many working counters in a row were wrong" -> u8 = value("count");
    chip::WkcErrorMaxGet, "gives how many of them are allowed" -> WkcErrorLimit;
    chip::WkcErrorMaxSet, "sets how many of them are allowed";
    raw::RawRequest<'d>, "sends an EtherCAT datagram, whose answer is for RAW_ECAT_FUNC_GET";
    raw::RawGet, "gives what came back of the datagram" -> RawAnswer<'a>;
    foe::FoeRequest<'d>, "moves a file between a slave and the flash memory, or reads or writes that";
    foe::FoeGet, "gives the part of the flash memory that FOE_FUNC_REQ has read" -> &'a [u8];
    network::EnableLrw, "chooses LRW, or LRD and LWR, for process data";
    mailbox::ReceiveMailbox, "fetches a slave's mailbox, or gives a part of it" -> &'a [u8];
    mailbox::MailboxStatus, "tells which mailboxes are full, or which are polled, or sets that" -> SlaveBits;
}
