//! Converts the reports of a recording to rows of a table, which a [`Format`] writes.

use std::io;

use ecmsk::link::Dir;
use ecmsk::recording::{Clock, Kinds, RecordMeta};
use ecmsk::sk::dump::{MAX_SLAVES, ResponseDump, SlotMeaning};
use ecmsk::sk::{
    DriveResponse, HspResponse, IoResponse, MasterResponse, MasterState, SlaveCommand, SlaveKind, SlotCommand,
};

use crate::filter::Times;
use crate::recording::{Framed, link_name};

/// The type of the values of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    I32,
    U16,
    /// A number of tenths of a percent, which is written in percent.
    Percent,
}

/// A column of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    pub name: &'static str,
    pub ty: Type,
    /// A description of the values, with their unit.
    pub about: &'static str,
}

/// The kind of a group of columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    Board,
    Axis,
    /// The first axis of a pulse module, which has no torque.
    Pulse,
    Bits,
}

const fn column(name: &'static str, ty: Type, about: &'static str) -> Column {
    Column { name, ty, about }
}

const TARGET: Column = column("target", Type::I32, "the target that was sent last, counts");
const POSITION: Column = column("position", Type::I32, "the actual position, counts");
const STATUSWORD: Column = column("statusword", Type::U16, "the statusword, object 0x6041");

const OF_BOARD: &[Column] = &[
    column("fifo_free", Type::U16, "free entries of the FIFO"),
    column("full_count", Type::U16, "command frames that were lost because the FIFO was full, modulo 65536"),
    column("crc_errors", Type::U16, "command frames with a wrong CRC, modulo 256"),
    column("state", Type::U16, "byte 2 of slot 0: 8 is OP, 24 is OP with a lost slave"),
];
const OF_AXIS: &[Column] = &[
    TARGET,
    POSITION,
    column("torque_percent", Type::Percent, "the actual torque, percent of the rated torque"),
    STATUSWORD,
    column("error_code", Type::U16, "the error code, object 0x603F"),
];
const OF_PULSE: &[Column] = &[TARGET, POSITION, STATUSWORD];
const OF_BITS: &[Column] = &[column("bits", Type::U16, "the inputs, or outputs in the answer to IO_WR, a bit each")];

impl Part {
    /// The columns of this group, in their order.
    pub const fn columns(self) -> &'static [Column] {
        match self {
            Self::Board => OF_BOARD,
            Self::Axis => OF_AXIS,
            Self::Pulse => OF_PULSE,
            Self::Bits => OF_BITS,
        }
    }
}

/// The columns of one slave, or of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    /// The number of the slave, from 1; 0 for the board.
    pub slave: u8,
    pub part: Part,
}

/// The properties of a table that are known before its first row.
pub struct Head<'a> {
    pub groups: &'a [Group],
    /// The link in the recording; `None` if the recording does not name it.
    pub link: Option<String>,
    /// Whether the times are those of a virtual clock. Otherwise they are relative to 1970-01-01, UTC.
    pub is_virtual: bool,
}

/// A row of the table, which is made from a report in OP.
pub struct Row<'a> {
    /// The time of the report, ns, with jumps of the clock removed.
    pub at_ns: u64,
    /// The time of the report since the first frame of the recording, ns.
    pub time_ns: i64,
    /// The values of all columns, in the order of the groups; `None` for an unknown value.
    pub values: &'a [Option<i64>],
}

/// Writes a table to a file in a certain format.
pub trait Format {
    /// Begins the table, before its first row.
    fn begin(&mut self, head: &Head) -> io::Result<()>;

    fn row(&mut self, row: &Row) -> io::Result<()>;

    /// Completes the file. `lacks` says what is missing in the recording.
    fn finish(&mut self, lacks: Option<String>) -> io::Result<()>;
}

/// Why a row was not added.
#[derive(Debug)]
pub enum TableError {
    /// The file cannot be written.
    Write(io::Error),
    /// A requested slave has no columns.
    NoAxis {
        /// The requested slave.
        axis: u8,
        /// The slaves that have columns.
        axes: Vec<u8>,
    },
}

impl From<io::Error> for TableError {
    fn from(error: io::Error) -> Self {
        Self::Write(error)
    }
}

/// Makes the rows of a table from frames.
pub struct Table {
    format: Box<dyn Format>,
    /// The numbers of the slaves for which the table has columns; if empty, all slaves.
    asked: Vec<u8>,
    times: Times,
    kinds: Kinds,
    /// The board, and the slaves that have columns. Empty before the first row, because the first report in OP shows
    /// which slaves there are.
    groups: Vec<Group>,
    /// The last target that was sent to each slave within the times. \[OURS] Targets before the times do not count. If
    /// only a part of a recording is read, not all frames before it are read, so the last earlier target is unknown.
    targets: [Option<i32>; MAX_SLAVES],
    /// The time of the first frame in the file, ns.
    begin_ns: Option<u64>,
    values: Vec<Option<i64>>,
    rows: u64,
}

impl Table {
    /// Creates a table of the frames within `times`. It has columns for the slaves `asked`, or for all slaves if
    /// `asked` is empty.
    pub fn new(format: Box<dyn Format>, asked: Vec<u8>, times: Times) -> Self {
        Self {
            format,
            asked,
            times,
            kinds: Kinds::new(None),
            groups: Vec::new(),
            targets: [None; MAX_SLAVES],
            begin_ns: None,
            values: Vec::new(),
            rows: 0,
        }
    }

    /// Processes the next frame; frames must be sorted by time.
    ///
    /// # Errors
    /// [`TableError`] if the file cannot be written, or a requested slave does not exist.
    pub fn frame(&mut self, framed: &Framed) -> Result<(), TableError> {
        self.begin_ns.get_or_insert_with(|| moved(framed.recorded.at_ns, -i128::from(framed.time_ns)));
        match framed.recorded.dir {
            Dir::Write => {
                self.command(framed);
                Ok(())
            }
            Dir::Read => self.report(framed),
        }
    }

    /// Completes the file, and returns the number of rows. If there are no rows, nothing is written.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self, lacks: Option<String>) -> io::Result<u64> {
        if self.rows > 0 {
            self.format.finish(lacks)?;
        }
        Ok(self.rows)
    }

    fn command(&mut self, framed: &Framed) {
        let (frame, size) = (&framed.recorded.frame, framed.size);
        self.kinds.command(frame, size);
        if !self.times.contains(framed.time_ns) {
            return;
        }
        for (n, target) in (1..=size.max_slaves()).zip(&mut self.targets) {
            match SlotCommand::decode(&frame.slot(size, n), size).map(|slot| slot.command) {
                Ok(SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion)) => *target = Some(motion.first.target),
                Ok(SlaveCommand::Cst(torque)) => *target = Some(torque.into()),
                _ => {}
            }
        }
    }

    fn report(&mut self, framed: &Framed) -> Result<(), TableError> {
        let (frame, size) = (&framed.recorded.frame, framed.size);
        self.kinds.response(frame, size);
        let board = MasterResponse::decode(&frame.slot(size, 0));
        if board.state.state() != Some(MasterState::Op) || !self.times.contains(framed.time_ns) {
            return Ok(());
        }
        if self.groups.is_empty() {
            self.groups = self.found(framed)?;
            let meta = framed.meta.as_deref();
            let (link, is_virtual) = (meta.map(link_name), meta.is_some_and(is_virtual));
            self.format.begin(&Head { groups: &self.groups, link, is_virtual })?;
        }
        self.values.clear();
        for Group { slave, part } in &self.groups {
            let n = usize::from(*slave);
            // A file may contain a second board that has fewer slaves than the first one.
            if n > size.max_slaves() {
                self.values.extend(part.columns().iter().map(|_| None));
                continue;
            }
            let slot = frame.slot(size, n);
            let target = n.checked_sub(1).and_then(|n| self.targets[n]).map(i64::from);
            match part {
                Part::Board => self
                    .values
                    .extend([board.fifo_free, board.full_count, board.error.into(), board.state.0.into()].map(number)),
                Part::Axis => {
                    let DriveResponse { statusword, position, torque, error_code, .. } = DriveResponse::decode(&slot);
                    self.values.extend([target, number(position), number(torque)]);
                    self.values.extend([statusword.0, error_code].map(number));
                }
                Part::Pulse => {
                    let HspResponse { statusword, first, .. } = HspResponse::decode(&slot, size);
                    self.values.extend([target, number(first.position), number(statusword.0)]);
                }
                Part::Bits => self.values.push(number(IoResponse::decode(&slot).bits)),
            }
        }
        self.rows += 1;
        let at_ns = moved(self.begin_ns.unwrap_or_default(), framed.time_ns.into());
        Ok(self.format.row(&Row { at_ns, time_ns: framed.time_ns, values: &self.values })?)
    }

    /// Determines the groups of columns from the first report in OP.
    fn found(&self, framed: &Framed) -> Result<Vec<Group>, TableError> {
        let dump = ResponseDump::new(&framed.recorded.frame, framed.size);
        let guessed = |n: usize| match dump.line(n)?.meaning {
            SlotMeaning::SlaveResponse(reading) => reading.kind.kind(),
            _ => None,
        };
        let slaves = (1..=framed.size.max_slaves()).filter_map(|n| {
            let part = match self.kinds.of(n).or_else(|| guessed(n)) {
                Some(SlaveKind::Io) => Part::Bits,
                Some(SlaveKind::Hsp) => Part::Pulse,
                Some(SlaveKind::None) | None => return None,
                Some(_) => Part::Axis,
            };
            Some(Group { slave: n as u8, part })
        });
        let slaves: Vec<Group> = slaves.collect();
        if let Some(axis) = self.asked.iter().find(|axis| slaves.iter().all(|group| group.slave != **axis)) {
            return Err(TableError::NoAxis { axis: *axis, axes: slaves.iter().map(|group| group.slave).collect() });
        }
        let slaves = slaves.into_iter().filter(|group| self.asked.is_empty() || self.asked.contains(&group.slave));
        Ok([Group { slave: 0, part: Part::Board }].into_iter().chain(slaves).collect())
    }
}

fn number(value: impl Into<i64>) -> Option<i64> {
    Some(value.into())
}

fn is_virtual(meta: &RecordMeta) -> bool {
    meta.clock == Clock::Virtual
}

/// A time moved by some nanoseconds, limited to the range of u64, since a damaged file may contain any times.
fn moved(at_ns: u64, by_ns: i128) -> u64 {
    (i128::from(at_ns) + by_ns).clamp(0, u64::MAX.into()) as u64
}
