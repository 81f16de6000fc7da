//! Each of the 91 functions is tested with driver and model, and its test depends on the function's effect.

use std::panic::{AssertUnwindSafe, catch_unwind};

use ecmsk::xf::CommandCode;
use ecmsk::xf::chip::NEED_REGISTERS;
use ecmsk::xf::command_table::COMMANDS;
use ecmsk::xf::request::*;

use super::saboteur::{Function, ignore};
use super::{OVER_CONTROLLERS, fifos, helper, interrupts, network, refused, registers, start, transfers, units};

/// A function, and the test that shows its effect.
type Row = (Function, fn());

const fn of<C: Call<'static>>() -> Function {
    (C::CODE, C::FUNCTION)
}

/// By ascending code and parameter.
#[rustfmt::skip]
const SHOWN: [Row; 91] = [
    (of::<InfoUpdate>(), start::info_update),
    (of::<EcatInit>(), network::initialisation),
    (of::<Reconfig>(), network::layout),
    (of::<InitDc>(), network::clocks),
    (of::<PdoWorkingCounterGet>(), network::working_counter),
    (of::<PdoDataFifo<'_>>(), fifos::tx_fifo),
    (of::<PdoData<'_>>(), fifos::past_the_fifos),
    (of::<PdoConfigSet>(), transfers::mapping),
    (of::<PdoConfigRequest>(), transfers::mapping),
    (of::<PdoConfigGet>(), transfers::mapping),
    (of::<SdoRequest<'_>>(), transfers::objects),
    (of::<SdoGet>(), transfers::objects),
    (of::<StateSet>(), network::states),
    (of::<StateGet>(), network::states),
    (of::<SlaveInfoGet>(), network::slave_info),
    (of::<SlaveCountGet>(), network::initialisation),
    (of::<FifoEnable>(), fifos::rx_fifo),
    (of::<FifoPackSizeGet>(), network::layout),
    (of::<SpiPackSizeGet>(), start::version_and_size),
    (of::<SpiReconfig>(), start::another_size),
    (of::<CrcErrorCountClear>(), start::crc_errors),
    (of::<CrcTypeSet>(), start::check_word),
    (of::<HelperConfigSet>(), helper::a_drive_is_led),
    (of::<HelperStateSet>(), helper::a_drive_is_led),
    (of::<HelperStateGet>(), helper::a_drive_is_led),
    (of::<HelperControlSet>(), helper::control_byte),
    (of::<HelperControlGet>(), helper::control_byte),
    (of::<GpioSetMode>(), units::gpio_modes),
    (of::<GpioIntEnable>(), units::gpio_interrupts),
    (of::<GpioEnableDebounce>(), units::debounce),
    (of::<GpioSetDebounceClock>(), units::debounce),
    (of::<GpioIntClear>(), units::gpio_interrupts),
    (of::<GpioIntClearExt>(), units::gpio_interrupts),
    (of::<GpioSetModeExt>(), units::gpio_modes_of_upper_pins),
    (of::<GpioEnableDebounceExt>(), units::debounce_of_upper_pins),
    (of::<GpioSetValue>(), units::gpio_outputs),
    (of::<GpioGetValue>(), units::gpio_inputs),
    (of::<GpioExtSetValue>(), units::gpio_outputs),
    (of::<GpioExtGetValue>(), units::gpio_inputs),
    (of::<GpioGetIntFlag>(), units::gpio_interrupts),
    (of::<GpioExtGetIntFlag>(), units::gpio_interrupts),
    (of::<EncOpen>(), units::encoder),
    (of::<EncStart>(), units::encoder),
    (of::<EncStop>(), units::encoder),
    (of::<EncGetCount>(), units::encoder),
    (of::<DacStartConv>(), units::dac),
    (of::<DacSetData>(), units::dac),
    (of::<DacOpen>(), units::dac),
    (of::<DacClose>(), units::dac),
    (of::<DacSetDelayTime>(), units::dac),
    (of::<AdcStartConv>(), units::adc),
    (of::<AdcGetConvData>(), units::adc),
    (of::<AdcGetDataValidFlag>(), units::adc),
    (of::<AdcOpen>(), units::adc),
    (of::<AdcClose>(), units::adc),
    (of::<AdcConfigSampleModule>(), units::adc),
    (of::<EepromRequest>(), registers::eeproms),
    (of::<EepromGet>(), registers::eeproms),
    (of::<StateCheck>(), network::states_are_set_and_checked),
    (of::<DcSync>(), network::clocks),
    (of::<FifoClear>(), fifos::clear),
    (of::<FifoSetTxCount>(), fifos::entries),
    (of::<FifoGetTxCount>(), fifos::entries),
    (of::<FifoSetRxCount>(), fifos::entries),
    (of::<FifoGetRxCount>(), fifos::entries),
    (of::<FirmwareVersionGet>(), start::version_and_size),
    (of::<StateUpdate>(), network::states_are_read_anew),
    (of::<InterruptSetEnable>(), interrupts::int1_and_its_flags),
    (of::<InterruptGetEnable>(), interrupts::int1_and_its_flags),
    (of::<FifoInit>(), fifos::entries),
    (of::<SdoAbortCodeGet>(), transfers::abort_codes),
    (of::<FifoThresholdSet>(), fifos::thresholds),
    (of::<ConfigSyncManager>(), registers::sync_managers),
    (of::<ConfigFmmu>(), registers::fmmus),
    (of::<ConfigMap>(), network::layout_of_slaves_that_fall_back),
    (of::<HelperStatuswordGet>(), helper::a_drive_is_led),
    (of::<AsyncReset>(), start::reset_of_the_wait_for_the_port),
    (of::<Mdio>(), units::phy),
    (of::<DirectAssign>(), registers::direct_assign),
    (of::<CoeEmergency>(), registers::emergencies),
    (of::<WarmReset>(), start::warm_reset),
    (of::<WkcErrorCountGet>(), network::working_counter_errors),
    (of::<WkcErrorMaxGet>(), network::working_counter_errors),
    (of::<WkcErrorMaxSet>(), network::working_counter_errors),
    (of::<RawRequest<'_>>(), registers::datagrams),
    (of::<RawGet>(), registers::datagrams),
    (of::<FoeRequest<'_>>(), transfers::flash),
    (of::<FoeGet>(), transfers::flash),
    (of::<EnableLrw>(), network::working_counter),
    (of::<ReceiveMailbox>(), registers::mailboxes),
    (of::<MailboxStatus>(), registers::mailboxes),
];

/// XF-13.1 There is a test for each function of the table.
#[test]
fn every_function_has_a_test() {
    let functions = COMMANDS.iter().flat_map(|row| {
        let whole = row.functions.is_empty().then_some((row.code, None));
        whole.into_iter().chain(row.functions.iter().map(|function| (row.code, Some(function.parameter))))
    });
    let shown = SHOWN.map(|(function, _)| function);
    assert_eq!(functions.collect::<Vec<Function>>(), shown);
}

/// XF-13.2 XF-11.8 Functions that slave models do not have are refused.
#[test]
fn what_models_have_not_is_refused() {
    #[rustfmt::skip]
    const REFUSED: [(CommandCode, fn()); 7] = [
        (CommandCode::EepromRequest, refused::eeproms),
        (CommandCode::EepromGet, refused::eeproms),
        (CommandCode::ConfigSyncManager, refused::sync_managers),
        (CommandCode::RawRequest, refused::datagrams),
        (CommandCode::RawGet, refused::datagrams),
        (CommandCode::ReceiveMailbox, refused::mailboxes),
        (CommandCode::MailboxStatus, refused::mailboxes),
    ];
    assert_eq!(REFUSED.map(|(code, _)| code), NEED_REGISTERS);
    REFUSED.iter().for_each(|(_, test)| test());
}

/// XF-11.8 Each of the 67 codes has the same effect over controllers as over slave models, if those have it.
#[test]
fn every_function_does_the_same_over_controllers() {
    OVER_CONTROLLERS.set(true);
    let mut failed: Vec<Function> = Vec::new();
    let mut tested: Vec<fn()> = Vec::new();
    for (function, test) in SHOWN {
        if tested.iter().any(|done| std::ptr::fn_addr_eq(*done, test)) {
            continue;
        }
        tested.push(test);
        if catch_unwind(AssertUnwindSafe(test)).is_err() {
            failed.push(function);
        }
    }
    OVER_CONTROLLERS.set(false);
    assert!(failed.is_empty(), "{failed:?}");
}

/// XF-13.1 The test of a function fails on a wire on which the function has no effect.
#[test]
fn every_test_sees_the_effect() {
    for (function, test) in SHOWN {
        ignore(Some(function));
        let outcome = catch_unwind(AssertUnwindSafe(test));
        ignore(None);
        assert!(outcome.is_err(), "without effect, and the test passes: {function:?}");
    }
}
