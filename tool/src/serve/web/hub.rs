//! Makes messages from the reports of a board, and puts them into the queue of each page.
//!
//! The thread that reads the board only appends reports to a buffer. The thread of this module empties the buffer 20
//! times a second, makes one block of it, and offers the block to each queue. It never waits for a queue: a block that
//! finds a queue full is dropped and counted.

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
use crate::find::Search;
use crate::kind_list::KindList;
use crate::link_option::{ChosenLink, as_reader};
use crate::lock::lock;
use crate::monitor::source::Feed;
use crate::monitor::{self, json as view_json};
use crate::recording::Framed;
use crate::serve::watch::BoardWatch;
use crate::web::channels::Channels;
use crate::web::events::{Event, Events};
use crate::web::hello::{FORMAT, Hello, Names, Picture, Words, slaves};
use crate::web::sampler::Sampler;

/// The time between two blocks. \[OURS]
const BLOCK_INTERVAL: Duration = Duration::from_millis(50);
/// Every block of this number is followed by a message with the counters. \[OURS]
const BLOCKS_PER_STATUS: u32 = 5;
/// The largest number of reports in the buffer: those of two seconds at the fastest cycle, 250 us. Reports that find
/// the buffer full are dropped and counted. \[OURS]
const REPORTS_MAX: usize = 8000;
/// A condition of `--find` that becomes true again within this time, ns, is the same event: one that flickers must not hide
/// alarms. \[OURS]
const FOUND_APART_NS: i64 = 1_000_000_000;
/// The largest number of pages that show a board at the same time. \[OURS]
const PAGES_MAX: usize = 16;
/// The largest number of messages in the queue of a page, about 3 s. \[OURS]
const QUEUE_MAX: usize = 64;

/// A message to a page that shows a board.
#[derive(Clone)]
pub enum Out {
    /// A JSON object: the first message (hello), or new channels, events or counters.
    Text(Arc<str>),
    /// A binary message: the samples of all channels since the last one. A page that has just connected gets the newest
    /// sample of each channel first.
    Block(Arc<[u8]>),
}

/// The board that the pages show, and the options for showing it.
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
    /// The condition of `--find`, with its expression.
    pub find: Option<(String, Search)>,
    /// Whether pages may move axes, from `--control`.
    pub has_control: bool,
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

/// The queue to a connected page. A separate thread sends the queued messages over a WebSocket.
struct Page {
    queue: SyncSender<Out>,
    /// Whether the page needs the hello message with all channels and events: because it is new, or because its queue
    /// was full when a message for it could not be dropped.
    is_new: bool,
    /// The number of blocks that found the queue of this page full, plus the number of reports that were dropped for
    /// all pages.
    dropped: u64,
}

/// The buffer of reports that were read from the board and not yet sent to pages.
#[derive(Default)]
struct Inbox {
    reports: Vec<(i64, Frame)>,
    size: Option<SlotSize>,
    left_out: u64,
}

impl Hub {
    /// Opens the board, and starts the thread that makes messages from its reports.
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

    /// Ends the thread and closes the board. After that, a recording by `record=` of the link is complete.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = lock(&self.thread).take() {
            // A panic of the thread was already printed.
            let _ = thread.join();
        }
    }

    /// The link of the board.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The number of connected pages. Pages that have disconnected since the last message was sent still count.
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
    /// Puts a message into the queue of the page; returns whether the page is still connected. If the queue is full,
    /// the message is dropped and counted. With `must`, it is not counted, but the page gets a new hello message later.
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

    /// Puts the messages since the last call into the queue of the page. A new page gets instead the hello message of
    /// `hello`, with all channels and events so far, and the newest points. Returns whether the page is still
    /// connected.
    fn deliver(&mut self, news: &News, hello: impl Fn() -> Arc<str>) -> bool {
        self.dropped += news.left_out;
        if std::mem::take(&mut self.is_new) {
            // A new page gets the newest points at once, because it would show nothing if the board sends no further
            // reports.
            return self.offer(Out::Text(hello()), true) && self.offer(Out::Block(Arc::clone(&news.newest)), false);
        }
        if !news.texts.iter().all(|text| self.offer(Out::Text(Arc::clone(text)), true)) {
            return false;
        }
        // If a text was dropped, the page cannot interpret the following blocks, so it gets no block before the next
        // hello message.
        if self.is_new {
            return true;
        }
        if !news.block.is_empty() && !self.offer(Out::Block(Arc::clone(&news.block)), false) {
            return false;
        }
        let Some(status) = &news.status else { return true };
        let text = format!(r#"{{"type":"status","status":{},"dropped":{}}}"#, status.trim_end(), self.dropped);
        // A status that finds the queue full is dropped, because the next status replaces it.
        !matches!(self.queue.try_send(Out::Text(text.into())), Err(TrySendError::Disconnected(_)))
    }
}

/// The messages that one call of [`Publisher::publish`] sends to the pages.
struct News {
    /// Messages about new channels and events. If a page misses one of them, it gets a new hello message.
    texts: Vec<Arc<str>>,
    /// The block of points since the last call.
    block: Arc<[u8]>,
    /// The newest point of each channel.
    newest: Arc<[u8]>,
    /// The counters of the link and the board as JSON, with every fifth block; otherwise `None`.
    status: Option<String>,
    /// The number of reports that were dropped because the buffer was full.
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
    /// The time of the latest event of `--find`.
    found_ns: Option<i64>,
    /// The number of channels and the number of events that were already sent to the pages.
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
            found_ns: None,
            told: (0, 0),
            blocks: 0,
        };
        publisher.look_at_network();
        publisher
    }

    /// Reads from the link which slaves the network has; returns whether that has changed. The server of a board
    /// reports its slaves again after a program has configured the network.
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
        if let Some((_, search)) = self.subject.find.as_mut().filter(|_| is_other || self.first_ns.is_none()) {
            search.set_kinds(self.kinds.clone());
        }
        self.take(&reports, size, &mut events);
        let news = self.news(&events, left_out, is_status, is_other);
        lock(pages).retain_mut(|page| page.deliver(&news, || self.hello(name, &events)));
        self.events = Some(events);
    }

    /// Processes these reports: adds events to `events`, and points to the channels.
    fn take(&mut self, reports: &[(i64, Frame)], size: SlotSize, events: &mut Events) {
        let mut find = self.subject.find.take();
        let machine = self.subject.machine.as_deref();
        let names = self.subject.names();
        for (at_ns, frame) in reports {
            let at_ns = at_ns - *self.first_ns.get_or_insert(*at_ns);
            events.frame(at_ns, Dir::Read, frame, machine);
            if let Some((expression, search)) = &mut find {
                search.frame(&Framed::live(at_ns, Dir::Read, frame.clone(), size), true);
                let begun =
                    search.begun().filter(|at_ns| self.found_ns.is_none_or(|last| at_ns - last > FOUND_APART_NS));
                if let Some(at_ns) = begun {
                    self.found_ns = Some(at_ns);
                    events.add(Event::found(at_ns, expression));
                }
            }
            self.sampler.report(&mut self.channels, &names, at_ns, (frame, size), &self.kinds);
        }
        self.subject.find = find;
    }

    /// Makes the messages for the pages: points, channels and events since the last call. `is_status`: a message with
    /// the counters of the link and the board is due. `is_other`: the slaves of the network have changed.
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
            find: self.subject.find.as_ref().map(|(expression, _)| &**expression),
            block: String::new(),
        };
        let mut hello = json!(hello);
        hello["type"] = "hello".into();
        hello["control"] = self.subject.has_control.into();
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

    /// A page that reads nothing loses blocks, which are counted. If it loses a message that must not be dropped, it
    /// gets a new hello message.
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
