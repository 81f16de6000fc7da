//! Slave controllers around simulated slaves, with a master that sends single datagrams, in virtual time. The names of
//! the tests have the statements of the checklist, `s07` for number 7; `tests/masters` and `port/ethercat/network.rs`
//! also show number 40.
//!
//! - `rig.rs`: the master
//! - `datagrams.rs`: the commands, and frames as a whole
//! - `ports.rs`, `eeprom.rs`: cables and power; the EEPROM
//! - `logical.rs`, `managers.rs`: FMMUs; sync managers
//! - `states.rs`: the AL state machine, the watchdog
//! - `mailbox.rs`: SDO, SDO information, emergencies
//! - `files.rs`: bootstrap, and files by FoE
//! - `dp3cl.rs`: a DP3CL as the network sees it
//! - `clocks.rs`, `latches.rs`: distributed clocks; their latch inputs
//! - `register_table.rs`: every register, its value at power-on and its access
//! - `masters.rs`: the frames of known masters at their start
//! - `bad_input.rs`: invalid frames
//! - `disturbed.rs`: two masters, masters that stop, EEPROMs written in part, absurd FMMUs and sync managers

mod bad_input;
mod clocks;
mod datagrams;
mod disturbed;
mod dp3cl;
mod eeprom;
mod files;
mod latches;
mod logical;
mod mailbox;
mod managers;
mod masters;
mod noise;
mod ports;
mod register_table;
mod rig;
mod states;
