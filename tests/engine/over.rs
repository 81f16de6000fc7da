//! Runs the whole group once more, over a bus that takes outputs ahead and is as late as a real one ([`Ahead::chip`]):
//! a program sees the same on every bus. This program runs itself with [`OVER`] in its environment; every board then
//! has such a bus. After the cycles of a test, as many more pass as the bus is late. It does so again with the slaves
//! behind the model of an ECM-XF, and at the end of a wire, as controllers that our own master reaches.
//!
//! [`Ahead::chip`]: support::ahead_bus::Ahead::chip

use std::collections::BTreeSet;
use std::env;
use std::process::Command;
use std::thread;

use crate::host::{NIC, ONE_BY_ONE, OVER, SETTLED, SLAVES_MOVED, XF_ONE_BY_ONE, XF_SETTLED};

/// Tests that count cycles, and so pass only without additional cycles.
const BY_CYCLES: [&str; 18] = [
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
    "sdo::a_request_during_the_boards_own_transfers_is_held",
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
const CANNOT: [(&str, &str); 43] = [
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
    ("nic_bus::another_master_is_named", "a bus that takes ahead does not tell of other masters"),
    (
        "nic_bus::a_network_that_does_not_answer_is_told",
        "a bus that takes ahead does not say that the one behind it is down",
    ),
    ("nic_bus::what_a_slave_misses_beside_lost_ones_is_counted", CYCLE_BY_CYCLE),
    ("nic_bus::what_a_slave_misses_that_falls_behind_lost_ones_is_counted", CYCLE_BY_CYCLE),
    ("nic_bus::what_a_slave_misses_that_nobody_sees_fall_is_counted", CYCLE_BY_CYCLE),
    ("nic_ring::a_cut_costs_nothing", CYCLE_BY_CYCLE),
    ("repeats::cycles_without_an_entry_are_counted", CYCLE_BY_CYCLE),
    ("sdo::a_third_request_replaces_the_one_that_is_held", CYCLE_BY_CYCLE),
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
const SLOWER: &str =
    "its times are too short for a chip, where each SDO and each move of a slave is a command, one after the other";
const LOST_LATER: &str = "the chip tells one after the other which slaves are lost, and the test waits for the first";
const SDO_WAITS: &str = "the chip has one mailbox command at a time: an SDO waits for the end of the change (SK-12.10)";
const WATCHDOG: &str =
    "its cycle is longer than 100 ms: behind the chip the watchdogs of the slaves end OP between two sets of outputs";

/// Tests that cannot pass with the slaves behind an ECM-XF, besides those above, and why.
const CANNOT_BEHIND_CHIP: [(&str, &str); 43] = [
    ("cable::a_cut_before_the_first_slave", SILENCE),
    ("cable::a_cut_between_slaves", LOST_LATER),
    ("cable::a_set_state_while_the_cable_is_cut", SLOWER),
    ("cable::lost_slaves_are_configured_again", LOST_LATER),
    ("cable_below_op::a_change_that_fails_is_seen", SLOWER),
    ("failures::a_change_has_its_time", SLOWER),
    ("failures::a_change_that_waits_has_its_time", SLOWER),
    (
        "failures::a_silent_slave_declared_none",
        "the chip lays out the process data of all slaves: one that is silent is missed although it is declared none",
    ),
    ("failures::the_next_set_state_tries_again", SLOWER),
    (
        "homing_at_once::without_an_old_result_a_new_one_counts_at_once",
        "it looks in the cycle in which the result comes up",
    ),
    (
        "homing_ends::leaving_op_ends_homing",
        "the drive is off before it has left OP, so that this is the end of its homing",
    ),
    ("homing_real::every_method_through_the_board", SPEED),
    ("leaving::counters_survive_sw_reset", WATCHDOG),
    ("left_behind::nobody_is_left_behind_without_a_failure", SLOWER),
    (
        "lost::a_slave_that_is_back_holds_its_place",
        "the first outputs of a slave that is back have an old target, with its motor off",
    ),
    ("lost::all_lost_with_outputs_ahead", WATCHDOG),
    ("lost::lost_slaves_allocate_nothing", ONE_SLAVE_AT_A_TIME),
    ("lost_together::many_at_once", ONE_SLAVE_AT_A_TIME),
    (
        "lost_together::who_refuses_keeps_nobody_back",
        "the chip lays out the process data of all slaves: one that refuses PreOP keeps the others from coming back",
    ),
    ("mixed::every_wrong_declaration_fails", SLOWER),
    ("rejections::counters", WATCHDOG),
    (
        "replaced::another_target_has_its_own_time",
        "a slave that is silent while it is configured ends the change when its SDO has timed out",
    ),
    ("sdo::a_request_during_the_boards_own_transfers_is_held", SDO_WAITS),
    ("sdo_beside::beside_a_change_that_waits", SDO_WAITS),
    ("sdo_beside::beside_a_change_that_waits_for_a_lost_slave", SDO_WAITS),
    ("sdo_beside::not_beside_the_mapping", SDO_WAITS),
    ("states::axes_are_declared_by_nibbles", SLOWER),
    ("full_table_run::", "it takes as long as all others"),
    ("nic_allocation::", "it has another bus"),
    ("nic_bus::", "it has another bus"),
    ("nic_odd::", "it has another bus"),
    ("nic_predecessor::", "it has another bus"),
    ("nic_ring::", "it has another bus"),
    ("nic_terminals::", "it has another bus"),
    ("xf_bus::", "it has such a bus"),
    ("xf_ahead::", "it has such a bus"),
    ("xf_faults::", "it has such a bus"),
    ("xf_doubts::", "it has such a bus"),
    ("xf_network::", "it has such a bus"),
    ("xf_packets::", "it has such a bus"),
    ("xf_remap::", "it has such a bus"),
    ("xf_start::", "it has such a bus"),
    ("xf_state::", "it has such a bus"),
];

const WAY_DOWN: &str = "no slave controller refuses a way down, as the test wants it";
const SILENT: &str =
    "a slave that lets frames pass without power is as if it were not there, and equal ones behind it move up";
const ITS_TIMES: &str =
    "it looks while a change, a configuration or an SDO is under way, and those of our master take other times";

/// Tests that cannot pass with the slaves at the end of a wire, besides those of [`CANNOT`], and why.
const CANNOT_ON_WIRE: [(&str, &str); 51] = [
    ("answers::a_failed_change_goes_by_the_low_nibble", WAY_DOWN),
    (
        "any_bus::states_and_the_ways_between",
        "the way from SafeOP to OP is the longest one: it waits for the first SYNC0",
    ),
    ("cable::losses_are_logged", "a working counter that is too low comes before the names of those that are lost"),
    ("cable::lost_on_the_way_down", ITS_TIMES),
    ("cable::lost_while_others_come_back", ITS_TIMES),
    ("cable_below_op::a_change_that_fails_is_seen", ITS_TIMES),
    ("failures::a_change_has_its_time", ITS_TIMES),
    ("failures::a_change_may_take_for_ever", ITS_TIMES),
    ("fifo::set_state_does_not_wait_and_leaving_op_empties_the_fifo", ITS_TIMES),
    ("homing_at_once::an_old_result_that_comes_up_late_is_none", CYCLE_BY_CYCLE),
    (
        "homing_ends::leaving_op_ends_homing",
        "the drive is off before it has left OP, so that this is the end of its homing",
    ),
    ("homing_real::a_homing_that_fails", ITS_TIMES),
    ("io_slaves::the_image_is_what_is_output", CYCLE_BY_CYCLE),
    ("leaving::frames_while_booting_are_counted", ITS_TIMES),
    ("leaving::slave_slots_keep_their_values", CYCLE_BY_CYCLE),
    ("leaving::sw_reset_resets_all_variables", ITS_TIMES),
    ("left_behind::", WAY_DOWN),
    ("local_io::local_io_needs_no_network", ITS_TIMES),
    ("lost::a_slave_that_is_back_holds_its_place", CYCLE_BY_CYCLE),
    ("lost::another_target_on_the_way_back", ITS_TIMES),
    ("lost::no_motor_starts_when_a_slave_comes_back", ITS_TIMES),
    (
        "lost::no_output_comes_on_when_a_slave_comes_back",
        "the slave is away for less than its watchdog waits, three cycles, and so long its outputs have not gone off",
    ),
    ("lost::the_command_of_the_cycle_of_the_loss", "who is lost is known some cycles later"),
    ("lost_together::a_late_one_comes_back_too", SILENT),
    ("lost_together::below_op", SILENT),
    ("lost_together::dead_slaves_keep_nobody_back", SILENT),
    ("partial_frames::sw_reset_forgets_a_frame_under_way", ITS_TIMES),
    ("replaced::a_refusal_after_another_target", ITS_TIMES),
    ("replaced::another_target_has_its_own_time", ITS_TIMES),
    ("replaced::one_new_setting_is_configured", ITS_TIMES),
    ("sdo::a_request_during_the_boards_own_transfers_is_held", ITS_TIMES),
    ("sdo_beside::", ITS_TIMES),
    ("states::a_replaced_target_is_given_up_at_once", ITS_TIMES),
    ("states::a_target_is_replaced_on_the_way_down", ITS_TIMES),
    ("states::init_accepts_init_and_preop", ITS_TIMES),
    ("full_table_run::", "it takes as long as all others"),
    ("nic_allocation::", "it has such a bus"),
    ("nic_bus::", "it has such a bus"),
    ("nic_odd::", "it has such a bus"),
    ("nic_predecessor::", "it has such a bus"),
    ("nic_ring::", "it has such a bus"),
    ("nic_terminals::", "it has such a bus"),
    ("xf_bus::", "it has another bus"),
    ("xf_ahead::", "it has another bus"),
    ("xf_faults::", "it has another bus"),
    ("xf_doubts::", "it has another bus"),
    ("xf_network::", "it has another bus"),
    ("xf_packets::", "it has another bus"),
    ("xf_remap::", "it has another bus"),
    ("xf_start::", "it has another bus"),
    ("xf_state::", "it has another bus"),
];

/// Tests without a board over a plain simulated network, so that their slaves are not behind the chip in such a run:
/// tests with their own buses that take outputs ahead or fail, and tests that boot boards themselves.
const NOT_BEHIND_CHIP: [&str; 38] = [
    "ahead_entries::",
    "alarms::a_program_gets_out_of_a_fault_on_every_bus",
    "alarms::clear_takes_back_an_alarm_clear",
    "allocation::a_board_of_a_link_allocates_nothing",
    "allocation::outputs_ahead_allocate_nothing",
    "allocation::the_stepped_runner_allocates_nothing",
    "bus_ahead::a_phase_is_no_silence",
    "bus_ahead::a_threshold_holds_back_what_could_lie_ahead",
    "bus_ahead::a_walk_needs_no_more_frames",
    "bus_ahead::clear_brings_back_no_sv_on_that_has_ended",
    "bus_ahead::clear_starts_no_motor",
    "bus_ahead::clear_takes_back_walks",
    "bus_ahead::clear_takes_back_what_lies_ahead",
    "bus_ahead::idle_outputs_do_not_pile_up",
    "bus_ahead::leaving_op_drops_what_lies_ahead",
    "bus_ahead::op_begins_with_the_heads_of_the_commands_before",
    "bus_ahead::reports_are_right_however_cycles_and_polls_fall",
    "bus_ahead::what_lies_ahead_counts",
    "homing::a_clear_takes_homing_back",
    "homing_ends::every_end_is_worded",
    "homing_restore::a_home_event_behind_an_abort_makes_no_jump",
    "honest::",
    "hsp_network::clear_takes_back_outputs_that_lie_ahead",
    "io_slaves::outputs_ahead",
    "leds::a_board_that_starts",
    "leds::a_link_shows_the_leds",
    "leds::the_reference_clock",
    "left_behind::a_change_under_way_leaves_nobody_behind",
    "lost::a_slave_that_is_back_shows_what_has_reached_it",
    "lost::old_answers_are_no_new_loss",
    "nic_runner::",
    "repeats::",
    "sag::",
    "states::boot_ends_in_preop",
    "states::boot_with_a_slave_that_refuses",
    "states::boot_without_a_slave",
    "test_mode::a_write_that_is_cleared",
    "test_mode::the_key_of_a_link",
];

/// Modules whose tests use their own bus for every board, and single tests of that kind.
const OWN_BUS: [&str; 7] =
    ["nic_counters::", "nic_gone::", "over::", "random::", "random_networks::", "stale_program::", "xf_counters::"];

/// Runs this program's tests once more; returns the names of the tests that passed and of those that failed, and the
/// output.
fn run(over: &str, arguments: &[&str]) -> ([BTreeSet<String>; 2], String) {
    // More than one thread: else the thread of a test does not have its name.
    let threads = thread::available_parallelism().map_or(2, |n| n.get().max(2)).to_string();
    let mut program = Command::new(env::current_exe().expect("the test knows its file"));
    let output = program.args(arguments).args(["--test-threads", &threads]).env(OVER, over).output().expect("it runs");
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    let ended = |how: &str| {
        let lines = said.lines().filter_map(|line| line.strip_prefix("test ")?.strip_suffix(how));
        lines.map(str::to_owned).collect()
    };
    ([ended(" ... ok"), ended(" ... FAILED")], said)
}

/// Whether a test had a board whose slaves were behind the chip, or at the end of the wire.
fn has_moved_slaves(said: &str, test: &str) -> bool {
    said.contains(&format!("{SLAVES_MOVED}{test}\n"))
}

/// SK-12.1 A program sees the same over other hardware as over a simulated network.
#[test]
fn all_that_a_program_sees_is_the_same() {
    let skipped = BY_CYCLES.iter().chain(CANNOT.iter().map(|(name, _)| name)).chain(&OWN_BUS);
    // These tests take as long as all others, so only `cargo xtask soak` runs them.
    let long = if env::var_os("ECMSK_SOAK_FRAMES").is_some() { &[][..] } else { &["full_table_run::"] };
    let skipped = skipped.chain(long);
    let arguments: Vec<&str> = skipped.flat_map(|name| ["--skip", *name]).collect();
    let ([passed, failed], said) = run(SETTLED, &arguments);
    assert!(failed.is_empty() && passed.len() > 280, "{failed:?}\n{said}");
    let ([passed, failed], said) = run(ONE_BY_ONE, &[&["--exact"], &BY_CYCLES[..]].concat());
    assert!(failed.is_empty() && passed.len() == BY_CYCLES.len(), "{failed:?}\n{said}");
}

/// XF-19.1 The same with the slaves behind the model of an ECM-XF, in all tests except those in a table.
#[test]
fn all_that_a_program_sees_is_the_same_behind_an_ecm_xf() {
    let cannot: Vec<&str> = CANNOT.iter().chain(&CANNOT_BEHIND_CHIP).map(|(name, _)| *name).collect();
    let skipped = BY_CYCLES.iter().chain(&cannot).chain(&OWN_BUS);
    let arguments: Vec<&str> = skipped.flat_map(|name| ["--skip", *name]).collect();
    let ([passed, failed], said) = run(XF_SETTLED, &arguments);
    assert!(failed.is_empty() && passed.len() > 280, "{failed:?}\n{said}");
    let (behind, others): (BTreeSet<_>, BTreeSet<_>) =
        passed.iter().map(String::as_str).partition(|test| has_moved_slaves(&said, test));
    assert!(behind.len() > 230, "{}", behind.len());
    let is_named = |test: &str| {
        NOT_BEHIND_CHIP.iter().any(|name| test == *name || (name.ends_with("::") && test.starts_with(name)))
    };
    let more: Vec<_> = others.iter().filter(|test| !is_named(test)).collect();
    assert!(more.is_empty(), "no slave of these is behind the chip: name them in NOT_BEHIND_CHIP: {more:?}");
    let less: Vec<_> = behind.iter().filter(|test| is_named(test)).collect();
    assert!(less.is_empty(), "these are behind the chip: take them out of NOT_BEHIND_CHIP: {less:?}");

    let by_cycles: Vec<&str> = BY_CYCLES.into_iter().filter(|name| !cannot.contains(name)).collect();
    let ([passed, failed], said) = run(XF_ONE_BY_ONE, &[&["--exact"], &by_cycles[..]].concat());
    assert!(failed.is_empty() && passed.len() == by_cycles.len(), "{failed:?}\n{said}");
    let others: Vec<_> = passed.iter().filter(|test| !has_moved_slaves(&said, test)).collect();
    assert!(others.is_empty(), "{others:?}");
}

/// A program sees the same with the slaves at the end of a wire, as slave controllers that the software master reaches.
#[test]
fn all_that_a_program_sees_is_the_same_on_a_network_card() {
    let cannot: Vec<&str> = CANNOT.iter().chain(&CANNOT_ON_WIRE).map(|(name, _)| *name).collect();
    let skipped = BY_CYCLES.iter().chain(&cannot).chain(&OWN_BUS);
    let arguments: Vec<&str> = skipped.flat_map(|name| ["--skip", *name]).collect();
    let ([passed, failed], said) = run(NIC, &arguments);
    assert!(failed.is_empty() && passed.len() > 250, "{failed:?}\n{said}");
    let moved = passed.iter().filter(|test| has_moved_slaves(&said, test)).count();
    assert!(moved > 200, "{moved} of {}", passed.len());
}

/// Every excluded test really fails there.
#[test]
fn what_is_left_out_does_not_pass() {
    let names = CANNOT.map(|(name, _)| name);
    for over in [SETTLED, ONE_BY_ONE] {
        let ([passed, failed], _) = run(over, &[&["--exact"], &names[..]].concat());
        assert!(passed.is_empty(), "{over}: take them out of the table: {passed:?}");
        assert_eq!(failed.len(), names.len(), "{over}: some in the table are no tests");
    }
}
