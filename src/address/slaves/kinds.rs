//! The kinds of simulated slaves: which there are, and in what they differ.
//!
//! A new kind is a file in `slave/` that implements [`Model`](crate::slave::device::Model), and a variant of
//! [`SlaveModel`] with its row here.

use crate::sk::SlaveKind;

/// A kind of simulated slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlaveModel {
    /// A CiA 402 servo drive.
    Drive,
    /// A CiA 402 stepper drive, which has no mode but CSP.
    Step,
    /// The stepper drive Xinje DP3CL, which is a stepper for the board.
    Dp3cl,
    /// A pulse module (HSP) with one channel.
    Hsp,
    /// A pulse module (HSP) with two channels.
    Hsp2,
    /// An IO slave with 16 digital outputs and 16 digital inputs; output k is wired to input k.
    Io,
}

impl SlaveModel {
    /// Every model.
    pub const ALL: [Self; 6] = [Self::Drive, Self::Io, Self::Step, Self::Dp3cl, Self::Hsp, Self::Hsp2];

    /// The name of the model in a link.
    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// The name with its article, for messages.
    #[cfg_attr(not(feature = "sim"), expect(dead_code, reason = "errors of scripts alone say it"))]
    pub(crate) const fn with_article(self) -> &'static str {
        self.row().with_article
    }

    /// The kind of slave by which SET_AXIS declares it.
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

    /// The row of the model: everything in which the models differ.
    const fn row(self) -> Row {
        match self {
            Self::Drive => {
                Row { name: "drive", with_article: "a drive", kind: SlaveKind::Drive, axes: 1, motors: 1, channels: 0 }
            }
            Self::Step => {
                Row { name: "step", with_article: "a step", kind: SlaveKind::Step, axes: 1, motors: 1, channels: 0 }
            }
            Self::Dp3cl => {
                Row { name: "dp3cl", with_article: "a dp3cl", kind: SlaveKind::Step, axes: 1, motors: 1, channels: 1 }
            }
            Self::Hsp => {
                Row { name: "hsp", with_article: "an hsp", kind: SlaveKind::Hsp, axes: 1, motors: 0, channels: 1 }
            }
            Self::Hsp2 => {
                Row { name: "hsp2", with_article: "an hsp2", kind: SlaveKind::Hsp, axes: 2, motors: 0, channels: 2 }
            }
            Self::Io => Row { name: "io", with_article: "an io", kind: SlaveKind::Io, axes: 0, motors: 0, channels: 1 },
        }
    }
}

/// The properties of a model. A new model is a variant of [`SlaveModel`] with its row.
struct Row {
    name: &'static str,
    with_article: &'static str,
    kind: SlaveKind,
    axes: usize,
    motors: usize,
    channels: usize,
}
