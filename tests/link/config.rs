//! The places that name a link if the program does not.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use ecmsk::link::LinkError;
use ecmsk::link::config::{ConfigError, Configured, Environment, Platform, Source, find};
use ecmsk::link::uri::LinkUri;
use tempfile::TempDir;

/// A test's machine: every folder of the search, without files.
struct Machine {
    root: TempDir,
    environment: Environment,
}

impl Machine {
    fn unix() -> Self {
        let root = tempfile::tempdir().expect("a folder");
        let dir = |name: &str| Some(root.path().join(name));
        let platform = Platform::Unix { xdg_config_home: dir("xdg"), home: dir("home"), etc: root.path().join("etc") };
        let environment = Environment {
            program_dir: dir("program"),
            library_dir: dir("library"),
            platform,
            ..Environment::default()
        };
        Self { root, environment }
    }

    fn windows() -> Self {
        let mut machine = Self::unix();
        let dir = |name: &str| Some(machine.root.path().join(name));
        machine.environment.platform = Platform::Windows { app_data: dir("roaming"), program_data: dir("programdata") };
        machine
    }

    fn write(&self, path: &str, text: impl AsRef<[u8]>) -> PathBuf {
        let path = self.root.path().join(path);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(&path, text).expect("a file");
        path
    }

    fn find(&self) -> Configured {
        find(&self.environment).expect("a link")
    }
}

fn from_file(path: &Path, link: &str) -> Configured {
    Configured { link: link.to_owned(), source: Source::File(path.to_path_buf()) }
}

/// No link configured means a real board, never a simulated one.
#[test]
fn nothing_configured_means_usb() {
    for machine in [Machine::unix(), Machine::windows()] {
        assert_eq!(machine.find(), Configured { link: "usb:".to_owned(), source: Source::Default });
        assert_eq!(machine.find().source.to_string(), "by default");
    }
    let nothing =
        Environment { platform: Platform::Windows { app_data: None, program_data: None }, ..Environment::default() };
    assert_eq!(find(&nothing).expect("a link").link, "usb:");
}

/// The first place that names a link wins.
#[test]
fn the_first_place_that_names_a_link_wins() {
    let mut machine = Machine::unix();
    // From the last to the first: each one overrides all before it.
    for place in ["etc/ecmsk.toml", "xdg/ecmsk/ecmsk.toml", "library/ecmsk.toml", "program/ecmsk.toml"] {
        let link = format!("sim:?name={}", place.replace('/', "-"));
        let path = machine.write(place, format!("link = \"{link}\"\n"));
        assert_eq!(machine.find(), from_file(&path, &link));
        assert_eq!(machine.find().source.to_string(), format!("from {}", path.display()));
    }
    machine.environment.link = Some("sim:?fw=1.5".into());
    assert_eq!(machine.find(), Configured { link: "sim:?fw=1.5".to_owned(), source: Source::Variable });
    assert_eq!(machine.find().source.to_string(), "from ECMSK_LINK");
}

#[test]
fn on_windows_the_folders_are_those_of_windows() {
    let machine = Machine::windows();
    for place in ["programdata/ecmsk/ecmsk.toml", "roaming/ecmsk/ecmsk.toml"] {
        let path = machine.write(place, "link = 'sim:'");
        assert_eq!(machine.find(), from_file(&path, "sim:"));
    }
    // A file of the other system's place does not count.
    let other = Machine::windows();
    other.write("etc/ecmsk.toml", "link = 'sim:'");
    assert_eq!(other.find().source, Source::Default);
}

/// The user's folder is that of XDG, or .config.
#[test]
fn the_users_folder_is_xdgs_or_dot_config() {
    for xdg in [None, Some(PathBuf::from("relative")), Some(PathBuf::new())] {
        let mut machine = Machine::unix();
        let Platform::Unix { xdg_config_home, .. } = &mut machine.environment.platform else { unreachable!() };
        *xdg_config_home = xdg;
        let path = machine.write("home/.config/ecmsk/ecmsk.toml", "link = 'sim:'");
        assert_eq!(machine.find(), from_file(&path, "sim:"));
    }
    let machine = Machine::unix();
    machine.write("home/.config/ecmsk/ecmsk.toml", "link = 'sim:'");
    assert_eq!(machine.find().source, Source::Default, "XDG_CONFIG_HOME replaces ~/.config");
}

#[test]
fn an_empty_variable_counts_as_not_set() {
    let mut machine = Machine::unix();
    machine.environment.link = Some(OsString::new());
    let path = machine.write("etc/ecmsk.toml", "link = 'sim:'");
    assert_eq!(machine.find(), from_file(&path, "sim:"));
}

#[test]
fn a_file_may_have_comments_and_any_line_ends() {
    for text in ["# which board\n\nlink = \"sim:\" # this one\n", "# x\r\nlink = 'sim:'\r\n", "\u{feff}link = 'sim:'"] {
        let machine = Machine::unix();
        let path = machine.write("program/ecmsk.toml", text);
        assert_eq!(machine.find(), from_file(&path, "sim:"), "{text:?}");
    }
}

/// A wrong file is an error that names the file, the line and what is allowed.
#[test]
fn a_wrong_file_is_an_error_that_names_file_line_and_what_is_allowed() {
    for (text, line, says) in [
        ("link = 'sim:'\nlinks = 'usb:'\n", 2, "links"),
        ("\n\n[board]\nlink = 'sim:'\n", 3, "board"),
        ("link = 3\n", 1, "`link` is of type integer, not a string in quotes"),
        ("\n[link]\nuri = 'sim:'\n", 2, "`link` is of type table, not a string in quotes"),
        ("link = ['sim:']\n", 1, "`link` is of type array, not a string in quotes"),
        ("# nothing\n", 1, "link"),
        ("link = 'sim:'\nlink = 'usb:'\n", 2, "duplicate"),
        ("link = sim:\n", 1, ""),
        ("\nlink\n", 2, ""),
    ] {
        let machine = Machine::unix();
        let path = machine.write("program/ecmsk.toml", text);
        // It is not skipped for a valid file in a later place.
        machine.write("etc/ecmsk.toml", "link = 'usb:'");
        let error = find(&machine.environment).expect_err(text);
        let ConfigError::Content { path: named, line: at, message } = &error else { panic!("{text}: {error:?}") };
        assert_eq!((named, *at), (&path, line), "{text}: {error}");
        assert!(message.contains(says), "{text}: {message}");
        let words = error.to_string();
        for part in
            [&format!("{}, line {line}: ", path.display()), "allowed: one line, link = \"sim:", "ecmsk link help"]
        {
            assert!(words.contains(part), "{words}");
        }
        assert_eq!(LinkError::from(error).to_string(), words);
    }
}

/// The example file in the error's text is valid.
#[test]
fn the_example_in_the_error_works() {
    let machine = Machine::unix();
    machine.write("program/ecmsk.toml", "link = 3");
    let words = find(&machine.environment).expect_err("a number").to_string();
    let (_, rest) = words.split_once("one line, ").expect("an example");
    let (example, _) = rest.split_once(';').expect("an end");
    machine.write("program/ecmsk.toml", example);
    LinkUri::parse(&machine.find().link).expect("a link");
}

/// A file that cannot be read is an error.
#[test]
fn a_file_that_cannot_be_read_is_an_error() {
    let machine = Machine::unix();
    let path = machine.write("program/ecmsk.toml", b"link = '\xFF'");
    let error = find(&machine.environment).expect_err("not UTF-8");
    assert!(matches!(&error, ConfigError::Unreadable { path: named, .. } if *named == path), "{error:?}");
    assert!(error.to_string().starts_with(&path.display().to_string()), "{error}");

    let machine = Machine::unix();
    let path = machine.root.path().join("library/ecmsk.toml");
    std::fs::create_dir_all(&path).expect("a folder where the file should be");
    let error = find(&machine.environment).expect_err("a folder");
    assert!(matches!(&error, ConfigError::Unreadable { path: named, .. } if *named == path), "{error:?}");
}

#[cfg(unix)]
#[test]
fn a_variable_that_is_no_text_is_an_error() {
    use std::os::unix::ffi::OsStringExt;

    let mut machine = Machine::unix();
    machine.environment.link = Some(OsString::from_vec(b"sim:\xFF".to_vec()));
    let error = find(&machine.environment).expect_err("not UTF-8");
    assert!(matches!(error, ConfigError::NotUtf8 { .. }), "{error:?}");
    assert!(error.to_string().contains("ECMSK_LINK") && error.to_string().contains("allowed: "), "{error}");
}

#[test]
fn the_process_knows_its_program_and_the_callers_library() {
    let library = PathBuf::from("/somewhere/lib");
    let environment = Environment::from_process(Some(library.clone()));
    let program = std::env::current_exe().expect("a program");
    assert_eq!(environment.program_dir.as_deref(), program.parent());
    assert_eq!(environment.library_dir, Some(library));
    assert_eq!(environment.link, std::env::var_os("ECMSK_LINK"));
    let first = environment.files().into_iter().next();
    assert_eq!(first, program.parent().map(|dir| dir.join("ecmsk.toml")));
}

/// TOOL-136 Anything but a small regular file is refused with its kind. Opening a pipe without a writer would wait
/// forever.
#[cfg(target_os = "linux")]
#[test]
fn pipes_devices_and_huge_files_are_refused_as_configuration() {
    use rustix::fs::{CWD, Mode, mkfifoat};

    let machine = Machine::unix();
    let file = machine.write("program/ecmsk.toml", "");
    let folder = file.parent().expect("a folder");
    let refused = |words: &str| {
        let error = find(&machine.environment).expect_err("no configuration").to_string();
        assert!(error.contains("ecmsk.toml: ") && error.contains(words), "{error}");
        let script = format!("sim:?clock=virtual&script={}", file.display());
        let error = match ecmsk::link::open(&script, ecmsk::link::Share::ByName) {
            Ok(_) => panic!("{words}: it opened"),
            Err(error) => error.to_string(),
        };
        assert!(error.contains("cannot read the script") && error.contains(words), "{error}");
    };
    std::fs::File::create(&file).and_then(|file| file.set_len(1 << 30)).expect("a sparse file");
    refused("it has more than ");
    std::fs::remove_file(&file).expect("a file");
    mkfifoat(CWD, &file, Mode::RUSR | Mode::WUSR).expect("a pipe");
    refused("it is a pipe (FIFO)");
    std::fs::remove_file(&file).expect("a pipe");
    std::os::unix::fs::symlink("/dev/zero", &file).expect("a link");
    refused("it is a device");
    std::fs::remove_file(&file).expect("a link");
    std::fs::create_dir(folder.join("ecmsk.toml")).expect("a folder");
    refused("it is a folder");
}
