//! Checks which link would be used, and where it is configured.

use std::path::Path;

use ecmsk::link::config::{self, FILE_NAME, LINK_VARIABLE, Platform, Source};
use ecmsk::link::keys::Scheme;
use ecmsk::link::uri::LinkUri;
use ecmsk::machine::findings::Finding;
use ecmsk::machine_file;

use crate::link_option::{environment, is_variable_set};
use crate::machine_option;

const CHECK: &str = "link";

/// The finding about a link from the command line.
pub fn given(link: &LinkUri) -> Finding {
    Finding::fine(CHECK, format!("{link}, from --link"))
}

/// The finding about the configured link, and the link if it is valid. `root` is the folder that contains `/etc`.
pub fn finding(root: &Path) -> (Finding, Option<LinkUri>) {
    of_machine().unwrap_or_else(|| configured(root))
}

/// The finding about the link in the machine file of the working directory. That link has a lower priority than
/// `ECMSK_LINK` and a higher one than configuration files. `None` if the machine file has no link, or `ECMSK_LINK` is
/// set.
fn of_machine() -> Option<(Finding, Option<LinkUri>)> {
    if is_variable_set() {
        return None;
    }
    match machine_option::load(None) {
        Ok(machine) => {
            let uri = machine?.link(None)?;
            let found = format!("{uri}, from {}; {LINK_VARIABLE} is not set", machine_file::FILE_NAME);
            Some((Finding::fine(CHECK, found), Some(uri)))
        }
        Err(error) => {
            let (found, next) = split(&error.to_string());
            Some((Finding::wrong(CHECK, found, next), None))
        }
    }
}

fn configured(root: &Path) -> (Finding, Option<LinkUri>) {
    let mut environment = environment();
    if let Platform::Unix { etc, .. } = &mut environment.platform {
        *etc = root.join("etc");
    }
    let shown = |file: &Path| match file.strip_prefix(root) {
        Ok(inside) if cfg!(unix) => Path::new("/").join(inside),
        _ => file.to_owned(),
    };
    let configured = match config::find(&environment) {
        Ok(configured) => configured,
        Err(error) => {
            let (found, next) = split(&error.to_string());
            return (Finding::wrong(CHECK, found, next), None);
        }
    };
    let files = environment.files();
    let passed_over = match &configured.source {
        Source::Variable => Vec::new(),
        Source::File(file) => files.iter().take_while(|other| *other != file).map(|file| shown(file)).collect(),
        Source::Default => files.iter().map(|file| shown(file)).collect(),
    };
    let source = match &configured.source {
        Source::File(file) => format!("from {}", shown(file).display()),
        other => other.to_string(),
    };
    let mut found = format!("{}, {source}", configured.link);
    if configured.source != Source::Variable {
        found += &format!("; {LINK_VARIABLE} is not set");
        let passed_over: Vec<String> = passed_over.iter().map(|file| file.display().to_string()).collect();
        if !passed_over.is_empty() {
            found += &format!(", there is no {}", passed_over.join(", "));
        }
    }
    let uri = match LinkUri::parse(&configured.link) {
        Ok(uri) => uri,
        Err(error) => {
            let (why, next) = split(&error.to_string());
            return (Finding::wrong(CHECK, format!("{found}: {why}"), next), None);
        }
    };
    (Finding::fine(CHECK, found), Some(uri))
}

/// The finding about a link that this build cannot open; `None` if it can.
pub fn build(wanted: &LinkUri) -> Option<Finding> {
    let scheme = wanted.scheme();
    let next = || format!("{}; or name another link with {LINK_VARIABLE} or in {FILE_NAME}", scheme.instead());
    let finding = || Finding::wrong("build", format!("this build has no {scheme}: links"), next());
    (!scheme.in_build()).then(finding)
}

/// Why this build cannot open links of a scheme, and what to do.
pub fn not_in_build(scheme: Scheme) -> String {
    format!("this build has no {scheme}: links; {}", scheme.instead())
}

/// Splits the text of an error into the problem and the next step, which follows the last semicolon.
pub fn split(error: &str) -> (String, String) {
    match error.rsplit_once("; ") {
        Some((found, next)) => (found.to_owned(), next.to_owned()),
        None => (error.to_owned(), "see `ecmsk link help`".to_owned()),
    }
}
