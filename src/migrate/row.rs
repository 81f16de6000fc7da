//! How an ECM-XF differs from a board, and what that means for one feature of a program.

use std::fmt;

/// A difference between a board with the simulated network and the same board over an ECM-XF: a row of the table in
/// `docs/MIGRATION.md`, which has the figures, the reason and the test that checks it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Row {
    /// The report that answers a command comes some cycles later than on a board.
    Latency,
    /// A stall of the host is bridged by the outputs in the chip, and not by the board's FIFO.
    Stall,
    /// While an axis is switched on, it is held at its position of some cycles ago. Meanwhile the chip buffers only a
    /// few cycles of outputs, so that a stall of the host stops the other axes sooner.
    Hold,
    /// SET_FIFO clear takes some cycles, in which the chip still sends outputs.
    Clear,
    /// The report names a lost slave some cycles later than on a board, because the chip does not report which slave is
    /// lost.
    Loss,
    /// Slaves that return are configured and led to OP one after the other; on a board, all at the same time.
    Remap,
    /// An SDO that is requested during a change of the AL state waits until the change has ended.
    Sdo,
    /// Some cycle times are too short for the exchanges with the chip.
    Cycle,
    /// The board's own six inputs and outputs are pins of the chip, which keys of the link name.
    Lio,
    /// The start to OP takes longer than on a board.
    Start,
}

impl Row {
    /// Every row, in the order of the table in `docs/MIGRATION.md`.
    pub const ALL: [Self; 10] = [
        Self::Latency,
        Self::Stall,
        Self::Hold,
        Self::Clear,
        Self::Loss,
        Self::Remap,
        Self::Sdo,
        Self::Cycle,
        Self::Lio,
        Self::Start,
    ];

    /// The id of the row in the first column of the table in `docs/MIGRATION.md`. It never changes, so that other
    /// programs can rely on it.
    pub const fn id(self) -> &'static str {
        match self {
            Self::Latency => "latency",
            Self::Stall => "stall",
            Self::Hold => "hold",
            Self::Clear => "clear",
            Self::Loss => "loss",
            Self::Remap => "remap",
            Self::Sdo => "sdo",
            Self::Cycle => "cycle",
            Self::Lio => "lio",
            Self::Start => "start",
        }
    }

    /// The difference in one sentence, for the user.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Latency => {
                "the report that shows the answer comes a few cycles later; a program that computes each target from the \
                 newest report acts on older ones"
            }
            Self::Stall => {
                "a PC that stalls is bridged by the sets of outputs that lie in the chip (ahead=), and not by the \
                 entries of the board's FIFO, which lie in the PC"
            }
            Self::Hold => {
                "while an axis is switched on in CSP at most 4 sets lie in the chip, so that it is held where it is: a \
                 stall of the PC then stops the axes that move after that many cycles"
            }
            Self::Clear => {
                "SET_FIFO clear takes some cycles, since the chip is stopped and emptied; what it sends until then counts \
                 as executed"
            }
            Self::Loss => {
                "a lost slave is named later: when the working counter has told, and the states of the slaves were read \
                 one after the other"
            }
            Self::Remap => {
                "slaves that come back are configured and led to OP one by one; one that is to have other process data \
                 than before takes the others out of OP meanwhile"
            }
            Self::Sdo => "an SDO that is asked for while the network changes its state waits for the end of the change",
            Self::Cycle => "the packets of a cycle have to pass the SPI in it: not every cycle holds",
            Self::Lio => {
                "the six inputs and outputs of the board are at pins of the chip, which local_in= and local_out= name; \
                 without these the inputs read 0 and the outputs go nowhere"
            }
            Self::Start => "the way to OP takes longer, since each SDO of the configuration is a command of the chip",
        }
    }
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.id())
    }
}

/// Whether a feature that a program uses works with an ECM-XF.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The feature works, and the program sees no difference.
    Yes,
    /// The feature works, but the program sees the difference that this row of `docs/MIGRATION.md` describes.
    Differs(Row),
    /// The feature does not work with an ECM-XF.
    No {
        /// The row of `docs/MIGRATION.md` that describes the difference.
        row: Row,
        /// Why the feature does not work.
        reason: String,
        /// The next step for the owner of the program.
        next: String,
    },
}

impl Verdict {
    /// The verdict in a word: `yes`, `differs` or `no`.
    pub const fn word(&self) -> &'static str {
        match self {
            Self::Yes => "yes",
            Self::Differs(_) => "differs",
            Self::No { .. } => "no",
        }
    }

    /// The row that the verdict refers to; `None` for [`Verdict::Yes`].
    pub const fn row(&self) -> Option<Row> {
        match self {
            Self::Yes => None,
            Self::Differs(row) | Self::No { row, .. } => Some(*row),
        }
    }
}
