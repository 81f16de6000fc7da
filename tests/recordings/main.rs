//! Recordings of this project and captures of real boards: read, compared, and replayed to the model.

mod any;
mod compare;
mod page;
mod reader;
mod replay;
