//! The server over TCP: a board for one host at a time, controlled through its link.

use std::collections::VecDeque;
use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;

use ecmsk::link::{self, Share};
use ecmsk::port::usbip::{BoardSpec, Event, Identity, Options, ServeError, Server};
use ecmsk::sk::{CycleTime, DcShift, Frame, MasterCommand, MasterResponse, MasterState, SlotSize, StateByte};

use super::puppet::{Heard, Puppet, options, serve, spec};
use support::usbip_client::{Client, Reply, be16, be32};

const SIZE: SlotSize = SlotSize::Bytes12;

/// A server of a simulated board.
fn sim(uri: &'static str) -> (Server, Heard) {
    let heard = Heard::default();
    let opener = Box::new(move || link::open(uri, Share::ByUri));
    let boards = vec![BoardSpec { identity: Identity::default(), opener }];
    (Server::start(options(), boards, heard.listener()).expect("the server starts"), heard)
}

fn frame(command: MasterCommand) -> Frame {
    let mut frame = Frame::new();
    frame.put_master(SIZE, &command);
    frame
}

fn state(report: &[u8]) -> StateByte {
    MasterResponse::decode(&Frame::from_prefix(report).slot(SIZE, 0)).state
}

/// SK-9.1 The list and the import show the board's pair, at high speed.
#[test]
fn boards_are_listed_and_given_away() {
    let (left, right, heard) = (Puppet::default(), Puppet::default(), Heard::default());
    let server = Server::start(options(), vec![spec(&left), spec(&right)], heard.listener()).unwrap();
    assert_eq!(server.bus_ids().collect::<Vec<_>>(), ["1-1", "1-2"]);
    let (ids, devices) = Client::connect(server.address()).devices();
    assert_eq!(ids, ["1-1", "1-2"]);
    for device in devices.chunks(316) {
        assert_eq!((be32(device, 296), be16(device, 300), be16(device, 302)), (3, 0x16C0, 0x05DF));
    }
    // Each is for one host; the other board stays free.
    let mut first = Client::connect(server.address());
    let device = first.import("1-2").expect("free");
    assert_eq!((be32(&device, 288), be32(&device, 292)), (1, 2));
    assert_eq!(Client::connect(server.address()).import("1-2"), Err(2), "busy");
    assert_eq!(Client::connect(server.address()).import("1-3"), Err(4), "there is none");
    Client::connect(server.address()).import("1-1").expect("free");
}

#[test]
fn without_a_serial_number_a_board_has_its_bus_id() {
    let (_, server, _) = serve(options());
    let mut client = Client::attached(server.address());
    let (status, serial) = client.control([0x80, 6, 3, 3, 9, 4, 255, 0], &[]);
    assert_eq!((status, &serial[..]), (0, &[8, 3, b'1', 0, b'-', 0, b'1', 0][..]));
}

/// A listener that never returns is called by a separate thread: hosts get their board and transfer frames, a lost
/// board is detached from its host and returns, and the server stops.
#[test]
fn a_stuck_listener_stops_nothing() {
    let (goes_on, stuck) = std::sync::mpsc::channel::<()>();
    let stuck = std::sync::Mutex::new(stuck);
    let puppet = Puppet::default();
    let listener = Arc::new(move |_: &Event| assert!(stuck.lock().unwrap().recv().is_err(), "nobody sends"));
    let server = Server::start(options(), vec![spec(&puppet)], listener).unwrap();
    for fill in 1..=2 {
        let mut client = Client::attached_in_time(server.address());
        let given = client.give(&[fill; 512]);
        assert_eq!(client.reply(), Reply::done(given, 512));
        puppet.lose();
        assert!(client.is_cut());
        puppet.until_closed();
        puppet.come_back();
    }
    assert_eq!(puppet.written(), [1, 2]);
    let (done, stopped) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        server.stop();
        done.send(()).unwrap();
    });
    stopped.recv_timeout(Duration::from_secs(60)).expect("it stops while the listener does not return");
    drop(goes_on);
}

#[test]
fn frames_and_reports_move_in_order() {
    let (puppet, server, _) = serve(options());
    let mut client = Client::attached(server.address());
    for fill in 1..=50 {
        let wanted = client.want_report();
        puppet.make_report(fill);
        assert_eq!(client.report(), (Reply::done(wanted, 512), vec![fill; 512]));
        let given = client.give(&[fill; 512]);
        assert_eq!(client.reply(), Reply::done(given, 512));
    }
    assert_eq!(puppet.written(), (1..=50).collect::<Vec<u8>>());
    assert!(puppet.frames().iter().all(|frame| frame.bytes()[511] == frame.bytes()[0]), "whole");
}

/// A report that is already available may be passed on by another thread than one that was waited for: none overtakes
/// another.
#[test]
fn reports_keep_their_order_whoever_moves_them() {
    let (puppet, server, _) = serve(options());
    let mut client = Client::attached(server.address());
    // One thread waits for this one.
    let waiting = client.want_report();
    std::thread::sleep(Duration::from_millis(5));
    puppet.make_reports_without_end();
    assert_eq!(client.report(), (Reply::done(waiting, 512), vec![0; 512]));
    let mut wanted: VecDeque<u32> = (0..8).map(|_| client.want_report()).collect();
    for number in 1..2000_u32 {
        let first = wanted.pop_front().unwrap();
        assert_eq!(client.report(), (Reply::done(first, 512), vec![number as u8; 512]));
        wanted.push_back(client.want_report());
    }
}

#[test]
fn while_the_board_is_busy_a_frame_is_held() {
    let (puppet, server, _) = serve(options());
    let mut client = Client::attached(server.address());
    puppet.set_busy(true);
    let held = client.give(&[1; 512]);
    puppet.until_writing();
    // Reports go on meanwhile.
    let wanted = client.want_report();
    puppet.make_report(9);
    assert_eq!(client.report().0, Reply::done(wanted, 512));
    assert_eq!(puppet.written(), Vec::<u8>::new());
    puppet.set_busy(false);
    assert_eq!(client.reply(), Reply::done(held, 512));
}

#[test]
fn a_frame_that_is_held_can_be_taken_back() {
    let (puppet, server, _) = serve(options());
    let mut client = Client::attached(server.address());
    puppet.set_busy(true);
    let victim = client.give(&[1; 512]);
    puppet.until_writing();
    let wish = client.take_back(victim);
    assert_eq!(client.reply(), Reply::unlinked(wish));
    puppet.set_busy(false);
    let given = client.give(&[2; 512]);
    assert_eq!(client.reply(), Reply::done(given, 512));
    assert_eq!(puppet.written(), [2]);
}

/// However the race between the board and the host's cancellation ends, both agree: a frame is either taken and
/// answered, or cancelled and never seen by the board.
#[test]
fn a_frame_is_taken_or_taken_back_and_never_both() {
    let (puppet, server, _) = serve(options());
    let mut client = Client::attached(server.address());
    let mut taken = Vec::new();
    for round in 0..=250_u8 {
        puppet.set_busy(round % 3 == 0);
        let victim = client.give(&[round; 512]);
        if round % 2 == 0 {
            puppet.set_busy(false);
        }
        let wish = client.take_back(victim);
        let first = client.reply();
        if first == Reply::unlinked(wish) {
            continue;
        }
        assert_eq!(first, Reply::done(victim, 512));
        assert_eq!(client.reply(), Reply::too_late(wish));
        taken.push(round);
    }
    puppet.set_busy(false);
    let last = client.give(&[255; 512]);
    assert_eq!(client.reply(), Reply::done(last, 512));
    taken.push(255);
    assert_eq!(puppet.written(), taken);
}

#[test]
fn a_read_that_waits_can_be_taken_back_and_no_report_is_lost_by_it() {
    let (puppet, server, _) = serve(options());
    let mut client = Client::attached(server.address());
    for fill in 1..=100 {
        let victim = client.want_report();
        let wish = client.take_back(victim);
        assert_eq!(client.reply(), Reply::unlinked(wish));
        puppet.make_report(fill);
        if fill % 2 == 0 {
            // It was read for the cancelled transfer.
            puppet.let_report_be_taken(Duration::from_millis(1));
        }
        let wanted = client.want_report();
        assert_eq!(client.report(), (Reply::done(wanted, 512), vec![fill; 512]));
    }
}

/// WIRE-7
#[test]
fn a_host_that_goes_leaves_the_board_to_the_next() {
    let (puppet, server, heard) = serve(options());
    for fill in 1..=5 {
        let mut client = Client::attached_in_time(server.address());
        // It disconnects with a read and a frame pending.
        puppet.set_busy(true);
        client.want_report();
        client.give(&[fill; 512]);
        drop(client);
    }
    heard.end();
    puppet.set_busy(false);
    let mut client = Client::attached_in_time(server.address());
    let given = client.give(&[9; 512]);
    assert_eq!(client.reply(), Reply::done(given, 512));
    assert_eq!(puppet.opened(), 1, "the board stays on");
}

/// SK-9.7 Detaching and attaching again is this board's power cycle.
#[test]
fn a_board_that_hangs_runs_again_when_it_is_attached_again() {
    let (puppet, server, heard) = serve(options());
    let mut client = Client::attached(server.address());
    let short = client.give(&[1; 504]);
    assert_eq!(client.reply(), Reply::done(short, 504));
    let held = client.give(&[2; 512]);
    let wish = client.take_back(held);
    assert_eq!(client.reply(), Reply::unlinked(wish));
    drop(client);
    assert!(heard.end().contains("fewer than 512 bytes"), "it says so");
    let mut client = Client::attached_in_time(server.address());
    let given = client.give(&[3; 512]);
    assert_eq!(client.reply(), Reply::done(given, 512));
    assert_eq!(puppet.written(), [3]);
}

/// A frame that the link refuses is stalled, and so is one by SET_REPORT; the host keeps the board, and its next frame passes.
#[test]
fn a_frame_that_the_link_refuses_is_stalled() {
    let (puppet, server, _) = serve(options());
    let mut client = Client::attached(server.address());
    puppet.refuse(2);
    let refused = client.give(&[1; 512]);
    assert_eq!(client.reply(), Reply::stalled(refused));
    assert_eq!(client.control([0x21, 9, 0, 2, 0, 0, 0, 2], &[2; 512]).0, -32);
    let given = client.give(&[3; 512]);
    assert_eq!(client.reply(), Reply::done(given, 512));
    assert_eq!((puppet.written(), puppet.opened()), (vec![3], 1));
    // The rest of a transfer of several frames is dropped.
    puppet.refuse(1);
    let refused = client.give(&[4; 1024]);
    assert_eq!(client.reply(), Reply::stalled(refused));
    let given = client.give(&[5; 512]);
    assert_eq!(client.reply(), Reply::done(given, 512));
    assert_eq!(puppet.written(), [3, 5]);
}

#[test]
fn a_lost_board_is_detached_and_can_be_attached_when_it_is_back() {
    let (puppet, server, heard) = serve(options());
    let mut client = Client::attached(server.address());
    client.want_report();
    puppet.lose();
    assert!(client.is_cut());
    heard.until("it says so", |event| matches!(event, Event::Lost { .. }));
    puppet.until_closed();
    let mut list = Client::connect(server.address());
    assert_eq!(list.import("1-1"), Err(3), "away");
    assert_eq!(Client::connect(server.address()).devices().0, Vec::<String>::new());

    puppet.come_back();
    heard.until("it says so", |event| matches!(event, Event::Reopened { .. }));
    assert_eq!(Client::connect(server.address()).devices().0, ["1-1"]);
    let mut client = Client::attached(server.address());
    let given = client.give(&[1; 512]);
    assert_eq!(client.reply(), Reply::done(given, 512));
    assert_eq!(puppet.opened(), 2);
}

#[test]
fn a_board_that_is_lost_while_nobody_has_it_is_noticed() {
    let (puppet, server, heard) = serve(options());
    puppet.lose();
    heard.until("it says so", |event| matches!(event, Event::Lost { .. }));
    puppet.come_back();
    heard.until("it says so", |event| matches!(event, Event::Reopened { .. }));
    Client::attached(server.address());
}

#[test]
fn the_end_of_the_server_detaches_everybody_and_closes_the_links() {
    let (puppet, server, heard) = serve(options());
    let mut client = Client::attached(server.address());
    let mut idle = Client::connect(server.address());
    puppet.set_busy(true);
    client.give(&[1; 512]);
    client.want_report();
    puppet.until_writing();
    let address = server.address();
    server.stop();
    assert!(client.is_cut() && idle.is_cut());
    puppet.until_closed();
    assert!(heard.end().contains("the server stops"));
    drop(server);
    TcpListener::bind(address).expect("the port is free again");
}

#[test]
fn what_cannot_be_served_is_said_at_the_start() {
    let start = |boards| Server::start(options(), boards, Heard::default().listener()).map(|_| ());
    let gone = Puppet::default();
    gone.lose();
    let error = start(vec![spec(&gone)]).unwrap_err();
    assert!(matches!(error, ServeError::Link(_)), "{error}");

    let virtual_time = Box::new(|| link::open("sim:?clock=virtual", Share::ByName));
    let error = start(vec![BoardSpec { identity: Identity::default(), opener: virtual_time }]).unwrap_err();
    assert!(matches!(&error, ServeError::VirtualTime { .. }) && error.to_string().contains("clock=virtual"), "{error}");

    let mut bad = spec(&Puppet::default());
    bad.identity.interval = 0;
    assert!(matches!(start(vec![bad]).unwrap_err(), ServeError::Identity(_)));

    let many = (0..128).map(|_| spec(&Puppet::default())).collect();
    assert!(matches!(start(many).unwrap_err(), ServeError::TooMany { found: 128 }));

    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let options = Options { listen: taken.local_addr().unwrap(), ..options() };
    let error = Server::start(options, vec![], Arc::new(|_| {})).map(|_| ()).unwrap_err();
    assert!(error.to_string().ends_with("name another place with `--listen`"), "{error}");
}

/// SK-9.8, SK-9.9, SK-9.15 A simulated board: a report every cycle, with or without a command, in every state; a cycle
/// of 250 us is accepted.
#[test]
fn a_simulated_board_runs_behind_it() {
    let (server, _) = sim("sim:?slaves=io&queue=1&name=usbip-runs");
    let mut client = Client::attached(server.address());
    let mut next = || {
        client.want_report();
        client.report().1
    };
    let before: Vec<StateByte> = (0..20).map(|_| state(&next())).collect();
    assert!(before.iter().all(|state| *state == StateByte::reached(MasterState::PreOp)), "{before:?}");

    let give = |client: &mut Client, command| {
        let given = client.give(frame(command).bytes());
        assert_eq!(client.reply(), Reply::done(given, 512));
    };
    give(&mut client, MasterCommand::SetDc { cycle: CycleTime::from_us(250).unwrap(), shift: DcShift::Auto });
    give(&mut client, MasterCommand::SetState(MasterState::Op));
    let reports = (0..20_000).map(|_| {
        client.want_report();
        client.report().1
    });
    let mut in_op = reports.skip_while(|report| state(report) != StateByte::reached(MasterState::Op));
    assert!(in_op.next().is_some(), "it reaches OP");
    assert!(in_op.take(50).all(|report| state(&report) == StateByte::reached(MasterState::Op)));
}

/// SW_RESET detaches the board from the host; it can be attached again.
#[test]
fn after_a_reset_the_board_is_attached_again() {
    let (server, heard) = sim("sim:?slaves=io&queue=1&name=usbip-reset");
    let mut client = Client::attached(server.address());
    client.give(frame(MasterCommand::SoftReset).bytes());
    assert!(client.is_cut());
    heard.until("it says so", |event| matches!(event, Event::Reopened { .. }));
    let mut client = Client::attached(server.address());
    client.want_report();
    assert_eq!(state(&client.report().1), StateByte::reached(MasterState::PreOp));
}
