//! How long the chip takes for what it does.

use crate::ethercat::{AlState, Ns};

/// Durations. `[OURS]` The manuals give one alone, that a packet is processed in less than 150 us (XF EN, "ECM-XF
/// Interrupt"); those of the network are of a small one of servo drives. On a network of frames a command takes as long as these
/// say, or as its frames need if that is longer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// From power-on or WARM_RESET until packets are taken. The vendor's driver waits 1 s (OBS).
    pub start_ns: Ns,
    /// From then until the network port is initialised.
    pub port_ns: Ns,
    /// From the end of a packet until the next one is taken.
    pub packet_ns: Ns,
    /// ECAT_INIT_OP, of a network of any size.
    pub init_ns: Ns,
    /// What each slave adds to RECONFIG_OP and CONFIG_MAP.
    pub slave_ns: Ns,
    /// ECAT_RECONFIG_OP and CONFIG_MAP, without what each slave adds.
    pub reconfig_ns: Ns,
    /// From Init to PreOP.
    pub to_preop_ns: Ns,
    /// From PreOP to SafeOP.
    pub to_safeop_ns: Ns,
    /// From SafeOP to OP.
    pub to_op_ns: Ns,
    /// To a lower state, or to the present one.
    pub down_ns: Ns,
    /// What each slave adds to a change of state.
    pub change_slave_ns: Ns,
    /// ECAT_STATE_UPDATE.
    pub update_ns: Ns,
    /// ECAT_INIT_DC_OP and ECAT_DCSYNC.
    pub dc_ns: Ns,
    /// From the end of an initialisation of the clocks until they are stable.
    pub dc_settle_ns: Ns,
    /// An SDO transfer, an access to an EEPROM or to a mailbox.
    pub sdo_ns: Ns,
    /// PDO_CONFIG_SET and PDO_CONFIG_REQ, which are some SDO transfers.
    pub pdo_config_ns: Ns,
    /// FIFO_INIT.
    pub fifo_init_ns: Ns,
    /// Reading or writing flash memory; a file takes as long at least.
    pub flash_ns: Ns,
    /// A datagram, and setting a sync manager.
    pub datagram_ns: Ns,
    /// A conversion of the ADC.
    pub adc_ns: Ns,
    /// The EtherCAT cycle if ECAT_INIT_OP has 0 for SYNC0, and before it.
    pub cycle_ns: Ns,
}

impl Default for Timing {
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

impl Timing {
    /// One change of state of so many slaves.
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
