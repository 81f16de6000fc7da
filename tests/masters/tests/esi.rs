//! ESI files of the simulated slaves, read by a parser of another project, `ethercat-esi` 0.2.0. Its program is
//! `tests/masters/esi_reader`, outside the workspace.
#![cfg(target_os = "linux")]

use std::fs::{create_dir_all, write};
use std::process::Command;

use ecmsk::ethercat::sii::{CategoryKind, Sii, SiiPdoEntry, SiiSmEnable};
use ecmsk::link::simulated_slaves;
use ecmsk::link::slaves::{self, SlaveModel};
use ecmsk::slave::esc::{eeprom_of, esi_of};

/// The program's expected output for a device with this EEPROM and name, between the lines on vendor and group.
fn expected(eeprom: &[u8], name: &str) -> Vec<String> {
    let sii = Sii::new(eeprom).expect("an EEPROM");
    let identity = sii.info().identity;
    let mut lines = vec![format!("device {:08X} {:08X} YY {name}", identity.product, identity.revision)];
    for sm in sii.category(CategoryKind::SyncManagers).expect("sync managers").sync_managers() {
        let enable = u8::from(sm.enable.contains(SiiSmEnable::ENABLE));
        lines.push(format!("sm {:04X} {:02X} {} {enable}", sm.start, sm.control.0, sm.len));
    }
    for (kind, category) in [("rx", CategoryKind::RxPdos), ("tx", CategoryKind::TxPdos)] {
        for pdo in sii.category(category).expect("PDOs").pdos() {
            let pdo = pdo.expect("a PDO");
            lines.push(format!("{kind} {:04X} {}", pdo.index, pdo.sync_manager));
            for SiiPdoEntry { index, sub, bits, data_type, .. } in pdo.entries.iter() {
                lines.push(format!("entry {index:04X}:{sub} {bits} {}", type_name(data_type)));
            }
        }
    }
    lines
}

fn type_name(code: u8) -> &'static str {
    match code {
        2 => "SINT",
        4 => "DINT",
        3 => "INT",
        5 => "USINT",
        6 => "UINT",
        7 => "UDINT",
        other => panic!("{other}"),
    }
}

/// ECAT-15.15 The ESI file of each kind of slave is read by another project's parser, which finds the content of the
/// EEPROM in it: identity, ports, sync managers, PDOs with each entry.
#[test]
fn another_parser_reads_each_esi_file() {
    let manifest = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("esi_reader/Cargo.toml");
    let target = support::target_dir().join("masters");
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo
        .args(["build", "--locked", "--manifest-path"])
        .arg(manifest)
        .arg("--target-dir")
        .arg(target.join("esi_reader"));
    // Flags for this test's own build (coverage, a linker) must not apply to the program.
    support::succeed(cargo.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS"));
    let program = target.join("esi_reader/debug/esi_reader");
    create_dir_all(target.join("esi")).expect("the target folder");
    for kind in SlaveModel::ALL.map(SlaveModel::name) {
        let build = || simulated_slaves::build(&slaves::parse(kind).expect("a kind")).expect("a slave").remove(0);
        let settings = build().controller_settings();
        let eeprom = eeprom_of(&mut *build(), &settings).expect("it can be described");
        let file = target.join("esi").join(format!("{kind}.xml"));
        write(&file, esi_of(&mut *build(), &settings).expect("it can be described")).expect("a file");
        let printed = support::succeed(Command::new(&program).arg(&file));
        let lines: Vec<&str> = printed.lines().collect();
        let vendor = Sii::new(&eeprom).expect("an EEPROM").info().identity.vendor;
        assert_eq!(lines[0], format!("vendor {vendor:08X} ecmsk"), "{kind}");
        let name = lines[2].splitn(5, ' ').nth(4).expect("a name");
        assert_eq!(lines[2..], expected(&eeprom, name), "{kind}");
        assert!(!name.is_empty(), "{kind}");
    }
}
