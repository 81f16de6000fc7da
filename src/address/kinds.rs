//! The kinds of simulated slaves and their differences, in one table. The parser of lists, its error messages, the help
//! and the options of the tool use the table.
//!
//! A new kind is a file in `slave/` that implements [`Model`](crate::slave::device::Model), and its row
//! here.

use crate::sk::SlaveKind;

/// The word `none`: as a whole list, a network without slaves; as an entry of a declared list, a slot that is not used.
pub(super) const NONE: &str = "none";

/// The default travel of an axis: switches, index pulse and end stops, as far as the entry of the slave in the URI does
/// not give them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct UsualTravel {
    /// The travel as a user would write it in a link after the kind of the slave and a colon, such as
    /// `limits@-100000..100000:home@-2500..2500`.
    pub(super) parts: &'static str,
    pub(super) counts_a_turn: u32,
}

const SERVO: UsualTravel =
    UsualTravel { parts: "limits@-1310720..1310720:home@-32768..32768:index@0", counts_a_turn: 131_072 };
const STEPPER: UsualTravel =
    UsualTravel { parts: "limits@-100000..100000:home@-2500..2500:index@0", counts_a_turn: 10_000 };

/// The properties of a model. A new model is a row of the table below.
struct Row {
    name: &'static str,
    with_article: &'static str,
    meaning: &'static str,
    kind: SlaveKind,
    axes: usize,
    motors: usize,
    channels: usize,
    usual_travel: Option<UsualTravel>,
}

/// The enum, the list of all models and the row of each from one table.
macro_rules! models {
    ($($(#[$doc:meta])* $name:ident = $row:expr;)*) => {
        /// A kind of simulated slave.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum SlaveModel {
            $($(#[$doc])* $name,)*
        }

        impl SlaveModel {
            /// All models, in the order of the help. The first model of each [`SlaveKind`] has the same name as the kind.
            pub const ALL: [Self; [$(stringify!($name)),*].len()] = [$(Self::$name),*];

            /// The row of the model, with everything in which the models differ.
            const fn row(self) -> Row {
                match self {
                    $(Self::$name => $row,)*
                }
            }
        }
    };
}

models! {
    /// A CiA 402 servo drive.
    Drive = Row {
        name: "drive",
        with_article: "a drive",
        meaning: "a servo drive",
        kind: SlaveKind::Drive,
        axes: 1,
        motors: 1,
        channels: 0,
        usual_travel: Some(SERVO),
    };
    /// An IO slave with 16 digital outputs and 16 digital inputs; output k is wired to input k.
    Io = Row {
        name: "io",
        with_article: "an io",
        meaning: "16 outputs, each wired to one of 16 inputs",
        kind: SlaveKind::Io,
        axes: 0,
        motors: 0,
        channels: 1,
        usual_travel: None,
    };
    /// A CiA 402 stepper drive, whose only mode is CSP.
    Step = Row {
        name: "step",
        with_article: "a step",
        meaning: "a stepper drive with CSP alone",
        kind: SlaveKind::Step,
        axes: 1,
        motors: 1,
        channels: 0,
        usual_travel: Some(STEPPER),
    };
    /// The stepper drive Xinje DP3CL, which the board treats as a stepper.
    Dp3cl = Row {
        name: "dp3cl",
        with_article: "a dp3cl",
        meaning: "the stepper drive Xinje DP3CL, a step for the board",
        kind: SlaveKind::Step,
        axes: 1,
        motors: 1,
        channels: 1,
        usual_travel: Some(STEPPER),
    };
    /// A pulse module (HSP) with one channel.
    Hsp = Row {
        name: "hsp",
        with_article: "an hsp",
        meaning: "a pulse module of one channel, its outputs wired to its inputs",
        kind: SlaveKind::Hsp,
        axes: 1,
        motors: 0,
        channels: 1,
        usual_travel: Some(STEPPER),
    };
    /// A pulse module (HSP) with two channels.
    Hsp2 = Row {
        name: "hsp2",
        with_article: "an hsp2",
        meaning: "the same with two channels",
        kind: SlaveKind::Hsp,
        axes: 2,
        motors: 0,
        channels: 2,
        usual_travel: Some(STEPPER),
    };
}

impl SlaveModel {
    /// The name of the model in a link.
    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// The description of the model in the help.
    pub const fn meaning(self) -> &'static str {
        self.row().meaning
    }

    /// The name of the model with its indefinite article, for messages.
    pub(crate) const fn with_article(self) -> &'static str {
        self.row().with_article
    }

    /// The kind of slave that SET_AXIS declares for this model.
    pub const fn kind(self) -> SlaveKind {
        self.row().kind
    }

    /// The number of axes: 0..=2.
    pub const fn axes(self) -> usize {
        self.row().axes
    }

    /// The number of axes with a simulated motor, which a script can jam: 0..=1.
    pub const fn motors(self) -> usize {
        self.row().motors
    }

    /// The number of channels with 16 digital inputs and outputs: 0..=2.
    pub const fn channels(self) -> usize {
        self.row().channels
    }

    /// The default travel of the model's axes; `None` for a model without axes.
    pub(super) const fn usual_travel(self) -> Option<UsualTravel> {
        self.row().usual_travel
    }
}

/// The word by which a list of slaves names a kind of SET_AXIS: `drive`, `io`, `step`, `hsp`, or `none` for an unused
/// slot.
pub fn word(kind: SlaveKind) -> &'static str {
    SlaveModel::ALL.into_iter().find(|model| model.kind() == kind).map_or(NONE, SlaveModel::name)
}

/// The names of the models for which `holds` is true, separated by commas, for error messages.
pub(super) fn names(holds: impl Fn(SlaveModel) -> bool) -> String {
    let names: Vec<_> = SlaveModel::ALL.into_iter().filter(|model| holds(*model)).map(SlaveModel::name).collect();
    names.join(", ")
}

/// The words allowed in a list of declared slaves ([`slaves::parse_declared`](super::slaves::parse_declared)): every kind,
/// and `none`.
pub fn declared_words() -> String {
    format!("{}, {NONE}", names(|_| true))
}
