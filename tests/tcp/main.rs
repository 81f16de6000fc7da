//! A board on the network: the server, its links, and what strangers and bad lines do to them.

mod bounded;
mod link;
mod peers;
mod secret;
mod strangers;
mod vanish;
