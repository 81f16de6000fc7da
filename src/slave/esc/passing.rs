//! The datagrams of a frame while it passes slaves: decoded once for all of them, and put back at the end.

use crate::ethercat::{DATAGRAM_HEADER_LEN, DATAGRAM_OVERHEAD, DatagramHeader, Datagrams, FRAME_HEADER_LEN};

/// The most datagrams that a frame can say it has.
const DATAGRAMS_MAX: usize = DatagramHeader::LEN_MAX as usize / DATAGRAM_OVERHEAD;

/// A datagram that passes.
#[derive(Clone, Copy, Debug)]
struct Datagram {
    /// The header as the slaves so far have left it.
    header: DatagramHeader,
    /// Where its data begin in the frame.
    data: usize,
    /// What the slaves so far have added to its working counter.
    counts: u16,
}

/// The datagrams of the frame that passes.
#[derive(Debug)]
pub(super) struct Passing {
    datagrams: Vec<Datagram>,
}

impl Default for Passing {
    /// With room for any frame.
    fn default() -> Self {
        Self { datagrams: Vec::with_capacity(DATAGRAMS_MAX) }
    }
}

impl Passing {
    /// A frame with these datagrams, or with none, begins to pass. False: they do not fit into it, and none of them passes.
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

    /// The datagrams pass a slave, which changes their headers and their data and says what their working counters count.
    pub(super) fn each(&mut self, frame: &mut [u8], mut pass: impl FnMut(&mut DatagramHeader, &mut [u8]) -> u16) {
        for Datagram { header, data, counts } in &mut self.datagrams {
            let len = usize::from(header.len);
            *counts = counts.wrapping_add(pass(header, &mut frame[*data..][..len]));
        }
    }

    /// The frame turns round at a port 0 that is closed, which may happen once (ETG.1000.4, the circulating bit). False: it has
    /// happened before.
    pub(super) fn begin_to_circulate(&mut self) -> bool {
        let circulates = self.datagrams.iter().any(|datagram| datagram.header.circulating);
        self.datagrams.iter_mut().for_each(|datagram| datagram.header.circulating = true);
        !circulates
    }

    /// All slaves were passed: what they have changed is put into the frame.
    pub(super) fn end(&self, frame: &mut [u8]) {
        for Datagram { header, data, counts } in &self.datagrams {
            frame[data - DATAGRAM_HEADER_LEN..][..DATAGRAM_HEADER_LEN].copy_from_slice(&header.encode());
            if let Some(counter) = frame[data + usize::from(header.len)..].first_chunk_mut() {
                *counter = u16::from_le_bytes(*counter).wrapping_add(*counts).to_le_bytes();
            }
        }
    }
}
