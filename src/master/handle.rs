//! Handles of running jobs. The type of a handle gives the type of the job's result.

use std::fmt;
use std::marker::PhantomData;

use super::{DatagramAnswer, DatagramError, FileError, MailboxError, ScanError, SdoError, SiiError, StateError};

/// The id of a job. No two jobs of a master have the same id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct JobId(pub(super) u64);

/// A handle of a job whose result is a `T`. [`Master::take`](super::Master::take) returns the result.
pub struct Job<T> {
    id: JobId,
    end: PhantomData<fn() -> T>,
}

impl<T> Job<T> {
    pub(super) const fn new(id: JobId) -> Self {
        Self { id, end: PhantomData }
    }

    /// The id of the job, without the type of its result.
    pub const fn id(self) -> JobId {
        self.id
    }
}

impl<T> Clone for Job<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Job<T> {}

impl<T> fmt::Debug for Job<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Job({})", self.id.0)
    }
}

impl<T> From<Job<T>> for JobId {
    fn from(job: Job<T>) -> Self {
        job.id
    }
}

/// The types that the result of a [`Job`] may have.
pub trait Ending: Sized {
    #[doc(hidden)]
    fn into_end(self) -> End;

    /// Converts the result of a job. `None`: the result has another type, so the handle is one of another master, whose
    /// ids count separately.
    #[doc(hidden)]
    fn of(end: End) -> Option<Self>;
}

/// Defines the enum of all results, so that they can share one queue, and the conversions from and to each type.
macro_rules! ends {
    ($($kind:ident: $end:ty),+ $(,)?) => {
        /// The result of a job of any kind.
        #[derive(Clone, Debug)]
        pub enum End {
            $(#[allow(missing_docs, reason = "its type says it")] $kind($end)),+
        }

        $(impl Ending for $end {
            fn into_end(self) -> End {
                End::$kind(self)
            }

            fn of(end: End) -> Option<Self> {
                match end {
                    End::$kind(end) => Some(end),
                    _ => None,
                }
            }
        })+
    };
}

ends! {
    Scan: Result<u8, ScanError>,
    State: Result<(), StateError>,
    Bytes: Result<Vec<u8>, SdoError>,
    Number: Result<u32, SdoError>,
    Indices: Result<Vec<u16>, SdoError>,
    Written: Result<(), SdoError>,
    FileRead: Result<Vec<u8>, FileError>,
    FileWritten: Result<(), FileError>,
    EepromRead: Result<Vec<u16>, SiiError>,
    EepromWritten: Result<(), SiiError>,
    RegistersRead: Result<Vec<u8>, DatagramError>,
    RegistersWritten: Result<(), DatagramError>,
    StatesRead: (),
    Mail: Result<Option<Vec<u8>>, MailboxError>,
    Datagram: Result<DatagramAnswer, DatagramError>,
}
