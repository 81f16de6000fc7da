//! The example's output.

use support::{Ended, root};

fn run(arguments: &[&str]) -> Ended {
    support::run(support::example("xf_two_axes").args(arguments).current_dir(root()))
}

/// XF-17.7 Two axes move around a square and end at their targets, on every chip.
#[test]
fn two_axes_go_round_a_square() {
    let expected = "2 slaves\naxis 0: 0 counts from its target\naxis 1: 0 counts from its target\n\
                    damaged answers 0, lost process data 0\n";
    assert_eq!(run(&[]).success(), expected);
    for chip in ["clock=virtual&chip_fw=old", "clock=virtual&chip_fw=xfu", "clock=virtual&int0=yes"] {
        assert_eq!(run(&[&format!("xf-sim:?{chip}")]).success(), expected, "{chip}");
    }
}

/// XF-17.7 The picture of README shows the example's motion.
#[test]
fn the_picture_is_what_the_example_does() {
    let csv = run(&["xf-sim:?slaves=drive*2&clock=virtual", "--csv"]).success();
    support::kept(&root().join("docs/xf_two_axes.svg"), &super::picture::draw(&csv));
}

/// XF-17.2 Errors are printed with the next step.
#[test]
fn what_goes_wrong_is_said() {
    let ended = run(&["xf-sim:?slaves=drive&clock=virtual"]);
    assert_eq!(ended.status.code(), Some(1));
    assert_eq!(ended.stderr, "slave 1 is not on the network, which has 1; the first one is 0\n");
}
