//! The FIFOs of process data: their capacity and memory, and the fill levels at which they raise interrupts.

use crate::xf::Interrupts;
use crate::xf::request::{FIFO_ENTRIES, FifoThresholdSet};

/// Size of the memory for both FIFOs together, in bytes (XF EN 1236).
pub const FIFO_MEMORY: usize = 0x4000;
/// The largest capacity of a FIFO, in entries (OBS).
pub const FIFO_ENTRIES_MAX: u8 = 128;

/// A ring buffer of entries of equal size in a fixed memory.
struct Ring {
    memory: Vec<u8>,
    entry_bytes: usize,
    entries: usize,
    first: usize,
    len: usize,
}

impl Ring {
    fn new() -> Self {
        Self { memory: vec![0; FIFO_MEMORY], entry_bytes: 0, entries: 0, first: 0, len: 0 }
    }

    fn build(&mut self, entry_bytes: usize, entries: usize) {
        (self.entry_bytes, self.entries, self.first, self.len) = (entry_bytes, entries, 0, 0);
    }

    const fn clear(&mut self) {
        (self.first, self.len) = (0, 0);
    }

    fn slot(&self, place: usize) -> std::ops::Range<usize> {
        let at = (self.first + place) % self.entries * self.entry_bytes;
        at..at + self.entry_bytes
    }

    /// Appends an entry; returns false if the ring buffer is full.
    fn push(&mut self, entry: &[u8]) -> bool {
        if self.len >= self.entries {
            return false;
        }
        let slot = self.slot(self.len);
        self.memory[slot].copy_from_slice(entry);
        self.len += 1;
        true
    }

    fn pop(&mut self) -> Option<&[u8]> {
        if self.len == 0 {
            return None;
        }
        let slot = self.slot(0);
        self.first = (self.first + 1) % self.entries;
        self.len -= 1;
        Some(&self.memory[slot])
    }
}

/// The RxFIFO, with outputs that wait for their cycle, and the TxFIFO, with inputs that wait for the host.
pub(super) struct Fifos {
    rx: Ring,
    tx: Ring,
    /// The capacity of the RxFIFO in entries that the host has set; it applies when the FIFOs are next built.
    pub rx_entries: u8,
    /// The capacity of the TxFIFO in entries that the host has set; it applies when the FIFOs are next built.
    pub tx_entries: u8,
    pub thresholds: FifoThresholdSet,
}

impl Fifos {
    pub fn new() -> Self {
        Self {
            rx: Ring::new(),
            tx: Ring::new(),
            rx_entries: FIFO_ENTRIES,
            tx_entries: FIFO_ENTRIES,
            thresholds: FifoThresholdSet { tx_high: None, rx_low: None },
        }
    }

    /// Resets the FIFOs as at power-on: they are empty, without process data. Their memory stays allocated.
    pub fn reset(&mut self) {
        self.build_none();
        (self.rx_entries, self.tx_entries) = (FIFO_ENTRIES, FIFO_ENTRIES);
        self.thresholds = FifoThresholdSet { tx_high: None, rx_low: None };
    }

    fn build_none(&mut self) {
        self.rx.build(0, 0);
        self.tx.build(0, 0);
    }

    /// Divides the memory between both FIFOs, empty, for PDOs of these lengths. Returns false if they need more than
    /// [`FIFO_MEMORY`]; then both have no capacity.
    pub fn build(&mut self, rx_bytes: u16, tx_bytes: u16) -> bool {
        let (rx, tx) = (usize::from(self.rx_entries), usize::from(self.tx_entries));
        let fits = rx * usize::from(rx_bytes) + tx * usize::from(tx_bytes) <= FIFO_MEMORY;
        if fits {
            self.rx.build(rx_bytes.into(), rx);
            self.tx.build(tx_bytes.into(), tx);
        } else {
            self.build_none();
        }
        fits
    }

    pub const fn clear_rx(&mut self) {
        self.rx.clear();
    }

    pub const fn clear_tx(&mut self) {
        self.tx.clear();
    }

    /// The numbers of entries in the RxFIFO and in the TxFIFO.
    pub const fn counts(&self) -> (u8, u8) {
        (self.rx.len as u8, self.tx.len as u8)
    }

    /// Adds an RxPDO of the host. Returns false if it is lost, because the FIFO is full (XF EN 1262) or the length is wrong.
    pub fn push_rx(&mut self, pdo: &[u8]) -> bool {
        pdo.len() == self.rx.entry_bytes && self.rx.push(pdo)
    }

    /// Takes the RxPDO of a cycle, if there is one, into the beginning of `image`. Returns the low-level interrupt if the FIFO
    /// has fallen to its threshold.
    pub fn pop_rx(&mut self, image: &mut [u8]) -> Interrupts {
        let Some(pdo) = self.rx.pop() else { return Interrupts::NONE };
        image[..pdo.len()].copy_from_slice(pdo);
        let falls = self.thresholds.rx_low.is_some_and(|limit| usize::from(limit) == self.rx.len);
        if falls { Interrupts::RX_FIFO_LOW } else { Interrupts::NONE }
    }

    /// Adds the TxPDO of a cycle; a full FIFO loses its oldest entry (XF EN 1236). Returns the high-level interrupt if the FIFO
    /// has risen to its threshold.
    pub fn push_tx(&mut self, pdo: &[u8]) -> Interrupts {
        if self.tx.entries == 0 || pdo.len() != self.tx.entry_bytes {
            return Interrupts::NONE;
        }
        let was = self.tx.len;
        if was == self.tx.entries {
            self.tx.pop();
        }
        self.tx.push(pdo);
        let rises = self.thresholds.tx_high.is_some_and(|limit| usize::from(limit) == self.tx.len);
        if rises && was < self.tx.len { Interrupts::TX_FIFO_HIGH } else { Interrupts::NONE }
    }

    /// Takes the oldest TxPDO into the beginning of `data`; returns false if there is none, or if it does not fit.
    pub fn pop_tx(&mut self, data: &mut [u8]) -> bool {
        if data.len() < self.tx.entry_bytes {
            return false;
        }
        let Some(pdo) = self.tx.pop() else { return false };
        data[..pdo.len()].copy_from_slice(pdo);
        true
    }
}
