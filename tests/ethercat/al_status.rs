//! AL status codes.

use ecmsk::ethercat::AlStatus;

/// ECAT-7.1 Codes have names, each code one; a code without a name keeps its number.
#[test]
fn codes_have_names_and_others_survive() {
    assert!(AlStatus::ALL.is_sorted_by_key(|code| code.0));
    let mut codes: Vec<u16> = AlStatus::ALL.iter().map(|code| code.0).collect();
    codes.dedup();
    assert_eq!(codes.len(), AlStatus::ALL.len());
    for (code, text) in [
        (0x0000, "no error"),
        (0x0011, "invalid requested state change"),
        (0x0016, "invalid mailbox configuration in pre-operational"),
        (0x001B, "sync manager watchdog"),
        (0x002C, "fatal synchronization error: SYNC is missing"),
        (0x0051, "EEPROM access error"),
    ] {
        assert_eq!(AlStatus(code).text(), Some(text));
        assert_eq!(AlStatus(code).to_string(), format!("0x{code:04X} ({text})"));
    }
    assert_eq!((AlStatus(0xABCD).text(), AlStatus(0xABCD).to_string()), (None, "0xABCD".to_owned()));
}
