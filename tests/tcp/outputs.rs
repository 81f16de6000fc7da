//! The digital outputs of a pulse module whose writer vanishes.
#![cfg(unix)]

use ecmsk::ecm::{Axis, Close, Config, Ecm, Options, Slave, SlaveView};
use ecmsk::link::{self, Share, Wait};
use ecmsk::sk::{AxisTarget, FifoAction, Frame, MasterCommand, MasterState, Motion, SlaveCommand};
use support::tcp::{LIMIT, SIZE, options, serve_with, until, uri};

/// docs/SAFETY.md: outputs stay as they are. Which velocity of a pulse module was executed last is not known after the FIFO was
/// cleared; its outputs are, and the brake keeps them.
#[test]
fn the_brake_of_a_pulse_module_keeps_its_outputs() {
    let (options, told) = options();
    let server = serve_with("sim:?slaves=hsp&clock=virtual", options);
    let config = Config { slaves: vec![Slave::Hsp(Axis::CSV)], ..Config::default() };
    let ecm = Ecm::open_with(&uri(&server, ""), Options { close: Close::Leave, ..Options::default() }).unwrap();
    ecm.configure(&config).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    ecm.servo_on(&[1]).unwrap();
    drop(ecm);
    told.wait("has closed its link");
    let link = link::open(&uri(&server, ""), Share::ByName).unwrap();
    let mut frame = Frame::new();
    let first = AxisTarget { target: 20_000, outputs: 5 };
    let second = AxisTarget { target: 0, outputs: 0 };
    frame.put_slave(SIZE, 1, &SlaveCommand::Csv(Motion { first, second }).into());
    for n in 0..100 {
        if n == 90 {
            frame = Frame::new();
            frame.put_master(SIZE, &MasterCommand::SetFifo(FifoAction::Clear));
        }
        frame.fill_crc(SIZE);
        link.write(&frame, Wait::For(LIMIT)).unwrap();
        link.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap();
    }
    link.vanish();
    told.wait("stand still");
    let ecm = until("place for a writer", || Ecm::open(&uri(&server, "")).ok());
    ecm.adopt(&config).unwrap();
    let seen = [(), ()].map(|()| match ecm.next_cycle(LIMIT).unwrap().slave(1) {
        Some(SlaveView::Hsp(hsp)) => hsp.first,
        other => panic!("{other:?}"),
    });
    assert!(seen[0].position > 1000 && seen[0].position == seen[1].position, "{seen:?}");
    // Inputs are wired to outputs.
    assert_eq!(seen[1].inputs, 5);
    ecm.close(Close::Leave).unwrap();
}
