//! Links: what names one, the boards in the process, scripts, faults, and recordings as they are written and read.

mod config;
mod fault;
mod rate;
mod record;
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
