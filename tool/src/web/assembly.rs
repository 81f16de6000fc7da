//! Makes a single HTML text from the files in `tool/web/`. No bundler is needed, because the modules import only each
//! other. Without their `import` lines and `export` words, and in the order of [`MODULES`], they form a single script.

use data_encoding::BASE64;
use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::markup::escaped;

/// The modules of the page; each module comes after the modules that it imports.
const MODULES: [&str; 15] = [
    include_str!("../../web/src/codec.js"),
    include_str!("../../web/src/words.js"),
    include_str!("../../web/src/channels.js"),
    include_str!("../../web/src/readings.js"),
    include_str!("../../web/src/trigger.js"),
    include_str!("../../web/src/csv.js"),
    include_str!("../../web/src/mcap.js"),
    include_str!("../../web/src/plane.js"),
    include_str!("../../web/src/panels.js"),
    include_str!("../../web/src/tables.js"),
    include_str!("../../web/src/geometry.js"),
    include_str!("../../web/src/machine.js"),
    include_str!("../../web/src/control.js"),
    include_str!("../../web/src/live.js"),
    include_str!("../../web/src/main.js"),
];
/// The library that draws curves, with its licence.
const PLOT_LIBRARY: [&str; 2] =
    [include_str!("../../web/vendor/uPlot.iife.min.js"), include_str!("../../web/vendor/uPlot-LICENSE.txt")];
const STYLES: [&str; 2] = [include_str!("../../web/vendor/uPlot.min.css"), include_str!("../../web/page.css")];
const PAGE: &str = include_str!("../../web/page.html");

/// The page, and its content security policy. The policy allows only the scripts of the page.
pub struct Page {
    /// The HTML text.
    pub html: String,
    /// The value of the HTTP header `Content-Security-Policy`.
    pub policy: String,
}

/// Makes the page. `data` is what the page shows; `None` for a page that gets its data from a server. `connect` is the
/// address to which the page may connect.
///
/// # Errors
/// `data` cannot be converted to JSON.
pub fn page(title: &str, data: Option<&impl Serialize>, connect: Option<&str>) -> serde_json::Result<Page> {
    let data = data.map(serde_json::to_string).transpose()?.unwrap_or_else(|| "null".to_owned());
    let library = format!("/*\n{}*/\n{}", PLOT_LIBRARY[1], PLOT_LIBRARY[0]);
    let script: String = MODULES.iter().map(|module| without_imports(module)).collect();
    let style = STYLES.concat();
    let [library_hash, script_hash, style_hash] = [&library, &script, &style].map(|text| hash(text));
    let policy = format!(
        "default-src 'none'; base-uri 'none'; form-action 'none'; img-src blob: data:; connect-src {}; \
         script-src '{library_hash}' '{script_hash}'; style-src '{style_hash}'",
        connect.unwrap_or("'none'")
    );
    let parts = [
        ("{{policy}}", &*policy),
        ("{{title}}", &escaped(title)),
        ("{{style}}", &style),
        ("{{library}}", &library),
        // The data are inside a script element. Only a `<` in the data could end that element, so it is replaced by a
        // JSON escape sequence.
        ("{{data}}", &data.replace('<', "\\u003c")),
        ("{{script}}", &script),
    ];
    let mut html = String::with_capacity(PAGE.len() + parts.iter().map(|(_, text)| text.len()).sum::<usize>());
    let mut rest = PAGE;
    for (mark, text) in parts {
        let (before, after) = rest.split_once(mark).unwrap_or((rest, ""));
        html.push_str(before);
        html.push_str(text);
        rest = after;
    }
    html.push_str(rest);
    Ok(Page { html, policy })
}

/// The text of a module without its `import` lines and `export` words, as a part of the script of the page.
fn without_imports(module: &str) -> String {
    let lines = module.lines().filter(|line| !line.starts_with("import "));
    lines.map(|line| line.strip_prefix("export ").unwrap_or(line).to_owned() + "\n").collect()
}

fn hash(text: &str) -> String {
    format!("sha256-{}", BASE64.encode(&Sha256::digest(text.as_bytes())))
}

#[cfg(test)]
mod tests {
    use data_encoding::HEXLOWER;

    use super::*;

    /// The files of uPlot, the library with which the pages draw curves, are unchanged: they have the SHA-256 checksums
    /// of uPlot 1.6.32 in npm.
    #[test]
    fn the_library_is_as_it_was_published() {
        let sums = [&PLOT_LIBRARY[0], &STYLES[0]].map(|text| HEXLOWER.encode(&Sha256::digest(text.as_bytes())));
        assert_eq!(
            sums,
            [
                "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
                "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
            ]
        );
    }

    /// Each module comes after the modules that it imports.
    #[test]
    fn modules_are_in_order() {
        let names = [
            "codec", "words", "channels", "readings", "trigger", "csv", "mcap", "plane", "panels", "tables",
            "geometry", "machine", "control", "live", "main",
        ];
        for (place, module) in MODULES.iter().enumerate() {
            for line in module.lines().filter(|line| line.starts_with("import ")) {
                let from = line.rsplit("\"./").next().and_then(|rest| rest.strip_suffix(".js\";")).expect(line);
                assert!(names[..place].contains(&from), "{line} in {}", names[place]);
            }
        }
    }

    /// Data cannot end the script element that contains them, and markup in a title is shown as text. So a recording
    /// cannot run a script in the page.
    #[test]
    fn data_and_title_are_no_markup() {
        let page = page("</title><b>\"", Some(&["</script><script>alert(1)"]), None).expect("a page");
        assert!(page.html.contains("<title>&lt;/title>&lt;b>&quot; - ecmsk</title>"));
        assert!(page.html.contains(r#"["\u003c/script>\u003cscript>alert(1)"]"#));
        assert_eq!(page.html.matches("<script").count(), 3);
        assert!(page.html.contains(&page.policy));
    }
}
