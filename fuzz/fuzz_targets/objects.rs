//! Any text as a list of a maker's objects, and as an ESI file that one is made of: what is read is written so that it is
//! read as the same, and a simulated drive has it; else an error that says where.

#![no_main]

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope, SdoSize};
use ecmsk::slave::ManufacturerObjects;
use ecmsk::slave::dictionary::Access;
use ecmsk_tool::fuzzed;
use libfuzzer_sys::fuzz_target;

/// What begins a first line that names a device, as the command line does.
const DEVICE: &str = "--device ";

fuzz_target!(|text: &str| {
    match ManufacturerObjects::parse(text) {
        Ok(objects) => {
            let written = lines(&objects);
            assert_eq!(lines(&read(&written)), written);
            have(objects);
        }
        Err(error) => {
            let line = text.strip_prefix('\u{FEFF}').unwrap_or(text).lines().nth(error.line - 1).expect("a line of it");
            assert!(!line.trim().is_empty() && !error.message.is_empty());
        }
    }
    let (device, esi) = match text.strip_prefix(DEVICE).and_then(|text| text.split_once('\n')) {
        Some((device, esi)) => (Some(device), esi),
        None => (None, text),
    };
    match fuzzed::objects(esi, device) {
        Ok(converted) => {
            let (head, written) = converted.split_once('\n').expect("a line that says what it is");
            assert!(head.starts_with("# objects of "));
            assert_eq!(lines(&read(&converted)), written);
        }
        Err(error) => assert!(!error.is_empty()),
    }
});

fn read(text: &str) -> ManufacturerObjects {
    ManufacturerObjects::parse(text).unwrap_or_else(|error| panic!("it was written so: {error}\n{text}"))
}

fn lines(objects: &ManufacturerObjects) -> String {
    objects.objects().iter().map(|object| format!("{object}\n")).collect()
}

/// The first 4 bytes of an object, as the board reads them.
fn upload(objects: &ManufacturerObjects, at: ObjectAddress) -> Result<u32, AbortCode> {
    let mut first = [0; 4];
    objects.read(at, SdoScope::Entry, &mut first, AbortCode::NO_OBJECT).map(|_| u32::from_le_bytes(first))
}

/// A slave that has them answers for each: what is written is read, of what it may not the reason is said.
fn have(mut objects: ManufacturerObjects) {
    for object in objects.objects().to_vec() {
        let at = object.address;
        match upload(&objects, at) {
            Ok(bits) => assert_eq!(bits, object.value.bits() as u32),
            Err(code) => assert_eq!((code, object.access), (AbortCode::WRITE_ONLY, Access::WriteOnly)),
        }
        for size in [SdoSize::One, SdoSize::Two, SdoSize::Four] {
            let fits = object.data.bytes().is_none_or(|bytes| bytes == size.bytes());
            let value = &0xA1B2_C3D4u32.to_le_bytes()[..size.bytes().into()];
            let done = objects.write(at, SdoScope::Entry, value, AbortCode::NO_OBJECT);
            assert_eq!(done.is_ok(), fits && object.access != Access::ReadOnly, "{object}");
            if done.is_ok() && object.access == Access::ReadWrite {
                let stored = upload(&objects, at).expect("it can be read");
                assert_eq!(stored, 0xA1B2_C3D4 & size.mask(), "{object}");
            }
        }
    }
}
