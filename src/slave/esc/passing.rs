//! The datagrams of a frame while it passes slaves: decoded once for all slaves, and written back at the end.

use crate::ethercat::{DATAGRAM_HEADER_LEN, DATAGRAM_OVERHEAD, DatagramHeader, Datagrams, FRAME_HEADER_LEN};

/// The maximum number of datagrams in a frame, which the length field of the EtherCAT header limits.
const DATAGRAMS_MAX: usize = DatagramHeader::LEN_MAX as usize / DATAGRAM_OVERHEAD;

/// A datagram of the present frame.
#[derive(Clone, Copy, Debug)]
struct Datagram {
    /// The header, as changed by the slaves so far.
    header: DatagramHeader,
    /// The offset of the data in the frame.
    data: usize,
    /// The sum of the increments of the working counter by the slaves so far.
    counts: u16,
}

/// The datagrams of the present frame.
#[derive(Debug)]
pub(super) struct Passing {
    datagrams: Vec<Datagram>,
}

impl Default for Passing {
    /// Reserves capacity for the datagrams of any frame.
    fn default() -> Self {
        Self { datagrams: Vec::with_capacity(DATAGRAMS_MAX) }
    }
}

impl Passing {
    /// Begins a frame with these datagrams; `None`: the frame has none. Returns false if the datagrams do not fit into the
    /// frame; then slaves get none of them.
    pub(super) fn begin(&mut self, datagrams: Option<Datagrams<'_>>) -> bool {
        self.datagrams.clear();
        let mut at = FRAME_HEADER_LEN;
        for datagram in datagrams.into_iter().flatten() {
            let Ok(datagram) = datagram else {
                self.datagrams.clear();
                return false;
            };
            self.datagrams.push(Datagram { header: datagram.header, data: at + DATAGRAM_HEADER_LEN, counts: 0 });
            at += DATAGRAM_OVERHEAD + datagram.data.len();
        }
        true
    }

    /// Passes the datagrams to a slave. `pass` may change header and data, and returns the increment of the working
    /// counter.
    pub(super) fn each(&mut self, frame: &mut [u8], mut pass: impl FnMut(&mut DatagramHeader, &mut [u8]) -> u16) {
        for Datagram { header, data, counts } in &mut self.datagrams {
            let len = usize::from(header.len);
            *counts = counts.wrapping_add(pass(header, &mut frame[*data..][..len]));
        }
    }

    /// Sets the circulating bits when the frame turns round at a closed port 0. Returns false if they were set already
    /// (ETG.1000.4): such a frame may turn round only once.
    pub(super) fn begin_to_circulate(&mut self) -> bool {
        let circulates = self.datagrams.iter().any(|datagram| datagram.header.circulating);
        self.datagrams.iter_mut().for_each(|datagram| datagram.header.circulating = true);
        !circulates
    }

    /// Ends the frame: writes the changed headers and working counters back.
    pub(super) fn end(&self, frame: &mut [u8]) {
        for Datagram { header, data, counts } in &self.datagrams {
            frame[data - DATAGRAM_HEADER_LEN..][..DATAGRAM_HEADER_LEN].copy_from_slice(&header.encode());
            if let Some(counter) = frame[data + usize::from(header.len)..].first_chunk_mut() {
                *counter = u16::from_le_bytes(*counter).wrapping_add(*counts).to_le_bytes();
            }
        }
    }
}
