//! The handle of what was started, whose type says what its end is.

use std::fmt;
use std::marker::PhantomData;

use super::{DatagramAnswer, DatagramError, FileError, MailboxError, ScanError, SdoError, SiiError, StateError};

/// Names something that was started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct JobId(pub(super) u64);

/// Something that was started and ends with a `T`, which [`Master::take`](super::Master::take) gives.
pub struct Job<T> {
    id: JobId,
    end: PhantomData<fn() -> T>,
}

impl<T> Job<T> {
    pub(super) const fn new(id: JobId) -> Self {
        Self { id, end: PhantomData }
    }

    /// Its name among all that was started, whatever it ends with.
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

/// What a [`Job`] may end with.
pub trait Ending: Sized {
    #[doc(hidden)]
    fn into_end(self) -> End;

    /// `None`: the end is another job's, of another master.
    #[doc(hidden)]
    fn of(end: End) -> Option<Self>;
}

/// One type for all ends, so that they wait in one queue, and one type for each end.
macro_rules! ends {
    ($($kind:ident: $end:ty),+ $(,)?) => {
        /// How something that was started has ended.
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
