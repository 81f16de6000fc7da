//! The client of a control socket.

use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::{ControlError, Happened, place};

/// How long a board may take to parse an event. \[OURS]
const PARSE_LIMIT: Duration = Duration::from_secs(10);

/// An event that waits for the next cycle of a board. Dropping this value before the event has happened cancels the
/// event.
///
/// ```no_run
/// use std::time::Duration;
/// use ecmsk::link::control::Injection;
///
/// let happened = Injection::begin("press", "alarm 2 0x7500")?.wait(Duration::from_secs(10))?;
/// println!("cycle {}, {} ns", happened.cycle, happened.at_ns);
/// # Ok::<(), ecmsk::link::control::ControlError>(())
/// ```
#[derive(Debug)]
pub struct Injection {
    path: PathBuf,
    connection: BufReader<UnixStream>,
    /// The part of the next line that was received so far.
    line: String,
}

impl Injection {
    /// Sends an event, such as `alarm 2 0x7500`, to a board. `name` is the name or the path of the board's control
    /// socket. When the call returns, the event has been parsed and waits for the board's next cycle.
    ///
    /// # Errors
    /// [`ControlError`]; the event has no effect then.
    pub fn begin(name: &str, event: &str) -> Result<Self, ControlError> {
        let path = place(name)?;
        let connection = UnixStream::connect(&path).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::ConnectionRefused => {
                ControlError::NotRunning { name: name.to_owned(), running: super::place::running() }
            }
            _ => failed(&path, error.to_string()),
        })?;
        // The server reads only one line, so text after an end of line would be lost.
        let line = event.replace(['\n', '\r'], " ");
        let mut injection = Self { path, connection: BufReader::new(connection), line: String::new() };
        let sent = injection.connection.get_mut().write_all(format!("{line}\n").as_bytes());
        sent.map_err(|error| failed(&injection.path, error.to_string()))?;
        match injection.next(PARSE_LIMIT)? {
            Some(answer) if answer == "taken" => Ok(injection),
            Some(answer) => Err(injection.refused(&answer)),
            None => Err(failed(&injection.path, "it does not answer".to_owned())),
        }
    }

    /// Waits until the event has happened, at most for `limit`. After [`ControlError::Unanswered`] the event is still
    /// waiting, and the call may be repeated.
    ///
    /// # Errors
    /// [`ControlError::Failed`]: the board was closed, or too many events with `for` are active.
    /// [`ControlError::Unanswered`]: no cycle has begun within `limit`. [`ControlError::Io`]: the connection failed.
    pub fn wait(&mut self, limit: Duration) -> Result<Happened, ControlError> {
        let Some(answer) = self.next(limit)? else { return Err(ControlError::Unanswered(limit)) };
        let numbers = answer.strip_prefix("done ").and_then(|numbers| numbers.split_once(' '));
        let happened =
            numbers.and_then(|(cycle, at)| Some(Happened { cycle: cycle.parse().ok()?, at_ns: at.parse().ok()? }));
        happened.ok_or_else(|| self.refused(&answer))
    }

    /// Reads the next line from the board; `None` if it is not complete within `limit`.
    fn next(&mut self, limit: Duration) -> Result<Option<String>, ControlError> {
        let deadline = Instant::now() + limit;
        loop {
            // `set_read_timeout` refuses a timeout of 0.
            let left = deadline.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
            let read = self
                .connection
                .get_ref()
                .set_read_timeout(Some(left))
                .and_then(|()| self.connection.read_line(&mut self.line));
            match read {
                Ok(_) if self.line.ends_with('\n') => {
                    return Ok(Some(std::mem::take(&mut self.line).trim_end().to_owned()));
                }
                Ok(_) => return Err(failed(&self.path, "it was closed".to_owned())),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                    if Instant::now() >= deadline {
                        return Ok(None);
                    }
                }
                Err(error) => return Err(failed(&self.path, error.to_string())),
            }
        }
    }

    fn refused(&self, answer: &str) -> ControlError {
        match (answer.strip_prefix("wrong "), answer.strip_prefix("failed ")) {
            (Some(text), _) => ControlError::Wrong { text: text.to_owned() },
            (_, Some(text)) => ControlError::Failed { text: text.to_owned() },
            _ => failed(&self.path, format!("it answers `{answer}`, as no board of this version does")),
        }
    }
}

fn failed(path: &Path, message: String) -> ControlError {
    ControlError::Io { path: path.display().to_string(), message }
}
