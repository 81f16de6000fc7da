//! The virtual board at a USB device port of this machine (Linux). A host at the other end of the cable sees an ECM-SK.
//! The server passes frames and reports between this host and a board on any link (a model, a real board, a served
//! one). It uses a USB gadget of the kernel, set up by configfs and FunctionFS (why:
//! docs/decisions/the-gadget-is-served-over-functionfs.md).
//!
//! Files, in the order in which to read them:
//!
//! - `mod.rs`: [`Server`], its options and errors
//! - `host.rs`: the state of the host and the device model that it uses, without I/O
//! - `service.rs`: the threads: events and transfers, reports, frames
//! - `watched_link.rs`: the board's link, for stopping axes when the host is gone
//! - `lateness.rs`: reports and cycles that a machine that is too slow has missed
//! - `in_memory.rs`: a server without a controller, for tests; `host_tests.rs` are tests

mod host;
#[cfg(test)]
mod host_tests;
#[doc(hidden)]
pub mod in_memory;
mod lateness;
mod service;
mod watched_link;

use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

pub use super::tcp::OnVanish;
pub use super::usb_board::descriptors::{Identity, IdentityError};
pub use crate::io::gadget::ControllerError;

use super::usb_board::descriptors::Descriptors;
use super::usb_board::setup::descriptor::CONFIGURATION;
use crate::engine::RealTime;
use crate::io::gadget::{
    self, CONFIGFS, Claim, DeviceIds, Direction, End, Function, Gadget, MOUNTS, StepError, Transfers, UDC_CLASS,
};
use crate::link::{Link, LinkError};
use crate::notes::{NoteThread, Notes};
use crate::sk::FRAME_LEN;
use crate::threads;
use host::Controller;
use service::{Endpoints, Port, Service};

/// The pause between two attempts to open a lost board. \[OURS]
const RETRY_PAUSE: Duration = Duration::from_millis(500);
/// The serial number of a board whose identity has none. A USB/IP server (`port/usbip`) gives its first board the same
/// serial number, which is the board's bus id there. \[OURS]
const SERIAL: &str = "1-1";
/// The most bytes of a text that the kernel accepts for a USB device (`USB_MAX_STRING_LEN`).
const TEXT_BYTES_MAX: usize = 126;

/// Opens the board's link, at first and after every loss.
pub type Opener = Box<dyn Fn() -> Result<Arc<dyn Link>, LinkError> + Send + Sync>;

/// The folders through which the server sets up the gadget. Tests replace them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Places {
    /// The folder in which the kernel lists the USB device controllers, `/sys/class/udc`.
    pub controllers: PathBuf,
    /// The folder in configfs in which gadgets are made, `/sys/kernel/config/usb_gadget`.
    pub gadgets: PathBuf,
    /// The folder below which the USB function is mounted (FunctionFS), `/run/ecmsk`.
    pub mounts: PathBuf,
}

impl Default for Places {
    fn default() -> Self {
        Self { controllers: UDC_CLASS.into(), gadgets: CONFIGFS.into(), mounts: MOUNTS.into() }
    }
}

/// The settings of a server that offers a board at a USB device port of this machine.
#[derive(Clone)]
pub struct Options {
    /// The identity of the board in its descriptors. Without a serial number it gets `1-1`.
    pub identity: Identity,
    /// The name of the device controller; `None`: the only one.
    pub controller: Option<String>,
    /// What happens to moving axes when the host is gone.
    pub on_vanish: OnVanish,
    /// The pause between two attempts to open a lost board.
    pub retry: Duration,
    /// The folders through which the server sets up the gadget.
    pub places: Places,
    /// The real-time settings of the threads between the controller and the board. A board that this process simulates
    /// has real-time settings of its own for its cycle; they come from its link.
    pub real_time: RealTime,
    /// Called with each line of the log, in a thread of its own for which no other thread waits. If the function is too
    /// slow, lines are dropped, and a line reports their number.
    pub tell: Arc<dyn Fn(&str) + Send + Sync>,
    /// Called when the server has ended by itself, because the kernel has taken the USB function away. [`Server::stop`]
    /// returns the reason.
    pub failed: Arc<dyn Fn() + Send + Sync>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            identity: Identity::default(),
            controller: None,
            on_vanish: OnVanish::default(),
            retry: RETRY_PAUSE,
            places: Places::default(),
            real_time: RealTime::default(),
            tell: Arc::new(|_| {}),
            failed: Arc::new(|| {}),
        }
    }
}

/// Why a board cannot be served at a USB device port.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum ServeError {
    /// No USB device controller can be used: there is none, none of that name, several without a choice, or another
    /// server has it.
    #[error(transparent)]
    Controller(#[from] ControllerError),
    /// The link of the board cannot be opened at the start of the server.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The link of the board has a virtual clock: it stands still between two calls, but a USB host expects reports all
    /// the time.
    #[error(
        "`{name}` has a virtual clock, which stands still between two calls; a USB device runs by itself: leave out \
         clock=virtual"
    )]
    VirtualTime { name: String },
    /// The identity does not fit into USB descriptors: a text, the interval or the current is out of range.
    #[error(transparent)]
    Identity(#[from] IdentityError),
    /// A text of the identity has more than 126 bytes, the limit of the kernel. USB itself allows 126 UTF-16 units,
    /// which may be more bytes.
    #[error("`{text}` has {} bytes, and the kernel takes {TEXT_BYTES_MAX} for a text of a USB device; shorten it", text.len())]
    Text { text: String },
    /// The kernel's folder of gadgets does not exist.
    #[error(
        "this machine's kernel has no folder for USB gadgets ({}); `sudo modprobe libcomposite`, and if the folder above it is \
         empty `sudo mount -t configfs none /sys/kernel/config`",
        path.display()
    )]
    NoConfigfs { path: PathBuf },
    /// This user is not allowed to make a gadget.
    #[error("a USB gadget is made by root alone ({source}); start the same command with sudo")]
    NotAllowed { source: StepError },
    /// Another gadget has the controller.
    #[error(
        "another USB gadget of this machine has the device controller {controller} ({gadgets}); end what made it (on a Raspberry Pi \
         often the module g_ether, or a service that writes there), or name another one with --udc"
    )]
    Busy { controller: String, gadgets: String },
    /// The kernel refuses to create the gadget or to bind it to the controller.
    #[error("{0}; does the kernel have FunctionFS (`sudo modprobe usb_f_fs`)? `dmesg` may say more")]
    Gadget(StepError),
    /// The kernel refuses the USB function: FunctionFS cannot be mounted, or does not accept the descriptors.
    #[error(
        "cannot set up the USB function: {0}; does the kernel have FunctionFS (`sudo modprobe usb_f_fs`)? `dmesg` may say more"
    )]
    Function(io::Error),
    /// The running server cannot read events of the USB function any more.
    #[error("the kernel has taken the USB function away: {0}; start the server again")]
    FunctionGone(io::Error),
    /// The system did not provide a thread or another resource.
    #[error("{what}: {source}; free some memory, files or threads, then start it again")]
    System { what: &'static str, source: io::Error },
}

/// A running server; it ends when this value is stopped or dropped. Then the gadget is removed.
pub struct Server {
    controller: String,
    // The fields are dropped in this order: the endpoints are closed before the function is unmounted and the gadget
    // removed.
    service: Arc<Service>,
    threads: Vec<JoinHandle<()>>,
    teller: NoteThread<String>,
    _function: Function,
    _gadget: Arc<Gadget>,
    _claim: Claim,
}

impl Server {
    /// Opens the link of the board, creates the gadget and binds it to the controller. The cable to a host may be
    /// plugged in later.
    ///
    /// # Errors
    /// [`ServeError`]: a setting is invalid, the link cannot be opened, or the kernel refuses the gadget. The gadget is
    /// removed again before the call returns.
    pub fn start(opener: Opener, options: Options) -> Result<Self, ServeError> {
        let Options { mut identity, places, .. } = options.clone();
        if identity.serial.is_empty() {
            SERIAL.clone_into(&mut identity.serial);
        }
        let descriptors = Descriptors::new(&identity)?;
        let ids = ids(identity, &descriptors)?;
        let controller = gadget::choose(&places.controllers, options.controller.as_deref())?;
        let claim = Claim::new(&controller)?;
        if !places.gadgets.is_dir() {
            return Err(ServeError::NoConfigfs { path: places.gadgets });
        }
        let link = opener()?;
        let info = link.info();
        if info.virtual_time {
            return Err(ServeError::VirtualTime { name: info.name });
        }

        let name = format!("ecmsk-{controller}");
        // The claim shows that no other process has this gadget, so what a killed process has left of it can be
        // removed.
        Function::remove_leftover(&places.mounts, &name);
        let gadget = Arc::new(Gadget::make(&places.gadgets, &name, &ids).map_err(refused)?);
        let (function, control, transfers) =
            Function::open(&places.mounts, &name, function_part(&descriptors)).map_err(ServeError::Function)?;
        let notes = Notes::default();
        let system = |what| move |source| ServeError::System { what, source };
        let teller = NoteThread::of_lines(&notes, Arc::clone(&options.tell)).map_err(system("start a thread"))?;
        let ended = transfers.waited().try_clone_to_owned().map_err(system("open a file"))?;
        let port = Bound { gadget: Arc::clone(&gadget), controller: controller.clone() };
        let service = Service::new(opener, link, descriptors, Box::new(transfers), Box::new(port), options, notes);
        let service = Arc::new(service.map_err(system("make a socket"))?);
        let mut server = Self {
            controller,
            service,
            threads: Vec::new(),
            teller,
            _function: function,
            _gadget: gadget,
            _claim: claim,
        };
        let events = Arc::clone(&server.service);
        server.spawn("gadget-usb", move || events.serve_host(&control, &ended))?;
        let frames = Arc::clone(&server.service);
        server.spawn("gadget-frames", move || frames.move_frames())?;
        server.service.plug_in().map_err(|error| server.not_bound(error, &places))?;
        let reports = Arc::clone(&server.service);
        server.spawn("gadget-board", move || reports.serve_board())?;
        Ok(server)
    }

    /// The name of the USB device controller that the server uses, as in `/sys/class/udc`.
    pub fn controller(&self) -> &str {
        &self.controller
    }

    /// Waits until all log lines that the server has made so far are passed to [`Options::tell`], at most 1 s.
    pub fn flush(&self) {
        self.teller.flush();
    }

    /// Unplugs the board from its host, brings axes that the host has moved to a standstill, closes the link and
    /// removes the gadget.
    ///
    /// # Errors
    /// [`ServeError::FunctionGone`]: the server had already ended by itself, because the kernel had taken the USB
    /// function away.
    pub fn stop(mut self) -> Result<(), ServeError> {
        self.end();
        self.service.take_failure().map_or(Ok(()), |error| Err(ServeError::FunctionGone(error)))
    }

    fn spawn(&mut self, name: &str, work: impl FnOnce() + Send + 'static) -> Result<(), ServeError> {
        let thread = threads::spawn(name, work);
        self.threads.push(thread.map_err(|source| ServeError::System { what: "start a thread", source })?);
        Ok(())
    }

    fn not_bound(&self, error: StepError, places: &Places) -> ServeError {
        if error.source.kind() != io::ErrorKind::ResourceBusy {
            return refused(error);
        }
        let entries = std::fs::read_dir(&places.gadgets).into_iter().flatten().flatten();
        let holders = entries.filter(|entry| {
            std::fs::read_to_string(entry.path().join("UDC")).is_ok_and(|udc| udc.trim() == self.controller)
        });
        let names: Vec<String> = holders.map(|entry| entry.path().display().to_string()).collect();
        let gadgets = if names.is_empty() { "of a kernel module".to_owned() } else { names.join(", ") };
        ServeError::Busy { controller: self.controller.clone(), gadgets }
    }

    fn end(&mut self) {
        self.service.stop();
        for thread in self.threads.drain(..) {
            // An error is ignored: it means that the thread has panicked, and that was printed when it happened.
            let _ = thread.join();
        }
        self.service.close_board();
        self.teller.end();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end();
    }
}

/// The gadget and the controller to which it is bound: binding plugs the board in for a host, unbinding pulls it.
struct Bound {
    gadget: Arc<Gadget>,
    controller: String,
}

impl Port for Bound {
    fn plug_in(&self) -> Result<(), StepError> {
        self.gadget.bind(&self.controller)
    }

    fn pull(&self) {
        self.gadget.unbind();
    }
}

impl Controller for Transfers {
    fn is_sending(&self) -> bool {
        self.is_under_way(Direction::In)
    }

    fn is_receiving(&self) -> bool {
        self.is_under_way(Direction::Out)
    }

    fn send(&mut self, report: &[u8; FRAME_LEN]) {
        // An error is ignored: the next report of the board is the next attempt to send.
        let _ = Self::send(self, report);
    }

    fn take_back(&mut self) {
        Self::take_back(self);
    }

    fn receive(&mut self) {
        // An error is ignored: `Host::arm` tries again at the next report, at the latest after 50 ms.
        let _ = Self::receive(self);
    }
}

impl Endpoints for Transfers {
    fn next_end(&mut self) -> Option<End> {
        Self::next_end(self)
    }

    fn copy_received(&self, packet: &mut [u8]) {
        let received = self.received();
        let length = packet.len().min(received.len());
        packet[..length].copy_from_slice(&received[..length]);
    }
}

fn refused(error: StepError) -> ServeError {
    match error.source.kind() {
        io::ErrorKind::PermissionDenied => ServeError::NotAllowed { source: error },
        _ => ServeError::Gadget(error),
    }
}

/// The ids and texts for configfs, from the identity and the descriptors that USB/IP hosts get too.
fn ids(identity: Identity, descriptors: &Descriptors) -> Result<DeviceIds, ServeError> {
    let texts = [identity.manufacturer, identity.name, identity.serial];
    if let Some(text) = texts.iter().find(|text| text.len() > TEXT_BYTES_MAX) {
        return Err(ServeError::Text { text: text.clone() });
    }
    let attributes = descriptors.get(CONFIGURATION, 0).and_then(|bytes| bytes.get(7)).copied().unwrap_or_default();
    let Identity { vendor, product, release, power_ma, .. } = identity;
    Ok(DeviceIds { vendor, product, release, attributes, power_ma, texts })
}

/// The descriptors for FunctionFS: the configuration descriptor without its first 9 bytes, which the kernel makes
/// itself.
fn function_part(descriptors: &Descriptors) -> &[u8] {
    let all = descriptors.get(CONFIGURATION, 0).unwrap_or_default();
    let head = all.first().map_or(0, |length| usize::from(*length));
    all.get(head..).unwrap_or_default()
}
