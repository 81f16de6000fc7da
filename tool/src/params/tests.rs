//! Tests on each kind of link, in virtual time: parameters are backed up, changed, compared and restored. After that
//! the drive must have the same parameters as before.

use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

use ecmsk::bus;
use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::Ecm;
use ecmsk::slave::{ManufacturerObject, ManufacturerObjects};

use super::differ::drive as differs;
use super::file::ParameterFile;
use super::place::Opened;
use super::put_back::{Options, put_back};
use super::*;

const WRITE: Options = Options { yes: true, force: false, store: false };

/// Manufacturer-specific objects with values of 2, 4 and 8 bytes and a text. The ESI file is of a device with the
/// product code of simulated drives.
const ESI: &str = r##"<EtherCATInfo><Descriptions><Devices>
<Device><Type ProductCode="#x1">Other</Type><Name>Other</Name></Device>
<Device><Type ProductCode="#x53455256">SV2</Type><Name>SV2</Name><Profile><Dictionary><DataTypes/><Objects>
<Object><Index>#x2000</Index><Name>Motor code</Name><Type>UINT</Type><BitSize>16</BitSize><Info><DefaultData>1200</DefaultData></Info><Flags><Access>rw</Access></Flags></Object>
<Object><Index>#x2001</Index><Name>Gain</Name><Type>DINT</Type><BitSize>32</BitSize><Info><DefaultData>FBFFFFFF</DefaultData></Info><Flags><Access>rw</Access></Flags></Object>
<Object><Index>#x2002</Index><Name>Way</Name><Type>ULINT</Type><BitSize>64</BitSize><Info><DefaultData>0102030405060708</DefaultData></Info><Flags><Access>rw</Access></Flags></Object>
<Object><Index>#x2003</Index><Name>Nickname</Name><Type>STRING(24)</Type><BitSize>192</BitSize><Info><DefaultString>twenty-four letters long</DefaultString></Info><Flags><Access>rw</Access></Flags></Object>
<Object><Index>#x2004</Index><Name>Version</Name><Type>UINT</Type><BitSize>16</BitSize><Info><DefaultData>0300</DefaultData></Info><Flags><Access>ro</Access></Flags></Object>
</Objects></Dictionary></Profile></Device>
</Devices></Descriptions></EtherCATInfo>
"##;

fn on_network(link: &str) -> Opened {
    Opened::network(link, bus::open(link).unwrap(), false).unwrap()
}

fn behind_board(slaves: &str) -> Opened {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    // Each link has a unique name, because a second link with the same name would open the same board of this process.
    let link = format!("sim:?slaves={slaves}&clock=virtual&name=params-{}", NEXT.fetch_add(1, Ordering::Relaxed));
    Opened::board(&link, Ecm::open(&link).unwrap(), false).unwrap()
}

/// Backs up slave 1 to a file.
fn kept(opened: &mut Opened, file: &Path) -> ParameterFile {
    backup_one(opened, 1, Some(file), true).unwrap();
    ParameterFile::read(file).unwrap()
}

/// Backs up slave 1, changes an object, and restores the backup. Checks that the change is found, that nothing differs
/// afterwards, and that the drive has its original parameters. Returns the backup.
fn round_trip(mut opened: Opened, folder: &Path, object: ObjectAddress, value: &[u8]) -> ParameterFile {
    let (first, second) = (folder.join("first.params"), folder.join("second.params"));
    let before = kept(&mut opened, &first);
    assert!(!differs(&mut opened, 1, &before).unwrap());
    opened.drive(1).unwrap().write(object, value).unwrap().unwrap();
    assert!(differs(&mut opened, 1, &before).unwrap(), "{}", opened.link);
    assert_ne!(kept(&mut opened, &second), before, "{}", opened.link);
    put_back(&mut opened, 1, &before, WRITE).unwrap();
    assert!(!differs(&mut opened, 1, &before).unwrap(), "{}", opened.link);
    assert_eq!(kept(&mut opened, &second), before, "{}", opened.link);
    before
}

/// A DP3CL, and a drive with the objects of an ESI file, are backed up and restored on a network, behind a chip, and
/// behind a board.
#[test]
fn what_was_kept_is_put_back_on_every_link() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (esi, list) = (folder.join("sv2.xml"), folder.join("sv2.objects"));
    std::fs::write(&esi, ESI).unwrap();
    std::fs::write(&list, crate::objects::converted(ESI.as_bytes(), &esi, Some("SV2")).unwrap()).unwrap();
    let of_esi = format!("drive:objects@{}", list.display());
    let speed = ObjectAddress::new(0x6099, 1);
    let value = 4321_u32.to_le_bytes();

    for scheme in ["sim", "xf-sim"] {
        let file = round_trip(on_network(&format!("{scheme}:?slaves=dp3cl")), folder, speed, &value);
        assert_eq!((file.objects.objects().len(), file.not_kept), (404, 0), "{scheme}");
        let nickname = ObjectAddress::new(0x2003, 0);
        let opened = on_network(&format!("{scheme}:?slaves={of_esi}"));
        let file = round_trip(opened, folder, nickname, b"another one of 24 bytes.");
        assert_eq!(file.not_kept, 0, "{scheme}");
        assert!(file.objects.objects().iter().any(|object| object.address == nickname), "{scheme}");
    }
    // With a list of its objects, a drive on a network is backed up without its SDO information service.
    let opened = on_network(&format!("sim:?slaves={of_esi}")).with_objects(Some(esi.clone()));
    let file = round_trip(opened, folder, ObjectAddress::new(0x2002, 0), &[9; 8]);
    assert_eq!((file.objects.objects().len(), file.not_kept), (4, 0));

    // A board does not list the objects. The file from a network serves as the list.
    let list = folder.join("dp3cl.params");
    let listed = kept(&mut on_network("sim:?slaves=dp3cl"), &list);
    let file = round_trip(behind_board("dp3cl").with_objects(Some(list)), folder, speed, &value);
    assert_eq!(file.objects.objects().len() + file.not_kept, listed.objects.objects().len());
    let opened = behind_board(&of_esi).with_objects(Some(esi));
    let file = round_trip(opened, folder, ObjectAddress::new(0x2001, 0), &value);
    // The text and the value of 8 bytes cannot be transferred; they are listed in the comments of the file.
    assert_eq!((file.objects.objects().len(), file.not_kept), (2, 2));
    let text = std::fs::read_to_string(folder.join("first.params")).unwrap();
    assert!(text.contains("\n# not kept: 0x2002:0 Way: a board transfers values of 1, 2 or 4 bytes\n"), "{text}");
    assert!(text.contains("\n# not kept: 0x2003:0 Nickname: a board transfers no texts\n"), "{text}");
}

/// With the smallest packets a chip transfers values of up to 20 bytes. Longer values are listed as left out, and the
/// others are kept.
#[test]
fn a_chip_names_what_does_not_fit_its_packets() {
    let folder = tempfile::tempdir().unwrap();
    let list = folder.path().join("list.objects");
    std::fs::write(
        &list,
        "0x2000:0 text rw \"twenty letters, whole\" A\n0x2001:0 text rw \"as many as twenty.!!\" B\n",
    )
    .unwrap();
    let link = format!("xf-sim:?slaves=drive:objects@{}&n=32&use_n=32", list.display());
    let file = kept(&mut on_network(&link), &folder.path().join("a.params"));
    assert_eq!(file.not_kept, 1);
    let has = |index| file.objects.objects().iter().any(|object| object.address.index == index);
    assert!(!has(0x2000) && has(0x2001));
    // A file that was read with larger packets also has the long value.
    let whole = kept(&mut on_network(&link.replace("&n=32&use_n=32", "")), &folder.path().join("b.params"));
    assert_eq!(whole.not_kept, 0);
    let compared = differ::compare_with(&mut on_network(&link), 1, &whole, true).unwrap();
    assert_eq!((compared.different.len(), compared.left_out.len()), (0, 1));
}

/// Nothing is written to the slaves of a chip while another program runs their network.
#[test]
fn a_chip_that_runs_its_network_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let mut opened = on_network("xf-sim:?slaves=drive");
    let file = kept(&mut opened, &folder.path().join("a.params"));
    opened.runs = Some((1, "OP"));
    let error = put_back(&mut opened, 1, &file, WRITE).unwrap_err().to_string();
    assert!(error.starts_with("nothing was written: slave 1 is in OP"), "{error}");
    assert!(!differs(&mut opened, 1, &file).unwrap(), "it is compared all the same");
}

/// The slaves behind a board are found by querying each of them in turn.
#[test]
fn the_slaves_behind_a_board_are_counted() {
    assert_eq!(behind_board("dp3cl,drive,io").slaves().unwrap(), [1, 2, 3]);
}

/// If a drive is lost at any time during a restore, the counts of the error cover all parameters.
#[test]
fn a_drive_that_is_lost_at_any_time() {
    let folder = tempfile::tempdir().unwrap();
    let (file, script) = (folder.path().join("a.params"), folder.path().join("lose.ecmscript"));
    let mut file = kept(&mut on_network("sim:?slaves=drive"), &file);
    let is_changed = |object: &ManufacturerObject| matches!(object.address.index, 0x6099 | 0x609A);
    let lines = file.objects.objects().iter().map(|object| match is_changed(object) {
        true => format!("{} {} rw 9\n", object.address, object.data.word()),
        false => format!("{object}\n"),
    });
    let changed = ManufacturerObjects::parse(&lines.collect::<String>()).unwrap();
    let count = changed.objects().iter().filter(|object| is_changed(object)).count();
    file.objects = changed;
    let (mut untouched, mut halfway, mut whole) = (0, 0, 0);
    for us in (2000..16_000).step_by(150) {
        std::fs::write(&script, format!("at {us}us lose 1\n")).unwrap();
        let link = format!("sim:?slaves=drive&script={}", script.display());
        let Ok(mut opened) = Opened::network(&link, bus::open(&link).unwrap(), false) else { continue };
        match put_back(&mut opened, 1, &file, WRITE) {
            Ok(_) => whole += 1,
            Err(ParamsError::Untouched(_)) => untouched += 1,
            Err(ParamsError::Halfway { written, failed, sent, left, .. }) => {
                assert_eq!(written + failed + sent + left, count, "{us}");
                halfway += 1;
            }
            Err(error) => panic!("{error}"),
        }
    }
    assert!(untouched > 0 && halfway > 0 && whole > 0, "{untouched} {halfway} {whole}");
}
