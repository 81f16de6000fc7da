//! Error counters, and which cable is bad.

use std::time::Duration;

use ecmsk::bus::port_errors::{self, CablePort, PortErrors, ProblemPlace, SlaveErrors};
use ecmsk::master::Upstream;

use crate::{network, with_script};

fn cable(near: Option<(u8, u8)>, far: Option<(u8, u8)>) -> ProblemPlace {
    let end = |(slave, port)| CablePort { slave, port };
    ProblemPlace::Cable { near: near.map(end), far: far.map(end) }
}

/// BUS-7.2 A cable that damages frames is found by the counters at its two ends, wherever it is. Long frames reveal it.
#[test]
fn the_bad_cable_of_a_line_is_found() {
    for bad in 1..=4 {
        let (mut network, slaves) = with_script("drive,io*3", &format!("at 1s noise {bad} 20\n"));
        let before = port_errors::read(&mut *network, &slaves).expect("counters");
        assert_eq!(port_errors::judge(&slaves, &before), []);
        network.wait(Duration::from_secs(1)).expect("time");
        network.load(Duration::from_millis(200)).expect("time");
        let counted = port_errors::read(&mut *network, &slaves).expect("counters");
        let since: Vec<SlaveErrors> = counted.iter().zip(&before).map(|(now, then)| now.since(then)).collect();
        let problems = port_errors::judge(&slaves, &since);
        let [problem] = &problems[..] else { panic!("{bad}: {problems:?}") };
        let near = (bad > 1).then(|| (bad - 1, 1));
        assert_eq!(problem.place, cable(near, Some((bad, 0))));
        assert!(problem.far.invalid > 5 && (bad == 1 || problem.near.invalid > 5), "{problem:?}");
        assert!(network.frames().expect("our own master").lost > 10);
    }
}

/// BUS-7.1 All counters are read and cleared. BUS-7.2 A lost link is attributed to the cable at that port, with the
/// slave that is there now.
#[test]
fn a_lost_link_is_counted_and_cleared() {
    let (mut network, slaves) = with_script("io*3", "at 1s cut 3 for 200ms\nat 2s cut 3\n");
    network.wait(Duration::from_millis(1500)).expect("time");
    let counted = port_errors::read(&mut *network, &slaves).expect("counters");
    assert_eq!([counted[1].ports[1].lost_links, counted[2].ports[0].lost_links], [1, 1]);
    let problems = port_errors::judge(&slaves, &counted);
    assert_eq!(problems.iter().map(|problem| problem.place).collect::<Vec<_>>(), [cable(Some((2, 1)), Some((3, 0)))]);
    port_errors::clear(&mut *network, &slaves).expect("they are cleared");
    let cleared = port_errors::read(&mut *network, &slaves).expect("counters");
    assert!(cleared.iter().zip(1..).all(|(of, slave)| *of == SlaveErrors { slave, ..SlaveErrors::default() }));
    network.wait(Duration::from_secs(1)).expect("time");
    let left = network.scan().expect("two slaves");
    let counted = port_errors::read(&mut *network, &left).expect("counters");
    let problems = port_errors::judge(&left, &counted);
    assert_eq!(problems.iter().map(|problem| problem.place).collect::<Vec<_>>(), [cable(Some((2, 1)), None)]);
}

/// BUS-7.2 In a tree errors are attributed to the cable of a branch, forwarded errors to none; invalid frames to the
/// master, errors of a slave's own controller to that slave.
#[test]
fn counters_in_a_tree() {
    let (_, mut slaves) = network("io*4");
    // Slave 1 has slave 2 at port 3 and slave 3 at port 1, with 4 behind it.
    for (slave, upstream) in [(2, (1, 3)), (3, (1, 1)), (4, (3, 1))] {
        slaves[slave - 1].upstream = Some(Upstream { slave: upstream.0, port: upstream.1 });
    }
    let counted = |change: &dyn Fn(&mut [SlaveErrors])| {
        let mut errors: Vec<_> = (1..=4).map(|slave| SlaveErrors { slave, ..SlaveErrors::default() }).collect();
        change(&mut errors);
        port_errors::judge(&slaves, &errors).iter().map(|problem| problem.place).collect::<Vec<_>>()
    };
    let invalid = PortErrors { invalid: 3, ..PortErrors::default() };
    let physical = PortErrors { physical: 255, ..PortErrors::default() };
    let forwarded = PortErrors { forwarded: 200, ..PortErrors::default() };
    assert_eq!(counted(&|errors| errors[1].ports[0] = invalid), [cable(Some((1, 3)), Some((2, 0)))]);
    assert_eq!(counted(&|errors| errors[0].ports[3] = physical), [cable(Some((1, 3)), Some((2, 0)))]);
    let both = counted(&|errors| (errors[0].ports[1], errors[2].ports[0]) = (invalid, physical));
    assert_eq!(both, [cable(Some((1, 1)), Some((3, 0)))]);
    assert_eq!(counted(&|errors| errors[0].ports[2] = invalid), [cable(Some((1, 2)), None)]);
    assert_eq!(counted(&|errors| errors[0].ports[0] = invalid), [cable(None, Some((1, 0)))]);
    assert_eq!(counted(&|errors| errors.iter_mut().for_each(|of| of.ports = [forwarded; 4])), []);
    let own = counted(&|errors| (errors[0].processing_unit, errors[3].pdi) = (2, 9));
    assert_eq!(own, [ProblemPlace::Slave(4), ProblemPlace::Master]);
}

/// The errors since a reading are the difference; for a counter cleared since, its present value.
#[test]
fn counters_since_a_moment() {
    let of = |invalid, pdi| {
        let mut errors = SlaveErrors { slave: 1, pdi, ..SlaveErrors::default() };
        errors.ports[1].invalid = invalid;
        errors
    };
    assert_eq!(of(9, 255).since(&of(4, 255)), of(5, 0));
    assert_eq!(of(2, 0).since(&of(4, 7)), of(2, 0));
}
