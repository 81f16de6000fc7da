//! A host, written from the page docs/XF-PORT.md, and a link to a chip based on it.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream};
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use ecmsk::ethercat::Ns;
use ecmsk::link::chip::{self, ChipError, ChipInfo, ChipLink};
use ecmsk::port::xf::{Listen, Options, Server};
use ecmsk::xf::host::Wires;

/// No server takes longer to react.
const PATIENCE: Duration = Duration::from_secs(60);
pub const EXCHANGE: u8 = 1;
pub const WAIT_INT0: u8 = 2;
pub const INT1: u8 = 3;
pub const DELAY: u8 = 4;
pub const CLOSE: u8 = 5;
pub const RESET: u8 = 6;

/// The lines of a server's log.
#[derive(Clone, Default)]
pub struct Log(Arc<Mutex<Vec<String>>>);

impl Log {
    pub fn lines(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn teller(&self) -> Arc<dyn Fn(&str) + Send + Sync> {
        let lines = Arc::clone(&self.0);
        Arc::new(move |line| lines.lock().unwrap_or_else(PoisonError::into_inner).push(line.to_owned()))
    }
}

/// Any free port of this machine.
pub fn any_port() -> Listen {
    "127.0.0.1:0".parse().expect("an address")
}

/// Serves the chip of a link with these options, except for the address and the log, which are returned.
pub fn serve_with(uri: &str, options: Options) -> (Server, Log) {
    let (uri, log) = (uri.to_owned(), Log::default());
    let options = Options { tell: log.teller(), ..options };
    (Server::start(move || chip::open(&uri), options).expect("it can be served"), log)
}

/// Serves the chip of a link on any port.
pub fn serve(uri: &str) -> (Server, Log) {
    serve_with(uri, Options { listen: any_port(), ..Options::default() })
}

/// A socket of either kind.
#[derive(Debug)]
pub enum Socket {
    Tcp(TcpStream),
    Unix(UnixStream),
}

impl Socket {
    fn write_all(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.write_all(bytes),
            Self::Unix(stream) => stream.write_all(bytes),
        }
    }

    fn read_exact(&mut self, bytes: &mut [u8]) -> std::io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.read_exact(bytes),
            Self::Unix(stream) => stream.read_exact(bytes),
        }
    }
}

/// A connection to a server.
#[derive(Debug)]
pub struct Client {
    pub socket: Socket,
    /// The server's first message.
    pub greeting: (u8, u8, Vec<u8>),
}

impl Client {
    pub fn connect(to: &Listen) -> Self {
        let socket = match to {
            Listen::Tcp(address) => Socket::Tcp(TcpStream::connect(address).expect("it listens")),
            Listen::Unix(path) => Socket::Unix(UnixStream::connect(path).expect("it listens")),
        };
        let mut client = Self { socket, greeting: (0, 0, Vec::new()) };
        client.greeting = client.receive().expect("a greeting");
        client
    }

    /// As [`Client::connect`], once the server has noticed the end of the previous host.
    pub fn connect_when_free(to: &Listen) -> Self {
        let began = Instant::now();
        loop {
            let client = Self::connect(to);
            if client.greeting.1 == 0 {
                return client;
            }
            assert!(began.elapsed() < PATIENCE, "{:?}", client.greeting);
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    pub fn send(&mut self, bytes: &[u8]) {
        self.socket.write_all(bytes).expect("it takes bytes");
    }

    /// The next message: kind, status, body; `None`: the connection has ended.
    pub fn receive(&mut self) -> Option<(u8, u8, Vec<u8>)> {
        let mut head = [0; 4];
        self.socket.read_exact(&mut head).ok()?;
        let mut body = vec![0; usize::from(u16::from_le_bytes([head[2], head[3]]))];
        self.socket.read_exact(&mut body).ok()?;
        Some((head[0], head[1], body))
    }

    pub fn send_request(&mut self, kind: u8, body: &[u8]) -> std::io::Result<()> {
        let mut message = vec![kind, 0];
        message.extend((body.len() as u16).to_le_bytes());
        message.extend(body);
        self.socket.write_all(&message)
    }

    /// The status and the body of the answer to a request.
    pub fn ask(&mut self, kind: u8, body: &[u8]) -> (u8, Vec<u8>) {
        self.send_request(kind, body).expect("it takes requests");
        let (answered, status, body) = self.receive().expect("an answer");
        assert_eq!(answered, kind);
        (status, body)
    }

    pub fn exchange(&mut self, bytes: &[u8]) -> Vec<u8> {
        let (status, body) = self.ask(EXCHANGE, bytes);
        assert_eq!((status, body.len()), (0, bytes.len()));
        body
    }

    /// Ends the connection without a message, as the system does for a killed process.
    pub fn hang_up(&self) {
        match &self.socket {
            Socket::Tcp(stream) => stream.shutdown(Shutdown::Both),
            Socket::Unix(stream) => stream.shutdown(Shutdown::Both),
        }
        .expect("it is connected");
    }
}

/// A link to the chip behind a server, with a clock of its own.
pub struct Remote {
    pub client: Client,
    now: Ns,
}

impl Remote {
    pub fn connect(to: &Listen) -> Self {
        let client = Client::connect(to);
        assert_eq!(client.greeting.1, 0, "{:?}", client.greeting);
        Self { client, now: 0 }
    }

    fn call(&mut self, kind: u8, body: &[u8]) -> Result<Vec<u8>, ChipError> {
        let failed = |message: String| ChipError::Wires { name: "remote".to_owned(), message };
        self.client.send_request(kind, body).map_err(|error| failed(error.to_string()))?;
        match self.client.receive() {
            Some((_, 0, body)) => Ok(body),
            Some((_, _, text)) => Err(failed(String::from_utf8_lossy(&text).into_owned())),
            None => Err(failed("the connection has ended".to_owned())),
        }
    }
}

impl Wires for Remote {
    type Error = ChipError;

    fn now(&self) -> Ns {
        self.now
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), ChipError> {
        from_chip.copy_from_slice(&self.call(EXCHANGE, to_chip)?);
        self.now += to_chip.len() as Ns * 333;
        Ok(())
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), ChipError> {
        while self.now < time {
            let micros = (time - self.now).div_ceil(1000).min(1_000_000) as u32;
            self.call(DELAY, &micros.to_le_bytes())?;
            self.now += Ns::from(micros) * 1000;
        }
        Ok(())
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, ChipError> {
        self.wait_until(until).map(|()| false)
    }
}

impl ChipLink for Remote {
    fn info(&self) -> ChipInfo {
        ChipInfo { name: "remote".to_owned(), size: None, clock_hz: None, has_int0: false, virtual_time: true }
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        Ok(Some(self.call(INT1, &[])? == [1]))
    }
}
