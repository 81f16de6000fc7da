//! A model of the chip, the other end of the SPI or USB connection of a host. A host's packets have the effects and errors that
//! the manuals describe, on a network of simulated slaves.
//!
//! The model reads no clock and does no I/O. Time is an argument, in nanoseconds since power-on. The same calls always give the
//! same bytes; an exchange and a cycle do not allocate.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `profile.rs`, `timing.rs` | the type of the chip and its firmware; the durations of its operations |
//! | `exchange.rs` | packets: the choice of the answer, errors, repeated packets, the effects of each header |
//! | `port.rs` | the chip as a stream of bytes |
//! | `commands.rs`, `commands/` | the immediate effect of each command, by subject |
//! | `jobs.rs`, `jobs/` | commands that take time, with their effects at the end |
//! | `cycle.rs` | time: EtherCAT cycles |
//! | `bus.rs` | the chip's knowledge of its network: states, process data, working counter |
//! | `fifo.rs`, `helper.rs` | the FIFOs of process data; the CiA 402 helper |
//! | `interrupts.rs`, `gpio.rs`, `encoder.rs`, `analog.rs`, `flash.rs`, `mdio.rs` | the chip's own units |
//! | `results.rs` | results that wait until the host reads them |
//! | `network.rs`, `network/` | the trait of networks; slave models, and slave controllers with a master |
//!
//! How to read it: [`Chip::exchange`] handles a whole packet; for the command it calls `run` in `commands.rs`. A
//! command that takes time is started there as a `Job` and ends in `jobs.rs`, called from [`Chip::run_until`].
//!
//! There are two networks. [`Controllers`] has a master and a slave controller in front of each slave: every frame is
//! real, and all 67 codes are supported. [`SlaveModels`] calls the same slaves without frames. A cycle then takes a
//! fraction of the time, and the commands in [`NEED_REGISTERS`] are answered with the command error.
//!
//! ```
//! use ecmsk::slave::{Drive, DriveConfig};
//! use ecmsk::xf::chip::{Chip, Profile, SlaveModels};
//! use ecmsk::xf::request::FirmwareVersionGet;
//! use ecmsk::xf::{AnswerPacket, CheckRule, CommandHeader, CrcCoverage, MAX_PACKET, Received, write_request};
//!
//! let network = SlaveModels::new(vec![Box::new(Drive::new(DriveConfig::default()))]);
//! let mut chip = Chip::new(Profile::NEW, network);
//! let (mut command, mut answer) = ([0; MAX_PACKET], [0; MAX_PACKET]);
//! let size = chip.size();
//! let answer = &mut answer[..size.packet_len()];
//! for index in 1..=2 {
//!     let header = CommandHeader::with_index(index);
//!     let packet = write_request(&mut command, size, CheckRule::FIXED, header, &FirmwareVersionGet)?;
//!     // The chip needs time to start, and to process a packet: here it gets a second for each.
//!     chip.exchange(u64::from(index) * 1_000_000_000, packet, answer);
//! }
//! // The second exchange returns the answer to the first packet.
//! let received = AnswerPacket::parse(answer, size, CrcCoverage::All)?;
//! let Received::Answer(packet) = received else { panic!("the chip is ready") };
//! assert_eq!(packet.header.index, 1);
//! assert_eq!(packet.answer_to(&FirmwareVersionGet)?.version, 0x22);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod analog;
mod bus;
mod commands;
mod cycle;
mod encoder;
mod exchange;
mod fifo;
mod flash;
mod gpio;
mod helper;
mod interrupts;
mod jobs;
mod mdio;
mod network;
mod port;
mod profile;
mod results;
mod timing;

pub use commands::{NEED_REGISTERS, SYNC0_MIN_NS};
pub use fifo::{FIFO_ENTRIES_MAX, FIFO_MEMORY};
pub use flash::FLASH_BYTES;
pub use network::{
    Controllers, EepromFailure, EnterError, Entered, EnteringSlaves, IMAGE_MAX, ImageRanges, ImmediateNetwork, List,
    Operation, OperationAnswer, ProcessExchange, SLAVES_MAX, SdoData, SimulatedNetwork, SlaveIdentity, SlaveModels,
    SlaveNetwork, SlaveSetup,
};
pub use port::ChipPort;
pub use profile::Profile;
pub use timing::ChipTiming;

use crate::ethercat::Ns;
use crate::xf::request::{PdoConfig, Polarity};
use crate::xf::{AnswerHeader, CheckType, CommandCode, DataSize, Errors, MAX_PACKET};
use analog::AnalogUnit;
use bus::KnownNetwork;
use encoder::Encoder;
use exchange::Prepared;
use fifo::Fifos;
use flash::Flash;
use gpio::Gpio;
use helper::Helper;
use interrupts::InterruptUnit;
use jobs::{ActiveJob, Requests, SdoResult};
use mdio::Phys;
use results::Results;

/// A model of the chip with its network.
pub struct Chip<N> {
    profile: Profile,
    timing: ChipTiming,
    network: N,
    /// The time until which the model has run, ns since power-on.
    now: Ns,
    next_cycle: Ns,
    last_cycle: Ns,

    size: DataSize,
    check: CheckType,
    prepared: Prepared,
    /// Index and code of the previous packet: a packet with the same ones is a repetition and is not run again.
    previous: Option<(u8, CommandCode)>,
    /// The time from which on the next packet is accepted.
    ready_at: Ns,
    /// The time from which on the network port is initialised.
    port_ready_at: Ns,
    /// Whether WARM_RESET has just been received: the chip restarts when the packet has been run.
    restarts: bool,
    errors: Errors,
    /// Errors that no answer to a command has shown yet. The bits of a header that clear errors leave these set, so that a host
    /// that clears all errors in every packet sees each one.
    not_shown: Errors,
    crc_errors: u8,
    unknown_commands: u64,

    bus: KnownNetwork,
    /// Whether the PHY had a link when the network was initialised.
    phy_link: bool,
    fifos: Fifos,
    /// Whether RxPDOs are taken out of the RxFIFO in each cycle; true at power-on (XF EN 674).
    fifo_on: bool,
    helper: Helper,
    job: Option<ActiveJob>,
    /// Whether an update of states follows the running job, because the packet of that job has requested it.
    update_is_due: bool,
    sdo: SdoResult,
    results: Results,
    requests: Requests,
    /// The PDOs that PDO_CONFIG_REQ has read, for PDO_CONFIG_GET; `None` before the first PDO_CONFIG_REQ.
    pdo_config: Option<PdoConfig>,

    interrupts: InterruptUnit,
    gpio: Gpio,
    encoder: Encoder,
    analog: AnalogUnit,
    flash: Flash,
    phys: Phys,
}

impl<N: SlaveNetwork> Chip<N> {
    /// A chip with this network that is powered on at time 0.
    pub fn new(profile: Profile, network: N) -> Self {
        Self::with_timing(profile, ChipTiming::default(), network)
    }

    /// A chip with these durations instead of the default ones, powered on at time 0.
    pub fn with_timing(profile: Profile, timing: ChipTiming, network: N) -> Self {
        let mut chip = Self {
            profile,
            timing,
            network,
            now: 0,
            next_cycle: timing.cycle_ns,
            last_cycle: 0,
            size: profile.size,
            check: CheckType::Fixed,
            prepared: Prepared { bytes: [0; MAX_PACKET], header: AnswerHeader::default(), len: 0 },
            previous: None,
            ready_at: 0,
            port_ready_at: 0,
            restarts: false,
            errors: Errors::NONE,
            not_shown: Errors::NONE,
            crc_errors: 0,
            unknown_commands: 0,
            bus: KnownNetwork::new(timing.cycle_ns),
            phy_link: false,
            fifos: Fifos::new(),
            fifo_on: true,
            helper: Helper::new(),
            job: None,
            update_is_due: false,
            sdo: SdoResult::new(),
            results: Results::default(),
            requests: Requests::default(),
            pdo_config: None,
            interrupts: InterruptUnit::new(),
            gpio: Gpio::new(),
            encoder: Encoder::new(),
            analog: AnalogUnit::new(),
            flash: Flash::new(),
            phys: Phys::new(),
        };
        chip.restart();
        chip
    }

    /// Releases the reset line at `now`. The chip then starts as after power-on.
    pub fn reset(&mut self, now: Ns) {
        self.run_until(now);
        self.restart();
    }

    /// Restarts the chip after power-on, the reset line or WARM_RESET. Everything is reset except the flash memory and
    /// the levels with which external signals drive the pins.
    fn restart(&mut self) {
        self.size = self.profile.size;
        self.check = CheckType::Fixed;
        self.previous = None;
        self.ready_at = self.now + self.timing.start_ns;
        self.port_ready_at = self.ready_at + self.timing.port_ns;
        self.restarts = false;
        (self.errors, self.not_shown) = (Errors::NONE, Errors::NONE);
        self.crc_errors = 0;
        self.bus = KnownNetwork::new(self.timing.cycle_ns);
        self.next_cycle = self.now + self.timing.cycle_ns;
        self.phy_link = false;
        self.fifos.reset();
        self.fifo_on = true;
        self.helper = Helper::new();
        (self.job, self.update_is_due) = (None, false);
        self.network.reset();
        self.sdo = SdoResult::new();
        self.results = Results::default();
        self.pdo_config = None;
        self.interrupts = InterruptUnit::new();
        self.gpio.reset(self.now);
        self.encoder = Encoder::new();
        self.analog.reset();
        self.flash.reset();
        self.phys = Phys::new();
        self.prepare_first();
    }

    /// The size of the data segment of the next packet.
    pub const fn size(&self) -> DataSize {
        self.size
    }

    /// The time until which the chip has run, ns since its power-on.
    pub const fn now(&self) -> Ns {
        self.now
    }

    /// The time from which on the chip accepts the next packet, at which INT0 becomes active, ns since power-on.
    pub const fn ready_at(&self) -> Ns {
        self.ready_at
    }

    /// Whether process data travel in LRW; otherwise in LRD and LWR.
    pub const fn uses_lrw(&self) -> bool {
        self.bus.lrw
    }

    /// The number of commands with a code or a function parameter that is not in the manuals; each was answered with the
    /// command error. Tests read it. The vendor's header has more codes than the manuals (OBS).
    pub const fn unknown_commands(&self) -> u64 {
        self.unknown_commands
    }

    /// The chip's network.
    pub const fn network(&self) -> &N {
        &self.network
    }

    /// The chip's network, to cause faults in it.
    pub const fn network_mut(&mut self) -> &mut N {
        &mut self.network
    }

    /// The level of INT0 at `now`. It is active, by default high, while the chip is ready for a packet (XF EN, "ECM-XF
    /// Interrupt").
    pub fn int0(&mut self, now: Ns) -> bool {
        self.run_until(now);
        self.is_ready() == self.interrupts.enable.polarity.contains(Polarity::INT0_HIGH)
    }

    /// The level of INT1 at `now`. It is active, by default low, while any enabled interrupt flag is set.
    pub fn int1(&mut self, now: Ns) -> bool {
        self.run_until(now);
        let is_active = self.interrupts.is_active(self.gpio.flags(), self.encoder.flags);
        is_active == self.interrupts.enable.polarity.contains(Polarity::INT1_HIGH)
    }

    /// Drives GPIO 0..=19 from outside; `None` removes the external signal. A channel that does not exist is ignored.
    pub fn wire_gpio(&mut self, now: Ns, channel: u8, level: Option<bool>) {
        self.run_until(now);
        self.gpio.wire(self.now, channel, level);
    }

    /// The level at GPIO 0..=19 as seen from outside.
    pub fn gpio_level(&self, channel: u8) -> bool {
        self.gpio.level(channel)
    }

    /// Turns the encoder's shaft by `quarters` quarters of a period of its signals A and B; negative values turn it backwards.
    pub fn turn_encoder(&mut self, quarters: i32) {
        self.encoder.turn(quarters);
    }

    /// Gives an index pulse to the encoder.
    pub fn index_encoder(&mut self) {
        self.encoder.index();
    }

    /// The value that the DAC outputs at `now`, 0..=4095 for 0 V to 3.3 V; `None` if it is closed.
    pub fn dac_output(&mut self, now: Ns) -> Option<u16> {
        self.run_until(now);
        self.analog.output()
    }

    /// Sets the level of the pin DAC_ST at `now`, which may start a DAC conversion.
    pub fn wire_dac_start(&mut self, now: Ns, level: bool) {
        self.run_until(now);
        self.analog.set_start_pin(self.now, level);
    }

    /// Sets the values at the ADC's inputs, 0..=4095 for 0 V to 3.3 V. The negative input is used only in differential
    /// mode.
    pub fn wire_adc(&mut self, now: Ns, positive: u16, negative: u16) {
        self.run_until(now);
        self.analog.wire_adc(positive, negative);
    }

    /// The flash memory for files, of [`FLASH_BYTES`] bytes.
    pub fn flash(&self) -> &[u8] {
        self.flash.memory()
    }

    /// A register of a PHY, both numbered 0..=31; `None` if it does not exist.
    pub fn phy_register_mut(&mut self, phy: u8, register: u8) -> Option<&mut u16> {
        self.phys.register_mut(phy, register)
    }
}
