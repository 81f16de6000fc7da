//! Objects of a drive's maker on simulated slaves: `slaves=drive:objects@FILE`, `objects@any`, and `ecmsk objects`.

use crate::common::board::text;
use crate::common::run;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::ecm::{Ecm, EcmError};
use ecmsk::fieldbus::AlState;
use ecmsk::link::options::SimOptions;
use ecmsk::link::slaves::ManufacturerObjectsSpec;
use ecmsk::link::uri::LinkUri;
use ecmsk::slave::{Drive, DriveConfig, ManufacturerObjects, Slave};

const OBJECTS: &str = "\
# objects of a drive
0x2000:0 u16 rw 0x0012 Motor code
0x2101:0 u8 ro 2 Encoder
0x2101:1 i32 rw -5 Encoder: offset
0x2101:2 u32 wo 7 Encoder: key
0x220A:0 any rw 1
0x6041:0 u16 rw 1 the drive has this itself
";

fn drive(makers: ManufacturerObjects) -> Drive {
    let mut drive = Drive::new(DriveConfig::default());
    drive.add_manufacturer_objects(makers);
    drive.enter(AlState::PreOp).expect("that is open");
    drive
}

fn at(index: u16, sub: u8) -> ObjectAddress {
    ObjectAddress::new(index, sub)
}

/// SK-7.47 The objects of a file are read and written by the rules of CoE: size, access, missing objects.
#[test]
fn objects_of_a_file_follow_the_rules_of_coe() {
    let mut drive = drive(ManufacturerObjects::parse(OBJECTS).unwrap());
    let read = |drive: &mut Drive, index, sub| drive.upload(at(index, sub)).map(|value| value.bits);
    assert_eq!(read(&mut drive, 0x2000, 0), Ok(0x12));
    assert_eq!(read(&mut drive, 0x2101, 1), Ok((-5i32) as u32));
    assert_eq!(read(&mut drive, 0x2101, 2), Err(AbortCode::WRITE_ONLY));
    assert_eq!(read(&mut drive, 0x2101, 3), Err(AbortCode::NO_SUB_INDEX));
    assert_eq!(read(&mut drive, 0x2102, 0), Err(AbortCode::NO_OBJECT));
    for (index, sub, size, answer) in [
        (0x2000, 0, SdoSize::Two, Ok(())),
        (0x2000, 0, SdoSize::One, Err(AbortCode::TOO_SHORT)),
        (0x2000, 0, SdoSize::Four, Err(AbortCode::TOO_LONG)),
        (0x2101, 0, SdoSize::One, Err(AbortCode::READ_ONLY)),
        (0x2101, 2, SdoSize::Four, Ok(())),
        (0x2101, 9, SdoSize::Four, Err(AbortCode::NO_SUB_INDEX)),
        (0x2F00, 0, SdoSize::Four, Err(AbortCode::NO_OBJECT)),
        (0x220A, 0, SdoSize::Two, Ok(())),
        (0x220A, 0, SdoSize::Four, Ok(())),
    ] {
        assert_eq!(drive.download(at(index, sub), size, 0x77), answer, "0x{index:04X}:{sub} {size:?}");
    }
    assert_eq!(read(&mut drive, 0x2000, 0), Ok(0x77));
    // The simulated drive's own objects are unchanged: a file cannot change its motion.
    assert_eq!(drive.download(at(0x6041, 0), SdoSize::Two, 1), Err(AbortCode::READ_ONLY));
    drive.enter(AlState::Init).expect("down is open");
    assert_eq!(read(&mut drive, 0x2000, 0), Err(AbortCode::TIMEOUT), "no mailbox in Init");
}

/// SK-7.48 `any`: a written value of any size is read back; a value that was never written is 0; other addresses abort.
#[test]
fn objects_any_stores_whatever_is_written() {
    let mut drive = drive(ManufacturerObjects::any());
    for (index, sub) in [(0x2000, 0), (0x5FFF, 255), (0x6093, 1), (0x2101, 3)] {
        assert_eq!(drive.upload(at(index, sub)).map(|value| value.bits), Ok(0));
        for (size, value) in [(SdoSize::Four, 0x1234_5678), (SdoSize::One, 0xAB)] {
            assert_eq!(drive.download(at(index, sub), size, value), Ok(()));
            assert_eq!(drive.upload(at(index, sub)).map(|value| value.bits), Ok(value));
        }
    }
    assert_eq!(drive.upload(at(0x1F00, 0)), Err(AbortCode::NO_OBJECT));
    assert_eq!(drive.download(at(0x6098, 0), SdoSize::Four, 1), Err(AbortCode::TOO_LONG), "its own keep their rules");
    let full = (0..5000).find_map(|n| drive.download(at(0x3000 + n / 200, (n % 200) as u8), SdoSize::One, 1).err());
    assert_eq!(full, Some(AbortCode::OUT_OF_MEMORY), "it does not grow for ever");
}

/// SK-7.48 A transfer that creates an object allocates nothing, since it runs in the board's cycle.
#[test]
fn making_an_object_allocates_nothing() {
    let mut drive = drive(ManufacturerObjects::any());
    let allocated = allocation_counter::measure(|| {
        for sub in 0..100 {
            drive.download(at(0x2000, sub), SdoSize::Two, 1).expect("stored");
        }
    });
    assert_eq!(allocated.count_total, 0);
}

/// SK-7.47 In a link `objects@FILE` may follow any kind of slave, also with a count and with the travel of the axis; the link
/// has one normal form. Errors say what is allowed.
#[test]
fn a_link_names_objects_behind_any_kind_in_one_normal_form() {
    let of = |list: &str| {
        let uri = LinkUri::parse(&format!("sim:?slaves={list}"));
        uri.map(|uri| (uri.to_string(), SimOptions::from_uri(&uri).expect(list).slaves))
    };
    let (normal, slaves) = of("drive:objects@a/b.objects:start@5*2,io:objects@any").unwrap();
    assert_eq!(normal, "sim:?slaves=drive:start@5:objects@a/b.objects*2,io:objects@any");
    assert_eq!(slaves[1].manufacturer_objects, Some(ManufacturerObjectsSpec::File("a/b.objects".into())));
    assert_eq!(
        (slaves[1].travel.start, &slaves[2].manufacturer_objects),
        (Some(5), &Some(ManufacturerObjectsSpec::Any))
    );
    let (_, slaves) = of(r"drive:objects@C:\sv2.objects:start@5").unwrap();
    assert_eq!(slaves[0].manufacturer_objects, Some(ManufacturerObjectsSpec::File(r"C:\sv2.objects".into())));
    for (list, words) in [("drive:objects@", "names no file"), ("drive:objects@a:objects@b", "given twice")] {
        let error = of(list).unwrap_err().to_string();
        assert!(error.contains(words), "{list}: {error}");
    }
    assert!(ecmsk::link::keys::help().contains(":objects@FILE"));
    assert!(of("drive:objekts@a").unwrap_err().to_string().contains("objects@FILE|any"));
}

/// SK-7.47 A file of objects that is invalid, or is not a regular file, is refused when the simulated board is made; the error
/// names the line.
#[test]
fn an_invalid_objects_file_is_refused_with_its_line() {
    let open = |file: &str| Ecm::open(&format!("sim:?slaves=drive:objects@{file}&clock=virtual")).err().expect("wrong");
    let wrong = text("wrong.objects", "0x2000:0 u16 rw 1\n\n0x2001:0 u24 rw 1\n");
    let error = open(&wrong).to_string();
    assert!(error.contains(&wrong) && error.contains("line 3") && error.contains("no TYPE"), "{error}");
    assert!(open("no/such.objects").to_string().contains("no/such.objects"));
    #[cfg(unix)]
    assert!(open("/dev/zero").to_string().contains("a device"));
}

/// SK-7.47 A program on a board with a file of objects writes objects of its drive and goes on.
#[test]
fn a_program_writes_manufacturer_objects_of_a_drive() {
    let file = text("board.objects", OBJECTS);
    let ecm = Ecm::open(&format!("sim:?slaves=drive:objects@{file},drive&clock=virtual")).unwrap();
    assert_eq!(ecm.sdo_read::<u16>(1, at(0x2000, 0)), Ok(0x12));
    ecm.sdo_write(1, at(0x2101, 1), -77i32).unwrap();
    assert_eq!(ecm.sdo_read::<i32>(1, at(0x2101, 1)), Ok(-77));
    let code = AbortCode::NO_OBJECT;
    assert!(
        matches!(ecm.sdo_write(2, at(0x2000, 0), 1u16), Err(EcmError::SdoAborted { code: found, .. }) if found == code)
    );
}

/// `objects from-drive` prints the readable objects of a drive, and a simulated drive with that file answers the same.
#[test]
fn a_simulated_drive_with_the_objects_of_a_drive_answers_the_same() {
    let file = text("original.objects", OBJECTS);
    let link = format!("sim:?slaves=io,drive:objects@{file}&clock=virtual");
    let range = ["--range", "0x2000..0x2300", "--range", "0x6098..0x609A"];
    let dump = |link: &str| run(["objects", "from-drive", link, "2"].into_iter().chain(range));
    let ran = dump(&link);
    assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""), "{}", ran.out);
    let lines: Vec<&str> = ran.out.lines().skip(1).collect();
    let makers = ["0x2000:0 any rw 0x12", "0x2101:0 any rw 0x2", "0x2101:1 any rw 0xFFFFFFFB", "0x2101:2 any wo 0x0"];
    assert_eq!(lines[..4], makers, "{}", ran.out);
    assert_eq!(lines[4], "0x220A:0 any rw 0x1");
    assert!(lines.iter().any(|line| line.starts_with("0x6099:2 ")), "{}", ran.out);
    let copy = text("copy.objects", &ran.out);
    let again = dump(&format!("sim:?slaves=io,drive:objects@{copy}&clock=virtual"));
    assert_eq!(again.out.lines().skip(1).collect::<Vec<_>>(), lines);
    let absent = run(["objects", "from-drive", &link, "3", "--range", "0x2000"]);
    assert!(absent.code == Some(1) && absent.err.contains("slave 3"), "{}", absent.err);
}

pub const ESI: &str = r##"<?xml version="1.0"?>
<EtherCATInfo><Descriptions><Devices>
<Device><Type ProductCode="#x1">Other</Type><Name>Another one</Name></Device>
<Device><Type ProductCode="#x00001234" RevisionNo="#x1">SV2</Type><Name>Servo two</Name><Profile><Dictionary>
<DataTypes>
<DataType><Name>UINT</Name><BitSize>16</BitSize></DataType>
<DataType><Name>DT2101</Name><BitSize>64</BitSize>
<SubItem><SubIdx>0</SubIdx><Name>SubIndex 000</Name><Type>USINT</Type><BitSize>8</BitSize><BitOffs>0</BitOffs><Flags><Access>ro</Access></Flags></SubItem>
<SubItem><SubIdx>1</SubIdx><Name>Offset</Name><Type>DINT</Type><BitSize>32</BitSize><BitOffs>16</BitOffs><Flags><Access>rw</Access></Flags></SubItem>
<SubItem><SubIdx>3</SubIdx><Name>Key</Name><Type>UINT</Type><BitSize>16</BitSize><BitOffs>48</BitOffs><Flags><Access>wo</Access></Flags></SubItem>
</DataType>
<DataType><Name>DT2200ARR</Name><BaseType>UINT</BaseType><BitSize>32</BitSize><ArrayInfo><LBound>1</LBound><Elements>2</Elements></ArrayInfo></DataType>
<DataType><Name>DT2200</Name><BitSize>48</BitSize>
<SubItem><SubIdx>0</SubIdx><Name>Count</Name><Type>USINT</Type><BitSize>8</BitSize><BitOffs>0</BitOffs><Flags><Access>ro</Access></Flags></SubItem>
<SubItem><Name>Elements</Name><Type>DT2200ARR</Type><BitSize>32</BitSize><BitOffs>16</BitOffs><Flags><Access>rw</Access></Flags></SubItem>
</DataType>
</DataTypes>
<Objects>
<Object><Index>#x2000</Index><Name>Motor code</Name><Type>UINT</Type><BitSize>16</BitSize><Info><DefaultData>1200</DefaultData></Info><Flags><Access>rw</Access></Flags></Object>
<Object><Index>#x2101</Index><Name>Encoder</Name><Type>DT2101</Type><BitSize>64</BitSize><Info>
<SubItem><Name>SubIndex 000</Name><Info><DefaultData>03</DefaultData></Info></SubItem>
<SubItem><Name>Offset</Name><Info><DefaultValue>-5</DefaultValue></Info></SubItem>
<SubItem><Name>Key</Name><Info><DefaultData>0000</DefaultData></Info></SubItem></Info><Flags><Access>ro</Access></Flags></Object>
<Object><Index>#x2200</Index><Name>Gains</Name><Type>DT2200</Type><BitSize>48</BitSize><Info>
<SubItem><Name>Count</Name><Info><DefaultData>02</DefaultData></Info></SubItem>
<SubItem><Name>Elements 1</Name><Info><DefaultData>6400</DefaultData></Info></SubItem>
<SubItem><Name>Elements 2</Name><Info><DefaultData>C800</DefaultData></Info></SubItem></Info></Object>
<Object><Index>#x1008</Index><Name>Device name</Name><Type>STRING(4)</Type><BitSize>32</BitSize><Info><DefaultData>53563220</DefaultData></Info></Object>
</Objects></Dictionary></Profile></Device>
</Devices></Descriptions></EtherCATInfo>
"##;

/// `objects from-esi` prints the objects of a device of an ESI file: plain ones, records, arrays, with types,
/// access and defaults, as a link takes them.
#[test]
fn from_an_esi_file() {
    let esi = text("sv2.xml", ESI);
    for device in [&[][..], &["--device", "sv2"], &["--device", "Servo two"], &["--device", "0x1234"]] {
        let ran = run(["objects", "from-esi", &esi].iter().chain(device));
        assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""));
        let lines: Vec<&str> = ran.out.lines().skip(1).collect();
        assert_eq!(
            lines,
            [
                "0x1008:0 text ro 0x20325653 Device name",
                "0x2000:0 u16 rw 0x12 Motor code",
                "0x2101:0 u8 ro 0x3 Encoder: SubIndex 000",
                "0x2101:1 i32 rw 0xFFFFFFFB Encoder: Offset",
                "0x2101:3 u16 wo 0x0 Encoder: Key",
                "0x2200:0 u8 ro 0x2 Gains: Count",
                "0x2200:1 u16 rw 0x64 Gains: Elements 1",
                "0x2200:2 u16 rw 0xC8 Gains: Elements 2",
            ]
        );
        let objects = ManufacturerObjects::parse(&ran.out).expect("what it prints is what a link takes");
        assert_eq!(objects.objects().len(), lines.len());
    }
}

/// A sub-index that a type repeats is one object, by its first entry: a small file makes no large list.
#[test]
fn a_sub_index_counts_once() {
    let elements = ESI.lines().find(|line| line.contains("<Name>Elements</Name>")).unwrap();
    let again =
        elements.replace("<Name>Elements</Name>", "<SubIdx>1</SubIdx><Name>Again</Name>").replace("DT2200ARR", "DINT");
    let esi = text("again.xml", &ESI.replace(elements, &format!("{elements}{again}{elements}")));
    let ran = run(["objects", "from-esi", &esi]);
    let lines: Vec<&str> = ran.out.lines().filter(|line| line.starts_with("0x2200:")).collect();
    let [count, first, second] = lines[..] else { panic!("{lines:?}") };
    assert!(count.ends_with("Gains: Count"));
    assert_eq!((first, second), ("0x2200:1 u16 rw 0x64 Gains: Elements 1", "0x2200:2 u16 rw 0xC8 Gains: Elements 2"));
}

/// A file that is no ESI file, has no dictionary or another device is refused with the next step.
#[test]
fn a_file_that_is_no_esi_file_is_refused_with_the_next_step() {
    for (name, content, device, words) in [
        ("no.xml", "0x2000:0 u16 rw 1\n", None, "it is no XML"),
        ("empty.xml", "<EtherCATInfo/>", None, "no device with a dictionary"),
        ("other.xml", ESI, Some("SV3"), "allowed: SV2"),
        ("index.xml", &ESI.replace("#x2101<", "what<"), None, "line 20: an Object without an Index"),
        (
            "two.xml",
            &ESI.replace("<Device><Type ProductCode=\"#x1\">Other</Type><Name>Another one</Name></Device>", &{
                let from = ESI.find("<Device><Type ProductCode=\"#x00001234\"").unwrap();
                let to = ESI.rfind("</Devices>").unwrap();
                ESI[from..to].replace(">SV2<", ">SV1<")
            }),
            None,
            "--device: SV1, SV2",
        ),
    ] {
        let file = text(name, content);
        let named = device.map_or(vec![], |device| vec!["--device", device]);
        let ran = run(["objects", "from-esi", &file].into_iter().chain(named));
        assert_eq!(ran.code, Some(1), "{name}");
        assert!(ran.err.contains(words) && ran.err.contains(&file), "{name}: {}", ran.err);
    }
    let ran = run(["objects", "from-esi", "no/such.xml"]);
    assert!(ran.code == Some(1) && ran.err.contains("no/such.xml"), "{}", ran.err);
}

/// An ESI file of a device with a text of 24 letters, an output and an input, which declares `encoding`.
fn encoded(encoding: &str) -> String {
    format!(
        r##"<?xml version="1.0" encoding="{encoding}"?>
<EtherCATInfo><Vendor><Id>#x1234</Id><Name>Pr\u{{FC}}fwerk</Name></Vendor><Descriptions><Devices>
<Device><Type ProductCode="#x5678">PW-1</Type><Name>Servo 1\u{{B5}}s</Name><Profile><Dictionary>
<DataTypes><DataType><Name>STRING(24)</Name><BitSize>192</BitSize></DataType>
<DataType><Name>BITARR16</Name><BitSize>16</BitSize></DataType></DataTypes>
<Objects>
<Object><Index>#x2010</Index><Name>Nickname</Name><Type>STRING(24)</Type><BitSize>192</BitSize><Info><DefaultString>twenty-four<!-- a remark --> letters long</DefaultString></Info><Flags><Access>rw</Access></Flags></Object>
<Object><Index>#x2011</Index><Name>Pr\u{{FC}}fer</Name><Type>STRING(24)</Type><BitSize>192</BitSize><Info><DefaultString>Pr\u{{FC}}fwerk in Gr\u{{FC}}nwald</DefaultString></Info></Object>
<Object><Index>#x2012</Index><Name>Bytes</Name><Type>ARRAY [0..9] OF BYTE</Type><BitSize>80</BitSize><Info><DefaultData>00010203040506070809</DefaultData></Info></Object>
<Object><Index>#x2020</Index><Name>Out</Name><Type>UINT</Type><BitSize>16</BitSize><Flags><Access>rw</Access><PdoMapping>R</PdoMapping></Flags></Object>
<Object><Index>#x2021</Index><Name>Both</Name><Type>UINT</Type><BitSize>16</BitSize><Flags><Access>rw</Access><PdoMapping>TR</PdoMapping></Flags></Object>
<Object><Index>#x2022</Index><Name>In</Name><Type>BITARR16</Type><BitSize>16</BitSize><Flags><Access>ro</Access></Flags></Object>
</Objects></Dictionary></Profile>
<TxPdo><Index>#x1A00</Index><Entry><Index>#x2022</Index><SubIndex>0</SubIndex><BitLen>16</BitLen></Entry><Entry><Index>0</Index><BitLen>8</BitLen></Entry></TxPdo>
</Device></Devices></Descriptions></EtherCATInfo>
"##
    )
    .replace("\\u{FC}", "\u{FC}")
    .replace("\\u{B5}", "\u{B5}")
}

/// ESI files are read in the encoding that they have or declare; texts are whole; objects that can be mapped by the
/// dictionary or the device's PDOs are marked.
#[test]
fn esi_files_in_other_encodings_with_long_texts() {
    let latin = |text: String| text.chars().map(|letter| u8::try_from(letter).expect("latin")).collect::<Vec<u8>>();
    let wide = |text: String, bytes: fn(u16) -> [u8; 2]| text.encode_utf16().flat_map(bytes).collect::<Vec<u8>>();
    let files: [(&str, Vec<u8>); 6] = [
        ("utf8.xml", encoded("UTF-8").into_bytes()),
        ("marked.xml", [b"\xEF\xBB\xBF", encoded("UTF-8").as_bytes()].concat()),
        ("latin1.xml", latin(encoded("ISO-8859-1"))),
        ("cp1252.xml", latin(encoded("windows-1252"))),
        ("utf16le.xml", [b"\xFF\xFE".to_vec(), wide(encoded("UTF-16"), u16::to_le_bytes)].concat()),
        ("utf16be.xml", [b"\xFE\xFF".to_vec(), wide(encoded("UTF-16"), u16::to_be_bytes)].concat()),
    ];
    let folder = tempfile::tempdir().expect("a folder");
    for (name, bytes) in files {
        let file = folder.path().join(name);
        std::fs::write(&file, bytes).expect("a file");
        let ran = run(["objects", "from-esi", file.to_str().expect("UTF-8")]);
        assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""), "{name}");
        let lines: Vec<&str> = ran.out.lines().skip(1).collect();
        let expected = [
            "0x2010:0 text rw \"twenty-four letters long\" Nickname",
            "0x2011:0 text ro \"Pr\\xFCfwerk in Gr\\xFCnwald\" Pr\u{FC}fer",
            "0x2012:0 text ro \"\\x00\\x01\\x02\\x03\\x04\\x05\\x06\\x07\\x08\\x09\" Bytes",
            "0x2020:0 u16 rw rx 0x0 Out",
            "0x2021:0 u16 rw rxtx 0x0 Both",
            "0x2022:0 u16 ro tx 0x0 In",
        ];
        assert_eq!(lines, expected, "{name}");
        ManufacturerObjects::parse(&ran.out).expect("what it prints is what a link takes");
    }
    let wrong = folder.path().join("wrong.xml");
    std::fs::write(&wrong, latin(encoded("UTF-8"))).expect("a file");
    let ran = run(["objects", "from-esi", wrong.to_str().expect("UTF-8")]);
    assert!(
        ran.code == Some(1) && ran.err.contains("no text in UTF-8") && ran.err.contains("encoding="),
        "{}",
        ran.err
    );
}

/// An element of an ESI file with very many attributes is read like any other; a repeated attribute is refused with its line.
#[test]
fn very_many_attributes_are_read() {
    let many: String = (0..80_000).map(|n| format!(" a{n}=\"{n}\"")).collect();
    let esi = ESI.replace("<Type ProductCode=\"#x00001234\"", &format!("<Type{many} ProductCode=\"#x00001234\""));
    let file = text("many.xml", &esi);
    let ran = run(["objects", "from-esi", &file, "--device", "0x1234"]);
    assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""));
    assert!(ran.out.contains("0x2000:0 u16 rw 0x12 Motor code"), "{}", ran.out);
    let twice = text("twice.xml", &esi.replace(" a79999=", " a7="));
    let ran = run(["objects", "from-esi", &twice]);
    assert!(ran.code == Some(1) && ran.err.contains("line 4: the attribute a7 stands twice"), "{}", ran.err);
}

mod needs_valgrind {
    use std::process::Command;

    use super::{ESI, text};
    use crate::common::ecmsk;

    /// The instructions of `objects from-esi` for a file with that many attributes in an element, as valgrind counts them: however
    /// busy the machine is, their number is the same.
    fn instructions(attributes: usize) -> u64 {
        let many: String = (0..attributes).map(|n| format!(" a{n}=\"{n}\"")).collect();
        let esi = ESI.replace("<Type ProductCode=\"#x00001234\"", &format!("<Type{many} ProductCode=\"#x00001234\""));
        let file = text(&format!("attributes_{attributes}.xml"), &esi);
        let tool = ecmsk(["objects", "from-esi", &file, "--device", "0x1234"]);
        let mut command = Command::new("valgrind");
        command.args(["--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null"]);
        command.arg(tool.get_program()).args(tool.get_args());
        let ran = command.output().expect("valgrind; `apt-get install valgrind`, or skip the modules needs_valgrind");
        let told = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.success(), "{told}");
        let refs = told.lines().find(|line| line.contains(" refs:")).unwrap_or_else(|| panic!("no count in {told}"));
        let count = refs.rsplit_once(' ').expect("a number").1.replace(',', "");
        count.parse().unwrap_or_else(|error| panic!("{refs}: {error}"))
    }

    /// An element of an ESI file is read in a time that grows as the number of its attributes: four times as many take about
    /// four times as many instructions, and not sixteen times as many.
    #[test]
    fn each_attribute_costs_the_same() {
        let [none, some, many] = [0, 20_000, 80_000].map(instructions);
        let (some, many) = (some - none, many - none);
        assert!(many < 5 * some, "{some} for 20,000 attributes, {many} for 80,000");
    }
}
