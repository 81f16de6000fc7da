//! Opening by URI: errors are named, with the next step.

use ecmsk::link::uri::{LinkUri, UriError};
use ecmsk::link::{self, LinkError, Share};

#[track_caller]
fn fails(uri: &str, parts: &[&str]) -> LinkError {
    let error = link::open(uri, Share::ByName).err().expect("it does not open");
    for part in parts {
        assert!(error.to_string().contains(part), "{uri}: {error}: no {part}");
    }
    error
}

/// SK-10.1 Defaults and normal forms of the keys.
#[test]
fn keys_have_these_defaults_and_normal_forms() {
    let normal = |text: &str| LinkUri::parse(text).unwrap().to_string();
    for (text, expected) in [
        ("spi:/dev/spidev0.0?speed=24M&mode=0&slot=12&cycle_us=1000&prefill=0", "spi:/dev/spidev0.0"),
        ("spi:/dev/spidev0.0?speed=24000000", "spi:/dev/spidev0.0"),
        ("spi:/dev/spidev0.0?speed=8000k", "spi:/dev/spidev0.0?speed=8M"),
        ("spi:/dev/spidev0.0?speed=1500k", "spi:/dev/spidev0.0?speed=1500k"),
        (
            "spi:/dev/spidev0.0?reset=gpiochip0/24&busy=/dev/gpiochip0/BUSY",
            "spi:/dev/spidev0.0?busy=/dev/gpiochip0/BUSY&reset=gpiochip0/24",
        ),
    ] {
        assert_eq!(normal(text), expected);
        assert_eq!(normal(expected), expected);
    }
    for (key, bad) in [
        ("speed", "25M"),
        ("speed", "99999"),
        ("speed", "1.5M"),
        ("speed", "M"),
        ("speed", "8m"),
        ("speed", "99999999999999999999M"),
        ("mode", "4"),
        ("busy", "25"),
        ("busy", "gpiochip0/"),
        ("busy", "/25"),
        ("reset", "//"),
        ("prefill", "121"),
        ("cycle_us", "100"),
    ] {
        let error = LinkUri::parse(&format!("spi:/dev/spidev0.0?{key}={bad}")).unwrap_err();
        assert!(matches!(&error, UriError::BadValue { key: named, .. } if named == key), "{key}={bad}: {error}");
        assert!(error.to_string().contains("allowed: "), "{error}");
    }
    fails("spi:/dev/spidev0.0?bussy=gpiochip0/25", &["`bussy`", "did you mean `busy`?"]);
    fails("spi:/dev/spidev0.0?slaves=drive", &["`slaves`", "speed", "prefill"]);
}

/// Keys that exclude each other are refused before anything is opened.
#[test]
fn keys_that_exclude_each_other_are_refused() {
    fails("spi:", &["as its place", "spi:/dev/spidev0.0"]);
    fails("spi:spidev0.0", &["as its place", "spi:/dev/spidev0.0"]);
    fails("spi:/dev/spidev0.0?cycle_us=750", &["`cycle_us`", "250 * 2^n"]);
    fails("spi:/dev/spidev0.0?cycle_us=500", &["`cycle_us`", "without BUSY", "busy="]);
    fails(
        "spi:/dev/spidev0.0?cycle_us=250&speed=8M&busy=gpiochip0/1",
        &["`cycle_us`", "24000000 Hz at least", "speed="],
    );
}

/// A missing device, and one of another kind, are named.
#[test]
fn a_missing_or_wrong_device_is_named() {
    let missing =
        fails("spi:/dev/spidev999.7", &["/dev/spidev999.7 is not there", "switch SPI on", "correct the link"]);
    assert!(matches!(missing, LinkError::NoBoard { .. }), "{missing:?}");
    // It is no spidev: the first call on it is refused.
    let another = fails("spi:/dev/null", &["/dev/null is no device of that kind", "correct the link"]);
    assert!(matches!(another, LinkError::NoBoard { .. }), "{another:?}");
}

/// The error for a second opener names the process that has the device open.
#[test]
fn a_device_in_use_is_named_with_its_user() {
    let file = tempfile::NamedTempFile::new().unwrap();
    rustix::fs::flock(&file, rustix::fs::FlockOperation::NonBlockingLockExclusive).unwrap();
    let error = fails(&format!("spi:{}", file.path().display()), &["in use", "ecmsk serve tcp"]);
    assert!(matches!(error, LinkError::InUse { .. }), "{error:?}");
}
