//! Makes system calls of test runs fail, one per run, and checks what must hold afterwards.

use std::collections::BTreeMap;
use std::os::unix::process::ExitStatusExt;

use super::{Blow, Call, Struck};
use crate::dice::Dice;
use crate::schedules::asked;

/// A run with a failed call, and what was wrong with it.
pub struct Run {
    struck: Struck,
    wrong: Option<String>,
}

impl Run {
    /// The rules for every program: it ends by itself; with status 0 only if `is_done`; with another status it prints
    /// the reason.
    pub fn judge(struck: Struck, is_done: impl FnOnce(&Struck) -> Result<(), String>) -> Self {
        let wrong = wrong(&struck).or_else(|| {
            struck
                .ended
                .status
                .success()
                .then(|| is_done(&struck).err())?
                .map(|why| format!("exit status 0, but {why}"))
        });
        Self { struck, wrong }
    }

    /// Checks what the run has left behind, if nothing was wrong before.
    pub fn and(mut self, look: impl FnOnce(&Struck) -> Result<(), String>) -> Self {
        if self.wrong.is_none() {
            self.wrong = look(&self.struck).err();
        }
        self
    }
}

fn wrong(struck: &Struck) -> Option<String> {
    let ended = &struck.ended;
    if let Some(threads) = &struck.hung {
        return Some(format!("it hangs: {threads}"));
    }
    let dealt = struck.dealt?;
    let without_memory = dealt.errno == Some(libc::ENOMEM);
    match ended.status.signal() {
        Some(libc::SIGKILL) if dealt.errno.is_none() => None,
        // The loader has no message for it. The allocator, and a thread that cannot begin, end the process.
        Some(libc::SIGSEGV) if dealt.is_loading && without_memory => None,
        Some(libc::SIGABRT) if without_memory => None,
        Some(signal) => Some(format!("signal {signal}")),
        // A message of the standard library: a thread without memory for the guard page of its signal stack ends before
        // its work begins.
        None if without_memory && ended.stderr.contains("/sys/pal/unix/stack_overflow.rs") => None,
        None if ended.stderr.contains("panicked at") => Some("a panic".into()),
        None if !ended.status.success() && ended.stderr.is_empty() => {
            let has_reason = dealt.errno.is_none() || dealt.is_write_to(2);
            (!has_reason).then(|| "it fails without a word".into())
        }
        None => None,
    }
}

/// Makes calls fail in runs of one kind. The first run has no failure and lists the calls. Then come `usual` runs, or
/// as many as are asked for. `ECMSK_BLOW=CALL.ERROR` repeats one.
///
/// # Panics
/// If a failure does harm. `again` is the command that runs the test again.
pub fn strike(again: &str, test: &str, usual: usize, run: impl Fn(Option<Blow>) -> Run) {
    if let Ok(blow) = std::env::var("ECMSK_BLOW") {
        let (call, error) = blow.split_once('.').expect("CALL.ERROR");
        let error = if error == "kill" { Blow::KILL } else { error.parse().expect("a number") };
        let struck = run(Some(Blow { call: call.parse().expect("a number"), error }));
        println!("{}", story(&struck));
        assert_eq!(struck.wrong, None);
        return;
    }
    let whole = run(None);
    assert_eq!((&whole.wrong, whole.struck.ended.status.success()), (&None, true), "{}", story(&whole));
    let all = whole.struck.calls;
    let seed = asked("ECMSK_SOAK_FIRST").unwrap_or(0);
    let blows = match asked("ECMSK_SOAK_SCHEDULES") {
        Some(count) => sample(every(&all), count as usize, seed),
        None => share(&all, usual, seed),
    };
    let count = blows.len();
    let mut failed = Vec::new();
    let mut dealt = 0;
    for blow in blows {
        let ran = run(Some(blow));
        dealt += usize::from(ran.struck.dealt.is_some());
        if ran.wrong.is_some() {
            let error = if blow.error == Blow::KILL { "kill".into() } else { blow.error.to_string() };
            let text = format!("{}\nagain: ECMSK_BLOW={}.{error} {again} {test}", story(&ran), blow.call);
            println!("{text}");
            failed.push(text);
        }
    }
    println!("{test}: {} calls that may fail, {count} blows, {dealt} dealt, {} wrong", all.len(), failed.len());
    assert!(failed.is_empty(), "{test}: {} of {count} blows do harm (above)", failed.len());
    assert!(dealt * 2 >= count, "{test}: {dealt} of {count} blows hit a call");
}

fn story(run: &Run) -> String {
    let Run { struck, wrong } = run;
    let dealt = struck.dealt.map_or_else(|| "no blow".to_owned(), |dealt| dealt.to_string());
    let wrong = wrong.as_deref().unwrap_or("nothing wrong");
    format!(
        "{dealt}: {wrong}; {}\n--- stdout\n{}--- stderr\n{}---",
        struck.ended.status, struck.ended.stdout, struck.ended.stderr
    )
}

/// Every error of every call, and the end of the process at each call.
fn every(calls: &[Call]) -> Vec<Blow> {
    let blows =
        |(call, at): (usize, &Call)| (0..at.errors.len()).chain([Blow::KILL]).map(move |error| Blow { call, error });
    calls.iter().enumerate().flat_map(blows).collect()
}

fn sample(mut blows: Vec<Blow>, count: usize, seed: u64) -> Vec<Blow> {
    let mut dice = Dice(seed);
    while blows.len() > count {
        let at = dice.below(blows.len() as u64) as usize;
        blows.swap_remove(at);
    }
    blows
}

/// Kinds of calls with their errors are drawn first, so that rare calls are not lost among those that every cycle makes.
fn share(calls: &[Call], usual: usize, seed: u64) -> Vec<Blow> {
    let mut dice = Dice(seed);
    let mut kinds: BTreeMap<(Call, usize), Vec<usize>> = BTreeMap::new();
    for Blow { call, error } in every(calls) {
        kinds.entry((calls[call], error)).or_default().push(call);
    }
    let mut kinds: Vec<_> = kinds.into_iter().collect();
    let mut blows = Vec::new();
    while blows.len() < usual && !kinds.is_empty() {
        let at = dice.below(kinds.len() as u64) as usize;
        let ((_, error), at) = kinds.swap_remove(at);
        blows.push(Blow { call: dice.pick(&at), error });
    }
    blows
}
