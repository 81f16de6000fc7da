//! The row `lio`: the board's own six inputs and six outputs.

use std::time::Duration;

use ecmsk::link::{self, Share, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterResponse, SlotSize};

/// The value of LIO_RD over that link after LIO_WR has set outputs.
fn shown(link: &str) -> u32 {
    let link = link::open(link, Share::ByName).expect("a board");
    let mut report = Frame::new();
    let mut answer = |command| {
        let mut frame = Frame::new();
        frame.put_master(SlotSize::Bytes12, &command);
        link.write(&frame, Wait::Forever).expect("it is taken");
        for _ in 0..20 {
            link.read(&mut report, Wait::For(Duration::from_secs(5))).expect("a report");
        }
        MasterResponse::decode(&report.slot(SlotSize::Bytes12, 0)).result
    };
    answer(MasterCommand::LocalWrite(0b10_1101));
    answer(MasterCommand::LocalRead)
}

/// XF-20.10 SK-12.8 Without pins the local inputs read 0 and the outputs have no effect; an input on the pin of an
/// output reads the written value.
#[test]
fn local_lines_are_where_the_link_has_them() {
    assert_eq!(shown("xf-sim:?slaves=io&clock=virtual"), 0);
    assert_eq!(shown("xf-sim:?slaves=io&clock=virtual&local_out=0,1,2,3,4,5&local_in=0,1,2,3,4,5"), 0b10_1101);
}
