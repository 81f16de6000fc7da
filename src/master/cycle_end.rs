//! The end of a cycle: its working counters show whether slaves may be missing or have left OP.

use super::process_data::ProcessData;
use super::shared::Shared;

/// Ends a cycle, and checks by its working counters whether slaves are missing or have left OP.
pub(super) fn judge(process: &mut ProcessData, shared: &mut Shared) {
    let Some(done) = process.finish(shared.active) else { return };
    if let Some(time) = done.reference_time {
        shared.clocks.take_time(time, shared.missing);
        let Shared { clocks, pace, pacer, .. } = shared;
        process.note_time(clocks.time, pace.and_then(|pace| pacer.next(pace, done.sent_at, clocks.time)));
    }
    let found = shared.live.len() as u16;
    let is_short = done.working_counter < done.expected_working_counter;
    let is_right = !is_short && done.doubtful.is_empty();
    shared.is_all_in_op = done.all_in_op
        && done.present == Some(found)
        && is_right
        && shared.missing.is_empty()
        && shared.mute.is_empty();
    if done.lost > 0 || done.present.is_none() {
        // The frame was lost, which shows nothing about the slaves.
        return;
    }
    let counters = (done.working_counter, done.expected_working_counter, done.present);
    let is_new = std::mem::replace(&mut shared.last_counters, counters) != counters;
    shared.is_alarmed |= is_new && (!is_right || done.present != Some(found) || !shared.mute.is_empty());
    shared.doubtful = done.doubtful;
}
