//! The page that a browser shows: curves over time as on an oscilloscope, the slaves and the events of a board or of a
//! recording.
//!
//! A page consists of the files of `tool/web/`, and shows a [`Hello`](hello::Hello) in JSON and blocks of points of its
//! curves. For a recording, `ecmsk plot -o run.html` puts both into one file (`plot/html.rs`); for a board, `ecmsk serve
//! web` sends them (`serve/web.rs`). docs/WEB.md describes the messages. Files:
//!
//! - `assembly.rs`: one HTML text from the files of `tool/web/`, without a bundler
//! - `hello.rs`: the first message, before points: slaves, names of states, channels, events
//! - `channels.rs`, `codec.rs`: points of channels, and their bytes
//! - `sampler.rs`: points from reports; `events.rs`: events from frames

pub mod assembly;
pub mod channels;
pub mod codec;
pub mod events;
pub mod hello;
pub mod sampler;
