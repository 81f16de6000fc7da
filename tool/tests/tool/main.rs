//! The tool `ecmsk`, run as a user runs it.
//!
//! Files:
//!
//! - `command_line.rs`, `details.rs`, `words.rs`, `bad_input.rs`: help, options, units, and errors of the command line
//! - `page.rs`, `recordings_page.rs`, `readme_picture.rs`, `card_picture.rs`: the pages of `docs/` and README show the tool's
//!   output
//! - `exec.rs`, `exec_library.rs`, `exec_reasons.rs`, `clock.rs`: `ecmsk exec`: the program, its library, reports of what went
//!   wrong, and programs that sleep
//! - `dump_*.rs`, `plot*.rs`, `compare.rs`, `captures.rs`, `filters.rs`, `migrate.rs`: recordings and
//!   captures, shown, drawn, compared, replayed, and judged
//! - `summary_axes.rs`, `trends.rs`, `bad_moments.rs`, `find.rs`: `ecmsk summary` and `ecmsk find`
//! - `assert_rules.rs`: `ecmsk assert`
//! - `fault.rs`: `ecmsk fault`, `--control`, and faults in scripts
//! - `recording_end.rs`, `recording_damage.rs`, `foreign_recording.rs`: recordings that were not ended, damaged ones, and
//!   recordings of unknown origin
//! - `recording_files.rs`: `ecmsk recording`, and recordings in blocks in other verbs; `recording_tables.rs`: tables that it
//!   exports
//! - `verbs.rs`, `moves.rs`, `stop.rs`, `stalled.rs`, `scripts.rs`, `terminal.rs`, `state_failed.rs`, `objects.rs`: verbs that talk
//!   to a board,
//!   signals, scripts, the shell
//! - `monitor*.rs`: `ecmsk monitor`; `jog.rs`, `stop_verb.rs`: `ecmsk jog`, `ecmsk stop`
//! - `machine_file.rs`, `machine_names.rs`, `machine_served.rs`: the machine file, its link, names and words in all verbs, that
//!   of a server, and `ecmsk machine`
//! - `slave.rs`: `ecmsk slave`
//! - `serve_ethercat.rs`, `serve_gadget.rs`, `serve_metrics.rs`, `serve_service.rs`, `serve_usbip.rs`, `serve_xf.rs`,
//!   `service_on_tcp.rs`, `tcp_*.rs`: `ecmsk serve`
//! - `serve_web.rs`, `serve_web_browser.rs`, `serve_web_control.rs`, `serve_web_machine.rs`, `serve_web_secured.rs`:
//!   `ecmsk serve web`, the page in a browser, axes that it moves, and pages for other machines
//! - `list.rs`, `cards.rs`, `doctor.rs`, `doctor_folder.rs`, `doctor_gadget.rs`, `doctor_report.rs`, `machine.rs`,
//!   `man.rs`: `ecmsk list`, `doctor`, `man`
//! - `bus.rs`: `ecmsk bus`
//! - `xf.rs`, `behind_chip.rs`: `ecmsk xf`; the verbs of a board with its slaves behind an ECM-XF
//! - `wireshark.rs`, `wireshark_chip.rs`: `ecmsk wireshark`: its plugin shows what `dump` shows
//! - `common/`: running the tool, machines and recordings made for tests, and reading a plot back (`svg.rs`)

mod assert_rules;
mod bad_input;
mod bad_moments;
mod behind_chip;
mod bus;
mod captures;
mod card_picture;
mod cards;
mod clock;
mod command_line;
mod common;
mod compare;
mod details;
mod doctor;
mod doctor_folder;
mod doctor_gadget;
mod doctor_report;
mod dump_hex;
mod dump_packets;
mod dump_recording;
mod exec;
mod exec_library;
mod exec_reasons;
mod fault;
mod filters;
mod find;
mod flight;
mod foreign_recording;
mod jog;
mod list;
mod machine;
mod machine_file;
mod machine_names;
mod machine_served;
mod man;
mod migrate;
mod monitor;
mod monitor_tcp;
mod monitor_terminal;
mod moves;
mod objects;
mod odd_recordings;
mod one_clock;
mod page;
mod params;
mod plot;
mod plot_beside;
mod plot_difference;
mod plot_gaps;
#[cfg(all(unix, feature = "web"))]
mod plot_html;
mod plot_lost;
mod plot_panels;
mod plot_png;
mod plot_states;
mod readme_picture;
mod recording_damage;
mod recording_end;
mod recording_files;
mod recording_tables;
mod recordings_page;
mod scripts;
mod serve_ethercat;
mod serve_gadget;
#[cfg(all(unix, feature = "web"))]
mod serve_metrics;
mod serve_service;
mod serve_usbip;
#[cfg(all(unix, feature = "web"))]
mod serve_web;
#[cfg(all(unix, feature = "web"))]
mod serve_web_browser;
#[cfg(all(unix, feature = "web"))]
mod serve_web_control;
#[cfg(all(unix, feature = "web"))]
mod serve_web_machine;
#[cfg(all(unix, feature = "web"))]
mod serve_web_secured;
mod serve_xf;
mod service_on_tcp;
mod slave;
mod stalled;
mod state_failed;
mod stop;
mod stop_verb;
mod summary_axes;
mod tcp_network;
mod tcp_params;
mod tcp_process;
mod tcp_stalled_log;
mod terminal;
mod trends;
mod verbs;
mod wireshark;
mod wireshark_chip;
mod words;
mod xf;
