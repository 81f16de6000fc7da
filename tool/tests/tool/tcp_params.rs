//! `ecmsk params` of drives behind a board that is served over TCP: backup, change, diff and restore give the same parameters.

use crate::common::board::{file, text};
use crate::common::run;
use ecmsk::link::tcp::Secret;
use ecmsk::link::{self, Share};
use ecmsk::port::tcp::ServeOptions;
use support::tcp::{connect_next, serve, serve_with, uri};

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
    assert!(ran.code == Some(1) && ran.out.lines().count() == 1 && ran.out.contains("| drive 4321"), "{ran:?}");
    let ran = run(["params", "restore", &kept, "1", "--link", &link, "--yes"]);
    assert!(ran.code == Some(0) && ran.out.contains("4321 -> "), "{ran:?}");
    assert_eq!(diff().code, Some(0));
}

/// The objects of a drive behind a served board come from the ESI file of its maker. All drives are kept; what a board does not
/// transfer is named.
#[test]
fn a_drive_of_an_esi_file_behind_a_served_board_is_put_back() {
    // Simulated drives have this product code.
    let esi = text("tcp_params.xml", &crate::objects::ESI.replace("#x00001234", "#x53455256"));
    let ran = run(["objects", "from-esi", &esi]);
    let long = "0x2300:0 u64 rw 0x1122334455667788 Way\n0x2301:0 text rw \"a name\" Nickname\n";
    let list = text("tcp_params.objects", &format!("{}{long}", ran.out));
    let (server, _) = serve(&format!("sim:?slaves=drive:objects@{list}*2"));
    let link = uri(&server, "");
    let folder = file("tcp_params_all").display().to_string();
    let backup = |objects: &str| {
        let ran =
            run(["params", "backup", "all", "--link", &link, "--objects", objects, "--output", &folder, "--overwrite"]);
        assert_eq!((ran.code, ran.out.lines().count()), (Some(0), 2), "{ran:?}");
        ran
    };
    let ran = backup(&esi);
    assert!(ran.out.contains(": 4 parameters in ") && ran.err.is_empty(), "{ran:?}");
    let kept = format!("{folder}/slave2.params");
    let before = std::fs::read_to_string(&kept).expect("it is written");
    let ran = run(["sdo", "write", "2", "0x2200:2", "77", "--type", "u16", "--link", &link]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let diff = || run(["params", "diff", &kept, "2", "--link", &link]);
    assert!(diff().code == Some(1) && diff().out.starts_with("0x2200:2    file 200 | drive 77  Gains"), "{:?}", diff());
    let ran = run(["params", "restore", &kept, "2", "--link", &link, "--yes"]);
    assert!(ran.code == Some(0) && ran.out.contains("77 -> 200"), "{ran:?}");
    assert_eq!(diff().code, Some(0));
    backup(&esi);
    let objects = |text: &str| text.lines().filter(|line| !line.starts_with('#')).collect::<Vec<_>>().join("\n");
    assert_eq!(objects(&before), objects(&std::fs::read_to_string(&kept).expect("it is written")));

    let ran = backup(&list);
    assert!(ran.out.contains(": 4 parameters in ") && ran.out.contains(", 2 were not kept"), "{ran:?}");
    for said in ["values of 1, 2 or 4 bytes: 0x2300:0 Way\n", "no texts: 0x2301:0 Nickname\n"] {
        assert!(ran.err.contains(said), "{ran:?}");
    }
}

/// A board that another program writes to is refused, and so is a link that only reads, or has no secret.
#[test]
fn who_may_not_write_restores_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let secret = folder.path().join("secret");
    std::fs::write(&secret, "0123456789abcdef0123456789abcdef").expect("a file");
    #[cfg(unix)]
    std::fs::set_permissions(&secret, std::os::unix::fs::PermissionsExt::from_mode(0o600)).expect("its mode");
    let (options, _) = support::tcp::options();
    let options = ServeOptions { secret: Some(Secret::load(&secret).expect("a secret")), ..options };
    let server = serve_with("sim:?slaves=drive", options);
    let link = uri(&server, &format!("secret_file={}", secret.display()));
    let params = text("tcp_params_speed", "0x6099:1 u32 rw 1234\n");
    let restore = |link: &str| run(["params", "restore", &params, "1", "--link", link, "--yes", "--force"]);

    restore(&uri(&server, "")).expect_failure(1, &["secret"], "");
    let reader = restore(&format!("{link}&role=reader"));
    assert!(reader.code == Some(1) && reader.err.contains("role=writer"), "{reader:?}");
    let writer = link::open(&link, Share::ByName).expect("it is free");
    let refused = restore(&link);
    assert!(refused.code == Some(1) && refused.err.contains("is in use"), "{refused:?}");
    writer.close();
    drop(writer);
    connect_next(&server, &format!("secret_file={}", secret.display())).close();
    let ran = restore(&link);
    assert!(ran.code == Some(0) && ran.out.contains(" -> 1234"), "{ran:?}");
}
