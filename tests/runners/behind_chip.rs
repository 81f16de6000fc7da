//! `xf-sim:` as a board: its slaves are behind the model of an ECM-XF, and a program sees what it sees with `sim:`.

use ecmsk::link::{self, LinkError, Share};
use ecmsk::sk::MasterState;

use crate::client::Client;

fn open(uri: &str, share: Share) -> Result<Client, LinkError> {
    link::open(uri, share).map(Client::on)
}

/// Opens; there must be no error.
fn opened(uri: &str, share: Share) -> Client {
    open(uri, share).unwrap_or_else(|error| panic!("{uri}: {error}"))
}

/// LINK-9 Every chip that can be modelled has a board over it, whose slaves go to OP.
#[test]
fn a_board_over_every_chip_goes_to_op() {
    for chip in ["", "&chip_fw=old", "&chip_fw=xfu", "&int0=yes", "&use_n=512", "&n=256&speed=12M", "&ahead=1"] {
        let mut client = opened(&format!("xf-sim:?clock=virtual&slaves=drive*2{chip}"), Share::ByName);
        client.op();
        client.go(MasterState::PreOp);
    }
}

/// LINK-9 Without a slave it is refused as a board of `sim:` is.
#[test]
fn a_board_without_slaves_behind_its_chip_does_not_open() {
    let said = |scheme: &str| {
        let uri = format!("{scheme}:?slaves=none&clock=virtual");
        let Err(LinkError::NoBoard { name, reason }) = open(&uri, Share::ByName) else { panic!("{uri} is refused") };
        assert_eq!(name, uri);
        reason
    };
    assert_eq!(said("xf-sim"), said("sim"));
}
