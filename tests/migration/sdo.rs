//! The row `sdo`: a transfer while the state changes.

use ecmsk::coe::ObjectAddress;
use ecmsk::sk::{MasterCommand, MasterState, SdoCommand, SdoResponse, StateByte};

use crate::drives;
use crate::machine::{Behind, Machine};

fn is_done(machine: &Machine) -> bool {
    let shown = SdoResponse::decode(&machine.slot(machine.size.sdo_slot()));
    matches!(shown, SdoResponse::Done { value: 0x4543_4D53, .. })
}

/// XF-20.8 SK-12.10 An SDO requested during a change of state is answered during it on a board, and after it with
/// slaves behind a chip; the answer is the same.
#[test]
fn an_sdo_waits_for_the_change_of_state() {
    for behind in Behind::BOTH {
        let mut machine = drives::in_op(behind, 2);
        machine.go(MasterState::PreOp);
        machine.fresh().master(MasterCommand::SetState(MasterState::Op)).rest(20);
        let object = ObjectAddress::new(0x1018, 1);
        machine.send(|frame, size| frame.put_sdo(size, &SdoCommand::Read { slave: 1, object }));
        machine.until("the answer", is_done);
        let is_up = machine.answer().state == StateByte::reached(MasterState::Op);
        assert_eq!(is_up, behind != Behind::Board);
        machine.until("OP", |machine| machine.answer().state == StateByte::reached(MasterState::Op));
    }
}
