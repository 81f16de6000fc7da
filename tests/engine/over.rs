//! The whole group once more, over a bus that takes outputs ahead and is as late as a real one ([`Ahead::chip`]): what a
//! program sees of a board does not depend on the bus. This program runs itself with [`OVER`] in its environment; every
//! board then stands over such a bus. After what a test lets pass, as many cycles more pass as the bus is late.
//!
//! [`Ahead::chip`]: support::ahead_bus::Ahead::chip

use std::collections::BTreeSet;
use std::env;
use std::process::Command;

use crate::host::{ONE_BY_ONE, OVER, SETTLED, XF_SETTLED};

/// Tests that count cycles, and so pass only when none passes besides theirs.
const BY_CYCLES: [&str; 17] = [
    "cable_below_op::reports_go_on",
    "handles::cycles_are_counted",
    "homing::a_drive_goes_home",
    "homing_real::a_jam_ends_homing_by_a_fault",
    "homing_real::every_method_through_the_board",
    "homing_restore::the_mode_waits_until_the_drive_stands",
    "homing_sdo::restoring_is_not_seen_in_the_sdo_slot",
    "homing_sdo::the_hosts_mode_counts",
    "hsp_homing::a_module_in_csv_homes",
    "hsp_homing::go_home_acts_on_the_axes_in_mode_6",
    "mixed::every_slave_has_its_mode",
    "partial_frames::the_time_ends_by_itself",
    "replaced::new_settings_are_configured",
    "sdo::an_answer_stays_until_the_next_transfer_ends",
    "sdo::an_identical_request_shows_the_old_answer_at_once",
    "states::a_target_is_replaced_during_a_change",
    "states::settings_during_a_change_count_from_the_next",
];

const CYCLE_BY_CYCLE: &str =
    "it says what each single cycle shows; how many cycles late that is depends on the bus, and some looks find none";
const FREE_COUNT: &str =
    "it counts free places cycle by cycle; here a place is free when its outputs are known to be sent (SK-12.1)";
const ONE_REPORT_A_CYCLE: &str =
    "it takes a report in every cycle of ours; here the bus makes them, and some come together";
const SILENCE: &str =
    "it sees a silent bus within a cycle; here silence may be a late answer for as long as one may be late";
const SPEED: &str = "it measures a speed in cycles of ours; the bus has a clock of its own";

/// Tests that cannot pass there, and why.
const CANNOT: [(&str, &str); 37] = [
    ("ahead_entries::what_a_cut_cable_has_not_carried_is_counted", "the bus keeps what the cut cable has not carried"),
    ("alarms::the_bit_falls_with_the_fault", CYCLE_BY_CYCLE),
    ("answers::in_op_slot_0_is_cyclic", FREE_COUNT),
    ("answers::set_state_is_answered_with_the_old_state", ONE_REPORT_A_CYCLE),
    (
        "bus_ahead::a_program_ends_the_same_on_every_bus",
        "its program sends while the newest report shows room, and here reports may pause",
    ),
    ("cable::the_first_report_says_it", SILENCE),
    ("crc::in_op_a_wrong_frame_takes_no_entry", FREE_COUNT),
    ("drives::no_shaft_jumps", "it compares times in frames, and waits for an empty FIFO after each"),
    ("drives::the_target_is_the_actual_position_until_enabled", CYCLE_BY_CYCLE),
    ("fifo::a_full_fifo_is_executed_one_entry_a_cycle", FREE_COUNT),
    ("fifo::a_full_fifo_loses_frames_and_counts_them", FREE_COUNT),
    ("fifo::a_threshold_acts_from_its_arrival_on", FREE_COUNT),
    ("fifo::a_threshold_acts_on_a_full_fifo", FREE_COUNT),
    ("fifo::a_threshold_holds_entries_back_until_it_is_passed", FREE_COUNT),
    ("fifo::an_empty_fifo_repeats", ONE_REPORT_A_CYCLE),
    ("fifo::clear_acts_on_a_full_fifo", FREE_COUNT),
    ("fifo::every_frame_takes_an_entry", FREE_COUNT),
    ("fifo::set_state_acts_on_a_full_fifo", FREE_COUNT),
    ("fifo::the_full_count_wraps", FREE_COUNT),
    ("handles::a_held_fifo_fills", FREE_COUNT),
    ("handles::a_muted_board_goes_on", ONE_REPORT_A_CYCLE),
    ("homing::the_target_follows_while_homing", CYCLE_BY_CYCLE),
    ("hsp::targets_and_outputs_hold", CYCLE_BY_CYCLE),
    ("hsp::velocities_keep_running", SPEED),
    ("leds::power_link_and_traffic", SILENCE),
    ("local_io::in_op_local_io_waits_in_the_queue", CYCLE_BY_CYCLE),
    ("modes::a_velocity_keeps_running", SPEED),
    ("repeats::cycles_without_an_entry_are_counted", CYCLE_BY_CYCLE),
    ("sdo::a_request_during_a_transfer_is_rejected", CYCLE_BY_CYCLE),
    ("sdo::a_request_that_repeats_the_one_under_way_is_one_with_it", CYCLE_BY_CYCLE),
    ("sdo::a_transfer_that_nobody_answers_times_out", CYCLE_BY_CYCLE),
    ("sdo::in_op_a_request_waits_for_its_entry", FREE_COUNT),
    ("slave_answers::a_drive_slot_is_refreshed_every_cycle", ONE_REPORT_A_CYCLE),
    ("slave_answers::id_and_index_of_the_command_executed_last", CYCLE_BY_CYCLE),
    ("states::every_way_up_and_down", CYCLE_BY_CYCLE),
    ("states::report_period", ONE_REPORT_A_CYCLE),
    ("step::it_is_switched_as_a_drive", CYCLE_BY_CYCLE),
];

const ONE_SLAVE_AT_A_TIME: &str =
    "the chip moves one slave or all: many that come back beside others in OP take longer than SET_STATE waits";

/// Tests that cannot pass with the slaves behind an ECM-XF, besides those above, and why.
const CANNOT_BEHIND_CHIP: [(&str, &str); 6] = [
    (
        "homing_at_once::an_old_result_that_comes_up_late_is_none",
        "what settles there takes longer than the 20 ms it is about",
    ),
    ("lost::lost_slaves_allocate_nothing", ONE_SLAVE_AT_A_TIME),
    ("lost_together::many_at_once", ONE_SLAVE_AT_A_TIME),
    ("full_table_run::", "it takes as long as all others"),
    ("xf_bus::", "it has such a bus"),
    ("xf_ahead::", "it has such a bus"),
];

/// Runs this program's tests once more; gives the names of those that passed and of those that did not, and what was said.
fn run(over: &str, arguments: &[&str]) -> ([BTreeSet<String>; 2], String) {
    let mut program = Command::new(env::current_exe().expect("the test knows its file"));
    let output = program.args(arguments).env(OVER, over).output().expect("it runs");
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    let ended = |how: &str| {
        let lines = said.lines().filter_map(|line| line.strip_prefix("test ")?.strip_suffix(how));
        lines.map(str::to_owned).collect()
    };
    ([ended(" ... ok"), ended(" ... FAILED")], said)
}

/// SK-12.1 What a program sees of a board over a simulated network it sees over other hardware.
#[test]
fn all_that_a_program_sees_is_the_same() {
    let skipped = BY_CYCLES.iter().chain(CANNOT.iter().map(|(name, _)| name));
    // Those have a bus of their own in every board.
    let skipped = skipped.chain(&["over::", "random::", "random_networks::"]);
    // And these take as long as all others, so that `cargo xtask soak` alone runs them.
    let long = if env::var_os("ECMSK_SOAK_FRAMES").is_some() { &[][..] } else { &["full_table_run::"] };
    let skipped = skipped.chain(long);
    let arguments: Vec<&str> = skipped.flat_map(|name| ["--skip", *name]).collect();
    let ([passed, failed], said) = run(SETTLED, &arguments);
    assert!(failed.is_empty() && passed.len() > 280, "{failed:?}\n{said}");
    let ([passed, failed], said) = run(ONE_BY_ONE, &[&["--exact"], &BY_CYCLES[..]].concat());
    assert!(failed.is_empty() && passed.len() == BY_CYCLES.len(), "{failed:?}\n{said}");
}

/// XF-19.1 The same with the slaves behind the model of an ECM-XF.
#[test]
fn all_that_a_program_sees_is_the_same_behind_an_ecm_xf() {
    let cannot = CANNOT.iter().chain(&CANNOT_BEHIND_CHIP).map(|(name, _)| name);
    let skipped = BY_CYCLES.iter().chain(cannot).chain(&["over::", "random::", "random_networks::"]);
    let arguments: Vec<&str> = skipped.flat_map(|name| ["--skip", *name]).collect();
    let ([passed, failed], said) = run(XF_SETTLED, &arguments);
    assert!(failed.is_empty() && passed.len() > 280, "{failed:?}\n{said}");
}

/// No test is left out that could be there.
#[test]
fn what_is_left_out_does_not_pass() {
    let names = CANNOT.map(|(name, _)| name);
    for over in [SETTLED, ONE_BY_ONE] {
        let ([passed, failed], _) = run(over, &[&["--exact"], &names[..]].concat());
        assert!(passed.is_empty(), "{over}: take them out of the table: {passed:?}");
        assert_eq!(failed.len(), names.len(), "{over}: some in the table are no tests");
    }
}
