//! Answers requests for `/metrics` and `/healthz`, and checks who may send them.

use std::io;

use super::Shared;
use super::metrics::CONTENT_TYPE;
use crate::serve::http::{self, PLAIN, Refusal, Request};
use crate::serve::http_stream::Stream;

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
/// The client does not receive the answer.
pub fn serve(mut stream: Stream, request: &Request, shared: &Shared) -> io::Result<()> {
    match wish(request, shared.is_loopback) {
        Err(refusal) => http::refuse(&mut stream, refusal)?,
        Ok(Wish::Metrics) => http::send_text(&mut stream, "200 OK", CONTENT_TYPE, &shared.metrics())?,
        Ok(Wish::Health) => match shared.trouble() {
            None => http::send_text(&mut stream, "200 OK", PLAIN, &shared.health())?,
            Some(why) => http::send_text(&mut stream, "503 Service Unavailable", PLAIN, &format!("{why}\n"))?,
        },
    }
    stream.finish()
}

#[derive(Debug, PartialEq, Eq)]
enum Wish {
    Metrics,
    Health,
}

/// Checks a request and returns what it asks for. A server on the loopback address only answers requests that name this
/// machine as their host, to prevent DNS rebinding: see [`http::is_this_machine`].
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
