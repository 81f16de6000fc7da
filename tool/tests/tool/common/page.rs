//! Code for tests of the tool's page: the data in an HTML file and their points, its server, and a browser.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, Stdio};
use std::time::Duration;

use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

use super::run;
pub use super::serving::Serving;

/// The text of the element of a recording's page that contains its data as JSON.
#[track_caller]
pub fn data(html: &str) -> &str {
    let (_, rest) = html.split_once(r#"<script type="application/json" id="data">"#).expect("an element for data");
    rest.split_once("</script>").expect("its end").0
}

/// The hello message in the page of a recording: its slaves, channels and events.
#[track_caller]
pub fn hello(html: &str) -> Value {
    serde_json::from_str(data(html)).expect("JSON")
}

/// The points of a channel: the time in nanoseconds since the first frame, and the value in steps of the channel's factor.
pub type Points = Vec<(i64, i64)>;

/// The points of a block, by channel.
pub fn points(block: &[u8]) -> BTreeMap<usize, Points> {
    let (mut at, mut found) = (0, BTreeMap::<usize, Points>::new());
    let mut unsigned = || {
        let (mut value, mut shift) = (0, 0);
        loop {
            value |= u64::from(block[at] & 0x7F) << shift;
            (at, shift) = (at + 1, shift + 7);
            if block[at - 1] < 0x80 {
                return (value, at == block.len());
            }
        }
    };
    loop {
        let (channel, is_end) = unsigned();
        assert!(!is_end);
        let (_breaks, count) = (unsigned(), unsigned().0);
        let points = found.entry(channel as usize).or_default();
        let (mut time, mut step, mut value, mut is_end) = (0_i64, 0_i64, 0_i64, true);
        let signed = |value: u64| (value >> 1) as i64 ^ -((value & 1) as i64);
        for _ in 0..count {
            step += signed(unsigned().0);
            time += step;
            let (difference, end) = unsigned();
            (value, is_end) = (value + signed(difference), end);
            points.push((time, value));
        }
        if is_end {
            return found;
        }
    }
}

/// The index of the channel with this slave and quantity in the list of a hello message.
#[track_caller]
pub fn channel(hello: &Value, slave: u64, quantity: &str) -> usize {
    let channels = hello["channels"].as_array().expect("a list");
    let is_it = |channel: &Value| channel["slave"] == slave && channel["quantity"] == quantity;
    channels.iter().position(is_it).unwrap_or_else(|| panic!("no {quantity} of {slave} in {channels:?}"))
}

impl Serving {
    /// The host with the port, and the token, in the address of a page.
    pub fn host_and_token(&self) -> (&str, &str) {
        let (_, rest) = self.address().split_once("://").expect("an address of a page");
        rest.split_once("/?token=").expect("a token")
    }

    /// Sends an HTTP request with these lines to the server of the page; returns the head and the body of the answer.
    pub fn ask(&self, lines: &[&str]) -> (String, String) {
        ask(self.host_and_token().0, lines)
    }

    /// Opens a WebSocket as the page does; `None` if the server refuses it.
    pub fn socket(&self) -> Option<WebSocket<TcpStream>> {
        let (host, token) = self.host_and_token();
        let mut request = format!("ws://{host}/live?token={token}").into_client_request().expect("an address");
        request.headers_mut().insert("Origin", format!("http://{host}").parse().expect("a field"));
        let stream = TcpStream::connect(host).expect("it listens");
        Some(tungstenite::client(request, stream).ok()?.0)
    }
}

/// Connects with a server. Reading fails after two minutes: a server that takes what it should refuse ends no connection.
pub fn connect(host: &str) -> TcpStream {
    let stream = TcpStream::connect(host).expect("it listens");
    stream.set_read_timeout(Some(Duration::from_secs(120))).expect("a limit");
    stream
}

/// Sends an HTTP request with these lines to a server; returns the head and the body of the answer.
pub fn ask(host: &str, lines: &[&str]) -> (String, String) {
    let mut stream = connect(host);
    stream.write_all((lines.join("\r\n") + "\r\n\r\n").as_bytes()).expect("it reads");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("text");
    let (head, body) = answer.split_once("\r\n\r\n").expect("a head");
    (head.to_owned(), body.to_owned())
}

/// Runs the tool until it succeeds, at most 20 times: on a late machine a board on the real clock may run into a timeout.
#[track_caller]
pub fn insist(arguments: &[&str]) {
    const TRIES: usize = 20;
    let mut tries = (0..TRIES).map(|_| run(arguments));
    assert!(tries.any(|ran| ran.code == Some(0)), "{arguments:?} failed {TRIES} times");
}

/// The next message that is text, as JSON; blocks before it go to `blocks`.
pub fn next_text(socket: &mut WebSocket<TcpStream>, blocks: &mut Vec<Vec<u8>>) -> Value {
    loop {
        match socket.read().expect("a message") {
            Message::Text(text) => return serde_json::from_str(&text).expect("JSON"),
            Message::Binary(block) => blocks.push(block.to_vec()),
            other => panic!("{other:?}"),
        }
    }
}

/// A browser without a window, driven by its DevTools protocol.
pub struct Browser {
    child: Child,
    socket: WebSocket<TcpStream>,
    session: String,
    id: u64,
    _profile: tempfile::TempDir,
}

impl Browser {
    /// Starts Chromium and opens an empty page.
    pub fn start() -> Self {
        let profile = tempfile::tempdir().expect("a folder");
        let mut command = std::process::Command::new("chromium");
        // Chromium refuses its sandbox to root. No sandbox is needed, because only pages of this project are opened.
        command.args(["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"]);
        command.args(["--disable-extensions", "--disable-background-networking", "--hide-scrollbars"]);
        command.args(["--remote-debugging-port=0", "--window-size=1000,800", "about:blank"]);
        command.arg(format!("--user-data-dir={}", profile.path().display()));
        let mut child =
            command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect(
                "chromium is not there; `apt-get install chromium`, or skip the tests in modules needs_chromium",
            );
        let mut said = BufReader::new(child.stderr.take().expect("a pipe")).lines();
        let address = loop {
            let line = said.next().expect("it says where it listens").expect("text");
            if let Some(address) = line.strip_prefix("DevTools listening on ") {
                break address.to_owned();
            }
        };
        // Chromium would block if nobody read its standard error, so a thread goes on reading.
        std::thread::spawn(move || said.for_each(drop));
        let place = address.strip_prefix("ws://").and_then(|rest| rest.split('/').next()).expect(&address);
        let stream = TcpStream::connect(place).expect("it listens");
        let socket = tungstenite::client(&*address, stream).expect("a WebSocket").0;
        let mut browser = Self { child, socket, session: String::new(), id: 0, _profile: profile };
        let target = browser.call("Target.createTarget", json!({"url": "about:blank"}));
        let attached = browser.call("Target.attachToTarget", json!({"targetId": target["targetId"], "flatten": true}));
        browser.session = attached["sessionId"].as_str().expect("a session").to_owned();
        browser.call("Page.enable", json!({}));
        browser
    }

    /// Calls a function of the DevTools protocol; returns its result.
    #[track_caller]
    pub fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.id += 1;
        let mut request = json!({"id": self.id, "method": method, "params": parameters});
        if !self.session.is_empty() {
            request["sessionId"] = self.session.clone().into();
        }
        self.socket.send(Message::text(request.to_string())).expect("it reads");
        loop {
            let Message::Text(text) = self.socket.read().expect("an answer") else { continue };
            let mut answer: Value = serde_json::from_str(&text).expect("JSON");
            if answer["id"] == self.id {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].take();
            }
        }
    }

    /// Opens a page and waits until it shows its data.
    #[track_caller]
    pub fn open(&mut self, url: &str) {
        self.call("Page.navigate", json!({"url": url}));
        self.wait_for(&format!("location.href === {url:?} && document.documentElement.dataset.ready === 'yes'"));
    }

    /// The value of a JavaScript expression in the page. If it is a promise, its result is awaited.
    #[track_caller]
    pub fn value(&mut self, expression: &str) -> Value {
        let parameters = json!({"expression": expression, "awaitPromise": true, "returnByValue": true});
        let mut found = self.call("Runtime.evaluate", parameters);
        assert!(found["exceptionDetails"].is_null(), "{expression}: {}", found["exceptionDetails"]);
        found["result"]["value"].take()
    }

    /// Waits until a JavaScript expression is true in the page, for 1200 evaluations at most.
    #[track_caller]
    pub fn wait_for(&mut self, expression: &str) {
        // When the browser opens a new page, the promise in the page before ends with an error. So each evaluation is a request
        // of its own, and an error only leads to the next one.
        for _ in 0..1200 {
            let asked = format!("new Promise((done) => setTimeout(() => done(Boolean({expression})), 100))");
            let parameters = json!({"expression": asked, "awaitPromise": true, "returnByValue": true});
            self.id += 1;
            let mut request = json!({"id": self.id, "method": "Runtime.evaluate", "params": parameters});
            request["sessionId"] = self.session.clone().into();
            self.socket.send(Message::text(request.to_string())).expect("it reads");
            let answer = loop {
                let Message::Text(text) = self.socket.read().expect("an answer") else { continue };
                let answer: Value = serde_json::from_str(&text).expect("JSON");
                if answer["id"] == self.id {
                    break answer;
                }
            };
            if answer["result"]["result"]["value"] == true {
                return;
            }
        }
        let shown = self.value("document.body ? document.body.innerText.slice(0, 2000) : ''");
        panic!("never true: {expression}; the page shows: {shown}");
    }

    /// What keeps people out of the page as it is now, by all rules of axe-core: each rule that it breaks, with the elements.
    #[track_caller]
    pub fn barriers(&mut self) -> Vec<String> {
        let file = support::target_dir().join("xtask/axe-core-4.14.1.d/axe.min.js");
        let axe = std::fs::read_to_string(&file).unwrap_or_else(|error| {
            panic!(
                "{}: {error}; `cargo xtask test --all` fetches it, or skip the tests in modules needs_axe",
                file.display()
            )
        });
        self.value(&format!("{axe}; 1"));
        let found = self.value(
            "axe.run().then(({ violations }) => violations.map(({ impact, help, nodes }) => \
             `${impact}: ${help}: ${nodes.map(({ html, failureSummary }) => html + failureSummary).join()}`))",
        );
        serde_json::from_value(found).expect("a list of texts")
    }

    /// Presses a key.
    pub fn press(&mut self, key: &str) {
        for kind in ["keyDown", "keyUp"] {
            self.call(
                "Input.dispatchKeyEvent",
                json!({"type": kind, "key": key, "text": if kind == "keyDown" && key.len() == 1 { key } else { "" }}),
            );
        }
    }

    /// A picture of the page as PNG.
    pub fn picture(&mut self) -> Vec<u8> {
        let shot = self.call("Page.captureScreenshot", json!({"format": "png"}));
        data_encoding::BASE64.decode(shot["data"].as_str().expect("a picture").as_bytes()).expect("base64")
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
