//! The durations of the chip's operations.

use crate::ethercat::{AlState, Ns};

/// The durations of the chip's operations. `[OURS]` The manuals give only one of them: a packet is processed in less than 150
/// us (XF EN, "ECM-XF Interrupt"). All others are assumptions; those of network operations are typical of a small network of
/// servo drives. On a network with real frames a command takes this long, or longer if its frames need more time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChipTiming {
    /// From power-on or WARM_RESET until packets are accepted. The vendor's driver waits 1 s (OBS).
    pub start_ns: Ns,
    /// From the moment at which packets are accepted until the network port is initialised.
    pub port_ns: Ns,
    /// From the end of a packet until the next one is accepted.
    pub packet_ns: Ns,
    /// Duration of ECAT_INIT_OP, for a network of any size.
    pub init_ns: Ns,
    /// Additional duration of ECAT_RECONFIG_OP and CONFIG_MAP for each slave.
    pub slave_ns: Ns,
    /// Duration of ECAT_RECONFIG_OP and CONFIG_MAP, without the addition for each slave.
    pub reconfig_ns: Ns,
    /// Duration of a change of state from Init to PreOP.
    pub to_preop_ns: Ns,
    /// Duration of a change of state from PreOP to SafeOP.
    pub to_safeop_ns: Ns,
    /// Duration of a change of state from SafeOP to OP.
    pub to_op_ns: Ns,
    /// Duration of a change of state to a lower state, or to the present one.
    pub down_ns: Ns,
    /// Additional duration of a change of state for each slave that changes its state.
    pub change_slave_ns: Ns,
    /// Duration of ECAT_STATE_UPDATE.
    pub update_ns: Ns,
    /// Duration of ECAT_INIT_DC_OP and of ECAT_DCSYNC.
    pub dc_ns: Ns,
    /// Time from the end of an initialisation of the clocks until they are synchronised and the status bit DC_STABLE is set.
    pub dc_settle_ns: Ns,
    /// Duration of an SDO transfer, or of an access to an EEPROM or a mailbox.
    pub sdo_ns: Ns,
    /// Duration of PDO_CONFIG_SET and of PDO_CONFIG_REQ, each of which makes several SDO transfers.
    pub pdo_config_ns: Ns,
    /// Duration of FIFO_INIT.
    pub fifo_init_ns: Ns,
    /// Duration of one command that reads or writes the flash memory, whatever its length, and minimum duration of a file
    /// transfer.
    pub flash_ns: Ns,
    /// Duration of sending a datagram, and of setting a sync manager.
    pub datagram_ns: Ns,
    /// Duration of a conversion of the ADC.
    pub adc_ns: Ns,
    /// The EtherCAT cycle time before ECAT_INIT_OP, and if its SYNC0 time is 0.
    pub cycle_ns: Ns,
}

impl Default for ChipTiming {
    fn default() -> Self {
        const US: Ns = 1_000;
        const MS: Ns = 1_000 * US;
        Self {
            start_ns: 500 * MS,
            port_ns: 200 * MS,
            packet_ns: 100 * US,
            init_ns: 200 * MS,
            slave_ns: 10 * MS,
            reconfig_ns: 20 * MS,
            to_preop_ns: 50 * MS,
            to_safeop_ns: 300 * MS,
            to_op_ns: 50 * MS,
            down_ns: 20 * MS,
            change_slave_ns: 2 * MS,
            update_ns: 2 * MS,
            dc_ns: 20 * MS,
            dc_settle_ns: 100 * MS,
            sdo_ns: 3 * MS,
            pdo_config_ns: 30 * MS,
            fifo_init_ns: MS,
            flash_ns: 5 * MS,
            datagram_ns: 2 * MS,
            adc_ns: 2 * US,
            cycle_ns: MS,
        }
    }
}

impl ChipTiming {
    /// The duration of one step of a change of state in which `slaves` slaves go to the state `to`, ns. If `upwards` is false,
    /// the duration of a change to a lower state applies, whatever `to` is.
    pub(super) const fn change_ns(&self, to: AlState, upwards: bool, slaves: u8) -> Ns {
        let change = match to {
            _ if !upwards => self.down_ns,
            AlState::PreOp => self.to_preop_ns,
            AlState::SafeOp => self.to_safeop_ns,
            AlState::Op => self.to_op_ns,
            AlState::Init => self.down_ns,
        };
        change + self.change_slave_ns * slaves as Ns
    }
}
