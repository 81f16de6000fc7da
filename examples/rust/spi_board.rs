//! A board on SPI for a program of a microcontroller that was compiled for Linux: what its driver shifts out under one chip
//! select it writes to this program's standard input, and what it reads back is MISO.
//!
//! ```c
//! static void spi_exchange(const uint8_t *tx, uint8_t *rx) { /* 504 bytes each way, 512 with slot=16 */
//!     write_all(to_board, tx, 504);
//!     read_all(from_board, rx, 504);
//! }
//! ```
//!
//! A folder behind the link has the two lines, as files with `0` or `1` like those of a GPIO in `/sys`: `busy`, which this program
//! writes, and `resetn`, which the driver does. While BUSY is high (the board starts up, or RESETN is low) all bytes that come
//! back are 0.

use std::error::Error;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use ecmsk::link::{self, Share};
use ecmsk::port::spi::SpiBoard;

/// How often RESETN is read, and a board that is gone is looked for.
const LOOK: Duration = Duration::from_millis(1);

struct Board {
    link: String,
    spi: SpiBoard,
    lines: Option<Lines>,
    in_reset: bool,
}

struct Lines {
    busy: File,
    resetn: PathBuf,
}

impl Lines {
    fn open(folder: &Path) -> io::Result<Self> {
        let resetn = folder.join("resetn");
        fs::write(&resetn, "1")?;
        Ok(Self { busy: File::create(folder.join("busy"))?, resetn })
    }
}

impl Board {
    fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> io::Result<()> {
        self.look()?;
        self.show_busy(true)?;
        self.spi.exchange(tx, rx);
        self.show_busy(self.spi.is_busy())
    }

    /// Reads RESETN and shows BUSY. Reset or unplugged: the board is there again when it opens.
    fn look(&mut self) -> io::Result<()> {
        let is_low = self
            .lines
            .as_ref()
            .is_some_and(|lines| fs::read(&lines.resetn).is_ok_and(|level| level.first() == Some(&b'0')));
        if is_low && !std::mem::replace(&mut self.in_reset, is_low) {
            self.spi.reset();
        }
        self.in_reset = is_low;
        if self.spi.is_busy() && !is_low {
            self.spi.close();
            if let Ok(again) = link::open(&self.link, Share::ByName) {
                self.spi.replace(again);
            }
        }
        self.show_busy(self.spi.is_busy())
    }

    fn show_busy(&mut self, is_high: bool) -> io::Result<()> {
        let Some(Lines { busy, .. }) = &mut self.lines else { return Ok(()) };
        busy.rewind()?;
        busy.write_all(if is_high { b"1" } else { b"0" })
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    // queue=1: the board answers with the newest report. A name: the board is found again after its reset.
    let link = words.next().unwrap_or("sim:?slaves=drive&queue=1&name=mcu".to_owned());
    let lines = words.next().map(|folder| Lines::open(Path::new(&folder))).transpose()?;
    let spi = SpiBoard::new(link::open(&link, Share::ByName)?);
    let mut tx = vec![0; spi.frame_len()];
    let mut rx = tx.clone();
    let has_lines = lines.is_some();
    let board = Arc::new(Mutex::new(Board { link, spi, lines, in_reset: false }));
    if has_lines {
        let board = Arc::clone(&board);
        thread::spawn(move || -> io::Result<()> {
            loop {
                board.lock().unwrap_or_else(PoisonError::into_inner).look()?;
                thread::sleep(LOOK);
            }
        });
    }
    let (mut mosi, mut miso) = (io::stdin().lock(), io::stdout().lock());
    loop {
        match mosi.read_exact(&mut tx) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => break,
            whole => whole?,
        }
        board.lock().unwrap_or_else(PoisonError::into_inner).exchange(&tx, &mut rx)?;
        miso.write_all(&rx)?;
        miso.flush()?;
    }
    let mut board = board.lock().unwrap_or_else(PoisonError::into_inner);
    let counters = board.spi.counters();
    eprintln!("{} exchanges, {} of them while BUSY was high", counters.frames, counters.while_busy);
    board.spi.close();
    Ok(())
}
