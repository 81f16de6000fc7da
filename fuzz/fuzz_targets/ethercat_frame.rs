//! Any bytes as a frame of EtherCAT: datagrams are read as they are changed in place, and written again they are the same.

#![no_main]

use ecmsk::ethercat::{Datagram, FRAME_LEN_MAX, Frame, FrameWriter, each_datagram, mark_as_passed};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let mut bytes = bytes.to_vec();
    let before = bytes.clone();
    let Ok(frame) = Frame::decode(&before) else {
        assert!(each_datagram(&mut bytes, |_| panic!("no frame")).is_err());
        return;
    };
    let read: Result<Vec<Datagram<'_>>, _> = frame.datagrams().into_iter().flatten().collect();
    let mut visited = Vec::new();
    let result = each_datagram(&mut bytes, |datagram| visited.push((datagram.header(), datagram.working_counter())));
    assert_eq!(bytes, before, "looking changes nothing");
    if frame.datagrams().is_some() {
        assert_eq!(result.is_ok(), read.is_ok());
    }
    if let Ok(read) = read
        && bytes.len() <= FRAME_LEN_MAX
        && frame.datagrams().is_some()
    {
        assert!(visited.iter().eq(read.iter().map(|one| (one.header, one.working_counter)).collect::<Vec<_>>().iter()));
        let mut buffer = [0xA5; FRAME_LEN_MAX];
        let mut again = FrameWriter::new(&mut buffer, frame.header).expect("room");
        for datagram in &read {
            again.push(datagram.header, datagram.data).expect("room");
        }
        let again = Frame::decode(again.finish()).expect("a frame").datagrams().expect("datagrams");
        for (datagram, again) in read.iter().zip(again) {
            assert_eq!(Datagram { working_counter: 0, ..*datagram }, again.expect("whole"));
        }
    }
    mark_as_passed(&mut bytes);
});
