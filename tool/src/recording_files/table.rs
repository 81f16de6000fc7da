//! The reports of a recording as rows of a table.

use std::io::{self, Write};

use ecmsk::link::Dir;
use ecmsk::recording::Kinds;
use ecmsk::sk::dump::{MAX_SLAVES, ResponseDump, SlotMeaning};
use ecmsk::sk::{
    DriveResponse, HspResponse, IoResponse, MasterResponse, MasterState, SlaveCommand, SlaveKind, SlotCommand,
};

use crate::recording::Framed;

/// Which columns of the table a slave has.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Columns {
    Axis,
    /// The first axis of a pulse module, which has no torque.
    Pulse,
    Bits,
}

/// Writes the CSV table: a line with the names of the columns, and a row for each report in OP.
pub struct Table<W> {
    out: W,
    /// The numbers of the slaves that the table has columns for; empty: all slaves.
    asked: Vec<u8>,
    kinds: Kinds,
    /// The slaves that have columns, by number. `None` before the first report in OP, whose slots show which slaves there
    /// are.
    slaves: Option<Vec<(u8, Columns)>>,
    /// The target that was sent last to each slave.
    targets: [Option<i32>; MAX_SLAVES],
    rows: u64,
}

impl<W: Write> Table<W> {
    /// Starts a table that is written to `out`. It has columns for the slaves with the numbers `asked`, or for all slaves
    /// if `asked` is empty.
    pub fn new(out: W, asked: Vec<u8>) -> Self {
        Self { out, asked, kinds: Kinds::new(None), slaves: None, targets: [None; MAX_SLAVES], rows: 0 }
    }

    /// Adds the next frame; frames are sorted by time.
    pub fn frame(&mut self, framed: &Framed) -> io::Result<()> {
        match framed.recorded.dir {
            Dir::Write => {
                self.command(framed);
                Ok(())
            }
            Dir::Read => self.report(framed),
        }
    }

    /// Completes the table, and returns the number of its rows.
    pub fn finish(mut self) -> io::Result<u64> {
        self.out.flush()?;
        Ok(self.rows)
    }

    fn command(&mut self, framed: &Framed) {
        let (frame, size) = (&framed.recorded.frame, framed.size);
        self.kinds.command(frame, size);
        for (n, target) in (1..=size.max_slaves()).zip(&mut self.targets) {
            match SlotCommand::decode(&frame.slot(size, n), size).map(|slot| slot.command) {
                Ok(SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion)) => *target = Some(motion.first.target),
                Ok(SlaveCommand::Cst(torque)) => *target = Some(torque.into()),
                _ => {}
            }
        }
    }

    fn report(&mut self, framed: &Framed) -> io::Result<()> {
        let (frame, size) = (&framed.recorded.frame, framed.size);
        self.kinds.response(frame, size);
        let board = MasterResponse::decode(&frame.slot(size, 0));
        if board.state.state() != Some(MasterState::Op) {
            return Ok(());
        }
        if self.slaves.is_none() {
            self.begin(framed)?;
        }
        let seconds = framed.time_ns as f64 / 1e9;
        write!(self.out, "{seconds:.9},{},{}", board.fifo_free, board.full_count)?;
        for (slave, columns) in self.slaves.iter().flatten() {
            let n = usize::from(*slave);
            let slot = frame.slot(size, n);
            match columns {
                Columns::Axis => {
                    let DriveResponse { statusword, position, torque, error_code, .. } = DriveResponse::decode(&slot);
                    let target = self.targets[n - 1].map(|target| target.to_string()).unwrap_or_default();
                    let torque = f64::from(torque) / 10.0;
                    write!(self.out, ",{target},{position},{torque},{},{error_code}", statusword.0)?;
                }
                Columns::Pulse => {
                    let HspResponse { statusword, first, .. } = HspResponse::decode(&slot, size);
                    let target = self.targets[n - 1].map(|target| target.to_string()).unwrap_or_default();
                    write!(self.out, ",{target},{},{}", first.position, statusword.0)?;
                }
                Columns::Bits => write!(self.out, ",{}", IoResponse::decode(&slot).bits)?,
            }
        }
        self.rows += 1;
        writeln!(self.out)
    }

    /// Finds the slaves in the first report in OP, and writes the names of the columns.
    fn begin(&mut self, framed: &Framed) -> io::Result<()> {
        let dump = ResponseDump::new(&framed.recorded.frame, framed.size);
        let guessed = |n: usize| match dump.line(n)?.meaning {
            SlotMeaning::SlaveResponse(reading) => reading.kind.kind(),
            _ => None,
        };
        let mut slaves = Vec::new();
        for n in 1..=framed.size.max_slaves() {
            let slave = n as u8;
            let columns = match self.kinds.of(n).or_else(|| guessed(n)) {
                Some(SlaveKind::Io) => Columns::Bits,
                Some(SlaveKind::Hsp) => Columns::Pulse,
                Some(SlaveKind::None) | None => continue,
                Some(_) => Columns::Axis,
            };
            if self.asked.is_empty() || self.asked.contains(&slave) {
                slaves.push((slave, columns));
            }
        }
        write!(self.out, "time_s,fifo_free,full_count")?;
        for (slave, columns) in &slaves {
            let names: &[&str] = match columns {
                Columns::Axis => &["target", "position", "torque_percent", "statusword", "error_code"],
                Columns::Pulse => &["target", "position", "statusword"],
                Columns::Bits => &["bits"],
            };
            names.iter().try_for_each(|name| write!(self.out, ",{slave}_{name}"))?;
        }
        self.slaves = Some(slaves);
        writeln!(self.out)
    }
}
