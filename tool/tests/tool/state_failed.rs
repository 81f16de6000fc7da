//! The reason for a failed state is given wherever the tool shows that state.

use crate::common::board::{script, text};
use crate::common::run;

/// TOOL-158 A change of state that fails says which slave refused and why; frames do not show that.
#[test]
fn a_failed_change_of_state_says_which_slave_refused_and_why() {
    let ran = run(["state", "op", "--link", "sim:?slaves=drive*2&clock=virtual", "--slaves", "drive,io"]);
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    for words in ["OP was not reached", "slave 2 refused", "IO (nibble 1)", "no SET_AXIS has declared", "0x001D"] {
        assert!(ran.err.contains(words), "{words}: {}", ran.err);
    }
}

/// TOOL-158 `state` and `info` print the reason beside the state, `--json` in its own field.
#[test]
fn state_and_info_say_why_a_state_has_failed() {
    let falls = text("falls.ecmscript", "at 2s mute 2\n");
    let link = format!("sim:?slaves=drive*2&clock=virtual&script={falls}");
    let ran = script(&link, "state op\nwait 3s\nstate\ninfo\n");
    let why = "slave 2 fell out of the network; look at its power and its cable, then send SET_STATE to bring it back";
    assert!(ran.out.contains(&format!("OP (a slave failed): {why}")), "{}\n{}", ran.out, ran.err);
    assert_eq!(ran.out.matches(why).count(), 2, "{}", ran.out);
    let ran = crate::common::run_with_input(&["run", "-", "--json", "--link", &link], "state op\nwait 3s\nstate\n");
    assert!(ran.out.contains(&format!("\"why\":\"{why}\"")), "{}\n{}", ran.out, ran.err);
}
