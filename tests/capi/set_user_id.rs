//! The library in a program with more rights than the user who starts it: the user cannot influence it.
//!
//! The program is installed in a system folder for temporary files, since the user has to reach it.
#![cfg(target_os = "linux")]

/// LIB-58 The library reads its variables in one place, which checks for such programs.
#[test]
fn variables_are_read_in_one_place() {
    let mut others = Vec::new();
    let rooms = ["address", "link", "hardware", "own_board", "testbed", "tcp", "open", "io", "engine", "ecm", "port"];
    for folder in rooms.map(|room| format!("src/{room}")).into_iter().chain(["capi/src".to_owned()]) {
        read_variables(&support::root().join(folder), &mut others);
    }
    assert_eq!(others, [support::root().join("src/address/config/privilege.rs")]);
}

/// Adds the sources below `folder` that read variables of the environment.
#[cfg(test)]
fn read_variables(folder: &std::path::Path, found: &mut Vec<std::path::PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder of the repository") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            read_variables(&path, found);
        } else {
            let text = std::fs::read_to_string(&path).expect("a source");
            if ["env::var", "getenv", "vars_os", "home_dir"].iter().any(|call| {
                // Mentions in comments are in backticks.
                text.lines().any(|line| !line.trim_start().starts_with("//") && line.contains(call))
            }) {
                found.push(path);
            }
        }
    }
}

mod needs_root {
    use std::fs::{self, Permissions};
    use std::os::unix::fs::{PermissionsExt, chown, symlink};
    use std::os::unix::process::CommandExt;
    use std::path::{Path, PathBuf};
    use std::process::Command;

    use tempfile::TempDir;

    const NOBODY: u32 = 65534;

    /// A folder of root's with a program in it that runs with root's rights, and one of the user's.
    struct Installed {
        root: TempDir,
        user: TempDir,
    }

    impl Installed {
        fn new() -> Self {
            let installed = Self { root: folder(), user: folder() };
            set_mode(installed.root.path(), 0o755);
            chown(installed.user.path(), Some(NOBODY), Some(NOBODY)).expect("tests in needs_root run as root");
            let mut compiler = support::Language::C("c99").compiler();
            compiler.arg(support::root().join("tests/c/set_user_id.c")).arg("-o").arg(installed.program());
            compiler.arg(&support::library().archive);
            support::succeed(compiler.args(["-lgcc_s", "-lutil", "-lrt", "-lpthread", "-lm", "-ldl"]));
            set_mode(&installed.program(), 0o4755);
            installed
        }

        fn program(&self) -> PathBuf {
            self.root.path().join("program")
        }

        fn toml(&self) -> PathBuf {
            self.root.path().join("ecmsk.toml")
        }

        /// Runs the program as the user, with these variables. It must print nothing else.
        fn says(&self, variables: &[(&str, &str)], arguments: &[&str]) -> String {
            let mut command = Command::new(self.program());
            command.args(arguments).env_clear().envs(variables.iter().copied());
            command.uid(NOBODY).gid(NOBODY).current_dir(self.user.path());
            let ended = support::run(&mut command);
            assert_eq!(ended.stderr, "");
            ended.success()
        }
    }

    fn folder() -> TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        set_mode(folder.path(), 0o755);
        folder
    }

    fn set_mode(path: &Path, mode: u32) {
        fs::set_permissions(path, Permissions::from_mode(mode)).expect("the owner may");
    }

    const SIM: &str = "sim:?slaves=drive*3&clock=virtual";

    /// LIB-58 Variables of the user have no effect in a set-user-ID program, and their usual effect without that right.
    #[test]
    fn variables_are_not_obeyed() {
        let installed = Installed::new();
        let roots_file = installed.root.path().join("kept");
        fs::write(&roots_file, "kept").expect("a file");
        let recording = installed.user.path().join("recording.pcapng");
        let opened = installed.user.path().join("opened");
        let home = installed.user.path().join("home");
        fs::create_dir_all(home.join("ecmsk")).expect("a folder");
        fs::write(home.join("ecmsk/ecmsk.toml"), format!("link = \"{SIM}\"\n")).expect("a file");
        let [recorded, opened_text, kept, home] = [
            format!("{SIM}&record={}", recording.display()),
            opened.display().to_string(),
            roots_file.display().to_string(),
            home.display().to_string(),
        ];
        let link = ("ECMSK_LINK", recorded.as_str());
        let variables = [link, ("ECMSK_OPENED", &opened_text), ("ECMSK_LOG", "off"), ("XDG_CONFIG_HOME", &home)];
        let short_secret = [("ECMSK_TCP_SECRET", "short")];
        let server = ["tcp://127.0.0.1:1"];

        let said = installed.says(&variables, &[]);
        assert!(!said.contains("sim"), "{said}; is {} mounted nosuid? Set TMPDIR", installed.root.path().display());
        assert!(said.contains("by default"), "{said}");
        assert!(!recording.exists() && !opened.exists());
        installed.says(&[("ECMSK_OPENED", &kept), ("ECMSK_LOG", "trace")], &[]);
        assert_eq!(fs::read_to_string(&roots_file).expect("root's file"), "kept");
        let said = installed.says(&short_secret, &server);
        assert!(!said.contains("ECMSK_TCP_SECRET"), "{said}");

        set_mode(&installed.program(), 0o755);
        assert!(installed.says(&variables, &[]).contains("opened sim"));
        assert!(recording.exists() && opened.exists());
        assert!(installed.says(&variables[3..], &[]).contains("opened sim"));
        let said = installed.says(&short_secret, &server);
        assert!(said.contains("ECMSK_TCP_SECRET"), "{said}");
    }

    /// LIB-58 An `ecmsk.toml` counts in a set-user-ID program if only root can have written it; otherwise the open
    /// fails with the reason.
    #[test]
    fn a_configuration_of_roots_alone_counts() {
        let installed = Installed::new();
        let (toml, folder) = (installed.toml(), installed.root.path());
        fs::write(&toml, format!("link = \"{SIM}\"\n")).expect("a file");
        set_mode(&toml, 0o644);
        let says = || installed.says(&[], &[]);
        let refused = |because: &str| {
            let said = says();
            assert!(said.contains("ecmsk.toml: not read") && said.contains(because), "{said}");
        };
        assert!(says().contains("opened sim"), "{}", says());

        chown(&toml, Some(NOBODY), None).expect("root may");
        refused("belongs to user 65534");
        chown(&toml, Some(0), None).expect("root may");
        for mode in [0o664, 0o646] {
            set_mode(&toml, mode);
            refused(&format!("may be written by others (mode {mode:o})"));
        }
        set_mode(&toml, 0o644);
        for mode in [0o775, 0o757, 0o1777] {
            set_mode(folder, mode);
            refused(&format!("may be written by others (mode {mode:o})"));
        }
        set_mode(folder, 0o755);
        chown(folder, Some(NOBODY), None).expect("root may");
        refused("belongs to user 65534");
        chown(folder, Some(0), None).expect("root may");
        assert!(says().contains("opened sim"), "{}", says());

        let elsewhere = folder.join("elsewhere.toml");
        fs::rename(&toml, &elsewhere).expect("root may");
        symlink(&elsewhere, &toml).expect("a symbolic link");
        refused("no regular file");
        set_mode(&installed.program(), 0o755);
        assert!(says().contains("opened sim"), "{}", says());
    }

    /// LIB-58 The user cannot bring a configuration to the program: a second name of it in a folder of the user is
    /// refused with the files beside it, and so is a folder of root below one of the user.
    #[test]
    fn the_program_elsewhere_does_not_help() {
        let installed = Installed::new();
        let elsewhere = installed.user.path().join("program");
        fs::hard_link(installed.program(), &elsewhere).expect("both are in one file system");
        let toml = installed.user.path().join("ecmsk.toml");
        fs::write(&toml, format!("link = \"{SIM}\"\n")).expect("a file");
        let says = |program: &Path| {
            let mut command = Command::new(program);
            command.env_clear().uid(NOBODY).gid(NOBODY);
            support::run(&mut command).success()
        };
        assert!(says(&elsewhere).contains("ecmsk.toml: not read"), "{}", says(&elsewhere));

        let below = installed.user.path().join("below");
        fs::create_dir(&below).expect("a folder");
        for file in ["program", "ecmsk.toml"] {
            fs::rename(installed.user.path().join(file), below.join(file)).expect("root may");
        }
        let said = says(&below.join("program"));
        assert!(said.contains("ecmsk.toml: not read") && said.contains("belongs to user"), "{said}");
    }
}
