//! The 91 functions as requests: one type each, which holds only what the manuals allow, and [`Request`] over all.
//!
//! A type encodes itself into the fields of the header that belong to it ([`Arguments`]) and the data segment, and
//! decodes itself from them. Like the chip it reads fixed layouts from the data segment, whatever the length field
//! says; only the requests that say so go by the length (XF-4.3).
//!
//! | file | requests |
//! | --- | --- |
//! | `network` | initialisation, states, slaves, clocks |
//! | `slave` | sync managers, FMMUs, assigned process data |
//! | `pdo` | process data and their configuration |
//! | `fifo` | the FIFOs of process data |
//! | `sdo` | objects of slaves |
//! | `chip` | the chip itself: packets, version, resets, error counts, PHY |
//! | `interrupt` | the interrupt lines |
//! | `helper` | the CiA 402 helper |
//! | `gpio`, `encoder`, `dac`, `adc` | inputs and outputs of the chip |
//! | `eeprom`, `raw`, `foe`, `mailbox` | EEPROMs of slaves, datagrams, files, mailboxes and emergencies |

mod adc;
mod chip;
mod dac;
mod eeprom;
mod encoder;
mod fifo;
mod foe;
mod gpio;
mod helper;
mod interrupt;
mod mailbox;
mod network;
mod pdo;
mod raw;
mod sdo;
mod slave;

pub use adc::*;
pub use chip::*;
pub use dac::*;
pub use eeprom::*;
pub use encoder::*;
pub use fifo::*;
pub use foe::*;
pub use gpio::*;
pub use helper::*;
pub use interrupt::*;
pub use mailbox::*;
pub use network::*;
pub use pdo::*;
pub use raw::*;
pub use sdo::*;
pub use slave::*;

pub use super::value::{
    AllPins, Analog, DacDelay, FlashAddress, FlashBytes, GpioChannel, MotorNumber, SlaveNumber, Slaves, UpperPins,
};

use super::response::{Answer, Returned};
use super::value::{Switch, WriteOrRead};
use super::{CommandCode, Malformed, Reserve, segment};

/// The fields of a command header that belong to the request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Arguments {
    /// `par`, byte 0x0D.
    pub parameter: u8,
    /// `i0` to `i3`, bytes 0x04 to 0x07.
    pub info: [u8; 4],
    /// Word 0x08; ECAT_INIT_OP alone uses bits of it.
    pub reserve: Reserve,
    /// Word 0x0E: bytes of the data segment that are used; in SPI_RECONFIG_OP the new n.
    pub len: u16,
}

impl Arguments {
    /// All fields 0.
    pub const NONE: Self = Self { parameter: 0, info: [0; 4], reserve: Reserve::NONE, len: 0 };

    /// These fields with that parameter.
    pub(super) const fn parameter(self, parameter: u8) -> Self {
        Self { parameter, ..self }
    }

    /// These fields with that information.
    pub(super) const fn info(self, info: [u8; 4]) -> Self {
        Self { info, ..self }
    }

    /// These fields with that length.
    pub(super) const fn len(self, len: u16) -> Self {
        Self { len, ..self }
    }
}

/// A request of one function, and what is answered to it. `'d` is how long its data live, if it has any.
pub trait Call<'d>: Sized {
    /// The command code.
    const CODE: CommandCode;
    /// The parameter that names the function, with the codes 31 to 35.
    const FUNCTION: Option<u8> = None;
    /// The result; `()` if there is none.
    type Answer<'a>: Answer<'a>;

    /// Writes the data into a segment that is all 0, and returns the fields of the header.
    ///
    /// # Errors
    /// The data do not fit into the segment, or there are more than the chip takes.
    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed>;

    /// Reads the request from the fields of the header and the whole data segment.
    ///
    /// # Errors
    /// A field has a value that the manuals do not allow.
    fn decode(arguments: &Arguments, data: &'d [u8]) -> Result<Self, Malformed>;

    /// Reads the result from the answer's return byte, length and whole data segment.
    ///
    /// # Errors
    /// A field has a value that the manuals do not allow.
    fn answer<'a>(&self, returned: Returned, data: &'a [u8]) -> Result<Self::Answer<'a>, Malformed> {
        Self::Answer::decode(returned, data)
    }
}

/// What is done with a request as its own type: see [`Request::visit`].
pub trait Visit {
    /// The result.
    type Output;

    /// Takes the request.
    fn call<'d, C: Call<'d>>(self, call: &C) -> Self::Output;
}

/// What a command packet is built from: a [`Call`] or a [`Request`].
pub trait Encode {
    /// Writes the data into a segment that is all 0, and returns code and fields of the header.
    ///
    /// # Errors
    /// The data do not fit into the segment, or there are more than the chip takes.
    fn command(&self, data: &mut [u8]) -> Result<(CommandCode, Arguments), Malformed>;
}

impl<'d, C: Call<'d>> Encode for C {
    fn command(&self, data: &mut [u8]) -> Result<(CommandCode, Arguments), Malformed> {
        let arguments = self.encode(data)?;
        Ok((C::CODE, C::FUNCTION.map_or(arguments, |function| arguments.parameter(function))))
    }
}

/// A command whose code or function the manuals do not have. The chip answers it with a command error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct UnknownCommand<'d> {
    /// The code.
    pub code: CommandCode,
    /// The fields of the header.
    pub arguments: Arguments,
    /// The whole data segment.
    pub data: &'d [u8],
}

/// Defines [`Request`] with a variant for each type.
macro_rules! requests {
    ($($variant:ident($type:ty);)*) => {
        /// Any request.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Request<'d> {
            $(#[doc = concat!("See [`", stringify!($variant), "`].")] $variant($type),)*
            /// A code or function that the manuals do not have.
            Unknown(UnknownCommand<'d>),
        }

        impl<'d> Request<'d> {
            /// How many functions there are.
            pub const FUNCTIONS: usize = [$(stringify!($variant)),*].len();

            /// The request of a command with this code, these fields of its header and this whole data segment.
            ///
            /// # Errors
            /// A field has a value that the manuals do not allow.
            pub fn decode(code: CommandCode, arguments: &Arguments, data: &'d [u8]) -> Result<Self, Malformed> {
                $(if is_for::<$type>(code, arguments) {
                    return <$type as Call<'d>>::decode(arguments, data).map(Self::$variant);
                })*
                Ok(Self::Unknown(UnknownCommand { code, arguments: *arguments, data }))
            }

            /// The command code.
            pub fn code(&self) -> CommandCode {
                match self {
                    $(Self::$variant(_) => <$type as Call<'d>>::CODE,)*
                    Self::Unknown(unknown) => unknown.code,
                }
            }

            /// Calls a visitor with the request as its own type; `None` if it is unknown.
            pub fn visit<V: Visit>(&self, visitor: V) -> Option<V::Output> {
                match self {
                    $(Self::$variant(request) => Some(visitor.call(request)),)*
                    Self::Unknown(_) => None,
                }
            }

            /// The parameter that names the function, with the codes 31 to 35.
            pub fn function(&self) -> Option<u8> {
                match self {
                    $(Self::$variant(_) => <$type as Call<'d>>::FUNCTION,)*
                    Self::Unknown(unknown) => Some(unknown.arguments.parameter),
                }
            }
        }

        impl Encode for Request<'_> {
            fn command(&self, data: &mut [u8]) -> Result<(CommandCode, Arguments), Malformed> {
                match self {
                    $(Self::$variant(request) => request.command(data),)*
                    Self::Unknown(unknown) => {
                        segment::put_at(data, 0, unknown.data)?;
                        Ok((unknown.code, unknown.arguments))
                    }
                }
            }
        }

        $(impl<'d> From<$type> for Request<'d> {
            fn from(request: $type) -> Self {
                Self::$variant(request)
            }
        })*
    };
}

/// Whether a command with this code and these fields is a `C`.
fn is_for<'d, C: Call<'d>>(code: CommandCode, arguments: &Arguments) -> bool {
    code == C::CODE && C::FUNCTION.is_none_or(|function| function == arguments.parameter)
}

impl Request<'_> {
    /// Whether the request is done at once: its answer has the result. Any other sets the busy flag for a while.
    pub fn is_immediate(&self) -> bool {
        let parameter = match self {
            // The one command whose parameter decides it.
            Self::ReceiveMailbox(request) => request.parameter(),
            _ => 0,
        };
        self.code().is_immediate(parameter)
    }
}

requests! {
    InfoUpdate(InfoUpdate);
    EcatInit(EcatInit);
    Reconfig(Reconfig);
    InitDc(InitDc);
    PdoWorkingCounterGet(PdoWorkingCounterGet);
    PdoDataFifo(PdoDataFifo<'d>);
    PdoData(PdoData<'d>);
    PdoConfigSet(PdoConfigSet);
    PdoConfigRequest(PdoConfigRequest);
    PdoConfigGet(PdoConfigGet);
    SdoRequest(SdoRequest<'d>);
    SdoGet(SdoGet);
    StateSet(StateSet);
    StateGet(StateGet);
    SlaveInfoGet(SlaveInfoGet);
    SlaveCountGet(SlaveCountGet);
    FifoEnable(FifoEnable);
    FifoPackSizeGet(FifoPackSizeGet);
    SpiPackSizeGet(SpiPackSizeGet);
    SpiReconfig(SpiReconfig);
    CrcErrorCountClear(CrcErrorCountClear);
    CrcTypeSet(CrcTypeSet);
    HelperConfigSet(HelperConfigSet);
    HelperStateSet(HelperStateSet);
    HelperStateGet(HelperStateGet);
    HelperControlSet(HelperControlSet);
    HelperControlGet(HelperControlGet);
    GpioSetMode(GpioSetMode);
    GpioSetModeExt(GpioSetModeExt);
    GpioEnableDebounce(GpioEnableDebounce);
    GpioEnableDebounceExt(GpioEnableDebounceExt);
    GpioSetDebounceClock(GpioSetDebounceClock);
    GpioIntEnable(GpioIntEnable);
    GpioIntClear(GpioIntClear);
    GpioIntClearExt(GpioIntClearExt);
    GpioSetValue(GpioSetValue);
    GpioExtSetValue(GpioExtSetValue);
    GpioGetValue(GpioGetValue);
    GpioExtGetValue(GpioExtGetValue);
    GpioGetIntFlag(GpioGetIntFlag);
    GpioExtGetIntFlag(GpioExtGetIntFlag);
    EncOpen(EncOpen);
    EncStart(EncStart);
    EncStop(EncStop);
    EncGetCount(EncGetCount);
    DacOpen(DacOpen);
    DacClose(DacClose);
    DacSetDelayTime(DacSetDelayTime);
    DacSetData(DacSetData);
    DacStartConv(DacStartConv);
    AdcOpen(AdcOpen);
    AdcClose(AdcClose);
    AdcConfigSampleModule(AdcConfigSampleModule);
    AdcGetDataValidFlag(AdcGetDataValidFlag);
    AdcStartConv(AdcStartConv);
    AdcGetConvData(AdcGetConvData);
    EepromRequest(EepromRequest);
    EepromGet(EepromGet);
    StateCheck(StateCheck);
    DcSync(DcSync);
    FifoClear(FifoClear);
    FifoSetTxCount(FifoSetTxCount);
    FifoGetTxCount(FifoGetTxCount);
    FifoSetRxCount(FifoSetRxCount);
    FifoGetRxCount(FifoGetRxCount);
    FirmwareVersionGet(FirmwareVersionGet);
    StateUpdate(StateUpdate);
    InterruptSetEnable(InterruptSetEnable);
    InterruptGetEnable(InterruptGetEnable);
    FifoInit(FifoInit);
    SdoAbortCodeGet(SdoAbortCodeGet);
    FifoThresholdSet(FifoThresholdSet);
    ConfigSyncManager(ConfigSyncManager);
    ConfigFmmu(ConfigFmmu);
    ConfigMap(ConfigMap);
    HelperStatuswordGet(HelperStatuswordGet);
    AsyncReset(AsyncReset);
    Mdio(Mdio);
    DirectAssign(DirectAssign);
    CoeEmergency(CoeEmergency);
    WarmReset(WarmReset);
    WkcErrorCountGet(WkcErrorCountGet);
    WkcErrorMaxGet(WkcErrorMaxGet);
    WkcErrorMaxSet(WkcErrorMaxSet);
    RawRequest(RawRequest<'d>);
    RawGet(RawGet);
    FoeRequest(FoeRequest<'d>);
    FoeGet(FoeGet);
    EnableLrw(EnableLrw);
    ReceiveMailbox(ReceiveMailbox);
    MailboxStatus(MailboxStatus);
}

/// Requests without arguments.
macro_rules! plain {
    ($($(#[$doc:meta])* $name:ident, $code:ident $(($function:literal))? -> $answer:ty;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub struct $name;

        impl $crate::xf::request::Call<'_> for $name {
            const CODE: $crate::xf::CommandCode = $crate::xf::CommandCode::$code;
            $(const FUNCTION: Option<u8> = Some($function);)?
            type Answer<'a> = $answer;

            fn encode(&self, _: &mut [u8]) -> Result<$crate::xf::request::Arguments, $crate::xf::Malformed> {
                Ok($crate::xf::request::Arguments::NONE)
            }

            fn decode(_: &$crate::xf::request::Arguments, _: &[u8]) -> Result<Self, $crate::xf::Malformed> {
                Ok(Self)
            }
        }
    )*};
}

/// Requests whose fields are all in the header: how they are written and read.
macro_rules! short {
    ($($(#[$doc:meta])* $name:ident $body:tt, $code:ident $(($function:literal))? -> $answer:ty,
        |$this:ident| $encoded:expr, |$arguments:ident| $decoded:expr;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub struct $name $body

        impl $crate::xf::request::Call<'_> for $name {
            const CODE: $crate::xf::CommandCode = $crate::xf::CommandCode::$code;
            $(const FUNCTION: Option<u8> = Some($function);)?
            type Answer<'a> = $answer;

            fn encode(&self, _: &mut [u8]) -> Result<$crate::xf::request::Arguments, $crate::xf::Malformed> {
                let $this = self;
                Ok($encoded)
            }

            fn decode(
                $arguments: &$crate::xf::request::Arguments,
                _: &[u8],
            ) -> Result<Self, $crate::xf::Malformed> {
                Ok($decoded)
            }
        }
    )*};
}

use {plain, short};
