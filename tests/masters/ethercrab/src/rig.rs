//! Code that the programs share: the master, changes of state, cycles of process data, drives by CiA 402, and injected
//! faults.

use std::io::stdin;
use std::thread::spawn;
use std::time::{Duration, Instant};

use async_io::{Timer, block_on};
use ethercrab::error::Error;
use ethercrab::std::{ethercat_now, tx_rx_task};
use ethercrab::subdevice_group::{DcConfiguration, HasDc, NoDc, Op, PreOp};
use ethercrab::{
    AlStatusCode, DcSync, DefaultLock, MainDevice, MainDeviceConfig, PduStorage, RegisterAddress, SubDeviceGroup,
    SubDeviceRef, Timeouts, TxRxResponse,
};

/// Room for the slaves and the process data of most programs.
pub const SLAVES_MAX: usize = 4;
pub const IMAGE_MAX: usize = 256;
pub const CYCLE: Duration = Duration::from_millis(2);
/// The longest wait.
const LIMIT: Duration = Duration::from_secs(30);
/// The most data that a frame carries. ethercrab 0.7.1 reads 1500 bytes of a frame, of which Ethernet has up to 1514.
pub const DATA_MAX: usize = 1472;
const FRAME_MAX: usize = PduStorage::element_size(DATA_MAX);
const FRAMES: usize = 16;
/// The watchdog of process data, in units of 100 us: the machine that runs tests may be busy with others.
const WATCHDOG: u16 = 20_000;

pub const OPERATION_ENABLED: u16 = 0x27;
pub const FAULT: u16 = 0x08;
pub const STATE: u16 = 0x6F;

/// States of the AL status, and the error bit, for a state that was refused or left.
pub const PRE_OP: u16 = 0x02;
pub const OP: u16 = 0x08;
const AL_ERROR: u16 = 0x10;

static PDUS: PduStorage<FRAMES, FRAME_MAX> = PduStorage::new();

pub type Master = MainDevice<'static>;
/// Slaves in PreOP.
pub type InPreOp<const N: usize = SLAVES_MAX, const I: usize = IMAGE_MAX> =
    SubDeviceGroup<N, I, DefaultLock, PreOp, NoDc>;
/// Slaves that were asked for OP.
pub type InOp<D = NoDc, const N: usize = SLAVES_MAX, const I: usize = IMAGE_MAX> =
    SubDeviceGroup<N, I, DefaultLock, Op, D>;

/// A master on an interface, whose frames go out in a thread of their own.
pub fn master(interface: &str) -> Master {
    let (tx, rx, pdus) = PDUS.try_split().expect("once");
    // An answer after the limit ends the task for good, and a busy machine answers late.
    let long = Duration::from_millis(1000);
    let timeouts = Timeouts { pdu: long, eeprom: long, mailbox_echo: long, ..Timeouts::default() };
    let config = MainDeviceConfig { dc_static_sync_iterations: 1000, ..MainDeviceConfig::default() };
    let task = tx_rx_task(interface, tx, rx).expect("the interface");
    // Whatever ends the task, each later exchange is a timeout.
    spawn(move || {
        if let Err(error) = block_on(task) {
            eprintln!("no frames go out any more: {error}");
        }
    });
    MainDevice::new(pdus, timeouts, config)
}

/// Finds the slaves and brings them to PreOP, with a long watchdog.
pub async fn scan<const N: usize, const I: usize>(master: &Master, count: usize) -> InPreOp<N, I> {
    let group = master.init_single_group::<N, I>(ethercat_now).await.expect("a scan");
    assert_eq!(group.len(), count, "slaves found");
    for slave in group.iter(master) {
        let set = slave.register_write(RegisterAddress::SyncManagerWatchdog, WATCHDOG).await;
        set.expect("the time of the watchdog");
    }
    group
}

/// The AL status of a slave and its code, as `SubDeviceRef::status` returns them, but read one after the other: that
/// function asks for the code twice at once and drops the request under way, whose answer ends the task of the frames.
pub async fn al_status<S>(slave: &SubDeviceRef<'_, S>) -> Result<(u16, AlStatusCode), Error> {
    let status = slave.register_read::<u16>(RegisterAddress::AlStatus).await?;
    let code = slave.register_read::<AlStatusCode>(RegisterAddress::AlStatusCode).await?;
    if status & AL_ERROR == 0 { Ok((status, code)) } else { Err(Error::SubDevice(code)) }
}

/// Goes from PreOP to OP.
pub async fn to_op<const N: usize, const I: usize>(master: &Master, group: InPreOp<N, I>) -> InOp<NoDc, N, I> {
    let group = group.into_pre_op_pdi(master).await.expect("process data");
    let group = group.into_safe_op(master).await.expect("SafeOP");
    let group = group.request_into_op(master).await.expect("OP is requested");
    wait_for("OP", async || cycle(master, &group).await.all_op()).await;
    group
}

/// Goes from PreOP to OP with SYNC0.
pub async fn to_op_with_clocks(master: &Master, mut group: InPreOp) -> InOp<HasDc> {
    group.iter_mut(master).for_each(|mut slave| slave.set_dc_sync(DcSync::Sync0));
    let group = group.into_pre_op_pdi(master).await.expect("process data");
    for _ in 0..200 {
        group.tx_rx_sync_system_time(master).await.expect("the time");
        Timer::after(CYCLE / 4).await;
    }
    let clocks =
        DcConfiguration { start_delay: Duration::from_millis(100), sync0_period: CYCLE, sync0_shift: Duration::ZERO };
    let group = group.configure_dc_sync(master, clocks).await.expect("clocks");
    let group = group.into_safe_op(master).await.expect("SafeOP");
    let group = group.request_into_op(master).await.expect("OP is requested");
    wait_for("OP", async || cycle(master, &group).await.all_op()).await;
    group
}

/// Exchanges process data once.
pub async fn cycle<D, const N: usize, const I: usize>(
    master: &Master,
    group: &InOp<D, N, I>,
) -> TxRxResponse<N, Option<u64>> {
    let answer = group.tx_rx_sync_system_time(master).await.expect("process data");
    Timer::after(CYCLE).await;
    answer
}

pub async fn cycles<D, const N: usize, const I: usize>(master: &Master, group: &InOp<D, N, I>, count: usize) {
    for _ in 0..count {
        cycle(master, group).await;
    }
}

/// Polls until a condition holds.
pub async fn wait_for(what: &str, mut is_so: impl AsyncFnMut() -> bool) {
    let begin = Instant::now();
    while !is_so().await {
        assert!(begin.elapsed() < LIMIT, "not within {LIMIT:?}: {what}");
    }
}

/// Makes a line of a script happen to the slaves.
pub fn fault(line: &str) {
    println!("fault: {line}");
    stdin().read_line(&mut String::new()).expect("the test answers");
}

/// The inputs of a slave.
pub fn inputs<D, const N: usize, const I: usize>(master: &Master, group: &InOp<D, N, I>, n: usize) -> Vec<u8> {
    group.subdevice(master, n).expect("a slave").inputs_raw().to_vec()
}

/// Sets the first outputs of a slave: controlword and target.
pub fn put<D, const N: usize, const I: usize>(
    master: &Master,
    group: &InOp<D, N, I>,
    n: usize,
    control: u16,
    target: i32,
) {
    let slave = group.subdevice(master, n).expect("a slave");
    let mut outputs = slave.outputs_raw_mut();
    outputs[..2].copy_from_slice(&control.to_le_bytes());
    outputs[2..6].copy_from_slice(&target.to_le_bytes());
}

/// Statusword and position of a servo drive.
pub fn drive<D, const N: usize, const I: usize>(master: &Master, group: &InOp<D, N, I>, n: usize) -> (u16, i32) {
    let inputs = inputs(master, group, n);
    assert_eq!(inputs.len(), 10, "inputs of a drive");
    (u16::from_le_bytes([inputs[0], inputs[1]]), i32::from_le_bytes([inputs[2], inputs[3], inputs[4], inputs[5]]))
}

/// Brings a servo drive to Operation enabled at its position, also out of Fault; returns its position.
pub async fn enable<D>(master: &Master, group: &InOp<D>, n: usize) -> i32 {
    let stand = drive(master, group, n).1;
    put(master, group, n, 0x80, stand);
    cycles(master, group, 10).await;
    for (control, state) in [(0x06, 0x21), (0x07, 0x23), (0x0F, OPERATION_ENABLED)] {
        put(master, group, n, control, stand);
        let reached = async || {
            cycle(master, group).await;
            drive(master, group, n).0 & STATE == state
        };
        wait_for(&format!("state {state:#x}"), reached).await;
    }
    stand
}
