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
//! While BUSY would be high (the board starts up after SW_RESET) all bytes that come back are 0.

use std::error::Error;
use std::io::{self, ErrorKind, Read as _, Write as _};

use ecmsk::link::{self, Share};
use ecmsk::port::spi::SpiBoard;

fn main() -> Result<(), Box<dyn Error>> {
    // queue=1: the board answers with the newest report. A name: the board is found again after its reset.
    let link = std::env::args().nth(1).unwrap_or("sim:?slaves=drive&queue=1&name=mcu".to_owned());
    let mut spi_board = SpiBoard::new(link::open(&link, Share::ByName)?);
    let mut tx = vec![0; spi_board.frame_len()];
    let mut rx = tx.clone();
    let (mut mosi, mut miso) = (io::stdin().lock(), io::stdout().lock());
    loop {
        match mosi.read_exact(&mut tx) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => break,
            whole => whole?,
        }
        // Reset or unplugged: it is there again when it opens.
        if spi_board.is_busy() {
            spi_board.close();
            if let Ok(again) = link::open(&link, Share::ByName) {
                spi_board.replace(again);
            }
        }
        spi_board.exchange(&tx, &mut rx);
        miso.write_all(&rx)?;
        miso.flush()?;
    }
    let counters = spi_board.counters();
    eprintln!("{} exchanges, {} of them while BUSY was high", counters.frames, counters.while_busy);
    spi_board.close();
    Ok(())
}
