//! The simulated bus, driven as the engine drives it.

mod jobs;
mod sim;
