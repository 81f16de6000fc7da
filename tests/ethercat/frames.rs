//! Frames and datagrams.

use ecmsk::ethercat::{
    Addressing, Command, Datagram, DatagramHeader, Frame, FrameHeader, FrameWriter, Protocol, WireError, each_datagram,
    mark_as_passed,
};
use proptest::prelude::*;

const SOURCE: [u8; 6] = [0x10, 0x10, 0x10, 0x10, 0x10, 0x10];

/// A BRD of two bytes from the AL status, as masters send it, padded to the shortest frame.
fn brd_frame() -> Vec<u8> {
    let mut bytes = vec![0xFF; 6];
    bytes.extend(SOURCE);
    bytes.extend([0x88, 0xA4, 0x0E, 0x10]);
    bytes.extend([0x07, 0x2A, 0x00, 0x00, 0x30, 0x01, 0x02, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00]);
    bytes.resize(60, 0);
    bytes
}

fn command() -> impl Strategy<Value = Command> {
    prop_oneof![0u8..15, any::<u8>()].prop_map(Command::from_code)
}

fn header() -> impl Strategy<Value = DatagramHeader> {
    let fields =
        (command(), any::<u8>(), any::<u32>(), 0u16..=2047, 0u8..8, any::<bool>(), any::<bool>(), any::<u16>());
    fields.prop_map(|(command, index, address, len, reserved, circulating, more, irq)| DatagramHeader {
        command,
        index,
        address,
        len,
        reserved,
        circulating,
        more,
        irq,
    })
}

/// ECAT-1.1, ECAT-1.2 The bytes of a frame with one datagram are where the standard has them, both ways.
#[test]
fn a_frame_with_one_datagram_byte_by_byte() {
    let mut buffer = [0xA5; 100];
    let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams(SOURCE)).expect("room");
    frame.push(DatagramHeader::register(Command::Brd, 0x2A, 0, 0x0130), &[0, 0]).expect("room");
    assert_eq!(frame.finish(), brd_frame());

    let bytes = brd_frame();
    let frame = Frame::decode(&bytes).expect("a frame");
    assert_eq!((frame.header.source, frame.header.protocol, frame.payload.len()), (SOURCE, Protocol::Datagrams, 14));
    let datagrams: Vec<_> = frame.datagrams().expect("datagrams").collect();
    let header = DatagramHeader { len: 2, ..DatagramHeader::register(Command::Brd, 0x2A, 0, 0x0130) };
    assert_eq!(datagrams, [Ok(Datagram { header, data: &[0, 0], working_counter: 0 })]);
    assert_eq!((header.adp(), header.ado(), header.with_adp(0xFFFE).address), (0, 0x0130, 0x0130_FFFE));
}

/// ECAT-1.3 All 15 commands have their code, their abbreviation and their addressing; other codes survive.
#[test]
fn commands_by_their_codes() {
    use Addressing::*;
    let table = [
        ("NOP", None),
        ("APRD", Position),
        ("APWR", Position),
        ("APRW", Position),
        ("FPRD", Node),
        ("FPWR", Node),
        ("FPRW", Node),
        ("BRD", Broadcast),
        ("BWR", Broadcast),
        ("BRW", Broadcast),
        ("LRD", Logical),
        ("LWR", Logical),
        ("LRW", Logical),
        ("ARMW", Position),
        ("FRMW", Node),
    ];
    for (code, (name, addressing)) in table.into_iter().enumerate() {
        let command = Command::from_code(code as u8);
        assert_eq!((command.name(), command.addressing(), command.code()), (name, addressing, code as u8));
        assert_eq!(Command::ALL[code], command);
    }
    for code in 15..=255 {
        let command = Command::from_code(code);
        assert_eq!((command, command.code(), command.addressing()), (Command::Unknown(code), code, None));
    }
}

/// ECAT-1.4 Several datagrams follow each other; all but the last one say that others follow.
#[test]
fn datagrams_follow_each_other() {
    let mut buffer = [0xA5; 1514];
    let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams(SOURCE)).expect("room");
    for n in 0..15 {
        // The caller's `more` bit is ignored.
        let header = DatagramHeader { more: n % 2 == 0, ..DatagramHeader::new(Command::Lrw, n, u32::from(n) * 100) };
        frame.push(header, &[n; 20][..usize::from(n)]).expect("room");
    }
    let bytes = frame.finish();
    assert_eq!(bytes.len(), 16 + 15 * 12 + 105);
    let datagrams = Frame::decode(bytes).expect("a frame").datagrams().expect("datagrams");
    let all: Vec<Datagram<'_>> = datagrams.map(|datagram| datagram.expect("whole")).collect();
    assert_eq!(all.len(), 15);
    for (n, datagram) in all.iter().enumerate() {
        assert_eq!((datagram.header.more, datagram.header.index), (n < 14, n as u8));
        assert_eq!(datagram.data, vec![n as u8; n]);
    }
}

/// ECAT-1.5 A frame ends where its EtherCAT header says; what follows is padding, and a frame that is shorter is an error.
#[test]
fn the_length_of_a_frame_is_that_of_its_header() {
    let mut bytes = brd_frame();
    bytes[30..].fill(0xEE);
    assert_eq!(Frame::decode(&bytes).map(|frame| frame.payload.len()), Ok(14));
    assert_eq!(Frame::decode(&bytes[..30]).map(|frame| frame.payload.len()), Ok(14));
    let short = WireError::Short { part: "payload of a frame", needed: 14, found: 13 };
    assert_eq!(Frame::decode(&bytes[..29]), Err(short));
    let short = WireError::Short { part: "headers of a frame", needed: 16, found: 15 };
    assert_eq!(Frame::decode(&bytes[..15]), Err(short));
    assert_eq!(short.to_string(), "headers of a frame has 16 bytes, and only 15 are there");
}

/// ECAT-1.5 A datagram that is longer than the rest of its frame is an error, and so is one that is announced but
/// missing.
#[test]
fn datagrams_that_claim_too_much_are_errors() {
    let mut bytes = brd_frame();
    bytes[22] = 3;
    let all =
        |bytes: &[u8]| Frame::decode(bytes).expect("a frame").datagrams().expect("some").collect::<Vec<_>>().len();
    let frame = Frame::decode(&bytes).expect("a frame");
    let only = frame.datagrams().and_then(|mut all| all.next()).expect("an item");
    assert!(matches!(only, Err(WireError::Short { .. })), "{only:?}");
    assert_eq!(all(&bytes), 1);
    let error = each_datagram(&mut bytes, |_| panic!("it is not whole")).expect_err("too long");
    assert_eq!(error, WireError::Short { part: "datagram", needed: 15, found: 14 });

    let mut bytes = brd_frame();
    bytes[23] = 0x80;
    let frame = Frame::decode(&bytes).expect("a frame");
    let items: Vec<_> = frame.datagrams().expect("some").collect();
    assert!(matches!(items[..], [Ok(_), Err(WireError::Short { part: "datagram header", .. })]), "{items:?}");
}

/// ECAT-1.6 Another EtherType is no frame of EtherCAT; network variables and others are frames without datagrams.
#[test]
fn other_frames_have_no_datagrams() {
    let mut bytes = brd_frame();
    bytes[13] = 0xA5;
    let wrong = WireError::Field { part: "EtherType", found: 0x88A5, allowed: "0x88A4" };
    assert_eq!(Frame::decode(&bytes), Err(wrong));
    assert_eq!(wrong.to_string(), "EtherType is 34981 (0x88A5), allowed is 0x88A4");
    for (code, protocol) in [(4, Protocol::NetworkVariables), (5, Protocol::MailboxGateway), (9, Protocol::Unknown(9))]
    {
        let mut bytes = brd_frame();
        bytes[15] = code << 4;
        let frame = Frame::decode(&bytes).expect("a frame");
        assert_eq!((frame.header.protocol, frame.datagrams().is_none()), (protocol, true));
    }
}

/// ECAT-1.7 One datagram has 1486 bytes at most; a datagram that does not fit into a frame is an error, and the frame
/// does not change.
#[test]
fn a_frame_takes_what_ethernet_takes() {
    let mut buffer = [0xA5; 4000];
    let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams(SOURCE)).expect("room");
    assert_eq!(frame.room(), Some(1486));
    let header = DatagramHeader::new(Command::Lrw, 1, 0);
    let full = frame.push(header, &[7; 1487]).expect_err("too long");
    assert_eq!(full, WireError::NoRoom { part: "datagram", needed: 1499, room: 1498 });
    assert_eq!(full.to_string(), "datagram has 1499 bytes, and there is room for 1498");
    frame.push(header, &[7; 1486]).expect("room");
    assert_eq!(frame.room(), None);
    assert!(frame.push(header, &[]).is_err());
    let bytes = frame.finish();
    assert_eq!(bytes.len(), 1514);
    let only = Frame::decode(bytes).expect("a frame").datagrams().expect("some").next().expect("one").expect("whole");
    assert_eq!((only.data, only.header.more), (&[7; 1486][..], false));
    assert!(FrameWriter::new(&mut [0; 59], FrameHeader::datagrams(SOURCE)).is_err());
}

/// ECAT-1.8 A datagram is changed in place: address, circulating bit, events, data and working counter, and nothing else.
#[test]
fn a_datagram_is_changed_in_place() {
    let mut bytes = brd_frame();
    each_datagram(&mut bytes, |mut datagram| {
        datagram.set_adp(1);
        datagram.add_events(0x0204);
        datagram.add_events(0x0008);
        datagram.set_circulating();
        datagram.data.copy_from_slice(&[8, 0]);
        datagram.count(3);
        assert_eq!((datagram.working_counter(), datagram.header().adp()), (3, 1));
    })
    .expect("whole");
    let mut expected = brd_frame();
    expected[18] = 1;
    expected[23] = 0x40;
    expected[24..30].copy_from_slice(&[0x0C, 0x02, 8, 0, 3, 0]);
    assert_eq!(bytes, expected);
}

/// ECAT-1.9 A slave that a frame passes sets bit 1 of the first byte of its source, and does not toggle it.
#[test]
fn a_passed_frame_has_another_source() {
    let mut bytes = brd_frame();
    mark_as_passed(&mut bytes);
    mark_as_passed(&mut bytes);
    assert_eq!(Frame::decode(&bytes).expect("a frame").header.source, [0x12, 0x10, 0x10, 0x10, 0x10, 0x10]);
    mark_as_passed(&mut []);
}

proptest! {
    /// ECAT-1.2 A header of a datagram is the same after it was encoded and decoded, whatever its bits are.
    #[test]
    fn headers_of_datagrams_come_back(header in header(), bytes: [u8; 10]) {
        prop_assert_eq!(DatagramHeader::decode(&header.encode()), header);
        prop_assert_eq!(DatagramHeader::decode(&bytes).encode(), bytes);
    }

    /// ECAT-1.1 The headers of a frame are the same after they were decoded and encoded.
    #[test]
    fn headers_of_frames_come_back(mut bytes: [u8; 16]) {
        bytes[12..14].copy_from_slice(&[0x88, 0xA4]);
        prop_assert_eq!(FrameHeader::decode(&bytes).expect("the EtherType is right").encode(), bytes);
    }

    /// ECAT-1.4 Written datagrams are read back.
    #[test]
    fn datagrams_come_back(wanted in proptest::collection::vec((header(), proptest::collection::vec(any::<u8>(), 0..60)), 1..15)) {
        let mut buffer = [0xA5; 1514];
        let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams(SOURCE)).expect("room");
        for (header, data) in &wanted {
            frame.push(*header, data).expect("room");
        }
        let bytes = frame.finish();
        let read: Result<Vec<_>, _> = Frame::decode(bytes).expect("a frame").datagrams().expect("some").collect();
        let read = read.expect("whole");
        prop_assert_eq!(read.len(), wanted.len());
        for (n, (datagram, (header, data))) in read.iter().zip(&wanted).enumerate() {
            let header = DatagramHeader { len: data.len() as u16, more: n + 1 < wanted.len(), ..*header };
            prop_assert_eq!(datagram, &Datagram { header, data, working_counter: 0 });
        }
    }
}
