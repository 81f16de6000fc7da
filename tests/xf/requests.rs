//! Every request byte by byte, as the manuals print it, both ways.

mod bus;
mod chip;
mod io;
mod pdo;
mod transfers;

use crate::codes::{check_all, note_checked};
use crate::{Printed, check};

/// Checks a request against the bytes that the manual prints.
fn case<'d>(request: impl Into<ecmsk::xf::Request<'d>>, printed: Printed) {
    check(request, &printed);
    note_checked(printed.code, (31..=35).contains(&printed.code).then_some(printed.par));
}

/// A command with only `par` and information bytes.
fn short(code: u8, par: u8, info: [u8; 4]) -> Printed {
    Printed { code, par, info, ..Printed::default() }
}

/// A command with only data, all of which the length counts.
fn long(code: u8, par: u8, data: Vec<u8>) -> Printed {
    Printed { code, par, len: data.len() as u16, data, ..Printed::default() }
}

/// XF-4.1 Every function of the manuals is among those whose bytes these tests know.
#[test]
fn every_function_is_checked_byte_by_byte() {
    check_all(&[
        bus::ecat_init,
        bus::ecat_dcsync,
        bus::ecat_states,
        bus::numbers_and_items,
        bus::sync_managers_and_fmmus,
        bus::assigned_lengths,
        bus::commands_without_arguments,
        chip::packet_size_and_check_word,
        chip::enabled_interrupts,
        chip::resets_of_the_chip,
        chip::working_counter_errors,
        chip::phy_registers,
        chip::helper_configuration,
        chip::helper_state_codes,
        io::gpio_configuration,
        io::gpio_interrupt_types,
        io::gpio_outputs_and_inputs,
        io::encoder_functions,
        io::dac_functions,
        io::adc_functions,
        pdo::process_data,
        pdo::configured_pdos,
        pdo::fifo_commands,
        pdo::fifo_limits,
        transfers::sdo_requests,
        transfers::eeprom_requests,
        transfers::raw_requests,
        transfers::foe_requests,
        transfers::mailbox_requests,
        transfers::mailbox_status_requests,
    ]);
}
