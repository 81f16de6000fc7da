//! SDO transfers, mappings, flash memory.

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::ethercat::{AlState, AlStatus, Ns};
use ecmsk::slave::Slave;
use ecmsk::xf::chip::{FLASH_BYTES, Profile};
use ecmsk::xf::request::{
    Fifo, FifoPackSizeGet, FlashAddress, FlashBytes, FoeFile, FoeGet, FoeRequest, InfoUpdate, MappedObject,
    PdoAssignment, PdoConfigForm, PdoConfigGet, PdoConfigRequest, PdoConfigSet, PdoMap, Reconfig, SdoGet, SdoOperation,
    SdoRequest,
};
use ecmsk::xf::{Errors, EtherCatState, Status};

use super::{Host, INIT, sdo, to_all};
use crate::slave;

fn object(index: u16, bits: u8) -> MappedObject {
    MappedObject::new(ObjectAddress::new(index, 0), bits)
}

fn read(bytes: u16) -> SdoOperation<'static> {
    SdoOperation::Read { bytes }
}

/// XF-11.36 SDO_REQ reads an object for SDO_GET, and writes one; the abort code is 0 then. After a read that fails SDO_GET has no
/// bytes.
#[test]
fn sdo_transfers() {
    let mut host = Host::in_state(EtherCatState::PreOp);
    assert_eq!(host.call(&SdoGet).errors(), Errors::COMMAND, "nothing was read");
    let mut host = Host::in_state(EtherCatState::PreOp);
    host.write(1, 0x6065, 0, &20_000_u32.to_le_bytes());
    host.run(&sdo(1, 0x6065, 0, read(4)));
    assert_eq!(host.call(&SdoGet).to(&SdoGet), 20_000_u32.to_le_bytes());
    host.run(&sdo(2, 0x1008, 0, read(64)));
    assert_eq!(host.call(&SdoGet).to(&SdoGet), b"IO16 simulated digital IO");
    assert_eq!(host.abort_code(), AbortCode(0));
    // Complete access: a count with a byte of padding, then all entries.
    let all = SdoRequest { scope: SdoScope::Complete, ..sdo(0, 0x1C12, 0, read(64)) };
    host.run(&all);
    assert_eq!(host.call(&SdoGet).to(&SdoGet)[..4], [1, 0, 0x00, 0x16]);
    // What was read before is not the result of a read that fails.
    host.end(&sdo(2, 0x5FFF, 0, read(4)));
    assert_eq!(host.call(&SdoGet).to(&SdoGet), [0; 0]);
}

/// XF-11.37 A transfer that fails sets bit 3, and its abort code is kept until the next transfer.
#[test]
fn abort_codes() {
    let mut host = Host::in_state(EtherCatState::SafeOp);
    let cases = [
        (0x5FFF, 0, read(4), AbortCode::NO_OBJECT),
        (0x1018, 9, read(4), AbortCode::NO_SUB_INDEX),
        (0x1000, 0, SdoOperation::Write(&[1, 2, 3, 4]), AbortCode::READ_ONLY),
        (0x6065, 0, SdoOperation::Write(&[1, 2]), AbortCode::TOO_SHORT),
        (0x6065, 0, SdoOperation::Write(&[1, 2, 3, 4, 5]), AbortCode::TOO_LONG),
        (0x1C12, 0, SdoOperation::Write(&[0]), AbortCode::DEVICE_STATE),
    ];
    for (index, sub, operation, abort) in cases {
        assert!(host.end(&sdo(0, index, sub, operation)).errors().contains(Errors::NON_IMMEDIATE));
        assert_eq!(host.abort_code(), abort, "{index:04X}:{sub}");
        assert_eq!(host.abort_code(), abort, "it is kept");
    }
    host.end(&sdo(0, 0x1000, 0, read(4)));
    assert_eq!(host.abort_code(), AbortCode(0));
    assert!(host.call(&sdo(3, 0x1000, 0, read(4))).errors().contains(Errors::COMMAND), "there is no slave 3");
}

/// A slave that aborts every transfer.
struct Aborting {
    state: AlState,
    code: AbortCode,
}

impl Slave for Aborting {
    fn name(&self) -> &str {
        "aborting"
    }

    fn state(&self) -> AlState {
        self.state
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        self.state = target;
        Ok(())
    }

    fn read(&mut self, _: ObjectAddress, _: SdoScope, _: &mut [u8]) -> Result<usize, AbortCode> {
        Err(self.code)
    }

    fn write(&mut self, _: ObjectAddress, _: SdoScope, _: &[u8]) -> Result<(), AbortCode> {
        Err(self.code)
    }

    fn exchange(&mut self, _: Option<&[u8]>, _: &mut [u8]) {}

    fn step(&mut self, _: Ns) {}
}

/// XF-11.37 Every abort code of the manual comes as the slave gives it, of a read and of a write.
#[test]
fn every_abort_code() {
    for code in ABORT_CODES.map(AbortCode) {
        let slave: Box<dyn Slave> = Box::new(Aborting { state: AlState::Init, code });
        let mut host = Host::new(Profile::NEW, vec![slave]);
        host.bring_to(EtherCatState::PreOp);
        for operation in [read(4), SdoOperation::Write(&[1])] {
            assert!(host.end(&sdo(0, 0x2000, 1, operation)).errors().contains(Errors::NON_IMMEDIATE));
            assert_eq!(host.abort_code(), code);
        }
    }
}

/// The list at SDO_ABORTCODE_GET (XF EN 1358), without 0 for no error.
const ABORT_CODES: [u32; 29] = [
    0x0503_0000,
    0x0504_0000,
    0x0504_0001,
    0x0504_0005,
    0x0601_0000,
    0x0601_0001,
    0x0601_0002,
    0x0601_0003,
    0x0601_0004,
    0x0602_0000,
    0x0604_0041,
    0x0604_0042,
    0x0604_0043,
    0x0604_0047,
    0x0606_0000,
    0x0607_0010,
    0x0607_0012,
    0x0607_0013,
    0x0609_0011,
    0x0609_0030,
    0x0609_0031,
    0x0609_0032,
    0x0609_0033,
    0x0609_0036,
    0x0800_0000,
    0x0800_0020,
    0x0800_0021,
    0x0800_0022,
    0x0800_0023,
];

/// XF-11.38 A slave that does not answer is waited for until the time limit; the abort code is that of a timeout.
#[test]
fn sdo_timeout() {
    let mut host = Host::in_state(EtherCatState::PreOp);
    host.chip.network_mut().silence(0, true);
    let begin = host.now;
    assert_eq!(host.end(&sdo(0, 0x1000, 0, read(4))).errors(), Errors::NON_IMMEDIATE);
    assert!((100..110).contains(&((host.now - begin) / super::MS)));
    assert_eq!(host.abort_code(), AbortCode::TIMEOUT);
    // In Init no mailbox answers.
    let mut host = Host::with_drives();
    host.run(&INIT);
    host.end(&sdo(0, 0x1000, 0, read(4)));
    assert_eq!(host.abort_code(), AbortCode::TIMEOUT);
}

/// XF-11.39 PDO_CONFIG_SET writes the slave's mapping objects; PDO_CONFIG_REQ reads them for PDO_CONFIG_GET, with 3
/// PDOs or 4. After RECONFIG_OP the process data have the new length.
#[test]
fn pdo_config() {
    for (profile, form, len) in [(Profile::OLD, PdoConfigForm::Three, 112), (Profile::NEW, PdoConfigForm::Four, 148)] {
        let mut host = Host::new(profile, vec![super::drive()]);
        host.bring_to(EtherCatState::PreOp);
        let objects = [object(0x6040, 16), object(0x607A, 32), object(0x6060, 8)];
        let maps = [PdoMap::new(0x1600, &objects).expect("at most 8")];
        host.run(&PdoConfigSet::new(slave(0), PdoAssignment::Rx, &maps).expect("at most 3"));
        let objects = [object(0x6041, 16), object(0x6064, 32)];
        let tx_maps = [PdoMap::new(0x1A00, &objects).expect("at most 8")];
        host.run(&PdoConfigSet::new(slave(0), PdoAssignment::Tx, &tx_maps).expect("at most 3"));
        for (assignment, maps) in [(PdoAssignment::Rx, maps), (PdoAssignment::Tx, tx_maps)] {
            host.run(&PdoConfigRequest { slave: slave(0), assignment });
            let got = host.call(&PdoConfigGet);
            if len > got.data.len() {
                assert_eq!(got.errors(), Errors::COMMAND);
                continue;
            }
            let config = got.to(&PdoConfigGet);
            assert_eq!((config.maps(), config.form(), config.assignment), (&maps[..], form, assignment));
            assert_eq!(got.valid().len(), len);
        }
        host.run(&Reconfig);
        let size = |host: &mut Host, fifo| host.call(&FifoPackSizeGet { fifo }).to(&FifoPackSizeGet { fifo });
        assert_eq!((size(&mut host, Fifo::Rx), size(&mut host, Fifo::Tx)), (7, 6));
        host.run(&to_all(EtherCatState::Op));
    }
}

/// XF-11.40 A mapping that the slave refuses makes PDO_CONFIG_SET fail, with its abort code.
#[test]
fn refused_mapping() {
    let mut host = Host::in_state(EtherCatState::PreOp);
    let maps = [PdoMap::new(0x1600, &[object(0x5FFF, 16)]).expect("at most 8")];
    let set = PdoConfigSet::new(slave(0), PdoAssignment::Rx, &maps).expect("at most 3");
    assert_eq!(host.end(&set).errors(), Errors::NON_IMMEDIATE);
    assert_ne!(host.abort_code(), AbortCode(0));
    assert!(host.call(&PdoConfigGet).errors().contains(Errors::COMMAND), "nothing was read");
}

/// XF-11.41 FOE_FUNC_REQ writes and reads the flash memory, FOE_FUNC_GET gives what was read; the memory outlives
/// WARM_RESET. Transfers of files are command errors.
#[test]
fn flash() {
    let at = |n| FlashAddress::new(n).expect("below 0x40000");
    let mut host = Host::with_drives();
    assert_eq!(host.chip.flash().len(), FLASH_BYTES);
    let data: Vec<u8> = (0..=255).collect();
    let got = host.call(&FoeRequest::WriteFlash { start: at(0x100), data: &data });
    assert!(got.has(Status::BUSY));
    host.wait();
    assert_eq!(host.chip.flash()[0x100..0x200], data);
    host.run(&FoeRequest::ReadFlash { start: at(0x1FE), bytes: FlashBytes::new(4).expect("at most 256") });
    assert_eq!(host.call(&FoeGet).to(&FoeGet), [254, 255, 0xFF, 0xFF]);
    host.send(&ecmsk::xf::request::WarmReset);
    host.pass(2000 * super::MS);
    host.send(&InfoUpdate);
    assert_eq!(host.chip.flash()[0x100..0x200], data);

    assert_eq!(
        host.call(&FoeRequest::ReadFlash { start: at(0x3_FFFF), bytes: FlashBytes::new(2).expect("at most 256") })
            .errors(),
        Errors::COMMAND
    );
    let mut host = Host::in_state(EtherCatState::PreOp);
    let file = FoeFile { slave: slave(0), password: 0, bytes: 10, timeout_us: 1000, start: at(0), name: b"a" };
    assert_eq!(host.call(&FoeRequest::Upload(file)).errors(), Errors::COMMAND);
    assert_eq!(host.call(&FoeRequest::Download(file)).errors(), Errors::COMMAND);
}
