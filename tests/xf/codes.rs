//! The 67 codes and 91 functions, against a list that was written from the manuals' text.

use std::cell::RefCell;
use std::collections::BTreeSet;

use ecmsk::xf::command_table::{AnswerForm, COMMANDS, CommandEffect, CommandTiming};
use ecmsk::xf::request::{Arguments, UnknownCommand};
use ecmsk::xf::{CommandCode, Request};

/// Code, name, and the functions by parameter.
type Row = (u8, &'static str, &'static [(u8, &'static str)]);

/// Code, name without `ECM_CMD_` (with `ECM_` where the manuals have that), and the functions by parameter: the blocks
/// of the English manual in their order of codes.
#[rustfmt::skip]
pub const MANUAL: &[Row] = &[
    (0, "INFO_UPDATE_OP", &[]), (1, "ECAT_INIT_OP", &[]), (2, "ECAT_RECONFIG_OP", &[]), (3, "ECAT_INIT_DC_OP", &[]),
    (4, "ECAT_PDO_WC_GET", &[]), (5, "ECAT_PDO_DATA_FIFO_OP", &[]), (6, "ECAT_PDO_DATA_OP", &[]),
    (7, "ECAT_PDO_CONFIG_SET", &[]), (8, "ECAT_PDO_CONFIG_REQ", &[]), (9, "ECAT_PDO_CONFIG_GET", &[]),
    (10, "ECAT_SDO_REQ", &[]), (11, "ECAT_SDO_GET", &[]), (12, "ECAT_STATE_SET", &[]), (13, "ECAT_STATE_GET", &[]),
    (15, "ECAT_SLV_INFO_GET", &[]), (16, "ECAT_SLV_CNT_GET", &[]), (18, "FIFO_ENABLE", &[]),
    (19, "FIFO_PACK_SIZE_GET", &[]), (20, "SPI_PACK_SIZE_GET", &[]), (23, "SPI_RECONFIG_OP", &[]),
    (24, "CRC_ERR_CNT_CLR", &[]), (25, "CRC_TYPE_SET", &[]), (26, "402_CONFIG_SET", &[]), (27, "402_STATE_SET", &[]),
    (28, "402_STATE_GET", &[]), (29, "402_CTL_SET", &[]), (30, "402_CTL_GET", &[]),
    (31, "ECM_GPIO_CONFIG_SET", &[
        (0, "ECM_GpioSetMode"), (8, "ECM_GpioSetMode"), (2, "ECM_GpioEnableDebounce"), (9, "ECM_GpioEnableDebounce"),
        (3, "ECM_GpioSetDebounceClock"), (1, "ECM_GpioIntEnable"), (4, "ECM_GpioIntClear"), (6, "ECM_GpioIntClear"),
    ]),
    (32, "ECM_GPIO_FUNC_OP", &[
        (0, "ECM_GpioSetValue"), (2, "ECM_GpioExtSetValue"), (1, "ECM_GpioGetValue"), (3, "ECM_GpioExtGetValue"),
        (5, "ECM_GpioGetIntFlag"), (7, "ECM_GpioExtGetIntFlag"),
    ]),
    (33, "ECM_QEI_FUNC_OP", &[(4, "ECM_EncOpen"), (5, "ECM_EncStart"), (6, "ECM_EncStop"), (21, "ECM_EncGetCount")]),
    (34, "ECM_DAC_FUNC_OP", &[
        (20, "ECM_DacOpen"), (21, "ECM_DacClose"), (22, "ECM_DacSetDelayTime"), (11, "ECM_DacSetData"),
        (0, "ECM_DacStartConv"),
    ]),
    (35, "ECM_ADC_FUNC_OP", &[
        (40, "ECM_AdcOpen"), (41, "ECM_AdcClose"), (42, "ECM_AdcConfigSampleModule"), (17, "ECM_AdcGetDataValidFlag"),
        (12, "ECM_AdcStartConv"), (15, "ECM_AdcGetConvData"),
    ]),
    (38, "ECM_EEPROM_REQ", &[]), (39, "ECM_EEPROM_GET", &[]), (41, "ECAT_STATE_CHECK", &[]), (50, "ECAT_DCSYNC", &[]),
    (51, "FIFO_CLR_OP", &[]), (52, "FIFO_SET_TX_CNT", &[]), (53, "FIFO_GET_TX_CNT", &[]), (54, "FIFO_SET_RX_CNT", &[]),
    (55, "FIFO_GET_RX_CNT", &[]), (56, "FW_VERSION_GET", &[]), (57, "ECAT_STATE_UPDATE", &[]),
    (58, "ECAT_INT_SET_ENABLE", &[]), (59, "ECAT_INT_GET_ENABLE", &[]), (66, "FIFO_INIT", &[]),
    (69, "ECAT_SDO_ABORTCODE_GET", &[]), (70, "ECAT_SET_FIFO_TH", &[]), (71, "ECAT_CONFIG_SM", &[]),
    (72, "ECAT_CONFIG_FMMU", &[]), (73, "ECAT_CONFIG_MAP", &[]), (74, "402_GET_STATUSWORD", &[]),
    (75, "ASYNCCMD_RESET", &[]), (81, "MDIO", &[]), (82, "DIRECT_ASSIGN", &[]), (83, "COE_EMERGENCY", &[]),
    (127, "WARM_RESET", &[]), (130, "ECAT_WKC_CONTI_ERR_CNT_GET", &[]), (131, "ECAT_WKC_CONTI_ERR_MAX_GET", &[]),
    (132, "ECAT_WKC_CONTI_ERR_MAX_SET", &[]), (137, "RAW_ECAT_FUNC_REQ", &[]), (138, "RAW_ECAT_FUNC_GET", &[]),
    (139, "FOE_FUNC_REQ", &[]), (140, "FOE_FUNC_GET", &[]), (142, "ENABLE_LRW", &[]), (143, "RECV_MAILBOX", &[]),
    (144, "MBX_STAT", &[]),
];

/// The functions with data in their answer, and those with a result in the return byte, by the response packets of the
/// manual.
#[rustfmt::skip]
const DATA: [(u8, Option<u8>); 26] = [
    (4, None), (5, None), (6, None), (9, None), (11, None), (15, None), (19, None), (20, None), (32, Some(1)),
    (32, Some(3)), (32, Some(5)), (32, Some(7)), (33, Some(21)), (35, Some(17)), (35, Some(15)),
    (39, None), (56, None), (59, None),
    (69, None), (74, None), (81, None), (83, None), (138, None), (140, None), (143, None), (144, None),
];
const VALUE: [u8; 13] = [5, 13, 16, 24, 28, 30, 39, 53, 55, 56, 59, 130, 131];

/// Every function of the manual: its code and, with codes 31 to 35, its parameter.
pub fn functions() -> Vec<(u8, Option<u8>)> {
    let of = |&(code, _, functions): &Row| {
        let numbered: Vec<_> = functions.iter().map(|(parameter, _)| (code, Some(*parameter))).collect();
        if numbered.is_empty() { vec![(code, None)] } else { numbered }
    };
    MANUAL.iter().flat_map(of).collect()
}

thread_local! {
    /// Functions whose bytes tests of this thread have checked.
    static CHECKED: RefCell<BTreeSet<(u8, Option<u8>)>> = RefCell::default();
}

/// Notes that the bytes of a function were checked.
pub fn note_checked(code: u8, parameter: Option<u8>) {
    CHECKED.with_borrow_mut(|checked| checked.insert((code, parameter)));
}

/// Runs tests that have to check the bytes of every function.
pub fn check_all(tests: &[fn()]) {
    tests.iter().for_each(|test| test());
    assert_eq!(CHECKED.take(), functions().into_iter().collect());
}

/// XF-4.1 The list of the manuals has 67 codes and 91 functions, and the table has the same, by code and name.
#[test]
fn the_table_is_that_of_the_manuals() {
    assert_eq!((MANUAL.len(), functions().len(), Request::FUNCTIONS), (67, 91, 91));
    assert_eq!(COMMANDS.len(), MANUAL.len());
    for (row, (code, name, functions)) in COMMANDS.iter().zip(MANUAL) {
        let name = if name.starts_with("ECM_") { (*name).to_owned() } else { format!("ECM_CMD_{name}") };
        assert_eq!((row.code.code(), row.name), (*code, name.as_str()));
        assert_eq!(row.functions.len(), functions.len(), "{name}");
        for (parameter, name) in *functions {
            let function = row.code.function(*parameter).unwrap_or_else(|| panic!("no function {parameter}"));
            assert_eq!((function.parameter, function.name), (*parameter, *name));
        }
    }
}

/// XF-4.1 Every function of the manuals has a type, and every other code and function survives as unknown.
#[test]
fn every_function_has_a_type_and_others_survive() {
    let data = [0; 1408];
    let functions = functions();
    for code in 0..=255 {
        for parameter in 0..=255 {
            let arguments = Arguments { parameter, ..Arguments::NONE };
            let read = Request::decode(CommandCode::from_code(code), &arguments, &data);
            let known = functions.contains(&(code, None)) || functions.contains(&(code, Some(parameter)));
            let unknown = UnknownCommand { code: CommandCode::from_code(code), arguments, data: &data };
            match read {
                // Zeros are not allowed in every field.
                Err(_) => assert!(known, "{code} {parameter}"),
                Ok(request) => {
                    assert_eq!(request != Request::Unknown(unknown), known, "{code} {parameter}");
                    assert_eq!(request.code().code(), code);
                    if let Some(function) = request.function() {
                        assert_eq!(function, parameter);
                    }
                }
            }
        }
    }
}

/// XF-4.1 A code survives decoding, with a name or without; codes that only the vendor's header names have no name
/// here.
#[test]
fn codes_come_back() {
    for code in 0..=255 {
        let command = CommandCode::from_code(code);
        let known = MANUAL.iter().any(|row| row.0 == code);
        assert_eq!((command.code(), command.name().is_some()), (code, known));
        assert_eq!(matches!(command, CommandCode::Unknown(_)), !known);
        assert_eq!(command.command().map(|row| row.code), known.then_some(command));
    }
    assert_eq!(CommandCode::SdoRequest.to_string(), "ECM_CMD_ECAT_SDO_REQ (10)");
    assert_eq!(CommandCode::from_code(141).to_string(), "unknown command 141");
}

/// XF-4.2 Which commands are done at once.
#[test]
fn commands_that_are_not_done_at_once() {
    let slow = [1, 2, 3, 7, 8, 10, 12, 38, 41, 50, 57, 66, 71, 72, 73, 137, 139];
    for code in 0..=255 {
        for parameter in [0, 1, 48, 255] {
            let immediate = !(slow.contains(&code) || (code, parameter) == (143, 0));
            assert_eq!(CommandCode::from_code(code).is_immediate(parameter), immediate, "{code} {parameter}");
        }
    }
}

/// XF-4.2 Which commands only read, so that they may run again when their answer was lost: those that are done at once and
/// return a result, but 5, which takes TxPDOs out of the FIFO, and 24, which clears a counter. Of 6, 81 and 144 the
/// arguments decide.
#[test]
fn commands_that_only_read() {
    for row in &COMMANDS {
        let effect = match row.code.code() {
            5 | 24 => CommandEffect::Acts,
            6 | 81 | 144 => CommandEffect::ByArguments,
            _ if row.timing == CommandTiming::NonImmediate || row.answer == AnswerForm::Nothing => CommandEffect::Acts,
            _ => CommandEffect::Reads,
        };
        assert_eq!(row.effect, effect, "{}", row.name);
    }
}

/// XF-4.7 Three functions are there from firmware 9 on; answers have their results where the manual's response packets
/// have them.
#[test]
fn functions_say_since_when_and_where_their_result_is() {
    let since_9 = [(31, 6), (32, 2), (32, 3)];
    for (code, parameter) in functions() {
        let row = CommandCode::from_code(code).command().expect("a row");
        let form = match parameter {
            None => row.answer,
            Some(parameter) => {
                assert_eq!(row.answer, AnswerForm::ByFunction);
                let function = row.code.function(parameter).expect("a function");
                assert_eq!(function.since, if since_9.contains(&(code, parameter)) { 9 } else { 0 });
                function.answer
            }
        };
        let data = DATA.contains(&(code, parameter));
        // The manual does not describe the return byte of PDO_DATA_OP; the vendor's driver reads the outcome from it.
        let value = parameter.is_none() && (VALUE.contains(&code) || code == 6);
        let wanted = match (data, value) {
            (false, false) => AnswerForm::Nothing,
            (false, true) => AnswerForm::Value,
            (true, false) => AnswerForm::Data,
            (true, true) => AnswerForm::ValueAndData,
        };
        assert_eq!(form, wanted, "{code} {parameter:?}");
    }
}
