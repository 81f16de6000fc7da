//! The EC01M model against the specification, over simulated slaves. The first line of each file says what it shows; by
//! subject:
//!
//! - commands and answers: `commands`, `full_table` with `full_table_run`, `rejections`, `answers`, `slave_answers`, `crc`,
//!   `partial_frames`, `profiles`, `local_io`, `test_mode`, `leds`
//! - the state of the network: `states`, `failures`, `replaced`, `leaving`, `left_behind`
//! - cable and lost slaves: `cable`, `cable_below_op`, `lost`, `lost_together`
//! - the FIFO and motion: `fifo`, `drives`, `modes`, `alarms`, `step`, `hsp`, `hsp_network`, `io_slaves`, `mixed`
//! - homing: `homing` and the files that begin with its name, `hsp_homing`
//! - SDO: `sdo`, `sdo_beside`
//! - buses that take outputs ahead: `bus_ahead`, `ahead_entries`, `honest`, `sag`, `repeats`, and `over`, which runs the whole
//!   group over such a bus; `any_bus`, rules that others show cycle by cycle, for every bus
//! - over an ECM-XF: `xf_bus`, `xf_counters`, `xf_faults`, `xf_doubts`, `xf_network`, `xf_packets`, `xf_remap`, `xf_start`,
//!   `xf_state`, `xf_ahead`
//! - over our own master: `nic_bus`, `nic_counters`, `nic_gone`, `nic_odd`, `nic_predecessor`, `nic_ring`, `nic_runner`,
//!   `nic_terminals`, `stale_program`
//! - random runs, and invariants: `random`, `random_networks`, `allocation`, `nic_allocation`
//! - the tools of the tests: `host`, `probe`, `rig`, `network_rig`, `models`, `puppet`, `homer`, `entries`, `watch`, `handles`

mod ahead_entries;
mod alarms;
mod allocation;
mod answers;
mod any_bus;
mod bus_ahead;
mod cable;
mod cable_below_op;
mod commands;
mod crc;
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
mod honest;
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
mod nic_allocation;
mod nic_bus;
mod nic_counters;
mod nic_gone;
mod nic_odd;
mod nic_predecessor;
mod nic_ring;
mod nic_runner;
mod nic_terminals;
mod over;
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
mod sag;
mod sdo;
mod sdo_beside;
mod slave_answers;
mod stale_program;
mod states;
mod step;
mod test_mode;
mod watch;
mod xf_ahead;
mod xf_bus;
mod xf_counters;
mod xf_doubts;
mod xf_faults;
mod xf_network;
mod xf_packets;
mod xf_remap;
mod xf_start;
mod xf_state;
