//! A board whose link does not know how wide its slots are, as a real one at USB.
#![cfg(unix)]

use std::sync::Arc;

use ecmsk::link::tcp::{Stopped, stop};
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{self, Layer, Link, LinkInfo, Share};
use ecmsk::port::tcp::Server;
use support::tcp::{Told, connect, options, own, serve_link, uri};

use crate::vanish::{Wired, after, drive, prepared};

/// A link that does not know the slot size.
struct Untold(Arc<dyn Link>);

impl Layer for Untold {
    fn inner(&self) -> &dyn Link {
        self.0.as_ref()
    }

    fn info(&self) -> LinkInfo {
        LinkInfo { slot: None, ..self.0.info() }
    }
}

fn served(keys: &str) -> (Server, Told) {
    let (options, told) = options();
    let link = link::open(&own(&format!("sim:?slaves=drive*3&clock=real{keys}")), Share::ByUri).unwrap();
    (serve_link(Arc::new(Untold(link)), options), told)
}

/// TCP-9 docs/SAFETY.md: the axes of a vanished writer are brought to a standstill. Reports show how wide slots are, and
/// clients are told.
#[test]
fn the_axes_of_a_writer_that_vanishes_stand() {
    let (server, told) = served("");
    assert!(connect(&server, "role=reader").info().slot.is_some());
    let Wired { link, cable } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    cable.cut();
    told.wait("stand still");
    let (first, later) = after(&server);
    assert!((0..2).all(|axis| (later[axis].0 - first[axis].0).abs() < 20 && later[axis].1), "{first:?} {later:?}");
}

/// docs/SAFETY.md: a stop brakes the axes.
#[test]
fn a_stop_brakes_the_axes() {
    let (server, told) = served("");
    let Wired { link, cable: _cable } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    let done = stop(&LinkUri::parse(&uri(&server, "")).unwrap(), false).unwrap();
    assert!(matches!(&done, Stopped { in_op: true, writer: Some(_), .. }), "{done:?}");
    let (first, later) = after(&server);
    assert!((0..2).all(|axis| (later[axis].0 - first[axis].0).abs() < 20), "{first:?} {later:?}");
}
