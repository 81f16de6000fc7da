//! Any text as a script of `ecmsk run`, on a simulated board whose cable is pulled after a while: it ends, done or with an
//! error that says what is wrong. What Tab offers behind any text of the shell goes on with it.

#![no_main]

use ecmsk_tool::fuzzed;
use libfuzzer_sys::fuzz_target;

/// Boards; each is lost after so many frames, which bounds what a script can take.
const LINKS: [&str; 4] = [
    "sim:?slaves=drive*2,io&clock=virtual&fault.disconnect_after=4000",
    "sim:?slaves=hsp2,step,none,io&slot=16&clock=virtual&fault.disconnect_after=4000",
    "sim:?slaves=drive&clock=virtual&fault.disconnect_after=4000&fault.drop=0.01&fault.corrupt=0.01",
    "sim:?slaves=drive*3&clock=virtual&slot=16&fault.disconnect_after=300",
];
/// Options that go with them.
const OPTIONS: [&[&str]; 6] = [
    &["--up"],
    &["--up", "--json", "--counts-per-unit", "1=5000,2=0.001"],
    &["--slaves", "drive:csv,drive:cst,io", "--cycle-us", "250"],
    &["--guard", "1000", "--lead-limit", "off", "--timeout", "500ms", "--close", "leave", "--up"],
    &["--close", "servo-off", "--slaves", "drive,io"],
    &["--counts-per-unit=-1e300", "--cycle-us", "4000", "--up"],
];
/// Lines of a script, which clap reads one after the other.
const LINES_MAX: usize = 16;

fuzz_target!(|input: (u8, u8, &str)| {
    let (link, options, text) = input;
    let end = text.match_indices('\n').nth(LINES_MAX).map_or(text.len(), |(at, _)| at);
    let text = &text[..end];
    let words = ["any", "--link", LINKS[usize::from(link) % LINKS.len()]];
    let options = OPTIONS[usize::from(options) % OPTIONS.len()];
    if let Err(error) = fuzzed::script(text, words.iter().chain(options)) {
        assert!(!error.is_empty());
    }
    let line = text.lines().next().unwrap_or_default();
    let (start, offered) = fuzzed::complete(line);
    assert!(offered.iter().all(|word| word.starts_with(&line[start..])), "{line}: {offered:?}");
});
