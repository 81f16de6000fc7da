//! The travel of simulated axes in a link: `slaves=drive:limits@-200000..300000:home@-500..500`.

use ecmsk::cia402::Statusword;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::link::keys::help;
use ecmsk::link::options::SimOptions;
use ecmsk::link::travel::{PositionRange, TravelSpec};
use ecmsk::link::uri::LinkUri;
use ecmsk::sk::{DriveResponse, Motion, SdoCommand, SdoResponse, SlaveCommand, SlotCommand};
use proptest::prelude::*;
use support::script_client::{Client, SIZE};

fn uri(list: &str) -> LinkUri {
    LinkUri::parse(&format!("sim:?slaves={list}")).unwrap_or_else(|error| panic!("{list}: {error}"))
}

fn travel(parts: &str) -> TravelSpec {
    SimOptions::from_uri(&uri(&format!("drive:{parts}"))).expect(parts).slaves[0].travel
}

const fn span(from: Option<i64>, to: Option<i64>) -> PositionRange {
    PositionRange { from, to }
}

#[test]
fn valid_travels_are_read() {
    let nothing = TravelSpec::default();
    for (parts, said) in [
        ("start@-5", TravelSpec { start: Some(-5), ..nothing }),
        ("start@2147483647", TravelSpec { start: Some(i32::MAX.into()), ..nothing }),
        ("limits@-200..300", TravelSpec { limits: Some(Some(span(Some(-200), Some(300)))), ..nothing }),
        ("limits@-200..", TravelSpec { limits: Some(Some(span(Some(-200), None))), ..nothing }),
        ("limits@..300", TravelSpec { limits: Some(Some(span(None, Some(300)))), ..nothing }),
        ("limits@none", TravelSpec { limits: Some(None), ..nothing }),
        ("home@7..7", TravelSpec { home: Some(Some(span(Some(7), Some(7)))), ..nothing }),
        ("home@none:index@none", TravelSpec { home: Some(None), index: Some(None), ..nothing }),
        ("index@12345", TravelSpec { index: Some(Some(12_345)), ..nothing }),
        ("stops@-10..10:search@99", TravelSpec { stops: Some(span(Some(-10), Some(10))), search: Some(99), ..nothing }),
    ] {
        assert_eq!(travel(parts), said, "{parts}");
        assert_eq!(said.to_string(), format!(":{parts}"), "it is written as it is read");
    }
}

/// The normal form has the parts in a fixed order and omits defaults; it parses back to the same value.
#[test]
fn the_normal_form_of_a_travel() {
    for (list, normal) in [
        ("drive:search@5:home@-1..1:start@3,drive:start@3:home@-1..1:search@05", "drive:start@3:home@-1..1:search@5*2"),
        ("drive:start@0,drive:index@0,drive", "drive*3"),
        ("hsp2:limits@-9..9*2,io,step:home@..-4", "hsp2:limits@-9..9*2,io,step:home@..-4"),
        ("drive:start@-0:limits@none*3", "drive:limits@none*3"),
    ] {
        let text = uri(list).to_string();
        assert_eq!(text, format!("sim:?slaves={normal}"), "{list}: nothing is written as %XX");
        assert_eq!(LinkUri::parse(&text).expect("its own normal form"), uri(list));
    }
}

/// An error is reported with the allowed values.
#[test]
fn an_invalid_travel_is_reported_with_what_is_allowed() {
    const PARTS: &str = "allowed: start@N, limits@N..P|N..|..P|none, home@A..B|A..|..B|none, index@N|none, stops@A..B, \
                         search@N, objects@FILE|any";
    const PLACES: &str = "places from -2147483647 to 2147483647, the lower one first";
    let limits =
        |value: &str| format!("`{value}` in `limits@{value}` is no value; allowed: limits@N..P|N..|..P|none, {PLACES}");
    for (item, why) in [
        ("drive:", format!("`` is no part; {PARTS}")),
        ("drive:limits", format!("`limits` is no part; {PARTS}")),
        ("drive:limit@1..2", format!("`limit` in `limit@1..2` is unknown; did you mean `limits`? {PARTS}")),
        ("drive:xyzzy@1", format!("`xyzzy` in `xyzzy@1` is unknown; {PARTS}")),
        ("drive:limits@5", limits("5")),
        ("drive:limits@..", limits("..")),
        ("drive:limits@5..4", limits("5..4")),
        ("drive:limits@+1..2", limits("+1..2")),
        ("drive:limits@1...2", limits("1...2")),
        ("drive:limits@--1..2", limits("--1..2")),
        ("drive:limits@0..2147483648", limits("0..2147483648")),
        ("drive:limits@0..99999999999999999999", limits("0..99999999999999999999")),
        ("drive:index@-1", format!("`-1` in `index@-1` is no value; allowed: index@N|none, {PLACES}")),
        ("drive:stops@1..", format!("`1..` in `stops@1..` is no value; allowed: stops@A..B, {PLACES}")),
        ("drive:stops@0..0", format!("`0..0` in `stops@0..0` is no value; allowed: stops@A..B, {PLACES}")),
        ("drive:search@0", format!("`0` in `search@0` is no value; allowed: search@N, {PLACES}")),
        ("drive:start@1:start@2", "`start` is given twice; allowed: once".into()),
        (
            "drive:stops@1..5",
            "the axis stands at 0 and cannot be there with stops@1..5; allowed: start@ between them".into(),
        ),
        ("io:start@1", "a slave of kind io has no axis and no travel; allowed: io".into()),
        ("hsp:stops@-1..1", "the pulses of an hsp meet no stops; allowed: stops@ of drive, step, dp3cl".into()),
    ] {
        let error = LinkUri::parse(&format!("sim:?slaves=drive,{item}")).expect_err(item).to_string();
        let words = format!("key `slaves` does not take `drive,{item}`; in `{item}`, {why}; see `ecmsk link help`");
        assert_eq!(error, words);
    }
    for part in ["start@N", "limits@N..P|N..|..P|none", "home@A..B|A..|..B|none", "index@N|none", "stops@A..B"] {
        assert!(help().contains(&format!("\n  :{part}\n")), "{part}");
    }
}

fn write(client: &mut Client, slave: u8, index: u16, sub: u8, size: SdoSize, value: u32) {
    let object = ObjectAddress::new(index, sub);
    client.write(|f| f.put_sdo(SIZE, &SdoCommand::Write { slave, object, size, value }));
    client.until("the answer", |c| {
        matches!(SdoResponse::decode(&c.slot(41)), SdoResponse::Done { object: done, slave: from, .. }
            if done == object && from == slave)
    });
}

/// Homes a slave. The home position is the shaft's position at power-on minus its present position in the coordinate of
/// home; `None`: a homing error.
fn home(client: &mut Client, slave: usize, method: u32) -> Option<i32> {
    write(client, slave as u8, 0x6060, 0, SdoSize::One, 6);
    write(client, slave as u8, 0x6098, 0, SdoSize::One, method);
    client.write(|f| f.put_slave(SIZE, slave, &SlaveCommand::GoHome.into()));
    let drive = |c: &Client| DriveResponse::decode(&c.slot(slave));
    let before = drive(client).position;
    let mut last = before;
    // In the cycle of the home event the position steps by the home position, less the motion of that cycle.
    for _ in 0..60_000 {
        client.read();
        let word = drive(client).statusword.0;
        if word & 0x2000 != 0 {
            // The board accepts an immediate error only after it has persisted (SK-7.39).
            (0..200).for_each(|_| {
                client.read();
            });
            return None;
        }
        if word & 0x1000 != 0 {
            let home = last - drive(client).position;
            client.until("a stand", |c| drive(c).statusword.0 & 0x1400 == 0x1400);
            (0..200).for_each(|_| {
                client.read();
            });
            return Some(home);
        }
        last = drive(client).position;
    }
    panic!("slave {slave}, method {method}: no end; {:?}", drive(client));
}

/// The axes have the link's travel: position, home, and missing limits.
#[test]
fn axes_have_the_travel_that_the_link_says() {
    let list = "drive:start@-30000:limits@-60000..70000:home@-20000..20000:index@5000,drive:limits@none:home@none:\
                index@none,step:start@500:limits@-4000..6000,drive:home@9000..,drive:home@..-9000,drive:search@5000";
    let mut client = Client::with(list, "travel", "clock=virtual", "");
    client.op();
    for slave in 1..=6 {
        client.write(|f| f.put_slave(SIZE, slave, &SlaveCommand::ServoOn.into()));
        client.until("on", |c| DriveResponse::decode(&c.slot(slave)).statusword.is_enabled());
    }
    let position = |c: &Client, slave| DriveResponse::decode(&c.slot(slave)).position;
    assert_eq!((position(&client, 1), position(&client, 2), position(&client, 3)), (-30_000, 0, 500));
    // Default speeds: 2 turns/s, 0.2 turns/s, so at most 270 counts (20 of the step) in a cycle.
    for (slave, method, expected, about) in [
        (1, 17, Some(-59_999), 300),
        (1, 24, Some(-20_000), 300),
        (1, 34, Some(5000), 300),
        (2, 17, None, 0),
        (2, 33, None, 0),
        (2, 24, None, 0),
        (3, 18, Some(5999), 30),
        (4, 20, Some(9000), 300),
        (4, 21, None, 0),
        (5, 22, Some(-9000), 300),
        (6, 34, None, 0),
    ] {
        let before = position(&client, slave);
        let home = home(&mut client, slave, method);
        let what = format!("slave {slave}, method {method}: {home:?}, from {before}");
        assert_eq!(home.is_some(), expected.is_some(), "{what}");
        if slave != 1 || method == 17 {
            let off = home.zip(expected).map_or(0, |(home, expected)| (home - expected).abs());
            assert!(off <= about, "{what}, not {expected:?}");
        }
    }
}

/// Limits given in a link are enforced in CSP, with bit 11, and the axis can move back. The default limits of every
/// axis are for homing only.
#[test]
fn limits_that_are_said_stop_a_motion() {
    let said = "drive:limits@-1000..1000,step:limits@..1000,hsp:limits@-1000..1000,dp3cl:limits@-1000..1000";
    for (list, kept) in [(said, true), ("drive,step,hsp", false)] {
        let mut client = Client::with(list, "limits", "clock=virtual", "");
        client.op();
        let slaves = list.split(',').count();
        let drive = |c: &Client, slave| DriveResponse::decode(&c.slot(slave));
        for slave in 1..=slaves {
            client.write(|f| f.put_slave(SIZE, slave, &SlaveCommand::ServoOn.into()));
            client.until("on", |c| drive(c, slave).statusword.is_enabled());
        }
        let send = |client: &mut Client, target: i32| {
            client.write(|f| (1..=slaves).for_each(|slave| f.put_slave(SIZE, slave, &csp(target))));
            client.read();
        };
        for target in (0..=5000).step_by(10) {
            send(&mut client, target);
        }
        (0..200).for_each(|_| {
            client.read();
        });
        for slave in 1..=slaves {
            let DriveResponse { position, statusword, .. } = drive(&client, slave);
            let limited = statusword.0 & Statusword::INTERNAL_LIMIT != 0;
            let there = if kept { (1000..1100).contains(&position) } else { position == 5000 };
            assert!(there && limited == kept, "{list}, slave {slave}: {position} {:04X}", statusword.0);
        }
        for target in (0..5000).rev().step_by(10) {
            send(&mut client, target);
        }
        (0..200).for_each(|_| {
            client.read();
        });
        for slave in 1..=slaves {
            let DriveResponse { position, statusword, .. } = drive(&client, slave);
            assert_eq!((position, statusword.0 & Statusword::INTERNAL_LIMIT), (9, 0), "{list}, slave {slave}");
        }
    }
}

fn csp(target: i32) -> SlotCommand {
    SlaveCommand::Csp(Motion::to(target)).into()
}

fn item() -> impl Strategy<Value = String> {
    let words = "drive io hsp hsp2 step : @ .. * , - 1 0 -5 99999999999 none start limits home index stops search start@5 \
                 limits@-1..1 home@..3 *2 ä";
    let known: Vec<String> = words.split(' ').map(String::from).collect();
    prop_oneof![8 => proptest::sample::select(known), 1 => any::<String>()]
}

proptest! {
    #[test]
    fn no_text_makes_the_parser_panic(items in proptest::collection::vec(item(), 0..12)) {
        let text = format!("sim:?slaves={}", items.concat());
        if let Ok(uri) = LinkUri::parse(&text) {
            let normal = uri.to_string();
            prop_assert_eq!(LinkUri::parse(&normal).expect("its own normal form"), uri, "{}", normal);
        }
    }

    #[test]
    fn every_travel_is_read_back_from_its_text(
        start in proptest::option::of(-100i64..100),
        limits in proptest::option::of(proptest::option::of((-1000i64..0, 0i64..1000))),
        home in proptest::option::of(proptest::option::of(-2_147_483_647i64..0)),
        index in proptest::option::of(proptest::option::of(0u32..0x8000_0000)),
        stops in proptest::option::of((-10_000i64..-100, 100i64..10_000)),
        search in proptest::option::of(1u64..0x8000_0000),
    ) {
        let both = |(from, to)| span(Some(from), Some(to));
        let said = TravelSpec {
            start: start.filter(|start| *start != 0),
            limits: limits.map(|limits| limits.map(both)),
            home: home.map(|home| home.map(|to| span(None, Some(to)))),
            index: index.filter(|index| *index != Some(0)),
            stops: stops.map(both),
            search,
        };
        let uri = uri(&format!("step{said}*2"));
        let slaves = SimOptions::from_uri(&uri).expect("options").slaves;
        prop_assert_eq!(slaves.iter().map(|slave| slave.travel).collect::<Vec<_>>(), [said; 2]);
    }
}
