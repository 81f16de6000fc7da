//! The HTTP server of the page. It checks who may read the page and open its WebSocket, and answers the requests.

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use data_encoding::HEXLOWER;

use super::WebError;
use super::certificate::host_of;
use super::client::{self, Hears};
use super::control::Controls;
use super::hub::Hub;
use crate::serve::http::{self, Refusal, Request};
use crate::serve::http_server::HttpServer;
use crate::serve::http_stream::{Stream, Tls};
use crate::web::assembly::{Page, page};

/// The largest number of connections at the same time; each has a thread. \[OURS]
const CONNECTIONS_MAX: usize = 64;

/// The length of the token in the page's address, bytes.
pub const TOKEN_LEN: usize = 16;

/// What the page of the server shows.
pub enum Content {
    /// A recording: the page contains all of its data.
    Recording(Page),
    /// A board: the page gets its data over a WebSocket, and with `--control` may move its axes.
    Board(Arc<Hub>, Option<Arc<Controls>>),
}

/// The running HTTP server of `ecmsk serve web`.
pub struct Site {
    server: HttpServer,
    token: String,
    way: Way,
}

/// How pages come to the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    /// HTTP, from this machine alone.
    Here,
    /// HTTPS, from any machine.
    Secured,
}

impl Way {
    const fn page_scheme(self) -> &'static str {
        match self {
            Self::Here => "http",
            Self::Secured => "https",
        }
    }

    const fn socket_scheme(self) -> &'static str {
        match self {
            Self::Here => "ws",
            Self::Secured => "wss",
        }
    }
}

struct Shared {
    way: Way,
    token: String,
    content: Content,
    stop: Arc<AtomicBool>,
}

impl Site {
    /// Starts to listen, and serves the page in a thread: over HTTPS with `tls`. `token` is that of the page's address; a
    /// new one is made without it.
    ///
    /// # Errors
    /// [`WebError`] if the address cannot be listened on, or if the system provides no random token or no thread.
    pub fn start(
        listen: SocketAddr,
        tls: Option<Tls>,
        token: Option<[u8; TOKEN_LEN]>,
        content: Content,
    ) -> Result<Self, WebError> {
        let listener = TcpListener::bind(listen).map_err(|source| WebError::Listen { address: listen, source })?;
        let system = |what, message: String| WebError::System { what, message };
        let token = token.map_or_else(random_token, Ok).map_err(|message| system("make a token", message))?;
        let token = HEXLOWER.encode(&token);
        let way = if tls.is_some() { Way::Secured } else { Way::Here };
        let shared = Shared { way, token: token.clone(), content, stop: Arc::default() };
        let stop = Arc::clone(&shared.stop);
        let serve = move |stream, request| shared.serve(stream, &request);
        let server = HttpServer::start(listener, "web", CONNECTIONS_MAX, tls, stop, serve);
        let server = server.map_err(|error| system("start a thread", error.to_string()))?;
        Ok(Self { server, token, way })
    }

    /// The address of the page.
    pub fn url(&self) -> String {
        let listen = self.server.address();
        format!("{}://{}:{}/?token={}", self.way.page_scheme(), host_of(listen), listen.port(), self.token)
    }

    /// Ends the server and the connections of the pages.
    pub fn stop(self) {
        self.server.stop();
    }
}

fn random_token() -> Result<[u8; TOKEN_LEN], String> {
    let mut random = [0; TOKEN_LEN];
    getrandom::fill(&mut random).map_err(|error| error.to_string())?;
    Ok(random)
}

const NO_TOKEN: Refusal = Refusal {
    status: "403 Forbidden",
    text: "The address lacks its token: open the address that `ecmsk serve web` has printed.",
};
const NOT_HERE: Refusal = Refusal {
    status: "403 Forbidden",
    text: "This server answers only to names of its own machine: open http://localhost with the port and the token.",
};
const NO_HOST: Refusal = Refusal {
    status: "400 Bad Request",
    text: "The request names no host: open the address that `ecmsk serve web` has printed.",
};
const OTHER_ORIGIN: Refusal =
    Refusal { status: "403 Forbidden", text: "Only the page of this server may connect to it." };
const NOT_GET: Refusal = Refusal { status: "405 Method Not Allowed", text: "This server answers GET alone." };
const NOT_FOUND: Refusal = Refusal {
    status: "404 Not Found",
    text: "There is one page only: open the address that `ecmsk serve web` has printed.",
};
const NO_SOCKET: Refusal = Refusal { status: "400 Bad Request", text: "Here is a WebSocket, version 13." };
const FULL: Refusal =
    Refusal { status: "503 Service Unavailable", text: "Enough pages show this board: close one of them." };

/// What an allowed request asks for: the page, or the WebSocket, with the key that the client has sent.
#[derive(Debug, PartialEq, Eq)]
enum Wish {
    Page,
    Socket(String),
}

impl Shared {
    fn serve(&self, mut stream: Stream, request: &Request) -> io::Result<()> {
        let answered = match wish(request, &self.token, self.way) {
            Err(refusal) => http::refuse(&mut stream, refusal),
            Ok(Wish::Page) => match &self.content {
                Content::Recording(page) => http::send_page(&mut stream, &page.html, &page.policy),
                Content::Board(hub, _) => {
                    let connect = format!("{}://{}", self.way.socket_scheme(), request.host);
                    let page = page(hub.name(), None::<&()>, Some(&connect)).map_err(io::Error::other)?;
                    http::send_page(&mut stream, &page.html, &page.policy)
                }
            },
            Ok(Wish::Socket(key)) => match &self.content {
                Content::Recording(_) => http::refuse(&mut stream, NOT_FOUND),
                Content::Board(hub, controls) => match hub.join() {
                    None => http::refuse(&mut stream, FULL),
                    Some(queue) => {
                        let mut control = controls.as_ref().map(Controls::join);
                        let hears = control.as_mut().map(|control| control as &mut dyn Hears);
                        return client::serve(stream, &key, &queue, &self.stop, hears);
                    }
                },
            },
        };
        answered?;
        stream.finish()
    }
}

/// Checks a request, and returns what it asks for.
///
/// # Errors
/// The refusal, if the request names another host than this machine, is not a GET, lacks the token, has an unknown path, or
/// opens the WebSocket from a page of another origin. With HTTPS any name counts: a browser that takes this server for another
/// site misses the certificate of that site.
fn wish(request: &Request, token: &str, way: Way) -> Result<Wish, Refusal> {
    match way {
        Way::Here if !http::is_this_machine(&request.host) => return Err(NOT_HERE),
        Way::Secured if !http::is_host(&request.host) => return Err(NO_HOST),
        Way::Here | Way::Secured => {}
    }
    if request.method != "GET" {
        return Err(NOT_GET);
    }
    if !http::is_same(&request.token, token) {
        return Err(NO_TOKEN);
    }
    match &*request.path {
        "/" => Ok(Wish::Page),
        "/live" if request.origin != format!("{}://{}", way.page_scheme(), request.host) => Err(OTHER_ORIGIN),
        "/live" => request.socket_key.clone().map(Wish::Socket).ok_or(NO_SOCKET),
        _ => Err(NOT_FOUND),
    }
}
