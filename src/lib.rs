//! The ECM-SK, an EtherCAT master on a board (chip EC01M, by NEXTW): a native API for it, links to real boards, and an exact
//! model of the board with simulated drives.
//!
//! A host sends an ECM-SK one frame of commands per EtherCAT cycle over USB or SPI, and receives one frame of responses. The
//! board runs the network: up to 40 servo drives, steppers, pulse modules and IO slaves, with distributed clocks. This crate
//! is for
//! - **machine builders** who drive such a board from Rust, or keep a C, C++ or .NET program for it running;
//! - **engineers who test such programs** without a board, drives and a motor that may hit something: the same program runs
//!   on the model, in real time or in virtual time, and every run in virtual time gives the same bytes;
//! - **tool writers** who need the board's protocol, or read recordings of it.
//!
//! # How it fits together
//!
//! ```text
//!  Rust program ──────── Ecm ────┐            ┌── usb:   an ECM-SK on USB
//!                                │            │
//!  C, C++, C#, VB program        │            ├── spi:   an ECM-SK on SPI
//!   └─ NEXTWUSBLib (capi) ───────┼─── Link ───┤
//!                                │            ├── tcp:   a board that another program serves
//!  program on another machine    │            │
//!   └─ port: TCP, USB/IP ────────┘            └── sim:   Engine ── Fieldbus ── slaves
//!                                                        the model   simulated drives and IO
//! ```
//!
//! A [`Link`](link::Link) exchanges frames with one board and is named by a URI, such as `sim:?slaves=drive*2,io` or `usb:`.
//! Everything on the left runs unchanged on every link. [`link::keys`] lists all keys of a URI, and `ecmsk link help` prints
//! them.
//!
//! # One axis moves
//!
//! [`Ecm`] is the API for programs. A board is opened, its network is configured and brought to OP, a drive is switched on, and
//! a [`Stream`](ecm::Stream) gives it one target position per cycle:
//!
//! ```
//! use ecmsk::ecm::{Close, Config, Ecm, EcmError};
//! use ecmsk::sk::MasterState;
//!
//! fn main() -> Result<(), EcmError> {
//!     // A modelled board with one servo drive, in virtual time.
//!     let ecm = Ecm::open("sim:?slaves=drive&clock=virtual")?;
//!     ecm.configure(&Config::drives(1))?;
//!     ecm.set_state(MasterState::Op)?;
//!     ecm.servo_on(&[1])?;
//!
//!     // The stream stays 20 cycles ahead of the board, so that the program may be late by 20 ms.
//!     let mut stream = ecm.stream(20)?;
//!     let start = stream.snapshot()?.position(1).unwrap_or_default();
//!     for n in 1..=500 {
//!         stream.csp(1, start + 10 * n)?; // counts: 10 per cycle of 1 ms
//!         stream.step()?;
//!     }
//!     // Ends when all targets are executed. An axis that still moves is braked.
//!     let done = stream.finish()?;
//!     assert_eq!((done.underruns, done.losses), (0, 0));
//!     println!("axis 1 at {:?}", ecm.snapshot()?.position(1));
//!     ecm.close(Close::ServoOff)
//! }
//! ```
//!
//! # Two axes on a path
//!
//! A frame carries the targets of all axes, so axes that get their targets in the same step move in the same cycle. With a
//! [`Scale`](ecm::Scale) positions are in units of the machine:
//!
//! ```
//! use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Scale, Slave};
//! use ecmsk::sk::MasterState;
//!
//! fn main() -> Result<(), EcmError> {
//!     let ecm = Ecm::open("sim:?slaves=drive*2&clock=virtual")?;
//!     // Encoders with 17 bits per turn of a 5 mm spindle: positions in millimetres.
//!     let axis = Axis { scale: Scale::per_unit(131_072.0 / 5.0), ..Axis::CSP };
//!     ecm.configure(&Config { slaves: vec![Slave::Drive(axis); 2], cycle_us: 1000 })?;
//!     ecm.set_state(MasterState::Op)?;
//!     ecm.servo_on(&[1, 2])?;
//!
//!     let start = ecm.snapshot()?;
//!     let [x, y] = [1, 2].map(|slave| start.position_units(slave).unwrap_or_default());
//!     let mut stream = ecm.stream(20)?;
//!     for n in 1..=2000 {
//!         // One turn on a circle of 10 mm radius in 2 s, from standstill to standstill.
//!         let t = f64::from(n) / 2000.0;
//!         let angle = std::f64::consts::TAU * t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
//!         stream.csp_units(1, x + 10.0 * (angle.cos() - 1.0))?;
//!         stream.csp_units(2, y + 10.0 * angle.sin())?;
//!         stream.step()?;
//!     }
//!     stream.finish()?;
//!     ecm.close(Close::ServoOff)
//! }
//! ```
//!
//! # Objects and inputs
//!
//! SDO transfers read and write objects of a slave; the type says how many bytes they have. Inputs and outputs of IO slaves are
//! process data:
//!
//! ```
//! use ecmsk::coe::ObjectAddress;
//! use ecmsk::ecm::{Axis, Config, Ecm, EcmError, Slave};
//! use ecmsk::sk::MasterState;
//!
//! fn main() -> Result<(), EcmError> {
//!     let ecm = Ecm::open("sim:?slaves=drive,io&clock=virtual")?;
//!     ecm.configure(&Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Io], cycle_us: 1000 })?;
//!     ecm.set_state(MasterState::Op)?;
//!
//!     // Slave 1: the modes of operation that the drive supports, and a smaller limit of the following error.
//!     let modes: u32 = ecm.sdo_read(1, ObjectAddress::new(0x6502, 0))?;
//!     println!("supported modes 0x{modes:08X}");
//!     let following_error_window = ObjectAddress::new(0x6065, 0);
//!     ecm.sdo_write(1, following_error_window, 20_000_u32)?;
//!     assert_eq!(ecm.sdo_read::<u32>(1, following_error_window)?, 20_000);
//!
//!     // Slave 2: outputs 0 and 3 on.
//!     ecm.set_outputs(2, 0b1001)?;
//!     println!("inputs 0x{:04X}", ecm.inputs(2)?);
//!     Ok(())
//! }
//! ```
//!
//! # Modules
//!
//! | module | what it holds |
//! | --- | --- |
//! | [`ecm`] | [`Ecm`], the API for programs: configuration, states, homing, motion, SDO, IO |
//! | [`link`] | links to a board: the trait [`Link`](link::Link), the URI, `usb:`, `spi:`, `tcp:`, `sim:`, injected faults, recording |
//! | [`sk`] | the wire format: slots, frames, CRC, commands and responses as types, a readable dump; `no_std` |
//! | [`xf`] | the wire format of the chip ECM-XF: packets, check words, requests and answers as types, the driver of a host; `no_std`. In `xf::chip` a model of it |
//! | `embedded` | hosts on a microcontroller: a board or a chip on the SPI of `embedded-hal`; `no_std` |
//! | [`ethercat`] | EtherCAT itself: frames, registers, EEPROMs, mailboxes, [`coe`], [`cia402`]; `no_std` |
//! | [`master`] | a small EtherCAT master in software, without I/O: frames out, frames in, and the time |
//! | [`bus`] | what a network looks like from outside a program: slaves, objects, EEPROMs, files, clocks, cables |
//! | [`xf_api`] | [`Xf`], the API for a chip ECM-XF: any of its commands, the start of a network, process data with types |
//! | [`engine`] | the model of the EC01M: states of the network, command FIFO, SDO slot, homing |
//! | [`fieldbus`] | the trait by which the model reaches its slaves, and the simulated bus |
//! | `slave` | simulated slaves: object dictionary, CiA 402 state machine, servo drive, stepper, pulse module, IO; in `slave::esc` their controllers, as a master on the wire sees them |
//! | [`recording`] | reads recordings, and USB captures of Wireshark |
//! | [`compare`], `replay`, [`summary`] | what differs between two runs, what the model answers to a recorded one, what went wrong in one |
//! | [`migrate`] | what a recorded program needs of an ECM-XF |
//! | [`notes`] | a bounded queue of lines for a log, which never blocks the writers |
//! | `port` | serves a board to other programs and machines, by TCP or as a virtual USB device |
//! | [`machine_file`] | the file that describes a machine: axes by name with unit, limits and homing, slaves, inputs and outputs |
//! | `machine` | whether this machine is set up for a board, and what to do if it is not |
//! | [`io`] | HID on USB and SPI with its lines, below the links `usb:`, `spi:` and `xf-spi:` |
//!
//! # Features
//!
//! | feature | default | what it adds |
//! | --- | --- | --- |
//! | `std` | yes | everything but [`sk`], [`xf`], [`ethercat`] and `embedded`, which need no operating system and no allocator |
//! | `sim` | yes | simulated slaves, and the links `sim:` and `xf-sim:` |
//! | `tcp` | yes | the link `tcp:` to a board that another program serves |
//! | `usb` | | the links `usb:` and `xf-usb:`. They need libusb on Linux, which is loaded when the link is opened; on Windows `usb:` needs nothing, and there is no `xf-usb:` |
//! | `spi` | | the links `spi:` and `xf-spi:`, over spidev and GPIO lines (Linux) |
//! | `nic` | | the link `nic:`: the slaves of a board at a network card of this machine, as an EtherCAT master; it needs raw frames (root or CAP_NET_RAW) (Linux) |
//! | `serve` | | `port`: serving a board |
//! | `embedded` | | `embedded`: a board or a chip on the SPI of a microcontroller; needs no `std` |
//! | `schema` | | `machine_file::schema`: the JSON schema of machine files |
//!
//! The command-line tool `ecmsk` is a package of its own, and so is the drop-in `NEXTWUSBLib` for programs in C, C++ and .NET.
//!
//! # Real boards
//!
//! The links `usb:` and `spi:` are written from the documents of the board and were not tried on one yet. On Linux a user may
//! open a board on USB once a udev rule allows it: `ecmsk doctor` says what is missing, and `sudo ecmsk doctor
//! --write-udev-rule` installs the rule. Before a program moves a real axis for the first time, limit the drives' torque and
//! keep a hand at the emergency stop: a simulated axis that behaves is no proof that a real one will.
//!
//! # Further reading
//!
//! In the project's repository:
//! - `docs/GUIDE.md`: from the first program to a synchronised path, in Rust;
//! - `docs/GUIDE-CPP.md`: the four functions of the board's library, in C++;
//! - `docs/TOOL.md`: the command-line tool; `docs/RECORDINGS.md`: what a recording tells;
//! - `docs/SAFETY.md`: what stops when a program dies or a cable breaks;
//! - `docs/rules/board.md`: what the board does, rule by rule with its source. Comments in the code name a rule as `SK-5.6`;
//! - `examples/rust/`: complete programs.
#![cfg_attr(not(feature = "std"), no_std)]
#![cfg_attr(
    not(all(feature = "nic", feature = "serve", feature = "sim", feature = "spi", feature = "usb")),
    allow(dead_code, unused_imports, reason = "a link or a server that is not in the build would use it")
)]

#[cfg(feature = "embedded")]
pub mod embedded;
pub mod ethercat;
pub mod sk;
pub mod xf;

pub use ethercat::{cia402, coe};

#[cfg(feature = "std")]
mod address;
#[cfg(feature = "std")]
pub mod bus;
#[cfg(feature = "std")]
pub mod compare;
#[cfg(feature = "std")]
pub mod ecm;
#[cfg(feature = "std")]
pub mod engine;
#[cfg(feature = "std")]
pub mod fieldbus;
#[cfg(feature = "std")]
mod files;
#[cfg(feature = "std")]
mod hardware;
#[cfg(feature = "std")]
pub mod io;
#[cfg(feature = "std")]
pub mod link;
#[cfg(all(any(feature = "sim", feature = "serve"), unix))]
mod local_socket;
#[cfg(any(all(feature = "std", target_os = "linux"), all(feature = "usb", windows)))]
pub mod machine;
#[cfg(feature = "std")]
pub mod machine_file;
#[cfg(feature = "std")]
pub mod master;
#[cfg(feature = "std")]
pub mod migrate;
#[cfg(feature = "std")]
pub mod notes;
#[cfg(feature = "std")]
mod open;
#[cfg(feature = "std")]
mod own_board;
#[cfg(all(feature = "serve", any(unix, windows)))]
pub mod port;
#[cfg(feature = "std")]
pub mod recording;
#[cfg(feature = "sim")]
pub mod replay;
#[cfg(feature = "sim")]
pub mod slave;
#[cfg(feature = "std")]
mod span;
#[cfg(feature = "std")]
pub mod summary;
#[cfg(all(feature = "tcp", any(unix, windows)))]
mod tcp;
#[cfg(feature = "sim")]
mod testbed;
#[cfg(feature = "std")]
#[doc(hidden)]
pub mod threads;
#[cfg(feature = "std")]
pub mod xf_api;

#[cfg(feature = "std")]
pub use ecm::Ecm;
#[cfg(feature = "std")]
pub use xf_api::Xf;
