//! The seam below the master: frames out, frames in.

use crate::ethercat::FRAME_LEN_MAX;

/// A buffer for any frame.
pub type FrameBuffer = [u8; FRAME_LEN_MAX];

/// A way to the slaves, such as a network card. It never blocks.
pub trait Wire {
    /// Sends a frame, without its check sequence, at once.
    ///
    /// # Errors
    /// [`WireDown`]: the frame was not sent.
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown>;

    /// Puts the next frame that has come into `buffer` and gives its length; `None`: no frame is waiting.
    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize>;
}

/// A frame could not be sent: the interface is down, or its queue is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the frame was not sent; check the cable and the interface")]
pub struct WireDown;
