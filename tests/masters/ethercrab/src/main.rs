//! A master with ethercrab on two drives: scan, EEPROM, SDOs, OP with distributed clocks, a path in CSP. Each step that is not as
//! it has to be ends the program with a panic.
//!
//! Of ethercrab 0.7.1 are left out, for defects of its own: values of more than 4 bytes that are written, and emergencies.

use std::time::{Duration, Instant};

use async_io::{Timer, block_on};
use ethercrab::std::{ethercat_now, tx_rx_task};
use ethercrab::subdevice_group::DcConfiguration;
use ethercrab::{DcSync, MainDevice, MainDeviceConfig, PduStorage, Timeouts};

const SLAVES_MAX: usize = 4;
const FRAME_MAX: usize = PduStorage::element_size(1100);
const FRAMES: usize = 16;
const IMAGE_MAX: usize = 128;
const CYCLE: Duration = Duration::from_millis(2);
/// How long something may take.
const LIMIT: Duration = Duration::from_secs(20);

const OPERATION_ENABLED: u16 = 0x27;
const STATE: u16 = 0x6F;

static PDUS: PduStorage<FRAMES, FRAME_MAX> = PduStorage::new();

fn main() {
    let interface = std::env::args().nth(1).expect("usage: ethercrab_master INTERFACE");
    let (tx, rx, pdus) = PDUS.try_split().expect("once");
    // A busy machine answers late, and an answer behind the limit ends the task for good.
    let timeouts = Timeouts { pdu: Duration::from_millis(1000), ..Timeouts::default() };
    let master = MainDevice::new(pdus, timeouts, MainDeviceConfig::default());
    let task = tx_rx_task(&interface, tx, rx).expect("the interface");
    std::thread::spawn(move || block_on(task).map(drop));
    block_on(run(&master));
    println!("all as it has to be");
}

async fn run(master: &MainDevice<'_>) {
    let mut group = master.init_single_group::<SLAVES_MAX, IMAGE_MAX>(ethercat_now).await.expect("a scan");
    assert_eq!(group.len(), 2);
    for mut slave in group.iter_mut(master) {
        let identity = slave.identity();
        let by_eeprom = (identity.vendor_id, identity.product_id, identity.revision);
        let mut by_sdo = [0_u32; 3];
        for (value, sub) in by_sdo.iter_mut().zip(1_u8..) {
            *value = slave.sdo_read(0x1018, sub).await.expect("0x1018");
        }
        assert_eq!([by_eeprom.0, by_eeprom.1, by_eeprom.2], by_sdo);
        // SDOs of 1, 2 and 4 bytes, there and back.
        slave.sdo_write(0x6060, 0, 8_u8).await.expect("CSP");
        assert_eq!(slave.sdo_read::<u8>(0x6060, 0).await, Ok(8));
        slave.sdo_write(0x6072, 0, 900_u16).await.expect("0x6072");
        assert_eq!(slave.sdo_read::<u16>(0x6072, 0).await, Ok(900));
        slave.sdo_write(0x6065, 0, 123_456_u32).await.expect("0x6065");
        assert_eq!(slave.sdo_read::<u32>(0x6065, 0).await, Ok(123_456));
        // Aborts.
        let missing = slave.sdo_read::<u32>(0x5123, 0).await.expect_err("there is no such object");
        assert!(format!("{missing:?}").contains("NotFound") || missing.to_string().contains("exist"), "{missing:?}");
        slave.sdo_write(0x1018, 1, 0_u32).await.expect_err("it is read only");
        slave.set_dc_sync(DcSync::Sync0);
    }
    let group = group.into_pre_op_pdi(master).await.expect("process data");
    for _ in 0..200 {
        group.tx_rx_sync_system_time(master).await.expect("the time");
        Timer::after(CYCLE / 4).await;
    }
    let clocks = DcConfiguration {
        start_delay: Duration::from_millis(100),
        sync0_period: CYCLE,
        sync0_shift: Duration::ZERO,
    };
    let group = group.configure_dc_sync(master, clocks).await.expect("clocks");
    let group = group.into_safe_op(master).await.expect("SafeOP");
    let group = group.request_into_op(master).await.expect("OP is requested");

    let begin = Instant::now();
    let cycle = async || {
        let answer = group.tx_rx_dc(master).await.expect("process data");
        Timer::after(answer.extra.next_cycle_wait.min(CYCLE)).await;
        answer
    };
    while !cycle().await.all_op() {
        assert!(begin.elapsed() < LIMIT, "the drives are not in OP");
    }

    // Statusword and position of a drive; controlword and target of both.
    let drive = |n: usize| {
        let slave = group.subdevice(master, n).expect("a drive");
        let inputs = slave.inputs_raw();
        assert_eq!(inputs.len(), 10);
        let status = u16::from_le_bytes([inputs[0], inputs[1]]);
        (status, i32::from_le_bytes([inputs[2], inputs[3], inputs[4], inputs[5]]))
    };
    let put = |control: u16, targets: [i32; 2]| {
        for (n, target) in targets.into_iter().enumerate() {
            let slave = group.subdevice(master, n).expect("a drive");
            let mut outputs = slave.outputs_raw_mut();
            outputs[..2].copy_from_slice(&control.to_le_bytes());
            outputs[2..6].copy_from_slice(&target.to_le_bytes());
        }
    };
    let stand = [0, 1].map(|n| drive(n).1);
    for (control, state) in [(0x06, 0x21), (0x07, 0x23), (0x0F, OPERATION_ENABLED)] {
        put(control, stand);
        let begin = Instant::now();
        while [0, 1].iter().any(|n| drive(*n).0 & STATE != state) {
            cycle().await;
            assert!(begin.elapsed() < LIMIT, "state {state:#x}: {:?}", [0, 1].map(drive));
        }
    }
    for step in 1..=500 {
        put(0x0F, [stand[0] + 20 * step, stand[1] - 10 * step]);
        assert_eq!(cycle().await.working_counter, 6);
    }
    let ends = [stand[0] + 10_000, stand[1] - 5_000];
    let begin = Instant::now();
    while [0, 1].iter().any(|n| (drive(*n).1 - ends[*n]).abs() > 1) {
        cycle().await;
        assert!(begin.elapsed() < LIMIT, "{ends:?}: {:?}", [0, 1].map(drive));
    }
    assert!([0, 1].iter().all(|n| drive(*n).0 & STATE == OPERATION_ENABLED));
    let group = group.into_safe_op(master).await.expect("SafeOP");
    let group = group.into_pre_op(master).await.expect("PreOP");
    group.into_init(master).await.expect("Init");
}
