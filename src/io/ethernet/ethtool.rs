//! Reads those settings of a network card that can delay frames, as `ethtool` shows them.
//!
//! Each request is a structure of the kernel's `ethtool.h` that consists only of 32-bit numbers, the first of which is
//! the command.

use std::os::fd::AsRawFd;

use rustix::net::{AddressFamily, SocketType, socket};

use super::interface::request_about;

/// The settings of a network card; `None` where its driver does not report a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CardSettings {
    /// How long the card waits for further frames before it reports a received frame to the kernel, in us (interrupt
    /// coalescing).
    pub rx_usecs: Option<u32>,
    /// How long the card waits before it reports to the kernel that frames were sent, in us (interrupt coalescing).
    pub tx_usecs: Option<u32>,
    /// Whether the card adapts the waiting time for received frames to the traffic by itself.
    pub adaptive_rx: Option<bool>,
    /// Whether the kernel merges received frames (generic receive offload).
    pub gro: Option<bool>,
    /// Whether the card merges received frames (large receive offload).
    pub lro: Option<bool>,
    /// Whether the card splits long frames (TCP segmentation offload).
    pub tso: Option<bool>,
    /// Whether Energy Efficient Ethernet is on: the link sleeps between frames.
    pub eee: Option<bool>,
}

const SIOCETHTOOL: u32 = 0x8946;
const GET_COALESCING: u32 = 0x0E;
const GET_TSO: u32 = 0x1E;
const GET_FLAGS: u32 = 0x25;
const GET_GRO: u32 = 0x2B;
const GET_EEE: u32 = 0x44;
/// The bit for large receive offload in the flags of `ETHTOOL_GFLAGS`.
const FLAG_LRO: u32 = 1 << 15;

/// Reads the settings of the network card with the interface name `interface`.
pub fn settings(interface: &str) -> CardSettings {
    let Ok(socket) = socket(AddressFamily::INET, SocketType::DGRAM, None) else { return CardSettings::default() };
    // The lengths of the structures in 32-bit numbers: ethtool_coalesce has the command and 22 numbers, ethtool_value
    // the command and one number, ethtool_eee the command and nine numbers.
    let coalescing = ask::<23>(&socket, interface, GET_COALESCING);
    let value = |command| ask::<2>(&socket, interface, command).map(|[_, value]| value);
    CardSettings {
        rx_usecs: coalescing.map(|numbers| numbers[1]),
        tx_usecs: coalescing.map(|numbers| numbers[5]),
        adaptive_rx: coalescing.map(|numbers| numbers[10] != 0),
        gro: value(GET_GRO).map(|on| on != 0),
        lro: value(GET_FLAGS).map(|flags| flags & FLAG_LRO != 0),
        tso: value(GET_TSO).map(|on| on != 0),
        eee: ask::<10>(&socket, interface, GET_EEE).map(|numbers| numbers[5] != 0),
    }
}

/// Sends a request to the driver of an interface; `None` if it does not answer.
fn ask<const N: usize>(socket: &impl AsRawFd, interface: &str, command: u32) -> Option<[u32; N]> {
    let mut numbers = [0; N];
    numbers[0] = command;
    let mut request = request_about(interface)?;
    request.ifr_ifru.ifru_data = numbers.as_mut_ptr().cast();
    // SAFETY: the request points to `numbers`, which lives until the call returns and has room for everything that the
    // kernel writes for this command.
    let answer = unsafe { libc::ioctl(socket.as_raw_fd(), SIOCETHTOOL as _, &raw mut request) };
    (answer == 0).then_some(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An interface that does not exist, or whose name is too long, has no settings. The loopback interface answers
    /// some requests.
    #[test]
    fn who_does_not_answer_has_no_settings() {
        for name in ["", "no_such_card", "a_name_that_is_longer_than_any"] {
            assert_eq!(settings(name), CardSettings::default(), "{name}");
        }
        let lo = settings("lo");
        assert_eq!((lo.rx_usecs, lo.eee), (None, None), "it has neither");
        assert!(lo.tso.is_some() && lo.gro.is_some(), "{lo:?}");
    }
}
