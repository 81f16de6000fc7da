//! The analog output: code 34, DAC_FUNC_OP.

use super::{Analog, Arguments, Call, DacDelay, plain};
use crate::ethercat::U32Le;
use crate::xf::value::choices;
use crate::xf::{CommandCode, Malformed, segment};

plain! {
    /// ECM_DacClose, code 34, `par` 21: closes the DAC (XF EN 1042).
    DacClose, DacFunction(21) -> ();
    /// ECM_DacStartConv, code 34, `par` 0: puts out what was set (XF EN 1069).
    DacStartConv, DacFunction(0) -> ();
}

choices! {
    /// What makes the DAC put out what was set.
    pub DacTrigger(u32), "ECM_DacOpen trigger", "0x0000, 0x0010, 0x0030, 0x1030, 0x2030 or 0x3030" {
        /// 0x0000: [`DacSetData`] itself.
        SetData = 0x0000,
        /// 0x0010: [`DacStartConv`].
        StartConv = 0x0010,
        /// 0x0030: the pin DAC_ST is low.
        PinLow = 0x0030,
        /// 0x1030: the pin DAC_ST is high.
        PinHigh = 0x1030,
        /// 0x2030: the pin DAC_ST rises.
        PinRising = 0x2030,
        /// 0x3030: the pin DAC_ST falls.
        PinFalling = 0x3030,
    }
}

/// Requests with one u32 @0.
macro_rules! with_number {
    ($(
        $(#[$doc:meta])*
        $name:ident { $(#[$field_doc:meta])* $field:ident: $type:ident = $function:literal, $get:ident }
    )*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub struct $name {
            $(#[$field_doc])*
            pub $field: $type,
        }

        impl Call<'_> for $name {
            const CODE: CommandCode = CommandCode::DacFunction;
            const FUNCTION: Option<u8> = Some($function);
            type Answer<'a> = ();

            fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
                Ok(Arguments::NONE.len(segment::put(data, &U32Le::new(self.$field.$get()))?))
            }

            fn decode(_: &Arguments, data: &[u8]) -> Result<Self, Malformed> {
                Ok(Self { $field: $type::decode(segment::get::<U32Le>(data)?.get())? })
            }
        }
    )*};
}

with_number! {
    /// ECM_DacOpen, code 34, `par` 20: opens the DAC (XF EN 1034). 4 bytes: @0 u32 trigger.
    DacOpen {
        /// What makes it put out what was set.
        trigger: DacTrigger = 20, code
    }

    /// ECM_DacSetDelayTime, code 34, `par` 22: how long a conversion takes (XF EN 1050). 4 bytes: @0 u32 in 1/96 us.
    DacSetDelayTime {
        /// The time.
        delay: DacDelay = 22, get
    }

    /// ECM_DacSetData, code 34, `par` 11: the value (XF EN 1058). 4 bytes: @0 u32, 0..=4095 for 0 V to 3.3 V.
    DacSetData {
        /// The value.
        value: Analog = 11, get
    }
}
