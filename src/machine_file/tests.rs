//! Valid machine files, and a fault in each field.

use super::*;
use crate::address::slaves;

const WHOLE: &str = r#"
format = 1
name = "Portal"
link = "sim:?clock=virtual"
cycle_us = 2000

[slaves.1]
kind = "drive"
vendor = 0x66F
product = 0xFFFF_FFFF
revision = 0
simulated = "drive:limits@-1000..1000"

[slaves.2]
kind = "drive"
mode = "csv"

[slaves.3]
kind = "io"

[slaves.4]
kind = "none"

[axes]
Y = { slave = 2, unit = "deg", per = "-360/131072", min = -90, max = 90 }

[axes.X]
slave = 1
unit = "mm"
per = 0.001
min = -10
max = 250.5
max_velocity = 100
max_acceleration = 1000.5
homing = { method = -3, speed_switch = 20000, speed_zero = 2000, acceleration = 4294967295, offset = -2.5 }

[inputs]
door = { slave = 3, bit = 0 }

[outputs]
gripper = { slave = 3, bit = 15 }

[[alarms]]
texts = { 0x7500 = "of all", 0x7501 = "only of all" }

[[alarms]]
vendor = 0x66F
texts = { 0x7500 = "of the vendor", 29954 = "decimal" }

[[alarms]]
vendor = 0x66F
product = 0xFFFF_FFFF
texts = { 0x7500 = "of the product" }
"#;

fn parse(text: &str) -> Result<MachineFile, MachineFileError> {
    MachineFile::parse("m.toml", text)
}

fn error(text: &str) -> String {
    parse(text).map_or_else(|error| error.to_string(), |machine| panic!("{text}: {machine:?}"))
}

#[test]
fn a_whole_file_is_read() {
    let machine = parse(WHOLE).unwrap();
    assert_eq!((machine.name.as_deref(), machine.cycle_us), (Some("Portal"), Some(2000)));
    assert_eq!(machine.link(None).unwrap().to_string(), "sim:?machine=m.toml&clock=virtual");
    let kinds: Vec<SlaveKind> = machine.slaves.iter().map(|slave| slave.kind).collect();
    assert_eq!(kinds, [SlaveKind::Drive, SlaveKind::Drive, SlaveKind::Io, SlaveKind::None]);
    assert_eq!(machine.slaves[1].mode, Mode::Csv);
    let expected = IdentitySpec { vendor: Some(0x66F), product: Some(u32::MAX), revision: Some(0) };
    assert_eq!((machine.slaves[0].expected, machine.slaves[1].expected), (expected, IdentitySpec::default()));
    assert_eq!(machine.slaves[0].simulated.identity, expected);
    assert_eq!(slaves::normal(&[machine.slaves[0].simulated.clone()]), "drive:limits@-1000..1000");
    let x = machine.axis("x").unwrap();
    assert_eq!((x.slave, x.unit, x.scale, x.limits), (1, Unit::Mm, Scale::per_unit(1000.0), limits(-10_000, 250_500)));
    assert_eq!((x.max_velocity, x.max_acceleration), (Some(100.0), Some(1000.5)));
    let homing = AxisHoming {
        method: Some(-3),
        speed_switch: Some(20_000),
        speed_zero: Some(2000),
        acceleration: Some(u32::MAX),
        offset_counts: Some(-2500),
    };
    assert_eq!(x.homing, homing);
    let y = machine.axis_of(2).unwrap();
    assert_eq!((&*y.name, y.scale, y.limits), ("Y", Scale::per_unit(-131_072.0 / 360.0), limits(-32_768, 32_768)));
    let line = |name: &str, bit| IoLine { name: name.to_owned(), slave: 3, bit };
    assert_eq!((machine.inputs.clone(), machine.outputs.clone()), (vec![line("door", 0)], vec![line("gripper", 15)]));
    assert_eq!(
        (machine.input("Door"), machine.output("GRIPPER")),
        (Some(&line("door", 0)), Some(&line("gripper", 15)))
    );
    assert_eq!((machine.input("gripper"), machine.output("door")), (None, None));
}

fn limits(min: i32, max: i32) -> SoftLimits {
    SoftLimits { min, max }
}

const PORTAL: &str = r#"
format = 1
[axes]
X = { slave = 1, unit = "mm", per = 0.001 }
Y = { slave = 2, unit = "mm", per = 0.001 }
Y1 = { slave = 3, kind = "linear", unit = "deg", per = 0.01 }
Y2 = { slave = 4, kind = "linear", unit = "deg", per = 0.01 }
Z = { slave = 5, kind = "linear", unit = "deg", per = 0.01 }
A = { slave = 6, unit = "turn", per = 0.01 }
B = { slave = 7, kind = "rotary", unit = "rad", per = 0.01 }
C = { slave = 8 }
[picture]
xy = [["X", "y"]]
gantries = [{ sides = ["Y1", "Y2"], bridge = "Z" }]
"#;

/// An axis is rotary if its unit is an angle, unless the file says otherwise. The picture refers to its axes by their
/// slaves.
#[test]
fn a_picture_has_the_axes_of_the_file() {
    let machine = parse(PORTAL).unwrap();
    let turning: Vec<&str> =
        machine.axes.iter().filter(|axis| axis.kind == AxisKind::Rotary).map(|axis| &*axis.name).collect();
    assert_eq!(turning, ["A", "B"]);
    let gantry = Gantry { sides: [3, 4], bridge: Some(5) };
    assert_eq!(machine.picture, Picture { xy: vec![[1, 2]], gantries: vec![gantry] });
    assert_eq!(parse(WHOLE).unwrap().picture, Picture::default());
    for (replaced, by, said) in [
        (
            "C = { slave = 8",
            "C = { slave = 8, kind = \"rotary\"",
            "line 11: axes.C.kind: how many counts a turn has is",
        ),
        ("C = { slave = 8", "C = { slave = 8, kind = \"round\"", "line 11: axes.C.kind: unknown variant `round`"),
        ("\"y\"", "\"Q\"", "line 13: picture.xy.1: there is no axis `Q`; name axes of the table [axes]"),
        ("\"y\"", "\"x\"", "line 13: picture.xy.1: axis X is in the picture twice; name it once"),
        ("\"y\"", "\"A\"", "line 13: picture.xy.1: axis A turns; name a linear axis"),
        ("\"y\"", "\"C\"", "line 13: picture.xy.1: axis X is in mm and axis C in counts; give them one unit"),
        ("\"X\", \"y\"", "\"X\"", "line 13: picture.xy.1: invalid length 1"),
        ("\"Z\"", "\"Y\"", "line 14: picture.gantries.1: axis Y is in the picture twice"),
        ("bridge = \"Z\"", "bride = \"Z\"", "line 14: picture.gantries.1.bride: unknown field `bride`"),
    ] {
        assert!(PORTAL.contains(replaced), "{replaced}");
        let said_now = error(&PORTAL.replacen(replaced, by, 1));
        assert!(said_now.starts_with("m.toml, ") && said_now.contains(said), "{replaced} -> {by}\n  {said_now}");
    }
}

/// A text for the product takes precedence over one for the vendor, and that over one for all drives.
#[test]
fn texts_of_alarms_are_those_of_the_nearest_device() {
    let machine = parse(WHOLE).unwrap();
    let text = |slave, code| machine.alarm_text(slave, code);
    assert_eq!((text(1, 0x7500), text(2, 0x7500)), (Some("of the product"), Some("of all")));
    assert_eq!((text(1, 0x7502), text(2, 0x7502)), (Some("decimal"), None));
    assert_eq!((text(1, 0x7501), text(1, 0x7503), text(0, 0x7500)), (Some("only of all"), None, Some("of all")));
}

/// The smallest file has one axis, in counts, on a drive.
#[test]
fn an_axis_alone_is_a_machine() {
    let machine = parse("format = 1\naxes.X.slave = 2\naxes.Y.slave = 1\n").unwrap();
    assert_eq!(machine.slaves.len(), 2);
    let x = machine.axis("X").unwrap();
    assert_eq!(
        (x.unit, x.scale, x.limits, x.homing),
        (Unit::Counts, Scale::COUNTS, SoftLimits::NONE, AxisHoming::default())
    );
    assert_eq!(machine.axes.iter().map(|axis| &*axis.name).collect::<Vec<_>>(), ["Y", "X"]);
    assert_eq!(machine.link(None), None);
}

/// A link that lists its slaves keeps them. Only a link to a simulated board without such a list gets the slaves of the
/// file.
#[test]
fn the_slaves_of_the_file_are_simulated_where_a_link_lists_none() {
    let machine = parse(WHOLE).unwrap();
    let link = |text: &str| machine.link(Some(&LinkUri::parse(text).unwrap())).unwrap().to_string();
    assert_eq!(link("xf-sim:"), "xf-sim:?machine=m.toml");
    assert_eq!(link("sim:?slaves=io"), "sim:?slaves=io");
    // A `sim:` link without a list of slaves has two drives by default, so this list is left out of its normal form.
    assert_eq!(link("sim:?slaves=drive,drive"), "sim:");
    assert_eq!(link("sim:?machine=other"), "sim:?machine=other");
    assert_eq!(link("usb:"), "usb:");
    let both = LinkUri::parse("sim:?slaves=io&machine=m.toml").unwrap_err().to_string();
    assert!(both.contains("the machine file says which slaves there are; allowed: slaves= or machine="), "{both}");
}

/// Each wrong field is an error with its line, its name, and what to do.
#[test]
fn each_wrong_field_is_named_with_its_line() {
    for (line, replaced, by, said) in [
        (2, "format = 1", "", "m.toml, line 1: format: it is missing"),
        (
            2,
            "format = 1",
            "format = 2",
            "m.toml, line 2: format: it is 2, and this version reads up to 1; take a newer",
        ),
        (2, "format = 1", "format = \"1\"", "m.toml, line 2: format: it is no version"),
        (2, "format = 1", "format = 0", "m.toml, line 2: format: it is no version of the format; write `format = 1`"),
        (3, "\"Portal\"", "7", "m.toml, line 3: name: invalid type: integer `7`, expected a string; correct"),
        (3, "name =", "limt =", "m.toml, line 3: limt: unknown field `limt`, expected one of `format`, `name`"),
        (4, "sim:?clock", "sims:?clock", "m.toml, line 4: link: link `sims:?clock=virtual`: unknown scheme"),
        (5, "= 2000", "= 1500", "m.toml, line 5: cycle_us: 1500 us is no cycle of a board; write 250"),
        (5, "= 2000", "= -1", "m.toml, line 5: cycle_us: -1 us"),
        (5, "= 2000", "= 1.5", "m.toml, line 5: cycle_us: invalid type: floating point `1.5`, expected a whole number"),
        (7, "[slaves.1]", "[slaves.0]", "m.toml, line 7: slaves.0: `0` is no number of a slave; name slaves"),
        (7, "[slaves.1]", "[slaves.41]", "m.toml, line 7: slaves.41: `41` is no number"),
        (7, "[slaves.1]", "[slaves.01]", "m.toml, line 7: slaves.01: `01` is no number"),
        (7, "[slaves.1]", "[slaves.2]", "line 14: "),
        (18, "[slaves.3]", "[slaves.7]", "slaves: slave 7 is named, and slave 3 is not; add [slaves.3] with its kind"),
        (8, "kind = \"drive\"", "", "m.toml, line 7: slaves.1: missing field `kind`; add it"),
        (
            8,
            "kind = \"drive\"",
            "kind = \"drives\"",
            "line 8: slaves.1.kind: kind `drives` is unknown; did you mean `drive`?",
        ),
        (
            9,
            "0x66F",
            "-1",
            "m.toml, line 9: slaves.1.vendor: -1 is out of range; write a whole number from 0 to 4294967295",
        ),
        (10, "0xFFFF_FFFF", "0x1_0000_0000", "line 10: slaves.1.product: 4294967296 is out of range"),
        (11, "revision = 0", "revision = \"a\"", "line 11: slaves.1.revision: invalid type: string \"a\""),
        (12, "drive:limits@-1000..1000", "io", "line 12: slaves.1.simulated: `io` is not one slave of kind drive"),
        (12, "drive:limits@-1000..1000", "drive*2", "line 12: slaves.1.simulated: `drive*2` is not one slave"),
        (12, "drive:limits@-1000..1000", "drive:x", "line 12: slaves.1.simulated: "),
        (16, "\"csv\"", "\"pp\"", "line 16: slaves.2.mode: unknown variant `pp`, expected one of `csp`, `csv`, `cst`"),
        (
            19,
            "kind = \"io\"",
            "kind = \"io\"\nmode = \"csp\"",
            "slaves.3.mode: a slave of kind io has no axis; take it out",
        ),
        (
            25,
            "slave = 2,",
            "slave = 1,",
            "m.toml, line 25: axes.Y.slave: axis X is on slave 1, too; give each axis a slave",
        ),
        (25, "slave = 2,", "slave = 0,", "line 25: axes.Y.slave: there is no slave 0; name a slave by its number"),
        (25, "slave = 2,", "slave = 41,", "line 25: axes.Y.slave: there is no slave 41"),
        (25, "slave = 2,", "slave = 3,", "line 25: axes.Y.slave: slave 3 is of a kind without an axis"),
        (25, "slave = 2,", "slave = 4,", "line 25: axes.Y.slave: slave 4 is of a kind without an axis"),
        (25, "slave = 2,", "", "m.toml, line 25: axes.Y: missing field `slave`; add it"),
        (25, "\"deg\"", "\"grad\"", "line 25: axes.Y.unit: unknown variant `grad`, expected one of `mm`, `um`"),
        (25, "\"deg\"", "\"counts\"", "line 25: axes.Y.per: a count is one count; add the unit"),
        (25, "unit = \"deg\", ", "", "line 25: axes.Y.per: it has no unit; add the unit"),
        (25, "per = \"-360/131072\", ", "", "line 25: axes.Y.per: it is missing, and a count may be any number of deg"),
        (25, "-360/131072", "0/5", "line 25: axes.Y.per: 0/5 is no scale; write the units of one count"),
        (25, "-360/131072", "1/2/3", "line 25: axes.Y.per: 1/2/3 is no scale"),
        (25, "\"-360/131072\"", "true", "line 25: axes.Y.per: a number, or a fraction in quotes"),
        (
            25,
            "min = -90, max = 90",
            "min = 90, max = -90",
            "line 25: axes.Y.min: 90 is not below max, -90; exchange them",
        ),
        (25, "min = -90,", "min = 90,", "line 25: axes.Y.min: 90 is not below max, 90"),
        (
            25,
            "max = 90",
            "max = 1e9",
            "line 25: axes.Y.max: 1000000000 is outside the 32 bits of a position; write a number",
        ),
        (25, "max = 90", "max = nan", "line 25: axes.Y.max: NaN is outside"),
        (25, "Y =", "\"1\" =", "m.toml, line 25: axes.1: `1` is no name; begin with a letter"),
        (25, "Y =", "\"a=b\" =", "line 25: axes.a=b: `a=b` is no name"),
        (25, "Y =", "All =", "line 25: axes.All: `All` is no name"),
        (25, "Y =", "x =", "line 25: axes.x: it differs from `X` in upper and lower case alone; rename one"),
        (25, "Y = {", "Y = { limt = 2,", "line 25: axes.Y.limt: unknown field `limt`, expected one of `slave`, `unit`"),
        (30, "per = 0.001", "per = 0", "m.toml, line 30: axes.X.per: 0 is no scale"),
        (30, "per = 0.001", "per = nan", "line 30: axes.X.per: NaN is no scale"),
        (30, "per = 0.001", "per = inf", "line 30: axes.X.per: inf is no scale"),
        (33, "= 100\n", "= 0\n", "line 33: axes.X.max_velocity: 0 is no limit; write a number above 0"),
        (34, "= 1000.5", "= -inf", "line 34: axes.X.max_acceleration: -inf is no limit"),
        (35, "method = -3", "method = 128", "line 35: axes.X.homing.method: there is no homing method 128"),
        (35, "speed_switch = 20000", "speed_switch = 0", "line 35: axes.X.homing.speed_switch: 0 is out of range"),
        (35, "speed_zero = 2000,", "speed_zero = 2.5,", "line 35: axes.X.homing.speed_zero: invalid type"),
        (
            35,
            "offset = -2.5",
            "offset = -10.001",
            "line 35: axes.X.homing.offset: home would be at -10.001, beyond min or max",
        ),
        (35, "offset = -2.5", "offsets = 1", "line 35: axes.X.homing.offsets: unknown field"),
        (38, "slave = 3", "slave = 1", "line 38: inputs.door.slave: slave 1 is of a kind without inputs and outputs"),
        (38, "slave = 3", "slave = 5", "line 38: inputs.door.slave: the file has no slave 5; add [slaves.5]"),
        (
            38,
            "bit = 0 }",
            "bit = 16 }",
            "line 38: inputs.door.bit: 16 is out of range; write a whole number from 0 to 15",
        ),
        (
            38,
            "bit = 0 }",
            "bit = 0 }\ngate = { slave = 3, bit = 0 }",
            "inputs.gate.bit: `door` is bit 0 of slave 3, too",
        ),
        (44, "0x7500 = \"of all\"", "0 = \"none\"", "line 44: alarms.1.texts.0: `0` is no error code; write the code"),
        (44, "0x7500 = \"of all\"", "0x10000 = \"x\"", "line 44: alarms.1.texts.0x10000: `0x10000` is no error code"),
        (44, "0x7500 = \"of all\"", "0x7500 = \" \"", "line 44: alarms.1.texts.0x7500: it is no text of an alarm"),
        (44, "0x7500 = \"of all\"", "0x7500 = 5", "line 44: alarms.1.texts.0x7500: invalid type: integer `5`"),
        (52, "product = 0xFFFF_FFFF\ntexts", "product = -5\ntexts", "line 52: alarms.3.product: -5 is out of range"),
    ] {
        assert!(WHOLE.contains(replaced), "line {line}: {replaced}");
        let said_now = error(&WHOLE.replacen(replaced, by, 1));
        // The first `product` in the file belongs to slave 1, and has to be changed too.
        let said_now = if line == 52 { error(&WHOLE.replace(replaced, by)) } else { said_now };
        assert!(said_now.contains(said), "{replaced} -> {by}\n  {said_now}\n  {said}");
        assert!(said_now.starts_with("m.toml, line ") && said_now.contains("; "), "{said_now}");
    }
}

#[test]
fn what_is_no_machine_is_refused() {
    assert_eq!(
        error("format = 1\n"),
        "m.toml, line 1: slaves: the file names no slave and no axis; add an axis, e.g. [axes] X = { slave = 1 }"
    );
    assert!(error("format = 1\nformat = 1\n").starts_with("m.toml, line 2: "), "{}", error("format = 1\nformat = 1\n"));
    assert!(error("= 1").starts_with("m.toml, line 1: ") && error("= 1").ends_with("see https://toml.io"));
    // A file of another version may have fields that are not known yet.
    assert!(error("format = 9\nnew = 1\n").ends_with("take a newer ecmsk"));
    assert!(error("").starts_with("m.toml, line 1: format: it is missing"));
    let counts = error("format = 1\n[axes]\nX = { slave = 1, min = 0.5 }\n");
    assert!(counts.contains("line 3: axes.X.min: 0.5 is no whole number of counts; write one"), "{counts}");
    let missing = MachineFile::load(Path::new("/nonexistent/m.toml")).unwrap_err().to_string();
    assert!(missing.ends_with("name another file, or make one with `ecmsk machine new LINK`"), "{missing}");
}

/// Whatever the text is, the parser returns.
#[test]
fn a_file_with_a_part_missing_or_twice_never_panics() {
    for at in (0..WHOLE.len()).filter(|at| WHOLE.is_char_boundary(*at)) {
        let _ = parse(&WHOLE[..at]);
        let _ = parse(&format!("{}{}", &WHOLE[..at], &WHOLE[(at + 3).min(WHOLE.len())..]));
    }
    for line in WHOLE.lines() {
        let _ = parse(&WHOLE.replacen(line, &format!("{line}\n{line}"), 1));
    }
}

/// The examples in `docs/MACHINE.md` and `docs/WEB.md` are valid machine files.
#[test]
fn the_page_shows_a_machine_file() {
    let example = |page: &'static str| {
        page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).expect("an example")
    };
    let machine = parse(example(include_str!("../../docs/MACHINE.md"))).unwrap();
    assert_eq!(
        (machine.slaves.len(), machine.axes.len(), machine.alarm_text(1, 0x7305)),
        (3, 2, Some("encoder cable"))
    );
    let drawn = parse(example(include_str!("../../docs/WEB.md"))).unwrap();
    assert_eq!(drawn.picture.gantries, [Gantry { sides: [1, 2], bridge: Some(3) }]);
}

/// A limit that rounding to the nearest count would move noticeably is refused: the scale is inverted, or the limit is
/// shorter than a count. With a fine scale, a limit between two counts is rounded.
#[test]
fn a_limit_is_where_it_is_written() {
    let parse =
        |axis: &str| MachineFile::parse("m.toml", &format!("format = 1\n[axes]\nX = {{ slave = 1, {axis} }}\n"));
    for (axis, error) in [
        ("unit = \"mm\", per = 1000, max = 250", "axes.X.max: 250 mm would be 0 mm, since a count is 1000 mm"),
        (
            "unit = \"mm\", per = 1000, min = -10, max = 0.5",
            "axes.X.min: -10 mm would be 0 mm, since a count is 1000 mm",
        ),
        ("unit = \"mm\", per = -1000, max = 1500", "axes.X.max: 1500 mm would be 2000 mm, since a count is 1000 mm"),
    ] {
        let said = parse(axis).unwrap_err().to_string();
        assert_eq!(
            said,
            format!("m.toml, line 3: {error}; correct per, the units of one count, or the limit"),
            "{axis}"
        );
    }
    for (axis, max) in [
        ("unit = \"deg\", per = \"360/131072\", max = 45.1", 16_420),
        ("unit = \"mm\", per = 1000, max = 250000", 250),
        ("unit = \"mm\", per = 1000, min = 0, max = 2000", 2),
        ("max = 1", 1),
    ] {
        assert_eq!(parse(axis).unwrap().axes[0].limits.max, max, "{axis}");
    }
}
