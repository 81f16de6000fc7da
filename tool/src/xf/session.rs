//! The open chip for a verb of `ecmsk xf`.

use ecmsk::link::chip::{self, ChipLink};
use ecmsk::link::uri::LinkUri;
use ecmsk::xf::host::{HostConfig, HostError};
use ecmsk::xf::request::{Reconfig, Slaves};
use ecmsk::xf::{AnswerHeader, EtherCatState};
use ecmsk::xf_api::{NetworkConfig, Xf, XfError};

use super::XfVerbError;
use super::words::{state_name, state_text};
use crate::board::Reporter;
use crate::link_option::ChosenLink;
use crate::output::counted;

// No doc comment: clap would show it as the help of every verb.
#[derive(Clone, Default, clap::Args)]
#[group(skip)]
pub struct ChipArgs {
    /// Chip to talk to, see `ecmsk link help` [default: ECMSK_LINK, else the one of machine.toml or ecmsk.toml]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    /// Print JSON: one JSON object per line
    #[arg(long)]
    json: bool,
}

/// An open chip. Opening does not change the state of its network.
pub struct Session {
    pub xf: Xf,
    /// The name of the link, as reported by the link itself.
    pub link: String,
    pub reporter: Reporter,
    /// The chip's first answer after opening. It shows the state before the verb changes anything.
    pub found: AnswerHeader,
}

impl ChipArgs {
    /// Opens the chip.
    ///
    /// # Errors
    /// The command line names no chip, the link is not a link to a chip, or the chip does not answer.
    pub fn open(&self) -> Result<Session, XfVerbError> {
        let chosen = ChosenLink::find(self.link.as_ref())?;
        if !chosen.is_named() {
            return Err(XfVerbError::NoLink);
        }
        crate::recording_end::note_opened(&chosen.uri);
        let (link, config) = chip::open(&chosen.uri.to_string()).map_err(XfError::Link)?;
        Ok(Session::over(link, config, self.json)?)
    }
}

impl Session {
    /// Opens the chip on a link, without clearing its FIFO, because a machine may be running.
    ///
    /// # Errors
    /// [`XfError`] if the chip does not answer.
    pub fn over(link: Box<dyn ChipLink>, config: HostConfig, json: bool) -> Result<Self, XfError> {
        let info = link.info();
        let xf = Xf::over(link, HostConfig { keep_fifo: true, ..config })?;
        let found = xf.host().found().copied().unwrap_or_default();
        let reporter = Reporter::new(json, info.virtual_time);
        if xf.host().gave_crc_up() {
            reporter.note(format_args!("{}", HostError::CRC_GIVEN_UP));
        }
        Ok(Self { xf, link: info.name, reporter, found })
    }

    /// The state of the network in the chip's latest answer; `None` if the network is not initialised or the code is
    /// unknown.
    pub fn state(&self) -> Option<EtherCatState> {
        self.xf.header().state.state()
    }

    /// Whether the chip has initialised its network.
    pub fn is_up(&self) -> bool {
        self.xf.header().state.0 & 0x0F != 0
    }

    /// Initialises the network, prints a note about this, and returns the number of slaves.
    ///
    /// # Errors
    /// [`XfError`] if the chip does not answer or cannot initialise the network.
    pub fn start(&mut self) -> Result<u8, XfError> {
        let slaves = self.xf.start_network(&NetworkConfig::default())?;
        self.reporter.note(format_args!("the network was initialised: {}", counted(slaves, "slave")));
        Ok(slaves)
    }

    /// Returns the number of slaves. A network that is not initialised is first initialised and brought to `state`. An
    /// initialised network stays in its state.
    ///
    /// # Errors
    /// [`XfError`] if the chip does not answer, cannot initialise the network, or a slave does not reach `state`.
    pub fn join_or_start(&mut self, state: EtherCatState) -> Result<u8, XfError> {
        if self.is_up() {
            return self.xf.count_slaves();
        }
        let slaves = self.start()?;
        self.go_to(state)?;
        Ok(slaves)
    }

    /// Brings a network that was just initialised to `state`. On the way, in PreOP, its process data are configured.
    fn go_to(&mut self, state: EtherCatState) -> Result<(), XfError> {
        if state == EtherCatState::Init {
            return Ok(());
        }
        self.xf.set_state(Slaves::All, EtherCatState::PreOp)?;
        if state != EtherCatState::PreOp {
            self.xf.run(&Reconfig)?;
            self.xf.set_state(Slaves::All, state)?;
        }
        self.reporter.note(format_args!("brought to {}", state_name(state)));
        Ok(())
    }

    /// Checks that the network is in a state in which mailboxes work: PreOP, SafeOP or OP.
    ///
    /// # Errors
    /// [`XfVerbError::Refused`] if the network is in another state.
    pub fn expect_mailboxes(&self, what: &'static str) -> Result<(), XfVerbError> {
        match self.state() {
            Some(EtherCatState::PreOp | EtherCatState::SafeOp | EtherCatState::Op) => Ok(()),
            _ => Err(XfVerbError::Refused {
                what,
                why: format!("it needs PreOP, SafeOP or OP, the network is in {}", state_text(self.xf.header().state)),
                next: "bring it up with `ecmsk xf state preop`".into(),
            }),
        }
    }
}
