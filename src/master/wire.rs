//! The interface below the master: sends and receives frames.

use crate::ethercat::FRAME_LEN_MAX;

/// A buffer with room for any frame.
pub type FrameBuffer = [u8; FRAME_LEN_MAX];

/// A connection to the slaves, such as a network card. Its calls never block.
pub trait Wire {
    /// Sends a frame at once. The frame has no frame check sequence (FCS), which the network card appends.
    ///
    /// # Errors
    /// [`WireDown`]: the frame was not sent.
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown>;

    /// Copies the next received frame into `buffer` and returns its length; `None`: no frame is waiting.
    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize>;
}

/// A frame could not be sent: the interface is down, or its queue is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the frame was not sent; check the cable and the interface")]
pub struct WireDown;
