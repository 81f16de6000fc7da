//! Links: their URIs and configuration, boards in the process, scripts, faults, and writing and reading of recordings.
//!
//! Files:
//!
//! - `config.rs`: which link is opened when a program names none
//! - `uri.rs`, `travel.rs`: the URI, its keys, and the travel of simulated axes
//! - `in_build.rs`: the schemes that a build opens, and the tables of features
//! - `chip_usb.rs`: `xf-usb:`
//! - `limits.rs`: the limits of `axes=`
//! - `rate.rs`: `rate=`
//! - `fault.rs`: `fault.*`
//! - `script.rs`, `script_slaves.rs`, `script_text.rs`: `script=`: events of the board, of slaves, and the syntax
//! - `control.rs`: `control=`: events while the board runs
//! - `record.rs`, `record_board.rs`, `record_order.rs`, `record_disk.rs`, `record_pipe.rs`, `record_end.rs`: `record=`:
//!   the file, a board that is opened again, the order of frames, full disks, pipes, the end of a recording
//! - `record_blocks.rs`: recordings in blocks, `FILE.ecmrec`, also cut and damaged ones
//! - `flight.rs`: flight recorders, `flight=`
//! - `record_reader.rs`: reading recordings and captures

mod chip_usb;
mod config;
mod control;
mod fault;
mod flight;
mod in_build;
mod limits;
mod rate;
mod record;
mod record_blocks;
mod record_board;
mod record_disk;
mod record_end;
mod record_order;
mod record_pipe;
mod record_reader;
mod script;
mod script_slaves;
mod script_text;
mod travel;
mod uri;
