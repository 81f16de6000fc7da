//! The links that a build opens.

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
