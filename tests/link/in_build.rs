//! The links that a build opens, and the tables of features.

use ecmsk::link::keys::Scheme;
use ecmsk::link::{self, LinkError, Share};

/// For every scheme: a link whose feature this build has is tried, any other is refused with the table's text
/// (`src/address/scheme.rs`). None of these links names existing hardware.
#[test]
fn what_a_build_opens_is_what_its_table_says() {
    for scheme in Scheme::ALL {
        let rest = match scheme {
            Scheme::Sim | Scheme::XfSim => "?clock=virtual",
            Scheme::Usb => "?serial=none",
            Scheme::XfUsb => "?vid=0xFFFF&pid=0xFFFF&ep_out=1&ep_in=1",
            Scheme::Spi | Scheme::XfSpi => "/dev/none",
            Scheme::Tcp => "//127.0.0.1:1?connect_timeout_ms=1",
            Scheme::Nic => "none0",
        };
        let opened = link::open(&format!("{scheme}:{rest}"), Share::ByName);
        let refused = match opened.as_ref().err() {
            Some(LinkError::Unsupported { scheme: named, hint }) => {
                assert_eq!((named.as_str(), hint.as_str()), (scheme.name(), scheme.instead().as_str()));
                true
            }
            other => {
                assert!(!matches!(other, Some(LinkError::Uri(_))), "{scheme}: {other:?}");
                false
            }
        };
        assert_eq!(refused, !scheme.in_build(), "{scheme}");
    }
}

/// Rows of the table in `text` whose first column is headed `feature`, each split into cells.
fn feature_rows(text: &str) -> Vec<Vec<&str>> {
    let rows =
        text.lines().map(|line| line.trim_start_matches("//! ")).skip_while(|line| !line.starts_with("| feature |"));
    rows.skip(2)
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
        .collect()
}

/// The words between backquotes.
fn quoted(cell: &str) -> Vec<&str> {
    cell.split('`').skip(1).step_by(2).collect()
}

/// Whether a cell names a link of that scheme: `usb:`, `nic:eth1`.
fn names(cell: &str, scheme: Scheme) -> bool {
    quoted(cell).iter().any(|word| word.split_once(':').is_some_and(|(name, _)| name == scheme.name()))
}

/// The features in the README and on the crate's page are those of Cargo.toml, with the same ones on by default. Each link is
/// named at its feature and at no other.
#[test]
fn the_tables_of_features_are_those_of_the_manifest() {
    let read = |file: &str| {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
        std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{file}: {error}"))
    };
    let manifest: toml::Table = read("Cargo.toml").parse().expect("a manifest");
    let manifest = manifest["features"].as_table().expect("features");
    let on: Vec<&str> =
        manifest["default"].as_array().expect("a list").iter().filter_map(|name| name.as_str()).collect();
    let mut features: Vec<&str> = manifest.keys().map(String::as_str).filter(|name| *name != "default").collect();
    features.sort_unstable();

    let page = read("src/lib.rs");
    let mut listed = Vec::new();
    for row in feature_rows(&page) {
        let [feature, default, what] = row[..] else { panic!("3 cells: {row:?}") };
        let [feature] = quoted(feature)[..] else { panic!("one feature: {row:?}") };
        assert_eq!(default == "yes", on.contains(&feature), "{feature}");
        listed.push(feature);
        for scheme in Scheme::ALL {
            assert_eq!(names(what, scheme), scheme.feature() == feature, "the crate's page: {scheme} at {feature}");
        }
    }
    listed.sort_unstable();
    assert_eq!(listed, features, "on the crate's page");

    let readme = read("README.md");
    let mut of_links: Vec<&str> = Scheme::ALL.map(Scheme::feature).to_vec();
    of_links.sort_unstable();
    of_links.dedup();
    let mut listed = Vec::new();
    for row in feature_rows(&readme) {
        let [named, links] = row[..] else { panic!("2 cells: {row:?}") };
        for feature in quoted(named) {
            assert_eq!(named.starts_with("on by default"), on.contains(&feature), "{feature}");
            listed.push(feature);
        }
        for scheme in Scheme::ALL {
            assert_eq!(names(links, scheme), quoted(named).contains(&scheme.feature()), "README: {scheme} at {named}");
        }
    }
    listed.sort_unstable();
    assert_eq!(listed, of_links, "in the README");
}
