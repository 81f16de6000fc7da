//! The table of fields, against the list of the manuals' functions and against the types of requests and answers.

use ecmsk::coe::AbortCode;
use ecmsk::xf::command_table::AnswerForm;
use ecmsk::xf::fields::{Draft, FUNCTIONS, Field, FieldKind, FieldPosition, Value, function};
use ecmsk::xf::request::{
    InterruptEnable, MappedObject, PdoAssignment, PdoConfig, PdoConfigForm, PdoMap, PeripheralInterrupts, Polarity,
};
use ecmsk::xf::response::{Answer, FirmwareIdentity, FirmwareVersion, RawAnswer, Returned, Series, SlaveInfo};
use ecmsk::xf::{Interrupts, NetworkState, Request};

use crate::codes::{MANUAL, functions};
use crate::slave;

/// XF-18.12 Each of the 91 functions has one row, in the order of codes and parameters, with the manuals' name.
#[test]
fn each_function_has_a_row() {
    let mut wanted = functions();
    wanted.sort_unstable();
    let rows: Vec<_> = FUNCTIONS.iter().map(|row| (row.code.code(), row.function)).collect();
    assert_eq!(rows, wanted);
    for row in &FUNCTIONS {
        let (_, name, functions) =
            MANUAL.iter().find(|(code, ..)| *code == row.code.code()).expect("a code of the manual");
        let of_function = functions.iter().find(|(parameter, _)| Some(*parameter) == row.function);
        let name = of_function.map_or(*name, |(_, name)| name);
        assert!(row.name().ends_with(name) && !row.what.is_empty(), "{}", row.type_name);
        let all = || row.answers.iter().flat_map(|form| form.fields);
        let form = match (all().any(is_return), all().any(|field| !is_return(field))) {
            (false, false) => AnswerForm::Nothing,
            (true, false) => AnswerForm::Value,
            (false, true) => AnswerForm::Data,
            (true, true) => AnswerForm::ValueAndData,
        };
        assert_eq!(form, row.answer_form(), "{}", row.type_name);
    }
}

fn is_return(field: &Field) -> bool {
    field.position == FieldPosition::Return
}

/// XF-18.12 A function is found by the name of its type and by the manuals' name, with and without its prefixes and in any case;
/// a name that the manuals give to two functions finds both.
#[test]
fn functions_are_found_by_their_names() {
    let found = |name: &str| function(name).map(|row| row.type_name).collect::<Vec<_>>();
    for row in &FUNCTIONS {
        assert_eq!(found(row.type_name), [row.type_name]);
        assert!(found(row.name()).contains(&row.type_name), "{}", row.name());
    }
    for name in ["ECM_CMD_ECAT_STATE_GET", "ECAT_STATE_GET", "state_get", "state-get", "StateGet", "STATEGET"] {
        assert_eq!(found(name), ["StateGet"], "{name}");
    }
    assert_eq!(found("402_STATE_SET"), ["HelperStateSet"]);
    assert_eq!(found("ECM_GpioSetMode"), ["GpioSetMode", "GpioSetModeExt"]);
    assert_eq!(found("ECM_CMD_CYCTIME_SET"), [""; 0]);
}

/// The bytes to write into a field that is no number.
fn bytes_for(kind: FieldKind) -> &'static [u8] {
    match kind {
        FieldKind::Text => b"name",
        FieldKind::SlaveSet => &[0b101],
        _ => &[0x10, 0x00, 0x40, 0x60],
    }
}

/// XF-18.12 A number that is too large for its field, and data that are too long, are errors that name the field; a
/// value that the manuals do not allow is an error of the type.
#[test]
fn wrong_values_are_errors() {
    let mut data = [0; 32];
    let set = function("StateSet").next().expect("a row");
    let mut draft = Draft::new(set, &mut data);
    let (slaves, state) = (set.field("slaves").expect("a field"), set.field("STATE").expect("a field"));
    let error = draft.put(slaves, Value::Number(256)).expect_err("a byte").to_string();
    assert_eq!(error, "slaves is 256 (0x100), allowed is 0 to 255");
    assert!(draft.put(slaves, Value::Number(-1)).is_err());
    draft.put(state, Value::Number(5)).expect("it fits");
    assert!(draft.request().expect_err("no state").to_string().contains("EtherCAT state is 5"));
    let sdo = function("SDO_REQ").next().expect("a row");
    let mut draft = Draft::new(sdo, &mut data);
    let error = draft.put(sdo.field("data").expect("a field"), Value::Bytes(&[0; 21])).expect_err("too long");
    assert!(error.to_string().contains("33"), "{error}");
    // A segment that is too short for the layout is an error and no panic.
    for row in &FUNCTIONS {
        for len in 0..40 {
            let mut data = vec![0; len];
            let mut draft = Draft::new(row, &mut data);
            for field in row.request {
                let value = if field.is_number() { Value::Number(1) } else { Value::Bytes(bytes_for(field.kind)) };
                let _ = draft.put(field, value);
            }
            let _ = draft.request();
        }
    }
}

/// The fields of an answer with their values.
fn read<'a>(name: &str, answer: &impl Answer<'a>) -> Vec<(&'static str, String)> {
    let mut data = vec![0; 1408];
    let returned = answer.encode(&mut data).expect("it fits");
    fields(name, returned, &data)
}

fn fields(name: &str, returned: Returned, data: &[u8]) -> Vec<(&'static str, String)> {
    let row = function(name).next().expect("a row");
    let form = row.answer(returned).expect("a form");
    let text = |value| match value {
        Value::Number(number) => number.to_string(),
        Value::Bytes(bytes) => format!("{bytes:?}"),
    };
    form.fields.iter().filter_map(|field| Some((field.name, text(field.get(returned, data, 0)?)))).collect()
}

/// XF-18.12 The fields of answers are where their types have them; fields that an answer does not have are left out.
#[test]
fn answers_are_read_by_fields() {
    let number = |name, number: u32| (name, number.to_string());
    assert_eq!(read("StateGet", &NetworkState(0x14)), [number("state", 4), number("error", 1)]);
    assert_eq!(read("SdoAbortCodeGet", &AbortCode::NO_OBJECT), [number("abort", 0x0602_0000)]);
    let old = FirmwareVersion { version: 0x0E, identity: None };
    assert_eq!(read("FW_VERSION_GET", &old), [number("version", 0x0E)]);
    let identity = FirmwareIdentity { extended: 0x0102, series: Series(3), identification: [7; 16] };
    let new = FirmwareVersion { version: 0x22, identity: Some(identity) };
    let shown = read("FW_VERSION_GET", &new);
    assert_eq!(shown[..3], [number("version", 0x22), number("extended", 0x0102), number("series", 3)]);
    assert_eq!(shown[3], ("identification", format!("{:?}", [7; 16])));
    assert_eq!(read("SlaveInfoGet", &SlaveInfo::U16(0x1001)), [number("value", 0x1001)]);
    assert_eq!(read("SlaveInfoGet", &SlaveInfo::Text(b"abc")), [("value", format!("{:?}", b"abc"))]);
    let enabled = InterruptEnable {
        polarity: Polarity::INT0_HIGH,
        sources: Interrupts::CRC,
        gpio: 0x81,
        peripherals: PeripheralInterrupts::GPIO_9,
    };
    let wanted = [number("polarity", 2), number("sources", 1 << 23), number("gpio", 0x81), number("peripherals", 2)];
    assert_eq!(read("InterruptGetEnable", &enabled), wanted);
    let raw =
        RawAnswer { operation: 1, adp: 2, ado: 0x130, logical: 4, timeout_us: 5, working_counter: -1, data: &[8, 0] };
    let shown = read("RawGet", &raw);
    assert_eq!(shown[5..], [("working_counter", "-1".to_owned()), ("data", "[8, 0]".to_owned())]);
}

/// XF-18.12 PDO_CONFIG_GET of either form: the objects of each PDO, as many as are counted.
#[test]
fn pdo_configurations_are_read_by_fields() {
    let object = MappedObject { index: 0x6040, sub: 0, bits: 16 };
    for form in [PdoConfigForm::Three, PdoConfigForm::Four] {
        let maps: Vec<_> =
            (0..form.maps()).map(|n| PdoMap::new(0x1600 + n as u16, &vec![object; n + 1]).expect("up to 8")).collect();
        let config = PdoConfig::new(slave(5), PdoAssignment::Rx, form, &maps).expect("there is room");
        let shown = read("PDO_CONFIG_GET", &config);
        assert_eq!(shown.len(), 3 + 2 * form.maps());
        for n in 0..form.maps() {
            let bytes = vec![[16_u8, 0, 0x40, 0x60]; n + 1].concat();
            assert_eq!(shown[3 + 2 * n].1, (0x1600 + n).to_string());
            assert_eq!(shown[4 + 2 * n].1, format!("{bytes:?}"), "{form:?} PDO {n}");
        }
    }
    assert_eq!(Request::FUNCTIONS, FUNCTIONS.len());
}

/// Fields that share a place, each for other operations.
const SHARED: [(&str, &str, &str); 3] =
    [("DirectAssign", "on", "direction"), ("ReceiveMailbox", "slave", "start"), ("FoeRequest", "name", "data")];

/// XF-18.12 No two fields share a place, except fields of different operations: a field at a wrong place would also be
/// decoded by the type, under another name.
#[test]
fn fields_have_places_of_their_own() {
    for row in &FUNCTIONS {
        for (n, field) in row.request.iter().enumerate() {
            for other in &row.request[..n] {
                let is_shared = SHARED.contains(&(row.type_name, other.name, field.name));
                assert_eq!(overlap(field, other), is_shared, "{}: {} and {}", row.type_name, other.name, field.name);
            }
        }
    }
}

fn overlap(a: &Field, b: &Field) -> bool {
    let bits = |field: &Field| {
        let (area, byte) = match field.position {
            FieldPosition::Data(byte) => (0, usize::from(byte)),
            FieldPosition::Info(byte) => (1, byte.into()),
            FieldPosition::Parameter => (2, 0),
            FieldPosition::Reserve => (3, 0),
            FieldPosition::Length => (4, 0),
            FieldPosition::Return => (5, 0),
        };
        let begin = 8 * byte + usize::from(field.shift);
        let width = match (field.bytes, field.width) {
            (0, _) => 8 * 1408,
            (bytes, 0) => 8 * usize::from(bytes),
            (_, width) => width.into(),
        };
        (area, begin..begin + width)
    };
    let ((a_area, a), (b_area, b)) = (bits(a), bits(b));
    a_area == b_area && a.start < b.end && b.start < a.end
}
