//! The page: a scope, the slaves and the events of a board or of a recording, in a browser.
//!
//! A page consists of the files of `tool/web/`, and shows what a source tells: a [`Hello`](hello::Hello) in JSON, and
//! blocks of points. `ecmsk plot -o run.html` puts both into one file (`plot/html.rs`), `ecmsk serve web` sends them
//! (`serve/web.rs`). docs/WEB.md describes the messages. Files:
//!
//! - `assembly.rs`: one HTML text from the files of `tool/web/`, without a bundler
//! - `hello.rs`: what a page is told before points: slaves, words, channels, events
//! - `channels.rs`, `codec.rs`: points of channels, and their bytes
//! - `sampler.rs`: points from reports; `events.rs`: events from frames

pub mod assembly;
pub mod channels;
pub mod codec;
pub mod events;
pub mod hello;
pub mod sampler;
