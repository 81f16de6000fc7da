//! `ecmsk params` of drives behind a board that is served over TCP: backup, change, diff and restore give the same parameters.

use crate::common::board::file;
use crate::common::run;
use support::tcp::{serve, uri};

/// The parameters of a stepper behind a served board are saved, changed, compared and restored. Its objects are known from a
/// network with another stepper.
#[test]
fn a_drive_behind_a_served_board_is_put_back() {
    let objects = file("tcp_params_objects").display().to_string();
    let ran = run(["params", "backup", "1", "--link", "sim:?slaves=dp3cl", "--output", &objects, "--overwrite"]);
    assert_eq!(ran.code, Some(0), "{ran:?}");

    let (server, _) = serve("sim:?slaves=dp3cl");
    let link = uri(&server, "");
    let kept = file("tcp_params_kept").display().to_string();
    let backup = |to: &str| {
        run(["params", "backup", "1", "--link", &link, "--objects", &objects, "--output", to, "--overwrite"])
    };
    let ran = backup(&kept);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let diff = || run(["params", "diff", &kept, "1", "--link", &link]);
    assert_eq!(diff().code, Some(0), "{:?}", diff());

    let ran = run(["sdo", "write", "1", "0x6099:1", "4321", "--link", &link]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let ran = diff();
    assert!(ran.code == Some(1) && ran.out.lines().count() == 1 && ran.out.contains("| 4321"), "{ran:?}");
    let ran = run(["params", "restore", &kept, "1", "--link", &link, "--yes"]);
    assert!(ran.code == Some(0) && ran.out.contains("4321 -> "), "{ran:?}");
    assert_eq!(diff().code, Some(0));

    let ran = run(["params", "backup", "all", "--link", &link, "--output", "/tmp"]);
    assert!(ran.code == Some(2) && ran.err.contains("one after the other"), "{ran:?}");
}
