//! Makes messages of reports, and puts them into the queue of each page.
//!
//! The thread that reads the board only appends reports to a buffer. A thread of this file takes them 20 times a second,
//! makes one block, and offers it to each queue. It waits for no queue: blocks that find a queue full are left out and
//! counted.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use ecmsk::ecm::Scales;
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{Dir, KnownNetwork};
use ecmsk::machine_file::MachineFile;
use ecmsk::recording::Kinds;
use ecmsk::sk::{Frame, SlotSize};
use serde_json::json;

use super::WebError;
use crate::CliError;
use crate::kind_list::KindList;
use crate::link_option::{ChosenLink, as_reader};
use crate::lock::lock;
use crate::monitor::source::Feed;
use crate::monitor::{self, json as view_json};
use crate::serve::watch::BoardWatch;
use crate::web::channels::Channels;
use crate::web::events::Events;
use crate::web::hello::{FORMAT, Hello, Names, Picture, Words, slaves};
use crate::web::sampler::Sampler;

/// The time between two blocks. \[OURS]
const BLOCK_INTERVAL: Duration = Duration::from_millis(50);
/// How many blocks are between two messages with the counters. \[OURS]
const BLOCKS_PER_STATUS: u32 = 5;
/// The largest number of reports in the buffer: two seconds at the fastest cycle, 250 us. Reports that find it full are left
/// out and counted. \[OURS]
const REPORTS_MAX: usize = 8000;
/// The largest number of pages that show a board at the same time. \[OURS]
const PAGES_MAX: usize = 16;
/// The largest number of messages in the queue of a page: some 3 s. \[OURS]
const QUEUE_MAX: usize = 64;

/// A message to a page, which shows a board.
#[derive(Clone)]
pub enum Out {
    /// A JSON object: the first message (hello), or new channels, events or counters.
    Text(Arc<str>),
    /// A block of new points of channels, in the page's binary format.
    Block(Arc<[u8]>),
}

/// The board that the pages show, and the options that say how.
pub struct Subject {
    /// The link as the user gave it; the link that is opened may have a longer queue.
    pub uri: LinkUri,
    /// The machine file of the board, with names and units of axes.
    pub machine: Option<Arc<MachineFile>>,
    /// The kinds of the slaves, from `--slaves` of `ecmsk serve web`.
    pub slaves: Option<KindList>,
    /// The scales of `--counts-per-unit`.
    pub scales: Option<Scales>,
    /// The slot size of `--slot-size`.
    pub slot_size: Option<SlotSize>,
}

impl Subject {
    fn names(&self) -> Names<'_> {
        Names { machine: self.machine.as_deref(), scales: self.scales.as_ref(), unit: "units" }
    }
}

/// The pages that are connected to a board, and the thread that makes their messages.
pub struct Hub {
    name: String,
    pages: Mutex<Vec<Page>>,
    stop: AtomicBool,
    thread: Mutex<Option<JoinHandle<()>>>,
}

/// The queue to a connected page, which a thread of its own sends over a WebSocket.
struct Page {
    queue: SyncSender<Out>,
    /// Whether the page needs the hello message with all channels and events: it is new, or its queue was full for a
    /// message that it must not miss.
    is_new: bool,
    /// The number of blocks that found the queue of the page full, and of reports that were left out for all pages.
    dropped: u64,
}

/// Reports that were read and not yet sent.
#[derive(Default)]
struct Inbox {
    reports: Vec<(i64, Frame)>,
    size: Option<SlotSize>,
    left_out: u64,
}

impl Hub {
    /// Opens the board, and starts a thread that makes messages from its reports.
    ///
    /// # Errors
    /// [`CliError`] if the board cannot be opened or read, or if no thread can be started.
    pub fn start(chosen: &ChosenLink, subject: Subject, watch: Arc<BoardWatch>) -> Result<Arc<Self>, CliError> {
        let inbox = Arc::new(Mutex::new(Inbox::default()));
        let filled = Arc::clone(&inbox);
        let each = Box::new(move |at_ns: i64, frame: &Frame, size: SlotSize| {
            let mut inbox = lock(&filled);
            inbox.size = Some(size);
            if inbox.reports.len() < REPORTS_MAX {
                inbox.reports.push((at_ns, frame.clone()));
            } else {
                inbox.left_out += 1;
            }
        });
        let (slaves, size, machine) = (subject.slaves.as_ref(), subject.slot_size, subject.machine.as_ref());
        let around = Box::new(move |link| watch.around(link));
        let feed = monitor::board(chosen, slaves, size, machine, around, each)?;
        let hub = Arc::new(Self {
            name: subject.uri.to_string(),
            pages: Mutex::default(),
            stop: AtomicBool::new(false),
            thread: Mutex::default(),
        });
        let publishing = Arc::clone(&hub);
        let spawned = thread::Builder::new().name("pages".into()).spawn(move || {
            let mut publisher = Publisher::new(subject, feed, inbox);
            while !publishing.stop.load(Ordering::Relaxed) {
                publisher.publish(&publishing.name, &publishing.pages);
                thread::sleep(BLOCK_INTERVAL);
            }
        });
        let system = |error: io::Error| WebError::System { what: "start a thread", message: error.to_string() };
        *lock(&hub.thread) = Some(spawned.map_err(system)?);
        Ok(hub)
    }

    /// Ends the thread and closes the board. A recording by the link's `record=` is complete afterwards.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = lock(&self.thread).take() {
            // A panic of the thread was printed already.
            let _ = thread.join();
        }
    }

    /// The link of the board.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The number of pages that are connected, or were when the board's newest points were sent.
    pub fn page_count(&self) -> usize {
        lock(&self.pages).len()
    }

    /// Adds a page and returns its queue; `None` if [`PAGES_MAX`] pages are connected.
    pub fn join(&self) -> Option<Receiver<Out>> {
        let mut pages = lock(&self.pages);
        if pages.len() >= PAGES_MAX {
            return None;
        }
        let (queue, messages) = sync_channel(QUEUE_MAX);
        pages.push(Page { queue, is_new: true, dropped: 0 });
        Some(messages)
    }
}

impl Page {
    /// Offers a message to the queue of the page; returns whether the page is still connected. If the queue is full, a
    /// message that the page may miss is counted. With `must` the page gets a new hello message later instead.
    fn offer(&mut self, message: Out, must: bool) -> bool {
        match self.queue.try_send(message) {
            Ok(()) => true,
            Err(TrySendError::Full(_)) => {
                self.dropped += u64::from(!must);
                self.is_new |= must;
                true
            }
            Err(TrySendError::Disconnected(_)) => false,
        }
    }

    /// Offers the messages since the last call to the queue of the page. A new page gets `hello`, the message with all channels
    /// and events so far, and the newest points instead. Returns whether the page is still connected.
    fn deliver(&mut self, news: &News, hello: impl Fn() -> Arc<str>) -> bool {
        self.dropped += news.left_out;
        if std::mem::take(&mut self.is_new) {
            // A new page gets the newest points at once, because a board that sends no more reports gives it no others.
            return self.offer(Out::Text(hello()), true) && self.offer(Out::Block(Arc::clone(&news.newest)), false);
        }
        if !news.texts.iter().all(|text| self.offer(Out::Text(Arc::clone(text)), true)) {
            return false;
        }
        // A page that has missed a text cannot read the blocks after it, until it gets a new hello message.
        if self.is_new {
            return true;
        }
        if !news.block.is_empty() && !self.offer(Out::Block(Arc::clone(&news.block)), false) {
            return false;
        }
        let Some(status) = &news.status else { return true };
        let text = format!(r#"{{"type":"status","status":{},"dropped":{}}}"#, status.trim_end(), self.dropped);
        // A status that finds the queue full is not sent again, because the next one replaces it.
        !matches!(self.queue.try_send(Out::Text(text.into())), Err(TrySendError::Disconnected(_)))
    }
}

/// What one call of [`Publisher::publish`] sends to the pages.
struct News {
    /// Messages about new channels and events. A page that misses one gets a new hello message.
    texts: Vec<Arc<str>>,
    /// The block of points since the last call.
    block: Arc<[u8]>,
    /// The newest point of each channel.
    newest: Arc<[u8]>,
    /// The counters of the link and the board as JSON, with every fifth block; otherwise `None`.
    status: Option<String>,
    /// The number of reports that were left out because the buffer was full.
    left_out: u64,
}

/// Makes the messages to the pages from the reports of the board.
struct Publisher {
    subject: Subject,
    feed: Feed,
    inbox: Arc<Mutex<Inbox>>,
    network: Option<KnownNetwork>,
    kinds: Kinds,
    sampler: Sampler,
    channels: Channels,
    events: Option<Events>,
    first_ns: Option<i64>,
    /// The number of channels and the number of events that the pages have been sent.
    told: (usize, u64),
    blocks: u32,
}

impl Publisher {
    fn new(subject: Subject, feed: Feed, inbox: Arc<Mutex<Inbox>>) -> Self {
        let mut publisher = Self {
            subject,
            feed,
            inbox,
            network: None,
            kinds: Kinds::new(None),
            sampler: Sampler::new(true),
            channels: Channels::default(),
            events: None,
            first_ns: None,
            told: (0, 0),
            blocks: 0,
        };
        publisher.look_at_network();
        publisher
    }

    /// Takes over from the link which slaves there are; returns whether that has changed. The server of a board reports its
    /// slaves again when a program has configured the network.
    fn look_at_network(&mut self) -> bool {
        let network = self.feed.network();
        if self.events.is_some() && network == self.network {
            return false;
        }
        let uri = as_reader(&self.subject.uri);
        let machine = self.subject.machine.as_deref();
        let kinds = monitor::known_kinds(self.subject.slaves.as_ref(), &uri, machine, network.clone());
        (self.network, self.kinds) = (network, Kinds::new(kinds.as_deref()));
        true
    }

    /// Makes messages from the reports that were read since the last call, and offers them to all pages.
    fn publish(&mut self, name: &str, pages: &Mutex<Vec<Page>>) {
        let (reports, size, left_out) = {
            let mut inbox = lock(&self.inbox);
            (std::mem::take(&mut inbox.reports), inbox.size, std::mem::take(&mut inbox.left_out))
        };
        let Some(size) = size else { return };
        self.blocks = self.blocks.wrapping_add(1);
        let is_status = self.blocks.is_multiple_of(BLOCKS_PER_STATUS);
        let is_other = is_status && self.look_at_network();
        let mut events = self.events.take().unwrap_or_else(|| Events::new(size, self.kinds.clone()));
        if is_other {
            events.set_kinds(self.kinds.clone());
        }
        self.take(&reports, size, &mut events);
        let news = self.news(&events, left_out, is_status, is_other);
        lock(pages).retain_mut(|page| page.deliver(&news, || self.hello(name, &events)));
        self.events = Some(events);
    }

    /// Adds what these reports show: events to `events`, and points to the channels.
    fn take(&mut self, reports: &[(i64, Frame)], size: SlotSize, events: &mut Events) {
        let machine = self.subject.machine.as_deref();
        let names = self.subject.names();
        for (at_ns, frame) in reports {
            let at_ns = at_ns - *self.first_ns.get_or_insert(*at_ns);
            events.frame(at_ns, Dir::Read, frame, machine);
            self.sampler.report(&mut self.channels, &names, at_ns, (frame, size), &self.kinds);
        }
    }

    /// Makes the messages for the pages: the points, channels and events since the last call. `is_status`: the status, which is
    /// the counters of the link and the board, is due. `is_other`: the network has other slaves than before.
    fn news(&mut self, events: &Events, left_out: u64, is_status: bool, is_other: bool) -> News {
        let block = self.channels.take_block().into();
        let (channels, found) = (self.channels.list(), events.found());
        let all_events = events.left_out() + found.len() as u64;
        let new_events = usize::try_from(all_events - self.told.1).unwrap_or(usize::MAX).min(found.len());
        let channels_text = (channels.len() != self.told.0 || is_other).then(|| {
            let known = slaves(&self.kinds, &self.subject.names());
            json!({"type": "channels", "channels": channels, "slaves": known}).to_string()
        });
        let events_text = (new_events > 0)
            .then(|| json!({"type": "events", "events": &found[found.len() - new_events..]}).to_string());
        self.told = (channels.len(), all_events);
        News {
            texts: channels_text.into_iter().chain(events_text).map(Arc::from).collect(),
            block,
            newest: self.channels.newest().into(),
            status: is_status.then(|| view_json::line(&self.feed.view().0)),
            left_out,
        }
    }

    /// The first message to a page: all slaves, channels and events so far.
    fn hello(&self, name: &str, events: &Events) -> Arc<str> {
        let hello = Hello {
            format: FORMAT,
            version: env!("CARGO_PKG_VERSION"),
            source: "board",
            name: name.to_owned(),
            notes: Vec::new(),
            slaves: slaves(&self.kinds, &self.subject.names()),
            words: Words::new(),
            channels: self.channels.list(),
            events: events.found(),
            spans: Vec::new(),
            plane: None,
            picture: Picture::of(self.subject.machine.as_deref()),
            block: String::new(),
        };
        let mut hello = json!(hello);
        hello["type"] = "hello".into();
        hello.to_string().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text() -> Out {
        Out::Text("{}".into())
    }

    fn block() -> Out {
        Out::Block([0].into())
    }

    /// A page that reads nothing loses blocks, which are counted. If it loses a message that it must not miss, it gets a
    /// new hello message.
    #[test]
    fn a_slow_page_loses_blocks_and_nobody_waits_for_it() {
        let (queue, messages) = sync_channel(2);
        let mut page = Page { queue, is_new: false, dropped: 0 };
        assert!((0..5).all(|_| page.offer(block(), false)));
        assert_eq!((page.dropped, page.is_new), (3, false));
        assert!(page.offer(text(), true));
        assert_eq!((page.dropped, page.is_new), (3, true));
        assert_eq!(messages.try_iter().count(), 2);
        assert!(page.offer(text(), true));
        drop(messages);
        assert!(!page.offer(block(), false), "it has gone");
    }
}
