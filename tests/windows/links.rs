//! The choice of the link, and links over the network from Windows.

use std::fs;
use std::path::Path;

use crate::fixture::{DLL, Folder, Toolchain, Width, lines, source};
use support::tcp::serve;

crate::for_each_width! {
    /// LIB-42, WIN-7 The link comes from ECMSK_LINK, then from ecmsk.toml beside the program, beside the DLL, in the user's
    /// folder, in ProgramData; none: `usb:`. An error in the file is reported with the file, the line and the key.
    #[test]
    fn the_link_is_looked_for_in_five_places(width: Width) {
        let folder = Folder::empty(width, "places");
        let there = |name: &str| {
            let folder = folder.path().join(name);
            fs::create_dir_all(&folder).expect("a folder of Wine's");
            folder
        };
        let [program, library, user, system] = ["program", "library", "user/ecmsk", "system/ecmsk"].map(there);
        fs::copy(width.stage().join(DLL), library.join(DLL)).expect("the DLL");
        folder.build(Toolchain::MinGw, &source("which_link.c"), "program/which_link.exe");
        let says = |link: &str| {
            // Wine's drive Z is the root; relative paths start at the folder of all programs.
            let arguments = ["library\\NEXTWUSBLib.dll", "APPDATA=user", "ProgramData=system"];
            let ended = folder.run("program/which_link.exe", link, arguments);
            assert_eq!(ended.stderr, "", "{link}");
            lines(&ended.stdout)
        };
        let write = |dir: &Path, text: &str| fs::write(dir.join("ecmsk.toml"), text).expect("a file of the folder");

        // A board of another machine that does not exist: no device of this machine is opened.
        let none = says("");
        assert!(none.contains("by default") && none.contains("usb:"), "{none}");
        for (number, dir) in (3..).zip([&system, &user, &library, &program]) {
            write(dir, &format!("link = \"sim:?slaves=drive*{number}\"\n"));
            let said = says("");
            assert!(said.contains(&format!("drive*{number}")), "{}: {said}", dir.display());
        }
        assert!(says("sim:?slaves=drive*9").contains("drive*9"));

        for (text, parts) in [
            ("link = 3\n", &["ecmsk.toml, line 1", "`link`"][..]),
            ("# mine\nlnk = \"sim:\"\n", &["ecmsk.toml, line 2", "lnk"]),
            ("link = \"sim:?slaves=drive&colour=red\"\n", &["ecmsk.toml", "colour"]),
            ("link = \"sim:\n", &["ecmsk.toml, line 1"]),
        ] {
            write(&program, text);
            let said = says("");
            assert!(parts.iter().all(|part| said.contains(part)), "{text}: {said}");
        }
    }

    /// WIN-13 A board that a machine in the network serves: its threads and sockets end with the link.
    #[test]
    fn a_board_in_the_network(width: Width) {
        let (server, _) = serve("sim:?slaves=drive*2");
        let folder = Folder::with_dll(width, "network");
        let link = format!("tcp://{}", server.address());
        folder.build(Toolchain::MinGw, &support::root().join("tests/c/two_axes.c"), "two_axes.exe");
        folder.passes("two_axes.exe", &link, &[]);
        // Its threads and sockets have ended with the link.
        folder.build(Toolchain::MinGw, &source("cycles.c"), "cycles.exe");
        let ended = folder.run("cycles.exe", &link, ["20"]);
        assert_eq!(ended.stderr, "");
        assert_eq!(lines(&ended.success()), "threads +0, handles +0, TLS indexes +0\nok\n");
    }
}
