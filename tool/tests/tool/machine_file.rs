//! The machine file: with the same file a program runs on every board in units; its limits are kept; `ecmsk machine` makes and
//! checks it.

use std::path::{Path, PathBuf};

use tempfile::TempDir;

use crate::common::board::RecordedTraffic;
use crate::common::{Ran, ecmsk, json_lines};

pub const MACHINE: &str = r#"
format = 1
link = "sim:?clock=virtual"

[axes]
X = { slave = 1, unit = "mm", per = 0.001, min = -10, max = 250, max_velocity = 100, homing = { method = 35, offset = 2.5 } }
turn = { slave = 2, unit = "deg", per = "-360/131072", min = -90, max = 90 }

[slaves.3]
kind = "io"

[[alarms]]
texts = { 0x7500 = "the red cable" }
"#;

/// A folder with a machine file in it, in which the tool is started.
pub struct Folder(pub TempDir);

impl Folder {
    pub fn new(machine: &str) -> Self {
        let folder = Self(tempfile::tempdir().expect("a folder"));
        std::fs::write(folder.path("machine.toml"), machine).expect("a file");
        folder
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs the tool in this folder.
    pub fn run(&self, words: &[&str]) -> Ran {
        ecmsk(words).current_dir(self.0.path()).output().expect("the tool starts").into()
    }

    pub fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).expect("a file");
    }
}

pub const SAID: &str = "note: machine file machine.toml in this folder\n";

const PROGRAM: &str = "\
state op
servo on X,turn
home X
move X=12.5 turn=-45deg --velocity 40
move X=-1000counts --relative
move 1=5000
expect position X=5 turn=-45 --within 0.003
expect position 1=5000 2=16384 --within 2
servo off all
";

/// The same file and program give the same positions on a board, behind a chip, and in the recording of either.
#[test]
fn one_file_runs_one_program_on_every_board_in_units() {
    let folder = Folder::new(MACHINE);
    folder.write("program", PROGRAM);
    let printed = |link: &[&str], record: &str| {
        let words = [&["run", "program", "--record", record], link].concat();
        let ran = folder.run(&words);
        assert_eq!(ran.code, Some(0), "{link:?} {ran:?}");
        assert!(ran.err.starts_with(SAID) && ran.err.matches(SAID).count() == 1, "{}", ran.err);
        assert!(ran.err.contains("configured: 1 drive, 2 drive, 3 io, cycle 1000 us"), "{}", ran.err);
        ran.out
    };
    let board = printed(&[], "board.pcapng");
    assert_eq!(
        board,
        "OP\n\
         axis X: on, Operation enabled (0x1637)\n\
         axis turn: on, Operation enabled (0x1637)\n\
         axis X: home found (method 35), at 2.5 mm (2500 counts)\n\
         axis X: at 12.5 mm (12500 counts)\n\
         axis turn: at -45 deg (16384 counts)\n\
         axis X: at 11.5 mm (11500 counts)\n\
         axis X: at 5 mm (5000 counts)\n\
         axis X: off, Switched on (0x0233)\n\
         axis turn: off, Switched on (0x0233)\n"
    );
    assert_eq!(printed(&["--link", "xf-sim:?clock=virtual"], "chip.pcapng"), board);
    let (server, _) = support::tcp::serve("sim:?slaves=drive*2,io&clock=virtual");
    assert_eq!(printed(&["--link", &support::tcp::uri(&server, "")], "served.pcapng"), board);
    for record in ["board.pcapng", "chip.pcapng", "served.pcapng"] {
        let found = folder.run(&["find", "position(X) > 12mm", record]);
        assert_eq!((found.code, found.out.lines().count()), (Some(0), 1), "{found:?}");
        let summary = folder.run(&["summary", record]);
        assert!(summary.out.starts_with("axis X: ") && summary.out.contains(" mm ("), "{summary:?}");
        assert!(summary.out.contains("\naxis turn: ") && summary.out.contains(" deg/s ("), "{summary:?}");
        let failed = folder.run(&["summary", record, "--fail-on", "velocity>1mm/s"]);
        assert_eq!(failed.code, Some(1), "{failed:?}");
        assert!(
            failed.err.contains("failed: axis X: velocity ") && failed.err.contains("above 1.000 mm/s"),
            "{failed:?}"
        );
        assert_eq!(folder.run(&["summary", record, "--fail-on", "following-error>5mm"]).code, Some(0));
        let monitor = folder.run(&["monitor", "--recording", record, "--json", "--interval", "100s"]);
        let json = &json_lines(&monitor.out)[0];
        assert_eq!(json["axes"][0]["name"], "X", "{json}");
        assert_eq!(
            (&json["axes"][0]["unit"], json["axes"][0]["position"].as_f64()),
            (&"mm".into(), Some(5.0)),
            "{json}"
        );
        let table = folder.run(&["monitor", "--recording", record, "--once"]);
        assert!(table.out.contains("5.000 mm") && table.out.contains(" turn "), "{table:?}");
        let plot = folder.run(&["plot", record, "--axes", "X,turn", "--xy", "X,turn"]);
        assert_eq!(plot.code, Some(0), "{plot:?}");
        let svg = std::fs::read_to_string(folder.path(record).with_extension("svg")).expect("a plot");
        for text in ["Axis X: position (mm)", "Axis turn: position (deg)", "position of axis X (mm)"] {
            assert!(svg.contains(text), "{text}");
        }
    }
}

/// A target beyond a limit, or a speed beyond one, is refused before anything is sent, by name and by number; home may not
/// get a place beyond a limit either.
#[test]
fn limits_refuse_before_anything_moves() {
    let folder = Folder::new(MACHINE);
    for (words, why) in [
        (
            &["move", "X=250.001"] as &[&str],
            "move: axis X would be at 250.001 mm, beyond its limit, max = 250 mm; name another target, or correct max in \
             machine.toml",
        ),
        (&["move", "1=-10001"], "axis X would be at -10.001 mm, beyond its limit, min = -10 mm; "),
        (&["move", "turn=90.01"], "beyond its limit, max = 90 deg; "),
        (&["move", "2=32769"], "beyond its limit, min = -90 deg; "),
        (&["move", "X=300", "--relative"], "axis X would be at 300 mm, beyond its limit, max = 250 mm"),
        (
            &["move", "X=1", "--velocity", "100.1"],
            "--velocity is beyond the limit of axis X, max_velocity = 100 mm/s; ",
        ),
        (&["move", "X=1", "2=5", "--velocity", "1"], "a speed would have two units; name all axes alike"),
        (&["home", "X", "--offset", "251"], "home: axis X would be at 251 mm, beyond its limit, max = 250 mm"),
        (&["move", "Z=1"], "move: machine.toml has no axis `Z`; it has X, turn"),
        (&["move", "X=1deg"], "1deg is written for axis X, which is in mm; write the number in the unit of the axis"),
        (&["servo", "on", "X,Z"], "has no axis `Z`"),
    ] {
        let record = folder.path("refused.pcapng");
        let _ = std::fs::remove_file(&record);
        let ran = folder.run(&[words, &["--up", "--record", "refused.pcapng"]].concat());
        assert_eq!((ran.code, ran.out.as_str()), (Some(1), ""), "{words:?} {ran:?}");
        assert!(ran.err.contains(why), "{words:?}\n{}\n{why}", ran.err);
        if Path::exists(&record) {
            let traffic = RecordedTraffic::read(&record);
            let still = [1, 2].map(|slave| traffic.targets(slave)).concat();
            assert!(still.iter().all(|target| *target == 0), "{words:?} {still:?}");
        }
    }
    // A target at the limit itself is accepted, in the unit of the axis and in counts.
    let ran = folder.run(&["move", "X=250", "2=-32768", "--up", "--json"]);
    let lines: Vec<_> = json_lines(&ran.out).into_iter().filter(|line| line["target_counts"].is_i64()).collect();
    assert_eq!(
        (&lines[0]["name"], &lines[0]["unit"], &lines[0]["position"]),
        (&"X".into(), &"mm".into(), &250.0.into())
    );
    assert_eq!((&lines[1]["name"], &lines[1]["position_counts"]), (&"turn".into(), &(-32_768).into()));
}

/// The machine file of the working directory is used, with a note; `--machine` names another one; with `none` there is none,
/// and names of axes mean nothing.
#[test]
fn the_file_of_the_folder_is_used_unless_another_one_is_named() {
    let folder = Folder::new(MACHINE);
    folder.write("other.toml", "format = 1\nlink = \"sim:?clock=virtual\"\n[axes]\nA = { slave = 1 }\n");
    let ran = folder.run(&["move", "A=500", "--up", "--machine", "other.toml"]);
    assert_eq!((ran.code, ran.out.as_str()), (Some(0), "axis A: at 500\n"), "{ran:?}");
    assert!(!ran.err.contains(SAID), "{ran:?}");
    let link = "sim:?slaves=drive&clock=virtual";
    let ran = folder.run(&["move", "1=500", "--up", "--machine", "none", "--link", link]);
    assert_eq!((ran.code, ran.out.as_str()), (Some(0), "axis 1: at 500\n"), "{ran:?}");
    let ran = folder.run(&["move", "X=5", "--machine", "none", "--link", link]);
    ran.expect_failure(1, &["axis `X` is no number from 1 to 40, and there is no machine file"], "say --machine FILE");
    let ran = folder.run(&["move", "1=500", "--machine", "nothing.toml", "--link", link]);
    ran.expect_failure(1, &["cannot read the machine file nothing.toml: "], "make one with `ecmsk machine new LINK`");
    // Without a machine file a name of an axis is refused also if the other axis is given by its number.
    let ran = folder.run(&["move", "X=5", "1=5", "--machine", "none", "--link", link]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    folder.write("machine.toml", "format = 1\n[axes]\nX = { slave = 1, per = 0 }\n");
    for verb in [&["move", "1=500", "--link", link] as &[&str], &["info", "--link", link]] {
        folder.run(verb).expect_failure(1, &["machine.toml, line 3: axes.X.per: 0 is no scale"], "write the units");
    }
}

/// `machine new` makes a machine file from a network. `machine check` finds it equal to that network, and says where another
/// network differs.
#[test]
fn a_new_file_is_equal_to_its_network() {
    let folder = Folder::new(MACHINE);
    let link = "sim:?slaves=drive,io,step";
    let ran = folder.run(&["machine", "new", link]);
    ran.expect_failure(1, &["machine.toml is there already"], "replace it with --overwrite");
    assert_eq!(std::fs::read_to_string(folder.path("machine.toml")).expect("it is there"), MACHINE);
    let made = folder.run(&["machine", "new", link, "--overwrite"]).expect_quiet();
    assert_eq!(made, "machine.toml: 3 slaves; name its axes and set their units\n");
    assert_eq!(
        folder.run(&["machine", "check"]).expect_quiet(),
        "machine.toml: nothing is wrong; slaves: 3, axes: 2\n"
    );
    let same = folder.run(&["machine", "check", "--link"]).expect_quiet();
    assert_eq!(same, "machine.toml: nothing is wrong; slaves: 3, as they are there\n");
    let text = std::fs::read_to_string(folder.path("machine.toml")).expect("it is there");
    assert!(text.contains("\naxis1 = { slave = 1 }\naxis3 = { slave = 3 }\n"), "{text}");
    let ran = folder.run(&["machine", "check", "machine.toml", "--link", "sim:?slaves=drive,drive", "--json"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let lines = json_lines(&ran.out);
    let found = |slave: u64, difference: &str| {
        lines.iter().any(|line| line["slave"] == slave && line["difference"] == difference)
    };
    assert!(found(2, "product") && found(2, "kind") && found(3, "missing") && !found(1, "product"), "{}", ran.out);
    let ran = folder.run(&["machine", "check", "--link", "sim:?slaves=drive,io,step,io"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.out.starts_with("slave 4: it is there, and not in the file: vendor 0x"), "{ran:?}");
    let ran = folder.run(&["machine", "check", "nothing.toml"]);
    ran.expect_failure(2, &["cannot read the machine file nothing.toml"], "machine new LINK");
    // Slaves that a simulated board gets from the machine file are the devices that the file expects.
    let text_of_drive =
        "format = 1\nlink = \"sim:\"\n[slaves.1]\nkind = \"drive\"\nvendor = 1634\nproduct = 5\nrevision = 0x10\n";
    folder.write("drive.toml", text_of_drive);
    let same = folder.run(&["machine", "check", "drive.toml", "--link"]).expect_quiet();
    assert_eq!(same, "drive.toml: nothing is wrong; slaves: 1, as they are there\n");
    // A board does not list its slaves, so `machine new` asks them one after the other; the file is the same.
    let shown = folder.run(&["machine", "new", link, "--output", "-"]);
    assert_eq!(shown.expect_quiet(), text);
}

/// Errors and notes of a move have the name, the unit and the words for alarms of the machine file, as its results do.
#[test]
fn errors_of_a_move_have_names_units_and_words() {
    let folder = Folder::new(MACHINE);
    let link = "sim:?slaves=drive:limits@-1000..1000,drive,io&clock=virtual";
    let ran = folder.run(&["move", "X=5", "turn=10", "--velocity", "20", "--up", "--link", link]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for words in [
        "note: switched on: axes X, turn\n",
        "note: axis X pushed, ",
        " counts) from its target: its target is now its actual position, 1.0",
        "note: axis turn is at ",
        "error: move: axis X stands at 1.0",
        " counts): its drive holds it back (internal limit active",
    ] {
        assert!(ran.err.contains(words), "`{words}` is missing: {ran:?}");
    }
    let ran = folder.run(&["move", "X=1.5", "--up", "--guard", "1000", "--link", link]);
    assert!(
        ran.err.contains("axis X is at 0 mm (0 counts), and 1.5 mm (1500 counts) is 1.5 mm (1500 counts) away"),
        "{ran:?}"
    );
    folder.write("alarm", "at 2s alarm 1 0x7500\n");
    let link = "sim:?slaves=drive*2,io&clock=virtual&script=alarm";
    let ran = folder.run(&["move", "X=200", "--velocity", "20", "--up", "--link", link]);
    let says = "error: axis X has alarm 0x7500: the red cable; remove the cause";
    assert!(ran.code == Some(1) && ran.err.contains(says), "{ran:?}");
}

/// An axis with one limit alone is valid, and hardly meant: `machine check` advises to add the other one, named as the file
/// has it.
#[test]
fn a_check_advises_on_an_axis_with_one_limit() {
    let folder = Folder::new(MACHINE);
    folder.write(
        "machine.toml",
        "format = 1\n[axes]\nA = { slave = 1, unit = \"mm\", per = 0.001, max = 250 }\n\
         B = { slave = 2, unit = \"mm\", per = -0.001, max = 250 }\nC = { slave = 3, min = 0 }\n\
         D = { slave = 4, min = 0, max = 5 }\nE = { slave = 5 }\n",
    );
    let ran = folder.run(&["machine", "check"]);
    assert_eq!((ran.code, &*ran.out), (Some(0), "machine.toml: nothing is wrong; slaves: 5, axes: 5\n"), "{ran:?}");
    let lacks = |axis, has, lacks| {
        format!("note: axis {axis} has {has} and no {lacks}, so that nothing limits it there; add {lacks}\n")
    };
    assert_eq!(ran.err, lacks("A", "max", "min") + &lacks("B", "max", "min") + &lacks("C", "min", "max"));
}

/// `machine schema` prints a schema that has all fields of a machine file, with their meanings.
#[test]
fn the_schema_has_the_fields_of_the_file() {
    let schema = Folder::new(MACHINE).run(&["machine", "schema"]);
    let schema: serde_json::Value = serde_json::from_str(&schema.expect_quiet()).expect("JSON");
    assert_eq!(schema["required"], serde_json::json!(["format"]));
    for field in ["format", "link", "cycle_us", "slaves", "axes", "inputs", "outputs", "alarms", "picture"] {
        assert!(schema["properties"][field]["description"].is_string(), "{field}");
    }
    let axis = &schema["$defs"]["AxisFields"];
    assert_eq!(axis["required"], serde_json::json!(["slave"]));
    assert_eq!(axis["additionalProperties"], false);
    let kinds = &schema["$defs"]["SlaveFields"]["properties"]["kind"]["enum"];
    assert_eq!(kinds, &serde_json::json!(["drive", "io", "step", "dp3cl", "hsp", "hsp2", "none"]));
}

#[cfg(unix)]
mod needs_root {
    use std::os::unix::fs::chown;

    use super::{Folder, MACHINE};
    use crate::common::exec::ExecFolder;
    use crate::common::{Ran, ecmsk};

    const NOBODY: u32 = 65534;
    const LINK: [&str; 2] = ["--link", "sim:?slaves=drive*2,io&clock=virtual"];

    /// docs/MACHINE.md: a verb that moves axes does not pass over the limits of another user's file, also not under `sudo`
    /// over those of the caller. The others pass over the file.
    #[test]
    fn another_users_limits_are_not_passed_over() {
        let folder = Folder::new(MACHINE);
        chown(folder.path("machine.toml"), Some(NOBODY), None).expect("tests in needs_root run as root");
        folder.write("program", "state op\nservo on 1\nmove 1=5\n");
        let run = |words: &[&str]| {
            let mut command = ecmsk([words, &LINK].concat());
            Ran::from(command.current_dir(folder.0.path()).env("SUDO_UID", "65534").output().expect("the tool starts"))
        };
        for words in [&["move", "1=5", "--up"] as &[_], &["home", "1", "--up"], &["run", "program"], &["shell"]] {
            run(words).expect_failure(
                1,
                &["moving axes: machine.toml in this folder is another user's", "say --machine machine.toml to use it"],
                "or --machine none to move without its limits",
            );
        }
        let named = run(&["move", "1=250001", "--up", "--machine", "machine.toml"]);
        assert!(named.code == Some(1) && named.err.contains("beyond its limit, max = 250 mm"), "{named:?}");
        let none = run(&["move", "1=250001", "--velocity", "200000", "--up", "--machine", "none"]);
        assert_eq!(none.out, "axis 1: at 250001\n", "{none:?}");
        for words in [&["info"] as &[_], &["servo", "on", "1", "--up"], &["servo", "off", "1", "--up"]] {
            let ran = run(words);
            let passes = ran.err.contains("machine.toml is another user's and is passed over; name it with --machine");
            assert!(ran.code == Some(0) && passes, "{ran:?}");
        }
    }

    /// A program under `exec` may move axes, and is not started without the limits of another user's file either.
    #[test]
    fn exec_passes_over_no_limits_of_another_user() {
        let place = ExecFolder::new();
        let file = place.path().join("machine.toml");
        std::fs::write(&file, MACHINE).expect("a file");
        chown(&file, Some(NOBODY), None).expect("tests in needs_root run as root");
        let ran = place.run(&["--link", LINK[1]], "echo started");
        assert_eq!((ran.code, ran.out.as_str()), (Some(125), ""), "{ran:?}");
        for word in
            ["machine.toml in this folder is another user's", "say --machine machine.toml to use it, or --machine none"]
        {
            assert!(ran.err.contains(word), "{ran:?}");
        }
        for machine in ["machine.toml", "none"] {
            let ran = place.run(&["--link", LINK[1], "--machine", machine], "echo started");
            assert_eq!((ran.code, ran.out.as_str()), (Some(0), "started\n"), "{ran:?}");
        }
    }
}

/// Inputs and outputs have their names in `io` and `expect`. What a board does not tell is asked for.
#[test]
fn inputs_and_outputs_have_names() {
    let lines = "[inputs]\ndoor = { slave = 3, bit = 0 }\nknob = { slave = 3, bit = 2 }\n\
                 [outputs]\nlamp = { slave = 3, bit = 0 }\nhorn = { slave = 3, bit = 2 }\n";
    let folder = Folder::new(&format!("{MACHINE}{lines}"));
    let run = |words: &[&str]| folder.run(words);
    // The outputs of a simulated IO slave are wired to its inputs.
    folder.write(
        "program",
        "state op\nio lamp=on horn=off\nexpect inputs door=on\nio Door knob\nio horn=on\nexpect inputs 3=0x0005\n\
         io lamp=off --others-off\nexpect inputs 3=0\nexpect inputs knob=off\nio 3 --set 0x5\nio lamp=0\nexpect inputs 3=4\n",
    );
    let ran = run(&["run", "program"]);
    assert_eq!(
        (ran.code, ran.out.as_str()),
        (
            Some(0),
            "OP\nlamp: on (slave 3, output 0)\nhorn: off (slave 3, output 2)\ndoor: on (slave 3, input 0)\n\
             knob: off (slave 3, input 2)\nhorn: on (slave 3, output 2)\nlamp: off (slave 3, output 0)\n\
             slave 3: outputs 0x0005\nlamp: off (slave 3, output 0)\n"
        ),
        "{ran:?}"
    );
    let json = run(&["io", "lamp=on", "horn=on", "--up", "--json"]);
    assert_eq!(
        json_lines(&json.out)[1],
        serde_json::json!({"verb": "io", "name": "horn", "slave": 3, "output": 2, "on": true}),
        "{json:?}"
    );
    for (words, why) in [
        (&["io", "lamp=on", "--up"][..], "slave 3 has others: horn; give those too, or say --others-off"),
        (&["io", "lamp"], "`lamp` is an output, and a board does not tell which outputs are on; set it: io lamp=on"),
        (&["io", "door=on"], "`door` is an input, which cannot be set; read it: io door"),
        (&["io", "gate"], "machine.toml has no input `gate`; it has door, knob"),
        (&["io", "gate=on"], "machine.toml has no output `gate`; it has horn, lamp"),
        (&["io", "door", "3"], "use a command for each"),
        (&["io", "door", "--machine", "none"], "there is no machine file; name its slave, or say --machine FILE"),
    ] {
        let ran = run(words);
        assert!(ran.code == Some(1) && ran.err.contains(why), "{words:?}: {ran:?}");
    }
    folder.write("program", "state op\nio lamp=off horn=off\nexpect inputs door=on\n");
    let ran = run(&["run", "program"]);
    assert!(ran.code != Some(0) && ran.err.contains("input door is off, not on"), "{ran:?}");
}

/// A recording in either format carries the machine file. Verbs that read it elsewhere have its names and units, and say whose
/// they are; a copy carries it, too.
#[test]
fn a_recording_carries_its_machine_file() {
    let folder = Folder::new(MACHINE);
    folder.write("program", "state op\nservo on X\nhome X\nmove X=12.5\n");
    for name in ["run.pcapng", "run.ecmrec", "without.pcapng"] {
        let machine: &[&str] =
            if name.starts_with("run") { &[] } else { &["--machine", "none", "--slaves", "drive*2,io"] };
        let link = ["--link", "sim:?slaves=drive*2,io&clock=virtual"];
        folder.write("plain", "state op\nservo on 1\nmove 1=12500\n");
        let program = if machine.is_empty() { "program" } else { "plain" };
        let ran = folder.run(&[&["run", program, "--record", name][..], machine, &link].concat());
        assert_eq!(ran.code, Some(0), "{ran:?}");
    }
    let elsewhere = Folder(tempfile::tempdir().expect("a folder"));
    let export = |from: &str, to: &str| {
        let ran = folder.run(&["recording", "export", from, to]);
        assert_eq!(ran.code, Some(0), "{ran:?}");
    };
    export("run.pcapng", "copy.ecmrec");
    export("run.ecmrec", "copy.pcapng");
    let path = |name: &str| folder.path(name).display().to_string();
    let said = "note: machine file machine.toml of the recording\n";
    for name in ["run.pcapng", "run.ecmrec", "copy.ecmrec", "copy.pcapng"] {
        let summary = elsewhere.run(&["summary", &path(name)]);
        assert!(summary.err.contains(said) && summary.out.starts_with("axis X: "), "{name}: {summary:?}");
        let found = elsewhere.run(&["find", "position(X) > 12mm", &path(name)]);
        assert_eq!((found.code, found.out.lines().count()), (Some(0), 1), "{name}: {found:?}");
        let svg = elsewhere.path("a.svg").display().to_string();
        let plot = elsewhere.run(&["plot", &path(name), "--axes", "X", "-o", &svg]);
        assert!(plot.code == Some(0) && plot.err.contains(said), "{name}: {plot:?}");
        let info = elsewhere.run(&["recording", "info", &path(name)]);
        assert!(info.out.contains("\nmachine file: machine.toml, --machine-file prints it\n"), "{name}: {info:?}");
        let text = elsewhere.run(&["recording", "info", &path(name), "--machine-file"]);
        assert_eq!(text.out, MACHINE, "{name}");
        let none = elsewhere.run(&["summary", &path(name), "--machine", "none"]);
        assert!(none.out.starts_with("axis 1: ") && !none.err.contains(said), "{name}: {none:?}");
    }
    let without = elsewhere.run(&["recording", "info", &path("without.pcapng"), "--json"]);
    assert_eq!(without.json()["machine"], serde_json::Value::Null);
    let without = elsewhere.run(&["recording", "info", &path("without.pcapng"), "--machine-file"]);
    assert!(without.code == Some(1) && without.err.contains("carries no machine file"), "{without:?}");
    assert!(elsewhere.run(&["summary", &path("without.pcapng")]).out.starts_with("axis 1: "));
    // In a folder with a file, that is for recordings that carry none.
    let here = folder.run(&["summary", "without.pcapng"]);
    assert!(here.err.starts_with(SAID) && here.out.starts_with("axis X: "), "{here:?}");
}

/// A program under `exec` gets the machine file by its link: the slaves of a simulated board that has none, and the axes.
#[cfg(unix)]
#[test]
fn exec_gives_the_program_the_machine_file() {
    let place = crate::common::exec::ExecFolder::new();
    std::fs::write(place.path().join("machine.toml"), MACHINE).expect("a file");
    let shown = |options: &[&str]| place.run(options, "echo \"$ECMSK_LINK\"");
    let file = place.path().join("machine.toml").canonicalize().expect("it is there").display().to_string();
    let ran = shown(&[]);
    assert!(ran.err.contains(SAID), "{ran:?}");
    assert_eq!(ran.out, format!("sim:?machine={file}&clock=virtual\n"));
    let ran = shown(&["--link", "sim:?slaves=drive"]);
    assert_eq!(ran.out, format!("sim:?slaves=drive&axes={file}\n"));
    let ran = shown(&["--link", "sim:?slaves=drive", "--machine", "none"]);
    assert_eq!((ran.out.as_str(), ran.err.as_str()), ("sim:?slaves=drive\n", ""));
    let ran = shown(&["--machine", "missing.toml"]);
    assert!(ran.code == Some(125) && ran.err.contains("missing.toml"), "{ran:?}");
}

/// `stop` and `servo off` do not fail because of a machine file that nobody has named: they pass over one that cannot be used, and
/// find the board by `--link`, or by the link in the file as far as that can be read. Other verbs do not begin.
#[cfg(unix)]
#[test]
fn a_wrong_machine_file_keeps_nothing_from_being_stopped() {
    let (server, _) = support::tcp::serve("sim:?slaves=drive*2&clock=virtual");
    let link = support::tcp::uri(&server, "");
    let half = format!("format = 1\nlink = \"{link}\"\n[axes]\nX = {{ slave = 1, unit = \"mm\" }}\n");
    let folder = Folder::new(&half);
    let passed = "warning: the machine file is passed over: machine.toml, line 4: axes.X.per: it is missing";
    let words = ["servo", "on", "1,2", "--up", "--link", &link, "--machine", "none"];
    assert_eq!(folder.run(&words).code, Some(0));
    for (axis, given) in [("1", &["--link", &link] as &[&str]), ("2", &[])] {
        let off = folder.run(&[&["servo", "off", axis], given].concat());
        assert!(off.err.starts_with(passed) && off.err.matches(passed).count() == 1, "{off:?}");
        assert_eq!((off.code, off.out), (Some(0), format!("axis {axis}: off, Switched on (0x0233)\n")), "{}", off.err);
        let stop = folder.run(&[&["stop"], given].concat());
        assert!(stop.code == Some(0) && stop.err.starts_with(passed), "{stop:?}");
        assert_eq!(stop.out, "axes stand still; no program was writing\n");
    }
    folder.run(&["move", "1=5", "--link", &link]).expect_failure(1, &["axes.X.per: it is missing"], "");
    folder.run(&["stop", "--machine", "machine.toml", "--link", &link]).expect_failure(
        1,
        &["axes.X.per: it is missing"],
        "",
    );
    // Without a readable link it is not known which board the file means. Another one is not stopped in its place.
    folder.write("machine.toml", "format = 1\nlink = \n");
    let next = "or name the board with --link";
    for verb in [&["stop"] as &[&str], &["servo", "off", "1"]] {
        let ran = folder.run(verb);
        let why = "error: finding the board: the machine file may name it, and cannot be used: machine.toml, line 2";
        assert!(ran.code == Some(1) && ran.err.contains(why) && ran.err.contains(next), "{ran:?}");
        assert_eq!(folder.run(&[verb, &["--link", &link]].concat()).code, Some(0));
    }
    std::fs::remove_file(folder.path("machine.toml")).expect("it is there");
    let made = std::process::Command::new("mkfifo").arg(folder.path("machine.toml")).status().expect("it starts");
    assert!(made.success());
    assert_eq!(folder.run(&["stop", "--link", &link]).code, Some(0));
}
