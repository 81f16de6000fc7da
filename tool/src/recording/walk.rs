//! The frames of a recording sorted by time, with times that are corrected for jumps of the clock.

use std::io::Read;
use std::sync::mpsc;
use std::thread;

use ecmsk::recording::{InOrder, Jumps, RecordError, Timeline};

use super::{Framed, Frames};

/// \[OURS] [`Frames::walk`] hands frames from the thread that reads to its caller in batches of this many.
const BATCH: usize = 256;
/// \[OURS] The most batches that wait for the caller.
const BATCHES_AHEAD: usize = 4;

impl<R: Read> Frames<R> {
    /// A sorter that orders these frames by time. In a part of a recording, long times between two frames are no jumps
    /// of the clock.
    pub fn in_time(&self) -> InTime {
        InTime { has_gaps: self.part_of.is_some(), ..InTime::default() }
    }

    /// Calls `show` with every frame of the recording up to `until_ns`, sorted by time, with times that are corrected
    /// for jumps of the clock. A recording that ends early is read up to its damage. Another thread reads ahead meanwhile,
    /// since reading takes about as long as what is done with the frames. So frames behind `until_ns` are gone afterwards.
    ///
    /// # Errors
    /// [`RecordError`] if the recording cannot be read.
    pub fn walk(&mut self, until_ns: i64, mut show: impl FnMut(&Framed)) -> Result<Walked, RecordError>
    where
        R: Send,
    {
        let order = self.in_time();
        let (sender, batches) = mpsc::sync_channel(BATCHES_AHEAD);
        // The reader frees what it has allocated, since threads that free each other's memory wait for each other.
        let (give_back, shown) = mpsc::channel::<Vec<Framed>>();
        let walked = thread::scope(|scope| {
            scope.spawn(move || {
                let mut batch = Vec::with_capacity(BATCH);
                for framed in self {
                    batch.push(framed);
                    if batch.len() == BATCH {
                        drop(shown.try_recv());
                        // Sending fails when the caller needs no more frames.
                        if sender.send(std::mem::replace(&mut batch, Vec::with_capacity(BATCH))).is_err() {
                            return;
                        }
                    }
                }
                let _ = sender.send(batch);
            });
            let mut used = Vec::with_capacity(BATCH);
            pass(batches.into_iter().flatten(), order, until_ns, |framed| {
                show(&framed);
                used.push(framed);
                if used.len() == BATCH {
                    let _ = give_back.send(std::mem::replace(&mut used, Vec::with_capacity(BATCH)));
                }
                Ok(true)
            })
        });
        #[cfg(test)]
        super::FRAMES_READ.set(super::FRAMES_READ.get() + walked.as_ref().map_or(0, |walked| walked.frames));
        walked
    }

    /// Calls `show` as [`Self::walk`] does, until it returns false or fails.
    ///
    /// # Errors
    /// [`RecordError`] if the recording cannot be read, and the errors of `show`.
    pub fn walk_while<E: From<RecordError>>(
        &mut self,
        until_ns: i64,
        show: impl FnMut(&Framed) -> Result<bool, E>,
    ) -> Result<Walked, E> {
        let order = self.in_time();
        self.try_walk(order, until_ns, show)
    }

    /// Like [`Self::walk_while`], with a sorter of the caller's choice.
    ///
    /// # Errors
    /// [`RecordError`] if the recording cannot be read, and the errors of `show`.
    pub fn try_walk<E: From<RecordError>>(
        &mut self,
        order: InTime,
        until_ns: i64,
        mut show: impl FnMut(&Framed) -> Result<bool, E>,
    ) -> Result<Walked, E> {
        pass(self, order, until_ns, |framed| show(&framed))
    }
}

/// Sorts frames by time and calls `show` with each up to `until_ns`, until it returns false or fails.
fn pass<E: From<RecordError>>(
    frames: impl IntoIterator<Item = Result<Framed, RecordError>>,
    mut order: InTime,
    until_ns: i64,
    mut show: impl FnMut(Framed) -> Result<bool, E>,
) -> Result<Walked, E> {
    let mut walked = Walked { frames: 0, is_whole: false, damage: None, jumps: None };
    for framed in frames {
        match framed {
            Ok(framed) => {
                walked.frames += 1;
                let Some(framed) = order.push(framed) else { continue };
                if framed.time_ns > until_ns || !show(framed)? {
                    return Ok(walked);
                }
            }
            Err(error @ (RecordError::Truncated { .. } | RecordError::Malformed { .. })) => {
                walked.damage = Some(error);
            }
            Err(error) => return Err(error.into()),
        }
    }
    while let Some(framed) = order.pop() {
        if !show(framed)? {
            return Ok(walked);
        }
    }
    walked.is_whole = true;
    walked.jumps = order.jumps();
    Ok(walked)
}

/// The result of [`Frames::walk`].
pub struct Walked {
    /// The number of frames that were read.
    pub frames: u64,
    /// Whether the recording was read to its end, and not only up to the time that is needed.
    pub is_whole: bool,
    /// Why the recording ends early. A program that was killed leaves such a recording; the frames before its end are
    /// valid.
    pub damage: Option<RecordError>,
    /// The jumps of the clock in the recorded times; `None` if there are none.
    pub jumps: Option<Jumps>,
}

/// Sorts frames by time, and corrects the times after a jump of the clock.
#[derive(Default)]
pub struct InTime {
    /// Whether frames are left out, so that a long time between two frames is no jump of the clock.
    has_gaps: bool,
    /// The time of the file's first frame, from which the timeline counts.
    first_ns: Option<i64>,
    /// Whether frames stay in the order of the file.
    is_unsorted: bool,
    timeline: Timeline<Framed>,
    order: InOrder<Framed>,
}

impl InTime {
    /// Corrects only the times: frames stay in the order of the file, in which a report that was read late follows
    /// commands that were sent after it.
    pub fn unsorted(self) -> Self {
        Self { is_unsorted: true, ..self }
    }

    /// Adds the next frame of the file. Once enough frames are buffered (1,024) that no earlier one can follow, returns
    /// the earliest of them.
    pub fn push(&mut self, framed: Framed) -> Option<Framed> {
        if self.has_gaps {
            return self.sort((framed.time_ns, framed));
        }
        self.first_ns.get_or_insert(framed.time_ns);
        let placed = self.timeline.push(framed.recorded.at_ns, framed)?;
        self.sort(placed)
    }

    /// To be called after the last frame of the file: returns the earliest frame that is still buffered.
    pub fn pop(&mut self) -> Option<Framed> {
        let last = self.timeline.pop();
        last.and_then(|placed| self.sort(placed)).or_else(|| self.order.pop())
    }

    /// The jumps of the clock that were found so far.
    pub fn jumps(&self) -> Option<Jumps> {
        let jumps = self.timeline.jumps()?;
        Some(Jumps { first_at_ns: self.time_ns(jumps.first_at_ns), ..jumps })
    }

    fn sort(&mut self, (since_first_ns, framed): (i64, Framed)) -> Option<Framed> {
        let time_ns = self.time_ns(since_first_ns);
        let framed = Framed { time_ns, ..framed };
        if self.is_unsorted { Some(framed) } else { self.order.push(time_ns, framed) }
    }

    /// The [time](Framed::time_ns) of a frame that comes `since_first_ns` nanoseconds after the first one.
    fn time_ns(&self, since_first_ns: i64) -> i64 {
        since_first_ns.saturating_add(self.first_ns.unwrap_or(0))
    }
}
