//! What the chip does when it receives a command. Commands that take time are only started here, as jobs. By subject:
//!
//! | file | commands |
//! | --- | --- |
//! | `start.rs` | those that take time |
//! | `network.rs` | states, slaves, working counter |
//! | `pdo.rs` | process data and FIFOs |
//! | `unit.rs` | the chip itself: packets, version, resets, interrupts; the CiA 402 helper |
//! | `io.rs` | GPIO, encoder, DAC, ADC |
//! | `fetched.rs` | results read from registers, EEPROMs and mailboxes |

mod fetched;
mod io;
mod network;
mod pdo;
mod start;
mod unit;

pub use start::SYNC0_MIN_NS;

use super::Chip;
use super::network::SlaveNetwork;
use crate::xf::request::{FoeRequest, ReceiveMailbox, Request};
use crate::xf::response::{Answer, Returned};
use crate::xf::{CommandCode, Malformed};

/// Commands that need registers, EEPROMs or raw mailboxes. A network of slave models has none of these; there the chip
/// answers such commands with the command error. It does the same for operations 1 and 2 of FOE_FUNC_REQ, which
/// transfer files of slaves, but not for operations 3 and 4, which access the chip's own flash memory.
///
/// On such a network ECAT_INIT_OP stores the SYNC1 time and the shift of SYNC0 without using them, and ignores the choice of
/// the reference clock. Its option for "special slaves", which the manuals do not explain, has no effect on any network.
pub const NEED_REGISTERS: [CommandCode; 7] = [
    CommandCode::EepromRequest,
    CommandCode::EepromGet,
    CommandCode::ConfigSyncManager,
    CommandCode::RawRequest,
    CommandCode::RawGet,
    CommandCode::ReceiveMailbox,
    CommandCode::MailboxStatus,
];

/// The command is invalid: it has no effect, and the chip sets the command error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CommandRefused;

impl From<Malformed> for CommandRefused {
    /// Refuses a command with a field that the manuals do not allow, or whose answer does not fit into the data segment of the
    /// packet.
    fn from(_: Malformed) -> Self {
        Self
    }
}

/// The outcome of a command: the header fields of its answer, or a refusal. The answer's data are in the data segment already.
pub(super) type CommandOutcome = Result<Returned, CommandRefused>;

/// The outcome of a successful command without a result.
const DONE: CommandOutcome = Ok(Returned::NONE);

/// The outcome of a command without a result, which is refused unless `done`.
const fn done_if(done: bool) -> CommandOutcome {
    if done { DONE } else { Err(CommandRefused) }
}

/// Writes the answer of a command into the data segment and returns the outcome; without an answer, the outcome is a refusal.
fn answered<'a>(answer: Option<impl Answer<'a>>, data: &mut [u8]) -> CommandOutcome {
    Ok(answer.ok_or(CommandRefused)?.encode(data)?)
}

impl<N: SlaveNetwork> Chip<N> {
    /// Runs a command, and writes the data of its answer into `data`, a segment that is all 0.
    ///
    /// # Errors
    /// [`CommandRefused`], if the command is invalid.
    pub(super) fn run(&mut self, request: &Request<'_>, data: &mut [u8]) -> CommandOutcome {
        if !self.has(request) {
            return Err(CommandRefused);
        }
        match *request {
            Request::InfoUpdate(_) => DONE,

            Request::PdoWorkingCounterGet(ref request) => self.working_counter_item(request, data),
            Request::StateGet(ref request) => self.state_get(request, data),
            Request::SlaveInfoGet(ref request) => self.slave_info(request, data),
            Request::SlaveCountGet(_) => Ok(self.bus.count.encode(data)?),
            Request::EnableLrw(request) => self.enable_lrw(request.lrw),
            Request::SdoGet(_) => self.sdo_get(data),
            Request::SdoAbortCodeGet(_) => Ok(self.sdo.abort.encode(data)?),
            Request::CoeEmergency(request) => answered(self.results.emergencies.list(request.count.get().into()), data),
            Request::EepromGet(_) => self.eeprom_get(data),
            Request::RawGet(_) => self.raw_get(data),
            Request::DirectAssign(ref request) => self.direct_assign(request),
            Request::ReceiveMailbox(ReceiveMailbox::Read(part)) => self.mailbox_part(part, data),
            Request::MailboxStatus(ref request) => self.mailbox_status(request, data),
            Request::WkcErrorCountGet(_) => Ok(self.bus.wkc_errors_in_a_row.encode(data)?),
            Request::WkcErrorMaxGet(_) => Ok(self.bus.wkc_limit.encode(data)?),
            Request::WkcErrorMaxSet(request) => {
                self.bus.wkc_limit = request.limit();
                DONE
            }

            Request::PdoDataFifo(ref request) => Ok(self.pdo_data_fifo(request, data)),
            Request::PdoData(ref request) => Ok(self.pdo_data(request, data)),
            Request::PdoConfigGet(_) => answered(self.pdo_config, data),
            Request::FifoEnable(request) => {
                self.fifo_on = request.on;
                DONE
            }
            Request::FifoPackSizeGet(request) => Ok(self.pdo_bytes(request.fifo).encode(data)?),
            Request::FifoClear(request) => self.clear_fifos(request.fifos),
            Request::FifoSetTxCount(request) => Self::set_entries(&mut self.fifos.tx_entries, request.entries),
            Request::FifoGetTxCount(_) => Ok(self.fifos.tx_entries.encode(data)?),
            Request::FifoSetRxCount(request) => Self::set_entries(&mut self.fifos.rx_entries, request.entries),
            Request::FifoGetRxCount(_) => Ok(self.fifos.rx_entries.encode(data)?),
            Request::FifoThresholdSet(request) => {
                self.fifos.thresholds = request;
                DONE
            }

            Request::SpiPackSizeGet(_) => Ok(self.size.encode(data)?),
            Request::SpiReconfig(request) => self.set_size(request.size),
            Request::CrcErrorCountClear(_) => self.clear_crc_errors(data),
            Request::CrcTypeSet(request) => {
                self.check = request.kind;
                DONE
            }
            Request::FirmwareVersionGet(_) => self.version(data),
            Request::AsyncReset(request) => self.reset_job(request.actions()),
            Request::WarmReset(_) => {
                self.restarts = true;
                DONE
            }
            Request::Mdio(request) => answered(self.phys.run(request), data),
            Request::InterruptSetEnable(request) => {
                self.interrupts.enable = request.enable;
                DONE
            }
            Request::InterruptGetEnable(_) => Ok(self.interrupts.enable.encode(data)?),
            Request::FoeGet(_) => answered(self.flash.result(), data),

            Request::HelperConfigSet(ref request) => {
                self.helper.configure(request);
                DONE
            }
            Request::HelperStateSet(request) => done_if(self.helper.set_target(request.motor.get(), request.state)),
            Request::HelperStateGet(request) => self.drive_state(request.motor, data),
            Request::HelperControlSet(ref request) => {
                done_if(self.helper.set_control(request, self.profile.has_helper_defaults()))
            }
            Request::HelperControlGet(request) => answered(self.helper.control(request.motor.get()), data),
            Request::HelperStatuswordGet(request) => answered(self.statusword(request.motor), data),

            ref other => self.run_io(other, data).unwrap_or_else(|| self.start(other)),
        }
    }

    /// Whether the chip's firmware and its network support the command and the function that the request selects.
    fn has(&self, request: &Request<'_>) -> bool {
        let needs_registers = match request {
            Request::FoeRequest(FoeRequest::Upload(_) | FoeRequest::Download(_)) => true,
            _ => NEED_REGISTERS.contains(&request.code()),
        };
        let is_there = !needs_registers || self.network.knows_registers();
        let function = request.function().and_then(|parameter| request.code().function(parameter));
        is_there && function.is_none_or(|function| function.since <= self.profile.version)
    }
}
