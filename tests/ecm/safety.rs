//! The statements of docs/SAFETY.md about axes that are not commanded any more, on the modelled board: the program
//! vanishes, the cable is cut, the board resets, the network leaves OP.

use std::sync::Arc;

use crate::common::{SECOND, SIZE, cycles, enable, follow, open, script, steps, uri};
use ecmsk::cia402::DriveState;
use ecmsk::ecm::{Axis, Close, Config, Ecm, Homing, HomingPhase, News, Options, Slave};
use ecmsk::link::{self, Link, Share, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterState, StateByte};

fn config(axis: Axis) -> Config {
    Config { slaves: vec![Slave::Drive(axis); 2], ..Config::default() }
}

/// The counts that an axis moves in that many cycles.
fn moves(ecm: &Ecm, slave: u8, count: u32) -> i32 {
    let from = ecm.next_cycle(SECOND).unwrap().position(slave).unwrap();
    cycles(ecm, count);
    ecm.snapshot().unwrap().position(slave).unwrap() - from
}

fn is_on(ecm: &Ecm, slave: u8) -> bool {
    ecm.snapshot().unwrap().drive(slave).unwrap().statusword.is_enabled()
}

/// A program that moves axis 1 and is killed: it sends nothing more. The board and its axes go on; another program looks.
fn killed_while(name: &str, axis: Axis, command: impl Fn(&mut ecmsk::ecm::Stream<'_>, i32)) -> Ecm {
    let keys = format!("slaves=drive*2&name=safety-{name}");
    let ecm = enable(open(&keys), &config(axis));
    let mut stream = ecm.stream(16).unwrap();
    for n in 0..400 {
        command(&mut stream, n);
        stream.step().unwrap();
    }
    std::mem::forget(stream);
    ecm.close(Close::Leave).unwrap();
    let ecm = open(&keys);
    ecm.adopt(&config(axis)).unwrap();
    ecm
}

/// SK-5.4 CSP: the entries of the FIFO run, then the axis holds the last target, on.
#[test]
fn killed_in_csp_the_axis_holds() {
    let ecm = killed_while("csp", Axis::CSP, |stream, n| stream.csp(1, n * 50).unwrap());
    moves(&ecm, 1, 200);
    assert!(moves(&ecm, 1, 100).abs() <= 2);
    let position = ecm.snapshot().unwrap().position(1).unwrap();
    assert!((position - 399 * 50).abs() < 20, "{position}: the last target");
    assert!(is_on(&ecm, 1));
}

/// SK-5.5 CSV: the axis turns on at its last velocity, for ever.
#[test]
fn killed_in_csv_the_axis_runs_on() {
    let ecm = killed_while("csv", Axis::CSV, |stream, _| stream.csv(1, 50_000).unwrap());
    let second = moves(&ecm, 1, 1000);
    cycles(&ecm, 9000);
    let tenth = moves(&ecm, 1, 1000);
    assert!((49_000..51_000).contains(&second) && (49_000..51_000).contains(&tenth), "{second} {tenth}");
}

/// SK-5.5 CST: the torque stays, and an axis that nothing holds gets faster.
#[test]
fn killed_in_cst_the_axis_gets_faster() {
    let ecm = killed_while("cst", Axis::CST, |stream, _| stream.cst(1, 60).unwrap());
    let first = moves(&ecm, 1, 100);
    let later = moves(&ecm, 1, 100);
    assert!(first > 0 && later > first, "{first} {later}");
}

/// SK-7.20 SK-7.22 Homing: the drive goes on by itself, finds its home and stays there, switched on.
#[test]
fn killed_while_homing_the_axis_goes_home() {
    let keys = "slaves=drive*2&name=safety-homing";
    let link = link::open(&uri(keys), Share::ByName).unwrap();
    let ecm = enable(Ecm::over(link.clone(), Options::default()).unwrap(), &config(Axis::CSP));
    let mut moving = 0;
    let homing = Homing { offset: Some(0), ..Homing::method(17) };
    let ended = ecm.home(1, &homing, |progress| {
        moving += u32::from(progress.phase == HomingPhase::Moving);
        if moving == 20 {
            link.close();
        }
    });
    assert!(ended.is_err());
    drop(ecm);
    drop(link);
    let ecm = open(keys);
    ecm.adopt(&config(Axis::CSP)).unwrap();
    assert!(moves(&ecm, 1, 50).abs() > 100, "it still looks for its home");
    let mut cycles = 0;
    while moves(&ecm, 1, 100).abs() > 2 {
        cycles += 100;
        assert!(cycles < 60_000, "it has an end");
    }
    assert!(is_on(&ecm, 1));
    assert!(ecm.snapshot().unwrap().position(1).unwrap().abs() < 1000, "home is 0");
}

/// API-9 A program that ends by itself, or by a panic that unwinds, ramps its axes to a standstill; they stay on.
#[test]
fn a_panic_ramps_to_a_standstill() {
    let keys = "slaves=drive*2&name=safety-panic";
    let (tell, told) = std::sync::mpsc::channel();
    let ended = std::thread::spawn(move || {
        let ecm = enable(open(keys), &config(Axis::CSV));
        let mut stream = ecm.stream(16).unwrap();
        stream.csv(1, 50_000).unwrap();
        steps(&mut stream, 300);
        tell.send(stream.snapshot().unwrap().meta.at).unwrap();
        panic!("this panic is part of the test");
    });
    assert!(ended.join().is_err());
    let ecm = open(keys);
    let took = ecm.link_info().opened_at.0 - told.recv().unwrap().0;
    assert!(took <= 2_008_000_000, "docs/SAFETY.md: 2 s and 8 cycles, {took} ns");
    ecm.adopt(&config(Axis::CSV)).unwrap();
    assert!(moves(&ecm, 1, 100).abs() <= 2);
    assert!(is_on(&ecm, 1));
}

/// SK-4.59 SK-4.60 The cable before the first slave is cut: no cycle passes any more. The watchdogs of the drives stop
/// them within 100 ms, they are off, and stay so when the cable is back, until a program switches them on.
#[test]
fn a_cut_cable_stops_the_drives() {
    let file = script("safety-cut", "at 2s cut 1 for 1s\n");
    let link = link::open(&uri(&format!("slaves=drive*2&script={file}")), Share::ByName).unwrap();
    let ecm = enable(Ecm::over(link.clone(), Options::default()).unwrap(), &config(Axis::CSV));
    let mut stream = ecm.stream(16).unwrap();
    stream.csv(1, 50_000).unwrap();
    while stream.step().is_ok() {}
    let before = stream.snapshot().unwrap().position(1).unwrap();
    drop(stream);
    link.pass(2 * SECOND).unwrap();
    while ecm.next_cycle(SECOND).is_err() {}
    cycles(&ecm, 100);
    let snapshot = ecm.snapshot().unwrap();
    // The values of lost drives are old.
    assert_eq!(snapshot.state(), StateByte::failed(Some(MasterState::Op)));
    ecm.set_state(MasterState::Op).unwrap();
    let after = ecm.next_cycle(SECOND).unwrap().position(1).unwrap();
    // 100 ms at 50 counts/ms, some cycles until the report, and the quick-stop ramp.
    assert!((4500..6000).contains(&(after - before)), "docs/SAFETY.md: 100 ms, {} counts", after - before);
    assert!(moves(&ecm, 1, 200).abs() <= 2);
    assert!(!is_on(&ecm, 1) && !is_on(&ecm, 2));
}

/// SK-4.61 A cable that is cut behind slave 1: slave 2 is stopped as by a cut before the first one, slave 1 still
/// obeys.
#[test]
fn a_cut_behind_a_slave_stops_those_behind_it() {
    let file = script("safety-cut-2", "at 2s cut 2 for 1s\n");
    let slaves = vec![Slave::Drive(Axis::CSV); 2];
    let config = Config { slaves, ..Config::default() };
    let ecm = enable(open(&format!("slaves=drive*2&script={file}")), &config);
    let mut stream = ecm.stream(16).unwrap();
    [1, 2].into_iter().for_each(|slave| stream.csv(slave, 50_000).unwrap());
    while !stream.snapshot().unwrap().state().is_failed() {
        stream.step().unwrap();
    }
    let before = [1, 2].map(|slave| stream.snapshot().unwrap().position(slave).unwrap());
    steps(&mut stream, 500);
    let went_on = stream.snapshot().unwrap().position(1).unwrap() - before[0];
    assert!((24_000..26_000).contains(&went_on), "{went_on}");
    drop(stream);
    cycles(&ecm, 1000);
    ecm.set_state(MasterState::Op).unwrap();
    let way = ecm.next_cycle(SECOND).unwrap().position(2).unwrap() - before[1];
    assert!((4500..6000).contains(&way), "docs/SAFETY.md: stops as above, {way} counts");
    assert!(!is_on(&ecm, 2));
}

/// SK-4.61 A slave that loses its power is lost alone: the others still obey.
#[test]
fn one_slave_without_power_stops_alone() {
    let file = script("safety-lose", "at 1s lose 1\n");
    let ecm = enable(open(&format!("slaves=drive*2&script={file}")), &config(Axis::CSP));
    assert_eq!(ecm.stats().unwrap().slaves_failed, 0);
    let mut stream = ecm.stream(16).unwrap();
    follow(&mut stream, 2, 0, 20, 2000);
    assert_eq!(ecm.stats().unwrap().slaves_failed, 1);
    let state = StateByte::failed(Some(MasterState::Op));
    assert!(ecm.take_news().unwrap().contains(&News::SlavesFailed { state }));
    let snapshot = stream.snapshot().unwrap();
    assert_eq!(snapshot.state(), StateByte::failed(Some(MasterState::Op)));
    assert!(snapshot.position(2).unwrap() > 39_000);
}

/// SK-4.43 A board that resets leaves its drives without a master: they stop, and are off when it is back.
#[test]
fn a_reset_board_stops_the_drives() {
    let keys = "slaves=drive*2&name=safety-reset";
    let link: Arc<dyn Link> = link::open(&uri(keys), Share::ByName).unwrap();
    let ecm = enable(Ecm::over(link.clone(), Options::default()).unwrap(), &config(Axis::CSV));
    let mut stream = ecm.stream(16).unwrap();
    stream.csv(1, 50_000).unwrap();
    steps(&mut stream, 300);
    let before = stream.snapshot().unwrap().position(1).unwrap();
    std::mem::forget(stream);
    let mut frame = Frame::new();
    frame.put_master(SIZE, &MasterCommand::SoftReset);
    frame.fill_crc(SIZE);
    link.write(&frame, Wait::Now).unwrap();
    assert!(link.check().is_err(), "docs/SAFETY.md: at once");
    drop(ecm);
    drop(link);
    let (ecm, _) = Ecm::open_when_there(&uri(keys), Options::default(), 60 * SECOND).unwrap();
    ecm.configure(&config(Axis::CSV)).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    assert!(!is_on(&ecm, 1));
    assert!(moves(&ecm, 1, 200).abs() <= 2);
    let way = ecm.snapshot().unwrap().position(1).unwrap() - before;
    assert!((0..6000).contains(&way), "docs/SAFETY.md: as with a cut cable, {way} counts");
}

/// SK-4.50 Leaving OP stops the drives on their quick-stop ramp and switches them off; a homing ends.
#[test]
fn leaving_op_stops_the_drives() {
    let ecm = enable(open("slaves=drive*2"), &config(Axis::CSV));
    let mut stream = ecm.stream(16).unwrap();
    stream.csv(1, 50_000).unwrap();
    steps(&mut stream, 300);
    let before = stream.snapshot().unwrap().position(1).unwrap();
    std::mem::forget(stream);
    ecm.set_state(MasterState::PreOp).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    let drive = ecm.next_cycle(SECOND).unwrap().drive(1).unwrap();
    assert_eq!(drive.statusword.state(), Some(DriveState::SwitchOnDisabled));
    assert!(drive.position - before < 6000, "{}", drive.position - before);
    assert!(moves(&ecm, 1, 200).abs() <= 2);
}

fn read(page: &str) -> String {
    std::fs::read_to_string(support::root().join(page)).unwrap()
}

/// The number of tests that a page names by group, file and function, which all exist.
fn named_tests(page: &str) -> usize {
    let mut named = 0;
    for code in read(page).split('`').skip(1).step_by(2) {
        let &[group, file, test] = &*code.split("::").collect::<Vec<_>>() else { continue };
        if code.contains(char::is_whitespace) {
            continue;
        }
        let folders = if group == "tool" { &["tool/tests"][..] } else { &["tests", "tests/masters/tests"] };
        let own = |folder: &str| {
            let file = support::root().join(folder).join(group).join(file).with_extension("rs");
            std::fs::read_to_string(file)
        };
        let is_there = |folder: &&str| own(folder).is_ok_and(|own| own.contains(&format!("fn {test}(")));
        assert!(folders.iter().any(is_there), "{page}: {code}");
        named += 1;
    }
    named
}

/// The anchor of a heading, as GitHub makes it.
fn anchor(heading: &str) -> String {
    let kept = heading.to_lowercase().replace(' ', "-");
    kept.chars().filter(|c| c.is_alphanumeric() || *c == '-').collect()
}

/// Every test exists that docs/SAFETY.md and docs/NIC.md name. README.md names none: where it says that axes stop, it links
/// to the chapter of SAFETY.md that does.
#[test]
fn the_page_names_tests_that_exist() {
    let root = support::root();
    for (page, least) in [("docs/SAFETY.md", 40), ("docs/NIC.md", 8), ("README.md", 0)] {
        let named = named_tests(page);
        assert!(named >= least, "{page}: {named}");
    }
    let page = read("docs/SAFETY.md");
    let anchors: Vec<String> = page.lines().filter_map(|line| line.strip_prefix("## ")).map(anchor).collect();
    let readme = read("README.md");
    let links = readme.split("](docs/SAFETY.md#").skip(1).filter_map(|rest| rest.split_once(')'));
    let links: Vec<&str> = links.map(|(link, _)| link).collect();
    let is_there = |link: &&str| anchors.iter().any(|one| one == link);
    assert!(links.len() >= 2 && links.iter().all(is_there), "{links:?} {anchors:?}");
    let pages = std::fs::read_dir(root.join("docs/rules")).unwrap();
    let rules: String = pages.map(|page| std::fs::read_to_string(page.unwrap().path()).unwrap()).collect();
    let words = page.split(|c: char| !c.is_ascii_alphanumeric() && c != '-' && c != '.');
    for rule in words
        .map(|word| word.trim_end_matches('.'))
        .filter(|word| ["SK-", "API-", "LIB-", "TCP-", "WIRE-"].iter().any(|prefix| word.starts_with(prefix)))
    {
        assert!(rules.contains(&format!("| {rule} |")), "{rule}");
    }
}
