//! `share/windows/ecmsk.toml`, which is shipped with the DLLs: every key, with its meaning, as a line to uncomment.

use std::fs;

use ecmsk::link::config::{Configured, DEFAULT_LINK, Environment, Source, find};
use ecmsk::link::keys::{KEYS, Key, Scheme, Syntax};
use ecmsk::link::slaves::SlaveModel;
use ecmsk::link::uri::LinkUri;

/// The schemes that the DLL can open, and the shortest link of each.
const SCHEMES: [(Scheme, &str, &str); 4] = [
    (Scheme::Sim, "sim:", "a simulated board in the program"),
    (Scheme::XfSim, "xf-sim:", "a simulated board whose slaves are behind an ECM-XF"),
    (Scheme::Usb, "usb:", "a real board on USB"),
    (Scheme::Tcp, "tcp://192.168.0.10:4711", "a board that another machine serves (`ecmsk serve tcp`)"),
];

const HEAD: &str = r#"# Which board NEXTWUSBLib.dll opens. Put this file beside the program's .exe or beside the DLL; other places, and what a
# link is, are in README.txt. A file that is wrong is never passed over: OpenECMUSB gives false then, and with
# ECMSK_LOG=warn in the environment the reason goes to standard error.
#
# There is one key, `link`, and it stands here once: to switch another line on, take its # away and put one before the line
# that was on. A link is SCHEME:PLACE?KEY=VALUE&KEY=VALUE; each line below shows one key, several are joined by `&`.
# In a value, % & ? # and blanks are written %25 %26 %3F %23 %20.

"#;

/// The key that needs Unix sockets.
const NOT_ON_WINDOWS: &str = "control";

/// The file's only key, active and commented out.
const ON: &str = "link = ";
const OFF: &str = "# link = ";

fn file() -> std::path::PathBuf {
    support::root().join("share/windows/ecmsk.toml")
}

/// The expected file, from the table that the parser of links uses.
fn expected() -> String {
    let (on, off): (Vec<_>, Vec<_>) = SCHEMES.into_iter().partition(|(scheme, ..)| *scheme == Scheme::Usb);
    let mut text = format!("{HEAD}# {}\n{ON}'{DEFAULT_LINK}'\n", on[0].2);
    for (_, link, meaning) in off {
        text += &format!("# {meaning}\n{OFF}'{link}'\n");
    }
    let of_all = |key: &&Key| key.schemes.len() == Scheme::ALL.len();
    text += "\n# ---- any board\n";
    text += &KEYS.iter().filter(of_all).map(|key| entry("sim:", key)).collect::<String>();
    for (scheme, link, meaning) in SCHEMES {
        let is_over_sim = scheme != Scheme::Sim && scheme.is_model();
        let and = if is_over_sim { "; the keys of sim:, and" } else { "" };
        text += &format!("\n# ---- {scheme}: {meaning}{and}\n");
        let of_sim = |key: &&Key| is_over_sim && key.schemes.contains(&Scheme::Sim);
        let own = Key::of(scheme).filter(|key| !of_all(key) && !of_sim(key) && key.name != NOT_ON_WINDOWS);
        text += &own.map(|key| entry(link, key)).collect::<String>();
    }
    text
}

fn entry(link: &str, key: &Key) -> String {
    let value = match key.syntax {
        // Paths as on Windows.
        Syntax::File | Syntax::Folder => {
            format!(r"C:\Users\Public\{}", key.example.rsplit('/').next().expect("a name"))
        }
        _ => key.example.to_owned(),
    };
    let default = key.default.map(|value| format!("; default {value}")).unwrap_or_default();
    // The part of the help further down.
    let mut meaning = key.meaning.replace("see below", "see `ecmsk link help`");
    if key.syntax == Syntax::Slaves {
        let kinds = SlaveModel::ALL.map(|kind| format!("{}, {}", kind.name(), kind.meaning()));
        meaning += &format!("; kinds: {}", kinds.join("; "));
    }
    let mut lines = wrapped(&format!("{}: {meaning}{default}", key.name));
    lines += &format!("{OFF}'{link}?{}={value}'\n", key.name);
    lines
}

fn wrapped(text: &str) -> String {
    let mut lines = vec!["#".to_owned()];
    for word in text.split_whitespace() {
        let line = lines.last_mut().expect("there is one");
        if line.len() + 1 + word.len() > 120 {
            lines.push(format!("#   {word}"));
        } else {
            *line += &format!(" {word}");
        }
    }
    lines.join("\n") + "\n"
}

/// Parses a text, as a file with Windows' line ends.
fn read(text: &str) -> Result<String, String> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("ecmsk.toml");
    fs::write(&path, text.replace('\n', "\r\n")).expect("a file");
    let environment = Environment { program_dir: Some(folder.path().to_owned()), ..Environment::default() };
    let Configured { link, source } = find(&environment).map_err(|error| error.to_string())?;
    assert_eq!(source, Source::File(path));
    Ok(link)
}

/// Every key of the links that the DLL can open is in the file, with its meaning and its default.
#[test]
fn the_shipped_configuration_lists_every_key() {
    support::kept(&file(), &expected());
    let text = fs::read_to_string(file()).expect("the file");
    for (scheme, ..) in SCHEMES {
        for key in Key::of(scheme).filter(|key| key.name != NOT_ON_WINDOWS) {
            assert!(text.contains(&format!("?{}=", key.name)), "{scheme}: {}", key.name);
        }
    }
}

/// The shipped file has the same effect as no file.
#[test]
fn the_shipped_configuration_changes_no_default() {
    assert_eq!(read(&fs::read_to_string(file()).expect("the file")).as_deref(), Ok(DEFAULT_LINK));
}

/// Each commented line is a valid link once it is active, and differs from the default; two active lines are an error
/// with the line.
#[test]
fn each_commented_line_of_the_shipped_configuration_is_a_valid_link() {
    let text = fs::read_to_string(file()).expect("the file");
    let shipped = text.lines().find(|line| line.starts_with(ON)).expect("one is on");
    let off: Vec<&str> = text.lines().filter(|line| line.starts_with(OFF)).collect();
    assert!(off.len() > 40, "{}", off.len());
    for line in off {
        let on = line.trim_start_matches("# ");
        let switched = text.replace(shipped, &format!("# {shipped}")).replace(line, on);
        let link = read(&switched).unwrap_or_else(|error| panic!("{line}: {error}"));
        assert_eq!(on, format!("{ON}'{link}'"));
        let uri = LinkUri::parse(&link).unwrap_or_else(|error| panic!("{line}: {error}"));
        if let Some((_, key)) = link.split_once('?') {
            let name = key.split('=').next().expect("a name");
            assert!(uri.keys().any(|(known, _)| known == name), "{link} is the default");
        }
        let both = read(&text.replace(line, on)).expect_err(line);
        assert!(both.contains("duplicate key") && both.contains(", line "), "{both}");
    }
}
