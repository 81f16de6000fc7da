//! `/metrics` and `/healthz`: what they answer, and to whom.

use std::io;
use std::net::{Shutdown, TcpStream};

use super::Shared;
use super::metrics::CONTENT_TYPE;
use crate::serve::http::{self, PLAIN, Refusal, Request};

const NOT_HERE: Refusal = Refusal {
    status: "403 Forbidden",
    text: "This server answers only to names of its own machine: ask http://localhost with the port, or start it with an address \
           of the network, --metrics ADDR:PORT.",
};
const NOT_GET: Refusal = Refusal { status: "405 Method Not Allowed", text: "This server only shows: use GET." };
const NOT_FOUND: Refusal = Refusal { status: "404 Not Found", text: "Here are /metrics and /healthz." };

/// Answers a request.
///
/// # Errors
/// The client does not take the answer.
pub fn serve(mut stream: TcpStream, request: &Request, shared: &Shared) -> io::Result<()> {
    match wish(request, shared.is_loopback) {
        Err(refusal) => http::refuse(&mut stream, refusal)?,
        Ok(Wish::Metrics) => http::send_text(&mut stream, "200 OK", CONTENT_TYPE, &shared.metrics())?,
        Ok(Wish::Health) => match shared.trouble() {
            None => http::send_text(&mut stream, "200 OK", PLAIN, &shared.health())?,
            Some(why) => http::send_text(&mut stream, "503 Service Unavailable", PLAIN, &format!("{why}\n"))?,
        },
    }
    stream.shutdown(Shutdown::Both)
}

#[derive(Debug, PartialEq, Eq)]
enum Wish {
    Metrics,
    Health,
}

/// Checks a request, and returns what it asks for. A server on the loopback address answers to names of this machine alone:
/// a page in a browser could give it another name.
fn wish(request: &Request, is_loopback: bool) -> Result<Wish, Refusal> {
    if is_loopback && !http::is_this_machine(&request.host) {
        return Err(NOT_HERE);
    }
    if request.method != "GET" {
        return Err(NOT_GET);
    }
    match &*request.path {
        "/metrics" => Ok(Wish::Metrics),
        "/healthz" => Ok(Wish::Health),
        _ => Err(NOT_FOUND),
    }
}
