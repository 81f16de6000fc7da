//! Objects, files and EEPROMs that are written.

mod needs_network_namespace {
    use std::fs;
    use std::path::PathBuf;

    use ecmsk::coe::{ObjectAddress, SdoScope};
    use ecmsk::ethercat::sii::checksum;
    use masters::Rig;
    use serde_json::json;

    use crate::card::{LIST, by_library, file, look};

    /// BUS-5.1 The next run reads what one run has written, in words and as JSON, and so does the library; no other
    /// slave has changed. The earlier states of slaves are reported.
    #[test]
    fn what_is_written_is_what_the_next_run_reads() {
        let rig = Rig::new(LIST, "tool_writes");
        let object = ["0x6099:1", "0x607C:0", "0x4FFF:0"];
        let before = look(&["sdo", "read", "2", object[0], "--json"]).lines()[0]["value"].clone();
        assert_ne!(before, 51_234);
        let said = look(&["sdo", "write", "1", object[0], "51234"]).good();
        assert_eq!(said, "slave 1: homing_speed_switch (0x6099:1) = 51234\n");
        let read = look(&["sdo", "read", "1", object[0]]);
        assert_eq!(read.err, "note: slave 1 was found in PreOP, and was brought to Init\n");
        assert_eq!(read.good(), "51234 (0x0000C822)\n");
        let written = look(&["sdo", "write", "2", object[1], "-7", "--type", "i32", "--json"]).lines();
        assert_eq!((&written[0]["value"], &written[0]["bytes"]), (&json!(-7), &json!("F9FFFFFF")));
        let read = look(&["sdo", "read", "2", object[1], "--type", "i32", "--json"]).lines();
        assert_eq!((&read[0]["value"], &read[0]["slave"]), (&json!(-7), &json!(2)));
        look(&["sdo", "write", "3", object[2], "hex:0102FF7F80"]).good();
        let bytes = by_library(|network| {
            assert_eq!(network.upload(1, ObjectAddress::new(0x6099, 1), SdoScope::Entry)?, 51_234_u32.to_le_bytes());
            network.upload(3, ObjectAddress::new(0x4FFF, 0), SdoScope::Entry)
        });
        assert_eq!(bytes, [1, 2, 0xFF, 0x7F, 0x80]);
        let dumped = look(&["sdo", "dump", "2"]).good();
        let line =
            |object: &str| dumped.lines().find(|line| line.starts_with(object)).expect("it is dumped").to_owned();
        assert!(line("0x607C:0 ").contains(" -7 (0xFFFFFFF9) "), "{dumped}");
        assert!(line("0x6099:1 ").contains(&format!(" {before} (0x")), "{dumped}");

        let content: Vec<u8> = (0..=u8::MAX).cycle().take(1000).collect();
        let (table, back) = (file("table.bin"), file("table_back.bin"));
        fs::write(&table, &content).expect("a file");
        let table = table.display().to_string();
        let said = look(&["foe", "write", "2", &table, "--json"]).lines();
        assert_eq!((&said[0]["name"], &said[0]["bytes"]), (&json!("table.bin"), &json!(1000)));
        look(&["foe", "read", "2", "table.bin", "--output", &back.display().to_string(), "--overwrite"]).good();
        assert_eq!(fs::read(&back).expect("it is written"), content);
        assert_eq!(by_library(|network| network.read_file(2, "table.bin", 0)), content);
        let said = look(&["foe", "write", "1", &table, "--name", "other"]).good();
        assert_eq!(said, "slave 1: other written, 1000 bytes\n");
        look(&["foe", "read", "1", "table.bin"]).fails(1, &["slave 1, file table.bin", "the file was not found"]);
        let said = rig.end();
        assert!(!said.iter().any(|line| line.ends_with("SafeOP") || line.ends_with(" OP")), "{said:?}");
    }

    /// An EEPROM is written only with `--yes`, and the next run finds the new content once the slave was switched off
    /// and on.
    #[test]
    fn an_eeprom_is_written_when_it_is_confirmed() {
        let rig = Rig::new("io*2", "tool_sii");
        let [present, changed, back] = ["present.bin", "changed.bin", "sii_back.bin"].map(file);
        let path = |file: &PathBuf| file.display().to_string();
        look(&["sii", "read", "2", "--output", &path(&present)]).good();
        let mut content = fs::read(&present).expect("it is written");
        assert_eq!(by_library(|network| network.read_eeprom(2)), content);
        content[8] = 9;
        content[14] = checksum(content.first_chunk().expect("14 bytes"));
        fs::write(&changed, &content).expect("a file");
        let shown = look(&["sii", "write", "2", &path(&changed)]);
        assert!(shown.code == Some(1) && shown.err.contains("nothing was written"), "{shown:?}");
        assert!(shown.out.starts_with("word 0x0004: 0x0000 -> 0x0009  station alias\n"), "{shown:?}");
        look(&["sii", "read", "2", "--output", &path(&back)]).good();
        assert_eq!(
            fs::read(&back).expect("it is read"),
            fs::read(&present).expect("it is there"),
            "it was not written"
        );
        let written = look(&["sii", "write", "2", &path(&changed), "--yes", "--json"]).lines();
        assert_eq!(written.last().expect("a line")["written_words"], written.len() - 1);
        rig.happen("lose 2");
        rig.happen("find 2");
        let slaves = look(&["scan", "--json"]).lines();
        assert_eq!(slaves.iter().map(|slave| &slave["alias"]).collect::<Vec<_>>(), [&json!(0), &json!(9)]);
        look(&["sii", "read", "2", "--output", &path(&back)]).good();
        assert_eq!(fs::read(&back).expect("it is read"), content);
        let again = look(&["sii", "write", "2", &path(&changed), "--yes"]);
        assert!(again.err.contains("has this content already"), "{again:?}");
        assert_eq!(again.good(), "");
        content[0] ^= 1;
        fs::write(&changed, &content).expect("a file");
        look(&["sii", "write", "2", &path(&changed), "--yes"]).fails(1, &["checksum"]);
    }
}
