//! `ecmsk summary`: the extremes of axes, and what makes a run a failed one.

use ecmsk::ecm::{Axis, Close, Config, Ecm, Slave};
use ecmsk::sk::MasterState;

use crate::common::board::{file, text};
use crate::common::{json_lines, run};

/// The cycle in which the target of axis 1 jumps.
const JUMP: i32 = 3_000;

/// Records ten seconds in virtual time to the file `name`.pcapng; returns its path. Both axes turn with 10 counts in each
/// cycle. In the cycle [`JUMP`] the target of axis 1 steps by 3,010 counts, and at 6 s a script blocks axis 2 for 20 ms.
fn recorded(name: &str) -> String {
    let script = text(&format!("{name}.script"), "at 6s jam 2 for 20ms\n");
    let path = file(&format!("{name}.pcapng"));
    let _ = std::fs::remove_file(&path);
    let path = path.display().to_string();
    let link = format!("sim:?slaves=drive*2&clock=virtual&script={script}&record={path}");
    let ecm = Ecm::open(&link).expect("a board");
    ecm.configure(&Config { slaves: vec![Slave::Drive(Axis::CSP); 2], ..Config::default() }).expect("it is configured");
    ecm.set_state(MasterState::Op).expect("OP");
    ecm.servo_on(&[1, 2]).expect("they are on");
    let mut stream = ecm.stream(8).expect("a stream");
    let mut target = 0;
    for cycle in 0..10_000 {
        target += if cycle == JUMP { 3_010 } else { 10 };
        stream
            .csp(1, target)
            .and_then(|()| stream.csp(2, 10 * cycle))
            .and_then(|()| stream.step())
            .expect("it is sent");
    }
    stream.finish().expect("it stands");
    ecm.close(Close::ServoOff).expect("it is closed");
    path
}

/// A jam of 20 ms and a step of 3,000 counts are found, with their axes and within 5 ms of their times.
#[test]
fn a_jam_and_a_step_are_found() {
    let path = recorded("summary_found");
    let said = run(["summary", &path]).expect_quiet();
    let ran = run(["summary", "--json", &path]);
    let json = &json_lines(&ran.out)[0];
    let [one, two] = [&json["axes"][0], &json["axes"][1]];
    assert_eq!(one["target_step"]["value"], 3_010, "{said}{json}");
    // The drive follows the jump at once. So the time of its largest velocity is nearly that of the largest step of the target
    // in force.
    let at = |quantity: &str| one[quantity]["at_s"].as_f64().expect("a time");
    assert!(at("target_step") > 3.0 && (at("velocity") - at("target_step")).abs() < 0.005, "{json}");
    assert!(
        said.lines().any(|line| line.starts_with("axis 1: ") && line.contains("target step up to 3010 counts (")),
        "{said}"
    );
    let at = two["following_error"]["at_s"].as_f64().expect("a time");
    assert!((at - 6.020).abs() < 0.005, "{json}");
    assert!(two["following_error"]["value"].as_u64() > Some(150), "{json}");
    assert_eq!(two["target_step"]["value"], 10);
}

/// With `--fail-on` standard error names the limit that was exceeded, and the exit code is 1.
#[test]
fn a_limit_makes_a_run_fail() {
    let path = recorded("summary_limits");
    let with = |reasons: &str| run(["summary", "--fail-on", reasons, &path]);
    let ran = with("target-step>2000,following-error>100000,alarm");
    assert_eq!((ran.code, ran.err.lines().count()), (Some(1), 1), "{ran:?}");
    assert!(
        ran.err.starts_with("failed: axis 1: target step 3010 counts at ")
            && ran.err.ends_with(", above 2000 counts\n")
    );
    assert_eq!(with("target-step>3010,gap,state,torque>300").code, Some(0));
    let ran = with("jerk>1");
    assert!(ran.code == Some(2) && ran.err.contains("allowed: any, alarm"), "{ran:?}");
}

/// The summary has the extremes of all axes, up to the last one of 40.
#[test]
fn every_axis_has_its_extremes() {
    let path = file("summary_forty.pcapng");
    let _ = std::fs::remove_file(&path);
    let path = path.display().to_string();
    let ecm = Ecm::open(&format!("sim:?slaves=drive*40&clock=virtual&record={path}")).expect("a board");
    ecm.configure(&Config::drives(40)).expect("it is configured");
    ecm.set_state(MasterState::Op).expect("OP");
    ecm.servo_on(&[40]).expect("it is on");
    let mut stream = ecm.stream(8).expect("a stream");
    for cycle in 0..200 {
        stream.csp(40, 7 * cycle).and_then(|()| stream.step().map(drop)).expect("it is sent");
    }
    stream.finish().expect("it stands");
    ecm.close(Close::ServoOff).expect("it is closed");
    let said = run(["summary", &path]).expect_quiet();
    let of_last = said.lines().find(|line| line.starts_with("axis 40: ")).unwrap_or_else(|| panic!("{said}"));
    assert!(of_last.contains("following error up to ") && of_last.contains("target step up to 7 counts"), "{said}");
}
