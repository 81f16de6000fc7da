//! A pulse module of two channels under the native API: a command for one channel does not affect the other, and both
//! have to be on.

use std::time::Duration;

use crate::common::{Tap, cycles, enable, follow, script, steps};
use ecmsk::ecm::{Axis, Config, Ecm, EcmError, Options, Slave, SlaveView, Stream};
use ecmsk::sk::{AxisTarget, HspResponse};

fn config(axis: Axis) -> Config {
    Config { slaves: vec![Slave::Hsp(axis)], ..Config::default() }
}

fn at(target: i32, outputs: u16) -> AxisTarget {
    AxisTarget { target, outputs }
}

fn seen(stream: &Stream<'_>) -> HspResponse {
    match stream.snapshot().unwrap().slave(1) {
        Some(SlaveView::Hsp(hsp)) => hsp,
        other => panic!("{other:?}"),
    }
}

fn board(keys: &str, axis: Axis) -> (std::sync::Arc<Tap>, Ecm) {
    Tap::enabled(&format!("slot=16&{keys}"), &config(axis))
}

/// SK-3.13 `csp` moves the first axis of an HSP; the second one and the outputs stay, with a target before it and
/// without.
#[test]
fn one_axis_of_two_moves() {
    let (_tap, ecm) = board("slaves=hsp2", Axis::CSP);
    let mut stream = ecm.stream(8).unwrap();
    for n in 1..=500 {
        stream.csp_hsp(1, at(0, 1), at(n * 200, 2)).unwrap();
        stream.step().unwrap();
    }
    let move_first = |stream: &mut Stream<'_>, to: i32| {
        follow(stream, 1, to, 1, 200);
        let now = seen(stream);
        assert!((now.second.position - 100_000).abs() < 50, "{now:?}");
        assert!((now.first.position - to).abs() < 250, "{now:?}");
        // Inputs are wired to outputs.
        assert_eq!((now.first.inputs, now.second.inputs), (1, 2), "{now:?}");
    };
    move_first(&mut stream, 0);
    stream.finish().unwrap();
    let mut stream = ecm.stream(8).unwrap();
    move_first(&mut stream, 200);
    stream.csp_units(1, 400.0).unwrap();
    stream.step().unwrap();
    move_first(&mut stream, 400);
}

/// The same with `csv`.
#[test]
fn one_velocity_of_two_changes() {
    let (_tap, ecm) = board("slaves=hsp2", Axis::CSV);
    let mut stream = ecm.stream(8).unwrap();
    for _ in 0..100 {
        stream.csv_hsp(1, at(0, 1), at(20_000, 2)).unwrap();
        stream.step().unwrap();
    }
    let before = seen(&stream).second.position;
    for _ in 0..100 {
        stream.csv(1, 1000).unwrap();
        stream.step().unwrap();
    }
    let now = seen(&stream);
    assert!((1900..2100).contains(&(now.second.position - before)), "{before} {now:?}");
    assert_eq!((now.first.inputs, now.second.inputs), (1, 2), "{now:?}");
}

/// SK-7.15 The second channel trips: the stream takes no target for the slave any more, and after `clear_alarm` and
/// `servo_on`, which wait for both channels, nothing moves before a new target.
#[test]
fn a_second_channel_that_trips_stops_both() {
    let file = script("two-trips", "at 3s alarm 1.2 0x7500\n");
    let (_tap, ecm) = board(&format!("slaves=hsp2&script={file}"), Axis::CSP);
    let mut stream = ecm.stream(8).unwrap();
    let refused = (1..6000).find_map(|n| {
        let refused = stream.csp_hsp(1, at(n * 30, 0), at(n * 30, 0)).err();
        stream.step().unwrap();
        refused
    });
    assert_eq!(refused, Some(EcmError::SecondOff { slave: 1 }));
    let last = seen(&stream);
    assert!((last.first.position - last.second.position).abs() < 9000, "it was noticed soon: {last:?}");
    assert!(matches!(ecm.servo_on(&[1]), Err(EcmError::Alarm { slave: 1, .. })));
    ecm.clear_alarm(&[1]).unwrap();
    ecm.servo_on(&[1]).unwrap();
    let stands = seen(&stream);
    steps(&mut stream, 300);
    let now = seen(&stream);
    assert!((now.first.position - stands.first.position).abs() < 100, "{stands:?} {now:?}");
    assert!((now.second.position - stands.second.position).abs() < 100, "{stands:?} {now:?}");
    stream.csp_hsp(1, at(now.first.position, 0), at(now.second.position, 0)).unwrap();
    stream.finish().unwrap();
}

/// API-9 SK-7.15 One channel trips, whichever: the end of the stream stops the other one.
#[test]
fn the_channel_that_goes_on_is_stopped() {
    for tripped in [1, 2] {
        let file = script(&format!("one-trips-{tripped}"), &format!("at 3s alarm 1.{tripped} 0x7500\n"));
        let (_tap, ecm) = board(&format!("slaves=hsp2&script={file}"), Axis::CSV);
        let mut stream = ecm.stream(8).unwrap();
        let refused = (0..6000).find_map(|_| {
            let refused = stream.csv_hsp(1, at(20_000, 0), at(20_000, 0)).err();
            stream.step().unwrap();
            refused
        });
        assert!(refused.is_some(), "channel {tripped} has tripped");
        drop(stream);
        let positions = |count| {
            cycles(&ecm, count);
            match ecm.snapshot().unwrap().slave(1) {
                Some(SlaveView::Hsp(hsp)) => [hsp.first.position, hsp.second.position],
                other => panic!("{other:?}"),
            }
        };
        let (rest, later) = (positions(1), positions(100));
        assert!((0..2).all(|i| (later[i] - rest[i]).abs() < 20), "channel {tripped} has tripped: {rest:?}, {later:?}");
        assert!(rest.iter().all(|position| *position > 20_000), "both have moved: {rest:?}");
    }
}

/// An alarm of the second channel alone: `servo_on` refuses, `clear_alarm` returns an error if it stays.
#[test]
fn an_alarm_of_the_second_channel_is_told() {
    let file = script("two-alarm", "at 2s alarm 1.2 0x7500 stays\n");
    let tap = Tap::open(&format!("slot=16&slaves=hsp2&script={file}"));
    let options = Options { servo_limit: Duration::from_millis(500), ..Options::default() };
    let ecm = enable(tap.ecm(options).unwrap(), &config(Axis::CSP));
    cycles(&ecm, 3000);
    assert_eq!(ecm.servo_on(&[1]), Err(EcmError::Alarm { slave: 1, code: 0 }));
    assert_eq!(ecm.clear_alarm(&[1]), Err(EcmError::Alarm { slave: 1, code: 0 }));
}

/// Other transfers succeed during a stream that reads the second channel.
#[test]
fn sdo_beside_a_stream_of_two_channels() {
    let slaves = vec![Slave::Hsp(Axis::CSP), Slave::Drive(Axis::CSP)];
    let ecm = Tap::open("slot=16&slaves=hsp2,drive").ecm(Options::default()).unwrap();
    let ecm = enable(ecm, &Config { slaves, ..Config::default() });
    let mut stream = ecm.stream(8).unwrap();
    for round in 0..20 {
        steps(&mut stream, 50);
        let object = ecmsk::coe::ObjectAddress::new(0x6065, 0);
        ecm.sdo_write(2, object, 1000_u32 + round).unwrap();
        assert_eq!(ecm.sdo_read::<u32>(2, object), Ok(1000 + round));
    }
    stream.finish().unwrap();
}
