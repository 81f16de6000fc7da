//! `--attach`: a board passed to a virtual host controller; here a folder replaces the controller, and the test
//! replaces the kernel.

use std::fs;
use std::path::Path;

use ecmsk::port::usbip::{Event, Options, ServeError, Server, free_ports};

use super::puppet::{Heard, Puppet, options, serve, spec};
use support::usbip_client::{Client, Reply};

/// As in a 6.1 kernel.
const STATUS: &str = "\
hub port sta spd dev      sockfd local_busid
hs  0000 006 003 00010001 000003 1-1
hs  0001 004 000 00000000 000000 0-0
hs  0002 004 000 00000000 000000 0-0
ss  0008 004 000 00000000 000000 0-0
";

fn controller(status: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("status"), status).unwrap();
    fs::write(folder.path().join("attach"), "").unwrap();
    folder
}

fn here(vhci: &Path) -> Options {
    Options { attach: Some(vhci.to_owned()), ..options() }
}

#[test]
fn ports_that_are_free_are_told_from_others() {
    assert_eq!(free_ports(STATUS).collect::<Vec<_>>(), [1, 2]);
    assert_eq!(free_ports("").count() + free_ports("hs\nhs x 004\nhs 1\n\n").count(), 0);
}

#[test]
fn without_the_kernels_controller_the_error_says_how_to_get_it() {
    let folder = tempfile::tempdir().unwrap();
    let start = |vhci: &Path| Server::start(here(vhci), vec![spec(&Puppet::default())], Heard::default().listener());
    let error = start(folder.path()).map(|_| ()).unwrap_err();
    assert!(
        matches!(error, ServeError::Attach(_)) && error.to_string().ends_with("`sudo modprobe vhci-hcd`"),
        "{error}"
    );

    let full = controller("hub port sta spd\nhs 0000 006 003\n");
    let error = start(full.path()).map(|_| ()).unwrap_err();
    assert!(error.to_string().contains("usbip detach"), "{error}");
}

#[test]
fn the_controller_gets_a_free_port_the_device_and_its_speed() {
    let vhci = controller(STATUS);
    let (_puppet, _server, _) = serve(here(vhci.path()));
    let order = fs::read_to_string(vhci.path().join("attach")).unwrap();
    let fields: Vec<&str> = order.split(' ').collect();
    // The second is a socket of this process.
    assert_eq!((fields[0], fields[2], fields[3], fields.len()), ("1", "65537", "3", 4), "{order}");
}

/// The folder releases the board at once, since the socket's other end is closed. A user who detaches it manually wants
/// it to stay detached.
#[test]
fn the_controller_gets_the_board_again_when_its_link_is_back() {
    let vhci = controller(STATUS);
    let (puppet, server, heard) = serve(here(vhci.path()));
    heard.end();
    let mut client = Client::attached_in_time(server.address());
    let given = client.give(&[1; 512]);
    assert_eq!(client.reply(), Reply::done(given, 512));
    drop(client);

    fs::write(vhci.path().join("attach"), "").unwrap();
    puppet.lose();
    heard.until("it says so", |event| matches!(event, Event::Lost { .. }));
    puppet.come_back();
    heard.until_times(
        2,
        "attached here",
        |event| matches!(event, Event::Attached { host, .. } if host == "this machine, port 1"),
    );
    assert!(fs::read_to_string(vhci.path().join("attach")).unwrap().starts_with("1 "));
}

#[test]
fn a_board_that_cannot_be_attached_again_is_served_all_the_same() {
    let vhci = controller(STATUS);
    let (puppet, server, heard) = serve(here(vhci.path()));
    fs::remove_file(vhci.path().join("status")).unwrap();
    puppet.lose();
    heard.until("it says so", |event| matches!(event, Event::Lost { .. }));
    puppet.come_back();
    heard.until("it says so", |event| matches!(event, Event::NotAttached { .. }));
    Client::attached_in_time(server.address());
}
