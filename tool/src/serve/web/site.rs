//! The HTTP server of the page: its connections, each with a thread, and the checks of who may read the page and its
//! WebSocket.

use std::io;
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use data_encoding::HEXLOWER;

use super::WebError;
use super::client;
use super::hub::Hub;
use crate::serve::http::{self, Refusal, Request};
use crate::serve::http_server::HttpServer;
use crate::web::assembly::{Page, page};

/// The most connections at a time; each has a thread. \[OURS]
const CONNECTIONS_MAX: usize = 64;

/// What the page of the server shows.
pub enum Content {
    /// A recording: the page contains all of its data.
    Recording(Page),
    /// A board: the page gets its data over a WebSocket.
    Board(Arc<Hub>),
}

/// The running HTTP server of `ecmsk serve web`.
pub struct Site {
    server: HttpServer,
    token: String,
}

struct Shared {
    token: String,
    content: Content,
    stop: Arc<AtomicBool>,
}

impl Site {
    /// Starts to listen, and serves the page in a thread.
    ///
    /// # Errors
    /// [`WebError`] if the address cannot be listened on, or if the system gives no random token or no thread.
    pub fn start(listen: SocketAddr, content: Content) -> Result<Self, WebError> {
        let listener = TcpListener::bind(listen).map_err(|source| WebError::Listen { address: listen, source })?;
        let mut random = [0; 16];
        let system = |what, message: String| WebError::System { what, message };
        getrandom::fill(&mut random).map_err(|error| system("make a token", error.to_string()))?;
        let token = HEXLOWER.encode(&random);
        let shared = Shared { token: token.clone(), content, stop: Arc::default() };
        let stop = Arc::clone(&shared.stop);
        let serve = move |stream, request| shared.serve(stream, &request);
        let server = HttpServer::start(listener, "web", CONNECTIONS_MAX, stop, serve);
        Ok(Self { server: server.map_err(|error| system("start a thread", error.to_string()))?, token })
    }

    /// The address of the page.
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", self.server.address(), self.token)
    }

    /// Ends the server. Pages that are connected see their connections end.
    pub fn stop(self) {
        self.server.stop();
    }
}

const NO_TOKEN: Refusal = Refusal {
    status: "403 Forbidden",
    text: "The address lacks its token: open the address that `ecmsk serve web` has printed.",
};
const NOT_HERE: Refusal = Refusal {
    status: "403 Forbidden",
    text: "This server answers only to names of its own machine: open http://localhost with the port and the token.",
};
const OTHER_ORIGIN: Refusal =
    Refusal { status: "403 Forbidden", text: "Only the page of this server may connect to it." };
const NOT_GET: Refusal = Refusal { status: "405 Method Not Allowed", text: "This server only shows: use GET." };
const NOT_FOUND: Refusal = Refusal {
    status: "404 Not Found",
    text: "There is one page only: open the address that `ecmsk serve web` has printed.",
};
const NO_SOCKET: Refusal = Refusal { status: "400 Bad Request", text: "Here is a WebSocket, version 13." };
const FULL: Refusal =
    Refusal { status: "503 Service Unavailable", text: "Enough pages show this board: close one of them." };

/// What a permitted request asks for: the page, or the WebSocket with the client's key.
#[derive(Debug, PartialEq, Eq)]
enum Wish {
    Page,
    Socket(String),
}

impl Shared {
    fn serve(&self, mut stream: TcpStream, request: &Request) -> io::Result<()> {
        let answered = match wish(request, &self.token) {
            Err(refusal) => http::refuse(&mut stream, refusal),
            Ok(Wish::Page) => match &self.content {
                Content::Recording(page) => http::send_page(&mut stream, &page.html, &page.policy),
                Content::Board(hub) => {
                    let connect = format!("ws://{}", request.host);
                    let page = page(hub.name(), None::<&()>, Some(&connect)).map_err(io::Error::other)?;
                    http::send_page(&mut stream, &page.html, &page.policy)
                }
            },
            Ok(Wish::Socket(key)) => match &self.content {
                Content::Recording(_) => http::refuse(&mut stream, NOT_FOUND),
                Content::Board(hub) => match hub.join() {
                    None => http::refuse(&mut stream, FULL),
                    Some(queue) => return client::serve(stream, &key, &queue, &self.stop),
                },
            },
        };
        answered?;
        stream.shutdown(Shutdown::Both)
    }
}

/// Checks a request, and returns what it asks for.
///
/// # Errors
/// The refusal, if the request names another host than this machine, is not a GET, lacks the token, has an unknown path, or
/// opens the WebSocket from a page of another origin.
fn wish(request: &Request, token: &str) -> Result<Wish, Refusal> {
    if !http::is_this_machine(&request.host) {
        return Err(NOT_HERE);
    }
    if request.method != "GET" {
        return Err(NOT_GET);
    }
    if !http::is_same(&request.token, token) {
        return Err(NO_TOKEN);
    }
    match &*request.path {
        "/" => Ok(Wish::Page),
        "/live" if request.origin != format!("http://{}", request.host) => Err(OTHER_ORIGIN),
        "/live" => request.socket_key.clone().map(Wish::Socket).ok_or(NO_SOCKET),
        _ => Err(NOT_FOUND),
    }
}
