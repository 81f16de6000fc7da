//! What the makers' drivers and other clients do against the manuals: each row has its tests, whose comments name it.

use std::fs;
use std::path::Path;

/// What is known, and its tests: files from the root of the project, and names.
const ROWS: &[(&str, &[(&str, &str)])] = &[
    (
        "CRC-32 covers",
        &[
            ("tests/xf/drivers.rs", "driver_0_1"),
            ("tests/xf/drivers.rs", "driver_1_60"),
            ("tests/xf/host/start.rs", "what_a_crc_covers_is_found_for_each_direction"),
            ("tests/xf/host/start.rs", "a_crc_that_covers_nothing_known_is_given_up"),
        ],
    ),
    ("PDO_DATA_OP, op 6", &[("tests/xf/drivers.rs", "driver_1_60")]),
    (
        "402_CTL_SET without 402_CONFIG_SET",
        &[
            ("tests/xf/drivers.rs", "driver_0_1"),
            ("tests/xf/pair/helper.rs", "defaults_of_old_firmware"),
            ("tests/xf/pair/helper.rs", "motors_that_are_not_configured"),
        ],
    ),
    ("STATE_SET 0x12", &[("tests/xf/drivers.rs", "a_state_with_the_acknowledge_bit")]),
    ("SLV_INFO items 10..13", &[("tests/xf/drivers.rs", "items_of_the_clock")]),
    (
        "WKC of LRD + LWR",
        &[("tests/xf/pair/network.rs", "working_counter"), ("tests/xf/pair/network.rs", "lrw_of_the_initialisation")],
    ),
    ("PDO_CONFIG with VID and PID first", &[("tests/xf/drivers.rs", "what_is_not_known")]),
    ("NOP answer to the driver's own repeat", &[("tests/xf/drivers.rs", "what_is_not_known")]),
    ("codes 40, 60..65, 128, 133..136, 141", &[("tests/xf/drivers.rs", "driver_1_60")]),
    ("1 byte per exchange", &[("tool/tests/tool/dump_packets.rs", "pieces_are_joined")]),
    (
        "error bits of 0x09",
        &[
            ("tests/xf/drivers.rs", "a_closed_client"),
            ("tests/xf/chip/exchanges.rs", "errors_are_shown_before_they_are_cleared"),
        ],
    ),
    (
        "CRC by direction",
        &[("tests/xf/drivers.rs", "a_closed_client"), ("tests/xf/pair/start.rs", "a_crc_of_any_coverage")],
    ),
    ("reset", &[("tests/spi/chip.rs", "the_reset_line"), ("tests/xf_port/messages.rs", "the_chip_is_reset")]),
    ("three PDOs of each direction", &[("tests/xf/drivers.rs", "a_closed_client")]),
    ("zeros", &[("tests/xf/host/faults.rs", "a_chip_that_answers_zeros")]),
];

/// The rows that the comment of a test names; `None`: there is no such test.
fn named<'a>(source: &'a str, test: &str) -> Option<Vec<&'a str>> {
    let (before, _) =
        source.split_once(&format!("\nfn {test}(")).or_else(|| source.split_once(&format!("\npub fn {test}(")))?;
    let above: Vec<&str> =
        before.lines().rev().take_while(|line| line.starts_with("///") || line.starts_with("#[")).collect();
    above.contains(&"#[test]").then(|| {
        let rows =
            above.iter().find_map(|line| line.strip_prefix("/// Row: ").or_else(|| line.strip_prefix("/// Rows: ")));
        rows.map_or(Vec::new(), |rows| rows.trim_end_matches('.').split("; ").collect())
    })
}

/// XF-13.6 Each row has its tests, and they name it.
#[test]
fn each_row_has_its_tests() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for (row, tests) in ROWS {
        assert!(!tests.is_empty(), "{row}");
        for (file, test) in *tests {
            let source = fs::read_to_string(root.join(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
            let names =
                named(&source, test).unwrap_or_else(|| panic!("{file} has no test {test}, for the row \"{row}\""));
            assert!(names.contains(row), "{file}: the comment of {test} does not name the row \"{row}\": {names:?}");
            for name in names {
                let is_known = ROWS.iter().any(|(row, tests)| *row == name && tests.contains(&(*file, *test)));
                assert!(is_known, "{file}: {test} names \"{name}\", which is no row of it here");
            }
        }
    }
}
