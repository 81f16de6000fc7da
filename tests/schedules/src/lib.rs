//! The hand-over of `src/engine/handover.rs`, the same file, on locks whose schedule a test chooses.
//!
//! Shuttle runs each test under many random interleavings and fails on a deadlock; a hang on a machine is a failure
//! here.
#![cfg(test)]

mod fieldbus {
    pub use ecmsk::fieldbus::Ns;
}

mod sk {
    pub use ecmsk::sk::Frame;
}

mod engine;
