//! The EC01M model against the specification, over simulated slaves.

mod ahead_bus;
mod ahead_entries;
mod alarms;
mod allocation;
mod answers;
mod bus_ahead;
#[path = "../bus_wrapper/mod.rs"]
mod bus_wrapper;
mod cable;
mod cable_below_op;
mod commands;
mod crc;
#[path = "../dice/mod.rs"]
mod dice;
mod drives;
mod entries;
mod failures;
mod fifo;
mod full_table;
mod full_table_run;
mod handles;
mod homer;
mod homing;
mod homing_at_once;
mod homing_ends;
mod homing_real;
mod homing_restore;
mod homing_sdo;
#[path = "../homing_tables/mod.rs"]
mod homing_tables;
mod host;
mod hsp;
mod hsp_homing;
mod hsp_network;
mod io_slaves;
mod leaving;
mod leds;
mod left_behind;
mod local_io;
mod lost;
mod lost_together;
mod mixed;
mod models;
mod modes;
mod network_rig;
mod partial_frames;
mod probe;
mod profiles;
mod puppet;
mod random;
mod random_networks;
mod rejections;
mod repeats;
mod replaced;
mod rig;
mod sdo;
mod sdo_beside;
mod slave_answers;
mod states;
mod step;
#[path = "../swift/mod.rs"]
mod swift;
mod test_mode;
mod watch;
